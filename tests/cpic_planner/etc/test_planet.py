"""The reference planet has one contrast: in the ETC, scene and spectra; many planets have those of one.

Where planets are put: diagonals, rolls, and the quadrant with the least light of a companion.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from catalogs import load_stars
from cpic_planner.etc import (
    aperture_rates,
    build_model,
    diagonal_pa_deg,
    insolation_distance_au,
    kinds_by_albedo,
    mixture_contrast,
    place_status,
    planet_offsets,
    questions,
    reference_contrast,
    reference_distance_au,
    reference_notes,
    reflected_contrast,
    usable_range_arcsec,
)
from cpic_planner.etc.rates import QUADRANTS, dark_quadrants, reflected_share
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.targets import Targets, find_target, rank_sample, targets_from_table
from cpic_planner.validation import target_scene
from simulator import load_instrument, planet_contrast, spectrum_generator
from simulator.config import ConstantAlbedo, MeasuredAlbedo, ParametricAlbedo
from simulator.imaging import aperture_sums, overlap_weights, single_band_psf
from simulator.passbands import band_integral
from simulator.target import albedo_source, scene_sources, sky_to_detector

SEPARATION = 0.7
BANDS = ("F520", "F850")
PLANETS = [
    {"model": "parametric", "log10_mh": 1.0, "log10_fsed": 1.0},
    {"model": "parametric", "log10_mh": 0.3, "log10_fsed": -1.2, "phase_function": "grid"},
    {"model": "parametric", "log10_mh": 2.0, "log10_fsed": None, "insolation_au": 2.0},
    {"model": "parametric", "log10_mh": 0.0, "phase_function": "grid", "insolation_au": 9.0},
    "neptune",
    0.4,
]


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument("cpic_default"), bands=BANDS)


@pytest.fixture(scope="module")
def targets():
    """Stars at random, and the extremes: clamped insolation at either end is among them."""
    everyone = targets_from_table(load_stars())
    columns = (everyone.luminosity_lsun, everyone.distance_pc, everyone.teff_k)
    ends = [int(pick(column)) for column in columns for pick in (np.argmin, np.argmax)]
    some = np.random.default_rng(3).choice(len(everyone), 20, replace=False).tolist()
    return [everyone.select([row]) for row in (*ends, *some)]


PHASES_DEG = (90.0, 60.0, 120.0, 135.0, 45.0, 90.0)


@pytest.mark.parametrize(("albedo", "phase_deg"), list(zip(PLANETS, PHASES_DEG, strict=True)))
def test_etc_and_scene_agree_in_contrast_and_flags(model, targets, albedo, phase_deg):
    planet = ReferencePlanet(phase_deg=phase_deg, albedo=albedo)
    clamped = 0
    for target in targets:
        distance = float(reference_distance_au(target, np.array([SEPARATION]), planet)[0, 0])
        scene = target_scene(target, planet, SEPARATION, distance)
        for band in BANDS:
            (found,) = (one for one in scene_sources(scene, model.instrument, band) if one.kind == "planet")
            expected = reference_contrast(model, target, band, np.array([SEPARATION]), planet)[0]
            assert found.contrast == pytest.approx(expected, rel=1e-9, abs=0.0)
            notes = reference_notes(model, target, band, SEPARATION, planet)
            assert set(found.flags) - {"luminosity_derived"} == set(notes)
            clamped += "insolation_clamped" in notes
    if isinstance(albedo, dict):
        fixed = {None: range(1, 2 * len(targets)), 2.0: (0,), 9.0: (2 * len(targets),)}
        assert clamped in fixed[albedo.get("insolation_au")]


def test_the_spectra_hold_that_contrast(model, targets):
    planet = ReferencePlanet(phase_deg=70.0, albedo=PLANETS[0])
    for target in targets[:6]:
        distance = float(reference_distance_au(target, np.array([SEPARATION]), planet)[0, 0])
        star, body, *_ = spectrum_generator(target_scene(target, planet, SEPARATION, distance))
        for band in BANDS:
            passband = model.passbands.bands[model.passbands.index(band)]
            rates = [band_integral(passband, one.wavelength_nm, one.photlam) for one in (body, star)]
            expected = reference_contrast(model, target, band, np.array([SEPARATION]), planet)[0]
            assert rates[0] / rates[1] == pytest.approx(expected, rel=1e-6)


def test_a_file_counts_by_what_is_in_it(tmp_path):
    path = tmp_path / "mine.txt"
    contents = []
    for value in (0.3, 0.4, 0.3):
        path.write_text(f"wavelength_nm albedo\n400 {value}\n900 0.5\n")
        contents.append(ReferencePlanet(albedo=str(path)).content())
    assert contents[0] == contents[2] != contents[1]
    assert str(tmp_path) not in ReferencePlanet(albedo=str(path)).albedo.label


MIXTURE = (
    ConstantAlbedo(value=0.3),
    ParametricAlbedo(log10_mh=0.5, log10_fsed=0.5),
    MeasuredAlbedo(model="jupiter"),
    ConstantAlbedo(value=0.3),
)


@pytest.fixture(scope="module")
def one_band():
    return build_model(load_instrument(), ("F662",))


@pytest.fixture(scope="module")
def stars():
    return rank_sample().select([0, 5, 40])


def drawn(n_stars, k, seed=0):
    rng = np.random.default_rng(seed)
    return (
        rng.integers(0, len(MIXTURE), (n_stars, k)),
        rng.uniform(0.3, 1.5, (n_stars, k)),
        rng.uniform(0.5, 8.0, (n_stars, k)),
        rng.uniform(5.0, 170.0, (n_stars, k)),
    )


def test_a_constant_albedo_is_the_papers_equation(one_band, stars):
    _, radius, distance, phase = drawn(len(stars), 7)
    found = reflected_contrast(one_band, stars, "F662", MIXTURE[0], radius, distance, phase)
    projected = distance * np.sin(np.radians(phase))
    np.testing.assert_allclose(found, planet_contrast(radius, projected, 0.0 * projected, phase, 0.3), rtol=1e-12)


def test_every_planet_of_a_mixture_is_what_it_is_alone(one_band, stars):
    kind, radius, distance, phase = drawn(len(stars), 11)
    found = mixture_contrast(one_band, stars, "F662", MIXTURE, kind, radius, distance, phase)
    for i in range(len(stars)):
        for j in range(kind.shape[1]):
            alone = reflected_contrast(
                one_band,
                stars.select([i]),
                "F662",
                MIXTURE[kind[i, j]],
                radius[i, j],
                distance[i, j][None, None],
                phase[i, j],
            )
            assert found[i, j] == pytest.approx(float(alone[0, 0]), rel=1e-12)


def test_an_albedo_that_follows_the_insolation_takes_that_of_its_star(one_band, stars):
    """The same insolation at stars of another luminosity is another distance."""
    own = np.array([[1.0, 5.0]])
    distance = own * np.sqrt(stars.luminosity_lsun)[:, None]
    np.testing.assert_allclose(insolation_distance_au(stars, distance), np.broadcast_to(own, (3, 2)), rtol=1e-14)
    share = reflected_share(one_band, stars, "F662", MIXTURE[1], distance, 0.0)
    albedo = one_band.passbands.band_albedo(
        albedo_source(MIXTURE[1]),
        stars.teff_k[:, None],
        stars.log_g[:, None],
        stars.metallicity[:, None],
        insolation_au=own,
        only="F662",
    )
    # At full phase the share is the geometric albedo.
    np.testing.assert_allclose(share, albedo, rtol=1e-9)
    assert np.all(np.abs(share[:, 0] / share[:, 1] - 1.0) > 0.01)


def test_kinds_of_one_albedo_go_together():
    assert kinds_by_albedo(MIXTURE) == [(MIXTURE[0], [0, 3]), (MIXTURE[1], [1]), (MIXTURE[2], [2])]


INSTRUMENT = load_instrument()
MODEL = build_model(INSTRUMENT)
ROLL = build_model(INSTRUMENT, None, Strategy(library="roll"))
TAU_CET = find_target("tau Cet")[0]


def pair(pa_deg, separation_arcsec=4.0, roll_deg=0.0):
    """Return tau Ceti with a companion as bright as itself."""
    columns = {"separation_arcsec": separation_arcsec, "pa_deg": pa_deg, "v_mag": 3.5, "teff_k": 5400.0}
    changed = {f"companion_{name}": np.array([value]) for name, value in columns.items()}
    return replace(TAU_CET, roll_deg=roll_deg, **changed)


def test_rolled_planets_stand_half_the_roll_beside_the_diagonal():
    x, y = planet_offsets(ROLL, TAU_CET, "F520", 0.6)
    assert math.hypot(x, y) == pytest.approx(0.6)
    assert math.degrees(math.atan2(y, x)) == pytest.approx(45.0 + 15.0)


@pytest.mark.parametrize("parity", [-1, 1])
def test_parity_turns_the_sky_not_the_detector(parity):
    model = build_model(load_instrument({"detector": {"parity": parity}}), ["F520"])
    assert planet_offsets(model, TAU_CET, "F520", 0.6) == planet_offsets(MODEL, TAU_CET, "F520", 0.6)
    # Upper right on the detector: west of the star where x grows to the west.
    assert diagonal_pa_deg(model, TAU_CET, "F520") == pytest.approx(315.0 if parity == -1 else 45.0)


@pytest.mark.parametrize("roll_deg", [0.0, 40.0, -130.0])
@pytest.mark.parametrize("pa_deg", [10.0, 55.0, 130.0, 305.0])
def test_the_quadrant_holds_least_of_the_companions_light(pa_deg, roll_deg):
    """Mean of an image of the companion over each quadrant of the hole; the roll turns the companion alone."""
    psf = single_band_psf("F662")
    image = psf.at(*(float(part) for part in sky_to_detector(4.0, pa_deg, roll_deg=roll_deg, parity=-1)))
    sums = aperture_sums(image, overlap_weights(psf.geometry.aperture_radius_arcsec / psf.geometry.pixel_scale_arcsec))
    offset = np.arange(len(image)) - len(image) // 2
    light = {
        name: sums[psf.geometry.hole & (offset * x > 0) & (offset[:, None] * y > 0)].mean()
        for name, (x, y) in zip(QUADRANTS, ((1, 1), (-1, 1), (1, -1), (-1, -1)), strict=True)
    }
    star = pair(pa_deg, roll_deg=roll_deg)
    (number,) = dark_quadrants(MODEL, star, "F662")
    assert light[QUADRANTS[number]] <= 1.03 * min(light.values())
    assert max(light.values()) > 2.0 * min(light.values())
    x, y = planet_offsets(MODEL, star, "F662", 0.6)
    assert (x > 0, y > 0) == (number % 2 == 0, number // 2 == 0)
    turned = sky_to_detector(0.6, diagonal_pa_deg(MODEL, star, "F662"), parity=-1)
    np.testing.assert_allclose((x, y), turned, rtol=1e-12)


def test_only_known_companions_that_count_move_the_planet():
    """No companion, one whose light is left out, and one that may stand anywhere: the upper right quadrant."""
    lit = pair(305.0)
    assert dark_quadrants(MODEL, lit, "F520")[0] != 0
    for star in (TAU_CET, replace(lit, companions="off"), pair(np.nan)):
        assert dark_quadrants(MODEL, star, "F520").tolist() == [0]


def test_stars_have_quadrants_of_their_own():
    stars = [pair(305.0), TAU_CET, pair(130.0), pair(10.0)]
    every = Targets.joined(stars)
    x, y = planet_offsets(MODEL, every, "F520", np.array([[0.5, 0.6]]))
    assert x.shape == y.shape == (4, 2)
    for row, star in enumerate(stars):
        alone = planet_offsets(MODEL, star, "F520", np.array([[0.5, 0.6]]))
        np.testing.assert_array_equal((x[row], y[row]), (alone[0][0], alone[1][0]))
    assert planet_offsets(MODEL, TAU_CET, "F520", np.array([[0.5, 0.6]]))[0].shape == (1, 2)


def test_half_a_hole_keeps_the_planet_in_its_dark_half():
    half = build_model(load_instrument("cpic_2q"), ["F520"])
    for pa_deg in np.arange(12) * 30.0:
        x, _ = planet_offsets(half, pair(pa_deg), "F520", 0.6)
        assert x > 0


@pytest.mark.parametrize("pa_deg", np.arange(8) * 45.0 + 12.0)
def test_two_rolls_stay_in_the_hole_in_every_quadrant(pa_deg):
    low, high = usable_range_arcsec(INSTRUMENT, "F520")
    edge, outer = INSTRUMENT.hole_inner_arcsec("F520"), INSTRUMENT.hole_outer_arcsec("F520")
    radius = INSTRUMENT.aperture_radius_arcsec("F520")
    for place in np.linspace(low, high, 9):
        x, y = (abs(float(part)) for part in planet_offsets(ROLL, pair(pa_deg), "F520", place))
        whole = min(x, y) >= edge + radius and max(x, y) <= outer - radius
        assert whole == (place_status(ROLL, "F520", float(place))[0] == "ok")


def test_answers_say_quadrant_and_roll():
    asked = {"time_s": 7200.0, "separation_arcsec": 0.6, "contrast": 1e-8, "bands": ["F520"]}
    for star in (TAU_CET, pair(305.0), pair(305.0, roll_deg=40.0)):
        (answer,) = questions.signal_to_noise(MODEL, star, **asked)
        assert answer.quadrant == QUADRANTS[dark_quadrants(MODEL, star, "F520")[0]]
        assert answer.roll_deg == star.roll_deg
    outside = questions.signal_to_noise(MODEL, TAU_CET, **(asked | {"separation_arcsec": 3.0}))[0]
    assert outside.quadrant is None


def test_a_roll_turns_the_companion():
    """Rolling by an angle is turning the position angle back by it."""
    x = np.full((1, 1), 0.42)
    for name in ("companion_e_s", "smear_e", "peak_in_hole_e_s"):
        rolled, turned = (
            getattr(aperture_rates(MODEL, star, "F520", x, x, np.full((1, 1), 1e-9)), name)
            for star in (pair(50.0, roll_deg=35.0), pair(15.0))
        )
        np.testing.assert_allclose(rolled, turned, rtol=1e-9)
        assert math.isfinite(float(rolled.flat[0]))
