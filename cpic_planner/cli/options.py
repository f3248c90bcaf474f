"""Options with one name, one meaning and one help text across all commands."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from catalogs.errors import InputError
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.registry.scores import SCORES
from simulator.config.albedo import AlbedoSpec, albedo_spec, names_file
from simulator.config.base import validate

if TYPE_CHECKING:
    from cpic_planner.known_completeness import KnownChoice
    from cpic_planner.population import PopulationChoice
    from simulator.config import Instrument

    ScoreText: TypeAlias = str
else:
    ScoreText = SCORES.literal()

__all__ = [
    "AlbedoOption",
    "BandOption",
    "CatalogOption",
    "CloudsOption",
    "CompanionsOption",
    "DateOption",
    "DwarfsOption",
    "FidelityOption",
    "ForceOption",
    "InsolationOption",
    "InstrumentOption",
    "JsonOption",
    "KnownPlanetsOption",
    "MetallicityOption",
    "OnOff",
    "PhaseFunction",
    "PhaseFunctionOption",
    "PhaseOption",
    "PlanetsOption",
    "PopulationOption",
    "RadiusOption",
    "RealisationsOption",
    "ScoreOption",
    "SeedOption",
    "SinglesOption",
    "Tier",
    "TimeOption",
    "ToleranceOption",
    "VMaxOption",
    "albedo_from",
    "known_from",
    "planet_from",
    "population_from",
    "refuse_date_alone",
]

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


class PhaseFunction(StrEnum):
    """How a planet's brightness falls with phase."""

    LAMBERT = "lambert"
    GRID = "grid"


ForceOption: TypeAlias = Annotated[
    bool, typer.Option("--force", help="Remove what a run of another configuration wrote into --out, and nothing else.")
]
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
    str | None,
    typer.Option(
        "--albedo",
        help="jupiter, saturn, uranus, neptune, parametric, a number, or a file with wavelength and geometric albedo "
        "[default: jupiter, or parametric where its parameters are given].",
    ),
]
MetallicityOption: TypeAlias = Annotated[
    float | None, typer.Option("--log10-mh", help="Parametric albedo: log10 of metallicity over solar, 0 to 2.")
]
CloudsOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--log10-fsed", help="Parametric albedo: log10 of the clouds' sedimentation efficiency, -2 to 2."),
]
InsolationOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--insolation-au",
        help="Parametric albedo: distance from the Sun of equal insolation [default: r / sqrt(L) of the star].",
    ),
]
PhaseFunctionOption: TypeAlias = Annotated[
    PhaseFunction | None,
    typer.Option(
        "--phase-function", help="Parametric albedo: Lambert's, or that of the model grid [default: lambert]."
    ),
]
DwarfsOption: TypeAlias = Annotated[bool, typer.Option("--dwarfs", help="Dwarfs only (luminosity class V or IV-V).")]
SinglesOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--singles", help="Without stars that the table flags as close pairs (the snapshot's flag is SIMBAD's)."
    ),
]
VMaxOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--v-mag-max", help="Faintest V magnitude [default: 7; none for a table of your own]."),
]
CatalogOption: TypeAlias = Annotated[
    str,
    typer.Option(
        "--catalog",
        help="Star table: snapshot, latest (made by cpic catalog refresh), simbad_2012 (the snapshot with companions "
        "where they were first listed), or a CSV, ECSV, VOTable or FITS file.",
    ),
]
ScoreOption: TypeAlias = Annotated[ScoreText, typer.Option("--score", help="What the ranking is by.")]
PopulationOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--population",
        help="Planets that completeness refers to: giants, jupiters, solar_system, or a YAML file [default: giants].",
    ),
]
PlanetsOption: TypeAlias = Annotated[
    int | None, typer.Option("--planets", help="Planets drawn from the population [default: 4000].")
]
KnownPlanetsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--known-planets",
        help="Table of known planets: snapshot (NASA Exoplanet Archive of 2019 with the updates since), archive_2019 "
        "(without them), or a CSV, ECSV, VOTable or FITS file, which is laid over the snapshot planet by planet; "
        "none+FILE takes the file alone. In a ranking or a plan it stands instead of a population; whatif counts them "
        "beside it, and off leaves them out.",
    ),
]
DateOption: TypeAlias = Annotated[
    str | None,
    typer.Option("--date", help="Date of the known planets' places, UTC [default: the mission's start]."),
]
SeedOption: TypeAlias = Annotated[int, typer.Option("--seed", min=0, help="Seed of every random number.")]
RealisationsOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--realisations",
        min=1,
        max=100_000,
        help="Made-up observations of every planet and band, each with its own drift and noise [default: 8].",
    ),
]
FidelityOption: TypeAlias = Annotated[
    Tier | None, typer.Option("--fidelity", help="Speed against accuracy of the images [default: standard].")
]
ToleranceOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        help="Instead of --fidelity: the cheapest images whose planet flux and SNR are predicted to be this close to "
        "the reference, 0 to 0.5.",
    ),
]


def albedo_from(
    albedo: str | None,
    log10_mh: float | None,
    log10_fsed: float | None,
    insolation_au: float | None,
    phase_function: PhaseFunction | None,
) -> AlbedoSpec:
    """Albedo from options; parameters without a name mean the parametric model, with a file a grid of models."""
    given: dict[str, Any] = {
        "log10_mh": log10_mh,
        "log10_fsed": log10_fsed,
        "insolation_au": insolation_au,
        "phase_function": phase_function.value if phase_function else None,
    }
    parameters = {key: value for key, value in given.items() if value is not None}
    if albedo is None:
        return albedo_spec({"model": "parametric"} | parameters if parameters else "jupiter")
    if names_file(albedo):
        if not Path(albedo).is_file():
            raise InputError("--albedo", albedo, allowed="an existing file")
        return albedo_spec({"model": "grid" if parameters else "table", "file": albedo} | parameters)
    if albedo == "parametric":
        return albedo_spec({"model": "parametric"} | parameters)
    if parameters:
        option = "--" + next(iter(parameters)).replace("_", "-")
        raise InputError(
            option,
            f"given with --albedo {albedo}",
            allowed="one of the two",
            hint="parameters are those of --albedo parametric or of a grid of models",
        )
    try:
        number = float(albedo)
    except ValueError:
        return albedo_spec(albedo)
    return albedo_spec(number)


def planet_from(radius_rjup: float, phase_deg: float, albedo: AlbedoSpec) -> ReferencePlanet:
    """Reference planet from options, refused in one line when out of range."""
    tree = {"radius_rjup": radius_rjup, "phase_deg": phase_deg, "albedo": albedo}
    return validate(ReferencePlanet, tree, where="planet")


def population_from(source: str | None, n_planets: int | None, seed: int) -> PopulationChoice:
    """Population, number of planets and seed from options."""
    from cpic_planner.population import MAX_PLANETS, N_PLANETS, PopulationChoice
    from cpic_planner.population_config import load_population
    from simulator.quantities import check_whole

    drawn = check_whole("--planets", N_PLANETS if n_planets is None else n_planets, 1, MAX_PLANETS)
    return PopulationChoice(load_population(source), drawn, seed)


def refuse_date_alone(date: str | None, known_planets: str | None) -> None:
    """Refuse a date without known planets."""
    if date is not None and known_planets is None:
        raise InputError("--date", date, allowed="only with --known-planets", hint="nothing else depends on a date")


def known_from(
    source: str | None,
    date: str | None,
    n_draws: int | None,
    seed: int,
    albedo: AlbedoSpec,
    instrument: Instrument,
    *,
    draws_option: str = "--planets",
) -> KnownChoice:
    """Known planets at a date from options."""
    from cpic_planner.known_completeness import MAX_DRAWS, N_DRAWS, KnownChoice
    from simulator.quantities import check_whole

    drawn = check_whole(draws_option, N_DRAWS if n_draws is None else n_draws, 1, MAX_DRAWS)
    return KnownChoice.at(source or "snapshot", date, albedo, instrument, n_draws=drawn, seed=seed)
