"""Sampling of a product of two sampled functions, so that it may again be taken as linear between its samples."""

from __future__ import annotations

import numpy as np

__all__ = ["product_samples"]

_TOLERANCE = 1.5e-6
"""Largest error of the straight line between two samples, relative to the mean of the product there."""


def product_samples(
    x1: np.ndarray, y1: np.ndarray, x2: np.ndarray, y2: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample the product of two functions that are linear between their samples.

    Between two neighbours of the union of both samplings the product is a parabola. Each such segment is divided until
    a straight line is within 1.5e-6 of it, so that integrals, which see two thirds of that, are right to 1e-6.

    Parameters
    ----------
    x1, y1, x2, y2 : ndarray
        Increasing positions and values, none negative.

    Returns
    -------
    x, first, second : ndarray, shape (n,)
        Positions within the common range, and both functions there.
    """
    low, high = max(x1[0], x2[0]), min(x1[-1], x2[-1])
    union = np.union1d(x1, x2)
    union = np.unique(np.concatenate([[low, high], union[(union > low) & (union < high)]]))
    product = np.interp(union, x1, y1) * np.interp(union, x2, y2)
    middle = 0.5 * (union[1:] + union[:-1])
    there = np.interp(middle, x1, y1) * np.interp(middle, x2, y2)
    ends = 0.5 * (product[1:] + product[:-1])
    bend, mean = np.abs(there - ends), (ends + 2.0 * there) / 3.0
    # Both factors are nowhere negative, so a mean of 0 means no bend; the bend is never above 1.5 times the mean.
    relative = np.divide(bend, mean, out=np.zeros_like(bend), where=mean > 0.0)
    pieces = np.maximum(np.ceil(np.sqrt(relative / _TOLERANCE)), 1.0).astype(np.int64)
    position = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    x = np.append(np.repeat(union[:-1], pieces) + position * np.repeat(np.diff(union) / pieces, pieces), high)
    return x, np.interp(x, x1, y1), np.interp(x, x2, y2)
