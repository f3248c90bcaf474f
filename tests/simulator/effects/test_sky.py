"""Sky rates: the uniform sky of the paper, zodiacal light end to end, of a date and as the median of a year.

The closed forms against astropy.

Zodiacal light against the published numbers of Leinert et al. 1998.
"""

from datetime import UTC, datetime

import numpy as np
import pytest
from astropy import constants, units
from astropy.coordinates import BarycentricMeanEcliptic, GeocentricMeanEcliptic, SkyCoord, get_sun
from astropy.time import Time

from catalogs import HC_ERG_ANGSTROM, load_reference_spectrum, load_zodi_table
from cpic_core import InputError
from simulator.config import load_instrument
from simulator.effects import ecliptic_deg, sky_rate_e_s_arcsec2, sky_rates_e_s_arcsec2
from simulator.effects.sky import (
    colour_factor,
    days_since_j2000,
    decimal_year,
    elongation_deg,
    parse_utc,
    sun_longitude_deg,
    zodiacal_photlam_arcsec2,
    zodiacal_radiance,
)
from simulator.passbands import Passbands, v_photon_rate, vega_v_photon_rate

DATE = "2028-03-03T06:00:00"
UNIFORM = load_instrument({"sky": {"model": "uniform"}})
MEDIAN = load_instrument({"sky": {"earthshine": {"brightness_v_mag_arcsec2": None}}})
DATED = MEDIAN.changed({"sky": {"season": "date"}})


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
    instrument = UNIFORM
    passbands = Passbands.from_instrument(instrument)
    expected = passbands.sky_rate_e_s_arcsec2(21.0, instrument.telescope.area_cm2)
    for band, rate in zip(passbands.names, expected, strict=True):
        level = sky_rate_e_s_arcsec2(instrument, band)
        assert level.rate_e_s_arcsec2 == rate
        assert level.parts == {"uniform": rate}
        assert level.flags == ()


@pytest.mark.parametrize(
    ("longitude", "latitude", "radiance"), [(180, 0, 230e-8), (90, 0, 259e-8), (-60, 45, 134e-8), (0, 90, 77e-8)]
)
@pytest.mark.parametrize("band", ["F520", "F850", "F1265"])
def test_zodiacal_rate_by_brute_force(longitude, latitude, radiance, band):
    level = sky_rate_e_s_arcsec2(DATED, band, **icrs_at(longitude, latitude))
    # The table, the colour and the photon count anew, with units.
    configuration = DATED.bands[band]
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
    expected = detected * DATED.telescope.area_cm2
    assert level.rate_e_s_arcsec2 == pytest.approx(expected, rel=3e-3)
    assert level.parts == {"zodiacal": level.rate_e_s_arcsec2}
    assert level.flags == ()


def test_zodiacal_light_changes_with_the_season():
    star = {"ra_deg": "14:39:36.5", "dec_deg": "-60:50:02"}
    rates = [
        sky_rate_e_s_arcsec2(DATED, "F520", **star, start_utc=f"2028-{month:02d}-01").rate_e_s_arcsec2
        for month in range(1, 13)
    ]
    assert 1.3 < max(rates) / min(rates) < 4.0
    # The uniform sky is brighter than all of them.
    assert max(rates) < sky_rate_e_s_arcsec2(UNIFORM, "F520").rate_e_s_arcsec2


def test_close_to_the_sun_it_is_flagged_not_nan():
    level = sky_rate_e_s_arcsec2(DATED, "F520", **icrs_at(3.0, 2.0))
    assert level.flags == ("solar_avoidance",)
    assert np.isfinite(level.rate_e_s_arcsec2)
    assert level.rate_e_s_arcsec2 > sky_rate_e_s_arcsec2(DATED, "F520", **icrs_at(40.0, 2.0)).rate_e_s_arcsec2


def test_brightness_of_extra_light_is_added():
    instrument = UNIFORM.changed(
        {"sky": {"earthshine": {"brightness_v_mag_arcsec2": 21.0}, "stray_light": {"brightness_v_mag_arcsec2": 23.5}}}
    )
    level = sky_rate_e_s_arcsec2(instrument, "F720")
    assert set(level.parts) == {"uniform", "earthshine", "stray_light"}
    assert level.parts["earthshine"] == level.parts["uniform"]
    assert level.rate_e_s_arcsec2 == pytest.approx(2.1 * level.parts["uniform"], rel=1e-12)


@pytest.mark.parametrize("missing", ["ra_deg", "dec_deg", "start_utc"])
def test_light_of_a_date_needs_place_and_date(refused, missing):
    given = {"ra_deg": 10.0, "dec_deg": 10.0, "start_utc": DATE} | {missing: None}
    refused(f"{missing} = missing", sky_rate_e_s_arcsec2, DATED, "F520", **given)


@pytest.mark.parametrize(
    ("latitude", "band"),
    [(place, "F520") for place in (0.0, 22.2, -41.7, 88.0)]
    + [pytest.param(place, "F520", marks=pytest.mark.long) for place in (7.3, -15.0, 30.0, 49.6, 55.0, -70.0)]
    + [(7.3, "F850"), *(pytest.param(place, "F850", marks=pytest.mark.long) for place in (-41.7, 88.0))],
    # The band is a factor on all days alike.
)
def test_median_of_the_season_by_brute_force(latitude, band):
    """Every day of a year, with the Sun of astropy; its uneven speed, left out by the table, is 1.2 % at most."""
    place = SkyCoord(123.0 * units.deg, latitude * units.deg, frame=BarycentricMeanEcliptic(equinox="J2000")).icrs
    days = Time("2027-03-01") + np.arange(365.0) * units.day
    sun = get_sun(days).cartesian.xyz  # towards it, in the axes of the ICRS
    cosine = (place.cartesian.xyz.value @ sun.value) / np.linalg.norm(sun.value, axis=0)
    seen = np.rad2deg(np.arccos(cosine)) >= 50.0
    star = {"ra_deg": place.ra.deg, "dec_deg": place.dec.deg}
    of_days = [sky_rate_e_s_arcsec2(DATED, band, **star, start_utc=day.isot).rate_e_s_arcsec2 for day in days[seen]]
    level = sky_rate_e_s_arcsec2(MEDIAN, band, **star)
    assert level.rate_e_s_arcsec2 == pytest.approx(np.median(of_days), rel=0.013)
    assert level.parts == {"zodiacal": level.rate_e_s_arcsec2}
    assert level.flags == ()
    assert sky_rate_e_s_arcsec2(MEDIAN, band, **star, start_utc=DATE) == level  # whatever the date


def test_median_over_the_whole_sky_stands_in_for_an_unknown_place(rng):
    """Half of an even sample of the sky is brighter than the light for a star without coordinates."""
    ra, dec = 360.0 * rng.random(20000), np.rad2deg(np.arcsin(2.0 * rng.random(20000) - 1.0))
    everywhere = sky_rates_e_s_arcsec2(MEDIAN, "F662", ra, dec)
    for place in ({}, {"ra_deg": 10.0}, {"dec_deg": -20.0}):
        level = sky_rate_e_s_arcsec2(MEDIAN, "F662", **place)
        assert level.rate_e_s_arcsec2 == pytest.approx(np.median(everywhere), rel=5e-3)
        assert level.flags == ("sky_place_unknown",)
    assert sky_rate_e_s_arcsec2(UNIFORM, "F662").flags == ()


@pytest.mark.parametrize("instrument", [UNIFORM, MEDIAN, DATED, load_instrument()])
def test_many_places_at_once_are_the_same_one_by_one(instrument, rng):
    ra, dec = 360.0 * rng.random(20), np.rad2deg(np.arcsin(2.0 * rng.random(20) - 1.0))
    together = sky_rates_e_s_arcsec2(instrument, "F850", ra, dec, DATE)
    for place, rate in zip(zip(ra, dec, strict=True), together, strict=True):
        alone = sky_rate_e_s_arcsec2(instrument, "F850", ra_deg=place[0], dec_deg=place[1], start_utc=DATE)
        assert rate == pytest.approx(alone.rate_e_s_arcsec2, rel=1e-12)


def test_a_farther_limit_from_the_sun_darkens_the_median():
    rates = [
        sky_rate_e_s_arcsec2(MEDIAN.changed({"sky": {"sun_limit_deg": limit}}), "F520", ra_deg=0.0, dec_deg=0.0)
        for limit in (0.0, 50.0, 90.0)
    ]
    assert rates[0].rate_e_s_arcsec2 > rates[1].rate_e_s_arcsec2 > rates[2].rate_e_s_arcsec2


def test_default_sky_in_magnitudes():
    """Darkest at the poles, 23.3, and 22.2 on the ecliptic (60 and 165 tenth-magnitude stars a square degree)."""
    instrument = load_instrument()
    assert (instrument.sky.model, instrument.sky.season) == ("zodiacal", "median")
    one = sky_rate_e_s_arcsec2(UNIFORM, "F520").rate_e_s_arcsec2  # 21 mag
    for star, expected in (((270.0, 66.56), 23.28), ((0.0, 0.0), 22.19)):
        parts = sky_rate_e_s_arcsec2(instrument, "F520", ra_deg=star[0], dec_deg=star[1]).parts
        assert 21.0 - 2.5 * np.log10(parts["zodiacal"] / one) == pytest.approx(expected, abs=0.03)
        assert 21.0 - 2.5 * np.log10(parts["earthshine"] / one) == pytest.approx(24.3, abs=1e-9)


@pytest.mark.parametrize(("key", "value"), [("ra_deg", 400.0), ("dec_deg", float("nan")), ("start_utc", "someday")])
def test_bad_places_are_refused(key, value):
    with pytest.raises(InputError, match=key):
        sky_rate_e_s_arcsec2(DATED, "F520", **({"ra_deg": 10.0, "dec_deg": 10.0, "start_utc": DATE} | {key: value}))


def test_unknown_bands_are_refused(refused):
    refused("band = F999", sky_rate_e_s_arcsec2, DATED, "F999", **icrs_at(90, 0))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2028-01-01", datetime(2028, 1, 1, tzinfo=UTC)),
        ("2028-01-01T12:30:00", datetime(2028, 1, 1, 12, 30, tzinfo=UTC)),
        ("2028-01-01T12:30:00Z", datetime(2028, 1, 1, 12, 30, tzinfo=UTC)),
        (" 2028-01-01T08:00:00+08:00 ", datetime(2028, 1, 1, tzinfo=UTC)),
        ("2016-12-31T23:59:60", datetime(2017, 1, 1, tzinfo=UTC)),
        ("2016-12-31T23:59:60.123456789Z", datetime(2017, 1, 1, 0, 0, 0, 123456, tzinfo=UTC)),
        ("2100-06-01", datetime(2100, 6, 1, tzinfo=UTC)),
    ],
)
def test_dates_are_utc(text, expected):
    assert parse_utc("start_utc", text) == expected


def test_decimal_years():
    assert decimal_year("when", "2028-07-02") == pytest.approx(2028.5, abs=1e-3)  # a leap year
    assert decimal_year("when", "2027-07-02T12:00:00") == pytest.approx(2027.5, abs=1e-9)
    assert decimal_year("when", 2019.96) == 2019.96
    assert decimal_year("when", 2100) == decimal_year("when", "2100-01-01") == 2100.0
    assert decimal_year("when", "2016-12-31T23:59:60") == 2017.0


@pytest.mark.parametrize("text", ["1972-01-01", "2016-12-31T23:59:60", "2100-12-31T23:59:59"])
def test_every_begin_of_an_observation_has_a_place_of_the_sun_and_a_rate(text):
    """One range for begins of observations, sky and cosmic rays."""
    from simulator import load_instrument
    from simulator.config import checked_utc
    from simulator.effects import cosmic_ray_rate

    assert checked_utc("start_utc", text).startswith(text[:10])
    assert 0 < cosmic_ray_rate(load_instrument().cosmic_rays, text) <= 1
    assert abs(days_since_j2000(parse_utc("start_utc", text))) < 40000


def test_days_since_j2000():
    assert days_since_j2000(parse_utc("x", "2000-01-01T12:00:00")) == 0.0
    assert days_since_j2000(parse_utc("x", "2099-12-31T12:00:00")) == 36524.0


@pytest.mark.parametrize("year", [1972, 1976, 2000, 2028, 2061, 2099])
def test_sun_is_within_an_arcminute(year):
    for month in range(1, 13):
        text = f"{year}-{month:02d}-{2 * month:02d}T0{month % 8}:30:00"
        when = Time(text, scale="tdb")  # a minute from UTC: 0.05 arcmin
        there = get_sun(when).transform_to(GeocentricMeanEcliptic(equinox="J2000", obstime=when))
        off = (sun_longitude_deg(parse_utc("when", text)) - there.lon.deg + 180.0) % 360.0 - 180.0
        assert abs(off) < 1.0 / 60.0
        assert abs(there.lat.deg) < 0.02  # the plane of J2000 stands in for that of date


def test_ecliptic_coordinates(rng):
    ra, dec = 360.0 * rng.random(200), np.rad2deg(np.arcsin(2 * rng.random(200) - 1))
    there = SkyCoord(ra, dec, unit="deg").transform_to(BarycentricMeanEcliptic(equinox="J2000"))
    ours = np.array([ecliptic_deg(*place) for place in zip(ra, dec, strict=True)])
    assert np.abs((ours[:, 0] - there.lon.deg + 180) % 360 - 180).max() < 1e-3 / np.cos(np.deg2rad(there.lat.deg)).min()
    assert np.abs(ours[:, 1] - there.lat.deg).max() < 1e-4


def test_elongation():
    assert elongation_deg(0.0, 0.0) == 0.0
    assert elongation_deg(180.0, 0.0) == pytest.approx(180.0)
    assert elongation_deg(77.0, 90.0) == pytest.approx(90.0)
    assert elongation_deg(-60.0, 0.0) == pytest.approx(60.0)


S10_W_M2_SR_UM = 1.28e-8  # table 2: a tenth-magnitude solar star per square degree, at 500 nm
ARCSEC2_PER_SR = (180 * 3600 / np.pi) ** 2


@pytest.mark.parametrize(
    ("longitude", "magnitudes"),
    # WFC3 handbook, table 9.4: V at latitudes 0, 15, 30, 45, 60, 75 and 90 degrees, to a tenth.
    [
        (60, (21.3, 21.9, 22.4, 22.7, 23.0, 23.2, 23.3)),
        (90, (22.0, 22.3, 22.7, 23.0, 23.2, 23.3, 23.3)),
        (120, (22.4, 22.6, 22.9, 23.2, 23.3, 23.3, 23.3)),
        (150, (22.4, 22.6, 22.9, 23.1, 23.3, 23.4, 23.3)),
    ],
)
def test_brightness_in_v_is_that_of_hubbles_table(longitude, magnitudes):
    for latitude, expected in zip(np.arange(0.0, 91.0, 15.0), magnitudes, strict=True):
        radiance, _ = zodiacal_radiance(longitude, latitude)
        spectrum = zodiacal_photlam_arcsec2(float(radiance), float(elongation_deg(longitude, latitude)))
        v = -2.5 * np.log10(v_photon_rate(spectrum.wavelength_nm, spectrum.photlam) / vega_v_photon_rate())
        assert v == pytest.approx(expected, abs=0.13)


def test_table_is_returned_at_its_own_places():
    table = load_zodi_table()
    for i, longitude in enumerate(table.helioecliptic_longitude_deg):
        for j, latitude in enumerate(table.ecliptic_latitude_deg):
            expected = table.radiance_500nm_w_m2_sr_um[i, j]
            for sign in (1, -1):
                found = zodiacal_radiance(sign * longitude + 360.0, -sign * latitude)
                assert found.solar_avoidance == np.isnan(expected)
                if np.isfinite(expected):
                    assert found.radiance_500nm_w_m2_sr_um == pytest.approx(expected, rel=1e-12)


def test_between_cells_the_logarithm_is_linear():
    low, high = (zodiacal_radiance(x, 0.0).radiance_500nm_w_m2_sr_um for x in (15.0, 20.0))
    assert zodiacal_radiance(17.5, 0.0).radiance_500nm_w_m2_sr_um == pytest.approx(np.sqrt(low * high), rel=1e-12)


def test_all_over_the_sky_it_is_finite_and_falls_away_from_the_sun(rng):
    for longitude, latitude in zip(720 * rng.random(500) - 360, 180 * rng.random(500) - 90, strict=True):
        assert 60e-8 < zodiacal_radiance(longitude, latitude).radiance_500nm_w_m2_sr_um <= 11500e-8
    along = [zodiacal_radiance(x, 0.0).radiance_500nm_w_m2_sr_um for x in np.linspace(0, 135, 200)]
    assert np.all(np.diff(along) <= 1e-20)


def test_around_the_sun_a_lower_limit_is_flagged():
    for longitude, latitude in ((0, 0), (14.9, 0), (-5, 9), (0, 14.9), (10, 9.9)):
        found = zodiacal_radiance(longitude, latitude)
        assert found.solar_avoidance
        assert found.radiance_500nm_w_m2_sr_um >= 3140e-8
    assert not zodiacal_radiance(15.0, 0.0).solar_avoidance
    assert not zodiacal_radiance(0.0, 15.0).solar_avoidance


def test_colour_factor():
    # Leinert et al. 1998, eq. 22.
    for elongation, below, above in ((30, 1.2, 0.8), (10, 1.2, 0.8), (90, 0.9, 0.6), (150, 0.9, 0.6), (60, 1.05, 0.7)):
        assert colour_factor(500.0, elongation) == 1.0
        assert colour_factor(400.0, elongation) == pytest.approx(1 + below * np.log10(0.8))
        assert colour_factor(1000.0, elongation) == pytest.approx(1 + above * np.log10(2.0))


@pytest.mark.parametrize("wavelength_um", [0.5, 0.7, 0.9, 1.0, 1.2])
def test_spectrum_agrees_with_the_published_one(wavelength_um):
    # Table 19, at 90 degrees from the Sun in the ecliptic, is another source than the colour factor; two digits.
    table = load_zodi_table()
    spectrum = zodiacal_photlam_arcsec2(259e-8, 90.0)
    chosen = np.abs(spectrum.wavelength_nm / (1000 * wavelength_um) - 1) < 0.03
    erg = (spectrum.photlam * HC_ERG_ANGSTROM / (10 * spectrum.wavelength_nm))[chosen].mean()
    radiance = erg * 10.0 * ARCSEC2_PER_SR  # erg/s/cm2/A/arcsec2 to W/m2/um/sr
    expected = table.spectrum_radiance_w_m2_sr_um[np.isclose(table.spectrum_wavelength_um, wavelength_um)][0]
    assert radiance == pytest.approx(expected, rel=0.08)
