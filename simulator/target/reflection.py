"""Light reflected by a planet: a Rayleigh-scattering, absorbing gas above a cloud deck.

The model of the parametric albedo, and of the inversion that gives the methane coefficients: one homogeneous layer
of gas (scattering optical depth ``t_s``, absorption optical depth ``t_a``) over a deck that reflects the share ``d``
of the flux that reaches it, both lit and seen along the same direction, as at phase 0.

Equations, for unit solar flux, ``t = t_s + t_a``, ``w = t_s / t`` and direction cosine ``m``:

1. The diffuse field is that of the hemispheric-mean two-stream approximation for isotropic scattering (Toon et al.
   1989, JGR 94, 16287, table 1: ``gamma_1 = 2 - w``, ``gamma_2 = w``, ``gamma_3 = gamma_4 = 1/2``). The sum ``S`` and
   the difference ``D`` of the upward and downward fluxes obey ``S' = 2 D`` and ``D' = 2 (1 - w) S - w exp(-x/m)``,
   hence with ``L = 2 sqrt(1 - w)``

       ``S(x) = a exp(-L x) + b exp(-L (t - x)) + c exp(-x/m)``,  ``c = -2 w m^2 / (1 - L^2 m^2)``;

   ``a`` and ``b`` follow from no diffuse light from above, ``S = D``, and reflection below,
   ``(S + D)/2 = d [(S - D)/2 + m exp(-t/m)]``.
2. The light that leaves towards the observer is the exact integral of that source over the path (the source function
   technique of the same paper), with ``J = S / (2 pi)`` and Rayleigh's phase function at backscatter, 3/2, for the
   first scattering: ``I(m) = integral of [w J + w (3/2) exp(-x/m) / (4 pi)] exp(-x/m) dx/m``
   plus the deck, ``d exp(-t/m) [(S - D)/2 + B m exp(-t/m)] / pi``. ``B`` is the deck's backscatter enhancement over a
   Lambert surface.
3. Geometric albedo ``A_g = 2 pi integral over 0 < m < 1 of I(m) m dm`` (Gauss-Legendre).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from catalogs.errors import InputError

__all__ = ["layer_albedo", "rayleigh_slope"]

_NODES = 8
_LEAST_DEPTH = 1e-12
_LARGEST_EXPONENT = 600.0
# Nearer to pure scattering, or to the resonance L m = 1, the closed form loses digits; the albedo moves by less than
# 1e-4 over these distances.
_LEAST_ABSORPTION = 1e-9
_RESONANCE = 1e-4
_RAYLEIGH_BACKSCATTER = 1.5
_REFERENCE_NM = 550.0


def rayleigh_slope(wavelength_nm: ArrayLike) -> np.ndarray:
    """Return the Rayleigh cross section of molecular hydrogen relative to 550 nm.

    Dalgarno & Williams 1962 (ApJ 136, 690): ``8.14e-13 l^-4 + 1.28e-6 l^-6 + 1.61 l^-8`` cm^2 with l in Angstrom.

    Parameters
    ----------
    wavelength_nm : array_like
        Wavelengths above 0.

    Returns
    -------
    ndarray
        1 at 550 nm.
    """

    def cross_section(angstrom: np.ndarray) -> np.ndarray:
        inverse_square = angstrom**-2.0
        return inverse_square**2 * (8.14e-13 + inverse_square * (1.28e-6 + inverse_square * 1.61))

    reference = cross_section(np.asarray(_REFERENCE_NM * 10.0))
    return np.asarray(cross_section(np.asarray(wavelength_nm, dtype=np.float64) * 10.0) / reference)


def layer_albedo(
    scattering_depth: ArrayLike, absorption_depth: ArrayLike, deck_albedo: ArrayLike, *, backscatter: float = 1.0
) -> np.ndarray:
    """Return the geometric albedo of a gas layer over a deck; equations in the module's head.

    Parameters
    ----------
    scattering_depth, absorption_depth : array_like
        Optical depths of the layer, at least 0.
    deck_albedo : array_like
        Share of flux that the deck reflects, 0 to 1.
    backscatter : float
        Enhancement of the deck's reflection straight back over that of a Lambert surface, at least 0.

    Returns
    -------
    ndarray
        Geometric albedo, broadcast shape. Against exact transfer (isotropic, Rayleigh for the first scattering) it is
        off by at most 0.03, or 9 % at depth 0.6 without a deck, rms 3 %.

    Raises
    ------
    InputError
        If a value is not finite or out of range.
    """
    scattering = _in_range("scattering_depth", scattering_depth, np.inf)
    absorption = _in_range("absorption_depth", absorption_depth, np.inf)
    deck = _in_range("deck_albedo", deck_albedo, 1.0)
    boost = float(_in_range("backscatter", backscatter, np.inf))
    depth = np.maximum(scattering + absorption, _LEAST_DEPTH)
    single = np.minimum(scattering / depth, 1.0 - _LEAST_ABSORPTION)
    decay = 2.0 * np.sqrt(1.0 - single)
    points, weights = np.polynomial.legendre.leggauss(_NODES)
    total: np.ndarray | float = 0.0
    for mu, weight in zip(0.5 * (points + 1.0), 0.5 * weights, strict=True):
        total = total + weight * mu * _intensity(depth, single, decay, deck, mu, boost)
    return np.asarray(2.0 * np.pi * total)


def _intensity(
    depth: np.ndarray, single: np.ndarray, decay: np.ndarray, deck: np.ndarray, mu: float, boost: float
) -> np.ndarray:
    """Intensity towards the observer at one direction cosine, for unit flux."""
    product = decay * mu
    product = np.where(np.abs(product - 1.0) < _RESONANCE, 1.0 + _RESONANCE, product)
    decay = product / mu
    # Slant depth of the beam, depth of the diffuse field, and what is left of each at the deck.
    slant, diffuse = np.minimum(depth / mu, _LARGEST_EXPONENT), np.minimum(decay * depth, _LARGEST_EXPONENT)
    beam, field = np.exp(-slant), np.exp(-diffuse)
    c = -2.0 * single * mu**2 / (1.0 - product**2)
    half = 0.5 * decay
    # Two conditions for a and b: S - D = 0 at the top; (1 - d) S + (1 + d) D = 2 d m exp(-t/m) at the deck.
    top_a, top_b, top = 1.0 + half, field * (1.0 - half), -c * (1.0 + 0.5 / mu)
    low_a = field * ((1.0 - deck) - (1.0 + deck) * half)
    low_b = (1.0 - deck) + (1.0 + deck) * half
    low = 2.0 * deck * mu * beam - c * beam * ((1.0 - deck) - (1.0 + deck) * 0.5 / mu)
    determinant = top_a * low_b - top_b * low_a
    a = (top * low_b - top_b * low) / determinant
    b = (top_a * low - top * low_a) / determinant
    total = a * field + b + c * beam
    difference = half * (b - a * field) - 0.5 * c * beam / mu
    # Path integrals of the three exponentials; the second is a divided difference of the exponential function.
    gap = slant - diffuse
    safe = np.where(np.abs(gap) < _LARGEST_EXPONENT * 1e-12, 1.0, gap)
    falling = (1.0 - field * beam) / (1.0 + product)
    rising = slant * np.where(safe == gap, (field - beam) / safe, beam)
    once = 0.5 * (1.0 - beam * beam)
    many = single / (2.0 * np.pi) * (a * falling + b * rising + c * once)
    first = single * _RAYLEIGH_BACKSCATTER / (4.0 * np.pi) * once
    below = deck * beam / np.pi * (0.5 * (total - difference) + boost * mu * beam)
    return np.asarray(many + first + below)


def _in_range(name: str, value: ArrayLike, high: float) -> np.ndarray:
    array = np.asarray(value, dtype=np.float64)
    inside = (array >= 0.0) & (array <= high) & np.isfinite(array)
    if not np.all(inside):
        allowed = "finite, at least 0" if np.isinf(high) else f"0 to {high:g}"
        raise InputError(name, float(array[~inside].flat[0]), allowed=allowed)
    return array
