"""The stated planet that a ranked star's numbers refer to."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cpic_planner.etc.model import EtcModel
from cpic_planner.targets import Targets
from simulator.config import FrozenModel
from simulator.target.contrast import contrast_at

__all__ = ["ReferencePlanet", "reference_contrast", "reference_distance_au"]

FloatArray = NDArray[np.float64]


class ReferencePlanet(FrozenModel):
    """1 R_J at phase 90 deg on a hole diagonal, with the measured albedo of Jupiter.

    At phase 90 deg the true distance equals the projected one; at other phases it is ``rho / sin(phase)``.
    """

    radius_rjup: Annotated[float, Field(gt=0, le=10)] = 1.0
    phase_deg: Annotated[float, Field(gt=0, lt=180)] = 90.0
    albedo: str = "jupiter"


def reference_distance_au(targets: Targets, separation_arcsec: FloatArray, planet: ReferencePlanet) -> FloatArray:
    """True star-planet distance in au, shape ``(n_star, n_separation)``; 1 arcsec at 1 pc is 1 au."""
    projected = targets.distance_pc[:, None] * np.atleast_1d(separation_arcsec)[None, :]
    return projected / np.sin(np.radians(planet.phase_deg))


def reference_contrast(
    model: EtcModel, targets: Targets, band: str, separation_arcsec: FloatArray, planet: ReferencePlanet
) -> FloatArray:
    """Contrast of the reference planet in one band, ``(n_star, n_separation)``; ``(n_separation,)`` for one star."""
    distance = reference_distance_au(targets, separation_arcsec, planet)
    column = model.passbands.names.index(band)
    albedo = model.passbands.band_albedo(planet.albedo, targets.teff_k, targets.log_g, targets.metallicity)[:, column]
    contrast = np.asarray(contrast_at(planet.radius_rjup, distance, planet.phase_deg, albedo[:, None]))
    return contrast[0] if len(targets) == 1 else contrast
