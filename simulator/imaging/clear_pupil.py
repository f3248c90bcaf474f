"""Light of a source seen through a round pupil with a round obstruction and nothing else: where optics are a table.

Separations are in lambda/D, brightness is the fraction of the collected light per square lambda/D.
"""

import functools

import numpy as np

from cpic_core import ArrayLike, FloatArray
from cpic_core.special_functions import special

_WAVELENGTHS = 24
# Mean light of a wavefront error of 1 nm rms at 662 nm that falls as f^-2.5, relative to the peak, times u^2.5 with u
# in lambda/D: at most 1.7 times too large in the dark holes of the visible bands (60 screens each).
_ERROR_LIGHT_AT_1_NM = 2.4e-5
_DISC_POINTS = 300
FIELD_ARCSEC = 17.2


def airy(separation_lambda_d: ArrayLike, obstruction: float = 0.0, relative_width: float = 0.0) -> FloatArray:
    """Return the brightness of the diffraction pattern of the pupil over a band.

    Parameters
    ----------
    separation_lambda_d : array_like
        From the source, at the middle of the band.
    obstruction : float
        Diameter of the obstruction over that of the pupil, 0 to below 1.
    relative_width : float
        Width of the band over its middle, evenly lit.
    """
    u = np.asarray(separation_lambda_d, dtype=np.float64)
    total = np.zeros(u.shape)
    nodes = (np.arange(_WAVELENGTHS) + 0.5) / _WAVELENGTHS - 0.5 if relative_width > 0 else np.zeros(1)
    for stretch in 1.0 + relative_width * nodes:
        v = np.pi * np.maximum(u / stretch, 1e-9)
        field = 2.0 * special().j1(v) / v
        if obstruction > 0:
            field = field - obstruction**2 * 2.0 * special().j1(obstruction * v) / (obstruction * v)
        total += (field / (1.0 - obstruction**2)) ** 2 / stretch**2
    return np.asarray(np.pi / 4.0 * (1.0 - obstruction**2) * total / len(nodes))


def scattered_light(separation_lambda_d: ArrayLike, rms_nm: float, slope: float, wavelength_nm: float) -> FloatArray:
    """Return the mean light that a wavefront error scatters, relative to the peak of a source; at most 1.

    Parameters
    ----------
    separation_lambda_d : array_like
        From the source; below 1 the value at 1.
    rms_nm, slope : float
        Of the error: its rms, and the exponent with which its power falls.
    wavelength_nm : float
        Middle of the band.

    Notes
    -----
    ``2.4e-5 (rms / nm)^2 (662 nm / lambda)^2 u^-slope``: the power spectrum of the screens seen through the telescope,
    its scale measured in the dark holes of the visible bands.
    """
    u = np.maximum(np.asarray(separation_lambda_d, dtype=np.float64), 1.0)
    return np.minimum(_ERROR_LIGHT_AT_1_NM * (rms_nm * 662.0 / wavelength_nm) ** 2 * u**-slope, 1.0)


@functools.lru_cache(maxsize=4)
def _disc() -> tuple[FloatArray, FloatArray]:
    """Return the points that fill a unit disc evenly, x and y."""
    number = np.arange(_DISC_POINTS)
    radius, angle = np.sqrt((number + 0.5) / _DISC_POINTS), number * np.pi * (3.0 - np.sqrt(5.0))
    return radius * np.cos(angle), radius * np.sin(angle)


def disc_light(
    separation_lambda_d: FloatArray, radius_lambda_d: float, obstruction: float, relative_width: float
) -> FloatArray:
    """Return the part of the collected light in discs of a radius whose middles are so far from the source, shape (n,).

    Parameters
    ----------
    separation_lambda_d : ndarray, shape (n,)
    radius_lambda_d : float
    obstruction, relative_width : float
        As of `airy`.
    """
    x, y = _disc()
    fine = np.linspace(0.0, float(separation_lambda_d.max()) + radius_lambda_d, 8 * len(separation_lambda_d) + 2000)
    light = airy(fine, obstruction, relative_width)
    at = np.hypot(separation_lambda_d[:, None] + radius_lambda_d * x, radius_lambda_d * y)
    return np.asarray(np.interp(at, fine, light).mean(axis=1) * np.pi * radius_lambda_d**2)
