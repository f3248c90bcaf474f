"""The separable transform of a pupil by parts that are even or odd about its axes: real matrices on half of it.

Pupil samples lie symmetrically about the axis, so that a pupil map is the sum of four parts, even or odd along either
axis, each told by one quadrant. An even part sees cosines only, an odd one sines. That takes a quarter of the
multiplications of the complex product where the nodes of the focal plane are symmetric too (each part is then needed
on one side only), half of them where they are not. Nothing is approximated.
"""

import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cpic_core import FloatArray, NDArray, Record

RealArray = NDArray[np.floating[Any]]
ComplexArray = NDArray[np.complexfloating[Any, Any]]
BLOCK_VALUES = 2**13  # of a block, if it has more rows: what is read again stays in the processor's cache
LEAST_ROWS = 64  # of a block: a product packs its right side anew for each
SYMMETRIC = 1e-14  # of the farthest node: equal but for rounding
SERIES_BELOW = 0.25  # rad; beyond, the power series takes longer than the library's cosine and sine


class HalfWaves(Record, eq=False):
    """Transform of one axis, from the pupil samples on its upper side.

    Attributes
    ----------
    cosine, sine : ndarray, shape (k, h)
        Waves at the nodes, envelope included; at those from zero up if ``mirrored``.
    mirrored : bool
        Whether the nodes are symmetric about zero, so that the upper half of them is enough.
    n_nodes : int
        Number of all nodes.
    """

    cosine: RealArray
    sine: RealArray
    mirrored: bool
    n_nodes: int

    @functools.cached_property
    def both(self) -> RealArray:
        """Cosine and sine side by side, shape (k, 2 h): one product where no side needs them apart."""
        return np.concatenate([self.cosine, self.sine], axis=1)

    def full(self, samples: int) -> ComplexArray:
        """Return the waves at all nodes and pupil samples, shape (n_nodes, samples): this axis's whole transform."""
        upper, odd = self.cosine - 1j * self.sine, samples % 2
        if odd:
            upper[:, 0] *= 2.0  # half of the middle sample stands in either half
        lower = upper.conj()[:, :0:-1] if odd else upper.conj()[:, ::-1]
        waves = np.concatenate([lower, upper], axis=1)
        if not self.mirrored:
            return waves
        return np.concatenate([waves[self.n_nodes % 2 :].conj()[::-1], waves])

    @property
    def sides(self) -> list[tuple[slice, slice]]:
        """Where the values of each side go among all nodes, and which of them."""
        if not self.mirrored:
            return [(slice(None), slice(None))]
        half, middle = self.n_nodes // 2, self.n_nodes % 2
        return [(slice(half, None), slice(None)), (slice(half - 1, None, -1), slice(middle, None))]


def half_waves(frequencies: FloatArray, samples: int, scale: float, dtype: Any = np.float64) -> HalfWaves:
    """Return the waves at given frequencies on pupil samples, each with the envelope of a sample of constant field.

    Parameters
    ----------
    frequencies : ndarray, shape (k,)
        Cycles per sample.
    samples : int
        Samples across the pupil, centred on its axis.
    scale : float
        Factor on the transform.
    dtype : numpy.dtype
        Of the matrices.
    """
    count = frequencies.size
    farthest = float(np.abs(frequencies).max(initial=0.0))
    mirrored = count > 1 and bool(np.abs(frequencies + frequencies[::-1]).max() <= SYMMETRIC * farthest)
    held = frequencies[count // 2 :] if mirrored else frequencies
    cosine, sine = _cosine_and_sine(held, samples)
    envelope = (scale * np.sinc(held))[:, None]
    cosine, sine = envelope * cosine, envelope * sine
    return HalfWaves(cosine.astype(dtype, copy=False), sine.astype(dtype, copy=False), mirrored, count)


def mirrored_waves(upper: FloatArray, samples: int, dtype: Any = np.float64) -> HalfWaves:
    """Return the waves without envelope at frequencies from zero up and their mirror images, an odd number.

    Parameters
    ----------
    upper : ndarray, shape (k,)
        Cycles per sample, the first of them 0.
    samples, dtype
        As in `half_waves`.
    """
    cosine, sine = _cosine_and_sine(upper, samples)
    return HalfWaves(cosine.astype(dtype, copy=False), sine.astype(dtype, copy=False), True, 2 * upper.size - 1)


def _cosine_and_sine(frequencies: FloatArray, samples: int) -> tuple[FloatArray, FloatArray]:
    position = np.arange(samples // 2, samples) - (samples - 1) / 2
    turns = 2.0 * np.pi * np.outer(frequencies, position)
    cosine, sine = np.cos(turns), np.sin(turns)
    if samples % 2:
        cosine[:, 0] *= 0.5  # the middle sample stands in both halves
    return cosine, sine


def quadrants_of(values: FloatArray) -> FloatArray:
    """Return the quadrants of a map on the pupil, both axes counted from the middle outwards.

    Parameters
    ----------
    values : ndarray, shape (n, n)

    Returns
    -------
    ndarray, shape (2, 2, h, h)
        Upper and lower half of the rows, then of the columns, ``h = (n + 1) // 2``. A middle row or column stands in
        both halves.
    """
    n = len(values)
    sides = slice(n // 2, None), slice((n - 1) // 2, None, -1)
    return np.stack([np.stack([values[y, x] for x in sides]) for y in sides])


def unit_phases(phase: FloatArray, largest: float) -> tuple[FloatArray, FloatArray]:
    """Return the cosine and sine to rounding; small phases by their power series, which takes a quarter of the time.

    Parameters
    ----------
    phase : ndarray
        Radians.
    largest : float
        Bound on their absolute values.
    """
    if not largest <= SERIES_BELOW:
        return np.cos(phase), np.sin(phase)
    terms, rest = 1, 0.5 * largest**2
    while rest > 2.0**-56:
        terms += 1
        rest *= largest**2 / ((2 * terms - 1) * (2 * terms))
    square = phase * phase
    cosine = _polynomial(square, [(-1) ** order / math.factorial(2 * order) for order in range(terms + 1)])
    sine = _polynomial(square, [(-1) ** order / math.factorial(2 * order + 1) for order in range(terms + 1)])
    sine *= phase
    return cosine, sine


def _polynomial(x: FloatArray, coefficients: list[float]) -> FloatArray:
    """Return a polynomial by Horner's rule, lowest power first."""
    total = coefficients[-1] * x
    for coefficient in coefficients[-2:0:-1]:
        total += coefficient
        total *= x
    total += coefficients[0]
    return total


def parts_of(real: FloatArray, imaginary: FloatArray, dtype: Any = np.float64) -> RealArray:
    """Return the even and odd parts of a pupil field, from its quadrants.

    Parameters
    ----------
    real, imaginary : ndarray, shape (2, 2, h, h)
        From `quadrants_of`.

    Returns
    -------
    ndarray, shape (2, 2, h, 2, h)
        Real and imaginary part; even or odd along y, and the rows; even or odd along x, and the columns. Each odd axis
        brings the factor ``-i`` of its sines, so that the field at a node is the plain sum of what the parts give.
    """
    half = real.shape[-1]
    parts = np.empty((2, 2, half, 2, half), dtype=dtype)
    for this, values in enumerate((real, imaginary)):
        sums, steps = values[0] + values[1], values[0] - values[1]  # along y, on both sides of x
        parts[this, 0, :, 0] = sums[0] + sums[1]
        parts[this, 1, :, 1] = steps[1] - steps[0]
        other = 1 - this  # -i (a + ib) = b - ia
        parts[other, 0, :, 1] = sums[1] - sums[0] if other else sums[0] - sums[1]
        parts[other, 1, :, 0] = -(steps[0] + steps[1]) if other else steps[0] + steps[1]
    return parts


def add_intensity(
    total: FloatArray, parts: RealArray, y: HalfWaves, x: HalfWaves, envelopes: tuple[FloatArray, FloatArray] | None
) -> None:
    """Add the squared modulus of the field to that of others.

    Parameters
    ----------
    total : ndarray, shape (s_y, s_x, k_y, k_x)
        Sums at the nodes held, on the upper side of each axis and, if it is mirrored, on the lower; changed in place.
    parts : ndarray
        From `parts_of`.
    y, x : HalfWaves
        Axes of the nodes.
    envelopes : tuple of ndarray or None, shapes (s_y, k_y) and (s_x, k_x)
        Factors on the squared modulus by side and node of either axis, for waves without envelope.
    """
    for place, field in _sides(parts, y, x):
        np.multiply(field, field, out=field)
        target = total[place]
        if envelopes is None:
            target += field[0]
            target += field[1]
            continue
        side_y, side_x, rows = place
        light = np.add(field[0], field[1], out=field[0])
        light *= envelopes[0][side_y, rows, None]
        light *= envelopes[1][side_x]
        target += light


def field_of(parts: RealArray, y: HalfWaves, x: HalfWaves) -> ComplexArray:
    """Return the field at all nodes, shape (n_y, n_x).

    Parameters
    ----------
    parts : ndarray
        Even and odd parts of the field.
    y, x : HalfWaves
    """
    shape = (1 + y.mirrored, 1 + x.mirrored, len(y.cosine), len(x.cosine))
    values = np.empty(shape, dtype=np.result_type(parts.dtype, np.complex64))
    for place, field in _sides(parts, y, x):
        values.real[place], values.imag[place] = field
    return unfolded(values, (y.n_nodes, x.n_nodes), (y.sides, x.sides))


def _sides(parts: RealArray, y: HalfWaves, x: HalfWaves) -> Iterator[tuple[tuple[int, int, slice], RealArray]]:
    """Yield the field of a block of rows, shape (2, rows, k_x), real and imaginary part, side by side of both axes."""
    half, count = parts.shape[-1], len(x.cosine)
    flat = parts.reshape(4 * half, 2 * half)
    products = [flat[:, :half] @ x.cosine.T, flat[:, half:] @ x.sine.T] if x.mirrored else [flat @ x.both.T]
    middle = [part.reshape(2, 2 * half, count) for part in products]
    block = max(LEAST_ROWS, BLOCK_VALUES // max(count, 1))
    for first in range(0, len(y.cosine), block):
        rows = slice(first, first + block)
        if not y.mirrored:
            for side, field in enumerate(_sums_and_steps([y.both[rows] @ part for part in middle])):
                yield (0, side, rows), field
            continue
        means = _sums_and_steps([y.cosine[rows] @ part[:, :half] for part in middle])
        slopes = _sums_and_steps([y.sine[rows] @ part[:, half:] for part in middle])
        for side, (mean, slope) in enumerate(zip(means, slopes, strict=True)):
            yield (0, side, rows), mean + slope
            yield (1, side, rows), np.subtract(mean, slope, out=mean)


def _sums_and_steps(parts: list[RealArray]) -> list[RealArray]:
    """Return the even and odd part on the upper and on the lower side of an axis; a single part as it is."""
    if len(parts) < 2:
        return parts
    return [parts[0] + parts[1], parts[0] - parts[1]]


def unfolded(
    values: NDArray[Any], shape: tuple[int, int], sides: tuple[list[tuple[slice, slice]], list[tuple[slice, slice]]]
) -> NDArray[Any]:
    """Return the values at all nodes in their order, from those held of all sides, shape (s_y, s_x, k_y, k_x).

    Parameters
    ----------
    values : ndarray
        Values of all sides, shape (s_y, s_x, k_y, k_x).
    shape : tuple of int
        Numbers of all nodes along y and x.
    sides : tuple of list
        For the sides of y and of x where their values go, and which of them.
    """
    answer = np.empty(shape, dtype=values.dtype)
    for side_y, (to_y, from_y) in enumerate(sides[0]):
        for side_x, (to_x, from_x) in enumerate(sides[1]):
            answer[to_y, to_x] = values[side_y, side_x, from_y, from_x]
    return answer
