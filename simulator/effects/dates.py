"""Dates as people write them: ISO 8601 in UTC, or a decimal year."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from catalogs.errors import InputError
from simulator.quantities import check_number

__all__ = ["days_since_j2000", "decimal_year", "parse_utc"]

_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
_YEARS = (1950.0, 2100.0)
_ALLOWED = f"{_YEARS[0]:g} to {_YEARS[1]:g}, as 2028-01-01T00:00:00"


def parse_utc(name: str, value: Any) -> datetime:
    """Return an ISO 8601 date, with or without time, as a UTC instant.

    Parameters
    ----------
    name : str
        What it is, for messages.
    value : str
        ``2028-01-01``, ``2028-01-01T12:30:00``, with ``Z`` or an offset if not UTC.

    Raises
    ------
    InputError
        If it is no date or outside 1950 to 2100.
    """
    try:
        found = datetime.fromisoformat(value.strip())
    except (AttributeError, ValueError):
        raise InputError(name, value, allowed=f"a date, {_ALLOWED}") from None
    found = found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
    if not _YEARS[0] <= found.year < _YEARS[1]:
        raise InputError(name, value, allowed=f"a date, {_ALLOWED}")
    return found


def decimal_year(name: str, value: Any) -> float:
    """Return a decimal year; a number passes, a date is converted by the length of its year.

    Raises
    ------
    InputError
        If it is neither a date nor a year, or outside 1950 to 2100.
    """
    if isinstance(value, str):
        found = parse_utc(name, value)
        start = datetime(found.year, 1, 1, tzinfo=UTC)
        return found.year + (found - start) / (datetime(found.year + 1, 1, 1, tzinfo=UTC) - start)
    year = check_number(name, value, "yr")
    if not _YEARS[0] <= year <= _YEARS[1]:
        raise InputError(name, value, unit="yr", allowed=f"a year, {_ALLOWED}")
    return year


def days_since_j2000(when: datetime) -> float:
    """Return days since 2000-01-01 12:00 UTC."""
    return (when - _J2000).total_seconds() / 86400.0
