"""The solver of frames against plain minimisation, one case at a time."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from cpic_core import Reason
from cpic_planner.etc import FrameCamera, FrameProblem, best_in_visit, least_time, smooth_least_visit_s
from cpic_planner.etc.frames import best_exposure_s
from simulator.config import load_instrument
from simulator.detectors import excess_noise_factor2
from simulator.signal import frame_limit, longest_exposure_s

CAMERA = FrameCamera.of(load_instrument(), "F520")
ONE = {
    "alpha_e_s": 0.4,
    "beta_e": 0.7,
    "gamma_e2": 5e5,
    "signal_e_s": 0.05,
    "z0": 1e-3,
    "z1": 1e-7,
    "z2": 1e-12,
    "loss_per_s": 6e-5,
    "peak_columns_e_s": 2e3,
    "peak_in_hole_e_s": 5.0,
    "register_tail_e_s": 20.0,
    "visits": 1.0,
}


def problem(n=1, camera=CAMERA, em_gain=None, **changes):
    parts = {name: np.broadcast_to(np.asarray(value, float), n).copy() for name, value in (ONE | changes).items()}
    return FrameProblem(**parts, camera=camera, em_gain=em_gain)


def drawn(n, seed, camera=CAMERA):
    """Random cases over everything that matters."""
    rng = np.random.default_rng(seed)
    factors = {name: 10 ** rng.uniform(-1.5, 1.5, n) for name in ONE}
    return problem(n, camera, **{name: ONE[name] * factors[name] for name in ONE})


def white(case, t):
    """Noise over signal squared of a frame at the best of many gains."""
    camera = case.camera
    hottest = [float(getattr(case, name)[0]) for name in ("peak_columns_e_s", "peak_in_hole_e_s", "register_tail_e_s")]
    wells = ((camera.output_well_e, hottest[1]), (camera.register_full_well_e, hottest[2]))
    cap = min(camera.em_gain_max, *(well / (rate * t + 5 * (2 * rate * t) ** 0.5) for well, rate in wells))
    gain = np.geomspace(1.0, cap, 1500)
    light = case.alpha_e_s[0] * t + case.beta_e[0]
    variance = (excess_noise_factor2(gain, 604) * light + case.gamma_e2[0] / gain**2).min() / case.visits[0]
    return variance / (case.signal_e_s[0] * t) ** 2 * math.exp(case.loss_per_s[0] * t)


def longest(case):
    parts = (float(getattr(case, name)[0]) for name in ("peak_columns_e_s", "peak_in_hole_e_s", "register_tail_e_s"))
    return min(float(longest_exposure_s(*parts, case.camera)), case.camera.exposure_max_s)


def inverse(case, t, n):
    v = n * (t + case.camera.readout_s)
    return white(case, t) / n + case.z0[0] + v * (case.z1[0] + v * case.z2[0])


def reference_time(case, level, frames):
    """Least visit for an SNR with each number of frames: the best exposure, then the shortest that does."""
    best = math.inf
    for n in frames:
        top = longest(case)
        found = minimize_scalar(
            lambda x, n=n: inverse(case, math.exp(x), n),
            bounds=(math.log(0.01), math.log(top)),
            method="bounded",
            options={"xatol": 1e-9},
        )
        x, y = min(((found.x, found.fun), (math.log(top), inverse(case, top, n))), key=lambda pair: pair[1])
        if y > level**-2:
            continue
        if inverse(case, 0.01, n) > level**-2:
            x = brentq(lambda x, n=n: inverse(case, math.exp(x), n) - level**-2, math.log(0.01), x, xtol=1e-12)
        else:
            x = math.log(0.01)
        best = min(best, n * (math.exp(x) + case.camera.readout_s))
    return best


@pytest.mark.parametrize("level", [0.4, pytest.param(2.0, marks=pytest.mark.long), 6.0])
def test_least_time_against_plain_minimisation(level):
    cases, compared = drawn(10, 3), 0
    got = least_time(cases, level)
    for i in range(10):
        case, n = cases.at(np.arange(10) == i), int(got.n_frames[i])
        if n > 300:
            continue
        frames = range(1, n + 8) if n < 12 else range(n - 4, n + 5)
        found = reference_time(case, level, frames)
        assert math.isfinite(found) == (n > 0)
        if n > 0:
            assert got.visit_s[i] == pytest.approx(found, rel=2e-6)
            compared += 1
    assert compared >= 2


def test_the_best_exposure_against_plain_minimisation():
    cases = drawn(12, 5, replace(CAMERA, readout_s=20.0))
    t, cost = best_exposure_s(cases)
    for i in range(12):
        case = cases.at(np.arange(12) == i)
        grid = np.geomspace(0.01, longest(case), 300)
        assert cost[i] <= min(white(case, float(x)) * (x + 20.0) for x in grid) * (1 + 1e-6)
        assert cost[i] == pytest.approx(white(case, float(t[i])) * (t[i] + 20.0), rel=1e-6)


def test_nothing_saturates_and_no_exposure_is_beyond_the_longest():
    cases = drawn(400, 8)
    visits = 10 ** np.random.default_rng(2).uniform(0, 6, 400)
    for choice in (least_time(cases, 3.0), best_in_visit(cases, visits), best_in_visit(cases, visits, whole=True)):
        used = choice.n_frames > 0
        assert used.sum() > 100
        assert np.all((choice.exposure_s[used] <= 300.0) & (choice.exposure_s[used] >= 0.01 * (1 - 1e-12)))
        assert np.all((choice.em_gain >= 1.0) & (choice.em_gain <= 1000.0))
        assert np.all(choice.n_frames == np.floor(choice.n_frames))
        for i in np.flatnonzero(used):
            parts = (
                float(getattr(cases, name)[i]) for name in ("peak_columns_e_s", "peak_in_hole_e_s", "register_tail_e_s")
            )
            fits = frame_limit(*parts, choice.exposure_s[i] * (1 - 1e-9), choice.em_gain[i] * (1 - 1e-9), CAMERA)
            assert fits is Reason.NONE
        seen = cases.at(used).inverse_snr2(choice.exposure_s[used], choice.n_frames[used])
        np.testing.assert_allclose(seen, choice.inverse_snr2[used], rtol=1e-12)
        np.testing.assert_allclose(choice.visit_s, choice.n_frames * (choice.exposure_s + CAMERA.readout_s), rtol=1e-15)
        assert np.all(np.isinf(choice.inverse_snr2[~used]))
        assert np.all(choice.visit_s[~used] == 0.0)


def test_inverse_of_each_other():
    cases = drawn(300, 11)
    visits = 10 ** np.random.default_rng(3).uniform(0, 6, 300)
    there = best_in_visit(cases, visits)
    used = there.n_frames > 0
    back = least_time(cases.at(used), there.inverse_snr2[used] ** -0.5)
    np.testing.assert_allclose(back.visit_s, there.visit_s[used], rtol=1e-9)
    assert np.all(there.visit_s <= visits * (1 + 1e-12))


def test_longer_visits_reach_as_much_at_least():
    cases = drawn(60, 13)
    visits = np.sort(np.concatenate([np.geomspace(1.5, 1e7, 60), np.linspace(100, 130, 40)]))
    reached = np.array([best_in_visit(cases, np.full(60, v)).inverse_snr2 for v in visits])
    assert np.all(reached[1:] <= reached[:-1] * (1 + 1e-12))


def test_whole_visits_use_their_time():
    cases = problem(3, camera=replace(CAMERA, exposure_min_s=17.0, exposure_max_s=17.0), z1=[0.0, 1e-4, 1e-4])
    whole = best_in_visit(cases, np.full(3, 5000.0), whole=True)
    np.testing.assert_array_equal(whole.n_frames, math.floor(5000.0 / 18.1))
    short = best_in_visit(cases, np.full(3, 5000.0))
    assert short.n_frames[0] == whole.n_frames[0]
    assert np.all(short.visit_s[1:] < whole.visit_s[1:])
    assert np.all(short.inverse_snr2 <= whole.inverse_snr2)


def test_bounds_without_whole_frames():
    """No whole number of frames is faster, and long visits of short frames come close."""
    cases = drawn(200, 17)
    choice = least_time(cases, 2.0)
    bound = smooth_least_visit_s(cases, 2.0)
    used = choice.n_frames > 0
    assert np.all(choice.visit_s[used] >= bound[used] * (1 - 1e-9))
    many = used & (choice.n_frames > 500)
    assert many.any()
    np.testing.assert_allclose(choice.visit_s[many], bound[many], rtol=1e-3)


def test_the_floor_of_speckles():
    """Without a walk the SNR climbs to 1 / sqrt(z0); with one it has a top."""
    still = problem(1, z1=0.0, z2=0.0, z0=0.04)
    assert least_time(still, 4.99).n_frames[0] > 0
    assert least_time(still, 5.0).n_frames[0] == 0
    walk = problem(1, z0=0.0, z2=0.0, z1=1e-6)
    _, cost = best_exposure_s(walk)
    top = (2.0 * math.sqrt(float(cost[0]) * 1e-6)) ** -0.5
    assert least_time(walk, 0.999 * top).n_frames[0] > 0
    assert least_time(walk, 1.0001 * top).n_frames[0] == 0
    at_top = best_in_visit(walk, np.full(1, 1e9))
    assert at_top.inverse_snr2[0] ** -0.5 == pytest.approx(top, rel=1e-4)
    assert at_top.visit_s[0] == pytest.approx(math.sqrt(float(cost[0]) / 1e-6), rel=0.02)


def test_no_frame_at_all():
    for case in (problem(peak_columns_e_s=1e9), problem(signal_e_s=0.0), problem(em_gain=1000.0, peak_in_hole_e_s=1e6)):
        assert least_time(case, 1.0).n_frames[0] == 0
        assert best_in_visit(case, np.full(1, 1e4)).n_frames[0] == 0
    assert best_in_visit(problem(), np.full(1, 1.0)).n_frames[0] == 0  # shorter than a readout
    assert best_in_visit(problem(), np.zeros(1)).n_frames[0] == 0
