"""Shipped spectra: Sun, Vega, Johnson V, planet albedos, zodiacal light, and the stellar grid.

Interpolation in the grid is linear in flux over log g, [M/H] and Teff: any band integral of the interpolated spectrum
equals the interpolated band integrals of the nodes: a table of integrals, made once, serves a whole catalogue.

All arrays are read-only; each file is read once per process. Only numpy is needed.
"""

import functools
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, InputError, Record, check_finite, check_word, of_byte_planes, read_npz

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


class StellarGrid(Record, eq=False):
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
        teff = check_finite("teff_k", teff_k, "K")
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
        names = (("teff_k", "K"), ("log_g", "dex"), ("metallicity", "dex"))
        checked = (check_finite(name, value, unit) for (name, unit), value in zip(names, values, strict=True))
        return tuple(np.broadcast_arrays(*checked))


@functools.lru_cache(maxsize=64)
def _corners(grid: StellarGrid, *stars: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the stars last asked about: every band of a question asks about the same ones."""
    found = grid.corners_of(*(np.frombuffer(values) for values in stars))
    for part in found:
        part.flags.writeable = False
    return found


#: Planets with a measured albedo.
PLANETS = ("jupiter", "saturn", "uranus", "neptune")

_DATA = Path(__file__).resolve().parent / "data"


class Spectrum(Record, eq=False):
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


class Curve(Record, eq=False):
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


class Albedo(Record, eq=False):
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


class SpectralLibrary(Record, eq=False):
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


class ZodiacalLight(Record, eq=False):
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
    return {
        name: _read_only(of_byte_planes(array) if array.dtype == np.uint8 else array)
        for name, array in read_npz(_DATA / file_name).items()
    }


def _read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
