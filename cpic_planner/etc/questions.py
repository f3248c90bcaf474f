"""The three questions of an exposure-time calculator, answered by type."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from catalogs.errors import InputError
from cpic_planner.etc.answer import EtcAnswer, Question
from cpic_planner.etc.limits import frame_limit
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import stack_noise
from cpic_planner.etc.place import check_range, diagonal, hole_notes, locate
from cpic_planner.etc.planet import ReferencePlanet, reference_contrast, reference_notes
from cpic_planner.etc.rates import ApertureRates, aperture_rates, speckle_fraction
from cpic_planner.etc.settings import (
    VISIT_LENGTHS_S,
    Settings,
    settings_for_snr,
    settings_for_time,
    visit_lengths,
)
from cpic_planner.etc.significance import threshold_array
from cpic_planner.targets import Targets
from simulator.outcome import Reason, Status

__all__ = ["contrast_limit", "exposure_time", "signal_to_noise"]

MAX_TURNS = 200
BETWEEN = (2.0**-0.5, 2.0**0.5)


@dataclass(frozen=True)
class _Case:
    """One target, band and planet, ready for a question."""

    answer: dict[str, Any]
    rates: ApertureRates
    threshold: float


def _cases(
    model: EtcModel,
    target: Targets,
    bands: Sequence[str] | None,
    planet: ReferencePlanet,
    separation_arcsec: float,
    contrast: float | None,
    question: Question,
    unit: str,
) -> Iterator[_Case | EtcAnswer]:
    """Yield ready cases, or finished refusals for positions outside the zone."""
    if len(target) != 1:
        raise InputError("target", len(target), allowed="one star a question")
    check_range("separation_arcsec", separation_arcsec, 1e-6, 120.0, "arcsec")
    if contrast is not None:
        check_range("contrast", contrast, 1e-20, 1.0, "")
    for band in bands or model.bands:
        if band not in model.metrics:
            raise InputError("band", band, allowed=", ".join(model.bands))
        given, notes = contrast, target.flags[0]
        if given is None:
            notes += reference_notes(model, target, band, separation_arcsec, planet)
            given = float(reference_contrast(model, target, band, np.array([separation_arcsec]), planet)[0])
        head: dict[str, Any] = {
            "target": str(target.name[0]),
            "band": band,
            "question": question,
            "unit": unit,
            "contrast": None if question == "contrast_limit" else given,
            "separation_arcsec": separation_arcsec,
            "flags": (target.flags[0] if question == "contrast_limit" else notes) + hole_notes(model, band),
        }
        status, reason, message = locate(model.instrument, band, separation_arcsec)
        if status is not Status.OK:
            yield EtcAnswer(value=None, status=status, reason=reason, message=message, **head)
            continue
        x, y = diagonal(model.metrics[band].zone, np.array([separation_arcsec]))
        rates = aperture_rates(model, target, band, x, y, np.array([given]))
        elements = float(model.metrics[band].resolution_elements(separation_arcsec))
        threshold = float(threshold_array(elements, model.strategy.sigma))
        head["core_throughput"] = float(model.metrics[band].core_throughput(x, y)[0])
        head["threshold"] = threshold if math.isfinite(threshold) else None
        yield _Case(head, rates, threshold)


def _filled(case: _Case, settings: Settings, value: float | None, **more: Any) -> EtcAnswer:
    """Answer with the chosen setting filled in."""
    noise = settings.noise
    frames, exposure = int(settings.n_frames[0]), float(settings.exposure_s[0])
    budget = {
        "signal_e": float(noise.signal_e[0]),
        "source_e2": float(noise.source_variance_e2[0]),
        "background_e2": float(noise.background_variance_e2[0]),
        "detector_e2": float(noise.detector_variance_e2[0]),
        "speckle_e2": float(noise.speckle_variance_e2[0]),
    }
    fixed: dict[str, Any] = {"status": Status.OK, "reason": Reason.NONE, "message": ""}
    return EtcAnswer(
        value=value,
        exposure_s=exposure,
        n_frames=frames,
        em_gain=float(settings.em_gain[0]),
        integration_s=frames * exposure,
        time_s=float(settings.time_s[0]),
        snr=float(noise.snr[0]),
        significance=float(noise.significance[0]),
        budget=budget,
        **(fixed | case.answer | more),
    )


def _no_setting(
    model: EtcModel, case: _Case, settings: Settings, exposure_s: float | None, em_gain: float | None
) -> EtcAnswer:
    """Refusal when no frame fits: saturation, or no time for one frame."""
    detector = model.instrument.detector
    shortest = exposure_s if exposure_s is not None else detector.exposure_min_s
    peaks = (float(case.rates.peak_columns_e_s[0]), float(case.rates.peak_hole_e_s[0]), float(case.rates.tail_e_s[0]))
    limit = frame_limit(*peaks, shortest, em_gain or 1.0, detector)
    if limit is not Reason.NONE:
        longest = float(settings.longest_exposure_s[0])
        text = (
            f"a frame of {shortest:g} s at EM gain {em_gain or 1.0:g} saturates; at gain 1 up to {longest:.3g} s do not"
        )
        return EtcAnswer(value=None, status=Status.SATURATED, reason=limit, message=text, **case.answer)
    text = "the time does not hold one science frame with its share of reference frames"
    return EtcAnswer(value=None, status=Status.UNREACHABLE, reason=Reason.NO_TIME, message=text, **case.answer)


def signal_to_noise(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float,
    separation_arcsec: float,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | None = None,
    contrast: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
) -> list[EtcAnswer]:
    """SNR of a planet in a given wall time, per band.

    Parameters
    ----------
    model : EtcModel
    target : Targets
        One star.
    time_s : float
        Longest wall time, overheads and reference frames included, 1e-3 to 1e9 s.
    separation_arcsec : float
        Projected separation, on the diagonal of a quadrant.
    bands : sequence of str, optional
        All of the model by default.
    planet : ReferencePlanet, optional
        Gives the contrast when ``contrast`` is not given; the default reference planet otherwise.
    contrast : float, optional
        Planet-to-star ratio of detected rates, in every band.
    exposure_s, em_gain : float, optional
        Fixed instead of optimised.
    exact : bool
        Use all of ``time_s``, although the walk of the wavefront can make a shorter visit better.

    Returns
    -------
    list of EtcAnswer
        One per band. ``value`` is the photometric SNR in the best visit of at most ``time_s``; ``time_s`` of the
        answer is what it uses (flag ``shorter_visit_is_better``).

    Raises
    ------
    InputError
        For values out of range.
    """
    check_range("time_s", time_s, 1e-3, 1e9, "s")
    _check_frame(model, exposure_s, em_gain)
    answers = []
    for case in _cases(
        model,
        target,
        bands,
        planet or ReferencePlanet(),
        separation_arcsec,
        contrast,
        "signal_to_noise",
        "",
    ):
        if isinstance(case, EtcAnswer):
            answers.append(case)
            continue
        lengths = [time_s] if exact else visit_lengths(time_s)

        def tried(length: float, case: _Case = case) -> Settings:
            rates = _walked(model, case, length)
            return settings_for_time(model, rates, length, exposure_s=exposure_s, em_gain=em_gain)

        found = [tried(length) for length in lengths]
        best = max(range(len(found)), key=lambda i: float(found[i].noise.significance[0]))
        if not exact:  # between the lengths tried, too
            found += [tried(part) for part in (lengths[best] * f for f in BETWEEN) if part < time_s]
        chosen = max(found, key=lambda setting: float(setting.noise.significance[0]))
        if chosen.n_frames[0] < 1:
            answers.append(_no_setting(model, case, chosen, exposure_s, em_gain))
            continue
        flags = case.answer["flags"] + (("shorter_visit_is_better",) if chosen is not found[0] else ())
        answers.append(_filled(case, chosen, float(chosen.noise.snr[0]), flags=flags))
    return answers


def exposure_time(
    model: EtcModel,
    target: Targets,
    *,
    snr: float,
    separation_arcsec: float,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | None = None,
    contrast: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    refine: bool = True,
) -> list[EtcAnswer]:
    """Least wall time that reaches an SNR, per band; ``unreachable`` below the speckle floor.

    Parameters as in `signal_to_noise`; ``snr`` from 1e-6 to 1e6. ``value`` is ``time_s``; without
    ``refine`` it is good to one frame.
    """
    check_range("snr", snr, 1e-6, 1e6, "")
    _check_frame(model, exposure_s, em_gain)
    answers = []
    for case in _cases(
        model, target, bands, planet or ReferencePlanet(), separation_arcsec, contrast, "exposure_time", "s"
    ):
        if isinstance(case, EtcAnswer):
            answers.append(case)
            continue
        answers.append(_least_time(model, case, snr, exposure_s, em_gain, refine))
    return answers


def _walked(model: EtcModel, case: _Case, time_s: float) -> ApertureRates:
    """Rates of a case with the speckle residual of a visit of ``time_s``."""
    band, place = case.answer["band"], case.answer["separation_arcsec"]
    instant = max(float(speckle_fraction(model, band, 0.0, place)), 1e-300)
    growth = float(speckle_fraction(model, band, model.visit_s(time_s), place)) / instant
    return replace(case.rates, speckle_e_s=case.rates.speckle_e_s * growth)


def _least_time(
    model: EtcModel, case: _Case, snr: float, exposure_s: float | None, em_gain: float | None, refine: bool
) -> EtcAnswer:
    """Shortest time that suffices although the speckle residual grows with the length of the visit.

    Starting from the residual of an instant visit, time and residual are found in turn; both only grow, so the
    first time that reproduces itself is the shortest one.
    """
    rates, time_s = case.rates, 0.0
    place = case.answer["band"], case.answer["separation_arcsec"]
    star_e_s = float(rates.speckle_e_s[0]) / max(float(speckle_fraction(model, place[0], 0.0, place[1])), 1e-300)
    for _ in range(MAX_TURNS):
        chosen = settings_for_snr(model, rates, snr, exposure_s=exposure_s, em_gain=em_gain, refine=refine)
        level = math.sqrt(1.0 + 1.0 / float(rates.background_apertures[0]))
        floor = float(rates.planet_e_s[0]) / max(level * float(rates.speckle_e_s[0]), 1e-300)
        if floor <= snr:
            break
        if chosen.n_frames[0] < 1:
            return _no_setting(model, case, chosen, exposure_s, em_gain)
        previous, time_s = time_s, float(chosen.time_s[0])
        if time_s <= previous:
            return _filled(case, chosen, time_s)
        fraction = float(speckle_fraction(model, place[0], model.visit_s(time_s), place[1]))
        rates = replace(rates, speckle_e_s=np.array([star_e_s * fraction]))
    # Near the largest SNR that any visit gives, the search steps over the few lengths that suffice.
    for length in sorted(VISIT_LENGTHS_S):
        chosen = settings_for_time(model, _walked(model, case, length), length, exposure_s=exposure_s, em_gain=em_gain)
        if chosen.n_frames[0] >= 1 and chosen.noise.snr[0] >= snr:
            return _filled(case, chosen, float(chosen.time_s[0]))
    text = f"the speckle residual keeps the SNR below {snr:g}, whatever the time"
    return EtcAnswer(value=None, status=Status.UNREACHABLE, reason=Reason.SPECKLE_FLOOR, message=text, **case.answer)


def contrast_limit(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float,
    separation_arcsec: float,
    bands: Sequence[str] | None = None,
    sigma: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
) -> list[EtcAnswer]:
    """Faintest contrast detected in a given wall time, per band.

    Parameters as in `signal_to_noise`. With ``sigma`` the limit is at that plain significance; without it, at the
    small-sample threshold of the model's level (5 sigma-equivalent), which is stated in ``threshold``.

    Notes
    -----
    Significance does not contain the planet's own noise, so the limit is linear in it: one setting is optimised
    for a planet at the limit (two passes), then ``C = n_sigma * sigma / (star rate * core * time)``.
    """
    check_range("time_s", time_s, 1e-3, 1e9, "s")
    if sigma is not None:
        check_range("sigma", sigma, 1e-3, 1e3, "")
    _check_frame(model, exposure_s, em_gain)
    answers = []
    for case in _cases(
        model,
        target,
        bands,
        ReferencePlanet(),
        separation_arcsec,
        1e-9,
        "contrast_limit",
        "contrast",
    ):
        if isinstance(case, EtcAnswer):
            answers.append(case)
            continue
        level = sigma if sigma is not None else case.threshold
        if not math.isfinite(level):
            text = "fewer than three resolution elements at this separation: no threshold is defined (give --sigma)"
            answers.append(
                EtcAnswer(
                    value=None,
                    status=Status.UNREACHABLE,
                    reason=Reason.TOO_FEW_ELEMENTS,
                    message=text,
                    **(case.answer | {"contrast": None}),
                )
            )
            continue
        found = [
            _limit(model, target, case, level, length, separation_arcsec, exposure_s, em_gain)
            for length in ([time_s] if exact else visit_lengths(time_s))
        ]
        best = min(found, key=lambda answer: math.inf if answer.value is None else answer.value)
        if best is not found[0]:
            best = replace(best, flags=(*best.flags, "shorter_visit_is_better"))
        answers.append(best)
    return answers


def _limit(
    model: EtcModel,
    target: Targets,
    case: _Case,
    level: float,
    time_s: float,
    separation_arcsec: float,
    exposure_s: float | None,
    em_gain: float | None,
) -> EtcAnswer:
    contrast, rates = 1e-9, _walked(model, case, time_s)
    x, y = diagonal(model.metrics[case.answer["band"]].zone, np.array([separation_arcsec]))
    for _ in range(3):
        chosen = settings_for_time(model, rates, time_s, exposure_s=exposure_s, em_gain=em_gain)
        if chosen.n_frames[0] < 1:
            return _no_setting(model, case, chosen, exposure_s, em_gain)
        contrast *= level / float(chosen.noise.significance[0])
        if contrast >= 1.0:
            text = "no contrast below 1 is detected"
            return EtcAnswer(
                value=None,
                status=Status.UNREACHABLE,
                reason=Reason.INSUFFICIENT_TIME,
                message=text,
                **(case.answer | {"contrast": None}),
            )
        rates = aperture_rates(
            model, target, case.answer["band"], x, y, np.array([contrast]), visit_s=model.visit_s(time_s)
        )
    noise = stack_noise(
        rates,
        chosen.exposure_s,
        chosen.n_frames,
        chosen.em_gain,
        model.instrument.detector,
        reference_ratio=model.strategy.reference_ratio,
    )
    final = Settings(
        chosen.exposure_s, chosen.n_frames, chosen.em_gain, chosen.time_s, noise, chosen.longest_exposure_s
    )
    contrast *= level / float(noise.significance[0])
    return _filled(case, final, contrast, contrast=contrast)


def _check_frame(model: EtcModel, exposure_s: float | None, em_gain: float | None) -> None:
    if exposure_s is not None:
        check_range("exposure_s", exposure_s, 1e-6, 1e6, "s")
    if em_gain is not None:
        check_range("em_gain", em_gain, 1.0, model.instrument.detector.em_gain_max, "")
