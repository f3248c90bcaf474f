"""Linear interpolation between the nodes of an axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def bracket(nodes: np.ndarray, values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the two nodes around each value and their weights.

    Parameters
    ----------
    nodes : ndarray, shape (n,)
        Increasing, at least two.
    values : array_like, shape (...)
        Finite; outside the nodes the end is taken.

    Returns
    -------
    index : ndarray of int, shape (..., 2)
    weight : ndarray, shape (..., 2)
        Non-negative, sum 1.
    """
    inside = np.clip(values, nodes[0], nodes[-1])
    left = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, nodes.size - 2)
    fraction = (inside - nodes[left]) / (nodes[left + 1] - nodes[left])
    return np.stack([left, left + 1], axis=-1), np.stack([1.0 - fraction, fraction], axis=-1)
