"""Comparisons of survey strategies: in words, on the terminal, and as reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

from catalogs import PLANET_CREDITS, data_credits, split_source
from cpic_core import Record, Registry
from cpic_planner import results
from cpic_planner.queries import LIBRARIES, with_unit
from cpic_planner.report import document as doc, words
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

_EXCLUSIONS = words.WORDS["exclusions_of_surveys"]
_SPENT = 0.95
"""Share of the budget above which it is what limits the yield."""
_HANGS = 0.3
"""Share of a yield above which it is said to hang on one planet."""
_MOST_LISTED, _MOST_EMPTY = 8, 3
_HARDLY_USED, _FAR_BELOW = 0.02, 0.5
"""Share of the budget, and distance from the bound, of a calendar that is nearly empty."""


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


_CODES = {
    "visit.goal": words.WORDS["goals"],
    "detection.rule": words.WORDS["detection_rules"],
    "targets.known_planets": words.WORDS["hosts"],
    "scheduler.method": words.WORDS["schedulers"],
    "reduction.library": {name: library.meaning for name, library in LIBRARIES.items()},
}
"""Words for codes, by the settings that hold them."""
_OF_POPULATION = ("population.name", "population.description", "population.planets_per_star")


def shared_facts(settings: Mapping[str, Any], used: results.AssumedInstrument | None = None) -> list[tuple[str, str]]:
    """Return the settings of a strategy that are set, group by group, and what they make of the instrument if given."""
    groups: dict[str, list[str]] = {}
    for key, value in _leaves({**settings, "population": settings["population"] or {"name": "none"}}):
        group, _, name = key.rpartition(".") if "." in key else ("budget and values", "", key)
        hidden = key in ("name", "description") or (group == "population" and key not in _OF_POPULATION)
        text = _CODES.get(key, {}).get(value) if isinstance(value, str) else None
        text = setting_text(value, key) if text is None else text
        if not hidden and not group.startswith("population.") and text not in ("none", "no", ""):
            named = name.removesuffix(f"_{unit_of(key)}") if with_unit("", unit_of(key)) else name
            groups.setdefault(group, []).append(f"{named.replace('_', ' ')} {text}")
    facts = [(group.replace("_", " ").capitalize(), "; ".join(texts)) for group, texts in groups.items()]
    if used is not None:
        by_band = ", ".join(f"{value:g} in {band}" for band, value in used.throughput.items())
        drift = f"{used.visit_drift_nm:g} nm visit offset, {used.walk_nm_per_sqrt_hour:g} nm/√h walk"
        facts.append(("Instrument as assumed", f"drift {drift}; throughput of the optics {by_band or 'its own'}"))
    return facts


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


def whatif_blocks(result: WhatIfResult, *, full: bool = True) -> Iterator[doc.Block]:
    """Yield the summary, the strategies, and their differences with the first one, as a terminal shows them.

    Parameters
    ----------
    result : WhatIfResult
    full : bool
        Also every strategy's images, and what the comparison is to be made again with.
    """
    report = WhatIfReport(result, {}, shown_rows(result.strategies, _MOST_STRATEGIES))
    document = whatif_document(report)
    yield doc.Paragraph(document.about)
    yield from doc.parts(document, "strategies", "differences", "facts", *["images"] * full)
    if full:
        yield doc.Paragraph(f"Seed {result.universe['seed']}, configuration {result.config_hash}.", "note")
    elif samples := [item.images for item in result.strategies if item.images is not None and item.images.images]:
        found, made = (sum(getattr(sample, name) for sample in samples) for name in ("found", "images"))
        expected = decimals(sum(sample.expected for sample in samples), 1)
        said = f"{found} of {made} simulated image sequences show the planet, {expected} expected (-v: by strategy)."
        yield doc.Paragraph(said, "note")


_MOST_STRATEGIES = 20
"""Strategies that a terminal shows."""


def _visits_made(item: StrategyOutcome) -> float:
    return sum(target.visits for target in item.targets)


def targets_csv(result: WhatIfResult) -> str:
    """Return one line for each strategy and star; units stand in the names, lists are joined with semicolons."""
    rows = []
    for item in result.strategies:
        rows += [{"strategy": item.name} | results.values_of(target) for target in item.targets]
    return results.csv_text(("strategy", *results.names_of(results.SurveyTarget)), rows)


_Differences = Mapping[str, DifferenceRecord]
"""Differences of two strategies by quantity."""
_Pair = tuple[str, str, _Differences]


def _pairs(differences: Iterable[DifferenceRecord]) -> list[_Pair]:
    """Return the names of two strategies with their differences, pair by pair."""
    pairs: dict[tuple[str, str], dict[str, DifferenceRecord]] = {}
    for item in differences:
        pairs.setdefault((item.first, item.second), {})[item.quantity] = item
    return [(first, second, by) for (first, second), by in pairs.items()]


def _verdict(pair: _Pair) -> doc.Inline:
    """Return whether the first of two strategies finds more planets than the second."""
    item = pair[2].get("planets")
    if item is None:
        return MISSING
    if item.low > 0:
        return doc.badge("ok", "finds more")
    return doc.badge("invalid", "finds fewer") if item.high < 0 else doc.badge("unreachable", "may be chance")


def _difference_table(pairs: Sequence[_Pair], title: str) -> doc.Table:
    def column(quantity: str, heading: str, places: int = 2, look: str = "", way: int = 0) -> results.Column:
        template = f"{{mean:+.{places}f}}\n{{low:.{places}f}} to {{high:.{places}f}}"
        cell = doc.own_column("", template)
        unit = "h" if quantity == "hours" else ""
        return doc.own_column(heading, lambda pair: doc.cell(cell, pair[2].get(quantity)), unit, look, way=way)

    def correlation(pair: _Pair) -> str:
        return decimals(pair[2]["planets"].correlation, 2) if "planets" in pair[2] else MISSING

    columns = [
        column("planets", "planets"),
        column("new_planets", "new", way=2),
        column("characterised_planets", "characterised", look="page"),
        column("orbits_known", "orbits known", look="page"),
        column("hours", "hours", 0, way=3),
        doc.own_column("correlation", correlation, "planets", "page"),
        doc.own_column("verdict", _verdict, look="left", way=1),
        doc.own_column("second", "{1}", look="left star page"),
        doc.own_column("strategy", "{0}", look="row left star"),
    ]
    return doc.Table(title, columns, pairs, words.text("texts.whatif_differences"), last_width=24)


def _fact_tables(report: WhatIfReport, facts: results.FactsRecord) -> Iterator[doc.Block]:
    """Yield what strategies find with all facts and without each, a table for each kind of planets."""
    rows = {(row.strategy, row.fact): row for row in facts.rows}

    def without(fact: str, quantity: str) -> Callable[[StrategyOutcome], doc.Inline]:
        def cell(item: StrategyOutcome) -> doc.Inline:
            row = rows[item.name, fact]
            change: results.ChangeRecord = getattr(row, f"{quantity}_change")
            said, sure = words.formatted(change.mean, "+.3f"), change.low > 0.0 or change.high < 0.0
            ends = doc.small(f"({interval_text(change.low, change.high, 3)})")
            return doc.lines(decimals(getattr(row, quantity).mean, 2), doc.strong(said) if sure else said, ends)

        return cell

    for quantity, title in (
        ("planets", "Planets found"),
        ("new_planets", "New planets"),
        ("known_planets", "Known planets"),
    ):
        columns = [
            doc.own_column("with all facts", f"{{{quantity}.mean:.2f}}"),
            *(doc.own_column(fact.heading, without(fact.name, quantity)) for fact in facts.facts),
            doc.own_column("strategy", report.named, look="row left star"),
        ]
        caption = words.text("texts.whatif_facts", title=title)
        yield doc.Table(f"{title} without each fact, planned anew", columns, report.rows, caption, last_width=24)


def _doubt_blocks(found: results.DoubtRecord) -> Iterator[doc.Block]:
    """Yield the table of all plans under all values, and what to take where one strategy is settled."""
    cells = {(cell.strategy, cell.planned_for, cell.played_under): cell for cell in found.cells}

    def under(shown: Callable[[DoubtCell], doc.Inline], text: str) -> Callable[[DoubtChoice], doc.Inline]:
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
        return doc.lines(
            words.formatted(cell.regret.mean, "+.3f"), doc.small(f"± {decimals(cell.regret.error, 3)}"), hours
        )

    interval = doc.own_column("", f"{{low:.2f}} to {{high:.2f}}\n{_ONE_SURVEY}")

    def alone(item: DoubtChoice) -> doc.Inline:
        return doc.cell(interval, cells[item.strategy, item.planned_for, item.planned_for].planets)

    plan = doc.own_column("plan", plan_label, look="row left star")
    played = [
        doc.own_column(
            f"{found.key} {value.text}", under(planets, value.text), f"weight {words.share_text(value.weight)} %"
        )
        for value in found.values
    ]
    columns = [
        plan,
        *played,
        doc.own_column("largest loss", "{largest_loss:.3f}", "planets"),
        doc.own_column("mean", "{planets:.2f}", "by the weights"),
        doc.own_column("if as planned", alone, "mean; one survey"),
        replace(interval, short="with the doubt", unit="mean; one survey"),
    ]
    chosen = {plan_label(item) for item in (found.decision.cautious, found.decision.expected)}
    about = {"key": found.key, "what": found.quantity.replace("_", " "), "weights": found.weights_from}
    look: dict[str, Any] = {"look": "compact", "picked": lambda item: plan_label(item) in chosen}
    yield doc.Table("Plans under doubt", columns, found.choices, words.text("texts.whatif_doubt", **about), **look)
    if len(found.of_strategies) > 1:
        yield _settled(found)
    regrets = [doc.own_column(f"{found.key} {value.text}", under(regret, value.text)) for value in found.values]
    made = doc.Table("Regret", [plan, *regrets], found.choices, words.text("texts.whatif_regret"), look="compact")
    yield doc.Fold("Regret against the same strategy", [made])


def _settled(found: results.DoubtRecord) -> doc.Table:
    """Return what to plan for, strategy by strategy."""

    def loss(item: results.DoubtDecision) -> str:
        one = item.cautious
        return f"{decimals(one.largest_loss, 3)} at {one.largest_loss_under}" if one.largest_loss > 0.0 else "0"

    worth = "{value_of_knowing.mean:.3f}\n{value_of_knowing.low:.3f} to {value_of_knowing.high:.3f}"
    columns = [
        doc.own_column("strategy", "{strategy}", look="row left star"),
        doc.own_column("cautious", "{cautious.planned_for}", "planned for"),
        doc.own_column("its largest loss", loss, "planets"),
        doc.own_column("most by weights", "{expected.planned_for}", "planned for"),
        doc.own_column("mean", "{expected.planets:.2f}", "by the weights"),
        doc.own_column("worth of knowing", worth, "planets"),
    ]
    caption = words.text("texts.whatif_settled", key=found.key)
    return doc.Table("If the strategy is settled", columns, found.of_strategies, caption)


_OPEN_CHANGES = 5
"""Strategies whose changes of rank are shown without a click."""
_DESCRIBED = 12
"""Strategies whose descriptions stand in the table of yields."""
_WORDS = "contrast; SNR; significance; threshold; blind search; separation; dark hole; RDI"
"""Terms of the glossary that this report uses."""


class WhatIfReport(Record):
    """The contents of the report of a comparison: the result, and figures by the keys of `WHATIF_FIGURES`.

    ``chosen`` are the strategies that tables show, all where it is empty.
    """

    result: WhatIfResult
    figures: Mapping[str, Picture]
    chosen: Sequence[int] = ()

    @property
    def rows(self) -> list[StrategyOutcome]:
        """Strategies that tables show."""
        every = self.result.strategies
        return [every[i] for i in self.chosen] if self.chosen else every

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


_ONE_SURVEY = "{survey_low:g} to {survey_high:g}"


@doc.section_of(WHATIF_SECTIONS, "strategies", "Strategies")
def _strategies(report: WhatIfReport) -> Iterator[doc.Block]:
    strategies, of = report.result.strategies, (StrategyOutcome, doc.itself)
    best = _most(strategies)

    def described(item: StrategyOutcome) -> doc.Inline:
        text = item.description if len(strategies) <= _DESCRIBED else ""
        return doc.lines(report.named(item), doc.small(text))

    def counted(
        name: str, heading: str, unit: str = "", remark: Callable[[StrategyOutcome], str] = lambda _: ""
    ) -> results.Column:
        def cell(item: StrategyOutcome) -> doc.Inline:
            estimate: results.EstimateRecord = getattr(item, name)
            interval = doc.small(interval_text(estimate.low, estimate.high))
            return doc.lines(decimals(estimate.mean, 2), interval, doc.small(remark(item)))

        return doc.own_column(heading, cell, unit, "page")

    def of_fields(heading: str, text: str, fields: str, legend: str, look: str = "terminal") -> results.Column:
        return doc.own_column(heading, text, look=look, legend=legend, fields=fields, of=of)

    survey, ends = _ONE_SURVEY.replace("{", "{planets."), "planets.survey_low planets.survey_high"
    columns = doc.row_columns(
        StrategyOutcome,
        "planets:terminal interval:terminal/2 found:page,wide survey/5 new:terminal/1 allowed:page every:page "
        "known:page characterised:page orbits:page any_planet/4 any_new_planet:page hours visits:terminal/6 "
        "bound:terminal/7 alarms:terminal/8 named:page,row,left,described name:terminal,left",
        planets="{planets.mean:.2f}",
        interval=of_fields(
            "interval", "{planets.low:.2f} to {planets.high:.2f}", "planets.low planets.high", "of the mean"
        ),
        found=counted("planets", "planets found", "new and known", hanging_text),
        survey=of_fields("one survey", survey, ends, "5 to 95 % of single surveys", ""),
        new=of_fields("new", "{new_planets.mean:.2f}", "new_planets", "planets that nobody knows"),
        allowed=counted("new_planets", "new planets", "still allowed", _occurrence_text),
        every=counted("new_planets_unconditional", "new planets", "nothing excluded"),
        known=counted("known_planets", "known planets"),
        characterised=counted("characterised_planets", "characterised"),
        orbits=counted("orbits_known", "orbits known"),
        hours="{hours.mean:.0f}",
        visits=doc.computed("visits", _visits_made, lambda value: decimals(value, 1), "made, mean"),
        bound=doc.computed(
            "bound %",
            lambda item: item.schedule.distance,
            lambda value: decimals(100.0 * value, 1),
            "optimality gap: planets lost relative to the best possible calendar, at most",
            name="optimality_gap",
        ),
        alarms=doc.computed(
            "alarms",
            lambda item: item.noise_alarms.mean + item.background_alarms.mean,
            planets_text,
            "false ones, mean",
            name="false_alarms",
        ),
        named=doc.own_column("strategy", described),
    )
    universes = f"{count_text(report.result.n_universes)} universes"
    title = f"{report.result.name or 'strategies'}: mean of {universes} and its 90 % interval"
    look: dict[str, Any] = {"picked": lambda item: item is best and best.planets.mean > 0, "last_width": 24}
    yield doc.Table(title, columns, report.rows, words.text("texts.whatif_yields"), legend=True, **look)
    left = f"The first and the {len(report.rows) - 1} of {len(strategies)} that find most."
    yield from doc.notes(left * (len(report.rows) < len(strategies)))
    yield from report.drawn("sweep", "yields")


@doc.section_of(WHATIF_SECTIONS, "differences", "Differences")
def _differences(report: WhatIfReport) -> Iterator[doc.Block]:
    pairs, first = _pairs(report.result.differences), report.reference.name
    names = {item.name for item in report.rows}
    with_first = [pair for pair in pairs if pair[1] == first and pair[0] in names]
    if not with_first:
        return
    yield _difference_table(with_first, f"Difference with {first} in the same universes")
    if others := [pair for pair in pairs if pair[1] != first]:
        yield doc.Fold(f"All other pairs ({len(others)})", [_difference_table(others, "First less second strategy")])
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
    def hourly(item: StrategyOutcome) -> str:
        return significant(100 * item.planets.mean / item.hours.mean, 2) if item.hours.mean > 0 else MISSING

    def planned(item: StrategyOutcome) -> str:
        reserve = item.schedule.reserve_visits
        return count_text(item.schedule.visits) + (f" + {count_text(reserve)}" if reserve else "")

    def alarms(item: StrategyOutcome) -> str:
        return f"{planets_text(item.noise_alarms.mean)}; {planets_text(item.background_alarms.mean)}"

    columns = [
        doc.own_column("strategy", report.named, look="row left star"),
        doc.own_column("telescope time", "{hours.mean:.0f}\n{hours.survey_low:.0f} to {hours.survey_high:.0f}", "h"),
        doc.own_column("budget", "{time_use.budget_h:.0f}\n{time_use.budget_share:%} %", "h; of the survey"),
        doc.own_column("planets", hourly, "per 100 h"),
        doc.own_column("stars visited", lambda item: str(sum(star.planned_visits > 0 for star in item.targets))),
        doc.own_column("visits planned", planned, "and in reserve"),
        doc.own_column("visits made", lambda item: decimals(_visits_made(item), 1), "mean"),
        doc.own_column("from the bound", lambda item: decimals(100 * item.schedule.distance, 1), "%"),
        doc.own_column("false alarms", alarms, "noise; background"),
        doc.own_column("spent on false alarms", "{time_use.alarm_h:.1f}", "h"),
    ]
    yield doc.Table("Time and cost", columns, report.result.strategies, words.text("texts.whatif_cost"))
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
    columns = [
        doc.own_column("star", "{star:name}", look="row left star"),
        doc.own_column("rank in", lambda change: rank(change.first_rank), reference),
        doc.own_column("rank here", lambda change: rank(change.rank)),
        doc.own_column("why", "{why}", look="left wide"),
    ]
    for name, rows in changes.items():
        made = doc.Table(f"Changes of rank, {name}", columns, rows, f"{name} beside {reference}.")
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

    def corrected(row: tuple[StrategyOutcome, results.ImageSample]) -> str:
        return MISSING if row[1].correction is None else decimals(row[1].correction * row[0].planets.mean, 2)

    columns = [
        doc.own_column("detections", "{1.detections:d}", "sampled"),
        doc.own_column("sequences", "{1.images:d}", "simulated"),
        doc.own_column("expected", "{1.expected:.1f}"),
        doc.own_column("found", "{1.found:d}"),
        doc.own_column("correction", "{1.correction:.2f}\n{1.low:.2f} to {1.high:.2f}"),
        doc.own_column("planets found", corrected, "corrected"),
        doc.own_column("note", "{1.note}", look="left wide"),
        doc.own_column("strategy", lambda row: report.named(row[0]), look="row left star"),
    ]
    yield doc.Table("Confirmed by images", columns, confirmed, words.text("texts.whatif_images"), last_width=24)


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
    columns = doc.row_columns(
        results.SurveyTarget,
        "rank name:row,star v_mag distance_pc bands visit_time_s visit_h planned_visits visits first_utc search_h "
        "follow_up_h alarm_h new_planets known_seen planets_per_100h",
        name=lambda star: doc.lines(pretty_name(star.name), doc.small(", ".join(map(pretty_name, star.known_planets)))),
        distance_pc="{distance_pc:.4g}",
        first_utc=lambda star: star.first_utc or MISSING,
        new_planets=lambda star: planets_text(star.new_planets),
        known_seen=lambda star: planets_text(star.known_seen) if star.known_planets else MISSING,
    )
    caption = words.text("texts.whatif_stars", name=item.name)
    stars = doc.Table(f"Stars of {item.name}", columns, item.targets, caption, look="compact")
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

    columns = [
        doc.own_column("setting", lambda item: doc.code(item.key), look="row left"),
        doc.own_column("value", value),
        doc.own_column("standing", "{confidence}", look="left"),
        doc.own_column("source", "{source}", look="left wide"),
        doc.own_column("strategies", used_by, look="left wide"),
    ]
    caption = words.text("texts.whatif_sources")
    rows = doc.Table("Sources of the settings", columns, result.sources, caption, look="compact")
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
