"""Parametric albedo of giant planets: Rayleigh scattering over a cloud deck with methane absorption.

Not the models of Batalha et al. 2018, but a model with a few physical parameters at each node of their grid
(metallicity, sedimentation efficiency of the clouds f_sed, insolation), fitted to the six band albedos that are
public for it; ``tools/calibrate_albedo`` makes the table and says how well it does.

At a node the albedo is ``h + (1 - h)^2 A(t_s, t_a, d)`` with `simulator.target.reflection.layer_albedo` and

- ``t_s = T r(l)``: Rayleigh scattering of the gas above the cloud, T at 550 nm;
- ``t_a = T [M x k(l) + n N(l) + w W(l)]``: methane (k in 1/(km amagat), x = 10^[M/H] times the column of a solar
  mixture, M a factor near 1), sodium and potassium wings, water vapour;
- ``d = logistic(c + s ln(l / 650 nm))``: reflectivity of the deck, with 1.15 times the light straight back of a
  Lambert surface;
- ``h``: a thin grey haze above all.

Between nodes the albedo itself is interpolated, linearly in log10 of metallicity and f_sed and in ln of distance: it
stays positive, and smooth in wavelength. f_sed above 6 is taken as 6 and never blended with the cloud-free models.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from catalogs.errors import InputError
from catalogs.stellar_grid import bracket
from simulator.albedo_family import AlbedoFamily
from simulator.arrays import read_npz
from simulator.target.phase import checked_phase, lambert_phase
from simulator.target.reflection import layer_albedo, rayleigh_slope

__all__ = [
    "BACKSCATTER",
    "PARAMETERS",
    "ParametricGrid",
    "grid_phase_curve",
    "load_parametric_grid",
    "node_albedo",
    "parametric_family",
    "phase_curve",
]

PARAMETERS = (
    "ln_rayleigh_depth",
    "ln_methane_factor",
    "deck_logit",
    "deck_slope",
    "ln_alkali",
    "ln_water",
    "ln_haze",
)
"""The parameters of a node: ln T, ln M, c, s, ln n, ln w, ln h."""

BACKSCATTER = 1.15
"""Enhancement of the deck straight back (A): the brightest models of the grid reach A_g = 0.77, 2/3 of it 0.67."""

# Methane above a Rayleigh depth of 1 at 550 nm in a solar mixture, km amagat: 400 km amagat of H2 (cross section of
# Dalgarno & Williams 1962) times CH4/H2 = 5e-4 (C/H of Lodders 2003, all carbon in methane).
_SOLAR_METHANE_KM_AM = 0.2
_DECK_REFERENCE_NM = 650.0

# Absorbers of warm gas beside methane: centre (nm), half width (nm), height relative to the strongest. Centres from
# spectroscopy; widths and heights assumed (A): they only have to carry light between the fitted bands.
_ALKALI = ((589.3, 15.0, 1.0), (768.0, 15.0, 0.5))
_WATER = ((725.0, 10.0, 0.1), (820.0, 12.0, 0.1), (940.0, 25.0, 1.0), (1135.0, 35.0, 1.0), (1380.0, 50.0, 10.0))


@dataclass(frozen=True, eq=False)
class ParametricGrid:
    """The fitted table.

    Attributes
    ----------
    fsed : ndarray, shape (8,)
        Sedimentation efficiency; the first, 0, is cloud-free.
    insolation_au : ndarray, shape (10,)
    log10_mh : ndarray, shape (6,)
    parameters : ndarray, shape (8, 10, 6, 7)
        In the order of `PARAMETERS`.
    phase : ndarray, shape (8, 10, 6, 3)
        Parameters of `phase_curve`.
    wavelength_nm, methane_per_km_am : ndarray, shape (n,)
        Sampling of the spectra and methane absorption there, 1/(km amagat).
    documented_to_nm : float
        Beyond, the methane coefficients come from albedos of undocumented origin.
    """

    fsed: np.ndarray
    insolation_au: np.ndarray
    log10_mh: np.ndarray
    parameters: np.ndarray
    phase: np.ndarray
    wavelength_nm: np.ndarray
    methane_per_km_am: np.ndarray
    documented_to_nm: float


def data_file() -> Path:
    """Return where the fitted table lies."""
    return Path(str(files("simulator.target") / "data" / "parametric_albedo.npz"))


@functools.cache
def load_parametric_grid() -> ParametricGrid:
    """Return the shipped table; it is read once per process."""
    arrays = read_npz(data_file())
    documented = float(arrays.pop("documented_to_nm"))
    plain = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}
    for array in plain.values():
        array.setflags(write=False)
    return ParametricGrid(documented_to_nm=documented, **plain)


def node_albedo(
    parameters: ArrayLike, log10_mh: ArrayLike, wavelength_nm: ArrayLike, methane_per_km_am: ArrayLike
) -> np.ndarray:
    """Return geometric albedos of nodes; equations in the module's head.

    Parameters
    ----------
    parameters : array_like, shape (..., 7)
        In the order of `PARAMETERS`.
    log10_mh : array_like, shape (...)
        Metallicity of each.
    wavelength_nm, methane_per_km_am : array_like, shape (n,)

    Returns
    -------
    ndarray, shape (..., n)
    """
    depth, methane, deck, slope, alkali, water, haze = np.moveaxis(np.asarray(parameters, float), -1, 0)[..., None]
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    column = _SOLAR_METHANE_KM_AM * 10.0 ** np.asarray(log10_mh, float)[..., None] * np.exp(methane)
    absorber = column * np.asarray(methane_per_km_am, float)
    absorber = absorber + np.exp(alkali) * _lorentz(wavelength, _ALKALI) + np.exp(water) * _gauss(wavelength, _WATER)
    above = np.exp(depth)
    reflectivity = 1.0 / (1.0 + np.exp(-(deck + slope * np.log(wavelength / _DECK_REFERENCE_NM))))
    below = layer_albedo(above * rayleigh_slope(wavelength), above * absorber, reflectivity, backscatter=BACKSCATTER)
    veil = np.exp(haze)
    return np.asarray(veil + (1.0 - veil) ** 2 * below)


@functools.lru_cache(maxsize=32)
def parametric_family(log10_mh: float, log10_fsed: float | None) -> AlbedoFamily:
    """Return the parametric albedo over insolation.

    Parameters
    ----------
    log10_mh : float
        Decimal logarithm of the metallicity over the Sun's, 0 to 2.
    log10_fsed : float or None
        Decimal logarithm of f_sed, -2 to log10 6; above, log10 6 is used. None: cloud-free.

    Returns
    -------
    AlbedoFamily
        300-1755 nm in steps of 2 nm.

    Raises
    ------
    InputError
        If a parameter is out of range.
    """
    grid = load_parametric_grid()
    albedo = sum(weight * _node_spectra(fsed, metal) for fsed, metal, weight in _corners(grid, log10_mh, log10_fsed))
    family = np.asarray(albedo)
    family.setflags(write=False)
    return AlbedoFamily(grid.insolation_au, grid.wavelength_nm, family, grid.documented_to_nm)


def phase_curve(shape: ArrayLike, phase_deg: ArrayLike) -> np.ndarray:
    """Return ``(1 - s) L^p + s cos^(2 q)(a / 2)``: L is Lambert's phase function, s = logistic of the second number.

    Parameters
    ----------
    shape : array_like, shape (..., 3)
        ln p, logit s, ln q.
    phase_deg : array_like, shape (n,)

    Returns
    -------
    ndarray, shape (..., n)
        1 at 0, 0 at 180 degrees.
    """
    power, share, wide = np.moveaxis(np.asarray(shape, float), -1, 0)[..., None]
    phase = checked_phase(phase_deg)
    mixed = 1.0 / (1.0 + np.exp(-share))
    # From the supplement the cosine of half the phase keeps its digits up to 180 degrees.
    cosine = np.sin(np.deg2rad(0.5 * (180.0 - phase)))
    return np.asarray((1.0 - mixed) * lambert_phase(phase) ** np.exp(power) + mixed * cosine ** (2.0 * np.exp(wide)))


def grid_phase_curve(
    phase_deg: ArrayLike, *, log10_mh: float, log10_fsed: float | None, insolation_au: ArrayLike
) -> np.ndarray:
    """Return the phase function of the grid's models, as fitted, relative to full phase.

    At 90 degrees it lies between 0.13 and 0.51 (Lambert: 0.318), for nine nodes in ten between 0.20 and 0.45; one
    curve serves all wavelengths.

    Parameters
    ----------
    phase_deg, insolation_au : array_like
        Broadcast against each other; 0 to 180 degrees; above 0 au, clamped to the grid's 0.5-5.
    log10_mh, log10_fsed
        As in `parametric_family`.

    Returns
    -------
    ndarray
        Broadcast shape.
    """
    grid = load_parametric_grid()
    phase, distance = np.broadcast_arrays(checked_phase(phase_deg), np.asarray(insolation_au, dtype=np.float64))
    nodes, weights = parametric_family(log10_mh, log10_fsed).corners(distance)
    result = np.zeros(phase.shape)
    for fsed, metal, share in _corners(grid, log10_mh, log10_fsed):
        curves = phase_curve(grid.phase[fsed, :, metal], phase.ravel()).reshape(-1, *phase.shape)
        for end in (0, 1):
            chosen = np.take_along_axis(curves, nodes[..., end][None], axis=0)[0]
            result += share * weights[..., end] * chosen
    return result


@functools.lru_cache(maxsize=64)
def _node_spectra(fsed: int, metal: int) -> np.ndarray:
    """Spectra of all insolations at one metallicity and f_sed, shape (10, n)."""
    grid = load_parametric_grid()
    metallicity = np.full(grid.insolation_au.size, grid.log10_mh[metal])
    return node_albedo(grid.parameters[fsed, :, metal], metallicity, grid.wavelength_nm, grid.methane_per_km_am)


def _corners(grid: ParametricGrid, log10_mh: float, log10_fsed: float | None) -> list[tuple[int, int, float]]:
    """Nodes (f_sed, metallicity) around a point and their weights."""
    metals = _bracket("log10_mh", grid.log10_mh, log10_mh)
    if log10_fsed is None:
        clouds = [(0, 1.0)]
    else:
        axis = np.log10(grid.fsed[1:])
        clouds = [(index + 1, weight) for index, weight in _bracket("log10_fsed", axis, min(log10_fsed, axis[-1]))]
    pairs = itertools.product(clouds, metals)
    return [(fsed, metal, a * b) for (fsed, a), (metal, b) in pairs if a * b > 0.0]


def _bracket(name: str, nodes: np.ndarray, value: float) -> list[tuple[int, float]]:
    if not (math.isfinite(value) and nodes[0] <= value <= nodes[-1]):
        raise InputError(name, value, allowed=f"{nodes[0]:g} to {nodes[-1]:.4g}")
    ends, weights = bracket(nodes, value)
    return list(zip(ends.tolist(), weights.tolist(), strict=True))


def _lorentz(wavelength_nm: np.ndarray, lines: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    return sum(
        (height / (1.0 + ((wavelength_nm - centre) / width) ** 2) for centre, width, height in lines),
        np.zeros_like(wavelength_nm),
    )


def _gauss(wavelength_nm: np.ndarray, lines: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    return sum(
        (height * np.exp(-0.5 * ((wavelength_nm - centre) / width) ** 2) for centre, width, height in lines),
        np.zeros_like(wavelength_nm),
    )
