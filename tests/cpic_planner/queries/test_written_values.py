"""Values of the command line: units are converted exactly, and what could be read both ways is not guessed."""

import pytest
from astropy import units as u
from hypothesis import given, strategies as st

from cpic_planner.queries import read_value, two_spellings, with_unit

CONVERTED = [
    ("0.1nm", "nm", 0.1),
    ("100pm", "nm", 0.1),
    ("1e-4 um", "nm", 0.1),
    ("1e-4µm", "nm", 0.1),
    ("2h", "s", 7200.0),
    ("90min", "h", 1.5),
    ("36 hours", "d", 1.5),
    ("350mas", "arcsec", 0.35),
    ("0.35arcsec", "mas", 350.0),
    ("30arcmin", "deg", 0.5),
    ("160e-", "e-", 160.0),
    ("160 e", "e-", 160.0),
    ("3zodi", "zodi", 3.0),
    ("5%", "", 0.05),
    ("0.2pm/sqrt(h)", "nm/sqrt(h)", 0.0002),
    ("0nm", "nm", 0.0),
    ("7mag", "mag", 7.0),
    ("-1.5e1s", "min", -0.25),
]


@pytest.mark.parametrize(("text", "unit", "value"), CONVERTED)
def test_units_are_converted_exactly(text, unit, value):
    found = read_value("key", text, unit)
    assert (found.action, found.value, found.bare) == ("set", value, False)
    assert type(found.value) is float


@given(value=st.floats(1e-6, 1e6), pair=st.sampled_from([("pm", "nm"), ("min", "h"), ("mas", "arcsec"), ("d", "s")]))
def test_conversions_are_those_of_astropy(value, pair):
    given_unit, unit = pair
    expected = (value * u.Unit(given_unit)).to_value(unit)
    assert read_value("key", f"{value!r}{given_unit}", unit).value == pytest.approx(expected, rel=1e-14)


def test_numbers_without_unit_words_and_lists():
    bare = read_value("time_s", "3600", "s")
    assert (bare.value, bare.text, bare.bare) == (3600, "3600 s", True)
    assert read_value("contrast", "1e-8").text == "1e-8"
    assert read_value("rule", "blind").value == "blind"
    assert read_value("names", "61 Cyg A").value == "61 Cyg A"
    assert read_value("stop", "null").value is None
    assert read_value("stop", "true").bare is False
    assert read_value("time_s", "[60,2min]", "s").value == [60, 120.0]


@pytest.mark.parametrize("text", ["x0.7", "*0.7", "×0.7", "x 0.7", " x0.7 "])
def test_factors(text):
    found = read_value("key", text, "nm")
    assert (found.action, found.value, found.text, found.bare) == ("scale", 0.7, "x0.7", False)


@pytest.mark.parametrize("text", ["x-1", "x.nan", "x0,7", "x2nm"])
def test_factors_that_are_none(refused, text):
    refused("a factor on the present value", read_value, "key", text, "nm")


@pytest.mark.parametrize(
    ("text", "unit", "units"),
    [
        ("1mas", "nm", "pm, nm, um, mm, cm, m, km"),
        ("1nm", "nm/sqrt(h)", "pm/sqrt"),
        ("5%", "nm", "pm"),
        ("1h", "e-", "e-"),
        ("3 wild", "s", "s, min, h, d"),
    ],
)
def test_units_of_another_kind_are_refused(refused, text, unit, units):
    message = refused("", read_value, "key", text, unit)
    assert message.startswith(f"key = {text}: not accepted; allowed: a number with a unit: {units}")


def test_both_spellings_say_what_they_mean():
    assert str(two_spellings("--vary drift", "drift", "0.1", unit="nm", present=0.05)) == (
        "--vary drift = 0.1: not accepted; allowed: a unit (nm), or an x before a factor (drift=x0.1 is 0.1 times the "
        "instrument's 0.05 nm: 0.005 nm; drift=0.1nm is 0.1 nm)"
    )
    unknown = str(two_spellings("qe", "qe", "0.5", unit="", value_key="bands.*.qe"))
    assert "(qe=x0.5 is 0.5 times the instrument's; bands.*.qe=0.5 is the value itself)" in unknown
    assert with_unit("5", "") == "5"
