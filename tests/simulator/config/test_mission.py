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
        ("2028-02-29", "2028-02-29T00:00:00"),
    ],
)
def test_times_are_read_in_the_usual_spellings(given, meant):
    assert checked_utc("start_utc", given) == meant


@pytest.mark.parametrize(
    "given",
    ["", "today", "2027-02-29", "2028-13-01", "2028-01-01T24:00:00", "2028-01-01T00:60:00", "2028-01-01T00:00:60",
     "1971-12-31", "2101-01-01", "28-01-01", "2028-01-01T00:00:00+08:00", 20280101, None],
)  # fmt: skip
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
