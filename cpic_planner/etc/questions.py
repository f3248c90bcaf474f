"""The three questions of an exposure-time calculator, answered by type, for targets x bands x planets at once."""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError
from cpic_planner.etc.cases import BandCases, FixedFrames, Planets, band_cases, planets_of
from cpic_planner.etc.frames import FrameChoice, FrameProblem, best_in_visit, least_time, solve_together
from cpic_planner.etc.model import EtcModel, check_range
from cpic_planner.etc.noise import Objective
from cpic_planner.etc.solved import Solved
from cpic_planner.queries import ReferencePlanet
from cpic_planner.results import EtcAnswer
from cpic_planner.targets import Targets

_LIMIT_STEPS = 60
_CLOSE = 1e-14
_START = 1e-9


def signal_to_noise(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
) -> list[EtcAnswer]:
    """SNR of planets in a given wall time.

    Parameters
    ----------
    model : EtcModel
    target : Targets
        One star or more.
    time_s : float
        Longest wall time, overheads and reference frames included, 1e-3 to 1e9 s.
    separation_arcsec : float or sequence of float
        Projected separation, on the diagonal of a quadrant, 0 to 120.
    bands : sequence of str, optional
        All of the model by default.
    planet : ReferencePlanet or sequence, optional
        Gives the contrast when ``contrast`` is not given; the default reference planet otherwise.
    contrast : float or sequence of float, optional
        Planet-to-star ratio of detected rates, in every band, 0 to 1.
    exposure_s, em_gain : float, optional
        Fixed instead of optimised.
    exact : bool
        Use all of ``time_s``, although the walk of the wavefront can make a shorter visit better.

    Returns
    -------
    list of EtcAnswer
        Targets in order, bands in theirs within each (by wavelength if none are given), planets within each band.
        ``value`` is the photometric SNR in the best visit of at most ``time_s``; ``time_s`` of the answer is what it
        uses (flag ``shorter_visit_is_better``).

    Raises
    ------
    InputError
        For values out of range, or sequences of different lengths.
    """
    check_range("time_s", time_s, 1e-3, 1e9, "s")
    fixed, planets = _fixed_frames(model, bands, exposure_s, em_gain), planets_of(separation_arcsec, planet, contrast)
    cases = _bands(model, target, bands, planets, fixed)
    problems = [part.problem("snr") for part in cases]
    parts = []
    for part, problem, choice in zip(cases, problems, _best(problems, model.visit_s(time_s), exact), strict=True):
        with np.errstate(divide="ignore"):
            value = 1.0 / np.sqrt(choice.inverse_snr2)
        parts.append(Solved(part, problem, choice, "signal_to_noise", value, time_s))
    return _in_order(parts, len(target), len(planets))


def exposure_time(
    model: EtcModel,
    target: Targets,
    *,
    snr: float | None = None,
    sigma: float | None = None,
    detect: bool = False,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> list[EtcAnswer]:
    """Least wall time that reaches an SNR or a detection; ``unreachable`` below the speckle floor.

    Parameters
    ----------
    model, target, separation_arcsec, bands, planet, contrast, exposure_s, em_gain
        As `signal_to_noise`.
    snr : float, optional
        Photometric SNR, 1e-6 to 1e6.
    sigma : float, optional
        Plain significance (noise without the planet), 1e-6 to 1e6.
    detect : bool
        Ask for the small-sample threshold of the model's level at that separation. One of the three is given.

    Returns
    -------
    list of EtcAnswer
        ``value`` is ``time_s``, exactly the inverse of `signal_to_noise` (for ``snr``) and of `contrast_limit` (for
        ``sigma`` and ``detect``).

    Raises
    ------
    InputError
        For values out of range, or if not exactly one level is asked for.
    """
    given = [name for name, value in (("snr", snr), ("sigma", sigma), ("detect", detect or None)) if value is not None]
    if len(given) != 1:
        raise InputError("snr", " and ".join(given) or None, allowed="one of snr, sigma, detect")
    for name, value in (("snr", snr), ("sigma", sigma)):
        if value is not None:
            check_range(name, value, 1e-6, 1e6, "")
    fixed, planets = _fixed_frames(model, bands, exposure_s, em_gain), planets_of(separation_arcsec, planet, contrast)
    cases, by_snr = _bands(model, target, bands, planets, fixed), snr is not None
    problems = [part.problem("snr" if by_snr else "significance") for part in cases]
    levels = np.stack([_levels(part, snr, sigma) for part in cases])
    choices = solve_together(problems, least_time, np.where(np.isfinite(levels), levels, 1.0))
    parts = []
    for part, problem, choice, level in zip(cases, problems, choices, levels, strict=True):
        wall_s = model.time_s(choice.visit_s)
        parts.append(Solved(part, problem, choice, "exposure_time", wall_s, level=level, with_planet=by_snr))
    return _in_order(parts, len(target), len(planets))


def contrast_limit(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    sigma: float | None = None,
    snr: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
) -> list[EtcAnswer]:
    """Faintest contrast detected in a given wall time.

    Parameters
    ----------
    model, target, time_s, separation_arcsec, bands, exposure_s, em_gain, exact
        As `signal_to_noise`.
    sigma : float, optional
        Plain significance, 1e-3 to 1e3, instead of the small-sample threshold of the model's level (5
        sigma-equivalent), which is stated in ``threshold``.
    snr : float, optional
        Photometric SNR, 1e-3 to 1e3, instead of a significance: the planet's own noise counts.

    Notes
    -----
    ``C = level / SNR`` of a planet of contrast 1 but for the planet's own light, which fills pixels and, for ``snr``,
    adds noise: found by secants of ``ln C``, of which significance needs one or two.
    """
    check_range("time_s", time_s, 1e-3, 1e9, "s")
    for name, value in (("sigma", sigma), ("snr", snr)):
        if value is not None:
            check_range(name, value, 1e-3, 1e3, "")
    if sigma is not None and snr is not None:
        raise InputError("sigma", sigma, allowed="one of sigma, snr")
    fixed, planets = _fixed_frames(model, bands, exposure_s, em_gain), planets_of(separation_arcsec, None, _START)
    objective: Objective = "snr" if snr is not None else "significance"
    every, visit = _bands(model, target, bands, planets, fixed), model.visit_s(time_s)
    levels = np.stack([_levels(cases, snr, sigma) for cases in every])
    aims = np.where(np.isfinite(levels), levels, 1.0)
    contrasts, choices = _limits(every, objective, aims, visit, exact)
    # Beyond contrast 1 there is no planet: refused below.
    shown = [
        replace(cases, contrast=ratio, rates=cases.rates_at(ratio))
        for cases, ratio in zip(every, np.minimum(contrasts, 1.0), strict=True)
    ]
    problems = [cases.problem(objective) for cases in shown]
    stopped = [(choice.n_frames > 0) & (choice.visit_s < visit * (1.0 - 1e-9)) for choice in choices]
    if np.any(stopped) and not exact:
        # The same setting as the inverse question finds: where more time hardly pays, rounding moves the length of it.
        inverse = solve_together(problems, least_time, aims)
        choices = [
            there.where(early & (there.n_frames > 0) & (there.visit_s <= visit), here)
            for there, here, early in zip(inverse, choices, stopped, strict=True)
        ]
    parts = []
    for part, problem, choice, level, contrast in zip(shown, problems, choices, levels, contrasts, strict=True):
        limit = np.where(contrast < 1.0, contrast, math.inf)
        parts.append(Solved(part, problem, choice, "contrast_limit", limit, time_s, level, snr is not None))
    return _in_order(parts, len(target), len(planets))


def _best(parts: Sequence[FrameProblem], visit_s: FloatArray, whole: bool, quickest: bool = True) -> list[FrameChoice]:
    """Best frames of one visit for problems of several bands."""
    best = functools.partial(best_in_visit, whole=whole, quickest=quickest)
    return solve_together(parts, best, np.broadcast_to(visit_s, (len(parts), *parts[0].signal_e_s.shape)))


def _limits(
    every: Sequence[BandCases], objective: Objective, level: FloatArray, visit_s: FloatArray, whole: bool
) -> tuple[FloatArray, list[FrameChoice]]:
    """Contrasts at which the best frames of a visit reach the level (``inf`` where none does), and those frames."""
    choices: list[FrameChoice] = []

    def excess(log_contrast: FloatArray) -> FloatArray:
        problems = [cases.problem(objective, ratio) for cases, ratio in zip(every, np.exp(log_contrast), strict=True)]
        choices[:] = _best(problems, visit_s, whole, quickest=False)
        with np.errstate(divide="ignore"):
            return np.log(level) + 0.5 * np.log(np.stack([choice.inverse_snr2 for choice in choices]))

    x = np.full(level.shape, math.log(_START))
    f, slope = excess(x), np.ones(level.shape)
    for _ in range(_LIMIT_STEPS):
        # SNR grows with contrast at least like its square root: slopes are between 1/2 and 1.
        new = np.clip(x + f / slope, math.log(1e-29), 0.1)
        moved = np.isfinite(f) & (np.abs(new - x) > 4e-16 * np.abs(x))
        if not moved.any():
            break
        g = excess(np.where(moved, new, x))
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = (f - g) / (new - x)
        slope = np.where(moved & np.isfinite(secant), np.clip(secant, 0.3, 1.0), slope)
        x, f = np.where(moved, new, x), np.where(moved, g, f)
        if np.all(np.abs(f) < _CLOSE, where=np.isfinite(f)):
            break
    return np.where(np.isfinite(f) & (f < 1e-9), np.exp(x), math.inf), choices


def _levels(cases: BandCases, snr: float | None, sigma: float | None) -> FloatArray:
    """SNR or significance to reach, per case; infinite where no threshold is defined."""
    value = snr if snr is not None else sigma
    level = cases.threshold if value is None else np.full(len(cases.planets), float(value))
    return np.broadcast_to(level, cases.contrast.shape)


def _bands(
    model: EtcModel, target: Targets, bands: Sequence[str] | None, planets: Planets, fixed: FixedFrames
) -> list[BandCases]:
    if len(target) < 1:
        raise InputError("target", len(target), allowed="at least one star")
    return [band_cases(model, target, band, planets, fixed) for band in model.named(bands)]


def _in_order(parts: Sequence[Solved], n_stars: int, n_planets: int) -> list[EtcAnswer]:
    """From bands x (stars x planets) to stars x bands x planets."""
    answers = [part.answers() for part in parts]
    rows = [slice(star * n_planets, (star + 1) * n_planets) for star in range(n_stars)]
    return [answer for row in rows for part in answers for answer in part[row]]


def _fixed_frames(
    model: EtcModel, bands: Sequence[str] | None, exposure_s: float | None, em_gain: float | None
) -> FixedFrames:
    cameras = [model.camera(band) for band in model.named(bands)]
    limits: dict[str, Any] = {}
    if exposure_s is not None:
        shortest = max(camera.exposure_min_s for camera in cameras)
        limits["exposure_s"] = check_range("exposure_s", exposure_s, shortest, 1e6, "s")
    if em_gain is not None:
        limits["em_gain"] = check_range("em_gain", em_gain, 1.0, min(camera.em_gain_max for camera in cameras), "")
    return FixedFrames(**limits)
