"""Errors of every way against the reference of its scene, each with its own uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_planner.models.tradeoff import TradeoffRow
from cpic_planner.tradeoff.points import REFERENCE

FloatArray = NDArray[np.float64]
FLUX_LIMIT = 1e-9
"""Rounding of the difference of two expected images, relative to a planet."""


@dataclass(frozen=True)
class _Ratio:
    """A ratio and its standard error."""

    value: float
    error: float


def compared(rows: Iterable[TradeoffRow], *, exposure_s: float) -> list[TradeoffRow]:
    """Rows of one scene with their errors; None where there is no reference to compare with.

    Parameters
    ----------
    rows : iterable of TradeoffRow
        Of one scene.
    exposure_s : float
        Of a frame.

    Returns
    -------
    list of TradeoffRow

    Notes
    -----
    ``variance = 2 N white + own + (N t)^2 speckle``: science and reference visit of ``N`` frames each, the planet's own
    light, and what subtraction leaves of the star. A part whose random numbers are those of the reference, frame by
    frame or pair by pair, is compared with it sample by sample; the others carry the errors of both.
    """
    every = list(rows)
    best = next((row for row in every if row.point == REFERENCE and row.status == "ok"), None)
    if best is None:
        return [row.model_copy(update=dict.fromkeys(_ERRORS)) for row in every]
    return [_one(row, best, exposure_s) if row.status == "ok" else row for row in every]


_ERRORS = ("variance_e2", "snr", "flux_error", "flux_uncertainty", "snr_error", "snr_uncertainty")


def _one(row: TradeoffRow, best: TradeoffRow, exposure_s: float) -> TradeoffRow:
    assert row.flux_e is not None  # as ok says
    assert best.flux_e is not None
    white_best, speckle_best = _white(best), _speckle(best, best).value * (best.n_frames * exposure_s) ** 2
    parts = np.array([2.0 * best.n_frames * white_best.value, best.samples["own_e2"][0], speckle_best])
    whole = float(parts.sum())
    if row.group == "closed_form":
        variance = row.samples["whole_e2"][0] + row.samples["fixed_speckle_e2"][0]
        error = _variance_error(parts, white_best.error / white_best.value, _relative(best.samples["speckle_e2_s2"]))
    else:
        white, speckle = _white_ratio(row, best), _speckle(row, best)
        ratio = _divided(speckle, _speckle(best, best))
        new = parts * [white.value, 1.0, ratio.value]
        new[1] = row.samples["own_e2"][0]
        variance = float(new.sum())
        error = _variance_error(new, white.error / max(white.value, 1e-300), ratio.error / max(ratio.value, 1e-300))
    flux, noise = row.flux_e / best.flux_e, math.sqrt(variance / whole)
    return row.model_copy(
        update={
            "variance_e2": variance,
            "snr": row.flux_e / math.sqrt(variance),
            "flux_error": flux - 1.0,
            "flux_uncertainty": 0.0 if row is best else FLUX_LIMIT,
            "snr_error": flux / noise - 1.0,
            "snr_uncertainty": 0.0 if row is best else flux / noise * 0.5 * error,
        }
    )


def _variance_error(parts: FloatArray, white: float, speckle: float) -> float:
    return float(np.hypot(parts[0] * white, parts[2] * speckle) / parts.sum())


def _relative(values: Sequence[float]) -> float:
    array = np.asarray(values, float)
    if array.size < 2 or not array.mean() > 0:
        return 0.0
    return float(array.std(ddof=1) / array.mean() / math.sqrt(array.size))


def _white(row: TradeoffRow) -> _Ratio:
    values = [*row.samples["white_e2"], *row.samples.get("more_white_e2", [])]
    return _Ratio(float(np.mean(values)), float(np.mean(values)) * _relative(values))


def _white_ratio(row: TradeoffRow, best: TradeoffRow) -> _Ratio:
    """White noise over the reference's: frame by frame where the frames have the same random numbers."""
    if _same_numbers(row, best):
        return _paired(row.samples["white_e2"], best.samples["white_e2"])
    return _divided(_white(row), _white(best))


def _same_numbers(row: TradeoffRow, best: TradeoffRow) -> bool:
    alike = all(row.settings.get(key) == best.settings.get(key) for key in ("draw", "region"))
    return alike and len(row.samples["white_e2"]) == len(best.samples["white_e2"])


def _speckle(row: TradeoffRow, best: TradeoffRow) -> _Ratio:
    """Variance of the residual of the star, (e-/s)^2; its error is that of the ratio to the reference.

    What a row does not hold is as in the reference.
    """
    samples, others = row.samples, best.samples
    fixed = samples.get("speckle_e2_s2", others["speckle_e2_s2"])
    walk, one = (samples.get(name, others[name]) for name in ("walk_e2_s2", "one_epoch_e2_s2"))
    epochs = float(np.mean(walk) / np.mean(one)) if np.mean(one) > 0 else 1.0
    value = float(np.mean(fixed)) * epochs
    if not value > 0:
        return _Ratio(0.0, 0.0)
    knobs, moved = _paired(fixed, others["speckle_e2_s2"]), _paired(walk, others["walk_e2_s2"])
    return _Ratio(value, value * math.hypot(knobs.error / knobs.value, moved.error / moved.value))


def _paired(ours: Sequence[float], theirs: Sequence[float]) -> _Ratio:
    """Ratio of two means of paired samples."""
    first, second = np.asarray(ours, float), np.asarray(theirs, float)
    if len(first) != len(second):
        return _divided(
            _Ratio(float(first.mean()), float(first.mean()) * _relative(ours)),
            _Ratio(float(second.mean()), float(second.mean()) * _relative(theirs)),
        )
    value = float(first.mean() / second.mean())
    difference = first / first.mean() - second / second.mean() if value > 0 else np.zeros(2)
    return _Ratio(value, value * float(difference.std(ddof=1)) / math.sqrt(difference.size))


def _divided(ours: _Ratio, theirs: _Ratio) -> _Ratio:
    if not theirs.value > 0:
        return _Ratio(1.0, 0.0)
    value = ours.value / theirs.value
    relative = math.hypot(ours.error / ours.value if ours.value > 0 else 0.0, theirs.error / theirs.value)
    return _Ratio(value, value * relative)


def speed_ups(rows: Iterable[TradeoffRow], *, beside: str = "etc") -> dict[str, float]:
    """Wall clock of the reference over that of another way on the same machine, by scene."""
    times: dict[str, dict[str, TradeoffRow]] = {}
    for row in rows:
        if row.point in (REFERENCE, beside) and row.wall_s:
            times.setdefault(row.scene, {})[row.point] = row
    return {
        scene: (pair[REFERENCE].wall_s or 0.0) / (pair[beside].wall_s or math.inf)
        for scene, pair in times.items()
        if len(pair) == 2 and pair[REFERENCE].machine == pair[beside].machine
    }
