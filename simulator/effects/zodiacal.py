"""Zodiacal light of Leinert et al. 1998 (A&AS 127, 1): brightness by place, colour by wavelength.

Brightness at 500 nm is their table 17, seen from the Earth's orbit; the change over the year (about 10 %, from the tilt
of the dust's plane and the Earth's distance) is not in it. The spectrum is the Sun's, reddened by their colour factor.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.spectra import HC_ERG_ANGSTROM, Spectrum, load_reference_spectrum, load_zodi_table

FloatArray = NDArray[np.float64]
_ARCSEC2_PER_SR = (180.0 * 3600.0 / np.pi) ** 2
_ERG_S_CM2_A_PER_W_M2_UM = 0.1
_REFERENCE_NM = 500.0
_SUN_MEAN_NM = (480.0, 520.0)  # over the Sun's lines at 500 nm
_SLOPES = {30.0: (1.2, 0.8), 90.0: (0.9, 0.6)}  # elongation: below, above 500 nm


class ZodiacalRadiance(NamedTuple):
    """Radiance at 500 nm in W m-2 sr-1 um-1, and whether it is only a lower limit: too close to the Sun."""

    radiance_500nm_w_m2_sr_um: float
    solar_avoidance: bool


def zodiacal_radiance(longitude_from_sun_deg: float, latitude_deg: float) -> ZodiacalRadiance:
    """Radiance of the zodiacal light at 500 nm.

    Parameters
    ----------
    longitude_from_sun_deg : float
        Ecliptic longitude from the Sun; east and west are alike.
    latitude_deg : float
        Ecliptic latitude; north and south are alike.

    Returns
    -------
    ZodiacalRadiance
        Linear in the logarithm between the cells of the table. Where the table is empty, around the Sun, the brightest
        cell tabulated at that latitude stands in: a lower limit, flagged.
    """
    table = load_zodi_table()
    longitude = abs((longitude_from_sun_deg + 180.0) % 360.0 - 180.0)
    logarithm, empty = _filled()
    rows, columns = (
        _weights(axis, place)
        for axis, place in (
            (table.helioecliptic_longitude_deg, longitude),
            (table.ecliptic_latitude_deg, abs(latitude_deg)),
        )
    )
    value = sum(wr * wc * logarithm[i, j] for i, wr in rows for j, wc in columns)
    avoided = any(wr * wc > 0.0 and empty[i, j] for i, wr in rows for j, wc in columns)
    return ZodiacalRadiance(float(np.exp(value)), avoided)


@functools.cache
def _filled() -> tuple[FloatArray, NDArray[np.bool_]]:
    """Logarithm of the table, its empty cells filled with the next one away from the Sun; and which were empty."""
    radiance = load_zodi_table().radiance_500nm_w_m2_sr_um
    empty = np.isnan(radiance)
    filled = radiance.copy()
    for row in range(radiance.shape[0] - 2, -1, -1):
        filled[row] = np.where(empty[row], filled[row + 1], filled[row])
    return np.log(filled), empty


def _weights(axis: FloatArray, place: float) -> tuple[tuple[int, float], tuple[int, float]]:
    """Neighbouring cells and their weights."""
    right = int(np.clip(np.searchsorted(axis, place), 1, axis.size - 1))
    share = float((place - axis[right - 1]) / (axis[right] - axis[right - 1]))
    return (right - 1, 1.0 - share), (right, share)


def colour_factor(wavelength_nm: ArrayLike, elongation: float) -> FloatArray:
    """Reddening relative to the Sun, 1 at 500 nm (Leinert et al. 1998, eq. 22), 220 to 2500 nm.

    ``1 + s log10(wavelength / 500 nm)`` with s = 1.2 below and 0.8 above 500 nm at 30 degrees from the Sun, 0.9 and 0.6
    at 90 degrees; linear between, constant beyond.
    """
    logarithm = np.log10(np.asarray(wavelength_nm, dtype=np.float64) / _REFERENCE_NM)
    near, far = _SLOPES
    below, above = (np.interp(elongation, [near, far], [_SLOPES[near][i], _SLOPES[far][i]]) for i in (0, 1))
    return np.asarray(1.0 + np.where(logarithm < 0.0, below, above) * logarithm)


def zodiacal_photlam_arcsec2(radiance_500nm_w_m2_sr_um: float, elongation: float) -> Spectrum:
    """Spectrum of the zodiacal light, ph/s/cm2/A/arcsec2, 300-1750 nm.

    Parameters
    ----------
    radiance_500nm_w_m2_sr_um : float
        Radiance at 500 nm.
    elongation : float
        Angle from the Sun, degrees; sets the colour.
    """
    sun = load_reference_spectrum("sun")
    flam = sun.photlam * HC_ERG_ANGSTROM / (10.0 * sun.wavelength_nm)
    inside = (sun.wavelength_nm >= _SUN_MEAN_NM[0]) & (sun.wavelength_nm <= _SUN_MEAN_NM[1])
    x, y = sun.wavelength_nm[inside], flam[inside]
    mean = float(np.trapezoid(y, x)) / float(x[-1] - x[0])
    scale = radiance_500nm_w_m2_sr_um * _ERG_S_CM2_A_PER_W_M2_UM / _ARCSEC2_PER_SR / mean
    return Spectrum(sun.wavelength_nm, scale * colour_factor(sun.wavelength_nm, elongation) * sun.photlam)
