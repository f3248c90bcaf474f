"""What an effect of the camera is, and what it works on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from simulator.config.detector import Detector

__all__ = ["KERNELS", "LIMIT_KERNELS", "Effect", "Exposure", "Place", "Work"]

KERNELS = "simulator.camera.kernels"
LIMIT_KERNELS = "simulator.camera.limit_kernels"

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Place:
    """Where an array of pixels lies on the detector.

    Attributes
    ----------
    rows, columns : slice
        Part of the array that is made of pixels, light-sensitive or shielded; the rest is clocked out of none.
    first_row, first_column : int
        Row and column of the frame that the array begins with.
    whole : bool
        Whether the array is the whole frame.
    """

    rows: slice
    columns: slice
    first_row: int
    first_column: int
    whole: bool


@dataclass(frozen=True, eq=False)
class Exposure:
    """The noise-free part of a frame: made once, exposed many times.

    Attributes
    ----------
    mean_e : ndarray
        Mean electrons collected by every pixel: light, smear and dark current.
    zero : ndarray
        ``exp(-mean_e)``, the chance of none.
    cic_e : ndarray or None
        Mean clock-induced electrons per pixel where they differ; else ``detector.cic_e`` everywhere.
    stripe_adu, bias_adu : ndarray or None
        Fixed structure of the bias: per column, and a whole map.
    flaws : ndarray of uint8 or None
        Bits of `simulator.camera.MaskBit` that belong to the pixels themselves.
    smear_e : ndarray or None
        Of ``mean_e``, what the light of the other rows leaves during the transfer; None without smear.
    """

    detector: Detector
    place: Place
    exposure_s: float
    em_gain: float
    mean_e: FloatArray
    zero: FloatArray
    cic_e: FloatArray | None = None
    stripe_adu: FloatArray | None = None
    bias_adu: FloatArray | None = None
    flaws: npt.NDArray[np.uint8] | None = None
    smear_e: FloatArray | None = None
    n_negative_rates: int = 0


@dataclass(eq=False)
class Work:
    """A frame in the making: electrons, then ADU, with its bookkeeping."""

    image: FloatArray
    saturated: BoolArray
    cosmic: BoolArray | None = None
    charge: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def book(self, step: str, electrons: float) -> None:
        """Enter electrons of the whole frame under the name of a step."""
        self.charge[step] = self.charge.get(step, 0.0) + float(electrons)


class Effect(Protocol):
    """One effect of the camera.

    ``switch`` is the name of its switch in the configuration and of its random stream. `expect` does to a mean image
    what the effect does on average; `draw` does it to one frame. Both work in place.
    """

    @property
    def switch(self) -> str:
        """Name of the switch."""

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Change the mean image."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Change one frame."""
