"""The mission as configuration: when observations begin, where the telescope is, and how products are labelled."""

from __future__ import annotations

import re
from datetime import date
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationInfo

from catalogs.errors import InputError
from simulator.config.base import FrozenModel

__all__ = ["MissionConfig", "OrbitConfig", "checked_utc"]

_UTC = re.compile(r"(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d(?:\.\d{1,9})?))?)?Z?", re.ASCII)
_FIRST_YEAR, _LAST_YEAR = 1972, 2100


def checked_utc(key: str, value: Any) -> str:
    """Return a time of UTC in one spelling, ``YYYY-MM-DDThh:mm:ss`` with the fraction that was given.

    Parameters
    ----------
    key : str
        What the time is, for the refusal.
    value : str
        ISO 8601: a date, or a date and a time, with or without ``Z``. Second 60 is accepted where leap seconds are put,
        at the end of June and December.

    Raises
    ------
    InputError
        If it is no such time between 1972, when UTC began, and 2100.
    """
    found = _UTC.fullmatch(value.strip()) if isinstance(value, str) else None
    if found is not None:
        year, month, day = (int(part) for part in found.groups()[:3])
        hour, minute, second = int(found[4] or 0), int(found[5] or 0), found[6] or "00"
        leap = (month, day, hour, minute) in ((6, 30, 23, 59), (12, 31, 23, 59))
        if hour < 24 and minute < 60 and float(second) < 60 + leap and _is_day(year, month, day):
            return f"{found[1]}-{found[2]}-{found[3]}T{hour:02d}:{minute:02d}:{second}"
    raise InputError(
        key,
        value,
        unit="UTC",
        allowed=f"a time as 2028-01-01T00:00:00, {_FIRST_YEAR} to {_LAST_YEAR}",
    )


def _is_day(year: int, month: int, day: int) -> bool:
    try:
        return _FIRST_YEAR <= date(year, month, day).year <= _LAST_YEAR
    except ValueError:
        return False


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
