"""Light of the sky in front of the telescope."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from catalogs.errors import InputError
from simulator.config import Instrument
from simulator.config.angles import declination_deg, right_ascension_deg
from simulator.effects.dates import parse_utc
from simulator.effects.stray_light import extra_lights
from simulator.effects.sun_position import ecliptic_deg, elongation_deg, sun_longitude_deg
from simulator.effects.zodiacal import zodiacal_photlam_arcsec2, zodiacal_radiance
from simulator.passbands import Passbands

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
            raise InputError(
                name,
                "missing",
                allowed="place and date of the target, which sky.model: zodiacal needs",
                hint="sky.model: uniform needs none",
            )
    longitude, latitude = ecliptic_deg(right_ascension_deg(ra_deg), declination_deg(dec_deg))
    return longitude - sun_longitude_deg(parse_utc("start_utc", start_utc)), latitude
