"""The three questions of an exposure-time calculator, answered by type, for targets x bands x planets at once.

An observation is a programme of visits that are reduced together. Where the strategy does not say how many, the best
number is chosen for every case (`cpic_planner.etc.programmes`), and frames are whole.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError
from cpic_planner.etc.cases import FixedFrames, band_cases, fixed_frames
from cpic_planner.etc.frames import FrameChoice, best_in_visit
from cpic_planner.etc.groups import Found, Group
from cpic_planner.etc.model import EtcModel, Programme, check_range
from cpic_planner.etc.noise import Objective
from cpic_planner.etc.planet import Planets, planets_of
from cpic_planner.etc.programmes import Span
from cpic_planner.etc.solved import Solved
from cpic_planner.etc.together import CameraCases, Wanted
from cpic_planner.queries import ConfirmQuestion, EtcQuestion, ReferencePlanet
from cpic_planner.results import EtcAnswer, Question
from cpic_planner.targets import Targets

_LIMIT_STEPS, _MODE_ROUNDS, _STILL = 60, 10, 1e-11
_CLOSE, _START = 1e-14, 1e-9
TRIAL_CONTRAST = 1e-8
"""Contrast of the planet that stands for all where a faintest one is looked for."""


def signal_to_noise(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float | None = None,
    visit_time_s: float | None = None,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
    offsets_arcsec: tuple[float, float] | None = None,
) -> list[EtcAnswer]:
    """Return the SNR of planets in a given wall time.

    Parameters
    ----------
    model : EtcModel
        Its strategy may say the number of visits; otherwise that of highest SNR is chosen.
    target : Targets
        One star or more.
    time_s : float, optional
        Longest wall time of all visits, overheads and reference frames included, 1e-3 to 1e9 s. It may be left out
        where number and time of the visits are given.
    visit_time_s : float, optional
        Wall time of one visit.
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
        Use all of the time, although the walk of the wavefront can make shorter visits better.
    offsets_arcsec : tuple of float, optional
        A place in the dark hole at which all planets stand, instead of the diagonal at their separations.

    Returns
    -------
    list of EtcAnswer
        Targets in order, bands in theirs within each (by wavelength if none are given), planets within each band.
        ``value`` is the photometric SNR in the best programme of at most ``time_s``; ``time_s`` of the answer is what
        it uses (flag ``shorter_visit_is_better``).

    Raises
    ------
    InputError
        For values out of range, sequences of different lengths, and times that contradict each other.
    """
    span = Span.of(model, time_s, visit_time_s)
    fixed, planets = fixed_frames(model, bands, exposure_s, em_gain), planets_of(separation_arcsec, planet, contrast)
    parts: dict[str, list[EtcAnswer]] = {}
    for group in groups_of(model, target, bands, planets, fixed, "snr", 1.0, offsets_arcsec):
        visits = group.visits_in(span)
        solved = group.in_time(visits, span, exact)
        with np.errstate(divide="ignore"):
            value = 1.0 / np.sqrt(solved.choice.inverse_snr2)
        parts |= _answers(solved, "signal_to_noise", value, span)
    return _in_order(parts, model.named(bands), len(target), len(planets))


def exposure_time(
    model: EtcModel,
    target: Targets,
    *,
    snr: float | None = None,
    sigma: float | None = None,
    detect: bool = False,
    visit_time_s: float | None = None,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> list[EtcAnswer]:
    """Return the least wall time that reaches an SNR or a detection; ``unreachable`` below the speckle floor.

    Parameters
    ----------
    model, target, separation_arcsec, bands, planet, contrast, exposure_s, em_gain
        As `signal_to_noise`.
    snr : float, optional
        Photometric SNR, 1e-6 to 1e6.
    sigma : float, optional
        Plain significance (noise without the planet), 1e-6 to 1e6.
    detect : bool
        Ask for a detection as the strategy searches: by half of such programmes. One of the three is given.
    visit_time_s : float, optional
        Wall time of one visit: the least number of them is asked for.

    Returns
    -------
    list of EtcAnswer
        ``value`` is ``time_s``, exactly the inverse of `signal_to_noise` (for ``snr``) and of `contrast_limit` (for
        ``sigma`` and ``detect``) of as many visits.

    Raises
    ------
    InputError
        For values out of range, or if not exactly one level is asked for.
    """
    given = [name for name, value in (("snr", snr), ("sigma", sigma), ("detect", detect or None)) if value is not None]
    if len(given) != 1:
        raise InputError("snr", " and ".join(given) or None, allowed="one of snr, sigma, detect")
    check_levels(snr, sigma)
    span = Span.of(model, None, visit_time_s, asked=True)
    fixed, planets = fixed_frames(model, bands, exposure_s, em_gain), planets_of(separation_arcsec, planet, contrast)
    objective: Objective = "significance" if snr is None else "snr"
    parts: dict[str, list[EtcAnswer]] = {}
    for group in groups_of(model, target, bands, planets, fixed, objective, sigma if snr is None else snr):
        solved = group.for_level(span)
        wall_s = solved.programme.visits * model.time_s(solved.choice.visit_s)
        parts |= _answers(solved, "exposure_time", wall_s, span)
    return _in_order(parts, model.named(bands), len(target), len(planets))


def contrast_limit(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float | None = None,
    visit_time_s: float | None = None,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    sigma: float | None = None,
    snr: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
) -> list[EtcAnswer]:
    """Return the faintest contrast detected in a given wall time.

    Parameters
    ----------
    model, target, time_s, visit_time_s, separation_arcsec, bands, exposure_s, em_gain, exact
        As `signal_to_noise`.
    sigma : float, optional
        Plain significance, 1e-3 to 1e3, instead of a detection as the strategy searches; its small-sample threshold is
        stated in ``threshold``, and what half of such programmes find in ``level``.
    snr : float, optional
        Photometric SNR, 1e-3 to 1e3, instead of a significance: the planet's own noise counts.

    Notes
    -----
    ``C = level / SNR`` of a planet of contrast 1 but for the planet's own light, which fills pixels and, for ``snr``,
    adds noise: found by secants of ``ln C``, of which significance needs one or two.
    """
    check_levels(snr, sigma, largest=1e3)
    if sigma is not None and snr is not None:
        raise InputError("sigma", sigma, allowed="one of sigma, snr")
    span = Span.of(model, time_s, visit_time_s)
    fixed, planets = fixed_frames(model, bands, exposure_s, em_gain), planets_of(separation_arcsec, None, _START)
    objective: Objective = "significance" if snr is None else "snr"
    parts: dict[str, list[EtcAnswer]] = {}
    for group in groups_of(model, target, bands, planets, fixed, objective, sigma if snr is None else snr):
        limit = _limit(group, span, exact)
        value = np.where(limit.contrast < 1.0, limit.contrast, math.inf)
        parts |= _answers(_at_limit(group, limit, exact), "contrast_limit", value, span)
    return _in_order(parts, model.named(bands), len(target), len(planets))


def contrast_limits(
    model: EtcModel,
    target: Targets,
    separation_arcsec: Mapping[str, FloatArray],
    *,
    time_s: float,
    sigma: float | None = None,
    snr: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> dict[str, FloatArray]:
    """Return the values of `contrast_limit` alone, of bands at places of their own: NaN where there is none.

    Parameters
    ----------
    model, target, time_s, sigma, snr, exposure_s, em_gain
        As `contrast_limit`, one star.
    separation_arcsec : mapping of str to ndarray
        By band, as many in each.
    """
    bands, span = tuple(separation_arcsec), Span.of(model, time_s, None)
    planets = {band: planets_of(place.tolist(), None, _START) for band, place in separation_arcsec.items()}
    fixed, found = fixed_frames(model, bands, exposure_s, em_gain), dict[str, FloatArray]()
    objective: Objective = "significance" if snr is None else "snr"
    for group in groups_of(model, target, bands, planets, fixed, objective, sigma if snr is None else snr):
        cases, limit = group.cases, _limit(group, span, exact=False)
        defined = cases.usable & ((group.value is not None) | np.isfinite(cases.threshold))
        value = np.where(defined & (limit.choice.n_frames >= 1) & (limit.contrast < 1.0), limit.contrast, np.nan)
        found |= {one.band: value[i, 0] for i, one in enumerate(cases.bands)}
    return found


def times_of(question: EtcQuestion | ConfirmQuestion, model: EtcModel, band: str) -> dict[str, Any]:
    """Return the wall times of all visits and of one in a band: the given ones, or those of the frames.

    Parameters
    ----------
    question : EtcQuestion or ConfirmQuestion
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.

    Returns
    -------
    dict
        ``time_s``, ``visit_time_s``, and ``exact`` where frames set them.
    """
    if question.n_frames is None or question.exposure_s is None:
        return {"time_s": question.wall_s, "visit_time_s": question.visit_time_s}
    # A hair more, lest rounding lose a frame.
    pace_s = (question.exposure_s + model.camera(band).readout_s) * (1.0 + 1e-12)
    visit_time_s = float(model.time_s(question.n_frames * pace_s))
    return {"time_s": (question.strategy.visits or 1) * visit_time_s, "visit_time_s": visit_time_s, "exact": True}


def groups_of(
    model: EtcModel,
    target: Targets,
    bands: Sequence[str] | None,
    planets: Planets | Mapping[str, Planets],
    fixed: FixedFrames,
    objective: Objective,
    value: float | None,
    offsets_arcsec: tuple[float, float] | None = None,
) -> list[Group]:
    """Return the cases of every camera; planets of all bands, or as many of each."""
    if len(target) < 1:
        raise InputError("target", len(target), allowed="at least one star")
    own = planets if isinstance(planets, Mapping) else dict.fromkeys(model.named(bands), planets)
    every = [band_cases(model, target, band, own[band], fixed, offsets_arcsec) for band in model.named(bands)]
    alike = [[one for one in every if one.camera == camera] for camera in dict.fromkeys(one.camera for one in every)]
    groups = []
    for same in alike:
        cases = CameraCases.of(same)
        wanted = cases.search if value is None else Wanted.of(cases, value)
        solvable = replace(wanted, level=np.where(np.isfinite(wanted.level), wanted.level, 1.0))
        groups.append(Group(model, cases, objective, value, solvable))
    return groups


@dataclass(frozen=True)
class _Limit:
    """Contrasts at which the best frames in a time reach the level (``inf`` where none does), and those frames.

    ``visit_s`` is the length of visits that pays, ``longest_s`` what the time allows.
    """

    contrast: FloatArray
    visits: FloatArray
    programme: Programme
    choice: FrameChoice
    visit_s: FloatArray
    longest_s: FloatArray


def _limit(group: Group, span: Span, exact: bool) -> _Limit:
    """Return the limits of a group in a time."""
    assert span.time_s is not None
    visits = group.visits_in(span)
    programme, _, longest_s = group.spread(visits, span.time_s)
    visit_s = longest_s if exact else group.paying_s(visits, longest_s)
    contrast, choice = _limits(group, programme, visit_s, exact)
    if span.visits is None and group.objective == "snr":
        # The planet's own noise counts: the best number of visits is that at the limit.
        at_limit = replace(group.programmes, problem=lambda made: group.problem(made, np.minimum(contrast, 1.0)))
        visits = at_limit.best_in_time(span.time_s)
        programme, _, longest_s = group.spread(visits, span.time_s)
        visit_s = longest_s
        contrast, choice = _limits(group, programme, visit_s, exact)
    n_modes = group.model.strategy.n_modes
    for _ in range(_MODE_ROUNDS if n_modes else 0):
        programme, last = group.made(visits, span.time_s / visits, choice, of_choice=True), contrast
        contrast, choice = _limits(group, programme, visit_s, exact)
        if np.allclose(contrast, last, rtol=_STILL, atol=0.0):
            break
    return _Limit(contrast, visits, programme, choice, visit_s, longest_s)


def _at_limit(group: Group, limit: _Limit, exact: bool) -> Found:
    """Return the programmes and frames of planets at the limit."""
    programme, choice = limit.programme, limit.choice
    # Beyond contrast 1 there is no planet: refused below.
    ratio = np.minimum(limit.contrast, 1.0)
    there, problem = replace(group, cases=group.cases.of_contrast(ratio)), group.problem(programme, ratio)
    level = group.level_of(programme, problem, choice)
    stopped = (choice.n_frames > 0) & (choice.visit_s < limit.longest_s * (1.0 - 1e-9))
    if np.any(stopped) and not exact:
        # The same setting as the inverse question finds: where more time hardly pays, rounding moves its length.
        again = there.at_level(programme.visits)
        use = stopped & (again.choice.n_frames > 0) & (again.choice.visit_s <= limit.visit_s)
        choice, level = again.choice.where(use, choice), np.where(use, again.level, level)
        if group.model.strategy.n_modes:
            programme = again.programme.spread(use.shape).where(use, programme.spread(use.shape))
    return Found(there, programme, problem, choice, level)


def _limits(group: Group, programme: Programme, visit_s: FloatArray, whole: bool) -> tuple[FloatArray, FrameChoice]:
    """Return the contrasts at which the best frames of visits reach the level, and those frames."""

    def excess(log_contrast: FloatArray) -> tuple[FloatArray, FrameChoice]:
        problem = group.problem(programme, np.exp(log_contrast))
        choice = best_in_visit(problem, visit_s, whole=whole, quickest=False)
        level = group.level_of(programme, problem, choice)
        with np.errstate(divide="ignore"):
            return np.log(level) + 0.5 * np.log(choice.inverse_snr2), choice

    x = np.full(visit_s.shape, math.log(_START))
    (f, choice), slope = excess(x), np.ones(visit_s.shape)
    for _ in range(_LIMIT_STEPS):
        # SNR grows with contrast at least like its square root: slopes are between 1/2 and 1.
        new = np.clip(x + f / slope, math.log(1e-29), 0.1)
        moved = np.isfinite(f) & (np.abs(new - x) > 4e-16 * np.abs(x))
        if not moved.any():
            break
        g, choice = excess(np.where(moved, new, x))
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = (f - g) / (new - x)
        slope = np.where(moved & np.isfinite(secant), np.clip(secant, 0.3, 1.0), slope)
        x, f = np.where(moved, new, x), np.where(moved, g, f)
        if np.all(np.abs(f) < _CLOSE, where=np.isfinite(f)):
            break
    return np.where(np.isfinite(f) & (f < 1e-9), np.exp(x), math.inf), choice


def _answers(found: Found, question: Question, value: FloatArray, span: Span) -> dict[str, list[EtcAnswer]]:
    """Return the answers of the programmes and frames that were found, band by band, planets within stars."""
    group, level = found.group, None
    if question != "signal_to_noise":
        undefined = (group.value is None) & ~np.isfinite(group.cases.threshold)
        level = np.where(undefined, math.inf, found.level)
    cases, by_snr = group.cases.in_programme(found.programme), group.objective == "snr"
    searched = question == "exposure_time" and group.value is None
    answers = Solved(cases, found.problem, found.choice, question, value, span, level, by_snr, searched).answers()
    each = len(answers) // len(cases.bands)
    return {one.band: answers[i * each : (i + 1) * each] for i, one in enumerate(cases.bands)}


def _in_order(
    by_band: dict[str, list[EtcAnswer]], bands: Sequence[str], n_stars: int, n_planets: int
) -> list[EtcAnswer]:
    """Return from bands x (stars x planets) to stars x bands x planets."""
    rows = [slice(star * n_planets, (star + 1) * n_planets) for star in range(n_stars)]
    return [answer for row in rows for band in bands for answer in by_band[band][row]]


def check_levels(snr: float | None, sigma: float | None, *, largest: float = 1e6) -> None:
    """Refuse an SNR or a significance outside of the range from one over ``largest`` to that.

    Raises
    ------
    InputError
        Naming the one that is out of range.
    """
    for name, value in (("snr", snr), ("sigma", sigma)):
        if value is not None:
            check_range(name, value, 1.0 / largest, largest, "")
