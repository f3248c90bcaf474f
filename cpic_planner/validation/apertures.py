"""Exact circular apertures, the scatter of their sums over a region, and images as rows of pixels."""

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
    check_number,
    checked_array,
    disc_overlap,
    load_quietly,
    require,
)
from simulator.imaging import Zone


def described(array: np.ndarray) -> str:
    """Return the type and shape of an array, as refusals name it."""
    return f"{array.dtype} array of shape {array.shape}"


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


def check_mask(key: str, value: ArrayLike, shape: tuple[int, ...], *, empty: bool = False) -> BoolArray:
    """Return the pixels as a mask; refused by name if they are no truth values of that shape, or none of them is true.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : array_like
        Pixels that are meant.
    shape : tuple of int
        Shape of the images.
    empty : bool, optional
        Whether all of them may be false.
    """
    mask = np.asarray(value)
    if mask.dtype != np.bool_ or mask.shape != tuple(shape) or not (empty or mask.any()):
        allowed = f"booleans of shape {tuple(shape)}" + ("" if empty else ", some of them true")
        raise InputError(key, described(mask), allowed=allowed)
    return mask


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


def aperture_sum(image: ArrayLike, x_pixel: ArrayLike, y_pixel: ArrayLike, radius_pixel: float) -> FloatArray:
    """Sum inside exact circular apertures.

    Parameters
    ----------
    image : array_like
        Image (y, x), finite.
    x_pixel, y_pixel : array_like
        Centres, broadcast; pixel centres are at integers.
    radius_pixel : float
        Radius, above 0; every circle must lie inside the image.

    Returns
    -------
    ndarray
        One sum per centre, shape of the centres.

    Raises
    ------
    InputError
        If a circle leaves the image, or a number is not finite.
    """
    CircularAperture = load_quietly("photutils.aperture").CircularAperture

    data = checked_image(image)
    x, y = np.broadcast_arrays(np.asarray(x_pixel, dtype=np.float64), np.asarray(y_pixel, dtype=np.float64))
    _check_inside(data.shape, x, y, radius_pixel)
    if x.size == 0:
        return np.zeros(x.shape)
    apertures = CircularAperture(np.column_stack([x.ravel(), y.ravel()]), float(radius_pixel))
    sums, _ = apertures.do_photometry(data, method="exact")
    return np.asarray(sums, dtype=np.float64).reshape(x.shape)


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
