"""A survey strategy as frozen configuration: targets, visits, revisits, detection and stop rules."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, WrapValidator, model_validator

from cpic_core import FloatArray, InputError
from cpic_planner.etc import LAW_ERROR
from cpic_planner.planets import FLOOR_MAS, STAR_MASS_ERROR, PopulationConfig, load_population
from cpic_planner.queries import Strategy as Reduction, read_value
from cpic_planner.results import VariedSetting
from simulator.config import FrozenModel, Real, Sourced, validate


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
    (`cpic_planner.survey.orbit_visits.best_slots`), and come before planned visits.

    ``value`` is what a known orbit is worth to the scheduler beside the detection of its planet, in units of that: a
    visit counts so much more for each planet that it is likely to detect early enough for its orbit, by the positions
    of visits to come (`cpic_planner.survey.orbit_visits.orbit_chance`). With 0 schedules are made for detections alone.
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
        (`cpic_planner.survey.strategy_file`).
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
