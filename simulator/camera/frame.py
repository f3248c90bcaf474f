"""One raw frame with its truth: what every camera gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntFlag

import numpy as np
import numpy.typing as npt


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

    adu: npt.NDArray[np.uint16]
    mask: npt.NDArray[np.uint8]
    charge: Mapping[str, float] = field(default_factory=dict)
    n_clipped: int = 0
    n_saturated_pixels: int = 0
    n_register_saturated: int = 0
    n_cosmic_rays: int = 0
    n_negative_rates: int = 0

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """Pixels whose number says nothing about their light: a limit cut them off."""
        result: npt.NDArray[np.bool_] = (self.mask & MaskBit.SATURATED) != 0
        return result
