"""Jobs as visitors see them: form, address, progress, result, cancelling, refusals."""

import base64
import re
import time

import html5lib
import pytest

from cpic_planner import confirm_targets
from cpic_planner.results import StarImagesResult
from cpic_planner.web import application
from cpic_planner.web.addresses import IMAGES, image_lines
from cpic_planner.web.job_queue import JobQueue

ASKED = {"target": "tau Cet", "bands": "F520", "realisations": "2", "fidelity": "quick"}


@pytest.fixture
def idle(browser, tmp_path):
    """A server whose queue does not move."""
    with JobQueue(tmp_path / "jobs", most_waiting=2) as queue:
        mine = type(browser)(application(jobs=queue))
        yield mine


def address_of(told):
    assert told.status == 303, told.text
    return told.headers["location"]


@pytest.mark.long
def test_a_job_runs_to_its_result_which_is_that_of_python(browser, tmp_path):
    with JobQueue(tmp_path) as queue:
        queue.start()
        mine = type(browser)(application(jobs=queue))
        address = address_of(mine.submit("/jobs", ASKED)).partition("?")[0]
        for _ in range(1500):
            told = mine.get(f"{address}?format=json").json
            if told["state"] not in ("waiting", "running"):
                break
            time.sleep(0.1)
        assert (told["state"], told["token"]) == ("done", None)
        result = StarImagesResult.model_validate(mine.get(told["result"]).json)
        # The same under another name of the star, from its result.
        again = mine.submit("/jobs", ASKED | {"target": "HIP 8102", "format": "json"})
        assert (again.status, again.json["id"], again.json["token"]) == (200, told["id"], None)
        page = mine.get(address).text
        shown = mine.get(f"{address}/panels-F520.png")
        drawing = mine.get(f"{address}/panels-F520.svg")
        table = mine.get(f"{address}/measurements.csv").text
        for name in ("panels-F850.png", "panels-F850.svg", "run.json", "cpic-run.jsonl", "..%2fasked.json", "%2e%2e"):
            assert mine.get(f"{address}/{name}").status in (404, 405), name
    assert told["id"] == result.config_hash
    given = {}
    exec(image_lines(IMAGES.canonical(ASKED.items())), given)
    (target,) = given["targets"]
    assert target.model_dump_json() == result.targets[0].model_dump_json()
    html5lib.HTMLParser(strict=True).parse(page)
    for words in (
        "<h1>τ Cet: confirmed by simulated images in F520</h1>",
        "Confirmed in F520; ETC",
        f"{address}/panels-F520.svg",
        f"{address}/star_images.json",
        "confirm_targets",
    ):
        assert words in page
    assert "refresh" not in page
    assert shown.body[:4] == b"\x89PNG"
    assert drawing.headers["content-type"] == "image/svg+xml"
    assert base64.b64encode(shown.body) in drawing.body
    assert table.splitlines()[1].startswith("tau Cet,8102,1,F520")


def test_python_gives_what_the_page_says_it_does():
    pairs = IMAGES.canonical([("target", "tau Cet"), ("set", "throughput=x0.7"), ("library", "roll"), ("exozodi", "2")])
    given = {"confirm_targets": lambda *names, **words: (names, words)}
    lines = image_lines(pairs).replace("from cpic_planner import confirm_targets\n", "")
    exec(lines, given)
    names, words = given["targets"]
    assert names == ("tau Cet",)
    assert IMAGES.model.of({"target": names[0]} | words) == IMAGES.question(pairs)
    assert callable(confirm_targets)


def test_a_waiting_job_says_its_place_and_asks_again_without_a_script(idle):
    first, second = (address_of(idle.submit("/jobs", ASKED | {"seed": str(seed)})) for seed in (1, 2))
    page = idle.get(second)
    html5lib.HTMLParser(strict=True).parse(page.text)
    assert '<meta http-equiv="refresh" content="5">' in page.text
    assert "Place in the queue</dt><dd>2" in page.text
    assert re.findall(r"<script(?! src=./page.js. defer>)", page.text) == []
    assert "set-cookie" not in page.headers
    assert 'name="token"' in page.text
    assert 'name="token"' not in idle.get(second.partition("?")[0]).text  # shared without it
    assert idle.get(first).status == 200


def test_a_full_queue_is_said_in_one_line(idle):
    for seed in (1, 2):
        address_of(idle.submit("/jobs", ASKED | {"seed": str(seed)}))
    told = idle.submit("/jobs", ASKED | {"seed": "3"})
    assert (told.status, told.text.count("\n")) == (503, 1)
    assert "2 jobs wait" in told.text
    assert idle.submit("/jobs", ASKED | {"seed": "2"}).status == 303


def test_only_the_asker_cancels(idle):
    address, _, token = address_of(idle.submit("/jobs", ASKED)).partition("?token=")
    for wrong in ("", "x", token[:-1]):
        told = idle.submit(f"{address}/cancel", {"token": wrong})
        assert (told.status, told.text.count("\n")) == (403, 1)
    assert idle.get(address).status == 200
    assert idle.submit(f"{address}/cancel", {"token": token}).status == 200
    assert idle.get(address).status == 404
    assert idle.submit(f"{address}/cancel", {"token": token}).status == 404


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"target": "nowhere"}, "target", "nowhere"),
        ({"bands": "F999"}, "bands", "F520"),
        ({"realisations": "100000"}, "realisations", "at most 900 s a job"),
        ({"fidelity": "reference", "bands": "", "realisations": "8"}, "realisations", "at most 900 s a job"),
        ({"n_modes": "3"}, "n_modes", "the command line does"),
        ({"workers": "8"}, "workers", "the command line does"),
        ({"catalog": "/etc/passwd"}, "catalog", "the command line"),
        ({"instrument": "/etc/passwd"}, "instrument", "files are named on the command line only"),
        ({"out": "/tmp/x"}, "out", "fields of the question"),
        ({"planet_radius_rjup": "70"}, "planet_radius_rjup", "10"),
    ],
)
def test_what_cannot_be_asked_is_refused_naming_the_field(idle, changes, key, words):
    told = idle.submit("/jobs", ASKED | changes | {"format": "json"})
    assert told.status == 400, told.text
    assert told.json["parameter"] == key
    assert words in told.json["message"]
    page = idle.submit("/jobs", ASKED | changes)
    assert page.status == 400
    assert words in page.text.replace("&#39;", "'")
    assert "/etc/passwd" not in page.text or 'value="/etc/passwd"' in page.text


def test_posts_have_a_length_and_come_from_here(idle):
    assert idle.submit("/jobs", ASKED, origin="http://localhost:8765").status == 303
    for headers, status in (
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"sec_fetch_site": "cross-site"}, 403),
        ({"content_length": "20001"}, 413),
        ({"content_length": "9" * 30}, 413),
        ({"content_length": "-1"}, 411),
        ({"transfer_encoding": "chunked"}, 411),
        ({"content_type": "text/plain"}, 400),
        ({"content_type": "multipart/form-data; boundary=x"}, 400),
    ):
        told = idle.submit("/jobs", ASKED | {"format": "csv"} if status == 400 else ASKED, **headers)
        assert told.status == status, headers
    assert idle.submit("/runs", ASKED).status == 405
    assert idle.submit("/jobs", b"target=%ff").status == 400
    assert idle.submit("/jobs", b"\xff\xfe").status == 400
    assert idle.submit("/jobs", b"a=1&" * 300).status == 400


NAMES = ["0" * 16, "..", "%2e%2e", "../jobs", "b421b8c241ed715e%00", "cpic-jobs.json", "queue.lock"]


@pytest.mark.parametrize("name", NAMES)
def test_a_job_is_looked_up_and_never_opened_by_its_name(idle, name):
    for address in (f"/jobs/{name}", f"/jobs/{name}/star_images.json", f"/jobs/{name}?format=json"):
        told = idle.get(address)
        assert told.status == 404
        assert told.text.count("\n") == 1


def test_a_body_has_a_limit_of_time(browser, tmp_path, monkeypatch):
    import asyncio

    from cpic_planner.web import guard

    monkeypatch.setattr(guard, "BODY_S", 0.05)
    sent = []

    async def never():
        await asyncio.sleep(60)

    async def send(message):
        sent.append(message)

    head = [(b"host", b"localhost"), (b"content-length", b"10")]
    asked = {"method": "POST", "path": "/jobs", "raw_path": b"/jobs", "query_string": b"", "headers": head}
    asyncio.run(application()({"type": "http"} | asked, never, send))
    assert sent[0]["status"] == 408
    assert sent[1]["body"].count(b"\n") == 1


def test_the_form_offers_what_may_be_asked_and_is_filled_from_the_address(idle):
    page = idle.get("/jobs?target=tau+Cet&bands=F520")
    html5lib.HTMLParser(strict=True).parse(page.text)
    assert '<form method="post" action="/jobs">' in page.text
    assert 'value="tau Cet"' in page.text
    names = set(re.findall(r'name="([a-z_]+)"', page.text)) - {"viewport", "color"}
    for name in names:
        assert IMAGES.by_name[name].flag not in IMAGES.left_out


def test_what_is_not_run_for_visitors_is_shown_with_its_cost(idle):
    told = idle.get("/commands?format=json").json
    page = idle.get("/commands").text
    for command, cost in told.items():
        assert command.split()[0] == "cpic"
        assert cost["wall_s"] > 10
        assert command.replace('"', "&#34;") in page
    assert "cpic whatif survey_default" in told
