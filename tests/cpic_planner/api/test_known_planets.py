"""Known planets by name: their place and light are those of ``cpic known``, and answers are about these."""

import numpy as np
import pytest

import cpic_planner as cp
from catalogs import load_known_planets, open_catalogue, resolve_star
from cpic_core import InputError
from cpic_planner.api.one_star import star_or_planet
from cpic_planner.etc import build_model
from cpic_planner.queries import EtcQuestion
from cpic_planner.ranking import KnownChoice
from cpic_planner.ranking.known_answer import known_answer
from cpic_planner.targets import find_target
from simulator.config import MeasuredAlbedo, load_instrument

DATE = "2030-01-01T00:00:00"
TIME = {"time_s": 36000.0, "date_utc": DATE}


def test_every_planet_of_a_star_of_the_catalogue_is_found_by_its_name():
    table, catalogue = load_known_planets(), open_catalogue("snapshot")
    found = 0
    for star, planet in zip(table.text("star"), table.text("planet"), strict=True):
        try:
            resolve_star(star)
        except InputError:
            continue
        mine = star_or_planet(EtcQuestion.of({"target": planet, "detect": True}), planet, catalogue)[2]
        assert mine is not None, planet
        assert mine.name == planet
        found += 1
    assert found > 100


@pytest.mark.parametrize("name", ["alpha Cen B", "alpha Cen b", "61 Cyg A", "70 Oph B", "tau Cet", "HD 10700"])
def test_stars_stay_stars(name):
    question = EtcQuestion.of({"target": name, "detect": True})
    star, _, planet = star_or_planet(question, name, open_catalogue("snapshot"))
    assert planet is None
    assert star.name[0] == find_target(name)[0].name[0]


@pytest.mark.parametrize("name", ["eps Eri b", "HD 22049 b", "epsilon Eridani b"])
def test_place_and_contrast_are_those_of_the_table_of_known_planets(name):
    model = build_model(load_instrument(), ["F520", "F662"])
    star = find_target("eps Eri", date_utc=DATE)[0]
    instrument, albedo = load_instrument(), MeasuredAlbedo(model="jupiter")
    choice = KnownChoice.at("snapshot", DATE, albedo, instrument, n_draws=4000, seed=1)
    (row,) = known_answer(model, star, choice).planets
    answers = cp.signal_to_noise(name, bands=["F520", "F662"], **TIME)
    assert [answer.band for answer in answers] == ["F520", "F662"]
    for answer, band in zip(answers, row.bands, strict=True):
        look = answer.known_planet
        assert (look.planet, look.status) == ("eps Eri b", "confirmed")
        assert look.separation_arcsec == row.separation_arcsec
        assert look.contrast == band.contrast
        assert look.hole_share == band.hole_share
        assert look.phase_deg == row.phase_deg
        assert (answer.separation_arcsec, answer.contrast) == (row.separation_arcsec.median, band.contrast.median)


def test_the_answer_is_that_of_a_look_at_the_place():
    (about,) = cp.signal_to_noise("eps Eri b", bands=["F520"], **TIME)
    place = {"separation_arcsec": about.separation_arcsec, "contrast": about.contrast, "bands": ["F520"], **TIME}
    (plain,) = cp.signal_to_noise("eps Eri", strategy={"search": "known_place"}, **place)
    same = about.model_copy(update={"known_planet": None})
    assert same == plain
    (blind,) = cp.signal_to_noise("eps Eri b", strategy={"search": "blind"}, bands=["F520"], **TIME)
    assert (about.verdict_mode, blind.verdict_mode) == ("known_place", "blind")


def test_ranges_hold_what_the_draws_say():
    (snr,) = cp.signal_to_noise("eps Eri b", bands=["F520"], **TIME)
    value = snr.known_planet.value
    assert 0.0 <= value.low < value.median < value.high
    assert value.high > snr.value
    # On the diagonal the hole is left at both corners, and the aperture before the planet.
    assert value.answered_share <= snr.known_planet.hole_share
    (time,) = cp.exposure_time("eps Eri b", bands=["F520"], snr=3.0, date_utc=DATE)
    assert time.known_planet.value.low < time.value
    (limit,) = cp.contrast_limit("eps Eri b", bands=["F520"], **TIME)
    assert limit.known_planet.value.low <= limit.value


@pytest.fixture
def exact(tmp_path):
    """A planet whose orbit has no errors: on a circle seen from above, 0.6 arcsec from tau Cet."""
    path = tmp_path / "exact.csv"
    columns = "star,planet,status,semi_major_axis_au,eccentricity,inclination_deg,node_deg,radius_rjup,mass_mjup,"
    columns += "star_mass_msun,periastron_jd,omega_deg"
    path.write_text(f"{columns}\ntau Cet,tau Cet z,confirmed,2.19,0,0,0,1,1,0.78,2462502.5,0\n", encoding="utf-8")
    return f"none+{path}"


def test_without_errors_there_is_one_answer(exact):
    (answer,) = cp.signal_to_noise("tau Cet z", known_planets=exact, bands=["F520"], **TIME)
    look = answer.known_planet
    assert look.separation_arcsec.low == pytest.approx(look.separation_arcsec.high, rel=1e-9)
    assert look.separation_arcsec.median == pytest.approx(2.19 / 3.650, rel=2e-3)
    assert look.phase_deg.median == pytest.approx(90.0)
    assert look.value.answered_share == 1.0
    assert look.value.low == pytest.approx(answer.value, rel=1e-6)
    assert look.value.high == pytest.approx(answer.value, rel=1e-6)
    (plain,) = cp.signal_to_noise("tau Cet", separation_arcsec=look.separation_arcsec.median, bands=["F520"], **TIME)
    assert look.contrast.median == pytest.approx(plain.contrast, rel=1e-6)


def test_stars_and_planets_stand_in_the_order_asked():
    rows = cp.signal_to_noise(["tau Cet", "eps Eri b", "eps Ind"], bands=["F520"], **TIME)
    assert [(row.target, row.known_planet is not None) for row in rows] == [
        ("tau Cet", False),
        ("eps Eri", True),
        ("eps Ind", False),
    ]


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("eps Eri b", {"separation_arcsec": 0.5}, "separation_arcsec"),
        ("eps Eri b", {"separation_au": 2.0}, "separation_au"),
        ("eps Eri b", {"contrast": 1e-8}, "contrast"),
        ("eps Eri b", {"planet": {"radius_rjup": 2.0}}, "radius_rjup"),
        ("eps Eri b", {"planet": {"phase_deg": 60.0}}, "phase_deg"),
        ("eps Eri c", {}, "of this star: eps Eri b"),
        ("eps Xyz b", {}, "star"),
        ("Vega b", {}, "Vega"),
    ],
)
def test_what_the_table_sets_is_not_given_too(name, given, words):
    with pytest.raises(InputError, match=words):
        cp.signal_to_noise(name, bands=["F520"], **given, **TIME)


def test_what_planets_reflect_can_be_chosen():
    dark, bright = (
        cp.signal_to_noise("eps Eri b", planet={"albedo": albedo}, bands=["F520"], **TIME)[0] for albedo in (0.2, 0.4)
    )
    assert bright.contrast == pytest.approx(2.0 * dark.contrast)
    assert np.isfinite(bright.value)
    assert bright.value > dark.value
