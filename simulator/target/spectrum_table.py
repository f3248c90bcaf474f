"""Spectra from two-column files: text with units in its header, ECSV, VOTable, FITS."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import HC_ERG_ANGSTROM, LENGTHS_NM, Spectrum, TableBytes, astropy_table, two_columns
from cpic_core import InputError, read_file
from simulator.band_integrals import check_table

_MAX_BYTES = 200_000_000
# nm per unit.
_FLUXES = ("photlam", "flam", "fnu", "jy")
_SPEED_OF_LIGHT_NM_S = 2.99792458e17
_WANTED = "a header such as 'wavelength_nm photlam' (nm, um or Angstrom; photlam, flam, fnu or Jy)"


def read_spectrum(path: str | Path) -> Spectrum:
    """Read a spectrum from a file of two columns, wavelength and flux density.

    Text files (``.txt``, ``.dat``, ``.csv``: columns apart by blanks, commas, semicolons or tabs) name their units in
    comment lines or in the line above the numbers: ``wavelength_nm,photlam`` or ``# Angstrom flam``. ECSV, VOTable
    and FITS tables carry units with their columns; in FITS the columns ``WAVELENGTH`` and ``FLUX`` are read, else the
    first two.

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
    start = data[:512].lstrip()
    kinds = {b"SIMPLE  =": "fits", b"# %ECSV": "ecsv", b"<?xml": "votable", b"<VOTABLE": "votable"}
    kind = next((kind for mark, kind in kinds.items() if start.startswith(mark)), "")
    columns = _from_table(place, data, kind) if kind else _from_text(place, data)
    wavelength, wavelength_unit, flux, flux_unit = columns
    wavelength_nm = wavelength * _wavelength_scale(place, wavelength_unit)
    return photon_flux(place.name, wavelength_nm, flux, flux_unit)


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


def _from_text(path: Path, data: bytes) -> tuple[np.ndarray, str, np.ndarray, str]:
    wavelength, flux, said = two_columns(data, path.name)
    words = re.findall(r"[a-z]+", said.lower())
    return wavelength, _only(path, "wavelength", words, LENGTHS_NM), flux, _only(path, "flux", words, _FLUXES)


def _only(path: Path, what: str, words: list[str], known: Any) -> str:
    """Return the one unit that the header names."""
    named = [word for word in dict.fromkeys(words) if word in known]
    scales = {known[word] if isinstance(known, dict) else word for word in named}
    if len(scales) != 1:
        raise InputError(f"{path.name} {what} unit", " and ".join(named) or "not stated", allowed=_WANTED)
    return named[0]


def _from_table(path: Path, data: bytes, kind: str) -> tuple[np.ndarray, str, np.ndarray, str]:
    try:
        table, _ = astropy_table(TableBytes(path.name, data, ""), kind)
        names = [name for name in ("WAVELENGTH", "FLUX") if kind == "fits" and name in table.colnames]
        columns = [table[name] for name in (names if len(names) == 2 else table.colnames[:2])]
        values = [np.array(np.ma.filled(np.ma.asarray(column, float), np.nan), dtype=np.float64) for column in columns]
        units = ["" if column.unit is None else str(column.unit) for column in columns]
    except InputError:
        raise
    except Exception as error:
        raise _unreadable(path, error) from None
    if len(values) != 2:
        raise InputError(path.name, f"{len(values)} columns", allowed="wavelength and flux")
    return values[0], units[0], values[1], units[1]


def _unreadable(path: Path, error: Exception) -> InputError:
    reason = f"{type(error).__name__}: {error}"[:160]
    return InputError("spectrum file", str(path), allowed="a whole table of wavelength and flux", hint=reason)


def _wavelength_scale(path: Path, unit: str) -> float:
    if unit.strip().lower() in LENGTHS_NM:
        return LENGTHS_NM[unit.strip().lower()]
    if unit.strip():
        from astropy import units

        try:
            return float(units.Unit(unit).to(units.nm))
        except (ValueError, TypeError, units.UnitConversionError):
            pass
    raise InputError(f"{path.name} wavelength unit", unit or "not stated", allowed="nm, um, Angstrom")


def _by_astropy(name: str, wavelength_nm: np.ndarray, flux: np.ndarray, unit: str) -> np.ndarray:
    if unit.strip():
        from astropy import units

        photlam = units.photon / (units.s * units.cm**2 * units.AA)
        try:
            quantity = flux * units.Unit(unit)
            return np.asarray(quantity.to_value(photlam, units.spectral_density(wavelength_nm * units.nm)))
        except (ValueError, TypeError, units.UnitConversionError):
            pass
    raise InputError(f"{name} flux unit", unit or "not stated", allowed="photlam, flam, fnu, Jy, or a flux density")
