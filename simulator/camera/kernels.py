"""Compiled kernels of the camera: random charge, spilling, transfer, register, converter.

All kernels and what they call live in this file, since the disk cache of compiled code does not see edits elsewhere.
They take checked input only. Charge is float64 holding whole electrons, exact up to 2**53; kernels that spill or move
charge conserve it exactly. Importing this module loads the compiler: do it inside functions.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = [
    "add_normal",
    "compress_counts",
    "digitise",
    "draw_poisson",
    "multiply_charge",
    "round_stochastic",
    "serial_spill",
    "shift_back",
    "vertical_spill",
]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Counts of smaller variance come from their cumulated probabilities, term by term. Larger ones come from the
# Cornish-Fisher expansion of a rounded variate, whose own variance is smaller by that of the rounding (1/12, Sheppard's
# correction): at this variance the distribution function is off by 3e-5, falling as the square.
_EXPANSION_ABOVE = 10.0
# Divisions by small whole numbers, the slowest part of a sum of probabilities, are products with these.
_INVERSE = 1.0 / np.maximum(np.arange(128.0), 1.0)
# Outputs of the register narrower than this keep their grain: a moment-matched negative binomial.
_SMOOTH_ABOVE_SIGMA = 20.0


@njit(cache=True)
def _expanded(
    mean: float, variance: float, third: float, fourth: float, fifth: float, rng: np.random.Generator
) -> float:
    """Rounded Cornish-Fisher variate of given cumulants."""
    v = variance - 1.0 / 12.0
    s = math.sqrt(v)
    skew = third / (v * s)
    excess = (fourth + 1.0 / 120.0) / (v * v)
    fifth = fifth / (v * v * s)
    z = rng.standard_normal()
    z2 = z * z
    x = z + (z2 - 1.0) * skew / 6.0
    x += z * ((z2 - 3.0) * excess / 24.0 - (2.0 * z2 - 5.0) * skew * skew / 36.0)
    x += (z2 * (z2 - 6.0) + 3.0) * fifth / 120.0 - (z2 * (z2 - 5.0) + 2.0) * skew * excess / 24.0
    x += (z2 * (12.0 * z2 - 53.0) + 17.0) * skew * skew * skew / 324.0
    return max(math.floor(mean + s * x + 0.5), 0.0)


@njit(cache=True)
def _poisson(mean: float, zero: float, rng: np.random.Generator) -> float:
    """One Poisson count; ``zero`` is exp(-mean)."""
    if mean > _EXPANSION_ABOVE:
        return _expanded(mean, mean, mean, mean, mean, rng)
    return _counted_up(rng.random(), mean, zero)


@njit(cache=True)
def _counted_up(u: float, mean: float, zero: float) -> float:
    """Poisson count whose distribution function reaches ``u``."""
    k = 0
    term = zero
    total = zero
    while u >= total and k < 100:
        k += 1
        term *= mean * _INVERSE[k]
        total += term
    return float(k)


@njit(cache=True)
def draw_poisson(mean: FloatArray, zero: FloatArray, rng: np.random.Generator, out: FloatArray) -> None:
    """Poisson counts of flat arrays; ``zero`` is exp(-mean)."""
    for i in range(mean.size):
        if mean[i] > _EXPANSION_ABOVE:
            out[i] = _expanded(mean[i], mean[i], mean[i], mean[i], mean[i], rng)
            continue
        # Most dark pixels end at the first comparison; mean 0 has zero = 1.
        u = rng.random()
        out[i] = 0.0 if u < zero[i] else _counted_up(u, mean[i], zero[i])


@njit(cache=True)
def round_stochastic(charge: FloatArray, rng: np.random.Generator) -> None:
    """Round to whole electrons, up with the probability of the fraction, so that the mean stays. Flat, in place."""
    for i in range(charge.size):
        whole = math.floor(charge[i])
        if charge[i] != whole:
            charge[i] = whole + 1.0 if rng.random() < charge[i] - whole else whole


@njit(cache=True)
def compress_counts(charge: FloatArray, b: float, rng: np.random.Generator) -> None:
    """Counts ``x / (1 + b x)``, rounded at random to whole electrons. Flat, in place."""
    gap = rng.standard_exponential()
    for i in range(charge.size):
        n = charge[i]
        if n == 0.0:
            continue
        loss = b * n * n
        if loss < 1e-3:
            # Rare losses of one electron: the gaps of a Poisson process of this rate (two in a pixel: 5e-7 of them).
            gap -= loss
            if gap < 0.0:
                charge[i] = n - 1.0
                gap = rng.standard_exponential()
            continue
        loss /= 1.0 + b * n
        whole = math.floor(loss)
        charge[i] = n - whole - (1.0 if rng.random() < loss - whole else 0.0)


@njit(cache=True)
def add_normal(level: FloatArray, sigma: float, rng: np.random.Generator) -> None:
    """Add Gaussian noise. Flat, in place."""
    for i in range(level.size):
        level[i] += sigma * rng.standard_normal()


@njit(cache=True)
def _binomial_expanded(n: float, p: float, rng: np.random.Generator) -> float:
    q = 1.0 - p
    variance = n * p * q
    third = variance * (1.0 - 2.0 * p)
    fourth = variance * (1.0 - 6.0 * p * q)
    return min(_expanded(n * p, variance, third, fourth, third * (1.0 - 12.0 * p * q), rng), n)


@njit(cache=True)
def _binomial_counted_up(u: float, none: float, n: float, p: float) -> float:
    """Binomial count whose distribution function reaches ``u``; ``none`` is the chance of none."""
    term = none
    total = none
    ratio = p / (1.0 - p)
    k = 0
    while u >= total and k < n and k < 127:
        term *= (n - k) * ratio * _INVERSE[k + 1]
        k += 1
        total += term
    return float(k)


@njit(cache=True)
def shift_back(
    charge: FloatArray, first: FloatArray, second: FloatArray, third: FloatArray, by_row: bool, rng: np.random.Generator
) -> float:
    """Leave charge behind in transfers along one axis, in place; returns what stays behind beyond the array's end.

    ``first``, ``second``, ``third`` are, per line, the chance of being left behind at least once, then a
    second and a third time given the one before; charge goes back by that many lines. ``by_row``: lines are rows, else
    columns. First losses are binomial; of them, further losses have the binomial mean and are rounded at random.
    """
    rows, columns = charge.shape
    length = rows if by_row else columns
    log_q = np.log1p(-first)
    lost = 0.0
    gap = rng.standard_exponential()
    for i in range(rows):
        r = rows - 1 - i
        for j in range(columns):
            c = columns - 1 - j
            n = charge[r, c]
            if n == 0.0:
                continue
            line = r if by_row else c
            if n * first[line] > 1.05 * _EXPANSION_ABOVE:
                one = _binomial_expanded(n, first[line], rng)
                if one == 0.0:
                    continue
            else:
                # The chance of none is exp(n log q): gaps of a process of rate -log q per electron skip the pixels
                # without a loss, exactly; where the gap ends, one electron at least is lost.
                gap += n * log_q[line]
                if gap > 0.0:
                    continue
                none = math.exp(n * log_q[line])
                u = none + (1.0 - none) * rng.random()
                one = max(_binomial_counted_up(u, none, n, first[line]), 1.0)
                gap = rng.standard_exponential()
            two = math.floor(one * second[line] + rng.random())
            three = math.floor(two * third[line] + rng.random()) if two > 0.0 else 0.0
            charge[r, c] = n - one
            for back in range(1, 4):
                amount = one - two if back == 1 else (two - three if back == 2 else three)
                if amount == 0.0:
                    continue
                if line + back >= length:
                    lost += amount
                elif by_row:
                    charge[r + back, c] += amount
                else:
                    charge[r, c + back] += amount
    return lost


@njit(cache=True)
def vertical_spill(charge: FloatArray, full_well: float, spilled: BoolArray) -> tuple[float, float]:
    """Spill charge above the full well along the columns, half each way, in place.

    Each half fills the free room of the pixels in its direction; what is left at the ends of the columns is returned
    (bottom, top). ``spilled`` is set where charge was cut off or arrived.
    """
    rows, columns = charge.shape
    bottom = 0.0
    top = 0.0
    flagged = np.zeros(columns, np.bool_)
    for r in range(rows):
        for c in range(columns):
            if charge[r, c] > full_well:
                flagged[c] = True
    for c in range(columns):
        if not flagged[c]:
            continue
        down = np.zeros(rows)
        carry = 0.0
        for r in range(rows):
            excess = charge[r, c] - full_well
            if excess > 0.0:
                down[r] = math.floor(excess / 2.0)
                charge[r, c] = full_well
                spilled[r, c] = True
            elif carry > 0.0:
                taken = min(-excess, carry)
                if taken > 0.0:
                    charge[r, c] += taken
                    carry -= taken
                    spilled[r, c] = True
            if excess > 0.0:
                carry += excess - down[r]
        top += carry
        carry = 0.0
        for step in range(rows):
            r = rows - 1 - step
            if carry > 0.0:
                taken = min(full_well - charge[r, c], carry)
                if taken > 0.0:
                    charge[r, c] += taken
                    carry -= taken
                    spilled[r, c] = True
            carry += down[r]
        bottom += carry
    return bottom, top


@njit(cache=True)
def serial_spill(charge: FloatArray, full_well: float, spilled: BoolArray) -> float:
    """Pass charge above the register's full well to the pixels read next, in place; returns what is left at row ends.

    ``spilled`` is set where charge was cut off or arrived.
    """
    rows, columns = charge.shape
    residue = 0.0
    for r in range(rows):
        carry = 0.0
        for c in range(columns):
            n = charge[r, c]
            if carry == 0.0 and n <= full_well:
                continue
            spilled[r, c] = True
            total = n + carry
            charge[r, c] = min(total, full_well)
            carry = max(total - full_well, 0.0)
        residue += carry
    return residue


@njit(cache=True)
def _from_table(
    n: int,
    rng: np.random.Generator,
    cdf: FloatArray,
    start: IntArray,
    guide: npt.NDArray[np.int32],
    guide_start: IntArray,
    guide_size: IntArray,
) -> float:
    u = rng.random()
    k = start[n] + guide[guide_start[n] + int(u * guide_size[n])]
    while cdf[k] <= u:
        k += 1
    return float(n + k - start[n])


@njit(cache=True)
def _smooth(n: float, gain: float, sigma_one: float, skew_one: float, rng: np.random.Generator) -> float:
    """Wilson-Hilferty variate of exact mean, variance and skewness, rounded (Sheppard's correction applied)."""
    z = rng.standard_normal()
    sigma = math.sqrt(sigma_one * sigma_one * n - 1.0 / 12.0)
    skew = skew_one / math.sqrt(n)
    if abs(skew) < 1e-6:
        x = sigma * (z + skew * (z * z - 1.0) / 6.0)
    else:
        root = 2.0 / skew
        a = root * root
        cube = 1.0 - 1.0 / (9.0 * a) + z / (3.0 * root)
        # The cube's own mean is above 1 by 1/(729 a^3).
        x = sigma * root * (cube * cube * cube - 1.0 - 1.0 / (729.0 * a * a * a))
    return max(math.floor(n * gain + x + 0.5), n)


@njit(cache=True)
def multiply_charge(
    charge: FloatArray,
    gain: float,
    sigma_one: float,
    skew_one: float,
    shape_one: float,
    rng: np.random.Generator,
    cdf: FloatArray,
    start: IntArray,
    guide: npt.NDArray[np.int32],
    guide_start: IntArray,
    guide_size: IntArray,
    n_direct: int,
    n_exact: float,
) -> None:
    """Charge at the output of the register, flat, in place.

    Up to ``n_exact`` electrons as sums of draws from the tabulated exact laws of up to ``n_direct`` electrons; above,
    from a law of the same mean, variance and skewness where the output is wide, of the same mean and variance where it
    is narrow.
    """
    for i in range(charge.size):
        n = charge[i]
        if n == 0.0:
            continue
        if n <= n_exact:
            left = int(n)
            total = 0.0
            while left > 0:
                part = min(left, n_direct)
                total += _from_table(part, rng, cdf, start, guide, guide_start, guide_size)
                left -= part
            charge[i] = total
        elif sigma_one * math.sqrt(n) > _SMOOTH_ABOVE_SIGMA:
            charge[i] = _smooth(n, gain, sigma_one, skew_one, rng)
        else:
            mean = rng.standard_gamma(n * shape_one) * ((gain - 1.0) / shape_one)
            charge[i] = n + _poisson(mean, math.exp(-mean), rng)


@njit(cache=True)
def compress(level: FloatArray, b: float) -> None:
    """``x / (1 + b x)``. Flat, in place."""
    for i in range(level.size):
        level[i] /= 1.0 + b * level[i]


@njit(cache=True)
def digitise(level: FloatArray, highest: float, out: npt.NDArray[np.uint16], clipped: BoolArray) -> int:
    """Round to whole ADU, cut off at 0 and ``highest``; flags and counts what was cut off. Flat arrays."""
    count = 0
    for i in range(level.size):
        value = np.rint(level[i])
        if value < 0.0 or value > highest:
            clipped[i] = True
            count += 1
            value = min(max(value, 0.0), highest)
        out[i] = np.uint16(value)
    return count
