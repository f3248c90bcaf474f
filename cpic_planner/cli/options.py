"""Options with one name, one meaning and one help text across all commands."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, TypeAlias

import typer

from cpic_planner.etc.planet import ReferencePlanet
from simulator.config.base import validate

__all__ = [
    "AlbedoOption",
    "BandOption",
    "CompanionsOption",
    "DwarfsOption",
    "FidelityOption",
    "InstrumentOption",
    "JsonOption",
    "OnOff",
    "PhaseOption",
    "RadiusOption",
    "SinglesOption",
    "Tier",
    "TimeOption",
    "VMaxOption",
    "planet_from",
]  # fmt: skip

DEFAULT_TIME_S = 36000.0


class OnOff(StrEnum):
    """A choice written ``on`` or ``off``."""

    ON = "on"
    OFF = "off"


class Tier(StrEnum):
    """Named fidelity."""

    QUICK = "quick"
    STANDARD = "standard"
    REFERENCE = "reference"


JsonOption: TypeAlias = Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")]
BandOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--band", help="Band, e.g. F662; repeat for several [default: all visible bands]."),
]
TimeOption: TypeAlias = Annotated[
    float,
    typer.Option("--time-s", help="Wall time per target and band in s, readouts and reference frames included."),
]
InstrumentOption: TypeAlias = Annotated[
    str | None,
    typer.Option("--instrument", help="Preset name or YAML file with what differs [default: cpic_default]."),
]
CompanionsOption: TypeAlias = Annotated[
    OnOff, typer.Option("--companions", help="Count the light of known stellar companions.")
]
RadiusOption: TypeAlias = Annotated[
    float, typer.Option("--planet-radius-rjup", help="Planet radius in R_J = 71 492 km.")
]
PhaseOption: TypeAlias = Annotated[float, typer.Option("--phase-deg", help="Phase angle, above 0 and below 180 deg.")]
AlbedoOption: TypeAlias = Annotated[
    str, typer.Option("--albedo", help="Geometric-albedo template: jupiter, saturn, uranus, neptune.")
]
DwarfsOption: TypeAlias = Annotated[bool, typer.Option("--dwarfs", help="Dwarfs only (luminosity class V or IV-V).")]
SinglesOption: TypeAlias = Annotated[bool, typer.Option("--singles", help="Stars without a close companion only.")]
VMaxOption: TypeAlias = Annotated[float, typer.Option("--v-mag-max", help="Faintest V magnitude.")]
FidelityOption: TypeAlias = Annotated[Tier, typer.Option("--fidelity", help="Speed against accuracy of the images.")]


def planet_from(radius_rjup: float, phase_deg: float, albedo: str) -> ReferencePlanet:
    """Reference planet from options, refused in one line when out of range."""
    from catalogs.spectra import load_albedo

    load_albedo(albedo)
    tree = {"radius_rjup": radius_rjup, "phase_deg": phase_deg, "albedo": albedo}
    return validate(ReferencePlanet, tree, where="planet")
