"""The stated planet that a star's numbers refer to, as configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from catalogs.errors import InputError
from catalogs.user_files import digest_of
from cpic_planner.queries.base import Parts, called
from cpic_planner.queries.fields import asked
from simulator.config.albedo import AlbedoSpec, AlbedoValue, MeasuredAlbedo, albedo_spec, names_file
from simulator.config.base import FrozenModel


class AlbedoParts(Parts):
    """Options of an albedo; parameters without a name mean the parametric model, with a file a grid of models."""

    albedo: str | None = asked(
        None,
        "jupiter, saturn, uranus, neptune, parametric, a number, or a file with wavelength and geometric albedo.",
        default_words="jupiter, or parametric where its parameters are given",
    )
    log10_mh: float | None = asked(None, "Parametric albedo: log10 of metallicity over solar, 0 to 2.")
    log10_fsed: float | None = asked(None, "Parametric albedo: log10 of the clouds' sedimentation efficiency, -2 to 2.")
    insolation_au: float | None = asked(
        None,
        "Parametric albedo: distance from the Sun of equal insolation.",
        default_words="r / sqrt(L) of the star",
    )
    phase_function: Literal["lambert", "grid"] | None = asked(
        None, "Parametric albedo: Lambert's, or that of the model grid.", default_words="lambert"
    )

    def made(self, base: Any) -> AlbedoSpec:
        """Return the albedo that the options name."""
        parameters = self.model_dump(exclude={"albedo"}, exclude_none=True)
        name = self.albedo
        if name is None:
            return albedo_spec({"model": "parametric"} | parameters)
        if names_file(name):
            if not Path(name).is_file():
                raise InputError("albedo", name, allowed="an existing file")
            return albedo_spec({"model": "grid" if parameters else "table", "file": name} | parameters)
        if name == "parametric":
            return albedo_spec({"model": "parametric"} | parameters)
        if parameters:
            raise InputError(
                next(iter(parameters)),
                f"given with {called('albedo')} {name}",
                allowed="one of the two",
                hint=f"parameters are those of {called('albedo')} parametric or of a grid of models",
            )
        try:
            number = float(name)
        except ValueError:
            return albedo_spec(name)
        return albedo_spec(number)


class ReferencePlanet(FrozenModel):
    """1 R_J at phase 90 deg on a hole diagonal, with the measured albedo of Jupiter.

    At phase 90 deg the true distance equals the projected one; at other phases it is ``rho / sin(phase)``. An albedo
    that follows the insolation takes it as ``r / sqrt(L)``.
    """

    radius_rjup: float = asked(1.0, "Planet radius in R_J = 71 492 km.", gt=0, le=10, option="--planet-radius-rjup")
    phase_deg: float = asked(90.0, "Phase angle.", gt=0, lt=180)
    albedo: AlbedoValue = asked(MeasuredAlbedo(model="jupiter"), "What the planet reflects.", parts=AlbedoParts)

    def content(self) -> dict[str, Any]:
        """Everything that decides its light, for content hashes: a file counts by what is in it."""
        tree = self.model_dump(mode="json")
        file = getattr(self.albedo, "file", None)
        if file is not None:
            tree["albedo"]["file"] = digest_of(file)
        return tree
