"""Visits of a task: what each library shows, sums against frames, and the story of the frames."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import build_model
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.queries.shared import ReferenceStar
from cpic_planner.targets import find_target
from cpic_planner.validation import ConfirmTask, modelling_of, prepare_task, realise_frames, visit_pair
from simulator import load_instrument

STILL = {"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}


@functools.cache
def task_of(library="same_star_planet_free", still=True, star="tau Cet", **changes):
    extra = {"reference_star": ReferenceStar(v_mag=4.5)} if library == "reference_star" else {}
    model = build_model(
        load_instrument(STILL if still else {}), ["F520"], Strategy(library=library, visits=1, **extra, **changes)
    )
    target, _ = find_target(star)
    task = prepare_task(model, target, "F520", time_s=1800.0, planet=ReferencePlanet(), seed=5, fidelity="quick")
    assert isinstance(task, ConfirmTask)
    return task


@pytest.mark.parametrize(("n_sums", "n_frames"), [(10, 1), pytest.param(40, 5, marks=pytest.mark.long)])
def test_sums_and_frames_reduce_to_the_same_image(n_sums, n_frames):
    """Mean residual over realisations: the planet as the subtraction leaves it, from sums and from every frame."""
    task = replace(task_of(), n_frames=12)
    visits = visit_pair(task)
    assert visits.stackable.status.value == "ok"
    every = [
        realise_frames(visit_pair(task, realisation=number, modelling=modelling_of(task).whole()))[0].reduced
        for number in range(n_frames)
    ]
    means = {
        "sums": np.mean([visits.draw(number).reduced.image_e for number in range(n_sums)], axis=0),
        "frames": np.mean([stack.image_e for stack in every], axis=0),
    }
    planet = visits.science.truth.sources[1]
    light = planet.rate_e_s * visits.optics.at(planet.x_arcsec, planet.y_arcsec) * task.exposure_s * 12
    bright = every[0].region & (light > 0.3 * light.max())
    # The planet's own electrons, with the excess noise of the register, besides what the stack states.
    noise = np.sqrt(visits.draw(0).reduced.white_variance_e2[bright].sum() + 2 * light[bright].sum())
    for name, runs in (("sums", n_sums), ("frames", n_frames)):
        assert means[name][bright].sum() == pytest.approx(light[bright].sum(), abs=4 * noise / np.sqrt(runs)), name


def test_white_variance_of_real_draws():
    task = task_of()
    visits = visit_pair(replace(task, scene=task.scene | {"planets": []}, planets=[], predictions=[]))
    pulls = []
    for number in range(12):
        stack = visits.draw(number).reduced
        pulls.append(stack.image_e[stack.region] / np.sqrt(stack.white_variance_e2[stack.region]))
    pulls = np.array(pulls)
    assert np.mean(pulls**2) == pytest.approx(1.0, abs=0.03)


def test_an_idealised_library_adds_no_noise():
    plain, ideal = visit_pair(task_of()), visit_pair(task_of("idealised"))
    ratio = [
        visits.draw(0).reduced.white_variance_e2[visits.geometry.hole].mean()
        / (visits.task.exposure_s * visits.task.n_frames)
        for visits in (plain, ideal)
    ]
    assert ratio[1] / ratio[0] == pytest.approx(0.5, rel=0.1)
    drifting = visit_pair(task_of("idealised", still=False, star="alf Cen A"))
    science, reference = drifting._stacks  # the expectation has the wavefront of the very visit
    hole = drifting.geometry.hole
    planet = science.static_e_s - reference.static_e_s
    difference = science.mean_rates(3) - reference.mean_rates(3) - planet
    assert np.abs(difference[:, hole]).max() < 1e-9 * reference.mean_rates(3)[:, hole].max()


def test_a_reference_star_is_scaled_by_its_light():
    visits = visit_pair(task_of("reference_star"))
    assert visits.scale == pytest.approx(10 ** (0.4 * (4.5 - 3.5)), rel=0.1)
    residual = np.mean([visits.draw(number).reduced.image_e for number in range(10)], axis=0)
    dark = visits.geometry.hole & (visits.optics.at(*_place(visits)) < 1e-4 * visits.optics.off_axis.max())
    noise = np.sqrt(visits.draw(0).reduced.white_variance_e2[dark].sum() / 10)
    # The planet's light is in the level that is taken off, and its wings in what is left.
    assert abs(residual[dark].sum()) < 4 * noise + _planet_light(visits)


def _planet_light(visits):
    planet = visits.science.truth.sources[1]
    light = visits.optics.at(*_place(visits))[visits.geometry.hole].sum() * planet.rate_e_s
    return light * visits.task.exposure_s * visits.task.n_frames


def _place(visits):
    planet = visits.science.truth.sources[1]
    return planet.x_arcsec, planet.y_arcsec


def test_rolls_see_the_planet_twice():
    visits = visit_pair(task_of("roll", roll_deg=40.0))
    realised = visits.draw(0)
    assert realised.roll is not None
    places = [sequence.truth.sources[1] for sequence in (visits.science, visits.reference)]
    turned = [np.degrees(np.arctan2(place.y_arcsec, place.x_arcsec)) for place in places]
    assert abs(turned[0] - turned[1]) == pytest.approx(40.0)
    assert np.mean(turned) == pytest.approx(45.0)


def test_frames_lose_what_is_hit_and_what_is_bad():
    instrument = {"cosmic_rays": {"peak_rate_per_s_cm2": 20.0}}
    model = build_model(load_instrument(instrument), ["F520"], Strategy(visits=1))
    target, _ = find_target("tau Cet")
    task = prepare_task(model, target, "F520", time_s=1800.0, planet=ReferencePlanet(), seed=5, fidelity="quick")
    task = replace(task, n_frames=16)
    visits = visit_pair(task, modelling=modelling_of(task).whole())
    realised, story = realise_frames(visits)
    assert story.hits > 100
    # Particles fill pixels too; the star's own light does not.
    assert story.lost_in == 0
    assert 0.02 < story.rejected_fraction < 0.5
    flaws = visits.geometry.hole & ~realised.reduced.region
    assert np.count_nonzero(flaws) < 0.02 * visits.geometry.hole.sum()
    clean = replace(task, simulator=model.instrument.switched({"cosmic_rays": False}).model_dump(mode="json"))
    other, _ = realise_frames(visit_pair(clean, modelling=modelling_of(clean).whole()))
    both = realised.reduced.region & other.reduced.region
    grown = realised.reduced.white_variance_e2[both].mean() / other.reduced.white_variance_e2[both].mean()
    assert grown == pytest.approx(1.0 / (1.0 - story.rejected_fraction), rel=0.1)


def test_a_programme_is_the_mean_of_its_visits_less_that_of_the_references():
    """By hand, from the draws of every visit; R references of V / R times the length; modes are of visits."""
    task = replace(task_of(still=False), n_frames=6, visits=3, reference_visits=2)
    strategy = task.strategy | {"reference_visits": 2}
    visits = visit_pair(replace(task, strategy=strategy))
    assert (visits.plan.visits, visits.plan.reference_visits, visits.plan.reference["n_frames"]) == (3, 2, 9)
    science, reference = visits._stacks
    sums = science.draw(4, visits=3).sum(axis=0), reference.draw(4, visits=2, summed=True)[0]
    stack = visits.draw(4).reduced
    assert stack.integration_s == pytest.approx(18 * task.exposure_s)
    assert stack.image_e == pytest.approx(sums[0] - sums[1], abs=1e-6 * np.abs(sums[0]).max())
    offsets = [stacks.mean_rates(4, 0)[:, stack.region].mean(axis=0) for stacks in (science, reference)]
    later = science.mean_rates(4, 1)[:, stack.region].mean(axis=0)
    assert np.std(later - offsets[0]) > 0.3 * np.std(offsets[1] - offsets[0])
    rolled = visit_pair(replace(task_of("roll", roll_deg=40.0), n_frames=6, visits=3, reference_visits=3)).draw(4)
    assert [len(half.residuals) for half in (rolled.roll.first, rolled.roll.second)] == [3, 3]
    many = visit_pair(replace(task, strategy=strategy | {"n_modes": 5}))
    assert many.draw(4).reduced.rdi.modes_used == 1  # two visits less their mean


def test_frames_of_a_programme_are_its_sums():
    task = replace(task_of(), n_frames=6, visits=2, reference_visits=2)
    visits = visit_pair(task)
    realised, story = realise_frames(visit_pair(task, modelling=modelling_of(task).whole()))
    other = visits.draw(0).reduced
    assert story.lost_in == 0
    assert realised.reduced.integration_s == other.integration_s == pytest.approx(12 * task.exposure_s)
    assert len(realised.reduced.rdi.residuals) == 2
    both = realised.reduced.region & other.region
    noise = np.sqrt(2.0 * other.white_variance_e2[both].sum())
    assert abs(realised.reduced.image_e[both].sum() - other.image_e[both].sum()) < 4.0 * noise
