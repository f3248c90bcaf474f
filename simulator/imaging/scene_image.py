"""Image of a scene behind the focal-plane mask: any number of sources at exact positions, on any window of pixels.

The spectrum of the scene times the transfer function is summed back at the centres of the *open* intervals of the
pixels, every harmonic averaged over its interval in closed form. Nothing is placed on a grid, no kernel is shifted,
and a pixel that the mask cuts is integrated over what the mask leaves open. There is no Lyot stop, so the masked image
is the mask times the unmasked one, for every source.

The error is 1e-14 of the peak of the *brightest* source of the scene, 3e-12 where the window ends in the core of one
(1e-6 with fields in single precision). A source 1e8 times fainter than its neighbour is thus right to better than 1e-3
of its own peak wherever it stands; beside a star 1e10 times brighter on the same window it should have an image of its
own, to be added.

A scene is synthesised from harmonics of a period longer than the displacements (pixel minus source) that occur in it.
The wings of a hard-edged pupil fall off as the inverse square only, 1e-5 of the peak at 10 arcsec, and would fold in
from the next period. So the point-spread function is first multiplied by a window that is one on all displacements
that occur and falls to zero before the period ends. No light folds; what remains is the leakage of the window,
1e-9 of the *local* level of the wings, because the window is a box smoothed by a Kaiser-Bessel bell (Kaiser & Schafer
1980), the shortest practical bell for a given leakage. No kernel is cut off, and nothing rings.

The paper's shortcut for off-axis sources (``scene_model="paper"``) is here so that its error can be measured: CPISM
puts each source into the nearest cell of a grid of 4 x 4 cells a pixel, convolves the grid with one unmasked off-axis
PSF and bins it. The same sum is taken here source by source: one kernel for each of the 16 cells of a pixel, binned
once and laid down on the pixels. The focal-plane mask is honoured for the star alone. At 520 nm a source between cells
is misplaced by up to 2 mas per axis (up to 5 % of its peak), and a source behind the mask keeps all its light.
"""

import functools
import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from cpic_core import ArrayLike, ComplexArray, FloatArray, InputError, Keyed, NDArray, Record
from simulator.config import ARCSEC_PER_RAD
from simulator.imaging.imager import Imager
from simulator.imaging.pupil_symmetry import HalfWaves, add_intensity, mirrored_waves, parts_of, quadrants_of, unfolded
from simulator.imaging.sampling import PixelAxis, overlap, pixel_axis

BELL = 23.0  # of the Kaiser-Bessel bell: leakage about exp(-BELL)
# (half width of the bell) x (frequency from which its transform stays below the leakage)
BELL_PRODUCT = BELL / (2.0 * math.pi)
LONGEST_AXIS = 5000  # harmonics an axis; the arrays stay below 1 GB
SHORTEST_CYCLES = 20.0  # of the cutoff frequency: beyond the core, where the window leaks less
JITTER_REACH = 7.0  # standard deviations


class FrequencyAxis(Record, eq=False):
    """Harmonics ``k / period``, ``|k| <= count // 2``, of one axis.

    Attributes
    ----------
    low_arcsec, high_arcsec : float
        Displacements pixel minus source on which the synthesis holds.
    period_arcsec : float
        Period of the synthesis.
    count : int
        Number of harmonics, odd; also the number of samples a period.
    centre_arcsec : float
        Displacement that the phases of the transfer function refer to.
    """

    low_arcsec: float
    high_arcsec: float
    period_arcsec: float
    count: int
    centre_arcsec: float

    @property
    def frequencies(self) -> FloatArray:
        """Harmonics 0 to ``count // 2`` in cycles per arcsec."""
        return np.arange(self.count // 2 + 1) / self.period_arcsec

    @property
    def samples_arcsec(self) -> FloatArray:
        """One period of displacements relative to the centre, in the order of an FFT: from zero up, then below zero."""
        return np.asarray(np.fft.fftfreq(self.count) * self.period_arcsec, dtype=np.float64)

    @property
    def window(self) -> FloatArray:
        """Weights of the samples: one between low and high, smoothly to zero at the ends of the period."""
        flat = (self.high_arcsec - self.low_arcsec) / 2.0
        bell = (self.period_arcsec / 2.0 - flat) / 2.0
        return _bell_integral((flat + bell - np.abs(self.samples_arcsec)) / bell)


class BandTransfer(Record, eq=False):
    """Transfer function of the optics of a band, pointing jitter included, pixel not.

    Attributes
    ----------
    imager : Imager
        Optical model: wavelengths, apodizer, static wavefront, mirror and jitter are all honoured.
    """

    imager: Imager

    @property
    def reach_arcsec(self) -> float:
        """Diffraction has no end."""
        return math.inf

    @property
    def cutoff_per_arcsec(self) -> float:
        """Highest frequency that the pupil passes, per axis: its diameter over the shortest wavelength."""
        return self.imager.diameter_m / float(self.imager.wavelengths_m.min()) / ARCSEC_PER_RAD

    def axis(self, low_arcsec: float, high_arcsec: float) -> FrequencyAxis:
        """Return the harmonics that serve the displacements from low to high, as few as the window's flanks allow.

        Parameters
        ----------
        low_arcsec : float
            Lower edge, arcsec.
        high_arcsec : float
            Upper edge, arcsec.

        Raises
        ------
        InputError
            If the displacements span more than the memory can hold (about 100 arcsec at 520 nm).
        """
        margin = JITTER_REACH * self.imager.jitter_arcsec
        low, high = low_arcsec - margin, high_arcsec + margin
        length = max(high - low, SHORTEST_CYCLES / self.cutoff_per_arcsec)
        # The fewest of (length + 4 bell) * 2 (cutoff + BELL_PRODUCT / bell) samples.
        bell = 0.5 * math.sqrt(length * BELL_PRODUCT / self.cutoff_per_arcsec)
        period = length + 4.0 * bell
        count = _odd_fast_length(period * 2.0 * (self.cutoff_per_arcsec + BELL_PRODUCT / bell))
        if count > LONGEST_AXIS:
            unit = "arcsec from end to end, window and sources together"
            hint = "image its parts one by one and add them"
            allowed = f"up to about {LONGEST_AXIS / 2.5 / self.cutoff_per_arcsec:.0f} arcsec"
            raise InputError("scene", round(length, 1), unit=unit, allowed=allowed, hint=hint)
        centre = 0.5 * (low + high)
        return FrequencyAxis(centre - length / 2.0, centre + length / 2.0, period, count, centre)

    def values(self, y: FrequencyAxis, x: FrequencyAxis) -> ComplexArray:
        """Return the transfer function on the harmonics, of the light within the window.

        Parameters
        ----------
        y, x : FrequencyAxis
            Axes from `axis`.

        Returns
        -------
        ndarray of complex128, shape (y.count, x.count // 2 + 1)
            Rows in the order of an FFT, columns from zero up; phases relative to the centres of the axes. Its scale:
            1 would pass the energy on the clear pupil disc.
        """
        kernel = _intensity(self.imager, y, x)
        cell_sr = y.period_arcsec / y.count * x.period_arcsec / x.count / ARCSEC_PER_RAD**2
        kernel *= (y.window * cell_sr)[:, None]
        kernel *= x.window
        spectrum: ComplexArray = np.fft.rfft2(kernel)
        if self.imager.jitter_arcsec > 0:
            spectrum *= _gaussian(y.frequencies, self.imager.jitter_arcsec)[_mirrored(y.count), None]
            spectrum *= _gaussian(x.frequencies, self.imager.jitter_arcsec)
        return spectrum


class KernelTransfer(Record, eq=False):
    """Transfer function of a pixel-integrated point-spread function, for example one from a file.

    Sources between pixels see the band-limited interpolation of the kernel, which is exact for a kernel sampled
    finer than lambda/2D that has faded at its edge. At an edge that has not faded it rings by a fraction of the edge's
    own level; what falls below zero is set to zero in images.

    Attributes
    ----------
    kernel : ndarray, shape (n, n), n odd
        Light in every pixel for a source of unit flux on the central pixel, not negative.
    pixel_scale_arcsec : float
        Pixel of the kernel, which must be that of the detector.
    """

    kernel: FloatArray
    pixel_scale_arcsec: float

    @property
    def reach_arcsec(self) -> float:
        """Half the kernel and a pixel."""
        return float((self.kernel.shape[0] // 2 + 1) * self.pixel_scale_arcsec)

    @property
    def cutoff_per_arcsec(self) -> float:
        """Highest frequency that the pixels carry, per axis."""
        return 0.5 / self.pixel_scale_arcsec

    def axis(self, low_arcsec: float, high_arcsec: float) -> FrequencyAxis:
        """Return the harmonics whose samples are the pixels of the kernel, padded until nothing folds.

        Parameters
        ----------
        low_arcsec : float
            Lower edge, arcsec.
        high_arcsec : float
            Upper edge, arcsec.

        Raises
        ------
        InputError
            If that takes more pixels than the memory can hold.
        """
        farthest = max(abs(low_arcsec), abs(high_arcsec))
        count = _odd_fast_length((farthest + self.reach_arcsec) / self.pixel_scale_arcsec + self.kernel.shape[0] // 2)
        if count > LONGEST_AXIS:
            unit = "arcsec from end to end"
            allowed = f"up to {LONGEST_AXIS} pixels"
            hint = "image its parts one by one"
            raise InputError("scene", round(high_arcsec - low_arcsec, 1), unit=unit, allowed=allowed, hint=hint)
        return FrequencyAxis(low_arcsec, high_arcsec, count * self.pixel_scale_arcsec, count, 0.0)

    def values(self, y: FrequencyAxis, x: FrequencyAxis) -> ComplexArray:
        """Return the transfer function on the harmonics, the pixel's own divided out (it is 0.64 or more on each axis).

        Parameters
        ----------
        y, x : FrequencyAxis
            Axes from `axis`.

        Returns
        -------
        ndarray of complex128, shape (y.count, x.count // 2 + 1)
        """
        offsets = np.arange(self.kernel.shape[0]) - self.kernel.shape[0] // 2
        padded = np.zeros((y.count, x.count))
        padded[np.ix_(offsets, offsets)] = self.kernel  # negative offsets at the end, as an FFT wants them
        spectrum: ComplexArray = np.fft.rfft2(padded)
        spectrum /= np.sinc(y.frequencies * self.pixel_scale_arcsec)[_mirrored(y.count), None]
        spectrum /= np.sinc(x.frequencies * self.pixel_scale_arcsec)
        return spectrum


Transfer: TypeAlias = BandTransfer | KernelTransfer
"""Anything that can image a scene: ``axis`` serves displacements, ``values`` has the transfer function on them."""


def _intensity(imager: Imager, y: FrequencyAxis, x: FrequencyAxis) -> FloatArray:
    """Return the band-averaged intensity per steradian on the samples of two axes, each in the order of an FFT.

    The samples lie symmetrically about the centre of their axis. With the phases of the centre in the pupil, parity
    (`simulator.imaging.pupil_symmetry`) takes a quarter of the multiplications; the envelope of a pupil sample, which
    is not symmetric about the centre, comes last.
    """
    samples, step = len(imager.transmission), imager.diameter_m / len(imager.transmission)
    dtype = np.empty(0, imager.knobs.field_dtype).real.dtype
    position = np.arange(samples) - (samples - 1) / 2
    sizes = y.count // 2 + 1, x.count // 2 + 1
    total = np.zeros((2, 2, *sizes))
    for index, (wavelength, weight) in enumerate(zip(imager.wavelengths_m, imager.weights, strict=True)):
        per_arcsec = step / float(wavelength) / ARCSEC_PER_RAD  # cycles a pupil sample
        # Light on the clear disc is one, and a pixel of the field is a steradian.
        scale = math.sqrt(weight) * step**2 / (float(wavelength) * math.sqrt(math.pi / 4.0) * imager.diameter_m)
        waves: list[HalfWaves] = []
        phases, envelopes = [], []
        for axis in (y, x):
            cycles = axis.period_arcsec / axis.count * per_arcsec
            upper: FloatArray = np.arange(axis.count // 2 + 1, dtype=np.float64) * cycles
            known = waves and (axis.period_arcsec, axis.count) == (y.period_arcsec, y.count)
            waves.append(waves[0] if known else mirrored_waves(upper, samples, dtype))
            centre = axis.centre_arcsec * per_arcsec
            phases.append(np.exp(-2j * np.pi * centre * position))
            envelopes.append(scale * np.sinc(np.stack([centre + upper, centre - upper])) ** 2)
        pupil = imager.pupil(index) * phases[0][:, None] * phases[1]
        parts = parts_of(quadrants_of(pupil.real), quadrants_of(pupil.imag), dtype)
        add_intensity(total, parts, waves[0], waves[1], (envelopes[0], envelopes[1]))
    return unfolded(total, (y.count, x.count), (_sides(y.count), _sides(x.count)))


def _sides(count: int) -> list[tuple[slice, slice]]:
    """Return where the samples of either side of an axis go in the order of an FFT, and which of them."""
    return [(slice(0, count // 2 + 1), slice(None)), (slice(count - 1, count // 2, -1), slice(1, None))]


def _gaussian(frequencies: FloatArray, sigma_arcsec: float) -> FloatArray:
    return np.asarray(np.exp(-2.0 * (np.pi * sigma_arcsec * frequencies) ** 2), dtype=np.float64)


def _mirrored(count: int) -> NDArray[np.intp]:
    """Return the index of the absolute frequency of every row of an FFT of odd length."""
    steps = np.arange(count)
    return np.minimum(steps, count - steps)


def _bell_integral(u: FloatArray) -> FloatArray:
    """Return the integral of the Kaiser-Bessel bell on [-1, 1] up to u, scaled to run from 0 to 1."""
    from scipy.special import i0e

    nodes, weights = np.polynomial.legendre.leggauss(48)
    integral = np.where(u >= 1.0, 1.0, 0.0)
    flank = np.abs(u) < 1.0
    span = u[flank] + 1.0
    points = 0.5 * span[:, None] * (nodes + 1.0) - 1.0
    root = np.sqrt(np.maximum(1.0 - points**2, 0.0))
    part = 0.5 * span * ((i0e(BELL * root) * np.exp(BELL * (root - 1.0))) @ weights)
    root = np.sqrt(1.0 - nodes**2)
    integral[flank] = part / ((i0e(BELL * root) * np.exp(BELL * (root - 1.0))) @ weights)
    return integral


def _odd_fast_length(least: float) -> int:
    """Return the smallest odd integer >= least that is a product of 3, 5, 7 and 11."""
    count = math.ceil(least) | 1
    while True:
        rest = count
        for prime in (3, 5, 7, 11):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return count
        count += 2


CHUNK = 512  # sources whose phases are held at a time
SMALLEST_TILE_ARCSEC = 4.0
TILES = (1.0, 2.0, 4.0, 8.0)  # times the smallest
GROUP_SAMPLES = 10_000.0  # of the transfer function that take as long as what a group costs besides


class PointSources(Record, eq=False):
    """Point sources at any position.

    Attributes
    ----------
    x_arcsec, y_arcsec : array_like, shape (s,)
        Positions on the detector relative to the star; x grows with the column, y with the row.
    flux : array_like, shape (s,)
        Light of each on the clear pupil disc, >= 0; the image has the same unit per pixel.
    """

    x_arcsec: ArrayLike
    y_arcsec: ArrayLike
    flux: ArrayLike

    @functools.cached_property
    def arrays(self) -> tuple[FloatArray, ...]:
        """Positions and light as arrays."""
        return tuple(np.asarray(part, dtype=np.float64) for part in (self.x_arcsec, self.y_arcsec, self.flux))


class SourceGrid(PointSources):
    """An extended source as point sources on a grid along the axes of the detector.

    Light between the points is not invented: the grid should be finer than lambda/2D for a source that is smooth.

    Attributes
    ----------
    x_arcsec, y_arcsec : array_like, shapes (m,) and (k,)
        Columns and rows of the grid, relative to the star.
    flux : array_like, shape (k, m)
        Light of every point on the clear pupil disc, >= 0.
    """


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
        Of a band (`simulator.imaging.scene_image.BandTransfer`) or of a kernel.
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
        If one extended source spans more than the memory can hold.
    """
    y, x = np.asarray(y_centres_arcsec, dtype=np.float64), np.asarray(x_centres_arcsec, dtype=np.float64)
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


class _Window(Record, eq=False):
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


def _groups(transfer: Transfer, window: _Window, parts: Sequence[PointSources]) -> list[list[Component]]:
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


def _tiles(window: _Window, parts: Sequence[PointSources], larger: float) -> list[list[Component]]:
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


CELLS = 4  # per pixel and axis (paper, section on imaging)
CELL_NODES = 2  # Gauss nodes per cell: the kernel is exact to 1e-6, the grid is the only error
ROWS_AT_A_TIME = 64  # on either side of the axis
N_KEPT = 2  # optics whose kernels are kept, 8 MB each


def paper_scene_image(
    imager: Imager, y_arcsec: ArrayLike, x_arcsec: ArrayLike, sources: PointSources, *, kernel_half_pixels: int = 128
) -> FloatArray:
    """Return the image of point sources by the nearest cell of a 4 x 4 grid and one convolution, without the mask.

    Parameters
    ----------
    imager : Imager
        Optical model; the pixels are its own.
    y_arcsec, x_arcsec : array_like, shapes (n,) and (m,)
        Centres of the rows and columns, one pixel apart.
    sources : PointSources
        Those farther outside the window than the kernel reaches are left out.
    kernel_half_pixels : int
        Half side of the kernel; light beyond it is lost.

    Returns
    -------
    ndarray, shape (n, m)
        Light per pixel in the unit of the fluxes.
    """
    pixel, reach = imager.pixel_scale_arcsec, kernel_half_pixels
    rows, columns = np.asarray(y_arcsec, dtype=np.float64), np.asarray(x_arcsec, dtype=np.float64)
    image = np.zeros((rows.size, columns.size))
    places = [_cell(part, axis[0], pixel) for part, axis in zip(sources.arrays[1::-1], (rows, columns), strict=True)]
    inside = np.ones(places[0].shape, dtype=np.bool_)
    for cell, n_pixels in zip(places, image.shape, strict=True):
        inside &= (cell >= -CELLS * reach) & (cell < CELLS * (n_pixels + reach))
    if not inside.any():
        return image
    kernels = _binned_kernels(Keyed(imager.content_key, imager), reach)
    cells = np.stack([cell[inside] for cell in places], axis=1).astype(np.intp)
    for (row, column), flux in zip(cells, sources.arrays[2][inside], strict=True):
        spans = [overlap(int(cell) // CELLS, reach, n) for cell, n in zip((row, column), image.shape, strict=True)]
        kernel = kernels[row % CELLS, column % CELLS]
        image[spans[0][0], spans[1][0]] += flux * kernel[spans[0][1], spans[1][1]]
    return image


@functools.lru_cache(maxsize=N_KEPT)
def _binned_kernels(optics: Keyed[Imager], reach: int) -> FloatArray:
    """Return the light in every pixel for a source on each cell of the middle one, without the mask.

    Returns
    -------
    ndarray, shape (4, 4, 2 reach + 1, 2 reach + 1)
        By row and column of the cell.
    """
    imager, half, side = optics.value, CELLS * reach, 2 * reach + 1
    cell = imager.pixel_scale_arcsec / CELLS
    place = np.arange(-half, half + 1)
    centres: FloatArray = place.astype(np.float64) * cell
    columns = pixel_axis(centres, cell, CELL_NODES, 0.0, imager.jitter_arcsec)
    starts = np.arange(0, CELLS * side, CELLS)
    kernels = np.zeros((CELLS, CELLS, side, side))
    for start in range(0, half + 1, ROWS_AT_A_TIME):
        # Rows above and below the axis together: where nodes are symmetric, half of the work is enough.
        part = np.flatnonzero((np.abs(place) >= start) & (np.abs(place) < start + ROWS_AT_A_TIME))
        light = imager.image(pixel_axis(centres[part], cell, CELL_NODES, 0.0, imager.jitter_arcsec), columns)
        for right in range(CELLS):
            shifted = np.pad(light, ((0, 0), (right, CELLS - 1 - right)))
            binned = np.add.reduceat(shifted, starts, axis=1)
            for up in range(CELLS):
                np.add.at(kernels[up, right], (part + up) // CELLS, binned)
    kernels /= CELLS**2  # the imager gives light per detector pixel
    kernels.flags.writeable = False
    return kernels


def _cell(positions: FloatArray, first_centre: float, pixel: float) -> FloatArray:
    """Return the index of the cell that holds each position, cell 0 being the first of the first pixel."""
    return np.floor((positions - (first_centre - pixel / 2.0)) * (CELLS / pixel))
