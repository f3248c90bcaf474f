"""The page that says what the columns of a table are taken for: the words of the command, of content alone."""

import json
import re

import pytest
from jsonschema import Draft202012Validator

from cpic_planner.cli.main import main
from cpic_planner.schemas import RESULTS, generated

STARS = b"name,plx [mas],v_mag,sp_type,mood\nBob,100,5,G2V,fine\nEve,x,5,G2V,sad\n"


def words(told):
    return " ".join(re.sub(r"<[^>]*>", " ", told.text).split())


def test_the_start_page_leads_to_a_form_that_takes_a_table(ask):
    assert 'href="/columns"' in ask("/etc").text
    page = ask("/columns")
    assert page.status == 200
    assert 'enctype="multipart/form-data"' in page.text
    assert 'type="file" name="table"' in page.text


@pytest.mark.parametrize("kind", ["", "stars"])
def test_the_page_says_what_the_command_says(send, tmp_path, capsys, kind):
    (tmp_path / "mine.csv").write_bytes(STARS)
    assert main(["catalog", "columns", str(tmp_path / "mine.csv"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    fields = [("as", kind)] * bool(kind)
    assert send("/columns", [("table", "mine.csv", STARS)], fields=[*fields, ("format", "json")]).json == printed
    assert list(Draft202012Validator(json.loads(generated("columns"))).iter_errors(printed)) == []
    assert "columns" in RESULTS
    page = send("/columns", [("table", "mine.csv", STARS)], fields=fields)
    assert page.status == 200
    assert "cpic-files" in page.headers
    for text in (
        "1 of 2 rows can be used",
        "plx [mas] parallax_mas mas",
        "mood not used – heading not known",
        "row 2 (Eve): x mas allowed: a number, 0.01 to 1000 mas",
        "cpic catalog columns mine.csv",
    ):
        assert text in words(page)


@pytest.mark.parametrize(
    ("files", "fields", "text"),
    [
        ([], [("table", "/etc/passwd")], "a file that is sent"),
        ([], [("table", "pyproject.toml")], "a file that is sent"),
        ([], [], "a file that is sent"),
        ([("table", "x.csv", b"a,b\n1,2\n")], [], "x.csv"),
        ([("table", "x.csv", STARS)], [("as", "moons")], "stars or planets"),
        ([("table", "x.csv", STARS)], [("path", "x.csv")], "path"),
        ([("catalog", "x.csv", STARS)], [], "catalog"),
    ],
)
def test_what_is_no_table_is_refused_at_its_field(send, files, fields, text):
    told = send("/columns", files, fields=fields)
    assert told.status == 400
    assert text in words(told)
    data = send("/columns", files, fields=[*fields, ("format", "json")])
    assert data.status == 400
    assert data.json["type"] == "invalid_input"


def test_addresses_name_no_file(ask):
    told = ask("/columns?table=pyproject.toml&format=json")
    assert (told.status, told.json["parameter"]) == (400, "table")


def test_remarks_on_a_table_that_is_sent_stand_with_the_answer(send):
    fields = [("target", "Bob"), ("bands", "F520"), ("snr", "5")]
    page = words(send("/etc", [("catalog", "mine.csv", STARS)], fields=fields))
    assert page.count("mine.csv: columns not used: mood") == 1
    assert "mine.csv: 1 row left out: 1 because of plx [mas]" in page
    refused = send("/etc", [("catalog", "mine.csv", STARS)], fields=[*fields, ("strict", "on")])
    assert refused.status == 400
    assert "mine.csv row 2 (Eve)" in words(refused)
