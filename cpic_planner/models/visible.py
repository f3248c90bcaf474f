"""Results of visibility: when stars can be seen."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cpic_planner.models.base import Result, Row
from cpic_planner.models.columns import column
from simulator.config.light import Real

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
    """When one star can be seen. Medians are over the steps on which it can."""

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


class VisibilityResult(Result):
    """When stars can be seen."""

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
