"""Asking SIMBAD: the queries mean what they say, and an answer counts only when it is whole."""

import pickle
import time

import pytest

from catalogs import Cuts, RefreshError, TapService, queries, service_url
from catalogs.simbad import ask

STARS, MEASUREMENTS = queries(Cuts())


def quick(service, **changes):
    return TapService(**({"url": service.url, "timeout_s": 5.0, "retries": 2, "pause_s": 0.01} | changes))


def test_first_query_gives_every_object_within_the_cuts_once(simbad, sky):
    table = ask(quick(simbad), STARS)
    wanted = [star[1] for star in sky.STARS if star[12] is not None and star[12] <= 7.5 and star[4] >= 25.0]
    assert sorted(table["main_id"]) == sorted(wanted)
    assert "HD 999005" in wanted, "the edge itself belongs to the cut"
    assert table["V"][list(table["main_id"]).index("* tau Cet")] == pytest.approx(3.5)
    assert not table["ids"][list(table["main_id"]).index("HD 999011")], "an object without identifiers stays"


def test_second_query_gives_all_measurements_of_the_same_objects(simbad, sky):
    table = ask(quick(simbad), MEASUREMENTS)
    outside = {14}
    assert sorted(table["oidref"]) == sorted(row[0] for row in sky.MEASUREMENTS if row[0] not in outside)


@pytest.mark.parametrize(("v_mag_max", "parallax_min_mas"), [(6.0, 25.0), (7.5, 100.0), (4, 30.5)])
def test_cuts_are_in_the_queries(simbad, sky, v_mag_max, parallax_min_mas):
    cuts = Cuts(v_mag_max=v_mag_max, parallax_min_mas=parallax_min_mas)
    inside = {s[0]: s[1] for s in sky.STARS if s[12] is not None and s[12] <= v_mag_max and s[4] >= parallax_min_mas}
    first, second = (ask(quick(simbad), query) for query in queries(cuts))
    assert set(first["main_id"]) == set(inside.values())
    assert set(second["oidref"]) == {row[0] for row in sky.MEASUREMENTS if row[0] in inside}


def test_request_is_a_tap_request_with_a_limit_and_nothing_else_is_asked(simbad):
    ask(quick(simbad, maxrec=77), STARS)
    assert simbad.paths == ["/simbad/sim-tap/sync"]
    assert simbad.maxrec == [77]
    assert simbad.queries == [STARS]


def test_same_question_is_asked_anew_each_time(simbad):
    first = ask(quick(simbad), STARS)
    simbad.tables["basic"] = simbad.tables["basic"][:3]
    assert len(ask(quick(simbad), STARS)) == 3 < len(first)


def test_a_wrong_query_is_refused_with_the_reason_and_not_repeated(simbad):
    for query, words in (
        ("SELECT b.oid FROM basic AS b WHERE b.nonsense > 1", "nonsense"),
        ("SELECT b.oid FROM stars AS b WHERE b.oid > 1", "stars"),
        ("DROP TABLE basic", "cannot parse"),
    ):
        before = len(simbad.queries)
        with pytest.raises(RefreshError, match=words) as failure:
            ask(quick(simbad), query)
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
        ask(quick(simbad), STARS, tell=heard.append)
    assert len(simbad.queries) == attempts
    assert len(heard) == attempts - 1
    assert failure.value.remedy
    assert "\n" not in str(failure.value)


def test_connection_dropped_twice_then_answered(simbad):
    simbad.mode, simbad.failures = "drop", 2
    heard = []
    assert len(ask(quick(simbad), STARS, tell=heard.append)) > 10
    assert len(simbad.queries) == 3
    assert len(heard) == 2
    assert "trying again" in heard[0]


def test_pauses_grow(simbad, monkeypatch):
    simbad.mode, simbad.failures = "500", 2
    pauses = []
    monkeypatch.setattr(time, "sleep", pauses.append)
    ask(quick(simbad, pause_s=0.1), STARS)
    assert pauses == [0.1, 0.2]


@pytest.mark.parametrize("mode", ["hang", "drip"])
def test_time_limit_holds_for_the_whole_answer(simbad, mode):
    simbad.mode = mode  # one byte of a slow answer comes in time, the whole does not
    with pytest.raises(RefreshError, match=r"within 0\.4 s"):
        ask(quick(simbad, timeout_s=0.4, retries=0), STARS)


@pytest.mark.parametrize("mode", ["gzip", "chunked"])
def test_other_ways_of_sending_are_read(simbad, mode):
    simbad.mode = mode
    assert "* tau Cet" in list(ask(quick(simbad), STARS)["main_id"])


@pytest.mark.parametrize("mode", ["refer", "refer gzip", "refer packed"])
def test_an_answer_that_refers_to_an_address_is_refused_and_nobody_is_asked(simbad, mode):
    simbad.mode = mode
    with pytest.raises(RefreshError, match="references are not followed"):
        ask(quick(simbad), STARS)
    assert simbad.paths == ["/simbad/sim-tap/sync"]


def test_an_answer_that_grows_beyond_the_limit_when_unpacked_is_refused(simbad, monkeypatch):
    monkeypatch.setattr("catalogs.tap_session.MAX_ANSWER_BYTES", 5000)
    simbad.mode = "gzip"
    with pytest.raises(RefreshError, match="larger than"):
        ask(quick(simbad), STARS)


@pytest.mark.parametrize("mode", ["", "silent limit"])
def test_as_many_rows_as_allowed_count_as_cut_off(simbad, mode):
    whole = len(ask(quick(simbad), STARS))
    simbad.mode = mode
    for maxrec in (whole, whole - 1):
        with pytest.raises(RefreshError, match=rf"cut off at {maxrec} rows.*--maxrec"):
            ask(quick(simbad, maxrec=maxrec), STARS)
    assert len(ask(quick(simbad, maxrec=whole + 1), STARS)) == whole


def test_nobody_listens():
    with pytest.raises(RefreshError, match="Connection refused"):
        ask(TapService(url="http://127.0.0.1:9/tap", retries=0), STARS)


def test_this_machine_is_reached_without_the_proxy_of_the_environment(simbad, monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "https_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    assert len(ask(quick(simbad, retries=0), STARS)) > 10


def test_other_machines_are_reached_through_the_proxy_of_the_environment(simbad, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    with pytest.raises(RefreshError, match="refused"):
        ask(TapService(url="http://192.0.2.1/tap", retries=0, timeout_s=5.0), STARS)


def test_default_service_is_that_of_astroquery(monkeypatch):
    monkeypatch.delenv("CPIC_SIMBAD_URL", raising=False)
    from astroquery.simbad import conf

    assert service_url(TapService()) == f"https://{conf.server}/simbad/sim-tap"
    with conf.set_temp("server", "simbad.harvard.edu"):
        assert service_url(TapService()) == "https://simbad.harvard.edu/simbad/sim-tap"
    for given in ("http://localhost:8000/tap", "http://localhost:8000/tap/", "http://localhost:8000/tap/sync"):
        assert service_url(TapService(url=given)) == "http://localhost:8000/tap"


def test_environment_may_name_the_service(refused, simbad, monkeypatch):
    monkeypatch.setenv("CPIC_SIMBAD_URL", simbad.url)
    assert len(ask(TapService(retries=0), STARS)) > 10
    assert service_url(TapService(url="http://localhost:8000/tap")) == "http://localhost:8000/tap"
    monkeypatch.setenv("CPIC_SIMBAD_URL", "simbad.example.org")
    refused("CPIC_SIMBAD_URL.*http://", service_url, TapService())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Cuts(v_mag_max=float("nan")), "v_mag_max"),
        (lambda: Cuts(v_mag_max=99.0), "v_mag_max"),
        (lambda: Cuts(parallax_min_mas=0.0), "parallax_min_mas"),
        (lambda: TapService(url="simbad.example.org"), "http"),
        (lambda: TapService(timeout_s=0.0), "timeout_s"),
        (lambda: TapService(retries=-1), "retries"),
        (lambda: TapService(maxrec=0), "maxrec"),
        (lambda: TapService(pause_s=-1.0), "pause_s"),
    ],
)
def test_settings_are_checked(refused, make, words):
    refused(words, make)


def test_error_travels_between_processes():
    error = RefreshError("what", "remedy")
    back = pickle.loads(pickle.dumps(error))
    assert str(back) == str(error) == "what; remedy"


@pytest.mark.network
def test_the_real_service_answers_both_questions():
    cuts = Cuts(v_mag_max=4.0, parallax_min_mas=250.0)
    from catalogs.simbad_answer import read_measurements, read_stars

    stars, measurements = (ask(TapService(), query) for query in queries(cuts))
    answer = read_stars(stars)
    found = dict(zip(answer.main_id, answer.v_mag, strict=True))
    assert found["* tau Cet"] == pytest.approx(3.5, abs=0.05)
    assert found["* eps Eri"] == pytest.approx(3.73, abs=0.05)
    assert len(read_measurements(measurements)) > 100
