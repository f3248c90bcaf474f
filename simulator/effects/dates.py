"""Dates as people write them: ISO 8601 in UTC, or a decimal year."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from catalogs.errors import InputError
from simulator.config.mission import FIRST_YEAR, LAST_YEAR, checked_utc
from simulator.quantities import check_number

_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
_ALLOWED = f"{FIRST_YEAR} to {LAST_YEAR}, as 2028-01-01T00:00:00"


def parse_utc(name: str, value: Any) -> datetime:
    """Return an ISO 8601 date, with or without time, as a UTC instant.

    Parameters
    ----------
    name : str
        What it is, for messages.
    value : str
        What `simulator.config.mission.checked_utc` accepts, a leap second included (it is the first second of the next
        day here); or a time with an offset from UTC, as ``2028-01-01T08:00:00+08:00``.

    Raises
    ------
    InputError
        If it is no date or outside 1972 to 2100.
    """
    try:
        plain = checked_utc(name, value)
    except InputError:
        plain = ""
    if plain[17:19] == "60":
        return datetime.fromisoformat(f"{plain[:17]}59{plain[19:26]}").replace(tzinfo=UTC) + timedelta(seconds=1)
    try:
        found = datetime.fromisoformat(value.strip())
    except (AttributeError, ValueError):
        raise InputError(name, value, allowed=f"a date, {_ALLOWED}") from None
    found = found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
    if not FIRST_YEAR <= found.year <= LAST_YEAR:
        raise InputError(name, value, allowed=f"a date, {_ALLOWED}")
    return found


def decimal_year(name: str, value: Any) -> float:
    """Return a decimal year; a number passes, a date is converted by the length of its year.

    Raises
    ------
    InputError
        If it is neither a date nor a year, or outside 1972 to 2100 (the end of that year).
    """
    if isinstance(value, str):
        found = parse_utc(name, value)
        start = datetime(found.year, 1, 1, tzinfo=UTC)
        return found.year + (found - start) / (datetime(found.year + 1, 1, 1, tzinfo=UTC) - start)
    year = check_number(name, value, "yr")
    if not FIRST_YEAR <= year <= LAST_YEAR + 1:
        raise InputError(name, value, unit="yr", allowed=f"a year, {_ALLOWED}")
    return year


def days_since_j2000(when: datetime) -> float:
    """Return days since 2000-01-01 12:00 UTC."""
    return (when - _J2000).total_seconds() / 86400.0
