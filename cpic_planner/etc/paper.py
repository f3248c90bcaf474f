"""The signal-to-noise ratio of Zhu et al. 2025 (Eqs. 3 and 4) as a prediction: for comparison, never for a decision."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.camera import FrameCamera
from cpic_planner.etc.noise import light_factor2, white_term
from cpic_planner.etc.rates import ApertureRates
from simulator.camera.gain import GAIN_LIMIT
from simulator.quantities import checked_array, checked_scalar
from simulator.signal.variance import clean_fraction

FloatArray = NDArray[np.float64]

SPECKLE_COHERENCE = 0.37
"""Variance of aperture sums of residual speckles over what pixels in step would give, ``a0^2 sigma_pixel^2``: mean of
the four visible bands, measured on images of the shipped holes at a visit offset of 0.05 nm (0.47 in F520, 0.28 in
F850); 0.7 beyond 0.5 nm."""


def snr_paper(
    rates: ApertureRates,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    camera: FrameCamera,
    background_pixels: ArrayLike | None = None,
    *,
    reference_ratio: float = 1.0,
) -> FloatArray:
    """Signal over the error of Eq. 4, ``S0 / sqrt(S0 + sigma_s^2 a0 (1 + a0 / a_s))``.

    Parameters
    ----------
    rates : ApertureRates
    exposure_s, n_frames, em_gain : array_like
        One frame (s), number of science frames, gain of the register (1 to 1e4); broadcast with the rates.
    camera : FrameCamera
    background_pixels : array_like, optional
        Pixels ``a_s`` of the background region, above 0; those of the annulus around the planet by default.
    reference_ratio : float, optional
        Reference frames per science frame, above 0.

    Returns
    -------
    ndarray
        Expectation of ``snr_paper`` of `cpic_planner.validation.photometry.aperture_photometry`; 0 without signal.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.

    Notes
    -----
    ``S0`` is the planet's charge in the aperture of the summed stack, as the projection leaves it (Eq. 3, whose
    background subtraction is unbiased); ``sigma_s`` the expected scatter of the pixels of the background, in electrons:
    white noise of the science frames and their share of the reference frames, and the speckles that are left, as one
    pixel shows them; ``a0`` the area of the aperture. Frames whose aperture a particle hits are left out of both.

    It is not the error of a measurement, in five ways: (1) the planet's own noise lacks the excess noise of the
    register, ``F^2``, up to a factor of 2 in variance; (2) printed, ``sigma_s`` is in units of the converter while
    ``S0`` is in electrons: here both are electrons; (3) speckles are as large as the aperture, and pixels that go up
    and down together do not average as ``sigma_s^2 a0`` has it: the variance is up to 20 times larger; (4) there is no
    throughput of the subtraction, nor a correction for the few apertures that the scatter is known from; (5) ``K``
    counts photo-electrons, not photons, and the errors of the calibrating star, of rounding and of the sum of frames
    are left open.
    """
    exposure = checked_array("exposure_s", exposure_s, low=0.0, unit="s")
    frames = checked_array("n_frames", n_frames, low=0.0)
    ratio = checked_scalar("reference_ratio", reference_ratio, low=1e-6, high=1e6)
    area = rates.aperture_pixels
    if background_pixels is None:
        region = rates.background_apertures * area
    else:
        region = checked_array("background_pixels", background_pixels, low=1e-6, unit="px")
    gain = checked_array("em_gain", em_gain, low=1.0, high=GAIN_LIMIT)
    kept = frames * clean_fraction(rates.loss_per_s, exposure)
    own = rates.rdi_throughput * rates.planet_e_s * exposure * kept
    frame = white_term(rates, camera, ratio)
    white = kept * frame.variance_e2(exposure, light_factor2(camera, gain), gain) / area
    together = rates.residual.variance(frames * (exposure + camera.readout_s)) / area**2
    pixel_variance = white + (kept * exposure) ** 2 * together / SPECKLE_COHERENCE
    variance = (own + pixel_variance * area * (1.0 + area / region)) * rates.variance_factor
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(own > 0, own / np.sqrt(variance), 0.0))
