"""How predictions and measurements compare over all confirmed bands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_planner.models import BandConfirmation

__all__ = ["Calibration", "calibrate"]


@dataclass(frozen=True)
class Calibration:
    """Ratio of recovered to predicted SNR.

    Attributes
    ----------
    ratio : float or None
        Weighted mean of recovered / predicted SNR; ``None`` without a confirmed band.
    error : float or None
        Standard error: from the scatter of the bands where there are at least three, else from unit noise in SNR.
    n_bands : int
        Bands with a measurement.
    """

    ratio: float | None
    error: float | None
    n_bands: int


def calibrate(bands: Sequence[BandConfirmation]) -> Calibration:
    """Calibration factor over bands.

    An SNR measured once scatters by about one around its expectation, so a ratio has the variance
    ``1 / predicted^2`` and the best mean is ``sum(recovered * predicted) / sum(predicted^2)``.
    """
    pairs = [
        (b.predicted_snr, b.recovered_snr) for b in bands if b.predicted_snr and b.recovered_snr is not None
    ]
    if not pairs:
        return Calibration(None, None, 0)
    predicted, recovered = np.array(pairs, float).T
    weight = predicted**2
    ratio = float(np.sum(recovered * predicted) / weight.sum())
    error = 1.0 / math.sqrt(weight.sum())
    if len(pairs) >= 3:
        scatter = float(np.sum(weight * (recovered / predicted - ratio) ** 2) / (len(pairs) - 1))
        error *= math.sqrt(max(scatter, 1.0))
    return Calibration(ratio, error, len(pairs))
