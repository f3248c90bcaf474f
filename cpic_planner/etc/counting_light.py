"""White noise of apertures whose photons are counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.photon_counting import CountingLaw, counting_variance

__all__ = ["LIGHT_ARRAYS", "CountingLight", "counted"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CountingLight:
    """Light per pixel in the aperture and how often it enters the variance.

    ``planet_e_s`` and ``quiet_e_s``, everything else, count in ``science_pixels``; ``quiet_e_s`` alone in
    ``mean_pixels`` (of the mean background); ``reference_e_s``, what a reference frame really holds, in
    ``reference_pixels``. ``quiet_e`` and ``reference_e`` are in every frame, whatever its exposure: smear and
    clock-induced charge. The planet's light is spread evenly over the aperture. Without ``own_noise`` it adds none, but
    may still be too much to be counted: the variance is then infinite.
    """

    planet_e_s: FloatArray
    quiet_e_s: FloatArray
    reference_e_s: FloatArray
    quiet_e: FloatArray
    reference_e: FloatArray
    science_pixels: FloatArray
    mean_pixels: FloatArray
    reference_pixels: FloatArray
    law: CountingLaw
    own_noise: bool

    def at(self, mask: NDArray[np.bool_]) -> CountingLight:
        """The cases of a mask, as flat arrays."""
        return replace(self, **{name: getattr(self, name)[mask] for name in LIGHT_ARRAYS})

    def spread(self, shape: tuple[int, ...]) -> CountingLight:
        """Arrays repeated along new first axes."""
        parts: dict[str, Any] = {name: np.broadcast_to(getattr(self, name), shape) for name in LIGHT_ARRAYS}
        return replace(self, **parts)

    @classmethod
    def stacked(cls, lights: Sequence[CountingLight]) -> CountingLight:
        """Lights of one law and shape on a new first axis."""
        parts: dict[str, Any] = {name: np.stack([getattr(light, name) for light in lights]) for name in LIGHT_ARRAYS}
        return replace(lights[0], **parts)

    def frame_variance(self, exposure_s: FloatArray) -> FloatArray:
        """Variance of one science frame's aperture sum with its share of reference frames."""
        quiet = self.quiet_e_s * exposure_s + self.quiet_e
        both = quiet + self.planet_e_s * exposure_s
        reference = self.reference_e_s * exposure_s + self.reference_e
        science = counted(self.science_pixels, both, self.law)
        if not self.own_noise:
            science = np.where(np.isfinite(science), counted(self.science_pixels, quiet, self.law), np.inf)
        mean = counted(self.mean_pixels, quiet, self.law)
        return science + mean + counted(self.reference_pixels, reference, self.law)


def counted(pixels: FloatArray, mean_e: FloatArray, law: CountingLaw) -> FloatArray:
    """Variance of a sum over pixels; 0 over none, however bright they are."""
    with np.errstate(invalid="ignore"):
        return np.where(pixels > 0, pixels * counting_variance(mean_e, law), 0.0)


LIGHT_ARRAYS = (
    "planet_e_s",
    "quiet_e_s",
    "reference_e_s",
    "quiet_e",
    "reference_e",
    "science_pixels",
    "mean_pixels",
    "reference_pixels",
)
