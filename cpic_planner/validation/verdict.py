"""From realisations to an answer: what was recovered, whether the planet is confirmed, and how the ETC stands."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cpic_core import Reason
from cpic_planner.results import AuditRecord, BandConfirmation
from cpic_planner.validation.astrometry import Astrometry
from cpic_planner.validation.findings import (
    MIN_JACKKNIFE,
    MIN_SNR,
    PREDICTION_ERROR,
    calibrate,
    mean_snr,
    optimism,
    standing,
)
from cpic_planner.validation.measure import Measurement
from cpic_planner.validation.modelling import Modelling, modelling_of
from cpic_planner.validation.realise import FrameStory
from cpic_planner.validation.star_flux import StarFlux
from cpic_planner.validation.task import ConfirmTask

_ADVICE = {
    "quick": "take --fidelity standard, or a --tolerance",
    "standard": "take --fidelity reference, or a --tolerance",
    "custom": "take --fidelity reference, or a larger --tolerance",
}


def confirmation_of(
    task: ConfirmTask,
    modelling: Modelling,
    number: int,
    measured: Sequence[Measurement],
    *,
    star: StarFlux | None,
    core: float,
    false_detections: int,
    story: FrameStory | None,
    position: Astrometry | None,
    audit: AuditRecord | None,
) -> BandConfirmation:
    """Answer for planet ``number`` of a task.

    Parameters
    ----------
    task : ConfirmTask
    modelling : Modelling
        How the images were made.
    number : int
        Of the planet among those of the task.
    measured : sequence of Measurement
        One a realisation.
    star : StarFlux or None
        What contrasts refer to; None where the scene's own rate had to do.
    core : float
        Core throughput at the planet's place.
    false_detections : int
        Of all searches.
    story : FrameStory or None
        Of frames that were run one by one; None for sums.
    position : Astrometry or None
        Fit of the first realisation that shows the planet.
    audit : AuditRecord or None
    """
    expected = task.predictions[number]
    contrast = np.array([item.contrast for item in measured])
    error = np.array([item.contrast_error for item in measured])
    sigma = np.array([item.contrast_sigma for item in measured])
    snr, snr_error = mean_snr(
        contrast, error, significance=expected["significance"], n_apertures=measured[0].n_apertures
    )
    n = len(measured)
    # A few values do not tell their scatter.
    spread = float(contrast.std(ddof=1)) if n >= MIN_JACKKNIFE else float(np.sqrt((error**2).mean()))
    found = sum(item.found for item in measured)
    at_place = sum(item.significance >= expected["threshold"] for item in measured)
    lost = 0 if story is None else story.lost_in
    ratio = snr / expected["snr"]
    ratio_error = math.hypot(snr_error / expected["snr"], PREDICTION_ERROR * ratio)
    factor = optimism(ratio, ratio_error) if ratio > MIN_SNR * ratio_error else (None, None)
    detected = bool(2 * found >= n and not lost)
    return BandConfirmation(
        **_asked(task, number),
        status="saturated" if lost else "ok",
        reason=Reason.PIXEL_FULL_WELL.value if lost else "",
        message=f"{lost} pixels of the hole were cut off by a limit" if lost else "",
        realisations=n,
        drawn_as=modelling.draw,
        modelled=modelling.record(),
        recovered_snr=snr,
        recovered_snr_error=snr_error,
        recovered_significance=float(contrast.mean() / np.sqrt((sigma**2).mean())),
        etc_ratio=factor[0],
        etc_ratio_error=factor[1],
        recovered_contrast=float(contrast.mean()),
        contrast_error=float(np.sqrt((error**2).mean())),
        contrast_mean_error=spread / math.sqrt(n),
        star_flux="known" if star is None else star.method,
        star_flux_error=None if star is None else star.error_e_s / star.rate_e_s,
        rdi_throughput=float(np.mean([item.throughput for item in measured])),
        rdi_modes_used=measured[0].modes,
        core_throughput=core,
        n_background_apertures=measured[0].n_apertures,
        saturated_in_hole=lost,
        saturated_outside=None
        if story is None
        else story.lost_outside / (task.n_frames * (1.0 + task.strategy["reference_ratio"]) * n),
        n_detected=found,
        search_snr=_mean([item.search_snr for item in measured]),
        search_threshold=_mean([item.search_threshold for item in measured]),
        n_significant=at_place,
        false_detections=false_detections,
        detected=detected,
        found_separation_arcsec=None if position is None else position.sky.separation_arcsec,
        found_separation_error_arcsec=None if position is None else position.sky.separation_error_arcsec,
        found_pa_deg=None if position is None else position.sky.pa_deg % 360.0,
        found_pa_error_deg=None if position is None else position.sky.pa_error_deg,
        verdict=_verdict(expected, detected, (found, at_place, n), ratio, ratio_error),
        audit=audit,
    )


def _asked(task: ConfirmTask, number: int) -> dict[str, Any]:
    """What was observed, and what was expected of it."""
    expected = task.predictions[number]
    return {
        "band": task.band,
        "planet": task.planets[number],
        "separation_arcsec": expected["separation_arcsec"],
        "pa_deg": expected["pa_deg"],
        "exposure_s": task.exposure_s,
        "n_frames": task.n_frames,
        "em_gain": task.em_gain,
        "integration_s": task.exposure_s * task.n_frames,
        "time_s": expected["time_s"],
        "predicted_snr": expected["snr"],
        "predicted_significance": expected["significance"],
        "threshold": expected["threshold"],
        "predicted_verdict": expected["verdict"],
        "predicted_detection_probability": expected["chance_blind"],
        "predicted_detection_probability_known_place": expected["chance_known_place"],
        "true_contrast": expected["contrast"],
        "image": task.key,
    }


def cut_off(task: ConfirmTask, modelling: Modelling, number: int, story: FrameStory) -> BandConfirmation:
    """Answer where limits left nothing of a planet's aperture, or of the background around it.

    Parameters
    ----------
    task : ConfirmTask
    modelling : Modelling
    number : int
        Realisations.
    story : FrameStory
    """
    return BandConfirmation(
        **_asked(task, number),
        status="saturated",
        reason=Reason.PIXEL_FULL_WELL.value,
        message="limits cut off the aperture or the background around it",
        drawn_as="frames",
        modelled=modelling.record(),
        saturated_in_hole=story.lost_in,
        detected=False,
        verdict="saturated",
    )


def refusals_of(task: ConfirmTask) -> list[BandConfirmation]:
    """Answers of a task whose tier is not good enough for its scene, one a planet; empty where it is."""
    modelling = modelling_of(task)
    if modelling.outcome.value is not None:
        return []
    return [
        BandConfirmation(
            **(_asked(task, number) | {"image": None}),
            status=modelling.outcome.status.value,
            reason=modelling.outcome.reason.value,
            message=f"{modelling.outcome.message}: {_ADVICE[modelling.dial.fidelity]}",
            modelled=modelling.record(),
            verdict="not modelled",
        )
        for number in range(len(task.planets))
    ]


def _verdict(expected: dict[str, Any], detected: bool, counts: tuple[int, int, int], ratio: float, error: float) -> str:
    found, at_place, realisations = counts
    likely = expected["significance"] >= expected["threshold"]
    if detected:
        word = "confirmed" if likely else "detected, though predicted below threshold"
    elif 2 * at_place >= realisations:
        word = "seen at its known place, not confirmed blind"
    else:
        word = "not confirmed" if likely else "not detected, as predicted"
    if realisations > 1:
        word += f" ({found} of {realisations})"
    return f"{word}; {_etc(ratio, error)}"


def _etc(ratio: float, error: float) -> str:
    if ratio <= MIN_SNR * error:
        return "too faint to measure the ETC by"
    word = standing(ratio, error)
    factor, spread = optimism(ratio, error)
    return f"ETC {word}{', ' if word == 'agrees' else ' by '}{factor:.2f} +- {spread:.2f}"


def _mean(values: Sequence[float | None]) -> float | None:
    given = [value for value in values if value is not None]
    return float(np.mean(given)) if given else None


def audit_of(
    task: ConfirmTask, number: int, measured: Measurement, story: FrameStory, false_detections: int
) -> AuditRecord:
    """Record of the realisation that ran frame by frame with every effect on."""
    expected = task.predictions[number]
    frames = task.n_frames * (1.0 + task.strategy["reference_ratio"])
    return AuditRecord.of(
        task,
        measured,
        story,
        predicted_snr=expected["snr_full"],
        recovered_snr=measured.snr,
        recovered_significance=measured.significance,
        deviation_sigma=(measured.contrast - expected["contrast"]) / measured.contrast_error,
        detected=bool(measured.found and not story.lost_in),
        false_detections=false_detections,
        saturated_in_hole=story.lost_in,
        saturated_outside=story.lost_outside / frames,
    )


def seen_at_place(band: BandConfirmation) -> bool:
    """Whether at least half of the realisations are significant at the known place, limits aside."""
    return band.status == "ok" and 2 * (band.n_significant or 0) >= (band.realisations or 1)


def target_verdict(bands: Sequence[BandConfirmation]) -> tuple[str, float | None, float | None]:
    """A target's bands in words, with the mean factor of the ETC and its error."""
    seen = [band for band in bands if band.detected]
    tried = [band for band in bands if band.recovered_snr is not None]
    if not tried:
        word = "saturated" if any(band.verdict == "saturated" for band in bands) else "not observed"
        return f"{word}: " + ", ".join(sorted({band.reason for band in bands})), None, None
    if any(band.status == "saturated" for band in tried) and not seen:
        word = "saturated"
    elif seen:
        word = "confirmed in " + ", ".join(band.band for band in seen)
    elif any(seen_at_place(band) for band in tried):
        word = "seen at its known place, not confirmed blind"
    else:
        word = "not confirmed"
    mean = calibrate(tried)
    assert mean.ratio is not None  # there is a band
    assert mean.error is not None
    if mean.ratio <= MIN_SNR * mean.error:
        return f"{word}; {_etc(mean.ratio, mean.error)}", None, None
    return f"{word}; {_etc(mean.ratio, mean.error)}", *optimism(mean.ratio, mean.error)
