"""Exposure, whole number of frames and EM gain: the solver behind every answer.

With ``N`` frames of ``t`` seconds in a visit of ``v = N (t + readout)`` seconds,

    1 / SNR^2 = y(t) / N + z(v) = G(t) / v + z(v),    G(t) = y(t) (t + readout),

where ``y`` is white noise over signal squared of one frame (of every visit of a programme) at its best gain and ``z``
the speckle residual of the programme, which only grows with the visit. So the best exposure is the one of least ``G``,
whatever the visit; whole numbers of frames next to ``v / (t + readout)`` then follow exactly. Time for an SNR and SNR
for a time are inverses of each other.
"""

import functools
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, Record
from cpic_planner.etc.model import FrameCamera, Programme, best_gain
from cpic_planner.etc.noise import PLAIN, Objective, own_noise, residuals, white_term
from cpic_planner.etc.photon_counting import CountingLight, counting_probabilities, reference_pixel
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.etc.searches import CaseArrays, bracketed, first_root, first_root_of_all, lowest, spread, taken
from cpic_planner.queries import Strategy
from simulator.detectors import FrameTerm, frame_variance_e2, frames_per_clean, noise_factor2
from simulator.signal import largest_gain, longest_exposure_s

_NEIGHBOURS = np.array([-1.0, 0.0, 1.0, 2.0])
_MAX_FRAMES = 1e15
_ROUNDING = 1e-12
_STEP = 1e-4
_ELASTICITY = 1e-4
"""A visit ends where 1 % more time gives less than 5e-7 more SNR: at its very top the time would be arbitrary."""
_NEWTON_STEPS = 60
_NEARLY = 2.0
_LONGER = 1.1, 2.0, 5.0, 20.0, 200.0, np.inf


class FrameProblem(CaseArrays, Record):
    """The numbers that decide the frames of any number of cases; arrays that broadcast to the shape of the signal.

    Attributes
    ----------
    alpha_e_s, beta_e, gamma_e2 : ndarray
        Variance of one science frame with its share of the reference, ``F^2 (alpha t + beta) + gamma / g^2``.
    signal_e_s : ndarray
        Planet in the aperture.
    z0, z1, z2 : ndarray
        Speckle variance over signal squared, ``z0 + z1 v + z2 v^2``.
    loss_per_s : ndarray
        Rate of particles that void an aperture: a frame of ``t`` s counts with probability ``exp(-loss t)``.
    peak_columns_e_s, peak_in_hole_e_s, register_tail_e_s : ndarray
        Light that must not saturate; see `simulator.signal.saturation`.
    visits : ndarray
        Visits of the programme: noise and residual are those of all together, frames those of one.
    camera : FrameCamera
    em_gain : float, optional
        Fixed gain.
    counting : CountingLight, optional
        Photons are counted at the largest gain instead of measured.
    best_s : ndarray, optional
        Exposure of most SNR per time, where it is known.
    """

    alpha_e_s: FloatArray
    beta_e: FloatArray
    gamma_e2: FloatArray
    signal_e_s: FloatArray
    z0: FloatArray
    z1: FloatArray
    z2: FloatArray
    loss_per_s: FloatArray | float
    peak_columns_e_s: FloatArray
    peak_in_hole_e_s: FloatArray
    register_tail_e_s: FloatArray
    visits: FloatArray
    camera: FrameCamera
    em_gain: float | None = None
    counting: CountingLight | None = None
    best_s: FloatArray | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the cases."""
        return self.signal_e_s.shape

    def fixed_gain(self) -> float | None:
        """Return the gain that is not to be chosen; counting uses the largest one."""
        return self.camera.em_gain_max if self.em_gain is None and self.counting is not None else self.em_gain

    def peaks_e_s(self, index: Any = ...) -> tuple[Any, Any, Any]:
        """Return the light that must not saturate: in the hole's columns, inside it, and before the register."""
        peaks = self.peak_columns_e_s, self.peak_in_hole_e_s, self.register_tail_e_s
        return peaks if index is ... else tuple(spread(peak, self.shape)[index] for peak in peaks)

    @functools.cached_property
    def longest_s(self) -> FloatArray:
        """Longest exposure that saturates nothing and that the camera allows."""
        limit = longest_exposure_s(*self.peaks_e_s(), self.camera, self.fixed_gain() or 1.0)
        return np.minimum(limit, self.camera.exposure_max_s)

    def frame_noise(self, exposure_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the white noise over signal squared of one frame of each visit, and the gain that makes it least."""
        t, fixed = exposure_s, self.fixed_gain()
        light = self.alpha_e_s * t + self.beta_e
        if self.counting is not None:
            variance, gain = self.counting.frame_variance(t), np.full(t.shape, fixed)
        elif fixed is not None:
            gain = np.full(t.shape, fixed)
            stages = self.camera.register_stages
            factor2 = noise_factor2(np.asarray(fixed, float), stages) if stages else 1.0
            variance = frame_variance_e2(light, factor2, self.gamma_e2, fixed)
        else:
            cap = largest_gain(self.peak_in_hole_e_s, self.register_tail_e_s, t, self.camera)
            camera = self.camera
            gain, variance = best_gain(light, self.gamma_e2, cap, camera.em_gain_max, camera.register_stages)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            noise = variance / (self.signal_e_s * t) ** 2 / self.visits * frames_per_clean(self.loss_per_s, t)
        return noise, gain

    def residual(self, visit_s: FloatArray) -> FloatArray:
        """Return the speckle variance over signal squared."""
        return self.z0 + visit_s * (self.z1 + visit_s * self.z2)

    def inverse_snr2(self, exposure_s: FloatArray, n_frames: FloatArray) -> FloatArray:
        """Return ``1 / SNR^2`` of a programme.

        Parameters
        ----------
        exposure_s : ndarray
            Of one frame.
        n_frames : ndarray
            Of one visit.
        """
        visit = n_frames * (exposure_s + self.camera.readout_s)
        return self.frame_noise(exposure_s)[0] / n_frames + self.residual(visit)


def frame_problem(
    rates: ApertureRates,
    camera: FrameCamera,
    strategy: Strategy = PLAIN,
    *,
    objective: Objective = "snr",
    em_gain: float | None = None,
    programme: Programme | None = None,
    white: FrameTerm | None = None,
) -> FrameProblem:
    """Return what the solver of frames needs of an aperture's rates.

    Parameters
    ----------
    rates : ApertureRates
    camera : FrameCamera
    strategy : Strategy
        Says how many references there are, and whether photons are counted above which threshold.
    objective : {"snr", "significance"}
        With or without the planet's own noise and the error of the mean background.
    em_gain : float, optional
        Fixed gain.
    programme : Programme, optional
        Visits that are reduced together, ``n_frames`` in each; by default those of the strategy, or one.
    white : FrameTerm, optional
        Where it is known: `white_term` of these rates, of this programme's references.

    Notes
    -----
    Everything but the planet is measured twice, in science and in reference frames. A sum over a circle has the
    variance of ``sum(w^2)`` pixels, fewer than its area.
    """
    with_planet = objective == "snr"
    level = 1.0 + 1.0 / rates.background_apertures if with_planet else 1.0
    made = Programme.of(strategy) if programme is None else programme
    factor = made.white_factor * rates.variance_factor
    share = level * rates.noise_fraction * factor
    ratio = made.frame_ratio(strategy.reference_ratio)
    white = white_term(rates, camera, ratio) if white is None else white
    own = own_noise(rates, camera, made) if with_planet else 0.0
    z0, z1, z2 = residuals(rates, level, made)
    arrays: dict[str, Any] = {
        "alpha_e_s": camera.light_factor * share * white.rate_e_s + own,
        "beta_e": camera.light_factor * share * white.charge_e,
        "gamma_e2": share * white.output_e2,
        "z0": z0,
        "z1": z1,
        "z2": z2,
        "loss_per_s": rates.loss_per_s,
        "peak_columns_e_s": rates.peak_columns_e_s,
        "peak_in_hole_e_s": rates.peak_in_hole_e_s,
        "register_tail_e_s": rates.register_tail_e_s,
        "visits": made.visits,
    }
    counting, shape = None, np.broadcast(rates.planet_e_s, *arrays.values()).shape
    if strategy.mode == "photon_counting":
        if camera.of_past:
            allowed = "off: what frames leave in the next one is not known for frames of counted photons"
            raise InputError(f"switches.{camera.added[0][0]}", True, allowed=allowed)
        pixels = rates.noise_fraction * factor * rates.aperture_pixels
        law = counting_probabilities(camera, camera.em_gain_max if em_gain is None else em_gain, strategy)
        counting = CountingLight(
            planet_e_s=rates.planet_e_s / rates.aperture_pixels,
            quiet_e_s=rates.background_e_s / rates.aperture_pixels + camera.rate_e_s,
            reference_e_s=reference_pixel(rates.reference_light_e_s, rates) + camera.rate_e_s,
            quiet_e=rates.smear_e / rates.aperture_pixels + camera.charge_e,
            reference_e=reference_pixel(rates.reference_smear_e, rates) + camera.charge_e,
            science_pixels=pixels,
            mean_pixels=pixels * (level - 1.0),
            reference_pixels=level * pixels * rates.reference_scale / ratio,
            law=law,
            own_noise=with_planet,
        )
    signal_e_s = spread(rates.planet_e_s, shape)
    return FrameProblem(signal_e_s=signal_e_s, **arrays, camera=camera, em_gain=em_gain, counting=counting)


class FrameChoice(CaseArrays, Record):
    """Chosen frames; arrays of the problem's shape. ``n_frames`` is 0 where there are none.

    ``n_frames`` and ``visit_s`` are those of one visit, ``inverse_snr2`` is ``1 / SNR^2`` of all visits together
    (``inf`` without frames).
    """

    exposure_s: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    visit_s: FloatArray
    inverse_snr2: FloatArray


def best_exposure_s(problem: FrameProblem) -> tuple[FloatArray, FloatArray]:
    """Return the exposure of least ``G`` and its value: most SNR per time where frames need not be whole.

    Returns
    -------
    exposure_s, cost : ndarray
        ``cost`` is ``inf`` where even the shortest frame saturates or there is no light.
    """
    camera = problem.camera
    longest = problem.longest_s
    usable = (longest >= camera.exposure_min_s * (1.0 - _ROUNDING)) & (problem.signal_e_s > 0)
    if problem.best_s is not None:
        t = np.array(problem.best_s)
        return t, np.where(usable, problem.frame_noise(t)[0] * (t + camera.readout_s), np.inf)
    low = np.full(problem.shape, camera.exposure_min_s)
    high = np.maximum(longest, low)

    def cost(part: FrameProblem, t: FloatArray) -> FloatArray:
        return part.frame_noise(t)[0] * (t + camera.readout_s)

    t, value = lowest(problem, cost, low, high)
    return t, np.where(usable, value, np.inf)


def peak_visit_s(problem: FrameProblem, cost: FloatArray, elasticity: float = 0.0) -> FloatArray:
    """Return the visit beyond which time does not pay: ``d ln h / d ln v`` of ``h = G / v + z(v)`` is ``-elasticity``.

    At 0 it is the visit of highest SNR: in a longer one the walk of the wavefront loses more than time gains.
    """
    e = elasticity
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        c1, c2, c3 = e * problem.z0, (1.0 + e) * problem.z1, (2.0 + e) * problem.z2
        aim = (1.0 - e) * cost
        v = np.fmin(np.fmin(aim / c1, np.sqrt(aim / c2)), np.cbrt(aim / c3))
        grows = np.isfinite(v) & (v > 0)
        v, aim = np.where(grows, v, 1.0), np.where(grows, aim, 1.0)
        for _ in range(_NEWTON_STEPS):  # from above; the cubic is convex there
            step = (v * (c1 + v * (c2 + v * c3)) - aim) / (c1 + v * (2.0 * c2 + 3.0 * v * c3))
            v = np.where(grows, v - step, 1.0)
            if not (grows & (np.abs(step) > 1e-14 * v)).any():
                break
    return np.where(grows, v, np.inf)


def _slope(problem: FrameProblem, exposure_s: FloatArray, n_frames: FloatArray) -> FloatArray:
    """Return ``d ln h / d ln v`` of a whole number of frames, by a central difference."""
    steps = np.array([1.0 + _STEP, 1.0 - _STEP]).reshape((2,) + (1,) * exposure_s.ndim)
    after, before = problem.inverse_snr2(exposure_s * steps, n_frames)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (np.log(after) - np.log(before)) / (2.0 * _STEP) * (1.0 + problem.camera.readout_s / exposure_s)
    # Beyond the light that can be counted nothing pays.
    return np.where(np.isnan(slope), 1.0, slope)


def _paying_exposure_s(problem: FrameProblem, n_frames: FloatArray, top: FloatArray, longest: FloatArray) -> FloatArray:
    """Return the exposure up to which more time pays, at most ``top``, on the whole range whatever the visit."""
    pays = _slope(problem, top, n_frames) <= -_ELASTICITY
    if pays.all():
        return top
    low = np.full(top.shape, problem.camera.exposure_min_s)
    pays_still = _slope(problem, longest, n_frames) <= -_ELASTICITY
    stops = ~pays & ~pays_still
    if not stops.any():
        return np.where(pays, top, np.minimum(top, longest))

    def excess(part: FrameProblem, t: FloatArray, n: FloatArray) -> FloatArray:
        return np.exp(np.clip(-_ELASTICITY - _slope(part, t, n), -1.0, 1.0))

    stop, part, n = longest.copy(), problem.at(stops), n_frames[stops]
    low, high, _ = bracketed(part, excess, low[stops], longest[stops], n)
    stop[stops] = first_root(part, excess, low, high, np.ones(n.size, bool), n, tolerance=1e-6 * _ELASTICITY)
    return np.where(pays, top, np.minimum(top, stop))


Level: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]
"""SNR or significance to reach: of the length of the visit, and of ``1 / SNR^2``."""


def _over_level(problem: FrameProblem, exposure_s: FloatArray, n_frames: FloatArray, level: Any) -> FloatArray:
    inverse = problem.inverse_snr2(exposure_s, n_frames)
    wanted = level(n_frames * (exposure_s + problem.camera.readout_s), inverse) if callable(level) else level
    return np.asarray(inverse * wanted**2)


def _candidates(visit_s: FloatArray, frame_s: FloatArray) -> FloatArray:
    """Return the whole numbers of frames next to ``visit / frame``, on a new first axis."""
    with np.errstate(invalid="ignore", over="ignore"):
        middle = np.clip(np.floor(np.nan_to_num(visit_s / frame_s, posinf=_MAX_FRAMES)), 0.0, _MAX_FRAMES)
    offsets = _NEIGHBOURS.reshape((-1,) + (1,) * middle.ndim)
    return np.asarray(np.maximum(middle + offsets, 1.0))


def best_in_visit(
    problem: FrameProblem, visit_s: FloatArray, *, whole: bool = False, quickest: bool = True
) -> FrameChoice:
    """Return the frames of highest SNR in a visit of at most ``visit_s``.

    Parameters
    ----------
    problem : FrameProblem
    visit_s : ndarray
        Broadcasts to the problem's shape.
    whole : bool
        Use all of the visit, although a shorter one may be better.
    quickest : bool
        Of the settings that reach as much, give the one of least time; not needed for the SNR alone.
    """
    camera = problem.camera
    visit = spread(np.asarray(visit_s, float), problem.shape)
    t_best, cost = best_exposure_s(problem)
    aim = visit if whole else np.minimum(visit, peak_visit_s(problem, cost, _ELASTICITY))
    frames = _candidates(aim * (1.0 + 1e-12), t_best + camera.readout_s)
    longest = problem.longest_s
    # A frame as long as the visit allows; a hair of slack lets the frames of an answer fit their own time again.
    top = np.minimum(visit / frames * (1.0 + 1e-13) - camera.readout_s, longest)
    shortest = camera.exposure_min_s
    feasible = (top >= shortest * (1.0 - 1e-12)) & np.isfinite(cost)
    top = np.maximum(top, shortest)
    t = top
    if whole:
        filled = np.where(feasible, frames * (top + camera.readout_s), 0.0)
        feasible &= filled >= filled.max(axis=0) * (1.0 - 1e-9)
    else:
        t = _paying_exposure_s(problem, frames, top, spread(np.maximum(longest, shortest), top.shape))
    value = problem.inverse_snr2(t, frames)
    chosen = _pick(problem, t, frames, np.where(feasible, value, np.inf), value)
    return chosen if whole or not quickest else shortened(problem, chosen, visit)


def shortened(problem: FrameProblem, chosen: FrameChoice, visit_s: FloatArray) -> FrameChoice:
    """Return frames that reach as much as chosen ones in the least time: the inverse question has the same answer.

    Parameters
    ----------
    problem : FrameProblem
    chosen : FrameChoice
        Best frames in a visit.
    visit_s : ndarray
        Its length.
    """
    short = (chosen.n_frames > 0) & (chosen.visit_s < visit_s * (1.0 - 1e-9))
    stopped = short & (chosen.exposure_s < problem.longest_s)
    if not stopped.any():
        return chosen
    again = least_time(problem.at(stopped), 1.0 / np.sqrt(chosen.inverse_snr2[stopped]))
    use = (again.n_frames > 0) & (again.visit_s <= chosen.visit_s[stopped])
    for name in FrameChoice.__dataclass_fields__:
        column = getattr(chosen, name)
        column[stopped] = np.where(use, getattr(again, name), column[stopped])
    return chosen


def least_time(
    problem: FrameProblem, level: FloatArray | float | Level, about_s: FloatArray | None = None
) -> FrameChoice:
    """Return the frames of least time that reach an SNR of ``level``; none where no visit does.

    Parameters
    ----------
    problem : FrameProblem
    level : ndarray, float or callable
        SNR to reach, or a function of the visit and of ``1 / SNR^2``: then cases that only a narrow range of exposures
        reaches have no frames.
    about_s : ndarray, optional
        Length below which no visit reaches a level that is a function; ``inf`` where none does.

    Notes
    -----
    ``1 / SNR^2`` falls with the length of the visit up to its best one: the smallest root is found from the left, first
    with frames that need not be whole, then for the whole numbers next to it. There it is nearly always just above the
    exposure that fills as long a visit; where it is not, a grid of exposures is looked through.
    """
    camera = problem.camera
    t_best, cost = best_exposure_s(problem)
    given = None if callable(level) else spread(np.asarray(level, float), problem.shape)
    if given is not None:
        about_s = smooth_least_visit_s(problem, given, cost)
    assert about_s is not None
    possible = np.isfinite(about_s)
    lower = np.where(possible, about_s, 0.0)
    frames = _candidates(lower, t_best + camera.readout_s)
    shape, lower = frames.shape, lower * (1.0 - 1e-9)
    own = None if given is None else spread(np.where(possible, given, 1.0), shape)
    wanted = level if own is None else own
    longest = spread(np.maximum(problem.longest_s, camera.exposure_min_s), shape)
    low = np.clip(lower / frames - camera.readout_s, camera.exposure_min_s, longest)
    low = np.where(frames > 1.0, low, camera.exposure_min_s)
    possible = possible & (frames * (longest + camera.readout_s) >= lower)

    def over(exposure_s: FloatArray) -> FloatArray:
        return _over_level(problem, exposure_s, frames, wanted)

    start = top = low
    reached = over(low) <= 1.0 + _ROUNDING
    for factor in _LONGER:
        left = possible & ~reached
        if not left.any():
            break
        start, top = np.where(left, top, start), np.where(left, np.minimum(low * factor, longest), top)
        reached |= left & (over(top) <= 1.0 + _ROUNDING)
    left = possible & ~reached
    if own is not None and left.any():
        part, n, aim = problem.at(left), frames[left], own[left]
        start[left], high, least = bracketed(part, _over_level, low[left], longest[left], n, aim)
        near = (least > 1.0) & (least < _NEARLY)  # a valley between two points may reach it
        if near.any():
            ends = low[left][near], longest[left][near]
            high[near], least[near] = lowest(part.at(near), _over_level, *ends, n[near], aim[near], coarse=False)
        top[left], reached[left] = high, least <= 1.0 + _ROUNDING
    reached &= possible
    t = first_root_of_all(over, start, top, reached)
    visit = frames * (t + camera.readout_s)
    return _pick(problem, t, frames, np.where(reached, visit, np.inf), problem.inverse_snr2(t, frames))


def smooth_least_visit_s(
    problem: FrameProblem, level: FloatArray | float, cost: FloatArray | None = None
) -> FloatArray:
    """Return the shortest visit that reaches an SNR if frames need not be whole; ``inf`` where none does.

    No whole number of frames is faster.

    Parameters
    ----------
    problem : FrameProblem
    level : ndarray or float
        SNR to reach.
    cost : ndarray, optional
        Least ``G`` of the problem, where it is known (`best_exposure_s`).
    """
    aim = 1.0 / spread(np.asarray(level, float), problem.shape) ** 2
    cost = best_exposure_s(problem)[1] if cost is None else cost
    peak = peak_visit_s(problem, cost)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        top = np.where(np.isfinite(peak), peak, 0.0)
        at_peak = np.where(np.isfinite(peak), cost / peak + problem.residual(top), problem.z0)
        # Rounding must not call the top of the curve out of reach.
        reached = np.isfinite(cost) & np.where(np.isfinite(peak), at_peak <= aim * (1.0 + _ROUNDING), at_peak < aim)
        v = np.where(reached, cost / np.maximum(aim - problem.z0, 1e-300), 1.0)
        for _ in range(_NEWTON_STEPS):  # from the left of a convex falling function
            excess = cost / v + problem.residual(v) - aim
            slope = cost / v**2 - problem.z1 - 2.0 * problem.z2 * v
            step = np.where(reached & (excess > 0) & (slope > 0), excess / slope, 0.0)
            v = np.where(reached, np.minimum(v + step, np.where(np.isfinite(peak), peak, np.inf)), 1.0)
            if not (step > 1e-15 * v).any():
                break
    return np.where(reached, v, np.inf)


def _pick(problem: FrameProblem, t: FloatArray, n: FloatArray, rank: FloatArray, value: FloatArray) -> FrameChoice:
    """Pick along the first axis the candidate of least rank, of exposures ``t`` and numbers of frames ``n``."""
    best = np.argmin(rank, axis=0)
    t, n = taken(t, best), np.where(np.isfinite(taken(rank, best)), taken(n, best), 0.0)
    gain = problem.frame_noise(t)[1]
    visit = n * (t + problem.camera.readout_s)
    return FrameChoice(t, n, gain, visit, np.where(n > 0, taken(value, best), np.inf))
