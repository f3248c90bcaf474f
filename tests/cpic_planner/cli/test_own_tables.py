"""Tables of a user's own as commands read them: what is left out, listed and refused, and what travels along."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from cpic_planner import load_targets, rank_targets
from cpic_planner.cli.command import REJECTS_ENDINGS
from cpic_planner.ranking import MOST_OWN
from cpic_planner.results import RankedTarget, RankResult

STARS = """Name,plx [mas],Vmag,SpT,ra,dec,mood,rank
mine,273.8,3.5,G8V,26,-15,fine,7
HD 20794,165.5,4.26,G8V,50,-43,,8
broken,abc,8.5,G2V,1,1,=sad,9
no V,100,,G2V,1,1,sad,9
mine,50,6,G2V,1,1,sad,9
"""
PLANETS = """pl_name,hostname,pl_orbper,pl_orbsmax,pl_bmassj,pl_bmassprov,colour
tau Cet x,tau Cet,1000,1.8,1,Mass,red
tau Cet y,tau Cet,long,1.8,1,Mass,red
"""
REASONS = {
    ("broken", "plx [mas]", "abc mas", "row left out"),
    ("no V", "Vmag", "missing", "row left out"),
    ("mine", "Name", "mine", "row left out"),
}
SMALL = {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}
QUICK = ("--band", "F520", "--planets", "50")


@pytest.fixture
def stars(tmp_path):
    (tmp_path / "mine.csv").write_text(STARS)
    return str(tmp_path / "mine.csv")


@pytest.fixture
def planets(tmp_path):
    (tmp_path / "pl.csv").write_text(PLANETS)
    return str(tmp_path / "pl.csv")


def told(out):
    """Return the tables of ``cpic catalog columns --json`` by kind, and the use of each column by its heading."""
    tables = {table["taken_as"]: table for table in json.loads(out)["tables"]}
    return tables, {kind: {row["heading"]: row for row in table["columns"]} for kind, table in tables.items()}


def test_columns_of_a_file_are_told_before_any_work(done, stars):
    out, err = done("catalog", "columns", stars, "--json")
    assert err == "", "what is told is the answer"
    tables, columns = told(out)
    assert list(tables) == ["stars"]
    assert (tables["stars"]["n_rows"], tables["stars"]["n_usable"]) == (5, 2)
    own = columns["stars"]
    assert {heading: row["quantity"] for heading, row in own.items()} == {
        "Name": "name",
        "plx [mas]": "parallax_mas",
        "Vmag": "v_mag",
        "SpT": "sp_type",
        "ra": "ra_deg",
        "dec": "dec_deg",
        "mood": "",
        "rank": "",
    }
    assert (own["plx [mas]"]["unit"], own["plx [mas]"]["unit_assumed"]) == ("mas", False)
    assert (own["Vmag"]["unit"], own["Vmag"]["unit_assumed"]) == ("mag", True)
    assert own["mood"]["reason"] == "not known"
    assert own["Vmag"]["reason"] == ""
    found = {(row["name"], row["column"], row["value"], row["done"]) for row in tables["stars"]["left_out"]}
    assert found == REASONS
    assert [row["count"] for row in tables["stars"]["left_out"]] == [1, 1, 1]
    text = " ".join(done("catalog", "columns", stars)[0].split())
    for words in ("2 of 5 rows can be used", "plx [mas] parallax_mas mas", "Vmag v_mag mag (assumed)", "--catalog"):
        assert words in text
    assert "mood not used – heading not known" in text
    assert "row left out 1 Vmag row 4 (no V): missing allowed: a number, -1.5 to 25 mag" in text


def test_a_unit_of_the_file_is_none_that_is_assumed(done, tmp_path):
    (tmp_path / "t.csv").write_text("name,d,v_mag,sp_type\nBob,10,5,G2V\n")
    assert told(done("catalog", "columns", tmp_path / "t.csv", "--json")[0])[1]["stars"]["d"]["unit_assumed"] is True
    text = "# %ECSV 1.0\n# ---\n# datatype:\n" + "".join(
        f"# - {{name: {name}, {rest}datatype: {kind}}}\n"
        for name, rest, kind in (
            ("name", "", "string"),
            ("d", "unit: lyr, ", "float64"),
            ("v_mag", "unit: mag, ", "float64"),
            ("sp_type", "", "string"),
        )
    )
    (tmp_path / "t.ecsv").write_text(f"{text}name d v_mag sp_type\nBob 32.6 5 G2V\n")
    row = told(done("catalog", "columns", tmp_path / "t.ecsv", "--json")[0])[1]["stars"]["d"]
    assert (row["quantity"], row["unit"], row["unit_assumed"]) == ("distance_pc", "lyr", False)


def test_conventions_of_columns_are_said_in_words(done, tmp_path):
    text = "star,planet,per,perr1,perr2,mass\ntau Cet,tau Cet x,1000,1,-1,1\n".replace("perr1", "pl_orbpererr1")
    (tmp_path / "p.csv").write_text(text.replace("perr2", "pl_orbpererr2").replace("per,", "pl_orbper,", 1))
    own = told(done("catalog", "columns", tmp_path / "p.csv", "--json")[0])[1]["planets"]
    assert own["pl_orbpererr1"]["quantity"] == "period_err_days"
    assert own["pl_orbpererr1"]["convention"].startswith("upper error")


def test_a_file_that_can_be_both_is_said_as_both(call, done, tmp_path):
    path = tmp_path / "both.csv"
    path.write_text(
        "pl_name,hostname,pl_orbper,pl_bmassj,pl_bmassprov,st_teff,sy_dist,sy_vmag\na b,a,9,1,Mass,5900,9,5\n"
    )
    out, _ = done("catalog", "columns", path, "--json")
    assert list(told(out)[0]) == ["stars", "planets"]
    assert "can be read both as stars and as planets" in done("catalog", "columns", path)[0]
    for kind in ("stars", "planets"):
        assert list(told(done("catalog", "columns", path, "--as", kind, "--json")[0])[0]) == [kind]
    (tmp_path / "stars.csv").write_text("name,distance_pc,v_mag,sp_type\nBob,10,5,G2V\n")
    status, out, err = call("catalog", "columns", tmp_path / "stars.csv", "--as", "planets")
    assert (status, out, err.count("\n")) == (2, "", 1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,distance_pc,v_mag,sp_type\nBob,ten,5,G2V\n", ["column distance_pc", "ten"]),
        ("name,distance_pc,v_mag,colour\nBob,10,5,red\n", ["sp_type or teff_k", "missing"]),
        ("planet,period,mass\nx b,long,1\n", ["column period", "long"]),
    ],
)
def test_a_file_of_which_nothing_can_be_used_is_refused(refuses, tmp_path, text, words):
    (tmp_path / "x.csv").write_text(text)
    refuses(["catalog", "columns", tmp_path / "x.csv"], ["x.csv", *words])


def test_strict_refuses_a_file_whichever_kind_it_is(refuses, done, tmp_path, stars, planets):
    refuses(["catalog", "columns", stars, "--strict"], ["mine.csv row 3 (broken) column plx [mas]", "abc"])
    refuses(["catalog", "columns", planets, "--strict"], ["pl.csv row 2", "pl_orbper", "long"])
    (tmp_path / "good.csv").write_text("name,distance_pc,v_mag,sp_type,own\nBob,10,5,G2V,x\n")
    done("catalog", "columns", tmp_path / "good.csv", "--strict")


@pytest.mark.parametrize("option", ["--strict", "--as=stars", "--rejects=r.csv"])
def test_options_of_a_file_need_one(refuses, option):
    refuses(["catalog", "columns", option], [option.partition("=")[0], "only with a FILE"])


def rejected(path):
    """Return the rows of a file of rejects as texts, read by others than us."""
    if path.suffix == ".parquet":
        import pyarrow.parquet as pq

        return [{name: str(cell) for name, cell in row.items()} for row in pq.read_table(path).to_pylist()]
    if path.suffix == ".ecsv":
        from astropy.table import Table

        return [{n: str(row[n]) for n in row.colnames} for row in Table.read(path, format="ascii.ecsv")]
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.mark.parametrize("ending", REJECTS_ENDINGS)
@pytest.mark.parametrize("of", ["columns", "etc"])
def test_rejects_are_written_in_every_form(done, tmp_path, stars, ending, of):
    path = tmp_path / f"rejects{ending}"
    asked = {"columns": ["catalog", "columns", stars], "etc": ["etc", "mine", "--catalog", stars, "--band", "F520"]}
    _, err = done(*asked[of], "--rejects", path)
    assert f"wrote 3 rows to {path}" in err
    rows = rejected(path)
    assert list(rows[0]) == ["table", "row", "name", "column", "value", "reason", "done"]
    assert {(row["name"], row["column"], row["value"], row["done"]) for row in rows} == REASONS
    assert [row["row"] for row in rows] == ["3", "4", "5"]
    assert {row["table"] for row in rows} == {"mine.csv"}


# Every command that takes a table, in the cheapest way that opens it.
COMMANDS = {
    "rank": ("rank", "--catalog", "STARS", *QUICK),
    "explain": ("rank", "--catalog", "STARS", *QUICK, "--explain", "mine"),
    "sensitivity": ("rank", "--catalog", "STARS", *QUICK, "--sensitivity"),
    "compare": ("rank", "--catalog", "STARS", *QUICK, "--compare", "as_published"),
    "etc": ("etc", "mine", "--catalog", "STARS", "--band", "F520"),
    "visibility": ("visibility", "mine", "--catalog", "STARS", "--days", "3"),
    "curve": ("curve", "mine", "--catalog", "STARS", "--band", "F520", "--separation-arcsec", "0.5"),
    "roc": ("roc", "mine", "--catalog", "STARS", "--band", "F520", "--separation-arcsec", "0.5"),
    "known": ("known", "tau Cet", "--known-planets", "PLANETS", "--band", "F520", "--planets", "20"),
    "known of planets": ("etc", "tau Cet x", "--known-planets", "none+PLANETS", "--band", "F520"),
}
DRY = {
    "plan": ("plan", "--catalog", "STARS", "--band", "F520", "--dry-run"),
    "whatif": ("whatif", "survey_default", "--known-planets", "PLANETS", "--dry-run", "--strategy", "few_and_deep"),
    "whatif stars": ("whatif", "survey_default", "--catalog", "STARS", "--dry-run", "--strategy", "few_and_deep"),
    "simulate": ("simulate", "STARS", "--band", "F520", "--dry-run"),
}


def with_tables(arguments, stars, planets):
    return [word.replace("STARS", stars).replace("PLANETS", planets) for word in arguments]


@pytest.mark.parametrize("name", [*COMMANDS, *DRY])
def test_what_is_left_out_is_said_once_and_listed(done, tmp_path, stars, planets, name):
    path = tmp_path / "r.csv"
    out, err = done(*with_tables((COMMANDS | DRY)[name], stars, planets), "--json", "--rejects", path)
    label = "pl.csv" if "PLANETS" in "".join((COMMANDS | DRY)[name]) else "mine.csv"
    unused, left = f"{label}: columns not used:", f"{label}: {1 if label == 'pl.csv' else 3} row"
    for words in (unused, left):
        assert err.count(words) == 1, err
    assert {row["table"] for row in rejected(path)} == {label}
    if name in COMMANDS:
        notes = json.loads(out)["notes"]
        assert [sum(words in note for note in notes) for words in (unused, left)] == [1, 1]


@pytest.mark.parametrize("name", [*COMMANDS, *DRY])
def test_strict_refuses_the_table_in_every_command(refuses, stars, planets, name):
    arguments = (COMMANDS | DRY)[name]
    words = ["pl.csv row 2", "long"] if "PLANETS" in "".join(arguments) else ["mine.csv row 3 (broken)", "abc"]
    refuses([*with_tables(arguments, stars, planets), "--strict"], words)


def test_rejects_are_written_where_the_table_is_refused_too(call, tmp_path):
    (tmp_path / "x.csv").write_text("name,distance_pc,v_mag,sp_type\nBob,ten,5,G2V\nEve,,5,G2V\n")
    status, _, err = call("rank", "--catalog", tmp_path / "x.csv", "--rejects", tmp_path / "r.csv")
    assert status == 2, err
    assert [row["name"] for row in rejected(tmp_path / "r.csv")] == ["Bob", "Eve"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("rank",),
        ("etc", "tau Cet"),
        ("known", "--known-planets", "archive_2019"),
        ("visibility", "tau Cet", "--catalog", "simbad_2012"),
        ("plan", "--known-planets", "snapshot", "--dry-run"),
        ("whatif", "survey_default", "--dry-run"),
        ("simulate", "paper_example", "--band", "F520", "--dry-run"),
    ],
)
def test_rejects_without_a_table_of_ones_own_are_refused(call, tmp_path, arguments):
    status, _, err = call("-q", *arguments, "--rejects", tmp_path / "r.csv")
    assert (status, err.count("\n")) == (2, 1), err
    assert "--rejects" in err
    assert "a table of your own" in err
    assert not (tmp_path / "r.csv").exists()


def test_rejects_have_a_known_ending(refuses, stars):
    refuses(["rank", "--catalog", stars, "--rejects", "r.txt"], ["--rejects", ".csv, .ecsv or .parquet"])


@pytest.mark.parametrize(
    "arguments", [("catalog", "columns", "STARS"), ("rank", "--catalog", "STARS"), ("simulate", "STARS", "--dry-run")]
)
def test_rejects_do_not_replace_the_table_itself(refuses, stars, arguments):
    refuses([*with_tables(arguments, stars, ""), "--rejects", stars], ["--rejects", "another file"])
    assert Path(stars).read_text() == STARS


def test_strict_still_says_that_there_is_no_detection(call, tmp_path):
    (tmp_path / "faint.csv").write_text("name,distance_pc,v_mag,sp_type\nBob,40,12,G2V\n")
    asked = ["etc", "Bob", "--catalog", tmp_path / "faint.csv", "--band", "F520", "--time-s", "10"]
    assert call(*asked)[0] == 0
    assert call(*asked, "--strict")[0] == 3


@pytest.mark.parametrize("command", [("rank", *QUICK), ("etc", "Bob", "--band", "F520"), ("visibility", "Bob")])
def test_a_table_that_was_cut_off_says_so_in_every_result(done, tmp_path, command):
    from astropy.io.votable import from_table
    from astropy.table import Table

    stars = {"name": ["Bob"], "distance_pc": [10.0], "v_mag": [5.0], "sp_type": ["G2V"], "ra": [9.0], "dec": [9.0]}
    from_table(Table(stars)).to_xml(str(tmp_path / "s.xml"))
    text = (tmp_path / "s.xml").read_text()
    (tmp_path / "s.xml").write_text(text.replace("<TABLE", '<INFO name="QUERY_STATUS" value="OVERFLOW"/><TABLE', 1))
    out, err = done(*command, "--catalog", tmp_path / "s.xml", "--json")
    (note,) = json.loads(out)["notes"]
    assert "was cut off" in note
    assert err.count("was cut off") == 1


def test_a_simulation_keeps_the_remarks(done, tmp_path, stars):
    small = [f"detector.{key}={value}" for key, value in SMALL.items()]
    small = [word for change in small for word in ("--set", change)]
    asked = ["simulate", stars, "--band", "F520", "--frames", "1", *small, "--fidelity", "quick"]
    out, _ = done(*asked, "--out", tmp_path / "out", "--json")
    assert any("3 rows left out" in note for note in json.loads(out)["notes"])
    assert json.loads(out)["notes"] == json.loads((tmp_path / "out" / "simulation.json").read_text())["notes"]


def test_python_reads_as_strictly(stars):
    from cpic_core import InputError

    asked = {"catalog": stars, "bands": ["F520"], "n_planets": 50}
    with pytest.raises(InputError, match=r"row 3 \(broken\)"):
        rank_targets(**asked, strict=True)
    result = rank_targets(**asked)
    assert [row.name for row in result.targets] == ["mine", "HD 20794"]
    assert any("3 rows left out" in note for note in result.notes)


def test_other_columns_travel_to_every_output(done, tmp_path, stars):
    from astropy.table import Table

    asked = ["rank", "--catalog", stars, *QUICK]
    out, _ = done(*asked, "--json", "--out", tmp_path / "r.csv")
    own = [row["own"] for row in json.loads(out)["targets"]]
    assert own == [{"mood": "fine", "own_rank": "7"}, {"mood": None, "own_rank": "8"}]
    rows = list(csv.DictReader((tmp_path / "r.csv").read_text().splitlines()))
    assert [(row["rank"], row["mood"], row["own_rank"]) for row in rows] == [("1", "fine", "7"), ("2", "", "8")]
    done(*asked, "--out", tmp_path / "r.ecsv", "--brief")
    table = Table.read(tmp_path / "r.ecsv", format="ascii.ecsv")
    assert table["mood"][0] == "fine"
    assert list(table["own_rank"]) == ["7", "8"]
    lines = done(*asked, "--format", "csv")[0].splitlines()
    assert lines[0].endswith(",mood,own_rank")
    frame = RankResult.model_validate_json(out).to_pandas()
    assert list(frame["mood"][:1]) == ["fine"]
    assert list(frame["own_rank"]) == ["7", "8"]
    shown, _ = done(*asked)
    assert "mood" not in shown, "the terminal shows them where they are asked for"
    assert done(*asked, "--columns", "name,mood", "--format", "csv")[0].splitlines()[:2] == ["name,mood", "mine,fine"]
    assert "fine" in done(*asked, "--columns", "name,mood")[0]
    assert "mood: column of your own table" in done(*asked, "--columns", "help")[0]


def test_headings_of_others_steer_no_program(done, tmp_path):
    """A heading may begin like a formula of spreadsheets, or hold what steers a terminal."""
    text = "name,distance_pc,v_mag,sp_type,=cmd|x,\x1b[31mred\nBob,10,5,G2V,1,2\n"
    (tmp_path / "odd.csv").write_text(text)
    asked = ["rank", "--catalog", tmp_path / "odd.csv", *QUICK]
    for ending in (".csv", ".ecsv"):
        done(*asked, "--out", tmp_path / f"r{ending}")
        lines = [line for line in (tmp_path / f"r{ending}").read_text().splitlines() if not line.startswith("#")]
        names = next(csv.reader(lines[:1]))
        assert [name for name in names if name.startswith(("=", "+", "@"))] == []
        assert any("=cmd" in name for name in names)
        assert "\x1b" not in "".join(lines)
    for more in (["--columns", "help"], ["--format", "csv"], ["--json"]):
        assert "\x1b" not in done(*asked, *more)[0]


def test_numbers_of_a_file_with_types_stay_numbers(tmp_path):
    from astropy.table import MaskedColumn, Table

    table = Table({"name": ["Bob", "Eve"], "distance_pc": [10.0, 12.0], "v_mag": [5.0, 6.0], "sp_type": ["G2V"] * 2})
    table["n_obs"] = [3, 2**40]
    table["rms"] = MaskedColumn([0.25, 0.0], mask=[False, True])
    table["good"] = [True, False]
    table.write(tmp_path / "t.fits")
    result = rank_targets(catalog=tmp_path / "t.fits", bands=["F520"], n_planets=50)
    by_name = {row.name: row.own for row in result.targets}
    assert by_name["Bob"] == {"n_obs": 3, "rms": 0.25, "good": True}
    assert by_name["Eve"] == {"n_obs": 2**40, "rms": None, "good": False}
    frame = result.to_pandas().set_index("name")
    assert frame["n_obs"].dtype == np.int64
    assert frame["rms"].dtype == np.float64
    assert np.isnan(frame["rms"]["Eve"])


def test_of_many_columns_the_first_travel_and_others_by_name(done, tmp_path):
    names = [f"x{i:03d}" for i in range(MOST_OWN + 20)]
    path = tmp_path / "wide.csv"
    path.write_text(f"name,distance_pc,v_mag,sp_type,{','.join(names)}\nBob,10,5,G2V,{','.join(map(str, range(60)))}\n")
    asked = ["rank", "--catalog", path, *QUICK]
    (row,) = json.loads(done(*asked, "--json")[0])["targets"]
    assert list(row["own"]) == names[:MOST_OWN]
    last = names[-1]
    assert done(*asked, "--columns", f"name,{last}", "--format", "csv")[0].splitlines() == [f"name,{last}", "Bob,59"]


def test_shipped_tables_have_no_other_columns():
    assert not load_targets("snapshot").empty
    from catalogs import load_stars

    assert len(load_stars().own) == 0
    assert {"own", "rank", "name"} <= set(RankedTarget.model_fields)
