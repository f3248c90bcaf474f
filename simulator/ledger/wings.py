"""Light of sources off the axis where a sketch has no map: wings, the frame around the stamp, and lines across it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simulator.config import Instrument
from simulator.imaging.metrics import PsfMetrics
from simulator.signal.wings import wing

FloatArray = NDArray[np.float64]
MOST, MOST_BEYOND = 5.0, 20.0
"""Light in a pixel or an aperture over that of the wing map, at most, on it and beyond it: 4.6 out to 4 arcsec in the
four visible bands, where one pixel in a hundred has more than 3.8."""
# Light that a core leaves in one row or column, in peak pixels, and how far from its middle.
_CORE_PEAKS, _CORE_REACH_LD = 8.0, 3.0
# Means over the boxes of the wing map, over single rows and columns of them.
_LANE = 2.0
_BRIGHTEST = 12


def frame_reach(instrument: Instrument, band: str, pixel: float) -> tuple[float, float]:
    """Return the half sides of the frame, x and y, in arcsec.

    Parameters
    ----------
    instrument : Instrument
    band : str
    pixel : float
        Scale, arcsec.
    """
    detector = instrument.detector_of(band)
    x, y = (
        max(star, size - 1 - star)
        for star, size in ((detector.star_column, detector.n_columns), (detector.star_row, detector.n_rows))
    )
    return x * pixel, y * pixel


def beyond(
    metrics: PsfMetrics,
    rate_e_s: float,
    half: float,
    frame: tuple[float, float],
    sky_e_s: float,
    stars: Sequence[tuple[float, float, float]],
) -> tuple[FloatArray, float, tuple[float, float]]:
    """Return levels of pixels beyond the stamp, their largest sum over a column, the brightest in its columns and rows.

    A core holds the light of eight of its peak pixels in one column, the arm of a star beside the column some ten
    pixels of its wing.

    Parameters
    ----------
    metrics : PsfMetrics
    rate_e_s : float
        Of the central star.
    half : float
        Half side of the stamp, arcsec.
    frame : tuple of float
        Half sides of the frame, arcsec.
    sky_e_s : float
        On an open pixel.
    stars : sequence of tuple of float
        Place x and y, arcsec, and rate of the others.
    """
    step, pixel = metrics.wing_map_step_arcsec, metrics.pixel_scale_arcsec
    last = len(metrics.wing_map) // 2
    arm = np.arange(-last, last + 1) * step
    x, y = np.meshgrid(arm, arm)
    cross = np.minimum(np.abs(x), np.abs(y)) >= metrics.mask_half_width_arcsec
    outside = (np.maximum(np.abs(x), np.abs(y)) > half) & (np.abs(x) <= frame[0]) & (np.abs(y) <= frame[1])
    light = np.where(cross & outside, metrics.wing_map, 0.0) * rate_e_s
    column = float(light[:, np.abs(arm) <= half].sum(axis=0).max()) * step / pixel + sky_e_s * 2.0 * frame[1] / pixel
    brightest = rate_e_s * metrics.peak_on_axis_frame
    in_columns, in_rows = rate_e_s * metrics.peak_on_axis_columns, rate_e_s * metrics.register_tail
    for at_x, at_y, rate in stars:
        seen = abs(at_x) <= frame[0] and abs(at_y) <= frame[1]
        peak = rate * metrics.peak_off_axis
        if seen:
            brightest = max(brightest, peak)
        if seen and abs(at_x) <= half:
            in_columns = max(in_columns, peak)
        if seen and abs(at_y) <= half:
            in_rows = max(in_rows, peak)
        if seen and abs(at_x) <= half:
            column += 8.0 * peak
        else:
            column += 10.0 * MOST * rate * float(wing(metrics, max(abs(at_x) - half, pixel), 0.0))
    levels = light[outside] * MOST + sky_e_s
    return np.concatenate([levels, [brightest, sky_e_s, 0.0]]), column, (in_columns, in_rows)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The frame around the stamp, for what runs along its rows and columns.

    Attributes
    ----------
    metrics : PsfMetrics
    star_e_s : float
        Rate of the star behind the mask.
    stars : tuple of (float, float, float)
        Place in arcsec and rate of every other source.
    half_arcsec : float
        Half side of the stamp.
    frame_arcsec : tuple of float
        Half sides of the frame, x and y.
    sky_e_s : float
        On an open pixel.
    """

    metrics: PsfMetrics
    star_e_s: float
    stars: tuple[tuple[float, float, float], ...]
    half_arcsec: float
    frame_arcsec: tuple[float, float]
    sky_e_s: float

    def lanes(self, places_arcsec: FloatArray, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Light along rows or columns beyond the stamp, electrons per second and pixel.

        Parameters
        ----------
        places_arcsec : ndarray, shape (k,)
            Of the rows (``axis="x"``) or columns (``"y"``), from the star.
        axis : {"x", "y"}
            Along which they run.
        sign : {-1, 1}
            Side of the stamp.

        Returns
        -------
        light : ndarray, shape (k, m)
            At most, in boxes; nearest to the stamp first.
        pixels : float
            Length of a box.
        """
        figures, across = self.metrics, np.asarray(places_arcsec, dtype=np.float64)[:, None]
        step, edge = figures.wing_map_step_arcsec, self.frame_arcsec[axis == "y"]
        n = max(int(np.ceil((edge - self.half_arcsec) / step)), 0)
        along: FloatArray = np.asarray(sign * (self.half_arcsec + step * (np.arange(n) + 0.5)), dtype=np.float64)[
            None, :
        ]
        pixel, open_lane = figures.pixel_scale_arcsec, np.abs(across) > figures.mask_half_width_arcsec
        light = np.full((len(across), n), self.sky_e_s)
        if self.star_e_s > 0:
            light = light + _LANE * self.star_e_s * _pair(figures, along, across, axis) * open_lane
        reach = _CORE_REACH_LD * figures.lambda_d_arcsec
        for rank, (x, y, rate) in enumerate(sorted(self.stars, key=lambda star: -star[2])):
            here, beside = (x, y) if axis == "x" else (y, x)
            if rank < _BRIGHTEST:
                light = light + _LANE * rate * _pair(figures, along - here, across - beside, axis)
            # A row or column through a core holds much of its light; wings of the many faint stars are nothing to it.
            if across.min() - reach <= beside <= across.max() + reach:
                core = (np.abs(across - beside) <= reach) & (np.abs(along - here) <= 0.5 * step + reach)
                light = light + core * (_CORE_PEAKS * rate * figures.peak_off_axis * pixel / step)
        return light, step / pixel


def _pair(metrics: PsfMetrics, along: FloatArray, across: FloatArray, axis: str) -> FloatArray:
    return wing(metrics, along, across) if axis == "x" else wing(metrics, across, along)
