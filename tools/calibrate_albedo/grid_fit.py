"""Fit of the parametric albedo to the band albedos of the public model grid, and what its errors are.

At each of the 480 nodes six band albedos stand against seven parameters, so the parameters need company: each is
drawn towards a quadratic in metallicity and ln distance through all nodes of the same f_sed (empirical Bayes: the
trend and its scatter come from the fit itself, in a few rounds). A band that is held out of every node then tests the
physics, not the flexibility.
"""

import csv
import gzip
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from cpic_core import InputError
from simulator.target.albedo import PARAMETERS, node_albedo, phase_curve

BANDS_NM = {
    "albedo_506nm": (480.0, 532.0),
    "albedo_575nm": (546.0, 604.0),
    "albedo_661nm": (628.0, 694.0),
    "albedo_721nm": (703.0, 739.0),
    "albedo_883nm": (860.0, 906.0),
    "albedo_940nm": (910.0, 970.0),
}
"""Columns of the table and the bands they are integrals over, nm."""

_STEP_NM = 4.0
_ABSOLUTE_ERROR, _RELATIVE_ERROR = 0.01, 0.03
# Start and width of the prior of each parameter, before the trends are known (A).
_PRIOR = np.array([-5.0, 0.0, 1.0, 0.0, -3.0, -1.0, -5.0])
_SPREAD = np.array([3.0, 0.7, 2.0, 1.0, 2.0, 1.5, 0.7])
# Methane follows the metallicity and the haze is thin everywhere: no trend is learned for these two.
_WITH_TREND = tuple(i for i, name in enumerate(PARAMETERS) if name not in ("ln_methane_factor", "ln_haze"))
_LEAST_SPREAD = 0.3
_RIDGE = 0.5
_ROUNDS = 4
_FIRST_STEPS, _LATER_STEPS = 40, 25
_LARGEST_STEP = 1.5
_DIFFERENCE = 1e-4


@dataclass(frozen=True, eq=False)
class Measured:
    """The table: axes and band albedos at all phases.

    Attributes
    ----------
    fsed, insolation_au, log10_mh, phase_deg : ndarray
        Axes.
    albedo : ndarray, shape (fsed, insolation, metallicity, phase, band)
        Phase included.
    """

    fsed: np.ndarray
    insolation_au: np.ndarray
    log10_mh: np.ndarray
    phase_deg: np.ndarray
    albedo: np.ndarray

    @property
    def full_phase(self) -> np.ndarray:
        """Geometric albedos, shape (fsed, insolation, metallicity, band)."""
        return self.albedo[:, :, :, 0]

    def nearest_insolations(self, insolation_au: float, number: int) -> "Measured":
        """Return the table of the few distances nearest to one."""
        keep = np.sort(np.argsort(np.abs(np.log(self.insolation_au / insolation_au)))[:number])
        return Measured(self.fsed, self.insolation_au[keep], self.log10_mh, self.phase_deg, self.albedo[:, keep])


def read_table(path: str | Path) -> Measured:
    """Read the table (csv, gzipped or not) of band albedos.

    Raises
    ------
    InputError
        If a column is missing or the rows are not a full grid.
    """
    opener = gzip.open if str(path).endswith(".gz") else open
    with opener(path, "rt", encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    axes = ("fsed", "distance_au", "log10_mh", "phase_deg")
    missing = [name for name in (*axes, *BANDS_NM) if not rows or name not in rows[0]]
    if missing:
        raise InputError("table", str(path), allowed=f"a csv with the columns {', '.join(missing)} too")
    columns = {name: np.array([float(row[name]) for row in rows]) for name in (*axes, *BANDS_NM)}
    nodes, places = zip(*(np.unique(columns[name], return_inverse=True) for name in axes), strict=True)
    shape = tuple(axis.size for axis in nodes)
    albedo = np.full((*shape, len(BANDS_NM)), np.nan)
    albedo[places] = np.stack([columns[name] for name in BANDS_NM], axis=-1)
    if len(rows) != int(np.prod(shape)) or not np.isfinite(albedo).all():
        raise InputError("table", f"{len(rows)} rows", allowed=f"a full grid of {int(np.prod(shape))}")
    fsed, distance, metal, phase = nodes
    return Measured(fsed, distance, metal, phase, albedo)


def band_albedo(
    parameters: np.ndarray, log10_mh: np.ndarray, wavelength_nm: np.ndarray, methane_per_km_am: np.ndarray
) -> np.ndarray:
    """Return the mean albedo over each band, shape (n, 6).

    Parameters
    ----------
    parameters : ndarray, shape (n, 7)
        Parameters of `simulator.target.albedo.node_albedo`.
    log10_mh : ndarray, shape (n,)
        Metallicity of each.
    wavelength_nm, methane_per_km_am : ndarray
        Absorption of methane, 1/(km amagat).
    """
    samples = [np.arange(low + 0.5 * _STEP_NM, high, _STEP_NM) for low, high in BANDS_NM.values()]
    places = np.concatenate(samples)
    spectra = node_albedo(parameters, log10_mh, places, np.interp(places, wavelength_nm, methane_per_km_am))
    starts = np.cumsum([0, *(part.size for part in samples[:-1])])
    return np.asarray(np.add.reduceat(spectra, starts, axis=-1) / [part.size for part in samples])


def fit_parameters(
    measured: Measured, wavelength_nm: np.ndarray, methane_per_km_am: np.ndarray, *, without: str | None = None
) -> np.ndarray:
    """Return the parameters of every node.

    Parameters
    ----------
    measured : Measured
    wavelength_nm, methane_per_km_am : ndarray, shape (n,)
    without : str, optional
        A column of `BANDS_NM` to hold out of the fit.

    Returns
    -------
    ndarray, shape (fsed, insolation, metallicity, 7)
    """
    target = measured.full_phase.reshape(-1, len(BANDS_NM))
    fsed, distance, metal = (
        axis.ravel() for axis in np.meshgrid(measured.fsed, measured.insolation_au, measured.log10_mh, indexing="ij")
    )
    used = np.array([name != without for name in BANDS_NM])
    weight = used / (_ABSOLUTE_ERROR + _RELATIVE_ERROR * target)
    x, y = metal, np.log(distance)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)

    def bands(parameters: np.ndarray) -> np.ndarray:
        return band_albedo(parameters, metal, wavelength_nm, methane_per_km_am)

    centre, spread = np.tile(_PRIOR, (x.size, 1)), np.tile(_SPREAD, (x.size, 1))
    found = centre.copy()
    for turn in range(_ROUNDS + 1):

        def residuals(parameters: np.ndarray, centre: np.ndarray = centre, spread: np.ndarray = spread) -> np.ndarray:
            return np.hstack([(bands(parameters) - target) * weight, (parameters - centre) / spread])

        found = _least_squares(residuals, found, _LATER_STEPS if turn else _FIRST_STEPS)
        if turn < _ROUNDS:
            centre, spread = _trends(found, fsed, terms)
    return found.reshape(measured.fsed.size, measured.insolation_au.size, measured.log10_mh.size, len(PARAMETERS))


def _trends(found: np.ndarray, fsed: np.ndarray, terms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the prior centre and width of each parameter at each node, from all nodes of its f_sed."""
    centre, spread = np.tile(_PRIOR, (len(found), 1)), np.tile(_SPREAD, (len(found), 1))
    for value in np.unique(fsed):
        rows = fsed == value
        design = terms[rows]
        normal = design.T @ design + _RIDGE * np.eye(design.shape[1])
        for i in _WITH_TREND:
            centre[rows, i] += design @ np.linalg.solve(normal, design.T @ (found[rows, i] - _PRIOR[i]))
            spread[rows, i] = np.clip(np.std(found[rows, i] - centre[rows, i]), _LEAST_SPREAD, _SPREAD[i])
    return centre, spread


def _least_squares(residuals: Callable[[np.ndarray], np.ndarray], start: np.ndarray, steps: int) -> np.ndarray:
    """Fit by Levenberg-Marquardt for all rows at once, each with its own damping."""
    found, damping = start.copy(), np.full(len(start), 1e-2)
    current = residuals(found)
    cost = np.sum(current**2, axis=1)
    identity = np.eye(start.shape[1])
    for _ in range(steps):
        slopes = np.stack([(residuals(found + _DIFFERENCE * row) - current) / _DIFFERENCE for row in identity], axis=-1)
        normal = np.einsum("nri,nrj->nij", slopes, slopes)
        gradient = np.einsum("nri,nr->ni", slopes, current)
        diagonal = np.einsum("nii->ni", normal)
        step = -np.linalg.solve(normal + (damping[:, None] * diagonal)[:, :, None] * identity, gradient[..., None])
        trial = found + np.clip(step[..., 0], -_LARGEST_STEP, _LARGEST_STEP)
        there = residuals(trial)
        better = np.sum(there**2, axis=1) < cost
        found = np.where(better[:, None], trial, found)
        current = np.where(better[:, None], there, current)
        cost = np.sum(current**2, axis=1)
        damping = np.where(better, damping / 3.0, damping * 4.0)
    return found


def fit_phase(measured: Measured) -> np.ndarray:
    """Return the phase-curve parameters of every node, shape (fsed, insolation, metallicity, 3).

    One curve per node: the mean of its six bands weighted by their albedo.
    """
    curves = measured.albedo.sum(axis=-1) / measured.full_phase.sum(axis=-1)[..., None]
    fits = [
        least_squares(lambda shape, curve=curve: phase_curve(shape, measured.phase_deg) - curve, np.full(3, 0.2)).x
        for curve in curves.reshape(-1, measured.phase_deg.size)
    ]
    return np.reshape(fits, (*curves.shape[:3], 3))
