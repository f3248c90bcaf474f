"""The whole loop: does the validator find what is wrong, and nothing where nothing is?"""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import FIVE_STARS, TIME_S, in_blocks, nominal, task_for

from cpic_planner.etc import build_model, planet_offsets
from cpic_planner.queries import SimulatorOverrides
from cpic_planner.ranking import rank_targets
from cpic_planner.results import BandConfirmation
from cpic_planner.targets import find_target, rank_sample
from cpic_planner.validation import PREDICTION_ERROR, calibrate, confirm_task, expected_of

UNALTERED_STARS, UNALTERED_REALISATIONS = 20, 24
ALTERED = ("throughput=x0.7", "read_noise=x1.5", "visit_drift=x3", "companions=on")
ALTERED_REALISATIONS = 16


def confirmed_block(task: dict[str, Any]) -> list[dict[str, Any]]:
    """Confirmation of one task without its pictures."""
    return list(confirm_task(task)["confirmations"])


def best_stars(count: int) -> list[tuple[str, str]]:
    """Stars of the largest predicted margins with their best bands."""
    rank = rank_targets(nominal(), rank_sample(), time_s=TIME_S, score="detection_margin")
    rows = [row for row in rank.targets if row.status != "saturated"][:count]
    return [(row.name, row.band) for row in rows]


def unaltered(workers: int) -> list[tuple[str, BandConfirmation]]:
    """One band of each star, nothing altered."""
    pairs = best_stars(UNALTERED_STARS)
    tasks = [task_for(star, band, seed=11, realisations=UNALTERED_REALISATIONS) for star, band in pairs]
    rows = in_blocks(confirmed_block, [(task.to_dict(),) for task in tasks], workers)
    return [(star, BandConfirmation.model_validate(row)) for (star, _), row in zip(pairs, rows, strict=True)]


def altered(entry: str, workers: int) -> dict[str, Any]:
    """The sentence of a plan whose images are altered, and the factor that the ETC itself gives for it."""
    light = entry.startswith("companions")
    stars = ("alf Cen B",) if light else FIVE_STARS
    pairs = [(star, band) for star in stars for band in nominal().bands]
    tasks = [
        task_for(
            star, band, seed=12, realisations=ALTERED_REALISATIONS, overrides=entry, companions="off" if light else "on"
        )
        for star, band in pairs
    ]
    rows = in_blocks(confirmed_block, [(task.to_dict(),) for task in tasks], workers)
    bands = [BandConfirmation.model_validate(row) for row in rows]
    overrides = SimulatorOverrides.of(entry)
    model = build_model(overrides.instrument(nominal().instrument))
    known = []
    for (star, band), task in zip(pairs, tasks, strict=True):
        target, _ = find_target(star, companions="on")
        expected = task.predictions[0]
        place = planet_offsets(model, target, band, expected["separation_arcsec"])
        known.append(expected_of(model, target, band, place, expected["contrast"], task)["snr"] / expected["snr"])
    mean = calibrate(bands)
    assert mean.etc_ratio is not None  # every band was measured
    assert mean.etc_ratio_error is not None
    expected_ratio = _weighted(bands, np.array(known), 1.0 / mean.etc_ratio)
    return {
        "override": entry,
        "stars": len(stars),
        "bands": len(bands),
        "known": 1.0 / expected_ratio,
        "found": mean.etc_ratio,
        "error": mean.etc_ratio_error,
        "deviation": (1.0 - expected_ratio * mean.etc_ratio) * mean.etc_ratio / mean.etc_ratio_error,
        "text": mean.text,
    }


def _weighted(bands: list[BandConfirmation], ratios: np.ndarray, mean: float) -> float:
    """Mean of known ratios with the weights of the calibration."""
    own = np.array([(band.recovered_snr_error or 0.0) / (band.predicted_snr or 1.0) for band in bands])
    return float(np.average(ratios, weights=1.0 / (own**2 + (PREDICTION_ERROR * mean) ** 2)))
