"""Discs on a grid of square pixels."""

import numpy as np

from cpic_core.quantities import FloatArray


def disc_overlap(y_edges: FloatArray, x_edges: FloatArray, radius: float) -> FloatArray:
    """Return the exact fraction of each cell of a grid that a disc around the origin covers, for cells of area 1.

    Parameters
    ----------
    y_edges, x_edges : ndarray, shapes (n + 1,) and (m + 1,)
        Edges of the cells from the centre of the disc, ascending by 1.
    radius : float
        Above 0.

    Returns
    -------
    ndarray, shape (n, m)
    """
    above, below = (_caps(x_edges, np.maximum(side, 0.0), radius) for side in (y_edges, -y_edges))
    covered = np.clip(above[:-1] - above[1:] + below[1:] - below[:-1], 0.0, 1.0)
    near_y, near_x = (np.maximum(0.0, np.maximum(part[:-1], -part[1:])) for part in (y_edges, x_edges))
    # What rounding leaves in cells that the circle does not reach is none of the disc.
    return np.where(np.hypot(near_y[:, None], near_x) < radius, covered, 0.0)


def _caps(x: FloatArray, y: FloatArray, radius: float) -> FloatArray:
    """Return the areas of a disc around the origin beyond heights of at least 0, between successive x; (y, x)."""
    half = np.sqrt(np.maximum(radius**2 - y**2, 0.0))[:, None]
    to = np.clip(x, -half, half)
    primitive = 0.5 * (to * np.sqrt(np.maximum(radius**2 - to**2, 0.0)) + radius**2 * np.arcsin(to / radius))
    return np.diff(primitive - y[:, None] * to, axis=1)


def overlap_weights(radius_pixels: float, offset_y: float = 0.0, offset_x: float = 0.0) -> FloatArray:
    """Return each pixel's exact fraction inside a circle near the central pixel.

    Parameters
    ----------
    radius_pixels : float
        Radius.
    offset_y, offset_x : float
        Centre of the circle relative to the centre of the middle pixel, -0.5 to 0.5.

    Returns
    -------
    ndarray, shape (m, m), m odd
    """
    half = int(np.ceil(radius_pixels + 0.5))
    edges = np.arange(-half, half + 2, dtype=np.float64) - 0.5
    return disc_overlap(edges - offset_y, edges - offset_x, radius_pixels)
