"""Audit of a programme: what few frames beside their twins tell, and that it is carried to all frames."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from cpic_planner.etc import build_model
from cpic_planner.queries import ReferencePlanet, SimulatorOverrides, Strategy
from cpic_planner.targets import find_target
from cpic_planner.validation import prepare_task, realise as audit, visit_pair
from cpic_planner.validation.frames import calibrated_frames, transferred
from cpic_planner.validation.task import modelling_of
from simulator import load_instrument
from simulator.camera import load_calibration_set

# The light of one visit is that of all: what the mean of few visits loses of it is known from the mean map.
STILL = {"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}


@functools.cache
def task_of(altered=""):
    model = build_model(load_instrument(STILL), ["F520"], Strategy())
    target, _ = find_target("tau Cet")
    overrides = SimulatorOverrides.of(altered) if altered else None
    task = prepare_task(
        model, target, "F520", time_s=7200.0, planet=ReferencePlanet(), seed=4, fidelity="standard", overrides=overrides
    )
    large = task.scene["planets"][0] | {"radius_rjup": 4.0}  # sixteen times the light
    return replace(
        task, scene=task.scene | {"planets": [large]}, exposure_s=30.0, n_frames=16, visits=10, reference_visits=10
    )


@functools.cache
def full_of(altered=""):
    task = task_of(altered)
    return visit_pair(task, realisation=audit.REALISATION, modelling=modelling_of(task).whole())


@functools.cache
def effects_of(altered=""):
    return audit.frame_effects(full_of(altered), "science", 10)


@pytest.mark.parametrize(("visits", "length"), [(1, 1), (1, 460), (10, 16), (3, 25), (2, 48)])
def test_sequences_are_all_frames_once_and_span_their_visit(visits, length):
    every = list(audit.sequences(visits, length))
    assert sorted((visit, number) for visit, part in every for number in part) == [
        (visit, number) for visit in range(visits) for number in range(length)
    ]
    assert max(len(part) for _, part in every) <= 24
    first = every[0][1]
    assert first[-1] >= length - 1 - first.step
    assert [visit for visit, _ in every[:visits]] == list(range(visits))


def test_a_twin_has_the_noise_of_its_frame():
    """Without the effects of single frames nothing is left of the difference; with them a tenth of the noise is."""
    observation = full_of().visit("science", 0)
    numbers = range(0, 16, 4)
    hole = full_of().geometry.hole
    twin = calibrated_frames(audit.without_frame_effects(observation), numbers=numbers).electrons
    plain = audit.without_frame_effects(observation)
    assert not plain.camera_chain.particles
    assert np.array_equal(calibrated_frames(plain, numbers=numbers).electrons, twin)
    switches = plain.instrument.detector.switches
    assert all((switches.flat, switches.dark_structure, switches.bad_pixels))  # pixels are those of the frames
    frames = calibrated_frames(observation, numbers=numbers)
    good = frames.usable & ~frames.struck & hole
    difference = np.where(good, frames.electrons - twin, 0.0).var(axis=0)[hole].mean()
    assert 0.0 < difference < 0.4 * twin.var(axis=0)[hole].mean()


def test_frames_are_run_until_their_noise_is_small():
    effects, hole = effects_of(), full_of().geometry.hole
    assert 32 <= effects.statistics.frames_run < 0.5 * 160
    assert effects.statistics.frames_run % 16 == 0
    inside = hole & effects.covered
    share = 1.0 - effects.common[inside] / effects.variance[inside]
    assert 0.1 < np.median(share) <= audit.MOST_SHARE
    assert np.median(effects.variance[inside]) == pytest.approx(1.0, abs=0.1)


def test_noise_of_the_programme_is_kept():
    """By hand: a total noise of both parts as of all frames, visits that scatter as their frames do."""
    rng = np.random.default_rng(3)
    n_frames, visits, share = 16, 400, 0.4
    shape = (visits, 20, 20)
    counts = np.full(visits, n_frames)
    mean = np.full(shape, 5.0 * n_frames)
    drawn = mean + np.sqrt(n_frames) * rng.standard_normal(shape)
    change = 0.5 + np.sqrt(share / counts.sum()) * rng.standard_normal(shape[1:])
    one = np.ones(shape[1:])
    effects = audit.FrameEffects(change, one, (1 - share) * one, one, one > 0, effects_of().statistics)
    images = effects.on(drawn, mean, counts)
    total = images.sum(axis=0) / counts.sum()
    assert total.mean() == pytest.approx(5.5, abs=4 / np.sqrt(400 * counts.sum()))
    assert total.var() * counts.sum() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 400))
    assert (images - images.mean(axis=0)).var() / n_frames == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    "altered",
    ["detector.transfer.parallel_cti=x10", pytest.param("detector.transfer.serial_cti=x10", marks=pytest.mark.long)],
)
def test_charge_that_stays_behind_is_seen(altered):
    """The change is that of the mean light by the law of the transfers, at ten times the loss.

    A dead column passes nothing on: beside it the planet leaves half as much behind again as in a whole field.
    """
    visits, effects, before = full_of(altered), effects_of(altered), effects_of()
    observation = visits.science
    detector, first = observation.instrument.detector, observation.first_pixel
    window = [slice(at, at + size) for at, size in zip(first, observation.shape, strict=True)]
    response = load_calibration_set(detector).window(*window).response_of(detector.switches)
    light = observation.mean_rate_map * observation.exposure_s
    moved = transferred(light * response, detector, first) / np.where(response > 0, response, 1.0) - light
    covered = effects.covered & before.covered & (binary_erosion(visits.geometry.hole, iterations=2))
    moved, found, was = moved[covered], effects.change_e[covered], before.change_e[covered]
    shares = [float((moved * one).sum() / (moved**2).sum()) for one in (found, was)]
    # Noise goes with the light, as what moves does: pixel by pixel.
    error = np.sqrt((moved**2 * (found - shares[0] * moved) ** 2).sum()) / (moved**2).sum()
    assert error < 0.1
    assert shares[0] == pytest.approx(1.0, abs=4 * error)
    assert shares[0] > shares[1] + 4 * error


def test_particles_are_told():
    plain, story = effects_of().statistics, effects_of("cosmic_rays.peak_rate_per_s_cm2=x8").statistics
    assert story.hits / story.frames_run > 4 * plain.hits / plain.frames_run
    flawed = 1.0 - effects_of().covered[full_of().geometry.hole].mean()
    assert story.rejected_fraction - flawed > 3 * (plain.rejected_fraction - flawed) > 0
