"""Least times by trying everything: what the choice of frames is held against.

Thousands of exposures, every whole number of frames, a table of gains and the limits of conventions written out once
more; nothing is assumed about where the best setting lies. A problem is any object with the arrays of
`cpic_planner.etc.frames.FrameProblem`; none of its functions is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
SIGMAS = 5.0  # kept free below every limit
FIELDS = (
    "alpha_e_s",
    "beta_e",
    "gamma_e2",
    "signal_e_s",
    "z0",
    "z1",
    "z2",
    "loss_per_s",
    "peak_columns_e_s",
    "peak_in_hole_e_s",
    "register_tail_e_s",
)


@dataclass(frozen=True, eq=False)
class Found:
    """Best setting of every case; ``visit_s`` is infinite and ``n_frames`` 0 where there is none."""

    visit_s: FloatArray
    exposure_s: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray


def rows(problem: Any) -> dict[str, FloatArray]:
    """The arrays of a problem, flat."""
    parts = np.broadcast_arrays(*(np.asarray(getattr(problem, name), dtype=np.float64) for name in FIELDS))
    return {name: part.ravel() for name, part in zip(FIELDS, parts, strict=True)}


def excess2(gain: ArrayLike, stages: int) -> FloatArray:
    """Squared excess noise factor of Robbins & Hadwen (2003); 1 without a register."""
    g = np.asarray(gain, dtype=np.float64)
    if stages == 0:
        return np.ones_like(g)
    return 2.0 * (g - 1.0) * g ** (-(stages + 1.0) / stages) + 1.0 / g


def _output_e(mean_e: FloatArray) -> FloatArray:
    """Charge per unit gain that the output must hold for a pixel of that mean."""
    return mean_e + SIGMAS * np.sqrt(2.0 * mean_e)


def largest_gain(case: dict[str, FloatArray], exposure_s: FloatArray, camera: Any) -> FloatArray:
    """Largest gain that saturates nothing; 0 where there is none."""
    column = [case["peak_in_hole_e_s"], case["peak_columns_e_s"]] if camera.blooms else [case["peak_in_hole_e_s"]]
    pixel = np.maximum.reduce(column) * exposure_s
    output = min(camera.register_full_well_e, camera.converter_e)
    with np.errstate(divide="ignore"):
        gain = output / _output_e(case["peak_in_hole_e_s"] * exposure_s)
        if camera.blooms:
            gain = np.minimum(gain, camera.register_full_well_e / _output_e(case["register_tail_e_s"] * exposure_s))
    gain = np.minimum(gain, camera.em_gain_max)
    return np.where((pixel + SIGMAS * np.sqrt(pixel) <= camera.full_well_e) & (gain >= 1.0), gain, 0.0)


def longest_exposure(case: dict[str, FloatArray], camera: Any, em_gain: float = 1.0) -> FloatArray:
    """Longest exposure that saturates nothing at a gain, by bisection; 0 where even the shortest does."""
    low, high = (np.full(case["alpha_e_s"].shape, end) for end in (camera.exposure_min_s, camera.exposure_max_s))
    fits_all = largest_gain(case, high, camera) >= em_gain
    fits_none = largest_gain(case, low, camera) < em_gain
    for _ in range(60):
        middle = np.sqrt(low * high)
        fits = largest_gain(case, middle, camera) >= em_gain
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(fits_none, 0.0, np.where(fits_all, camera.exposure_max_s, low))


class GainScan:
    """Best of a grid of gains up to any cap, for any ratio of read variance to light; or a fixed gain."""

    def __init__(self, problem: Any, n_gains: int = 1500, n_ratios: int = 3000) -> None:
        stages, fixed = problem.camera.register_stages, problem.em_gain
        grid = np.geomspace(1.0, problem.camera.em_gain_max, n_gains) if stages else np.ones(1)
        self.gains = grid if fixed is None else np.array([float(fixed)])
        self.least = float(self.gains[0])
        self.stages = stages
        self.log_ratio = np.linspace(np.log(1e-8), np.log(1e12), n_ratios)
        factor2 = excess2(self.gains, stages)
        self.best = np.empty((n_ratios, self.gains.size), dtype=np.int32)
        for i, ratio in enumerate(np.exp(self.log_ratio)):
            variance = factor2 + ratio / self.gains**2
            lowest = np.minimum.accumulate(variance)
            self.best[i] = np.maximum.accumulate(np.where(variance == lowest, np.arange(variance.size), 0))

    def __call__(self, light_e2: FloatArray, read_e2: FloatArray, cap: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gain and variance; a cap below the least gain counts as that gain."""
        with np.errstate(divide="ignore"):
            ratio = np.log(read_e2) - np.log(light_e2)
        i = np.clip(np.searchsorted(self.log_ratio, ratio), 0, self.log_ratio.size - 1)
        j = np.clip(np.searchsorted(self.gains, cap, side="right") - 1, 0, self.gains.size - 1)
        inner = self.gains[self.best[i, j]]
        return min_of(
            (gain, excess2(gain, self.stages) * light_e2 + read_e2 / gain**2)
            for gain in (inner, np.clip(cap, self.gains[0], self.gains[-1]))
        )


def min_of(options: Any) -> tuple[FloatArray, FloatArray]:
    """The gain of less variance of two."""
    (one, first), (two, second) = options
    return np.where(first <= second, one, two), np.minimum(first, second)


def inverse_snr2(
    case: dict[str, FloatArray], exposure_s: FloatArray, n_frames: FloatArray, em_gain: FloatArray, camera: Any
) -> FloatArray:
    """``1 / SNR^2`` of a setting."""
    factor2 = excess2(em_gain, camera.register_stages)
    light = case["alpha_e_s"] * exposure_s + case["beta_e"]
    white = factor2 * light + case["gamma_e2"] / em_gain**2
    clean = np.exp(-case["loss_per_s"] * exposure_s)
    visit = n_frames * (exposure_s + camera.readout_s)
    speckles = case["z0"] + case["z1"] * visit + case["z2"] * visit**2
    return white / (case["signal_e_s"] * exposure_s) ** 2 / clean / n_frames + speckles


def least_time(problem: Any, level: ArrayLike, *, n_exposures: int = 2000, chunk: int = 64) -> Found:
    """Shortest visit that reaches ``level``."""
    case, camera = rows(problem), problem.camera
    scan = GainScan(problem)
    wanted = np.broadcast_to(np.asarray(level, dtype=np.float64), case["alpha_e_s"].shape)
    parts = [
        _least_time(
            {name: part[i : i + chunk, None] for name, part in case.items()},
            wanted[i : i + chunk, None],
            camera,
            scan,
            n_exposures,
        )
        for i in range(0, wanted.size, chunk)
    ]
    return Found(*(np.concatenate([getattr(part, name) for part in parts]) for name in Found.__dataclass_fields__))


def _least_time(case: dict[str, FloatArray], level: FloatArray, camera: Any, scan: GainScan, n_exposures: int) -> Found:
    longest = longest_exposure(case, camera, scan.least)
    possible = longest > 0
    share = np.linspace(0.0, 1.0, n_exposures)
    last = np.where(possible, longest, camera.exposure_max_s)
    exposure = np.minimum(camera.exposure_min_s * (last / camera.exposure_min_s) ** share, last)
    cap = largest_gain(case, exposure, camera)
    light = case["alpha_e_s"] * exposure + case["beta_e"]
    gain, white = scan(light, case["gamma_e2"], cap)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        each = white / (case["signal_e_s"] * exposure) ** 2 * np.exp(case["loss_per_s"] * exposure)
    pace = exposure + camera.readout_s
    frames = fewest_frames(each, case["z1"] * pace, case["z2"] * pace**2, 1.0 / level**2 - case["z0"])
    visit = np.where(possible & np.isfinite(frames), frames * pace, np.inf)
    pick = np.argmin(visit, axis=1)[:, None]
    best, t, n, g = (np.take_along_axis(part, pick, axis=1)[:, 0] for part in (visit, exposure, frames, gain))
    none = ~np.isfinite(best)
    return Found(best, t, np.where(none, 0.0, n), g)


def fewest_frames(each: FloatArray, linear: FloatArray, square: FloatArray, room: FloatArray) -> FloatArray:
    """Smallest whole N >= 1 with ``each / N + linear N + square N^2 <= room``; infinite where there is none.

    The left side falls and then rises; Newton's steps from the left of the first crossing stay left of it.
    """
    each, linear, square, room = np.broadcast_arrays(each, linear, square, room)
    alive = np.isfinite(each) & (room > 0)
    y, a = np.where(alive, each, 1.0), np.where(alive, room, 1.0)
    n = np.maximum(y / a, 1.0)
    for _ in range(80):
        excess = y / n + linear * n + square * n**2 - a
        slope = y / n**2 - linear - 2.0 * square * n
        going = alive & (excess > 0)
        alive &= ~(going & (slope <= 0))
        step = np.where(going & (slope > 0), excess / np.where(slope > 0, slope, 1.0), 0.0)
        if not np.any(step > 1e-13 * n):
            break
        n = np.minimum(n + step, 1e15)
    answer = np.full(n.shape, np.inf)
    for candidate in (np.ceil(n * (1.0 - 1e-12)) + 1.0, np.ceil(n * (1.0 - 1e-12))):
        whole = np.maximum(candidate, 1.0)
        fits = alive & (y / whole + linear * whole + square * whole**2 <= a * (1.0 + 1e-12))
        answer = np.where(fits, whole, answer)
    return answer


def best_in_visit(problem: Any, visit_s: ArrayLike, *, n_exposures: int = 2000, chunk: int = 64) -> FloatArray:
    """Least ``1 / SNR^2`` of visits no longer than ``visit_s``; infinite where no frame fits."""
    case, camera = rows(problem), problem.camera
    scan = GainScan(problem)
    allowed = np.broadcast_to(np.asarray(visit_s, dtype=np.float64), case["alpha_e_s"].shape)
    parts = [
        _best_in_visit(
            {name: part[i : i + chunk, None] for name, part in case.items()},
            allowed[i : i + chunk, None],
            camera,
            scan,
            n_exposures,
        )
        for i in range(0, allowed.size, chunk)
    ]
    return np.concatenate(parts)


def _best_in_visit(
    case: dict[str, FloatArray], allowed: FloatArray, camera: Any, scan: GainScan, n_exposures: int
) -> FloatArray:
    longest = longest_exposure(case, camera, scan.least)
    last = np.where(longest > 0, longest, camera.exposure_max_s)
    grid = camera.exposure_min_s * (last / camera.exposure_min_s) ** np.linspace(0.0, 1.0, n_exposures)
    filling = allowed * (1.0 - 1e-12) / np.arange(1, 200) - camera.readout_s  # whole numbers of frames fill the visit
    exposure = np.minimum(np.concatenate([grid, np.maximum(filling, camera.exposure_min_s)], axis=1), last)
    cap = largest_gain(case, exposure, camera)
    white = scan(case["alpha_e_s"] * exposure + case["beta_e"], case["gamma_e2"], cap)[1]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        each = white / (case["signal_e_s"] * exposure) ** 2 * np.exp(case["loss_per_s"] * exposure)
    pace = exposure + camera.readout_s
    most = np.floor(allowed / pace)
    linear, square = case["z1"] * pace, case["z2"] * pace**2
    low, high = np.zeros(each.shape), np.full(each.shape, 35.0)  # logarithm of the number of frames of least noise
    for _ in range(60):
        middle = 0.5 * (low + high)
        n = np.exp(middle)
        rising = linear * n**2 + 2.0 * square * n**3 > each
        low, high = np.where(rising, low, middle), np.where(rising, middle, high)
    best = np.full(allowed.shape[0], np.inf)
    for n in (np.floor(np.exp(low)), np.floor(np.exp(low)) + 1.0):
        whole = np.clip(n, 1.0, np.maximum(most, 1.0))
        value = each / whole + case["z0"] + linear * whole + square * whole**2
        usable = (most >= 1.0) & (longest > 0) & np.isfinite(value)
        best = np.minimum(best, np.where(usable, value, np.inf).min(axis=1))
    return best
