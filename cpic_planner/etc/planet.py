"""The stated planet that a ranked star's numbers refer to."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from catalogs.user_files import digest_of
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.reflected import reflected_contrast
from cpic_planner.targets import Targets
from simulator.config import FrozenModel
from simulator.config.albedo import AlbedoValue, MeasuredAlbedo
from simulator.target.albedo import albedo_notes, albedo_source
from simulator.target.phase import sin_phase

__all__ = ["ReferencePlanet", "reference_contrast", "reference_distance_au", "reference_notes"]

FloatArray = NDArray[np.float64]


class ReferencePlanet(FrozenModel):
    """1 R_J at phase 90 deg on a hole diagonal, with the measured albedo of Jupiter.

    At phase 90 deg the true distance equals the projected one; at other phases it is ``rho / sin(phase)``. An albedo
    that follows the insolation takes it as ``r / sqrt(L)``.
    """

    radius_rjup: Annotated[float, Field(gt=0, le=10)] = 1.0
    phase_deg: Annotated[float, Field(gt=0, lt=180)] = 90.0
    albedo: AlbedoValue = MeasuredAlbedo(model="jupiter")

    def content(self) -> dict[str, Any]:
        """Everything that decides its light, for content hashes: a file counts by what is in it."""
        tree = self.model_dump(mode="json")
        file = getattr(self.albedo, "file", None)
        if file is not None:
            tree["albedo"]["file"] = digest_of(file)
        return tree


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
