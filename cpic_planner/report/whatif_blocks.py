"""Tables of the report of a comparison of survey strategies: differences, images, stars, sources of the settings."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from cpic_planner import results
from cpic_planner.report import document as doc, whatif_words
from cpic_planner.report.numbers import MISSING, count_text, decimals, pretty_name, significant


@dataclass(frozen=True)
class Pair:
    """Differences of two strategies by quantity."""

    first: str
    second: str
    by: dict[str, results.DifferenceRecord]

    def cell(self, quantity: str, places: int) -> doc.Inline:
        """Return the mean of a difference and its interval."""
        item = self.by.get(quantity)
        if item is None:
            return MISSING
        sign = "+" if item.mean > 0 else ""
        return doc.lines(
            f"{sign}{decimals(item.mean, places)}", doc.small(whatif_words.interval_text(item.low, item.high, places))
        )

    @property
    def correlation(self) -> str:
        """How far the planets of both rise and fall together."""
        return decimals(self.by["planets"].correlation, 2) if "planets" in self.by else MISSING

    @property
    def verdict(self) -> doc.Mark | str:
        """Whether the first finds more planets than the second."""
        item = self.by.get("planets")
        if item is None:
            return MISSING
        if item.low > 0:
            return doc.badge("ok", "finds more")
        return doc.badge("invalid", "finds fewer") if item.high < 0 else doc.badge("unreachable", "may be chance")


def pairs_of(differences: Iterable[results.DifferenceRecord]) -> list[Pair]:
    """Return the pairs of strategies that differences are of, in their order."""
    pairs: dict[tuple[str, str], Pair] = {}
    for item in differences:
        pairs.setdefault((item.first, item.second), Pair(item.first, item.second, {})).by[item.quantity] = item
    return list(pairs.values())


_DIFFERENCES: tuple[doc.Column[Pair], ...] = (
    doc.Column("First", lambda pair: pair.first, look="row left star"),
    doc.Column("Second", lambda pair: pair.second, look="left star"),
    doc.Column("Planets found", lambda pair: pair.cell("planets", 3)),
    doc.Column("New planets", lambda pair: pair.cell("new_planets", 3)),
    doc.Column("Characterised", lambda pair: pair.cell("characterised_planets", 3)),
    doc.Column("Orbits known", lambda pair: pair.cell("orbits_known", 3)),
    doc.Column("Telescope time", lambda pair: pair.cell("hours", 0), "h"),
    doc.Column("Correlation", lambda pair: pair.correlation, "planets"),
    doc.Column("Verdict", lambda pair: pair.verdict, look="left"),
)


def difference_table(pairs: Sequence[Pair]) -> doc.Table:
    """Return the differences of some pairs."""
    caption = (
        "First less second strategy, mean a survey with its 90 % interval. Correlation: how far the two rise and fall "
        "together from universe to universe; the nearer to 1, the surer the difference. The verdict is about planets "
        "found, new and known."
    )
    return doc.table("Differences", caption, _DIFFERENCES, pairs)


_COUNTED = {"planets": "Planets found", "new_planets": "New planets", "known_planets": "Known planets"}


def fact_tables(
    named: Callable[[results.StrategyOutcome], doc.Inline],
    strategies: Sequence[results.StrategyOutcome],
    facts: results.FactsRecord,
) -> Iterator[doc.Block]:
    """Yield what strategies find with all facts and without each, a heading and a table for each kind of planets.

    Parameters
    ----------
    named : callable
        Writes the name of a strategy.
    strategies : sequence of StrategyOutcome
    facts : FactsRecord
    """
    rows = {(row.strategy, row.fact): row for row in facts.rows}

    def without(fact: str, quantity: str) -> Callable[[results.StrategyOutcome], doc.Inline]:
        def cell(item: results.StrategyOutcome) -> doc.Inline:
            row: results.FactRow = rows[item.name, fact]
            change = getattr(row, f"{quantity}_change")
            ends = f"({whatif_words.interval_text(change.low, change.high, 3)})"
            sure = change.low > 0.0 or change.high < 0.0
            said = whatif_words.change_text(change.mean)
            mean = decimals(getattr(row, quantity).mean, 2)
            return doc.lines(mean, doc.strong(said) if sure else said, doc.small(ends))

        return cell

    def with_all(quantity: str) -> Callable[[results.StrategyOutcome], doc.Inline]:
        return lambda item: decimals(getattr(item, quantity).mean, 2)

    for quantity, title in _COUNTED.items():
        columns = (
            doc.Column("Strategy", named, look="row left star"),
            doc.Column("With all facts", with_all(quantity)),
            *(doc.Column(fact.heading, without(fact.name, quantity)) for fact in facts.facts),
        )
        caption = (
            f"{title}, mean of a survey. In each column but the first the strategies are planned and played as if that "
            "fact were not known, in the same universes; below the number how much more is found than with all facts, "
            "bold where that is more than chance, with its 90 % interval."
        )
        yield doc.Heading(title)
        yield doc.table(f"{title} without each fact", caption, columns, strategies)


def _correction(images: results.ImageSample) -> doc.Inline:
    ends = "" if images.low is None or images.high is None else whatif_words.interval_text(images.low, images.high)
    return doc.lines(decimals(images.correction, 2), doc.small(ends))


def image_table(
    named: Callable[[results.StrategyOutcome], doc.Inline],
    confirmed: Sequence[tuple[results.StrategyOutcome, results.ImageSample]],
) -> doc.Table:
    """Return what images say of the detections of strategies; ``named`` writes their names."""

    def corrected(row: tuple[results.StrategyOutcome, results.ImageSample]) -> str:
        correction = row[1].correction
        return MISSING if correction is None else decimals(correction * row[0].planets.mean, 2)

    columns: tuple[doc.Column[tuple[results.StrategyOutcome, results.ImageSample]], ...] = (
        doc.Column("Strategy", lambda row: named(row[0]), look="row left star"),
        doc.Column("Detections", lambda row: count_text(row[1].detections), "sampled"),
        doc.Column("Sequences", lambda row: count_text(row[1].images), "simulated"),
        doc.Column("Expected", lambda row: decimals(row[1].expected, 1)),
        doc.Column("Found", lambda row: count_text(row[1].found)),
        doc.Column("Correction", lambda row: _correction(row[1])),
        doc.Column("Planets found", corrected, "corrected"),
        doc.Column("Note", lambda row: row[1].note, look="left wide"),
    )
    caption = (
        "Detections of each strategy that were simulated as images, reduced and measured by the same rule, beside what "
        "the law of the strategy expects of them. Correction: found over expected, with its 90 % interval; the yields "
        "above are not multiplied with it, the last column is."
    )
    return doc.table("Confirmed by images", caption, columns, confirmed)


def _star_columns() -> list[doc.Column[results.SurveyTarget]]:
    return doc.row_columns(
        results.SurveyTarget,
        "rank name:row,star v_mag distance_pc bands visit_time_s visit_h planned_visits visits first_utc search_h "
        "follow_up_h alarm_h new_planets known_seen planets_per_100h",
        name=lambda star: doc.lines(pretty_name(star.name), doc.small(", ".join(map(pretty_name, star.known_planets)))),
        distance_pc=lambda star: significant(star.distance_pc, 4),
        first_utc=lambda star: star.first_utc or MISSING,
        new_planets=lambda star: whatif_words.planets_text(star.new_planets),
        known_seen=lambda star: whatif_words.planets_text(star.known_seen) if star.known_planets else MISSING,
    )


def strategy_blocks(item: results.StrategyOutcome, reference: results.StrategyOutcome) -> Iterator[doc.Block]:
    """Yield what there is to say of one strategy: how it differs from the reference, and its stars."""
    if item.description:
        yield doc.Paragraph(f"{item.description}.")
    if item.name != reference.name:
        differences: list[doc.Inline] = [f"Set as {reference.name} is."]
        if changed := whatif_words.changed_settings(item.settings, reference.settings):
            differences = [f"Set otherwise than in {reference.name}: "]
            for number, (key, own, other) in enumerate(changed, 1):
                differences += [doc.code(key), f" {own} (there {other})", "; " if number < len(changed) else "."]
        yield doc.Paragraph(differences, "note")
    if not item.targets:
        yield doc.Paragraph("No star is visited.")
        return
    caption = (
        f"Stars of {item.name} by planets found per hour of telescope time. A visit: mean of those planned. Visits "
        "made, times and planets: mean of a survey."
    )
    stars = doc.table(f"Stars of {item.name}", caption, _star_columns(), item.targets, look="compact")
    yield doc.Fold(f"Stars ({len(item.targets)})", [stars])


def _value(item: results.SettingSource) -> doc.Inline:
    text = whatif_words.setting_text(item.value, "" if item.unit else item.key)
    return [text, " ", doc.small(item.unit)] if item.unit else text


def source_table(sources: Sequence[results.SettingSource], n_strategies: int) -> doc.Table:
    """Return where settings are from, each for the strategies that have it."""

    def used_by(item: results.SettingSource) -> str:
        return "all" if len(item.strategies) == n_strategies else ", ".join(item.strategies)

    columns: tuple[doc.Column[results.SettingSource], ...] = (
        doc.Column("Setting", lambda item: doc.code(item.key), look="row left"),
        doc.Column("Value", _value),
        doc.Column("Standing", lambda item: item.confidence, look="left"),
        doc.Column("Source", lambda item: item.source, look="left wide"),
        doc.Column("Strategies", used_by, look="left wide"),
    )
    caption = "Settings that were stated with a source. P: published; I: inferred from published or measured numbers; "
    return doc.table("Sources of the settings", f"{caption}A: assumed.", columns, sources, look="compact")
