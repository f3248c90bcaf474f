"""Results of the ranking: rows, sensitivity, ensembles, comparison with another ranking, and explanations."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from cpic_planner.registry import ScoreName
from cpic_planner.results.answers import EtcResult, Quantiles
from cpic_planner.results.base import (
    MADE_LATE,
    DetectionMode,
    Document,
    LimitColumns,
    LimitText,
    OfTables,
    ProgrammeColumns,
    RankedSample,
    Result,
    Row,
    RunResult,
    StarHeader,
    StarRow,
    StatusText,
    VerdictColumns,
    column,
    optional,
)
from cpic_planner.results.compared import AnswerComparison, SettingChange
from cpic_planner.results.runs import InstrumentResult
from simulator.config import Real


class EnsembleBar(Row):
    """The effect of one unknown number on a ranking, all others as they are assumed."""

    key: str = column("key of the number")
    label: str = column("what the number is", label="number")
    low: str = column("value, or factor on the instrument's, that 5 % of its law are below", label="low")
    high: str = column("that 95 % are below", label="high")
    planets_low: float = column("expected planets of one observation of every star, at low", format=".2g")
    planets_high: float = column("the same at high", format=".2g")
    n_reachable_low: int = column("stars whose reference planet is detected, at low")
    n_reachable_high: int = column("the same at high")
    tau_low: float | None = column(
        "Kendall's tau-b of the nominal scores and those at low, over the stars among the first ten in either; null "
        "where no order can be compared",
        format=".2f",
    )
    tau_high: float | None = column("the same at high", format=".2f")
    source: str = column("where the law is from")


class EnsembleRecord(Result):
    """The ranking under an ensemble of instruments that fit what is known."""

    name: str
    n_instruments: int = column("instruments drawn, a Latin hypercube")
    seed: int
    n_stars: int = column(
        "stars that all instruments rank; the others have neither a detection nor a thousandth of the expected planets "
        "under any of those that rank all stars"
    )
    planets_nominal: float = column(
        "expected planets of one observation of every star by the instrument asked; completeness summed where the "
        "population has no rate of occurrence"
    )
    planets_p05: float = column("the same, exceeded by 95 % of the instruments")
    planets_median: float
    planets_p95: float
    n_reachable_nominal: int = column("stars whose reference planet is detected, by the instrument asked")
    n_reachable_p05: int = column("the same, exceeded or equalled by 95 % of the instruments")
    n_reachable_median: int
    n_reachable_p95: int
    bars: list[EnsembleBar] = column("what the numbers hang on, the largest effect on planets first")
    decides: str = column("key of the number that decides how many planets are expected")
    decides_order: str = column("key of the number that changes the order of the first ten most")
    statement: str = column("the same in words")


class SensitivityRow(Row):
    """The ranking under one other assumption."""

    assumption: str = column("key of the assumption")
    text: str = column("what is assumed instead", label="assumption")
    n_ok: int = column("stars whose reference planet is detected", label="detected")
    kendall_tau_b: float | None = column(
        "Kendall's tau-b of the nominal scores and those under the assumption, over the compared stars; ties count as "
        "no order; null where no order can be compared",
        label="tau",
        format=".2f",
    )
    n_compared: int = column(
        "stars among the first, nominally or under the assumption, that have a score above zero in either",
        label="stars compared",
        short="tau of",
    )
    kendall_tau: float | None = column(
        "Kendall's tau of the ranks of the nominal first stars, those without a score included, whose ranks are by "
        "margin and name; null for one star",
        format=".2f",
    )
    kept: int = column("stars of the nominal top that are in the top under this assumption too")
    kept_first: int = column("stars of the nominal first ones that are among the first under this assumption too")
    largest_fall: str = column(
        "star of the nominal top that loses most ranks; empty if none", label="biggest fall", format="star"
    )
    largest_fall_ranks: int = column("ranks that it loses", label="by ranks")
    best: str = column("first star under this assumption", label="first star", short="first", format="star")


class SensitivityStar(StarRow):
    """The ranks of one of the nominal first stars under all assumptions, the nominal ones included."""

    rank: int = column("nominal rank", label="#")
    rank_lowest: int = column("lowest number of its rank under any of the assumptions")
    rank_highest: int = column("highest number of its rank under any of them")


class SensitivityResult(OfTables, RunResult):
    """The dependence of the ranking on what is assumed."""

    schema_version: Literal[2] = 2  # type: ignore[assignment]
    kind: Literal["sensitivity"] = "sensitivity"
    top: int = column("stars of the nominal ranking that are compared")
    first: int = column("first stars that kept_first is about: those that a plan proposes, else ten")
    score_name: ScoreName
    n_ranked: int = column("stars of the ranking")
    n_ok: int = column("stars whose reference planet is detected, nominally")
    rows: list[SensitivityRow]
    stars: list[SensitivityStar] = column("the nominal top")
    statement: str = column("the same in words")


KNOWN_PLANETS = "known planets"
"""Name of the population where completeness refers to the stars' own planets."""


class PopulationRecord(Result):
    """The population that completeness refers to."""

    name: str
    description: str
    n_planets: int = column("planets drawn, the same at every star")
    seed: int
    planets_per_star: float | None = column("occurrence, if the population states it")
    planets_per_star_range: tuple[float, float] | None = optional(
        "what surveys find that disagree: expected planets are uncertain in this ratio"
    )
    exclusions: list[str] = column(
        "knowledge of the stars that excludes planets: rv, stability, known_giants; empty in older results", default=[]
    )
    columns_not_used: list[str] = column("headings of a user's table of known planets", default=[])


class PlaceColumns(Row):
    """Columns of the reference planet in a band, at the place where it is seen best, and of the population there."""

    band: str
    status: StatusText = column("ok when the reference planet is detected in the given time")
    reason: str = column(
        "why not, empty when ok; speckle_floor: no length of so many visits is enough; common_speckle_floor: no number "
        "of visits is, up to 1000; planet_moves: it would be if the planet stood still; limited_by says why"
    )
    separation_arcsec: float = column("projected separation of the reference planet, arcsec")
    contrast: float
    snr: float = column("predicted photometric SNR of the stack; 0 where no frame is possible")
    significance: float
    threshold: float = column("small-sample detection threshold for significance, 5 sigma-equivalent")
    detection_margin: float
    contrast_limit: float | None
    completeness: float = column(
        "fraction of the population that one observation detects in the band by a search that does not know where "
        "planets stand: mean of their probabilities; planets that velocities, a companion star or a known giant "
        "exclude do not count"
    )
    completeness_known_place: float | None = optional(
        "the same where each planet is looked for at its known place; null in older results"
    )
    completeness_unconditional: float | None = optional(
        "completeness of all planets, whatever is known of the star; null in older results",
        label="completeness of all",
        short="of all %",
        format="%",
    )
    completeness_known_place_unconditional: float | None = optional(
        "the same where each planet is looked for at its known place; null in older results",
        label="completeness of all at known places",
        short="known, of all %",
        format="%",
    )


class Standing(VerdictColumns, ProgrammeColumns, PlaceColumns):
    """The standing of a star with one reference planet: its best observation, and what that detects."""

    required_drift_factor: float | None = optional(
        "largest factor on the drift, common part and walk included, with which the planet is detected in the given "
        "time, visits and place chosen anew; null where it is detected, or no drift is small enough"
    )
    required_contrast_factor: float | None = optional(
        "factor by which the planet has to be brighter to be detected in the given time; null where it is detected"
    )


class RankedColumns(StarRow):
    """Columns of a star in the ranking."""

    column_order: ClassVar[str] = "rank rank_in_catalogue score"
    rank: int = column(
        "1 is best: highest score; among the stars that the filters choose, where there are any", label="#"
    )
    rank_in_catalogue: int | None = optional(
        "rank among all stars of the sample, whatever the filters are; null in older results",
        label="rank in the catalogue",
        short="# of all",
    )
    score: float = column(
        "what the ranking is by, see score_name; more is better; stars of equal score, such as all those of score 0, "
        "follow each other by detection_margin, then name"
    )
    hip: int | None
    v_mag: float
    sp_type: str = column("spectral type as catalogued", label="type")
    distance_pc: float
    hd: str | None = optional("Henry Draper number; null if not listed, and in older results", label="HD")
    gj: str | None = optional("Gliese-Jahreiss number; null if not listed, and in older results", label="GJ")
    ra_deg: float | None = column("ICRS right ascension at the date, deg; null if not listed", format=".5f")
    dec_deg: float | None = column("ICRS declination at the date, deg; null if not listed", format=".5f")


class RankedTarget(Standing, RankedColumns):
    """One star of the ranking. Numbers refer to the stated reference planet in the best band and separation."""

    tier: int | None = optional(
        "1: the reference planet is detected in the given time; 2: it would be in at most ten times the time, or with "
        "a tenth of the drift or more; 3: a planet at most ten times as bright would be; 4: the others; null in older "
        "results"
    )
    band: str = column("best band")
    deepest_limit: float | None = column("the same at the separation where it is faintest", format=".2e")
    deepest_separation_arcsec: float = column("that separation, arcsec", format=".3f")
    detection_time_s: float | None = column(
        "least wall time that detects the reference planet, in any band and at any separation; null: none",
        format="time",
    )
    detection_visits: int | None = optional("visits of that observation; null: none, or an older result")
    completeness_error: float = column("standard error, by the planets drawn, of the one that counts", format="%")
    completeness_band: str = column("band of that observation", label="band of completeness", short="in")
    completeness_time_s: float | None = column("its wall time, s", format="time")
    completeness_per_hour: float = column("the completeness that counts over that time in hours")
    expected_planets: float | None = optional(
        "the completeness that counts times planets per star of the population", format=".2g"
    )
    expected_planets_unconditional: float | None = optional("the same of all planets", format=".2g")
    required_time_s: float | None = optional(
        "least wall time that detects the planet, visits chosen anew unless their number is given; null where it is "
        "detected, or no time does"
    )
    ref_planet_distance_au: float = column("true star-planet distance, au")
    ref_planet_insolation_au: float | None = column("distance from the Sun of equal insolation, r / sqrt(L), au")
    rv_amplitude_m_s: float | None = optional(
        "amplitude of the star's velocity by the reference planet there, m/s: with the least mass of its radius, on an "
        "orbit inclined by the median of 60 deg; null in older results",
        label="velocity",
        short="K m/s",
        format=".2g",
    )
    luminosity_lsun: float | None = column("bolometric luminosity, solar units")
    companion_separation_arcsec: float | None = column("nearest known companion, at the date, arcsec")
    companion_pa_deg: float | None = optional("its position angle east of north, deg; null where not known")
    companion_position_error_arcsec: float | None = optional(
        "standard error of its place: by the grade of its orbit, or how far it can have moved since it was seen"
    )
    p_reachable: float | None = optional(
        "share of the ensemble's instruments that detect the reference planet in the given time; null without an "
        "ensemble",
        label="reachable",
        short="reach %",
        format="%",
    )
    rank_median: float | None = optional("median rank over the ensemble; null without one", short="rank", format=".0f")
    rank_p05: float | None = optional("rank that 5 % of the ensemble do not pass upwards", short="5 %", format=".0f")
    rank_p95: float | None = optional("rank that 5 % of the ensemble fall behind", short="95 %", format=".0f")
    p_rank_le_10: float | None = optional(
        "share of the ensemble's instruments under which the star is among the first ten",
        label="among the first ten",
        short="first 10 %",
        format="%",
    )
    flags: list[str] = column("caveats, see the documentation of flags")
    own: dict[str, bool | int | float | str | None] = column(
        "columns of your own star table that are not used, by their headings, as they are there; empty for shipped "
        "tables and in older results",
        default={},
    )


class RankResult(RankedSample, OfTables, RunResult):
    """The analytic ranking of the whole sample."""

    kind: Literal["rank"] = "rank"
    instrument: str = column("name of the instrument; empty in older results", default="")
    sigma: float = column("detection level whose false-alarm probability the thresholds keep")
    reference_library: str = column(
        "reference library of the subtraction, the mean of whose frames is taken off, without further modes"
    )
    annulus_lambda_d: float | None = optional(
        "half width of the annulus whose apertures tell background and noise, lambda/D; null in older results"
    )
    search: DetectionMode = column(
        "how the planets that completeness counts are looked for, which says which completeness the score, its error "
        "and the expected planets are of; known_place in older results",
        default="known_place",
    )
    visits: int | None = optional("visits of every observation; null: the best number for each star and band")
    drift_nm: float | None = optional("rms of the wavefront offset of a visit; null in older results")
    population: PopulationRecord
    score_name: ScoreName = column("what the ranking is by")
    ensemble: EnsembleRecord | None = optional("the same under many instruments, where asked")
    targets: Annotated[list[RankedTarget], *MADE_LATE]

    @property
    def filtered(self) -> bool:
        """Whether the rows are some of the ranked stars."""
        return self.n_in_catalogue is not None and self.n_in_catalogue > len(self.targets)


class StarInRanking(Row):
    """The place of one star in one of two rankings; columns are those of its row there."""

    rank: int = column("among all stars of the sample, whatever the filters are")
    score: float
    detection_margin: float
    status: StatusText
    limited_by: LimitText | None
    band: str
    completeness: float
    completeness_band: str
    completeness_time_s: float | None
    visits: int | None


class RankMove(Row):
    """One star in two rankings."""

    name: str = column("name of the star in the second ranking", label="star", format="star")
    hip: int | None
    before: StarInRanking
    after: StarInRanking
    places: int = column("places that it gains; below 0: loses")
    score_ratio: float | None = column(
        "score after over score before; null where that was 0, or where the rankings are not by the same score",
        label="score ratio",
        short="score ×",
    )
    why: str = column("what changes of the star, or of others, in words")


class RankAgreement(Row):
    """The agreement of two rankings on the first stars."""

    top: int = column("first stars of either ranking, among those that both hold")
    kept: int = column("stars that are among the first in both")
    kendall_tau_b: float | None = column(
        "Kendall's tau-b of the scores of the stars that are among the first in either ranking and have a score above "
        "zero in either: 1 the same order, 0 an unrelated one; null where no order can be compared",
        label="tau",
        format=".2f",
    )
    n_compared: int = column("number of these stars")


class ComparedRanking(Result):
    """One of two rankings that are compared."""

    name: str = column("the file or the instrument")
    config_hash: str = column("that of the ranking; of a file without one the sha256 of the file")
    score_name: str | None = column("what it is by; null in a file that does not say it")
    n_stars: int
    n_scored: int = column("stars with a score above zero")
    n_detected: int = column("stars whose reference planet is detected")


class RankComparison(OfTables):
    """The moves from one ranking to another one, and their reasons."""

    main_rows: ClassVar[str] = "targets"
    kind: Literal["comparison"] = "comparison"
    before: ComparedRanking
    after: ComparedRanking
    settings: list[SettingChange] | None = column(
        "settings that differ; null where one of the rankings does not say how it was made"
    )
    only_before: list[str] = column("stars that only the first ranking holds")
    only_after: list[str] = column("stars that only the second ranking holds")
    n_moved: int = column("stars with a score above zero in either ranking that stand at another rank")
    detected_more: list[str] = column("stars whose reference planet is detected after, not before")
    detected_less: list[str] = column("stars whose reference planet is detected before, not after")
    agreement: list[RankAgreement]
    largest_mover: str = column(
        "star that moves by most ranks, of those among the first 50 of either ranking with a score above zero in "
        "either, or of all where there is none; the best ranked of equals; empty where none moves"
    )
    largest_mover_places: int = column("places that it gains; below 0: loses")
    statement: str = column("the comparison in words")
    targets: list[RankMove] = column("stars that both rankings hold, in the order of the second")


class BandStanding(LimitColumns, Standing):
    """One band of a star's explanation."""

    column_order: ClassVar[str] = "... exposure_limited_by gain_limited_by dominant"
    floor_margin: float = column(
        "margin that no programme can pass, of the given number of visits or of up to 1000",
        label="margin at most",
        short="at most",
        format=".3g",
    )
    in_zone: float = column("fraction of the population in the dark quadrants", short="in zone %", format="%")
    observable: float = column("fraction whose whole aperture lies there", short="whole %", format="%")


class Explanation(OfTables):
    """The reasons why a star stands where it stands."""

    kind: Literal["explanation"] = "explanation"
    n_ranked: int
    score_name: ScoreName
    star: RankedTarget
    better: RankedTarget | None = column("star one rank higher")
    worse: RankedTarget | None = column("star one rank lower")
    bands: list[BandStanding]
    ranks: dict[str, int] = column("rank of the star under other assumptions")
    sentences: list[str] = column("the explanation in words")


class KnownBand(Result):
    """A planet in one band."""

    band: str
    contrast: Quantiles = column("true planet-to-star ratio of detected rates")
    hole_share: float = column(
        "share of the draws whose separation lies between inner and outer corner of the dark hole"
    )


class KnownWindow(Result):
    """Days on which a planet more likely than not stands between the corners of the dark hole."""

    band: str
    start_utc: str = column("first day")
    end_utc: str = column("last day")
    best_utc: str = column("day on which it is most likely")
    best_share: float = column("share of the draws on that day")


class KnownTrack(Result):
    """Separation against time."""

    mjd: list[float]
    separation_low_arcsec: list[float] = column("16 % of the draws lie below")
    separation_median_arcsec: list[float]
    separation_high_arcsec: list[float] = column("84 % of the draws lie below")


class KnownOrbit(Result):
    """One published orbit of a planet; null where the publication has no value."""

    reference: str = column("where it was published")
    share: float = column("share of the draws that have it")
    period_days: float | None
    semi_major_axis_au: float | None
    eccentricity: float | None


class KnownPlanetRow(Row):
    """One known planet at the date."""

    planet: str
    star: str
    hip: int | None
    v_mag: float
    distance_pc: float
    discovery_method: str
    status: Literal["confirmed", "controversial", "candidate", "refuted"] = column(
        "how sure the planet is; refuted planets are listed and never counted"
    )
    counted: bool = column(
        "whether rankings, plans and what-ifs count it: candidates only when asked for, refuted ones never"
    )
    reference: str = column("where the orbit was published; of several the one of the largest weight")
    orbits: list[KnownOrbit] = column("the published orbits that are drawn: several where they disagree")
    superseded_by: str = column(
        "publication of a later orbit that contradicts the one in use, and in what; empty: none"
    )
    status_reference: str = column("where the status was published; empty: where the orbit was")
    updated: str = column("date of the row in the table's updates; empty: as in the table of 2019")
    note: str = column("remark of the table on the planet")
    flags: list[str] = column("what the table lacks or marks, see catalogs.known_planets.FLAGS")
    period_days: Quantiles = column(short="P d", format=".4g")
    semi_major_axis_au: Quantiles = column(short="a au", format=".3g")
    eccentricity: Quantiles = column(short="e", format=".2f")
    mass_mjup: Quantiles | None = column(
        "true mass; null where neither it nor m sin i is known", short="M_J", format=".2g"
    )
    radius_rjup: Quantiles = column(short="R_J", format=".2g")
    separation_arcsec: Quantiles = column("projected separation")
    distance_au: Quantiles = column("true distance from the star")
    phase_deg: Quantiles = column("phase angle, 0 full to 180 new", label="phase", format=".0f")
    pa_deg: Quantiles | None = column("position angle east of north; null without a known node")
    bands: list[KnownBand]
    windows: list[KnownWindow] = column("empty where no track was asked for, or the planet is not counted")
    track: KnownTrack | None = column("null where none was asked for, or the planet is not counted")


class KnownHole(Result):
    """Separations of the corners of the dark hole, along a diagonal."""

    band: str
    inner_arcsec: float
    outer_arcsec: float


class KnownResult(OfTables, RunResult):
    """Known planets of some stars at a date."""

    main_rows: ClassVar[str] = "planets"
    kind: Literal["known"] = "known"
    catalogue: str
    planets_table: str = column("as catalogue, of the table of planets")
    columns_not_used: list[str] = column("headings of a user's table of planets", default=[])
    date_utc: str
    mjd: float
    years: float | None = column("length of the tracks from the date on; null without tracks")
    n_draws: int
    seed: int
    albedo: str = column("what reflects the light: a measured planet, or a model and its parameters")
    holes: list[KnownHole]
    planets: list[KnownPlanetRow]


Angle = Annotated[Real, Field(ge=0, le=180)]
QuarterTurn = Annotated[Real, Field(ge=0, le=90)]


class PointingRecord(Result):
    """The limits of pointing that are applied, and what a slew costs."""

    name: str = ""
    sun_deg: Angle = column("least angle between the target and the centre of the Sun, deg")
    moon_deg: Angle = column("least angle between the target and the Moon, its parallax added, deg")
    dark_limb_deg: Angle = column("least angle from the limb of the solid Earth where its nearest point is dark, deg")
    bright_limb_deg: Angle = column("the same where it is sunlit, deg")
    panel: Literal["one_axis", "fixed"] = column(
        "whether the solar panels turn about the axis across the boresight and their normal"
    )
    panel_deg: QuarterTurn = column(
        "largest angle between the panels' normal and the Sun, deg; 90 with panels that turn by 90: no limit"
    )
    panel_turn_deg: QuarterTurn = column(
        "panels of one_axis turn by at most this either way from across the boresight, deg"
    )
    roll_deg: QuarterTurn = column("freedom of roll either side of the best one, whatever the panels allow, deg")
    saa_fraction: Annotated[Real, Field(ge=0, lt=1)] = column(
        "share of all time lost to the South Atlantic Anomaly: one number, no map"
    )
    slew_deg_s: Annotated[Real, Field(gt=0, le=100)] = column("rate of slews, deg/s")
    settle_s: Annotated[Real, Field(ge=0, le=1e5)] = column("settling after a slew, s")
    thermal_settle_orbits: Annotated[Real, Field(ge=0, le=1000)] = column(
        "orbits until the dark hole has settled after a slew"
    )


class SeasonRecord(Result):
    """A time in which a star can be seen, but for passages of the Moon."""

    start_utc: str
    end_utc: str
    days: float = column("days in it on which the star can be seen")


class VisibleDays(Result):
    """One entry a step, as lists of one length."""

    visible_s: list[float] = column("time per orbit that can be used, s; 0 where blocked")
    window_s: list[float] = column("longest piece of an orbit between Earth limbs, s; 0 where blocked")
    roll_half_range_deg: list[float] = column("roll allowed either way, deg; 0 where the panels allow none")
    sun_deg: list[float] = column("angle from the Sun, deg")
    moon_deg: list[float] = column("angle from the Moon, from the centre of the Earth, deg")
    blocked_by: list[Literal["", "sun", "moon", "panel", "limb"]] = column(
        "what prevents it, of several the first of sun, panel, moon, limb; empty: nothing"
    )


class VisibleTarget(StarRow):
    """The times when one star can be seen. Medians are over the steps on which it can."""

    hip: int | None
    ra_deg: float
    dec_deg: float
    ecliptic_latitude_deg: float = column(short="ecl. lat", format=".1f")
    seasons: list[SeasonRecord]
    observable_days: float = column("days on which the star can be seen", short="days", format="g")
    blocked_days: dict[str, float] = column("days by what blocks them: sun, moon, panel, limb")
    visible_s: float | None = column(
        "time per orbit that can be used, median, s; null: never seen", short="min/orbit", format="min"
    )
    best_visible_s: float | None = column("the same on the best day", short="best", format="min")
    best_utc: str | None = column("middle of the first of the best steps", short="best day")
    longest_window_s: float | None = column(
        "longest piece of an orbit between Earth limbs, s; the period: the star never sets on some day",
        short="window",
        format="min",
    )
    roll_half_range_deg: float | None = column("roll allowed either way, median", short="roll ±", format=".0f")
    days: VisibleDays


class VisibilityResult(OfTables):
    """The times when stars can be seen."""

    kind: Literal["visibility"] = "visibility"
    catalogue: str
    start_utc: str
    n_days: int
    step_days: float = column("one orbit in the middle of each step stands for it")
    period_s: float = column("period of the orbit, s")
    altitude_km: float
    inclination_deg: float
    pointing: PointingRecord
    mjd: list[float] = column("middle of each step, Modified Julian Date of UTC")
    targets: list[VisibleTarget]


class StarResult(StarHeader):
    """The facts about a star: its place in the ranking, its known planets, and when it is seen."""

    kind: Literal["star"] = "star"
    name: str
    sp_type: str = column("spectral type; empty where it is not known")
    teff_k: float
    luminosity_lsun: float
    companion_separation_arcsec: float | None = column("of the nearest companion that counts; null: none")
    explanation: Explanation | None = column(
        "why it stands where it stands in the ranking of all stars, without its ranks under other assumptions; null "
        "where it is not ranked"
    )
    known: KnownResult | None = column("known planets and their windows; null where none is listed")
    seasons: VisibilityResult = column("when it is seen, from the date on, as are the windows")


class TwoInstrumentsResult(Document):
    """Two questions to the calculator, with one instrument or two: in what they and their answers differ."""

    kind: Literal["two_instruments"] = "two_instruments"
    differences: InstrumentResult
    answers: list[EtcResult] = column("to the first question and to the second; empty without a star")
    comparison: AnswerComparison | None = optional("what differs in the answers and why; null without a star")
