"""Forced aperture photometry of a planet, its error from aperture-sized samples, and its contrast.

Positions are given, never fitted: a free centroid would raise the flux by about ``1 / SNR^2``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    check_number,
    check_positive,
    numeric_context,
    require,
)
from cpic_planner.validation import apertures
from simulator.detectors import excess_noise_factor2

# Known sources are kept this many aperture radii away from the background region.
EXCLUSION_RADII = 1.5


@dataclass(frozen=True)
class Contrast:
    """Planet-to-star ratio and its 1-sigma error (dimensionless)."""

    value: float
    error: float


@dataclass(frozen=True)
class Photometry:
    """Photometry of one position; electrons of the summed stack.

    Attributes
    ----------
    flux : float
        Aperture sum minus background, divided by ``throughput``.
    error : float
        1-sigma error of ``flux``: scatter of background apertures, error of the background mean, and the
        source's own noise, divided by ``throughput``.
    snr : float
        ``flux / error``.
    significance : float
        ``flux`` over the scatter alone (no planet noise); compare with `detection_threshold`.
    raw_flux : float
        Aperture sum minus background, as measured.
    sigma_background : float
        Standard deviation of the sum in one aperture, from samples in the background region.
    n_background_apertures : int
        Most non-overlapping apertures that fit in the background region on one square grid.
    error_rel_uncertainty : float
        Relative 1-sigma uncertainty of ``sigma_background``, ``1 / sqrt(2 (n - 1))`` with the number above.
    background_per_pixel : float
        Mean of the background region, light of the source that the reduction spread there included.
    aperture_area_pixels, background_area_pixels : float, int
        Areas.
    throughput : float
        Throughput that was divided out.
    flux_paper_error : float
        Eq. 4 of the paper, ``sqrt(S0 + sigma_s^2 a0 (1 + a0/a_s))`` for ``raw_flux``, with ``sigma_s`` the
        pixel scatter in electrons: no excess noise, pixels taken as independent, no throughput. For
        comparison only.
    snr_paper : float
        ``raw_flux / flux_paper_error``.
    """

    flux: float
    error: float
    snr: float
    significance: float
    raw_flux: float
    sigma_background: float
    n_background_apertures: int
    error_rel_uncertainty: float
    background_per_pixel: float
    aperture_area_pixels: float
    background_area_pixels: int
    throughput: float
    flux_paper_error: float
    snr_paper: float

    def contrast(
        self, core: float, star_rate_e_s: float, time_s: float, *, star_rate_error_e_s: float = 0.0
    ) -> Contrast:
        """Return the contrast of this source; see the function `contrast`.

        Parameters
        ----------
        core : float
            Energy of a unit source in its aperture.
        star_rate_e_s : float
            Rate of the unmasked star, e-/s.
        time_s : float
            Wall time, s, overheads and reference frames included.
        star_rate_error_e_s : float, optional
            Its standard error, e-/s.
        """
        return contrast(
            self.raw_flux,
            self.throughput,
            core,
            star_rate_e_s,
            time_s,
            error=self.error * self.throughput,
            star_rate_error_e_s=star_rate_error_e_s,
        )


def contrast(
    flux: float,
    throughput: float,
    core: float,
    star_rate_e_s: float,
    time_s: float,
    *,
    error: float = 0.0,
    star_rate_error_e_s: float = 0.0,
) -> Contrast:
    """Return the planet-to-star ratio from an aperture flux.

    Parameters
    ----------
    flux : float
        Electrons in the aperture above background, not yet corrected for ``throughput``.
    throughput : float
        Fraction of the aperture flux that the reduction leaves, above 0 (`RdiResult.throughput`).
    core : float
        Aperture energy at the planet's position over the energy on the clear pupil, above 0 and at most 1.
    star_rate_e_s : float
        Detected rate of the star on the clear pupil (no mask, apodizer or aperture), above 0.
    time_s : float
        Summed exposure of the stack, above 0.
    error, star_rate_error_e_s : float, optional
        1-sigma errors of ``flux`` and of the star's rate; independent, added in quadrature.

    Returns
    -------
    Contrast
        ``flux / (throughput core star_rate time)`` and its error.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.
    """
    for key, value in {"throughput": throughput, "core": core}.items():
        check_positive(key, check_number(key, value))
    check_positive("star_rate_e_s", check_number("star_rate_e_s", star_rate_e_s, "e-/s"), "e-/s")
    check_positive("time_s", check_number("time_s", time_s, "s"), "s")
    require("core", core, core <= 1, "", "above 0 and at most 1")
    check_number("flux", flux, "e-")
    for key, value, unit in (("error", error, "e-"), ("star_rate_error_e_s", star_rate_error_e_s, "e-/s")):
        require(key, value, check_number(key, value, unit) >= 0, unit, "finite and at least 0")
    full_scale = float(throughput) * float(core) * float(star_rate_e_s) * float(time_s)
    allowed = "a star whose light over the whole time is a finite number above 0"
    product = "throughput x core x star_rate_e_s x time_s"
    require(product, full_scale, 0 < full_scale < math.inf, "e-", allowed)
    value = flux / full_scale
    spread = math.hypot(error / full_scale, value * (star_rate_error_e_s / star_rate_e_s))
    finite = math.isfinite(value) and math.isfinite(spread)
    require("contrast", value, finite, "", "a finite ratio with a finite error")
    return Contrast(value, spread)


@numeric_context()
def aperture_photometry(
    image: ArrayLike,
    x_pixel: float,
    y_pixel: float,
    radius_pixel: float,
    *,
    background_region: ArrayLike,
    exclude: Sequence[tuple[float, float]] = (),
    throughput: float = 1.0,
    em_gain: float = 1.0,
    stages: int = 604,
    factor2: float | None = None,
    kernel: ArrayLike | None = None,
    left: ArrayLike | None = None,
) -> Photometry:
    """Return the flux of a source at a given position, with empirical errors.

    Parameters
    ----------
    image : array_like
        Summed stack in electrons at the register input, (y, x), finite.
    x_pixel, y_pixel : float
        Position of the source; pixel centres are at integers.
    radius_pixel : float
        Radius of the aperture, above 0; it must lie inside the image.
    background_region : array_like of bool
        The dark hole, (y, x). Discs of 1.5 aperture radii around the source and around every position of
        ``exclude`` are taken out of it here.
    exclude : sequence of (x, y), optional
        Positions of other known sources.
    throughput : float, optional
        Fraction of the aperture flux that the reduction leaves, above 0 (`RdiResult.throughput`).
    em_gain, stages : float, int, optional
        Gain (1 to 1e4) and stages of the register: they set the excess noise of the source's own electrons.
    factor2 : float, optional
        Variance over mean of these electrons, instead of that of a register.
    kernel : array_like, optional
        Weights of a sum instead of those of a circle, (k, k) with k odd, for the pixel in their middle, which is the
        one nearest to the source (`kernel_at`). The ``throughput`` has to be that of the same sum.
    left : array_like, optional
        Forward model of the source, (y, x), any scale: what the reduction leaves of its light everywhere
        (`RdiResult.project`). It is taken off the background before the scatter is measured. Without it, the source
        is taken to have no light beyond 1.5 aperture radii.

    Returns
    -------
    Photometry

    Raises
    ------
    InputError
        If an argument is out of range, a pixel is not finite, the background region holds fewer than 3
        non-overlapping apertures, or nothing is left of the source in its aperture.

    Notes
    -----
    ``Var(flux) = [F^2 S2 + sigma^2 (1 + a0/a_s)] / throughput^2`` with ``sigma`` from
    `cpic_planner.validation.apertures.sample_scatter` and ``S2`` the source's sum with squared aperture weights (at
    least 0): a pixel counted with weight ``w`` adds ``w^2`` times its variance, which for an aperture of 0.7 lambda/D
    makes ``S2`` 4 to 7 % less than the flux. Without any noise, ``snr`` and ``significance`` are infinite for a source
    and 0 for none.

    The wings of a bright source and the negative image that modes leave of it are no noise. The strength of ``left`` is
    the flux above the mean of the background over the same for ``left`` itself: the light that the model has in the
    background is in both, so that this is the solution, which repeating would not change. Neither does it change the
    flux, whose ``throughput`` counts that light as lost; only the scatter is freed of it.
    """
    data = apertures.checked_image(image)
    hole = apertures.check_mask("background_region", background_region, data.shape)
    check_positive("throughput", throughput)
    excess = float(excess_noise_factor2(em_gain, stages)) if factor2 is None else factor2
    own_kernel = None if kernel is None else apertures.checked_image(kernel)
    weights = sum_weights(data.shape, x_pixel, y_pixel, radius_pixel, own_kernel)
    region = _without_sources(hole, [(x_pixel, y_pixel), *exclude], EXCLUSION_RADII * radius_pixel)
    phase = (x_pixel - round(x_pixel), y_pixel - round(y_pixel))
    pixels = data[region]
    area, area_background = math.pi * radius_pixel**2, pixels.size
    if own_kernel is not None:
        area = float(own_kernel.sum() ** 2 / np.sum(own_kernel**2))
    level = float(pixels.mean())
    source = data - level
    raw = float(np.sum(weights * source))
    own = max(float(np.sum(weights**2 * source)), 0.0)
    empty = data
    if left is not None:
        model = apertures.checked_image(left)
        require("left", model.size, model.shape == data.shape, "px", f"one image of {data.shape}")
        empty = without_source(data, model, weights, region)
        pixels = empty[region]
    sigma, n_apertures = apertures.sample_scatter(empty, region, radius_pixel, phase_pixel=phase, kernel=own_kernel)
    raw_error = math.sqrt(sigma**2 * (1.0 + area / area_background) + excess * own)
    paper = math.sqrt(max(raw, 0.0) + float(pixels.var(ddof=1)) * area * (1.0 + area / area_background))
    return Photometry(
        flux=raw / throughput,
        error=raw_error / throughput,
        snr=ratio(raw, raw_error),
        significance=ratio(raw, sigma),
        raw_flux=raw,
        sigma_background=sigma,
        n_background_apertures=n_apertures,
        error_rel_uncertainty=1.0 / math.sqrt(2.0 * (n_apertures - 1)),
        background_per_pixel=level,
        aperture_area_pixels=area,
        background_area_pixels=area_background,
        throughput=float(throughput),
        flux_paper_error=paper,
        snr_paper=ratio(raw, paper),
    )


def without_source(image: FloatArray, left: FloatArray, weights: FloatArray, background: BoolArray) -> FloatArray:
    """Return an image without the light of a source: the sum that measures it is 0 above the mean of the background.

    Parameters
    ----------
    image, left : ndarray, shape (y, x)
        Image, and what the reduction leaves in it of the source, any scale.
    weights : ndarray, shape (y, x)
        Of the sum that measures the source.
    background : ndarray of bool, shape (y, x)

    Raises
    ------
    InputError
        If nothing is left of the source in the sum.
    """
    measured, modelled = (float(np.sum(weights * (part - part[background].mean()))) for part in (image, left))
    check_positive("sum of left in the aperture", modelled)
    return image - measured / modelled * left


def kernel_at(image: FloatArray, x_pixel: float, y_pixel: float, reach_pixel: float) -> FloatArray:
    """Return the image of a source around its nearest pixel, cut to a disc, as weights of a matched filter.

    Parameters
    ----------
    image : ndarray, shape (y, x)
        Of the source alone, any scale.
    x_pixel, y_pixel : float
        Place of the source; pixel centres are at integers.
    reach_pixel : float
        Radius of the disc, above 0.

    Returns
    -------
    ndarray, shape (2 k + 1, 2 k + 1)
        ``k`` is the radius, rounded up; 0 beyond the disc and the image.
    """
    half = math.ceil(reach_pixel)
    row, column = round(y_pixel), round(x_pixel)
    padded = np.pad(np.asarray(image, dtype=np.float64), half)
    cut = padded[row : row + 2 * half + 1, column : column + 2 * half + 1]
    offset = np.arange(-half, half + 1)
    away = np.hypot(offset[:, None] + row - y_pixel, offset + column - x_pixel)
    return np.where(away <= reach_pixel, cut, 0.0)


def sum_weights(
    shape: tuple[int, int], x_pixel: float, y_pixel: float, radius_pixel: float, kernel: FloatArray | None = None
) -> FloatArray:
    """Return the weight of every pixel of an image in the sum that measures a source, (y, x).

    Parameters
    ----------
    shape : tuple of int
        Shape (y, x) of the image.
    x_pixel, y_pixel : float
        Place of the source; pixel centres are at integers.
    radius_pixel : float
        Radius of a circle, above 0.
    kernel : ndarray, optional
        Weights around the pixel nearest to the source instead, odd sides; what lies beyond the image is cut off.
    """
    if kernel is None:
        return apertures.aperture_weights(shape, x_pixel, y_pixel, radius_pixel)
    half = len(kernel) // 2
    row, column = round(y_pixel), round(x_pixel)
    padded = np.zeros((shape[0] + 2 * half, shape[1] + 2 * half))
    padded[row : row + 2 * half + 1, column : column + 2 * half + 1] = kernel
    return padded[half : half + shape[0], half : half + shape[1]]


def _without_sources(hole: BoolArray, positions: Sequence[tuple[float, float]], radius: float) -> BoolArray:
    for position in positions:
        if len(position) != 2 or not all(math.isfinite(value) for value in position):
            raise InputError("exclude", position, unit="px", allowed="finite pairs (x, y)")
    region = apertures.outside_discs(hole, positions, radius)
    if not region.any():
        raise InputError("background_region", "empty", allowed="some pixels away from the known sources")
    return region


def ratio(signal: float, noise: float) -> float:
    """Return the signal over noise; infinite for a signal without noise, 0 for nothing."""
    if noise > 0:
        return signal / noise
    return math.copysign(math.inf, signal) if signal else 0.0
