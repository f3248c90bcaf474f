"""Tables of the terminal in the forms that other programs read."""

import csv
import io

import astropy.units as u
import pytest
from astropy.table import Table
from rich.console import Console

from cpic_planner.report import Sheet, form_text, print_etc, print_rank
from cpic_planner.report.cells import latex_text
from cpic_planner.version import __version__


@pytest.fixture
def taken(rank):
    sheet = Sheet(Console(file=io.StringIO(), width=80), "csv")
    print_rank(rank, sheet, limit=len(rank.targets))
    return sheet.taken


def test_csv_holds_fields_in_full(rank, taken):
    rows = list(csv.DictReader(io.StringIO(form_text("csv", rank, taken))))
    assert [row["name"] for row in rows] == [target.name for target in rank.targets]
    for row, target in zip(rows, rank.targets, strict=True):
        for name in ("v_mag", "snr", "separation_arcsec", "contrast", "score"):
            value = getattr(target, name)
            assert row[name] == ("" if value is None else repr(value))
        assert row["status"] == target.status


def test_ecsv_reads_back_with_units(rank, taken):
    table = Table.read(form_text("ecsv", rank, taken), format="ascii.ecsv")
    assert str(table["separation_arcsec"].unit) == "arcsec"
    assert len(table) == len(taken[2])
    assert table["n_frames"].dtype.kind == "i"
    assert table["score"].unit == 1 / u.h
    assert table.meta["title"].startswith("Ranking")


def test_latex_is_a_table_that_fits_a_page(rank, taken):
    text = form_text("latex", rank, taken)
    lines = text.splitlines()
    assert lines[0] == r"\begin{table}"
    assert lines[2].startswith(r"\caption{Ranking: ")
    assert f"Date: {rank.date_utc[:10]}" in lines[2] or not rank.date_utc
    assert f"cpic-planner {__version__}.}}" in lines[2]
    assert lines[3] == r"\label{tab:rank}"
    assert lines[4].startswith(r"\begin{tabular}{")
    assert lines[-2:] == [r"\end{tabular}", r"\end{table}"]
    columns = len(lines[4].split("{")[2].rstrip("}"))
    assert 5 < columns < len(taken[1])
    body = [line for line in lines if line.endswith(r"\\")]
    assert len(body) == 1 + len(taken[2])
    assert {line.replace(r"\&", "").count(" & ") + 1 for line in body} == {columns}
    assert "\n".join(lines[4:]).isascii()
    assert not any(mark in text for mark in "✓○□▲→")
    assert len(Table.read("\n".join(lines[4:-1]), format="ascii.latex")) == len(taken[2])


def test_caption_and_label_are_those_that_are_given(rank, taken):
    text = form_text("latex", rank, taken, caption="50 % of α & β", label="tab:mine", columns=("v_mag", "name"))
    lines = text.splitlines()
    assert lines[2] == r"\caption{50 \% of $\alpha$ \& $\beta$}"
    assert lines[3] == r"\label{tab:mine}"
    assert lines[6:8] == [r"V mag & star \\", r"\hline"]


def test_markdown_has_as_many_cells_in_every_line(rank, taken):
    lines = form_text("markdown", rank, taken).splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 2 + len(taken[2])
    assert {line.count("|") for line in table} == {len(taken[1]) + 1}


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("5.16e-08", r"$5.16\times10^{-8}$"),
        ("τ Cet", r"$\tau$ Cet"),
        ("ο² Eri", r"o$^{2}$ Eri"),
        ("HD_1 & 50 %", r"HD\_1 \& 50 \%"),
        ("3 × 17", r"3 $\times$ 17"),
        ("–", r"\ldots{}"),
        ("a\\b", r"a\textbackslash{}b"),
        ("1.2 ± 0.1", r"1.2 $\pm$ 0.1"),
    ],
)
def test_signs_in_latex(text, written):
    assert latex_text(text) == written


def test_a_sheet_takes_the_first_table_alone(etc_answers):
    stream = io.StringIO()
    sheet = Sheet(Console(file=stream, width=120))
    print_etc(etc_answers, sheet)
    text = stream.getvalue()
    assert "→ F520" in text
    assert "Noise in" not in text
    assert "!" not in text
    assert text.count("\n") == 4 + len(etc_answers.answers)
