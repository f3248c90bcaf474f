from datetime import UTC, datetime

import pytest

from simulator.effects.dates import days_since_j2000, decimal_year, parse_utc


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
    from simulator.config.mission import checked_utc
    from simulator.effects import cosmic_ray_rate

    assert checked_utc("start_utc", text).startswith(text[:10])
    assert 0 < cosmic_ray_rate(load_instrument().cosmic_rays, text) <= 1
    assert abs(days_since_j2000(parse_utc("start_utc", text))) < 40000


def test_days_since_j2000():
    assert days_since_j2000(parse_utc("x", "2000-01-01T12:00:00")) == 0.0
    assert days_since_j2000(parse_utc("x", "2099-12-31T12:00:00")) == 36524.0
