"""Thermal light of a sphere."""

from __future__ import annotations

import numpy as np

from simulator.target.contrast import AU_KM, JUPITER_RADIUS_KM

__all__ = ["photon_surface", "thermal_photlam"]

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
