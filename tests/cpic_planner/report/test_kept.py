"""Whole answers, on a terminal and as pages, are those that were kept; with ``CPIC_KEEP=1`` they are kept anew."""

import io
import os
import re
from pathlib import Path

import pytest
from rich.console import Console

from cpic_planner import report
from cpic_planner.ranking.sensitivity import Ranking, compare_rankings
from cpic_planner.report.confirm import ConfirmReport, confirm_document
from cpic_planner.report.plan import PlanReport, plan_document
from cpic_planner.report.whatif import WhatIfReport, whatif_document
from cpic_planner.report.writing import page_html

KEPT = Path(__file__).with_name("kept")


def on_terminal(blocks, width=120):
    console = Console(file=io.StringIO(), width=width, highlight=False)
    report.print_blocks(blocks, console, full=True)
    return "\n".join(line.rstrip() for line in console.file.getvalue().splitlines())


@pytest.fixture
def answers(rank, plan, etc_answers, confirmation, sensitivity, explanation, compared):
    first, second, *others = rank.targets
    places = [second.model_copy(update={"rank": 1}), first.model_copy(update={"rank": 2}), *others]
    swapped = rank.model_copy(update={"targets": places, "time_s": 2.0 * rank.time_s})
    moved = compare_rankings(Ranking.of(rank, "[old].json"), Ranking.of(swapped, "new"))
    return {
        "etc": lambda: on_terminal(report.etc_blocks(etc_answers, every_budget=True, explain=True)),
        "rank": lambda: on_terminal(report.rank_blocks(rank), 230),
        "explanation": lambda: on_terminal(report.explanation_blocks(explanation), 160),
        "sensitivity": lambda: on_terminal(report.sensitivity_blocks(sensitivity)),
        "moves": lambda: on_terminal(report.move_blocks(moved, limit=2)),
        "plan": lambda: on_terminal(report.plan_blocks(plan), 160),
        "confirm": lambda: on_terminal(report.confirm_blocks(confirmation), 160),
        "whatif": lambda: on_terminal(report.whatif_blocks(compared(["one", "two", "three"]))),
    }


@pytest.fixture
def pages(rank, plan, confirmation, sensitivity, compared):
    return {
        "plan-page": plan_document(PlanReport(plan, rank, {}, {}, sensitivity)),
        "confirm-page": confirm_document(ConfirmReport(confirmation, {}, {})),
        "whatif-page": whatif_document(WhatIfReport(compared(), {})),
    }


def check(name, text):
    path = KEPT / f"{name}.txt"
    text = re.sub(r"cpic-planner \d[\w.+]*", "cpic-planner VERSION", text) + "\n"
    if os.environ.get("CPIC_KEEP"):
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["etc", "rank", "explanation", "sensitivity", "moves", "plan", "confirm", "whatif"])
def test_on_a_terminal(name, answers):
    check(name, answers[name]())


@pytest.mark.parametrize("name", ["plan-page", "confirm-page", "whatif-page"])
def test_as_a_page(name, pages):
    text = re.sub(r"(?s)<(script|style)\b.*?</\1>", " ", page_html(pages[name]))
    words = re.sub(r"</(tr|p|h\d|li|div|caption|summary|figcaption)>", "\n", text)
    lines = (" ".join(re.sub(r"<[^>]*>", " ", line).split()) for line in words.splitlines())
    check(name, "\n".join(line for line in lines if line))
