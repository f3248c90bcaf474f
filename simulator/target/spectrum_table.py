"""Spectra from files of wavelength and flux density, in any of the usual units."""

import warnings
from pathlib import Path

import numpy as np

from catalogs import HC_ERG_ANGSTROM, Spectrum, read_curve
from cpic_core import InputError, read_file
from simulator.passbands import check_table

_MAX_BYTES = 200_000_000
_SPEED_OF_LIGHT_NM_S = 2.99792458e17


def read_spectrum(path: str | Path) -> Spectrum:
    """Read a spectrum from a file of wavelength and flux density, see `catalogs.curves.read_curve`.

    Units stand with the columns of ECSV, VOTable and FITS tables; text names them in its headings or remarks:
    ``wavelength_nm,photlam``, ``# Angstrom flam``, ``Wave (um)  Flux (W/m2/um)``.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Spectrum
        Wavelengths in nm, ph/s/cm2/A, linear between the samples.

    Raises
    ------
    InputError
        If the file cannot be read, a unit is not stated, wavelengths do not increase or fluxes are not finite or
        negative.
    """
    place = Path(path)
    data = read_file(place, key="spectrum file", allowed="a readable file", max_bytes=_MAX_BYTES)
    return photon_flux(place.name, *read_curve(place.name, data, "flux"))


def photon_flux(name: str, wavelength_nm: np.ndarray, flux: np.ndarray, unit: str) -> Spectrum:
    """Return a spectrum whose flux density is given in any of the usual units.

    Parameters
    ----------
    name : str
        What it is, for messages.
    wavelength_nm, flux : ndarray, shape (n,)
        Wavelengths and flux density.
    unit : str
        ``photlam`` (ph/s/cm2/A), ``flam`` (erg/s/cm2/A), ``fnu`` (erg/s/cm2/Hz), ``Jy``, or a unit that
        astropy reads.

    Raises
    ------
    InputError
        If the unit is not one of a flux density, wavelengths do not increase or fluxes are not finite or negative.
    """
    wavelength, values = check_table(name, wavelength_nm, flux)
    if wavelength[0] <= 0.0:
        raise InputError(f"{name} wavelength", float(wavelength[0]), unit="nm", allowed="above 0")
    kind = unit.strip().lower()
    if kind in ("fnu", "jy"):
        # Per frequency to per wavelength; a Jy is 1e-23 of the other.
        values = values * ((1e-23 if kind == "jy" else 1.0) * _SPEED_OF_LIGHT_NM_S / (10.0 * wavelength**2))
        kind = "flam"
    if kind == "flam":
        values = values * (10.0 * wavelength / HC_ERG_ANGSTROM)
    elif kind != "photlam":
        values = _by_astropy(name, wavelength, values, unit)
    return Spectrum(wavelength, values)


def _by_astropy(name: str, wavelength_nm: np.ndarray, flux: np.ndarray, unit: str) -> np.ndarray:
    hint = "the unit is not understood"
    if unit.strip():
        from astropy import units

        photlam = units.photon / (units.s * units.cm**2 * units.AA)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # several slashes are read from the left, as people mean them
                quantity = flux * units.Unit(unit)
            return np.asarray(quantity.to_value(photlam, units.spectral_density(wavelength_nm * units.nm)))
        except (ValueError, TypeError):
            pass
    else:
        unit, hint = "not stated", "name it in the heading, such as 'wavelength_nm photlam'"
    raise InputError(f"{name} flux unit", unit, allowed="photlam, flam, fnu, Jy, or a flux density", hint=hint)
