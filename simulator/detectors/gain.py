"""The exact law of the multiplication register, tabulated for few electrons, and its cumulants.

One electron leaves a stage as ``1 + Bernoulli(p)`` electrons, so the generating function of the output is that of one
stage, ``f(z) = z (1 - p + p z)``, iterated over the stages; ``n`` electrons give its ``n``-th power. Evaluated on the
unit circle and transformed back, it is the whole distribution to rounding.

Electron multiplication: closed forms of the register's statistics, and a sampler.

A register of ``N`` identical stages turns ``x`` electrons into ``x + Binomial(x, p)`` at each stage, so the
mean gain is ``g = (1 + p)^N``. Mean and variance of the output follow in closed form (Robbins & Hadwen 2003
give the same excess noise factor, written ``2 (g - 1) g^(-(N+1)/N) + 1/g``).
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from cpic_core import (
    ArrayLike,
    ComplexArray,
    FloatArray,
    InputError,
    IntArray,
    NDArray,
    checked_array,
    element_name,
    load_kernels,
)

# Exponent of the probability left out at the upper end of a table, exp(-36) = 2e-16: half a step of a uniform number.
_TAIL = 36.0
MAX_ENTRIES = 450_000
MAX_DIRECT = 64
_GUIDE_SHARE = 4


class RegisterTable(NamedTuple):
    """Distribution functions of the output for 1 to ``n_direct`` electrons, one after the other.

    Attributes
    ----------
    cdf : ndarray
        Values of all distribution functions; that of ``n`` electrons starts at the output ``n``.
    start : ndarray of int64
        Where that of ``n`` electrons starts in ``cdf`` (index ``n``; index 0 is unused).
    guide : ndarray of int32
        For equal steps of probability, the first entry to look at, counted from the start; one step for two to four
        entries.
    guide_start, guide_size : ndarray of int64
        Place and length of each guide.
    n_direct : int
        Largest number of electrons with a table of its own.
    """

    cdf: FloatArray
    start: IntArray
    guide: NDArray[np.int32]
    guide_start: IntArray
    guide_size: IntArray
    n_direct: int


_PART = 16_384
"""Numbers that go through all stages of a register at a time."""


def generating_function(z: ComplexArray, probability: float, stages: int) -> ComplexArray:
    """Return the mean of ``z`` to the power of the output of one electron, for ``|z|`` at most 1.

    Parameters
    ----------
    z : ComplexArray
    probability : float
        Chance that an electron frees another one in a stage, 0 to 1.
    stages : int
        Stages of the multiplication register.
    """
    value = z.copy()
    # In parts that stay in the cache of the processor through all stages.
    flat = value.ravel()  # the same memory, as a copy lies in one piece
    for part in np.array_split(flat, flat.size // _PART + 1):
        more = np.empty_like(part)
        for _ in range(stages):
            np.multiply(probability, part, out=more)
            np.add(1.0 - probability, more, out=more)
            np.multiply(part, more, out=part)
    return value


def output_pmf(electrons: int, probability: float, stages: int, size: int) -> FloatArray:
    """Return the probabilities of 0 to ``size - 1`` electrons at the output (a power of two; the rest folds)."""
    return np.asarray(np.fft.irfft(_transform(probability, stages, size) ** electrons, size))


@functools.lru_cache(maxsize=64)
def output_cumulants(probability: float, stages: int) -> tuple[float, float, float, float, float]:
    """Return the first five cumulants of the output of one electron.

    The cumulant function of a stage is ``h(t) = t + log(1 - p + p e^t)``; that of the register is its iteration, whose
    derivatives at 0 follow by the chain rule (Faa di Bruno) stage by stage.

    Parameters
    ----------
    probability : float
        Chance that an electron frees another one in a stage, 0 to 1.
    stages : int
        Stages of the multiplication register.
    """
    p, q = probability, 1.0 - probability
    h1, h2, h3 = 1.0 + p, p * q, p * q * (q - p)
    h4, h5 = p * q * (1.0 - 6.0 * p * q), p * q * (q - p) * (1.0 - 12.0 * p * q)
    k1, k2, k3, k4, k5 = 1.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(stages):
        third, second = 10 * h1**2 * h3 + 15 * h1 * h2**2, 5 * h1 * h4 + 10 * h2 * h3
        k5 = h1**5 * k5 + 10 * h1**3 * h2 * k4 + third * k3 + second * k2 + h5 * k1
        k4 = h1**4 * k4 + 6 * h1**2 * h2 * k3 + (4 * h1 * h3 + 3 * h2**2) * k2 + h4 * k1
        k3 = h1**3 * k3 + 3 * h1 * h2 * k2 + h3 * k1
        k2 = h1**2 * k2 + h2 * k1
        k1 = h1 * k1
    return k1, k2, k3, k4, k5


@functools.lru_cache(maxsize=16)
def register_table(gain: float, probability: float, stages: int) -> RegisterTable:
    """Return the tables for one register; the last 16 are kept. 604 stages take 4 ms at gain 1.01 and 0.3 s at 1e4.

    Parameters
    ----------
    gain : float
        Gain of the multiplication register, at least 1.
    probability : float
        Chance that an electron frees another one in a stage, 0 to 1.
    stages : int
        Stages of the multiplication register.
    """
    sizes = [_entries(n, gain) for n in range(1, MAX_DIRECT + 1)]
    n_direct = max(int(np.searchsorted(np.cumsum(sizes), MAX_ENTRIES, side="right")), 1)
    size = 1 << (sizes[n_direct - 1] + n_direct).bit_length()
    one = _transform(probability, stages, size)
    power = np.ones_like(one)
    functions, guides = [], []
    for n in range(1, n_direct + 1):
        power = power * one
        pmf = np.maximum(np.fft.irfft(power, size), 0.0)[n:]
        function = np.cumsum(pmf)
        function /= function.max()
        function = function[: sizes[n - 1]].copy()
        function[-1] = 2.0
        # A power of two: the step of a uniform number is then found without rounding.
        steps = 1 << math.ceil(math.log2(function.size / _GUIDE_SHARE))
        functions.append(function)
        guides.append(np.searchsorted(function, np.arange(steps) / steps, side="right").astype(np.int32))
    guide_size = np.array([0, *(guide.size for guide in guides)], dtype=np.int64)
    laws, hints = (np.concatenate(functions), _starts(functions)), (np.concatenate(guides), _starts(guides))
    return RegisterTable(*laws, *hints, guide_size=guide_size, n_direct=n_direct)


def _starts(parts: list[FloatArray] | list[NDArray[np.int32]]) -> IntArray:
    return np.cumsum([0, 0, *(part.size for part in parts[:-1])], dtype=np.int64)


def _entries(electrons: int, gain: float) -> int:
    """Return the outputs up to which the tail, that of a sum of exponentials, is below exp(-36)."""
    return int(gain * (electrons + math.sqrt(2.0 * electrons * _TAIL) + _TAIL)) + 32


def _transform(probability: float, stages: int, size: int) -> ComplexArray:
    return generating_function(np.exp(-2j * np.pi * np.fft.rfftfreq(size)), probability, stages)


GAIN_LIMIT = 1e4
MAX_ELECTRONS = 10**12
# Below this many stages the output can be narrower than any negative binomial; the cascade itself is then
# cheap.
_CASCADE_BELOW_STAGES = 16
# The exact law serves this many electrons, and so many times as many as have a table of their own.
_EXACT_TO = 24
_MAX_LOOKUPS = 3


def stage_probability(gain: ArrayLike, stages: int = 604) -> FloatArray:
    """Return the probability that one electron makes a second one in one stage.

    Parameters
    ----------
    gain : array_like
        Mean gain of the whole register, 1 to 1e4 and at most ``2**stages``.
    stages : int, optional
        Number of identical stages, at least 1.

    Returns
    -------
    ndarray
        ``p = expm1(log(gain) / stages)``, 0 to 1; full relative precision down to ``gain - 1`` of 1e-16.

    Raises
    ------
    InputError
        If ``gain`` or ``stages`` is out of range or not finite.
    """
    return _probability(_checked_gain(gain, stages), stages)


def excess_noise_factor2(gain: ArrayLike, stages: int = 604) -> FloatArray:
    """Return the squared excess noise factor for Poisson input.

    ``F^2 = Var(out) / (g^2 Var(in)) = 1 + (1 - 1/g) (1 - p) / (1 + p)``: 1 at gain 1, near 2 at high gain.
    Parameters and errors as `stage_probability`.

    Parameters
    ----------
    gain : array_like
        Gain of the multiplication register, at least 1.
    stages : int, optional
        Stages of the multiplication register.
    """
    return noise_factor2(_checked_gain(gain, stages), stages)


def noise_factor2(gain: FloatArray, stages: int) -> FloatArray:
    """Return the same as `excess_noise_factor2`, without checks.

    Parameters
    ----------
    gain : ndarray
        Gain of the multiplication register, at least 1.
    stages : int
        Stages of the multiplication register.
    """
    p = _probability(gain, stages)
    return 1.0 + (gain - 1.0) / gain * (1.0 - p) / (1.0 + p)


def multiply(electrons: ArrayLike, gain: float, *, rng: np.random.Generator, stages: int = 604) -> IntArray:
    """Return the electrons after the multiplication register.

    Parameters
    ----------
    electrons : array_like
        Whole electrons at the register input, of an integer type, any shape, 0 to 1e12.
    gain : float
        Mean gain of the register, 1 to 1e4 and at most ``2**stages``.
    rng : numpy.random.Generator
        Source of random numbers.
    stages : int, optional
        Number of stages, at least 1.

    Returns
    -------
    ndarray of int64
        Electrons at the output, same shape, never fewer than at the input; 0 stays 0, and gain 1 is the
        identity.

    Raises
    ------
    InputError
        For negative, floating-point, NaN, infinite or too large charge (naming the pixel), a gain or number of
        stages out of range, or an ``rng`` that is not a generator.

    Notes
    -----
    Up to 24 electrons, and up to three times as many as have a table of their own (60 at gain 300, 192 up to 20), are
    drawn from the exact law of the cascade (`simulator.detectors.gain`). More come from a smooth law of the exact
    mean, variance and skewness, whose distribution function is within 0.0005 of the cascade's; where the output is
    narrower than 20 electrons from an expansion in five exact cumulants, or from a negative binomial of exact mean and
    variance where it has a few values only. Registers of fewer than 16 stages are sampled stage by stage, which is
    exact. From 16 stages on, what a pixel draws depends on its own charge and place alone.
    """
    if not isinstance(rng, np.random.Generator):
        raise InputError("rng", type(rng).__name__, allowed="a numpy.random.Generator")
    g_array = _checked_gain(gain, stages)
    if g_array.ndim:
        raise InputError("gain", gain, allowed="one number")
    output = _checked_electrons(electrons)
    if float(g_array) == 1.0:
        return output
    charge = output.astype(np.float64)
    amplify(charge.ravel(), float(g_array), stages, rng)
    return charge.astype(np.int64)


def amplify(charge: FloatArray, gain: float, stages: int, rng: np.random.Generator) -> None:
    """Multiply without checks, in place: a flat array of whole electrons; fractions are rounded at random first."""
    kernels = load_kernels("simulator.detectors.kernels")
    if gain == 1.0:
        return
    p = float(_probability(np.float64(gain), stages))
    kernels.round_stochastic(charge, pixel_keys(rng))
    if stages < _CASCADE_BELOW_STAGES:
        filled = np.flatnonzero(charge)
        counts = charge[filled].astype(np.int64)
        for _ in range(stages):
            counts += rng.binomial(counts, p)
        charge[filled] = counts
        return
    table = register_table(gain, p, stages)
    cumulants, n_exact = np.array(output_cumulants(p, stages)), float(max(_MAX_LOOKUPS * table.n_direct, _EXACT_TO))
    kernels.multiply_charge(charge, gain, cumulants, added_shape(gain, p), pixel_keys(rng), *table, n_exact)


def added_shape(gain: float, probability: float) -> float:
    """Return the shape of the negative binomial law with mean and variance of the electrons that one electron adds.

    Parameters
    ----------
    gain : float
        Gain of the multiplication register, at least 1.
    probability : float
        Chance that an electron frees another one in a stage, 0 to 1.
    """
    # (g (1-p)/(1+p) - 1) (1+p) = (g - 1) - p (g + 1), free of cancellation as g -> 1.
    return (gain - 1.0) * (1.0 + probability) / ((gain - 1.0) - probability * (gain + 1.0))


def pixel_keys(rng: np.random.Generator) -> NDArray[np.uint64]:
    """Return two keys, from which kernels hash one uniform number per pixel and draw."""
    return rng.integers(0, 2**64, size=2, dtype=np.uint64)


def _probability(g: FloatArray | np.float64, stages: int) -> FloatArray:
    return np.expm1(np.log1p(g - 1.0) / stages)


def _checked_gain(gain: ArrayLike, stages: int) -> FloatArray:
    if isinstance(stages, bool) or not isinstance(stages, int | np.integer) or stages < 1:
        raise InputError("stages", stages, allowed="an integer of at least 1")
    limit = min(GAIN_LIMIT, 2.0 ** min(int(stages), 60))
    return checked_array("gain", gain, low=1.0, high=limit)


def _checked_electrons(electrons: ArrayLike) -> IntArray:
    """Return a copy as int64, refused by name and pixel unless whole numbers of an integer type from 0 to 1e12."""
    allowed = f"whole electrons (integers), 0 to {MAX_ELECTRONS:.0e}"
    try:
        given = np.asarray(electrons)
    except ValueError:
        raise InputError("electrons", type(electrons).__name__, unit="e-", allowed=allowed) from None
    if given.size == 0 and given.dtype.kind == "f":
        return np.zeros(given.shape, dtype=np.int64)
    if given.dtype.kind not in "iuf":
        raise InputError("electrons", f"array of {given.dtype}", unit="e-", allowed=allowed)
    good = (given >= 0) & (given <= MAX_ELECTRONS)
    if not good.all():
        name, index = element_name("electrons", ~np.asarray(good))
        raise InputError(name, given[index].item(), unit="e-", allowed=allowed)
    if given.dtype.kind == "f":
        name, index = element_name("electrons", given == given)
        raise InputError(
            name, given[index].item(), unit="e-", allowed=allowed, hint="draw counts first, or round to integers"
        )
    return np.array(given, dtype=np.int64, order="C")


# ln G = a + b v + c v^2 + d v^3, v = V - 39 V - 0.029 V/K (T - 223 K), fitted to the curves of the e2v CCD201-20 data
# sheet (gain against clock amplitude, 223 K to 293 K, read to 10 %). Its slope has no zero: one voltage per gain.
_A, _B, _C, _D = 0.582, 0.860, -0.0530, 0.01465
_REFERENCE_V, _REFERENCE_K, _V_PER_K = 39.0, 223.0, 0.029
TEMPERATURE_RANGE_K = (120.0, 320.0)


def em_voltage_of(em_gain: ArrayLike, temperature_k: ArrayLike) -> FloatArray:
    """Return the clock voltage that gives a gain at a temperature.

    Parameters
    ----------
    em_gain : array_like
        Gain of the register, 1 to 1e4.
    temperature_k : array_like
        Temperature of the detector, 120 to 320 K; broadcasts.

    Returns
    -------
    ndarray
        Amplitude of the high-voltage clock, V; for gain 1 the highest that gives it. The gain of that voltage, against
        the data sheet of the e2v CCD201-20: within 15 % for gains of 5 to 300 at 223 K to 273 K, 28 % low at gain 5.5
        and 293 K, up to 40 % high near gain 1000; below gain 5 only good (15 %) at 223 K and 233 K.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.
    """
    gain = checked_array("em_gain", em_gain, low=1.0, high=GAIN_LIMIT)
    low, high = TEMPERATURE_RANGE_K
    temperature = checked_array("temperature_k", temperature_k, low=low, high=high, unit="K")
    # The one real root of the cubic (Vieta's hyperbolic form): with v = t - c/3d it reads t^3 + p t + q = 0, p > 0.
    shift = _C / (3.0 * _D)
    p = _B / _D - 3.0 * shift**2
    q = 2.0 * shift**3 - shift * _B / _D + (_A - np.log(gain)) / _D
    t = -2.0 * np.sqrt(p / 3.0) * np.sinh(np.arcsinh(1.5 * q / p * np.sqrt(3.0 / p)) / 3.0)
    return np.asarray(t - shift + _REFERENCE_V + _V_PER_K * (temperature - _REFERENCE_K))
