import pytest

from catalogs.errors import InputError
from simulator.config.mission import checked_utc


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("2028-01-02", "2028-01-02T00:00:00"),
        ("2028-01-02T03:04", "2028-01-02T03:04:00"),
        ("2028-01-02 03:04:05.25Z", "2028-01-02T03:04:05.25"),
        ("2016-12-31T23:59:60.5", "2016-12-31T23:59:60.5"),
        ("1972-06-30T23:59:60", "1972-06-30T23:59:60"),
        ("2028-02-29", "2028-02-29T00:00:00"),
        ("2100-12-31T23:59:59.9", "2100-12-31T23:59:59.9"),
    ],
)
def test_times_are_read_in_the_usual_spellings(given, meant):
    assert checked_utc("start_utc", given) == meant


def test_leap_seconds_are_those_of_astropy():
    from astropy.time import Time

    for year in range(1972, 2024):
        for day in ("06-30", "12-31"):
            length = Time(f"{year}-{day}", scale="utc")
            seconds = (Time(length.jd1 + 1.0, length.jd2, format="jd", scale="utc") - length).to_value("s")
            text = f"{year}-{day}T23:59:60.5"
            if round(seconds) == 86401:
                assert checked_utc("start_utc", text) == text
            else:
                with pytest.raises(InputError, match="start_utc"):
                    checked_utc("start_utc", text)
