"""The report of a comparison of survey strategies: its sections, each an entry of `WHATIF_SECTIONS`."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from catalogs import PLANET_CREDITS, data_credits, split_source
from cpic_core import Registry
from cpic_planner.report import document as doc, numbers, whatif_blocks, whatif_words as words
from cpic_planner.report.drawing import Picture
from cpic_planner.report.figures import WHATIF_FIGURES
from cpic_planner.report.whatif_doubt import doubt_blocks
from cpic_planner.report.whatif_maps import shown_rows
from cpic_planner.report.words import prose, terms
from cpic_planner.results import RankChange, StrategyOutcome, WhatIfResult

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
    first, *others = words.lead_sentences(result)
    named = f": {result.name}" if result.name else ""
    description = f"{result.description}. " if result.description else ""
    return doc.document_of(
        WHATIF_SECTIONS,
        report,
        title=f"CPI-C survey strategies{named}, configuration {result.config_hash}",
        heading=result.name or "Survey strategies",
        about=f"{description}Survey strategies for CPI-C: {words.extent_text(result)}, played in the same "
        f"{numbers.count_text(result.n_universes)} synthetic universes with real stars.",
        summary=[doc.Paragraph(doc.strong(first), "lead"), *(doc.Paragraph(text, "lead") for text in others)],
    )


@doc.section_of(WHATIF_SECTIONS, "strategies", "Strategies")
def _strategies(report: WhatIfReport) -> Iterator[doc.Block]:
    strategies = report.result.strategies
    best = max(strategies, key=lambda item: item.planets.mean)

    def described(item: StrategyOutcome) -> doc.Inline:
        text = item.description if len(strategies) <= _DESCRIBED else ""
        return [report.named(item), doc.small(text) if text else ""]

    def one_survey(item: StrategyOutcome) -> str:
        return f"{item.planets.survey_low:.3g} to {item.planets.survey_high:.3g}"

    def counted(name: str) -> Callable[[StrategyOutcome], doc.Inline]:
        def cell(item: StrategyOutcome) -> doc.Inline:
            estimate = getattr(item, name)
            one = {"planets": words.hanging_text, "new_planets": words.occurrence_text}.get(name, lambda _: "")(item)
            interval = doc.small(words.interval_text(estimate.low, estimate.high))
            return doc.lines(numbers.decimals(estimate.mean, 2), interval, doc.small(one) if one else "")

        return cell

    columns: tuple[doc.Column[StrategyOutcome], ...] = (
        doc.Column("Strategy", described, look="row left described"),
        doc.Column("Planets found", counted("planets"), "new and known", look="wide"),
        doc.Column("One survey", one_survey, "5 to 95 %"),
        doc.Column("New planets", counted("new_planets"), "still allowed"),
        doc.Column("New planets", counted("new_planets_unconditional"), "nothing excluded"),
        doc.Column("Known planets", counted("known_planets")),
        doc.Column("Characterised", counted("characterised_planets")),
        doc.Column("Orbits known", counted("orbits_known")),
        doc.Column("Chance of any", lambda item: numbers.share_text(item.any_planet), "%"),
        doc.Column("Chance of a new one", lambda item: numbers.share_text(item.any_new_planet), "%"),
        doc.Column("Telescope time", lambda item: numbers.decimals(item.hours.mean, 0), "h"),
    )
    caption = (
        "Planets that one survey finds: mean over universes, with the 90 % interval of the mean. One survey: 5 % of "
        "the surveys find fewer, 5 % more. New planets still allowed: those that radial velocities, companion "
        "stars and known giants do not exclude; they are the ones that count. Nothing excluded: what the same visits "
        "would find of the whole population, had nobody looked before. Chance: share of the surveys that find at "
        "least one. The strategy that finds most is shaded."
    )
    yield doc.table("Yields", caption, columns, strategies, picked=lambda item: item is best and best.planets.mean > 0)
    yield from report.drawn("sweep", "yields")


@doc.section_of(WHATIF_SECTIONS, "differences", "Differences")
def _differences(report: WhatIfReport) -> Iterator[doc.Block]:
    pairs, first = whatif_blocks.pairs_of(report.result.differences), report.reference.name
    with_first = [pair for pair in pairs if pair.second == first]
    if not with_first:
        return
    yield whatif_blocks.difference_table(with_first)
    if others := [pair for pair in pairs if pair.second != first]:
        yield doc.Fold(f"All other pairs ({len(others)})", [whatif_blocks.difference_table(others)])
    yield from report.drawn("differences")


@doc.section_of(WHATIF_SECTIONS, "facts", "Which fact moved which number")
def _facts(report: WhatIfReport) -> Iterator[doc.Block]:
    facts = report.result.facts
    if facts is None or not facts.facts:
        return
    yield doc.Paragraph(facts.statement)
    yield from whatif_blocks.fact_tables(report.named, report.result.strategies, facts)


@doc.section_of(WHATIF_SECTIONS, "doubt", "Planned for one value, played under another")
def _doubt(report: WhatIfReport) -> Iterator[doc.Block]:
    found = report.result.doubt
    if found is None:
        return
    yield doc.Paragraph(found.statement)
    yield from report.drawn("doubt")
    yield from doubt_blocks(found)


def _hourly(item: StrategyOutcome) -> str:
    return numbers.significant(100 * item.planets.mean / item.hours.mean, 2) if item.hours.mean > 0 else numbers.MISSING


def _hours(item: StrategyOutcome) -> doc.Inline:
    ends = words.interval_text(item.hours.survey_low, item.hours.survey_high, 0)
    return doc.lines(numbers.decimals(item.hours.mean, 0), doc.small(f"({ends})"))


def _alarms(item: StrategyOutcome) -> str:
    return f"{words.planets_text(item.noise_alarms.mean)}; {words.planets_text(item.background_alarms.mean)}"


def _budget(item: StrategyOutcome) -> doc.Inline:
    return doc.lines(
        numbers.decimals(item.time_use.budget_h, 0), doc.small(f"({numbers.percent_text(item.time_use.budget_share)})")
    )


def _visits(item: StrategyOutcome) -> str:
    reserve = item.schedule.reserve_visits
    return numbers.count_text(item.schedule.visits) + (f" + {numbers.count_text(reserve)}" if reserve else "")


@doc.section_of(WHATIF_SECTIONS, "cost", "Time and cost")
def _cost(report: WhatIfReport) -> Iterator[doc.Block]:
    columns: tuple[doc.Column[StrategyOutcome], ...] = (
        doc.Column("Strategy", report.named, look="row left star"),
        doc.Column("Telescope time", _hours, "h"),
        doc.Column("Budget", _budget, "h; of the survey"),
        doc.Column("Planets", _hourly, "per 100 h"),
        doc.Column("Stars visited", lambda item: str(sum(star.planned_visits > 0 for star in item.targets))),
        doc.Column("Visits planned", _visits, "and in reserve"),
        doc.Column("Visits made", lambda item: numbers.decimals(sum(star.visits for star in item.targets), 1), "mean"),
        doc.Column("From the bound", lambda item: numbers.decimals(100 * item.schedule.distance, 1), "%"),
        doc.Column("False alarms", _alarms, "noise; background"),
        doc.Column("Spent on false alarms", lambda item: numbers.decimals(item.time_use.alarm_h, 1), "h"),
    )
    caption = (
        "Telescope time holds slews, settling and occultations; in brackets the range of single surveys, 5 to 95 %. "
        "From the bound: how far the planned calendar is below what no calendar of such visits can pass. False alarms: "
        "noise and background stars that a survey takes for planets. Spent on them: visits that only false alarms "
        "asked for, where candidates are looked at again."
    )
    yield doc.table("Time and cost", caption, columns, report.result.strategies)
    yield from report.drawn("curves", "time")


@doc.section_of(WHATIF_SECTIONS, "where", "Stars and dates")
def _where(report: WhatIfReport) -> Iterator[doc.Block]:
    yield from report.drawn("calendar", "sky")
    if not any(item.targets for item in report.result.strategies):
        yield doc.Paragraph("No strategy visits a star.")


def _rank_of(rank: int | None) -> str:
    return "not visited" if rank is None else str(rank)


@doc.section_of(WHATIF_SECTIONS, "changes", "Changes of rank")
def _changes(report: WhatIfReport) -> Iterator[doc.Block]:
    changes: dict[str, list[RankChange]] = {}
    for change in report.result.rank_changes:
        changes.setdefault(change.strategy, []).append(change)
    if not changes:
        return
    reference = report.reference.name
    yield doc.Paragraph(
        f"Stars that a strategy ranks elsewhere than {reference} does, by planets found per hour; the largest changes "
        "of each strategy. Planets are those found at the star, mean of a survey."
    )
    columns: tuple[doc.Column[RankChange], ...] = (
        doc.Column("Star", lambda change: numbers.pretty_name(change.star), look="row left star"),
        doc.Column("Rank in", lambda change: _rank_of(change.first_rank), reference),
        doc.Column("Rank here", lambda change: _rank_of(change.rank)),
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
    yield whatif_blocks.image_table(report.named, confirmed)


@doc.section_of(WHATIF_SECTIONS, "details", "Each strategy")
def _details(report: WhatIfReport) -> Iterator[doc.Block]:
    n, shown = len(report.result.strategies), report.shown
    if len(shown) < n:
        most = f"The first strategy and the {len(shown) - 1} that find most; `targets.csv` has the stars of all {n}."
        yield doc.Paragraph(doc.marked(most), "note")
    for item in shown:
        yield doc.Group(
            report.anchors[item.name], item.name, list(whatif_blocks.strategy_blocks(item, report.reference))
        )


@doc.section_of(WHATIF_SECTIONS, "reading", "How to read this")
def _reading(report: WhatIfReport) -> Iterator[doc.Block]:
    yield doc.Items(prose()["reading"])


@doc.section_of(WHATIF_SECTIONS, "assumptions", "Assumptions")
def _assumptions(report: WhatIfReport) -> Iterator[doc.Block]:
    result, reference = report.result, report.reference
    yield doc.Heading("Of all strategies")
    yield doc.Facts([*words.universe_facts(result), *doc.notes_fact(result.notes)])
    others: doc.Inline = ["; the others differ as told under ", doc.link("details", "Each strategy")]
    yield doc.Heading([f"Of {reference.name}", others if len(result.strategies) > 1 else ""])
    yield doc.Facts(words.shared_facts(reference.settings, reference.instrument))
    if not result.sources:
        return
    rows = whatif_blocks.source_table(result.sources, len(result.strategies))
    yield doc.Fold(f"Where these numbers are from ({len(result.sources)})", [rows])


@doc.section_of(WHATIF_SECTIONS, "missing", "What is not modelled")
def _missing(report: WhatIfReport) -> Iterator[doc.Block]:
    left_out = report.result.not_modelled
    yield doc.Items(left_out) if left_out else doc.Paragraph("Nothing is listed.")


@doc.section_of(WHATIF_SECTIONS, "glossary", "Glossary")
def _glossary(report: WhatIfReport) -> Iterator[doc.Block]:
    yield doc.Facts([*prose()["whatif_terms"].items(), *terms(_WORDS)])


@doc.section_of(WHATIF_SECTIONS, "reproduce", "Reproducing this")
def _reproduce(report: WhatIfReport) -> Iterator[doc.Block]:
    result = report.result
    note = (
        "Numbers in full: `whatif.json`; stars of all strategies: `targets.csv`; their calendars, one line a visit: "
        "`visits.csv`, `visits.ecsv`, `visits.json`; every universe, star, detection and orbit: "
        "`universes.parquet`, `stars.parquet`, `detections.parquet`, `orbits.parquet`. Times, host and package "
        "versions of the run: `run.json`."
    )
    yield from doc.reproduced_blocks(result, doc.marked(note), seed=result.universe["seed"])
    shipped = bool(result.known_planets) and split_source(str(result.universe["known_planets"]))[0] != "none"
    yield doc.Items((*data_credits(result.catalogue), *(PLANET_CREDITS if shipped else ()), *prose()["credits"]))
