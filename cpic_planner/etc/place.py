"""Where a planet may stand in the dark hole, and the check of plain numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from catalogs.errors import InputError
from cpic_planner.etc.model import EtcModel
from simulator.config import Instrument
from simulator.imaging.hole_zone import HoleZone
from simulator.outcome import Reason, Status
from simulator.target.positions import detector_to_sky

__all__ = ["check_range", "diagonal", "diagonal_pa_deg", "hole_notes", "locate", "stand", "usable_range_arcsec"]


def diagonal(zone: HoleZone, separation_arcsec: Any) -> tuple[Any, Any]:
    """Detector offsets x and y of a point on the diagonal of one dark quadrant: the upper right one if it is dark.

    Parameters
    ----------
    zone : HoleZone
    separation_arcsec : object
        Projected separation from the star, arcsec, above 0.
    """
    offset = np.asarray(separation_arcsec, float) / math.sqrt(2.0)
    sign_x, sign_y = zone.diagonal
    return sign_x * offset, sign_y * offset


def diagonal_pa_deg(zone: HoleZone, parity: int) -> float:
    """Position angle of that diagonal at roll 0."""
    _, pa = detector_to_sky(*zone.diagonal, parity=parity)
    return float(pa)


def usable_range_arcsec(instrument: Instrument, band: str) -> tuple[float, float]:
    """Diagonal separations between which the whole photometric aperture lies in the controlled zone of a band.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    radius = instrument.aperture_radius_arcsec(band)
    inner = (instrument.hole_inner_arcsec(band) + radius) * math.sqrt(2.0)
    outer = (instrument.hole_outer_arcsec(band) - radius) * math.sqrt(2.0)
    return inner, outer


def hole_notes(model: EtcModel, band: str) -> tuple[str, ...]:
    """Flag of a band whose dark hole is not as dark as asked.

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    return ("hole_not_reached",) if model.metrics[band].hole_state == "not_reached" else ()


def locate(model: EtcModel, band: str, separation_arcsec: float) -> tuple[Status, Reason, str]:
    """Whether the aperture of a planet on the diagonal lies in the controlled zone of a band, at both rolls.

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    """
    instrument, rolls = model.instrument, model.strategy.rolls_deg
    inner, outer = usable_range_arcsec(instrument, band)
    where = "diagonal"
    if len(rolls) > 1:
        half = math.radians(rolls[1])
        # The planet stands half the roll beside the diagonal, before and after.
        near, far = math.cos(math.pi / 4 + half), math.sin(math.pi / 4 + half)
        inner = inner / math.sqrt(2.0) / near if near > 0 else math.inf
        outer = outer / math.sqrt(2.0) / far
        where = f"{rolls[1]:g} deg beside the diagonal"
    place = f"{separation_arcsec:.3f} arcsec"
    if separation_arcsec < inner * (1.0 - 1e-9):
        text = f"{place}: the aperture leaves the dark hole of {band} inside {inner:.3f} arcsec ({where})"
        return Status.OUTSIDE_FIELD, Reason.INSIDE_INNER_EDGE, text
    if separation_arcsec > outer * (1.0 + 1e-9):
        text = f"{place}: the aperture leaves the dark hole of {band} outside {outer:.3f} arcsec ({where})"
        return Status.OUTSIDE_FIELD, Reason.OUTSIDE_OUTER_EDGE, text
    if len(rolls) > 1:
        least = 2.0 * instrument.aperture_radius_arcsec(band)
        moved = 2.0 * separation_arcsec * math.sin(math.radians(rolls[1]))
        if moved < least:
            text = (
                f"{place}: a roll of {rolls[1] - rolls[0]:g} deg moves the planet by {moved:.3f} arcsec, less than its "
                f"aperture of {least:.3f}"
            )
            return Status.UNREACHABLE, Reason.SMALL_ROLL, text
    return Status.OK, Reason.NONE, ""


def stand(model: EtcModel, band: str, separation_arcsec: Any) -> tuple[Any, Any]:
    """Detector offsets of a planet: on the diagonal, or half the roll beside it for a library of two rolls.

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : object
        Projected separation from the star, arcsec, above 0.
    """
    x, y = diagonal(model.metrics[band].zone, separation_arcsec)
    rolls = model.strategy.rolls_deg
    if len(rolls) == 1:
        return x, y
    half = math.radians(rolls[1])
    return x * math.cos(half) - y * math.sin(half), x * math.sin(half) + y * math.cos(half)


def check_range(key: str, value: float, low: float, high: float, unit: str) -> float:
    """Refuse a number that is not finite or not in [low, high]."""
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float | np.floating | np.integer)
        or not math.isfinite(value)
    ):
        raise InputError(key, value, unit=unit, allowed=f"a finite number from {low:g} to {high:g}")
    if not low <= value <= high:
        raise InputError(key, value, unit=unit, allowed=f"{low:g} to {high:g}")
    return float(value)
