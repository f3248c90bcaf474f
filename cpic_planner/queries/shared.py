"""Fields that several questions share: the instrument and its bands, the stars, the planets that are counted, runs."""

from __future__ import annotations

import functools
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from catalogs.errors import InputError
from cpic_planner.jobs.engine import check_address
from cpic_planner.population_config import PopulationConfig, load_population
from cpic_planner.queries.base import Parts, Question, called
from cpic_planner.queries.changes import Change, changed
from cpic_planner.queries.fields import asked
from cpic_planner.queries.planet import ReferencePlanet
from simulator.config import Instrument, load_instrument
from simulator.config.mission import Utc

DEFAULT_TIME_S = 36000.0
N_PLANETS = 4000
"""Planets that a ranking draws."""
MAX_PLANETS = 1_000_000
MAX_REALISATIONS = 100_000
OnOff = Literal["on", "off"]
Fidelity = Literal["quick", "standard", "reference"]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


def several(value: Any) -> Any:
    """Return a single value as a tuple of one, and a list as a tuple."""
    if value is None or isinstance(value, tuple):
        return value
    return tuple(value) if isinstance(value, list | set) or hasattr(value, "tolist") else (value,)


Texts = Annotated[tuple[str, ...], BeforeValidator(several)]


@functools.lru_cache(maxsize=1)
def default_instrument() -> Instrument:
    """Return the shipped instrument, always the same object."""
    return load_instrument()


def read_instrument(source: Any) -> Instrument:
    """Return an instrument from what people write; see `simulator.load_instrument`."""
    return source if isinstance(source, Instrument) else load_instrument(source)


class InstrumentParts(Parts):
    """Options of the instrument."""

    instrument: str | None = asked(None, "Preset name or YAML file with what differs.", default_words="cpic_default")
    exozodi_zodis: float | None = asked(
        None,
        "Dust around the star, in units of the solar system's.",
        option="--exozodi",
        default_words="that of the instrument, 0",
    )

    def made(self, base: Any) -> Instrument:
        """Return the instrument with what is changed of it."""
        given = base if self.instrument is None else self.instrument
        built = default_instrument() if given is None else read_instrument(given)
        if self.exozodi_zodis is None:
            return built
        return changed(built, (Change(key="sky.exozodi_zodis", value=self.exozodi_zodis),))


class InstrumentQuestion(Question):
    """A question about an instrument and some of its bands."""

    instrument: Instrument = asked(
        default_instrument,
        "The instrument: a preset, a YAML file or a mapping with what differs.",
        parts=InstrumentParts,
        read=read_instrument,
        accepts="Instrument, mapping, str or Path, optional",
    )
    bands: Texts | None = asked(
        None,
        "Band, e.g. F662; repeat for several.",
        option="--band",
        default_words="all visible bands",
        accepts="sequence of str, optional",
    )

    def band_names(self) -> tuple[str, ...]:
        """Return the bands that are asked for, all of the visible camera without any."""
        return self.bands or self.instrument.visible_bands()


class CatalogQuestion(Question):
    """A question about stars of a table."""

    # A table counts by what is read of it, which is in the hashes of results.
    catalog: Any = asked(
        "snapshot",
        "Star table: snapshot, latest (made by cpic catalog refresh), simbad_2012 (the snapshot with companions where "
        "they were first listed), or a CSV, ECSV, VOTable or FITS file.",
        physics=False,
        command=str,
        accepts="str, Path or Catalogue, optional",
    )


class StarsQuestion(CatalogQuestion):
    """A question about stars and the companions that they have."""

    companions: OnOff = asked("on", "Count the light of known stellar companions.")


class CutsQuestion(StarsQuestion):
    """A question about all stars of a table within some cuts."""

    v_mag_max: float | None = asked(None, "Faintest V magnitude.", default_words="7; none for a table of your own")
    dwarfs_only: bool = asked(False, "Dwarfs only (luminosity class V or IV-V).", option="--dwarfs")
    singles_only: bool = asked(
        False,
        "Without stars that the table flags as close pairs (the snapshot's flag is SIMBAD's).",
        option="--singles",
    )


class KnownPlanetsQuestion(Question):
    """A question that known planets at a date can be part of."""

    # They count by what is read of them, which is in the hash of the ranking.
    known_planets: str | None = asked(
        None,
        "Table of known planets: snapshot (NASA Exoplanet Archive of 2019 with the updates since), archive_2019 "
        "(without them), or a CSV, ECSV, VOTable or FITS file, which is laid over the snapshot planet by planet; "
        "none+FILE takes the file alone. In a ranking or a plan it stands instead of a population; whatif counts them "
        "beside it, and off leaves them out.",
        physics=False,
        read=str,
    )
    date_utc: Utc | None = asked(
        None,
        "Date of the known planets' places, UTC.",
        option="--date",
        default_words="the mission's start",
        physics=False,
    )


class CountedPlanetsQuestion(KnownPlanetsQuestion):
    """A question about the planets that completeness counts: of a population, or known ones."""

    planet: ReferencePlanet = asked(
        ReferencePlanet(), "The reference planet.", accepts="ReferencePlanet or mapping, optional"
    )
    population: PopulationConfig = asked(
        load_population,
        "Planets that completeness refers to: giants, jupiters, solar_system, or a YAML file.",
        read=load_population,
        default_words="giants",
        accepts="PopulationConfig, mapping, str or Path, optional",
    )
    n_planets: int = asked(
        N_PLANETS,
        "Planets drawn from the population, or draws of each known planet.",
        ge=1,
        le=MAX_PLANETS,
        option="--planets",
    )

    def check_planets(self) -> None:
        """Refuse a population beside known planets, and a date without them."""
        if self.known_planets is not None and "population" in self.model_fields_set:
            raise InputError(
                "population",
                f"given with {called('known_planets')}",
                allowed="one of the two",
                hint="known planets stand instead of a hypothetical population",
            )
        if self.known_planets is None and self.date_utc is not None:
            raise InputError(
                "date_utc",
                self.date_utc,
                allowed=f"only with {called('known_planets')}",
                hint="nothing else depends on a date",
            )


class RunQuestion(Question):
    """How a run is made: nothing here decides a number."""

    workers: int = asked(
        1, "Local worker processes; results do not depend on their number.", ge=1, le=256, physics=False
    )
    scheduler: str | None = asked(
        None, "Dask scheduler to use instead, tcp://host:port.", physics=False, read=check_address
    )
    force: bool = asked(
        False,
        "Remove what a run of another configuration wrote into {out}, and nothing else.",
        physics=False,
    )
