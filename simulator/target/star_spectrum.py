"""Stellar spectra normalised in Johnson V (Vega), and the thermal light of a sphere."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from catalogs import Spectrum, load_stellar_grid, stellar_parameters
from cpic_core import InputError, check_number, is_file, numeric_context
from simulator.band_integrals import check_table, v_photon_rate, vega_v_photon_rate
from simulator.target.contrast import AU_KM, JUPITER_RADIUS_KM

if TYPE_CHECKING:
    from synphot import SourceSpectrum


_C_CM_S = 2.99792458e10
# h c / k, cm K (exact SI values).
_HC_OVER_K_CM_K = 6.62607015e-34 * 2.99792458e8 / 1.380649e-23 * 100.0
_CM_PER_NM = 1e-7
_CM_PER_ANGSTROM = 1e-8
_AU_PER_PC = 648000.0 / np.pi


def photon_surface(wavelength_nm: np.ndarray, teff_k: float) -> np.ndarray:
    """Return the photon flux of a black surface, ph/s/cm2/A: ``2 pi c / lambda^4 / (exp(h c / lambda k T) - 1)``.

    Planck's law in photons times pi.

    Parameters
    ----------
    wavelength_nm : ndarray
        Wavelengths.
    teff_k : float
        Temperature, at least 70 K at 300 nm (below, the exponential overflows).
    """
    wavelength_cm = np.asarray(wavelength_nm, dtype=np.float64) * _CM_PER_NM
    surface = 2.0 * np.pi * _C_CM_S / wavelength_cm**4 / np.expm1(_HC_OVER_K_CM_K / (wavelength_cm * teff_k))
    return np.asarray(surface * _CM_PER_ANGSTROM)


def thermal_photlam(wavelength_nm: np.ndarray, teff_k: float, radius_rjup: float, distance_pc: float) -> np.ndarray:
    """Return the photon flux density of a black sphere at a distance, ph/s/cm2/A.

    `photon_surface` times ``(R/d)^2``.

    Parameters
    ----------
    wavelength_nm : ndarray
        Wavelengths.
    teff_k : float
        Temperature, see `photon_surface`.
    radius_rjup : float
        Radius, R_J = 71 492 km.
    distance_pc : float
        Distance from us.
    """
    size = radius_rjup * JUPITER_RADIUS_KM / (distance_pc * _AU_PER_PC * AU_KM)
    return np.asarray(photon_surface(wavelength_nm, teff_k) * size * size)


StarModel: TypeAlias = str | os.PathLike[str] | Spectrum
"""Name of a model, path of a tree or file, or a spectrum."""

STAR_MODELS = ("grid", "blackbody", "pickles")
"""Models by name."""

STAR_FLAGS = {
    "subclass_assumed": "the spectral type names no subclass: 5 taken",
    "luminosity_class_assumed": "the spectral type names no luminosity class: V taken",
    "type_uncertain": "the spectral type carries a colon or question mark",
    "composite_first_used": "two stars in one spectral type: the first taken",
    "subdwarf_as_dwarf": "temperature and gravity of a subdwarf taken from the dwarfs",
    "log_g_assumed": "no gravity and no spectral type given: the Sun's taken",
    "low_gravity_lines": "gravity below 3.5: lines of log g 3.5 on the broadband fluxes of the gravity",
    "template_interpolated": "mean of neighbouring templates of the library",
    "teff_k_unused": "the model does not depend on the temperature given",
    "log_g_unused": "the model does not depend on the gravity given",
    "metallicity_unused": "the model does not depend on the metallicity given",
}
"""Codes in ``flags`` and what they mean."""

_SUN_LIKE_LOG_G = 4.44
_BLACKBODY_TEFF_K = (100.0, 1e6)
_V_MAG = (-30.0, 40.0)
_NEUTRAL = {"metallicity": 0.0}
_ALLOWED_MODELS = f"{', '.join(STAR_MODELS)}, a Spectrum, or the path of a file or of a tree of models"


@dataclass(frozen=True, eq=False)
class StarSpectrum(Spectrum):
    """A stellar spectrum at the telescope and what it was made from.

    Attributes
    ----------
    wavelength_nm, photlam : ndarray, shape (n,)
        Increasing wavelengths, the model's own (300-1750 nm for the shipped ones); ph/s/cm2/A.
    teff_k, log_g, metallicity : float or None
        Parameters used; for models that do not depend on them, those given or typical of the spectral type, None
        if there are none.
    flags : tuple of str
        Codes of `STAR_FLAGS`.
    model : str
        ``grid``, ``blackbody``, ``pickles``, ``table``, or the path given.
    """

    teff_k: float | None
    log_g: float | None
    metallicity: float | None
    flags: tuple[str, ...]
    model: str = "grid"


@dataclass(frozen=True)
class _Parameters:
    teff_k: float | None
    log_g: float | None
    metallicity: float | None
    flags: tuple[str, ...] = ()

    def unused(self, *names: str) -> tuple[str, ...]:
        """Return flags for those that are given; [M/H] = 0 is what all models are made for."""
        return tuple(f"{name}_unused" for name in names if getattr(self, name) not in (None, _NEUTRAL.get(name)))


def stellar_spectrum(
    magnitude_v: float,
    spectral_type: str | None = None,
    *,
    teff_k: float | None = None,
    log_g: float | None = None,
    metallicity: float | None = None,
    model: StarModel = "grid",
) -> StarSpectrum:
    """Return the photon spectrum of a star at the telescope, outside the atmosphere.

    Whatever the model, the spectrum is scaled to the Johnson V magnitude on the Vega scale (Vega has V = 0). One star
    a call; numbers may carry units (`astropy.units`). For many stars, see `simulator.passbands.Passbands`.

    Parameters
    ----------
    magnitude_v : float
        Johnson V, -30 to 40.
    spectral_type : str, optional
        MK type, gives Teff and log g. Either this or `teff_k` is needed, unless the spectrum is given.
    teff_k, log_g, metallicity : float, optional
        Override the type's values (K, dex of cm/s2, dex); defaults: log g 4.44 without a type (flagged), [M/H] = 0.
    model : str, path or Spectrum
        - ``"grid"``: the shipped surface fluxes (PHOENIX lines at R = 1000 on PHOENIX-ACES broadband fluxes, CK04
          broadband trends with metallicity and, below 3.5, gravity), interpolated linearly in flux over log g, [M/H]
          and Teff. 3500-8000 K, log g 0-5 (from 0.5 above 6000 K, from 1 above 7400 K), [M/H] -2.5 to 0.5. Scaled in
          V, it has the Sun's light within 2.5 % from 450 to 1100 nm, 3 % more at 1265 and 4 % more at 1400-1600 nm
          (TSIS-1 HSRS, ``reports/external``).
        - ``"blackbody"``: Planck's law, 100 K to 1e6 K.
        - ``"pickles"``: measured spectra by spectral type (Pickles 1998), A0-M6.
        - the path of a CK04, Kurucz or PHOENIX tree, see `simulator.target.stellar_libraries.find_tree`.
        - the path of a file, see `simulator.target.spectrum_table.read_spectrum`, or a `Spectrum`; it must cover
          470-700 nm.

    Returns
    -------
    StarSpectrum

    Raises
    ------
    InputError
        If a value is not finite or outside the model (which is said with its range), the type cannot be read, or the
        tree or file is not as it should be.
    """
    magnitude = _number("magnitude_v", magnitude_v, "mag", *_V_MAG)
    numbers = ("teff_k", teff_k, "K"), ("log_g", log_g, "dex"), ("metallicity", metallicity, "dex")
    checked = [None if value is None else check_number(name, value, unit) for name, value, unit in numbers]
    given = _Parameters(checked[0], checked[1], checked[2])
    if isinstance(model, Spectrum):
        return _from_table(magnitude, model, given, "table")
    if not isinstance(model, str | os.PathLike):
        raise InputError("model", model, allowed=_ALLOWED_MODELS)
    name = str(model)
    if name == "pickles":
        return _from_library(magnitude, spectral_type, given)
    if name not in STAR_MODELS and is_file(name) and Path(name).name != "catalog.fits":
        from simulator.target.spectrum_table import read_spectrum

        return _from_table(magnitude, read_spectrum(name), given, name)
    star = _complete(spectral_type, given)
    if name == "grid":
        return _from_grid(magnitude, star)
    if name == "blackbody":
        return _blackbody(magnitude, star, given)
    return _from_tree(magnitude, star, name)


@numeric_context()
def star_photlam(
    magnitude_v: float,
    spectral_type: str | None = None,
    *,
    teff_k: float | None = None,
    log_g: float | None = None,
    metallicity: float | None = None,
    model: StarModel = "grid",
) -> SourceSpectrum:
    """Return `stellar_spectrum` as a synphot source: PHOTLAM (ph/s/cm2/A) over wavelength in Angstrom.

    Parameters and errors are those of `stellar_spectrum`; ``meta`` of the result holds the parameters used, the
    model and the flags. The source is zero outside the model's wavelengths (3000-17500 A for the shipped ones).
    """
    star = stellar_spectrum(
        magnitude_v, spectral_type, teff_k=teff_k, log_g=log_g, metallicity=metallicity, model=model
    )
    meta = {"magnitude_v": check_number("magnitude_v", magnitude_v, "mag"), "spectral_type": spectral_type}
    meta |= {name: getattr(star, name) for name in ("teff_k", "log_g", "metallicity", "model", "flags")}
    return synphot_source(star.wavelength_nm, star.photlam, meta)


def synphot_source(wavelength_nm: np.ndarray, photlam: np.ndarray, meta: dict[str, Any]) -> SourceSpectrum:
    """Return the samples as a synphot source, zero outside them.

    Parameters
    ----------
    wavelength_nm, photlam : ndarray
        Samples, nm and ph/s/cm2/A.
    meta : dict
        What is told with the source.
    """
    from synphot import SourceSpectrum
    from synphot.models import Empirical1D

    # Without fill_value synphot continues the edge values for ever.
    return SourceSpectrum(Empirical1D, points=wavelength_nm * 10.0, lookup_table=photlam, fill_value=0.0, meta=meta)


def _complete(spectral_type: str | None, given: _Parameters) -> _Parameters:
    """Return the parameters given, completed from the type or by the stated assumptions."""
    teff_k, log_g = given.teff_k, given.log_g
    flags: tuple[str, ...] = ()
    if teff_k is None and spectral_type is None:
        raise InputError("spectral_type", "missing", allowed="an MK type such as K1V", hint="or give teff_k")
    if spectral_type is not None and (teff_k is None or log_g is None):
        typical = stellar_parameters(spectral_type)
        teff_k = typical.teff_k if teff_k is None else teff_k
        log_g = typical.log_g if log_g is None else log_g
        flags = typical.flags
    elif log_g is None:
        log_g, flags = _SUN_LIKE_LOG_G, ("log_g_assumed",)
    return _Parameters(teff_k, log_g, 0.0 if given.metallicity is None else given.metallicity, flags)


def _from_grid(magnitude: float, star: _Parameters) -> StarSpectrum:
    grid = load_stellar_grid()
    teff_k = _number("teff_k", star.teff_k, "K", *grid.teff_k[[0, -1]], hint='or model="blackbody"')
    floor = float(grid.log_g_floor(teff_k))
    log_g = _number("log_g", star.log_g, "dex", floor, grid.log_g[-1], where=f" at {teff_k:g} K")
    metallicity = _number("metallicity", star.metallicity, "dex", *grid.metallicity[[0, -1]])
    flags = (*star.flags, "low_gravity_lines") if log_g < grid.line_log_g[0] else star.flags
    nodes, weights = grid.corners(teff_k, log_g, metallicity)
    surface = weights @ grid.node_photlam(nodes, np.arange(grid.wavelength_nm.size))
    photlam = _normalised(grid.wavelength_nm, surface, magnitude)
    return StarSpectrum(grid.wavelength_nm, photlam, teff_k, log_g, metallicity, flags, "grid")


def _blackbody(magnitude: float, star: _Parameters, given: _Parameters) -> StarSpectrum:
    teff_k = _number("teff_k", star.teff_k, "K", *_BLACKBODY_TEFF_K)
    flags = tuple(flag for flag in star.flags if flag != "log_g_assumed")
    wavelength_nm = load_stellar_grid().wavelength_nm
    photlam = _normalised(wavelength_nm, photon_surface(wavelength_nm, teff_k), magnitude)
    flags += given.unused("log_g", "metallicity")
    return StarSpectrum(wavelength_nm, photlam, teff_k, star.log_g, star.metallicity, flags, "blackbody")


def _from_library(magnitude: float, spectral_type: str | None, given: _Parameters) -> StarSpectrum:
    from simulator.target.stellar_libraries import library_photlam

    if spectral_type is None:
        allowed = "an MK type of the library, A0 to M6"
        raise InputError("spectral_type", "missing", allowed=allowed, hint='or model="grid"')
    wavelength_nm, template, flags = library_photlam(spectral_type)
    typical = stellar_parameters(spectral_type)
    photlam = _normalised(wavelength_nm, template, magnitude)
    flags = (*typical.flags, *flags, *given.unused("teff_k", "log_g", "metallicity"))
    return StarSpectrum(wavelength_nm, photlam, typical.teff_k, typical.log_g, 0.0, flags, "pickles")


def _from_tree(magnitude: float, star: _Parameters, path: str) -> StarSpectrum:
    from simulator.target.stellar_libraries import find_tree, tree_photlam

    if not path:
        raise InputError("model", "empty", allowed=_ALLOWED_MODELS)
    tree = find_tree(path)
    assert star.teff_k is not None
    assert star.log_g is not None
    assert star.metallicity is not None
    wavelength_nm, surface = tree_photlam(tree, star.teff_k, star.log_g, star.metallicity)
    photlam = _normalised(wavelength_nm, surface, magnitude)
    return StarSpectrum(wavelength_nm, photlam, star.teff_k, star.log_g, star.metallicity, star.flags, path)


def _from_table(magnitude: float, table: Spectrum, given: _Parameters, name: str) -> StarSpectrum:
    wavelength_nm, flux = check_table("spectrum", table.wavelength_nm, table.photlam)
    photlam = _normalised(wavelength_nm, flux, magnitude)
    flags = given.unused("teff_k", "log_g", "metallicity")
    return StarSpectrum(wavelength_nm, photlam, given.teff_k, given.log_g, given.metallicity, flags, name)


def _normalised(wavelength_nm: np.ndarray, surface: np.ndarray, magnitude: float) -> np.ndarray:
    """Return the spectrum scaled to the V magnitude, read-only."""
    peak = surface.max()
    rate = v_photon_rate(wavelength_nm, surface / peak) if peak > 0.0 else 0.0
    if not rate > 0.0:
        raise InputError("spectrum", "no light in V", allowed="some light between 470 and 700 nm")
    photlam: np.ndarray = surface / peak * (10.0 ** (-0.4 * magnitude) * vega_v_photon_rate() / rate)
    photlam.setflags(write=False)
    return photlam


def _number(
    name: str, value: float | None, unit: str, low: float, high: float, *, where: str = "", hint: str = ""
) -> float:
    number = check_number(name, value, unit)
    if not low <= number <= high:
        raise InputError(name, number, unit=unit, allowed=f"{low:g} to {high:g}{where}", hint=hint)
    return number
