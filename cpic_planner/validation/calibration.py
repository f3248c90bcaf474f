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


def snr_scatter(snr: float, significance: float, n_apertures: int | None) -> float:
    """Standard deviation of an SNR measured once.

    Parameters
    ----------
    snr, significance : float
        Expected values: with and without the planet's own noise.
    n_apertures : int or None
        Apertures behind the measured scatter.

    Notes
    -----
    Unit noise in the flux, less what a brighter measurement adds to its own error; and the error of the background's
    scatter, known to ``1 / sqrt(2 (n - 1))`` from n apertures, in its share of the variance.
    """
    quiet = min((snr / significance) ** 2, 1.0) if significance > 0 else 1.0
    relative = 1.0 / math.sqrt(2.0 * (n_apertures - 1)) if n_apertures and n_apertures > 1 else 0.0
    return math.hypot(1.0 - 0.5 * (1.0 - quiet), snr * relative * quiet)


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
    scatter = np.array(
        [snr_scatter(b.predicted_snr or 0.0, b.predicted_significance or 0.0, b.n_background_apertures) for b in used]
    )
    weight = (predicted / scatter) ** 2
    ratio = float(np.sum(weight * ratios) / weight.sum())
    error = 1.0 / math.sqrt(weight.sum())
    if len(used) >= 3:
        chi2 = float(np.sum(weight * (ratios - ratio) ** 2) / (len(used) - 1))
        error *= math.sqrt(max(chi2, 1.0))
    return Calibration(ratio, error, len(used))
