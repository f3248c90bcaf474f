"""Answers of the pages: ranking rows, a star, two instruments, the columns of a table."""

import hashlib
import html
import json
import re
from shlex import split
from types import SimpleNamespace
from urllib.parse import quote

import pytest
from jsonschema import Draft202012Validator

from catalogs import velocity_limit
from cpic_core import InputError
from cpic_planner import explain_rank, star_visibility
from cpic_planner.cli.main import main
from cpic_planner.schemas import RESULTS, generated
from cpic_planner.web.answers import rank_pairs, star_answer
from cpic_planner.web.pages import tag_of


def test_rows_that_are_shown():
    assert rank_pairs([("limit", "")]) == ()
    assert rank_pairs([("limit", "7")]) == (("limit", "7"),)
    for text in ("0", "-1", "1e3", "1501", "٣", "9" * 40):
        with pytest.raises(InputError, match="1 to 1500"):
            rank_pairs([("limit", text)])


def test_a_tag_follows_question_kind_and_version(monkeypatch):
    from cpic_planner.web import pages

    asked = (("target", "tau Cet"),)
    mine = tag_of("svg", asked)
    assert mine == tag_of("svg", asked)
    assert mine not in (tag_of("png", asked), tag_of("svg", (("target", "eps Eri"),)))
    monkeypatch.setattr(pages, "__version__", "9.9.9")
    assert tag_of("svg", asked) != mine


def words(told):
    return " ".join(re.sub(r"<[^>]*>", " ", told.text).split())


def test_a_page_says_what_the_commands_say(ask, capsys):
    text = words(ask("/star?name=eps+Eri&date_utc=2030-01-01"))
    season = star_visibility("eps Eri", start_utc="2030-01-01").targets[0].seasons[0]
    assert f"Season {season.start_utc[:16]} to {season.end_utc[:16]}" in text
    assert main(["known", "eps Eri", "--date", "2030-01-01", "-v"]) == 0
    (windows,) = re.findall(r"more likely than not in the dark hole (.*)", " ".join(capsys.readouterr().out.split()))
    assert windows.split(" Numbers")[0][:40] in text
    assert f"over {velocity_limit('eps Eri').baseline_years:.3g} years" in text


def test_figures_have_addresses_of_their_own(ask):
    page = ask("/star?name=eps+Eri").text
    addresses = [address.replace("&amp;", "&") for address in re.findall(r'src="(/star/[^"]+)"', page)]
    assert [address.partition(".")[0] for address in addresses] == ["/star/planets", "/star/seasons"]
    for address in addresses:
        told = ask(address)
        assert (told.status, told.headers["content-type"]) == (200, "image/svg+xml")
        assert ask(address, if_none_match=told.headers["etag"]).status == 304
        values = ask(address.replace(".svg", ".values"))
        assert values.status == 200
        assert values.text.count("<tr") > 300
    assert ask("/star/planets.svg?name=del+Pav").status == 400
    assert ask("/star/other.svg?name=eps+Eri").status == 404


def test_a_planet_leads_to_its_star_and_a_faint_star_has_no_rank(ask):
    assert star_answer((("name", "eps Eri b"),)).name == "eps Eri"
    faint = ask("/star?name=HD+108147")
    assert faint.status == 200
    assert "it ends at V 7" in faint.text
    assert "Tier" not in faint.text


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ("name=Nobody", "name"),
        ("date_utc=2030-01-01", "name"),
        ("name=tau+Cet&date_utc=soon", "date_utc"),
        ("name=" + "a" * 200, "name"),
    ],
)
def test_bad_input_is_said_at_its_field(ask, query, field):
    told = ask(f"/star?{query}")
    assert told.status == 400
    assert told.text.count('class="wrong"') == 1
    assert f'id="wrong-{field}"' in told.text


def test_a_star_is_asked_for_by_its_name_and_nothing_else(ask):
    for query in ("name=tau+Cet&name=eps+Eri", "name=tau+Cet&file=/etc/passwd", "name=%00"):
        told = ask(f"/star?{query}")
        assert told.status == 400
        assert "root:" not in told.text
    assert ask("/star?name=tau+Cet&date_utc=").headers["location"] == "/star?name=tau+Cet"
    assert ask("/star").status == 200


@pytest.mark.long
def test_the_data_of_a_page_are_what_python_and_the_commands_give(ask, capsys):
    """Rank and what is missing are those of the ranking."""
    told = ask("/star?name=HIP+116727&date_utc=2030-01-01&format=json").json
    seasons = star_visibility("gam Cep", start_utc="2030-01-01")
    assert told["seasons"] == json.loads(seasons.model_dump_json())
    assert main(["known", "gam Cep", "--date", "2030-01-01", "--json"]) == 0
    assert told["known"] == json.loads(capsys.readouterr().out)
    explained = json.loads(explain_rank("gam Cep").model_dump_json())
    assert told["explanation"]["star"] == explained["star"]
    assert told["explanation"]["bands"] == explained["bands"]
    assert f"Tier {explained['star']['tier']}:" in ask("/star?name=gam+Cep&date_utc=2030-01-01").text
    assert (told["name"], told["hip"], told["note"]) == ("gam Cep", 116727, "")
    assert told["distance_pc"] == pytest.approx(1000.0 / 72.52, abs=0.01)  # Gaia DR3
    assert ask("/star?name=Nobody&format=json").json["parameter"] == "name"
    assert ask("/star?format=csv&name=tau+Cet").status == 400


NOISY = b"kind: instrument\nname: noisy\ndetector: {read_noise_e: 160}\n"


def printed(capsys, command):
    assert main(split(command)) == 0
    return capsys.readouterr().out


def test_differences_are_those_of_the_command(ask, capsys):
    text = words(ask("/compare?instrument=as_published&other=cpic_default"))
    rows = printed(capsys, "instrument diff as_published --format csv").splitlines()[1:]
    assert len(rows) > 3
    for row in rows:
        assert row.split(",")[0] in text


def test_answers_of_both_stand_below_each_other_with_their_ratio(ask):
    page = ask("/compare?target=tau+Cet&snr=5&separation_arcsec=0.45&bands=F520&set=throughput%3Dx0.7")
    assert page.status == 200
    question = "target=tau+Cet&snr=5&separation_arcsec=0.45&bands=F520"
    first, other = (
        ask(f"/etc?{question}{more}&format=json").json["answers"][0]["value"] for more in ("&set=throughput%3Dx0.7", "")
    )
    assert first > other
    text = words(page)
    assert f"{other / first:.3f}"[:4] in text
    assert "cpic etc &#39;tau Cet&#39;" in page.text
    assert "All that" in text


def test_an_instrument_is_not_compared_with_itself_in_silence(ask):
    assert "the same in every value" in words(ask("/compare?instrument=cpic_default&other=cpic_default"))


def test_instruments_that_are_sent_are_compared(send):
    told = send("/compare", [("other", "noisy.yaml", NOISY)], fields=[("target", "tau Cet"), ("bands", "F520")])
    assert told.status == 200
    assert "detector.read_noise_e" in told.text
    assert hashlib.sha256(NOISY).hexdigest() in told.text
    assert '<th scope="row">' in told.text or "noisy" in told.text
    other = b"kind: instrument\nname: x\nwavefront: {opd_rms_nm: 15}\n"
    refused = send("/compare", [("other", "x.yaml", other)], fields=[("target", "tau Cet")])
    assert refused.status == 400
    assert "other optics" in refused.text


@pytest.mark.parametrize(
    "query",
    [
        "other=/etc/passwd",
        "other=x.yaml",
        "other=cpic_2q&other=cpic_default",
        "instrument=/etc/passwd",
        "target=Nobody",
        "x=1",
    ],
)
def test_bad_input_is_refused(ask, query):
    told = ask(f"/compare?{query}")
    assert told.status == 400
    assert told.text.count('class="wrong"') == 1
    assert "root:" not in told.text


def test_the_data_of_a_page_are_what_the_commands_print(ask, send, capsys):
    question = "target=tau+Cet&snr=5&separation_arcsec=0.45&bands=F520"
    told = ask(f"/compare?{question}&instrument=as_published&format=json").json
    command = "etc 'tau Cet' --snr 5 --separation-arcsec 0.45 --band F520 --json"
    theirs = [json.loads(printed(capsys, f"{command}{more}")) for more in (" --instrument as_published", "")]
    assert told["answers"] == theirs
    assert told["differences"] == json.loads(printed(capsys, "instrument diff as_published --json"))
    alone = ask("/compare?instrument=as_published&format=json").json
    assert (alone["answers"], alone["differences"]) == ([], told["differences"])
    fields = [("target", "tau Cet"), ("bands", "F520"), ("format", "json")]
    sent = send("/compare", [("other", "noisy.yaml", NOISY)], fields=fields)
    assert hashlib.sha256(NOISY).hexdigest() in sent.headers["cpic-files"]
    assert [row["key"] for row in sent.json["differences"]["values"]] == ["detector.read_noise_e"]
    assert send("/compare", [], fields=[("other", "x"), ("format", "json")]).json["parameter"] == "other"


@pytest.mark.parametrize(
    ("question", "given"),
    [
        ("time_s=36000", False),  # each instrument has its own best place
        ("time_s=36000&separation_arcsec=0.5", True),
        ("detect=true", False),
        ("snr=5&separation_arcsec=0.5&contrast=1e-8", True),
        ("contrast_limit=true&detect=true&time_s=36000&separation_arcsec=0.5", True),
    ],
)
def test_a_ratio_compares_the_same_planet_only(ask, question, given):
    """Two planets at two separations have no ratio, and the page says so in sight, below the table."""
    page = ask(f"/compare?target=tau+Cet&bands=F720&{question}&instrument=as_published")
    assert page.status == 200
    first, other = (
        ask(f"/etc?target=tau+Cet&bands=F720&{question}{more}&format=json").json["answers"][0]
        for more in ("&instrument=as_published", "")
    )
    assert (first["separation_arcsec"] == other["separation_arcsec"]) is given
    shown = page.text.partition("What the headings mean")[0]
    assert ("other planet" in words(SimpleNamespace(text=shown))) is not given
    unfolded = re.sub(r"<details.*?</details>", "", page.text, flags=re.DOTALL)
    assert ("No ratio is given where it says other planet" in words(SimpleNamespace(text=unfolded))) is not given
    if given:
        assert f"{other['value'] / first['value']:.3g}" in words(page)


def test_two_questions_are_compared_as_the_command_compares_their_answers(ask, tmp_path, capsys):
    first, second = "target=tau+Cet&bands=F520&bands=F720&time_s=36000", "time=2h&drift_nm=0.1"
    told = ask(f"/compare?{first}&second={quote(second)}&format=json").json
    command = "etc 'tau Cet' --band F520 --band F720 --json"
    for name, more in (("a", " --time-s 36000"), ("b", " --time 2h --drift-nm 0.1")):
        (tmp_path / f"{name}.json").write_text(printed(capsys, f"{command}{more}"))
    assert told["answers"] == [json.loads((tmp_path / f"{name}.json").read_text()) for name in "ab"]
    theirs = json.loads(printed(capsys, f"compare {tmp_path / 'a.json'} {tmp_path / 'b.json'} --json"))
    for name in ("changes", "settings", "explained_by", "statement"):
        assert told["comparison"][name] == theirs[name]
    settings = {row["key"]: (row["before"], row["after"]) for row in theirs["settings"]}
    assert settings == {
        "time_s": ("36000", "7200"),
        "instrument.drift.visit_nm": ("by default", "0.1 nm"),
        "instrument.drift.walk_nm_per_sqrt_hour": ("by default", "0.1 nm/sqrt(h)"),
    }
    page = ask(f"/compare?{first}&second={quote(second)}")
    assert "The verdict changes for F720" in words(page)
    assert "cpic compare first.json second.json" in page.text


def test_the_second_question_may_be_whole_or_the_address_of_an_answer(ask):
    first = "/compare?target=tau+Cet&snr=5&bands=F520&set=throughput%3Dx0.7"
    for whole in ("target=eps+Ind&snr=10&bands=F520", "http://localhost:8765/etc?target=eps+Ind&snr=10&bands=F520"):
        told = ask(f"{first}&second={quote(whole)}&format=json").json
        mine, other = told["answers"]
        assert other == ask("/etc?target=eps+Ind&snr=10&bands=F520&format=json").json
        assert mine == ask(f"/etc?{first.partition('?')[2]}&format=json").json
        # Rows of two stars stand beside each other, band by band.
        assert not told["comparison"]["only_before"]
        keys = [row["key"] for row in told["comparison"]["settings"]]
        assert keys[:2] == ["target", "snr"]
        assert "instrument.bands.F520.t_opt" in keys


@pytest.mark.parametrize(
    ("query", "parameter", "said"),
    [
        ("target=tau+Cet&second=x", "second", "NAME=VALUE"),
        ("target=tau+Cet&second=nonsense%3D2", "second", "nonsense"),
        ("target=tau+Cet&snr=5&second=time%3D2h", "second", "one asks for a time"),
        ("target=tau+Cet&second=instrument%3D%2Fetc%2Fpasswd", "second", "instrument"),
        (f"target=tau+Cet&second={'x' * 2001}", "second", "at most 2000"),
        ("second=time%3D2h", "target", "a star in the first question"),
    ],
)
def test_what_is_wrong_with_the_second_question_is_said_beside_it(ask, query, parameter, said):
    told = ask(f"/compare?{query}&format=json")
    assert told.status == 400
    assert told.json["parameter"] == parameter
    assert said in told.json["message"]


def test_an_answer_leads_to_its_comparison(ask):
    page = ask("/etc?target=tau+Cet&snr=5&bands=F520")
    (link,) = set(re.findall(r'href="(/compare\?[^"]*)"', page.text))
    told = ask(html.unescape(link))
    assert told.status == 200
    assert words(page).count("18.6 min") >= 1 <= words(told).count("18.6 min")


STARS = b"name,plx [mas],v_mag,sp_type,mood\nBob,100,5,G2V,fine\nEve,x,5,G2V,sad\n"


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
