"""What is to be confirmed, and what is expected of it."""

import math

import numpy as np
import pytest

from cpic_planner.etc import build_model, planet_offsets, reference_distance_au
from cpic_planner.queries import MAX_FRAMES, ReferencePlanet, SimulatorOverrides, Strategy
from cpic_planner.queries.shared import ReferenceStar
from cpic_planner.ranking import best_in_band
from cpic_planner.results import BandConfirmation
from cpic_planner.targets import find_target
from cpic_planner.validation import ConfirmTask, Frames, expected_of, images_of, prepare_task, target_scene
from simulator import load_instrument
from simulator.config import Instrument, Scene, validate
from simulator.signal import exozodi_disc
from simulator.target import scene_sources

PLANET = ReferencePlanet()
ASKED = {"time_s": 7200.0, "planet": PLANET, "seed": 1, "fidelity": "quick"}


def prepared(star="tau Cet", band="F520", *, instrument=None, strategy=None, companions="on", **changes):
    model = build_model(instrument or load_instrument(), [band], strategy)
    target, _ = find_target(star, companions=companions)
    return model, target, prepare_task(model, target, band, **(ASKED | changes))


def test_the_prediction_is_that_of_the_optimiser():
    model, target, task = prepared()
    best = best_in_band(model, target, "F520", 7200.0, PLANET)
    expected = task.predictions[0]
    assert (task.exposure_s, task.n_frames, task.em_gain, task.visits) == (
        float(best.exposure_s[0]),
        int(best.frames_per_visit[0]),
        float(best.em_gain[0]),
        int(best.visits[0]),
    )
    for key, value in (
        ("snr_full", best.snr),
        ("significance_full", best.significance),
        ("threshold", best.threshold),
        ("contrast", best.contrast),
        ("separation_arcsec", best.separation_arcsec),
    ):
        assert expected[key] == pytest.approx(float(value[0]), rel=1e-9)
    assert task.time_s == pytest.approx(float(best.time_s[0]), rel=1e-9)
    # No particle voids a sum of frames: it has the SNR of a camera without them.
    clean = model.instrument.switched({"cosmic_rays": False})
    alone = best_in_band(build_model(clean, ["F520"]), target, "F520", 7200.0, PLANET, expected["separation_arcsec"])
    assert expected["snr"] >= expected["snr_full"]
    assert expected["snr"] == pytest.approx(float(alone.snr[0]), rel=2e-3)


def test_the_planet_of_the_scene_is_the_one_of_the_prediction():
    model, target, task = prepared("eps Eri", "F662")
    scene = validate(Scene, task.scene, where="scene")
    planet = scene_sources(scene, model.instrument, "F662")[1]
    place = planet_offsets(model, target, "F662", task.predictions[0]["separation_arcsec"])
    assert (planet.x_arcsec, planet.y_arcsec) == pytest.approx(tuple(map(float, place)), abs=1e-9)
    assert planet.contrast == pytest.approx(task.predictions[0]["contrast"], rel=1e-6)


def test_a_task_is_plain_data():
    import json

    _, _, task = prepared()
    assert ConfirmTask(**json.loads(json.dumps(task.to_dict()))) == task
    assert task.key == "tau Cet F520"
    assert task.planets == ["reference planet"]


def test_time_without_a_frame_is_refused():
    _, _, answer = prepared(time_s=0.5)
    assert isinstance(answer, BandConfirmation)
    assert (answer.status, answer.reason, answer.verdict) == ("unreachable", "time_below_overheads", "not observed")


def test_more_frames_than_memory_holds_are_refused():
    _, _, answer = prepared(
        "alf Cen A",
        time_s=1e6,
        instrument=load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}),
        strategy=Strategy(visits=1),
    )
    assert isinstance(answer, BandConfirmation)
    assert answer.reason == "too_many_frames"
    assert str(MAX_FRAMES) in answer.message


def test_overrides_change_the_images_alone():
    _, _, plain = prepared("alf Cen B", companions="off")
    model, _, altered = prepared(
        "alf Cen B",
        companions="off",
        overrides=SimulatorOverrides.of(["throughput=x0.7", "companions=on", "exozodi=3zodi"]),
    )
    assert altered.predictions == plain.predictions
    assert (altered.exposure_s, altered.n_frames, altered.em_gain) == (plain.exposure_s, plain.n_frames, plain.em_gain)
    simulator = validate(Instrument, altered.simulator, where="instrument")
    nominal = model.instrument
    assert simulator.band("F520").t_opt == pytest.approx(0.7 * nominal.band("F520").t_opt)
    assert plain.scene["companions"] == "off"
    assert altered.scene["companions"] == "on"
    assert plain.scene["extended"] == []
    assert altered.scene["extended"][0]["contrast"] == exozodi_disc(3.0).contrast


def test_particles_cost_what_they_void():
    instrument = load_instrument({"cosmic_rays": {"peak_rate_per_s_cm2": 100.0}})
    model = build_model(instrument, ["F520"])
    target, _ = find_target("tau Cet")
    expected = expected_of(
        model, target, "F520", planet_offsets(model, target, "F520", 0.5), 1e-8, Frames(100.0, 50, 300.0)
    )
    clean = math.exp(-model.loss_per_s("F520") * 100.0)
    assert clean < 0.9
    # All of the variance that is white grows with the frames that are left.
    assert expected["significance_full"] / expected["significance"] > math.sqrt(clean)
    assert expected["significance_full"] < expected["significance"]


@pytest.mark.parametrize("library", ["reference_star", "roll", "idealised"])
def test_the_library_of_the_strategy_goes_with_the_task(library):
    star = ReferenceStar(v_mag=2.0) if library == "reference_star" else None
    strategy = Strategy(library=library, reference_star=star, roll_deg=40.0)
    _, _, task = prepared(strategy=strategy)
    assert validate(Strategy, task.strategy, where="strategy") == strategy
    # Two rolls see it to either side of the diagonal, on which it stands at the middle one.
    assert task.scene["planets"][0]["pa_deg"] == pytest.approx(315.0)
    turned = abs(task.predictions[0]["pa_deg"] - 315.0)
    assert turned == pytest.approx(20.0 if library == "roll" else 0.0, abs=1e-9)


def test_sums_leave_out_what_a_reduction_takes_out():
    instrument = images_of(load_instrument())
    switches = instrument.detector.switches
    assert not any((switches.cosmic_rays, switches.nonlinearity, switches.serial_cti, switches.stripes))
    assert all(
        (
            switches.photon_noise,
            switches.em_register,
            switches.read_noise,
            switches.clock_charge,
            switches.blooming,
            switches.register_full_well,
        )
    )


def test_dust_of_the_instrument_is_in_science_and_reference():
    target, _ = find_target("tau Cet")
    distance = float(reference_distance_au(target, np.array([0.6]), PLANET)[0, 0])
    plain = target_scene(target, PLANET, 0.6, distance)
    dusty = target_scene(target, PLANET, 0.6, distance, exozodi_zodis=7.0)
    assert plain.extended == ()
    assert dusty.extended == dusty.without_planets().extended == (exozodi_disc(7.0),)
    for zodis in (0.0, 7.0):
        _, _, task = prepared(band="F662", instrument=load_instrument({"sky": {"exozodi_zodis": zodis}}))
        assert [disc["contrast"] for disc in task.scene["extended"]] == ([exozodi_disc(7.0).contrast] if zodis else [])


def test_the_sky_knows_where_the_star_is():
    """Zodiacal light depends on the place: a scene without coordinates would be refused."""
    target, _ = find_target("tau Cet")
    distance = float(reference_distance_au(target, np.array([0.6]), PLANET)[0, 0])
    scene = target_scene(target, PLANET, 0.6, distance)
    assert scene.cstar.ra_deg == pytest.approx(float(target.ra_deg[0]))
