"""The questions of ``cpic rank``, ``cpic known`` and ``cpic visibility``.

Which stars promise most, where the known planets are at a date, and when stars can be seen from the orbit.
"""

import inspect
import re
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import model_validator

from cpic_core import InputError, is_file, read_text, unguarded
from cpic_planner.planets import MAX_PLANETS, N_PLANETS, PopulationConfig, load_population
from cpic_planner.queries import shared
from cpic_planner.queries.base import called, check_visits
from cpic_planner.queries.changes import InstrumentParts, read_instrument
from cpic_planner.queries.ensemble import Ensemble, EnsembleChoice, load_ensemble
from cpic_planner.queries.etc import KnownPlanetsQuestion
from cpic_planner.queries.fields import asked, asked_visit_time
from cpic_planner.queries.shared import EXCLUSIONS
from cpic_planner.registry import DEFAULT_SCORE, ScoreName
from simulator.config import AlbedoValue, Instrument, MeasuredAlbedo, load_instrument, preset_names

DEFAULT_YEARS = 5.0


class KnownQuestion(shared.InstrumentQuestion, shared.CatalogQuestion, KnownPlanetsQuestion):
    """Say where the known planets are at a date, how bright, and when the dark hole covers them."""

    KIND: ClassVar[str] = "known"

    star: str | None = asked(
        None, 'Star: "eps Eri", "HIP 16537" ...', argument=True, metavar="[STAR]", completes=shared.star_names
    )
    years: float | None = asked(None, "How long the star's planets are followed.", unset=f"{DEFAULT_YEARS:g}")
    albedo: AlbedoValue = asked(MeasuredAlbedo(model="jupiter"), "What the planets reflect.", parts=shared.AlbedoParts)
    v_mag_max: float | None = asked(None, "Faintest V magnitude.", unset="7; none for a table of your own")
    n_draws: int = asked(4000, "Draws of each planet.", ge=1, le=100_000, option="--planets")
    seed: shared.Seed = asked(1, "Seed of every random number.")

    @model_validator(mode="after")
    def _of_a_star(self) -> Self:
        if self.star is None and self.years is not None:
            raise InputError("years", self.years, allowed=f"only with a {called('star')}")
        if self.star is not None and self.v_mag_max is not None:
            raise InputError("v_mag_max", self.v_mag_max, allowed=f"only without a {called('star')}")
        return self


class VisibilityQuestion(shared.CatalogQuestion):
    """Say when stars can be seen from the orbit of the telescope, and for how long per orbit.

    The places of the stars are those of ``date_utc``, which is also the first day where none is given, and of the first
    day without it.
    """

    KIND: ClassVar[str] = "visibility"

    target: shared.Texts = asked(
        ...,
        'Stars: "HIP 8102", "tau Cet", "alpha Cen B" ...',
        min_length=1,
        argument=True,
        metavar="TARGET...",
        accepts="str or sequence of str",
        completes=shared.star_names,
    )
    start_utc: str | None = asked(
        None, "First day, UTC, e.g. 2028-01-01.", option="--start", unset="{date_utc}, else that of the mission"
    )
    n_days: int = asked(365, "How many days.", option="--days")
    step_days: float = asked(1.0, "Time between orbits that are looked at; of the Moon, at most 1.")
    limits: Any = asked(
        None,
        "Limits of pointing: preset, or YAML file.",
        option="--visibility",
        command=str,
        unset="default",
        accepts="VisibilityConfig, mapping, str or Path",
    )
    instrument: Instrument = asked(
        load_instrument,
        "Preset name or YAML file with what differs; its mission has the orbit.",
        parts=InstrumentParts,
        read=read_instrument,
        unset="cpic_default",
        accepts="Instrument, mapping, str or Path",
    )


def read_exclusions(given: Any) -> tuple[str, ...]:
    """Return names of `EXCLUSIONS` from what people write: some of them, or ``none`` alone.

    Raises
    ------
    InputError
        For another name, or ``none`` beside one.
    """
    names = shared.several(given)
    for name in names:
        if name not in (*EXCLUSIONS, "none") or (name == "none" and len(names) > 1):
            allowed = f"{', '.join(EXCLUSIONS)}, one or several, or none alone"
            raise InputError("exclusions", name, allowed=allowed)
    return tuple(name for name in EXCLUSIONS if name in names)


def asked_exclusions(default: tuple[str, ...] | None = EXCLUSIONS, **settings: Any) -> Any:
    """Declare the field of what excludes planets; ``settings`` as of `asked`."""
    return asked(
        default,
        "What excludes planets of the population: rv (radial velocities would have shown them), stability (a companion "
        "star leaves them no orbit), known_giants (a known giant stands there), or none. Repeat for several.",
        read=read_exclusions,
        accepts="str or sequence of str",
        **settings,
    )


class CountedPlanetsQuestion(KnownPlanetsQuestion):
    """A question about the planets that completeness counts: of a population, or known ones."""

    planet: shared.ReferencePlanet = shared.asked_planet()
    population: PopulationConfig = asked(
        load_population,
        "Planets that completeness refers to: giants, jupiters, solar_system, or a YAML file.",
        read=load_population,
        unset="giants",
        accepts="PopulationConfig, mapping, str or Path",
        names_file=lambda word: word not in preset_names("population", package="cpic_planner"),
    )
    n_planets: int = asked(
        N_PLANETS,
        "Planets drawn from the population, or draws of each known planet.",
        ge=1,
        le=MAX_PLANETS,
        option="--planets",
    )
    exclusions: shared.Texts = asked_exclusions()

    def check_planets(self) -> None:
        """Refuse a population, and what excludes its planets, beside known planets."""
        for name in ("population", "exclusions"):
            if self.known_planets is not None and name in self.model_fields_set:
                taken = f"given with {called('known_planets')}"
                hint = "known planets stand instead of a hypothetical population"
                raise InputError(name, taken, allowed="one of the two", hint=hint)


_LIST_OF_STARS = "names of stars, or a text file with one name a line"
_LIST_ENDINGS = (".txt", ".lst", ".list", ".dat")
_MOST_BYTES = 1_000_000


def read_star_names(given: Any) -> tuple[str, ...]:
    """Return names of stars from what people write: names, several between commas, and files with one name a line.

    What follows a ``#`` in a file is a comment; blank lines do not count, neither does a heading ``name``, nor an
    apostrophe that a table of ours puts before a name (`cpic_core.guarded`).

    Parameters
    ----------
    given : str, Path or sequence
        A word is a file where there is one, or where it has a slash or ends as text files do.

    Returns
    -------
    tuple of str
        Each name once.

    Raises
    ------
    InputError
        For a file that cannot be read, and where there is no name.
    """
    names: dict[str, None] = {}
    for item in shared.several(given):
        text = str(item)
        if "/" in text or text.lower().endswith(_LIST_ENDINGS) or is_file(text):
            written = read_text(text, key="stars", allowed=_LIST_OF_STARS, max_bytes=_MOST_BYTES)
            lines = [line.partition("#")[0] for line in written.splitlines()]
            lines = lines[bool(lines) and lines[0].strip().lower() == "name" :]
            lines = [unguarded(name.strip()) for line in lines for name in line.split(",")]
        else:
            lines = [text]
        names |= dict.fromkeys(" ".join(name.split()) for line in lines for name in line.split(",") if name.strip())
    if not names:
        raise InputError("stars", ",".join(map(str, shared.several(given))) or "none", allowed=_LIST_OF_STARS)
    return tuple(names)


def read_spectral_types(given: Any) -> tuple[str, ...]:
    """Return beginnings of spectral types, such as ``K``, ``K2`` or ``G8V``, from what people write.

    Parameters
    ----------
    given : str or sequence of str
        Several may stand between commas; blanks and the case of the letter do not count.

    Raises
    ------
    InputError
        For what no spectral type begins with.
    """
    words = ["".join(word.split()) for item in shared.several(given) for word in str(item).split(",") if word.strip()]
    for word in words or ["none"]:
        if not re.match(r"[OBAFGKMobafgkm](?![a-z])", word):
            allowed = "the beginning of a spectral type: a class (G), with subclass (K2), or more (K2V)"
            raise InputError("sp_type", word, allowed=allowed)
    return tuple(dict.fromkeys(word[0].upper() + word[1:] for word in words))


class FilteredQuestion(shared.CutsQuestion):
    """A question about all stars of a table within some cuts, whose answer is about those that pass the filters.

    The whole sample is ranked whatever the filters are. They count by the stars that they leave, which are in the hash
    of the ranking.
    """

    stars: shared.Texts = asked(
        (),
        "Only these of the ranked stars: a name, several between commas, or a text file with one name a line (blank "
        "lines and what follows a # do not count). Repeat for several.",
        physics=False,
        read=read_star_names,
        metavar="NAME|FILE",
        accepts="str, Path or sequence of str",
    )
    sp_type: shared.Texts = asked(
        (),
        "Only ranked stars whose spectral type begins so: K, K2, G8V; several between commas or repeated.",
        physics=False,
        read=read_spectral_types,
        accepts="str or sequence of str",
    )
    distance_max_pc: float | None = asked(None, "Only ranked stars as near as this.", gt=0, physics=False)
    dec_min_deg: float | None = asked(
        None,
        "Only ranked stars at this declination or north of it, at the date.",
        ge=-90,
        le=90,
        option="--dec-min",
        physics=False,
    )
    dec_max_deg: float | None = asked(
        None,
        "Only ranked stars at this declination or south of it, at the date.",
        ge=-90,
        le=90,
        option="--dec-max",
        physics=False,
    )
    known_hosts: bool = asked(
        False,
        "Only ranked stars with known planets, of the table snapshot; confirmed and controversial ones count, with "
        "{candidates} candidates too.",
        physics=False,
    )

    @classmethod
    def load(cls, source: str | Path) -> dict[str, Any]:
        """Return what a YAML file answers; a list of stars is looked for beside it first."""
        tree, folder = super().load(source), Path(source).parent
        if "stars" in tree:
            names = [str(item) for item in shared.several(tree["stars"]) or ()]
            tree["stars"] = [str(folder / name) if is_file(folder / name) else name for name in names]
        return tree

    @model_validator(mode="after")
    def _possible_declinations(self) -> Self:
        if self.dec_min_deg is not None and self.dec_max_deg is not None and self.dec_min_deg > self.dec_max_deg:
            allowed = f"at most {called('dec_max_deg')} {self.dec_max_deg:g}"
            raise InputError("dec_min_deg", self.dec_min_deg, unit="deg", allowed=allowed)
        return self

    @property
    def filters(self) -> tuple[str, ...]:
        """Names of the filters that are given, in the order in which they are applied."""
        return tuple(name for name in FILTERS if self.is_given(name) and getattr(self, name) != ())


FILTERS = tuple(inspect.get_annotations(FilteredQuestion))
"""Fields that choose some of the ranked stars."""


class RankedQuestion(shared.InstrumentQuestion, FilteredQuestion, CountedPlanetsQuestion):
    """The settings of a ranking of stars."""

    time_s: float = asked(
        shared.DEFAULT_TIME_S,
        "Wall time of all visits per target and band, readouts, reference frames and overheads included.",
        ge=1e-3,
        le=1e9,
    )
    visit_time_s: float | None = asked_visit_time()
    seed: shared.Seed = asked(1, "Seed of every random number.")
    score: ScoreName = asked(DEFAULT_SCORE, "Score that orders the stars.")
    instruments: int | None = asked(
        None,
        "Rank the stars under so many instruments too, drawn from {ensemble}: how sure each rank is, how often each "
        "reference planet is detected, and which assumption decides.",
        unset="none",
        ge=2,
        le=100_000,
    )
    ensemble: Ensemble = asked(
        load_ensemble,
        "What is not known of the instrument: the preset default, or a YAML file with what differs from it.",
        read=load_ensemble,
        unset="default",
        accepts="Ensemble, mapping, str or Path",
    )

    @model_validator(mode="after")
    def _one_kind_of_planets(self) -> Self:
        self.check_planets()
        if "ensemble" in self.model_fields_set and self.instruments is None:
            raise InputError("ensemble", "given", allowed=f"only with {called('instruments')}")
        hint = f"{called('known_planets')} ranks no other stars"
        self.refuse_together(("known_hosts", "known_planets"), hint)
        if self.known_planets is None and self.candidates and not self.known_hosts:
            allowed = f"only with {called('known_planets')} or {called('known_hosts')}"
            raise InputError("candidates", "given", allowed=allowed)
        return self

    @property
    def drawn_instruments(self) -> EnsembleChoice | None:
        """The instruments that the stars are ranked under too; None where none are asked."""
        return None if self.instruments is None else EnsembleChoice(self.ensemble, self.instruments, self.seed)


class RankQuestion(RankedQuestion):
    """Rank the whole catalogue."""

    KIND: ClassVar[str] = "rank"

    strategy: shared.Strategy = shared.asked_strategy()

    @model_validator(mode="after")
    def _possible_visits(self) -> Self:
        given = self.time_s if "time_s" in self.model_fields_set else None
        check_visits(self.strategy.visits, self.visit_time_s, given)
        return self
