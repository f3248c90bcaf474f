"""Comparisons of survey strategies: in words, on the terminal, and as reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Literal

from catalogs import PLANET_CREDITS, data_credits, split_source
from cpic_core import Registry
from cpic_planner import results
from cpic_planner.queries import LIBRARIES, with_unit
from cpic_planner.report import document as doc, words
from cpic_planner.report.cells import Cells, computed, print_note, print_plain, print_table, row_cells
from cpic_planner.report.drawing import Picture
from cpic_planner.report.whatif_figures import WHATIF_FIGURES, plan_label, shown_rows
from cpic_planner.report.words import (
    MISSING,
    count_text,
    decimals,
    interval_text,
    percent_text,
    pretty_name,
    significant,
)
from cpic_planner.results import DifferenceRecord, DoubtCell, DoubtChoice, StrategyOutcome, WhatIfResult
from simulator.config import unit_of

if TYPE_CHECKING:
    from rich.console import Console


_EXCLUSIONS = words.WORDS["exclusions_of_surveys"]
_SPENT = 0.95
"""Share of the budget above which it is what limits the yield."""
_HANGS = 0.3
"""Share of a yield above which it is said to hang on one planet."""
_MOST_LISTED, _MOST_EMPTY = 8, 3
_HARDLY_USED, _FAR_BELOW = 0.02, 0.5
"""Share of the budget, and distance from the bound, of a calendar that is nearly empty."""


def _one_survey(item: results.EstimateRecord | DoubtChoice) -> str:
    return f"{item.survey_low:.3g} to {item.survey_high:.3g}"


def _signed(value: float, places: int) -> str:
    """Return a change with its sign."""
    return f"{'+' if value > 0 else ''}{decimals(value, places)}"


def planets_text(value: float) -> str:
    """Return a mean number of planets of a star, which may be far below one."""
    return "0" if value == 0 else "<0.001" if value < 0.001 else decimals(value, 3)


def _most(strategies: Sequence[StrategyOutcome]) -> StrategyOutcome:
    """Return the strategy that finds most planets."""
    return max(strategies, key=lambda item: item.planets.mean)


def _occurrence_text(item: StrategyOutcome) -> str:
    """Return how many new planets the range of the occurrence rate means; empty where none is stated."""
    found = item.occurrence
    if found is None:
        return ""
    rates = f"{found.planets_per_star_low:g} to {found.planets_per_star_high:g}"
    return f"{interval_text(found.low, found.high)} for {rates} planets a star"


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


def _empty_text(item: StrategyOutcome) -> str:
    """Return the sentence on a calendar that is empty, or hardly used and far below its bound; otherwise nothing."""
    plan, settings = item.schedule, item.settings
    needed, least = settings["detection"]["visits_needed"], settings["scheduler"]["min_gain"]
    if plan.visits and (plan.hours > _HARDLY_USED * settings["time_budget_h"] or plan.distance < _FAR_BELOW):
        return ""
    text = f"{item.name} plans no visit at all"
    if plan.visits:
        text = f"{item.name} plans {count_text(plan.visits)} visits only, {significant(plan.hours)} h"
    rule = f"A visit has to be worth {least:g} planets (scheduler.min_gain)."
    if needed > 1:
        worth = f"those of a star have to be worth {least:g} planets each on average (scheduler.min_gain)"
        rule = f"Where {needed} visits have to show a planet, {worth}."
    why = "no visit of its stars fits into the calendar and shows a planet"
    if plan.bound > 0.0:
        bound = f"no calendar can be worth more than {significant(plan.bound, 2)}"
        why = f"{bound}, this one is worth {significant(plan.value, 2)}"
    return f"{text}: {why}. {rule}"


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
    sentences = [result.statement, *_new_planets(result)]
    if result.doubt is not None:
        sentences.append(result.doubt.statement)
    empty = [text for item in result.strategies if (text := _empty_text(item))]
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
        sentences += _runner_up(result, order[0].name, order[1].name)
    budgets = sorted({float(item.settings["time_budget_h"]) for item in result.strategies})
    share = max(item.hours.mean / float(item.settings["time_budget_h"]) for item in result.strategies)
    if share < _SPENT:
        budget = f"its budget of {budgets[0]:g} h" if len(budgets) == 1 else "its budget"
        who = "The strategy uses" if len(order) == 1 else "No strategy uses more than"
        used = f"{who} {percent_text(share)} of {budget} on average"
        sentences.append(f"{used}: its rules on stars and visits end it before the time does.")
    return sentences


def _new_planets(result: WhatIfResult) -> list[str]:
    """Return the best strategy's new planets with other occurrence rates, and with nothing excluded; none without."""
    best = _most(result.strategies)
    said = [_occurrence_text(best)] if best.occurrence and best.new_planets.mean > 0 else []
    if result.universe["exclusions"] and best.new_planets_unconditional.mean > 0:
        names = " or ".join(_EXCLUSIONS[name].split(" (")[0] for name in result.universe["exclusions"])
        said.append(f"{decimals(best.new_planets_unconditional.mean, 2)} with those that {names} exclude")
    new = f"New planets of {best.name}: {decimals(best.new_planets.mean, 2)}"
    return [f"{new}; in the same visits {', and '.join(said)}."] if said else []


def _runner_up(result: WhatIfResult, best: str, other: str) -> list[str]:
    difference, hours = between(result, best, other, "planets"), between(result, best, other, "hours")
    if difference is None or hours is None:
        return []
    mean, low, high = difference
    more = f"{decimals(abs(hours[0]), 0)} h {'more' if hours[0] >= 0 else 'less'}"
    planets, interval = f"{decimals(mean, 2)} planets", f"({interval_text(low, high)}), in {more}."
    if low > 0:
        return [f"In the same universes {best} finds {planets} more than {other}, the next best {interval}"]
    return [f"The lead of {best} on {other}, the next best, may be chance: {planets} {interval}"]


_FACTORS = ("assumptions.drift", "assumptions.throughput")
_UNITS = {f"assumptions.exozodi{part}": "zodi" for part in ("", ".median", ".p95")}
"""Units of keys that do not end in them."""


def universe_facts(result: WhatIfResult) -> list[tuple[str, str]]:
    """Return what all strategies share, as terms and texts."""
    shared = result.universe
    limits = "Sun, Moon, Earth limb, solar panels, South Atlantic Anomaly, in low Earth orbit"
    changes = f" with {', '.join(shared['changes'])}" if shared.get("changes") else ""
    preset = "Every default value has its source and confidence in the preset."
    excluded = ", ".join(_EXCLUSIONS[name] for name in shared["exclusions"]) or "nothing"
    return [
        ("Time", f"{_span_text(shared)}, planned in slots of {shared['slot_days']:g} days"),
        ("Instrument", f"{shared['instrument']}{changes}. {preset}"),
        ("Orbit and pointing limits", f"{shared['visibility']}: {limits}"),
        ("Stars", result.catalogue),
        ("Known planets", result.known_planets or "left out"),
        ("What excludes unknown planets", excluded),
        ("Background stars", "not drawn" if shared["background"] == "off" else "drawn, as false alarms"),
        *([("Already observed", result.observed)] if result.observed else []),
        ("Universes", f"{count_text(result.n_universes)}, seed {shared['seed']}"),
    ]


def shared_facts(settings: Mapping[str, Any], used: results.AssumedInstrument | None = None) -> list[tuple[str, str]]:
    """Return the rules and assumptions of a strategy, with numbers of the instrument if given, as terms and texts."""
    stops = _setting_parts(
        settings["stop"],
        after_detection="a star is left once it has shown a planet",
        after_empty="or after {} empty visits",
        after_planets="the survey ends with {} planets",
    )
    revisits, scheduler = settings["revisits"], settings["scheduler"]
    method = words.WORDS["schedulers"].get(scheduler["method"], scheduler["method"])
    share = f"at most {percent_text(settings['slot_share'])} of any slot"
    again = f"up to {revisits['max_visits']} visits of a star, at least {revisits['min_gap_days']:g} days apart"
    return [
        ("Population of unknown planets", _population(settings["population"])),
        ("Targets", _targets(settings["targets"])),
        ("Visit", _visit(settings["visit"])),
        ("Revisits", "none" if revisits["max_visits"] == 1 else again),
        ("Follow-up", _follow_up(settings["follow_up"])),
        ("Candidates", _candidates(settings)),
        ("Reference frames", LIBRARIES[settings["reduction"]["library"]].meaning),
        ("Detection", _detection(settings["detection"])),
        ("Changes to the instrument", _assumed(settings["assumptions"], used)),
        ("Stop rules", ", ".join(stops) or "none"),
        ("Calendar", f"{method}; {share}; no visit worth less than {scheduler['min_gain']:g} planets"),
    ]


def _setting_parts(settings: Mapping[str, Any], **texts: str) -> list[str]:
    """Return the texts of those settings that are set, in the order of the texts; of a list its length is told."""
    given = {key: settings[key] for key in texts}
    given = {key: len(value) if isinstance(value, list) else value for key, value in given.items()}
    return [texts[key].format(value) for key, value in given.items() if value is not None and value is not False]


def _population(population: Mapping[str, Any] | None) -> str:
    if population is None:
        return "none: only known planets are looked for"
    often = population.get("planets_per_star")
    details = [population.get("description"), None if often is None else f"{often:g} planets per star"]
    return f"{population.get('name') or 'own'}: {', '.join(filter(None, details))}"


def _targets(cuts: Mapping[str, Any]) -> str:
    parts = _setting_parts(
        {**cuts, "names": cuts["names"] or None, "exclude": cuts["exclude"] or None},
        max_targets="at most {}",
        v_mag_max="V up to {:g} mag",
        distance_max_pc="within {:g} pc",
        dwarfs_only="dwarfs only",
        singles_only="no close companions",
        names="{} named stars",
        exclude="{} stars left out by name",
    )
    return ", ".join(filter(None, [*parts, words.WORDS["hosts"][cuts["known_planets"]]]))


def _visit(visit: Mapping[str, Any]) -> str:
    times = " or ".join(words.duration_text(value) for value in visit["time_s"])
    bands = visit["bands"]
    chosen = bands[0] if len(bands) == 1 else f"the best of {', '.join(bands)}"
    fixed = _setting_parts(visit, exposure_s="frames of {:g} s", em_gain="EM gain {:g}")
    return "; ".join([f"{chosen}, {words.WORDS['goals'][visit['goal']]} {times} of wall time", *fixed])


def _follow_up(rule: Mapping[str, Any]) -> str:
    if not rule["bands"]:
        return "none"
    bands, time = ", ".join(rule["bands"]), words.duration_text(rule["time_s"])
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
    return words.text("texts.whatif_candidates", **rule)


def _detection(rule: Mapping[str, Any]) -> str:
    text = f"{words.WORDS['detection_rules'][rule['rule']]}; {rule['sigma']:g}σ per resolution element"
    if rule["visits_needed"] > 1:
        text += f", in {rule['visits_needed']} visits"
    if rule["rule"] == "expected":
        return text
    ratio, error = 1.0 / rule["calibration"], rule["calibration_error"] / rule["calibration"] ** 2
    times = "" if rule["half_factor"] == 1.0 else f"{rule['half_factor']:g} times "
    half_error = percent_text(rule["half_error"])
    return words.text("texts.whatif_detection", text=text, ratio=ratio, error=error, times=times, half_error=half_error)


def _assumed(assumed: Mapping[str, Any], used: results.AssumedInstrument | None) -> str:
    parts = []
    if assumed["contrast"] is not None:
        parts.append(f"median raw contrast of the dark hole {words.contrast_text(assumed['contrast'], 2)}")
    if assumed["drift"] != 1.0:
        nm = f" ({used.visit_drift_nm:g} nm visit offset, {used.walk_nm_per_sqrt_hour:g} nm/√h walk)" if used else ""
        parts.append(f"wavefront drift × {assumed['drift']:g}{nm}")
    if assumed["throughput"] != 1.0:
        by_band = ", ".join(f"{value:g} in {band}" for band, value in used.throughput.items()) if used else ""
        parts.append(f"throughput of the optics × {assumed['throughput']:g}{by_band and f' ({by_band})'}")
    if isinstance(dust := assumed["exozodi"], Mapping):
        law = f"lognormal with median {dust['median']:g} and 95 % below {dust['p95']:g} solar systems (zodi)"
        parts.append(f"dust drawn for each star, {law}")
    elif dust is not None:
        parts.append(f"dust of {dust:g} solar systems (zodi)")
    return ", ".join(parts) or "none"


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


_LAST_COLUMN = 24
_MOST_STRATEGIES = 20


def print_whatif(result: WhatIfResult, console: Console, *, full: bool = True) -> None:
    """Print the summary, the strategies, and their differences with the first one.

    Parameters
    ----------
    result : WhatIfResult
    console : Console
    full : bool
        Also every strategy's images, and what the comparison is to be made again with.
    """
    for i, text in enumerate(lead_sentences(result)):
        print_plain(console, text, bold=i == 0)
    print_plain(console, f"Compared: {extent_text(result)}.")
    console.print()
    shown = [result.strategies[i] for i in shown_rows(result.strategies, _MOST_STRATEGIES)]
    universes = f"{count_text(result.n_universes)} universes"
    title = f"{result.name or 'strategies'}: mean of {universes} and its 90 % interval"
    print_table(console, title, _STRATEGIES, shown, last_width=_LAST_COLUMN, legend=True)
    if len(shown) < len(result.strategies):
        print_note(console, f"The first and the {len(shown) - 1} of {len(result.strategies)} that find most.")
    if len(shown) > 1:
        console.print()
        _print_differences(result, {item.name for item in shown}, console)
    _print_facts(result, shown, console)
    if full:
        print_plain(console, *_image_lines(shown))
        print_note(console, f"Seed {result.universe['seed']}, configuration {result.config_hash}.")
    elif samples := [item.images for item in result.strategies if item.images is not None and item.images.images]:
        found, made = (sum(getattr(sample, name) for sample in samples) for name in ("found", "images"))
        expected = decimals(sum(sample.expected for sample in samples), 1)
        said = f"{found} of {made} simulated image sequences show the planet, {expected} expected (-v: by strategy)."
        print_note(console, said)


def _visits_made(item: StrategyOutcome) -> float:
    return sum(target.visits for target in item.targets)


_STRATEGIES = row_cells(
    StrategyOutcome,
    "planets interval/2 survey/5 new/1 any_planet/4 hours visits/6 bound/7 alarms/8 name",
    planets=lambda item: decimals(item.planets.mean, 2),
    interval=Cells(
        "interval",
        lambda item: interval_text(item.planets.low, item.planets.high),
        legend="of the mean",
        fields=("planets.low", "planets.high"),
    ),
    survey=Cells(
        "survey",
        lambda item: _one_survey(item.planets),
        legend="5 to 95 % of single surveys",
        fields=("planets.survey_low", "planets.survey_high"),
    ),
    new=Cells(
        "new",
        lambda item: decimals(item.new_planets.mean, 2),
        legend="planets that nobody knows",
        fields=("new_planets",),
    ),
    hours=lambda item: decimals(item.hours.mean, 0),
    visits=computed("visits", _visits_made, lambda value: decimals(value, 1), "made, mean"),
    bound=computed(
        "bound %",
        lambda item: item.schedule.distance,
        lambda value: decimals(100.0 * value, 1),
        "optimality gap: planets lost relative to the best possible calendar, at most",
        name="optimality_gap",
    ),
    alarms=computed(
        "alarms",
        lambda item: item.noise_alarms.mean + item.background_alarms.mean,
        planets_text,
        "false ones, mean",
        name="false_alarms",
    ),
)


def _print_differences(result: WhatIfResult, names: set[str], console: Console) -> None:
    """Print paired differences with the first strategy."""
    reference = result.strategies[0].name
    pairs = {first: by for (first, second), by in _pairs(result.differences).items() if second == reference}
    rows = [(item.name, pairs.get(item.name, {})) for item in result.strategies[1:] if item.name in names]

    def mean(quantity: str, places: int) -> Callable[[tuple[str, _Differences]], str]:
        return lambda row: _signed(row[1][quantity].mean, places) if quantity in row[1] else MISSING

    cells = [
        Cells("planets", mean("planets", 2)),
        Cells("interval", lambda row: interval_text(row[1]["planets"].low, row[1]["planets"].high), gives_way=2),
        Cells("new", mean("new_planets", 2), gives_way=3),
        Cells("hours", mean("hours", 0), gives_way=1),
        Cells("verdict", lambda row: _verdict(row[1]).text.removeprefix("finds "), right=False, gives_way=4),
        Cells("strategy", itemgetter(0), right=False),
    ]
    title = f"Difference with {reference} in the same universes"
    print_table(console, title, cells, [row for row in rows if "planets" in row[1]], last_width=_LAST_COLUMN)


def _print_facts(result: WhatIfResult, strategies: list[StrategyOutcome], console: Console) -> None:
    """Print planets found with all facts and without each."""
    facts = result.facts
    if facts is None or not facts.facts:
        return
    rows = {(row.strategy, row.fact): row for row in facts.rows}

    def without(fact: str) -> Callable[[StrategyOutcome], str]:
        return lambda item: decimals(rows[item.name, fact].planets.mean, 2)

    cells = [
        Cells("all facts", lambda item: decimals(item.planets.mean, 2)),
        *(Cells(fact.name, without(fact.name)) for fact in facts.facts),
        Cells("strategy", lambda item: item.name, right=False),
    ]
    console.print()
    print_table(console, "Planets found without each fact, planned anew", cells, strategies, last_width=_LAST_COLUMN)
    print_plain(console, facts.statement)
    console.print()


def _image_lines(strategies: list[StrategyOutcome]) -> list[str]:
    """Return what images say of the detections of each strategy that has some."""
    lines = []
    for name, sample in ((item.name, item.images) for item in strategies if item.images is not None):
        if sample.images == 0:
            lines.append(f"{name}: no detection was simulated as images: {sample.note or 'none asked for'}")
            continue
        remark = f"; {sample.note}" if sample.note else ""
        ends = "" if sample.low is None or sample.high is None else f" ({interval_text(sample.low, sample.high)})"
        sequences = f"{sample.images} simulated image sequences (of {sample.detections} detections)"
        correction = f"correction {decimals(sample.correction, 2)}{ends}"
        counts = f"{sample.found} of {sequences} show the planet, {decimals(sample.expected, 1)} expected"
        lines.append(f"{name}: {counts}; {correction}{remark}")
    return lines


def targets_csv(result: WhatIfResult) -> str:
    """Return one line for each strategy and star; units stand in the names, lists are joined with semicolons."""
    rows = []
    for item in result.strategies:
        rows += [{"strategy": item.name} | results.values_of(target) for target in item.targets]
    return results.csv_text(("strategy", *results.names_of(results.SurveyTarget)), rows)


_Differences = Mapping[str, DifferenceRecord]
"""Differences of two strategies by quantity."""
_Pair = tuple[tuple[str, str], _Differences]


def _pairs(differences: Iterable[DifferenceRecord]) -> dict[tuple[str, str], dict[str, DifferenceRecord]]:
    """Return differences by the names of the two strategies, in their order, and quantity."""
    pairs: dict[tuple[str, str], dict[str, DifferenceRecord]] = {}
    for item in differences:
        pairs.setdefault((item.first, item.second), {})[item.quantity] = item
    return pairs


def _verdict(by: _Differences) -> doc.Mark:
    """Return whether the first of two strategies finds more planets than the second."""
    item = by["planets"]
    if item.low > 0:
        return doc.badge("ok", "finds more")
    return doc.badge("invalid", "finds fewer") if item.high < 0 else doc.badge("unreachable", "may be chance")


def _difference_table(pairs: Sequence[_Pair]) -> doc.Table:
    def cell(quantity: str, places: int) -> Callable[[_Pair], doc.Inline]:
        def text(pair: _Pair) -> doc.Inline:
            item = pair[1].get(quantity)
            if item is None:
                return MISSING
            return doc.lines(_signed(item.mean, places), doc.small(interval_text(item.low, item.high, places)))

        return text

    def of_planets(text: Callable[[_Differences], doc.Inline]) -> Callable[[_Pair], doc.Inline]:
        return lambda pair: text(pair[1]) if "planets" in pair[1] else MISSING

    columns: tuple[doc.Column[_Pair], ...] = (
        doc.Column("First", lambda pair: pair[0][0], look="row left star"),
        doc.Column("Second", lambda pair: pair[0][1], look="left star"),
        doc.Column("Planets found", cell("planets", 3)),
        doc.Column("New planets", cell("new_planets", 3)),
        doc.Column("Characterised", cell("characterised_planets", 3)),
        doc.Column("Orbits known", cell("orbits_known", 3)),
        doc.Column("Telescope time", cell("hours", 0), "h"),
        doc.Column("Correlation", of_planets(lambda by: decimals(by["planets"].correlation, 2)), "planets"),
        doc.Column("Verdict", of_planets(_verdict), look="left"),
    )
    return doc.table("Differences", words.text("texts.whatif_differences"), columns, pairs)


def _fact_tables(report: WhatIfReport, facts: results.FactsRecord) -> Iterator[doc.Block]:
    """Yield what strategies find with all facts and without each, a heading and a table for each kind of planets."""
    rows = {(row.strategy, row.fact): row for row in facts.rows}

    def with_all(quantity: str) -> Callable[[StrategyOutcome], doc.Inline]:
        return lambda item: decimals(getattr(item, quantity).mean, 2)

    def without(fact: str, quantity: str) -> Callable[[StrategyOutcome], doc.Inline]:
        def cell(item: StrategyOutcome) -> doc.Inline:
            row = rows[item.name, fact]
            change: results.ChangeRecord = getattr(row, f"{quantity}_change")
            said, sure = _signed(change.mean, 3), change.low > 0.0 or change.high < 0.0
            ends = doc.small(f"({interval_text(change.low, change.high, 3)})")
            return doc.lines(decimals(getattr(row, quantity).mean, 2), doc.strong(said) if sure else said, ends)

        return cell

    counted = {"planets": "Planets found", "new_planets": "New planets", "known_planets": "Known planets"}
    for quantity, title in counted.items():
        columns = (
            doc.Column("Strategy", report.named, look="row left star"),
            doc.Column("With all facts", with_all(quantity)),
            *(doc.Column(fact.heading, without(fact.name, quantity)) for fact in facts.facts),
        )
        yield doc.Heading(title)
        caption = words.text("texts.whatif_facts", title=title)
        yield doc.table(f"{title} without each fact", caption, columns, report.result.strategies)


def _doubt_blocks(found: results.DoubtRecord) -> Iterator[doc.Block]:
    """Yield the table of all plans under all values, and what to take where one strategy is settled."""
    cells = {(cell.strategy, cell.planned_for, cell.played_under): cell for cell in found.cells}

    def under(text: str, shown: Callable[[DoubtCell], doc.Inline]) -> Callable[[DoubtChoice], doc.Inline]:
        return lambda item: shown(cells[item.strategy, item.planned_for, text])

    def planets(cell: DoubtCell) -> doc.Inline:
        mean, loss = decimals(cell.planets.mean, 2), cell.loss
        if loss.mean == 0.0:
            return doc.lines(doc.strong(mean), doc.small("best"))
        ends = f"({interval_text(loss.low, loss.high, 3)})"
        return doc.lines(mean, doc.small(f"loses {decimals(loss.mean, 3)}"), doc.small(ends))

    def regret(cell: DoubtCell) -> doc.Inline:
        hours = doc.small(f"{decimals(cell.hours, 0)} h")
        if cell.planned_for == cell.played_under:
            return doc.lines("0", hours)
        return doc.lines(_signed(cell.regret.mean, 3), doc.small(f"± {decimals(cell.regret.error, 3)}"), hours)

    def alone(item: DoubtChoice) -> doc.Inline:
        own = cells[item.strategy, item.planned_for, item.planned_for].planets
        return doc.lines(interval_text(own.low, own.high), doc.small(_one_survey(own)))

    def mixed(item: DoubtChoice) -> doc.Inline:
        return doc.lines(interval_text(item.low, item.high), doc.small(_one_survey(item)))

    plan: doc.Column[DoubtChoice] = doc.Column("Plan", plan_label, look="row left star")
    heads = {value.text: f"{found.key} {value.text}" for value in found.values}
    weights = {value.text: f"weight {words.share_text(value.weight)} %" for value in found.values}
    columns: tuple[doc.Column[DoubtChoice], ...] = (
        plan,
        *(doc.Column(head, under(text, planets), weights[text]) for text, head in heads.items()),
        doc.Column("Largest loss", lambda item: decimals(item.largest_loss, 3), "planets"),
        doc.Column("Mean", lambda item: decimals(item.planets, 2), "by the weights"),
        doc.Column("If as planned", alone, "mean; one survey"),
        doc.Column("With the doubt", mixed, "mean; one survey"),
    )
    chosen = {plan_label(item) for item in (found.decision.cautious, found.decision.expected)}
    about = {"key": found.key, "what": found.quantity.replace("_", " "), "weights": found.weights_from}
    caption = words.text("texts.whatif_doubt", **about)
    look: dict[str, Any] = {"look": "compact", "picked": lambda item: plan_label(item) in chosen}
    yield doc.table("Plans under doubt", caption, columns, found.choices, **look)
    if len(found.of_strategies) > 1:
        yield doc.Heading("If the strategy is settled")
        yield _settled(found)
    regrets = (plan, *(doc.Column(head, under(text, regret)) for text, head in heads.items()))
    made = doc.table("Regret", words.text("texts.whatif_regret"), regrets, found.choices, look="compact")
    yield doc.Fold("Regret against the same strategy", [made])


def _settled(found: results.DoubtRecord) -> doc.Table:
    """Return what to plan for, strategy by strategy."""

    def loss(item: results.DoubtDecision) -> str:
        one = item.cautious
        return f"{decimals(one.largest_loss, 3)} at {one.largest_loss_under}" if one.largest_loss > 0.0 else "0"

    def knowing(item: results.DoubtDecision) -> doc.Inline:
        worth = item.value_of_knowing
        return doc.lines(decimals(worth.mean, 3), doc.small(interval_text(worth.low, worth.high, 3)))

    columns: tuple[doc.Column[results.DoubtDecision], ...] = (
        doc.Column("Strategy", lambda item: item.strategy, look="row left star"),
        doc.Column("Cautious", lambda item: item.cautious.planned_for, "planned for"),
        doc.Column("Its largest loss", loss, "planets"),
        doc.Column("Most by weights", lambda item: item.expected.planned_for, "planned for"),
        doc.Column("Mean", lambda item: decimals(item.expected.planets, 2), "by the weights"),
        doc.Column("Worth of knowing", knowing, "planets"),
    )
    caption = words.text("texts.whatif_settled", key=found.key)
    return doc.table("Settled strategies", caption, columns, found.of_strategies)


_OPEN_CHANGES = 5
"""Strategies whose changes of rank are shown without a click."""
_DESCRIBED = 12
"""Strategies whose descriptions stand in the table of yields."""
_WORDS = "contrast; SNR; significance; threshold; blind search; separation; dark hole; RDI"
"""Terms of the glossary that this report uses."""


@dataclass(frozen=True)
class WhatIfReport:
    """The contents of the report of a comparison: the result, and figures by the keys of `WHATIF_FIGURES`."""

    result: WhatIfResult
    figures: Mapping[str, Picture]

    @property
    def reference(self) -> StrategyOutcome:
        """The strategy that the others are compared with."""
        return self.result.strategies[0]

    @cached_property
    def shown(self) -> list[StrategyOutcome]:
        """Strategies that are shown in full."""
        return [self.result.strategies[i] for i in shown_rows(self.result.strategies)]

    @cached_property
    def anchors(self) -> dict[str, str]:
        """Anchors of the strategies that are shown in full."""
        return {item.name: f"strategy-{number}" for number, item in enumerate(self.shown, 1)}

    def named(self, item: StrategyOutcome) -> doc.Inline:
        """Return the name of a strategy, as a link where it is shown in full."""
        return doc.link(self.anchors[item.name], item.name) if item.name in self.anchors else item.name

    def drawn(self, *keys: str) -> Iterator[doc.Figure]:
        """Yield some of the figures, those that there are."""
        return (doc.Figure(self.figures[key], WHATIF_FIGURES[key][0], key) for key in keys if key in self.figures)


WHATIF_SECTIONS: Registry[doc.Section[WhatIfReport]] = Registry("section")
"""Sections of the report, in their order."""


def whatif_document(report: WhatIfReport) -> doc.Document:
    """Return the report of a comparison."""
    result = report.result
    first, *others = lead_sentences(result)
    named = f": {result.name}" if result.name else ""
    description = f"{result.description}. " if result.description else ""
    universes = f"{count_text(result.n_universes)} synthetic universes with real stars"
    about = f"Survey strategies for CPI-C: {extent_text(result)}, played in the same {universes}."
    return doc.document_of(
        WHATIF_SECTIONS,
        report,
        title=f"CPI-C survey strategies{named}, configuration {result.config_hash}",
        heading=result.name or "Survey strategies",
        about=f"{description}{about}",
        summary=[doc.Paragraph(doc.strong(first), "lead"), *(doc.Paragraph(text, "lead") for text in others)],
    )


@doc.section_of(WHATIF_SECTIONS, "strategies", "Strategies")
def _strategies(report: WhatIfReport) -> Iterator[doc.Block]:
    strategies = report.result.strategies
    best = _most(strategies)

    def described(item: StrategyOutcome) -> doc.Inline:
        text = item.description if len(strategies) <= _DESCRIBED else ""
        return [report.named(item), doc.small(text) if text else ""]

    def counted(
        name: str, remark: Callable[[StrategyOutcome], str] = lambda _: ""
    ) -> Callable[[StrategyOutcome], doc.Inline]:
        def cell(item: StrategyOutcome) -> doc.Inline:
            estimate: results.EstimateRecord = getattr(item, name)
            interval = doc.small(interval_text(estimate.low, estimate.high))
            return doc.lines(decimals(estimate.mean, 2), interval, doc.small(remark(item)))

        return cell

    columns: tuple[doc.Column[StrategyOutcome], ...] = (
        doc.Column("Strategy", described, look="row left described"),
        doc.Column("Planets found", counted("planets", hanging_text), "new and known", look="wide"),
        doc.Column("One survey", lambda item: _one_survey(item.planets), "5 to 95 %"),
        doc.Column("New planets", counted("new_planets", _occurrence_text), "still allowed"),
        doc.Column("New planets", counted("new_planets_unconditional"), "nothing excluded"),
        doc.Column("Known planets", counted("known_planets")),
        doc.Column("Characterised", counted("characterised_planets")),
        doc.Column("Orbits known", counted("orbits_known")),
        doc.Column("Chance of any", lambda item: words.share_text(item.any_planet), "%"),
        doc.Column("Chance of a new one", lambda item: words.share_text(item.any_new_planet), "%"),
        doc.Column("Telescope time", lambda item: decimals(item.hours.mean, 0), "h"),
    )
    caption = words.text("texts.whatif_yields")
    yield doc.table("Yields", caption, columns, strategies, picked=lambda item: item is best and best.planets.mean > 0)
    yield from report.drawn("sweep", "yields")


@doc.section_of(WHATIF_SECTIONS, "differences", "Differences")
def _differences(report: WhatIfReport) -> Iterator[doc.Block]:
    pairs, first = list(_pairs(report.result.differences).items()), report.reference.name
    with_first = [pair for pair in pairs if pair[0][1] == first]
    if not with_first:
        return
    yield _difference_table(with_first)
    if others := [pair for pair in pairs if pair[0][1] != first]:
        yield doc.Fold(f"All other pairs ({len(others)})", [_difference_table(others)])
    yield from report.drawn("differences")


@doc.section_of(WHATIF_SECTIONS, "facts", "Which fact moved which number")
def _facts(report: WhatIfReport) -> Iterator[doc.Block]:
    facts = report.result.facts
    if facts is not None and facts.facts:
        yield doc.Paragraph(facts.statement)
        yield from _fact_tables(report, facts)


@doc.section_of(WHATIF_SECTIONS, "doubt", "Planned for one value, played under another")
def _doubt(report: WhatIfReport) -> Iterator[doc.Block]:
    found = report.result.doubt
    if found is not None:
        yield doc.Paragraph(found.statement)
        yield from report.drawn("doubt")
        yield from _doubt_blocks(found)


@doc.section_of(WHATIF_SECTIONS, "cost", "Time and cost")
def _cost(report: WhatIfReport) -> Iterator[doc.Block]:
    def hours(item: StrategyOutcome) -> doc.Inline:
        ends = interval_text(item.hours.survey_low, item.hours.survey_high, 0)
        return doc.lines(decimals(item.hours.mean, 0), doc.small(f"({ends})"))

    def budget(item: StrategyOutcome) -> doc.Inline:
        share = f"({percent_text(item.time_use.budget_share)})"
        return doc.lines(decimals(item.time_use.budget_h, 0), doc.small(share))

    def hourly(item: StrategyOutcome) -> str:
        return significant(100 * item.planets.mean / item.hours.mean, 2) if item.hours.mean > 0 else MISSING

    def planned(item: StrategyOutcome) -> str:
        reserve = item.schedule.reserve_visits
        return count_text(item.schedule.visits) + (f" + {count_text(reserve)}" if reserve else "")

    def alarms(item: StrategyOutcome) -> str:
        return f"{planets_text(item.noise_alarms.mean)}; {planets_text(item.background_alarms.mean)}"

    columns: tuple[doc.Column[StrategyOutcome], ...] = (
        doc.Column("Strategy", report.named, look="row left star"),
        doc.Column("Telescope time", hours, "h"),
        doc.Column("Budget", budget, "h; of the survey"),
        doc.Column("Planets", hourly, "per 100 h"),
        doc.Column("Stars visited", lambda item: str(sum(star.planned_visits > 0 for star in item.targets))),
        doc.Column("Visits planned", planned, "and in reserve"),
        doc.Column("Visits made", lambda item: decimals(_visits_made(item), 1), "mean"),
        doc.Column("From the bound", lambda item: decimals(100 * item.schedule.distance, 1), "%"),
        doc.Column("False alarms", alarms, "noise; background"),
        doc.Column("Spent on false alarms", lambda item: decimals(item.time_use.alarm_h, 1), "h"),
    )
    yield doc.table("Time and cost", words.text("texts.whatif_cost"), columns, report.result.strategies)
    yield from report.drawn("curves", "time")


@doc.section_of(WHATIF_SECTIONS, "where", "Stars and dates")
def _where(report: WhatIfReport) -> Iterator[doc.Block]:
    yield from report.drawn("calendar", "sky")
    if not any(item.targets for item in report.result.strategies):
        yield doc.Paragraph("No strategy visits a star.")


@doc.section_of(WHATIF_SECTIONS, "changes", "Changes of rank")
def _changes(report: WhatIfReport) -> Iterator[doc.Block]:
    def rank(value: int | None) -> str:
        return "not visited" if value is None else str(value)

    changes: dict[str, list[results.RankChange]] = {}
    for change in report.result.rank_changes:
        changes.setdefault(change.strategy, []).append(change)
    if not changes:
        return
    reference = report.reference.name
    yield doc.Paragraph(words.text("texts.whatif_changes", reference=reference))
    columns: tuple[doc.Column[results.RankChange], ...] = (
        doc.Column("Star", lambda change: pretty_name(change.star), look="row left star"),
        doc.Column("Rank in", lambda change: rank(change.first_rank), reference),
        doc.Column("Rank here", lambda change: rank(change.rank)),
        doc.Column("Why", lambda change: change.why, look="left wide"),
    )
    for name, rows in changes.items():
        made = doc.table(f"Changes of rank, {name}", f"{name} beside {reference}.", columns, rows)
        yield doc.Fold(f"{name} ({len(rows)})", [made], len(changes) <= _OPEN_CHANGES)


@doc.section_of(WHATIF_SECTIONS, "detected", "Detections")
def _detected(report: WhatIfReport) -> Iterator[doc.Block]:
    if "detections" not in report.figures:
        yield doc.Paragraph("Nothing is detected in any universe.")
    yield from report.drawn("detections", "convergence")


@doc.section_of(WHATIF_SECTIONS, "images", "Confirmed by images")
def _images(report: WhatIfReport) -> Iterator[doc.Block]:
    confirmed = [(item, item.images) for item in report.result.strategies if item.images is not None]
    if not confirmed:
        none = "No images were asked for: detections are those of the analytic model with the detection law that stands"
        yield doc.Paragraph([f"{none} under ", doc.link("assumptions", "Assumptions"), "."])
        return

    def correction(row: tuple[StrategyOutcome, results.ImageSample]) -> doc.Inline:
        low, high = row[1].low, row[1].high
        ends = "" if low is None or high is None else interval_text(low, high)
        return doc.lines(decimals(row[1].correction, 2), doc.small(ends))

    def corrected(row: tuple[StrategyOutcome, results.ImageSample]) -> str:
        return MISSING if row[1].correction is None else decimals(row[1].correction * row[0].planets.mean, 2)

    columns: tuple[doc.Column[tuple[StrategyOutcome, results.ImageSample]], ...] = (
        doc.Column("Strategy", lambda row: report.named(row[0]), look="row left star"),
        doc.Column("Detections", lambda row: count_text(row[1].detections), "sampled"),
        doc.Column("Sequences", lambda row: count_text(row[1].images), "simulated"),
        doc.Column("Expected", lambda row: decimals(row[1].expected, 1)),
        doc.Column("Found", lambda row: count_text(row[1].found)),
        doc.Column("Correction", correction),
        doc.Column("Planets found", corrected, "corrected"),
        doc.Column("Note", lambda row: row[1].note, look="left wide"),
    )
    yield doc.table("Confirmed by images", words.text("texts.whatif_images"), columns, confirmed)


@doc.section_of(WHATIF_SECTIONS, "details", "Each strategy")
def _details(report: WhatIfReport) -> Iterator[doc.Block]:
    n, shown = len(report.result.strategies), report.shown
    if len(shown) < n:
        most = f"The first strategy and the {len(shown) - 1} that find most; `targets.csv` has the stars of all {n}."
        yield doc.Paragraph(doc.marked(most), "note")
    for item in shown:
        yield doc.Group(report.anchors[item.name], item.name, list(_strategy_blocks(item, report.reference)))


def _strategy_blocks(item: StrategyOutcome, reference: StrategyOutcome) -> Iterator[doc.Block]:
    """Yield what there is to say of one strategy: how it differs from the reference, and its stars."""
    if item.description:
        yield doc.Paragraph(f"{item.description}.")
    if item.name != reference.name:
        differences: list[doc.Inline] = [f"Set as {reference.name} is."]
        if changed := changed_settings(item.settings, reference.settings):
            differences = [f"Set otherwise than in {reference.name}: "]
            for number, (key, own, other) in enumerate(changed, 1):
                differences += [doc.code(key), f" {own} (there {other})", "; " if number < len(changed) else "."]
        yield doc.Paragraph(differences, "note")
    if not item.targets:
        yield doc.Paragraph("No star is visited.")
        return
    stars = doc.row_table(
        f"Stars of {item.name}",
        words.text("texts.whatif_stars", name=item.name),
        results.SurveyTarget,
        "rank name:row,star v_mag distance_pc bands visit_time_s visit_h planned_visits visits first_utc search_h "
        "follow_up_h alarm_h new_planets known_seen planets_per_100h",
        item.targets,
        look="compact",
        name=lambda star: doc.lines(pretty_name(star.name), doc.small(", ".join(map(pretty_name, star.known_planets)))),
        distance_pc=lambda star: significant(star.distance_pc, 4),
        first_utc=lambda star: star.first_utc or MISSING,
        new_planets=lambda star: planets_text(star.new_planets),
        known_seen=lambda star: planets_text(star.known_seen) if star.known_planets else MISSING,
    )
    yield doc.Fold(f"Stars ({len(item.targets)})", [stars])


@doc.section_of(WHATIF_SECTIONS, "reading", "How to read this")
def _reading(report: WhatIfReport) -> Iterator[doc.Block]:
    yield doc.Items(words.prose()["reading"])


@doc.section_of(WHATIF_SECTIONS, "assumptions", "Assumptions")
def _assumptions(report: WhatIfReport) -> Iterator[doc.Block]:
    result, reference = report.result, report.reference
    n_strategies = len(result.strategies)
    yield doc.Heading("Of all strategies")
    yield doc.Facts([*universe_facts(result), *doc.notes_fact(result.notes)])
    others: doc.Inline = ["; the others differ as told under ", doc.link("details", "Each strategy")]
    yield doc.Heading([f"Of {reference.name}", others if n_strategies > 1 else ""])
    yield doc.Facts(shared_facts(reference.settings, reference.instrument))
    if not result.sources:
        return

    def value(item: results.SettingSource) -> doc.Inline:
        text = setting_text(item.value, "" if item.unit else item.key)
        return [text, " ", doc.small(item.unit)] if item.unit else text

    def used_by(item: results.SettingSource) -> str:
        return "all" if len(item.strategies) == n_strategies else ", ".join(item.strategies)

    columns: tuple[doc.Column[results.SettingSource], ...] = (
        doc.Column("Setting", lambda item: doc.code(item.key), look="row left"),
        doc.Column("Value", value),
        doc.Column("Standing", lambda item: item.confidence, look="left"),
        doc.Column("Source", lambda item: item.source, look="left wide"),
        doc.Column("Strategies", used_by, look="left wide"),
    )
    caption = words.text("texts.whatif_sources")
    rows = doc.table("Sources of the settings", caption, columns, result.sources, look="compact")
    yield doc.Fold(f"Where these numbers are from ({len(result.sources)})", [rows])


@doc.section_of(WHATIF_SECTIONS, "missing", "What is not modelled")
def _missing(report: WhatIfReport) -> Iterator[doc.Block]:
    left_out = report.result.not_modelled
    yield doc.Items(left_out) if left_out else doc.Paragraph("Nothing is listed.")


@doc.section_of(WHATIF_SECTIONS, "glossary", "Glossary")
def _glossary(report: WhatIfReport) -> Iterator[doc.Block]:
    yield doc.Facts([*words.prose()["whatif_terms"].items(), *words.terms(_WORDS)])


@doc.section_of(WHATIF_SECTIONS, "reproduce", "Reproducing this")
def _reproduce(report: WhatIfReport) -> Iterator[doc.Block]:
    result = report.result
    note = doc.marked(words.text("texts.whatif_files"))
    yield from doc.reproduced_blocks(result, note, seed=result.universe["seed"])
    shipped = bool(result.known_planets) and split_source(str(result.universe["known_planets"]))[0] != "none"
    yield doc.Items((*data_credits(result.catalogue), *(PLANET_CREDITS if shipped else ()), *words.prose()["credits"]))
