"""The way from a star's name to the time beside three calculators: what makes them differ."""

import csv
from importlib.resources import files

import numpy as np
import pytest

from reports.external import comparison
from reports.external.comparisons import stark
from reports.external.star_in_band import Star

CASES = comparison.recorded("stark")["cases"]
PLACES = sorted({(case["star"], case["wavelength_nm"]) for case in CASES})


def _of(code: str, star: str, wavelength_nm: float) -> stark.Case:
    place = (code, star, wavelength_nm)
    return next(case for case in CASES if (case["code"], case["star"], case["wavelength_nm"]) == place)


def test_all_of_the_sheet_is_there():
    assert len(CASES) == 30
    assert len({case["star"] for case in CASES}) == 5


def test_what_is_known_to_differ_does():
    assert [row.what for row in stark.rows(comparison.recorded("stark")) if row.agrees and not row.expected] == []


@pytest.mark.parametrize(("name", "wavelength_nm"), PLACES)
def test_dust_of_the_stars_colour_is_ayos_and_of_vegas_is_the_others(name, wavelength_nm):
    star = Star(name, wavelength_nm)
    ayo, ebs = _of("ayo", name, wavelength_nm), _of("ebs", name, wavelength_nm)
    ours = stark.fluxes(star, ayo["L_star"], ayo["dist"], light=ayo["F_star"])["F_exozodi"]
    assert ours == pytest.approx(ayo["F_exozodi"], rel=0.025)
    assert stark.as_code(star, ebs)["F_exozodi"] == pytest.approx(ebs["F_exozodi"], rel=1e-3)
    # One brightness around every star is no starlight that dust has scattered.
    assert ebs["F_exozodi"] == pytest.approx(3.0 * ebs["F_0"] * 10.0 ** (-0.4 * 22.0), rel=1e-3)


@pytest.mark.parametrize("name", sorted({star for star, _ in PLACES}))
def test_dust_is_grey(name):
    """Ours is the same fraction of the star at both wavelengths; that of EBS is 2 to 6 times less at 1000 nm."""
    ours, ebs = [], []
    for wavelength in (500, 1000):
        case = _of("ebs", name, wavelength)
        found = stark.fluxes(Star(name, wavelength), case["L_star"], case["dist"])
        ours.append(found["F_exozodi"] / found["F_star"])
        ebs.append(case["F_exozodi"] / case["F_star"])
    assert ours[1] == pytest.approx(ours[0], rel=0.01)
    assert 2.0 < ebs[0] / ebs[1] < 6.0


def test_zodiacal_light_follows_the_place_of_the_sun():
    """18 Sco is ten times brighter 24 degrees from the Sun, where EXOSIMS looks, than 135 degrees from it."""
    star = Star("HIP 79672", 500)
    near, far = _of("exosims", star.name, 500), _of("ayo", star.name, 500)
    assert near["sun_longitude_deg"] == pytest.approx(23.65, abs=0.01)
    assert near["F_zodi"] / far["F_zodi"] == pytest.approx(10.06, rel=0.01)
    ours = star.zodiacal(near["sun_longitude_deg"]) / star.zodiacal(far["sun_longitude_deg"])
    assert ours == pytest.approx(near["F_zodi"] / far["F_zodi"], rel=0.07)


@pytest.mark.parametrize("name", sorted({star for star, _ in PLACES}))
def test_at_500_nm_the_time_lies_among_the_codes_where_the_planet_is_theirs(name):
    codes = {code: _of(code, name, 500) for code in stark.CODES}
    ayo = codes["ayo"]
    found = stark.rates(Star(name, 500), stark.fluxes(Star(name, 500), ayo["L_star"], ayo["dist"]), ayo)
    for convention in ("ayo", "ebs"):
        ours = stark.science_time(found | {"CR_bstray": ayo["CR_bstray"]}, convention)
        theirs = [stark.science_time(case, convention) for case in codes.values()]
        assert min(theirs) <= ours <= max(theirs)


def test_times_of_the_sheet_follow_from_its_rates():
    for case in CASES:
        assert stark.science_time(case, case["code"]) == pytest.approx(case["t_science"], rel=5e-3)
        assert stark.wall_time(case["t_science"], case["code"]) == pytest.approx(case["t_exp"], rel=2e-3)


def test_the_table_is_what_ebs_has_at_ten_separations():
    """The leak is an intensity times the aperture, over the planet's throughput; the ends are assumed."""
    text = (files("simulator") / "presets/coronagraph/hwo_example.csv").read_text(encoding="utf-8")
    table = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    points = sorted((case for case in CASES if case["code"] == "ebs"), key=lambda case: case["sp"])
    assert len(table) == len(points) + 2
    for row, case in zip(table[1:-1], points, strict=True):
        contrast = case["I_star"] * case["omega_core"] / case["T_core"]
        expected = {
            "separation_lambda_d": case["sp"],
            "core_throughput": case["T_core"],
            "raw_contrast": contrast,
            "contrast_stability": stark.FLOOR * contrast,
            "occulter_transmission": case["skytrans"] / stark.SKY_PIXELS,
            "core_area_lambda_d2": case["omega_core"],
        }
        assert {name: float(value) for name, value in row.items()} == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("name", "wavelength_nm"), PLACES)
def test_the_calculator_gives_what_its_rates_give(name, wavelength_nm):
    """`exposure_time` beside the few lines of `rates`; besides, it measures the background's mean in an annulus."""
    star, ebs = Star(name, wavelength_nm), _of("ebs", name, wavelength_nm)
    found = stark.whole_way(star, ebs["t_photon_count"])
    assert stark.science_time(found, "ayo") == pytest.approx(found["t_science"], rel=0.01)
    place = float(star.row.luminosity_lsun), float(star.row.distance_pc)
    points = np.array(sorted((case["sp"], case["skytrans"]) for case in CASES if case["code"] == "ebs"))
    optics = ebs | {"T_core": found["T_core"], "skytrans": np.interp(found["sp"], *points.T)}
    expected = stark.rates(star, stark.fluxes(star, *place), optics)
    inside = found["sp"] > points[0, 0]
    for rate in ("CR_p", "CR_bd", *(("CR_bz", "CR_bez") if inside else ())):
        assert found[rate] == pytest.approx(expected[rate], rel=0.01), rate
