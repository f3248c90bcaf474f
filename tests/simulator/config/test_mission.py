import pytest

from catalogs.errors import InputError
from simulator import load_instrument
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


@pytest.mark.parametrize(
    "given",
    [
        "",
        "today",
        "2027-02-29",
        "2028-13-01",
        "2028-01-01T24:00:00",
        "2028-01-01T00:60:00",
        "2028-01-01T00:00:60",
        "2015-12-31T23:59:60",
        "2016-12-31T22:59:60",
        "2016-12-31T23:59:61",
        "2016-12-30T23:59:60",
        "2028-06-30T23:59:60",
        "2100-12-31T23:59:60",
        "1971-12-31T23:59:60",
        "1971-12-31",
        "2101-01-01",
        "28-01-01",
        "2028-01-01T00:00:00+08:00",
        20280101,
        None,
    ],
)
def test_what_is_no_time_is_refused_by_name(given):
    with pytest.raises(InputError, match="start_utc") as refused:
        checked_utc("start_utc", given)
    assert "UTC" in str(refused.value)
    assert "1972 to 2100" in str(refused.value)


@pytest.mark.parametrize(
    ("mission", "words"),
    [
        ({"start_utc": "soon"}, ("instrument.mission.start_utc", "soon")),
        ({"orbit": {"epoch_utc": "2028-02-30"}}, ("instrument.mission.orbit.epoch_utc", "2028-02-30")),
        ({"orbit": {"altitude_km": 10}}, ("instrument.mission.orbit.altitude_km = 10", "200 to 2000")),
        ({"obsid_prefix": "x"}, ("instrument.mission.obsid_prefix", "x")),
        ({"product_version": 100}, ("instrument.mission.product_version = 100", "1 to 99")),
    ],
)
def test_bad_values_are_refused_by_name(mission, words):
    with pytest.raises(InputError) as refused:
        load_instrument({"mission": mission})
    assert all(word in str(refused.value) for word in words), str(refused.value)


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
