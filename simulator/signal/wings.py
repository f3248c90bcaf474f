"""Light of sources off the axis: their wings, and what a subtraction leaves of those of a companion.

Everything is in units of the light of the source on the clear disc.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.imaging.metrics import PsfMetrics

FloatArray = NDArray[np.float64]
# Rms of aperture sums of the wings about their smooth course, over the latter: typical of the visible bands, and good
# to a factor of two at most single places (tests of this module, against images).
_STRUCTURE = 0.4
_STEP_ARCSEC, _N_SEPARATIONS = 0.07, 16


def wing(metrics: PsfMetrics, x: FloatArray | float, y: FloatArray | float) -> FloatArray:
    """Return the unmasked light per pixel at an offset from a source: its ring mean near the core, then the wing map.

    Parameters
    ----------
    metrics : PsfMetrics
    x, y : array_like
        Offsets from the source, arcsec; broadcast.
    """
    distance = np.hypot(x, y)
    return np.where(distance < 2.0 * metrics.wing_map_step_arcsec, metrics.wing(distance), metrics.wing_at(x, y))


def spot(metrics: PsfMetrics, offset: FloatArray, x: float, y: float) -> FloatArray:
    """Return the light per pixel of a unit source on a stamp without a mask, shape (n, n).

    Parameters
    ----------
    metrics : PsfMetrics
    offset : ndarray, shape (n,)
        Of the pixels of the stamp along an axis, arcsec.
    x, y : float
        Place of the source, arcsec.
    """
    return wing(metrics, (offset - x)[None, :], (offset - y)[:, None])


def aperture_wing(metrics: PsfMetrics, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Return the smooth light of a source's wings in whole apertures.

    Parameters
    ----------
    metrics : PsfMetrics
    x, y : array_like
        Offsets of the apertures from the source, arcsec; broadcast.
    """
    return metrics.wing_at(x, y) * metrics.aperture_pixels


def wings_variance(
    metrics: PsfMetrics,
    places: Sequence[tuple[ArrayLike, ArrayLike]],
    annulus_lambda_d: float,
    separation_arcsec: FloatArray,
) -> FloatArray:
    """Return the spatial variance of aperture sums of what the references leave of companions' light.

    Parameters
    ----------
    metrics : PsfMetrics
    places : sequence of (x, y)
        Where the ``k`` companions stand, arcsec from the star on the detector: in the science frames, and in the
        references if these show them too. None where the references show them at the same place: nothing is left.
    annulus_lambda_d : float
        Half width of the annulus whose apertures measure the scatter, lambda/D.
    separation_arcsec : ndarray
        Of the planets, ``(k or 1, ...)``.

    Returns
    -------
    ndarray
        Shape ``(k, ...)``, in units of the square of the companion's light on the clear disc. It does not average, like
        that of speckles, and is their like: the mean over whole apertures of an annulus.

    Notes
    -----
    Two rolls show the wings at two places, a reference star has none; the library of the same star shows them where the
    science frames do. With ``W`` the smooth light of the wings in an aperture and the references' ``R``, it is
    ``var(W - R) + 0.4^2 mean(W^2 + R^2)``: the course over the annulus, and the fine structure about it.
    """
    if not places:
        return np.zeros(separation_arcsec.shape)
    stood = tuple(np.asarray(part, np.float64).tobytes() for xy in places for part in xy)
    place, table = _table(metrics, annulus_lambda_d, stood)
    shape = np.broadcast_shapes((len(table), *(1,) * (separation_arcsec.ndim - 1)), separation_arcsec.shape)
    at = np.broadcast_to(np.interp(separation_arcsec, place, np.arange(place.size)), shape)
    low = np.minimum(at.astype(np.intp), place.size - 2)
    rows = np.arange(len(table)).reshape((-1,) + (1,) * (len(shape) - 1))
    return np.asarray(table[rows, low] * (low + 1 - at) + table[rows, low + 1] * (at - low))


@functools.lru_cache(maxsize=16)
def _table(metrics: PsfMetrics, annulus_lambda_d: float, stood: tuple[bytes, ...]) -> tuple[FloatArray, FloatArray]:
    """Separations of planets, and the variance there for each companion, ``(k, s)``; kept for stars that come again."""
    x, y, place, share = _apertures(metrics, annulus_lambda_d)
    there = [np.frombuffer(part)[:, None] for part in stood]
    found = [aperture_wing(metrics, x - there[i], y - there[i + 1]) for i in range(0, len(there), 2)]
    course = found[0] - found[1] if len(found) > 1 else found[0]
    variance = _mean(course**2, share) - _mean(course, share) ** 2
    table = np.maximum(variance, 0.0) + _STRUCTURE**2 * _mean(np.square(found).sum(axis=0), share)
    table.flags.writeable = False
    return place, table


def _mean(values: FloatArray, share: FloatArray) -> FloatArray:
    """Mean over apertures ``(k, p)`` with the shares ``(p, s)``, the same bytes for any number of stars."""
    return np.asarray((values[:, :, None] * share).sum(axis=1))


@functools.lru_cache(maxsize=64)
def _apertures(metrics: PsfMetrics, annulus_lambda_d: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Places x and y of whole apertures in the zone, separations, and the share of each aperture in each annulus."""
    zone, margin = metrics.zone, metrics.aperture_radius_arcsec
    low, high = zone.inner_arcsec + margin, zone.outer_arcsec - margin
    side = np.linspace(low, high, max(2, int(np.ceil((high - low) / _STEP_ARCSEC)) + 1))
    rows, columns = zone.axes(side)
    y, x = (part.ravel() for part in np.meshgrid(rows, columns, indexing="ij"))
    separation = np.hypot(x, y)
    place = np.linspace(separation.min(), separation.max(), _N_SEPARATIONS)
    away = np.abs(separation[:, None] - place)
    reach = np.maximum(annulus_lambda_d * metrics.lambda_d_arcsec, away.min(axis=0))
    share = (away <= reach).astype(np.float64)
    return x, y, place, share / share.sum(axis=0)
