"""Visits of the optical model: how they change the pixels of the dark hole, and what is summed around a place."""

import functools
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, IntArray, announce, compute_once, stream
from simulator.config import Instrument, content_hash
from simulator.imaging import Psf, centred_axis, metrics_key, overlap_weights, single_band_psf, visit_light

REGION_LAMBDA_D = 2.4
"""Half width of the annulus around a place whose speckles count: those of the whole hole are its inner corner's."""
N_VISITS, SEED = 1500, 101
_NEAR_LAMBDA_D, _N_APERTURES, _N_PLANETS = 1.5, 300, 48


@dataclass(frozen=True)
class OpticalBand:
    """A band that counts as equal to any other of its key."""

    instrument: Instrument = field(compare=False)
    band: str = field(compare=False)
    key: str

    @classmethod
    def of(cls, instrument: Instrument, band: str) -> Self:
        """Return the band with everything that decides its visits."""
        slope = instrument.drift.psd_slope
        parts = {
            "optics": metrics_key(instrument, band),
            "slope": slope,
            "visits": N_VISITS,
            "seed": SEED,
            "schema": 2,
        }
        return cls(instrument, band, content_hash(parts))


def visit_changes(wanted: OpticalBand) -> tuple[FloatArray, FloatArray]:
    """Return how the star's image in the dark hole changes with visits whose wavefronts are off by 1 nm.

    Returns
    -------
    linear, square : ndarray, shape (n, p)
        ``2 Re(E0* dE)`` and ``|dE|^2`` of n visits in the p pixels of the hole, in the order of the stamp, single
        precision, as part of the star's light on the clear disc: an offset of ``o`` nm changes the image by
        ``o linear + o^2 square``. Drawn once (`simulator.imaging.visit_light`) and kept in the cache.

    Raises
    ------
    InputError
        If the band has no optical model.
    """
    return _visits(wanted)


def hole_changes(psf: Psf, psd_slope: float, count: int, rng: np.random.Generator) -> tuple[FloatArray, Any, Any]:
    """Return the star in the pixels of the dark hole, and what wavefront errors of 1 nm rms change of it.

    Parameters
    ----------
    psf : Psf
    psd_slope : float
        Exponent of the power spectrum of the errors.
    count : int
        Number of errors.
    rng : numpy.random.Generator

    Returns
    -------
    static : ndarray, shape (p,)
        In the order of the stamp, as part of the star's light on the clear disc.
    linear, square : ndarray, shape (count, p)
        As of `visit_changes`, in single precision.
    """
    hole, imager = psf.geometry.hole, psf.imager
    rows, columns = (np.flatnonzero(hole.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(hole), imager.pixel_scale_arcsec)
    y, x = (imager.axis(offset[part], masked=True) for part in (rows, columns))
    light, inside = visit_light(imager, y, x, psd_slope), hole[np.ix_(rows, columns)]
    linear, square = light.changes(np.stack([light.draw(rng, 1.0)[None] for _ in range(count)]))
    return light.static[inside], linear[:, inside], square[:, inside]


@functools.lru_cache(maxsize=4)
def _visits(wanted: OpticalBand) -> tuple[FloatArray, FloatArray]:
    """Return the change of the hole's pixels by 1 nm in each visit: the part linear in the error, and its light."""

    def measured() -> dict[str, Any]:
        announce(f"drawing how {N_VISITS} visits move the speckles in {wanted.band}, once: some seconds")
        psf = single_band_psf(wanted.band, instrument=wanted.instrument)
        slope = wanted.instrument.drift.psd_slope
        _, linear, square = hole_changes(psf, slope, N_VISITS, stream(SEED, "visits"))
        return {"linear": linear, "square": square}

    return compute_once(f"visits-{wanted.key}", measured, lambda found: (found["linear"], found["square"]))


class Stamps(NamedTuple):
    """Sums and planets around a separation, as rows of the p pixels of its annulus.

    Attributes
    ----------
    inside : ndarray of bool
        Which pixels of the hole are those of the annulus.
    apertures : ndarray, shape (a, p)
        Weights of apertures within 1.5 lambda/D of the separation, the mean of them all taken off.
    own, planets : ndarray, shape (m, p)
        Weights of the apertures nearest to it, and the images of planets in their middles.
    mean : ndarray, shape (p,)
        What was taken off.
    """

    inside: BoolArray
    apertures: FloatArray
    own: FloatArray
    planets: FloatArray
    mean: FloatArray


def stamps_around(psf: Psf, separation_arcsec: float) -> Stamps:
    """Return sums and planets around a separation.

    Raises
    ------
    InputError
        If fewer than two whole apertures fit there.
    """
    geometry = psf.geometry
    region = geometry.annulus(separation_arcsec, REGION_LAMBDA_D)
    weights, planet = overlap_weights(geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec), psf.off_axis
    rows, columns = _whole(region, weights)
    if rows.size < 2:
        inner, outer = geometry.zone.inner_arcsec, geometry.zone.outer_arcsec
        allowed = f"with whole apertures inside the dark quadrants, {inner:.3g} to {outer:.3g} arcsec along an axis"
        raise InputError("separation_arcsec", separation_arcsec, unit="arcsec", allowed=allowed)
    offsets = centred_axis(len(region), geometry.pixel_scale_arcsec)
    distance = np.abs(np.hypot(offsets[rows], offsets[columns]) - separation_arcsec)
    near = np.flatnonzero(distance <= _NEAR_LAMBDA_D * geometry.lambda_d_arcsec)
    near = near if near.size > 1 else np.argsort(distance, kind="stable")[:2]
    nearest = np.argsort(distance, kind="stable")[:_N_PLANETS]

    def stamped(index: IntArray, stamp: FloatArray) -> FloatArray:
        return np.array([placed(region.shape, stamp, rows[i], columns[i])[region] for i in index])

    every = stamped(near, weights)
    chosen, mean = np.unique(np.linspace(0, len(every) - 1, _N_APERTURES).astype(int)), every.mean(axis=0)
    return Stamps(
        inside=region[geometry.hole],
        apertures=every[chosen] - mean,
        own=stamped(nearest, weights),
        planets=stamped(nearest, planet),
        mean=mean,
    )


def _whole(region: BoolArray, weights: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the rows and columns of pixels whose aperture lies wholly in a region."""
    half = len(weights) // 2
    fits = np.ones(region.shape, bool)
    padded = np.pad(region, half)
    for dy, dx in np.argwhere(weights > 0):
        fits &= padded[dy : dy + len(region), dx : dx + len(region)]
    rows, columns = np.nonzero(fits)
    return rows, columns


def placed(shape: tuple[int, int], stamp: FloatArray, row: int, column: int) -> FloatArray:
    """Return an image with the middle pixel of a stamp at a place, 0 where it does not reach.

    Parameters
    ----------
    shape : tuple of int
        Shape (y, x) of the image.
    stamp : ndarray
        Odd sides.
    row, column : int
        Place of its middle pixel, in the image.
    """
    image, half = np.zeros(shape), len(stamp) // 2
    low = [max(place - half, 0) for place in (row, column)]
    high = [min(place - half + size, side) for place, size, side in zip((row, column), stamp.shape, shape, strict=True)]
    to = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    image[to] = stamp[
        tuple(slice(s.start - p + half, s.stop - p + half) for s, p in zip(to, (row, column), strict=True))
    ]
    return image
