"""Results of survey what-ifs, with means over synthetic universes and decisions under doubt.

Under doubt a survey is planned for one value of a number, and played under another.
"""

from typing import Annotated, Any, Literal

from pydantic import Field

from cpic_planner.results.base import OfTables, Result, Row, RunResult, StarRow, column, optional


class CurvePoint(Result):
    """One point of a curve with its band."""

    x: float = column("telescope time used in hours, or number of universes")
    mean: float
    low: float
    high: float


class ChangeRecord(Result):
    """Mean of a paired difference over universes."""

    mean: float
    error: float = column("standard error of the mean, of the number of universes")
    low: float = column("lower end of the 90 % interval of the mean")
    high: float = column("upper end of it")


class EstimateRecord(ChangeRecord):
    """Mean over universes."""

    survey_low: float = column("5 % of the surveys find fewer")
    survey_high: float = column("5 % of the surveys find more")


class DoubtValue(Result):
    """A value that the number may turn out to have."""

    text: str = column("the value with its unit or its x: 0.1 nm")
    meaning: str = column("in words, where the text does not say it all")
    weight: float = column("how likely it is; all of them sum to 1")


class DoubtCell(Row):
    """One plan played under one value: the same visits, in the same universes.

    Planets are those of ``quantity`` of the record.
    """

    strategy: str
    planned_for: str = column("value that the strategy was planned for")
    played_under: str = column("value that the number then has")
    planets: EstimateRecord = column("planets found")
    visits: float = column("visits made, mean over universes")
    hours: float = column("telescope time used, mean over universes")
    loss: ChangeRecord = column("what the best of all plans finds under that value, less what this one finds")
    regret: ChangeRecord = column(
        "what the same strategy's plan for that very value is worth, less what this plan is, as the scheduler counts: "
        "value_new and value_known a planet, less min_gain a visit"
    )
    regret_of_planets: ChangeRecord = column("the same without the price of visits, value of planets alone")


class DoubtChoice(Row):
    """One plan over all values that the number may have."""

    strategy: str
    planned_for: str = column("value that the strategy was planned for")
    planets: float = column("found, mean over universes and values by their weights")
    error: float = column("standard error of the mean, of the number of universes")
    low: float = column("mean over universes below which 5 % of the weight of the values lie")
    high: float = column("the same for 95 %")
    survey_low: float = column("5 % of the surveys find fewer, over universes and values")
    survey_high: float = column("5 % of the surveys find more, over universes and values")
    largest_loss: float = column("of all values: planets fewer than the best plan finds there")
    largest_loss_under: str = column("value under which it loses most")


class DoubtDecision(Result):
    """The choice among some plans."""

    strategy: str = column("the strategy whose plans these are; empty: all plans of all strategies")
    cautious: DoubtChoice = column("the plan whose largest loss is the smallest")
    expected: DoubtChoice = column("the plan that finds most by the weights")
    value_of_knowing: ChangeRecord = column(
        "planets more if the number is known before the plan is chosen, by the weights"
    )


class DoubtRecord(Result):
    """The plan to take while a number is not known."""

    key: str = column("the number as it was asked for: drift")
    quantity: Literal["planets", "new_planets"] = column("what the choice is made by")
    values: list[DoubtValue]
    weights_from: str = column("where the weights are from")
    cells: list[DoubtCell]
    choices: list[DoubtChoice] = column("every plan; losses are those against the best of all plans")
    decision: DoubtDecision
    of_strategies: list[DoubtDecision] = column(
        "if one strategy is settled: losses are those against the best of its own plans"
    )
    statement: str = column("the decision in words")


class OccurrenceRange(Result):
    """New planets over the published range of the population's occurrence rate.

    Planets are independent of each other, so that their number in the same visits goes with the rate. A survey that is
    planned for another rate makes other visits: fewer of them are worth it where planets are rare.
    """

    planets_per_star: float = column("of the population as it was run")
    planets_per_star_low: float
    planets_per_star_high: float
    low: float = column("new planets found with the lowest rate in the same visits, mean over universes")
    high: float = column("with the highest rate")


class TimeUse(Result):
    """The use of the telescope time, means over universes, in hours."""

    exposing_h: float = column("search: science and reference frames with readouts")
    occulted_h: float = column("search: behind the Earth, in the South Atlantic Anomaly, windows not filled")
    settling_h: float = column("search: slews and settling")
    follow_up_h: float = column("second visits of candidates that are planets included")
    alarm_h: float = column("visits that only false alarms asked for")
    unused_h: float = column("of the budget")
    budget_h: float = column("telescope time that the strategy may use")
    budget_share: float = column("the budget over the length of the survey")


class ScheduleRecord(Result):
    """The calendar that was planned, before chance had its say."""

    method: str
    visits: int = column("planned within the budget")
    reserve_visits: int = column("planned for time that stop rules free")
    hours: float = column("telescope time of the visits within the budget")
    value: float = column("what they are worth on the planets of planning, orbits included where they have a value")
    bound: float = column("what no schedule can pass")
    distance: float = column("1 - value / bound")


class SurveyTarget(StarRow):
    """One star of a strategy."""

    rank: int = column("by planets found per hour", label="#")
    v_mag: float
    distance_pc: float
    ra_deg: float
    dec_deg: float
    known_planets: list[str] = column("names in the table of known planets")
    bands: list[str] = column("of its planned visits")
    visit_time_s: float = column("wall time of a visit, mean of those planned", label="wall time", short="wall")
    visit_h: float = column("telescope time of a visit, mean of those planned", label="telescope", format=".1f")
    planned_visits: int
    slots: list[int] = column("of the planned visits, those of the reserve included")
    first_utc: str = column("middle of the days of the first planned visit", label="first visit", short="first")
    visits: float = column("made, mean over universes", label="visits made", short="visits", format=".1f")
    search_h: float = column(label="search", format=".1f")
    follow_up_h: float = column(label="follow-up", format=".1f")
    alarm_h: float = column(
        "visits that only false alarms asked for, mean over universes", label="false alarms", format=".1f"
    )
    new_planets: float = column("found, mean over universes")
    new_planets_unconditional: float = column(
        "the same with planets that are excluded, in the same visits", label="new planets, nothing excluded"
    )
    known_seen: float = column(label="known planets")
    orbits_known: float = column("planets found whose orbit is known, mean over universes")
    orbit_epochs: float | None = optional("positions of a planet that has enough for an orbit, median; null: none has")
    orbit_arc_periods: float | None = optional("their arc in periods of the planet, median")
    orbit_axis_error: float | None = optional("relative error of the semi-major axis, median")
    orbit_place_error_lambda_d: float | None = optional("error of the place in the star's next window, median")
    planets_per_100h: float = column(
        "planets found in 100 hours of telescope time", label="planets per 100 h", short="per 100 h", format=".2g"
    )


_ORDINAL, _SPAN_MIN = Field(ge=1, le=1e6), Field(ge=0, le=1e5)
_MJD = Field(ge=0, le=1e6)


class PlannedVisitRow(Row):
    """One visit of a strategy's calendar, and what came of it: one line of ``visits.csv``.

    The first columns are the plan. The last three are empty until somebody has observed, and then the line is one of
    an observation log; whoever took other frames, another roll or more time than planned writes that over the plan.
    Ranges are those that a file may hold (`cpic_planner.survey.observed`).
    """

    strategy: str = column("name of the strategy that plans the visit; empty in a log: no plan had it")
    visit: Annotated[int, _ORDINAL] = column("number of the visit in the calendar of its strategy, from 1")
    star: str = column("name of the star in the catalogue", format="star")
    hip: int | None = None
    ra_deg: Annotated[float, Field(ge=-360, le=360)] = column("right ascension at the date of the survey's positions")
    dec_deg: Annotated[float, Field(ge=-90, le=90)] = column("declination at that date")
    reason: Literal["search", "known_planet", "follow_up"] = column(
        "what the visit is for: search (planets that nobody knows), known_planet (which is the likelier detection), or "
        "follow_up (the log has a detection at this star)"
    )
    reserve: bool = column("whether it is made only where stop rules have freed the time for it")
    window_start_utc: str = column("begin of the first day in its slot on which the star may be pointed at")
    window_end_utc: str = column("end of the last such day; the Moon may forbid some between")
    window_start_mjd: Annotated[float, _MJD] = column("the begin as Modified Julian Date of UTC")
    window_end_mjd: Annotated[float, _MJD] = column("the end likewise")
    arcs: Annotated[int, _ORDINAL] = column(
        "orbits that the frames take, with the arc of each in which the star is seen"
    )
    arc_usable_min: Annotated[float, _SPAN_MIN] = column(
        "time of an orbit that can be used, mean of the window: clear of the Earth's limb, less what the South "
        "Atlantic Anomaly takes on average",
        unit="min",
    )
    arc_longest_min: Annotated[float, _SPAN_MIN] = column(
        "longest piece of that arc: the Earth may stand in its middle", unit="min"
    )
    roll_deg: Annotated[float, Field(ge=-360, le=360)] = column(
        "position angle of the detector's +y axis; empty in a log: that of the solar panels on that day"
    )
    quadrants: str = column("dark quadrants of the detector, +x right and +y up: all, or their names")
    band: str = column("name of the band")
    exposure_s: Annotated[float, Field(ge=1e-6, le=1e6)] = column("exposure of one frame")
    visits: Annotated[int, Field(ge=1, le=1000)] = column(
        "wavefronts of this visit that are reduced together, each begun with a settling of its own"
    )
    frames_per_visit: Annotated[int, Field(ge=1, le=1e9)] = column("science frames of each of them")
    em_gain: Annotated[float, Field(ge=1, le=1e4)]
    reference_library: str = column("where the reference frames come from")
    reference_ratio: Annotated[float, Field(ge=0, le=1000)] = column("reference frames per science frame")
    time_s: Annotated[float, Field(ge=0, le=1e9)] = column(
        "wall time of science and reference frames with readouts, without occultations"
    )
    telescope_h: Annotated[float, Field(ge=0, le=1e5)] = column(
        "telescope time with slews, settling and occultations; in a log what it took"
    )
    probability: Annotated[float, Field(ge=0, le=1)] = column(
        "probability that this visit completes the detection of a planet, by the planets that the calendar was made "
        "with, if the star's earlier visits are made as planned"
    )
    start_utc: str | None = optional("when the visit began, ISO 8601; empty: not observed")
    outcome: Literal["detected", "not_detected", "lost"] | None = optional(
        "what came of it; lost: its time is spent and its frames say nothing; empty: not observed"
    )
    planets: Annotated[int | None, Field(ge=0, le=1000)] = optional("number of planets that it showed")


class VisitsResult(RunResult):
    """Planned visits of all strategies of a comparison: ``visits.json``, the table of ``visits.csv``."""

    kind: Literal["visits"] = "visits"
    version: str
    config_hash: str = column("hash of everything that decides the comparison")
    catalogue: str
    date_utc: str = column("date of the positions of the stars")
    visits: list[PlannedVisitRow]


class ImageSample(Result):
    """Detections of a strategy that were simulated as images and measured blind."""

    detections: int = column("sampled")
    images: int = column("simulated sequences")
    expected: float = column("of them detected by the law of the strategy")
    found: int = column("detected in the images, by the same rule")
    correction: float | None = column("found over expected")
    low: float | None = column("lower end of its 90 % interval")
    high: float | None
    note: str = ""


class VariedSetting(Result):
    """A value that ``--vary`` gave a strategy."""

    name: str = column("as it was asked for: drift, budget_h ...")
    key: str = column("dotted key of the strategy")
    text: str = column("the value with its unit or its x: 0.1 nm, x2 (0.1 nm)")
    value: Any = column("number in the unit, or a word; of a factor what it makes of the present value")
    unit: str = column("empty: the quantity has none, or it is a factor")
    meaning: str = column("in words, where the text does not say it all")

    @property
    def label(self) -> str:
        """The setting as names of strategies have it: ``drift=0.1 nm``."""
        return f"{self.name}={self.text}"


class PlanetShare(Result):
    """The known planet that makes up most of a yield."""

    name: str = column("in the table of known planets")
    share: float = column("of all planets found over the universes")
    planets: float = column("how often it is found, mean over universes")


class AssumedInstrument(Result):
    """Numbers of the instrument that a strategy was run with, its assumptions included."""

    visit_drift_nm: float = column("offset of the wavefront of a visit, rms")
    walk_nm_per_sqrt_hour: float = column("walk of the wavefront within a visit, rms")
    exozodi_zodis: float = column("dust around every star; the median where each star has its own")
    throughput: dict[str, float] = column("of the optics, by band of the search")


class StrategyOutcome(Row):
    """The yields of one strategy."""

    name: str = column(label="strategy")
    description: str
    varied: list[VariedSetting] = column("values of --vary; empty: none", default=[])
    instrument: AssumedInstrument | None = None
    leading_planet: PlanetShare | None = optional("null: no known planet is found")
    settings: dict[str, Any] = column("the strategy as it was run")
    schedule: ScheduleRecord
    planets: EstimateRecord = column("planets found, new and known")
    new_planets: EstimateRecord = column(
        "planets that nobody knew and that velocities, stability and known giants allow"
    )
    new_planets_unconditional: EstimateRecord = column(
        "of the whole population, in the same visits: what new planets would be had nobody looked before"
    )
    occurrence: OccurrenceRange | None = optional("null: the population states no range of its occurrence rate")
    known_planets: EstimateRecord
    stars_with_planet: EstimateRecord
    characterised_planets: EstimateRecord
    orbits_known: EstimateRecord = column("planets found whose semi-major axis and next place are known well enough")
    confirmed_planets: EstimateRecord = column(
        "planets found where a published orbit has them, or seen again in another visit"
    )
    noise_alarms: EstimateRecord
    background_alarms: EstimateRecord
    hours: EstimateRecord = column("telescope time used")
    any_planet: float = column("share of the universes in which it finds any planet", short="any %", format="%")
    any_new_planet: float = column("the same for a new planet", short="any new %", format="%")
    time_use: TimeUse
    curve: list[CurvePoint] = column("planets found against telescope time used")
    convergence: list[CurvePoint] = column("mean of planets found against number of universes")
    quantiles: dict[str, list[float]] = column("5, 25, 50, 75, 95 % of detections by quantity; empty: none")
    targets: list[SurveyTarget]
    images: ImageSample | None = optional("null where no images were asked for")

    @property
    def base(self) -> str:
        """Name without the values that were varied."""
        return self.name.removesuffix(f" {self.variation}") if self.varied else self.name

    @property
    def variation(self) -> str:
        """The values that were varied: ``drift=0.1 nm rule=blind``."""
        return " ".join(item.label for item in self.varied)


class DifferenceRecord(Row):
    """Paired difference of two strategies: the same universes, the same noise where they make the same visit."""

    first: str
    second: str
    quantity: Literal["planets", "new_planets", "characterised_planets", "orbits_known", "hours"]
    mean: float = column("first minus second")
    error: float
    low: float = column("lower end of the 90 % interval of the mean")
    high: float
    correlation: float | None = column("of the two over universes; null where one never varies")
    verdict: str


class RankChange(Row):
    """A star that one strategy ranks elsewhere than the first one."""

    strategy: str
    star: str
    first_rank: int | None = column("null: not among its targets")
    rank: int | None
    why: str


class TakenBack(Result):
    """A fact that is taken back, and what a survey was planned and played with then."""

    name: str
    words: str = column("the fact in words")
    heading: str = column("the survey without it in words")
    catalog: str
    known_planets: str
    exclusions: list[str]


class FactRow(Row):
    """The yields of one strategy, planned and played as if one fact were not known, in the same universes.

    A change is the number without the fact less that with all facts.
    """

    strategy: str
    fact: str
    planets: EstimateRecord
    planets_change: ChangeRecord
    new_planets: EstimateRecord
    new_planets_change: ChangeRecord
    known_planets: EstimateRecord
    known_planets_change: ChangeRecord


class FactsRecord(Result):
    """The facts that moved numbers, and the numbers."""

    facts: list[TakenBack] = column("the last one is all of them at once, where there are several")
    rows: list[FactRow]
    statement: str = column("the fact that moves most, in words")


class SettingSource(Result):
    """The source of a number of the strategies' file or of its preset."""

    key: str = column("dotted key of a strategy; universe.KEY of what all share")
    value: Any
    unit: str
    source: str
    confidence: str = column("P: published, I: inferred from published or measured numbers, A: assumed")
    strategies: list[str] = column("those that have this value")


class WhatIfResult(OfTables, RunResult):
    """Comparison of survey strategies: reproducible from configuration and seed."""

    kind: Literal["whatif"] = "whatif"
    version: str
    name: str
    description: str
    universe: dict[str, Any] = column("what all strategies share")
    catalogue: str
    known_planets: str = column("table of known planets; empty: left out")
    observed: str = column("observation log that was taken into account; empty: none")
    n_universes: int
    slot_utc: list[str] = column("begin of every slot of the calendar")
    strategies: list[StrategyOutcome]
    differences: list[DifferenceRecord]
    rank_changes: list[RankChange]
    facts: FactsRecord | None = optional("null where the comparison was not asked for")
    doubt: DoubtRecord | None = optional("null where no number is in doubt")
    statement: str = column("the outcome in words")
    sources: list[SettingSource] = column("empty: no setting states one", default=[])
    not_modelled: list[str]
