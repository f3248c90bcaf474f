import json
import re

import pytest

from catalogs import velocity_limit
from cpic_planner import explain_rank, star_visibility
from cpic_planner.cli.main import main
from cpic_planner.web.answers import star_answer


def words(told):
    return " ".join(re.sub(r"<[^>]*>", " ", told.text).split())


def test_a_page_says_what_the_commands_say(ask, capsys):
    text = words(ask("/star?name=eps+Eri&date_utc=2030-01-01"))
    season = star_visibility("eps Eri", start_utc="2030-01-01").targets[0].seasons[0]
    assert f"season {season.start_utc[:16]} to {season.end_utc[:16]}" in text
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
