"""Poisson counts at any mean up to 1e17."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["poisson_counts", "scattered_events"]

# NumPy's rejection step compares log-probabilities of size mean * log(mean): beyond this mean their rounding
# error approaches the width of the accepted band, while the expansion below is exact to 1e-9 of a sigma.
_EXPANSION_ABOVE = 1e9


def poisson_counts(mean: npt.NDArray[np.float64], rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Poisson counts of the given means (finite, 0 to 1e17, checked by the caller).

    NumPy's sampler up to 1e9; above it the one-term Cornish-Fisher expansion
    ``m + sqrt(m) z + (z^2 - 1)/6``, whose error in the distribution is below 1e-9 there.
    """
    large = mean > _EXPANSION_ABOVE
    if not large.any():
        return np.asarray(rng.poisson(mean), dtype=np.int64)
    counts = np.asarray(rng.poisson(np.where(large, 0.0, mean)), dtype=np.int64)
    m = mean[large]
    z = rng.standard_normal(m.size)
    counts[large] = np.rint(m + np.sqrt(m) * z + (z * z - 1.0) / 6.0).astype(np.int64)
    return counts


def scattered_events(mean_per_pixel: float, shape: tuple[int, ...], rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Poisson counts of one small mean in every pixel, drawn as events thrown at random pixels.

    Identical in law to ``rng.poisson(mean_per_pixel, shape)`` (a Poisson number of independent, uniformly
    placed events) and far cheaper when the mean is small.
    """
    size = int(np.prod(shape))
    if size == 0 or mean_per_pixel == 0.0:
        return np.zeros(shape, dtype=np.int64)
    if mean_per_pixel > 0.5:
        return np.asarray(rng.poisson(mean_per_pixel, shape), dtype=np.int64)
    places = rng.integers(0, size, size=int(rng.poisson(mean_per_pixel * size)))
    return np.bincount(places, minlength=size).reshape(shape)
