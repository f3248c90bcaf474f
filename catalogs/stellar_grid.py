"""The stellar grid and its interpolation law: linear in flux over log g, [M/H] and Teff.

Because the law is linear in flux, any band integral of the interpolated spectrum equals the interpolated band
integrals of the nodes: a table of integrals, made once, serves a whole catalogue.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from catalogs.errors import InputError

__all__ = ["HC_ERG_ANGSTROM", "GridFlags", "StellarGrid"]

#: Planck constant times speed of light (exact SI values), erg A.
HC_ERG_ANGSTROM = 6.62607015e-27 * 2.99792458e18


class GridFlags(NamedTuple):
    """Which values lie outside the grid and are clamped to its edge, boolean arrays of one shape."""

    teff_k: np.ndarray
    log_g: np.ndarray
    metallicity: np.ndarray

    @property
    def any(self) -> np.ndarray:
        """True where at least one of the three is clamped."""
        return self.teff_k | self.log_g | self.metallicity


@dataclass(frozen=True, eq=False)
class StellarGrid:
    """Surface fluxes ``F(T, g, m; lambda) = F_PHOENIX(T, g; lambda) x ratio_CK04(T, g, m; lambda)``.

    Attributes
    ----------
    teff_k, log_g, metallicity : ndarray
        Node coordinates, increasing (K, dex of cm/s2, dex).
    wavelength_nm : ndarray, shape (n,)
        Sampling; the spectrum in PHOTLAM is linear between samples.
    log10_flam : ndarray, shape (teff, log g, n)
        PHOENIX surface flux at solar metallicity, log10 of erg/s/cm2/A.
    ratio_wavelength_nm : ndarray, shape (k,)
        Knots of the metallicity trend, which is linear in log wavelength between them.
    ratio : ndarray, shape (teff, log g, metallicity, k)
        CK04 flux relative to solar metallicity.
    """

    teff_k: np.ndarray
    log_g: np.ndarray
    metallicity: np.ndarray
    wavelength_nm: np.ndarray
    log10_flam: np.ndarray
    ratio_wavelength_nm: np.ndarray
    ratio: np.ndarray

    @property
    def n_nodes(self) -> int:
        """Number of nodes; they are numbered with [M/H] fastest and Teff slowest."""
        return self.teff_k.size * self.log_g.size * self.metallicity.size

    def flags(self, teff_k: ArrayLike, log_g: ArrayLike, metallicity: ArrayLike) -> GridFlags:
        """Return which values lie outside the grid, arrays of the broadcast shape.

        Raises
        ------
        InputError
            If a value is not finite.
        """
        axes = self._broadcast(teff_k, log_g, metallicity)
        nodes = (self.teff_k, self.log_g, self.metallicity)
        outside = [(x < grid[0]) | (x > grid[-1]) for x, grid in zip(axes, nodes, strict=True)]
        return GridFlags(*outside)

    def corners(self, teff_k: ArrayLike, log_g: ArrayLike, metallicity: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the eight surrounding nodes and their weights, values outside clamped to the edge.

        Trilinear over log g, [M/H] and Teff; the order of the three steps does not change the weights.

        Returns
        -------
        nodes : ndarray of int, shape (..., 8)
            Node numbers.
        weights : ndarray, shape (..., 8)
            Non-negative, sum 1.

        Raises
        ------
        InputError
            If a value is not finite.
        """
        teff, gravity, metal = self._broadcast(teff_k, log_g, metallicity)
        (it, wt), (ig, wg), (im, wm) = (
            _bracket(self.teff_k, teff),
            _bracket(self.log_g, gravity),
            _bracket(self.metallicity, metal),
        )
        row = it[..., :, None, None] * self.log_g.size + ig[..., None, :, None]
        nodes = row * self.metallicity.size + im[..., None, None, :]
        weights = wt[..., :, None, None] * wg[..., None, :, None] * wm[..., None, None, :]
        return nodes.reshape(*teff.shape, 8), weights.reshape(*teff.shape, 8)

    def node_photlam(self, nodes: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Return surface photon fluxes (ph/s/cm2/A) of the given nodes at the given wavelength samples.

        Parameters
        ----------
        nodes, samples : ndarray of int, shapes (a,) and (b,)
            Node numbers and indices into ``wavelength_nm``.

        Returns
        -------
        ndarray, shape (a, b)
        """
        models, position = np.unique(nodes // self.metallicity.size, return_inverse=True)
        log10_flam = self.log10_flam.reshape(-1, self.wavelength_nm.size)[np.ix_(models, samples)]
        wavelength_nm = self.wavelength_nm[samples]
        photlam = 10.0 ** log10_flam.astype(np.float64) * (wavelength_nm * 10.0 / HC_ERG_ANGSTROM)
        knots = np.log(self.ratio_wavelength_nm)
        index, weight = _bracket(knots, np.log(wavelength_nm))
        hats = np.zeros((knots.size, samples.size))
        columns = np.arange(samples.size)
        hats[index[:, 0], columns] = weight[:, 0]
        hats[index[:, 1], columns] = weight[:, 1]
        result = self.ratio.reshape(-1, knots.size)[nodes].astype(np.float64) @ hats
        result *= photlam[position]
        return result

    def _broadcast(self, *values: ArrayLike) -> tuple[np.ndarray, ...]:
        arrays = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in values))
        for name, unit, array in zip(("teff_k", "log_g", "metallicity"), ("K", "dex", "dex"), arrays, strict=True):
            if not np.all(np.isfinite(array)):
                bad = float(array[~np.isfinite(array)].flat[0])
                raise InputError(name, bad, unit=unit, allowed="finite numbers")
        return tuple(arrays)


def _bracket(nodes: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two nodes around each value and their weights, shape (..., 2); clamped outside."""
    inside = np.clip(values, nodes[0], nodes[-1])
    left = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, nodes.size - 2)
    fraction = (inside - nodes[left]) / (nodes[left + 1] - nodes[left])
    return np.stack([left, left + 1], axis=-1), np.stack([1.0 - fraction, fraction], axis=-1)
