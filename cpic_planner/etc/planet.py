"""The stated planet that a ranked star's numbers refer to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.reflected import reflected_contrast
from cpic_planner.queries.planet import ReferencePlanet
from cpic_planner.targets import Targets
from simulator.target.albedo import albedo_notes, albedo_source
from simulator.target.phase import sin_phase

__all__ = ["ReferencePlanet", "reference_contrast", "reference_distance_au", "reference_notes"]

FloatArray = NDArray[np.float64]


def reference_distance_au(targets: Targets, separation_arcsec: FloatArray, planet: ReferencePlanet) -> FloatArray:
    """True star-planet distance in au, shape ``(n_star, n_separation)``; 1 arcsec at 1 pc is 1 au.

    Separations are the same for all stars, ``(n_separation,)``, or one row for each.
    """
    projected = targets.distance_pc[:, None] * np.atleast_2d(separation_arcsec)
    return np.asarray(projected / sin_phase(planet.phase_deg))


def reference_notes(
    model: EtcModel, target: Targets, band: str, separation_arcsec: float, planet: ReferencePlanet
) -> tuple[str, ...]:
    """What was clamped or extrapolated in the reference planet of one star, as flags."""
    distance = float(reference_distance_au(target, np.array([separation_arcsec]), planet)[0, 0])
    notes = albedo_notes(planet.albedo, distance / float(np.sqrt(target.luminosity_lsun[0])))
    beyond = model.passbands.albedo_flags(albedo_source(planet.albedo))[model.passbands.index(band)]
    return (*notes, "extrapolated") if beyond else notes


def reference_contrast(
    model: EtcModel, targets: Targets, band: str, separation_arcsec: FloatArray, planet: ReferencePlanet
) -> FloatArray:
    """Contrast of the reference planet in one band, ``(n_star, n_separation)``; as `reference_distance_au`."""
    distance = reference_distance_au(targets, separation_arcsec, planet)
    return reflected_contrast(model, targets, band, planet.albedo, planet.radius_rjup, distance, planet.phase_deg)
