"""Forced photometry: sums in exact apertures, and their error from samples of the background.

Positions are given, never fitted: a free centroid would raise the flux by about ``1 / SNR^2``.
"""

import functools
import math
from collections.abc import Iterable, Sequence

import numpy as np

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    IntArray,
    Reason,
    Record,
    check_mask,
    check_number,
    check_positive,
    checked_array,
    described,
    disc_overlap,
    numeric_context,
    require,
)
from simulator.detectors import excess_noise_factor2
from simulator.imaging import BandGeometry, Zone


def checked_frames(key: str, value: ArrayLike) -> FloatArray:
    """Return the image or images as float64; refused by name if they are no numbers of that shape.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : array_like
        Images, shape (n, y, x).
    """
    images = np.asarray(value)
    if images.dtype.kind not in "iufb" or images.ndim not in (2, 3) or images.size == 0:
        raise InputError(key, described(images), allowed="numbers, (y, x) or (n, y, x)")
    return images.astype(np.float64, copy=False)


def checked_region(key: str, value: ArrayLike | None, shape: tuple[int, ...]) -> BoolArray:
    """Return the pixels (y, x) that take part: a copy; all without any.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : array_like or None
        Pixels that are meant, (y, x).
    shape : tuple of int
        Shape (y, x) of the images.
    """
    return np.ones(shape, dtype=np.bool_) if value is None else check_mask(key, value, shape).copy()


def region_rows(key: str, images: FloatArray, region: BoolArray) -> FloatArray:
    """Return the region pixels of each image as one row, a copy; refused by name if not finite.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    images : ndarray
        Images, shape (n, y, x).
    region : ndarray of bool
        Pixels that are meant, (y, x).
    """
    stack = images.reshape(-1, *images.shape[-2:])
    # Flat indices: several times faster than a mask over two axes.
    rows = stack.reshape(len(stack), -1).take(np.flatnonzero(region), axis=1)
    if not np.isfinite(np.vdot(rows, rows)) and not (finite := np.isfinite(rows)).all():
        frame, pixel = np.unravel_index(int(np.argmin(finite)), rows.shape)
        y, x = np.argwhere(region)[pixel]
        raise InputError(f"{key}[frame={frame}, y={y}, x={x}]", float(rows[frame, pixel]), allowed="finite numbers")
    return rows


def frame_counts(key: str, value: ArrayLike, images: int) -> FloatArray:
    """Return the number of frames in each of so many images, from one number or one each; refused below 1.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : array_like
        Numbers of frames, at least 1.
    images : int
        Number of images.
    """
    counts = np.asarray(value, dtype=np.float64)
    if counts.shape not in ((), (images,)) or not (counts >= 1).all():
        raise InputError(key, value, allowed=f"at least 1, one number or {images} of them")
    return np.broadcast_to(counts, (images,)).copy()


def as_images(rows: FloatArray, region: BoolArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the rows as images of the given shape, 0 outside the region; may share the memory of the rows.

    Parameters
    ----------
    rows : ndarray
        Values of the region's pixels, one image a row, shape (n, k).
    region : ndarray of bool
        Pixels that are meant, (y, x).
    shape : tuple of int
        Shape (y, x) of the images.
    """
    if region.all():
        return rows.reshape(shape)
    images = np.zeros((len(rows), region.size))
    images[:, np.flatnonzero(region)] = rows
    return images.reshape(shape)


def outside_discs(region: BoolArray, places: Iterable[Sequence[float]], radius_pixel: float) -> BoolArray:
    """Return the pixels of a region farther than a radius from every place.

    Parameters
    ----------
    region : ndarray of bool, shape (y, x)
    places : iterable of (x, y)
        Centres of the discs; pixel centres are at integers.
    radius_pixel : float
        Radius of the discs.
    """
    kept = region.copy()
    for x, y in places:
        rows, columns = (
            np.arange(max(math.floor(at - radius_pixel), 0), min(math.ceil(at + radius_pixel) + 1, size))
            for at, size in zip((y, x), region.shape, strict=True)
        )
        if rows.size and columns.size:
            kept[np.ix_(rows, columns)] &= np.hypot(columns - x, rows[:, None] - y) > radius_pixel
    return kept


def edge_crossed(zone: Zone, x_arcsec: float, y_arcsec: float, radius_arcsec: float) -> Reason:
    """Return which edge of the dark hole the aperture of a source crosses that does not lie in it.

    Parameters
    ----------
    zone : HoleZone or RingZone
    x_arcsec, y_arcsec : float
        Offsets of the source from the star on the detector.
    radius_arcsec : float
        Radius of the aperture.
    """
    inner = zone.crosses_inner(x_arcsec, y_arcsec, radius_arcsec)
    return Reason.INSIDE_INNER_EDGE if inner else Reason.OUTSIDE_OUTER_EDGE


MIN_BACKGROUND_APERTURES = 3


def aperture_weights(shape: tuple[int, int], x_pixel: float, y_pixel: float, radius_pixel: float) -> FloatArray:
    """Return the exact overlap of a circle with each pixel of an image.

    Parameters
    ----------
    shape : tuple of int
        Shape (y, x) of the image.
    x_pixel, y_pixel : float
        Centre; pixel centres are at integers.
    radius_pixel : float
        Radius, above 0; the circle must lie inside the image.

    Returns
    -------
    ndarray
        Fractions 0 to 1, (y, x); their sum is ``pi r^2``.

    Raises
    ------
    InputError
        If the circle leaves the image or an argument is not finite.
    """
    _check_inside(shape, np.asarray(x_pixel, dtype=float), np.asarray(y_pixel, dtype=float), radius_pixel)
    centre, radius = np.array([y_pixel, x_pixel], dtype=float), float(radius_pixel)
    first = np.floor(centre - radius + 0.5).astype(int)
    last = np.minimum(np.ceil(centre + radius + 0.5).astype(int), shape)
    # Edges of the pixels around the circle, from its centre.
    y, x = (np.arange(low, high + 1) - 0.5 - middle for low, high, middle in zip(first, last, centre, strict=True))
    weights = np.zeros(shape)
    weights[first[0] : last[0], first[1] : last[1]] = disc_overlap(y, x, radius)
    return weights


def sample_scatter(
    image: ArrayLike,
    region: ArrayLike,
    radius_pixel: float,
    *,
    phase_pixel: tuple[float, float] = (0.0, 0.0),
    kernel: FloatArray | None = None,
) -> tuple[float, int]:
    """Return the standard deviation of aperture sums inside a region, and how many independent apertures it holds.

    Apertures lie wholly inside the region, on square grids of pitch ``ceil(2 r)`` so that none overlap; every
    offset of the grid by whole pixels is used, and the variances about each grid's own mean are pooled. The
    pooled variance is unbiased for uncorrelated pixels, and correlated speckles are included as they are. Where no
    such grid holds 3 apertures, as in the corners of a dark hole, every separate part of the region has its own grid.

    Parameters
    ----------
    image : array_like
        Image (y, x), finite.
    region : array_like of bool
        Allowed pixels, (y, x).
    radius_pixel : float
        Radius, above 0.
    phase_pixel : tuple of float, optional
        Sub-pixel offset (x, y) of the centres, -0.5 to 0.5: that of the aperture the scatter is meant for,
        since the weights of the edge pixels, and with them the noise, depend on it.
    kernel : ndarray, optional
        Weights of the sums instead of those of a circle, at least 0, odd sides; grids keep the pitch of the circles.

    Returns
    -------
    sigma : float
        Standard deviation of the sum in one aperture.
    n_apertures : int
        Number of apertures on the fullest grid.

    Raises
    ------
    InputError
        If no grid holds 3 apertures.
    """
    data = checked_image(image)
    allowed = check_mask("background_region", region, data.shape)
    require("radius_pixel", radius_pixel, math.isfinite(radius_pixel) and radius_pixel > 0, "px", "above 0")
    sides = (np.flatnonzero(allowed.any(axis=axis)) for axis in (1, 0))
    box = tuple(slice(int(side[0]), int(side[-1]) + 1) for side in sides)
    half = math.ceil(radius_pixel + 0.5)
    if kernel is None and 2.0 * radius_pixel <= min(data.shape):
        side = 2 * half + 1
        kernel = aperture_weights((side, side), half + phase_pixel[0], half + phase_pixel[1], radius_pixel)
    y, x, grid, n_apertures = sample_places(allowed[box], radius_pixel, kernel)
    assert kernel is not None  # without one there are no places
    cut = data[box] - data[allowed].mean()
    down, right = np.nonzero(kernel)
    around = (down - len(kernel) // 2) * cut.shape[1] + right - len(kernel) // 2
    sums = cut.ravel().take((y * cut.shape[1] + x)[:, None] + around) @ kernel[down, right]
    held = np.maximum(np.bincount(grid, minlength=1), 1)
    deviation = sums - (np.bincount(grid, weights=sums) / held)[grid]
    return math.sqrt(float(deviation @ deviation) / int(np.sum(held - 1))), n_apertures


def sample_places(
    region: BoolArray, radius_pixel: float, kernel: FloatArray | None
) -> tuple[IntArray, IntArray, IntArray, int]:
    """Return the pixels around which a kernel lies wholly inside a region.

    Parameters
    ----------
    region : ndarray of bool, shape (y, x)
    radius_pixel : float
        Radius of an aperture: the grids have a pitch of twice that, rounded up.
    kernel : ndarray or None
        Weights of a sum, odd sides; None for one that fits nowhere.

    Returns
    -------
    y, x, grid : ndarray of int
        Rows and columns, and the number of the grid that each is part of.
    n_apertures : int
        Places of the fullest grid.

    Raises
    ------
    InputError
        If no grid holds 3 places.
    """
    weighed = np.zeros((0, 0), np.bool_) if kernel is None else kernel > 0
    return _sample_places(region.tobytes(), region.shape, radius_pixel, weighed.tobytes(), weighed.shape)


@functools.lru_cache(maxsize=256)
def _sample_places(
    pixels: bytes, shape: tuple[int, ...], radius_pixel: float, weighed: bytes, sides: tuple[int, ...]
) -> tuple[IntArray, IntArray, IntArray, int]:
    """Return the same for masks given as bytes: every realisation of a programme asks for the same places."""
    from scipy.ndimage import binary_erosion, label

    region, structure = np.frombuffer(pixels, np.bool_).reshape(shape), np.frombuffer(weighed, np.bool_).reshape(sides)
    pitch = math.ceil(2.0 * radius_pixel)
    inside = binary_erosion(region, structure=structure) if structure.size else np.zeros_like(region)
    y, x = np.nonzero(inside)
    grid = (y % pitch) * pitch + x % pitch
    if np.bincount(grid, minlength=1).max() < MIN_BACKGROUND_APERTURES:
        # Apertures in separate parts of the region never overlap: the fullest grids of all parts make one.
        part = label(region)[0][y, x]
        for number in np.unique(part):
            own = part == number
            _, offset, held = np.unique(grid[own], return_inverse=True, return_counts=True)
            grid[own] = np.argsort(np.argsort(-held, kind="stable"), kind="stable")[offset]
    n_apertures = int(np.bincount(grid, minlength=1).max())
    if n_apertures < MIN_BACKGROUND_APERTURES:
        small = f"too small for apertures of radius {radius_pixel:g} px"
        allowed = f"room for at least {MIN_BACKGROUND_APERTURES} of them"
        raise InputError("background_region", small, allowed=allowed)
    for shared in (y, x, grid):
        shared.flags.writeable = False
    return y, x, grid, n_apertures


def checked_image(image: ArrayLike) -> FloatArray:
    """Return an image as floats; refuse what is no plane of real numbers."""
    data = np.asarray(image)
    if data.dtype.kind not in "iuf" or data.ndim != 2 or data.size == 0:
        raise InputError("image", described(data), unit="e-", allowed="one image (y, x)")
    return checked_array("image", data, low=-math.inf, unit="e-", allowed="finite numbers")


def _check_inside(shape: tuple[int, ...], x: FloatArray, y: FloatArray, radius: float) -> None:
    require("radius_pixel", radius, check_number("radius_pixel", radius, "px") > 0, "px", "finite and above 0")
    for key, centre, size in (("x_pixel", x, shape[1]), ("y_pixel", y, shape[0])):
        bad = ~((centre - radius >= -0.5) & (centre + radius <= size - 0.5))
        if bad.any():
            allowed = f"a circle of radius {radius:g} px inside {size} px"
            raise InputError(key, float(centre[bad].flat[0]), unit="px", allowed=allowed)


# Known sources are kept this many aperture radii away from the background region.
EXCLUSION_RADII = 1.5


class Photometry(Record):
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
    `cpic_planner.validation.photometry.sample_scatter` and ``S2`` the source's sum with squared aperture weights (at
    least 0): a pixel counted with weight ``w`` adds ``w^2`` times its variance, which for an aperture of 0.7 lambda/D
    makes ``S2`` 4 to 7 % less than the flux. Without any noise, ``snr`` and ``significance`` are infinite for a source
    and 0 for none.

    The wings of a bright source and the negative image that modes leave of it are no noise. The strength of ``left`` is
    the flux above the mean of the background over the same for ``left`` itself: the light that the model has in the
    background is in both, so that this is the solution, which repeating would not change. Neither does it change the
    flux, whose ``throughput`` counts that light as lost; only the scatter is freed of it.
    """
    data = checked_image(image)
    hole = check_mask("background_region", background_region, data.shape)
    check_positive("throughput", throughput)
    excess = float(excess_noise_factor2(em_gain, stages)) if factor2 is None else factor2
    own_kernel = None if kernel is None else checked_image(kernel)
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
        model = checked_image(left)
        require("left", model.size, model.shape == data.shape, "px", f"one image of {data.shape}")
        empty = without_source(data, model, weights, region)
        pixels = empty[region]
    sigma, n_apertures = sample_scatter(empty, region, radius_pixel, phase_pixel=phase, kernel=own_kernel)
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
        return aperture_weights(shape, x_pixel, y_pixel, radius_pixel)
    half = len(kernel) // 2
    row, column = round(y_pixel), round(x_pixel)
    padded = np.zeros((shape[0] + 2 * half, shape[1] + 2 * half))
    padded[row : row + 2 * half + 1, column : column + 2 * half + 1] = kernel
    return padded[half : half + shape[0], half : half + shape[1]]


def _without_sources(hole: BoolArray, positions: Sequence[tuple[float, float]], radius: float) -> BoolArray:
    for position in positions:
        if len(position) != 2 or not all(math.isfinite(value) for value in position):
            raise InputError("exclude", position, unit="px", allowed="finite pairs (x, y)")
    region = outside_discs(hole, positions, radius)
    if not region.any():
        raise InputError("background_region", "empty", allowed="some pixels away from the known sources")
    return region


def ratio(signal: float, noise: float) -> float:
    """Return the signal over noise; infinite for a signal without noise, 0 for nothing."""
    if noise > 0:
        return signal / noise
    return math.copysign(math.inf, signal) if signal else 0.0


def radius_pixel(geometry: BandGeometry) -> float:
    """Return the radius of the photometric aperture in pixels."""
    return geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec
