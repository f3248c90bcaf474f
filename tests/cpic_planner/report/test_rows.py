"""A column is one line of one class: names, units and formats of every table come from the row."""

import csv
import io
import json
import pkgutil
from types import SimpleNamespace

import astropy.units as u
import numpy as np
import pytest
from astropy.table import Table
from rich.console import Console

from cpic_planner.report.cells import print_table, row_cells
from cpic_planner.results import (
    EtcAnswer,
    RankedTarget,
    Result,
    Row,
    arrow_schema,
    base,
    column,
    column_of,
    columns_of,
    csv_text,
    ecsv_text,
    names_of,
    planned,
    ranked,
    surveyed,
    taken_of,
    values_of,
)
from cpic_planner.results.base import VOCABULARY, data_frame
from cpic_planner.schemas import RESULTS


class Wider(RankedTarget):
    """A ranked star with one more column."""

    airmass_deg: float | None = column("a new number", label="new", format=".1f", console=True, default=None)


@pytest.fixture(scope="module")
def rows(rank):
    return [Wider(**dict(row), airmass_deg=None if i else 12.34) for i, row in enumerate(rank.targets[:3])]


def test_one_line_of_a_class_is_a_column_everywhere(rows):
    console = Console(file=io.StringIO(), width=120)
    print_table(console, "", row_cells(Wider, "rank name status"), rows)
    head, _, first, second, _ = (line.split() for line in console.file.getvalue().splitlines() if line.strip())
    assert head == ["#", "star", "new", "status"]
    assert "12.3" in first
    assert "–" in second

    page = row_cells(Wider, "rank name contrast", page=True)
    assert [(cell.label, cell.unit) for cell in page] == [("#", ""), ("star", ""), ("new", "deg"), ("contrast", "")]
    assert page[2].text(rows[0]) == "12.3"
    assert "× 10⁻" in page[3].text(rows[0])

    lines = list(csv.DictReader(io.StringIO(csv_text(names_of(Wider), map(values_of, rows)))))
    assert [line["airmass_deg"] for line in lines] == ["12.34", "", ""]

    table = Table.read(ecsv_text(taken_of(Wider), rows, {}), format="ascii.ecsv")
    assert table["airmass_deg"].unit == u.deg
    assert table["airmass_deg"].description == "a new number"
    assert table["airmass_deg"].mask.tolist() == [False, True, True]

    field = arrow_schema(columns_of(Wider)).field("airmass_deg")
    assert (str(field.type), field.metadata[b"unit"]) == ("double", b"deg")

    frame = data_frame(taken_of(Wider), rows)
    assert frame["airmass_deg"].isna().tolist() == [False, True, True]
    assert frame["n_frames"].dtype == "int64"
    assert frame["flags"].tolist() == ["|".join(row.flags) for row in rows]

    assert json.loads(rows[0].model_dump_json())["airmass_deg"] == 12.34
    part = Wider.model_json_schema()["properties"]["airmass_deg"]
    assert (part["title"], part["unit"], part["description"]) == ("new", "deg", "a new number")


def test_cells_of_a_row_that_is_not_there_are_dashes(rows):
    """Also of null whole numbers, which stay whole in a frame."""
    cells = row_cells(RankedTarget, "name v_mag", of=lambda pair: pair[1])
    assert [cell.text((1, None)) for cell in cells] == ["–", "–"]
    without = rows[0].model_copy(update={"n_frames": None})
    assert data_frame(taken_of(Wider), [rows[0], without])["n_frames"].dtype == "Int64"


def every_row():
    """All rows that leave the program."""
    found, new = set(), {Row}
    while new:
        new = {child for parent in new for child in parent.__subclasses__()} - found
        found |= new
    return sorted((row for row in found if row.__module__.startswith("cpic_planner.")), key=lambda row: row.__name__)


@pytest.mark.parametrize("row", every_row(), ids=lambda row: row.__name__)
def test_units_are_units_and_stand_in_the_names(row):
    """A number with a unit says so in its name, and astropy reads what the files say."""
    suffixes = {u.s: "_s", u.h: "_h", u.deg: "_deg", u.arcsec: "_arcsec", u.AU: "_au", u.pc: "_pc", u.d: "day"}
    for item in columns_of(row):
        unit = u.Unit(item.unit)
        if unit in suffixes:
            assert suffixes[unit] in item.name, item.name
        if item.unit:
            assert item.dtype in ("float64", "int64"), item.name


@pytest.mark.parametrize(
    ("row", "name", "dtype", "unit", "heading"),
    [
        (RankedTarget, "completeness_per_hour", "float64", "1/h", "completeness per hour"),
        (RankedTarget, "luminosity_lsun", "float64", "solLum", "luminosity lsun"),
        (RankedTarget, "hip", "int64", "", "HIP"),
        (RankedTarget, "flags", "string", "", "flags"),
        (EtcAnswer, "status", "string", "", "status"),
        (EtcAnswer, "separation_arcsec", "float64", "arcsec", "sep ″"),
        (planned.BandConfirmation, "detected", "bool", "", "detected"),
        (planned.BandConfirmation, "audit", "", "", "audit"),
        (surveyed.SurveyTarget, "slots", "string", "", "slots"),
        (ranked.KnownPlanetRow, "mass_mjup", "", "M_jup", "M_J"),
    ],
)
def test_type_unit_and_heading(row, name, dtype, unit, heading):
    found = column_of(row, name)
    assert (found.dtype, found.unit, found.heading) == (dtype, unit, heading)


def test_what_the_vocabulary_says_is_said_once():
    """Every word of the vocabulary is a field of some result, and no result repeats its meaning."""
    results, new = set(), {Result}
    while new:
        new = {child for parent in new for child in parent.__subclasses__()} - results
        results |= new
    mine = [item for item in results if item.__module__.startswith("cpic_planner.")]
    for word, told in VOCABULARY.items():
        having = [item for item in mine if word in item.model_fields]
        assert having, word
        for item in having:
            assert item.model_fields[word].description != told.description or not told.description, (word, item)


def test_schemas_state_meaning_and_unit_of_shared_words():
    for kind in map(pkgutil.resolve_name, RESULTS.values()):
        definitions = kind.model_json_schema().get("$defs", {})
        for part in definitions.values():
            sep = part.get("properties", {}).get("separation_arcsec")
            assert sep is None or sep.get("unit") == "arcsec"


def test_results_are_frozen_and_strict():
    assert base.Result.model_config["frozen"]
    with pytest.raises(ValueError, match="extra"):
        planned.AuditRecord(unknown=1)


def test_a_row_is_made_of_the_attributes_of_others():
    """First source first; places in arrays; what is not finite is null where it may be."""

    class Made(Row):
        name: str
        share: float
        limit: float | None
        counts: list[int]
        said: str = "as it was"

    columns = SimpleNamespace(name=np.array(["a", "b"]), share=np.array([0.1, 0.2]), limit=np.array([1.0, np.inf]))
    other = SimpleNamespace(share=0.9, counts=np.array([[1], [2]]))
    assert Made.of(columns, other, at=1) == Made(name="b", share=0.2, limit=None, counts=[2])
    assert Made.of(columns, other, at=0, share=0.5, said="new").model_dump() == {
        "name": "a",
        "share": 0.5,
        "limit": 1.0,
        "counts": [1],
        "said": "new",
    }
    endless = SimpleNamespace(name="a", share=np.inf, limit=1.0, counts=[])
    with pytest.raises(ValueError, match="finite"):
        Made.of(endless)
