"""Where a planet may stand in the dark hole, and the check of plain numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from catalogs.errors import InputError
from simulator.config import Instrument
from simulator.outcome import Reason, Status

__all__ = ["check_range", "diagonal", "locate", "usable_range_arcsec"]


def diagonal(separation_arcsec: Any) -> tuple[Any, Any]:
    """Detector offsets of a point on the diagonal of the upper right quadrant."""
    offset = np.asarray(separation_arcsec, float) / math.sqrt(2.0)
    return offset, offset


def usable_range_arcsec(instrument: Instrument, band: str) -> tuple[float, float]:
    """Diagonal separations between which the whole photometric aperture lies in the controlled zone of a band."""
    radius = instrument.aperture_radius_arcsec(band)
    inner = (instrument.hole_inner_arcsec(band) + radius) * math.sqrt(2.0)
    outer = (instrument.coronagraph.outer_half_side_arcsec - radius) * math.sqrt(2.0)
    return inner, outer


def locate(instrument: Instrument, band: str, separation_arcsec: float) -> tuple[Status, Reason, str]:
    """Whether the aperture of a planet at a diagonal separation lies in the controlled zone of a band."""
    inner, outer = usable_range_arcsec(instrument, band)
    place = f"{separation_arcsec:.3f} arcsec"
    if separation_arcsec < inner * (1.0 - 1e-9):
        text = f"{place}: the aperture leaves the dark hole of {band} inside {inner:.3f} arcsec (diagonal)"
        return Status.OUTSIDE_FIELD, Reason.INSIDE_INNER_EDGE, text
    if separation_arcsec > outer * (1.0 + 1e-9):
        text = f"{place}: the aperture leaves the dark hole of {band} outside {outer:.3f} arcsec (diagonal)"
        return Status.OUTSIDE_FIELD, Reason.OUTSIDE_OUTER_EDGE, text
    return Status.OK, Reason.NONE, ""


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
