"""Texts that a spreadsheet would take for a formula are guarded in every table we write, and read back as they were."""

import csv
import io

import pytest

from catalogs import TableBytes, open_catalogue, parse_table
from cpic_core import visible
from cpic_planner.queries.rank import read_star_names
from cpic_planner.ranking.sensitivity import load_ranking
from cpic_planner.report import first_table, form_text, rank_blocks, ranking_csv, ranking_ecsv
from cpic_planner.report.confirm import measurements_csv
from cpic_planner.report.whatif import targets_csv
from cpic_planner.results import PlannedVisitRow, csv_text, ecsv_text, names_of, taken_of, values_of
from cpic_planner.survey.observed import read_log, read_schedule

ATTACKS = ("=cmd|'/C calc'!A1", "+1+1", "@SUM(A1)", "-2+3", "'=1", "\t=1", "\r=1", "-", "+3 %")
NUMBERS = ("-1.5", "+3", "-.5e-3", "42")
FORMULA = ("=", "+", "-", "@", "\t", "\r")


def cells_of(text):
    lines = "".join(line for line in io.StringIO(text, newline="") if not line.startswith("#"))
    return list(csv.reader(io.StringIO(lines, newline="")))


def is_number(text):
    try:
        return float(text) is not None
    except ValueError:
        return False


def no_formula(text):
    """Whether no cell of a table is one."""
    return not [cell for row in cells_of(text) for cell in row if cell.startswith(FORMULA) and not is_number(cell)]


@pytest.fixture
def hostile(rank):
    """The ranking with stars of those names."""
    stars = [
        row.model_copy(update={"name": name, "sp_type": name, "flags": ["=1", "+1"]})
        for row, name in zip(rank.targets * 5, (*ATTACKS, *NUMBERS), strict=False)
    ]
    assert len(stars) == len(ATTACKS) + len(NUMBERS)
    return rank.model_copy(update={"targets": stars})


@pytest.mark.parametrize("ending", ["csv", "ecsv"])
def test_a_ranking_has_no_formula_and_reads_back_as_it_was(hostile, tmp_path, ending):
    text = {"csv": ranking_csv, "ecsv": ranking_ecsv}[ending](hostile)
    assert no_formula(text)
    path = tmp_path / f"ranking.{ending}"
    rows = hostile.targets
    kept = [row for row in rows if ending == "csv" or "\r" not in row.name]  # astropy ends a line there
    again = {"csv": ranking_csv, "ecsv": ranking_ecsv}[ending](hostile.model_copy(update={"targets": kept}))
    path.write_text(again, encoding="utf-8", newline="")
    found = load_ranking(path).rows
    assert [row.flags for row in found] == [row.flags for row in kept]
    assert [row.name for row in found] == [visible(row.name) for row in kept]  # what steers a terminal stands escaped
    assert [row.snr for row in found] == [row.snr for row in kept]


@pytest.mark.parametrize("form", ["csv", "ecsv"])
def test_tables_of_the_terminal_have_none(hostile, form):
    text = form_text(form, hostile, first_table(rank_blocks(hostile, limit=len(hostile.targets))))
    assert no_formula(text)
    assert "'=cmd|" in text


def test_measurements_and_targets_have_none(plan, compared):
    targets = [item.model_copy(update={"name": name}) for item, name in zip(plan.targets, ATTACKS, strict=False)]
    assert no_formula(measurements_csv(plan.model_copy(update={"targets": targets})))
    result = compared()
    strategies = [
        item.model_copy(
            update={
                "name": "=1+1",
                "targets": [star.model_copy(update={"known_planets": ["@b"]}) for star in item.targets],
            }
        )
        for item in result.strategies
    ]
    text = targets_csv(result.model_copy(update={"strategies": strategies}))
    assert no_formula(text)
    assert "'=1+1" in text
    assert "'@b" in text


def test_numbers_stay_as_they_are():
    rows = [{"a": -1.5, "b": -3, "c": text, "d": None, "e": True} for text in NUMBERS]
    assert [row[2] for row in cells_of(csv_text(tuple("abcde"), rows))[1:]] == list(NUMBERS)
    assert cells_of(csv_text(("a", "b", "d", "e"), rows))[1] == ["-1.5", "-3", "", "1"]


def visit(name, **more):
    return PlannedVisitRow.model_construct(
        **{"strategy": "=deep", "star": name, "band": "F520", "exposure_s": 20.0, "frames_per_visit": 10}
        | {"em_gain": 400.0, "visits": 1, "roll_deg": -10.0, "telescope_h": 5.0, "reserve": False, "hip": None}
        | {"start_utc": None, "outcome": None, "planets": None, "reference_library": "same_star_planet_free"}
        | {"window_start_mjd": 61771.0, "window_end_mjd": 61772.0, "dec_deg": -10.0, "ra_deg": 10.0, "visit": 1}
        | {"reason": "search", "window_start_utc": "", "window_end_utc": "", "arcs": 1, "arc_usable_min": 1.0}
        | {"arc_longest_min": 1.0, "quadrants": "all", "reference_ratio": 1.0, "time_s": 1.0, "probability": 0.5}
        | more
    )


@pytest.mark.parametrize("ending", ["csv", "ecsv"])
def test_a_schedule_and_a_log_read_back_as_they_were(tmp_path, ending):
    made = {"start_utc": "2028-02-01T00:00:00", "outcome": "not_detected"}
    names = [name for name in ATTACKS if name == name.strip() and name != "-"]  # what else reading makes plain
    rows = [visit(name) for name in names] + [visit(name, **made) for name in names]
    if ending == "csv":
        text = csv_text(names_of(PlannedVisitRow), map(values_of, rows))
    else:
        text = ecsv_text(taken_of(PlannedVisitRow), rows, {})
    assert no_formula(text)
    path = tmp_path / f"visits.{ending}"
    path.write_text(text, encoding="utf-8")
    visits, about = read_schedule(path, "=deep")
    assert [item.star for item in visits] == names
    assert {item.roll_deg for item in visits} == {-10.0}
    assert "of =deep" in about
    assert sorted(item.star for item in read_log(path).visits) == sorted(names)


@pytest.mark.parametrize("form", ["csv", "ecsv"])
def test_stars_of_ones_own_that_somebody_guarded_have_their_names(tmp_path, form):
    head = "" if form == "csv" else "# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n"
    if form == "ecsv":
        for name in ("name", "v_mag", "distance_pc", "sp_type"):
            head += f"# - {{name: {name}, datatype: {'float64' if '_' in name and name != 'sp_type' else 'string'}}}\n"
    rows = "\"'=HYPERLINK(1)\",5,10,G2V\n'+31 Aql,5,11,K0V\n'Oumuamua,6,12,G5V\n\"''=x\",6,13,G5V\n"
    path = tmp_path / f"stars.{form}"
    path.write_text(f"{head}name,v_mag,distance_pc,sp_type\n{rows}")
    names = open_catalogue(path).table.column("name").tolist()
    assert names == ["=HYPERLINK(1)", "+31 Aql", "'Oumuamua", "'=x"]


def test_apostrophes_of_other_formats_are_theirs():
    """Only tables of text are opened in spreadsheets as they are."""
    text = (
        '<?xml version="1.0"?><VOTABLE version="1.3"><RESOURCE><TABLE><FIELD name="name" datatype="char" '
        'arraysize="*"/><DATA><TABLEDATA><TR><TD>\'=x</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>'
    )
    assert parse_table(TableBytes("x.vot", text.encode(), "")).columns[0].cells.tolist() == ["'=x"]


def test_a_list_of_stars_that_was_cut_out_of_a_table_has_their_names(tmp_path):
    path = tmp_path / "stars.txt"
    path.write_text("'+31 Aql, tau Cet\n'=x  # mine\n'Oumuamua\n")
    assert read_star_names(str(path)) == ("+31 Aql", "tau Cet", "=x", "'Oumuamua")
    assert read_star_names("'=x") == ("'=x",), "what is typed is meant"
