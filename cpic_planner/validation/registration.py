"""Registration of frames: how far the light of a star behind the mask moved from one image to another.

The mask hides the star, so that its place is that of the headers; jitter and errors of pointing move what the mask
leaves of its light, and every planet with it. The shift of that light tells how far, with an error that holds noise and
the speckles that changed.
"""

import math

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, Record
from simulator.imaging import BandGeometry, centred_axis

SMOOTHING_PIXELS = 1.5
"""Width of the Gaussian by which both images are smoothed: it takes most of the noise out of the gradient."""
SIGNIFICANT_SIGMA = 5.0
LEAST_PIXELS = 0.01
"""A shift below this moves less than 1 % of the light of a pixel, and is left."""
_MOST_STEPS, _STILL_PIXELS, _CELLS = 10, 1e-4, 12
_REACH = 4.0  # of the smoothing, beyond which a pixel without light does not count


class Shift(Record):
    """Distance of an image from another one of the same light.

    Attributes
    ----------
    x_pixel, y_pixel : float
        Shift along columns and rows.
    x_error_pixel, y_error_pixel : float
        1-sigma errors.
    sigma : float
        Significance: the root of its chi2 of two degrees of freedom.
    """

    x_pixel: float
    y_pixel: float
    x_error_pixel: float
    y_error_pixel: float
    sigma: float

    @property
    def significant(self) -> bool:
        """Whether images are moved by it; where it is not, the place of the headers holds."""
        return self.sigma >= SIGNIFICANT_SIGMA and math.hypot(self.x_pixel, self.y_pixel) >= LEAST_PIXELS


def star_light(geometry: BandGeometry) -> BoolArray:
    """Return the pixels of a stamp whose light moves with the star: beyond the dark hole, and off the mask by lambda/D.

    What leaks along the edges of the mask stays with it: with that light a shift of the star counts for three quarters.

    Parameters
    ----------
    geometry : BandGeometry
    """
    offset = np.abs(centred_axis(geometry.stamp_pixels, geometry.pixel_scale_arcsec))
    away = offset > geometry.mask_half_width_arcsec + geometry.lambda_d_arcsec
    return np.asarray(away[:, None] & away & ~geometry.hole)


def moved(image: FloatArray, x_pixel: float, y_pixel: float) -> FloatArray:
    """Return an image moved by a part of a pixel, by splines of fifth order; what is beyond the edge is its edge."""
    from scipy.ndimage import shift

    return np.asarray(shift(image, (y_pixel, x_pixel), order=5, mode="nearest"))


def measured_shift(image: FloatArray, template: FloatArray, region: BoolArray, cell_pixels: float) -> Shift | None:
    """Return the shift of an image against a template, by least squares on all light in a region.

    Parameters
    ----------
    image, template : ndarray, shape (y, x)
        Images of the same light, on any scale.
    region : ndarray of bool, shape (y, x)
        Pixels that can be used in both.
    cell_pixels : float
        Side of squares that vary independently of each other: some lambda/D.

    Returns
    -------
    Shift or None
        None where the light tells no shift: fewer than 12 squares with light, or no convergence within a square.

    Raises
    ------
    InputError
        If the shapes differ.

    Notes
    -----
    The model is ``a T(x - s) + b`` of the smoothed template T, Gauss-Newton in ``a``, ``a s`` and ``b``, each pixel
    weighted by the inverse of its light: speckles that drift change in proportion to the light they beat with. The
    covariance of ``s`` is that of the fit without one square at a time (delete-one jackknife, Efron 1982, The
    Jackknife, ch. 3), so that neither the noise nor how far speckles are alike has to be known.
    """
    from scipy.ndimage import binary_erosion, gaussian_filter

    if not image.shape == template.shape == region.shape:
        raise InputError("template", template.shape, unit="px", allowed=f"images of {image.shape}")
    inside = binary_erosion(region, iterations=math.ceil(SMOOTHING_PIXELS * _REACH / 2.0))
    rows, columns = np.nonzero(inside)
    wide = int(image.shape[1] // cell_pixels) + 1
    _, cell = np.unique(
        (rows // cell_pixels).astype(int) * wide + (columns // cell_pixels).astype(int), return_inverse=True
    )
    cells = int(cell.max()) + 1 if cell.size else 0
    if cells < _CELLS:
        return None
    clean, known = np.where(region, image, 0.0), np.where(region, template, 0.0)
    seen = gaussian_filter(clean, SMOOTHING_PIXELS)[inside]
    at = np.zeros(2)
    for _ in range(_MOST_STEPS):
        there = moved(known, *at) if at.any() else known
        light, across, up = (
            gaussian_filter(there, SMOOTHING_PIXELS, order=order)[inside] for order in (0, (0, 1), (1, 0))
        )
        strength = np.abs(light)
        design = np.stack([light, -across, -up, np.ones(light.size)])
        design /= np.maximum(np.sqrt(np.mean(design**2, axis=1, keepdims=True)), np.finfo(float).tiny)
        scale = np.sqrt(np.mean(light**2)) / np.sqrt(np.mean(np.stack([across, up]) ** 2, axis=1))
        weights = 1.0 / (strength + np.median(strength) + np.finfo(float).tiny)
        normal, right = np.zeros((cells, 4, 4)), np.zeros((cells, 4))
        for i in range(4):
            right[:, i] = np.bincount(cell, weights * design[i] * seen, cells)
            for j in range(4):
                normal[:, i, j] = np.bincount(cell, weights * design[i] * design[j], cells)
        try:
            without = np.linalg.solve(normal.sum(axis=0) - normal, (right.sum(axis=0) - right)[..., None])[..., 0]
            whole = np.linalg.solve(normal.sum(axis=0), right.sum(axis=0))
        except np.linalg.LinAlgError:
            return None
        if not whole[0] > 0:
            return None
        step = whole[1:3] / whole[0] * scale
        at = at + np.clip(step, -1.0, 1.0)
        if np.abs(at).max() > cell_pixels:
            return None
        if np.hypot(*step) < _STILL_PIXELS:
            break
    else:
        return None
    shifts = without[:, 1:3] / without[:, :1] * scale
    spread = shifts - shifts.mean(axis=0)
    covariance = (cells - 1) / cells * (spread.T @ spread)
    errors = np.sqrt(np.diag(covariance))
    sigma = math.sqrt(max(float(at @ np.linalg.pinv(covariance) @ at), 0.0))
    return Shift(float(at[0]), float(at[1]), float(errors[0]), float(errors[1]), sigma)
