"""Band rates of stars, planets and sky: the one quadrature that ETC and images share.

All rates are detected photo-electrons per second before any PSF: photons of the spectrum x area x ``t_opt``
x filter x QE. Apodizer, Strehl, mask and aperture are not in them.

Stellar rates come from a table of band integrals at the nodes of the stellar grid. The grid is interpolated
linearly in flux, hence the interpolated integrals equal the integrals of the interpolated spectrum, to
rounding.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import catalogs
from catalogs import Albedo, Band, Spectrum, StellarGrid
from cpic_core import ArrayLike, InputError, check_finite, check_number, numeric_context
from simulator import band_integrals as integrals
from simulator.knobs import AlbedoFamily

if TYPE_CHECKING:
    from simulator.config import BandConfig, Instrument


_MAGNITUDES = (-30.0, 60.0)
_MOST_CM2 = 1e12
_CENTER_TOLERANCE = 0.2
"""Largest distance between the centre of a band and that of its curve, of the width."""
_WIDTH_TOLERANCE = 1.25
"""Largest ratio of the width of a band and that of its curve, area over peak."""


@dataclass(frozen=True, eq=False)
class Passbands:
    """The bands with their band integrals; made by `from_bands` or `from_instrument`.

    Attributes
    ----------
    bands : tuple of Band
        The bands, in the order of the last axis of every result.
    grid : StellarGrid
        The stellar grid.
    node_rates : ndarray, shape (node, band)
        Detected rate of each grid node per area of stellar surface, e-/s/cm2.
    node_v : ndarray, shape (node,)
        V-weighted photon rate of each grid node, ph/s/cm2 of stellar surface.
    sun_rates : ndarray, shape (band,)
        e-/s/cm2 of the solar spectrum scaled to V = 0.
    """

    bands: tuple[Band, ...]
    grid: StellarGrid
    node_rates: np.ndarray
    node_v: np.ndarray
    sun_rates: np.ndarray

    @classmethod
    def from_bands(cls, bands: Mapping[str, Band] | Iterable[Band] | None = None) -> Passbands:
        """Integrate the stellar grid over the bands; equal bands give the same object again.

        Parameters
        ----------
        bands : mapping or iterable of Band, optional
            The bands; default: the eight shipped ones.

        Raises
        ------
        InputError
            If there is no band, a name occurs twice, or a band reaches beyond the stellar grid (300-1750 nm).
        """
        chosen = catalogs.load_bands() if bands is None else bands
        return _integrate(tuple(chosen.values() if isinstance(chosen, Mapping) else chosen))

    @classmethod
    def from_instrument(cls, instrument: Instrument) -> Passbands:
        """Return the passbands of an instrument configuration; see `from_bands`."""
        return cls.from_bands(_band(name, config) for name, config in instrument.bands.items())

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Band names in order."""
        return tuple(band.name for band in self.bands)

    def index(self, name: str) -> int:
        """Return the position of a band.

        Raises
        ------
        InputError
            If there is no such band.
        """
        if name not in self.names:
            raise InputError("band", name, allowed=", ".join(self.names))
        return self.names.index(name)

    def star_rate_e_s(
        self, v_mag: ArrayLike, teff_k: ArrayLike, log_g: ArrayLike, metallicity: ArrayLike, area_cm2: float
    ) -> np.ndarray:
        """Return the detected rate of stars, e-/s, before any PSF.

        Parameters
        ----------
        v_mag : array_like
            Johnson V magnitude (Vega).
        teff_k, log_g, metallicity : array_like
            Stellar parameters (K, dex of cm/s2, dex); clamped to the grid, see `grid_flags`.
        area_cm2 : float
            Collecting area.

        Returns
        -------
        ndarray, shape (..., band)
            The leading shape is that of the broadcast inputs.

        Raises
        ------
        InputError
            If an input is not finite, the magnitude not between -30 and 60 or the area not between 0 and 1e12.
        """
        magnitude = _magnitude("v_mag", v_mag, "mag")
        area = _area(area_cm2)
        nodes, weights = self.grid.corners(teff_k, log_g, metallicity)
        electrons = np.einsum("...k,...kb->...b", weights, self.node_rates[nodes])
        v_photons = np.einsum("...k,...k->...", weights, self.node_v[nodes])
        scale = area * integrals.vega_v_photon_rate() * 10.0 ** (-0.4 * magnitude) / v_photons
        result: np.ndarray = scale[..., None] * electrons
        return result

    def grid_flags(self, teff_k: ArrayLike, log_g: ArrayLike, metallicity: ArrayLike) -> catalogs.GridFlags:
        """Return which parameters lie outside the stellar grid and are clamped; ``.any`` joins the three.

        Parameters
        ----------
        teff_k : array_like
            Effective temperature, K.
        log_g : array_like
            Logarithm of the surface gravity in cm/s^2.
        metallicity : array_like
            Metallicity [M/H], dex.
        """
        return self.grid.flags(teff_k, log_g, metallicity)

    @numeric_context()
    def spectrum_rate_e_s(self, wavelength_nm: ArrayLike, photlam: ArrayLike, area_cm2: float) -> np.ndarray:
        """Return the detected rate (e-/s, shape (band,)) of any spectrum that is linear between its samples.

        Parameters
        ----------
        wavelength_nm, photlam : array_like, shape (n,)
            Increasing wavelengths and photon flux density, ph/s/cm2/A.
        area_cm2 : float
            Collecting area.

        Raises
        ------
        InputError
            If the spectrum is malformed, negative or does not cover a band.
        """
        wavelength, flux = integrals.check_table("spectrum", wavelength_nm, photlam)
        area = _area(area_cm2)
        return area * np.array([integrals.band_integral(band, wavelength, flux) for band in self.bands])

    def sky_rate_e_s_arcsec2(self, mag_arcsec2: ArrayLike, area_cm2: float) -> np.ndarray:
        """Return the detected rate of a sky of solar colour, e-/s/arcsec2, shape (..., band).

        Parameters
        ----------
        mag_arcsec2 : array_like
            Surface brightness in Johnson V (Vega).
        area_cm2 : float
            Collecting area.
        """
        magnitude = _magnitude("mag_arcsec2", mag_arcsec2, "mag/arcsec2")
        area = _area(area_cm2)
        result: np.ndarray = area * (10.0 ** (-0.4 * magnitude))[..., None] * self.sun_rates
        return result

    def band_albedo(
        self,
        albedo: str | Albedo | AlbedoFamily,
        teff_k: ArrayLike,
        log_g: ArrayLike,
        metallicity: ArrayLike,
        *,
        insolation_au: ArrayLike | None = None,
        only: str | None = None,
    ) -> np.ndarray:
        """Return the photon-weighted mean albedo in each band under the light of each star.

        ``integral(F A T QE dlambda) / integral(F T QE dlambda)``, exact for an albedo linear between its
        samples. The integrals over the stellar grid are made once for each albedo object.

        Parameters
        ----------
        albedo : str, Albedo or AlbedoFamily
            Name of a measured planet, a table, or albedos over insolation.
        teff_k, log_g, metallicity : array_like
            Stellar parameters.
        insolation_au : array_like, optional
            Distance from the Sun that has the planet's insolation; needed for a family only.
        only : str, optional
            The one band that is wanted; the albedo need not cover the others.

        Returns
        -------
        ndarray, shape (..., band), or (...) for one band
            The leading shape is that of the broadcast stars and insolations.

        Raises
        ------
        InputError
            If the planet is unknown, the table is malformed, negative or does not cover a band, or the insolation
            is missing.
        """
        source = catalogs.load_albedo(albedo) if isinstance(albedo, str) else albedo
        wanted = slice(None) if only is None else slice(self.index(only), self.index(only) + 1)
        nodes, weights = self.grid.corners(teff_k, log_g, metallicity)
        # Grid interpolation is linear in surface flux, so the same weights serve numerator and denominator.
        direct = np.einsum("...k,...kb->...b", weights, self.node_rates[nodes, wanted])
        reflected = np.einsum("...k,...kdb->...db", weights, _albedo_nodes(self, source, only)[nodes])
        mean = _at_insolation(reflected / direct[..., None, :], source, insolation_au)
        return mean if only is None else np.asarray(mean[..., 0])

    def albedo_flags(self, albedo: str | Albedo | AlbedoFamily) -> np.ndarray:
        """Return, per band, whether the albedo is ``extrapolated`` (its origin undocumented)."""
        table = catalogs.load_albedo(albedo) if isinstance(albedo, str) else albedo
        return np.array([band.support_nm[1] > table.documented_to_nm for band in self.bands])

    def wavelength_nodes(self, name: str, n: int, *, spectrum: Spectrum | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the Gauss rule that averages over the detected photons of a band.

        It integrates every polynomial up to degree 2n - 1 exactly against filter x QE x photon spectrum; for a
        top-hat and a flat spectrum it is Gauss-Legendre.

        Parameters
        ----------
        name : str
            Band name.
        n : int
            Number of nodes, at least 1.
        spectrum : Spectrum, optional
            Photon spectrum to weight with; default: flat.

        Returns
        -------
        wavelength_nm, weights : ndarray, shape (n,)
            Weights are positive and sum to 1.

        Raises
        ------
        InputError
            For an unknown band, n < 1, or a spectrum that does not cover the band.
        """
        if n < 1:
            raise InputError("n", n, allowed="at least 1")
        band = self.bands[self.index(name)]
        low, high = band.support_nm
        if spectrum is None and band.curve is None:
            t, gauss = np.polynomial.legendre.leggauss(n)
            return 0.5 * (low + high + (high - low) * t), 0.5 * gauss
        # Cells much finer than the polynomials: two points in each are enough.
        samples = [np.linspace(low, high, 64 * n + 1)]
        if spectrum is not None:
            wavelength, flux = integrals.check_table("spectrum", spectrum.wavelength_nm, spectrum.photlam)
            integrals.check_covers("spectrum", wavelength, band)
            samples.append(wavelength)
        x, measure = integrals.band_quadrature(band, *samples)
        if spectrum is not None:
            measure = measure * np.interp(x, wavelength, flux)
        return integrals.gauss_rule(x, measure, n)


def _magnitude(name: str, value: ArrayLike, unit: str) -> np.ndarray:
    low, high = _MAGNITUDES
    magnitude = check_finite(name, value, unit)
    bad = (magnitude < low) | (magnitude > high)
    if bad.any():
        raise InputError(name, float(magnitude[bad].flat[0]), unit=unit, allowed=f"{low:g} to {high:g}")
    return magnitude


def _area(area_cm2: float) -> float:
    if not 0.0 < check_number("area_cm2", area_cm2, "cm2") <= _MOST_CM2:
        raise InputError("area_cm2", area_cm2, unit="cm2", allowed=f"above 0, at most {_MOST_CM2:g}")
    return float(area_cm2)


def _band(name: str, config: BandConfig) -> Band:
    """Return the band of a configuration entry; a file replaces the top-hat, of which it has centre and width.

    Raises
    ------
    InputError
        If the curve of a file has another centre or width than the entry, by which optics are worked out, or reaches
        beyond the spectra.
    """
    band = Band(name, config.camera, config.center_nm, config.width_nm, config.t_opt, config.qe)
    if config.transmission_file is None:
        return band
    file = Path(config.transmission_file).name
    read = catalogs.band_from_file(config.transmission_file, name, t_opt=band.t_opt, qe=band.qe, camera=band.camera)
    first, last = catalogs.load_stellar_grid().wavelength_nm[[0, -1]]
    if not first <= read.support_nm[0] < read.support_nm[1] <= last:
        span = "{:g} to {:g}".format(*read.support_nm)
        raise InputError(f"{file} wavelengths", span, unit="nm", allowed=f"{first:g} to {last:g} nm, as spectra have")
    apart_nm, wider = abs(read.center_nm - band.center_nm), read.width_nm / band.width_nm
    if apart_nm > _CENTER_TOLERANCE * band.width_nm or not 1.0 / _WIDTH_TOLERANCE <= wider <= _WIDTH_TOLERANCE:
        given = f"{band.center_nm:g} and {band.width_nm:g}"
        own = f"{read.center_nm:.1f} and {read.width_nm:.1f} nm, those of {file}; or neither, to have them from it"
        raise InputError(f"instrument.bands.{name}.center_nm and width_nm", given, unit="nm", allowed=own)
    return replace(band, curve=read.curve)


@functools.lru_cache(maxsize=8)
@numeric_context()
def _integrate(bands: tuple[Band, ...]) -> Passbands:
    names = [band.name for band in bands]
    if not bands or len(set(names)) != len(names):
        raise InputError("bands", names, allowed="at least one band, each name once")
    grid = catalogs.load_stellar_grid()
    sun = catalogs.load_reference_spectrum("sun")
    samples = grid.wavelength_nm
    table = _node_table(
        grid, [integrals.v_projection(samples), *(integrals.band_projection(band, samples) for band in bands)]
    )
    node_rates, node_v = np.ascontiguousarray(table[:, 1:]), np.ascontiguousarray(table[:, 0])
    sun_at_v0 = integrals.vega_v_photon_rate() / integrals.v_photon_rate(sun.wavelength_nm, sun.photlam)
    sun_rates = sun_at_v0 * np.array([integrals.band_integral(band, sun.wavelength_nm, sun.photlam) for band in bands])
    for array in (node_rates, node_v, sun_rates):
        array.setflags(write=False)
    return Passbands(bands, grid, node_rates, node_v, sun_rates)


def _at_insolation(mean: np.ndarray, source: Albedo | AlbedoFamily, insolation_au: ArrayLike | None) -> np.ndarray:
    """Return band means, shape (..., band), from those of all albedos of the source, shape (..., albedo, band)."""
    if not isinstance(source, AlbedoFamily):
        return np.asarray(mean[..., 0, :])
    if insolation_au is None:
        raise InputError("insolation_au", "missing", unit="au", allowed="a value is required for this albedo")
    ends, weights = source.corners(insolation_au)
    shape = np.broadcast_shapes(mean.shape[:-2], ends.shape[:-1])
    mean = np.broadcast_to(mean, (*shape, *mean.shape[-2:]))
    two = np.take_along_axis(mean, np.broadcast_to(ends, (*shape, 2))[..., None], axis=-2)
    return np.asarray(np.einsum("...e,...eb->...b", weights, two))


@functools.lru_cache(maxsize=64)
@numeric_context()
def _albedo_nodes(passbands: Passbands, albedo: Albedo | AlbedoFamily, only: str | None) -> np.ndarray:
    """Return band integrals of stellar flux x albedo at the grid nodes, shape (node, albedo, band)."""
    rows = albedo.albedo if isinstance(albedo, AlbedoFamily) else [albedo.albedo]
    tables = [integrals.check_table("albedo", albedo.wavelength_nm, row) for row in rows]
    bands = [band for band in passbands.bands if only is None or band.name == only]
    samples = passbands.grid.wavelength_nm
    columns = [integrals.band_projection(band, samples, table) for table in tables for band in bands]
    return _node_table(passbands.grid, columns).reshape(-1, len(tables), len(bands))


def _node_table(grid: StellarGrid, columns: list[np.ndarray]) -> np.ndarray:
    return grid.node_integrals(np.column_stack(columns))
