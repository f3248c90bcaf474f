"""Results of ``cpic known``: where known planets are, how bright, and when the dark hole covers them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cpic_planner.models.base import Result, Row
from cpic_planner.models.columns import column


class Quantiles(Result):
    """What the published errors leave open: 16, 50 and 84 % of the draws lie below."""

    low: float
    median: float
    high: float


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


class KnownPlanetRow(Row):
    """One known planet at the date."""

    planet: str
    star: str
    hip: int | None
    v_mag: float
    distance_pc: float
    discovery_method: str
    status: Literal["confirmed", "controversial", "candidate", "refuted"] = Field(
        description="how sure the planet is; candidates and refuted ones are listed and never counted"
    )
    reference: str = Field(description="where the orbit was published")
    status_reference: str = Field(description="where the status was published; empty: where the orbit was")
    updated: str = Field(description="date of the row in the table's updates; empty: as in the table of 2019")
    note: str = Field(description="remark of the table on the planet")
    flags: list[str] = Field(description="what the table lacks or marks, see catalogs.known_planet_columns.FLAGS")
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


class KnownResult(Result):
    """Known planets of some stars at a date."""

    schema_version: Literal[1] = 1
    kind: Literal["known"] = "known"
    config_hash: str
    catalogue: str
    planets_table: str = Field(description="as catalogue, of the table of planets")
    date_utc: str
    mjd: float
    years: float | None = Field(description="length of the tracks from the date on; null without tracks")
    n_draws: int
    seed: int
    albedo: str = Field(description="what reflects the light: a measured planet, or a model and its parameters")
    holes: list[KnownHole]
    planets: list[KnownPlanetRow]
