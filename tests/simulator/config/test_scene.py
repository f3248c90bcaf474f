"""Scenes as people write them: the paper's dictionary, YAML, objects; every fault by its name.

Places and distances: astropy on the sphere, absolute pictures, and what does not follow is refused.
"""

import json

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import Angle, SkyCoord
from hypothesis import given, strategies as st
from pydantic import ValidationError
from scipy import stats

from catalogs import Spectrum
from cpic_core import InputError
from simulator.config import (
    ConstantAlbedo,
    MeasuredAlbedo,
    ParametricAlbedo,
    Planet,
    Scene,
    SceneStar,
    SpectrumTable,
    declination_deg,
    load_scene,
    place,
    preset_names,
    right_ascension_deg,
    true_distance_au,
)
from tools.star_field import star_field

STAR = {"name": "star", "v_mag": 1.35, "teff_k": 5230}

PLANET = {
    "name": "b",
    "radius_rjup": 1,
    "distance_au": 0.8775,
    "phase_deg": 90,
    "separation_arcsec": 0.65,
    "pa_deg": 315,
}

PAPER_STAR = {"magnitude": 1.35, "sptype": "K1V", "distance": 1.35, "ra": "14:39:35.06", "dec": "-60:50:15.1"}

PAPER_PLANET = {"radius": 1, "phase_angle": 90, "separation": 0.65, "pangle": 315, "coe_metal": 1, "coe_cloud": 1}


def scene(**change):
    return {"name": "s", "cstar": STAR} | change


def test_planet_and_planets_mean_the_same():
    one = load_scene(scene(planet=PLANET))
    many = load_scene(scene(planets=[PLANET]))
    alone = load_scene(scene(planets=PLANET))
    assert one == many == alone
    assert one.content_hash == many.content_hash
    assert one.without_planets().planets == ()


def test_the_papers_dictionary():
    found = load_scene({"name": "alpha Cen B", "cstar": PAPER_STAR, "stars": [], "planet": [PAPER_PLANET]})
    assert found.cstar.name == "alpha Cen B"
    assert found.cstar.spectral_type == "K1V"
    assert found.cstar.dec_deg == pytest.approx(-60.8375278, abs=1e-7)
    body = found.planets[0]
    assert (body.name, body.radius_rjup, body.phase_deg, body.separation_arcsec, body.pa_deg) == (
        "planet 1",
        1.0,
        90.0,
        0.65,
        315.0,
    )
    assert body.albedo == ParametricAlbedo(log10_mh=1, log10_fsed=1)
    assert body.reflects


def test_all_spellings_give_one_scene():
    spelled = {
        "radius_rjup": 1,
        "phase_deg": 90,
        "separation_arcsec": 0.65,
        "position_angle": 315,
        "albedo": {"model": "parametric", "log10_mh": 1, "log10_fsed": 1},
    }
    star = {
        "v_mag": 1.35,
        "spectral_type": "K1V",
        "distance_pc": 1.35,
        "ra_deg": "14h39m35.06s",
        "dec_deg": "-60d50m15.1s",
    }
    one = load_scene({"name": "a", "cstar": PAPER_STAR, "planet": PAPER_PLANET})
    other = load_scene({"name": "a", "cstar": star, "planets": [spelled], "stars": None})
    assert one == other
    assert hash(one) == hash(other)
    assert one.content_hash == other.content_hash


def test_objects_and_mappings_mix():
    mixed = Scene(
        name="s",
        cstar=SceneStar(v_mag=1.35, teff_k=5230),
        planets=[Planet(**PLANET)],
        stars=({"v_mag": 5, "teff_k": 4000, "separation_arcsec": 3, "pa_deg": 20},),
    )
    assert [mixed.cstar.name, mixed.planets[0].name, mixed.stars[0].name] == ["s", "b", "star 1"]
    assert load_scene(mixed) is mixed


def test_scenes_are_frozen_and_hash_by_content():
    one, other = load_scene(scene(planet=PLANET)), load_scene(scene(planet=PLANET | {"pa_deg": 314}))
    assert one.content_hash != other.content_hash
    assert hash(one) == hash(load_scene(scene(planet=dict(reversed(PLANET.items())))))
    with pytest.raises(ValidationError):
        one.name = "x"


@pytest.mark.parametrize(
    "tree",
    [
        scene(planet=PLANET, companions="off"),
        {"name": "a", "cstar": PAPER_STAR, "planet": PAPER_PLANET | {"insolation_au": 2}},
        {
            "name": "a",
            "cstar": PAPER_STAR,
            "stars": [{"v_mag": 9, "teff_k": 4000, "model": "blackbody", "ra": "14:39:35.2", "dec": "-60:50:14"}],
        },
        scene(cstar={"v_mag": 3, "spectrum": {"wavelength_nm": [300, 900, 1800], "flam": [1e-9, 2e-9, 1e-9]}}),
        scene(
            planets=[
                PLANET | {"albedo": 0.3},
                {
                    "name": "t",
                    "separation_arcsec": 1,
                    "pa_deg": 0,
                    "spectrum": {"wavelength_nm": [300, 1800], "photlam": [1, 2]},
                },
            ]
        ),
    ],
)
def test_round_trip_through_json(tree):
    first = load_scene(tree)
    again = load_scene(json.loads(json.dumps(first.model_dump(mode="json"))))
    assert again == first
    assert again.content_hash == first.content_hash


@pytest.mark.parametrize(
    ("given", "albedo"),
    [
        ({}, MeasuredAlbedo(model="jupiter")),
        ({"albedo": "neptune"}, MeasuredAlbedo(model="neptune")),
        ({"albedo": 0.5}, ConstantAlbedo(value=0.5)),
        ({"log10_mh": 1, "fsed": 3}, ParametricAlbedo(log10_mh=1, log10_fsed=np.log10(3))),
        ({"albedo": "parametric", "log10_mh": 0, "log10_fsed": 0}, ParametricAlbedo(log10_mh=0, log10_fsed=0)),
        (
            {"albedo": {"log10_mh": 0, "log10_fsed": 0}, "insolation_au": 2},
            ParametricAlbedo(log10_mh=0, log10_fsed=0, insolation_au=2),
        ),
    ],
)
def test_albedo_as_people_give_it(given, albedo):
    assert load_scene(scene(planet=PLANET | given)).planets[0].albedo == albedo


def test_numbers_of_numpy_and_quantities_of_astropy():
    body = PLANET | {
        "radius_rjup": np.float32(1.0),
        "separation_arcsec": (650.0 * u.mas).astype(np.float64),
        "pa_deg": np.int64(315),
        "distance_au": (0.8775 * u.AU).to(u.km),
        "phase_deg": (np.pi / 2) * u.rad,
    }
    found = load_scene(scene(planet=body)).planets[0]
    assert found.separation_arcsec == pytest.approx(0.65, rel=1e-14)
    assert (found.distance_au, found.phase_deg) == (pytest.approx(0.8775, rel=1e-12), pytest.approx(90.0, rel=1e-14))
    with pytest.raises(
        InputError, match=r"scene.planets.0.separation_arcsec = 1.0 AU: .*a number in arcsec, or a quantity"
    ):
        load_scene(scene(planet=PLANET | {"separation_arcsec": 1.0 * u.AU}))


def test_spectra_as_people_give_them(tmp_path):
    wavelength, photlam = [300.0, 900.0, 1800.0], [1.0, 2.0, 1.0]
    table = SpectrumTable(wavelength_nm=wavelength, photlam=photlam)
    for written in (
        {"wavelength_nm": np.array(wavelength), "photlam": tuple(photlam)},
        Spectrum(np.array(wavelength), np.array(photlam)),
        _synphot(wavelength, photlam),
    ):
        assert load_scene(scene(cstar={"v_mag": 1, "spectrum": written})).cstar.spectrum == table
    file = tmp_path / "mine.txt"
    file.write_text("300 1\n1800 1\n")
    for written in (str(file), file, {"file": str(file)}):
        assert load_scene(scene(cstar={"v_mag": 1, "spectrum": written})).cstar.spectrum == str(file)
    assert load_scene(scene(cstar=STAR | {"model": "blackbody"})).cstar.spectrum == "blackbody"


def _synphot(wavelength, photlam):
    from synphot import SourceSpectrum
    from synphot.models import Empirical1D

    return SourceSpectrum(Empirical1D, points=np.multiply(wavelength, 10.0), lookup_table=photlam)


def test_yaml_file_finds_files_beside_it(tmp_path, monkeypatch):
    (tmp_path / "star.txt").write_text("300 1\n1800 1\n")
    (tmp_path / "albedo.txt").write_text("300 0.5\n1800 0.5\n")
    (tmp_path / "grid").mkdir()
    path = tmp_path / "scene.yaml"
    path.write_text(
        "name: s\ncompanions: off\n"
        "cstar: {v_mag: 5, teff_k: 5800, spectrum: star.txt}\n"
        "stars: {v_mag: 5, teff_k: 5800, model: grid, separation: 2, pa: 0}\n"
        "planet: {radius: 1, phase: 90, distance_au: 1, separation: 0.5, pa: 45, albedo: {file: albedo.txt}}\n"
    )
    monkeypatch.chdir(tmp_path.parent)
    found = load_scene(path)
    assert found.companions == "off"
    assert found.cstar.spectrum == str(tmp_path / "star.txt")
    assert found.stars[0].spectrum == "grid"
    assert found.planets[0].albedo.file == str(tmp_path / "albedo.txt")
    assert load_scene(str(path)) == found


@pytest.mark.parametrize("name", preset_names("scene"))
def test_presets_are_whole(name):
    found = load_scene(name)
    assert load_scene(found.model_dump(mode="json")) == found


@pytest.mark.parametrize("name", [name for name in preset_names("scene") if name.startswith("paper_")])
def test_presets_of_the_paper_have_its_star_and_planet(name):
    found = load_scene(name)
    assert found.cstar == load_scene("paper_background").cstar.model_copy(update={"name": found.cstar.name})
    planets = [planet.model_copy(update={"name": "planet"}) for planet in found.planets]
    assert planets in ([], [load_scene("paper_example").planets[0]])
    assert bool(planets) == (name in ("paper_example", "paper_background", "paper_science"))


def test_presets_ship():
    assert set(preset_names("scene")) >= {"paper_example", "paper_background"}


def test_the_papers_companion_is_left_out_and_its_calibration_star_is_not():
    found = load_scene("paper_science")
    assert found.companions == "off"
    assert [(star.name, star.companion, found.is_lit(star)) for star in found.stars] == [
        ("calibration star", False, True),
        ("alpha Cen A", True, False),
    ]
    shining = found.model_copy(update={"companions": "on"})
    assert all(shining.is_lit(star) for star in found.stars)
    calibrator = found.stars[0]
    assert (calibrator.v_mag, calibrator.separation_arcsec, calibrator.pa_deg) == (17, 0.95, 225)
    # one calibration star in every scene of the paper that has it
    background = load_scene("paper_background").stars[0]
    assert background == calibrator.model_copy(update={"companion": True})


def test_alpha_cen_a_stands_where_the_catalogue_has_it():
    from catalogs import load_stars, stars_at

    table = stars_at(load_stars(), 2028.5)
    names = list(table.column("name"))
    ours, theirs = names.index("alf Cen B"), names.index("alf Cen A")
    companion = load_scene("paper_science").stars[1]
    assert companion.separation_arcsec == pytest.approx(table.column("companion_sep_arcsec")[ours], abs=0.005)
    assert companion.pa_deg == pytest.approx(table.column("companion_pa_deg")[ours], abs=0.05)
    assert companion.v_mag == table.column("v_mag")[theirs]
    assert companion.spectral_type == table.column("sp_type")[theirs]


@pytest.mark.parametrize(("companion", "words"), [("no", "companion"), (0, "companion")])
def test_whether_a_star_is_a_companion_is_true_or_false(refused, companion, words):
    near = STAR | {"name": "near", "separation_arcsec": 3, "pa_deg": 20, "companion": companion}
    refused(words, load_scene, scene(stars=[near]))


def test_the_central_star_is_no_companion_of_itself(refused):
    refused(r"cstar\.companion", load_scene, {"name": "s", "cstar": STAR | {"companion": False}})


def test_a_folder_is_no_scene(refused, tmp_path):
    refused("a YAML file or a preset", load_scene, tmp_path)


def test_capitals_of_keys_do_not_matter(refused):
    cstar = {"Magnitude": 1.35, "SpType": "K1V", "Distance": 1.35, "RA": "14:39:35.06", "Dec": "-60:50:15.1"}
    planet = {"Radius": 1, "Phase_Angle": 90, "RA": "14:39:35.00", "DEC": "-60:50:14.6", "coe_metal": 1, "coe_cloud": 1}
    plain = {key.lower(): value for key, value in planet.items()}
    one = load_scene({"name": "a", "cstar": cstar, "stars": {}, "planet": planet})
    assert one == load_scene({"name": "a", "cstar": PAPER_STAR, "planet": plain})
    refused("given with", load_scene, {"name": "a", "cstar": cstar | {"ra": 1.0}})


def test_an_albedo_file_beside_the_scene_is_found(tmp_path):
    (tmp_path / "mine.txt").write_text("# wavelength_nm albedo\n300 0.5\n1700 0.5\n")
    (tmp_path / "jupiter").write_text("not meant\n")
    body = "{radius: 1, phase: 90, separation: 0.5, pa: 45, distance_au: 5, albedo: %s}"
    for word, file in (("mine.txt", str(tmp_path / "mine.txt")), ("jupiter", None)):
        path = tmp_path / "scene.yaml"
        path.write_text(f"name: s\ncstar: {{magnitude: 5, sptype: G2V}}\nplanet: {body % word}\n")
        assert getattr(load_scene(path).planets[0].albedo, "file", None) == file


def test_the_preset_is_what_its_comment_says():
    scene = load_scene("star_field")
    star = scene.cstar
    centre = {"v_mag": star.v_mag, "teff_k": star.teff_k, "ra_deg": star.ra_deg, "dec_deg": star.dec_deg}
    assert star_field(300, seed=1, centre=centre) == scene


def test_counts_rise_by_the_slope_between_the_limits():
    slope, low, high = 0.3, 13.0, 20.0
    v_mag = np.array([star.v_mag for star in star_field(4000, seed=5, counts_per_mag=slope).stars])
    assert v_mag.min() >= low
    assert v_mag.max() <= high

    def below(limit):
        return (10 ** (slope * limit) - 10 ** (slope * low)) / (10 ** (slope * high) - 10 ** (slope * low))

    assert stats.kstest(v_mag, below).pvalue > 1e-4


def test_places_are_even_over_the_square():
    stars = star_field(4000, seed=5, half_width_arcsec=8.0).stars
    angle = np.radians([star.pa_deg for star in stars])
    distance = np.array([star.separation_arcsec for star in stars])
    for axis in (distance * np.sin(angle), distance * np.cos(angle)):
        assert stats_even(axis, 8.0) > 1e-4


def stats_even(values, half):
    return stats.kstest(values, stats.uniform(-half, 2 * half).cdf).pvalue


def test_equal_seeds_give_equal_fields_and_others_do_not():
    assert star_field(20, seed=3) == star_field(20, seed=3)
    assert star_field(20, seed=3) != star_field(20, seed=4)


def test_a_bad_centre_is_refused(refused):
    refused("v_mag", star_field, 3, centre={"teff_k": 5000})


def host(ra=None, dec=None, distance=None):
    return SceneStar(v_mag=1.0, teff_k=5000, ra_deg=ra, dec_deg=dec, distance_pc=distance)


def star(**where):
    return SceneStar(v_mag=5.0, teff_k=5000, **where)


def planet(**more):
    return Planet(**{"radius_rjup": 1.0, "phase_deg": 90.0, "separation_arcsec": 0.65, "pa_deg": 315.0} | more)


@given(st.floats(0.0, 359.9), st.floats(-89.5, 89.5), st.floats(0.0, 359.9), st.floats(1e-3, 119.0))
def test_coordinates_give_the_great_circle_of_astropy(ra, dec, pa, separation):
    centre = SkyCoord(ra * u.deg, dec * u.deg)
    there = centre.directional_offset_by(pa * u.deg, separation * u.arcsec)
    found = place(host(ra, dec), star(ra_deg=float(there.ra.deg), dec_deg=float(there.dec.deg)))
    assert found.separation_arcsec == pytest.approx(centre.separation(there).arcsec, rel=1e-9, abs=1e-9)
    assert found.separation_arcsec == pytest.approx(separation, abs=1e-6)
    # A degree has 13 decimals: 4e-10 arcsec across.
    turn = (found.pa_deg - centre.position_angle(there).deg + 180.0) % 360.0 - 180.0
    assert abs(turn) < 1e-7 + np.rad2deg(1e-8 / separation)


def test_east_is_at_position_angle_90():
    # At declination 60 one second of right ascension is 7.5 arcsec on the sky.
    found = place(host("12:00:00", 60.0), star(ra_deg="12:00:01", dec_deg=60.0))
    assert found.separation_arcsec == pytest.approx(7.5, rel=1e-6)
    assert found.pa_deg == pytest.approx(90.0, abs=0.01)
    assert place(host(10.0, 20.0), star(ra_deg=10.0, dec_deg=20.001)).pa_deg == pytest.approx(0.0, abs=1e-9)


def test_across_the_meridian_and_at_the_pole():
    found = place(host(359.9999, 0.0), star(ra_deg=0.0001, dec_deg=0.0))
    assert (found.separation_arcsec, found.pa_deg) == (pytest.approx(0.72, rel=1e-9), pytest.approx(90.0))
    found = place(host(0.0, 89.999), star(ra_deg=180.0, dec_deg=89.999))
    assert found.separation_arcsec == pytest.approx(7.2, rel=1e-9)


def test_an_offset_is_taken_as_it_is():
    assert place(host(), star(separation_arcsec=2.0, pa_deg=-45.0)) == (2.0, -45.0)


@pytest.mark.parametrize(
    ("centre", "where", "word"),
    [
        (host(), {}, "separation_arcsec = missing"),
        (host(), {"ra_deg": 1.0, "dec_deg": 1.0}, "cstar has them too"),
        (host(1.0, 1.0), {"ra_deg": 1.0, "dec_deg": 1.04}, "144 arcsec"),
        (host(1.0, 1.0), {"ra_deg": 181.0, "dec_deg": -1.0}, "at most 120 arcsec"),
    ],
)
def test_no_place_is_refused(refused, centre, where, word):
    refused(word, place, centre, star(**where))


def test_the_distance_of_the_paper():
    assert true_distance_au(planet(), 0.65, 1.35) == pytest.approx(0.8775, rel=1e-15)
    assert true_distance_au(planet(), 0.65, 1.2548) == pytest.approx(0.81562, rel=1e-15)


@given(st.floats(0.1, 179.9), st.floats(0.01, 100.0), st.floats(1.0, 50.0))
def test_projected_distance_is_recovered(phase, separation, distance):
    found = true_distance_au(planet(phase_deg=phase), separation, distance)
    assert found * np.sin(np.deg2rad(phase)) == pytest.approx(separation * distance, rel=1e-12)
    # and a planet given by what was found is accepted
    assert true_distance_au(planet(phase_deg=phase, distance_au=found), separation, distance) == found


@given(st.floats(30.0, 150.0), st.floats(0.01, 100.0), st.floats(1.0, 50.0))
def test_a_distance_that_contradicts_the_separation_is_refused(refused, phase, separation, distance):
    found = true_distance_au(planet(phase_deg=phase), separation, distance)
    refused("distance_au", true_distance_au, planet(phase_deg=phase, distance_au=1.03 * found), separation, distance)


def test_rounded_numbers_agree():
    assert true_distance_au(planet(distance_au=5.2, phase_deg=60.0), 0.45, 10.0) == 5.2


def test_without_the_distance_of_the_star_nothing_is_compared():
    assert true_distance_au(planet(distance_au=5.0), 100.0, None) == 5.0


@pytest.mark.parametrize(
    ("change", "separation", "distance", "words"),
    [
        ({}, 0.65, None, ("distance_au = missing", "cstar.distance_pc")),
        ({"phase_deg": 0.0}, 0.65, 1.0, ("distance_au = missing", "phase_deg is 0")),
        ({"phase_deg": 180.0}, 0.65, 1.0, ("distance_au = missing", "phase_deg is 180")),
        ({}, 0.0, 1.0, ("distance_au = missing", "separation is 0")),
        ({"distance_au": 0.5}, 0.65, 1.35, ("distance_au = 0.5 au", "0.8775 au")),
        ({"distance_au": 2.0}, 0.65, 1.35, ("distance_au = 2.0 au", "2 au", "0.8775 au")),
        ({"distance_au": 2.0, "phase_deg": 0.0}, 0.65, 1.35, ("distance_au = 2.0 au", "0 au", "0.8775 au")),
    ],
)
def test_what_does_not_follow_or_contradicts_is_refused(refused, change, separation, distance, words):
    message = refused("", true_distance_au, planet(**change), separation, distance)
    for word in words:
        assert word in message


def test_full_phase_with_a_true_distance():
    assert true_distance_au(planet(phase_deg=0.0, distance_au=5.0), 0.0, 10.0) == 5.0


def test_light_of_its_own_needs_no_distance():
    body = Planet(spectrum="blackbody", teff_k=1000, radius_rjup=1, separation_arcsec=1.0, pa_deg=0.0)
    assert true_distance_au(body, 1.0, None) is None
    assert true_distance_au(body, 1.0, 10.0) is None


@pytest.mark.parametrize(
    "text",
    ["14:39:36.49", "14h39m36.49s", "14 39 36.49", " 14h 39m 36.49s ", "14:39", "14h39m", "14H39M36S", "0:0:0.001"],
)
def test_right_ascension_is_in_hours_unless_it_says_degrees(text):
    assert right_ascension_deg(text) == pytest.approx(Angle(text.strip().lower(), u.hourangle).deg, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [("219.9d", 219.9), ("219d54m7.2s", 219.902), ("219°54′7.2″", 219.902), ("14.66h", 219.9), ("120d", 120.0)],
)
def test_units_are_obeyed(text, degrees):
    assert right_ascension_deg(text) == pytest.approx(degrees, rel=1e-14)


@pytest.mark.parametrize(
    "text", ["-60:50:02.3", "-60d50m02.3s", "+12 30 15", "-60 50", "-0:30:00", "−60:50:02.3", "-60.84d"]
)
def test_declination(text):
    assert declination_deg(text) == pytest.approx(Angle(text.replace("−", "-"), u.deg).deg, rel=1e-15)


def test_a_small_southern_declination_keeps_its_sign():
    assert declination_deg("-00:00:36") == pytest.approx(-0.01)


@given(st.floats(0.0, 359.9999), st.floats(-90.0, 90.0))
def test_what_astropy_writes_is_read_back(ra, dec):
    texts = (
        Angle(ra, u.deg).to_string(u.hourangle, sep=":", precision=9, pad=True),
        Angle(dec, u.deg).to_string(u.deg, sep="dms", precision=8),
    )
    assert right_ascension_deg(texts[0]) == pytest.approx(ra, abs=1e-11)
    assert declination_deg(texts[1]) == pytest.approx(dec, abs=1e-11)
    assert right_ascension_deg(ra) == ra
    assert declination_deg(dec) == dec
