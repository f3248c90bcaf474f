"""Results of a ranking under other assumptions and under an ensemble of instruments."""

from typing import Literal

from pydantic import Field

from cpic_planner.registry import ScoreName
from cpic_planner.results.base import OfTables, Result, Row, RunResult, column


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
    n_instruments: int = Field(description="instruments drawn, a Latin hypercube")
    seed: int
    n_stars: int = Field(
        description="stars that all instruments rank; the others have neither a detection nor a thousandth of the "
        "expected planets under any of those that rank all stars"
    )
    planets_nominal: float = Field(
        description="expected planets of one observation of every star by the instrument asked; completeness summed "
        "where the population has no rate of occurrence"
    )
    planets_p05: float = Field(description="the same, exceeded by 95 % of the instruments")
    planets_median: float
    planets_p95: float
    n_reachable_nominal: int = Field(description="stars whose reference planet is detected, by the instrument asked")
    n_reachable_p05: int = Field(description="the same, exceeded or equalled by 95 % of the instruments")
    n_reachable_median: int
    n_reachable_p95: int
    bars: list[EnsembleBar] = Field(description="what the numbers hang on, the largest effect on planets first")
    decides: str = Field(description="key of the number that decides how many planets are expected")
    decides_order: str = Field(description="key of the number that changes the order of the first ten most")
    statement: str = Field(description="the same in words")


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


class SensitivityStar(Row):
    """The ranks of one of the nominal first stars under all assumptions, the nominal ones included."""

    name: str = column("name of the star in the catalogue", label="star", format="star")
    rank: int = column("nominal rank", label="#")
    rank_lowest: int = column("lowest number of its rank under any of the assumptions")
    rank_highest: int = column("highest number of its rank under any of them")


class SensitivityResult(OfTables, RunResult):
    """The dependence of the ranking on what is assumed."""

    schema_version: Literal[2] = 2
    kind: Literal["sensitivity"] = "sensitivity"
    config_hash: str
    top: int = Field(description="stars of the nominal ranking that are compared")
    first: int = Field(description="first stars that kept_first is about: those that a plan proposes, else ten")
    score_name: ScoreName
    n_ranked: int = Field(description="stars of the ranking")
    n_ok: int = Field(description="stars whose reference planet is detected, nominally")
    rows: list[SensitivityRow]
    stars: list[SensitivityStar] = Field(description="the nominal top")
    statement: str = Field(description="the same in words")
