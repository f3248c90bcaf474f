"""Detected photon rates in bands: one quadrature for stars, planets and sky, exact for what is linear between samples.

The product of photon flux, filter curve and albedo is at most cubic between neighbouring samples, so two Gauss points
a segment integrate it exactly. Stellar rates come from a table of band integrals at the nodes of the stellar grid,
which is interpolated linearly in flux: the interpolated integrals are those of the interpolated spectrum, to rounding.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import catalogs
from catalogs import HC_ERG_ANGSTROM, Albedo, Band, Spectrum, StellarGrid, load_johnson_v, load_reference_spectrum
from cpic_core import ArrayLike, InputError, Record, check_finite, check_number, numeric_context
from simulator.knobs import AlbedoFamily

if TYPE_CHECKING:
    from simulator.config import BandConfig, Instrument


_ANGSTROM_PER_NM = 10.0
_W_M2_UM = 10.0
"""Of an erg/s/cm2/A."""
_GAUSS = 1.0 / np.sqrt(3.0)


def _union(*samples_nm: np.ndarray) -> np.ndarray:
    """Return the wavelengths of all samples, each once: `numpy.unique` would load what masked arrays need."""
    every = np.sort(np.concatenate(samples_nm))
    return np.asarray(every[np.diff(every, prepend=-np.inf) > 0.0])


def band_quadrature(band: Band, *samples_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (nm) and weights (A x transmission) of the band, two Gauss points between all samples."""
    low, high = band.support_nm
    tables = samples_nm if band.curve is None else (*samples_nm, band.curve.wavelength_nm)
    inside = np.concatenate([table[(table > low) & (table < high)] for table in tables])
    breaks = _union(np.array([low, high]), inside)
    half = 0.5 * np.diff(breaks)
    middle = breaks[:-1] + half
    nodes = np.concatenate([middle - _GAUSS * half, middle + _GAUSS * half])
    return nodes, np.tile(half * _ANGSTROM_PER_NM, 2) * band.transmission(nodes)


def band_projection(
    band: Band, samples_nm: np.ndarray, albedo: tuple[np.ndarray, np.ndarray] | None = None
) -> np.ndarray:
    """Return weights ``w`` with ``w @ photlam`` = integral of photlam x band (x albedo) over wavelength in A.

    Parameters
    ----------
    band : Band
        The band.
    samples_nm : ndarray, shape (n,)
        Wavelengths at which the photon spectrum is sampled.
    albedo : (ndarray, ndarray), optional
        Wavelengths (nm) and values of a factor that is linear between its own samples.

    Returns
    -------
    ndarray, shape (n,)
    """
    check_covers("spectrum", samples_nm, band)
    if albedo is None:
        return _on_samples(samples_nm, *band_quadrature(band, samples_nm))
    check_covers("albedo", albedo[0], band)
    x, weight = band_quadrature(band, samples_nm, albedo[0])
    return _on_samples(samples_nm, x, weight * np.interp(x, *albedo))


def v_projection(samples_nm: np.ndarray) -> np.ndarray:
    """Return weights ``w`` with ``w @ photlam`` = V-weighted photon rate, ph/s/cm2.

    The rule is synphot's, the trapezoid on the union of the samples of spectrum and filter, so that
    magnitudes agree with it to rounding; it differs from the exact integral by a few 1e-6 for stars.
    """
    curve = load_johnson_v()
    check_covers("spectrum", samples_nm, _johnson_v_band())
    inside = samples_nm[(samples_nm > curve.wavelength_nm[0]) & (samples_nm < curve.wavelength_nm[-1])]
    x = _union(inside, curve.wavelength_nm)
    width = np.zeros_like(x)
    width[1:] += 0.5 * np.diff(x)
    width[:-1] += 0.5 * np.diff(x)
    weight = width * _ANGSTROM_PER_NM * np.interp(x, curve.wavelength_nm, curve.transmission)
    return _on_samples(samples_nm, x, weight)


def _on_samples(samples_nm: np.ndarray, x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return what the weights at `x` mean for a function that is linear between its samples."""
    right = np.clip(np.searchsorted(samples_nm, x), 1, samples_nm.size - 1)
    fraction = (x - samples_nm[right - 1]) / (samples_nm[right] - samples_nm[right - 1])
    size = samples_nm.size
    upper = np.bincount(right, weights=weight * fraction, minlength=size)
    return upper + np.bincount(right - 1, weights=weight * (1.0 - fraction), minlength=size)


def band_integral(band: Band, wavelength_nm: np.ndarray, photlam: np.ndarray) -> float:
    """Return the integral of photlam x band over wavelength in A: detected electrons, e-/s/cm2.

    Parameters
    ----------
    band : Band
        Name of a band of the instrument, such as ``F520``.
    wavelength_nm : ndarray
        Wavelength, nm, above 0.
    photlam : ndarray
        Photon flux density, photons/s/cm2/Angstrom, at the samples.
    """
    return float(band_projection(band, wavelength_nm) @ photlam)


def band_flux_density(band: Band, spectrum: Spectrum) -> tuple[float, float]:
    """Return the mean flux density in a band, W/m2/um, and its effective wavelength, nm.

    Parameters
    ----------
    band : Band
    spectrum : Spectrum
        Photon flux density ``n``, ph/s/cm2/A, over wavelength; it covers the band.

    Notes
    -----
    Photons are counted: ``F = h c int(n T dlambda) / int(lambda T dlambda)`` and ``int(lambda n T) / int(n T)``, with
    ``T`` the throughput of filter, optics and detector (Bessell & Murphy 2012, PASP 124, 140, equations A11 and A21;
    what synphot calls effstim and effective wavelength). A source that sends ``k`` times the electrons of another has
    ``k`` times its ``F`` if ``T`` alone weighs both.
    """
    check_covers("spectrum", spectrum.wavelength_nm, band)
    x, weight = band_quadrature(band, spectrum.wavelength_nm)
    photons = weight * np.interp(x, spectrum.wavelength_nm, spectrum.photlam)
    erg_cm2_s_angstrom = HC_ERG_ANGSTROM * photons.sum() / (weight @ (x * _ANGSTROM_PER_NM))
    return float(erg_cm2_s_angstrom * _W_M2_UM), float(photons @ x / photons.sum())


@functools.cache
def _johnson_v_band() -> Band:
    curve = load_johnson_v()
    low, high = float(curve.wavelength_nm[0]), float(curve.wavelength_nm[-1])
    return Band("V", "VIS", 0.5 * (low + high), high - low, 1.0, 1.0, curve)


def v_photon_rate(wavelength_nm: np.ndarray, photlam: np.ndarray) -> float:
    """Return the V-weighted photon rate of a spectrum, ph/s/cm2.

    Divided by `vega_v_photon_rate` it is 10^(-0.4 V).

    Parameters
    ----------
    wavelength_nm : ndarray
        Wavelength, nm, above 0.
    photlam : ndarray
        Photon flux density, photons/s/cm2/Angstrom, at the samples.

    Raises
    ------
    InputError
        If the spectrum does not cover 470-700 nm.
    """
    wavelength, flux = check_table("spectrum", wavelength_nm, photlam)
    return float(v_projection(wavelength) @ flux)


@functools.cache
def vega_v_photon_rate() -> float:
    """Return the V-weighted photon rate of Vega, ph/s/cm2: the zero point, V = 0."""
    vega = load_reference_spectrum("vega")
    return v_photon_rate(vega.wavelength_nm, vega.photlam)


def check_covers(what: str, wavelength_nm: np.ndarray, band: Band) -> None:
    """Refuse a table that does not reach over the whole band.

    Parameters
    ----------
    what : str
        Name that a refusal gives.
    wavelength_nm : ndarray
        Wavelength, nm, above 0.
    band : Band
        Name of a band of the instrument, such as ``F520``.
    """
    low, high = band.support_nm
    if wavelength_nm[0] > low or wavelength_nm[-1] < high:
        span = f"{wavelength_nm[0]:g}-{wavelength_nm[-1]:g}"
        raise InputError(f"{what} range", span, unit="nm", allowed=f"all of band {band.name}, {low:g}-{high:g} nm")


def check_table(what: str, wavelength_nm: ArrayLike, values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return two float64 columns; refuse unequal shapes, unsorted wavelengths, bad values.

    Parameters
    ----------
    what : str
        Name that a refusal gives.
    wavelength_nm : array_like
        Wavelength, nm, above 0.
    values : array_like
        Values at the samples, shape (n,).
    """
    wavelength, column = np.asarray(wavelength_nm, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if wavelength.ndim != 1 or wavelength.shape != column.shape or wavelength.size < 2:
        raise InputError(what, f"shapes {wavelength.shape}, {column.shape}", allowed="two equal columns of >= 2 rows")
    if not np.all(np.diff(wavelength) > 0.0):
        raise InputError(f"{what} wavelength", "not increasing", unit="nm", allowed="strictly increasing")
    if not (np.all(np.isfinite(column)) and column.min() >= 0.0):
        raise InputError(f"{what} values", float(column.min()), allowed="finite, not negative")
    return wavelength, column


def gauss_rule(points: np.ndarray, masses: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss rule of a discrete measure: recurrence by Stieltjes, nodes and weights by Golub & Welsch (1969).

    Parameters
    ----------
    points, masses : ndarray, shape (m,)
        The measure; masses >= 0, at least ``n`` of them above 0.
    n : int
        Nodes.

    Returns
    -------
    nodes, weights : ndarray, shape (n,)
        Nodes ascending within the measure; weights above 0, summing to 1. Polynomials up to degree ``2 n - 1`` are
        integrated exactly.
    """
    middle = 0.5 * (float(points.max()) + float(points.min()))
    scale = 0.5 * (float(points.max()) - float(points.min())) or 1.0
    t = (points - middle) / scale
    before, now, norm, beta = np.zeros(t.size), np.ones(t.size), float(masses.sum()), 0.0
    diagonal, off_diagonal = np.zeros(n), np.zeros(n - 1)
    for k in range(n):
        diagonal[k] = float(masses @ (t * now**2)) / norm
        before, now = now, (t - diagonal[k]) * now - beta * before
        if k < n - 1:
            norm, previous = float(masses @ now**2), norm
            beta = norm / previous
            off_diagonal[k] = np.sqrt(beta)
    nodes, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(off_diagonal, 1) + np.diag(off_diagonal, -1))
    return middle + scale * nodes, vectors[0] ** 2


_TOLERANCE = 1.5e-6
"""Largest error of the straight line between two samples, relative to the mean of the product there."""


def product_samples(
    x1: np.ndarray, y1: np.ndarray, x2: np.ndarray, y2: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample the product of two functions that are linear between their samples.

    Between two neighbours of the union of both samplings the product is a parabola. Each such segment is divided until
    a straight line is within 1.5e-6 of it, so that integrals, which see two thirds of that, are right to 1e-6.

    Parameters
    ----------
    x1, y1, x2, y2 : ndarray
        Increasing positions and values, none negative.

    Returns
    -------
    x, first, second : ndarray, shape (n,)
        Positions within the common range, and both functions there.
    """
    low, high = max(x1[0], x2[0]), min(x1[-1], x2[-1])
    union = _union(x1, x2)
    union = _union(np.array([low, high]), union[(union > low) & (union < high)])
    product = np.interp(union, x1, y1) * np.interp(union, x2, y2)
    middle = 0.5 * (union[1:] + union[:-1])
    there = np.interp(middle, x1, y1) * np.interp(middle, x2, y2)
    ends = 0.5 * (product[1:] + product[:-1])
    bend, mean = np.abs(there - ends), (ends + 2.0 * there) / 3.0
    # Both factors are nowhere negative, so a mean of 0 means no bend; the bend is never above 1.5 times the mean.
    relative = np.divide(bend, mean, out=np.zeros_like(bend), where=mean > 0.0)
    pieces = np.maximum(np.ceil(np.sqrt(relative / _TOLERANCE)), 1.0).astype(np.int64)
    position = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    x = np.append(np.repeat(union[:-1], pieces) + position * np.repeat(np.diff(union) / pieces, pieces), high)
    return x, np.interp(x, x1, y1), np.interp(x, x2, y2)


_MAGNITUDES = (-30.0, 60.0)
_MOST_CM2 = 1e12
_CENTER_TOLERANCE = 0.2
"""Largest distance between the centre of a band and that of its curve, of the width."""
_WIDTH_TOLERANCE = 1.25
"""Largest ratio of the width of a band and that of its curve, area over peak."""


class Passbands(Record, eq=False):
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
        scale = area * vega_v_photon_rate() * 10.0 ** (-0.4 * magnitude) / v_photons
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
        wavelength, flux = check_table("spectrum", wavelength_nm, photlam)
        area = _area(area_cm2)
        return area * np.array([band_integral(band, wavelength, flux) for band in self.bands])

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
            wavelength, flux = check_table("spectrum", spectrum.wavelength_nm, spectrum.photlam)
            check_covers("spectrum", wavelength, band)
            samples.append(wavelength)
        x, measure = band_quadrature(band, *samples)
        if spectrum is not None:
            measure = measure * np.interp(x, wavelength, flux)
        return gauss_rule(x, measure, n)


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
    table = _node_table(grid, [v_projection(samples), *(band_projection(band, samples) for band in bands)])
    node_rates, node_v = np.ascontiguousarray(table[:, 1:]), np.ascontiguousarray(table[:, 0])
    sun_at_v0 = vega_v_photon_rate() / v_photon_rate(sun.wavelength_nm, sun.photlam)
    sun_rates = sun_at_v0 * np.array([band_integral(band, sun.wavelength_nm, sun.photlam) for band in bands])
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
    tables = [check_table("albedo", albedo.wavelength_nm, row) for row in rows]
    bands = [band for band in passbands.bands if only is None or band.name == only]
    samples = passbands.grid.wavelength_nm
    columns = [band_projection(band, samples, table) for table in tables for band in bands]
    return _node_table(passbands.grid, columns).reshape(-1, len(tables), len(bands))


def _node_table(grid: StellarGrid, columns: list[np.ndarray]) -> np.ndarray:
    return grid.node_integrals(np.column_stack(columns))
