"""Means over synthetic universes with their intervals, and decisions under doubt.

Under doubt a survey is planned for one value of a number, and played under another.
"""

from typing import Literal

from pydantic import Field

from cpic_planner.results.base import Result, Row, column


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


class EstimateRecord(ChangeRecord):
    """Mean over universes."""

    survey_low: float = Field(description="5 % of the surveys find fewer")
    survey_high: float = Field(description="5 % of the surveys find more")


class DoubtValue(Result):
    """A value that the number may turn out to have."""

    text: str = Field(description="the value with its unit or its x: 0.1 nm")
    meaning: str = Field(description="in words, where the text does not say it all")
    weight: float = Field(description="how likely it is; all of them sum to 1")


class DoubtCell(Row):
    """One plan played under one value: the same visits, in the same universes.

    Planets are those of ``quantity`` of the record.
    """

    strategy: str
    planned_for: str = column("value that the strategy was planned for")
    played_under: str = column("value that the number then has")
    planets: EstimateRecord = Field(description="planets found")
    visits: float = column("visits made, mean over universes")
    hours: float = column("telescope time used, mean over universes")
    loss: ChangeRecord = Field(
        description="what the best of all plans finds under that value, less what this one finds"
    )
    regret: ChangeRecord = Field(
        description="what the same strategy's plan for that very value is worth, less what this plan is, as the "
        "scheduler counts: value_new and value_known a planet, less min_gain a visit"
    )
    regret_of_planets: ChangeRecord = Field(description="the same without the price of visits, value of planets alone")


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

    strategy: str = Field(description="the strategy whose plans these are; empty: all plans of all strategies")
    cautious: DoubtChoice = Field(description="the plan whose largest loss is the smallest")
    expected: DoubtChoice = Field(description="the plan that finds most by the weights")
    value_of_knowing: ChangeRecord = Field(
        description="planets more if the number is known before the plan is chosen, by the weights"
    )


class DoubtRecord(Result):
    """The plan to take while a number is not known."""

    key: str = Field(description="the number as it was asked for: drift")
    quantity: Literal["planets", "new_planets"] = Field(description="what the choice is made by")
    values: list[DoubtValue]
    weights_from: str = Field(description="where the weights are from")
    cells: list[DoubtCell]
    choices: list[DoubtChoice] = Field(description="every plan; losses are those against the best of all plans")
    decision: DoubtDecision
    of_strategies: list[DoubtDecision] = Field(
        description="if one strategy is settled: losses are those against the best of its own plans"
    )
    statement: str = Field(description="the decision in words")
