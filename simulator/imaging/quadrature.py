"""Where the focal plane is sampled: Gauss-Legendre nodes in the open part of every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PixelAxis", "integrate_pixels", "pixel_axis"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PixelAxis:
    """Quadrature along one detector axis: nodes only where the focal-plane mask is open.

    Attributes
    ----------
    nodes_arcsec : ndarray, shape (k,)
        Ascending positions relative to the star.
    weights : ndarray, shape (k,)
        Fractions of a pixel; those of a wholly open pixel sum to one.
    pixels : ndarray of int, shape (p,)
        Indices of pixels that are at least partly open.
    starts : ndarray of int, shape (p,)
        First node of each of these pixels.
    n_pixels : int
        Length of the axis.
    """

    nodes_arcsec: FloatArray
    weights: FloatArray
    pixels: NDArray[np.intp]
    starts: NDArray[np.intp]
    n_pixels: int


def pixel_axis(
    centres_arcsec: FloatArray, pixel_arcsec: float, n_nodes: int, half_width_arcsec: float = 0.0
) -> PixelAxis:
    """Nodes of an axis with a hard bar ``|x| < half_width_arcsec`` in front of it.

    A pixel that the edge of the bar cuts gets its Gauss-Legendre nodes on the open part, so the area behind the
    bar is exact to rounding and the quadrature error is that of an uncut pixel.

    Parameters
    ----------
    centres_arcsec : ndarray, shape (n,)
        Ascending pixel centres relative to the star.
    pixel_arcsec : float
        Pixel size.
    n_nodes : int
        Gauss-Legendre nodes per open interval.
    half_width_arcsec : float
        Half width of the bar, 0 for none.
    """
    base, base_weights = np.polynomial.legendre.leggauss(n_nodes)
    low, high = centres_arcsec - pixel_arcsec / 2, centres_arcsec + pixel_arcsec / 2
    if half_width_arcsec > 0:
        left = np.stack([low, np.minimum(high, -half_width_arcsec)], axis=1)
        right = np.stack([np.maximum(low, half_width_arcsec), high], axis=1)
        intervals = np.stack([left, right], axis=1).reshape(-1, 2)
        owner = np.repeat(np.arange(low.size), 2)
    else:
        intervals, owner = np.stack([low, high], axis=1), np.arange(low.size)
    length = intervals[:, 1] - intervals[:, 0]
    keep = length > 1e-9 * pixel_arcsec
    intervals, owner, length = intervals[keep], owner[keep], length[keep]
    nodes = intervals.mean(axis=1)[:, None] + 0.5 * length[:, None] * base
    weights = 0.5 * length[:, None] / pixel_arcsec * base_weights
    pixels, first = np.unique(owner, return_index=True)
    return PixelAxis(nodes.ravel(), weights.ravel(), pixels, first * n_nodes, low.size)


def integrate_pixels(intensity: FloatArray, y: PixelAxis, x: PixelAxis) -> FloatArray:
    """Mean intensity of every pixel, closed parts counting as zero.

    Parameters
    ----------
    intensity : ndarray, shape (..., k_y, k_x)
        Values at the nodes.

    Returns
    -------
    ndarray, shape (..., n_y, n_x)
    """
    image = np.zeros((*intensity.shape[:-2], y.n_pixels, x.n_pixels))
    if y.pixels.size and x.pixels.size:
        rows = np.add.reduceat(intensity * y.weights[:, None], y.starts, axis=-2)
        sums = np.add.reduceat(rows * x.weights, x.starts, axis=-1)
        image[..., y.pixels[:, None], x.pixels[None, :]] = sums
    return image
