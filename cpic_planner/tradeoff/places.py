"""Where the noise is measured: apertures of the hole beside the planet's, and what is expected of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_planner.tradeoff.scenes import FixedScene
from cpic_planner.tradeoff.setup import Setup, visit
from simulator.camera.noise import FrameNoise
from simulator.imaging.aperture import aperture_sums, overlap_weights
from simulator.imaging.imager import centred_axis
from simulator.imaging.store import psf_metrics
from simulator.knobs import FIDELITIES
from simulator.target.sources import scene_sources

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
ANNULUS_LAMBDA_D = 2.0
"""Half width of the annulus whose apertures measure the speckles."""
_AWAY_RADII = 2.5


@dataclass(frozen=True, eq=False)
class Places:
    """Apertures on the stamp around the mask; made by `Places.of`.

    Attributes
    ----------
    white : ndarray of bool, shape (n, n)
        Centres of apertures wholly inside the hole, none of which touches the planet.
    near : ndarray of bool, shape (n, n)
        Those of them near the planet's separation.
    annulus : ndarray of bool, shape (n, n)
        Pixels of the hole near that separation.
    weights : ndarray
        Of the pixels of an aperture.
    level : ndarray, shape (n, n)
        Expected white variance of the planet's aperture, without its own light, over that of the aperture on each
        pixel: halo and companions differ from place to place.
    star_e_s, source_noise_fraction : float
        Light of the star on the clear disc, and `PsfMetrics.source_noise_fraction`.
    """

    white: BoolArray
    near: BoolArray
    annulus: BoolArray
    weights: FloatArray
    level: FloatArray
    star_e_s: float
    source_noise_fraction: float

    @classmethod
    def of(cls, case: FixedScene) -> Places:
        """Those of a scene: the same for every way, so that ways can be compared."""
        metrics = psf_metrics(case.instrument, case.band)
        alone = case.scene.model_copy(update={"stars": (), "extended": ()})
        star, planet, *_ = scene_sources(alone, case.instrument, case.band)
        pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
        offset = centred_axis(len(metrics.raw_contrast), pixel)
        separation = np.hypot(planet.x_arcsec, planet.y_arcsec)
        distance = np.abs(np.hypot(offset[:, None], offset) - separation)
        around = distance <= ANNULUS_LAMBDA_D * metrics.lambda_d_arcsec
        away = np.hypot(offset[:, None] - planet.y_arcsec, offset - planet.x_arcsec) > _AWAY_RADII * radius
        white = metrics.zone.covers(offset, offset, -radius) & away
        weights = overlap_weights(radius / pixel)
        at = int(np.abs(offset - planet.y_arcsec).argmin()), int(np.abs(offset - planet.x_arcsec).argmin())
        return cls(
            white=white,
            near=white & around,
            annulus=metrics.zone.covers(offset, offset) & around,
            weights=weights,
            level=_level(case, weights, at),
            star_e_s=star.rate_e_s,
            source_noise_fraction=metrics.source_noise_fraction,
        )


def _level(case: FixedScene, weights: FloatArray, at: tuple[int, int]) -> FloatArray:
    """Closed-form variance at the planet over that at each place, from the expected light at quick knobs."""
    seen = visit(
        case, Setup("frames", "hole", FIDELITIES["quick"], 1, scene_model=case.scene_model), planets=False, n_frames=1
    )
    noise = FrameNoise.of(seen.instrument.detector_of(case.band), case.em_gain, case.exposure_s)
    sums = aperture_sums(noise.charge_variance_e2(seen.expected_e + noise.clock_e), weights**2)
    return np.where(sums > 0, sums[at] / np.where(sums > 0, sums, 1.0), 1.0)
