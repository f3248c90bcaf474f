"""Results of pages that put several answers together: a star, and two instruments."""

from typing import Literal

from pydantic import Field

from cpic_planner.results.answers import EtcResult
from cpic_planner.results.base import Result
from cpic_planner.results.known import KnownResult, VisibilityResult
from cpic_planner.results.ranked import Explanation
from cpic_planner.results.runs import InstrumentResult


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
