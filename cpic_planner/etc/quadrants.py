"""Where a planet is put that has a separation and no position angle: the quadrant, and the place in it.

A planet stands on the diagonal of a dark quadrant, the upper right one if it is dark. Around a star whose companion
lights the hole it stands in the quadrant that holds least of that light. The noise of a measurement is that of the
whole annulus (`simulator.signal.companions`), nearly the same for all quadrants; but the scatter of the planet's own
aperture is least there.
"""

import math
from typing import Any

import numpy as np

from cpic_core import IntArray
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.rates import companions_of
from cpic_planner.targets import Targets
from simulator.signal import quadrant_of
from simulator.target import detector_to_sky

QUADRANTS = ("upper right", "upper left", "lower right", "lower left")
"""Quadrants on the detector by their number, +x to the right and +y up."""


def dark_quadrants(model: EtcModel, targets: Targets, band: str) -> IntArray:
    """Return the number of the quadrant of each star in which its planet is put, shape ``(n,)``.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars; a companion without position angle lights all quadrants alike.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    found = np.full(len(targets), quadrant_of(*model.metrics[band].zone.diagonal))
    for chosen, placed, tables in companions_of(model, targets, band):
        if placed:
            found[chosen] = np.argmin(tables.quadrants, axis=1)
    return found


def planet_offsets(model: EtcModel, targets: Targets, band: str, separation_arcsec: Any) -> tuple[Any, Any]:
    """Detector offsets of planets: on the diagonal, or half the roll beside it for a library of two rolls.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : array_like
        Projected separations from the stars, arcsec, above 0, ``(n or 1, ...)``.

    Returns
    -------
    x_arcsec, y_arcsec : ndarray
        Shape of the separations, or ``(n, ...)`` where the stars' quadrants differ.
    """
    offset, number = np.asarray(separation_arcsec, float) / math.sqrt(2.0), dark_quadrants(model, targets, band)
    same = bool(np.all(number == number[0]))
    number = number[0] if same else number.reshape((-1,) + (1,) * (offset.ndim - 1))
    x, y = np.where(number % 2, -offset, offset), np.where(number // 2, -offset, offset)
    rolls = model.strategy.rolls_deg
    if len(rolls) == 1:
        return x, y
    half = math.radians(rolls[1])
    return x * math.cos(half) - y * math.sin(half), x * math.sin(half) + y * math.cos(half)


def diagonal_pa_deg(model: EtcModel, target: Targets, band: str) -> float:
    """Position angle of the diagonal on which the planet of one star is put, at roll 0.

    Parameters
    ----------
    model : EtcModel
    target : Targets
        One star.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    (number,) = dark_quadrants(model, target, band)
    _, pa = detector_to_sky(1 - 2 * (number % 2), 1 - 2 * (number // 2), parity=model.instrument.detector.parity)
    return float(pa)
