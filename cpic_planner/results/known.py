"""Results of ``cpic known``: where known planets are, how bright, and when the dark hole covers them.

Results of visibility: when stars can be seen. Results of pages that put several answers together: a star, and two
instruments.
"""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from cpic_planner.results.answers import EtcResult, Quantiles
from cpic_planner.results.base import OfTables, Result, Row, RunResult, column
from cpic_planner.results.ranked import Explanation
from cpic_planner.results.runs import InstrumentResult
from simulator.config import Real


class KnownBand(Result):
    """A planet in one band."""

    band: str
    contrast: Quantiles = Field(description="true planet-to-star ratio of detected rates")
    hole_share: float = Field(
        description="share of the draws whose separation lies between inner and outer corner of the dark hole"
    )


class KnownWindow(Result):
    """Days on which a planet more likely than not stands between the corners of the dark hole."""

    band: str
    start_utc: str = Field(description="first day")
    end_utc: str = Field(description="last day")
    best_utc: str = Field(description="day on which it is most likely")
    best_share: float = Field(description="share of the draws on that day")


class KnownTrack(Result):
    """Separation against time."""

    mjd: list[float]
    separation_low_arcsec: list[float] = Field(description="16 % of the draws lie below")
    separation_median_arcsec: list[float]
    separation_high_arcsec: list[float] = Field(description="84 % of the draws lie below")


class KnownOrbit(Result):
    """One published orbit of a planet; null where the publication has no value."""

    reference: str = Field(description="where it was published")
    share: float = Field(description="share of the draws that have it")
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
    status: Literal["confirmed", "controversial", "candidate", "refuted"] = Field(
        description="how sure the planet is; refuted planets are listed and never counted"
    )
    counted: bool = Field(
        description="whether rankings, plans and what-ifs count it: candidates only when asked for, refuted ones never"
    )
    reference: str = Field(description="where the orbit was published; of several the one of the largest weight")
    orbits: list[KnownOrbit] = Field(description="the published orbits that are drawn: several where they disagree")
    superseded_by: str = Field(
        description="publication of a later orbit that contradicts the one in use, and in what; empty: none"
    )
    status_reference: str = Field(description="where the status was published; empty: where the orbit was")
    updated: str = Field(description="date of the row in the table's updates; empty: as in the table of 2019")
    note: str = Field(description="remark of the table on the planet")
    flags: list[str] = Field(description="what the table lacks or marks, see catalogs.known_planets.FLAGS")
    period_days: Quantiles = column(short="P d", format=".4g")
    semi_major_axis_au: Quantiles = column(short="a au", format=".3g")
    eccentricity: Quantiles = column(short="e", format=".2f")
    mass_mjup: Quantiles | None = column(
        "true mass; null where neither it nor m sin i is known", short="M_J", format=".2g"
    )
    radius_rjup: Quantiles = column(short="R_J", format=".2g")
    separation_arcsec: Quantiles = Field(description="projected separation")
    distance_au: Quantiles = Field(description="true distance from the star")
    phase_deg: Quantiles = column("phase angle, 0 full to 180 new", label="phase", format=".0f")
    pa_deg: Quantiles | None = Field(description="position angle east of north; null without a known node")
    bands: list[KnownBand]
    windows: list[KnownWindow] = Field(description="empty where no track was asked for, or the planet is not counted")
    track: KnownTrack | None = Field(description="null where none was asked for, or the planet is not counted")


class KnownHole(Result):
    """Separations of the corners of the dark hole, along a diagonal."""

    band: str
    inner_arcsec: float
    outer_arcsec: float


class KnownResult(OfTables, RunResult):
    """Known planets of some stars at a date."""

    main_rows: ClassVar[str] = "planets"
    schema_version: Literal[1] = 1
    kind: Literal["known"] = "known"
    config_hash: str
    catalogue: str
    planets_table: str = Field(description="as catalogue, of the table of planets")
    columns_not_used: list[str] = Field(default=[], description="headings of a user's table of planets")
    date_utc: str
    mjd: float
    years: float | None = Field(description="length of the tracks from the date on; null without tracks")
    n_draws: int
    seed: int
    albedo: str = Field(description="what reflects the light: a measured planet, or a model and its parameters")
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
    days: float = Field(description="days in it on which the star can be seen")


class VisibleDays(Result):
    """One entry a step, as lists of one length."""

    visible_s: list[float] = Field(description="time per orbit that can be used, s; 0 where blocked")
    window_s: list[float] = Field(description="longest piece of an orbit between Earth limbs, s; 0 where blocked")
    roll_half_range_deg: list[float] = Field(description="roll allowed either way, deg; 0 where the panels allow none")
    sun_deg: list[float] = Field(description="angle from the Sun, deg")
    moon_deg: list[float] = Field(description="angle from the Moon, from the centre of the Earth, deg")
    blocked_by: list[Literal["", "sun", "moon", "panel", "limb"]] = Field(
        description="what prevents it, of several the first of sun, panel, moon, limb; empty: nothing"
    )


class VisibleTarget(Row):
    """The times when one star can be seen. Medians are over the steps on which it can."""

    name: str = column("name of the star in the catalogue", label="star", format="star")
    hip: int | None
    ra_deg: float
    dec_deg: float
    ecliptic_latitude_deg: float = column(short="ecl. lat", format=".1f")
    seasons: list[SeasonRecord]
    observable_days: float = column("days on which the star can be seen", short="days", format="g")
    blocked_days: dict[str, float] = Field(description="days by what blocks them: sun, moon, panel, limb")
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

    schema_version: Literal[1] = 1
    kind: Literal["visibility"] = "visibility"
    config_hash: str
    catalogue: str
    start_utc: str
    n_days: int
    step_days: float = Field(description="one orbit in the middle of each step stands for it")
    period_s: float = Field(description="period of the orbit, s")
    altitude_km: float
    inclination_deg: float
    pointing: PointingRecord
    mjd: list[float] = Field(description="middle of each step, Modified Julian Date of UTC")
    targets: list[VisibleTarget]


class StarResult(Result):
    """The facts about a star: its place in the ranking, its known planets, and when it is seen."""

    schema_version: Literal[1] = 1
    kind: Literal["star"] = "star"
    name: str
    hip: int | None
    date_utc: str = Field(description="date of the companion's place, and first day of seasons and windows")
    catalogue: str
    note: str = Field(description="on the name that was given; empty for none")
    v_mag: float
    distance_pc: float
    sp_type: str = Field(description="spectral type; empty where it is not known")
    teff_k: float
    luminosity_lsun: float
    companion_separation_arcsec: float | None = Field(description="of the nearest companion that counts; null: none")
    explanation: Explanation | None = Field(
        description="why it stands where it stands in the ranking of all stars, without its ranks under other "
        "assumptions; null where it is not ranked"
    )
    known: KnownResult | None = Field(description="known planets and their windows; null where none is listed")
    seasons: VisibilityResult = Field(description="when it is seen")


class TwoInstrumentsResult(Result):
    """Two instruments: the values in which they differ, and the answers of both to one question."""

    schema_version: Literal[1] = 1
    kind: Literal["two_instruments"] = "two_instruments"
    differences: InstrumentResult
    answers: list[EtcResult] = Field(description="of the first instrument and of the other; empty without a question")
