"""Sums of pixels that know how speckles go together: the least noise that is possible if their covariance is right.

The optical model tells the covariance of the speckle field in the pixels around a place. A sum that is weighed with its
inverse looks for a planet where it can be told from speckles. It takes for granted that the model is that of this very
instrument: most of the covariance is the static field in the dark hole, crossed with the errors of the wavefront.
"""

import functools

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError
from simulator.config import Instrument
from simulator.imaging import single_band_psf
from simulator.signal.speckle_visits import REGION_LAMBDA_D, OpticalBand, visit_changes

LEAST_NOISE = 0.01
"""White noise of a pixel over the rms of its speckles, at least: below, chance in the visits would pass for order."""


class Whitening:
    """Pixels in units in which their noise is white and of variance 1.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Of the noise, positive definite.
    beside : ndarray, shape (k, p)
        Images of unknown strength that are fitted too: nothing of them is left.

    Raises
    ------
    InputError
        If the covariance is not positive definite.

    Notes
    -----
    A source of image t in an image x: the whitened images ``t' = L^-1 t``, ``x' = L^-1 x`` with ``L L^T`` the
    covariance, without their parts along the whitened ``beside``, tell its strength ``t' x' / t' t'`` with the error
    ``(t' t')^-1/2``. It is the estimate of generalised least squares, of which no linear one is better (Aitken 1936).
    """

    def __init__(self, covariance: FloatArray, beside: FloatArray) -> None:
        from scipy.linalg import cholesky

        try:
            self._root = cholesky(covariance, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            raise InputError("covariance", "singular", allowed="positive definite") from None
        self._beside = _orthonormal(self._solved(np.asarray(beside, float)))

    def of(self, images: FloatArray) -> FloatArray:
        """Return images whitened, without what is beside; shape (..., p).

        Parameters
        ----------
        images : ndarray, shape (..., p)
        """
        rows = self._solved(np.atleast_2d(images))
        rows -= (rows @ self._beside.T) @ self._beside
        return rows.reshape(np.shape(images))

    def weights(self, images: FloatArray) -> FloatArray:
        """Return the weights of the sums that tell the strength of sources of these images, one each; shape (..., p).

        Parameters
        ----------
        images : ndarray, shape (..., p)
        """
        from scipy.linalg import solve_triangular

        seen = self.of(images)
        back = solve_triangular(self._root, seen.T, lower=True, trans="T", check_finite=False).T
        return np.asarray(back / (seen**2).sum(axis=-1, keepdims=True))

    def _solved(self, rows: FloatArray) -> FloatArray:
        from scipy.linalg import solve_triangular

        return np.ascontiguousarray(solve_triangular(self._root, rows.T, lower=True, check_finite=False).T)


def _orthonormal(rows: FloatArray) -> FloatArray:
    """Return the orthonormal rows that span what these do."""
    if not len(rows):
        return rows
    _, singular, basis = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(basis[singular > 1e-9 * singular[0]])


def speckle_covariance(
    instrument: Instrument, band: str, separation_arcsec: float, linear_nm2: float, square_nm4: float
) -> FloatArray:
    """Return the covariance of speckles around a separation, in units of (star light on the clear disc)^2.

    Parameters
    ----------
    instrument : Instrument
        Whose static field, mirror and spectrum of drift are taken for granted.
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
    linear_nm2, square_nm4 : float
        Factors of the covariance of ``2 Re(E0* dE)`` and of ``|dE|^2``, each at 1 nm: offset squared and to the fourth
        for one visit, and those of `unit_parts` for a programme.

    Returns
    -------
    ndarray, shape (p, p)
        Of the pixels of the hole within 2.4 lambda/D of the separation, in the order of the stamp; read-only.

    Notes
    -----
    The two parts do not go together for errors with a normal distribution: their product is odd in the errors. They
    are measured apart on the visits of `visit_changes`, the mean over the visits taken off.
    """
    band_of = OpticalBand.of(instrument, band)
    return _covariance(band_of, float(separation_arcsec), float(linear_nm2), float(square_nm4))


@functools.lru_cache(maxsize=4)
def _covariance(wanted: OpticalBand, separation_arcsec: float, linear_nm2: float, square_nm4: float) -> FloatArray:
    geometry = single_band_psf(wanted.band, instrument=wanted.instrument).geometry
    inside = geometry.annulus(separation_arcsec, REGION_LAMBDA_D)[geometry.hole]
    found = np.zeros((np.count_nonzero(inside),) * 2)
    if linear_nm2 > 0.0 or square_nm4 > 0.0:
        changes = visit_changes(wanted)
        for factor, part in zip((linear_nm2, square_nm4), changes, strict=True):
            images = part[:, inside].astype(float)
            images -= images.mean(axis=0)
            found += (factor / len(images)) * (images.T @ images)
    found.flags.writeable = False
    return found


def with_noise(covariance: FloatArray, white_variance: ArrayLike) -> FloatArray:
    """Return the covariance of speckles and white noise.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Of the speckles.
    white_variance : array_like
        Of every pixel, broadcasts to (p,); at least 0. No less is taken than 1e-4 of the mean variance of the speckles,
        and where there is neither, 1.
    """
    whole = np.array(covariance)
    least = LEAST_NOISE**2 * float(np.trace(whole)) / len(whole)
    white = np.maximum(np.broadcast_to(white_variance, len(whole)), least)
    whole[np.diag_indices_from(whole)] += white if white.any() else 1.0
    return whole
