"""Regenerate this report: ``python reports/doubt/make.py`` (about three minutes on a quiet core).

Which strategy to take while nobody knows the drift of the wavefront: the default strategies are planned for four
drifts, and every plan is played under each of them. ``--run FOLDER`` takes the numbers of a finished
``cpic whatif survey_default --no-facts --doubt drift=0.02nm,0.05nm,0.1nm,0.2nm --out FOLDER``; ``--words`` writes the
page anew from the numbers beside this file.
"""

from __future__ import annotations

import argparse
import base64
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import write_text
from cpic_planner.report.drawing import BAND_STYLE, Picture, new_figure, save, style
from cpic_planner.report.whatif_doubt import doubt_figure
from cpic_planner.results import ChangeRecord, DoubtCell, DoubtChoice, DoubtRecord, WhatIfResult
from cpic_planner.survey import load_strategies, run_whatif, with_doubt, with_universe

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results.json"
DRIFTS = "drift=0.02nm,0.05nm,0.1nm,0.2nm"
NOMINAL = "0.05 nm"
COMMAND = f"cpic whatif survey_default --no-facts --images 0 --doubt {DRIFTS}"


def measured(folder: Path) -> dict[str, Any]:
    """Return the numbers of a run in a folder; it is made where it is not finished."""
    made = folder / "whatif.json"
    if not made.exists():
        config = with_doubt(with_universe(load_strategies(), {"facts": False}), DRIFTS)
        run_whatif(config, folder, pages=False)
    result = WhatIfResult.model_validate_json(made.read_text(encoding="utf-8"))
    assert result.doubt is not None
    return {"doubt": result.doubt.model_dump(), "n_universes": result.n_universes}


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in lines)


def signed(value: float, places: int = 3) -> str:
    """A number with its sign."""
    return f"{value:+.{places}f}".replace("-", "−")


class Table:
    """Cells of a record by plan and value."""

    def __init__(self, record: DoubtRecord) -> None:
        self.record = record
        self.texts = [value.text for value in record.values]
        self.weights = np.array([value.weight for value in record.values])
        self.strategies = [item.strategy for item in record.of_strategies]
        self._cells = {(item.strategy, item.planned_for, item.played_under): item for item in record.cells}

    def cell(self, strategy: str, planned_for: str, played_under: str) -> DoubtCell:
        """One cell."""
        return self._cells[strategy, planned_for, played_under]

    def told(self, item: DoubtCell, change: ChangeRecord) -> str:
        """A regret in words."""
        knew = self.cell(item.strategy, item.played_under, item.played_under)
        return (
            f"{item.strategy} planned for {item.planned_for}, played under {item.played_under}: "
            f"{signed(change.mean)} ± {change.error:.3f}, in {item.hours:.0f} h instead of {knew.hours:.0f} h"
        )

    def cautious(self, texts: Sequence[str]) -> tuple[DoubtChoice, float]:
        """The plan whose largest loss is smallest where only some values can be true, and that loss."""
        largest = [
            max(self.cell(item.strategy, item.planned_for, text).loss.mean for text in texts)
            for item in self.record.choices
        ]
        best = int(np.argmin(largest))
        return self.record.choices[best], largest[best]

    def off_diagonal(self) -> list[DoubtCell]:
        """Plans played under a value that they were not made for."""
        return [item for item in self.record.cells if item.planned_for != item.played_under]


def in_errors(change: ChangeRecord) -> float:
    """A change in its standard errors; 0 where nothing differs in any universe."""
    return change.mean / max(change.error, 1e-12) if change.mean else 0.0


def lines_figure(found: Table) -> Picture:
    """Draw planets against the true drift, and the intervals with and without the doubt."""
    drift = [float(text.split()[0]) for text in found.texts]
    record = found.record
    with style():
        figure = new_figure(4.4)
        left, right = figure.subplots(1, 2)
        for row, (item, (colour, marker)) in enumerate(zip(record.of_strategies, BAND_STYLE, strict=False)):
            name, planned = item.strategy, item.cautious.planned_for
            known = [found.cell(name, text, text).planets for text in found.texts]
            kept = [found.cell(name, planned, text).planets for text in found.texts]
            errors = [[one.mean - one.low for one in known], [one.high - one.mean for one in known]]
            look = {"color": colour, "marker": marker, "ms": 5, "lw": 1.4, "elinewidth": 1, "capsize": 2}
            left.errorbar(drift, [one.mean for one in known], yerr=errors, label=name, **look)
            left.plot(drift, [one.mean for one in kept], color=colour, ls="--", lw=1.2)
            plan = next(
                one for one in record.choices if (one.strategy, one.planned_for) == (name, item.expected.planned_for)
            )
            nominal = found.cell(name, NOMINAL, NOMINAL).planets
            for shift, low, middle, high, width in (
                (-0.15, nominal.low, nominal.mean, nominal.high, 7.0),
                (0.15, plan.low, plan.planets, plan.high, 1.6),
            ):
                right.plot([low, high], [row + shift] * 2, color=colour, lw=width, solid_capstyle="butt")
                right.plot([middle], [row + shift], marker="|", color="black", ms=9, mew=1.2)
        left.set_xscale("log")
        left.set_xticks(drift, found.texts)
        left.minorticks_off()
        left.set_xlabel("drift that turns out to be true")
        left.set_ylabel("planets found in a survey")
        left.set_ylim(0.0, None)
        left.grid(visible=True)
        right.set_yticks(range(len(found.strategies)), found.strategies)
        right.invert_yaxis()
        right.set_xlim(0.0, None)
        right.set_xlabel("mean planets of a survey")
        right.grid(visible=True, axis="x")
        handles, texts = left.get_legend_handles_labels()
        figure.legend(handles, texts, loc="outside upper center", ncols=len(texts))
        return save(figure, alt="Planets against the true drift, and intervals.", caption="")


def write_picture(name: str, picture: Picture) -> None:
    """Write a figure beside this file."""
    (HERE / name).write_bytes(base64.b64decode(picture.uri.partition(",")[2]))


def decision_part(found: Table, n_universes: int) -> list[str]:
    """What to take, and what every plan finds."""
    record, safe = found.record, found.record.decision.cautious
    rows = []
    for item in record.choices:
        cells = [found.cell(item.strategy, item.planned_for, text) for text in found.texts]
        shown = [
            f"**{cell.planets.mean:.2f}**"
            if cell.loss.mean == 0.0
            else f"{cell.planets.mean:.2f} (−{cell.loss.mean:.3f} ± {cell.loss.error:.3f})"
            for cell in cells
        ]
        worst = f"{item.largest_loss:.3f} at {item.largest_loss_under}" if item.largest_loss > 0.0 else "0"
        rows.append([item.strategy, item.planned_for, *shown, worst, f"{item.planets:.2f}"])
    head = ["strategy", "planned for", *(f"drift {text}" for text in found.texts), "largest loss", "by the weights"]
    weights = ", ".join(f"{text} {100 * w:.0f} %" for text, w in zip(found.texts, found.weights, strict=True))
    losing = [
        cell for text in found.texts if (cell := found.cell(safe.strategy, safe.planned_for, text)).loss.mean > 0.0
    ]
    where = "; ".join(
        f"{cell.loss.mean:.3f} ± {cell.loss.error:.3f} where it is {cell.played_under}" for cell in losing
    )
    hours = ", ".join(
        f"{found.cell(safe.strategy, safe.planned_for, text).hours:.0f} h at {text}" for text in found.texts
    )
    missing = [item.name for item in load_strategies().strategies if item.name not in found.strategies]
    without = f" Not played here: {', '.join(missing)}." if missing else ""
    at_least = []
    for first in range(1, len(found.texts) - 1):
        left = found.texts[first:]
        plan, loss = found.cautious(left)
        at_least.append(f"not below {left[0]}: {plan.strategy} planned for {plan.planned_for}, at most {loss:.3f}")
    return [
        f"# Which strategy to take while the drift is not known\n\n{record.statement}",
        f"What the cautious plan loses, in planets a survey: {where or 'nothing'}. Telescope time that it uses of its "
        f"1752 h: {hours}.",
        "The choice hangs on the lowest drift: it is there that plans differ most. The cautious plan and its largest "
        f"loss if the drift is surely {'; '.join(at_least)}.",
        f"Mean planets (new and known) of a survey of ten years, {n_universes} universes (`{COMMAND}`). A row is a "
        "calendar with its frames, made for one drift; a column plays it under one drift, in the same universes. Bold: "
        "the best plan of the column; in brackets what a plan loses against that, with its paired standard error. "
        f"Weights of the drifts: {weights}, {record.weights_from}. Drift is the offset of a visit; the walk within it "
        f"changes in the same ratio.{without}",
        table(head, rows),
        "![what each plan finds and loses under each drift](losses.svg)",
    ]


def settled_part(found: Table) -> list[str]:
    """Each strategy by itself, and intervals with and without the doubt."""
    record = found.record
    rows = [
        [
            item.strategy,
            item.cautious.planned_for,
            f"{item.cautious.largest_loss:.3f} at {item.cautious.largest_loss_under}"
            if item.cautious.largest_loss > 0.0
            else "0",
            item.expected.planned_for,
            f"{item.expected.planets:.2f}",
            f"{item.value_of_knowing.mean:.3f} ({item.value_of_knowing.low:.3f} to {item.value_of_knowing.high:.3f})",
        ]
        for item in record.of_strategies
    ]
    knowing = record.decision.value_of_knowing
    rows.append(
        [
            "free choice",
            f"{record.decision.cautious.strategy}, {record.decision.cautious.planned_for}",
            f"{record.decision.cautious.largest_loss:.3f} at {record.decision.cautious.largest_loss_under}",
            f"{record.decision.expected.strategy}, {record.decision.expected.planned_for}",
            f"{record.decision.expected.planets:.2f}",
            f"{knowing.mean:.3f} ({knowing.low:.3f} to {knowing.high:.3f})",
        ]
    )
    head = ["strategy", "cautious: plan for", "its largest loss", "by weights: plan for", "planets"]
    parts = [
        "## If the strategy is settled",
        "Which drift to plan each strategy for; losses are those against its own best plan. Worth of knowing: planets "
        "more a survey if the drift is measured before the plan is made, with its 90 % interval. It is chosen as the "
        "largest of the same means that it is made of, and so is rather too large than too small.",
        table([*head, "worth of knowing the drift"], rows),
        "## With and without the doubt about the drift",
        f"Planned and played at the instrument's {NOMINAL}, the number of universes alone makes the interval of the "
        "mean. With the doubt the mean is that over the weights of the drifts, for the plan that then finds most, and "
        "the range holds 90 % of the weight. One survey: 5 to 95 % of single surveys.",
    ]
    rows = []
    for item in record.of_strategies:
        nominal, mixed = found.cell(item.strategy, NOMINAL, NOMINAL).planets, item.expected
        rows.append(
            [
                item.strategy,
                f"{nominal.mean:.2f} ({nominal.low:.2f} to {nominal.high:.2f})",
                f"{nominal.survey_low:.0f} to {nominal.survey_high:.0f}",
                f"{mixed.planets:.2f} ({mixed.low:.2f} to {mixed.high:.2f}), planned for {mixed.planned_for}",
                f"{mixed.survey_low:.0f} to {mixed.survey_high:.0f}",
            ]
        )
    head = ["strategy", f"mean at {NOMINAL}, 90 % interval", "one survey", "mean with the doubt, 5 to 95 %"]
    parts += [
        table([*head, "one survey"], rows),
        "![planets against the true drift, and intervals with and without the doubt](drift.svg)",
        "Left: planets against the true drift; solid with the drift known before the plan is made (90 % intervals), "
        "dashed with the cautious plan of the strategy. Right: thick, mean and interval at the instrument's drift; "
        "thin, with the doubt.",
    ]
    return parts


def regret_part(found: Table) -> list[str]:
    """Regret against the same strategy planned for the truth: the criterion."""
    rows = []
    for name in found.strategies:
        for planned in found.texts:
            row = [name, planned]
            for text in found.texts:
                cell = found.cell(name, planned, text)
                same = planned == text
                shown = "0" if same else f"{signed(cell.regret.mean)} ± {cell.regret.error:.3f}"
                row.append(f"{shown}, {cell.hours:.0f} h")
            rows.append(row)
    others = found.off_diagonal()

    def below(name: str) -> str:
        changes = [(item, getattr(item, name)) for item in others]
        low = [found.told(item, change) for item, change in changes if in_errors(change) < -2.0]
        lowest = min(in_errors(change) for _, change in changes)
        counted = f"{len(low) or 'None'} of {len(others)} {'are' if len(low) > 1 else 'is'} below −2 standard errors"
        return f"{counted}, the lowest at {signed(lowest, 1)}{': ' if low else ''}{'; '.join(low)}."

    return [
        "## Regret against the same strategy",
        "What a plan would have gained had it been made for the drift of the column, in what the scheduler counts: a "
        "planet 1 (of known_planets_first a known one 3), less `min_gain`, 0.001, a visit, for it plans no visit that "
        "is worth less. With its paired standard error, and the telescope time that the plan uses. A number below 0 "
        f"says that a plan made for another drift does better than that made for the true one. {below('regret')}",
        table(["strategy", "planned for", *(f"drift {text}" for text in found.texts)], rows),
        "Without the price of a visit, in planets alone, a plan made for a better instrument may find more than that "
        "made for the true one, because it goes on where the other stops: it spends time on visits that find less "
        f"than one planet in a thousand. {below('regret_of_planets')} Whoever has the hours may lower `min_gain`; the "
        "scheduler chose as it was told.",
    ]


LEFT_OUT = """## What is left out

- Visits and frames stay as planned. A team would know the drift after the first visits and plan the rest anew
  (`--observed`): losses are upper ends of what a team that looks at its data would lose.
- Only the drift is in doubt here. Contrast, throughput and dust move all plans at once; `--doubt` takes them one at a
  time.
- Four values stand for the law of the drift: the lowest one for everything below it, where more would be found.
- Plans are made for the same four values: one made for a drift between them may lose less.
- Weights are those of an assumed law; the cautious choice does not use them.
- False alarms follow the true instrument, and cost what the strategies say that they cost."""


def report(kept: dict[str, Any]) -> str:
    """The page."""
    found = Table(DoubtRecord.model_validate(kept["doubt"]))
    parts = decision_part(found, kept["n_universes"]) + settled_part(found) + regret_part(found)
    return "\n\n".join([*parts, LEFT_OUT, "Regenerate with `python reports/doubt/make.py`."]) + "\n"


def main() -> None:
    """Measure, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, help="folder of a finished run")
    parser.add_argument("--words", action="store_true", help="write the page anew, measure nothing")
    asked = parser.parse_args()
    if not asked.words:
        with tempfile.TemporaryDirectory() as scratch:
            kept = measured(asked.run or Path(scratch))
        write_text(RESULTS, json.dumps(kept, indent=1) + "\n")
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))
    record = DoubtRecord.model_validate(kept["doubt"])
    losses = doubt_figure(WhatIfResult.model_construct(doubt=record))
    assert losses is not None
    write_picture("losses.svg", losses)
    write_picture("drift.svg", lines_figure(Table(record)))
    write_text(HERE / "report.md", report(kept))


if __name__ == "__main__":
    main()
