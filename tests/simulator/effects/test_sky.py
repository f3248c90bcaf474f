"""Sky rates: the uniform sky of before, zodiacal light end to end."""

import numpy as np
import pytest
from astropy import constants, units
from astropy.coordinates import GeocentricMeanEcliptic, SkyCoord, get_sun
from astropy.time import Time

from catalogs.errors import InputError
from catalogs.spectra import load_reference_spectrum
from simulator.config import load_instrument
from simulator.effects import sky_rate_e_s_arcsec2
from simulator.passbands import Passbands

DATE = "2028-03-03T06:00:00"
ZODIACAL = load_instrument({"sky": {"model": "zodiacal"}})


def icrs_at(longitude_from_sun_deg, latitude_deg):
    """Right ascension and declination of a place relative to the Sun at `DATE`, by astropy."""
    when = Time(DATE, scale="tt")
    frame = GeocentricMeanEcliptic(equinox="J2000", obstime=when)
    sun = get_sun(when).transform_to(frame)
    # Unit distance is one astronomical unit from the Earth; as a direction it must be far away.
    place = SkyCoord(
        (sun.lon.deg + longitude_from_sun_deg) * units.deg, latitude_deg * units.deg, 1e9 * units.pc, frame=frame
    )
    return {"ra_deg": place.icrs.ra.deg, "dec_deg": place.icrs.dec.deg, "start_utc": DATE}


def test_uniform_sky_is_that_of_the_passbands():
    instrument = load_instrument()
    passbands = Passbands.from_instrument(instrument)
    expected = passbands.sky_rate_e_s_arcsec2(21.0, instrument.telescope.area_cm2)
    for band, rate in zip(passbands.names, expected, strict=True):
        level = sky_rate_e_s_arcsec2(instrument, band)
        assert level.rate_e_s_arcsec2 == rate
        assert level.parts == {"uniform": rate}
        assert level.flags == ()


def test_uniform_sky_follows_its_magnitude():
    fainter = load_instrument({"sky": {"brightness_v_mag_arcsec2": 23.5}})
    bright, faint = (sky_rate_e_s_arcsec2(item, "F662").rate_e_s_arcsec2 for item in (load_instrument(), fainter))
    assert bright / faint == pytest.approx(10.0, rel=1e-12)


@pytest.mark.parametrize(
    ("longitude", "latitude", "radiance"), [(180, 0, 230e-8), (90, 0, 259e-8), (-60, 45, 134e-8), (0, 90, 77e-8)]
)
@pytest.mark.parametrize("band", ["F520", "F850", "F1265"])
def test_zodiacal_rate_by_brute_force(longitude, latitude, radiance, band):
    level = sky_rate_e_s_arcsec2(ZODIACAL, band, **icrs_at(longitude, latitude))
    # The table, the colour and the photon count anew, with units.
    configuration = ZODIACAL.bands[band]
    wavelength = np.linspace(-0.5, 0.5, 20001) * configuration.width_nm + configuration.center_nm
    sun = load_reference_spectrum("sun")

    def flam(nm):
        return np.interp(nm, sun.wavelength_nm, sun.photlam / sun.wavelength_nm)

    elongation = np.rad2deg(np.arccos(np.cos(np.deg2rad(longitude)) * np.cos(np.deg2rad(latitude))))
    share = np.clip((elongation - 30) / 60, 0, 1)
    slope = np.where(wavelength < 500, 1.2 - 0.3 * share, 0.8 - 0.2 * share)
    relative = flam(wavelength) / flam(np.linspace(480, 520, 4001)).mean() * (1 + slope * np.log10(wavelength / 500))
    spectral = radiance * relative * units.W / units.m**2 / units.sr / units.um
    photons = (spectral * wavelength * units.nm / (constants.h * constants.c)).to(units.Unit("s-1 cm-2 nm-1 arcsec-2"))
    detected = np.trapezoid(photons.value, wavelength) * configuration.t_opt * configuration.qe
    expected = detected * ZODIACAL.telescope.area_cm2
    assert level.rate_e_s_arcsec2 == pytest.approx(expected, rel=3e-3)
    assert level.parts == {"zodiacal": level.rate_e_s_arcsec2}
    assert level.flags == ()


def test_zodiacal_light_changes_with_the_season():
    star = {"ra_deg": "14:39:36.5", "dec_deg": "-60:50:02"}
    rates = [
        sky_rate_e_s_arcsec2(ZODIACAL, "F520", **star, start_utc=f"2028-{month:02d}-01").rate_e_s_arcsec2
        for month in range(1, 13)
    ]
    assert 1.3 < max(rates) / min(rates) < 4.0
    # The uniform sky is brighter than all of them.
    assert max(rates) < sky_rate_e_s_arcsec2(load_instrument(), "F520").rate_e_s_arcsec2


def test_close_to_the_sun_it_is_flagged_not_nan():
    level = sky_rate_e_s_arcsec2(ZODIACAL, "F520", **icrs_at(3.0, 2.0))
    assert level.flags == ("solar_avoidance",)
    assert np.isfinite(level.rate_e_s_arcsec2)
    assert level.rate_e_s_arcsec2 > sky_rate_e_s_arcsec2(ZODIACAL, "F520", **icrs_at(40.0, 2.0)).rate_e_s_arcsec2


def test_brightness_of_extra_light_is_added():
    instrument = load_instrument(
        {"sky": {"earthshine": {"brightness_v_mag_arcsec2": 21.0}, "stray_light": {"brightness_v_mag_arcsec2": 23.5}}}
    )
    level = sky_rate_e_s_arcsec2(instrument, "F720")
    assert set(level.parts) == {"uniform", "earthshine", "stray_light"}
    assert level.parts["earthshine"] == level.parts["uniform"]
    assert level.rate_e_s_arcsec2 == pytest.approx(2.1 * level.parts["uniform"], rel=1e-12)


@pytest.mark.parametrize("missing", ["ra_deg", "dec_deg", "start_utc"])
def test_zodiacal_light_needs_place_and_date(refused, missing):
    given = {"ra_deg": 10.0, "dec_deg": 10.0, "start_utc": DATE} | {missing: None}
    refused(f"{missing} = missing", sky_rate_e_s_arcsec2, ZODIACAL, "F520", **given)


@pytest.mark.parametrize(("key", "value"), [("ra_deg", 400.0), ("dec_deg", float("nan")), ("start_utc", "someday")])
def test_bad_places_are_refused(key, value):
    with pytest.raises(InputError, match=key):
        sky_rate_e_s_arcsec2(ZODIACAL, "F520", **({"ra_deg": 10.0, "dec_deg": 10.0, "start_utc": DATE} | {key: value}))


def test_unknown_bands_are_refused(refused):
    refused("band = F999", sky_rate_e_s_arcsec2, ZODIACAL, "F999", **icrs_at(90, 0))
