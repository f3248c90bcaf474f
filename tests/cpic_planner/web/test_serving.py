"""Check how the server begins and ends."""

import html
import json
import math
import re
import threading
from concurrent.futures import ThreadPoolExecutor
from shlex import split

import numpy as np
import pytest
import uvicorn

from cpic_planner.cli.main import main
from cpic_planner.web import answers, application, serving

# Address and command that ask the same.
SAME = [
    ("target=tau+Cet", '"tau Cet"'),
    ("target=tau+Cet&snr=5&separation_arcsec=0.36", '"tau Cet" --snr 5 --separation-arcsec 0.36'),
    ("target=HIP+8102&detect=on&separation_arcsec=0.45", '"HIP 8102" --detect --separation-arcsec 0.45'),
    ("target=eps+Eri&contrast=5e-9&separation_arcsec=0.6&snr=5",
     '"eps Eri" --contrast 5e-9 --separation-arcsec 0.6 --snr 5'),
    ("target=HD+10700&semi_major_axis_au=1.5&contrast_limit=1", '"HD 10700" --semi-major-axis-au 1.5 --contrast-limit'),
    ("target=eps+Eri&contrast_limit=on&sigma=5&separation_arcsec=0.4,0.6",
     '"eps Eri" --contrast-limit --sigma 5 --separation-arcsec 0.4 --separation-arcsec 0.6'),
    ("target=eps+Ind&visits=16&visit_time_s=2700", '"eps Ind" --visits 16 --visit-time-s 2700'),
    ("target=eps+Ind&detect=on&library=archive&search=known_place",
     '"eps Ind" --detect --library archive --search known_place'),
    ("target=tau+Cet&time=2h&bands=F520&bands=F662", '"tau Cet" --time 2h --band F520 --band F662'),
    ("target=tau+Cet&set=throughput%3Dx0.7&exozodi=3", '"tau Cet" --set throughput=x0.7 --exozodi 3'),
    ("target=tau+Cet&albedo=saturn&planet_radius_rjup=0.8&phase_deg=70",
     '"tau Cet" --albedo saturn --planet-radius-rjup 0.8 --phase-deg 70'),
    ("target=eps+Eri+b&date_utc=2030-06-01", '"eps Eri b" --date 2030-06-01'),
    ("target=alpha+Cen+B&exposure_s=30&n_frames=100&em_gain=20&bands=F520",
     '"alpha Cen B" --exposure-s 30 --frames 100 --em-gain 20 --band F520'),
]  # fmt: skip


def printed(capsys, *arguments):
    assert main(list(arguments)) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize(("address", "command"), SAME)
def test_json_is_that_of_the_command_line_to_the_last_byte(ask, capsys, address, command):
    told = ask(f"/etc?{address}&format=json")
    assert (told.status, told.headers["content-type"]) == (200, "application/json")
    assert told.text == printed(capsys, "etc", *split(command), "--json")


@pytest.mark.parametrize("form", ["csv", "ecsv", "latex", "markdown"])
def test_tables_are_those_of_the_command_line(ask, capsys, form):
    address, command = SAME[1]
    assert ask(f"/etc?{address}&format={form}").text == printed(capsys, "etc", *split(command), "--format", form)


def test_a_ranking_is_that_of_the_command_line(ask, capsys):
    told = ask("/priorities?sp_type=K&distance_max_pc=6&v_mag_max=5&bands=F520&format=json")
    options = ["--sp-type", "K", "--distance-max-pc", "6", "--v-mag-max", "5", "--band", "F520"]
    assert told.text == printed(capsys, "rank", *options, "--json")
    rows = ask("/priorities?sp_type=K&distance_max_pc=6&v_mag_max=5&bands=F520&limit=3&format=csv").text
    assert rows == printed(capsys, "rank", *options, "--limit", "3", "--format", "csv")
    shown = ask("/priorities?sp_type=K&distance_max_pc=6&v_mag_max=5&bands=F520&limit=3")
    names = [row["name"] for row in told.json["targets"]]
    assert shown.status == 200
    assert [name for name in names[:3] if name.split()[-1] not in shown.text] == []


def test_a_figure_has_an_address_of_its_own_and_is_not_sent_twice(ask):
    address = "/etc.svg?target=tau+Cet&snr=5&bands=F520"
    first = ask(address)
    assert first.headers["content-type"] == "image/svg+xml"
    assert b"<svg" in first.body
    tag = first.headers["etag"]
    again = ask(address, if_none_match=tag)
    assert (again.status, again.body, again.headers["etag"]) == (304, b"", tag)
    assert ask(address).body == first.body
    # The same question in other words has the same figure, another question or form has not.
    assert ask("/etc.svg?band=F520&snr=5&target=tau+Cet").headers["etag"] == tag
    assert ask("/etc.svg?target=tau+Cet&snr=6&bands=F520", if_none_match=tag).status == 200
    drawn = ask("/etc.png?target=tau+Cet&snr=5&bands=F520", if_none_match=tag)
    assert (drawn.status, drawn.body[:4]) == (200, b"\x89PNG")


def test_the_values_of_a_figure_are_a_page_of_tables(ask):
    asked = "target=tau+Cet&snr=5&separation_arcsec=0.5&bands=F520"
    page, told = ask(f"/etc?{asked}"), ask(f"/etc.values?{asked}")
    assert f'href="/etc.values?{asked}"'.replace("&", "&amp;") in page.text
    assert (told.status, told.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert "script-src 'self'" in told.headers["content-security-policy"]
    assert f'src="/etc.svg?{asked}"'.replace("&", "&amp;") in told.text
    assert f'href="/etc?{asked}"'.replace("&", "&amp;") in told.text
    (answer,) = ask(f"/etc?{asked}&format=json").json["answers"]
    panels = json.loads(html.unescape(re.search(r'data-panels="([^"]*)"', told.text)[1]))
    times, _, budget = panels
    assert times["levels"] == [{"name": "F520, threshold", "y": pytest.approx(answer["threshold"], rel=1e-4)}]
    snr = next(line for line in times["lines"] if line["name"] == "F520, SNR")
    good = [(x, y) for x, y in zip(snr["x"], snr["y"], strict=True) if y is not None]
    found = np.interp(math.log(answer["time_s"] / 3600.0), *np.array([(math.log(x), y) for x, y in good]).T)
    assert found == pytest.approx(5.0, rel=0.02)
    assert sum(bar["high"] - bar["low"] for bar in budget["bars"]) == pytest.approx(100.0, abs=0.01)
    assert ask(f"/etc.values?{asked}", if_none_match=told.headers["etag"]).status == 304
    assert ask("/etc.values?target=Nobody").status == 400


def test_a_question_of_a_form_gets_the_address_without_what_was_left_empty(ask):
    told = ask("/etc?target=tau+Cet&snr=5&time_s=&visits=+&bands=F520")
    assert told.status == 303
    assert told.headers["location"] == "/etc?target=tau+Cet&snr=5&bands=F520"


def test_wrong_input_comes_back_with_one_line_at_its_field(ask):
    told = ask("/etc?target=tau+Cet&snr=five")
    assert told.status == 400
    field = told.text.partition('id="snr"')[2].partition("</div>")[0]
    assert 'value="five"' in field
    assert 'aria-invalid="true"' in field
    assert "snr = five: not accepted; allowed: a number" in field
    assert told.text.count('class="wrong"') == 1
    assert 'value="tau Cet"' in told.text


def test_errors_in_json_have_parts(ask):
    told = ask("/etc?target=tau+Cet&planet_radius_rjup=70&format=json")
    problem = told.json
    assert told.status == 400
    assert {name: problem[name] for name in ("kind", "type", "parameter", "value")} == {
        "kind": "error",
        "type": "invalid_input",
        "parameter": "planet_radius_rjup",
        "value": "70.0",
    }
    assert "10" in problem["allowed"]


def test_only_the_pages_that_there_are(ask):
    assert ask("/").headers["location"] == "/etc"
    assert ask("/style.css").headers["content-type"].startswith("text/css")
    for address in ("/nothing", "/etc/", "/etc/../style.css", "//etc", "/static/plan.css"):
        told = ask(address)
        assert told.status in (404, 307), address
        assert told.text.count("\n") <= 1


FILES = ["/etc/passwd", "../secret.yaml", "secret.yaml", "secret", "~/.netrc", "file:///etc/passwd", "C:\\secret", "."]
FILE_FIELDS = ["instrument", "catalog", "known_planets", "albedo"]


def hostile():
    """Questions that are refused, and how."""
    for field in FILE_FIELDS:
        for file in FILES:
            if field == "albedo" and file == "secret":
                continue
            yield f"/etc?target=tau+Cet&{field}={file}"
    for file in FILES:
        yield f"/etc?target={file}"
        yield f"/etc?target=tau+Cet&set=bands.F520.transmission_file={file}"
        yield f"/etc?target=tau+Cet&set=detector.calibration_files.flat={file}"
        yield f"/etc?target=tau+Cet&set=coronagraph.table={file}"
        yield f"/etc?target=tau+Cet&set=detector.*={file}"
        yield f"/etc?target=tau+Cet&question={file}"
        yield f"/priorities?stars={file}"
        yield f"/priorities?population={file}"
        yield f"/priorities?ensemble={file}"
        yield f"/priorities?compare={file}"
        yield f"/priorities?sp_type={file}"
    for number in (
        "nan",
        "inf",
        "-1",
        "1e999",
        "1" * 190,
        "0x10",
        "١٢",
        "<script>alert(1)</script>",
        "5;rm",
        "{{7*7}}",
    ):
        yield f"/etc?target=tau+Cet&snr={number}"
        yield f"/etc?target=tau+Cet&separation_arcsec={number}&snr=5&bands=F520&contrast=2"
        yield f"/etc?target=tau+Cet&visits={number}e"
    for other in (
        "target=tau+Cet&target=eps+Eri",
        "target=%00",
        "target=tau%0aCet",
        "target=" + "a" * 300,
        "target=tau+Cet&bands=F1",
        "target=tau+Cet&bands=<b>",
        "target=tau+Cet&unknown=1",
        "target=tau+Cet&%3Cscript%3E=1",
        "target=tau+Cet&fidelity=reference",
        "target=tau+Cet&realisations=100000",
        "target=tau+Cet&tolerance=0.01",
        "target=tau+Cet&n_modes=1000",
        "target=tau+Cet&strategy.choose_modes=on",
        "target=tau+Cet&snr=5&sigma=5",
        "target=tau+Cet&detect=maybe",
        "target=tau+Cet&date_utc=yesterday",
        "target=tau+Cet&library=mine",
        "target=tau+Cet&set=wavefront.opd_rms_nm=20",
        "target=tau+Cet&set=drift=0.1",
        "target=tau+Cet&limit=5",
        "target=tau+Cet&workers=8",
        "target=tau+Cet&out=x",
        "target=tau+Cet&plot=x.svg",
        "target=tau+Cet&" + "separation_arcsec=0.4&" * 60 + "snr=5",
        "snr=5",
    ):
        yield f"/etc?{other}"
    for other in (
        "limit=0",
        "limit=1e3",
        "limit=9999999999",
        "limit=5&limit=6",
        "instruments=100000",
        "planets=1000000",
    ):
        yield f"/priorities?{other}"


HOSTILE = sorted(set(hostile()))


def test_hostile_questions_are_a_hundred():
    assert len(HOSTILE) >= 100


@pytest.mark.parametrize("address", HOSTILE)
def test_hostile_questions_are_refused_in_one_line(ask, monkeypatch, tmp_path, address):
    for name in ("secret", "secret.yaml"):
        (tmp_path / name).write_text("kind: instrument\nname: xyzzy\nstars: [xyzzy]\nxyzzy\n")
    monkeypatch.chdir(tmp_path)
    told = ask(f"{address}&format=csv")
    assert told.status == 400, told.text
    assert told.text.count("\n") == 1
    for word in ("xyzzy", "Traceback", ".py", str(tmp_path), "root:"):
        assert word not in told.text
    page = ask(address)
    assert page.status == 400
    assert page.text.count("<script") == page.text.count('<script src="/page.js" defer></script>') == 1
    assert "xyzzy" not in page.text
    problem = ask(f"{address}&format=json")
    assert problem.status == 400
    assert json.loads(problem.text)["type"] == "invalid_input"


def test_a_fault_of_ours_says_nothing_of_itself(browser, monkeypatch, caplog):
    monkeypatch.setattr(serving, "_answer", lambda *given: 1 / 0)
    told = type(browser)(application()).get("/etc?target=tau+Cet&format=json")
    assert told.status == 500
    assert told.text.count("\n") == 1
    assert "division" not in told.text
    assert "ZeroDivisionError" in caplog.text


def test_ranked_stars_lead_to_their_pages_and_these_to_the_calculator(ask):
    told = ask("/priorities?sp_type=K&distance_max_pc=6&bands=F520&limit=3").text
    links = re.findall(r'href="(/star\?name=HIP\+\d+)"', told)
    assert len(links) == 3
    star = ask(links[0])
    (asked, *_) = re.findall(r'href="(/etc\?target=[\w+]+)"', star.text)
    answer = ask(asked + "&bands=F520")
    assert (star.status, answer.status) == (200, 200)
    assert re.search(r'href="/star\?name=', answer.text)


def test_twenty_askers_at_once_get_what_each_gets_alone(ask, browser):
    star = "target=eps+Eri&bands=F520"
    addresses = [f"/etc?{star}&snr={level}&format=json" for level in range(3, 7)]
    addresses += [f"/etc?{star}&snr={level}" for level in range(3, 7)]
    addresses += [f"/etc.{form}?{star}&snr=3" for form in ("svg", "png")]
    assert len(addresses * 2) == 20
    with ThreadPoolExecutor(20) as pool:
        together = list(pool.map(ask, addresses * 2))
    assert {told.status for told in together} == {200}
    answers.etc_answer.cache_clear()
    alone = type(browser)(application())  # which has kept nothing
    assert [told.body for told in together] == [alone.get(address).body for address in addresses] * 2


def test_an_interrupted_server_waits_for_the_figure_that_it_draws_beforehand(monkeypatch, tmp_path):
    """A daemon thread that is cut inside compiled code killed the process by SIGSEGV or SIGABRT."""
    begun, interrupted, daemons = threading.Event(), threading.Event(), []

    def figure(*_):
        daemons.append(threading.current_thread().daemon)
        begun.set()
        assert interrupted.wait(30)

    def run(*_, **__):
        assert begun.wait(30)
        interrupted.set()

    monkeypatch.setattr(serving, "drawn", figure)
    monkeypatch.setattr(uvicorn, "run", run)
    serving.serve("127.0.0.1", 8765, jobs=tmp_path / "jobs")
    assert daemons == [False]
