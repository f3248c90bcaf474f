"""Names in a result steer no terminal and no reader, whoever writes it: console, forms, files, pages, drawings."""

import base64
import io
import re
import unicodedata
import xml.dom.minidom
from functools import partial

import pytest
from rich.console import Console

from cpic_core import dump_json
from cpic_planner import report
from cpic_planner.report import confirm, ranking, whatif
from cpic_planner.report.confirm import ConfirmReport, confirm_document
from cpic_planner.report.plan import PlanReport, panel_pictures, plan_document, plan_figures
from cpic_planner.report.whatif import WhatIfReport, whatif_document
from cpic_planner.report.writing import page_html

STEERS = "\x1b[31m\x07\x9b1m\u202e\u2066\u2028\x7f\x00α é "
NAMES = {"name", "target", "star", "planet", "scene", "strategy", "reference", "catalogue", "description", "message"}


def named(tree):
    """Put what steers a terminal before every name in plain data."""
    if isinstance(tree, list):
        return [named(item) for item in tree]
    if isinstance(tree, dict):
        return {
            key: STEERS + item if key in NAMES and isinstance(item, str) else named(item) for key, item in tree.items()
        }
    return tree


def renamed(result):
    return type(result).model_validate(named(result.model_dump()))


def steering(text):
    return {sign for sign in text if unicodedata.category(sign) in ("Cc", "Cf", "Zl", "Zp")} - {"\n"}


def check(text):
    """Nothing steers, the names are there as escapes, and ordinary letters as they are."""
    assert steering(text.replace("\r\n", "\n")) == set()
    assert "x1b" in text or "u001b" in text
    assert "α é" in text or r"$\alpha$ é" in text


@pytest.fixture
def printers(rank, plan, confirmation, etc_answers, compared, explanation):
    return {
        "rank": partial(report.rank_blocks, renamed(rank)),
        "explanation": partial(report.explanation_blocks, renamed(explanation)),
        "plan": partial(report.plan_blocks, renamed(plan)),
        "confirm": partial(report.confirm_blocks, renamed(confirmation)),
        "etc": partial(report.etc_blocks, renamed(etc_answers)),
        "whatif": partial(report.whatif_blocks, renamed(compared(["one", "two"]))),
    }


@pytest.mark.parametrize("form", ["table", "csv", "ecsv", "latex", "markdown"])
@pytest.mark.parametrize("name", ["rank", "explanation", "plan", "confirm", "etc", "whatif"])
def test_tables(printers, name, form):
    stream = io.StringIO()
    screen = Console(file=stream, width=200, highlight=False)
    if form == "table":
        report.print_blocks(printers[name](), screen, full=True)
        check(stream.getvalue())
        return
    text = report.form_text(form, printers[name].args[0], report.first_table(printers[name]()))
    assert steering(text.replace("\r\n", "\n")) == set()


def test_files(rank, plan, confirmation, compared):
    check(ranking.ranking_csv(renamed(rank)))
    check(ranking.ranking_ecsv(renamed(rank)))
    check(confirm.measurements_csv(renamed(plan)))
    check(confirm.measurements_csv(renamed(confirmation)))
    check(whatif.targets_csv(renamed(compared(["one", "two"]))))
    check(dump_json(renamed(rank).model_dump(mode="json")))


@pytest.fixture(scope="module")
def page(rank, plan, panels, limits):
    shown, order = renamed(plan), renamed(rank)
    figures = plan_figures(shown, order, limits=limits)
    return page_html(plan_document(PlanReport(shown, order, figures, panel_pictures(shown, panels))))


def test_pages(page, confirmation, compared):
    check(page)
    check(page_html(confirm_document(ConfirmReport(renamed(confirmation), {}, {}))))
    check(page_html(whatif_document(WhatIfReport(renamed(compared(["one", "two"])), {}))))


def test_drawings(page, rank, tmp_path):
    drawings = [base64.b64decode(code) for code in re.findall(r"data:image/svg\+xml;base64,([\w+/=]+)", page)]
    assert drawings
    for drawing in drawings:
        xml.dom.minidom.parseString(drawing)  # which control characters would damage
    path = report.write_figure(report.rank_figure(renamed(rank)), tmp_path / "priorities.svg")
    assert r"\x1b" in path.read_text()
    xml.dom.minidom.parse(str(path))
