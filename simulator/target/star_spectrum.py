"""Stellar spectra normalised in Johnson V (Vega)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from catalogs.errors import InputError
from catalogs.spectra import Spectrum, load_stellar_grid
from catalogs.spectral_types import stellar_parameters
from simulator.band_integrals import v_photon_rate, vega_v_photon_rate

if TYPE_CHECKING:
    from synphot import SourceSpectrum

__all__ = ["StarSpectrum", "star_photlam", "stellar_spectrum"]

# h c / k, nm K (exact SI values).
_HC_OVER_K_NM_K = 6.62607015e-34 * 2.99792458e8 / 1.380649e-23 * 1e9
_SUN_LIKE_LOG_G = 4.44
_BLACKBODY_TEFF_K = (1000.0, 1e6)
_V_MAG = (-30.0, 40.0)


@dataclass(frozen=True, eq=False)
class StarSpectrum(Spectrum):
    """A stellar spectrum at the telescope and what it was made from.

    Attributes
    ----------
    wavelength_nm, photlam : ndarray, shape (n,)
        300-1750 nm at R = 1000; ph/s/cm2/A.
    teff_k, log_g, metallicity : float
        Parameters used, after clamping.
    flags : tuple of str
        ``log_g_clamped``, ``metallicity_clamped``, ``subclass_assumed``, ``luminosity_class_assumed``,
        ``log_g_assumed``.
    """

    teff_k: float
    log_g: float
    metallicity: float
    flags: tuple[str, ...]


def stellar_spectrum(
    magnitude_v: float,
    spectral_type: str | None = None,
    *,
    teff_k: float | None = None,
    log_g: float | None = None,
    metallicity: float | None = None,
    model: str = "grid",
) -> StarSpectrum:
    """Return the photon spectrum of a star at the telescope, outside the atmosphere.

    ``grid`` interpolates the shipped surface fluxes (PHOENIX lines, CK04 broadband metallicity trend)
    linearly in flux over log g, [M/H] and Teff, the eight nearest nodes; ``blackbody`` is a Planck
    spectrum. Both are scaled to the Johnson V magnitude on the Vega scale (Vega has V = 0).

    Parameters
    ----------
    magnitude_v : float
        Johnson V.
    spectral_type : str, optional
        MK type, gives Teff and log g; either this or `teff_k` is needed.
    teff_k, log_g, metallicity : float, optional
        Override the type's values; defaults: log g 4.44 without a type (flagged), [M/H] = 0.
    model : {"grid", "blackbody"}
        Kind of spectrum. The grid holds 3500-8000 K, log g 3.5-5.0, [M/H] -2.5 to 0.5.

    Returns
    -------
    StarSpectrum
        Gravity and metallicity outside the grid are clamped to its edge and flagged.

    Raises
    ------
    InputError
        If a value is not finite or out of range, the type cannot be read, or the temperature is outside the
        grid (there the blackbody is the labelled alternative).
    """
    magnitude = _number("magnitude_v", magnitude_v, "mag", *_V_MAG)
    if spectral_type is None and teff_k is None:
        raise InputError("spectral_type", None, allowed="an MK type such as K1V", hint="or give teff_k")
    flags: list[str] = []
    gravity = _SUN_LIKE_LOG_G
    if spectral_type is not None and (teff_k is None or log_g is None):
        typical = stellar_parameters(spectral_type)
        teff_k = typical.teff_k if teff_k is None else teff_k
        gravity = typical.log_g
        flags += typical.flags
    elif log_g is None:
        flags.append("log_g_assumed")
    log_g = gravity if log_g is None else log_g
    metallicity = 0.0 if metallicity is None else metallicity
    if model == "grid":
        return _from_grid(magnitude, _finite("teff_k", teff_k, "K"), log_g, metallicity, flags)
    if model == "blackbody":
        temperature = _number("teff_k", teff_k, "K", *_BLACKBODY_TEFF_K)
        wavelength_nm = load_stellar_grid().wavelength_nm
        surface = wavelength_nm**-4.0 / np.expm1(_HC_OVER_K_NM_K / (wavelength_nm * temperature))
        photlam = _normalised(wavelength_nm, surface, magnitude)
        return StarSpectrum(wavelength_nm, photlam, temperature, log_g, metallicity, tuple(flags))
    raise InputError("model", model, allowed="grid, blackbody")


def star_photlam(
    magnitude_v: float,
    spectral_type: str | None = None,
    *,
    teff_k: float | None = None,
    log_g: float | None = None,
    metallicity: float | None = None,
    model: str = "grid",
) -> SourceSpectrum:
    """Return `stellar_spectrum` as a synphot source: PHOTLAM (ph/s/cm2/A) over wavelength in Angstrom.

    Parameters and errors are those of `stellar_spectrum`; ``meta`` of the result holds the parameters used
    and the flags. The source is zero outside 3000-17500 A.
    """
    from synphot import SourceSpectrum
    from synphot.models import Empirical1D

    star = stellar_spectrum(
        magnitude_v, spectral_type, teff_k=teff_k, log_g=log_g, metallicity=metallicity, model=model
    )
    meta = {
        "magnitude_v": float(magnitude_v),
        "spectral_type": spectral_type,
        "teff_k": star.teff_k,
        "log_g": star.log_g,
        "metallicity": star.metallicity,
        "model": model,
        "flags": star.flags,
    }
    # Without fill_value synphot continues the edge values for ever.
    return SourceSpectrum(
        Empirical1D, points=star.wavelength_nm * 10.0, lookup_table=star.photlam, fill_value=0.0, meta=meta
    )


def _from_grid(magnitude: float, teff_k: float, log_g: float, metallicity: float, flags: list[str]) -> StarSpectrum:
    grid = load_stellar_grid()
    outside = grid.flags(teff_k, log_g, metallicity)
    low, high = float(grid.teff_k[0]), float(grid.teff_k[-1])
    if outside.teff_k:
        raise InputError("teff_k", teff_k, unit="K", allowed=f"{low:g} to {high:g}", hint='or model="blackbody"')
    if outside.log_g:
        flags.append("log_g_clamped")
    if outside.metallicity:
        flags.append("metallicity_clamped")
    nodes, weights = grid.corners(teff_k, log_g, metallicity)
    surface = weights @ grid.node_photlam(nodes, np.arange(grid.wavelength_nm.size))
    return StarSpectrum(
        grid.wavelength_nm,
        _normalised(grid.wavelength_nm, surface, magnitude),
        teff_k,
        float(np.clip(log_g, grid.log_g[0], grid.log_g[-1])),
        float(np.clip(metallicity, grid.metallicity[0], grid.metallicity[-1])),
        tuple(flags),
    )


def _normalised(wavelength_nm: np.ndarray, surface: np.ndarray, magnitude: float) -> np.ndarray:
    """Return the spectrum scaled to the V magnitude, read-only."""
    relative = surface / surface.max()
    photlam = relative * (10.0 ** (-0.4 * magnitude) * vega_v_photon_rate() / v_photon_rate(wavelength_nm, relative))
    photlam.setflags(write=False)
    return photlam


def _finite(name: str, value: float | None, unit: str) -> float:
    if value is None or not np.isfinite(value):
        raise InputError(name, value, unit=unit, allowed="a finite number")
    return float(value)


def _number(name: str, value: float | None, unit: str, low: float, high: float) -> float:
    number = _finite(name, value, unit)
    if not low <= number <= high:
        raise InputError(name, number, unit=unit, allowed=f"{low:g} to {high:g}")
    return number
