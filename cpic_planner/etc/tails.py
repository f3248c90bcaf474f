"""Tails of the noise of one position of a residual: Gaussian noise and speckles of visits, of an estimated scale."""

import math

import numpy as np

from cpic_core import ArrayLike, FloatArray

# Beyond these a law is as good as its limit: known noise, and Gaussian speckles.
_KNOWN_DOF, _MANY_VISITS = 1e6, 1e6
_DROP, _STEPS = 23.0, 14  # of the logarithm of the integrand at the ends of the sum; of their search
_LEAST_LOG, _TERMS = -600.0, 18
_MOST_ROUNDS, _CLOSE = 80, 1e-11


def log_tail(snr: ArrayLike, laplace: ArrayLike, dof: ArrayLike = np.inf, visits: ArrayLike = 1.0) -> FloatArray:
    """Return the logarithm of the probability that noise alone reaches a level.

    Parameters
    ----------
    snr : array_like, shape (n,)
        Signal over estimated standard deviation, at least 0.
    laplace : array_like
        Share of the variance that is a sum of Laplace variates, 0 to 1; the rest is Gaussian.
    dof : array_like
        Degrees of freedom of the estimated variance, above 0; broadcasts.
    visits : array_like
        Number V of these variates, of equal variance, above 0; fractions allowed (`effective_visits`).

    Notes
    -----
    The light of two independent circular Gaussian fields differs by a Laplace variate. The sum of V of them is Gaussian
    noise of a variance that is a Gamma variate of shape V (variance-gamma law, Madan & Seneta 1990, J. Business 63,
    511), so that the noise has the characteristic function ``exp(-(1-s) t^2/2) (1 + s t^2/(2V))^-V``. The tail is the
    mean of Gaussian tails, of Student's where the scale is estimated, over that variate: a trapezoidal sum over its
    logarithm, around the largest term, to 1e-9 of the tail.
    """
    parts = (np.atleast_1d(np.asarray(part, np.float64)) for part in (snr, laplace, dof, visits))
    level, share, free, number = np.broadcast_arrays(*parts)
    share = np.where(number < _MANY_VISITS, share, 0.0)
    result = _scaled_tail(level, free)
    mixed = share > 0.0
    if mixed.any():
        result[mixed] = _mixed_tail(level[mixed], share[mixed], free[mixed], number[mixed])
    return result


def _mixed_tail(level: FloatArray, share: FloatArray, free: FloatArray, number: FloatArray) -> FloatArray:
    """Return the same as `log_tail`, for shares above 0, shape (n,)."""
    from scipy.special import gammaln, wrightomega

    few, squared = np.minimum(free, 1e9), level**2

    def exponent(log_ratio: FloatArray) -> FloatArray:
        """Return the logarithm of the integrand but for factors that vary slowly."""
        ratio = np.exp(log_ratio)
        variance = np.maximum(1.0 - share + share * ratio, 1e-300)
        return np.asarray(number * (log_ratio - ratio) - 0.5 * (few + 1.0) * np.log1p(squared / (few * variance)))

    # The largest term: a root of a convex falling function of the ratio, which Newton's steps reach from below.
    ratio, extra = np.ones(level.shape), squared / few
    for _ in range(_STEPS):
        variance = 1.0 - share + share * ratio
        pull = 0.5 * (few + 1.0) * share * extra / (variance * (variance + extra))
        slope = -number / ratio**2 - pull * share * (1.0 / variance + 1.0 / (variance + extra))
        change = (number / ratio - number + pull) / slope
        ratio = ratio - change
        if np.abs(change).max() < _CLOSE:
            break
    top = np.log(ratio)
    floor = exponent(top) - _DROP
    height = ratio - top + (0.5 * (few + 1.0) * np.log1p(extra / (1.0 - share + share * ratio)) + _DROP) / number
    inside, outside = np.stack([top, top]), np.stack([top - ratio - _DROP / number, np.log(2.0 * height + 2.0)])
    for _ in range(_STEPS):
        middle = 0.5 * (inside + outside)
        above = exponent(middle) > floor
        inside, outside = np.where(above, middle, inside), np.where(above, outside, middle)
    # In p with log G = p - exp(-p) the integrand falls doubly exponentially to both sides.
    low, high = outside + wrightomega(-outside)
    count = int(_TERMS + _TERMS / min(float(number.min()), 1e3))
    step = (high - low) / count
    places = low + step * np.arange(count + 1)[:, None]
    shrunk = np.exp(-places)
    logs = places - shrunk
    ratios = np.exp(logs)
    weights = number * (logs - ratios + np.log(number)) - gammaln(number) + np.log1p(shrunk)
    spread = np.sqrt(np.maximum(1.0 - share + share * ratios, 1e-300))
    return np.asarray(_log_sum(weights + _scaled_tail(level / spread, free)) + np.log(step))


def _scaled_tail(level: FloatArray, free: FloatArray) -> FloatArray:
    """Return the logarithm of the tail of Student's law, of the normal law for many degrees of freedom."""
    from scipy.special import betaln, hyp2f1, log_ndtr, stdtr

    free = np.broadcast_to(free, level.shape)
    known = free >= _KNOWN_DOF
    tail = np.empty(level.shape)
    tail[known] = log_ndtr(-level[known])
    if not known.all():
        number, value = free[~known], level[~known]
        with np.errstate(divide="ignore"):
            logs = np.log(stdtr(number, -value))
        far = logs < _LEAST_LOG  # where the tail itself is no number: the incomplete beta function's series
        half, below = 0.5 * number[far], 1.0 / (1.0 + value[far] ** 2 / number[far])
        series = np.log(hyp2f1(half, 0.5, half + 1.0, below)) - np.log(2.0 * half) - betaln(half, 0.5)
        logs[far] = half * np.log(below) + series
        tail[~known] = logs
    return tail


def _log_sum(logs: FloatArray) -> FloatArray:
    """Return the logarithm of the sum of exponentials over the first axis."""
    top = logs.max(axis=0)
    # Rows in memory are added alike, one or many: a sum over the first axis takes another order for a single column.
    terms = np.ascontiguousarray(np.exp(logs - top).T)
    return np.asarray(top + np.log(terms.sum(axis=-1)))


def equivalent_sigma(
    snr: ArrayLike, laplace: ArrayLike, dof: ArrayLike = np.inf, visits: ArrayLike = 1.0
) -> FloatArray:
    """Return the level of a standard normal variate that noise reaches as rarely.

    Parameters
    ----------
    snr : array_like
        Signal over estimated standard deviation, of any sign.
    laplace, dof, visits : array_like
        As of `log_tail`.
    """
    from scipy.special import ndtri_exp

    level = np.asarray(snr, np.float64)
    return np.asarray(np.copysign(ndtri_exp(log_tail(np.abs(level), laplace, dof, visits)), level))


def snr_at(sigma: float, laplace: ArrayLike, dof: ArrayLike = np.inf, visits: ArrayLike = 1.0) -> FloatArray:
    """Return the signal over estimated noise whose `equivalent_sigma` is ``sigma``, to 1e-9; false position.

    Parameters
    ----------
    sigma : float
        Level of a standard normal variate, above 0.
    laplace, dof, visits : array_like
        As of `log_tail`.
    """
    from scipy.special import log_ndtr

    parts = np.broadcast_arrays(*(np.atleast_1d(np.asarray(part, float)) for part in (laplace, dof, visits)))
    asked = float(log_ndtr(-sigma))

    def excess(logs: FloatArray) -> FloatArray:
        """Return the error of the square root of the tail's logarithm, which is nearly straight."""
        return np.sqrt(-log_tail(np.exp(logs), *parts)) - math.sqrt(-asked)

    # Tails are heavier than Gaussian ones: the level is not below.
    low = np.full(parts[0].shape, math.log(sigma) - 1e-6)
    high = low + 0.7
    below, above = excess(low), excess(high)
    while (short := above < 0.0).any():
        low, below = np.where(short, high, low), np.where(short, above, below)
        high = np.where(short, high + (high - math.log(sigma)), high)
        above = np.where(short, excess(high), above)
    middle, found, side = low, np.zeros(low.shape, bool), np.zeros(low.shape)
    for _ in range(_MOST_ROUNDS):
        middle = np.where(found, middle, (low * above - high * below) / (above - below))
        value = excess(middle)
        found |= np.abs(value) < _CLOSE
        if found.all():
            break
        # Illinois: an end that stays twice counts half, so that it moves soon.
        now = np.where(value > 0.0, 1.0, -1.0)
        again, right = now == side, now > 0.0
        below = np.where(right, np.where(again, 0.5 * below, below), value)
        above = np.where(right, value, np.where(again, 0.5 * above, above))
        low, high, side = np.where(right, low, middle), np.where(right, middle, high), now
    return np.asarray(np.exp(middle))
