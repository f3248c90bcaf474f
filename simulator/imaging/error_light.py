"""Variance from visit to visit of the light that random wavefront errors put into an aperture; it is exact.

The field ``dE`` of an error is linear in its screen, so that the light ``|dE|^2`` in an aperture is a quadratic form of
the waves' amplitudes, which are independent normal numbers a: ``Q = |R a|^2``, where each row of R is what one mode of
the field in the aperture sees of the waves. Its variance is ``2 tr (R R^T)^2``, the covariance of two such forms
``2 tr M M'`` with ``M = R^T R``.

Apertures see the light less the mean of the hole, whose own variance is up to two thirds of what is left in corners:
exact in the screens that matter most and estimated in the others, to some 1 %.

A field behind a pupil has few modes in an aperture little larger than lambda/D: those that bring less than 1e-3 of the
light of the brightest are left out, by which the variance is 1e-4 too small.
"""

from collections.abc import Sequence

import numpy as np

from cpic_core import ComplexArray, FloatArray, stream
from simulator.imaging.drift import ScreenModel, screen_model
from simulator.imaging.imager import FocalGrid, Imager
from simulator.imaging.sampling import PixelAxis

Aperture = tuple[int, int, FloatArray]
FAINT = 1e-3  # light of a mode that does not count, over that of the brightest
APART = 1e-2  # share of an aperture's light that does not count in its small covariance with the mean of the hole
PROBES = 64  # random screens that find what the mean of the hole varies by
_SEED = 20250102


class ErrorLight:
    """Light ``|dE|^2`` of screens of 1 nm in weighted pixels, to second order in the screen.

    Parameters
    ----------
    imager : Imager
    axes : tuple of PixelAxis
        Pixels along y and x.
    psd_slope : float
        Exponent of the power spectrum of the screens, ``f^-slope``.
    """

    def __init__(self, imager: Imager, axes: tuple[PixelAxis, PixelAxis], psd_slope: float) -> None:
        samples = len(imager.transmission)
        self.grid: FocalGrid = imager.focal_grid(*axes)
        self.screens: ScreenModel = screen_model(samples, psd_slope)
        self.owners = [axis.owners for axis in axes]
        self.counted = axes[0].weights[:, None] * axes[1].weights
        waves = zip(self.grid.rows, self.grid.columns, strict=True)
        self.waves = [[np.asarray(part.full(samples), np.complex128) for part in pair] for pair in waves]
        per_nm = 2.0 * np.pi / (imager.wavelengths_m * 1e9) * np.sqrt(imager.weights * imager.pixel_solid_angle_sr)
        self.pupils = [float(scale) * imager.pupil(index) for index, scale in enumerate(per_nm)]

    def readings(self, row: int, column: int, weights: FloatArray) -> FloatArray:
        """Return the pupil's maps whose readings of a screen, squared and added, are the weighted light; (m, n, n).

        Parameters
        ----------
        row, column : int
            First pixel.
        weights : ndarray
            Of the pixels from there on, 0 or more.
        """
        near = zip(self.owners, (row, column), weights.shape, strict=True)
        rows, columns = (slice(*np.searchsorted(pixel, [first, first + n])) for pixel, first, n in near)
        by_node = weights[np.ix_(self.owners[0][rows] - row, self.owners[1][columns] - column)]
        by_node = by_node * self.counted[rows, columns]
        found = []
        for (to_y, to_x), pupil in zip(self.waves, self.pupils, strict=True):
            (from_y, basis_y), (from_x, basis_x) = _basis(to_y[rows]), _basis(to_x[columns])
            light = _pairs(from_y).T @ by_node @ _pairs(from_x)
            n_y, n_x = len(basis_y), len(basis_x)
            form = light.reshape(n_y, n_y, n_x, n_x).swapaxes(1, 2).reshape(n_y * n_x, -1)
            power, modes = np.linalg.eigh(form)
            bright = power > FAINT * power[-1]
            kept = (np.sqrt(power[bright]) * modes[:, bright].conj()).T.reshape(-1, n_y, n_x)
            found.append(pupil * (basis_y.T @ kept @ basis_x))
        maps = np.concatenate(found)
        return np.concatenate([maps.real, maps.imag])

    def light(self, screens: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the weighted light of screens, shape (k,).

        Parameters
        ----------
        screens : ndarray, shape (k, n, n)
            Nm.
        weights : ndarray
            Of all pixels.
        """
        by_node = self.counted * weights[np.ix_(*self.owners)]
        total = np.zeros(len(screens))
        for index, pupil in enumerate(self.pupils):
            for number, screen in enumerate(screens):
                total[number] += (by_node * np.abs(self.grid.transformed(index, pupil * screen)) ** 2).sum()
        return total

    def product(self, coefficients: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the product of the form of the weighted light with the waves of some screens, of the same shape.

        Parameters
        ----------
        coefficients : ndarray, shape (..., 128, 128)
            As of `ScreenModel.screens`.
        weights : ndarray
            Of all pixels.
        """
        by_node = self.counted * weights[np.ix_(*self.owners)]
        screens = self.screens.screens(coefficients)
        back = np.zeros(screens.shape)
        for index, ((to_y, to_x), pupil) in enumerate(zip(self.waves, self.pupils, strict=True)):
            for number, screen in enumerate(screens):
                field = self.grid.transformed(index, pupil * screen)
                back[number] += (pupil * (to_y.T @ (by_node * field.conj()) @ to_x)).real
        return self.screens.coefficients(back)


def _basis(waves: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the factors of the waves at some nodes, (k, b) and (b, n): few that are orthonormal over the pupil."""
    left, size, right = np.linalg.svd(waves, full_matrices=False)
    several = size > np.sqrt(FAINT) * 1e-2 * size[0]
    return left[:, several] * size[several], right[several]


def _pairs(values: ComplexArray) -> ComplexArray:
    """Return the products of the conjugate of each column with each, shape (k, b^2)."""
    return (values.conj()[:, :, None] * values[:, None, :]).reshape(len(values), -1)


def light_variance(fine: ErrorLight, coarse: ErrorLight, mean: FloatArray, apertures: Sequence[Aperture]) -> FloatArray:
    """Return the variance of the light of screens of 1 nm, summed in apertures less the sum by ``mean``, one for each.

    Parameters
    ----------
    fine : ErrorLight
        Of the apertures.
    coarse : ErrorLight
        The same pixels, perhaps with fewer nodes, for the mean.
    mean : ndarray
        Weights of all pixels.
    apertures : sequence
        First row and column of each, and the weights of the pixels from there on.
    """
    screens, found = fine.screens, np.full(len(apertures), _mean_variance(coarse, mean))
    for number, aperture in enumerate(apertures):
        seen = screens.coefficients(fine.readings(*aperture))
        shape = seen.shape[1:]
        seen = seen.reshape(len(seen), -1)
        power, turned = np.linalg.eigh(seen @ seen.T)
        found[number] += 2.0 * float((power**2).sum())
        several = np.cumsum(power) > APART * power.sum()
        main = screens.screens((turned[:, several].T @ seen).reshape(-1, *shape))
        found[number] -= 4.0 * float(coarse.light(main, mean).sum())
    return found


def _mean_variance(light: ErrorLight, mean: FloatArray) -> float:
    """Return the variance of the sum by ``mean``: exact in what random screens find, estimated in what is left."""
    rng = stream(_SEED, "hole_mean")
    shape = tuple(light.screens.coefficients(light.grid.imager.transmission).shape)

    def product(vectors: FloatArray) -> FloatArray:
        return light.product(vectors.reshape(-1, *shape), mean).reshape(len(vectors), -1)

    found, _ = np.linalg.qr(product(rng.standard_normal((PROBES, shape[0] * shape[1]))).T)
    rest = rng.standard_normal((PROBES, len(found)))
    rest -= rest @ found @ found.T
    return 2.0 * float((product(found.T) ** 2).sum() + (product(rest) ** 2).sum() / PROBES)
