"""The choice of frames against trying everything: thousands of exposures, every number of frames, a grid of gains."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import FrameCamera, best_in_visit, build_model, cases_of, least_time, planets_of
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from simulator.config import load_instrument

CAMERA = FrameCamera.of(load_instrument(), "F520")
COARSE = 30000.0 ** (1 / 1999)  # cost of the next of 2000 exposures from 0.01 to 300 s, evenly in the logarithm
CAMERAS = {
    "default": CAMERA,
    "low read noise": replace(CAMERA, read_noise_e=3.0, rounding_e=0.3),
    "gain up to 20": replace(CAMERA, em_gain_max=20.0),
    "no register": replace(CAMERA, em_gain_max=1.0, register_stages=0, register_full_well_e=np.inf),
    "hybrid": replace(
        CAMERA,
        em_gain_max=1.0,
        register_stages=0,
        register_full_well_e=np.inf,
        read_noise_e=15.0,
        blooms=False,
        full_well_e=1e5,
    ),
    "no readout": replace(CAMERA, readout_s=0.0),
    "shallow": replace(CAMERA, full_well_e=2000.0, register_full_well_e=2e4),
}


def checked(oracles, problem, level):
    """Solve both ways; nothing may be better than the solver, and what it claims must hold."""
    brute = oracles.brute_force
    got, found, case = least_time(problem, level), brute.least_time(problem, level), brute.rows(problem)
    frames, visit = got.n_frames.ravel(), got.visit_s.ravel()
    np.testing.assert_array_equal(frames > 0, found.n_frames > 0)
    both = frames > 0
    assert both.any()
    ratio = visit[both] / found.visit_s[both]
    assert ratio.max() <= 1.001
    assert ratio.min() >= 1.0 / COARSE
    exposure, gain = got.exposure_s.ravel()[both], got.em_gain.ravel()[both]
    chosen = {name: part[both] for name, part in case.items()}
    reached = brute.inverse_snr2(chosen, exposure, frames[both], gain, problem.camera)
    assert np.all(reached <= 1.0 / level**2 * (1.0 + 1e-9))
    np.testing.assert_allclose(reached, got.inverse_snr2.ravel()[both], rtol=1e-9)
    np.testing.assert_allclose(visit[both], frames[both] * (exposure + problem.camera.readout_s), rtol=1e-12)
    assert np.all(gain <= brute.largest_gain(chosen, exposure * (1.0 - 1e-9), problem.camera))
    assert np.all(frames == np.round(frames))
    assert np.all((exposure >= problem.camera.exposure_min_s) & (exposure <= problem.camera.exposure_max_s))
    return frames


@pytest.mark.parametrize(
    "level", [0.3, *(pytest.param(level, marks=pytest.mark.long) for level in (1.0, 5.0, 8.0, 20.0))]
)
def test_no_setting_takes_less_time(oracles, level):
    problem = oracles.random_problems.random_problem(40, CAMERA, seed=int(10 * level))
    frames = checked(oracles, problem, level)
    if level <= 1.0:
        assert ((frames > 0) & (frames < 6)).sum() > 20  # where whole numbers matter most


QUICK_CAMERAS = ("default", "hybrid", "no register")


@pytest.mark.parametrize(
    "name", [name if name in QUICK_CAMERAS else pytest.param(name, marks=pytest.mark.long) for name in CAMERAS]
)
def test_other_cameras(oracles, name):
    checked(oracles, oracles.random_problems.random_problem(12, CAMERAS[name], seed=3), 3.0)


@pytest.mark.parametrize("gain", [1.0, pytest.param(10.0, marks=pytest.mark.long), 1000.0])
def test_a_fixed_gain(oracles, gain):
    checked(oracles, replace(oracles.random_problems.random_problem(12, CAMERA, seed=4), em_gain=gain), 2.0)


def test_at_the_edge_of_what_speckles_allow(oracles):
    """Levels just below and above the best that any visit reaches."""
    problem = oracles.random_problems.random_problem(12, CAMERA, seed=6)
    walking = problem.at((problem.z1 > 0) & (problem.z0 > 0))
    best = 1.0 / np.sqrt(oracles.brute_force.best_in_visit(walking, 1e15))
    for share, possible in ((0.9, True), (0.999, True), (1.01, False), (2.0, False)):
        found = least_time(walking, best * share)
        assert np.all((found.n_frames > 0) == possible)


def checked_visit(oracles, problem, visit_s):
    """Nothing reaches more in a visit."""
    got = best_in_visit(problem, np.full(problem.z0.shape, visit_s))
    found = oracles.brute_force.best_in_visit(problem, visit_s)
    np.testing.assert_array_equal(got.n_frames.ravel() > 0, np.isfinite(found))
    ratio = got.inverse_snr2.ravel()[np.isfinite(found)] / found[np.isfinite(found)]
    assert ratio.max() <= 1.001
    assert ratio.min() >= 1.0 / COARSE
    assert got.visit_s.max() <= visit_s * (1.0 + 1e-12)


@pytest.mark.parametrize(
    "visit_s", [3.0, 3600.0, *(pytest.param(visit_s, marks=pytest.mark.long) for visit_s in (300.0, 1e6))]
)
def test_no_setting_reaches_more_in_a_visit(oracles, visit_s):
    checked_visit(oracles, oracles.random_problems.random_problem(20, CAMERA, seed=7), visit_s)


def test_slow_readout_and_many_particles(oracles):
    slow = replace(CAMERA, readout_s=60.0)
    problem = oracles.random_problems.random_problem(12, slow, seed=8)
    problem = replace(problem, loss_per_s=100.0 * problem.loss_per_s)
    checked(oracles, problem, 2.0)
    for visit_s in (100.0, 1e5):
        checked_visit(oracles, problem, visit_s)


def test_brute_force_finds_what_a_hand_finds(oracles):
    """One frame, no background: the exposure is ``SNR^2 / rate`` at gain 1 without read noise."""
    quiet = replace(CAMERA, read_noise_e=0.0, rounding_e=0.0)
    problem = oracles.random_problems.random_problem(1, quiet, seed=1)
    two, none = np.full(1, 2.0), dict.fromkeys(oracles.brute_force.FIELDS, np.zeros(1))
    simple = replace(problem, **none | {"alpha_e_s": two, "signal_e_s": two})
    found = oracles.brute_force.least_time(simple, 10.0)
    assert found.exposure_s[0] == pytest.approx(50.0, rel=0.006)
    assert (found.n_frames[0], found.em_gain[0]) == (1.0, 1.0)
    assert least_time(simple, 10.0).exposure_s[0] == pytest.approx(50.0, rel=1e-9)


@pytest.mark.parametrize("search", ["blind", "known_place"])
@pytest.mark.parametrize(("star", "visits"), [("tau Cet", 1), ("alf CMi A", 2), ("61 Cyg A", 3)])
def test_no_frames_reach_sooner_a_level_that_follows_them(star, visits, search):
    """The level of a detection depends on the frames themselves: every number of them and 4000 exposures are tried."""
    model, bands = build_model(load_instrument(), None, Strategy(search=search)), ("F520", "F720")
    cases = cases_of(model, find_target(star)[0], bands, planets_of([0.42, 0.6]), objective="significance")
    many = np.full(cases.shape, float(visits))
    found = cases.at_level(many)
    programme, problem = found.cases.programme, found.problem
    level, camera = cases.level(programme, problem), problem.camera
    exposure = np.geomspace(camera.exposure_min_s, camera.exposure_max_s, 4000).reshape(-1, 1, 1, 1)
    allowed = exposure <= problem.longest_s
    shape = np.broadcast_shapes(exposure.shape, cases.shape)
    best = np.full(cases.shape, np.inf)
    frames = np.unique(np.concatenate([np.arange(1.0, 200.0), np.round(np.geomspace(200.0, 2e4, 200))]))
    some = found.choice.n_frames >= 1
    for n in (*frames, *found.choice.n_frames[some]):
        visit = np.broadcast_to(n * (exposure + camera.readout_s), shape)
        inverse = problem.inverse_snr2(np.broadcast_to(exposure, shape), np.array(n))
        reached = allowed & (inverse * level(visit, inverse) ** 2 <= 1.0)
        best = np.minimum(best, np.where(reached, visit, np.inf).min(axis=0))
    np.testing.assert_array_equal(some | np.isinf(best), True)  # what the grid reaches the solver reaches, too
    assert some.any()
    np.testing.assert_allclose(found.choice.inverse_snr2[some] * found.level[some] ** 2, 1.0, rtol=1e-9)
    assert np.all(found.choice.visit_s[some] <= best[some] * (1.0 + 1e-9))
