"""Plug-ins of the near-infrared camera: persistence and inter-pixel capacitance, and how to write others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.camera.checks import checked_array, checked_scalar

__all__ = ["Coupling", "ExponentialPersistence", "InterpixelKernel", "PastExposure", "Persistence", "neighbour_kernel"]

FloatArray = npt.NDArray[np.float64]


class PastExposure(NamedTuple):
    """Electrons that an earlier frame collected in every pixel, and the time from its end to the start of this one."""

    charge_e: npt.ArrayLike
    age_s: float


class Persistence(Protocol):
    """What earlier frames leave in a frame."""

    def __call__(self, past: Sequence[PastExposure], exposure_s: float) -> FloatArray:
        """Mean electrons per second and pixel over an exposure (0 means at its start), finite and at least 0."""


class Coupling(Protocol):
    """How the signal of a pixel appears in others."""

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Signal after coupling, of the same shape and sum."""


@dataclass(frozen=True)
class ExponentialPersistence:
    """Traps that catch ``fraction`` of the charge and release it with one decay time.

    A charge ``Q`` that ended ``a`` seconds before an exposure of ``t`` adds
    ``fraction Q (exp(-a / decay) - exp(-(a + t) / decay)) / t`` on average, the released electrons per second.
    """

    fraction: float
    decay_s: float

    def __post_init__(self) -> None:
        checked_scalar("fraction", self.fraction, low=0.0, high=1.0)
        checked_scalar("decay_s", self.decay_s, low=1e-6, high=1e9, unit="s")

    def __call__(self, past: Sequence[PastExposure], exposure_s: float) -> FloatArray:
        """Mean rate over the exposure, e-/s.

        Raises
        ------
        InputError
            For a charge or an age that is negative or not finite, or charges of different shapes.
        """
        rate: FloatArray = np.zeros(())
        for charge_e, age_s in past:
            charge = checked_array("past charge_e", charge_e, low=0.0, unit="e-")
            age = checked_scalar("past age_s", age_s, low=0.0, high=1e12, unit="s")
            if rate.ndim and rate.shape != charge.shape:
                raise InputError("past charge_e", f"shape {charge.shape}", allowed=f"shape {rate.shape}")
            # -expm1(-x)/x -> 1 as the exposure goes to 0
            x = exposure_s / self.decay_s
            share = -math.expm1(-x) / x if x > 0 else 1.0
            rate = rate + charge * (self.fraction / self.decay_s * math.exp(-age / self.decay_s) * share)
        return rate


@dataclass(frozen=True, eq=False)
class InterpixelKernel:
    """Coupling to the eight neighbours by a 3 x 3 kernel of sum 1; what would leave the array stays in its edge.

    ``kernel[1 + dy, 1 + dx]`` is the part of a pixel's signal that appears ``dy`` rows up and ``dx`` columns right.
    """

    kernel: npt.ArrayLike

    def __post_init__(self) -> None:
        kernel = checked_array("interpixel kernel", self.kernel, low=0.0, high=1.0)
        if kernel.shape != (3, 3):
            raise InputError("interpixel kernel", f"shape {kernel.shape}", allowed="shape (3, 3)")
        if abs(float(kernel.sum()) - 1.0) > 1e-9:
            raise InputError("interpixel kernel sum", float(kernel.sum()), allowed="1, so that charge is conserved")

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Coupled signal."""
        kernel = np.asarray(self.kernel, dtype=np.float64)
        rows, columns = signal.shape
        wide = np.zeros((rows + 2, columns + 2))
        for dy in range(3):
            for dx in range(3):
                if kernel[dy, dx] != 0.0:
                    wide[dy : dy + rows, dx : dx + columns] += kernel[dy, dx] * signal
        wide[1] += wide[0]
        wide[-2] += wide[-1]
        wide[:, 1] += wide[:, 0]
        wide[:, -2] += wide[:, -1]
        return wide[1:-1, 1:-1]


def neighbour_kernel(coupling: float) -> InterpixelKernel:
    """Kernel that gives each of the four nearest neighbours the part ``coupling``, 0 to 0.25."""
    a = checked_scalar("interpixel_coupling", coupling, low=0.0, high=0.25)
    return InterpixelKernel([[0.0, a, 0.0], [a, 1.0 - 4.0 * a, a], [0.0, a, 0.0]])
