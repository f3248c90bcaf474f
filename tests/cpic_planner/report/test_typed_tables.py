"""What a table of the terminal becomes in a file: numbers are numbers there, whatever command prints it."""

import io
from functools import partial

import astropy.units as u
import numpy as np
import pandas as pd
import pytest
from astropy.table import Table
from rich.console import Console

from cpic_core import InputError
from cpic_planner.report import (
    Sheet,
    form_text,
    offered_text,
    print_confirm,
    print_etc,
    print_explanation,
    print_plan,
    print_rank,
    print_sensitivity,
    print_whatif,
)
from cpic_planner.report.cells import chosen, offered
from cpic_planner.results import ProgrammeColumns, taken_of

WORDS = {"held_by", "outcome"}
"""Columns without a field of their own, in words for people."""
PRINTERS = {
    "rank": print_rank,
    "etc_answers": print_etc,
    "plan": print_plan,
    "confirmation": print_confirm,
    "sensitivity": print_sensitivity,
    "explanation": print_explanation,
    "strategies": print_whatif,
}


@pytest.fixture
def result(request, compared):
    return compared(["one", "two"]) if request.param == "strategies" else request.getfixturevalue(request.param)


def sheet_of(name, result, form="csv", columns=()):
    stream = io.StringIO()
    sheet = Sheet(Console(file=stream, width=80), form, columns)
    PRINTERS[name](result, sheet)
    return sheet, stream


def each(function):
    return pytest.mark.parametrize(("name", "result"), [(name, name) for name in PRINTERS], indirect=["result"])(
        function
    )


@each
def test_a_column_of_numbers_is_one_of_numbers_in_every_form(name, result):
    taken = sheet_of(name, result)[0].taken
    items = {item.column.name: item for cells in taken[1] for item in cells.taken}
    table = Table.read(form_text("ecsv", result, taken), format="ascii.ecsv")
    frame = pd.read_csv(io.StringIO(form_text("csv", result, taken)))
    assert table.colnames == list(frame.columns) == list(items)
    for key, item in items.items():
        values = [item.value(entry) for entry in taken[2]]
        numeric = item.column.dtype in ("float64", "int64")
        assert numeric == (table[key].dtype.kind in "fi"), key
        assert (table[key].unit or u.dimensionless_unscaled) == u.Unit(item.column.unit), key
        if numeric:
            assert [None if np.ma.is_masked(cell) else cell for cell in table[key]] == values, key
            read = pd.to_numeric(frame[key])
            assert [None if np.isnan(cell) else cell for cell in read.astype(float)] == values, key
    texts = {cells.header for cells in taken[1] if cells.right and all(not item.column.right for item in cells.taken)}
    assert not texts, "columns at the right are numbers for people, and words in files"


@each
def test_any_column_can_be_chosen_in_any_order(name, result):
    taken = sheet_of(name, result)[0].taken
    names = list(offered(taken[1]))
    assert len(names) == len(set(names)) == len(offered_text(taken).splitlines())
    some = names[::-7]
    assert Table.read(form_text("ecsv", result, taken, columns=some), format="ascii.ecsv").colnames == some
    for form in ("csv", "latex", "markdown"):
        assert form_text(form, result, taken, columns=some)
    sheet, stream = sheet_of(name, result, "table", tuple(some))
    lines = stream.getvalue().splitlines()
    cells = [len(str(cell.text(taken[2][0]))) for cell in chosen(taken[1], some)]
    assert max(map(len, lines)) >= sum(cells)
    assert "…" not in lines[-1]
    assert sheet.taken is not None


def test_identifiers_and_places_can_be_chosen(rank):
    taken = sheet_of("rank", rank)[0].taken
    columns = ("name", "hip", "hd", "gj", "ra_deg", "dec_deg", "sp_type", "v_mag", "detection_time_s")
    table = Table.read(form_text("ecsv", rank, taken, columns=columns), format="ascii.ecsv")
    assert tuple(table.colnames) == columns
    assert table["detection_time_s"].unit == u.s
    assert table["ra_deg"].dtype.kind == "f"


@pytest.mark.parametrize(
    ("columns", "said"),
    [(("hpi",), "did you mean hip"), (("name", "name"), "each column once"), (("",), "--columns help")],
)
def test_a_column_that_is_not_there_is_refused_with_the_nearest(rank, columns, said):
    with pytest.raises(InputError, match=said) as refused:
        form_text("csv", rank, sheet_of("rank", rank)[0].taken, columns=columns)
    assert refused.value.key == "--columns"


def test_a_chosen_table_stands_alone(rank):
    text = sheet_of("rank", rank, "table", ("name", "hip"))[1].getvalue()
    head, _, body = text.strip().rpartition("─")
    assert " ".join(head.split("─")[0].split()).endswith("star HIP")
    assert len(body.strip().splitlines()) == len(rank.targets)


@each
def test_results_become_tables_and_frames(name, result):
    table, frame = result.to_table(), result.to_pandas()
    assert table.colnames == list(frame.columns)
    assert len(table) == len(frame) > 0
    assert "<table" in result._repr_html_()
    assert len(repr(result)) < 1200
    for key in table.colnames:
        assert (table[key].dtype.kind in "fi") == (frame[key].dtype.kind in "fi"), key
    if name == "rank":
        assert table["time_s"].unit == u.s
        assert frame["contrast"].tolist() == [row.contrast for row in result.targets]
        assert table.meta["config_hash"] == result.config_hash
    if name == "strategies":
        assert frame["planets"].tolist() == [item.planets.mean for item in result.strategies]
        assert frame["planets_low"].tolist() == [item.planets.low for item in result.strategies]
        assert len(result.to_pandas("differences")) == len(result.differences)


def test_hostile_names_are_text_in_a_notebook(rank):
    row = rank.targets[0].model_copy(update={"name": "<script>alert(1)</script>"})
    assert "<script>" not in rank.model_copy(update={"targets": [row]})._repr_html_()


def test_rows_that_a_result_does_not_have_are_refused(rank):
    with pytest.raises(InputError, match="targets"):
        rank.to_pandas("planets")
    one = rank.targets[0]
    assert one.to_pandas()["name"].tolist() == [one.name]


def test_a_null_column_keeps_its_type():
    """Of a column without any value nothing but the row says what it holds."""
    frame = partial(form_text, "ecsv", ProgrammeColumns())
    rows = [ProgrammeColumns(), ProgrammeColumns()]
    from cpic_planner.report.cells import row_cells

    table = Table.read(frame(("", row_cells(ProgrammeColumns, "visits time_s"), rows)), format="ascii.ecsv")
    assert [table[name].dtype.kind for name in ("visits", "time_s")] == ["i", "f"]
    assert table["time_s"].mask.all()
    assert [item.column.dtype for item in taken_of(ProgrammeColumns, "visits", "time_s")] == ["int64", "float64"]
