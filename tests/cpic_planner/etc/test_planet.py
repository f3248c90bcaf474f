"""The reference planet has one contrast: in the ETC, scene and spectra; many planets have those of one."""

import numpy as np
import pytest

from catalogs import load_stars
from cpic_planner.etc import (
    build_model,
    insolation_distance_au,
    kinds_by_albedo,
    mixture_contrast,
    reference_contrast,
    reference_distance_au,
    reference_notes,
    reflected_contrast,
)
from cpic_planner.etc.planet import reflected_share
from cpic_planner.queries import ReferencePlanet
from cpic_planner.targets import rank_sample, targets_from_table
from cpic_planner.validation import target_scene
from simulator import load_instrument, planet_contrast, spectrum_generator
from simulator.band_integrals import band_integral
from simulator.config import ConstantAlbedo, MeasuredAlbedo, ParametricAlbedo
from simulator.target import albedo_source, scene_sources

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
