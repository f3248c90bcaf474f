"""Loaders of the shipped spectra: Sun, Vega, Johnson V, planet albedos, zodiacal light, stellar grid.

All arrays are read-only; each file is read once per process. Only numpy is needed.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from catalogs.stellar_grid import HC_ERG_ANGSTROM as HC_ERG_ANGSTROM, StellarGrid
from cpic_core import InputError, check_word

#: Planets with a measured albedo.
PLANETS = ("jupiter", "saturn", "uranus", "neptune")

_DATA = Path(__file__).resolve().parent / "data"


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A spectrum, linear between its samples.

    Attributes
    ----------
    wavelength_nm : ndarray, shape (n,)
        Increasing vacuum wavelengths.
    photlam : ndarray, shape (n,)
        Photon flux density, ph/s/cm2/A.
    """

    wavelength_nm: np.ndarray
    photlam: np.ndarray


@dataclass(frozen=True, eq=False)
class Curve:
    """A transmission curve, linear between its samples and zero outside.

    Attributes
    ----------
    wavelength_nm : ndarray, shape (n,)
        Increasing wavelengths.
    transmission : ndarray, shape (n,)
        Fraction of photons transmitted, 0 to 1.
    """

    wavelength_nm: np.ndarray
    transmission: np.ndarray


@dataclass(frozen=True, eq=False)
class Albedo:
    """A geometric albedo, linear between its samples.

    Attributes
    ----------
    wavelength_nm, albedo : ndarray, shape (n,)
        Increasing wavelengths and geometric albedo.
    documented_to_nm : float
        Beyond this wavelength the origin of the numbers is not documented; infinite for a table of your own.
    """

    wavelength_nm: np.ndarray
    albedo: np.ndarray
    documented_to_nm: float = np.inf


@dataclass(frozen=True, eq=False)
class SpectralLibrary:
    """Measured spectra by spectral type.

    Attributes
    ----------
    position : ndarray, shape (types,)
        Place on the temperature sequence: 10 x letter number (O = 0 ... M = 6) + subclass.
    luminosity_rank : ndarray, shape (types,)
        1 supergiant, 2 bright giant, 3 giant, 4 subgiant, 5 dwarf.
    wavelength_nm : ndarray, shape (n,)
        Increasing wavelengths.
    photlam : ndarray, shape (types, n)
        Photon flux density, ph/s/cm2/A, of a star of V = 0.
    """

    position: np.ndarray
    luminosity_rank: np.ndarray
    wavelength_nm: np.ndarray
    photlam: np.ndarray


@dataclass(frozen=True, eq=False)
class ZodiacalLight:
    """Zodiacal light of Leinert et al. 1998 (A&AS 127, 1), tables 17 and 19.

    Attributes
    ----------
    helioecliptic_longitude_deg : ndarray, shape (19,)
        Longitude from the Sun, 0 to 180.
    ecliptic_latitude_deg : ndarray, shape (11,)
        Absolute latitude, 0 to 90.
    radiance_500nm_w_m2_sr_um : ndarray, shape (19, 11)
        Radiance at 500 nm; NaN where the table is empty (too close to the Sun to observe).
    spectrum_wavelength_um, spectrum_radiance_w_m2_sr_um : ndarray, shape (16,)
        Spectrum at longitude 90 deg in the ecliptic.
    """

    helioecliptic_longitude_deg: np.ndarray
    ecliptic_latitude_deg: np.ndarray
    radiance_500nm_w_m2_sr_um: np.ndarray
    spectrum_wavelength_um: np.ndarray
    spectrum_radiance_w_m2_sr_um: np.ndarray


@functools.cache
def load_stellar_grid() -> StellarGrid:
    """Return the shipped stellar grid: PHOENIX lines on PHOENIX-ACES broadband fluxes, CK04 broadband trends."""
    return StellarGrid(**_arrays("stellar_grid.npz"))


@functools.cache
def load_pickles() -> SpectralLibrary:
    """Return the library of Pickles 1998 (PASP 110, 863), types A0-M6 of solar metallicity, 300-1750 nm in 1 nm."""
    arrays = _arrays("pickles.npz")
    photlam = arrays["flam"].astype(np.float64) * (arrays["wavelength_nm"] * 10.0) / HC_ERG_ANGSTROM
    return SpectralLibrary(arrays["position"], arrays["luminosity_rank"], arrays["wavelength_nm"], _read_only(photlam))


@functools.cache
def load_reference_spectrum(name: str) -> Spectrum:
    """Return the CALSPEC spectrum of the Sun at 1 AU or of Vega, 300-1750 nm.

    Parameters
    ----------
    name : {"sun", "vega"}
        Which one.

    Raises
    ------
    InputError
        For another name.
    """
    if name not in ("sun", "vega"):
        raise InputError("reference spectrum", name, allowed="sun, vega")
    arrays = _arrays("reference_spectra.npz")
    wavelength_nm = arrays[f"{name}_wavelength_nm"]
    photlam = arrays[f"{name}_flam"].astype(np.float64) * (wavelength_nm * 10.0) / HC_ERG_ANGSTROM
    return Spectrum(wavelength_nm, _read_only(photlam))


@functools.cache
def load_johnson_v() -> Curve:
    """Return Johnson V for photon counting (Maiz Apellaniz 2006), the curve that synphot uses by default."""
    arrays = _arrays("reference_spectra.npz")
    return Curve(arrays["johnson_v_wavelength_nm"], _read_only(arrays["johnson_v_transmission"].astype(np.float64)))


@functools.cache
def load_albedo(planet: str) -> Albedo:
    """Return the measured geometric albedo of a giant planet, 300-1755 nm in steps of 0.4 nm.

    Up to 1050 nm it is Karkoschka 1998 (Icarus 133, 134); beyond, its origin is undocumented.

    Parameters
    ----------
    planet : {"jupiter", "saturn", "uranus", "neptune"}
        Which one.

    Raises
    ------
    InputError
        For another name.
    """
    check_word("planet", planet, PLANETS)
    arrays = _arrays("albedo.npz")
    albedo = _read_only(arrays[planet].astype(np.float64))
    return Albedo(arrays["wavelength_nm"], albedo, float(arrays["documented_to_nm"]))


@functools.cache
def load_zodi_table() -> ZodiacalLight:
    """Return the zodiacal light tables; cells that are not tabulated are NaN."""
    arrays = dict(_arrays("zodiacal_light.npz"))
    radiance = _read_only(arrays.pop("radiance_500nm_1e8") * 1e-8)
    return ZodiacalLight(radiance_500nm_w_m2_sr_um=radiance, **arrays)


@functools.cache
def _arrays(file_name: str) -> dict[str, np.ndarray]:
    with np.load(_DATA / file_name, allow_pickle=False) as archive:
        return {name: _read_only(archive[name]) for name in archive.files}


def _read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
