"""How predictions and measurements compare over all confirmed bands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_planner.models import BandConfirmation

__all__ = ["Calibration", "calibrate", "snr_scatter"]


@dataclass(frozen=True)
class Calibration:
    """Ratio of recovered to predicted SNR.

    Attributes
    ----------
    ratio : float or None
        Weighted mean of recovered / predicted SNR; ``None`` without a confirmed band.
    error : float or None
        Standard error, enlarged where three or more bands scatter more than their errors allow.
    n_bands : int
        Bands with a measurement.
    """

    ratio: float | None
    error: float | None
    n_bands: int


def snr_scatter(snr: float, n_apertures: int | None) -> float:
    """Standard deviation of an SNR measured once: unit noise, and the error of a scatter from ``n`` apertures.

    A standard deviation from n samples is known to ``1 / sqrt(2 (n - 1))`` of itself.
    """
    relative = 1.0 / math.sqrt(2.0 * (n_apertures - 1)) if n_apertures and n_apertures > 1 else 0.0
    return math.hypot(1.0, snr * relative)


def calibrate(bands: Sequence[BandConfirmation]) -> Calibration:
    """Calibration factor over bands: the mean of recovered / predicted, weighted by the inverse variance of each.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        Bands without a measurement are passed over.
    """
    used = [b for b in bands if b.predicted_snr and b.recovered_snr is not None]
    if not used:
        return Calibration(None, None, 0)
    predicted = np.array([b.predicted_snr for b in used], float)
    ratios = np.array([b.recovered_snr for b in used], float) / predicted
    scatter = np.array([snr_scatter(float(p), b.n_background_apertures) for p, b in zip(predicted, used, strict=True)])
    weight = (predicted / scatter) ** 2
    ratio = float(np.sum(weight * ratios) / weight.sum())
    error = 1.0 / math.sqrt(weight.sum())
    if len(used) >= 3:
        chi2 = float(np.sum(weight * (ratios - ratio) ** 2) / (len(used) - 1))
        error *= math.sqrt(max(chi2, 1.0))
    return Calibration(ratio, error, len(used))
