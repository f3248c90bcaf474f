"""Light where the noise of a planet is measured: in the apertures of an annulus of the dark hole around the star.

Who measures a planet takes the scatter of apertures at its separation for its noise, and the mean of the pixels there
for its background (`cpic_planner.validation.photometry`). The light that makes this scatter is the mean over these
apertures, not that at the planet; and the background holds wings of the planet itself, which are taken off with it.

Light is in units of that of its source on the clear disc.
"""

import functools
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray, IntArray, Keyed
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.sampling import bilinear
from simulator.imaging.table_metrics import TableMetrics

STEP_PIXELS = 2.0
"""Pixels between the apertures of `noise_apertures`."""
# Apertures this many radii from a source hold no pixel of the disc around it that is left out of the background.
APART_RADII = 2.5
# Radii of that disc.
_EXCLUSION_RADII = 1.5
_N_SEPARATIONS = 16


def quadrant_of(x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> IntArray:
    """Return the number of the quadrant of a place: 0 upper right (+x, +y), 1 upper left, 2 lower right, 3 lower left.

    Parameters
    ----------
    x_arcsec, y_arcsec : array_like
        Offsets from the star on the detector.
    """
    return (np.asarray(x_arcsec) < 0).astype(np.int64) + 2 * (np.asarray(y_arcsec) < 0)


def by_geometry(metrics: PsfMetrics) -> Keyed[PsfMetrics]:
    """Return the figures of a band, equal to those of all dark holes of one geometry that share the unmasked light.

    Parameters
    ----------
    metrics : PsfMetrics
    """
    maps = (metrics.wing_map, metrics.aperture_map, metrics.column_profile)
    steps = metrics.wing_map_step_arcsec, metrics.aperture_map_step_arcsec
    # No other map has that id while this one lives.
    return Keyed((metrics.geometry, *steps, *map(id, maps)), metrics)


class Apertures(NamedTuple):
    """Apertures that measure the noise of planets on the diagonals of the quadrants.

    Attributes
    ----------
    x, y : ndarray, shape (p,)
        Their places.
    separation_arcsec : ndarray, shape (s,)
        Of the planets.
    share : ndarray, shape (p, 4, s)
        Each one's share in the noise, by the quadrant of the planet (`quadrant_of`).
    """

    x: FloatArray
    y: FloatArray
    separation_arcsec: FloatArray
    share: FloatArray


@functools.lru_cache(maxsize=64)
def noise_apertures(figures: Keyed[PsfMetrics], annulus_lambda_d: float, step_pixels: float = STEP_PIXELS) -> Apertures:
    """Return the apertures whole in the zone and in the annulus, beside the planet.

    Cells that an edge of the annulus or of a disc cuts count with the part inside.

    Parameters
    ----------
    figures : Keyed of PsfMetrics
        From `by_geometry`.
    annulus_lambda_d : float
        Half width of the annulus, lambda/D.
    step_pixels : float
        Pixels from one to the next.
    """
    metrics = figures.value
    pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
    x, y, step = metrics.zone.cells(step_pixels * pixel, radius, pixel)
    separation = np.hypot(x, y)
    planet = np.linspace(separation.min(), separation.max(), _N_SEPARATIONS)
    room = annulus_lambda_d * metrics.lambda_d_arcsec - radius - 0.5 * pixel
    away = np.abs(separation[:, None] - planet)
    inside = np.clip((np.maximum(room, away.min(axis=0)) - away) / step + 0.5, 0.0, 1.0)
    number, offset = np.arange(4)[:, None], planet / np.sqrt(2.0)
    place = (1 - 2 * (number % 2)) * offset, (1 - 2 * (number // 2)) * offset
    near = np.hypot(x[:, None, None] - place[0], y[:, None, None] - place[1])
    beside = np.clip((near - APART_RADII * radius) / step + 0.5, 0.0, 1.0) * inside[:, None, :]
    # Where nothing of the annulus is beside the planet, all of it counts.
    share = np.where(beside.any(axis=0), beside, inside[:, None, :])
    return Apertures(x, y, planet, share)


def mean_over(values: FloatArray, share: FloatArray) -> FloatArray:
    """Return the sum over apertures ``(r, p)`` with the shares ``(p, 4, s)``, the same bytes for any number of rows.

    Parameters
    ----------
    values : ndarray, shape (r, p)
    share : ndarray, shape (p, 4, s)
    """
    return np.asarray(np.einsum("rp,pqs->rqs", values, share, optimize=False))


class AnnulusLight(NamedTuple):
    """Light around planets; arrays in the shape of the planets' places.

    Attributes
    ----------
    star : ndarray
        Residual light of the star behind the coronagraph: mean over the apertures.
    errors : ndarray
        The same of the light that wavefront errors of 1 nm rms scatter there.
    planet_left : ndarray
        Part of a planet's light that is left in its aperture once the mean of the background is taken off.
    """

    star: FloatArray
    errors: FloatArray
    planet_left: FloatArray


def light_around(
    metrics: PsfMetrics,
    annulus_lambda_d: float,
    x_arcsec: ArrayLike,
    y_arcsec: ArrayLike,
    *,
    psd_slope: float,
    wavelength_nm: float,
) -> AnnulusLight:
    """Return the light in the apertures that measure the noise of planets, and what their background takes of them.

    Parameters
    ----------
    metrics : PsfMetrics
    annulus_lambda_d : float
        Half width of the annulus, lambda/D.
    x_arcsec, y_arcsec : array_like
        Places of the planets relative to the star; broadcast. Anywhere in a quadrant they have the light of planets at
        their separation on its diagonal.
    psd_slope, wavelength_nm : float
        As of `error_halo`.

    Notes
    -----
    A planet leaves ``1 - a0 mean(W) / core`` of its light, with W its light per pixel over the annulus beyond 1.5
    aperture radii of it, and a0 the pixels of its aperture: 0.98 at the inner edge of the hole to 0.99. A table of a
    coronagraph says all of it itself.
    """
    if isinstance(metrics, TableMetrics):
        return AnnulusLight(*metrics.noise_light(x_arcsec, y_arcsec))
    separation_arcsec, tables = _tables(metrics, annulus_lambda_d, psd_slope, wavelength_nm)
    x, y = np.broadcast_arrays(np.asarray(x_arcsec, float), np.asarray(y_arcsec, float))
    at = np.interp(np.hypot(x, y), separation_arcsec, np.arange(separation_arcsec.size))
    low = np.minimum(at.astype(np.intp), separation_arcsec.size - 2)
    part, quadrant = at - low, quadrant_of(x, y)
    read = (table[quadrant, low] * (1.0 - part) + table[quadrant, low + 1] * part for table in tables)
    return AnnulusLight(*read)


@functools.lru_cache(maxsize=64)
def _tables(
    metrics: PsfMetrics, annulus_lambda_d: float, psd_slope: float, wavelength_nm: float
) -> tuple[FloatArray, FloatArray]:
    """Return separations of planets on the diagonals, and the fields of `AnnulusLight` there, ``(3, 4, s)``."""
    x, y, separation_arcsec, share = noise_apertures(by_geometry(metrics), annulus_lambda_d)
    light = np.stack([metrics.halo_aperture(x, y), error_halo(metrics, x, y, psd_slope, wavelength_nm)])
    seen = mean_over(light, share) / share.sum(axis=0)
    left = _planet_left(metrics, annulus_lambda_d, separation_arcsec)
    return separation_arcsec, np.concatenate([seen, np.broadcast_to(left, (1, *seen.shape[1:]))])


def _planet_left(metrics: PsfMetrics, annulus_lambda_d: float, separation_arcsec: FloatArray) -> FloatArray:
    """Return what the mean of the background leaves of planets on a diagonal of the zone, ``(s,)``."""
    pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
    x, y, _ = metrics.zone.cells(STEP_PIXELS * pixel, 0.0, pixel)
    place = np.array(metrics.zone.diagonal)[:, None] * separation_arcsec / np.sqrt(2.0)
    core = metrics.core_throughput(*place)
    dx, dy = x - place[0][:, None], y - place[1][:, None]
    ring = np.abs(np.hypot(x, y) - separation_arcsec[:, None]) <= annulus_lambda_d * metrics.lambda_d_arcsec
    seen = ring & (np.hypot(dx, dy) > _EXCLUSION_RADII * radius)
    spread = np.where(seen, metrics.wing(np.hypot(dx, dy)), 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    return np.asarray(1.0 - metrics.aperture_pixels * spread / core)


def error_halo(
    metrics: PsfMetrics, x_arcsec: ArrayLike, y_arcsec: ArrayLike, psd_slope: float, wavelength_nm: float
) -> FloatArray:
    """Return the mean light that wavefront errors of 1 nm rms scatter into apertures of the zone.

    Parameters
    ----------
    metrics : PsfMetrics
    x_arcsec, y_arcsec : array_like
        Places relative to the star; broadcast.
    psd_slope : float
        Exponent of the power spectrum of the errors, ``f^-slope``.
    wavelength_nm : float
        Middle of the band.

    Notes
    -----
    ``<|dE|^2> = (2 pi / lambda)^2 sum_f P(f) W(theta - f lambda / D)``: a wave of the phase with random amplitudes puts
    an image of the star to either side, with half its mean square each, and waves do not interfere in the mean. W is
    the light of an unmasked source in apertures, P the spectrum of `simulator.imaging.drift` (piston and tilt are no
    part of it, which hardly reaches the zone). Up to 6 % more than the images have, whose screens are steps on the
    samples of the pupil. It grows as the square of the rms.
    """
    if isinstance(metrics, TableMetrics):
        return metrics.noise_light(x_arcsec, y_arcsec)[1]
    step, light = _error_map(metrics, psd_slope)
    x, y = np.broadcast_arrays(np.asarray(x_arcsec, float), np.asarray(y_arcsec, float))
    half = len(light) // 2
    column, row = (np.clip(part / step + half, 0.0, len(light) - 1.0) for part in (x, y))
    return np.asarray((2.0 * np.pi / wavelength_nm) ** 2 * bilinear(light, row, column))


@functools.lru_cache(maxsize=64)
def _error_map(metrics: PsfMetrics, psd_slope: float) -> tuple[float, FloatArray]:
    """Return a step in arcsec, and the spectrum convolved with the light of a source in apertures, that far apart."""
    from simulator.imaging.drift import spectrum

    frequency, power = spectrum(psd_slope)
    step, source = metrics.aperture_map_step_arcsec, metrics.aperture_map
    at = frequency * metrics.lambda_d_arcsec / step
    reach = int(np.ceil(at.max())) + 1
    # The power of each wave, divided between the nearest steps.
    nearest = np.maximum(1.0 - np.abs(at - np.arange(-reach, reach + 1)[:, None]), 0.0)
    images = nearest @ power @ nearest.T
    hole = int(np.ceil(metrics.owa_arcsec / step)) + 1
    middle, half = len(source) // 2, min(hole + reach, len(source) // 2)
    near = source[middle - half : middle + half + 1, middle - half : middle + half + 1]
    # Where all that is near is known, sums that go around meet nothing; products of small primes are quick.
    least = len(near) + (0 if half == hole + reach else len(images))
    shape = (-(-least // 16) * 16,) * 2
    light = np.fft.irfft2(np.fft.rfft2(near, shape) * np.fft.rfft2(images, shape), shape)
    seen = slice(half + reach - hole, half + reach + hole + 1)
    return step, light[seen, seen]
