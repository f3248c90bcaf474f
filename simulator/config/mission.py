"""The mission as configuration: when observations begin, where the telescope is, and how products are labelled."""

from __future__ import annotations

import re
from datetime import date
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationInfo

from catalogs.errors import InputError
from simulator.config.base import FrozenModel
from simulator.lazy import load_quietly

__all__ = ["FIRST_YEAR", "LAST_YEAR", "MissionConfig", "OrbitConfig", "checked_utc"]

FIRST_YEAR, LAST_YEAR = 1972, 2100
"""Years of every date of the project: from the first of UTC on, both included."""

_UTC = re.compile(r"(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d(?:\.\d{1,9})?))?)?Z?", re.ASCII)


def checked_utc(key: str, value: Any) -> str:
    """Return a time of UTC in one spelling, ``YYYY-MM-DDThh:mm:ss`` with the fraction that was given.

    Parameters
    ----------
    key : str
        What the time is, for the refusal.
    value : str
        ISO 8601: a date, or a date and a time, with or without ``Z``. Second 60 is accepted in the minutes that had
        one, by the table of leap seconds that comes with ERFA; none can be foreseen.

    Raises
    ------
    InputError
        If it is no such time between 1972, when UTC began, and 2100.
    """
    found = _UTC.fullmatch(value.strip()) if isinstance(value, str) else None
    if found is not None:
        year, month, day = (int(part) for part in found.groups()[:3])
        hour, minute, second = int(found[4] or 0), int(found[5] or 0), found[6] or "00"
        in_minute = float(second) < 60 or (
            float(second) < 61 and (hour, minute) == (23, 59) and _ends_in_leap_second(year, month, day)
        )
        if hour < 24 and minute < 60 and in_minute and _is_day(year, month, day):
            return f"{found[1]}-{found[2]}-{found[3]}T{hour:02d}:{minute:02d}:{second}"
    raise InputError(
        key,
        value,
        unit="UTC",
        allowed=f"a time as 2028-01-01T00:00:00, {FIRST_YEAR} to {LAST_YEAR}",
    )


def _is_day(year: int, month: int, day: int) -> bool:
    try:
        return FIRST_YEAR <= date(year, month, day).year <= LAST_YEAR
    except ValueError:
        return False


def _ends_in_leap_second(year: int, month: int, day: int) -> bool:
    """Whether a leap second was put behind a day: the table names the months that begin behind one."""
    if (month, day) not in ((6, 30), (12, 31)):
        return False
    behind = (year, 7) if month == 6 else (year + 1, 1)
    # Loading the table takes a fifth of a second, which only such a time costs.
    table = load_quietly("erfa").leap_seconds.get()
    return behind in {(int(row["year"]), int(row["month"])) for row in table if row["year"] >= FIRST_YEAR}


def _utc_field(value: str, info: ValidationInfo) -> str:
    return checked_utc(info.field_name or "utc", value)


Utc = Annotated[str, AfterValidator(_utc_field)]


class OrbitConfig(FrozenModel):
    """A circular orbit about an oblate Earth, given at one epoch.

    ``node_deg`` is the right ascension of the ascending node, ``phase_deg`` the angle from the node along the orbit.
    """

    altitude_km: Annotated[float, Field(ge=200, le=2000)]
    inclination_deg: Annotated[float, Field(ge=0, le=180)]
    node_deg: Annotated[float, Field(ge=-360, le=360)]
    phase_deg: Annotated[float, Field(ge=-360, le=360)]
    epoch_utc: Utc


class MissionConfig(FrozenModel):
    """Start of an observation that names none, orbit, and the labels of Level-0 products.

    ``obsid_prefix`` begins the eleven digits of an observation's number, ``product_version`` is the number behind ``V``
    in a file name, ``keyword_profile`` names the spellings of the keyword table that are written.
    """

    start_utc: Utc
    orbit: OrbitConfig
    obsid_prefix: Annotated[str, Field(pattern=r"^[0-9]{1,6}$")]
    product_version: Annotated[int, Field(ge=1, le=99)]
    keyword_profile: Annotated[str, Field(min_length=1)]
