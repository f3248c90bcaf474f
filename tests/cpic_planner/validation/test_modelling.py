"""What the dial makes of a task: sums or frames, hole or whole frames, knobs, epochs, what is left out.

What a task is expected to take: from what its dial makes of it.
"""

import functools
from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.confirm import scene_target
from cpic_planner.confirm.scene import images_cost
from cpic_planner.etc import build_model
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.results import ModellingRecord
from cpic_planner.targets import find_target
from cpic_planner.validation import (
    Frames,
    expected_of,
    images_of,
    modelling_of,
    prepare_task,
    realise_frames,
    refusals_of,
    task_cost,
    task_of,
    visit_pair,
)
from simulator import load_instrument, load_scene, observe
from simulator.detectors import excess_noise_factor2
from simulator.knobs import FIDELITIES
from simulator.ledger import MAX_EPOCHS, NOT_IN_SUMS, SUM_EPOCHS
from simulator.ledger.inventory import LEFT_OUT
from simulator.target import scene_sources

# Faint and photon limited; bright and limited by speckles, where frame transfer smears as much light as the hole holds;
# speckles in the corner of the hole, where they change fastest with wavelength.
STARS = {
    "faint": ({"v_mag": 5.5, "teff_k": 5500, "distance_pc": 4.0}, "F850", Frames(60.0, 40, 300.0)),
    "bright": ({"v_mag": 0.4, "teff_k": 6500, "distance_pc": 3.5}, "F850", Frames(2.7, 400, 300.0)),
    "speckles": ({"v_mag": 0.4, "teff_k": 6500, "distance_pc": 3.5}, "F520", Frames(1.7, 400, 300.0)),
}
PLANET = {"name": "b", "radius_rjup": 1, "phase_deg": 90, "separation_arcsec": 0.6, "pa_deg": 315, "albedo": "jupiter"}


@functools.cache
def made(star="faint", planets=1, more=(), library="same_star_planet_free", **dial):
    body, band, frames = STARS[star]
    planet = PLANET | {"separation_arcsec": 0.9 if star == "speckles" else 0.6}
    scene = load_scene({"name": star, "cstar": body, "planets": [planet][:planets], "stars": [dict(s) for s in more]})
    model = build_model(load_instrument(), [band], Strategy(library=library))
    target = scene_target(scene)
    shown = [source for source in scene_sources(scene, model.instrument, band) if source.kind == "planet"]
    expected = [expected_of(model, target, band, (s.x_arcsec, s.y_arcsec), s.contrast, frames) for s in shown]
    return task_of(
        model,
        scene,
        band,
        frames,
        expected,
        seed=4,
        realisations=2,
        audit=False,
        overrides=None,
        planets=[s.name for s in shown],
        **dial,
    )


def decisions(modelling):
    return {row.key: row.decision for row in modelling.rows}


def test_standard_draws_sums_as_they_were():
    how = modelling_of(made())
    assert (how.draw, how.region, how.knobs, how.epochs) == ("sums", "hole", FIDELITIES["standard"], SUM_EPOCHS)
    assert how.left_out == ()
    nominal = load_instrument()
    assert how.instrument(nominal) == images_of(nominal)
    assert how.outcome.value is not None
    assert all(how.predicted_error[name] <= how.dial.tolerance[name] for name in ("planet_flux", "snr"))
    assert decisions(how)["summed_frames"] == "skipped"
    assert decisions(how)["photon_noise"] == "kept"


def test_the_reference_leaves_nothing_out():
    how = modelling_of(made(fidelity="reference"))
    assert (how.draw, how.region, how.knobs) == ("frames", "full", FIDELITIES["reference"])
    assert (how.switches, how.left_out) == ({}, ())
    assert how.predicted_error == {"planet_flux": 0.0, "snr": 0.0}
    assert how.instrument(load_instrument()) == load_instrument()
    for row in how.rows:
        assert row.decision == "kept" or not row.size or row.key in LEFT_OUT, row
    assert how == modelling_of(made(tolerance=0.0))
    assert how.runs_by_frames(40) == 40


def test_what_is_audited_has_every_effect():
    how = modelling_of(made()).whole()
    assert (how.draw, how.epochs, how.knobs) == ("frames", MAX_EPOCHS, FIDELITIES["standard"])
    assert how.instrument(load_instrument()) == load_instrument()


def test_a_tolerance_is_met_and_more_of_it_costs_no_more():
    found = [modelling_of(made(tolerance=value)) for value in (0.003, 0.01, 0.03, 0.1, 0.3)]
    for how in found:
        assert how.outcome.value is not None
        for name, value in how.predicted_error.items():
            assert value <= how.dial.tolerance[name]
    costs = [task_cost(made(tolerance=value)).work_s for value in (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)]
    assert costs == sorted(costs, reverse=True)
    assert costs[0] > 5 * costs[-1]


def test_noise_that_is_measured_is_never_left_out():
    how = modelling_of(made(tolerance=0.5))
    for name in ("photon_noise", "em_register", "read_noise", "dark", "clock_charge", "sky"):
        assert decisions(how)[name] == "kept"
    assert not set(how.switches) - set(NOT_IN_SUMS)


def test_a_source_that_does_not_matter_is_not_drawn():
    far = ({"name": "far", "v_mag": 19.0, "teff_k": 5000, "separation_arcsec": 3.0, "pa_deg": 100.0},)
    task = made(more=tuple(tuple(star.items()) for star in far), tolerance=0.05)
    how = modelling_of(task)
    assert how.left_out == ("far",)
    visits = visit_pair(task, modelling=how)
    assert [source.name for source in visits.science.truth.sources] == ["faint", "b"]
    standard = modelling_of(made(more=tuple(tuple(star.items()) for star in far)))
    assert standard.left_out == ()


def test_frames_on_request():
    how = modelling_of(made(), by_frames=True)
    assert (how.draw, how.region, how.epochs) == ("frames", "hole", MAX_EPOCHS)
    assert all(decisions(how)[name] == "kept" for name in ("flat", "cosmic_rays", "smear", "summed_frames"))
    assert how.runs_by_frames(40) == 2


def test_sums_hold_the_noise_of_the_smear_and_not_its_mean():
    """Next to a bright star the frame transfer leaves more electrons in the hole than its light."""
    task = made("bright")
    how = modelling_of(task)
    assert how.draw == "sums"
    (row,) = (row for row in how.rows if row.key == "smear")
    assert (row.decision, row.size > how.dial.tolerance["snr"]) == ("kept", True)
    assert decisions(how)["flat"] == "skipped"
    held = visit_pair(task, modelling=how)
    off = replace(task, simulator=load_instrument({"detector": {"switches": {"smear": False}}}).model_dump(mode="json"))
    without = visit_pair(off, modelling=how)
    hole = held.geometry.hole
    whole = observe(task.scene, band=task.band, exposure_s=task.exposure_s, em_gain=task.em_gain, window="full")
    rows, columns, _ = whole.area.stamp(len(hole))
    smear = whole.smear_e[rows, columns][hole]
    assert smear.mean() > held.science.mean_rate_map[hole].mean() * task.exposure_s
    drawn = [[visits.draw(number) for number in range(6)] for visits in (held, without)]
    mean = [np.mean([one.science_e[hole] for one in part]) for part in drawn]
    charge = [np.mean([one.reduced.white_variance_e2[hole] for one in part]) for part in drawn]
    assert abs(mean[0] - mean[1]) < 5 * np.sqrt(sum(charge) / (2 * 6 * hole.sum()))
    factor2 = excess_noise_factor2(task.em_gain, 604)
    assert charge[0] - charge[1] == pytest.approx(2 * factor2 * task.n_frames * smear.mean(), rel=0.02)
    # what is drawn scatters as the variance says: pixel by pixel, from draw to draw
    spread = np.var([one.science_e[hole] for one in drawn[0]], axis=0, ddof=1).mean()
    assert 2 * spread == pytest.approx(charge[0], rel=0.05)


def test_an_idealised_library_has_the_same_mean():
    visits = visit_pair(made("bright", library="idealised"))
    stack = visits.draw(0).reduced
    mean, spread = stack.image_e[stack.region].mean(), stack.image_e[stack.region].std()
    assert abs(mean) < 4 * spread / np.sqrt(stack.region.sum())


def test_frames_and_sums_have_the_same_white_noise_where_smear_counts():
    task = replace(made("bright"), n_frames=4)
    sums = visit_pair(task).draw(0)
    frames, _ = realise_frames(visit_pair(task, modelling=modelling_of(task, by_frames=True)))
    region = frames.reduced.region & sums.reduced.region
    noise = [item.reduced.white_variance_e2[region].mean() for item in (frames, sums)]
    assert noise[0] == pytest.approx(noise[1], rel=0.1)
    scatter = [item.reduced.image_e[region].std() for item in (frames, sums)]
    assert scatter[0] == pytest.approx(scatter[1], rel=0.1)


def test_a_tier_that_is_too_coarse_is_an_answer():
    task = made("speckles", fidelity="quick")
    how = modelling_of(task)
    assert how.outcome.value is None
    (found,) = refusals_of(task)
    assert (found.status, found.reason, found.planet) == ("invalid", "tier_too_coarse", "b")
    assert "--fidelity standard" in found.message
    assert found.recovered_snr is None
    assert (found.n_frames, found.predicted_snr) == (400, task.predictions[0]["snr"])
    assert found.modelled.fidelity == "quick"
    assert refusals_of(made("speckles")) == []
    # whoever draws such images all the same gets what the tier stands for
    assert (how.draw, how.knobs) == ("sums", FIDELITIES["quick"])


def test_quick_is_wrong_where_it_is_refused():
    """Residual speckles of two wavelengths and of seven differ where the planet stands."""
    task, rms = made("speckles"), {}
    for tier in ("quick", "standard", "reference"):
        visits = visit_pair(task, modelling=replace(modelling_of(task), knobs=FIDELITIES[tier], epochs=1, exact=True))
        science, reference = visits._stacks
        annulus = visits.geometry.annulus(0.9, 1.0)
        kept = [(science.mean_rates(k) - reference.mean_rates(k))[0][annulus].std() for k in range(4)]
        rms[tier] = np.mean(kept)
    assert abs(rms["standard"] / rms["reference"] - 1.0) < 0.03
    assert abs(rms["quick"] / rms["reference"] - 1.0) > abs(rms["standard"] / rms["reference"] - 1.0)


def test_a_search_is_judged_by_a_planet_in_the_hole():
    how = modelling_of(made(planets=0))
    assert (how.draw, how.epochs) == ("sums", SUM_EPOCHS)
    assert set(how.predicted_error) == {"planet_flux", "snr"}
    assert visit_pair(made(planets=0)).science.truth.sources[-1].kind == "cstar"


def test_the_record_is_plain_and_finite():
    for dial in ({"fidelity": "quick"}, {"fidelity": "reference"}, {"tolerance": 0.1}):
        record = modelling_of(made("speckles", **dial)).record()
        again = ModellingRecord.model_validate_json(record.model_dump_json())
        assert again == record
        assert len({row.key for row in record.effects}) == len(record.effects)


@pytest.mark.long
def test_whole_frames_and_sums_reduce_to_the_same_planet():
    """The reference beside standard on few frames: flux and noise of the same planet."""
    short = replace(made(), n_frames=4)
    reference = replace(short, fidelity="reference")
    visits = visit_pair(reference)
    realised, story = realise_frames(visits)
    assert visits.science.shape == (1050, 1080)
    assert realised.reduced.image_e.shape == visits.geometry.hole.shape
    assert story.lost_in == 0
    sums = visit_pair(short).draw(0)
    region = realised.reduced.region & sums.reduced.region
    assert region.sum() > 0.95 * visits.geometry.hole.sum()
    noise = [np.sqrt(item.reduced.white_variance_e2[region].mean()) for item in (realised, sums)]
    assert noise[0] == pytest.approx(noise[1], rel=0.05)
    scatter = [item.reduced.image_e[region].std() for item in (realised, sums)]
    assert scatter[0] == pytest.approx(scatter[1], rel=0.1)


@pytest.fixture(scope="module")
def task():
    model = build_model(load_instrument(), ["F850"])
    target, _ = find_target("tau Cet")
    ready = prepare_task(model, target, "F850", time_s=3600.0, planet=ReferencePlanet(), seed=1, realisations=8)
    return replace(ready, n_frames=30, visits=2, reference_visits=2)


def test_tiers_are_ordered_in_time(task):
    coarse, fine, whole = (
        task_cost(replace(task, **dial))
        for dial in ({"tolerance": 0.2}, {"fidelity": "standard"}, {"fidelity": "reference"})
    )
    assert coarse.work_s < fine.work_s < 0.1 * whole.work_s
    assert coarse.memory_mb <= fine.memory_mb < whole.memory_mb


def test_frames_are_those_that_are_drawn(task):
    assert (task_cost(task).frames, task_cost(task).realisations) == (0, 8)
    audited = task_cost(replace(task, audit=True))
    assert audited.frames == 96  # two sequences of 24 frames of either role, of 2 * 2 * 30 frames in all
    longer = task_cost(replace(task, audit=True, n_frames=300))
    assert audited.frames < longer.frames < 0.3 * 2 * 2 * 300
    short = task_cost(replace(task, audit=True, n_frames=5))
    assert short.frames == 2 * 2 * 5
    assert audited.work_s > task_cost(task).work_s
    whole = task_cost(replace(task, fidelity="reference"))
    assert (whole.frames, whole.realisations) == (8 * 2 * 2 * 30, 8)
    fewer = replace(task, fidelity="reference", strategy=task.strategy | {"reference_ratio": 0.5})
    assert task_cost(fewer).frames == 8 * 2 * 45


def test_more_work_takes_longer(task):
    twice = replace(task, realisations=16)
    assert task_cost(twice).work_s > task_cost(task).work_s
    short, long = (task_cost(replace(task, fidelity="reference", n_frames=n)).work_s for n in (30, 300))
    assert long > 3 * short


def test_workers_share_pieces_and_no_piece_is_shared(task):
    one, two, many = (images_cost([task, task]).at(workers)["wall_s"] for workers in (1, 2, 8))
    assert one > two == many
    assert images_cost([task]).at(8)["wall_s"] == images_cost([task]).at(1)["wall_s"]
    empty = images_cost([]).at(2)
    assert (empty["n_tasks"], empty["n_frames"], empty["memory_mb"]) == (0, 0, 0.0)
