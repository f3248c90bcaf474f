"""What a comparison of survey strategies says, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from cpic_planner.models.surveyed import DifferenceRecord, StrategyOutcome, WhatIfResult
from cpic_planner.report.numbers import count_text, decimals, percent_text, significant

_SPENT = 0.95
"""Share of the budget above which it is what limits the yield."""
_HANGS = 0.3
"""Share of a yield above which it is said to hang on one planet."""
_MOST_LISTED, _MOST_EMPTY = 8, 3
_HARDLY_USED, _FAR_BELOW = 0.02, 0.5
"""Share of the budget, and distance from the bound, of a calendar that is nearly empty."""


def interval_text(low: float, high: float, digits: int = 2) -> str:
    """Return the ends of an interval."""
    return f"{decimals(low, digits)} to {decimals(high, digits)}"


def best_by_value(strategies: Sequence[StrategyOutcome]) -> dict[str, StrategyOutcome]:
    """Return the strategy that finds most at each value of a sweep, by that value; without a sweep of all, under ""."""
    swept = all(item.varied for item in strategies)
    best: dict[str, StrategyOutcome] = {}
    for item in strategies:
        value = item.variation if swept else ""
        if value not in best or item.planets.mean > best[value].planets.mean:
            best[value] = item
    return best


def hanging_text(item: StrategyOutcome) -> str:
    """Return ``85 % of the planets found are eps Eri b`` where more than 30 % are one planet; otherwise nothing."""
    one = item.leading_planet
    if one is None or one.share <= _HANGS:
        return ""
    return f"{percent_text(one.share)} of the planets found are {one.name}"


def empty_text(item: StrategyOutcome) -> str:
    """Return the sentence on a calendar that is empty, or hardly used and far below its bound; otherwise nothing."""
    plan, settings = item.schedule, item.settings
    needed, least = settings["detection"]["visits_needed"], settings["scheduler"]["min_gain"]
    if plan.visits and (plan.hours > _HARDLY_USED * settings["time_budget_h"] or plan.distance < _FAR_BELOW):
        return ""
    if not plan.visits:
        text = f"{item.name} plans no visit at all"
    else:
        text = f"{item.name} plans {count_text(plan.visits)} visits only, {significant(plan.hours)} h"
    rule = f"A visit has to be worth {least:g} planets (scheduler.min_gain)."
    if needed > 1:
        rule = (
            f"Where {needed} visits have to show a planet, those of a star have to be worth {least:g} planets each "
            "on average (scheduler.min_gain)."
        )
    if plan.bound <= 0.0:
        return f"{text}: no visit of its stars fits into the calendar and shows a planet. {rule}"
    bound = f"no calendar can be worth more than {significant(plan.bound, 2)}, this one is worth"
    worth = significant(plan.value, 2)
    return f"{text}: {bound} {worth}. {rule}"


def extent_text(result: WhatIfResult) -> str:
    """Return what is compared, from the numbers of the run: strategies, telescope time, length of the survey."""
    days = float(result.universe["duration_days"])
    budgets = sorted({float(item.settings["time_budget_h"]) for item in result.strategies})
    ends = dict.fromkeys((budgets[0], budgets[-1]))
    hours = " to ".join(f"{budget:g}" for budget in ends)
    shares = " to ".join(percent_text(budget / (24.0 * days)) for budget in ends)
    n = len(result.strategies)
    each = "one strategy" if n == 1 else f"{count_text(n)} strategies"
    return (
        f"{each} with {hours} h of telescope time, {shares} of {count_text(round(days))} days "
        f"({significant(days / 365.25, 2)} years) from {str(result.universe['start_utc'])[:10]}"
    )


def planets_text(value: float) -> str:
    """Return a mean number of planets of a star, which may be far below one."""
    return "0" if value == 0 else "<0.001" if value < 0.001 else decimals(value, 3)


def between(
    result: WhatIfResult, first: str, second: str, quantity: Literal["planets", "hours"]
) -> tuple[float, float, float] | None:
    """Return the mean of first minus second and the ends of its interval; none if the result has no such pair."""
    pairs: dict[tuple[str, str], DifferenceRecord] = {
        (item.first, item.second): item for item in result.differences if item.quantity == quantity
    }
    if (first, second) in pairs:
        item = pairs[first, second]
        return item.mean, item.low, item.high
    if (second, first) in pairs:
        item = pairs[second, first]
        return -item.mean, -item.high, -item.low
    return None


def lead_sentences(result: WhatIfResult) -> list[str]:
    """Return the summary, one sentence an item: the statement, the runner-up, and whether the budget binds."""
    said = [result.statement]
    empty = [text for item in result.strategies if (text := empty_text(item))]
    said += empty[:_MOST_EMPTY]
    if len(empty) > _MOST_EMPTY:
        said.append(f"Of {len(empty) - _MOST_EMPTY} other strategies, too, the calendar is empty or nearly so.")
    order = sorted(result.strategies, key=lambda item: -item.planets.mean)
    told = {item.name for item in best_by_value(result.strategies).values()}  # the statement says it of these
    others = [item for item in order if hanging_text(item) and item.name not in told]
    if others:
        listed = "; ".join(f"{item.name}: {hanging_text(item)}" for item in others[:_MOST_LISTED])
        more = f"; and so on for {len(others) - _MOST_LISTED} others" if len(others) > _MOST_LISTED else ""
        said.append(f"Other yields hang on one planet, too. {listed}{more}.")
    if len(order) > 1 and order[0].planets.mean > 0:
        said += _runner_up(result, order[0], order[1])
    budgets = sorted({float(item.settings["time_budget_h"]) for item in result.strategies})
    share = max(item.hours.mean / float(item.settings["time_budget_h"]) for item in result.strategies)
    if share < _SPENT:
        budget = f"its budget of {budgets[0]:g} h" if len(budgets) == 1 else "its budget"
        who = "The strategy uses" if len(order) == 1 else "No strategy uses more than"
        said.append(
            f"{who} {percent_text(share)} of {budget} on average: its rules on stars and visits end it before the time "
            "does."
        )
    return said


def _runner_up(result: WhatIfResult, best: StrategyOutcome, other: StrategyOutcome) -> list[str]:
    found, hours = between(result, best.name, other.name, "planets"), between(result, best.name, other.name, "hours")
    if found is None or hours is None:
        return []
    mean, low, high = found
    more = f"{decimals(abs(hours[0]), 0)} h {'more' if hours[0] >= 0 else 'less'}"
    if low > 0:
        return [
            f"In the same universes {best.name} finds {decimals(mean, 2)} planets more than {other.name}, the next "
            f"best ({interval_text(low, high)}), in {more}."
        ]
    return [
        f"The lead of {best.name} on {other.name}, the next best, may be chance: {decimals(mean, 2)} planets "
        f"({interval_text(low, high)}), in {more}."
    ]
