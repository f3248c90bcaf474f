"""Regenerate this report: ``python -m tools.reports numerics``.

Relative errors of the public closed forms from end to end of their domains, against mpmath with 50 digits at the very
doubles passed, beside the condition number; the questions that undo each other; and every refusal in its own words.
"""

from __future__ import annotations

import argparse
import csv
import io
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import round_trips
from inventory import ELSEWHERE, FORMS, NO_NUMBER, public_names, standing
from matplotlib.figure import Figure
from oracle import ALLOWED, DIGITS, ClosedForm, Point, points, worst
from refusal import answer
from refusals import REFUSALS
from threadpoolctl import threadpool_limits

from cpic_core import write_bytes, write_text
from cpic_planner.report import new_figure, style

HERE = Path(__file__).resolve().parent
FLOOR = 1e-18
GROUPS = {"catalogs": ("#0072B2", "o"), "simulator": ("#D55E00", "s"), "cpic_planner": ("#009E73", "^")}

Measured = list[tuple[ClosedForm, list[Point]]]


def shown(arguments: Sequence[float]) -> str:
    return ", ".join(f"{x:.9g}" for x in arguments)


def results_rows(measured: Measured) -> list[list[object]]:
    """One row per function: the case that comes nearest to what is allowed."""
    rows: list[list[object]] = [
        [
            "function",
            "domain",
            "cases",
            "worst_relative_error",
            "condition_there",
            "error_over_allowed",
            "arguments",
            "largest_relative_error",
        ]
    ]
    for form, found in measured:
        top = worst(found)
        rows.append(
            [
                form.name,
                form.domain,
                len(found),
                f"{top.error:.2e}",
                f"{top.condition:.2e}",
                f"{top.share / form.allowed:.2e}",
                shown(top.arguments),
                f"{max(point.error for point in found):.2e}",
            ]
        )
    return rows


def figure_of(measured: Measured) -> Figure:
    """Every case: relative error against condition number, with what is allowed."""
    figure = new_figure(5.2)
    axes = figure.add_subplot()
    for group, (colour, marker) in GROUPS.items():
        own = [point for form, found in measured if form.name.split(".")[0] == group for point in found]
        condition = np.clip([point.condition for point in own], 1e-3, 1e14)
        error = np.clip([point.error for point in own], FLOOR, 1.0)
        axes.scatter(
            condition, error, s=14, c=colour, marker=marker, alpha=0.6, linewidths=0, label=f"{group} ({len(own)})"
        )
    x = np.geomspace(1e-3, 1e14, 200)
    axes.plot(x, ALLOWED * np.maximum(x, 1.0), color="black", label="allowed: 1e-12 x condition number")
    axes.plot(x, 2.0**-53 * np.maximum(x, 1.0), color="0.5", linestyle="--", label="half a unit in the last place")
    axes.set(
        xscale="log",
        yscale="log",
        xlim=(5e-4, 2e14),
        ylim=(FLOOR / 2, 3.0),
        xlabel="condition number",
        ylabel="relative error (exact results drawn at 1e-18)",
    )
    axes.legend(loc="upper left", fontsize=9)
    axes.grid(alpha=0.3)
    return figure


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return lines + ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]


def report(measured: Measured, trips: dict[str, round_trips.Trips], refused: list[tuple[str, str, str]]) -> str:
    """The report as Markdown."""
    cases = [point for _, found in measured for point in found]
    shares = [worst(found).share / form.allowed for form, found in measured]
    met = sum(share <= 1 for share in shares)
    exported = [(package, name, standing(name, item)) for package, name, item in public_names()]
    functions = {name for _, name, what in exported if what == "measured"}
    magnitudes, distances = (
        ", ".join(f"{x:g}" for x in part) for part in (round_trips.MAGNITUDES, round_trips.DISTANCES_PC)
    )
    answers = [
        (
            name,
            ", ".join(f"{n} {status}" for status, n in sorted(trip.answers.items())),
            f"{trip.worst:.1e}",
            trip.where,
        )
        for name, trip in trips.items()
    ]
    lines = [
        "# Numbers at their extremes",
        "",
        "Regenerate: `python -m tools.reports numerics`. The same cases are tests: `tests/numerics`.",
        "",
        f"{len(FORMS)} closed forms in {len(cases)} cases against mpmath ({DIGITS} digits), at the doubles passed.",
        "The condition number is the sum over the arguments of abs(x f'(x) / f(x)), by mpmath: the factor by which a",
        f"relative error of the arguments grows. Allowed is a relative error of {ALLOWED:g} times the condition",
        f"number, or {ALLOWED:g} where that is below 1. {met} of {len(FORMS)} functions meet it; the worst takes",
        f"{max(shares):.1e} of what is allowed.",
        "",
        "![Relative error against condition number](errors.png)",
        "",
        "What lies beyond the axes is drawn at their edges: at a quarter turn, for one, a coordinate is 0 and its",
        "condition number without bound.",
        "",
        "Functions of two results have a row for each.",
        "",
        *table(
            ("function", "domain", "cases", "worst relative error", "condition there", "error / allowed", "at"),
            [row[:7] for row in results_rows(measured)[1:]],
        ),
        "",
        "## Questions that undo each other",
        "",
        f"One star of each V in {magnitudes} at {distances} pc, contrasts 1e-3 to 1e-15, SNR 1e-6 to 1e6, times 1 to",
        "1e9 s, F520, without drift. Frames are whole and found by search; allowed is a deviation of",
        f"{round_trips.ALLOWED:g}. Every other answer names its reason.",
        "",
        *table(("there and back", "questions", "worst relative deviation", "at"), answers),
        "",
        "## Refusals",
        "",
        f"{len(refused)} calls that are refused, with the line of the refusal.",
        "",
        *table(("function", "arguments", "refusal"), refused),
        "",
        "## Every public name",
        "",
        f"{len(exported)} exported names: {len(functions)} measured above; the others as follows.",
        "",
        *table(("name", "tested in"), sorted({(name, what) for _, name, what in exported if name in ELSEWHERE})),
        "",
        *(f"- {reason}: {', '.join(sorted(set(names)))}." for reason, names in NO_NUMBER.items()),
        "",
    ]
    return "\n".join(lines)


def brief(arguments: Sequence[object]) -> str:
    words = (
        f"array of {item.dtype} {item.shape}" if isinstance(item, np.ndarray) and item.size > 1 else repr(item)
        for item in arguments
        if type(item).__name__ != "Detector"
    )
    return ", ".join(words).replace("\n", " ")


def main() -> None:
    """Measure, draw, write."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    warnings.simplefilter("error")
    with threadpool_limits(1):
        measured = [(form, points(form)) for form in FORMS]
        etc = round_trips.model()
        trips = {
            "time for an SNR, SNR in that time": round_trips.times(etc),
            "contrast in a time, time for that contrast": round_trips.limits(etc),
        }
        refused = [(item.name, brief(item.arguments), answer(item)) for item in REFUSALS]
    warnings.resetwarnings()
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(results_rows(measured))
    write_text(HERE / "results.csv", text.getvalue())
    with style():
        picture = io.BytesIO()
        figure_of(measured).savefig(picture, format="png", dpi=110, metadata={"Software": None})
    write_bytes(HERE / "errors.png", picture.getvalue())
    write_text(HERE / "report.md", report(measured, trips, refused))
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
