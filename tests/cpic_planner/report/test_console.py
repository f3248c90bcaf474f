import io

import pytest
from rich.console import Console

from cpic_planner.report.console import print_etc, print_plan, print_rank


def shown(function, *arguments, width=100, **options):
    stream = io.StringIO()
    function(*arguments, Console(file=stream, width=width, highlight=False), **options)
    return stream.getvalue()


@pytest.mark.parametrize("width", [40, 60, 100, 200])
def test_tables_fit_any_width(rank, plan, etc_answers, width):
    for text in (
        shown(print_rank, rank, width=width),
        shown(print_plan, plan, width=width),
        shown(print_etc, etc_answers, width=width),
    ):
        assert max(len(line) for line in text.splitlines()) <= width


def test_rank_at_100_columns_is_one_line_a_star(rank):
    text = shown(print_rank, rank, limit=20)
    lines = [line for line in text.splitlines() if line.strip()[:2].strip().isdigit() and "F" in line]
    assert len([line for line in lines if "F520" in line or "F662" in line]) == 20
    for word in ("dist pc", "sep ″", "contrast", "margin", "status", "speckle floor", "▲ saturated", "α Cen B"):
        assert word in text


def test_rank_limit(rank):
    text = shown(print_rank, rank, limit=3)
    assert "first 3 of 20" in text
    assert "α Cen A" not in text


def test_wide_terminals_show_settings(rank):
    assert "frames × s" in shown(print_rank, rank, width=140)


def test_plan(plan):
    text = shown(print_plan, plan)
    assert "→ F662" in text
    assert "□ inside inner edge" in text
    assert "0.97 ± 0.04" in text


def test_etc(etc_answers):
    text = shown(print_etc, etc_answers)
    assert "τ Cet (HIP 8102): V 3.50 mag, 3.650 pc; wall time for the SNR" in text
    assert "→ F520" in text
    assert "1.42 h" in text
    assert "limits the SNR to 7.1" in text


def test_names_are_not_markup(rank):
    odd = rank.targets[0].model_copy(update={"name": "[bold]x[/bold] [/]"})
    assert "[bold]x[/bold]" in shown(print_rank, rank.model_copy(update={"targets": [odd]}))


def test_terminals_without_unicode_get_question_marks_not_errors(rank, plan, etc_answers):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    console = Console(file=stream, width=100, highlight=False)
    print_rank(rank, console)
    print_plan(plan, console)
    print_etc(etc_answers, console)
    stream.flush()
    assert b"margin" in raw.getvalue()
