"""Discs on a grid of square pixels."""

import numpy as np

from cpic_core.quantities import FloatArray

_STRIPS = 256


def overlap_weights(radius_pixels: float, offset_y: float = 0.0, offset_x: float = 0.0) -> FloatArray:
    """Return each pixel's fraction inside a circle near the central pixel (area good to 1e-4 above 1 px radius).

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
    pixel = np.arange(-half, half + 1)
    strip = (np.arange(_STRIPS) + 0.5) / _STRIPS - 0.5
    across = pixel[:, None] + strip - offset_x
    chord = np.sqrt(np.clip(radius_pixels**2 - across**2, 0.0, None))
    low = (pixel - 0.5 - offset_y)[:, None, None]
    covered = np.clip(chord, low, low + 1) - np.clip(-chord, low, low + 1)
    weights: FloatArray = covered.mean(axis=-1)
    return weights
