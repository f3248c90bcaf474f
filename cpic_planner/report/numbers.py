"""Numbers as text: sensible digits, units beside them, a dash where there is none."""

from __future__ import annotations

import math

__all__ = [
    "MISSING",
    "contrast_text",
    "count_text",
    "decimals",
    "duration_text",
    "percent_text",
    "power_of_ten",
    "share_text",
    "significant",
]

MISSING = "–"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MINUTE_S, _HOUR_S = 60.0, 3600.0


def decimals(value: float | None, places: int) -> str:
    """Return ``value`` with fixed decimals; a dash if there is none."""
    return MISSING if value is None or not math.isfinite(value) else f"{value:.{places}f}".replace("-", "−")


def significant(value: float | None, digits: int = 3) -> str:
    """Return ``value`` to significant digits without exponent (for numbers of everyday size)."""
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0.0:
        return "0"
    places = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{places}f}".replace("-", "−")


def contrast_text(value: float | None, digits: int = 3) -> str:
    """Return a flux ratio as ``5.16 × 10⁻⁸``."""
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa} × {power_of_ten(int(exponent))}".replace("-", "−")


def power_of_ten(exponent: int) -> str:
    """Return ``10⁻⁸`` for -8."""
    return "10" + str(exponent).translate(_SUPERSCRIPT)


def duration_text(value_s: float | None) -> str:
    """Return a time in the unit that people would use: s, min or h."""
    if value_s is None or not math.isfinite(value_s):
        return MISSING
    if value_s < 10 * _MINUTE_S:
        return f"{significant(value_s)} s"
    if value_s < _HOUR_S:
        return f"{significant(value_s / _MINUTE_S)} min"
    return f"{significant(value_s / _HOUR_S)} h"


def count_text(value: int | None) -> str:
    """Return an integer with thin spaces between thousands."""
    return MISSING if value is None else f"{value:,}".replace(",", "\u202f")


def percent_text(value: float | None) -> str:
    """Return a fraction as per cent."""
    return MISSING if value is None or not math.isfinite(value) else f"{significant(100.0 * value, 2)} %"


def share_text(value: float) -> str:
    """Return a fraction in per cent without the sign, for columns that name the unit."""
    return "0" if value == 0.0 else significant(100.0 * value) if value >= 1e-4 else "<0.01"
