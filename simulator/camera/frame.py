"""A raw frame with its truth, as every camera returns it, and the checks of input that cameras share."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntFlag

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, NDArray, element_name

NEGATIVE_TOLERANCE = 1e-9
# More light than this counts as this: that of any exposure and any sum of it stays finite.
MOST_E_S = 1e100


def checked_rates(rate_map_e_s: ArrayLike) -> tuple[FloatArray, int]:
    """Return the rates of a 2-D map with rounding-error negatives set to 0 (those above 1e100 too), and their number.

    Raises
    ------
    InputError
        For an empty map or one of other dimensions, and for NaN, infinity or a rate more negative than 1e-9 of the
        largest, naming the pixel.
    """
    allowed = f"finite and at least 0 (rounding errors to -{NEGATIVE_TOLERANCE:g} of the largest count as 0)"
    key, unit = "rate_map_e_s", "e-/s"
    try:
        rates = np.asarray(rate_map_e_s)
    except ValueError:
        raise InputError(key, type(rate_map_e_s).__name__, unit=unit, allowed="a 2-D (y, x) array") from None
    if rates.dtype.kind not in "iuf" or rates.ndim != 2 or rates.size == 0:
        given = f"{rates.dtype} array of shape {rates.shape}"
        raise InputError(key, given, unit=unit, allowed="a non-empty 2-D (y, x) array of numbers")
    rates = rates.astype(np.float64, copy=False)
    lowest, highest = float(rates.min()), float(rates.max())
    if lowest >= 0.0 and highest <= MOST_E_S:
        return rates, 0
    finite = np.isfinite(rates)
    bad = ~finite if not finite.all() else rates < -NEGATIVE_TOLERANCE * max(highest, 0.0)
    if bad.any():
        name, index = element_name(key, bad)
        raise InputError(name, float(rates[index]), unit=unit, allowed=allowed)
    return np.clip(rates, 0.0, MOST_E_S), int(np.count_nonzero(rates < 0.0))


class MaskBit(IntFlag):
    """Bits of the truth mask: those of the Level-1 data model."""

    GOOD = 0
    BAD = 1
    HOT = 2
    WARM = 4
    SATURATED = 8
    COSMIC_RAY = 16
    SATELLITE_TRAIL = 32


@dataclass(frozen=True, eq=False)
class Frame:
    """One raw frame and its bookkeeping.

    Attributes
    ----------
    adu : ndarray of uint16
        Image in ADU.
    mask : ndarray of uint8
        `MaskBit` of every pixel, same shape: saturated where a limit cut charge off or spilled charge arrived, cosmic
        ray where one left charge, bad and hot from the calibration set.
    charge : mapping of str to float
        Electrons of the whole frame by step: what came in and what was lost where; exact integers as floats.
    n_clipped : int
        Pixels cut off at either end of the converter's range.
    n_saturated_pixels : int
        Pixels filled to the pixel full well.
    n_register_saturated : int
        Pixels filled to the full well of the register.
    n_cosmic_rays : int
        Particles that crossed the frame.
    n_negative_rates : int
        Pixels whose rate was a rounding-error negative and was taken as 0.
    """

    adu: NDArray[np.uint16]
    mask: NDArray[np.uint8]
    charge: Mapping[str, float] = field(default_factory=dict)
    n_clipped: int = 0
    n_saturated_pixels: int = 0
    n_register_saturated: int = 0
    n_cosmic_rays: int = 0
    n_negative_rates: int = 0

    @property
    def lost(self) -> BoolArray:
        """Pixels whose number says nothing about their light: a limit cut them off."""
        return np.asarray((self.mask & MaskBit.SATURATED) != 0)
