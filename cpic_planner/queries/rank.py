"""The questions of ``cpic rank``, ``cpic known`` and ``cpic visibility``.

Which stars promise most, where the known planets are at a date, and when stars can be seen from the orbit. Instruments
that a ranking may be under: laws of the numbers that are inferred or assumed, and draws by them.
"""

import inspect
import re
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from cpic_core import FloatArray, InputError, Record, faults_by_line, is_file, read_text, stream, unguarded
from cpic_planner.planets import MAX_PLANETS, N_PLANETS, Law, PopulationConfig, load_population, read_law
from cpic_planner.queries import shared
from cpic_planner.queries.changes import InstrumentParts, is_optical, read_instrument, with_unit
from cpic_planner.queries.question import asked, called
from cpic_planner.queries.shared import EXCLUSIONS
from cpic_planner.registry import DEFAULT_SCORE, ScoreName
from simulator import config

CONTRAST, OCCURRENCE = "contrast", "planets_per_star"
"""Keys of numbers that no key of an instrument has: mean raw contrast of the dark hole, and the population's rate."""
_WIDTH = ".width_nm"  # of bands: it changes the light, and optics stay those of the nominal width
PACKAGE, DEFAULT = "cpic_planner", "default"
_READ = BeforeValidator(lambda value: None if value is None else read_law(value))
LawValue = Annotated[Law | None, _READ]


class Doubt(config.FrozenModel):
    """Law of one number that is not known.

    Attributes
    ----------
    label : str
        What the number is, in words.
    value, factor : Law
        Law of the number itself, or of a factor on the instrument's; one of the two.
    through : {"rates", "contrast", "images"}
        How it enters a ranking: only numbers of ``rates`` are drawn, the others' effect is that of the contrast, or
        on images alone.
    source : str
        Where the law is from.
    """

    label: Annotated[str, Field(min_length=1)]
    value: LawValue = None
    factor: LawValue = None
    through: Literal["rates", "contrast", "images"] = "rates"
    source: Annotated[str, Field(min_length=1)]

    def _check_values(self) -> None:
        if (self.value is None) == (self.factor is None):
            raise InputError("value", "given with factor" if self.value else "missing", allowed="one of value, factor")

    @property
    def law(self) -> Law:
        """Law of the number or of the factor."""
        return self.value or self.factor  # type: ignore[return-value]

    def text(self, key: str, drawn: float) -> str:
        """Return a drawn value of a key in words: a factor with an x, a number with its unit."""
        number = f"{drawn:.0f}" if 1e3 <= drawn < 1e5 else f"{drawn:.3g}"
        return with_unit(number, config.unit_of(key)) if self.factor is None else f"x{number}"


class Ensemble(config.FrozenModel):
    """Laws of all numbers of an instrument that are not known.

    Attributes
    ----------
    name, description : str
    numbers : dict of str to Doubt
        By key of the instrument, which may hold ``*`` (all that it means are drawn together), ``drift``, `CONTRAST` or
        `OCCURRENCE`.
    fixed : dict of str to str
        Inferred or assumed choices that are not drawn, with the reason.
    """

    name: str = ""
    description: str = ""
    numbers: dict[str, Doubt]
    fixed: dict[str, str] = Field(default_factory=dict)

    def _check_values(self) -> None:
        for key, doubt in self.drawn.items():
            if is_optical(key) and not key.endswith(_WIDTH):
                hint = "optics are not measured anew for every instrument: their numbers enter by the contrast"
                raise InputError(f"numbers.{key}.through", doubt.through, allowed="contrast, images", hint=hint)
        if not self.drawn:
            raise InputError("numbers", "none", allowed="at least one number that is drawn")

    @property
    def drawn(self) -> dict[str, Doubt]:
        """The numbers that are drawn."""
        return {key: doubt for key, doubt in self.numbers.items() if doubt.through == "rates"}

    def says(self, key: str) -> str:
        """Return what it says of a key of the instrument: the key of its law or of its reason, empty for nothing."""
        keys = (*self.numbers, *self.fixed)
        if key in ("drift.visit_nm", "drift.walk_nm_per_sqrt_hour") and "drift" in self.numbers:
            return "drift"
        return next((item for item in keys if fnmatchcase(key, item)), "")


def load_ensemble(source: Ensemble | Mapping[str, Any] | str | Path | None = None) -> Ensemble:
    """Load an ensemble.

    Parameters
    ----------
    source : Ensemble, mapping, str, Path or None
        Preset name, YAML path or mapping; ``None`` is the preset ``default``. A file or mapping holds what differs
        from its ``base`` (a preset, ``default`` if absent); null takes a number out: it is then known.

    Returns
    -------
    Ensemble

    Raises
    ------
    InputError
        Naming key, value and what is allowed of the first fault.
    """
    if isinstance(source, Ensemble):
        return source
    with faults_by_line(source):
        return _read(source)


def _read(source: Mapping[str, Any] | str | Path | None) -> Ensemble:
    keys = (*Ensemble.model_fields, "base")
    tree, _ = config.preset_tree("ensemble", DEFAULT if source is None else source, keys=keys, package=PACKAGE)
    base = tree.pop("base", None if source in (None, DEFAULT) else DEFAULT)
    if base is not None:
        under = load_ensemble(str(base)).model_dump(exclude_none=True)
        own = tree.get("numbers") or {}
        if not isinstance(own, Mapping):
            raise InputError("ensemble.numbers", own, allowed="a mapping of keys to laws")
        numbers = {key: item for key, item in {**under["numbers"], **own}.items() if item is not None}
        tree = {**under, **tree, "numbers": numbers}
    return config.validate(Ensemble, tree, where="ensemble")


class EnsembleChoice(Record):
    """An ensemble, how many instruments are drawn, and the seed of the draws."""

    ensemble: Ensemble
    n_instruments: int
    seed: int

    def shares(self) -> dict[str, FloatArray]:
        """Return uniform numbers for each number that is drawn, one for each instrument.

        A Latin hypercube (McKay et al. 1979, Technometrics 21, 239): each of n equal parts of every law is drawn from
        once. Each number has a stream of its own, so that a number more or less changes no other.
        """
        n = self.n_instruments
        found = {}
        for key in self.ensemble.drawn:
            random = stream(self.seed, "ensemble", key)
            found[key] = (random.permutation(n) + random.random(n)) / n
        return found

    def draws(self) -> dict[str, FloatArray]:
        """Return the drawn values or factors of each number, one for each instrument."""
        return {key: self.ensemble.numbers[key].law.quantile(share) for key, share in self.shares().items()}


DEFAULT_YEARS = 5.0


class KnownQuestion(shared.InstrumentQuestion, shared.CatalogQuestion, shared.KnownPlanetsQuestion):
    """Say where the known planets are at a date, how bright, and when the dark hole covers them."""

    KIND: ClassVar[str] = "known"

    star: str | None = asked(
        None, 'Star: "eps Eri", "HIP 16537" ...', argument=True, metavar="[STAR]", completes=shared.star_names
    )
    years: float | None = asked(None, "How long the star's planets are followed.", unset=f"{DEFAULT_YEARS:g}")
    albedo: config.AlbedoValue = asked(
        config.MeasuredAlbedo(model="jupiter"), "What the planets reflect.", parts=shared.AlbedoParts
    )
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
        unset="default",
        accepts="VisibilityConfig, mapping, str or Path",
    )
    instrument: config.Instrument = asked(
        config.load_instrument,
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


Exclusions = Annotated[tuple[str, ...], BeforeValidator(read_exclusions)]


def asked_exclusions(**settings: Any) -> Any:
    """Declare the field of what excludes planets; ``settings`` as of `asked`."""
    return asked(
        EXCLUSIONS,
        "What excludes planets of the population: rv (radial velocities would have shown them), stability (a companion "
        "star leaves them no orbit), known_giants (a known giant stands there), or none. Repeat for several.",
        accepts="str or sequence of str",
        **settings,
    )


class CountedPlanetsQuestion(shared.KnownPlanetsQuestion):
    """A question about the planets that completeness counts: of a population, or known ones."""

    planet: shared.ReferencePlanet = shared.asked_planet()
    population: PopulationConfig = asked(
        load_population,
        "Planets that completeness refers to: giants, jupiters, solar_system, or a YAML file.",
        read=load_population,
        unset="giants",
        accepts="PopulationConfig, mapping, str or Path",
        names_file=lambda word: word not in config.preset_names("population", package="cpic_planner"),
    )
    n_planets: int = asked(
        N_PLANETS,
        "Planets drawn from the population, or draws of each known planet.",
        ge=1,
        le=MAX_PLANETS,
        option="--planets",
    )
    exclusions: Exclusions = asked_exclusions()

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


class RankedQuestion(shared.ProgrammeQuestion, shared.InstrumentQuestion, FilteredQuestion, CountedPlanetsQuestion):
    """The settings of a ranking of stars."""

    time_s: float = asked(
        shared.DEFAULT_TIME_S,
        "Wall time of all visits per target and band, readouts, reference frames and overheads included.",
        ge=1e-3,
        le=1e9,
    )
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
