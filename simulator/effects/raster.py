"""An image of whole electrons that tracks are added to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulator.effects.tracks import REACH_SIGMA, Points, Tracks
from simulator.lazy import load_kernels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Canvas:
    """Electrons of an array of pixels, whose centres lie at integers; ``image`` has the shape of the array."""

    def __init__(self, shape: tuple[int, int]) -> None:
        size = shape[0] * shape[1]
        self.image: IntArray = np.zeros(shape, dtype=np.int64)
        self._work = np.zeros(size)
        self._touched = np.empty(size, dtype=np.int64)

    def add(
        self,
        tracks: Tracks,
        points: Points,
        row: FloatArray,
        column: FloatArray,
        azimuth: FloatArray,
        charge_e: IntArray,
    ) -> IntArray:
        """Add placed tracks.

        Parameters
        ----------
        tracks, points
            Shapes, and their points.
        row, column : ndarray
            Places of the middles.
        azimuth : ndarray
            Direction in radians, from columns towards rows.
        charge_e : ndarray of int
            Charge, above 0.

        Returns
        -------
        ndarray of int
            Electrons of each track that fell inside the array; the rest fell outside.
        """
        deposit = load_kernels("simulator.effects.deposit").deposit
        owner = np.repeat(np.arange(row.size), np.diff(points.start))
        sine, cosine = np.sin(azimuth)[owner], np.cos(azimuth)[owner]
        left = np.zeros(row.size, dtype=np.int64)
        if row.size:
            share = np.empty(2 * int(np.ceil(REACH_SIGMA * tracks.sigma_pixels.max())) + 3)
            deposit(
                points.start,
                row[owner] + points.along * sine + points.across * cosine,
                column[owner] + points.along * cosine - points.across * sine,
                points.weight,
                tracks.sigma_pixels,
                REACH_SIGMA,
                charge_e,
                *self.image.shape,
                self._work,
                self.image.reshape(-1),
                self._touched,
                share,
                left,
            )
        return left
