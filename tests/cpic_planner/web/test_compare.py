import hashlib
import json
import re
from shlex import split
from types import SimpleNamespace

import pytest

from cpic_planner.cli.main import main

NOISY = b"kind: instrument\nname: noisy\ndetector: {read_noise_e: 160}\n"


def words(told):
    return " ".join(re.sub(r"<[^>]*>", " ", told.text).split())


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
