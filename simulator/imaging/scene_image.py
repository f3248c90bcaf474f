"""Image of a scene behind the focal-plane mask: any number of sources at exact positions, on any window of pixels.

The spectrum of the scene times the transfer function is summed back at the centres of the *open* intervals of the
pixels, every harmonic averaged over its interval in closed form. Nothing is placed on a grid, no kernel is shifted,
and a pixel that the mask cuts is integrated over what the mask leaves open. There is no Lyot stop, so the masked image
is the mask times the unmasked one, for every source.

The error is 1e-14 of the peak of the *brightest* source of the scene, 3e-12 where the window ends in the core of one
(1e-6 with fields in single precision). A source 1e8 times fainter than its neighbour is thus right to better than 1e-3
of its own peak wherever it stands; beside a star 1e10 times brighter on the same window it should have an image of its
own, to be added.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cpic_core import ArrayLike, ComplexArray, FloatArray, InputError, NDArray
from simulator.imaging.sampling import PixelAxis, pixel_axis
from simulator.imaging.transfer import FrequencyAxis, Transfer

CHUNK = 512  # sources whose phases are held at a time
SMALLEST_TILE_ARCSEC = 4.0
TILES = (1.0, 2.0, 4.0, 8.0)  # times the smallest
GROUP_SAMPLES = 10_000.0  # of the transfer function that take as long as what a group costs besides


@dataclass(frozen=True, eq=False)
class _Sources:
    """Positions and light as given, and the same as checked arrays."""

    x_arcsec: ArrayLike
    y_arcsec: ArrayLike
    flux: ArrayLike
    arrays: tuple[FloatArray, FloatArray, FloatArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the values."""
        x, y = (_vector(name, getattr(self, name)) for name in ("x_arcsec", "y_arcsec"))
        flux = self._checked_flux(x, y)
        bad = ~(np.isfinite(flux) & (flux >= 0))
        if bad.any():
            raise InputError("flux", float(flux[bad][0]), allowed="finite numbers >= 0")
        object.__setattr__(self, "arrays", (x, y, flux))

    def _checked_flux(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the light as an array, its shape checked against the positions."""
        raise NotImplementedError


class PointSources(_Sources):
    """Point sources at any position.

    Attributes
    ----------
    x_arcsec, y_arcsec : array_like, shape (s,)
        Positions on the detector relative to the star; x grows with the column, y with the row.
    flux : array_like, shape (s,)
        Light of each on the clear pupil disc, >= 0; the image has the same unit per pixel.

    Raises
    ------
    InputError
        If shapes differ, a value is not finite, or a flux is negative.
    """

    def _checked_flux(self, x: FloatArray, y: FloatArray) -> FloatArray:
        flux = _vector("flux", self.flux)
        if not x.size == y.size == flux.size:
            raise InputError("sources", f"{x.size} x, {y.size} y, {flux.size} flux", allowed="equal numbers")
        return flux


class SourceGrid(_Sources):
    """An extended source as point sources on a grid along the axes of the detector.

    Light between the points is not invented: the grid should be finer than lambda/2D for a source that is smooth.

    Attributes
    ----------
    x_arcsec, y_arcsec : array_like, shapes (m,) and (k,)
        Columns and rows of the grid, relative to the star.
    flux : array_like, shape (k, m)
        Light of every point on the clear pupil disc, >= 0.

    Raises
    ------
    InputError
        If shapes differ, a value is not finite, or a flux is negative.
    """

    def _checked_flux(self, x: FloatArray, y: FloatArray) -> FloatArray:
        flux = np.asarray(self.flux, dtype=np.float64)
        if flux.shape != (y.size, x.size):
            raise InputError("flux", f"shape {flux.shape}", allowed=f"{(y.size, x.size)}: rows of y, columns of x")
        return flux


def scene_image(
    transfer: Transfer,
    y_centres_arcsec: ArrayLike,
    x_centres_arcsec: ArrayLike,
    pixel_arcsec: float,
    sources: PointSources,
    *,
    mask_half_width_arcsec: float = 0.0,
    extended: Sequence[SourceGrid] = (),
) -> FloatArray:
    """Return the pixel-integrated image of a scene.

    Parameters
    ----------
    transfer : Transfer
        Of a band (`simulator.imaging.transfer.BandTransfer`) or of a kernel.
    y_centres_arcsec, x_centres_arcsec : array_like, shapes (n,) and (m,)
        Ascending centres of the rows and columns of the window, relative to the star.
    pixel_arcsec : float
        Side of a pixel.
    sources : PointSources
        May lie anywhere, also outside the window or behind the mask, and may be none.
    mask_half_width_arcsec : float
        Half width w of the opaque cross ``|x| < w or |y| < w``, 0 for none.
    extended : sequence of SourceGrid
        Extended sources.

    Returns
    -------
    ndarray, shape (n, m)
        Light per pixel in the unit of the fluxes, never negative: values within rounding of zero, some 1e-14 of the
        brightest peak, are set to zero where they fall below it. Pixels wholly behind the mask are exactly zero.

    Raises
    ------
    InputError
        If centres are not finite and ascending, a width is out of range, the kernel has another pixel, or one extended
        source spans more than the memory can hold.
    """
    y, x = checked_centres("y_centres_arcsec", y_centres_arcsec), checked_centres("x_centres_arcsec", x_centres_arcsec)
    if not (math.isfinite(pixel_arcsec) and pixel_arcsec > 0):
        raise InputError("pixel_arcsec", pixel_arcsec, unit="arcsec", allowed="> 0")
    if not (math.isfinite(mask_half_width_arcsec) and mask_half_width_arcsec >= 0):
        raise InputError("mask_half_width_arcsec", mask_half_width_arcsec, unit="arcsec", allowed=">= 0")
    native = transfer.native_pixel_arcsec
    if native is not None and abs(pixel_arcsec - native) > 1e-6 * native:
        raise InputError("pixel_arcsec", pixel_arcsec, unit="arcsec", allowed=f"the pixel of the kernel, {native}")
    rows = pixel_axis(y, pixel_arcsec, 1, mask_half_width_arcsec)
    columns = pixel_axis(x, pixel_arcsec, 1, mask_half_width_arcsec)
    image = np.zeros((y.size, x.size))
    if rows.pixels.size == 0 or columns.pixels.size == 0:
        return image
    window = _Window(rows, columns, pixel_arcsec, (y[0], y[-1]), (x[0], x[-1]))
    light = np.zeros((rows.pixels.size, columns.pixels.size))
    for group in _groups(transfer, window, [sources, *extended]):
        _add_group(light, transfer, window, group)
    image[np.ix_(rows.pixels, columns.pixels)] = np.maximum(light, 0.0)
    return image


@dataclass(frozen=True, eq=False)
class _Window:
    """Open intervals of the pixels, and the first and last centre of each axis."""

    rows: PixelAxis
    columns: PixelAxis
    pixel_arcsec: float
    y_ends: tuple[float, float]
    x_ends: tuple[float, float]

    def displacements(self, ends: tuple[float, float], low: float, high: float) -> tuple[float, float]:
        """Return the least and greatest displacement of a pixel's edge from sources between low and high."""
        half = self.pixel_arcsec / 2.0
        return ends[0] - half - high, ends[1] + half - low

    def tile(self, x: FloatArray, y: FloatArray, larger: float) -> NDArray[np.int64]:
        """Return the tile of the sky of each position, (0, 0) being the window and its surroundings; shape (2, ...)."""
        tiles = []
        for position, ends in ((y, self.y_ends), (x, self.x_ends)):
            side = larger * max(2.0 * (ends[1] - ends[0] + self.pixel_arcsec), SMALLEST_TILE_ARCSEC)
            tiles.append(np.floor((position - 0.5 * (ends[0] + ends[1])) / side + 0.5))
        result: NDArray[np.int64] = np.clip(np.array(tiles), -1e18, 1e18).astype(np.int64)
        return result


Component = tuple[FloatArray, FloatArray, FloatArray]  # x, y, flux; flux is (s,) or (k, m)


def _groups(transfer: Transfer, window: _Window, parts: Sequence[_Sources]) -> list[list[Component]]:
    """Yield the sources with light in them, tile by tile: a synthesis's period grows with its sources' extent.

    Tiles are of the size that takes the fewest samples: small for a few sources far apart, large for a dense field.
    """
    best, least = _tiles(window, parts, 1.0), math.inf
    if len(best) < 2:
        return best
    for larger in TILES:
        groups = _tiles(window, parts, larger)
        try:
            cost = sum(_samples(transfer, window, group) for group in groups)
        except InputError:  # more than the memory can hold at once
            break
        if cost < least:
            best, least = groups, cost
        if len(groups) == 1:
            break
    return best


def _samples(transfer: Transfer, window: _Window, group: list[Component]) -> float:
    """Return the samples of the transfer function that a group takes, fixed cost included; 0 where it is dark."""
    axes = _axes(transfer, window, group)
    return 0.0 if axes is None else axes[0].count * axes[1].count + GROUP_SAMPLES


def _tiles(window: _Window, parts: Sequence[_Sources], larger: float) -> list[list[Component]]:
    groups: dict[tuple[int, int], list[Component]] = {}
    for part in parts:
        x, y, flux = part.arrays
        if not flux.any():
            continue
        if isinstance(part, SourceGrid):
            filled_rows, filled_columns = np.flatnonzero(flux.any(axis=1)), np.flatnonzero(flux.any(axis=0))
            x, y, flux = x[filled_columns], y[filled_rows], flux[np.ix_(filled_rows, filled_columns)]
            middle = [np.array(0.5 * (axis.min() + axis.max())) for axis in (x, y)]
            row, column = window.tile(middle[0], middle[1], larger)
            groups.setdefault((int(row), int(column)), []).append((x, y, flux))
            continue
        lit = flux > 0
        x, y, flux = x[lit], y[lit], flux[lit]
        tiles, owner = np.unique(window.tile(x, y, larger), axis=1, return_inverse=True)
        for index, (row, column) in enumerate(tiles.T):
            inside = owner.ravel() == index
            groups.setdefault((int(row), int(column)), []).append((x[inside], y[inside], flux[inside]))
    return [groups[key] for key in sorted(groups)]


def _add_group(light: FloatArray, transfer: Transfer, window: _Window, group: list[Component]) -> None:
    """Add the image of some sources."""
    axes = _axes(transfer, window, group)
    if axes is None:
        return
    y_axis, x_axis = axes
    even, odd = _spectrum(group, y_axis.frequencies, x_axis.frequencies)
    values = transfer.values(y_axis, x_axis)
    # Rows +k and -k of the scene's spectrum are even - i odd and even + i odd; the same for the product of both.
    plus, minus = values[: even.shape[0]], values[-np.arange(even.shape[0])]
    mean, slope = plus + minus, 1j * (plus - minus)
    mean[0] *= 0.5
    light += _synthesis(mean * even - slope * odd, slope * even + mean * odd, window, y_axis, x_axis)


def _axes(transfer: Transfer, window: _Window, group: list[Component]) -> tuple[FrequencyAxis, FrequencyAxis] | None:
    """Return the harmonics of rows and columns that serve some sources; None where none of their light arrives."""
    ends = []
    for which, edge in ((1, window.y_ends), (0, window.x_ends)):
        low = min(float(component[which].min()) for component in group)
        high = max(float(component[which].max()) for component in group)
        ends.append(window.displacements(edge, low, high))
    if any(low > transfer.reach_arcsec or high < -transfer.reach_arcsec for low, high in ends):
        return None
    return transfer.axis(*ends[0]), transfer.axis(*ends[1])


def _spectrum(group: list[Component], ky: FloatArray, kx: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the sums of ``flux cos(2 pi ky y) exp(-2 pi i kx x)`` and of the same with a sine, (len(ky), len(kx))."""
    even, odd = np.zeros((2, ky.size, kx.size), dtype=np.complex128)
    for x, y, flux in group:
        for start in range(0, y.size, CHUNK):
            part = slice(start, start + CHUNK)
            weighted = flux[part] @ _phases(kx, -x) if flux.ndim == 2 else _phases(kx, -x[part]) * flux[part, None]
            turns = _phases(ky, y[part]).T
            _add_product(even, turns.real, weighted)
            _add_product(odd, turns.imag, weighted)
    return even, odd


def _synthesis(
    even: ComplexArray, odd: ComplexArray, window: _Window, y_axis: FrequencyAxis, x_axis: FrequencyAxis
) -> FloatArray:
    """Return the real part of the sum over the harmonics, integrated over the open part of every open pixel."""
    rows = _interval_means(window.rows, window.pixel_arcsec, y_axis)
    columns = _interval_means(window.columns, window.pixel_arcsec, x_axis)
    columns[:, 1:] *= 2.0  # the other half of the plane is the conjugate of this one
    middle = np.zeros((rows.shape[0], even.shape[1]), dtype=np.complex128)
    _add_product(middle, rows.real, even)
    _add_product(middle, rows.imag, odd)
    image: FloatArray = np.ascontiguousarray(middle.real) @ np.ascontiguousarray(columns.real).T
    image -= np.ascontiguousarray(middle.imag) @ np.ascontiguousarray(columns.imag).T
    return image


def _interval_means(pixels: PixelAxis, pixel_arcsec: float, axis: FrequencyAxis) -> ComplexArray:
    """Return the integral of every harmonic over the open part of every open pixel, shape (p, harmonics)."""
    width = pixels.weights * pixel_arcsec
    matrix = _phases(axis.frequencies, pixels.nodes_arcsec - axis.centre_arcsec)
    # Few widths differ: that of an open pixel, and of those that the edges of the mask cut.
    _, first, kind = np.unique(np.round(pixels.weights, 12), return_index=True, return_inverse=True)
    means = np.sinc(np.multiply.outer(width[first], axis.frequencies)) * (width[first] / axis.period_arcsec)[:, None]
    matrix *= means[kind]
    if pixels.starts.size == pixels.nodes_arcsec.size:
        return matrix
    summed: ComplexArray = np.add.reduceat(matrix, pixels.starts, axis=0)
    return summed


def _phases(frequencies: FloatArray, positions: FloatArray) -> ComplexArray:
    """Return ``exp(2 pi i position frequency)`` for equidistant frequencies from zero: coarse steps times fine ones."""
    fine = 32
    coarse = -(-frequencies.size // fine)
    step = frequencies[1] if frequencies.size > 1 else 0.0
    turns = 2j * np.pi * positions * step
    first = np.exp(np.multiply.outer(turns, np.arange(coarse) * float(fine)))
    second = np.exp(np.multiply.outer(turns, np.arange(fine, dtype=np.float64)))
    table = (first[:, :, None] * second[:, None, :]).reshape(positions.size, coarse * fine)
    result: ComplexArray = table[:, : frequencies.size]
    return result


def _add_product(total: ComplexArray, real: FloatArray, values: ComplexArray) -> None:
    """Add ``real @ values`` to a complex array by one product of real matrices."""
    pairs = np.ascontiguousarray(values).view(np.float64)
    total.view(np.float64)[...] += np.ascontiguousarray(real) @ pairs


def _vector(name: str, values: ArrayLike) -> FloatArray:
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.ndim != 1:
        raise InputError(name, f"shape {array.shape}", allowed="one dimension")
    if not np.isfinite(array).all():
        raise InputError(name, float(array[~np.isfinite(array)][0]), allowed="finite numbers")
    return array


def checked_centres(name: str, values: ArrayLike) -> FloatArray:
    """Return centres of pixels along an axis; refuse what does not increase."""
    centres = _vector(name, values)
    if centres.size == 0 or (np.diff(centres) <= 0).any():
        raise InputError(name, f"{centres.size} values", unit="arcsec", allowed="at least one, ascending")
    return centres
