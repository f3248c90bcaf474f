from datetime import UTC, datetime

import pytest

from catalogs.errors import InputError
from simulator.effects.dates import days_since_j2000, decimal_year, parse_utc


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2028-01-01", datetime(2028, 1, 1, tzinfo=UTC)),
        ("2028-01-01T12:30:00", datetime(2028, 1, 1, 12, 30, tzinfo=UTC)),
        ("2028-01-01T12:30:00Z", datetime(2028, 1, 1, 12, 30, tzinfo=UTC)),
        (" 2028-01-01T08:00:00+08:00 ", datetime(2028, 1, 1, tzinfo=UTC)),
    ],
)
def test_dates_are_utc(text, expected):
    assert parse_utc("start_utc", text) == expected


def test_decimal_years():
    assert decimal_year("when", "2028-07-02") == pytest.approx(2028.5, abs=1e-3)  # a leap year
    assert decimal_year("when", "2027-07-02T12:00:00") == pytest.approx(2027.5, abs=1e-9)
    assert decimal_year("when", 2019.96) == 2019.96
    assert decimal_year("when", 2100) == 2100.0


@pytest.mark.parametrize("value", ["", "tomorrow", "2028-13-01", "1949-12-31", "2100-01-01", None, 5, float("nan")])
def test_bad_dates_are_refused(value):
    with pytest.raises(InputError, match="start_utc"):
        parse_utc("start_utc", value)


@pytest.mark.parametrize("value", ["2028-02-30", 1900, 2100.5, float("nan"), True, None, [2028.0]])
def test_bad_years_are_refused(value):
    with pytest.raises(InputError, match="when"):
        decimal_year("when", value)


def test_days_since_j2000():
    assert days_since_j2000(parse_utc("x", "2000-01-01T12:00:00")) == 0.0
    assert days_since_j2000(parse_utc("x", "2099-12-31T12:00:00")) == 36524.0
