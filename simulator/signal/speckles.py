"""The speckle residual that no number of frames averages: a law in the length of the visit."""

import functools
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray
from simulator.config import Drift
from simulator.imaging import PsfMetrics

_N_ANNULUS, _N_TABLE = 25, 500
_NOTHING = 1e-290
# Mean light of a wavefront error of 1 nm rms at 662 nm that falls as f^-2.5, relative to the peak, times u^2.5 with u
# in lambda/D: at most 1.7 times too large in the dark holes of the visible bands (60 screens each).
_DRIFT_AT_1_NM = 2.4e-5


class SpeckleLaw(NamedTuple):
    """Variance of aperture sums after subtraction, ``k0 + k1 v + k2 v^2`` for a visit of ``v`` seconds.

    In units of (star light on the clear disc)^2, or of (e-/s)^2 once multiplied with the star's rate squared.
    """

    k0: FloatArray
    k1: FloatArray
    k2: FloatArray

    def variance(self, visit_s: ArrayLike) -> FloatArray:
        """Value for a visit of that length."""
        visit = np.asarray(visit_s, float)
        return self.k0 + visit * (self.k1 + visit * self.k2)

    def scaled(self, factor: ArrayLike) -> "SpeckleLaw":
        """All of it times a factor."""
        return SpeckleLaw(*(np.asarray(factor, float) * part for part in self))


@functools.lru_cache(maxsize=64)
def floor_law(metrics: PsfMetrics) -> tuple[FloatArray, FloatArray]:
    """Coefficients ``a`` and ``b`` of the measured floor, ``sigma^2 = a o^2 + b o^4``, per bin of separation.

    Two visits with independent wavefront offsets differ by ``2 Re(E0* dE)``, of variance proportional to ``o^2``, and
    by the light of the errors themselves, ``|dE|^2``, of variance proportional to ``o^4``; Gaussian offsets leave no
    term between them. The fit weighs relative errors; it meets the measured table to about 2 %.
    """
    offset = metrics.floor_visit_nm
    a, b = [], []
    for sigma in metrics.floor_sigma[1:]:
        terms = np.stack([offset**2, offset**4], axis=1) / sigma[:, None] ** 2
        found, *_ = np.linalg.lstsq(terms, np.ones(offset.size), rcond=None)
        a.append(max(float(found[0]), 0.0))
        b.append(max(float(found[1]), 0.0))
    return np.array(a), np.array(b)


def speckle_law(
    metrics: PsfMetrics,
    drift: Drift,
    separation_arcsec: ArrayLike,
    annulus_lambda_d: float,
    reference_ratio: float = 1.0,
) -> SpeckleLaw:
    """Law of the residual at a separation.

    Parameters
    ----------
    metrics : PsfMetrics
    drift : Drift
        ``visit_nm`` is the offset of each visit, ``walk_nm_per_sqrt_hour`` its random walk.
    separation_arcsec : array_like
    annulus_lambda_d : float
        Half width of the annulus over which the scatter is measured: the residual is several times larger at the inner
        edge of the hole than at the outer one, and this is its quadratic mean over whole apertures in the quadrants.
    reference_ratio : float
        Length of the reference visit over that of the science visit.

    Returns
    -------
    SpeckleLaw
        Arrays of the shape of ``separation_arcsec``.

    Notes
    -----
    The mean of a walk of variance ``w s`` over ``0 < s < v`` has the variance ``w v / 3``; the mean of its square,
    which makes the light of the errors, has ``2 <min(s, s')^2> = w^2 v^2 / 3`` instead of the ``2 (w v / 3)^2`` of a
    frozen offset of that size, 3/2 times as much.
    """
    crossed, light = _laws(metrics, drift, separation_arcsec, annulus_lambda_d, reference_ratio)
    return SpeckleLaw(*(one + other for one, other in zip(crossed, light, strict=True)))


def error_light_share(
    metrics: PsfMetrics,
    drift: Drift,
    separation_arcsec: ArrayLike,
    annulus_lambda_d: float,
    reference_ratio: float,
    visit_s: ArrayLike,
) -> FloatArray:
    """Share of a residual's variance that the light of the wavefront's errors makes, ``|dE|^2``, 0 to 1.

    The rest is ``2 Re(E0* dE)``, which is as Gaussian as the errors are; ``|dE|^2`` has exponential tails. Parameters
    as of `speckle_law`, with the length of the visit in s; 0 where there is no residual.
    """
    laws = _laws(metrics, drift, separation_arcsec, annulus_lambda_d, reference_ratio)
    crossed, light = (law.variance(visit_s) for law in laws)
    whole = crossed + light
    return np.asarray(light / np.where(whole > 0.0, whole, 1.0))


def _laws(
    metrics: PsfMetrics, drift: Drift, separation_arcsec: ArrayLike, annulus_lambda_d: float, reference_ratio: float
) -> tuple[SpeckleLaw, SpeckleLaw]:
    """Laws of the cross term with the static field, and of the light of the errors."""
    place, linear_table, square_table = _annulus_table(metrics, annulus_lambda_d)
    separation = np.asarray(separation_arcsec, float)
    linear, square = (np.exp(np.interp(separation, place, table)) for table in (linear_table, square_table))
    visit, walk = drift.visit_nm**2, drift.walk_nm_per_sqrt_hour**2 / (3.0 * 3600.0)
    both, of_squares = (1.0 + reference_ratio) / 2.0, (1.0 + reference_ratio**2) / 2.0
    crossed = SpeckleLaw(k0=visit * linear, k1=walk * linear * both, k2=np.zeros_like(linear))
    light = SpeckleLaw(
        k0=visit**2 * square,
        k1=walk * 2.0 * square * visit * both,
        k2=1.5 * walk**2 * square * of_squares,
    )
    return crossed, light


@functools.lru_cache(maxsize=64)
def _annulus_table(metrics: PsfMetrics, annulus_lambda_d: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Separations, and the logarithms there of the mean coefficients over the whole apertures of an annulus.

    Apertures count by the azimuth that is left to them in the square quadrants: few fit near their corners.
    """
    margin, zone = metrics.aperture_radius_arcsec, metrics.zone
    low, high = zone.inner_arcsec + margin, zone.outer_arcsec - margin
    place = np.linspace(0.5 * metrics.hole_inner_corner_arcsec, metrics.owa_arcsec, _N_TABLE)
    reach = np.linspace(-1.0, 1.0, _N_ANNULUS) * annulus_lambda_d * metrics.lambda_d_arcsec
    around = np.maximum(place[:, None] + reach, 1e-6)
    edge = np.maximum(np.arcsin(np.minimum(low / around, 1.0)), np.arccos(np.minimum(high / around, 1.0)))
    weight = around * np.clip(1.0 - edge / (np.pi / 4.0), 0.0, 1.0)
    total = weight.sum(axis=1, keepdims=True)
    # Where no whole aperture fits, the residual at the separation itself.
    alone = np.broadcast_to(np.arange(_N_ANNULUS) == _N_ANNULUS // 2, weight.shape)
    weight = np.where(total > 0.0, weight / np.where(total > 0.0, total, 1.0), alone)
    # Interpolated in logarithms; a coefficient of 0 (a perfect hole has no cross term) stays next to 0.
    logs = [np.log(np.maximum(part, _NOTHING)) for part in floor_law(metrics)]
    bins = metrics.floor_separation_arcsec
    linear, square = (np.log((weight * np.exp(np.interp(around, bins, part))).sum(axis=1)) for part in logs)
    return place, linear, square


def drift_halo(
    metrics: PsfMetrics, separation_arcsec: FloatArray, rms_nm: float, slope: float, wavelength_nm: float
) -> FloatArray:
    """Return the mean light that a wavefront error scatters, relative to the peak of a source; at most 1.

    Parameters
    ----------
    metrics : PsfMetrics
    separation_arcsec : ndarray
        From the source.
    rms_nm, slope : float
        Of the error: its rms, and the exponent with which its power falls.
    wavelength_nm : float
        Middle of the band.

    Notes
    -----
    ``2.4e-5 (rms / nm)^2 (662 nm / lambda)^2 u^-slope`` with u the separation in lambda/D, at least 1: the power
    spectrum of the screens seen through the telescope, its scale measured in the dark holes of the visible bands.
    """
    u = np.maximum(separation_arcsec / metrics.lambda_d_arcsec, 1.0)
    return np.minimum(_DRIFT_AT_1_NM * (rms_nm * 662.0 / wavelength_nm) ** 2 * u**-slope, 1.0)
