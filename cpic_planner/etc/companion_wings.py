"""Light of companions that the subtraction of the references leaves, because their wings lie elsewhere there."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.model import EtcModel
from cpic_planner.targets import Targets
from simulator.imaging.metrics import PsfMetrics
from simulator.target.positions import sky_to_detector

__all__ = ["wings_variance"]

FloatArray = NDArray[np.float64]
# Rms of aperture sums of the wings about their smooth course, over the latter: typical of the visible bands, and good
# to a factor of two at most single places (tests of this module, against images).
_STRUCTURE = 0.4
_STEP_ARCSEC, _N_SEPARATIONS = 0.07, 16


def wings_variance(model: EtcModel, band: str, companions: Targets, separation_arcsec: FloatArray) -> FloatArray:
    """Spatial variance of aperture sums of what the references leave of a companion's light.

    Parameters
    ----------
    model : EtcModel
        Its library says where the wings lie in the references.
    band : str
    companions : Targets
        Stars whose companions are known, ``k`` of them.
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
    shape = np.broadcast_shapes((len(companions), *(1,) * (separation_arcsec.ndim - 1)), separation_arcsec.shape)
    strategy = model.strategy
    rolls = strategy.reference_library.wings_deg(strategy)
    if not rolls:
        return np.zeros(shape)
    places = tuple(
        np.asarray(part, np.float64).tobytes()
        for part in (companions.companion_separation_arcsec, companions.companion_pa_deg)
    )
    place, table = _table(
        model.metrics[band], rolls, strategy.annulus_lambda_d, model.instrument.detector.parity, *places
    )
    at = np.broadcast_to(np.interp(separation_arcsec, place, np.arange(place.size)), shape)
    low = np.minimum(at.astype(np.intp), place.size - 2)
    rows = np.arange(len(companions)).reshape((-1,) + (1,) * (len(shape) - 1))
    return np.asarray(table[rows, low] * (low + 1 - at) + table[rows, low + 1] * (at - low))


@functools.lru_cache(maxsize=16)
def _table(
    metrics: PsfMetrics,
    rolls_deg: tuple[float, ...],
    annulus_lambda_d: float,
    parity: int,
    separation_arcsec: bytes,
    pa_deg: bytes,
) -> tuple[FloatArray, FloatArray]:
    """Separations of planets, and the variance there for each companion, ``(k, s)``; kept for stars that come again."""
    x, y, place, share = _apertures(metrics, annulus_lambda_d)
    found = []
    for roll in rolls_deg:
        there = sky_to_detector(np.frombuffer(separation_arcsec), np.frombuffer(pa_deg), roll_deg=roll, parity=parity)
        found.append(metrics.wing_at(x - there[0][:, None], y - there[1][:, None]) * metrics.aperture_pixels)
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
