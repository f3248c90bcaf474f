"""Decisions under doubt: every strategy planned for each value of a number that is not known, and played under each.

A plan is a calendar with its frames. Where the number turns out to be another, the same visits are made with the same
frames in the same universes, and what they show is that of the other instrument. A team would know the number after
the first visits and could change the rest: that is left out, so that losses are those of a plan that is kept.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, IntArray, Record
from cpic_planner import results
from cpic_planner.jobs import Runner
from cpic_planner.planets import Law
from cpic_planner.queries import get, load_ensemble
from cpic_planner.survey.detection import alarms
from cpic_planner.survey.outcome import LEVEL, difference_interval, estimate_record
from cpic_planner.survey.prepare import planned, read_ground
from cpic_planner.survey.simulate import COUNTED, Survey, survey_counts
from cpic_planner.survey.strategy import DoubtRule, StrategiesConfig, UniverseConfig, varied
from cpic_planner.survey.tables import PLANETS

_STEPS, _ROUNDING = 100_000, 1e-12


class Choice(Record, eq=False):
    """The choice among ``o`` plans where one of ``t`` values is true.

    Attributes
    ----------
    worth, weights : ndarray
        As of `decide`.
    mean : ndarray, shape (o, t)
        Mean over universes.
    best : ndarray of int, shape (t,)
        The plan that has most under each value.
    loss : ndarray, shape (o, t)
        What the best plan has under a value, less what each one has.
    cautious, expected : int
        The plan whose largest loss is smallest, and the plan of most by the weights.
    knowing : ndarray, shape (u,)
        In each universe, the weighted mean of the best plans less that of ``expected``: its mean is what it is worth to
        know the value before choosing (the expected value of perfect information, Raiffa & Schlaifer 1961).
    """

    worth: FloatArray
    weights: FloatArray
    mean: FloatArray
    best: IntArray
    loss: FloatArray
    cautious: int
    expected: int
    knowing: FloatArray


def decide(worth: FloatArray, weights: FloatArray) -> Choice:
    """Choose among plans.

    Parameters
    ----------
    worth : ndarray, shape (o, t, u)
        What each plan is worth under each value in each universe.
    weights : ndarray, shape (t,)
        How likely the values are; they sum to 1.

    Notes
    -----
    Smallest largest loss is the rule of Savage (1951, JASA 46, 55). Of equal plans the one that has more by the weights
    is taken, and then the first.
    """
    mean = worth.mean(axis=2)
    best = mean.argmax(axis=0)
    loss = mean.max(axis=0) - mean
    by_weight = mean @ weights
    cautious = int(np.lexsort((-by_weight, loss.max(axis=1)))[0])
    expected = int(by_weight.argmax())
    knowing = np.einsum("tu,t->u", worth[best, np.arange(len(best))] - worth[expected], weights)
    return Choice(worth, weights, mean, best, loss, cautious, expected, knowing)


def quantiles(values: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return the values between which `LEVEL` of the weight lies.

    Parameters
    ----------
    values, weights : ndarray, shape (n,)
        Weights sum to 1.
    """
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    ends = np.searchsorted(below, np.array([0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL]) - _ROUNDING)
    low, high = values[order[np.minimum(ends, len(values) - 1)]]
    return float(low), float(high)


def law_weights(law: Law, values: FloatArray) -> FloatArray:
    """Return which part of a law each value stands for: that nearer to it than to any other, counted in probability.

    Parameters
    ----------
    law : Law
    values : ndarray, shape (n,)
        All different.
    """
    grid = law.quantile((np.arange(_STEPS) + 0.5) / _STEPS)
    order = np.argsort(values)
    below = np.searchsorted(grid, values[order]) / _STEPS
    ends = np.concatenate([[0.0], 0.5 * (below[1:] + below[:-1]), [1.0]])
    found = np.empty(len(values))
    found[order] = np.diff(ends)
    return found


_OF_NATURE = ("assumptions", "population")
"""Sections of a strategy that are no choice: what the instrument is, and which planets there are."""
_LAWS = {
    "assumptions.drift": "drift",
    "assumptions.throughput": "bands.*.t_opt",
    "assumptions.exozodi": "sky.exozodi_zodis",
}
"""Numbers of the ensemble that are those of a strategy."""


def doubted(config: StrategiesConfig) -> StrategiesConfig:
    """Return every strategy with every value of the number that is not known, the values of one strategy together.

    Parameters
    ----------
    config : StrategiesConfig
        With a `DoubtRule`.

    Raises
    ------
    InputError
        For a key that is a choice of the strategy, one that it varies already, or a value that the key cannot have.
    """
    rule = config.doubt
    assert rule is not None
    found = varied(config, [rule.text], option="--doubt").model_copy(update={"doubt": None})
    key = _setting(found, 0).key
    if key.partition(".")[0] not in _OF_NATURE:
        allowed = "drift, throughput, exozodi, contrast or population: everything else of a strategy is a choice"
        raise InputError("--doubt", rule.key, allowed=allowed, hint="--vary compares choices")
    if any(item.key == key for strategy in config.strategies for item in strategy.varied):
        raise InputError("--doubt", rule.key, allowed="a key that is not varied as well")
    return found


def _setting(config: StrategiesConfig, at: int) -> results.VariedSetting:
    """Return the doubtful number as one of the strategies of `doubted` has it."""
    return config.strategies[at].varied[-1]


def played(plan: Survey, truth: Survey, universe: UniverseConfig) -> Survey:
    """Return a plan as it is played where the instrument, or the planets, are those of another one.

    Parameters
    ----------
    plan : Survey
        Whose stars, visits, frames and costs are kept.
    truth : Survey
        The same strategy planned for what turns out to be true: its model and its planets count.
    universe : UniverseConfig
    """
    given = {name: getattr(truth.strategy, name) for name in _OF_NATURE}
    strategy = plan.strategy.model_copy(update=given)
    noise, background = alarms(universe, strategy, truth.model, plan.targets, plan.options)
    return replace(plan, strategy=strategy, model=truth.model, noise_alarms=noise, background_alarms=background)


def plays_of(rule: DoubtRule | None, n_strategies: int) -> int:
    """Return how many surveys are played: every plan under every value."""
    return 0 if rule is None else n_strategies * len(rule.values) ** 2


def doubt_record(config: StrategiesConfig, runner: Runner[Any]) -> results.DoubtRecord | None:
    """Plan every strategy for each value, play every plan under each, and say what to take; None without a rule."""
    rule, universe = config.doubt, config.universe
    if rule is None:
        return None
    every = doubted(config)
    n, values = len(config.strategies), len(rule.values)
    (ready,) = planned((every,), (read_ground(every),), runner)
    plans = ready.surveys
    surveys = {
        f"doubt: {plans[s * values + p].strategy.name}, played with {rule.values[t]}": played(
            plans[s * values + p], plans[s * values + t], universe
        )
        for s, p, t in itertools.product(range(n), range(values), range(values))
    }
    found = survey_counts(surveys, universe, runner).values()
    shape = n, values, values, universe.universes
    counts = {name: np.array([own[name] for own in found]).reshape(shape) for name in COUNTED}
    return record_of(config, every, counts)


def record_of(
    config: StrategiesConfig, every: StrategiesConfig, counts: Mapping[str, FloatArray]
) -> results.DoubtRecord:
    """Return the table of all plans under all values, and the decisions.

    Parameters
    ----------
    config, every : StrategiesConfig
        As of `doubted`: before and after.
    counts : mapping of str to ndarray
        New planets, known planets, visits and hours, shape (strategies, planned for, played under, universes).
    """
    rule = config.doubt
    assert rule is not None
    n, k = len(config.strategies), len(rule.values)
    settings = [_setting(every, t) for t in range(k)]
    texts = [item.text for item in settings]
    weights, source = weights_of(config, every)
    new, known = (counts[name] for name in PLANETS)
    found = new if rule.quantity == "new_planets" else new + known
    plans = [(item.name, text) for item in config.strategies for text in texts]
    worth = found.reshape(n * k, k, -1)
    choice = decide(worth, weights)
    cells = []
    for s, strategy in enumerate(config.strategies):
        value = strategy.value_new * new[s] + strategy.value_known * known[s]
        net = value - strategy.scheduler.min_gain * counts["visits"][s]
        for p, t in itertools.product(range(k), range(k)):
            o = s * k + p
            cells.append(
                results.DoubtCell(
                    strategy=strategy.name,
                    planned_for=texts[p],
                    played_under=texts[t],
                    planets=estimate_record(worth[o, t]),
                    visits=float(counts["visits"][s, p, t].mean()),
                    hours=float(counts["hours"][s, p, t].mean()),
                    loss=_more(worth[choice.best[t], t], worth[o, t]),
                    regret=_more(net[t, t], net[p, t]),
                    regret_of_planets=_more(value[t, t], value[p, t]),
                )
            )
    decision = _decision("", choice, plans, texts)
    return results.DoubtRecord(
        key=settings[0].name,
        quantity=rule.quantity,
        values=[
            results.DoubtValue(text=item.text, meaning=item.meaning, weight=float(weight))
            for item, weight in zip(settings, weights, strict=True)
        ],
        weights_from=source,
        cells=cells,
        choices=[_choice(o, choice, plans, texts) for o in range(n * k)],
        decision=decision,
        of_strategies=[
            _decision(item.name, decide(found[s], weights), plans[s * k : (s + 1) * k], texts)
            for s, item in enumerate(config.strategies)
        ],
        statement=statement(settings[0].name, rule.quantity, decision, choice, plans, texts),
    )


def _more(one: FloatArray, other: FloatArray) -> results.ChangeRecord:
    """Return one plan less another in the same universes; exactly nothing of what is equal in each of them."""
    if np.array_equal(one, other):
        return results.ChangeRecord(mean=0.0, error=0.0, low=0.0, high=0.0)
    return difference_interval(one - other)


def _choice(o: int, choice: Choice, plans: Sequence[tuple[str, str]], texts: Sequence[str]) -> results.DoubtChoice:
    strategy, planned_for = plans[o]
    own, weights, n = choice.worth[o], choice.weights, choice.worth.shape[2]
    mixed = weights @ own
    low, high = quantiles(choice.mean[o], weights)
    survey_low, survey_high = quantiles(own.ravel(), np.repeat(weights / n, n))
    worst = int(choice.loss[o].argmax())
    return results.DoubtChoice(
        strategy=strategy,
        planned_for=planned_for,
        planets=float(mixed.mean()),
        error=float(mixed.std(ddof=1) / np.sqrt(n)),
        low=low,
        high=high,
        survey_low=survey_low,
        survey_high=survey_high,
        largest_loss=float(choice.loss[o, worst]),
        largest_loss_under=texts[worst],
    )


def _decision(
    strategy: str, choice: Choice, plans: Sequence[tuple[str, str]], texts: Sequence[str]
) -> results.DoubtDecision:
    cautious, expected = (_choice(o, choice, plans, texts) for o in (choice.cautious, choice.expected))
    knowing = _more(choice.knowing, np.zeros_like(choice.knowing))
    return results.DoubtDecision(strategy=strategy, cautious=cautious, expected=expected, value_of_knowing=knowing)


def weights_of(config: StrategiesConfig, every: StrategiesConfig) -> tuple[FloatArray, str]:
    """Return how likely each value is, and where that is from.

    Parameters
    ----------
    config, every : StrategiesConfig
        As of `doubted`: before and after.
    """
    rule = config.doubt
    assert rule is not None
    k = len(rule.values)
    if rule.weights is not None:
        return np.array(rule.weights) / sum(rule.weights), "given"
    key = _setting(every, 0).key
    number = load_ensemble().numbers.get(_LAWS.get(key, ""))
    drawn = [get(item.model_dump(mode="python"), key) for item in every.strategies[:k]]
    if number is None or None in drawn:
        return np.full(k, 1.0 / k), "all the same"
    found = law_weights(number.law, np.array(drawn, float))
    return found, f"the law of {number.label} in the default ensemble"


def statement(
    key: str,
    quantity: str,
    decision: results.DoubtDecision,
    choice: Choice,
    plans: Sequence[tuple[str, str]],
    texts: Sequence[str],
) -> str:
    """Return the decision in words.

    Parameters
    ----------
    key : str
        The number that is not known.
    quantity : {"planets", "new_planets"}
    decision : DoubtDecision
        Among the plans.
    choice : Choice
        The same in numbers.
    plans : sequence of (str, str)
        Strategy and value that it is planned for.
    texts : sequence of str
        Values that the number may have.
    """
    what = quantity.replace("_", " ")

    def called(item: results.DoubtChoice) -> str:
        return f"{item.strategy} planned for {key} {item.planned_for}"

    safe, most, knowing = decision.cautious, decision.expected, decision.value_of_knowing
    if choice.mean.max() <= 0.0:
        return f"No plan finds any {what}, whatever {key} is."
    worst = texts.index(safe.largest_loss_under)
    best = " planned for ".join(plans[int(choice.best[worst])])
    if safe.largest_loss > 0.0:
        text = (
            f"it loses at most {safe.largest_loss:.3f} {what} a survey, where {key} is really "
            f"{safe.largest_loss_under} and {best} finds most"
        )
    else:
        text = f"no other plan finds more, whatever {key} is"
    same = (safe.strategy, safe.planned_for) == (most.strategy, most.planned_for)
    who = "it" if same else called(most)
    over = choice.mean[choice.expected]  # all values: the mean by weights lies between, which 5 and 95 % need not do
    return (
        f"A cautious team takes {called(safe)}: {text}. By the weights of the values {who} finds most, "
        f"{most.planets:.2f} {what} a survey ({over.min():.2f} to {over.max():.2f} over the values). To know {key} "
        f"before the choice is worth {knowing.mean:.3f} {what} a survey (90 % interval {knowing.low:.3f} to "
        f"{knowing.high:.3f})."
    )


def told_steps(rule: DoubtRule | None, n_strategies: int, n_blocks: int) -> int:
    """Return how many steps are told: every plan, and every block that is played, of ``n_blocks`` of each survey."""
    if rule is None:
        return 0
    return n_strategies * len(rule.values) + plays_of(rule, n_strategies) * n_blocks
