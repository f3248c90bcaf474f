import math

import pytest

from catalogs import load_stars, resolve_star
from cpic_core import InputError
from cpic_planner.api import answered
from cpic_planner.queries import EtcQuestion

SOLAR = {"v_mag": 4.83, "teff_k": 5772.0, "distance_pc": 10.0}
PLANET = {"separation_arcsec": [0.5], "bands": ["F520"]}


def asked(**given):
    return answered(EtcQuestion.of(PLANET | given)).result


def answer(**given):
    (row,) = asked(**given).answers
    return row


def test_a_star_by_its_light_is_that_of_a_table_of_one_row(tmp_path):
    table = tmp_path / "stars.csv"
    table.write_text("name,v_mag,sp_type,distance_pc\nBob,4.5,G8V,7\n")
    for goal in ({"snr": 5.0}, {"time_s": 36000.0}, {"contrast_limit": True}):
        mine = answer(v_mag=4.5, sp_type="G8V", distance_pc=7.0, **goal)
        theirs = answer(target="Bob", catalog=str(table), **goal)
        assert mine.value is not None
        assert mine.value == theirs.value
        assert mine.contrast == theirs.contrast


def test_the_sun_at_ten_parsecs_has_the_luminosity_of_the_sun():
    found = asked(**SOLAR, snr=5.0)
    assert found.target == "my star"
    row = found.answers[0]
    # 5 au of projected separation at phase 90 deg: A (R/r)^2 / pi with the albedo of Jupiter in F520, near 0.5.
    expected = 0.5 * (71492.0 / (5.0 * 149597870.7)) ** 2 / math.pi
    assert row.contrast == pytest.approx(expected, rel=0.15)


def test_light_falls_with_magnitude_and_nothing_else():
    times = [answer(v_mag=v, sp_type="G2V", contrast=[1e-8], snr=5.0).time_s for v in (3.0, 4.0, 5.0)]
    assert times[0] < times[1] < times[2]


def test_an_assumed_distance_is_said_and_counts_only_where_light_depends_on_it():
    near, far = (answer(v_mag=4.5, sp_type="G8V", snr=5.0, distance_pc=pc) for pc in (10.0, 12.0))
    silent = asked(v_mag=4.5, sp_type="G8V", snr=5.0)
    assert silent.answers[0].value == near.value != far.value
    assert "distance_assumed" in silent.answers[0].flags
    assert "10 pc (assumed)" in silent.catalogue
    limits = [answer(v_mag=4.5, sp_type="G8V", contrast_limit=True, distance_pc=pc).value for pc in (5.0, 50.0)]
    assert limits[0] == pytest.approx(limits[1], rel=1e-3)  # gravity follows from the luminosity


@pytest.mark.parametrize("name", ["HD 999 B", "*", "eps Eri b", "x", "Bob's star, the 2nd"])
def test_any_name_will_do(name):
    assert asked(target=name, v_mag=4.5, sp_type="G8V", snr=5.0).target == name


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({}, "target"),
        ({"v_mag": 4.5}, "sp_type"),
        ({"v_mag": 4.5, "sp_type": "Q"}, "sp_type"),
        ({"v_mag": 45.0, "sp_type": "G2V"}, "v_mag"),
        ({"v_mag": 4.5, "teff_k": 100.0}, "teff_k"),
        ({"target": "tau Cet", "sp_type": "G2V"}, "sp_type"),
        ({"target": "tau Cet", "teff_k": 5000.0}, "teff_k"),
        ({"target": ["a", "b"], "v_mag": 4.5, "sp_type": "G2V"}, "target"),
        ({"v_mag": 4.5, "sp_type": "G2V", "catalog": "simbad_2012"}, "v_mag"),
    ],
)
def test_half_a_star_is_refused(given, key):
    with pytest.raises(InputError) as refused:
        asked(**given, snr=5.0)
    assert refused.value.key == key


def test_a_star_of_the_catalogue_by_its_numbers_is_close_to_itself():
    stars = load_stars()
    row = resolve_star("tau Cet", stars).index
    numbers = {name: float(stars.column(name)[row]) for name in ("v_mag", "teff_k", "distance_pc")}
    goal = {"contrast": [1e-8], "snr": 5.0}
    mine, theirs = answer(**numbers, **goal), answer(target="tau Cet", **goal)
    assert mine.time_s == pytest.approx(theirs.time_s, rel=0.05)
