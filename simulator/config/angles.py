"""Right ascension and declination as people write them, in degrees."""

from __future__ import annotations

import math
import re
from typing import Any

from catalogs.errors import InputError

__all__ = ["declination_deg", "right_ascension_deg"]

_NUMBER = r"\d+(?:\.\d*)?"
_SEXAGESIMAL = re.compile(
    rf"(?P<sign>[-+]?)\s*(?P<whole>\d+)\s*(?P<unit>[hd:\s])\s*"
    rf"(?P<minutes>\d{{1,2}})(?:\s*[m:\s]\s*(?:(?P<seconds>{_NUMBER})\s*s?)?)?"
)
_DECIMAL = re.compile(rf"(?P<sign>[-+]?)\s*(?P<value>{_NUMBER})\s*(?P<unit>[hd])")
_SPELLINGS = str.maketrans("−–°ʰᵐˢ′'″\"", "--dhmsmmss")
_DEGREES_PER_HOUR = 15.0


def right_ascension_deg(value: Any) -> float:
    """Return a right ascension in degrees.

    Parameters
    ----------
    value : float or str
        Degrees, 0 to 360; or text: hours as ``14:39:36.49``, ``14 39 36.49``, ``14h39m36.49s``, ``14.66h``; degrees
        only where it says so, ``219.9d`` or ``219d54m7s``.

    Raises
    ------
    InputError
        If it cannot be read or is out of range.
    """
    return _angle("ra_deg", value, _DEGREES_PER_HOUR, (0.0, 360.0), "0 to 360 degrees, or text such as 14:39:36.5")


def declination_deg(value: Any) -> float:
    """Return a declination in degrees.

    Parameters
    ----------
    value : float or str
        Degrees, -90 to 90; or text: ``-60:50:02.3``, ``-60 50 02.3``, ``-60d50m02.3s``, ``-60.84d``.

    Raises
    ------
    InputError
        If it cannot be read or is out of range.
    """
    return _angle("dec_deg", value, 1.0, (-90.0, 90.0), "-90 to 90 degrees, or text such as -60:50:02.3")


def _angle(key: str, value: Any, degrees_per_part: float, limits: tuple[float, float], allowed: str) -> float:
    if isinstance(value, str):
        degrees = _read(value, degrees_per_part)
    else:
        degrees = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    # Not a number compares false.
    if degrees is None or not limits[0] <= degrees <= limits[1]:
        raise InputError(key, value, unit="" if isinstance(value, str) else "deg", allowed=allowed)
    return float(degrees)


def _read(text: str, degrees_per_part: float) -> float | None:
    """Degrees of an angle whose colons separate parts of that many degrees, None if it cannot be read."""
    plain = text.strip().lower().translate(_SPELLINGS)
    found = _SEXAGESIMAL.fullmatch(plain)
    if found:
        minutes, seconds = float(found["minutes"]), float(found["seconds"] or 0.0)
        if minutes >= 60.0 or seconds >= 60.0:
            return None
        size = math.fsum((float(found["whole"]), minutes / 60.0, seconds / 3600.0))
    else:
        found = _DECIMAL.fullmatch(plain)
        if not found:
            return None
        size = float(found["value"])
    hours = found["unit"] == "h" or (found["unit"] != "d" and degrees_per_part == _DEGREES_PER_HOUR)
    if hours and degrees_per_part != _DEGREES_PER_HOUR:
        return None
    # The sign belongs to the whole angle: -00:30:00 is south.
    return (-1.0 if found["sign"] == "-" else 1.0) * size * (_DEGREES_PER_HOUR if hours else 1.0)
