"""The noise budget of an answer: its origins, what binds its frames, what would help, and what limits it.

An answer is limited by the single change of the model that would make the planet detected in the given time: ``none``
where it is detected. ``geometry`` where the dark hole does not cover its place, ``saturation`` where no frame is
possible. ``motion`` where it would be detected if it stood still: a search for unknown planets goes through orbits
and its threshold pays for the trials. ``speckles`` where it is detected once the wavefront does not drift: everything
that no frames average is taken away, wings of a companion included; ``common_speckles`` where moreover no number of
visits detects it. Otherwise ``background`` where it is detected with its own photon noise and the speckles alone: no
starlight, sky, dust, companion, dark current, smear, clock-induced charge or read noise, in science and in reference
frames. Otherwise ``photons``: neither change alone is enough, the planet is too faint for the time. Exposure, gain
and number of frames are the best ones under each change, as are band and separation where the question leaves them
open. A question for a time that has no answer gets 1e9 s, the longest time that can be given.
"""

import functools
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, NDArray, Provenance, Reason, Status
from cpic_planner.etc.cases import Cases
from cpic_planner.etc.frames import FrameChoice, FrameProblem, best_in_visit
from cpic_planner.etc.model import Programme
from cpic_planner.etc.noise import StackNoise, residual_law
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.etc.searches import spread
from cpic_planner.results import LimitText
from simulator.config import Instrument, load_instrument, preset_names
from simulator.signal import frame_limit, gain_caps, largest_gain, longest_exposure_s

_EDGE = 1e-6
EXPOSURE_MAX, EXPOSURE_MIN, EM_GAIN_MAX = "exposure_max", "exposure_min", "em_gain_max"


def binding_limits(
    problem: FrameProblem, rates: ApertureRates, choice: FrameChoice, index: tuple[int, ...]
) -> dict[str, Any]:
    """Return the limits that bind the exposure and the gain of one case, and the gain that each limit allows.

    Parameters
    ----------
    problem : FrameProblem
    rates : ApertureRates
    choice : FrameChoice
        Chosen frames of every case.
    index : tuple of int
        The case.

    Returns
    -------
    dict
        ``exposure_limited_by``: ``exposure_max``, ``exposure_min``, a saturation reason (``pixel_full_well``,
        ``register_full_well``, ``adc_range``), or empty: the optimum, what whole frames leave of the time, or what was
        asked for.
        ``gain_limited_by``: ``em_gain_max``, ``register_full_well``, ``adc_range``, or empty. ``gain_caps``: by limit.
    """
    camera, (column, hole, tail) = problem.camera, map(float, problem.peaks_e_s(index))
    exposure, gain = float(choice.exposure_s[index]), float(choice.em_gain[index])
    fixed, bound, gain_bound = problem.fixed_gain() or 1.0, "", ""
    saturating = float(longest_exposure_s(column, hole, tail, camera, fixed))
    if camera.exposure_min_s == camera.exposure_max_s:
        pass
    elif exposure >= saturating * (1.0 - _EDGE):
        bound = frame_limit(column, hole, tail, saturating * (1.0 + _EDGE), fixed, camera).value
    elif exposure >= camera.exposure_max_s * (1.0 - _EDGE):
        bound = EXPOSURE_MAX
    elif exposure <= camera.exposure_min_s * (1.0 + _EDGE):
        bound = EXPOSURE_MIN
    cap = float(largest_gain(hole, tail, exposure, camera))
    if camera.em_gain_max > 1.0 and gain >= cap * (1.0 - _EDGE):
        beyond = frame_limit(0.0, hole, tail, exposure, cap * (1.0 + _EDGE), camera)
        gain_bound = EM_GAIN_MAX if cap >= camera.em_gain_max else beyond.value
    frame = float(spread(rates.peak_frame_e_s, problem.shape)[index])
    caps = gain_caps(hole, tail, frame, exposure, camera)
    return {"exposure_limited_by": bound, "gain_limited_by": gain_bound, "gain_caps": caps}


def largest_term(noise: StackNoise, index: tuple[int, ...]) -> str:
    """Return the name of the largest term of the variance; empty without frames.

    Parameters
    ----------
    noise : StackNoise
    index : tuple of int
        The case.
    """
    values = {name: float(term[index]) for name, term in noise.terms.items()}
    name = max(values, key=lambda key: values[key])
    return name if values[name] > 0 else ""


_NUMBERS = {"rounding": "gain_e_adu", "read_noise": "read_noise_e", "cic": "cic_e", "dark": "dark_e_s"}
"""Number of the detector by which a term of the variance is."""


def inherited_terms(instrument: Instrument, camera: str, noise: StackNoise) -> NDArray[np.str_]:
    """Return flags of the cases whose largest noise is by a number of the preset beside numbers that were given.

    Parameters
    ----------
    instrument : Instrument
        Where no number of its detector is another than a preset's, no case has a flag.
    camera : {"VIS", "NIR"}
    noise : StackNoise

    Returns
    -------
    ndarray of str
        Of the cases; ``""`` where there is none. What the references add is left out: it has the same origins.
    """
    found = np.zeros(noise.snr.shape, "<U24")
    section = "detector." if camera == "VIS" else "near_infrared.detector."
    known = instrument.provenance
    sources = {term: known.get(section + name) for term, name in _NUMBERS.items()}
    given = [term for term, item in sources.items() if item is None or item.source == "user"]
    if not given:
        return found
    terms = {name: part for name, part in noise.terms.items() if name != "reference"}
    most = np.max([np.broadcast_to(part, found.shape) for part in terms.values()], axis=0)
    for term, item in sources.items():
        if term in terms and item is not None and _of_a_preset(section + _NUMBERS[term], item):
            found[(terms[term] >= most) & (most > 0.0)] = f"inherited_{term}"
    return found


@functools.cache
def _of_a_preset(key: str, item: Provenance) -> bool:
    return any(load_instrument(name).provenance.get(key) == item for name in preset_names("instrument"))


_REMEDIES = (
    "twice_the_time",
    "twice_the_visits",
    "half_the_drift",
    "half_the_read_noise",
    "half_the_clock_charge",
    "half_the_star_light",
    "four_times_the_reference",
)


def remedies(cases: Cases, choice: FrameChoice, noise: StackNoise) -> dict[str, FloatArray]:
    """Return the factors by which the SNR of the chosen setting grows if one thing is changed.

    Parameters
    ----------
    cases : Cases
    choice : FrameChoice
        Frames of every case.
    noise : StackNoise
        Of these frames.

    Returns
    -------
    dict of str to ndarray
        ``twice_the_time``: as many frames again in each visit. ``twice_the_visits``: as many visits again.
        ``half_the_drift``: visit offset and walk. ``half_the_read_noise``, ``half_the_clock_charge``,
        ``half_the_star_light`` (a darker hole, speckles in proportion), ``four_times_the_reference`` (frames of the
        library; their time is not counted here).
    """
    rates, camera, programme = cases.rates, cases.free_camera, cases.programme
    crossed, light = (programme.law(part).variance(choice.visit_s) for part in cases.rates.parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        calmer = np.where(crossed + light > 0, (crossed / 4.0 + light / 16.0) / (crossed + light), 1.0)
    which = np.arange(len(_REMEDIES)).reshape(-1, 1, 1, 1)

    def only(name: str, value: ArrayLike, others: ArrayLike = 1.0) -> FloatArray:
        return np.where(which == _REMEDIES.index(name), value, others)

    # All at once; but where photons are counted, every read noise has a law of its own.
    drift, star, quieter = "half_the_drift", "half_the_star_light", "half_the_read_noise"
    less_e_s = only(drift, 0.75 * rates.errors_e_s, only(star, (rates.halo_e_s - rates.errors_e_s) / 2.0, 0.0))
    darker = replace(
        rates,
        halo_e_s=rates.halo_e_s - less_e_s,
        reference_light_e_s=rates.reference_light_e_s - rates.reference_halo * less_e_s,
        speckle=rates.speckle.scaled(only(drift, calmer, only(star, 0.5))),
    )
    clean: dict[str, Any] = {"cic_e": camera.cic_e * only("half_the_clock_charge", 0.5)}
    longer = replace(choice, n_frames=choice.n_frames * only("twice_the_time", 2.0))
    again = cases.programme_of(2.0 * programme.visits, cases.model.time_s(choice.visit_s), choice)
    made = cases.in_programme(again.where(which == _REMEDIES.index("twice_the_visits"), programme))
    snr = made.noise_of(darker, replace(camera, **clean), longer, only("four_times_the_reference", 4.0)).snr
    less_noise = replace(camera, read_noise_e=camera.read_noise_e / 2.0)
    snr[_REMEDIES.index(quieter)] = cases.noise_of(rates, less_noise, choice).snr
    with np.errstate(divide="ignore", invalid="ignore"):
        return dict(zip(_REMEDIES, np.where(noise.snr > 0, snr / noise.snr, 1.0), strict=True))


LONGEST_TIME_S = 1e9
"""Longest wall time that can be given, s: what a question for a time may take at most."""
_OF_PLACE = (Reason.TOO_FEW_ELEMENTS, Reason.SMALL_ROLL)


def without_speckles(problem: FrameProblem, errors_e_s: FloatArray) -> FrameProblem:
    """Return the problem without drift, and without a companion's wings: what no time averages.

    Parameters
    ----------
    problem : FrameProblem
    errors_e_s : ndarray
        Variance of the light that drift scatters, e-^2/s (`cpic_planner.etc.noise.error_noise`). It stays where photons
        are counted.
    """
    nothing, calm = np.zeros_like(problem.z0), np.array(problem.alpha_e_s - errors_e_s)
    return replace(problem, z0=nothing, z1=nothing, z2=nothing, alpha_e_s=calm, best_s=None)


def without_background(problem: FrameProblem, own_e_s: FloatArray) -> FrameProblem:
    """Return the problem with no white noise but the planet's own (`cpic_planner.etc.noise.own_noise`).

    Parameters
    ----------
    problem : FrameProblem
    own_e_s : ndarray
        Variance of the planet's own light, e-^2/s.
    """
    nothing = np.zeros_like(problem.alpha_e_s)
    own = np.array(spread(own_e_s, nothing.shape))
    return replace(problem, alpha_e_s=own, beta_e=nothing, gamma_e2=nothing, counting=None, best_s=None)


def reached(problem: FrameProblem, visit_s: FloatArray, level: FloatArray) -> NDArray[np.bool_]:
    """Return whether visits of at most ``visit_s`` reach a level; ``inf`` is reached by none.

    Parameters
    ----------
    problem : FrameProblem
    visit_s : ndarray
        Longest visit, s.
    level : ndarray
        SNR or significance to reach.
    """
    choice = best_in_visit(problem, visit_s, quickest=False)
    with np.errstate(divide="ignore"):
        return (choice.n_frames >= 1) & (np.sqrt(choice.inverse_snr2) * level <= 1.0 + 1e-9)


def time_at_rest_s(cases: Cases, visit_time_s: float | None) -> FloatArray | None:
    """Return the wall time of a detection in so many visits if planets stood still; None where they are followed.

    Parameters
    ----------
    cases : Cases
        With the visits of every case.
    visit_time_s : float or None
        Wall time of a visit, where it is given: the fewest visits are asked for.
    """
    if cases.motion is None:
        return None
    rest, visits = cases.at_rest, spread(cases.programme.visits, cases.contrast.shape)
    if visit_time_s is not None:
        return rest.fewest(cases.model.visit_s(visit_time_s)) * visit_time_s
    return np.asarray(visits * cases.model.time_s(rest.solved(visits)[0]))


def programme_floor(cases: Cases, visits: float) -> FloatArray:
    """Return the highest significance of any number of frames in so many visits, whatever their length."""
    endless = np.ones(1), np.full(1, np.inf), np.ones(1)
    law = residual_law(cases.rates, cases.with_modes(Programme.of(cases.model.strategy, visits), *endless))
    with np.errstate(divide="ignore"):
        return np.asarray(cases.rates.planet_e_s / np.sqrt(law.k0 * cases.rates.variance_factor))


def limit_of(
    status: Status,
    reason: Reason,
    *,
    detected: bool,
    without_speckles: bool,
    without_background: bool,
    common: bool = False,
    without_motion: bool = False,
) -> LimitText:
    """Return what limits an answer, as the module defines it.

    Parameters
    ----------
    status, reason
        Of the answer. A time that does not hold one frame counts as ``photons``.
    detected : bool
        Whether the planet is detected as things are.
    without_speckles, without_background : bool
        Whether it is under each change.
    common : bool
        Whether no number of visits detects it, of whatever length.
    without_motion : bool
        Whether it is detected if it does not move.
    """
    if status is Status.OUTSIDE_FIELD or reason in _OF_PLACE:
        return "geometry"
    if status is Status.SATURATED:
        return "saturation"
    if status is Status.OK and detected:
        return "none"
    if without_motion:
        return "motion"
    if without_speckles:
        return "common_speckles" if common else "speckles"
    return "background" if without_background else "photons"
