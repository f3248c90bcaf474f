"""Make an answer from realisations: what was recovered, whether the planet is confirmed, and the ETC's standing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import FloatArray, Reason, Status
from cpic_planner.queries import Strategy
from cpic_planner.results import AuditRecord, BandConfirmation
from cpic_planner.validation import findings
from cpic_planner.validation.astrometry import Astrometry
from cpic_planner.validation.libraries import library_plan
from cpic_planner.validation.measure import Measurement
from cpic_planner.validation.modelling import Modelling, modelling_of
from cpic_planner.validation.realise import FrameStatistics
from cpic_planner.validation.star_flux import StarFlux
from cpic_planner.validation.task import ConfirmTask, not_observed
from cpic_planner.validation.templates import obstacle, planet_places
from simulator.config import Instrument, Scene, validate
from simulator.imaging import BandGeometry

AT_KNOWN_PLACE = "seen at its known place, not confirmed blind"
_ADVICE = {
    "quick": "take --fidelity standard, or a --tolerance",
    "standard": "take --fidelity reference, or a --tolerance",
    "custom": "take --fidelity reference, or a larger --tolerance",
}


@dataclass(frozen=True)
class Evidence:
    """The evidence in the images of a task about all its planets together.

    Attributes
    ----------
    task : ConfirmTask
    modelling : Modelling
        How the images were made.
    star : StarFlux or None
        What contrasts refer to; None where the scene's own rate had to do.
    false_detections : int
        Of all searches.
    statistics : FrameStatistics or None
        Of frames that were run one by one; None for sums.
    """

    task: ConfirmTask
    modelling: Modelling
    star: StarFlux | None
    false_detections: int
    statistics: FrameStatistics | None


def confirmation_of(
    seen: Evidence,
    number: int,
    measured: Sequence[Measurement],
    core: float,
    position: Astrometry | None = None,
    audit: AuditRecord | None = None,
) -> BandConfirmation:
    """Return the answer for planet ``number`` of a task.

    Parameters
    ----------
    seen : Evidence
    number : int
        Of the planet among those of the task.
    measured : sequence of Measurement
        One a realisation.
    core : float
        Core throughput at the planet's place.
    position : Astrometry, optional
        Fit of the first realisation that shows the planet.
    audit : AuditRecord, optional
    """
    task, star, statistics = seen.task, seen.star, seen.statistics
    sky = position.sky if position else None
    expected = task.predictions[number]
    n = len(measured)
    n_apertures = measured[0].n_apertures
    contrast, error, sigma = contrasts_of(measured)
    recovered_significance = float(contrast.mean() / np.sqrt((sigma**2).mean()))
    predicted, significance = expected["snr"], expected["significance"]
    likely = recovered_significance if significance is None else significance
    snr, snr_error = findings.mean_snr(contrast, error, significance=likely, n_apertures=n_apertures)
    # A few values do not tell their scatter.
    spread = float(contrast.std(ddof=1)) if n >= findings.MIN_JACKKNIFE else float(np.sqrt((error**2).mean()))
    found = sum(item.found for item in measured)
    at_place = sum(item.found_at_place for item in measured)
    lost = 0 if statistics is None else statistics.lost_in
    mean = findings.Calibration() if predicted is None else findings.calibration_of(predicted, snr, snr_error)
    compared = "no closed form predicts this reduction" if predicted is None else _etc(mean)
    detected = bool(2 * found >= n and not lost)
    return BandConfirmation(
        **_asked(task, number),
        status="saturated" if lost else "ok",
        reason=Reason.PIXEL_FULL_WELL.value if lost else "",
        message=f"{lost} pixels of the hole were cut off by a limit" if lost else "",
        realisations=n,
        drawn_as=seen.modelling.draw,
        modelled=seen.modelling.record(),
        recovered_snr=snr,
        recovered_snr_error=snr_error,
        recovered_significance=recovered_significance,
        etc_ratio=mean.etc_ratio,
        etc_ratio_error=mean.etc_ratio_error,
        recovered_contrast=float(contrast.mean()),
        contrast_error=float(np.sqrt((error**2).mean())),
        contrast_mean_error=spread / math.sqrt(n),
        star_flux="known" if star is None else star.method,
        star_flux_error=None if star is None else star.error_e_s / star.rate_e_s,
        rdi_throughput=float(np.mean([item.throughput for item in measured])),
        rdi_modes_used=measured[0].modes,
        core_throughput=core,
        n_background_apertures=n_apertures,
        saturated_in_hole=lost,
        saturated_outside=statistics and statistics.lost_outside / statistics.frames_run,
        n_detected=found,
        search_snr=_mean([item.search_snr for item in measured]),
        search_threshold=_mean([item.search_threshold for item in measured]),
        n_significant=at_place,
        false_detections=seen.false_detections,
        detected=detected,
        found_separation_arcsec=sky and sky.separation_arcsec,
        found_separation_error_arcsec=sky and sky.separation_error_arcsec,
        found_pa_deg=sky and sky.pa_deg % 360.0,
        found_pa_error_deg=sky and sky.pa_error_deg,
        verdict=_verdict(_predicted(task, expected), detected, (found, at_place, n), compared),
        audit=audit,
    )


def _asked(task: ConfirmTask, number: int) -> dict[str, Any]:
    """Return what was observed, and what was expected of it."""
    expected = task.predictions[number]
    return {
        "band": task.band,
        "planet": task.planets[number],
        "separation_arcsec": expected["separation_arcsec"],
        "pa_deg": expected["pa_deg"],
        "exposure_s": task.exposure_s,
        "visits": task.visits,
        "reference_visits": task.reference_visits,
        "frames_per_visit": task.n_frames,
        "n_frames": task.n_science_frames,
        "em_gain": task.em_gain,
        "integration_s": task.exposure_s * task.n_science_frames,
        "time_s": task.time_s,
        "unused_s": task.unused_s,
        "chosen_for": task.chosen_for,
        "predicted_snr": expected["snr"],
        "predicted_significance": expected["significance"],
        "threshold": expected["threshold"],
        "predicted_verdict": expected["verdict"],
        "predicted_detection_probability": expected["chance_blind"],
        "predicted_detection_probability_known_place": expected["chance_known_place"],
        "true_contrast": expected["contrast"],
        "image": task.key,
    }


def contrasts_of(measured: Sequence[Measurement]) -> FloatArray:
    """Return the contrasts, their errors and those without the planet's noise, one a realisation; (3, n)."""
    rows = [(item.contrast, item.contrast_error, item.contrast_sigma) for item in measured]
    return np.ascontiguousarray(np.array(rows).T)


def cut_off(seen: Evidence, number: int) -> BandConfirmation:
    """Return the answer where limits left nothing of a planet's aperture, or of the background around it.

    Parameters
    ----------
    seen : Evidence
    number : int
        Of the planet among those of the task.
    """
    text = "limits cut off the aperture or the background around it"
    return BandConfirmation(
        **_asked(seen.task, number),
        status="saturated",
        reason=Reason.PIXEL_FULL_WELL.value,
        message=text,
        modelled=seen.modelling.record(),
        drawn_as="frames",
        saturated_in_hole=seen.statistics.lost_in if seen.statistics else None,
        detected=False,
        verdict="saturated",
    )


_PREDICTED = (
    *("predicted_snr", "predicted_significance", "predicted_verdict"),
    *("predicted_detection_probability", "predicted_detection_probability_known_place"),
)


def refusals_of(task: ConfirmTask) -> list[BandConfirmation]:
    """Return the answers for planets of a task that need no image.

    All of them where the tier is not good enough for the scene; those that images cannot show; none where all can be
    measured.
    """
    modelling = modelling_of(task)
    if modelling.outcome.value is None:
        why = modelling.outcome.status, modelling.outcome.reason
        text = f"{modelling.outcome.message}: {_ADVICE[modelling.dial.fidelity]}"
        reasons = dict.fromkeys(range(len(task.planets)), (*why, text, "not modelled"))
    else:
        reasons = {}
        strategy = validate(Strategy, task.strategy, where="strategy")
        instrument = validate(Instrument, task.simulator, where="instrument")
        scene = modelling.scene(validate(Scene, task.scene, where="scene"))
        plan = library_plan(strategy, scene, task.n_frames, visits=task.visits)
        geometry = BandGeometry.of(instrument, task.band, modelling.knobs.stamp_pixels)
        for number, place in enumerate(planet_places(plan, instrument, task, geometry, strategy)):
            if (hidden := obstacle(place, geometry, strategy)) is not None:
                inside = hidden[0] in (Reason.TOO_FEW_ELEMENTS, Reason.SOURCE_ON_PLACE)
                reasons[number] = (Status.UNREACHABLE if inside else Status.OUTSIDE_FIELD, *hidden, "not observed")
    answers = []
    for number, (status, reason, text, verdict) in reasons.items():
        more = {"image": None, "modelled": modelling.record(), "verdict": verdict}
        if reason is Reason.SOURCE_ON_PLACE:  # predictions know the light of an annulus
            more |= dict.fromkeys(_PREDICTED)
        answers.append(not_observed(status, reason, text, **(_asked(task, number) | more)))
    return answers


def _predicted(task: ConfirmTask, expected: dict[str, Any]) -> tuple[bool | None, str]:
    """Return whether the images' way of deciding predicted a detection, and what was predicted in words.

    None where nothing was predicted.
    """
    if expected["significance"] is None:
        return None, ""
    strategy = validate(Strategy, task.strategy, where="strategy")
    # Two rolls show every planet twice: the threshold at the known place decides there.
    at_place = strategy.search == "known_place" or len(strategy.rolls_deg) > 1
    chance = expected["chance_known_place" if at_place else "chance_blind"]
    if chance is None:
        return expected["significance"] >= expected["threshold"], "a significance below the threshold"
    return chance >= 0.5, f"a probability of {chance:.2f}"


def _verdict(predicted: tuple[bool | None, str], detected: bool, counts: tuple[int, int, int], etc: str) -> str:
    found, at_place, realisations = counts
    likely, expected = predicted
    if detected:
        word = f"detected, though {expected} was predicted" if likely is False else "confirmed"
    elif 2 * at_place >= realisations:
        word = AT_KNOWN_PLACE
    else:
        word = "not detected, as predicted" if likely is False else "not confirmed"
    counted = f" ({found} of {realisations})" if realisations > 1 else ""
    return f"{word}{counted}; {etc}"


def _etc(mean: findings.Calibration) -> str:
    return f"{mean.standing} (predicted over recovered SNR {mean.number})" if mean.number else mean.standing


def _mean(values: Sequence[float | None]) -> float | None:
    given = [value for value in values if value is not None]
    return float(np.mean(given)) if given else None


def audit_of(
    task: ConfirmTask, number: int, measured: Measurement, statistics: FrameStatistics, false_detections: int
) -> AuditRecord:
    """Return the record of the realisation with every effect on; ``statistics`` are of the frames that were run."""
    expected = task.predictions[number]
    return AuditRecord.of(
        task,
        measured,
        statistics,
        n_frames=task.n_science_frames,
        frames_in_all=round(task.n_all_frames),
        predicted_snr=expected["snr_full"],
        recovered_snr=measured.snr,
        recovered_significance=measured.significance,
        deviation_sigma=(measured.contrast - expected["contrast"]) / measured.contrast_error,
        detected=bool(measured.found and not statistics.lost_in),
        false_detections=false_detections,
        saturated_in_hole=statistics.lost_in,
        saturated_outside=statistics.lost_outside / statistics.frames_run,
    )


def significant_at_place(band: BandConfirmation) -> bool:
    """Return whether at least half of the realisations are significant at the known place, limits aside."""
    return band.status == "ok" and 2 * (band.n_significant or 0) >= (band.realisations or 1)


def target_verdict(bands: Sequence[BandConfirmation]) -> tuple[str, float | None, float | None]:
    """Return a target's bands in words, with predicted over recovered SNR and its error."""
    seen = [band for band in bands if band.detected]
    tried = [band for band in bands if band.recovered_snr is not None]
    if not tried:
        word = "saturated" if any(band.verdict == "saturated" for band in bands) else "not observed"
        return f"{word}: " + ", ".join(sorted({band.reason for band in bands})), None, None
    if seen:
        word = "confirmed in " + ", ".join(band.band for band in seen)
    elif any(band.status == "saturated" for band in tried):
        word = "saturated"
    else:
        word = AT_KNOWN_PLACE if any(significant_at_place(band) for band in tried) else "not confirmed"
    mean = findings.calibrate(tried)
    return f"{word}; {_etc(mean)}", mean.etc_ratio, mean.etc_ratio_error
