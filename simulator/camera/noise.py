"""The noise model of one pixel in one frame, shared by exposure-time calculator and image checks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simulator.camera.checks import checked_array
from simulator.camera.gain import excess_noise_factor2
from simulator.config.detector import Detector

__all__ = ["aperture_noise_pixels", "pixel_variance_e2"]

# Squares of it are finite.
_MOST = 1e100


def pixel_variance_e2(
    photon_e: npt.ArrayLike, cic_e: npt.ArrayLike, em_gain: npt.ArrayLike, detector: Detector
) -> npt.NDArray[np.float64]:
    """Variance of one pixel of one frame, referred to the register input.

    Parameters
    ----------
    photon_e : array_like
        Mean electrons collected during the exposure (photo-electrons and dark current), 0 to 1e100.
    cic_e : array_like
        Mean clock-induced electrons per frame, 0 to 1e100.
    em_gain : array_like
        Gain of the register, 1 to 1e4.
    detector : Detector
        Gives read noise (electrons at the register output), ADC gain and number of stages.

    Returns
    -------
    ndarray
        ``F^2 (photon + cic) + read_noise^2 / g^2 + (K / g)^2 / 12`` in electrons^2, with ``K`` in e-/ADU;
        arguments broadcast. The last term is the rounding of the converter, uniform as long as the noise
        before it exceeds about half an ADU.

    Raises
    ------
    InputError
        If an argument is negative, not finite or out of range.
    """
    photon = checked_array("photon_e", photon_e, low=0.0, high=_MOST, unit="e-")
    cic = checked_array("cic_e", cic_e, low=0.0, high=_MOST, unit="e-")
    factor2 = excess_noise_factor2(em_gain, detector.register_stages)
    output_variance = detector.read_noise_e**2 + detector.gain_e_adu**2 / 12.0
    return factor2 * (photon + cic) + output_variance / np.square(np.asarray(em_gain, dtype=np.float64))


def aperture_noise_pixels(radius_pixel: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Effective number of pixels that a circular aperture's white noise comes from.

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
    radius = checked_array("radius_pixel", radius_pixel, low=1.0, high=_MOST, unit="px")
    return np.pi * radius * (radius - 1.0 / 3.0)
