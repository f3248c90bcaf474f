"""One client for every service: an answer counts only when it is whole, and the time and the bytes are kept to."""

import io
import pickle
import time

import pytest
from astropy.io.votable import from_table
from astropy.table import MaskedColumn, Table

from catalogs import Cuts, RefreshError, TapService, archives, queries
from catalogs.archives import ask

STARS, _ = queries(Cuts())


def asked(service, query=STARS, *, tell=lambda text: None, url="", **changes):
    """Put a question, and return the cells of the answer's columns."""
    patience = TapService(**({"timeout_s": 120.0, "retries": 2, "pause_s": 0.01} | changes))
    found = ask(patience, url or service.url, query, narrower="ask for less", tell=tell)
    return {column.heading: column.cells.tolist() for column in found.columns}


def test_a_wrong_query_is_refused_with_the_reason_and_not_repeated(simbad):
    for query, words in (
        ("SELECT b.oid FROM basic AS b WHERE b.nonsense > 1", "nonsense"),
        ("SELECT b.oid FROM stars AS b WHERE b.oid > 1", "stars"),
        ("DROP TABLE basic", "cannot parse"),
    ):
        before = len(simbad.queries)
        with pytest.raises(RefreshError, match=words) as failure:
            asked(simbad, query)
        assert len(simbad.queries) == before + 1
        assert "\n" not in str(failure.value)


@pytest.mark.parametrize(
    ("mode", "words", "attempts"),
    [
        ("error", "maintenance of <SIMBAD>", 1),
        ("404", "HTTP 404", 1),
        ("500", "HTTP 500", 3),
        ("drop", "dropped", 3),
        ("html", "web page", 3),
        ("garbage", "no VOTable", 3),
        ("cut", "breaks off", 3),
        ("short", "dropped", 3),
        ("empty", "the answer is empty", 3),
        ("chunked cut", "dropped", 3),
        ("server limit", r"cut off at 5 rows \(allowed: 200000\); ask for less", 1),
    ],
)
def test_failures_are_named_and_only_those_on_the_way_are_repeated(simbad, mode, words, attempts):
    simbad.mode, simbad.failures = mode, 99
    heard = []
    with pytest.raises(RefreshError, match=words) as failure:
        asked(simbad, tell=heard.append)
    assert len(simbad.queries) == attempts
    assert len(heard) == attempts - 1
    assert failure.value.remedy
    assert "\n" not in str(failure.value)


def test_connection_dropped_twice_then_answered(simbad):
    simbad.mode, simbad.failures = "drop", 2
    heard = []
    assert len(asked(simbad, tell=heard.append)["oid"]) > 10
    assert len(simbad.queries) == 3
    assert len(heard) == 2
    assert "trying again" in heard[0]


def test_pauses_grow(simbad, monkeypatch):
    simbad.mode, simbad.failures = "500", 2
    pauses = []
    monkeypatch.setattr(time, "sleep", pauses.append)
    asked(simbad, pause_s=0.1)
    assert pauses == [0.1, 0.2]


@pytest.mark.parametrize("mode", ["hang", "drip"])
def test_time_limit_holds_for_the_whole_answer(simbad, mode):
    simbad.mode = mode  # one byte of a slow answer comes in time, the whole does not
    with pytest.raises(RefreshError, match=r"within 0\.4 s"):
        asked(simbad, timeout_s=0.4, retries=0)


@pytest.mark.parametrize("mode", ["gzip", "chunked"])
def test_other_ways_of_sending_are_read(simbad, mode):
    simbad.mode = mode
    assert "* tau Cet" in asked(simbad)["main_id"]


@pytest.mark.parametrize("form", ["tabledata", "binary", "binary2"])
def test_every_form_of_a_votable_is_read_with_what_is_missing(simbad, form):
    table = Table({"main_id": ["HD 1", "", "HD 3"], "ra": MaskedColumn([1.5, 2.5, 3.5], mask=[False, False, True])})
    content = io.BytesIO()
    from_table(table).to_xml(content, tabledata_format=form)
    simbad.mode, simbad.data = "data", (content.getvalue(),)
    assert asked(simbad) == {"main_id": ["HD 1", None, "HD 3"], "ra": [1.5, 2.5, None]}


def said(name, place, tap):
    """Return an answer of one row that says its status in a place of the document."""
    data = tap.votable([("oid", "long", "")], [[1]]).decode()
    note = f'<INFO name="QUERY_STATUS" value="{name}">it was stopped</INFO>'
    return data.replace(
        *{"end": ("</VOTABLE>", f"{note}</VOTABLE>"), "table": ("</TABLE>", f"{note}</TABLE>")}[place]
    ).encode()


@pytest.mark.parametrize("place", ["end", "table"])
@pytest.mark.parametrize(("name", "words"), [("OVERFLOW", "cut off at 1 rows"), ("ERROR", "ERROR|it was stopped")])
def test_a_status_counts_wherever_it_stands(simbad, tap, name, place, words):
    simbad.mode, simbad.data = "data", (said(name, place, tap),)
    with pytest.raises(RefreshError, match=words):
        asked(simbad, retries=0)


@pytest.mark.parametrize(
    ("status", "kind", "words", "attempts"),
    [
        (500, "application/x-votable+xml", "HTTP 500", 3),
        (503, "text/plain", "HTTP 503", 3),
        (429, "application/x-votable+xml", "HTTP 429", 3),
        (403, "application/x-votable+xml", "HTTP 403", 1),
        (400, "text/plain", "HTTP 400", 1),
    ],
)
def test_a_whole_table_with_a_status_of_error_is_no_answer(simbad, tap, status, kind, words, attempts):
    simbad.mode, simbad.data = "data", (tap.votable([("oid", "long", "")], [[1]]), status, kind)
    with pytest.raises(RefreshError, match=words):
        asked(simbad)
    assert len(simbad.queries) == attempts


@pytest.mark.parametrize("mode", ["redirect heavily", "data"])
def test_what_is_no_answer_is_no_larger_than_allowed_either(simbad, mode):
    """A redirect, and a refusal in plain text: both are read by packages that we use, whole."""
    simbad.mode, simbad.data = mode, (b" " * 2_000_000, 400, "text/plain")
    with pytest.raises(RefreshError, match="larger than"):
        asked(simbad, max_bytes=1_000_000)


def test_what_is_packed_several_times_is_no_larger_than_allowed(simbad):
    simbad.mode, simbad.data = "data", (b" " * 20_000_000, 200, "text/xml", "gzip, gzip")
    with pytest.raises(RefreshError, match="larger than"):
        asked(simbad, max_bytes=10_000_000)


@pytest.mark.parametrize("mode", ["refer", "refer gzip", "refer packed"])
def test_an_answer_that_refers_to_an_address_is_refused_and_nobody_is_asked(simbad, mode):
    simbad.mode = mode
    with pytest.raises(RefreshError, match="references are not followed"):
        asked(simbad)
    assert simbad.paths == ["/simbad/sim-tap/sync"]


@pytest.mark.parametrize(("mode", "max_bytes"), [("bomb", 10_000_000), ("many rows", 1_000_000), ("", 1000)])
def test_an_answer_larger_than_allowed_packed_or_not_is_refused(simbad, mode, max_bytes):
    simbad.mode = mode
    with pytest.raises(RefreshError, match=rf"larger than {max_bytes / 2**20:.3g} MB"):
        asked(simbad, max_bytes=max_bytes)
    assert len(simbad.queries) == 1


@pytest.mark.parametrize(
    "mode",
    [
        "redirect slowly",
        "many rows",
        *(pytest.param(mode, marks=pytest.mark.long) for mode in ("trickled header", "continue")),
    ],
)
def test_a_service_that_does_not_end_is_left_when_the_time_is_up(simbad, mode):
    simbad.mode = mode
    with pytest.raises(RefreshError, match=r"within 0\.1 s"):
        asked(simbad, timeout_s=0.1, retries=0)
    simbad.mode = ""
    assert "* tau Cet" in asked(simbad)["main_id"], "the next question is answered"


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("redirect", "redirects more than 5 times"),
        ("redirect file:///etc/passwd", "file:///etc/passwd"),
        ("redirect http://localhost/tap", "redirects to http://localhost, another host"),
        ("redirect http://192.0.2.1/tap", "redirects to http://192.0.2.1, which is not asked"),
        ("bomb", "the answer is empty"),
        ("long text", "more than 20000 letters"),
        ("promised rows", "takes more than 4 GB of memory"),
        ("no table", "holds no table"),
    ],
)
def test_what_no_service_should_send_is_refused(simbad, mode, words):
    simbad.mode = mode
    with pytest.raises(RefreshError, match=words) as failure:
        asked(simbad, retries=0)
    assert "\n" not in str(failure.value)
    simbad.mode = ""
    assert "* tau Cet" in asked(simbad)["main_id"], "the next question is answered"


def test_many_rows_are_read_where_there_is_time(simbad):
    simbad.mode = "many rows"
    assert len(asked(simbad)["oid"]) == 150_000


def test_a_redirect_is_followed_on_the_same_host_and_elsewhere_when_asked(simbad, tap):
    other = tap.TapService({})
    for code in ("307 ", ""):  # the first asks for the whole question again
        simbad.mode = f"redirect {code}{other.url}/sync"
        with pytest.raises(RefreshError, match=f"redirects to {other.url[:16]}.*another host"):
            asked(simbad, retries=0)
        assert other.paths == []
    with pytest.raises(RefreshError, match="HTTP 404"):
        asked(simbad, retries=0, other_hosts=True)
    assert other.paths == ["/simbad/sim-tap/sync"]
    other.close()


def test_an_interruption_ends_the_process_and_the_next_question_has_its_own_answer(simbad, monkeypatch):
    simbad.mode = "hang"

    def interrupt(lines, time_s):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(archives, "wait", interrupt)
        with pytest.raises(KeyboardInterrupt):
            asked(simbad)
    simbad.mode = ""
    assert asked(simbad, "SELECT b.oid FROM basic AS b WHERE b.oid = 3") == {"oid": [3]}


def test_a_process_that_died_is_replaced(simbad):
    asked(simbad)
    archives._PROCESS._child.kill()
    archives._PROCESS._child.wait()
    assert "* tau Cet" in asked(simbad)["main_id"]


def test_a_process_that_may_be_about_to_end_is_replaced(simbad, monkeypatch):
    """It ends when it has been idle for a while."""
    asked(simbad)
    first = archives._PROCESS._child
    asked(simbad)
    assert archives._PROCESS._child is first
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 0.6 * archives.IDLE_S)
    asked(simbad)
    assert archives._PROCESS._child is not first
    assert first.returncode is not None


@pytest.mark.parametrize("mode", ["", "silent limit"])
def test_as_many_rows_as_allowed_count_as_cut_off(simbad, mode):
    whole = len(asked(simbad)["oid"])
    simbad.mode = mode
    for maxrec in (whole, whole - 1):
        with pytest.raises(RefreshError, match=rf"cut off at {maxrec} rows.*--maxrec"):
            asked(simbad, maxrec=maxrec)
    assert len(asked(simbad, maxrec=whole + 1)["oid"]) == whole


def test_nobody_listens():
    with pytest.raises(RefreshError, match="Connection refused"):
        asked(None, url="http://127.0.0.1:9/tap", retries=0)


def test_this_machine_is_reached_without_the_proxy_of_the_environment(simbad, monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "https_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    assert len(asked(simbad)["oid"]) > 10


def test_other_machines_are_reached_through_the_proxy_of_the_environment(simbad, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    with pytest.raises(RefreshError, match="refused"):
        asked(None, url="http://192.0.2.1/tap", retries=0, plain_http=True)


def test_error_travels_between_processes():
    error = RefreshError("what", "remedy")
    back = pickle.loads(pickle.dumps(error))
    assert str(back) == str(error) == "what; remedy"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: TapService(url="simbad.example.org"), "url.*https://"),
        (lambda: TapService(url="file:///etc/passwd"), "url.*https://"),
        (lambda: TapService(url="http://["), "url.*https://"),
        (lambda: TapService(url="http://simbad.example.org/tap"), "url.*https://.*--plain-http"),
        (lambda: TapService(timeout_s=0.0), "timeout_s"),
        (lambda: TapService(retries=-1), "retries"),
        (lambda: TapService(maxrec=0), "maxrec"),
        (lambda: TapService(pause_s=-1.0), "pause_s"),
        (lambda: TapService(max_bytes=0), "max_bytes"),
    ],
)
def test_settings_are_checked(refused, make, words):
    refused(words, make)


def test_plain_http_is_asked_where_it_will_do_and_on_this_machine():
    for url in ("http://localhost:8000/tap", "http://127.0.0.1/tap", "http://[::1]:1/tap", "https://a.example/tap"):
        assert TapService(url=url).check_url("url", url) == url
    url = "http://a.example/tap"
    assert TapService(url=url, plain_http=True).check_url("url", f"{url}/sync") == url
