"""Dates as people write them: ISO 8601 in UTC, or a decimal year.

Where the Sun and a target lie on the ecliptic.

Zodiacal light of Leinert et al. 1998 (A&AS 127, 1): brightness by place, colour by wavelength.

Brightness at 500 nm is their table 17, seen from the Earth's orbit; the change over the year (about 10 %, from the tilt
of the dust's plane and the Earth's distance) is not in it. The spectrum is the Sun's, reddened by their colour factor.

Light of the sky in front of the telescope.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

import numpy as np

from catalogs import HC_ERG_ANGSTROM, Spectrum, load_reference_spectrum, load_zodi_table
from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, check_number
from simulator.config import FIRST_YEAR, LAST_YEAR, Instrument, checked_utc, declination_deg, right_ascension_deg
from simulator.effects.stray_light import extra_lights
from simulator.passbands import Passbands

_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
_ALLOWED = f"{FIRST_YEAR} to {LAST_YEAR}, as 2028-01-01T00:00:00"


def parse_utc(name: str, value: Any) -> datetime:
    """Return an ISO 8601 date, with or without time, as a UTC instant.

    Parameters
    ----------
    name : str
        What it is, for messages.
    value : str
        What `simulator.config.telescope.checked_utc` accepts, a leap second included (it is the first second of the
        next day here); or a time with an offset from UTC, as ``2028-01-01T08:00:00+08:00``.

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


_OBLIQUITY_DEG = 23.4392911  # J2000
_PRECESSION_DEG_PER_DAY = 1.396971 / 36525.0


def sun_longitude_deg(when: datetime) -> float:
    """Geocentric ecliptic longitude of the Sun, mean equinox J2000, 0 to 360 degrees.

    The low-precision formulae of the Astronomical Almanac (section C), brought from the equinox of date to that of
    J2000: good to an arcminute from 1950 to 2100.
    """
    days = days_since_j2000(when)
    mean = 280.460 + 0.9856474 * days
    anomaly = math.radians(357.528 + 0.9856003 * days)
    of_date = mean + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    return (of_date - _PRECESSION_DEG_PER_DAY * days) % 360.0


def ecliptic_deg(ra_deg: float, dec_deg: float) -> tuple[float, float]:
    """Ecliptic longitude (0 to 360) and latitude, equinox J2000, of an ICRS position, degrees.

    Parameters
    ----------
    ra_deg : float
        ICRS right ascension, degrees.
    dec_deg : float
        ICRS declination, degrees.
    """
    ra, dec, tilt = math.radians(ra_deg), math.radians(dec_deg), math.radians(_OBLIQUITY_DEG)
    x = math.cos(dec) * math.cos(ra)
    y = math.cos(tilt) * math.cos(dec) * math.sin(ra) + math.sin(tilt) * math.sin(dec)
    z = -math.sin(tilt) * math.cos(dec) * math.sin(ra) + math.cos(tilt) * math.sin(dec)
    return math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, math.hypot(x, y)))


def elongation_deg(longitude_from_sun_deg: float, latitude_deg: float) -> float:
    """Angle from the Sun of a place on the sky, degrees.

    The arc tangent keeps its digits next to the Sun and opposite it, where the arc cosine has none.
    """
    longitude, latitude = math.radians(longitude_from_sun_deg), math.radians(latitude_deg)
    beside = math.hypot(math.cos(latitude) * math.sin(longitude), math.sin(latitude))
    return math.degrees(math.atan2(beside, math.cos(latitude) * math.cos(longitude)))


_ARCSEC2_PER_SR = (180.0 * 3600.0 / np.pi) ** 2
_ERG_S_CM2_A_PER_W_M2_UM = 0.1
_REFERENCE_NM = 500.0
_SUN_MEAN_NM = (480.0, 520.0)  # over the Sun's lines at 500 nm
_SLOPES = {30.0: (1.2, 0.8), 90.0: (0.9, 0.6)}  # elongation: below, above 500 nm


class ZodiacalRadiance(NamedTuple):
    """Radiance at 500 nm in W m-2 sr-1 um-1, and whether it is only a lower limit: too close to the Sun."""

    radiance_500nm_w_m2_sr_um: float
    solar_avoidance: bool


def zodiacal_radiance(longitude_from_sun_deg: float, latitude_deg: float) -> ZodiacalRadiance:
    """Radiance of the zodiacal light at 500 nm.

    Parameters
    ----------
    longitude_from_sun_deg : float
        Ecliptic longitude from the Sun; east and west are alike.
    latitude_deg : float
        Ecliptic latitude; north and south are alike.

    Returns
    -------
    ZodiacalRadiance
        Linear in the logarithm between the cells of the table. Where the table is empty, around the Sun, the brightest
        cell tabulated at that latitude stands in: a lower limit, flagged.
    """
    table = load_zodi_table()
    longitude = abs((longitude_from_sun_deg + 180.0) % 360.0 - 180.0)
    logarithm, empty = _filled()
    rows = _weights(table.helioecliptic_longitude_deg, longitude)
    columns = _weights(table.ecliptic_latitude_deg, abs(latitude_deg))
    value = sum(wr * wc * logarithm[i, j] for i, wr in rows for j, wc in columns)
    avoided = any(wr * wc > 0.0 and empty[i, j] for i, wr in rows for j, wc in columns)
    return ZodiacalRadiance(float(np.exp(value)), avoided)


@functools.cache
def _filled() -> tuple[FloatArray, BoolArray]:
    """Logarithm of the table, its empty cells filled with the next one away from the Sun; and which were empty."""
    radiance = load_zodi_table().radiance_500nm_w_m2_sr_um
    empty = np.isnan(radiance)
    filled = radiance.copy()
    for row in range(radiance.shape[0] - 2, -1, -1):
        filled[row] = np.where(empty[row], filled[row + 1], filled[row])
    return np.log(filled), empty


def _weights(axis: FloatArray, place: float) -> tuple[tuple[int, float], tuple[int, float]]:
    """Neighbouring cells and their weights."""
    right = int(np.clip(np.searchsorted(axis, place), 1, axis.size - 1))
    share = float((place - axis[right - 1]) / (axis[right] - axis[right - 1]))
    return (right - 1, 1.0 - share), (right, share)


def colour_factor(wavelength_nm: ArrayLike, elongation: float) -> FloatArray:
    """Reddening relative to the Sun, 1 at 500 nm (Leinert et al. 1998, eq. 22), 220 to 2500 nm.

    ``1 + s log10(wavelength / 500 nm)`` with s = 1.2 below and 0.8 above 500 nm at 30 degrees from the Sun, 0.9 and 0.6
    at 90 degrees; linear between, constant beyond.
    """
    logarithm = np.log10(np.asarray(wavelength_nm, dtype=np.float64) / _REFERENCE_NM)
    near, far = _SLOPES
    below, above = (np.interp(elongation, [near, far], [_SLOPES[near][i], _SLOPES[far][i]]) for i in (0, 1))
    return np.asarray(1.0 + np.where(logarithm < 0.0, below, above) * logarithm)


def zodiacal_photlam_arcsec2(radiance_500nm_w_m2_sr_um: float, elongation: float) -> Spectrum:
    """Spectrum of the zodiacal light, ph/s/cm2/A/arcsec2, 300-1750 nm.

    Parameters
    ----------
    radiance_500nm_w_m2_sr_um : float
        Radiance at 500 nm.
    elongation : float
        Angle from the Sun, degrees; sets the colour.
    """
    sun = load_reference_spectrum("sun")
    flam = sun.photlam * HC_ERG_ANGSTROM / (10.0 * sun.wavelength_nm)
    inside = (sun.wavelength_nm >= _SUN_MEAN_NM[0]) & (sun.wavelength_nm <= _SUN_MEAN_NM[1])
    x, y = sun.wavelength_nm[inside], flam[inside]
    mean = float(np.trapezoid(y, x)) / float(x[-1] - x[0])
    scale = radiance_500nm_w_m2_sr_um * _ERG_S_CM2_A_PER_W_M2_UM / _ARCSEC2_PER_SR / mean
    return Spectrum(sun.wavelength_nm, scale * colour_factor(sun.wavelength_nm, elongation) * sun.photlam)


SOLAR_AVOIDANCE = "solar_avoidance"


@dataclass(frozen=True)
class SkyLevel:
    """Detected rate of the sky in a clear aperture, before apodizer, mask and pixel size.

    Attributes
    ----------
    rate_e_s_arcsec2 : float
        Electrons per second and arcsec2, the sum of all parts.
    parts : mapping of str to float
        The same by origin: ``uniform`` or ``zodiacal``, and ``earthshine`` and ``stray_light`` where those are given as
        surface brightness.
    flags : tuple of str
        ``solar_avoidance``: so close to the Sun that the zodiacal light is a lower limit.
    """

    rate_e_s_arcsec2: float
    parts: Mapping[str, float]
    flags: tuple[str, ...] = ()


def sky_rate_e_s_arcsec2(
    instrument: Instrument,
    band: str,
    *,
    ra_deg: float | str | None = None,
    dec_deg: float | str | None = None,
    start_utc: str | None = None,
) -> SkyLevel:
    """Detected rate of the sky in a band.

    Parameters
    ----------
    instrument : Instrument
        Its section ``sky`` chooses the model: ``uniform``, of solar colour and one brightness everywhere, or
        ``zodiacal``, by place and date.
    band : str
        Any band of the instrument.
    ra_deg, dec_deg : float or str, optional
        Target; needed for ``zodiacal``.
    start_utc : str, optional
        ISO date, 1972 to 2100; needed for ``zodiacal``.

    Returns
    -------
    SkyLevel

    Raises
    ------
    InputError
        For an unknown band, or where ``zodiacal`` lacks target or date.

    Notes
    -----
    Light that is given as a rate on the detector or as a map is not in it: `stray_light_map`.
    """
    sky, passbands = instrument.sky, Passbands.from_instrument(instrument)
    column = passbands.index(band)

    def solar(brightness_v_mag_arcsec2: float) -> float:
        rates = passbands.sky_rate_e_s_arcsec2(brightness_v_mag_arcsec2, instrument.telescope.area_cm2)
        return float(rates[column])

    flags: tuple[str, ...] = ()
    if sky.model == "uniform":
        parts = {"uniform": solar(sky.brightness_v_mag_arcsec2)}
    else:
        longitude, latitude = _place(ra_deg, dec_deg, start_utc)
        radiance, avoided = zodiacal_radiance(longitude, latitude)
        spectrum = zodiacal_photlam_arcsec2(radiance, elongation_deg(longitude, latitude))
        rates = passbands.spectrum_rate_e_s(spectrum.wavelength_nm, spectrum.photlam, instrument.telescope.area_cm2)
        parts = {"zodiacal": float(rates[column])}
        flags = (SOLAR_AVOIDANCE,) if avoided else ()
    for name, light in extra_lights(instrument).items():
        if light.brightness_v_mag_arcsec2 is not None:
            parts[name] = solar(light.brightness_v_mag_arcsec2)
    return SkyLevel(sum(parts.values()), parts, flags)


def _place(ra_deg: Any, dec_deg: Any, start_utc: Any) -> tuple[float, float]:
    """Ecliptic longitude from the Sun and latitude of a target at a date, degrees."""
    for name, value in (("ra_deg", ra_deg), ("dec_deg", dec_deg), ("start_utc", start_utc)):
        if value is None:
            allowed = "place and date of the target, which sky.model: zodiacal needs"
            raise InputError(name, "missing", allowed=allowed, hint="sky.model: uniform needs none")
    longitude, latitude = ecliptic_deg(right_ascension_deg(ra_deg), declination_deg(dec_deg))
    return longitude - sun_longitude_deg(parse_utc("start_utc", start_utc)), latitude
