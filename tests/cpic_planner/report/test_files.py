"""Tables of the terminal in the forms that other programs read."""

import csv
import io

import pytest
from rich.console import Console

from cpic_planner.report import Sheet, form_text, print_etc, print_rank
from cpic_planner.report.files import latex_text


@pytest.fixture
def taken(rank):
    sheet = Sheet(Console(file=io.StringIO(), width=80), "csv")
    print_rank(rank, sheet, limit=len(rank.targets))
    return sheet.taken


def test_csv_holds_fields_with_four_digits(rank, taken):
    rows = list(csv.DictReader(io.StringIO(form_text("csv", *taken))))
    assert [row["name"] for row in rows] == [target.name for target in rank.targets]
    for row, target in zip(rows, rank.targets, strict=True):
        assert float(row["v_mag"]) == pytest.approx(target.v_mag, rel=1e-3)
        for name in ("snr", "separation_arcsec", "contrast"):
            value = getattr(target, name)
            if value is None:
                assert row[name] == ""
                continue
            assert float(row[name]) == pytest.approx(value, rel=6e-4)
            digits = row[name].split("e")[0].replace(".", "").replace("-", "").strip("0")
            assert len(digits) <= 4
        assert row["status"] == target.status


def test_ecsv_reads_back_with_units(taken):
    from astropy.table import Table

    text = form_text("ecsv", *taken)
    table = Table.read(text, format="ascii.ecsv")
    assert str(table["separation_arcsec"].unit) == "arcsec"
    assert len(table) == len(taken[2])
    assert table["n_frames"].dtype.kind == "i"
    assert table.meta["title"].startswith("Ranking")


def test_latex_is_a_plain_tabular(taken):
    text = form_text("latex", *taken)
    lines = text.splitlines()
    assert lines[0].startswith("% Ranking")
    assert lines[1].startswith(r"\begin{tabular}{")
    assert lines[-1] == r"\end{tabular}"
    columns = len(lines[1].split("{")[2].rstrip("}"))
    body = [line for line in lines if line.endswith(r"\\")]
    assert len(body) == 1 + len(taken[2])
    assert {line.replace(r"\&", "").count(" & ") + 1 for line in body} == {columns}
    assert text.isascii() or "\n".join(lines[1:]).isascii()
    assert not any(mark in text for mark in "✓○□▲→")


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


def test_markdown_has_as_many_cells_in_every_line(taken):
    lines = form_text("markdown", *taken).splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 2 + len(taken[2])
    assert {line.count("|") for line in table} == {len(taken[1]) + 1}


def test_a_sheet_takes_the_first_table_alone(etc_answers):
    stream = io.StringIO()
    sheet = Sheet(Console(file=stream, width=120))
    print_etc(etc_answers, sheet)
    text = stream.getvalue()
    assert "→ F520" in text
    assert "Noise in" not in text
    assert "!" not in text
    assert text.count("\n") == 4 + len(etc_answers.answers)
