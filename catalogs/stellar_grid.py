"""The stellar grid and its interpolation law: linear in flux over log g, [M/H] and Teff.

Because the law is linear in flux, any band integral of the interpolated spectrum equals the interpolated band
integrals of the nodes: a table of integrals, made once, serves a whole catalogue.
"""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, InputError

#: Planck constant times speed of light (exact SI values), erg A.
HC_ERG_ANGSTROM = 6.62607015e-27 * 2.99792458e18


def bracket(nodes: np.ndarray, values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the two nodes around each value and their weights.

    Parameters
    ----------
    nodes : ndarray, shape (n,)
        Increasing, at least two.
    values : array_like, shape (...)
        Finite; outside the nodes the end is taken.

    Returns
    -------
    index : ndarray of int, shape (..., 2)
    weight : ndarray, shape (..., 2)
        Non-negative, sum 1.
    """
    inside = np.clip(values, nodes[0], nodes[-1])
    left = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, nodes.size - 2)
    fraction = (inside - nodes[left]) / (nodes[left + 1] - nodes[left])
    return np.stack([left, left + 1], axis=-1), np.stack([1.0 - fraction, fraction], axis=-1)


class GridFlags(NamedTuple):
    """Marks of values that lie outside the grid and are clamped to its edge, boolean arrays of one shape."""

    teff_k: np.ndarray
    log_g: np.ndarray
    metallicity: np.ndarray

    @property
    def any(self) -> np.ndarray:
        """True where at least one of the three is clamped."""
        result: np.ndarray = self.teff_k | self.log_g | self.metallicity
        return result


@dataclass(frozen=True, eq=False)
class StellarGrid:
    """Surface fluxes ``F(T, g, m; lambda) = F_line(T, g; lambda) x ratio(T, g, m; lambda)``.

    The line structure is that of PHOENIX models at solar metallicity; the ratio gives it the broadband fluxes of the
    node. A node whose ratio is zero does not exist: CK04 has no model of so low a gravity at that temperature.

    Attributes
    ----------
    teff_k, log_g, metallicity : ndarray
        Node coordinates, increasing (K, dex of cm/s2, dex).
    wavelength_nm : ndarray, shape (n,)
        Sampling; the spectrum in PHOTLAM is linear between samples.
    line_log_g : ndarray, shape (l,)
        Gravities of the line structure, the upper end of `log_g`; nodes below take the lowest.
    log10_flam : ndarray, shape (teff, l, n)
        Line structure: surface flux at solar metallicity, log10 of erg/s/cm2/A.
    ratio_wavelength_nm : ndarray, shape (k,)
        Knots of the ratio, which is linear in log wavelength between them and constant beyond.
    ratio : ndarray, shape (teff, log g, metallicity, k)
        Flux of the node relative to its line structure.
    """

    teff_k: np.ndarray
    log_g: np.ndarray
    metallicity: np.ndarray
    wavelength_nm: np.ndarray
    line_log_g: np.ndarray
    log10_flam: np.ndarray
    ratio_wavelength_nm: np.ndarray
    ratio: np.ndarray

    @property
    def n_nodes(self) -> int:
        """Number of nodes; they are numbered with [M/H] fastest and Teff slowest."""
        return self.teff_k.size * self.log_g.size * self.metallicity.size

    @functools.cached_property
    def _lowest(self) -> np.ndarray:
        """Lowest gravity that exists at each temperature node, shape (teff,)."""
        exists = self.ratio.any(axis=-1).all(axis=-1)
        return np.asarray(self.log_g[np.argmax(exists, axis=1)])

    @functools.cached_property
    def _line(self) -> np.ndarray:
        """Index of the line structure of each node's gravity, shape (log g,)."""
        return np.asarray(np.searchsorted(self.line_log_g, np.maximum(self.log_g, self.line_log_g[0])))

    def log_g_floor(self, teff_k: ArrayLike) -> np.ndarray:
        """Return the lowest gravity between whose nodes one can interpolate at each temperature (dex).

        Raises
        ------
        InputError
            If a temperature is not finite.
        """
        (teff,) = _finite(("teff_k",), ("K",), teff_k)
        index, weight = bracket(self.teff_k, teff)
        result: np.ndarray = np.where(weight > 0.0, self._lowest[index], self.log_g[0]).max(axis=-1)
        return result

    def flags(self, teff_k: ArrayLike, log_g: ArrayLike, metallicity: ArrayLike) -> GridFlags:
        """Return which values lie outside the grid, arrays of the broadcast shape.

        Parameters
        ----------
        teff_k, log_g, metallicity : array_like
            Temperature (K), gravity (dex of cm/s2) and [M/H] (dex); they broadcast.

        Raises
        ------
        InputError
            If a value is not finite.
        """
        teff, gravity, metal = self._broadcast(teff_k, log_g, metallicity)
        return GridFlags(
            (teff < self.teff_k[0]) | (teff > self.teff_k[-1]),
            (gravity < self.log_g_floor(teff)) | (gravity > self.log_g[-1]),
            (metal < self.metallicity[0]) | (metal > self.metallicity[-1]),
        )

    def corners(self, teff_k: ArrayLike, log_g: ArrayLike, metallicity: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the eight surrounding nodes and their weights, values outside clamped to the edge.

        Trilinear over log g, [M/H] and Teff; the order of the three steps does not change the weights. A node that
        does not exist has weight 0.

        Parameters
        ----------
        teff_k, log_g, metallicity : array_like
            Temperature (K), gravity (dex of cm/s2) and [M/H] (dex); they broadcast.

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
        stars = self._broadcast(teff_k, log_g, metallicity)
        nodes, weights = _corners(self, *(values.tobytes() for values in stars))
        return nodes.reshape(*stars[0].shape, 8), weights.reshape(*stars[0].shape, 8)

    def corners_of(self, teff: np.ndarray, gravity: np.ndarray, metal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the `corners` of finite values of one shape."""
        gravity = np.maximum(gravity, self.log_g_floor(teff))
        pairs = ((self.teff_k, teff), (self.log_g, gravity), (self.metallicity, metal))
        (it, wt), (ig, wg), (im, wm) = (bracket(nodes, values) for nodes, values in pairs)
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
        row = nodes // self.metallicity.size
        model = row // self.log_g.size * self.line_log_g.size + self._line[row % self.log_g.size]
        lines, position = np.unique(model, return_inverse=True)
        result: np.ndarray = self.ratio.reshape(self.n_nodes, -1)[nodes].astype(np.float64) @ self._hats(samples)
        result *= self._line_photlam(lines, samples)[position]
        return result

    def node_integrals(self, projection: np.ndarray) -> np.ndarray:
        """Return ``projection.T @ photlam`` of every node: integrals over bands, without making the spectra.

        Parameters
        ----------
        projection : ndarray, shape (n, b)
            Weights of the wavelength samples, one column per integral.

        Returns
        -------
        ndarray, shape (n_nodes, b)
        """
        samples = np.flatnonzero(projection.any(axis=1))
        used = projection[samples]
        shape = (self.teff_k.size, self.line_log_g.size)
        photlam = self._line_photlam(np.arange(shape[0] * shape[1]), samples)
        # The ratio is a sum over knots, hence so is the integral.
        weights = self._hats(samples).T[:, :, None] * used[:, None, :]
        knots = weights.shape[1:]  # sizes are said, not found: of no samples, as of an albedo of 0, none would be
        moments = (photlam @ weights.reshape(samples.size, math.prod(knots))).reshape(*shape, *knots)
        integrals = self.ratio.astype(np.float64) @ moments[:, self._line]
        return np.asarray(integrals.reshape(self.n_nodes, used.shape[1]))

    def _line_photlam(self, models: np.ndarray, samples: np.ndarray) -> np.ndarray:
        log10_flam = self.log10_flam.reshape(-1, self.wavelength_nm.size)[np.ix_(models, samples)]
        photons: np.ndarray = 10.0 ** log10_flam.astype(np.float64)
        photons *= self.wavelength_nm[samples] * 10.0 / HC_ERG_ANGSTROM
        return photons

    def _hats(self, samples: np.ndarray) -> np.ndarray:
        """Return the weight of each knot at the samples, shape (k, samples)."""
        knots = np.log(self.ratio_wavelength_nm)
        index, weight = bracket(knots, np.log(self.wavelength_nm[samples]))
        hats = np.zeros((knots.size, samples.size))
        columns = np.arange(samples.size)
        hats[index[:, 0], columns] = weight[:, 0]
        hats[index[:, 1], columns] = weight[:, 1]
        return hats

    def _broadcast(self, *values: ArrayLike) -> tuple[np.ndarray, ...]:
        return tuple(np.broadcast_arrays(*_finite(("teff_k", "log_g", "metallicity"), ("K", "dex", "dex"), *values)))


@functools.lru_cache(maxsize=64)
def _corners(grid: StellarGrid, *stars: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the stars last asked about: every band of a question asks about the same ones."""
    found = grid.corners_of(*(np.frombuffer(values) for values in stars))
    for part in found:
        part.flags.writeable = False
    return found


def _finite(names: tuple[str, ...], units: tuple[str, ...], *values: ArrayLike) -> list[np.ndarray]:
    arrays = [np.asarray(value, dtype=np.float64) for value in values]
    for name, unit, array in zip(names, units, arrays, strict=True):
        if not np.all(np.isfinite(array)):
            bad = float(array[~np.isfinite(array)].flat[0])
            raise InputError(name, bad, unit=unit, allowed="finite numbers")
    return arrays
