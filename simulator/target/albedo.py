"""Geometric albedo of planets: measured giants of the solar system."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from catalogs.errors import InputError
from catalogs.spectra import Albedo, load_albedo

__all__ = ["albedo_flags", "planet_albedo"]


def planet_albedo(wavelength_nm: ArrayLike, *, model: str = "jupiter") -> np.ndarray:
    """Return the geometric albedo of a planet.

    Parameters
    ----------
    wavelength_nm : array_like
        Wavelengths, 300 to 1755 nm.
    model : {"jupiter", "saturn", "uranus", "neptune"}
        Measured planet (Karkoschka 1998 up to 1050 nm; beyond, see `albedo_flags`).

    Returns
    -------
    ndarray
        Albedo at the wavelengths, linear between samples 0.4 nm apart. For a band use
        ``Passbands.band_albedo``: one wavelength does not stand for a band.

    Raises
    ------
    InputError
        For an unknown model or a wavelength outside the table.
    """
    table, wavelength = _table(wavelength_nm, model)
    return np.interp(wavelength, table.wavelength_nm, table.albedo)


def albedo_flags(wavelength_nm: ArrayLike, *, model: str = "jupiter") -> np.ndarray:
    """Return True where the albedo is ``extrapolated``.

    Beyond 1050 nm the origin of the measured tables is undocumented.

    Raises
    ------
    InputError
        For an unknown model or a wavelength outside the table.
    """
    table, wavelength = _table(wavelength_nm, model)
    return wavelength > table.documented_to_nm


def _table(wavelength_nm: ArrayLike, model: str) -> tuple[Albedo, np.ndarray]:
    table = load_albedo(model)
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    low, high = float(table.wavelength_nm[0]), float(table.wavelength_nm[-1])
    inside = (wavelength >= low) & (wavelength <= high)
    if not np.all(inside):
        bad = float(wavelength[~inside].flat[0])
        raise InputError("wavelength_nm", bad, unit="nm", allowed=f"{low:g} to {high:g}")
    return table, wavelength
