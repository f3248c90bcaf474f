"""Plans under doubt in the report of a comparison: what each finds under each value, and what it loses."""

from collections.abc import Callable, Iterator

import numpy as np

from cpic_planner.report import document as doc
from cpic_planner.report.drawing import Picture, literal, new_figure, save, style
from cpic_planner.report.numbers import decimals, share_text
from cpic_planner.report.whatif_maps import MOST_ROWS, row_label
from cpic_planner.report.whatif_words import interval_text
from cpic_planner.results import DoubtCell, DoubtChoice, DoubtDecision, DoubtRecord, WhatIfResult

_DARK, _ROOM = 0.4, 34.0


def _plan(item: DoubtChoice) -> str:
    return f"{item.strategy}, for {item.planned_for}"


def doubt_blocks(found: DoubtRecord) -> Iterator[doc.Block]:
    """Yield the table of all plans under all values, and what to take where one strategy is settled."""
    cells = {(cell.strategy, cell.planned_for, cell.played_under): cell for cell in found.cells}
    what = found.quantity.replace("_", " ")

    def under(text: str, shown: Callable[[DoubtCell], doc.Inline]) -> Callable[[DoubtChoice], doc.Inline]:
        return lambda item: shown(cells[item.strategy, item.planned_for, text])

    def planets(cell: DoubtCell) -> doc.Inline:
        loss = "best" if cell.loss.mean == 0.0 else f"loses {decimals(cell.loss.mean, 3)}"
        ends = "" if cell.loss.mean == 0.0 else f"({interval_text(cell.loss.low, cell.loss.high, 3)})"
        mean = decimals(cell.planets.mean, 2)
        return doc.lines(doc.strong(mean) if cell.loss.mean == 0.0 else mean, doc.small(loss), doc.small(ends))

    def regret(cell: DoubtCell) -> doc.Inline:
        if cell.planned_for == cell.played_under:
            return doc.lines("0", doc.small(f"{decimals(cell.hours, 0)} h"))
        sign = "+" if cell.regret.mean > 0.0 else ""
        error = doc.small(f"± {decimals(cell.regret.error, 3)}")
        return doc.lines(f"{sign}{decimals(cell.regret.mean, 3)}", error, doc.small(f"{decimals(cell.hours, 0)} h"))

    def alone(item: DoubtChoice) -> doc.Inline:
        own = cells[item.strategy, item.planned_for, item.planned_for].planets
        survey = f"{own.survey_low:.3g} to {own.survey_high:.3g}"
        return doc.lines(interval_text(own.low, own.high), doc.small(survey))

    def mixed(item: DoubtChoice) -> doc.Inline:
        survey = f"{item.survey_low:.3g} to {item.survey_high:.3g}"
        return doc.lines(interval_text(item.low, item.high), doc.small(survey))

    chosen = {(item.strategy, item.planned_for) for item in (found.decision.cautious, found.decision.expected)}
    columns: tuple[doc.Column[DoubtChoice], ...] = (
        doc.Column("Plan", _plan, look="row left star"),
        *(
            doc.Column(f"{found.key} {value.text}", under(value.text, planets), f"weight {share_text(value.weight)} %")
            for value in found.values
        ),
        doc.Column("Largest loss", lambda item: decimals(item.largest_loss, 3), "planets"),
        doc.Column("Mean", lambda item: decimals(item.planets, 2), "by the weights"),
        doc.Column("If as planned", alone, "mean; one survey"),
        doc.Column("With the doubt", mixed, "mean; one survey"),
    )
    caption = (
        f"Each row is a calendar with its frames, made for one value of {found.key}; each column plays it under one "
        f"value, in the same universes: {what} found, mean of a survey; below it how many fewer than the best plan "
        "finds there, with the 90 % interval. Visits and frames stay as planned, although a team would know the value "
        "after the first visits. The last two columns: interval of the mean (90 %), and below it of one survey (5 to "
        f"95 %), if {found.key} is what the plan was made for, by the number of universes alone; and with the doubt "
        f"about it. Weights: {found.weights_from}. Shaded: the cautious choice, and that of most by the weights."
    )

    def picked(item: DoubtChoice) -> bool:
        return (item.strategy, item.planned_for) in chosen

    yield doc.table("Plans under doubt", caption, columns, found.choices, look="compact", picked=picked)
    if len(found.of_strategies) > 1:
        yield doc.Heading("If the strategy is settled")
        yield _settled(found)
    regrets: tuple[doc.Column[DoubtChoice], ...] = (
        doc.Column("Plan", _plan, look="row left star"),
        *(doc.Column(f"{found.key} {value.text}", under(value.text, regret)) for value in found.values),
    )
    caption = (
        "What the same strategy would have gained had it been planned for the value of the column, in what its "
        "scheduler counts: value_new and value_known a planet, less min_gain a visit, for which it plans no visit that "
        "is worth less. With its standard error, and the telescope time that the plan uses. Below 0 by more than "
        "chance: the plan made for another value does better than that made for the true one."
    )
    yield doc.Fold(
        "Regret against the same strategy", [doc.table("Regret", caption, regrets, found.choices, look="compact")]
    )


def _settled(found: DoubtRecord) -> doc.Table:
    """Return what to plan for, strategy by strategy."""

    def loss(item: DoubtDecision) -> str:
        one = item.cautious
        return f"{decimals(one.largest_loss, 3)} at {one.largest_loss_under}" if one.largest_loss > 0.0 else "0"

    def knowing(item: DoubtDecision) -> doc.Inline:
        worth = item.value_of_knowing
        ends = doc.small(interval_text(worth.low, worth.high, 3))
        return doc.lines(decimals(worth.mean, 3), ends)

    columns: tuple[doc.Column[DoubtDecision], ...] = (
        doc.Column("Strategy", lambda item: item.strategy, look="row left star"),
        doc.Column("Cautious", lambda item: item.cautious.planned_for, "planned for"),
        doc.Column("Its largest loss", loss, "planets"),
        doc.Column("Most by weights", lambda item: item.expected.planned_for, "planned for"),
        doc.Column("Mean", lambda item: decimals(item.expected.planets, 2), "by the weights"),
        doc.Column("Worth of knowing", knowing, "planets"),
    )
    caption = (
        f"Which value of {found.key} to plan each strategy for. Losses are those against the best plan of the same "
        "strategy. Worth of knowing: planets more a survey where the value is known before the plan is made."
    )
    return doc.table("Settled strategies", caption, columns, found.of_strategies)


def doubt_figure(result: WhatIfResult) -> Picture | None:
    """Draw what every plan loses under every value; none where no number is in doubt."""
    found = result.doubt
    if found is None:
        return None
    best = sorted(range(len(found.choices)), key=lambda i: (found.choices[i].largest_loss, i))
    rows = [found.choices[i] for i in sorted(best[:MOST_ROWS])]
    texts = [value.text for value in found.values]
    cells = {(cell.strategy, cell.planned_for, cell.played_under): cell for cell in found.cells}
    own = [[cells[item.strategy, item.planned_for, text] for text in texts] for item in rows]
    losses = np.array([[cell.loss.mean for cell in row] for row in own])
    most = max(float(losses.max()), 1e-3)
    chosen = {"cautious": found.decision.cautious, "most": found.decision.expected}
    with style():
        figure = new_figure(1.6 + 0.29 * len(rows))
        axes = figure.subplots()
        drawn = axes.imshow(losses, aspect="auto", cmap="cividis_r", vmin=0.0, vmax=most)
        for y, (row, item) in enumerate(zip(own, rows, strict=True)):
            for x, cell in enumerate(row):
                text = f"{decimals(cell.planets.mean, 2)}  (−{decimals(cell.loss.mean, 3)})"
                text = f"{decimals(cell.planets.mean, 2)}  best" if cell.loss.mean == 0.0 else text
                colour = "white" if cell.loss.mean > _DARK * most else "black"
                axes.text(x, y, text, ha="center", va="center", fontsize=min(8.5, _ROOM / len(texts)), color=colour)
            names = [
                name
                for name, one in chosen.items()
                if (one.strategy, one.planned_for) == (item.strategy, item.planned_for)
            ]
            if names:
                axes.text(len(texts) - 0.45, y, ", ".join(names), va="center", fontsize=9.5, fontweight="bold")
            if y and item.strategy != rows[y - 1].strategy:
                axes.axhline(y - 0.5, color="white", lw=3.0)
        axes.set_yticks(range(len(rows)), [row_label(_plan(item)) for item in rows])
        axes.set_xticks(range(len(texts)), [literal(text) for text in texts])
        axes.set_xlabel(literal(f"{found.key} that turns out to be true"))
        axes.set_ylabel("plan")
        axes.tick_params(length=0)
        figure.colorbar(drawn, ax=axes, pad=0.12, label="planets fewer than the best plan")
        what = found.quantity.replace("_", " ")
        hidden = len(found.choices) - len(rows)
        return save(
            figure,
            alt=f"Loss of {len(rows)} plans under {len(texts)} values of {found.key}.",
            caption=f"Each row is a plan made for one value of {found.key}, each column the value that turns out to be "
            f"true: {what} found in a survey, and in brackets how many fewer than the best plan finds there. The "
            "cautious plan is that whose largest loss is the smallest; the plan marked most finds most by the weights."
            f"{f' Plans that lose more, not shown: {hidden}.' if hidden else ''}",
        )
