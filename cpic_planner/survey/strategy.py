"""Survey strategies as frozen configuration, as people write them in a YAML file, and with values that are varied.

What a strategy leaves out is that of ``defaults``, and what these leave out that of the preset ``default``.
"""

import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, WrapValidator, model_validator

from catalogs import split_source
from cpic_core import FloatArray, InputError, Provenance, Record, by_line, is_file, load_yaml, split_sourced
from cpic_planner.etc import LAW_ERROR
from cpic_planner.planets import FLOOR_MAS, STAR_MASS_ERROR, PopulationConfig, load_population
from cpic_planner.queries import (
    Strategy as Reduction,
    UniverseSettings,
    Written,
    changed_instrument,
    get,
    keys_of,
    put,
    read_value,
    scaled,
    two_spellings,
    with_unit,
)
from cpic_planner.results import SettingSource, VariedSetting
from simulator.config import (
    FrozenModel,
    Instrument,
    Real,
    Sourced,
    deep_merge,
    nearest,
    preset_path,
    preset_tree,
    unit_of,
    validate,
)
from simulator.config.scene import paths_beside


def _listed(value: Any) -> Any:
    """Return a single text as a list of one."""
    return (value,) if isinstance(value, str) else value


def _factor(value: Any) -> Any:
    """Return a factor that is written with its x, as a number."""
    written = read_value("factor", value) if isinstance(value, str) else None
    return value if written is None or written.action == "set" else written.value


Names = Annotated[tuple[str, ...], BeforeValidator(_listed)]


class TargetCuts(FrozenModel):
    """The stars that a survey may look at.

    ``names`` are the only stars, if given; ``max_targets`` the most that are visited, best first by planets expected
    per hour of the first visit; ``known_planets`` ``only`` leaves stars with a known planet, ``first`` visits them
    before all others. ``v_mag_max``, ``distance_max_pc``, ``dwarfs_only`` and ``singles_only`` select as options of
    ``cpic rank`` do; stars of ``exclude`` are never visited.
    """

    v_mag_max: Real | None = None
    distance_max_pc: Annotated[Real, Field(gt=0)] | None = None
    dwarfs_only: bool = False
    singles_only: bool = False
    names: Names = ()
    exclude: Names = ()
    max_targets: Annotated[int, Field(ge=1, le=100_000)] = 50
    known_planets: Literal["any", "first", "only"] = "any"


class VisitRule(FrozenModel):
    """One visit of the search.

    ``bands`` are tried for every star and the one of most planets per hour is taken. ``time_s`` is wall time with
    readouts and reference frames; several values let the scheduler choose one for each star. ``goal`` ``detect`` ends
    the visit where the reference planet is detected, ``snr`` where it reaches ``snr``, ``time`` uses what time pays;
    ``time_s`` is the longest in each case. ``exposure_s`` and ``em_gain`` are the best ones unless given. ``settlings``
    counts the slews or rolls of a visit, each with the settling behind it.
    """

    bands: Annotated[Names, Field(min_length=1)] = ("F520",)
    time_s: Annotated[
        tuple[Annotated[Real, Field(gt=0, le=1e8)], ...],
        BeforeValidator(lambda value: (value,) if isinstance(value, int | float) else value),
        Field(min_length=1),
    ] = (36000.0,)
    settlings: Annotated[int, Field(ge=1, le=10)] = 2
    goal: Literal["time", "detect", "snr"] = "time"
    snr: Annotated[Real, Field(gt=0, le=1e6)] | None = None
    exposure_s: Annotated[Real, Field(gt=0, le=1e6)] | None = None
    em_gain: Annotated[Real, Field(ge=1, le=1e4)] | None = None

    @model_validator(mode="after")
    def _goal(self) -> "VisitRule":
        if (self.goal == "snr") != (self.snr is not None):
            raise InputError("snr", self.snr, allowed="a value with goal snr, and with no other goal")
        return self


class Revisits(FrozenModel):
    """The number of visits of a star, their distance in time, and the roll of the telescope.

    A star is visited at most ``max_visits`` times, and again after ``min_gap_days`` at the earliest.
    ``roll`` ``sun``: the roll that the solar panels ask for on the day of the visit, so that the dark quadrants turn
    with the year; ``north``: the same roll always. ``roll_dither_deg`` is added and taken away at every other visit.
    """

    max_visits: Annotated[int, Field(ge=1, le=1000)] = 1
    min_gap_days: Annotated[Real, Field(ge=0, le=36525)] = 30.0
    roll: Literal["sun", "north"] = "sun"
    roll_dither_deg: Annotated[Real, Field(ge=0, le=90)] = 0.0


class FollowUp(FrozenModel):
    """Visits in other bands once a planet has been found; none by default.

    A visit is for all planets of the star that lack one of the ``bands``, and takes at most ``time_s`` of wall time;
    each planet has ``attempts`` visits of its own.
    With ``snr`` a band counts for a planet whose photometric SNR reaches it there, follow-up visits in that band
    added in quadrature. A visit is made only in slots in which as many visits as are left of ``attempts`` would reach
    it: the orbit is taken as known, as two epochs tell for some months ahead where the planet stands. Without ``snr``
    the next slots are taken as they come, and a band counts for a planet whose significance reaches the threshold
    there in one visit, at its known place.
    """

    snr: Annotated[Real, Field(gt=0, le=1e6)] | None = None
    bands: Names = ()
    time_s: Annotated[Real, Field(gt=0, le=1e8)] = 36000.0
    attempts: Annotated[int, Field(ge=1, le=100)] = 2

    @property
    def wanted(self) -> bool:
        """Whether there is any."""
        return bool(self.bands)


class AlarmRule(FrozenModel):
    """The answer to a candidate that one visit has shown, which may be a planet or a false alarm.

    With ``check`` a candidate is looked at again, by a visit of the same frames at least ``gap_days`` later: a search
    visit of that star that is planned anyway, or else one of its own, which costs telescope time. It is refuted there:
    noise does not come again at the same place (the probability of ``detection.sigma`` in a resolution element), and a
    background star has moved against the star, by one resolution element (54 mas in F520) in 30 days where proper
    motion and parallax make 0.65 arcsec a year. A visit of its own waits for a slot in whose roll the place where the
    candidate was seen, of a known planet where its orbit has it by then, lies in the dark hole; false alarms have no
    place here, and are looked at in the first slot. A planet that is not seen again is looked at ``attempts`` times in
    all, and still counts as found. A known planet whose published orbit gives its place needs no second look, and with
    ``orbit.visits`` no known planet does: the next position that its orbit asks for is one.

    Where ``check`` is not given, it is on with follow-up or visits for orbits and a detection of one visit, and off
    else.
    """

    check: bool | None = None
    gap_days: Annotated[Real, Field(ge=0, le=36525)] = 30.0
    attempts: Annotated[int, Field(ge=1, le=100)] = 2


class DetectionRule(FrozenModel):
    """The rule by which something counts as a detection.

    Attributes
    ----------
    rule : {"blind", "known_place", "expected"}
        ``blind``: found by a search that does not know where to look, with the probability measured on images;
        ``known_place``: significant at its place, likewise; ``expected``: predicted significance reaches the threshold,
        no chance in it (what a ranking calls completeness). Known planets whose whole orbit is published, node
        included, are looked for at their place under ``blind`` too.
    visits_needed : int
        Visits that must show the planet.
    sigma : float
        Detection level whose false-alarm probability the thresholds keep.
    calibration, calibration_error : float
        Factor on a predicted SNR that gives that of images, and its standard error.
    half_factor : float
        Factor on the significance at which half of the planets are detected: a search better or worse than the law.
    half_error : float
        Relative standard error of the significance at which half of the planets are detected
        (`cpic_planner.etc.SearchLaw`).

    Notes
    -----
    The errors are drawn once for each universe.
    """

    rule: Literal["blind", "known_place", "expected"] = "blind"
    visits_needed: Annotated[int, Field(ge=1, le=10)] = 1
    sigma: Annotated[Real, Field(ge=1, le=20)] = 5.0
    calibration: Annotated[Real, Field(gt=0, le=10)] = 1.0
    calibration_error: Annotated[Real, Field(ge=0, le=1)] = 0.0
    half_factor: Annotated[Real, Field(gt=0, le=100)] = 1.0
    half_error: Annotated[Real, Field(ge=0, le=10)] = LAW_ERROR


class DustLaw(FrozenModel):
    """Dust around stars, drawn for each star and universe: lognormal, by its median and 95th percentile (zodi).

    The HOSTS survey has a best-fit median of 3 zodi for Sun-like stars, below 27 zodi at 95 % confidence, and a fifth
    of the stars much dustier (Ertel et al. 2020, AJ 159, 177). The 27 zodi are a limit on the median, not a percentile
    of stars: ``{median: 3, p95: 27}`` is an assumption about the scatter.
    """

    median: Annotated[Real, Field(gt=0, le=1e4)]
    p95: Annotated[Real, Field(gt=0, le=1e4)]

    def _check_values(self) -> None:
        if self.p95 < self.median:
            raise InputError("p95", self.p95, unit="zodi", allowed=f"at least the median, {self.median:g}")

    def zodis(self, share: FloatArray) -> FloatArray:
        """Return the dust at given shares of the law, in [0, 1)."""
        from scipy.special import ndtri

        return np.asarray(self.median * (self.p95 / self.median) ** (ndtri(share) / ndtri(0.95)))


class _OneLevel(FrozenModel):
    """The same dust around all stars."""

    exozodi: Annotated[Real, Field(ge=0, le=1e4)]


def _dust(value: Any, _: Any) -> DustLaw | float | None:
    """Return a law of dust, or one level."""
    if value is None or isinstance(value, DustLaw):
        return value
    return validate(DustLaw, value) if isinstance(value, Mapping) else validate(_OneLevel, {"exozodi": value}).exozodi


class Assumptions(FrozenModel):
    """The assumptions about the instrument that replace what its file says.

    ``contrast`` is the median raw contrast of the dark hole in every band: a brighter hole is that of a mirror whose
    actuators are off by as much, a darker one has less of the instrument's light (`cpic_planner.survey.prepare`).
    ``drift`` and ``throughput`` are factors on the instrument's numbers (2 or ``x2``: twice): drift on the offset of a
    visit and on the walk within it, throughput on the optics' of every band. ``exozodi`` is an amount of dust in solar
    systems (zodi), one for all stars or a `DustLaw` by which each star has its own; frames are chosen for its median.
    """

    contrast: Annotated[Real, Field(ge=0, le=1e-3)] | None = None
    drift: Annotated[Real, Field(ge=0, le=1000), BeforeValidator(_factor)] = 1.0
    throughput: Annotated[Real, Field(gt=0, le=10), BeforeValidator(_factor)] = 1.0
    exozodi: Annotated[DustLaw | float | None, WrapValidator(_dust)] = None

    @property
    def dust(self) -> DustLaw | None:
        """The law of dust, where each star has its own."""
        return self.exozodi if isinstance(self.exozodi, DustLaw) else None


class StopRule(FrozenModel):
    """The rule by which a star, or the survey, is left alone.

    ``after_detection``: no more search visits of a star once it has shown a planet; ``after_empty``: nor after that
    many without; ``after_planets``: the survey ends with that many planets found. ``after_orbit``, in place of
    ``after_detection``: no more search visits of a star once the orbit of a planet that it has shown is known.
    """

    after_detection: bool = True
    after_empty: Annotated[int, Field(ge=1, le=1000)] | None = None
    after_planets: Annotated[int, Field(ge=1, le=100_000)] | None = None
    after_orbit: bool = False

    @model_validator(mode="after")
    def _one_end(self) -> "StopRule":
        if self.after_orbit and self.after_detection:
            hint = "a star that is left after its first detection never has an orbit"
            raise InputError("after_orbit", True, allowed="true with after_detection: false", hint=hint)
        return self


class OrbitRule(FrozenModel):
    """The rule by which the orbit of a found planet counts as known, and how many visits it is worth.

    The relative error of the semi-major axis is at most ``axis_error``, and the planet will stand within
    ``place_error_lambda_d`` (rms, in lambda/D of the last band that showed it) of its predicted place in the next
    window of its star. At least two positions are needed, or one of a planet whose published orbit has its node and
    inclination; an arc of a period or longer needs four, unless a published period tells how often the planet has gone
    round (to 0.1 periods). ``floor_mas`` is the error of a position, on each axis, that no light removes;
    ``star_mass_error`` the relative error of the star's mass. Positions are those of the survey's own images and of its
    observation log; a known planet begins with what is published of its orbit.

    ``visits`` is the most visits of one star that the survey adds for the orbits of the planets found there; with 0, as
    by default, none. They are made with the frames that found the planet, in the slots in which positions are expected
    to determine the orbit best, the fewest that are expected to make it known
    (`cpic_planner.survey.simulate.best_slots`), and come before planned visits.

    ``value`` is what a known orbit is worth to the scheduler beside the detection of its planet, in units of that: a
    visit counts so much more for each planet that it is likely to detect early enough for its orbit, by the positions
    of visits to come (`cpic_planner.survey.orbits.orbit_chance`). With 0 schedules are made for detections alone.
    """

    axis_error: Annotated[Real, Field(gt=0, le=10)] = 0.2
    place_error_lambda_d: Annotated[Real, Field(gt=0, le=100)] = 0.3
    floor_mas: Annotated[Real, Field(ge=0, le=1000)] = FLOOR_MAS
    star_mass_error: Annotated[Real, Field(gt=0, le=10)] = STAR_MASS_ERROR
    visits: Annotated[int, Field(ge=0, le=1000)] = 0
    value: Annotated[Real, Field(ge=0, le=1e6)] = 0.0

    @model_validator(mode="after")
    def _made(self) -> "OrbitRule":
        if self.value > 0.0 and not self.visits:
            raise InputError("orbit.value", self.value, allowed="0 without orbit.visits: nothing would follow")
        return self


class SchedulerRule(FrozenModel):
    """The rule by which visits are put into the calendar.

    ``method``: ``auto`` weighs whole plans of stars (sets of visits) against each other, however many visits a
    detection needs, with a search that ends after seconds; ``exact`` searches for minutes; ``greedy`` takes the visits
    of most planets per hour first. All three state how far they may be from the best calendar. ``min_gain`` is the
    least that a visit has to add to the others of its star, in planets. ``look_ahead`` is the most visits of one star
    that the greedy choice weighs together where one detection is enough: where several are needed, it weighs any number
    of them. ``reserve`` is the time planned beyond the budget, as a fraction of it, for universes in which stop rules
    free some.
    """

    method: Literal["auto", "greedy", "exact"] = "auto"
    min_gain: Annotated[Real, Field(ge=0, le=1)] = 1e-3
    look_ahead: Annotated[int, Field(ge=1, le=5)] = 2
    reserve: Annotated[Real, Field(ge=0, le=10)] = 0.5


def _population(value: Any) -> Any:
    return value if value is None else load_population(value)


class SurveyStrategy(FrozenModel, Sourced):
    """A survey.

    Attributes
    ----------
    name, description : str
    time_budget_h : float
        Telescope time, slews, settling and occultations included.
    share_of_time : float, optional
        The same as a fraction of the length of the survey, which gives the hours where strategies are loaded
        (`cpic_planner.survey.strategy`).
    reduction : Strategy
        How an observation is made and reduced. It is a programme of ``reduction.visits`` visits, one unless given, all
        in one slot of the calendar, each with its own settlings; what survey words call a visit is all of it.
    slot_share : float
        Largest fraction of any slot of the calendar that the coronagraph may take; of the whole survey it is
        ``share_of_time``.
    value_known, value_new : float
        What the detection of a known planet, and of a new one, is worth to the scheduler.
    """

    name: Annotated[str, Field(min_length=1, max_length=120)]
    description: str = ""
    time_budget_h: Annotated[Real, Field(gt=0, le=1e6)] = 1000.0
    share_of_time: Annotated[Real, Field(gt=0, le=1)] | None = None
    slot_share: Annotated[Real, Field(gt=0, le=1)] = 0.25
    targets: TargetCuts = TargetCuts()
    population: Annotated[PopulationConfig | None, BeforeValidator(_population)] = None
    visit: VisitRule = VisitRule()
    revisits: Revisits = Revisits()
    follow_up: FollowUp = FollowUp()
    reduction: Reduction = Reduction()
    detection: DetectionRule = DetectionRule()
    alarms: AlarmRule = AlarmRule()
    assumptions: Assumptions = Assumptions()
    stop: StopRule = StopRule()
    orbit: OrbitRule = OrbitRule()
    scheduler: SchedulerRule = SchedulerRule()
    value_known: Annotated[Real, Field(ge=0, le=1e6)] = 1.0
    value_new: Annotated[Real, Field(ge=0, le=1e6)] = 1.0
    _varied: tuple[VariedSetting, ...] = PrivateAttr(default=())

    @property
    def varied(self) -> tuple[VariedSetting, ...]:
        """Values that ``--vary`` gave the strategy, in the order of its name."""
        return self._varied

    @property
    def checks_candidates(self) -> bool:
        """Whether a candidate of one visit is looked at again."""
        if self.alarms.check is None:
            return (self.follow_up.wanted or self.orbit.visits > 0) and self.detection.visits_needed == 1
        return self.alarms.check

    @model_validator(mode="after")
    def _consistent(self) -> "SurveyStrategy":
        needed, most = self.detection.visits_needed, self.revisits.max_visits
        if needed > most:
            hint = "detection.visits_needed asks for that many"
            raise InputError("revisits.max_visits", most, allowed=f"at least {needed}", hint=hint)
        if self.alarms.check and needed > 1:
            hint = f"detection.visits_needed is {needed}: those visits tell planets from false alarms"
            raise InputError("alarms.check", True, allowed="false, where a detection takes several visits", hint=hint)
        if self.reduction.sigma not in (self.detection.sigma, Reduction().sigma):
            raise InputError("reduction.sigma", self.reduction.sigma, allowed="nothing here: give detection.sigma")
        return self


PACKAGE = "cpic_planner"
MAX_STRATEGIES = 200
FILES = ("instrument", "visibility", "catalog", "known_planets", "observed")
"""What a survey names by preset or file."""
SHARES = (
    "slot_share is the most of any one slot of the calendar that the coronagraph may take, and was called share "
    "before; share_of_time is all its telescope time over the length of the survey, 0.05 for 5 %"
)
"""What tells the two shares of a strategy apart."""
_BUDGETS = ("time_budget_h", "share_of_time")
_OF_SURVEY = ("kind", "universe", "doubt", "defaults", "strategies")


class UniverseConfig(UniverseSettings, Sourced):
    """The settings that strategies share, as their file says them.

    Attributes
    ----------
    start_utc : str
        Start of the survey.
    date_utc : str
        Date of the places of stars and their companions in all visits; the start where it is not given.
    duration_days, slot_days : float
        Length of the survey, and step of its calendar.
    instrument, visibility, catalog, known_planets : str
        Presets or files; ``known_planets`` as `catalogs.known_planets.load_known_planets` reads it, ``off`` leaves
        them out.
    changes : tuple of str
        What is changed of the instrument for all strategies, ``KEY=VALUE`` as `cpic_planner.queries.changes` reads it.
    candidates : bool
        Whether candidates count among the known planets.
    exclusions : tuple of {"rv", "stability", "known_giants"}
        What excludes planets of the population (`cpic_planner.planets.allowed`); ``none``: nothing.
    observed : str
        Observation log of what was done already (`cpic_planner.survey.observed`); empty for none.
    facts : bool
        Whether strategies are planned and played again without each fact that is known
        (`cpic_planner.survey.outcome`).
    background : {"off", "on"}
        Whether background stars make false alarms.
    universes : int
        Synthetic universes; at least 2, or no interval is defined.
    seed : int
    """

    @property
    def n_slots(self) -> int:
        """Slots of the calendar; the last one may be shorter."""
        return max(1, int(-(-self.duration_days // self.slot_days)))

    def made_instrument(self) -> Instrument:
        """Return the instrument with what is changed of it."""
        return changed_instrument(self.instrument, self.changes)

    @model_validator(mode="after")
    def _slots(self) -> "UniverseConfig":
        if self.slot_days > self.duration_days:
            allowed = f"at most duration_days, {self.duration_days:g}"
            raise InputError("slot_days", self.slot_days, unit="d", allowed=allowed)
        return self


class DoubtRule(FrozenModel):
    """A number that nobody knows before launch: strategies are planned for each of its values, and played under each.

    Attributes
    ----------
    key : str
        What is assumed of the instrument or of the planets, dotted or short: drift, throughput, exozodi, contrast,
        population.
    values : tuple of str
        What it may be, as ``--vary`` takes them: with a unit, or with an x.
    weights : tuple of float, optional
        How likely each of them is, in any unit; not given: by the law of the default ensemble, if it has one of the
        number, else all the same.
    quantity : {"planets", "new_planets"}
        What the choice is made by.
    """

    key: Annotated[str, Field(min_length=1)]
    values: Annotated[
        tuple[
            Annotated[str, BeforeValidator(lambda value: f"{value:g}" if isinstance(value, float) else str(value))], ...
        ],
        Field(min_length=2),
    ]
    weights: tuple[Annotated[Real, Field(ge=0)], ...] | None = None
    quantity: Literal["planets", "new_planets"] = "planets"

    @classmethod
    def of(cls, text: str) -> "DoubtRule":
        """Return the rule of ``KEY=VALUE,VALUE...``."""
        key, _, listed = text.partition("=")
        values = [item.strip() for item in listed.split(",")]
        if not key.strip() or len(values) < 2 or not all(values):
            raise InputError("--doubt", text, allowed="KEY=VALUE,VALUE..., as drift=0.02nm,0.1nm")
        return cls(key=key.strip(), values=tuple(values))

    @property
    def text(self) -> str:
        """The rule as ``--doubt`` takes it."""
        return f"{self.key}={','.join(self.values)}"

    @model_validator(mode="after")
    def _weighed(self) -> "DoubtRule":
        if self.weights is not None and (len(self.weights) != len(self.values) or not sum(self.weights) > 0.0):
            raise InputError("doubt.weights", list(self.weights), allowed=f"{len(self.values)} numbers, one above 0")
        return self


class StrategiesConfig(FrozenModel):
    """Strategies to compare; the first one is what the others are compared with."""

    name: str = ""
    description: str = ""
    universe: UniverseConfig = UniverseConfig()
    doubt: DoubtRule | None = None
    strategies: Annotated[tuple[SurveyStrategy, ...], Field(min_length=1, max_length=MAX_STRATEGIES)]

    @model_validator(mode="after")
    def _named(self) -> "StrategiesConfig":
        names = [item.name for item in self.strategies]
        for name in names:
            if names.count(name) > 1:
                raise InputError("strategies.name", name, allowed="each name once")
        return self


@by_line
def load_strategies(source: Mapping[str, Any] | str | Path = "survey_default") -> StrategiesConfig:
    """Load strategies.

    Parameters
    ----------
    source : mapping, str or Path
        Preset name, YAML path, or mapping with ``universe``, ``doubt``, ``defaults`` and ``strategies``, or one
        strategy alone.
        What a strategy leaves out is that of ``defaults``, and what these leave out that of the preset ``default``.

    Returns
    -------
    StrategiesConfig

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from cpic_planner.survey.strategy import load_strategies
    >>> [item.name for item in load_strategies("survey_default").strategies][:2]
    ['single_visit', 'multi_band']
    """
    tree, folder = preset_tree(
        "strategies", source, package=PACKAGE, kinds=("strategy",), keys=(*SurveyStrategy.model_fields, *_OF_SURVEY)
    )
    tree = tree if folder is None else _beside(paths_beside(tree, folder), folder)
    values, _ = split_sourced(tree)
    kind = values.pop("kind", "strategies")
    if kind == "strategy" or "strategies" not in values:
        shared = {key: values.pop(key) for key in ("universe", "doubt", "defaults") if key in values}
        values = {"name": values.get("name", "")} | shared | {"strategies": [values]}
    path = preset_path("strategy", "default", package=PACKAGE)
    assert path is not None
    default = {key: item for key, item in load_yaml(path).items() if key != "kind"}
    own = values.pop("defaults", {})
    if not isinstance(own, Mapping):
        raise InputError("strategies.defaults", own, allowed="a mapping of keys to values")
    listed = values["strategies"]
    if not isinstance(listed, list | tuple) or not all(isinstance(item, Mapping) for item in listed):
        raise InputError("strategies.strategies", listed, allowed="a list of mappings")
    base = _laid(split_sourced(default)[0], own)
    base = {key: item for key, item in base.items() if key not in ("name", "description")}
    values["strategies"] = [_laid(base, item) for item in listed]
    config = validate(StrategiesConfig, values, where="strategies")
    config.universe._provenance.update(_sourced(tree.get("universe", {})))
    written = tree.get("strategies") or [{key: item for key, item in tree.items() if key not in _OF_SURVEY}]
    for strategy, layer in zip(config.strategies, written, strict=True):
        strategy._provenance.update(_sourced(default, tree.get("defaults", {}), layer))
    return budgeted(config)


def _laid(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a layer of a strategy over another; its budget, in hours or as a share, replaces that of the other.

    Raises
    ------
    InputError
        If the layer above gives both, or ``share``, which could be either of two.
    """
    if "share" in above:
        raise InputError("strategies.share", above["share"], allowed="slot_share or share_of_time", hint=SHARES)
    given = [key for key in _BUDGETS if above.get(key) is not None]
    if len(given) > 1:
        both = f"given with {given[0]} {above[given[0]]}"
        raise InputError(f"strategies.{given[1]}", both, allowed="one of the two: each is the whole telescope time")
    kept = {key: value for key, value in below.items() if not (given and key in _BUDGETS)}
    return deep_merge(kept, above)


def budgeted(config: StrategiesConfig) -> StrategiesConfig:
    """Return the same strategies, with the hours of those that state a share of the length of the survey."""
    length_h, made = 24.0 * config.universe.duration_days, []
    for item in config.strategies:
        made.append(item)
        if item.share_of_time is not None:
            made[-1] = item.model_copy(update={"time_budget_h": item.share_of_time * length_h})
            made[-1]._provenance = {key: said for key, said in item.provenance.items() if key != "time_budget_h"}
    return config.model_copy(update={"strategies": tuple(made)})


def _sourced(*layers: Any) -> dict[str, Provenance]:
    """Return the sources of the values that are left when trees are laid over each other."""
    found: dict[str, Provenance] = {}
    for layer in layers:
        values, provenance = split_sourced(layer)
        found = {key: item for key, item in found.items() if not _holds(values, key)} | provenance
    return found


def _holds(tree: Any, key: str) -> bool:
    """Return whether a tree says what a dotted key is, or what one above it is."""
    head, _, rest = key.partition(".")
    if not isinstance(tree, Mapping):
        return True
    return head in tree and (not rest or _holds(tree[head], rest))


def _beside(tree: Any, folder: Path) -> Any:
    """Return the files of the survey and of populations that exist beside the strategies' file, made whole."""
    if isinstance(tree, list):
        return [_beside(item, folder) for item in tree]
    if not isinstance(tree, dict):
        return tree
    found = {key: _beside(item, folder) for key, item in tree.items()}
    for key, item in tree.items():
        if key in (*FILES, "population") and isinstance(item, str):
            name = split_source(item)[1] if key == "known_planets" else item
            if name and is_file(folder / name):
                found[key] = f"{item.removesuffix(name)}{folder / name}"
    return found


def with_universe(
    config: StrategiesConfig, given: Mapping[str, Any], share_of_time: float | None = None
) -> StrategiesConfig:
    """Return the same strategies over another calendar, catalogue, number of universes, or telescope time.

    A survey that is shorter than a slot has one slot. ``share_of_time`` is that of all strategies; a share that is
    kept means more or fewer hours where the survey gets another length.

    Raises
    ------
    InputError
        For an unknown key, or a value that it cannot have.
    """
    if share_of_time is not None:
        given_share = {"share_of_time": share_of_time}
        strategies = tuple(item.model_copy(update=given_share) for item in config.strategies)
        config = budgeted(config.model_copy(update={"strategies": strategies}))
        for item in config.strategies:
            item._provenance.pop("share_of_time", None)
    if not given:
        return config
    tree = config.universe.model_dump() | dict(given)
    length = given.get("duration_days")
    if "slot_days" not in given and isinstance(length, int | float):
        tree["slot_days"] = min(tree["slot_days"], float(length))
    universe = validate(UniverseConfig, tree, where="universe")
    if universe.changes:
        universe.made_instrument()  # refuses what the instrument cannot have before anything is worked out
    old = config.universe
    kept = {key: item for key, item in old.provenance.items() if getattr(universe, key) == getattr(old, key)}
    universe._provenance.update(kept)
    return budgeted(config.model_copy(update={"universe": universe}))


def with_doubt(config: StrategiesConfig, text: str | None) -> StrategiesConfig:
    """Return the same strategies with a number that is not known, ``KEY=VALUE,VALUE...``; unchanged without one.

    Raises
    ------
    InputError
        For anything else.
    """
    return config if text is None else config.model_copy(update={"doubt": DoubtRule.of(text)})


def with_exact_calendars(config: StrategiesConfig) -> StrategiesConfig:
    """Return the same strategies, whose calendars are searched for much longer."""
    exact = [
        item.model_copy(update={"scheduler": item.scheduler.model_copy(update={"method": "exact"})})
        for item in config.strategies
    ]
    return config.model_copy(update={"strategies": tuple(exact)})


def sources_of(config: StrategiesConfig) -> list[SettingSource]:
    """Return the sources of the numbers of all strategies and of what they share, equal ones once."""
    names, settings = [item.name for item in config.strategies], config.universe.model_dump(mode="json")
    shared = [
        SettingSource.of(item, key=f"universe.{key}", value=settings[key], strategies=names)
        for key, item in config.universe.provenance.items()
    ]
    found: dict[tuple[str, str, Provenance], SettingSource] = {}
    for strategy in config.strategies:
        tree = strategy.model_dump(mode="json")
        for key, item in strategy.provenance.items():
            value = get(tree, key)
            own = SettingSource.of(item, key=key, value=value, strategies=[])
            found.setdefault((key, repr(value), item), own).strategies.append(strategy.name)
    return [*shared, *found.values()]


SHORT_NAMES = {
    "contrast": "assumptions.contrast",
    "drift": "assumptions.drift",
    "throughput": "assumptions.throughput",
    "exozodi": "assumptions.exozodi",
    "budget_h": "time_budget_h",
    "time_s": "visit.time_s",
    "max_visits": "revisits.max_visits",
    "max_targets": "targets.max_targets",
    "rule": "detection.rule",
    "library": "reduction.library",
}
"""Short names of keys of a strategy."""
_DRIFT, _THROUGHPUT, _EXOZODI = "assumptions.drift", "assumptions.throughput", "assumptions.exozodi"
_UNITS = {_DRIFT: "nm", _THROUGHPUT: "", _EXOZODI: "zodi"}
"""Units of keys whose names do not end in them: they take a unit or an x."""


class _Sweep(Record):
    """One ``--vary``: the option, the key, its name as it was written, and its values."""

    option: str
    key: str
    name: str
    values: tuple[Written, ...]

    @property
    def where(self) -> str:
        """The key in refusals."""
        return f"{self.option} {self.name}"

    def setting(self, text: str, value: Any, unit: str, meaning: str) -> VariedSetting:
        """Return one of its values as results tell it."""
        return VariedSetting(name=self.name, key=self.key, text=text, value=value, unit=unit, meaning=meaning)


def varied(
    config: StrategiesConfig, sweeps: Sequence[str], *, facts: bool = False, option: str = "--vary"
) -> StrategiesConfig:
    """Return every strategy with every combination of values of some keys.

    Parameters
    ----------
    config : StrategiesConfig
    sweeps : sequence of str
        ``KEY=VALUE,VALUE...``: a dotted key of a strategy, or a short name of one (`SHORT_NAMES`). A value is a number
        with a unit (``time_s=1h``), a factor on the strategy's own value (``budget_h=x0.5``), a number alone where the
        key ends in its unit or the quantity has none, a word, or a list as ``[A,B]``. ``drift``, ``throughput`` and
        ``exozodi`` need a unit or an x, and their factors are on the numbers of the instrument: ``drift=x2`` doubles
        the offset of a visit and the walk within it; ``drift=0.1nm`` makes the offset 0.1 nm and scales the walk in the
        same ratio.
    facts : bool
        Whether every variant is also compared without each fact that is known, which takes several times as long.
    option : str
        What refusals call the values.

    Returns
    -------
    StrategiesConfig
        Strategies are named ``NAME KEY=VALUE`` with the unit or the x; the first one comes first for all values.

    Raises
    ------
    InputError
        For an unknown key, a value that it cannot have, and a number that could be a value or a factor.
    """
    parsed = [_sweep(text, config, option) for text in sweeps]
    keys = [item.key for item in parsed]
    for item in parsed:
        if keys.count(item.key) > 1:
            raise InputError(option, item.key, allowed="each key once")
    if {"time_budget_h", "share_of_time"} <= set(keys):
        raise InputError(option, "budget_h and share_of_time", allowed="one of the two: each is all telescope time")
    instrument = config.universe.made_instrument() if set(keys) & set(_UNITS) else None
    made = []
    for strategy in config.strategies:
        tree = strategy.model_dump(mode="python")
        every = [[_setting(item, value, tree, strategy, instrument) for value in item.values] for item in parsed]
        for item, settings in zip(parsed, every, strict=True):
            _check_differ(item, settings)
        for chosen in itertools.product(*every):
            own = tree | ({"share_of_time": None} if "time_budget_h" in keys else {})
            for setting, value in chosen:
                own = put(own, setting.key, value)
            given = tuple(setting for setting, _ in chosen)
            label = " ".join(setting.label for setting in given)
            about = f"{strategy.description}; here with {label}" if strategy.description else ""
            named = {"name": f"{strategy.name} {label}", "description": about}
            made.append(validate(SurveyStrategy, own | named, where=option))
            made[-1]._provenance.update({key: item for key, item in strategy.provenance.items() if key not in keys})
            made[-1]._varied = (*strategy.varied, *given)
    if len(made) > MAX_STRATEGIES:
        raise InputError(option, f"{len(made)} strategies", allowed=f"at most {MAX_STRATEGIES} in all")
    universe = config.universe.model_copy(update={"facts": facts})
    return budgeted(config.model_copy(update={"strategies": tuple(made), "universe": universe}))


def variation_lines(config: StrategiesConfig) -> list[str]:
    """Return what is varied, one value a line, with what each means: ``drift x2: 0.1 nm visit offset, ...``."""
    every = {item.label: item for strategy in config.strategies for item in strategy.varied}
    return [
        f"{item.name} {item.text.split(' (')[0]}: {item.meaning}" if item.meaning else f"{item.name} {item.text}"
        for item in every.values()
    ]


def _sweep(text: str, config: StrategiesConfig, option: str) -> _Sweep:
    name, sign, listed = text.partition("=")
    name = name.strip()
    if not sign or not name or not listed.strip():
        raise InputError(option, text, allowed="KEY=VALUE,VALUE..., as contrast=1e-8,3e-9 or drift=x0.5,x2")
    texts = [item.strip() for item in re.split(r",(?![^\[{]*[\]}])", listed)]
    if not all(texts):
        raise InputError(option, text, allowed="a value between commas; null for none")
    if name == "share":
        raise InputError(option, name, allowed="slot_share or share_of_time", hint=SHARES)
    key = SHORT_NAMES.get(name, name)
    known = tuple(key for key in keys_of(SurveyStrategy) if key not in ("name", "description"))
    if key not in known:
        drift = "drift=0.1nm sets the offset of a visit" if key.startswith("drift.") else ""
        hint = drift or nearest(name, (*SHORT_NAMES, *known)) or f"short names: {', '.join(SHORT_NAMES)}"
        raise InputError(option, name, allowed="a key of a strategy", hint=hint)
    unit = _UNITS.get(key, unit_of(key))
    return _Sweep(option, key, name, tuple(read_value(f"{option} {name}", item, unit) for item in texts))


def _setting(
    sweep: _Sweep, written: Written, tree: Mapping[str, Any], strategy: SurveyStrategy, instrument: Instrument | None
) -> tuple[VariedSetting, Any]:
    """Return one value of a key: how it is told, and what the strategy gets."""
    if instrument is not None and sweep.key in _UNITS:
        return _of_instrument(sweep, written, instrument)
    unit = unit_of(sweep.key)
    value, text = written.value, written.text
    if written.action == "scale":
        present = get(tree, sweep.key)
        value = scaled(present, written.value)
        if value is None:
            hint = f"{sweep.key} of {strategy.name} is {'not set' if present is None else present}"
            raise InputError(sweep.where, text, allowed="a value: only numbers take a factor", hint=hint)
        shown = ", ".join(f"{item:g}" for item in value) if isinstance(value, tuple) else f"{value:g}"
        text = f"{text} ({with_unit(shown, unit)})"
    most = f"at most that fraction of any slot; the telescope time in all stays {strategy.time_budget_h:g} h"
    return sweep.setting(text, value, unit, most if sweep.key == "slot_share" else ""), value


def _of_instrument(sweep: _Sweep, written: Written, instrument: Instrument) -> tuple[VariedSetting, Any]:
    """Return one value of what is assumed of the instrument, whose numbers are what factors multiply."""
    key, unit, text = sweep.key, _UNITS[sweep.key], written.text
    factor = written.action == "scale"
    optics = {band.t_opt for band in instrument.bands.values()}
    present = {
        _DRIFT: instrument.drift.visit_nm,
        _EXOZODI: instrument.sky.exozodi_zodis,
        _THROUGHPUT: min(optics) if len(optics) == 1 else None,
    }[key]
    if written.bare:
        raise two_spellings(sweep.where, sweep.name, text.removesuffix(unit).strip(), unit=unit, present=present)
    if key == _EXOZODI and written.value is None:  # as the instrument has it
        return sweep.setting(text, None, "", ""), None
    if not factor and (key == _THROUGHPUT or not isinstance(written.value, float)):
        asked = "a factor with an x, as x0.7"
        raise InputError(sweep.where, text, allowed=f"{asked}, or a number with a unit ({unit})" if unit else asked)
    said = ""
    if key == _THROUGHPUT:
        value = given = written.value
        said = "" if present is None else f"the optics pass {present * value:g} of the light"
    elif not present and (factor or key == _DRIFT):
        other = "an instrument with drift" if key == _DRIFT else f"a number with a unit: {sweep.name}=3{unit}"
        raise InputError(sweep.where, text, allowed=other, hint=f"this one has 0 {unit}: nothing can be scaled")
    else:
        value = given = present * written.value if factor else written.value
        text = f"{text} ({value:g} {unit})" if factor else text
    if key == _DRIFT:
        given = written.value if factor else value / present
        walk = given * instrument.drift.walk_nm_per_sqrt_hour
        said = f"{value:g} nm visit offset, {walk:g} nm/sqrt(h) walk, x{given:g} of the instrument's"
    return sweep.setting(text, value, unit, said), given


def _check_differ(sweep: _Sweep, settings: Sequence[tuple[VariedSetting, Any]]) -> None:
    """Refuse a value that is given twice, in two spellings or one."""
    for i, (setting, value) in enumerate(settings):
        same = next((other for other, given in settings[:i] if given == value), None)
        if same is not None:
            also = "" if same.text == setting.text else f"{same.text} is the same"
            raise InputError(sweep.where, setting.text, allowed="each value once", hint=also)
