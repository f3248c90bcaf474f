"""Means over synthetic universes, and their intervals."""

from pydantic import Field

from cpic_planner.results.base import Result


class EstimateRecord(Result):
    """Mean over universes."""

    mean: float
    error: float = Field(description="standard error of the mean, of the number of universes")
    low: float = Field(description="lower end of the 90 % interval of the mean")
    high: float = Field(description="upper end of it")
    survey_low: float = Field(description="5 % of the surveys find fewer")
    survey_high: float = Field(description="5 % of the surveys find more")


class CurvePoint(Result):
    """One point of a curve with its band."""

    x: float = Field(description="telescope time used in hours, or number of universes")
    mean: float
    low: float
    high: float


class ChangeRecord(Result):
    """Mean of a paired difference over universes."""

    mean: float
    error: float = Field(description="standard error of the mean, of the number of universes")
    low: float = Field(description="lower end of the 90 % interval of the mean")
    high: float = Field(description="upper end of it")
