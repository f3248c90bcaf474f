"""Compiled kernels of random charge: collection, transfer, register.

These kernels and what they call live in this file, since the disk cache of compiled code does not see edits elsewhere.
They take checked input only. Charge is float64 holding whole electrons, exact up to 2**53; what is moved is conserved
exactly. Importing this module loads the compiler: do it inside functions.

Random numbers belong to a pixel: `_bits` hashes two keys, the pixel and the number of the draw. What one pixel draws
depends on no other pixel's charge.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from cpic_core import BoolArray, FloatArray, IntArray

Keys = npt.NDArray[np.uint64]

# Counts of smaller variance come from their cumulated probabilities, term by term. Larger ones come from the
# Cornish-Fisher expansion of a rounded variate, whose own variance is smaller by that of the rounding (1/12, Sheppard's
# correction): at this variance the distribution function is off by 3e-5, falling as the square.
_EXPANSION_ABOVE = 10.0
# Divisions by small whole numbers, the slowest part of a sum of probabilities, are products with these.
_INVERSE = 1.0 / np.maximum(np.arange(128.0), 1.0)
# Outputs of the register wider than this are drawn from a smooth law of three moments.
_SMOOTH_ABOVE_VARIANCE = 400.0

# Ziggurat of the normal law (Marsaglia & Tsang 2000): 256 layers of equal area; the edge of the lowest solves
# r f(r) + integral of f beyond r = area, with f(x) = exp(-x^2 / 2).
_EDGE, _AREA = 3.6541528853610088, 0.00492867323399


def _layers() -> FloatArray:
    """Return the widths of the layers from the lowest, with the density at their upper ends: two rows of 257."""
    width = np.zeros(257)
    width[0], width[1] = _AREA / math.exp(-0.5 * _EDGE**2), _EDGE
    for i in range(2, 256):
        width[i] = math.sqrt(-2.0 * math.log(_AREA / width[i - 1] + math.exp(-0.5 * width[i - 1] ** 2)))
    return np.stack([width, np.exp(-0.5 * width**2)])


_LAYERS = _layers()

# Finaliser of splitmix64 (Steele, Lea & Flood 2014), with a second key between its rounds.
_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11, _DRAW = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11), np.uint64(40)
_LAYER, _SIGN = np.uint64(255), np.uint64(256)
_S32, _LOW32, _STEP32 = np.uint64(32), np.uint64(2**32 - 1), 2.0**-32
# Pixels whose first draws are hashed at once.
_CHUNK = 1024


@njit(cache=True, inline="always")
def _bits(keys: Keys, pixel: int, draw: int) -> int:
    """Return the 64 random bits of a pixel's draw."""
    z = keys[0] + (np.uint64(pixel) + (np.uint64(draw) << _DRAW)) * _STEP
    z = ((z ^ (z >> _S30)) * _FIRST) ^ keys[1]
    z = (z ^ (z >> _S27)) * _SECOND
    bits: int = z ^ (z >> _S31)
    return bits


@njit(cache=True, inline="always")
def _uniform(keys: Keys, pixel: int, draw: int) -> float:
    """Return the uniform number in (0, 1) of a pixel's draw."""
    return (float(_bits(keys, pixel, draw) >> _S11) + 0.5) * 1.1102230246251565e-16


@njit(cache=True)
def _fill_bits(keys: Keys, first: int, draw: int, out: Keys) -> None:
    """Fill in the bits of one draw of consecutive pixels: a loop without branches, of which several run at a time."""
    for i in range(out.size):
        out[i] = _bits(keys, first + i, draw)


@njit(cache=True, inline="always")
def _share(bits: int) -> float:
    """Return the uniform number in (0, 1) of 64 bits."""
    return (float(bits >> _S11) + 0.5) * 1.1102230246251565e-16


@njit(cache=True)
def _normal(z: int, keys: Keys, pixel: int) -> float:
    """Return a normal number from the bits ``z`` of a pixel's draw, in 1.2 % of cases with help of draws 16 on."""
    draw = 16
    while True:
        layer = np.int64(z & _LAYER)
        x = float(z >> _S11) * 1.1102230246251565e-16 * _LAYERS[0, layer]
        inside = x < _LAYERS[0, layer + 1]
        if not inside and layer == 0:
            # Beyond the edge: the tail by exponentials (Marsaglia 1964).
            while True:
                x = -math.log(_uniform(keys, pixel, draw + 1)) / _EDGE
                draw += 2
                if -2.0 * math.log(_uniform(keys, pixel, draw)) > x * x:
                    break
            x += _EDGE
            inside = True
        elif not inside:
            low, high = _LAYERS[1, layer], _LAYERS[1, layer + 1]
            draw += 1
            inside = low + _uniform(keys, pixel, draw) * (high - low) < math.exp(-0.5 * x * x)
        if inside:
            value: float = -x if z & _SIGN else x
            return value
        draw += 1
        z = _bits(keys, pixel, draw)


@njit(cache=True)
def _expanded(z: float, mean: float, variance: float, third: float, fourth: float, fifth: float) -> float:
    """Return a rounded Cornish-Fisher variate of a law of whole numbers with these cumulants; ``z`` is normal."""
    v = variance - 1.0 / 12.0
    inverse = 1.0 / v
    s = math.sqrt(v)
    skew = third * s * inverse * inverse
    excess = (fourth + 1.0 / 120.0) * inverse * inverse
    fifth = fifth * s * inverse * inverse * inverse
    z2 = z * z
    x = z + (z2 - 1.0) * skew / 6.0
    x += z * ((z2 - 3.0) * excess / 24.0 - (2.0 * z2 - 5.0) * skew * skew / 36.0)
    x += (z2 * (z2 - 6.0) + 3.0) * fifth / 120.0 - (z2 * (z2 - 5.0) + 2.0) * skew * excess / 24.0
    x += (z2 * (12.0 * z2 - 53.0) + 17.0) * skew * skew * skew / 324.0
    return max(math.floor(mean + s * x + 0.5), 0.0)


@njit(cache=True)
def _counted_up(u: float, mean: float, zero: float) -> float:
    """Return the Poisson count whose distribution function reaches ``u``; ``zero`` is exp(-mean)."""
    k = 0
    term = zero
    total = zero
    while u >= total and k < 100:
        k += 1
        term *= mean * _INVERSE[k]
        total += term
    return float(k)


@njit(cache=True)
def draw_poisson(mean: FloatArray, zero: FloatArray, keys: Keys, out: FloatArray) -> None:
    """Draw Poisson counts of flat arrays; ``zero`` is exp(-mean)."""
    bits = np.empty(_CHUNK, np.uint64)
    for first in range(0, mean.size, _CHUNK):
        _fill_bits(keys, first, 0, bits)
        for i in range(first, min(first + _CHUNK, mean.size)):
            m = mean[i]
            z = bits[i - first]
            if m > _EXPANSION_ABOVE:
                out[i] = _expanded(_normal(z, keys, i), m, m, m, m, m)
            else:
                u = _share(z)
                out[i] = 0.0 if u < zero[i] else _counted_up(u, m, zero[i])


@njit(cache=True)
def round_stochastic(charge: FloatArray, keys: Keys) -> None:
    """Round to whole electrons, up with the probability of the fraction, so that the mean stays. Flat, in place."""
    for i in range(charge.size):
        whole = math.floor(charge[i])
        if charge[i] != whole:
            charge[i] = whole + 1.0 if _uniform(keys, i, 0) < charge[i] - whole else whole


@njit(cache=True)
def compress_counts(charge: FloatArray, b: float, full_well: float, keys: Keys) -> None:
    """Draw counts ``x / (1 + b x)`` up to the full well, rounded at random to whole electrons; what spills is kept.

    Flat, in place.
    """
    bits = np.empty(_CHUNK, np.uint64)
    for first in range(0, charge.size, _CHUNK):
        _fill_bits(keys, first, 0, bits)
        for i in range(first, min(first + _CHUNK, charge.size)):
            n = min(charge[i], full_well)
            loss = b * n * n
            u = _share(bits[i - first])
            if u > loss and loss < 1.0:  # the curve's loss is below that of its parabola: most pixels end here
                continue
            loss /= 1.0 + b * n
            whole = math.floor(loss)
            charge[i] -= whole + (1.0 if u < loss - whole else 0.0)


@njit(cache=True)
def add_normal(level: FloatArray, sigma: float, rng: np.random.Generator) -> None:
    """Add Gaussian noise. Flat, in place."""
    for i in range(level.size):
        level[i] += sigma * rng.standard_normal()


@njit(cache=True)
def _binomial_expanded(z: float, n: float, p: float) -> float:
    q = 1.0 - p
    variance = n * p * q
    third = variance * (1.0 - 2.0 * p)
    fourth = variance * (1.0 - 6.0 * p * q)
    return min(_expanded(z, n * p, variance, third, fourth, third * (1.0 - 12.0 * p * q)), n)


@njit(cache=True)
def _binomial_counted_up(u: float, n: float, p: float, log_q: float) -> float:
    """Return the binomial count whose distribution function reaches ``u``; ``log_q`` is log(1 - p)."""
    term = math.exp(n * log_q)
    total = term
    ratio = p / (1.0 - p)
    k = 0
    while u >= total and k < n and k < 127:
        term *= (n - k) * ratio * _INVERSE[k + 1]
        k += 1
        total += term
    return float(k)


@njit(cache=True)
def shift_back(
    charge: FloatArray, first: FloatArray, second: FloatArray, third: FloatArray, by_row: bool, keys: Keys
) -> float:
    """Leave charge behind in transfers along one axis, in place; returns what stays behind beyond the array's end.

    ``first``, ``second``, ``third`` are, per line, the chance of being left behind at least once (below 1/2), then a
    second and a third time given the one before; charge goes back by that many lines. ``by_row``: lines are rows, else
    columns. First losses are binomial; of them, further losses have the binomial mean and are rounded at random.
    """
    rows, columns = charge.shape
    length = rows if by_row else columns
    log_q = np.log1p(-first)
    bits = np.empty(columns, np.uint64)
    lost = 0.0
    for i in range(rows):
        r = rows - 1 - i
        _fill_bits(keys, r * columns, 0, bits)
        for j in range(columns):
            c = columns - 1 - j
            n = charge[r, c]
            line = r if by_row else c
            mean = n * first[line]
            u = _share(bits[c])
            # The chance of none is at least 1 - n p: most draws of rare events end here.
            if u < 1.0 - mean:
                continue
            pixel = r * columns + c
            if mean * (1.0 - first[line]) > _EXPANSION_ABOVE:
                one = _binomial_expanded(_normal(bits[c], keys, pixel), n, first[line])
            else:
                one = _binomial_counted_up(u, n, first[line], log_q[line])
            if one == 0.0:
                continue
            again = _bits(keys, pixel, 1)
            two = math.floor(one * second[line] + float(again >> _S32) * _STEP32)
            three = math.floor(two * third[line] + float(again & _LOW32) * _STEP32) if two > 0.0 else 0.0
            charge[r, c] = n - one
            down, across = (1, 0) if by_row else (0, 1)
            if line + 3 < length:
                charge[r + down, c + across] += one - two
                if two > 0.0:
                    charge[r + 2 * down, c + 2 * across] += two - three
                    charge[r + 3 * down, c + 3 * across] += three
                continue
            for back in range(1, 4):
                amount = one - two if back == 1 else (two - three if back == 2 else three)
                if line + back < length:
                    charge[r + back * down, c + back * across] += amount
                else:
                    lost += amount
    return lost


@njit(cache=True)
def _smooth(z: float, n: float, gain: float, variance: float, skew: float) -> float:
    """Return a Wilson-Hilferty variate of exact mean, variance and skewness, rounded (with Sheppard's correction)."""
    sigma = math.sqrt(variance - 1.0 / 12.0)
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
def _added(u: float, mean: float, shape: float) -> float:
    """Return the negative binomial count of few electrons whose distribution function reaches ``u``."""
    odds = mean / shape
    term = math.exp(-shape * math.log1p(odds))
    total = term
    k = 0
    while u >= total and k < 127:
        term *= (k + shape) * _INVERSE[k + 1] * odds / (1.0 + odds)
        k += 1
        total += term
    return float(k)


@njit(cache=True)
def multiply_charge(
    charge: FloatArray,
    gain: float,
    cumulants: FloatArray,
    shape_one: float,
    keys: Keys,
    cdf: FloatArray,
    start: IntArray,
    guide: npt.NDArray[np.int32],
    guide_start: IntArray,
    guide_size: IntArray,
    n_direct: int,
    n_exact: float,
) -> None:
    """Draw charge at the output of the register, flat, in place; ``cumulants`` are those of one electron's output.

    Up to ``n_exact`` electrons as sums of draws from the tabulated exact laws of up to ``n_direct`` electrons. Above,
    from a smooth law of the same mean, variance and skewness where the output is wide, from the expansion in five
    cumulants where it is narrower, and from a negative binomial of the same mean and variance where it has few values.
    """
    skew_one = cumulants[2] / cumulants[1] ** 1.5
    bits = np.empty(_CHUNK, np.uint64)
    for first in range(0, charge.size, _CHUNK):
        _fill_bits(keys, first, 0, bits)
        for i in range(first, min(first + _CHUNK, charge.size)):
            n = charge[i]
            if n == 0.0:
                continue
            z = bits[i - first]
            if n <= n_exact:
                left = int(n)
                total = 0.0
                draw = 0
                while left > 0:
                    part = min(left, n_direct)
                    u = _share(z if draw == 0 else _bits(keys, i, draw))
                    k = start[part] + guide[guide_start[part] + int(u * guide_size[part])]
                    while cdf[k] <= u:
                        k += 1
                    total += part + k - start[part]
                    left -= part
                    draw += 1
                charge[i] = total
                continue
            variance = n * cumulants[1]
            if variance > _SMOOTH_ABOVE_VARIANCE:
                charge[i] = _smooth(_normal(z, keys, i), n, gain, variance, skew_one / math.sqrt(n))
            elif variance > _EXPANSION_ABOVE:
                third, fourth, fifth = n * cumulants[2], n * cumulants[3], n * cumulants[4]
                extra = _expanded(_normal(z, keys, i), n * (gain - 1.0), variance, third, fourth, fifth)
                charge[i] = n + extra
            else:
                charge[i] = n + _added(_share(z), n * (gain - 1.0), n * shape_one)


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
def compress(level: FloatArray, b: float) -> None:
    """Bend counts to ``x / (1 + b x)``. Flat, in place."""
    for i in range(level.size):
        level[i] /= 1.0 + b * level[i]


@njit(cache=True)
def digitise(level: FloatArray, highest: float, out: npt.NDArray[np.uint16], clipped: BoolArray) -> int:
    """Round to whole ADU, cut off at 0 and ``highest``; flag and count what was cut off. Flat arrays."""
    count = 0
    for i in range(level.size):
        value = np.rint(level[i])
        if value < 0.0 or value > highest:
            clipped[i] = True
            count += 1
            value = min(max(value, 0.0), highest)
        out[i] = np.uint16(value)
    return count
