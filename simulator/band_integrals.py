"""Integrals over a band, exact for functions that are linear between their samples.

The product of photon flux, filter curve and albedo is at most cubic between neighbouring samples, so two
Gauss points per segment integrate it exactly.

Sampling of a product of two sampled functions, so that it may again be taken as linear between its samples.
"""

import functools

import numpy as np

from catalogs import Band, load_johnson_v, load_reference_spectrum
from cpic_core import ArrayLike, InputError

_ANGSTROM_PER_NM = 10.0
_GAUSS = 1.0 / np.sqrt(3.0)


def band_quadrature(band: Band, *samples_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (nm) and weights (A x transmission) of the band, two Gauss points between all samples."""
    low, high = band.support_nm
    tables = samples_nm if band.curve is None else (*samples_nm, band.curve.wavelength_nm)
    inside = np.concatenate([table[(table > low) & (table < high)] for table in tables])
    breaks = np.unique(np.concatenate([[low, high], inside]))
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
    x = np.unique(np.concatenate([inside, curve.wavelength_nm]))
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
    union = np.union1d(x1, x2)
    union = np.unique(np.concatenate([[low, high], union[(union > low) & (union < high)]]))
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
