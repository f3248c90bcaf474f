"""Scenes of any kind: several planets, none, a calibrator, planets out of reach."""

import functools

import numpy as np
import pytest

from catalogs.errors import InputError
from cpic_planner.etc.model import Strategy, build_model
from cpic_planner.etc.place import stand
from cpic_planner.etc.planet import ReferencePlanet, reference_distance_au
from cpic_planner.scene_confirmation import ConfirmQuestion, confirm_job, confirm_scene, scene_target
from cpic_planner.targets import find_target
from cpic_planner.validation.task import Frames, expected_of, target_scene
from simulator import load_instrument, load_scene
from simulator.passbands import Passbands
from simulator.target.sources import scene_sources

FRAMES = {"exposure_s": 4.0, "n_frames": 40, "em_gain": 300.0, "realisations": 3, "audit": False}
STAR = {"v_mag": 1.35, "spectral_type": "K1V", "distance_pc": 1.35}


def planet(name, separation, pa, contrast_scale=1.0):
    return {
        "name": name,
        "radius_rjup": contrast_scale,
        "phase_deg": 90,
        "separation_arcsec": separation,
        "pa_deg": pa,
        "albedo": "jupiter",
    }


def config(scene, **changes):
    return ConfirmQuestion(
        instrument=load_instrument(), scene=load_scene(scene), **(FRAMES | {"bands": ("F520",)} | changes)
    )


@functools.cache
def system():
    """Two planets in the hole and one behind the cross, beside a calibration star."""
    scene = {
        "name": "system",
        "cstar": STAR,
        "planets": [planet("b", 0.5, 315), planet("c", 0.6, 135), planet("d", 0.5, 0)],
        "stars": [
            {
                "name": "calibrator",
                "v_mag": 14.5,
                "spectral_type": "K1V",
                "separation_arcsec": 0.7,
                "pa_deg": 225,
                "companion": False,
            }
        ],
    }
    return confirm_scene(config(scene)).result


def test_every_planet_has_its_answer():
    answers = {band.planet: band for band in system().bands}
    assert set(answers) == {"b", "c", "d"}
    for name in ("b", "c"):
        found = answers[name]
        assert found.status == "ok"
        assert abs(found.recovered_contrast - found.true_contrast) < 4.5 * max(
            found.contrast_mean_error, found.contrast_error / np.sqrt(3)
        )
        assert found.n_significant == 3
    assert (answers["d"].status, answers["d"].reason) == ("outside_field", "inside_inner_edge")
    assert answers["d"].verdict == "not observed"


def test_the_blind_search_names_what_it_finds():
    (search,) = system().searches
    named = {candidate.planet for candidate in search.candidates if candidate.detected}
    assert {"b", "c"} <= named
    by_name = {candidate.planet: candidate for candidate in search.candidates}
    assert by_name["b"].separation_arcsec == pytest.approx(0.5, abs=0.02)
    assert by_name["b"].pa_deg == pytest.approx(315.0, abs=3.0)
    assert by_name["c"].pa_deg == pytest.approx(135.0, abs=3.0)
    for record in system().positions:
        assert abs(record.separation_arcsec - record.true_separation_arcsec) < 5 * record.separation_error_arcsec
        assert abs(record.pa_deg - record.true_pa_deg) < 5 * record.pa_error_deg


def test_a_scene_without_planets_is_searched():
    done = confirm_scene(config({"name": "alone", "cstar": STAR}))
    result = done.result
    assert result.bands == result.positions == result.albedos == []
    assert result.calibration["n_bands"] == 0
    assert result.searches[0].resolution_elements > 100
    assert not any(candidate.detected for candidate in result.searches[0].candidates)
    assert list(done.bodies) == ["alone F520"]


def test_frames_may_be_left_to_the_calculator():
    scene = {"name": "left", "cstar": STAR, "planets": [planet("b", 0.6, 315)]}
    free = config(scene, exposure_s=None, n_frames=None, em_gain=None, time_s=1200.0, realisations=1)
    (band,) = confirm_scene(free).result.bands
    assert 0.5 * 1200 < band.time_s <= 1200.0 * (1 + 1e-9)
    gain_only = config(scene, em_gain=None, realisations=1)
    (chosen,) = confirm_scene(gain_only).result.bands
    assert (chosen.exposure_s, chosen.n_frames) == (4.0, 40)
    model = build_model(free.instrument, ["F520"])
    place = scene_sources(free.scene, free.instrument, "F520")[1]
    target = scene_target(free.scene)
    at = [
        expected_of(model, target, "F520", (place.x_arcsec, place.y_arcsec), place.contrast, Frames(4.0, 40, gain))
        for gain in (0.7 * chosen.em_gain, chosen.em_gain)
    ]
    # Here the register's full well binds: less gain is worse, and more would spill into the hole.
    assert at[1]["significance"] > at[0]["significance"]
    star = scene_sources(free.scene, free.instrument, "F520")[0].rate_e_s
    tail = model.metrics["F520"].register_tail * star * 4.0 * chosen.em_gain
    assert tail == pytest.approx(free.instrument.detector.register_full_well_e, rel=0.15)
    late = config(scene, exposure_s=None, n_frames=None, em_gain=None, time_s=1.0)
    (refused,) = confirm_scene(late).result.bands
    assert refused.status == "unreachable"


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"time_s": 100.0}, "n_frames"),
        ({"exposure_s": None}, "exposure_s"),
        ({"n_frames": None}, "n_frames"),
        ({"strategy": Strategy(mode="photon_counting")}, "photon"),
        ({"bands": ("F1265",)}, "near-infrared"),
        ({"bands": ("F999",)}, "F999"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, key):
    with pytest.raises((InputError, ValueError), match=key):
        confirm_scene(config({"name": "s", "cstar": STAR}, **changes))


def test_a_star_of_the_catalogue_is_the_same_target_through_its_scene():
    target, _ = find_target("eps Eri")
    body = ReferencePlanet()
    distance = float(reference_distance_au(target, np.array([0.6]), body)[0, 0])
    scene = target_scene(target, body, 0.6, distance)
    back = scene_target(scene)
    for name in ("v_mag", "teff_k", "log_g", "metallicity", "distance_pc", "luminosity_lsun", "ra_deg", "dec_deg"):
        assert getattr(back, name)[0] == pytest.approx(getattr(target, name)[0]), name
    model = build_model(load_instrument(), ["F520"])
    frames = Frames(20.0, 100, 400.0)
    ours, theirs = (
        expected_of(model, star, "F520", stand(model, "F520", 0.6), 1e-8, frames) for star in (back, target)
    )
    assert ours == pytest.approx(theirs)


@pytest.mark.parametrize("star", [{"v_mag": 5.0, "spectral_type": "F8V"}, {"v_mag": 5.0, "teff_k": 4000.0}])
def test_the_calculator_knows_the_light_of_a_scene(star):
    scene = load_scene({"name": "s", "cstar": star})
    instrument = load_instrument()
    target, passbands = scene_target(scene), Passbands.from_instrument(instrument)
    rates = passbands.star_rate_e_s(
        target.v_mag, target.teff_k, target.log_g, target.metallicity, instrument.telescope.area_cm2
    )[0]
    for band in instrument.visible_bands():
        light = scene_sources(scene, instrument, band)[0].rate_e_s
        assert rates[passbands.names.index(band)] == pytest.approx(light, rel=0.01)


def test_the_hash_is_that_of_what_decides():
    scene = {"name": "s", "cstar": STAR}
    assert confirm_job(config(scene)).digest == confirm_job(config(scene)).digest
    assert confirm_job(config(scene)).digest != confirm_job(config(scene, seed=2)).digest
    altered = config(
        scene, simulator_overrides={"entries": [{"key": "detector.read_noise_e", "action": "scale", "value": 2}]}
    )
    assert confirm_job(config(scene)).digest != confirm_job(altered).digest
