"""Sentences about a comparison of survey strategies, and the settings of strategies in words."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from cpic_planner.queries import with_unit
from cpic_planner.registry import LIBRARIES
from cpic_planner.report.numbers import contrast_text, count_text, decimals, duration_text, percent_text, significant
from cpic_planner.results import AssumedInstrument, StrategyOutcome, WhatIfResult
from simulator.config import unit_of

_EXCLUSIONS = {
    "rv": "radial velocities (planets that they would have shown)",
    "stability": "companion stars (orbits that do not last)",
    "known_giants": "known giants (no room for another planet)",
}
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


def change_text(value: float) -> str:
    """Return a change in planets with its sign."""
    return f"{'+' if value > 0 else ''}{decimals(value, 3)}"


def occurrence_text(item: StrategyOutcome) -> str:
    """Return how many new planets the range of the occurrence rate means; empty where none is stated."""
    found = item.occurrence
    if found is None:
        return ""
    rates = f"{found.planets_per_star_low:g} to {found.planets_per_star_high:g}"
    return f"{interval_text(found.low, found.high)} for {rates} planets a star"


def exclusions_text(exclusions: Sequence[str]) -> str:
    """Return what excludes planets of the population, in words."""
    return ", ".join(_EXCLUSIONS[name] for name in exclusions) or "nothing"


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
        worth = f"those of a star have to be worth {least:g} planets each on average (scheduler.min_gain)"
        rule = f"Where {needed} visits have to show a planet, {worth}."
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
    return f"{each} with {hours} h of telescope time, {shares} of {_span_text(result.universe)}"


def _span_text(universe: Mapping[str, Any]) -> str:
    """Return how long the survey is, and from when."""
    days = float(universe["duration_days"])
    years = significant(days / 365.25, 2)
    return f"{count_text(round(days))} days ({years} years) from {str(universe['start_utc'])[:10]}"


def planets_text(value: float) -> str:
    """Return a mean number of planets of a star, which may be far below one."""
    return "0" if value == 0 else "<0.001" if value < 0.001 else decimals(value, 3)


def between(
    result: WhatIfResult, first: str, second: str, quantity: Literal["planets", "hours"]
) -> tuple[float, float, float] | None:
    """Return the mean of first minus second and the ends of its interval; none if the result has no such pair."""
    for item in result.differences:
        if item.quantity == quantity and (item.first, item.second) == (first, second):
            return item.mean, item.low, item.high
        if item.quantity == quantity and (item.first, item.second) == (second, first):
            return -item.mean, -item.high, -item.low
    return None


def lead_sentences(result: WhatIfResult) -> list[str]:
    """Return the summary, one sentence an item: the statement, the runner-up, and whether the budget binds."""
    sentences = [result.statement]
    if new := _new_text(result):
        sentences.append(new)
    if result.doubt is not None:
        sentences.append(result.doubt.statement)
    empty = [text for item in result.strategies if (text := empty_text(item))]
    sentences += empty[:_MOST_EMPTY]
    if len(empty) > _MOST_EMPTY:
        sentences.append(f"Of {len(empty) - _MOST_EMPTY} other strategies, too, the calendar is empty or nearly so.")
    order = sorted(result.strategies, key=lambda item: -item.planets.mean)
    in_statement = {item.name for item in best_by_value(result.strategies).values()}  # the statement says it of these
    others = [item for item in order if hanging_text(item) and item.name not in in_statement]
    if others:
        listed = "; ".join(f"{item.name}: {hanging_text(item)}" for item in others[:_MOST_LISTED])
        more = f"; and so on for {len(others) - _MOST_LISTED} others" if len(others) > _MOST_LISTED else ""
        sentences.append(f"Other yields hang on one planet, too. {listed}{more}.")
    if len(order) > 1 and order[0].planets.mean > 0:
        sentences += _runner_up(result, order[0], order[1])
    budgets = sorted({float(item.settings["time_budget_h"]) for item in result.strategies})
    share = max(item.hours.mean / float(item.settings["time_budget_h"]) for item in result.strategies)
    if share < _SPENT:
        budget = f"its budget of {budgets[0]:g} h" if len(budgets) == 1 else "its budget"
        who = "The strategy uses" if len(order) == 1 else "No strategy uses more than"
        used = f"{who} {percent_text(share)} of {budget} on average"
        sentences.append(f"{used}: its rules on stars and visits end it before the time does.")
    return sentences


def _new_text(result: WhatIfResult) -> str:
    """Return the best strategy's new planets with other occurrence rates, and with nothing excluded."""
    best = max(result.strategies, key=lambda item: item.planets.mean)
    said = [occurrence_text(best)] if best.occurrence and best.new_planets.mean > 0 else []
    if result.universe["exclusions"] and best.new_planets_unconditional.mean > 0:
        whole = decimals(best.new_planets_unconditional.mean, 2)
        names = [_EXCLUSIONS[name].split(" (")[0] for name in result.universe["exclusions"]]
        said.append(f"{whole} with those that {' or '.join(names)} exclude")
    if not said:
        return ""
    return (
        f"New planets of {best.name}: {decimals(best.new_planets.mean, 2)}; in the same visits {', and '.join(said)}."
    )


def _runner_up(result: WhatIfResult, best: StrategyOutcome, other: StrategyOutcome) -> list[str]:
    difference, hours = (
        between(result, best.name, other.name, "planets"),
        between(result, best.name, other.name, "hours"),
    )
    if difference is None or hours is None:
        return []
    mean, low, high = difference
    more = f"{decimals(abs(hours[0]), 0)} h {'more' if hours[0] >= 0 else 'less'}"
    planets, interval = f"{decimals(mean, 2)} planets", f"({interval_text(low, high)}), in {more}."
    if low > 0:
        return [f"In the same universes {best.name} finds {planets} more than {other.name}, the next best {interval}"]
    return [f"The lead of {best.name} on {other.name}, the next best, may be chance: {planets} {interval}"]


_FACTORS = ("assumptions.drift", "assumptions.throughput")
_UNITS = {f"assumptions.exozodi{part}": "zodi" for part in ("", ".median", ".p95")}
"""Units of keys that do not end in them."""
_GOALS = {
    "time": "as long as it pays, at most",
    "detect": "until the reference planet is detected, at most",
    "snr": "until the reference planet has the SNR asked for, at most",
}
_RULES = {
    "blind": "a search that does not know where planets are",
    "known_place": "significance at the planet's place, taken as known",
    "expected": "predicted significance reaches the threshold; no chance in it",
}
_HOSTS = {"any": "", "first": "stars with known planets come first", "only": "only stars with known planets"}
_METHODS = {
    "auto": "whole plans of stars weighed against each other, with a limited search",
    "exact": "whole plans of stars weighed against each other, with a long search",
    "greedy": "best gain per hour first, with look-ahead",
}


def universe_facts(result: WhatIfResult) -> list[tuple[str, str]]:
    """Return what all strategies share, as terms and texts."""
    shared = result.universe
    limits = "Sun, Moon, Earth limb, solar panels, South Atlantic Anomaly, in low Earth orbit"
    set_to = f" with {', '.join(shared['changes'])}" if shared.get("changes") else ""
    facts = [
        ("Time", f"{_span_text(shared)}, planned in slots of {shared['slot_days']:g} days"),
        (
            "Instrument",
            f"{shared['instrument']}{set_to}. Every default value has its source and confidence in the preset.",
        ),
        ("Orbit and pointing limits", f"{shared['visibility']}: {limits}"),
        ("Stars", result.catalogue),
        ("Known planets", result.known_planets or "left out"),
        ("What excludes unknown planets", exclusions_text(shared["exclusions"])),
        ("Background stars", "not drawn" if shared["background"] == "off" else "drawn, as false alarms"),
    ]
    if result.observed:
        facts.append(("Already observed", result.observed))
    facts.append(("Universes", f"{count_text(result.n_universes)}, seed {shared['seed']}"))
    return facts


def shared_facts(settings: Mapping[str, Any], used: AssumedInstrument | None = None) -> list[tuple[str, str]]:
    """Return the rules and assumptions of a strategy, with numbers of the instrument if given, as terms and texts."""
    return [
        ("Population of unknown planets", _population(settings["population"])),
        ("Targets", _targets(settings["targets"])),
        ("Visit", _visit(settings["visit"])),
        ("Revisits", _revisits(settings["revisits"])),
        ("Follow-up", _follow_up(settings["follow_up"])),
        ("Candidates", _candidates(settings)),
        ("Reference frames", LIBRARIES[settings["reduction"]["library"]].meaning),
        ("Detection", _detection(settings["detection"])),
        ("Changes to the instrument", _assumed(settings["assumptions"], used)),
        ("Stop rules", _stops(settings["stop"])),
        ("Calendar", _calendar(settings)),
    ]


def _population(population: Mapping[str, Any] | None) -> str:
    if population is None:
        return "none: only known planets are looked for"
    often = population.get("planets_per_star")
    details = [str(population.get("description") or "")] + (
        [f"{often:g} planets per star"] if often is not None else []
    )
    return f"{population.get('name') or 'own'}: {', '.join(filter(None, details))}"


def _targets(cuts: Mapping[str, Any]) -> str:
    parts = [f"at most {cuts['max_targets']}"]
    if cuts["v_mag_max"] is not None:
        parts.append(f"V up to {cuts['v_mag_max']:g} mag")
    if cuts["distance_max_pc"] is not None:
        parts.append(f"within {cuts['distance_max_pc']:g} pc")
    parts += ["dwarfs only"] if cuts["dwarfs_only"] else []
    parts += ["no close companions"] if cuts["singles_only"] else []
    parts += [f"{len(cuts['names'])} named stars"] if cuts["names"] else []
    parts += [f"{len(cuts['exclude'])} stars left out by name"] if cuts["exclude"] else []
    return ", ".join([*parts, *filter(None, [_HOSTS[cuts["known_planets"]]])])


def _visit(visit: Mapping[str, Any]) -> str:
    times = " or ".join(duration_text(value) for value in visit["time_s"])
    bands = visit["bands"]
    chosen = bands[0] if len(bands) == 1 else f"the best of {', '.join(bands)}"
    fixed = [f"frames of {visit['exposure_s']:g} s"] if visit["exposure_s"] is not None else []
    fixed += [f"EM gain {visit['em_gain']:g}"] if visit["em_gain"] is not None else []
    return "; ".join([f"{chosen}, {_GOALS[visit['goal']]} {times} of wall time", *fixed])


def _revisits(rule: Mapping[str, Any]) -> str:
    if rule["max_visits"] == 1:
        return "none"
    return f"up to {rule['max_visits']} visits of a star, at least {rule['min_gap_days']:g} days apart"


def _follow_up(rule: Mapping[str, Any]) -> str:
    if not rule["bands"]:
        return "none"
    bands, time = ", ".join(rule["bands"]), duration_text(rule["time_s"])
    text = f"of planets found, in {bands}: {time} each, up to {rule['attempts']} attempts"
    if rule["snr"] is None:
        return text
    return f"{text}, in slots in which they reach a photometric SNR of {rule['snr']:g} together, the orbit known"


def _candidates(settings: Mapping[str, Any]) -> str:
    """Return what is done with a candidate that may be a false alarm."""
    rule, needed = settings["alarms"], settings["detection"]["visits_needed"]
    if needed > 1:
        return f"planets and false alarms are told apart by the {needed} visits that a detection takes"
    if not (bool(settings["follow_up"]["bands"]) if rule["check"] is None else rule["check"]):
        return "taken for planets after one visit; false alarms cost no telescope time"
    return (
        f"looked at again after {rule['gap_days']:g} days or more, by a planned visit or one of their own; what is "
        f"seen again is a planet, what is not, after {rule['attempts']} such visits, is left"
    )


def _detection(rule: Mapping[str, Any]) -> str:
    text = f"{_RULES[rule['rule']]}; {rule['sigma']:g}σ per resolution element"
    if rule["visits_needed"] > 1:
        text += f", in {rule['visits_needed']} visits"
    if rule["rule"] == "expected":
        return text
    ratio, error = 1.0 / rule["calibration"], rule["calibration_error"] / rule["calibration"] ** 2
    times = "" if rule["half_factor"] == 1.0 else f"{rule['half_factor']:g} times "
    return (
        f"{text}. Predicted over recovered SNR of images is {ratio:.3f} ± {error:.3f}. Half of the planets are found "
        f"at {times}the significance that the law of simulated images asks for, which is known to "
        f"{percent_text(rule['half_error'])}. These errors are drawn anew in each universe"
    )


def _assumed(assumed: Mapping[str, Any], used: AssumedInstrument | None) -> str:
    parts = []
    if assumed["contrast"] is not None:
        parts.append(f"median raw contrast of the dark hole {contrast_text(assumed['contrast'], 2)}")
    if assumed["drift"] != 1.0:
        parts.append(f"wavefront drift × {assumed['drift']:g}")
        if used is not None:
            parts[-1] += f" ({used.visit_drift_nm:g} nm visit offset, {used.walk_nm_per_sqrt_hour:g} nm/√h walk)"
    if assumed["throughput"] != 1.0:
        throughputs = (
            "" if used is None else ", ".join(f"{value:g} in {band}" for band, value in used.throughput.items())
        )
        by_band = f" ({throughputs})" if throughputs else ""
        parts.append(f"throughput of the optics × {assumed['throughput']:g}{by_band}")
    if isinstance(dust := assumed["exozodi"], Mapping):
        law = f"lognormal with median {dust['median']:g} and 95 % below {dust['p95']:g} solar systems (zodi)"
        parts.append(f"dust drawn for each star, {law}")
    elif dust is not None:
        parts.append(f"dust of {dust:g} solar systems (zodi)")
    return ", ".join(parts) or "none"


def _stops(rule: Mapping[str, Any]) -> str:
    parts = ["a star is left once it has shown a planet"] if rule["after_detection"] else []
    if rule["after_empty"] is not None:
        parts.append(f"or after {rule['after_empty']} empty visits")
    if rule["after_planets"] is not None:
        parts.append(f"the survey ends with {rule['after_planets']} planets")
    return ", ".join(parts) or "none"


def _calendar(settings: Mapping[str, Any]) -> str:
    rule = settings["scheduler"]
    method, share = _METHODS.get(rule["method"], rule["method"]), percent_text(settings["slot_share"])
    return f"{method}; at most {share} of any slot; no visit worth less than {rule['min_gain']:g} planets"


def changed_settings(settings: Mapping[str, Any], reference: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return key, value and value of the reference of every setting that differs, name and description aside."""
    own, other = dict(_leaves(settings)), dict(_leaves(reference))
    keys = [key for key in {**own, **other} if key not in ("name", "description")]
    return [
        (key, setting_text(own.get(key), key), setting_text(other.get(key), key))
        for key in keys
        if own.get(key) != other.get(key)
    ]


def _leaves(tree: Mapping[str, Any], above: str = "") -> list[tuple[str, Any]]:
    leaves: list[tuple[str, Any]] = []
    for key, value in tree.items():
        inside = isinstance(value, Mapping) and value
        leaves += _leaves(value, f"{above}{key}.") if inside else [(f"{above}{key}", value)]
    return leaves


def setting_text(value: Any, key: str = "") -> str:
    """Return a value of a setting as people read it: with the unit of its key, factors with their x."""
    if value is None or value in ([], {}, ""):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(setting_text(item, key) for item in value)
    if not isinstance(value, int | float):
        return str(value)
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"x{text}" if key in _FACTORS else with_unit(text, _UNITS.get(key, unit_of(key)))
