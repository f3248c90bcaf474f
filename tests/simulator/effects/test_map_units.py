import warnings

import pytest

from catalogs.errors import InputError
from simulator.effects.map_units import unit_factor

PER_SECOND = [
    "electron/s",
    "electron s-1",
    "electron.s-1",
    "electron s**-1",
    "electron s^-1",
    "electron s-1 pix-1",
    "electron / (s pix)",
    "electron / s / pixel",
    "electron/(pixel s)",
    "electrons/s",
    "e-/s",
    "e- s-1",
    "e s-1",
    "e-/px/s",
    "e-/pix/s/frame",
    "E-/S",
    " Electron / s ",
]


@pytest.mark.parametrize("text", PER_SECOND)
def test_spellings_of_a_rate(text):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert unit_factor("map", "a.fits", {"BUNIT": text}, "electron/s") == 1.0


@pytest.mark.parametrize(
    ("text", "unit", "factor"),
    [
        ("electron/min", "electron/s", 1 / 60),
        ("e-/h/pix", "electron/s", 1 / 3600),
        ("e- ms-1", "electron/s", 1000.0),
        ("electron", "electron", 1.0),
        ("e-/pix/frame", "electron", 1.0),
        ("electron pix-1 frame-1", "electron", 1.0),
        ("ADU", "adu", 1.0),
        ("DN/pixel", "adu", 1.0),
        ("relative", "", 1.0),
        ("1", "", 1.0),
        ("", "", 1.0),
        ("%", "", 0.01),
    ],
)
def test_factors(text, unit, factor):
    assert unit_factor("map", "a.fits", {"BUNIT": text}, unit) == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "allowed"),
    [
        ("electron", "electron/s", r"electron/s or electron/\(s pix\)"),
        ("adu/s", "electron/s", "electron/s"),
        ("electron/(s arcsec2)", "electron/s", "electron/s"),
        ("electron/electron/s", "electron/s", "electron/s"),
        ("furlong per fortnight", "electron/s", "electron/s"),
        ("((", "electron/s", "electron/s"),
        ("electron/s", "electron", "electron or electron/pix"),
        ("electron", "adu", "adu or adu/pix"),
        ("adu", "", "no unit"),
    ],
)
def test_other_units_are_refused_with_the_one_found_and_those_accepted(text, unit, allowed):
    with pytest.raises(InputError, match=rf"map BUNIT = .*allowed: .*{allowed}.*a\.fits") as refused:
        unit_factor("map", "a.fits", {"BUNIT": text}, unit)
    assert refused.value.value == text


def test_a_missing_unit(refused):
    refused("map BUNIT = missing.*electron/s", unit_factor, "map", "a.fits", {}, "electron/s")
    assert unit_factor("map", "a.fits", {}, "", required=False) == 1.0
