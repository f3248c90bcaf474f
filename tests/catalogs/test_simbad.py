"""Asking SIMBAD: the queries mean what they say, and an answer counts only when it is whole."""

import pytest

from catalogs import Cuts, TapService, queries, service_url
from catalogs.archives import ask

STARS, MEASUREMENTS = queries(Cuts())


def answered(service, query, **changes):
    """Cells of the columns of an answer."""
    asked = TapService(**({"url": service.url, "retries": 0} | changes))
    return {column.heading: column.cells.tolist() for column in ask(asked, service_url(asked), query).columns}


def test_first_query_gives_every_object_within_the_cuts_once(simbad, sky):
    table = answered(simbad, STARS)
    wanted = [star[1] for star in sky.STARS if star[12] is not None and star[12] <= 7.5 and star[4] >= 25.0]
    assert sorted(table["main_id"]) == sorted(wanted)
    assert "HD 999005" in wanted, "the edge itself belongs to the cut"
    assert table["V"][table["main_id"].index("* tau Cet")] == 3.5, "as the service wrote it, though of single precision"
    assert not table["ids"][table["main_id"].index("HD 999011")], "an object without identifiers stays"


def test_second_query_gives_all_measurements_of_the_same_objects(simbad, sky):
    table = answered(simbad, MEASUREMENTS)
    outside = {14}
    assert sorted(table["oidref"]) == sorted(row[0] for row in sky.MEASUREMENTS if row[0] not in outside)


@pytest.mark.parametrize(("v_mag_max", "parallax_min_mas"), [(6.0, 25.0), (7.5, 100.0), (4, 30.5)])
def test_cuts_are_in_the_queries(simbad, sky, v_mag_max, parallax_min_mas):
    cuts = Cuts(v_mag_max=v_mag_max, parallax_min_mas=parallax_min_mas)
    inside = {s[0]: s[1] for s in sky.STARS if s[12] is not None and s[12] <= v_mag_max and s[4] >= parallax_min_mas}
    first, second = (answered(simbad, query) for query in queries(cuts))
    assert set(first["main_id"]) == set(inside.values())
    assert set(second["oidref"]) == {row[0] for row in sky.MEASUREMENTS if row[0] in inside}


def test_request_is_a_tap_request_with_a_limit_and_nothing_else_is_asked(simbad):
    answered(simbad, STARS, maxrec=77)
    assert simbad.paths == ["/simbad/sim-tap/sync"]
    assert simbad.maxrec == [77]
    assert simbad.queries == [STARS]


def test_same_question_is_asked_anew_each_time(simbad):
    first = answered(simbad, STARS)
    simbad.tables["basic"] = simbad.tables["basic"][:3]
    assert len(answered(simbad, STARS)["oid"]) == 3 < len(first["oid"])


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
    assert service_url(TapService()) == simbad.url
    assert service_url(TapService(url="http://localhost:8000/tap")) == "http://localhost:8000/tap"
    monkeypatch.setenv("CPIC_SIMBAD_URL", "simbad.example.org")
    refused("CPIC_SIMBAD_URL.*https://", service_url, TapService())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Cuts(v_mag_max=float("nan")), "v_mag_max"),
        (lambda: Cuts(v_mag_max=99.0), "v_mag_max"),
        (lambda: Cuts(parallax_min_mas=0.0), "parallax_min_mas"),
    ],
)
def test_settings_are_checked(refused, make, words):
    refused(words, make)


@pytest.mark.network
def test_the_real_service_answers_both_questions():
    cuts = Cuts(v_mag_max=4.0, parallax_min_mas=250.0)
    from catalogs.simbad import read_measurements, read_stars

    stars, measurements = (ask(TapService(), service_url(TapService()), query) for query in queries(cuts))
    answer = read_stars(stars)
    found = {star["main_id"]: star["v_mag"] for star in answer}
    assert found["* tau Cet"] == pytest.approx(3.5, abs=0.05)
    assert found["* eps Eri"] == pytest.approx(3.73, abs=0.05)
    assert len(read_measurements(measurements)) > 100
