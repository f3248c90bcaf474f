"""What reference subtraction leaves of the star in images without noise: many pairs of visits, propagated in full.

The ETC reads a table made from first-order responses to other random wavefronts (`simulator.imaging.measure`). Here
every image is a propagation of its own, the residual is summed in circles wholly inside the squares, and the mean of
the annulus is subtracted, as an observer would do it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_core import stream
from simulator.config import Drift, Instrument
from simulator.imaging import PsfMetrics, aperture_sums, build_imager, overlap_weights, visit_frames

__all__ = ["Residual", "residuals", "scatter"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Residual:
    """Rms of aperture sums per unit star in an annulus, with its standard error."""

    rms: float
    error: float
    n_places: int


def residuals(
    instrument: Instrument,
    band: str,
    drift: Drift,
    n_visits: int,
    *,
    seed: int,
    frames: int = 1,
    cadence_s: float = 60.0,
) -> FloatArray:
    """Mean star image of each visit less that of the next one, ``(n_visits, stamp, stamp)``."""
    imager = build_imager(instrument, band)
    images = np.stack(
        [
            visit_frames(imager, drift, frames, cadence_s, stream(seed, "offset", k), stream(seed, "walk", k)).mean(
                axis=0
            )
            for k in range(n_visits)
        ]
    )
    return images - np.roll(images, 1, axis=0)


def scatter(left: FloatArray, metrics: PsfMetrics, separation_arcsec: float, half_width_lambda_d: float) -> Residual:
    """Scatter of apertures wholly inside the dark squares and inside the annulus, about the mean of the annulus."""
    pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
    weights = overlap_weights(radius / pixel)
    offset = (np.arange(left.shape[-1]) - left.shape[-1] // 2) * pixel
    inside = metrics.zone.covers(offset, offset, -radius)
    distance = np.abs(np.hypot(offset[:, None], offset) - separation_arcsec)
    place = inside & (distance <= half_width_lambda_d * metrics.lambda_d_arcsec)
    mean = left[:, metrics.annulus(separation_arcsec, half_width_lambda_d)].mean(axis=1) * weights.sum()
    squares = ((aperture_sums(left, weights)[:, place] - mean[:, None]) ** 2).mean(axis=1)
    # Every visit serves twice: two thirds of the pairs are worth counting as independent.
    error = squares.std(ddof=1) / np.sqrt(len(squares) / 1.5) / squares.mean() / 2.0
    rms = float(np.sqrt(squares.mean()))
    return Residual(rms, rms * float(error), int(place.sum()))
