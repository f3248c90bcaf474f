"""What a table of the terminal becomes in a file: numbers are numbers there, whatever command prints it."""

import csv
import io
import json
import pkgutil
from types import SimpleNamespace

import astropy.units as u
import numpy as np
import pandas as pd
import pytest
from astropy.table import Table
from rich.console import Console

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.report import chosen, first_table, form_text, offered_text, print_table, ranking_csv, ranking_ecsv
from cpic_planner.report.confirm import MEASUREMENT_COLUMNS, measurements_csv
from cpic_planner.report.document import (
    Table as DocumentTable,
    cell,
    cell_text,
    files_of,
    name_shown,
    row_columns,
    unit_shown,
)
from cpic_planner.report.whatif import targets_csv
from cpic_planner.report.writing import latex_text, offered, table_on_page
from cpic_planner.results import (
    EtcAnswer,
    ProgrammeColumns,
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
from cpic_planner.version import __version__


def lines(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_csv_holds_every_row_in_full_precision(rank):
    rows = lines(ranking_csv(rank))
    assert len(rows) == len(rank.targets)
    assert tuple(rows[0]) == names_of(RankedTarget)
    for row, target in zip(rows, rank.targets, strict=True):
        assert float(row["contrast"]) == target.contrast
        assert row["name"] == target.name
        assert row["flags"] == "|".join(target.flags)
        assert row["hip"] == ("" if target.hip is None else str(target.hip))
    assert rows[-1]["exposure_s"] == ""
    assert "\r" not in ranking_csv(rank)


def test_ecsv_round_trip_with_units_descriptions_and_masks(rank):
    text = ranking_ecsv(rank)
    assert text.startswith("# %ECSV 1.0")
    table = Table.read(text, format="ascii.ecsv")
    assert tuple(table.colnames) == names_of(RankedTarget)
    units = {name: table[name].unit for name in table.colnames if table[name].unit}
    assert len(units) == 24
    assert (units["visit_time_s"], units["unused_s"], units["required_time_s"]) == (u.s, u.s, u.s)
    assert units["span_days"] == u.day
    assert units["rv_amplitude_m_s"].to_string() == "m / s"
    assert units["v_mag"] == u.mag
    assert units["ref_planet_distance_au"] == u.AU
    assert units["completeness_per_hour"] == 1 / u.h
    assert units["score"] == 1 / u.h
    assert units["luminosity_lsun"] == u.L_sun
    for one in columns_of(RankedTarget):
        assert table[one.name].description == (one.description or None)
    assert table["contrast"].tolist() == [row.contrast for row in rank.targets]
    assert [str(name) for name in table["name"]] == [row.name for row in rank.targets]
    assert table["time_s"].mask.tolist() == [row.time_s is None for row in rank.targets]
    assert table["hip"].mask.tolist() == [row.hip is None for row in rank.targets]
    assert table.meta["time_s"] == rank.time_s
    assert table.meta["reference_planet"]["albedo"] == "jupiter"
    assert table.meta["score_name"] == "completeness_per_hour"
    assert table.meta["population"]["n_planets"] == 4000


@pytest.mark.parametrize("writer", [ranking_csv, ranking_ecsv])
def test_the_same_text_twice_and_a_head_without_rows(rank, writer):
    assert writer(rank) == writer(rank)
    text = writer(rank.model_copy(update={"targets": []}))
    assert text.splitlines()[-1].split(",") == list(names_of(RankedTarget))


def test_a_measurement_for_each_target_and_band(plan):
    table = lines(measurements_csv(plan))
    assert [(row["target"], row["band"]) for row in table] == [
        (target.name, band.band) for target in plan.targets for band in target.bands
    ]
    assert tuple(table[0]) == MEASUREMENT_COLUMNS
    assert [row["band"] for row in table if row["chosen"] == "1"] == ["F662", "F662"]
    first, outside = table[0], table[3]
    assert float(first["recovered_snr_error"]) == plan.targets[0].bands[0].recovered_snr_error
    assert first["detected"] == "1"
    assert first["audit_hits"] == ""
    assert table[1]["audit_hits"] == "444"
    assert (outside["status"], outside["recovered_snr"]) == ("outside_field", "")


def test_a_scene_has_its_planets_and_no_choice(confirmation):
    table = lines(measurements_csv(confirmation))
    assert len(table) == 5
    assert {row["planet"] for row in table} == {"c", "<script>alert('x')</script>"}
    assert {(row["target"], row["hip"], row["chosen"]) for row in table} == {("a scene", "", "")}


def test_every_star_of_every_strategy_has_a_line(compared):
    result = compared()
    rows = lines(targets_csv(result))
    pairs = [(item.name, target) for item in result.strategies for target in item.targets]
    assert [(row["strategy"], row["name"]) for row in rows] == [(name, target.name) for name, target in pairs]
    for row, (_, target) in zip(rows, pairs, strict=True):
        assert float(row["new_planets"]) == target.new_planets
        assert float(row["visit_time_s"]) == target.visit_time_s
        assert row["slots"] == ";".join(map(str, target.slots))
        assert row["bands"] == "F520;F662"
        assert row["known_planets"] == ";".join(target.known_planets)
    assert targets_csv(compared(empty=True)).splitlines() == [",".join(rows[0])]


WORDS = {"held_by", "outcome"}
"""Columns without a field of their own, in words for people."""
ANSWERS = {
    "rank": report.rank_blocks,
    "etc_answers": report.etc_blocks,
    "plan": report.plan_blocks,
    "confirmation": report.confirm_blocks,
    "sensitivity": report.sensitivity_blocks,
    "explanation": report.explanation_blocks,
    "strategies": report.whatif_blocks,
}


@pytest.fixture
def result(request, compared):
    return compared(["one", "two"]) if request.param == "strategies" else request.getfixturevalue(request.param)


def table_of(name, result):
    return first_table(ANSWERS[name](result))


def shown(blocks, width=100, encoding="utf-8"):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    report.print_blocks(blocks, Console(file=stream, width=width, highlight=False), full=True)
    stream.flush()
    return raw.getvalue().decode(encoding)


def each(function):
    return pytest.mark.parametrize(("name", "result"), [(name, name) for name in ANSWERS], indirect=["result"])(
        function
    )


@each
@pytest.mark.parametrize("width", [40, 60, 100, 200])
def test_tables_fit_any_width_and_any_terminal(name, result, width):
    for encoding in ("utf-8", "ascii"):
        assert max(map(len, shown(ANSWERS[name](result), width, encoding).splitlines())) <= width


def test_names_are_no_markup_and_bars_are_bars(rank, etc_answers):
    odd = rank.targets[0].model_copy(update={"name": "[bold]x[/bold] [/]"})
    assert "[bold]x[/bold]" in shown(report.rank_blocks(rank.model_copy(update={"targets": [odd]})))
    assert 24 * "█" in shown(report.etc_blocks(etc_answers))
    assert 24 * "#" in shown(report.etc_blocks(etc_answers), encoding="ascii")


@pytest.mark.parametrize("width", [80, 100, 120, 160, 190, 230])
def test_rank_keeps_what_matters_at_any_width(rank, width):
    head = shown(report.rank_blocks(rank), width).splitlines()[1]
    wanted = {
        80: "% per h compl % known % blind % status",
        100: "visits band",
        120: "margin",
        160: "V mag dist pc contrast sep ″",
        190: "in visit wall",
        230: "gain frames × s",
    }
    for at, words in wanted.items():
        assert width < at or all(word in head for word in words.split()), (at, head)


@each
def test_a_column_of_numbers_is_one_of_numbers_in_every_form(name, result):
    shown = table_of(name, result)
    items = {item.name: item for column in shown.columns if "page" not in column.look for item in files_of(column)}
    table = Table.read(form_text("ecsv", result, shown), format="ascii.ecsv")
    frame = pd.read_csv(io.StringIO(form_text("csv", result, shown)))
    assert table.colnames == list(frame.columns) == list(items)
    for key, item in items.items():
        values = [item.value(entry) for entry in shown.entries]
        numeric = item.dtype in ("float64", "int64")
        assert numeric == (table[key].dtype.kind in "fi"), key
        assert (table[key].unit or u.dimensionless_unscaled) == u.Unit(item.unit), key
        if numeric:
            assert [None if np.ma.is_masked(cell) else cell for cell in table[key]] == values, key
            read = pd.to_numeric(frame[key])
            assert [None if np.isnan(cell) else cell for cell in read.astype(float)] == values, key
    columns = [column for column in shown.columns if "page" not in column.look]
    texts = {one.heading for one in columns if one.right and all(not item.right for item in files_of(one))}
    assert not texts, "columns at the right are numbers for people, and words in files"


@each
def test_any_column_can_be_chosen_in_any_order(name, result):
    table = table_of(name, result)
    names = list(offered(table.columns))
    assert len(names) == len(set(names)) == len(offered_text(table).splitlines())
    some = names[::-7]
    assert Table.read(form_text("ecsv", result, table, columns=some), format="ascii.ecsv").colnames == some
    for form in ("csv", "latex", "markdown"):
        assert form_text(form, result, table, columns=some)
    console = Console(file=io.StringIO(), width=80)
    print_table(chosen(table, some), console, chosen=True)
    lines = console.file.getvalue().splitlines()
    cells = [len(cell_text(column, table.entries[0])) for column in chosen(table, some).columns]
    assert max(map(len, lines)) >= sum(cells)
    assert "…" not in lines[-1]


def test_identifiers_and_places_can_be_chosen(rank):
    columns = ("name", "hip", "hd", "gj", "ra_deg", "dec_deg", "sp_type", "v_mag", "detection_time_s")
    table = Table.read(form_text("ecsv", rank, table_of("rank", rank), columns=columns), format="ascii.ecsv")
    assert tuple(table.colnames) == columns
    assert table["detection_time_s"].unit == u.s
    assert table["ra_deg"].dtype.kind == "f"


@pytest.mark.parametrize(
    ("columns", "said"),
    [(("hpi",), "did you mean hip"), (("name", "name"), "each column once"), (("",), "--columns help")],
)
def test_a_column_that_is_not_there_is_refused_with_the_nearest(rank, columns, said):
    with pytest.raises(InputError, match=said) as refused:
        form_text("csv", rank, table_of("rank", rank), columns=columns)
    assert refused.value.key == "--columns"


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
    shown = DocumentTable("", row_columns(ProgrammeColumns, "visits time_s"), [ProgrammeColumns(), ProgrammeColumns()])
    table = Table.read(form_text("ecsv", ProgrammeColumns(), shown), format="ascii.ecsv")
    assert [table[name].dtype.kind for name in ("visits", "time_s")] == ["i", "f"]
    assert table["time_s"].mask.all()
    assert [item.dtype for item in taken_of(ProgrammeColumns, "visits", "time_s")] == ["int64", "float64"]


def test_columns_stand_where_the_row_says():
    assert names_of(RankedTarget)[:5] == ("rank", "rank_in_catalogue", "score", "name", "hip")
    assert names_of(EtcAnswer)[-5:] == ("roll_deg", "exposure_limited_by", "gain_limited_by", "dominant", "flags")
    measured = ("pa_deg", "exposure_s", "visits", "reference_visits", "frames_per_visit", "n_frames", "em_gain")
    assert names_of(planned.BandConfirmation)[6:13] == measured
    assert len(set(names_of(planned.BandConfirmation))) == len(names_of(planned.BandConfirmation))


class Wider(RankedTarget):
    """A ranked star with one more column."""

    airmass_deg: float | None = column("a new number", label="new", format=".1f", console=True, default=None)


@pytest.fixture(scope="module")
def rows(rank):
    return [Wider(**dict(row), airmass_deg=None if i else 12.34) for i, row in enumerate(rank.targets[:3])]


def test_one_line_of_a_class_is_a_column_everywhere(rows):
    text = shown([DocumentTable("", row_columns(Wider, "rank name status"), rows)])
    head, _, first, second, *_ = (line.split() for line in text.splitlines() if line.strip())
    assert head == ["#", "star", "new", "status"]
    assert "12.3" in first
    assert "–" in second

    columns = row_columns(Wider, "rank name contrast")
    heads = [(name_shown(one), unit_shown(one)) for one in columns]
    assert heads == [("#", ""), ("Star", ""), ("New", "deg"), ("Contrast", "")]
    assert cell(columns[2], rows[0]) == "12.3"
    page = table_on_page(DocumentTable("Stars", columns, rows))
    assert "× 10⁻" in page["rows"][0][1][3][0]

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
    columns = row_columns(RankedTarget, "name v_mag", of=lambda pair: pair[1])
    assert [cell(column, (1, None)) for column in columns] == ["–", "–"]
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


@pytest.fixture
def taken(rank):
    return first_table(report.rank_blocks(rank, limit=len(rank.targets)))


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
    assert 5 < columns < len(taken.columns)
    body = [line for line in lines if line.endswith(r"\\")]
    assert len(body) == 1 + len(taken.entries)
    assert {line.replace(r"\&", "").count(" & ") + 1 for line in body} == {columns}
    assert "\n".join(lines[4:]).isascii()
    assert not any(mark in text for mark in "✓○□▲→")
    assert len(Table.read("\n".join(lines[4:-1]), format="ascii.latex")) == len(taken.entries)


def test_caption_and_label_are_those_that_are_given(rank, taken):
    text = form_text("latex", rank, taken, caption="50 % of α & β", label="tab:mine", columns=("v_mag", "name"))
    lines = text.splitlines()
    assert lines[2] == r"\caption{50 \% of $\alpha$ \& $\beta$}"
    assert lines[3] == r"\label{tab:mine}"
    assert lines[6:8] == [r"V mag & star \\", r"\hline"]


def test_markdown_has_as_many_cells_in_every_line(rank, taken):
    lines = form_text("markdown", rank, taken).splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 2 + len(taken.entries)
    assert {line.count("|") for line in table} == {len(taken.columns) + 1}


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


def test_a_template_writes_fields_of_records_and_of_tuples(rank):
    star = rank.targets[0].model_copy(update={"snr": None})
    for text, written in {
        "{name:name}": "α Cen B",
        "{snr:.3g}": "–",
        "{v_mag:.1f} mag\n{snr:.3g} SNR": "1.3 mag",
        "{v_mag:.1f} mag\n{distance_pc:.2f} pc": "1.3 mag (1.25 pc)",
    }.items():
        assert cell_text(report.own_column("", text), star) == written
    assert cell_text(report.own_column("", "{0.v_mag:.1f} of {1}"), (star, "x")) == "1.3 of x"
    assert cell_text(report.own_column("", "{1.v_mag:.1f}"), (star, None)) == "–"
