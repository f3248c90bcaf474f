"""Light of the sky in front of the telescope at a date and place, and earthshine and stray light on the detector.

Zodiacal light is that of Leinert et al. 1998 (A&AS 127, 1): brightness by place, colour by wavelength.

Brightness at 500 nm is their table 17, seen from the Earth's orbit; the change over the year (about 10 %, from the tilt
of the dust's plane and the Earth's distance) is not in it. The spectrum is the Sun's, reddened by their colour factor,
which their table 19 confirms. Templates of Hubble's calculators, which other calculators for this telescope use, follow
Aldering 2001 (LBNL-51157) in the red: 5 % more light at 660 nm, 13 % at 850 nm for the same V magnitude.
"""

import functools
import math
import re
import warnings
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from catalogs import HC_ERG_ANGSTROM, Spectrum, bracket, load_reference_spectrum, load_zodi_table
from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, Record, check_number
from simulator import config
from simulator.imaging import read_maps, real_map
from simulator.passbands import Passbands

_WORDS = dict.fromkeys(("pixel", "pixels", "px"), "pix") | dict.fromkeys(("relative", "dimensionless"), "")
_WORDS |= {"electrons": "electron", "dn": "adu"}
_PER_FRAME = re.compile(r"/\s*(?:frame|exposure)s?\b|\b(?:frame|exposure)s?\s*\^?(?:\*\*)?\s*-1")
# e- or e, not part of a word; the minus of e-1 is that of a power.
_CHARGE = re.compile(r"(?<![a-z])e(?:-(?!\d))?(?![a-z])")


def unit_factor(key: str, path: str, header: Mapping[str, Any], unit: str, *, required: bool = True) -> float:
    """Return the factor from the unit that a map's header states to the one wanted.

    Parameters
    ----------
    key : str
        What the map is, for the refusal.
    path : str
        The file, for the refusal.
    header : mapping
        Cards of the image; ``BUNIT`` counts. Whatever `astropy.units` reads is understood, in capitals or not, and
        ``e-``, ``px`` and ``DN`` besides; per pixel or per frame may stand in it or not.
    unit : str
        What is wanted, as ``electron/s``; empty for a pure number.
    required : bool
        Whether a map without ``BUNIT`` is refused.

    Raises
    ------
    InputError
        If the unit is missing, cannot be read, or is of another kind; the one found and those accepted are named.
    """
    allowed = f"{unit} or {_per_pixel(unit)}" if unit else "none: the map has no unit"
    if "BUNIT" not in header:
        if required:
            raise InputError(f"{key} BUNIT", "missing", allowed=allowed, hint=path)
        return 1.0
    text = str(header["BUNIT"])
    from astropy import units

    wanted = units.Unit(unit)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", units.UnitsWarning)
            given = units.Unit(_plain(text))
        for target in (wanted, wanted / units.pixel) if unit else (wanted,):
            if given.is_equivalent(target):
                return float(given.to(target))
    except ValueError:
        pass
    raise InputError(f"{key} BUNIT", text, allowed=allowed, hint=path)


def _per_pixel(unit: str) -> str:
    above, _, below = unit.partition("/")
    return f"{above}/({below} pix)" if below else f"{unit}/pix"


def _plain(text: str) -> str:
    """Return the text of a unit in the words of astropy, with one fraction line at most."""
    text = _PER_FRAME.sub("", text.strip().lower())
    text = _CHARGE.sub("electron", text)
    text = re.sub(r"[a-z]+", lambda word: _WORDS.get(word[0], word[0]), text)
    above, *below = text.split("/")
    if len(below) < 2:
        return text
    return f"{above}/({' '.join(part.strip(' ()') for part in below)})"


_UNIT = "electron/s"


def stray_light_map(instrument: config.Instrument, band: str, shape: tuple[int, int]) -> FloatArray | None:
    """Return the electrons per second and pixel of earthshine and stray light that are given on the detector.

    Parameters
    ----------
    instrument : Instrument
        Its sections ``sky.earthshine`` and ``sky.stray_light``.
    band : str
        Any band of the instrument.
    shape : tuple of int
        Rows and columns of the whole frame of the band's camera.

    Returns
    -------
    ndarray, shape ``shape``, or None
        None if neither is set, or both are surface brightnesses in front of the telescope, which are part of
        `sky_rate_e_s_arcsec2`.

    Raises
    ------
    InputError
        If a map is missing, damaged, of another shape or unit, negative or not finite.
    """
    parts = stray_light_parts(instrument, band, shape)
    return sum(parts.values(), np.zeros(shape)) if parts else None


def stray_light_parts(
    instrument: config.Instrument,
    band: str,
    shape: tuple[int, int],
    *,
    first_pixel: tuple[int, int] = (0, 0),
    window: tuple[int, int] | None = None,
) -> dict[str, FloatArray]:
    """Return the parts of `stray_light_map` by origin, for a window of the frame.

    Parameters
    ----------
    instrument, band, shape
        As `stray_light_map`.
    first_pixel : tuple of int
        Row and column of the frame at which the window begins.
    window : tuple of int, optional
        Its rows and columns; the whole frame if not given. What reaches beyond the frame sees nothing of a map.

    Returns
    -------
    dict of str to ndarray
        ``earthshine`` and ``stray_light``, as far as they are given on the detector.
    """
    instrument.band(band)
    parts = {}
    for name, light in extra_lights(instrument).items():
        path = light.map_of(band)
        if path is not None:
            whole = _read_map(f"sky.{name}.map_file", path, shape)
            parts[name] = whole if window is None else _cut(whole, first_pixel, window)
        elif light.rate_e_s is not None:
            parts[name] = np.full(shape if window is None else window, light.rate_e_s)
    return parts


def _cut(whole: FloatArray, first_pixel: tuple[int, int], window: tuple[int, int]) -> FloatArray:
    # Places of the window's rows and columns in the frame; those outside it stay dark.
    places = [first + np.arange(length) for first, length in zip(first_pixel, window, strict=True)]
    inside = [(place >= 0) & (place < size) for place, size in zip(places, whole.shape, strict=True)]
    part = np.zeros(window)
    part[np.ix_(*inside)] = whole[np.ix_(*(place[there] for place, there in zip(places, inside, strict=True)))]
    return part


def effect_files(instrument: config.Instrument, band: str) -> list[str]:
    """Return the names of the files that cosmic rays, earthshine and stray light of a band read, for headers.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    template = instrument.cosmic_rays.template.template_file if instrument.cosmic_rays.model == "template" else None
    paths = [template, *(light.map_of(band) for light in extra_lights(instrument).values())]
    return [Path(path).name for path in paths if path is not None]


def extra_lights(instrument: config.Instrument) -> dict[str, config.ExtraLight]:
    """Return the light besides the sky, by the name of its section."""
    return {"earthshine": instrument.sky.earthshine, "stray_light": instrument.sky.stray_light}


def _read_map(key: str, path: str, shape: tuple[int, int]) -> FloatArray:
    found = read_maps(key, path)
    if not found.is_fits:
        raise InputError(key, path, allowed="a FITS file, which says its unit")
    item = next((image for image in found.maps if image.data.ndim == 2), found.maps[0])
    values = real_map(key, path, item.data, square=False)
    if values.shape != tuple(shape):
        allowed = f"a map of {shape[0]} rows x {shape[1]} columns, the whole frame"
        raise InputError(key, path, allowed=allowed, hint=f"it has {values.shape[0]} x {values.shape[1]}")
    values *= unit_factor(key, path, item.header, _UNIT)
    if (values < 0).any():
        row, column = np.argwhere(values < 0)[0]
        hint = f"row {row}, column {column} holds {values[row, column]:g}"
        raise InputError(key, path, unit="e-/s", allowed="values at least 0", hint=hint)
    return values


_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
_ALLOWED = f"{config.FIRST_YEAR} to {config.LAST_YEAR}, as 2028-01-01T00:00:00"


def parse_utc(name: str, value: Any) -> datetime:
    """Return an ISO 8601 date, with or without time, as a UTC instant.

    Parameters
    ----------
    name : str
        What it is, for messages.
    value : str
        What `simulator.config.instrument.checked_utc` accepts, a leap second included (it is the first second of the
        next day here); or a time with an offset from UTC, as ``2028-01-01T08:00:00+08:00``.

    Raises
    ------
    InputError
        If it is no date or outside 1972 to 2100.
    """
    try:
        plain = config.checked_utc(name, value)
    except InputError:
        plain = ""
    if plain[17:19] == "60":
        return datetime.fromisoformat(f"{plain[:17]}59{plain[19:26]}").replace(tzinfo=UTC) + timedelta(seconds=1)
    try:
        found = datetime.fromisoformat(value.strip())
    except (AttributeError, ValueError):
        raise InputError(name, value, allowed=f"a date, {_ALLOWED}") from None
    found = found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
    if not config.FIRST_YEAR <= found.year <= config.LAST_YEAR:
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
    if not config.FIRST_YEAR <= year <= config.LAST_YEAR + 1:
        raise InputError(name, value, unit="yr", allowed=f"a year, {_ALLOWED}")
    return year


def days_since_j2000(when: datetime) -> float:
    """Return days since 2000-01-01 12:00 UTC."""
    return (when - _J2000).total_seconds() / 86400.0


_OBLIQUITY_DEG = 23.4392911  # J2000
_PRECESSION_DEG_PER_DAY = 1.396971 / 36525.0


def sun_longitude_deg(when: datetime) -> float:
    """Return the geocentric ecliptic longitude of the Sun, mean equinox J2000, 0 to 360 degrees.

    The low-precision formulae of the Astronomical Almanac (section C), brought from the equinox of date to that of
    J2000: good to an arcminute from 1950 to 2100.
    """
    days = days_since_j2000(when)
    anomaly = math.radians(357.528 + 0.9856003 * days)
    of_date = 280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    return (of_date - _PRECESSION_DEG_PER_DAY * days) % 360.0


def ecliptic_deg(ra_deg: ArrayLike, dec_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the ecliptic longitude (0 to 360) and latitude, equinox J2000, of ICRS positions, degrees.

    Parameters
    ----------
    ra_deg, dec_deg : array_like
        ICRS, degrees.
    """
    ra, dec, tilt = np.deg2rad(ra_deg), np.deg2rad(dec_deg), math.radians(_OBLIQUITY_DEG)
    x = np.cos(dec) * np.cos(ra)
    y = math.cos(tilt) * np.cos(dec) * np.sin(ra) + math.sin(tilt) * np.sin(dec)
    z = -math.sin(tilt) * np.cos(dec) * np.sin(ra) + math.cos(tilt) * np.sin(dec)
    return np.rad2deg(np.arctan2(y, x)) % 360.0, np.rad2deg(np.arctan2(z, np.hypot(x, y)))


def elongation_deg(longitude_from_sun_deg: ArrayLike, latitude_deg: ArrayLike) -> FloatArray:
    """Return the angle from the Sun of places on the sky, degrees.

    The arc tangent keeps its digits next to the Sun and opposite it, where the arc cosine has none.
    """
    longitude, latitude = np.deg2rad(longitude_from_sun_deg), np.deg2rad(latitude_deg)
    beside = np.hypot(np.cos(latitude) * np.sin(longitude), np.sin(latitude))
    return np.asarray(np.rad2deg(np.arctan2(beside, np.cos(latitude) * np.cos(longitude))))


_ARCSEC2_PER_SR = (180.0 * 3600.0 / np.pi) ** 2
_ERG_S_CM2_A_PER_W_M2_UM = 0.1
_REFERENCE_NM = 500.0
_SUN_MEAN_NM = (480.0, 520.0)  # over the Sun's lines at 500 nm
_SLOPES = {30.0: (1.2, 0.8), 90.0: (0.9, 0.6)}  # elongation: below, above 500 nm


class ZodiacalRadiance(NamedTuple):
    """Radiance at 500 nm in W m-2 sr-1 um-1, and where it is only a lower limit: too close to the Sun."""

    radiance_500nm_w_m2_sr_um: FloatArray
    solar_avoidance: BoolArray


def zodiacal_radiance(longitude_from_sun_deg: ArrayLike, latitude_deg: ArrayLike) -> ZodiacalRadiance:
    """Return the radiance of the zodiacal light at 500 nm.

    Parameters
    ----------
    longitude_from_sun_deg : array_like
        Ecliptic longitude from the Sun; east and west are alike.
    latitude_deg : array_like
        Ecliptic latitude; north and south are alike.

    Returns
    -------
    ZodiacalRadiance
        Of the broadcast shape; linear in the logarithm between the cells of the table. Where the table is empty, around
        the Sun, the brightest cell tabulated at that latitude stands in: a lower limit, flagged.
    """
    table = load_zodi_table()
    longitude = np.abs((np.asarray(longitude_from_sun_deg) + 180.0) % 360.0 - 180.0)
    longitude, latitude = np.broadcast_arrays(longitude, np.abs(latitude_deg))
    row, row_weight = bracket(table.helioecliptic_longitude_deg, longitude)
    column, column_weight = bracket(table.ecliptic_latitude_deg, latitude)
    cell = row[..., :, None], column[..., None, :]
    weight = row_weight[..., :, None] * column_weight[..., None, :]
    logarithm, empty = _filled()
    value = (weight * logarithm[cell]).sum(axis=(-2, -1))
    return ZodiacalRadiance(np.exp(value), ((weight > 0.0) & empty[cell]).any(axis=(-2, -1)))


@functools.cache
def _filled() -> tuple[FloatArray, BoolArray]:
    """Return the logarithm of the table, empty cells filled with the next away from the Sun; and which were empty."""
    radiance = load_zodi_table().radiance_500nm_w_m2_sr_um
    empty, filled = np.isnan(radiance), radiance.copy()
    for row in range(radiance.shape[0] - 2, -1, -1):
        filled[row] = np.where(empty[row], filled[row + 1], filled[row])
    return np.log(filled), empty


def colour_factor(wavelength_nm: ArrayLike, elongation: float) -> FloatArray:
    """Return the reddening relative to the Sun, 1 at 500 nm (Leinert et al. 1998, eq. 22), 220 to 2500 nm.

    ``1 + s log10(wavelength / 500 nm)`` with s = 1.2 below and 0.8 above 500 nm at 30 degrees from the Sun, 0.9 and 0.6
    at 90 degrees; linear between, constant beyond.
    """
    logarithm = np.log10(np.asarray(wavelength_nm, dtype=np.float64) / _REFERENCE_NM)
    near, far = _SLOPES
    below, above = (np.interp(elongation, [near, far], [_SLOPES[near][i], _SLOPES[far][i]]) for i in (0, 1))
    return np.asarray(1.0 + np.where(logarithm < 0.0, below, above) * logarithm)


def zodiacal_photlam_arcsec2(radiance_500nm_w_m2_sr_um: float, elongation: float) -> Spectrum:
    """Return the spectrum of the zodiacal light, ph/s/cm2/A/arcsec2, 300-1750 nm.

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
SKY_PLACE_UNKNOWN = "sky_place_unknown"
_MIDDLE_LATITUDE_DEG = 30.0  # half of the sky lies nearer to the ecliptic, and is brighter
_BELT_DEG = 10.0


class SkyLevel(Record):
    """Detected rate of the sky in a clear aperture, before apodizer, mask and pixel size.

    Attributes
    ----------
    rate_e_s_arcsec2 : float
        Electrons per second and arcsec2, the sum of all parts.
    parts : mapping of str to float
        The same by origin: ``uniform`` or ``zodiacal``, and ``earthshine`` and ``stray_light`` where those are given as
        surface brightness.
    flags : tuple of str
        ``solar_avoidance``: so close to the Sun that the zodiacal light is a lower limit. ``sky_place_unknown``: no
        coordinates are given, and the zodiacal light is the median over the whole sky.
    """

    rate_e_s_arcsec2: float
    parts: Mapping[str, float]
    flags: tuple[str, ...] = ()


def sky_rate_e_s_arcsec2(
    instrument: config.Instrument,
    band: str,
    *,
    ra_deg: float | str | None = None,
    dec_deg: float | str | None = None,
    start_utc: str | None = None,
) -> SkyLevel:
    """Return the detected rate of the sky in a band.

    Parameters
    ----------
    instrument : Instrument
        Its section ``sky`` chooses the model, see `simulator.config.instrument.SkyConfig`.
    band : str
        Any band of the instrument.
    ra_deg, dec_deg : float or str, optional
        Target; needed for zodiacal light of a date.
    start_utc : str, optional
        ISO date, 1972 to 2100; needed for zodiacal light of a date.

    Returns
    -------
    SkyLevel

    Raises
    ------
    InputError
        For an unknown band, or where the zodiacal light of a date lacks target or date.

    Notes
    -----
    Light that is given as a rate on the detector or as a map is not in it: `stray_light_map`.
    """
    ra = math.nan if ra_deg is None else config.right_ascension_deg(ra_deg)
    dec = math.nan if dec_deg is None else config.declination_deg(dec_deg)
    parts, avoided = _parts(instrument, band, np.array([ra]), np.array([dec]), start_utc)
    flags = [SOLAR_AVOIDANCE] if avoided[0] else []
    if sky_place_unknown(instrument, ra, dec)[()]:
        flags.append(SKY_PLACE_UNKNOWN)
    numbers = {name: float(rates[0]) for name, rates in parts.items()}
    return SkyLevel(sum(numbers.values()), numbers, tuple(flags))


def sky_rates_e_s_arcsec2(
    instrument: config.Instrument,
    band: str,
    ra_deg: FloatArray,
    dec_deg: FloatArray,
    start_utc: str | None = None,
    passbands: Passbands | None = None,
) -> FloatArray:
    """Return the detected rates of the sky at many places, as `sky_rate_e_s_arcsec2`.

    Parameters
    ----------
    instrument : Instrument
    band : str
    ra_deg, dec_deg : ndarray, shape (n,)
        ICRS positions, degrees; nan where there are none.
    start_utc : str, optional
    passbands : Passbands, optional
        Those of the instrument, where they are at hand.

    Returns
    -------
    ndarray, shape (n,)
    """
    parts, _ = _parts(instrument, band, ra_deg, dec_deg, start_utc, passbands)
    return sum(parts.values(), np.zeros(len(ra_deg)))


def sky_place_unknown(instrument: config.Instrument, ra_deg: ArrayLike, dec_deg: ArrayLike) -> BoolArray:
    """Return whether the sky hangs on a place that is not known (nan)."""
    unknown = ~np.isfinite(np.asarray(ra_deg) + np.asarray(dec_deg))
    return np.asarray(unknown & (instrument.sky.model == "zodiacal"))


def _parts(
    instrument: config.Instrument,
    band: str,
    ra_deg: FloatArray,
    dec_deg: FloatArray,
    start_utc: str | None,
    passbands: Passbands | None = None,
) -> tuple[dict[str, FloatArray], BoolArray]:
    """Return the rates by origin, ``(n,)`` each, and where the zodiacal light is a lower limit."""
    sky, area = instrument.sky, instrument.telescope.area_cm2
    passbands = passbands or Passbands.from_instrument(instrument)
    column, near_sun = passbands.index(band), np.zeros(len(ra_deg), bool)
    lights = extra_lights(instrument).items()
    brightness: dict[str, float | None] = {name: light.brightness_v_mag_arcsec2 for name, light in lights}
    parts: dict[str, FloatArray] = {}
    if sky.model == "uniform":
        brightness["uniform"] = sky.brightness_v_mag_arcsec2
    elif sky.season == "median":
        latitude = np.abs(ecliptic_deg(ra_deg, dec_deg)[1])
        known = np.where(np.isfinite(latitude), latitude, _MIDDLE_LATITUDE_DEG)
        belt, parts["zodiacal"] = np.minimum(known // _BELT_DEG, 90.0 / _BELT_DEG - 1.0), np.empty(known.shape)
        for lowest in sorted(set((_BELT_DEG * belt).tolist())):
            latitudes, medians = season_medians_e_s_arcsec2(passbands, area, sky.sun_limit_deg, lowest)
            there = _BELT_DEG * belt == lowest
            parts["zodiacal"][there] = np.interp(known[there], latitudes, medians[:, column])
    else:
        longitude, latitude = _place(ra_deg, dec_deg, start_utc)
        rates, near_sun = _zodiacal(passbands, area, longitude, latitude)
        parts["zodiacal"] = rates[..., column]
    for name, value in brightness.items():
        if value is not None:
            parts[name] = np.full(len(ra_deg), passbands.sky_rate_e_s_arcsec2(value, area)[column])
    return parts, near_sun


def _zodiacal(passbands: Passbands, area_cm2: float, *from_sun_deg: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the rates of the zodiacal light, ``(..., band)``, and where they are lower limits, at given places."""
    radiance, avoided = zodiacal_radiance(*from_sun_deg)
    return _zodiacal_rates(passbands, area_cm2, radiance, elongation_deg(*from_sun_deg)), avoided


def _zodiacal_rates(passbands: Passbands, area_cm2: float, radiance: FloatArray, elongation: FloatArray) -> FloatArray:
    near, far = _rates_of_unit_radiance(passbands, area_cm2)
    share = np.interp(elongation, list(_SLOPES), [0.0, 1.0])[..., None]
    return np.asarray(radiance[..., None] * ((1.0 - share) * near + share * far))


@functools.lru_cache(maxsize=16)
def _rates_of_unit_radiance(passbands: Passbands, area_cm2: float) -> list[FloatArray]:
    """Return the rates near the Sun and far from it, ``(band,)`` each.

    The colour factor is linear in its slopes, and those in the angle from the Sun: two spectra serve every place.
    """
    lights = [zodiacal_photlam_arcsec2(1.0, elongation) for elongation in _SLOPES]
    return [passbands.spectrum_rate_e_s(light.wavelength_nm, light.photlam, area_cm2) for light in lights]


@functools.lru_cache(maxsize=144)
def season_medians_e_s_arcsec2(
    passbands: Passbands, area_cm2: float, sun_limit_deg: float, lowest_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Return the median rates of the zodiacal light over a year, against ecliptic latitude in a belt.

    The Sun passes every longitude once a year, so that the median hangs on the latitude alone; its uneven speed, left
    out, would move it by 1.2 % at most.

    Parameters
    ----------
    passbands : Passbands
    area_cm2 : float
        Collecting area.
    sun_limit_deg : float
        Days on which the place is nearer to the Sun do not count.
    lowest_deg : float
        Lowest latitude of the belt: one star needs one of nine.

    Returns
    -------
    latitude_deg : ndarray, shape (n,)
        Every degree of the belt.
    rate_e_s_arcsec2 : ndarray, shape (n, band)
    """
    latitude, radiance, elongation = _year(lowest_deg)
    hidden = elongation < sun_limit_deg - 1e-9  # the pole is 90 degrees from the Sun all the year
    rates = np.where(hidden[..., None], np.inf, _zodiacal_rates(passbands, area_cm2, radiance, elongation))
    middle = (np.count_nonzero(~hidden, axis=1)[:, None, None] - [[1], [0]]) // 2
    return latitude, np.take_along_axis(np.sort(rates, axis=1), middle, axis=1).mean(axis=1)


@functools.cache
def _year(lowest_deg: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the latitudes of a belt, and the zodiacal light and elongation of each at every place of the Sun."""
    latitude = lowest_deg + np.arange(_BELT_DEG + 1.0)
    places = np.broadcast_arrays(np.arange(180.0) + 0.5, latitude[:, None])
    return latitude, zodiacal_radiance(*places)[0], elongation_deg(*places)


def _place(ra_deg: FloatArray, dec_deg: FloatArray, start_utc: str | None) -> tuple[FloatArray, FloatArray]:
    """Return the ecliptic longitudes from the Sun and latitudes of targets at a date, degrees."""
    missing = {"ra_deg": np.isnan(ra_deg).any(), "dec_deg": np.isnan(dec_deg).any(), "start_utc": start_utc is None}
    for name, lacks in missing.items():
        if lacks:
            allowed = "place and date of the target, which sky.season: date needs"
            raise InputError(name, "missing", allowed=allowed, hint="sky.season: median needs none")
    longitude, latitude = ecliptic_deg(ra_deg, dec_deg)
    return longitude - sun_longitude_deg(parse_utc("start_utc", start_utc)), latitude
