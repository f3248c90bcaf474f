"""Variance of the electrons in a pixel, an aperture and a stack of frames: one law for all who predict or measure it.

Electrons that a camera collects are counted with the excess noise of its gain register, and what is added behind the
register is divided by the gain: ``F^2 charge + output / g^2``, referred to the register input. Without a register
``F^2`` is 1, or what a fitted ramp makes of the light.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray, checked_array

# Squares of it are finite.
MOST = 1e100
# Beyond this exponent no frame is clean, exp(-600) = 3e-261 of them; sums of what it multiplies stay finite.
_ALL_VOID = 600.0


def frame_variance_e2(charge_e: Any, factor2: Any, output_e2: Any, em_gain: Any) -> Any:
    """Return the variance of electrons of one frame, referred to the register input; no checks.

    Parameters
    ----------
    charge_e : ndarray or float
        Mean electrons at the register input, e-: of a pixel, or of a sum of pixels.
    factor2 : ndarray or float
        Squared excess noise factor.
    output_e2 : ndarray or float
        Variance added behind the register, e-^2.
    em_gain : ndarray or float
        Gain of the register, at least 1.

    Returns
    -------
    ndarray or float
        ``F^2 charge + output / g^2``; arguments broadcast.
    """
    return factor2 * charge_e + output_e2 / em_gain**2


class FrameTerm(NamedTuple):
    """The variance that one origin adds to a sum of one frame.

    Attributes
    ----------
    rate_e_s : ndarray or float
        Electrons per second of exposure.
    charge_e : ndarray or float
        Electrons in every frame, whatever its exposure.
    output_e2 : ndarray or float
        Variance added behind the register, e-^2.
    of_past : float
        Electrons for each of those that the frames before collected, where all have the same light.
    """

    rate_e_s: FloatArray | float = 0.0
    charge_e: FloatArray | float = 0.0
    output_e2: FloatArray | float = 0.0
    of_past: float = 0.0

    def variance_e2(
        self, exposure_s: ArrayLike, factor2: ArrayLike, em_gain: ArrayLike, past_e: ArrayLike = 0.0
    ) -> FloatArray:
        """Return the variance of an exposure, referred to the register input, e-^2.

        Parameters
        ----------
        exposure_s : array_like
            Of the frame.
        factor2, em_gain : array_like
            As of `frame_variance_e2`.
        past_e : array_like
            Electrons that each of the frames before collected.
        """
        charge = (
            self.rate_e_s * np.asarray(exposure_s, float) + self.charge_e + self.of_past * np.asarray(past_e, float)
        )
        return np.asarray(frame_variance_e2(charge, factor2, self.output_e2, em_gain))

    @classmethod
    def total(cls, terms: "Iterable[FrameTerm]") -> "FrameTerm":
        """Return the sum of independent terms."""
        return cls(*(sum(part) for part in zip(*terms, strict=True)))

    def over(self, pixels: ArrayLike, light_e_s: ArrayLike, light_e: ArrayLike) -> "FrameTerm":
        """Return the term of a sum of pixels, in every frame of which light leaves the same; nothing is left of past.

        Parameters
        ----------
        pixels : array_like
            How many they are, or the sum of their squared weights.
        light_e_s, light_e : array_like
            Electrons of the sum that come with time, and in every frame.
        """
        area, rate, charge = (np.asarray(part, float) for part in (pixels, light_e_s, light_e))
        return FrameTerm(
            area * self.rate_e_s + self.of_past * rate,
            area * self.charge_e + self.of_past * charge,
            area * self.output_e2,
        )


def ramp_factors(readout_mode: str, n_reads: int) -> tuple[float, float]:
    """Return what reading several times without destroying the charge makes of noise.

    Parameters
    ----------
    readout_mode : {"single", "cds", "up_the_ramp"}
    n_reads : int
        Reads of a ramp, at least 2.

    Returns
    -------
    reads, light : float
        Variance of the result over that of one read, and over the mean of the light. Double sampling has twice the
        variance of a read; a line through ``n`` equally spaced reads has ``12 (n - 1) / (n (n + 1))`` of it, and
        ``6 (n^2 + 1) / (5 n (n + 1))`` times the variance of the light (Garnett & Forrest 1993, SPIE 1946, 395).
    """
    n = n_reads
    if readout_mode == "up_the_ramp":
        return 12.0 * (n - 1) / (n * (n + 1)), 6.0 * (n**2 + 1) / (5.0 * n * (n + 1))
    return (1.0 if readout_mode == "single" else 2.0), 1.0


def aperture_noise_pixels(radius_pixel: ArrayLike) -> FloatArray:
    """Return the effective number of pixels that a circular aperture's white noise comes from.

    An exact aperture counts its edge pixels with weights ``w`` below 1, so that the variance of its sum is
    ``sum(w^2)``, not ``sum(w) = pi r^2``, times that of a pixel. On average over sub-pixel positions the edge
    takes ``w (1 - w) = 1/6`` per pixel of circumference: ``sum(w^2) = pi r^2 - pi r / 3``.

    Parameters
    ----------
    radius_pixel : array_like
        Radius in pixels, 1 to 1e100.

    Returns
    -------
    ndarray
        ``pi r^2 - pi r / 3``; within 2 % of the mean over positions at r = 1, 0.2 % beyond 2.

    Raises
    ------
    InputError
        If a radius is out of range or not finite.
    """
    radius = checked_array("radius_pixel", radius_pixel, low=1.0, high=MOST, unit="px")
    return np.pi * radius * (radius - 1.0 / 3.0)


def clean_fraction(loss_per_s: ArrayLike, exposure_s: ArrayLike) -> FloatArray:
    """Return the fraction of frames whose aperture no track touches, ``exp(-loss_per_s exposure_s)``.

    Parameters
    ----------
    loss_per_s : array_like
        Rate of tracks that touch the aperture (`simulator.camera.noise.aperture_loss_per_s`), at least 0.
    exposure_s : array_like
        Exposure of a frame, at least 0.

    Returns
    -------
    ndarray
        0 to 1; arguments broadcast.

    Raises
    ------
    InputError
        If an argument is negative or not finite.
    """
    loss = checked_array("loss_per_s", loss_per_s, low=0.0, unit="1/s")
    exposure = checked_array("exposure_s", exposure_s, low=0.0, unit="s")
    with np.errstate(over="ignore"):  # an infinite number of tracks leaves no frame
        return np.asarray(np.exp(-loss * exposure))


def frames_per_clean(loss_per_s: ArrayLike, exposure_s: ArrayLike) -> FloatArray:
    """Return the frames to take for one that no track touches, at most 4e260; no checks.

    Parameters
    ----------
    loss_per_s, exposure_s : array_like
        As of `clean_fraction`, whose inverse this is.
    """
    return np.asarray(np.exp(np.minimum(np.asarray(loss_per_s, float) * exposure_s, _ALL_VOID)))
