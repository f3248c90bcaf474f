"""What reference subtraction leaves of the star in images without noise: many visits, propagated in full.

The ETC reads a table made from first-order responses to all wavefronts (`simulator.imaging.measure`). Here every image
is a propagation of its own, the residual is summed in circles wholly inside the squares and the annulus, and the mean
of the annulus around each circle is subtracted, as an observer would do it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_core import stream
from cpic_planner.etc.rates import annulus_apertures
from simulator.config import Drift, Instrument
from simulator.imaging import PsfMetrics, aperture_sums, build_imager, overlap_weights, visit_frames

FloatArray = NDArray[np.float64]
EXCLUDED = 1.5  # radii of an aperture around a planet that tell nothing of the background


@dataclass(frozen=True)
class Residual:
    """Rms of aperture sums per unit star in an annulus, with the standard error of so many independent visits."""

    rms: float
    error: float
    n_places: int


def visit_images(
    instrument: Instrument,
    band: str,
    drift: Drift,
    n_visits: int,
    *,
    seed: int,
    frames: int = 1,
    cadence_s: float = 60.0,
) -> FloatArray:
    """Mean star image of each visit, ``(n_visits, stamp, stamp)``."""
    imager = build_imager(instrument, band)
    visits = [(stream(seed, "offset", k), stream(seed, "walk", k)) for k in range(n_visits)]
    return np.stack([visit_frames(imager, drift, frames, cadence_s, *rngs).mean(axis=0) for rngs in visits])


def scatter(images: FloatArray, metrics: PsfMetrics, separation_arcsec: float, half_width_lambda_d: float) -> Residual:
    """Rms of a visit less another in apertures, about the mean of their annulus beyond 1.5 radii of each of them.

    What that mean adds to the variance, as the ETC counts it, is taken off.
    """
    pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
    weights = overlap_weights(radius / pixel)
    offset = (np.arange(images.shape[-1]) - images.shape[-1] // 2) * pixel
    distance = np.abs(np.hypot(offset[:, None], offset) - separation_arcsec)
    place = metrics.zone.covers(offset, offset, -radius)
    place &= distance <= half_width_lambda_d * metrics.lambda_d_arcsec - radius
    annulus = metrics.annulus(separation_arcsec, half_width_lambda_d)
    reach = np.arange(-int(EXCLUDED * radius / pixel), int(EXCLUDED * radius / pixel) + 1) * pixel
    disc = (np.hypot(reach[:, None], reach) <= EXCLUDED * radius).astype(float)

    def around(values: FloatArray) -> FloatArray:
        """Sum over the annulus without the disc around each place."""
        rings = values * annulus
        return rings.sum(axis=(-2, -1))[..., None] - aperture_sums(rings, disc)[..., place]

    mean = around(images) / around(np.ones(annulus.shape)) * weights.sum()
    left = aperture_sums(images, weights)[:, place] - mean
    squares = 2.0 * ((left - left.mean(axis=0)) ** 2).mean(axis=1) / (1.0 - 1.0 / len(left))
    squares /= 1.0 + 1.0 / annulus_apertures(metrics, half_width_lambda_d, separation_arcsec)
    rms = float(np.sqrt(squares.mean()))
    error = squares.std(ddof=1) / np.sqrt(len(squares)) / squares.mean() / 2.0
    return Residual(rms, rms * float(error), int(place.sum()))
