"""Extended sources as grids of point fluxes on the detector.

Light is dealt out in small parcels, each to the four grid points around it in proportion to how near they are. That
keeps the total and the centre of light exactly, sharp edges and edge-on discs included, and widens an image by at most
half a step rms. Parcels of a disc are cells of rings in its own plane, whose light is known in closed form; those of an
image are equal parts of its pixels.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError
from simulator.config import DiscSource, ExtendedSource, ImageSource, RingSource
from simulator.config.map_files import pixel_scale, read_maps, real_map
from simulator.target import sky_to_detector

PARCELS_PER_STEP = 3
MAX_POINTS = 6001
"""Largest number of grid points a side."""
CHUNK = 1 << 19
RING_SIGMAS = 6.0
SCALE_TOLERANCE = 1e-3
FWHM_PER_SIGMA = 2.0 * math.sqrt(2.0 * math.log(2.0))


class ExtendedGrid(NamedTuple):
    """Point fluxes on a regular grid of the detector.

    Attributes
    ----------
    x_arcsec, y_arcsec : ndarray, shapes (n_x,) and (n_y,)
        Axes, arcsec from the star, ascending whole multiples of the step.
    flux : ndarray, shape (n_y, n_x)
        Fraction of the source's light at each point; sums to 1, or to what lies within the reach asked for.
    """

    x_arcsec: FloatArray
    y_arcsec: FloatArray
    flux: FloatArray


_Parcels: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
# Offsets from the centre of the source on the sky toward east and toward north, and the light there.


def render_extended(
    source: ExtendedSource,
    *,
    step_arcsec: float,
    roll_deg: float = 0.0,
    parity: int = -1,
    reach_arcsec: float | None = None,
) -> ExtendedGrid:
    """Deal out the light of an extended source to a grid on the detector.

    Parameters
    ----------
    source : DiscSource, RingSource or ImageSource
    step_arcsec : float
        Step of the grid, above 0. On the telescope's image the grid is seen as a slight blur that goes with the square
        of the step: at a quarter of a detector pixel at most 0.05 % of the peak for a face-on disc and 0.2 % for
        one seen edge-on or a ring of a pixel's width; four times that at half a pixel.
    roll_deg : float
        Roll of the telescope; it turns the sky on the detector.
    parity : {-1, +1}
        Orientation of the detector.
    reach_arcsec : float, optional
        Leave out what lies beyond ``|x|`` or ``|y|`` of this; the whole source if omitted.

    Returns
    -------
    ExtendedGrid

    Raises
    ------
    InputError
        If the step or reach is not above 0, the grid would have more than 6001 points a side, or an image cannot be
        read, has no pixel scale, or is not finite and non-negative.
    """
    for name, value in (("step_arcsec", step_arcsec), ("reach_arcsec", reach_arcsec)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(name, value, unit="arcsec", allowed="above 0")
    limit = math.inf if reach_arcsec is None else math.sqrt(2.0) * reach_arcsec + source.center_separation_arcsec
    if isinstance(source, ImageSource):
        picture = _read(source)
        extent = picture.extent_arcsec
        parcels = _image_parcels(picture, source.pa_deg, step_arcsec, limit)
    else:
        extent = _outer(source)
        parcels = _disc_parcels(source, step_arcsec, limit)
    # The map from sky to detector is linear: the offsets of one arcsec toward east and north tell all of it.
    separations_arcsec = [source.center_separation_arcsec, 1.0, 1.0]
    angles_deg = [source.center_pa_deg, 90.0, 0.0]
    x, y = sky_to_detector(separations_arcsec, angles_deg, roll_deg=roll_deg, parity=parity)
    x_axis, y_axis = (_axis(float(part[0]), extent, step_arcsec, reach_arcsec) for part in (x, y))
    flux = np.zeros((y_axis.size, x_axis.size))
    for east, north, light in parcels:
        column = (x[0] + east * x[1] + north * x[2] - x_axis[0]) / step_arcsec
        row = (y[0] + east * y[1] + north * y[2] - y_axis[0]) / step_arcsec
        _deal(flux, column, row, light)
    return ExtendedGrid(x_axis, y_axis, flux)


def _axis(middle: float, extent: float, step: float, reach: float | None) -> FloatArray:
    """Return the whole multiples of the step that enclose the source, none beyond the reach; at least two."""
    low, high = math.floor((middle - extent) / step) - 1, math.ceil((middle + extent) / step) + 1
    if reach is not None:
        last = max(1, math.floor(reach / step * (1 + 1e-12)))
        low, high = max(low, -last), min(high, last)
        if high <= low:
            low, high = -1, 1  # nothing of the source lies within the reach
    if high - low + 1 > MAX_POINTS:
        hint = f"the source needs {high - low + 1}; give reach_arcsec"
        raise InputError("step_arcsec", step, unit="arcsec", allowed=f"at most {MAX_POINTS} points a side", hint=hint)
    return np.arange(low, high + 1, dtype=np.float64) * step


def _deal(flux: FloatArray, column: FloatArray, row: FloatArray, light: FloatArray) -> None:
    """Add parcels to the four points around each, in place; what lies outside the grid is left out."""
    n_y, n_x = flux.shape
    inside = (column >= 0) & (column <= n_x - 1) & (row >= 0) & (row <= n_y - 1)
    column, row, light = column[inside], row[inside], light[inside]
    i, j = np.minimum(row.astype(np.intp), n_y - 2), np.minimum(column.astype(np.intp), n_x - 2)
    p, q = row - i, column - j
    flat = flux.reshape(-1)
    first = i * n_x + j
    low, high = light * (1 - p), light * p
    for step, part in ((0, low * (1 - q)), (1, low * q), (n_x, high * (1 - q)), (n_x + 1, high * q)):
        np.add.at(flat, first + step, part)


def _sky(separation: float, pa_deg: float) -> tuple[float, float]:
    """Return the offset toward east and toward north."""
    angle = math.radians(pa_deg)
    return separation * math.sin(angle), separation * math.cos(angle)


def _outer(source: DiscSource | RingSource) -> float:
    if isinstance(source, DiscSource):
        return source.outer_arcsec
    return source.radius_arcsec + RING_SIGMAS * source.fwhm_arcsec / FWHM_PER_SIGMA


def _rings(source: DiscSource | RingSource, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the radii of thin rings, where their light is on average, and their light, which sums to 1."""
    outer = _outer(source)
    if isinstance(source, DiscSource):
        inner, width = source.inner_arcsec, step / PARCELS_PER_STEP
    else:
        sigma = source.fwhm_arcsec / FWHM_PER_SIGMA
        inner, width = max(source.radius_arcsec - RING_SIGMAS * sigma, 0.0), min(step / PARCELS_PER_STEP, sigma / 8)
    edges = np.linspace(inner, outer, max(1, math.ceil((outer - inner) / width)) + 1)
    if isinstance(source, DiscSource):
        light, moment = (_power_integral(edges / outer, source.slope + power) for power in (1.0, 2.0))
        moment = moment * outer
    else:
        nodes, weights = np.polynomial.legendre.leggauss(4)
        r = 0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * nodes
        density = r * np.exp(-0.5 * ((r - source.radius_arcsec) / sigma) ** 2)
        light, moment = density @ weights, (density * r) @ weights
    keep = light > 0
    return moment[keep] / light[keep], light[keep] / light.sum()


def _power_integral(edges: FloatArray, power: float) -> FloatArray:
    """Return the integral of ``r^power`` between neighbouring edges; the first edge may be 0 if the power is > -1."""
    above = power + 1.0
    low, high = edges[:-1], edges[1:]
    with np.errstate(divide="ignore"):
        ratio = np.log(high) - np.log(low)
    if above == 0.0:
        return ratio
    # High less low to the same power, without the cancellation for powers near -1.
    return np.asarray(-(high**above) * np.expm1(-above * ratio) / above)


def _disc_parcels(source: DiscSource | RingSource, step: float, limit: float) -> Iterator[_Parcels]:
    """Yield the cells of rings, projected on the sky; rings that lie wholly beyond the limit are passed over."""
    radii, light = _rings(source, step)
    tilt = math.cos(math.radians(source.inclination_deg)) if source.inclination_deg < 90 else 0.0
    major = _sky(1.0, source.pa_deg)
    minor = (major[1] * tilt, -major[0] * tilt)
    near = radii * tilt <= limit
    radii, light = radii[near], light[near]
    counts = np.maximum(np.ceil(2 * np.pi * radii * PARCELS_PER_STEP / step), 16).astype(np.intp)
    counts += (-counts) % 4  # a ring of 4m parcels is as symmetric as the ellipse
    first = 0
    while first < radii.size:
        total = np.cumsum(counts[first:])
        last = first + max(1, int(np.searchsorted(total, CHUNK, side="right")))
        size = counts[first:last]
        place = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        # Every other ring is turned by half a cell, so that neighbours do not line up.
        turn = np.repeat(0.5 * (np.arange(first, last) % 2), size)
        angle = 2 * np.pi * (place + turn) / np.repeat(size, size)
        r = np.repeat(radii[first:last], size)
        along, across = r * np.cos(angle), r * np.sin(angle)
        east = along * major[0] + across * minor[0]
        north = along * major[1] + across * minor[1]
        yield east, north, np.repeat(light[first:last] / size, size)
        first = last


class _Picture(NamedTuple):
    """Image with sum 1, its pixel, and column and row of its centre."""

    image: FloatArray
    pixel_arcsec: float
    middle: tuple[float, float]

    @property
    def extent_arcsec(self) -> float:
        """Distance of the farthest corner from the centre."""
        n_y, n_x = self.image.shape
        x, y = self.middle
        return self.pixel_arcsec * math.hypot(max(x + 0.5, n_x - 0.5 - x), max(y + 0.5, n_y - 0.5 - y))


def _read(source: ImageSource) -> _Picture:
    """Read and check an image."""
    key = f"extended {source.name}".strip()
    file = read_maps(key, source.file)
    found = file.maps[0] if file.is_fits or len(file.maps) == 1 else file.named("image")
    if found is None:
        raise InputError(key, source.file, allowed="an npz file with an array named image")
    image = real_map(key, source.file, found.data, square=False)
    if image.min() < 0:
        allowed = "no negative values"
        raise InputError(key, source.file, allowed=allowed, hint=f"{(image < 0).sum()} are, down to {image.min():.3g}")
    if not image.any():
        raise InputError(key, source.file, allowed="an image with light in it")
    stated = pixel_scale(key, source.file, found.header)
    scale = file.named("pixel_scale_arcsec") if not file.is_fits else None
    if scale is not None:
        stated = float(real_map(key, source.file, np.atleast_2d(scale.data), square=False)[0, 0])
    asked = source.pixel_scale_arcsec
    if asked is not None and stated is not None and abs(asked / stated - 1) > SCALE_TOLERANCE:
        allowed = f"{stated:g}, as the file says"
        raise InputError("pixel_scale_arcsec", asked, unit="arcsec", allowed=allowed, hint=source.file)
    pixel = stated if asked is None else asked
    if pixel is None:
        allowed = "a value, or PIXSCALE or CDELT in the header"
        raise InputError("pixel_scale_arcsec", "missing", unit="arcsec", allowed=allowed, hint=source.file)
    if not 0 < pixel <= 10:
        raise InputError("pixel_scale_arcsec", pixel, unit="arcsec", allowed="above 0, at most 10", hint=source.file)
    n_y, n_x = image.shape
    middle = source.center_pixel or ((n_x - 1) / 2, (n_y - 1) / 2)
    if not (-0.5 <= middle[0] <= n_x - 0.5 and -0.5 <= middle[1] <= n_y - 0.5):
        raise InputError("center_pixel", middle, unit="px", allowed=f"inside the image of {n_x} x {n_y}")
    return _Picture(image / image.sum(), pixel, (float(middle[0]), float(middle[1])))


def _image_parcels(picture: _Picture, pa_deg: float, step: float, limit: float) -> Iterator[_Parcels]:
    """Yield equal parts of the pixels, small beside the step, on the sky, without what is dark or too far."""
    image, pixel, (middle_x, middle_y) = picture
    parts = max(1, math.ceil(pixel * PARCELS_PER_STEP / step - 1e-9))
    fine = (np.arange(parts) + 0.5) / parts - 0.5
    up, right = _sky(1.0, pa_deg), _sky(1.0, pa_deg - 90.0)  # west is to the right
    rows, columns = np.nonzero(image)
    near = np.hypot(rows - middle_y, columns - middle_x) - 1.0 <= limit / pixel
    rows, columns = rows[near], columns[near]
    per_pixel = parts * parts
    chunk = max(1, CHUNK // per_pixel)
    for start in range(0, rows.size, chunk):
        row, column = rows[start : start + chunk], columns[start : start + chunk]
        shape = (row.size, parts, parts)
        y = np.broadcast_to((row - middle_y)[:, None, None] + fine[:, None], shape).ravel() * pixel
        x = np.broadcast_to((column - middle_x)[:, None, None] + fine, shape).ravel() * pixel
        light = np.repeat(image[row, column] / per_pixel, per_pixel)
        yield x * right[0] + y * up[0], x * right[1] + y * up[1], light
