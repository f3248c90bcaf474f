"""Law of one position of a matched-filtered residual: Gaussian noise and speckles, with a scale that is estimated."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["equivalent_sigma", "log_tail", "snr_at"]

FloatArray = npt.NDArray[np.float64]
_LEAST_SHARE, _MOST_SHARE = 1e-3, 0.98
# Range of the logarithm of the squared scale: beyond it the chi-square of 3 degrees of freedom holds 1e-4 of its mass.
_LOG_SCALE2 = np.linspace(-7.0, 2.5, 191)[:, None]
_KNOWN_DOF = 1e4


def log_tail(snr: npt.ArrayLike, laplace: npt.ArrayLike, dof: npt.ArrayLike = np.inf) -> FloatArray:
    """Logarithm of the probability that noise alone reaches a level.

    Parameters
    ----------
    snr : array_like, shape (n,)
        Signal over estimated standard deviation, at least 0.
    laplace : array_like
        Share of the variance that follows a Laplace law, 0 to 1; the rest is Gaussian.
    dof : array_like
        Degrees of freedom of the estimated variance, above 0; broadcasts.

    Notes
    -----
    The light of two independent circular Gaussian fields differs by a Laplace variate; its sum with Gaussian noise has
    the tail ``Phi(-x) + exp(y^2/2) [exp(-t/b) Phi(x - y) - exp(t/b) Phi(-x - y)] / 2`` with ``x = t/s, y = s/b``
    (normal-Laplace law, Reed & Jorgensen 2004, Commun. Stat. Theory Methods 33, 1733). The mean over the estimated
    scale is taken numerically; without a Laplace share it is Student's t.
    """
    level, share, free = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(part, np.float64)) for part in (snr, laplace, dof))
    )
    tail = np.empty(level.shape)
    known = free >= _KNOWN_DOF
    tail[known] = _known_scale(level[known], share[known])
    if not known.all():
        from scipy.special import gammaln, logsumexp

        half = 0.5 * free[~known]
        weight = half * (np.log(half) + _LOG_SCALE2 - np.exp(_LOG_SCALE2)) - gammaln(half)
        at_scale = _known_scale(level[~known] * np.exp(0.5 * _LOG_SCALE2), share[~known])
        tail[~known] = logsumexp(at_scale + weight, axis=0) - logsumexp(weight, axis=0)
    return tail


def equivalent_sigma(snr: npt.ArrayLike, laplace: npt.ArrayLike, dof: npt.ArrayLike = np.inf) -> FloatArray:
    """Level of a standard normal variate that noise reaches as rarely; as `log_tail`, with ``snr`` of any sign."""
    from scipy.special import ndtri_exp

    level = np.asarray(snr, np.float64)
    return np.asarray(np.copysign(ndtri_exp(log_tail(np.abs(level), laplace, dof)), level))


def snr_at(sigma: float, laplace: npt.ArrayLike, dof: npt.ArrayLike = np.inf) -> FloatArray:
    """Signal over estimated noise whose `equivalent_sigma` is ``sigma``, to 1e-6; bisection."""
    share, free = np.broadcast_arrays(np.atleast_1d(np.asarray(laplace, float)), np.asarray(dof, float))
    low, high = np.zeros(share.shape), np.full(share.shape, np.log(1e6))
    for _ in range(45):
        middle = 0.5 * (low + high)
        above = equivalent_sigma(np.expm1(middle), share, free) >= sigma
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(np.expm1(high))


def _known_scale(level: FloatArray, share: FloatArray) -> FloatArray:
    from scipy.special import log_ndtr

    heavy = np.clip(share, _LEAST_SHARE, _MOST_SHARE)
    width, fall = np.sqrt(1.0 - heavy), np.sqrt(0.5 * heavy)
    x, y = level / width, width / fall
    gauss = log_ndtr(-x)
    right = 0.5 * y**2 - level / fall + log_ndtr(x - y)
    left = 0.5 * y**2 + level / fall + log_ndtr(-x - y)
    # The terms of a Gaussian law with next to no Laplace share cancel: it is then better alone.
    top = np.maximum(gauss, right)
    total = np.exp(gauss - top) + 0.5 * (np.exp(right - top) - np.exp(left - top))
    return np.where(share > _LEAST_SHARE, top + np.log(np.maximum(total, 1e-300)), log_ndtr(-level))
