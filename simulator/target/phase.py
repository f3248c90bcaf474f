"""Phase function of a Lambert sphere."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from catalogs.errors import InputError
from simulator.quantities import real_array

__all__ = ["lambert_phase", "sin_phase"]

# Below this angle sin d - d cos d loses digits; its Taylor series, with these terms, does not.
_SERIES_BELOW_RAD = 1.0
_SERIES_TERMS = 10


def lambert_phase(phase_deg: ArrayLike) -> np.ndarray | float:
    """Return the Lambert phase function, 1 at full phase, 1/pi at 90 deg, 0 at 180 deg.

    ``[sin a + (pi - a) cos a] / pi`` for phase angle a (Russell 1916; Eq. 1 of Zhu et al. 2025). It is
    computed from d = 180 deg - a, where it reads ``(sin d - d cos d) / pi``: the difference is exact in
    degrees, and a series replaces the cancelling terms near new phase, so that the relative error stays at
    rounding up to 180 deg.

    Parameters
    ----------
    phase_deg : array_like
        Phase angle, 0 to 180 degrees.

    Returns
    -------
    ndarray or float
        Same shape; a float for a scalar.

    Raises
    ------
    InputError
        If an angle is not within 0 to 180.
    """
    supplement = np.deg2rad(180.0 - checked_phase(phase_deg))
    small = supplement < _SERIES_BELOW_RAD
    result = np.where(
        small,
        _series(np.where(small, supplement, 0.0)),
        np.sin(supplement) - supplement * np.cos(supplement),
    )
    return _plain(result / np.pi)


def sin_phase(phase_deg: ArrayLike) -> np.ndarray | float:
    """Return the sine of a phase angle, exactly 0 at both 0 and 180 degrees, to full relative precision.

    Raises
    ------
    InputError
        If an angle is not within 0 to 180.
    """
    phase = checked_phase(phase_deg)
    return _plain(np.sin(np.deg2rad(np.minimum(phase, 180.0 - phase))))


def checked_phase(phase_deg: ArrayLike) -> np.ndarray:
    """Return phase angles as float64; refuse what is not within 0 to 180 degrees."""
    phase = real_array("phase_deg", phase_deg, "deg")
    inside = (phase >= 0.0) & (phase <= 180.0)
    if not np.all(inside):
        raise InputError("phase_deg", float(phase[~inside].flat[0]), unit="deg", allowed="0 to 180")
    return phase


def _series(d: np.ndarray) -> np.ndarray:
    """Return sin d - d cos d = sum over k >= 1 of (-1)^(k+1) 2k d^(2k+1) / (2k+1)!."""
    square = d * d
    total = np.zeros_like(d)
    for k in range(_SERIES_TERMS, 0, -1):
        # Horner from the smallest term; ratio of coefficients k+1 to k is -1 / (2k (2k+3)).
        total = 1.0 - total * square / (2.0 * k * (2.0 * k + 3.0))
    result: np.ndarray = d * square * total / 3.0
    return result


def _plain(array: np.ndarray) -> np.ndarray | float:
    return float(array) if array.ndim == 0 else array
