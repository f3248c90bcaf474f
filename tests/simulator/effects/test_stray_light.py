""""""

import warnings

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError
from simulator.config import load_instrument
from simulator.effects import effect_files, stray_light_map, stray_light_parts, unit_factor

SHAPE = (12, 15)


def write(path, data, unit="electron/s", extension=False):
    hdus = [fits.PrimaryHDU(None if extension else data)] + ([fits.ImageHDU(data)] if extension else [])
    if unit is not None:
        hdus[-1].header["BUNIT"] = unit
    fits.HDUList(hdus).writeto(path)
    return str(path)


def instrument_with(**sky):
    return load_instrument({"sky": sky})


def test_nothing_set_is_none():
    assert stray_light_map(load_instrument(), "F520", SHAPE) is None
    assert stray_light_map(instrument_with(earthshine={"brightness_v_mag_arcsec2": 22.0}), "F520", SHAPE) is None
    assert effect_files(load_instrument(), "F520") == []


def test_numbers_and_maps_add_up(tmp_path):
    values = np.arange(180.0).reshape(SHAPE)
    path = write(tmp_path / "glow.fits", values.astype(np.float32), extension=True)
    instrument = instrument_with(earthshine={"rate_e_s": 0.25}, stray_light={"map_file": path})
    np.testing.assert_allclose(stray_light_map(instrument, "F520", SHAPE), values + 0.25)
    assert effect_files(instrument, "F520") == ["glow.fits"]
    constant = stray_light_map(instrument_with(stray_light={"rate_e_s": 3.0}), "F1265", (4, 5))
    np.testing.assert_array_equal(constant, np.full((4, 5), 3.0))


def test_maps_by_band(refused, tmp_path):
    files = {
        band: write(tmp_path / f"{band}.fits", np.full(SHAPE, rate)) for band, rate in (("F520", 1.0), ("F850", 2.0))
    }
    instrument = instrument_with(stray_light={"map_file": files})
    assert stray_light_map(instrument, "F850", SHAPE)[3, 4] == 2.0
    assert effect_files(instrument, "F520") == ["F520.fits"]
    refused(r"map_file = no map of F662.*F520, F850", stray_light_map, instrument, "F662", SHAPE)


def test_files_beside_the_instrument_are_found(tmp_path, monkeypatch):
    write(tmp_path / "one.fits", np.ones(SHAPE))
    np.savez(tmp_path / "tracks.npz", templates=np.ones((1, 3, 3)), pixel_um=13.0)
    path = tmp_path / "mine.yaml"
    path.write_text(
        "sky: {earthshine: {map_file: one.fits}, stray_light: {map_file: {F520: one.fits}}}\n"
        "cosmic_rays: {model: template, template: {template_file: tracks.npz}}\n"
    )
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    instrument = load_instrument(path)
    np.testing.assert_array_equal(stray_light_map(instrument, "F520", SHAPE), np.full(SHAPE, 2.0))
    assert effect_files(instrument, "F520") == ["tracks.npz", "one.fits", "one.fits"]


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("electron/s", 1),
        ("e-/px/s", 1),
        ("electron s-1", 1),
        ("electron / (s pix)", 1),
        ("electron/min", 1 / 60),
        ("electron / (h pix)", 1 / 3600),
    ],
)
def test_units_are_converted(tmp_path, unit, factor):
    path = write(tmp_path / "a.fits", np.full(SHAPE, 36.0), unit)
    found = stray_light_map(instrument_with(stray_light={"map_file": path}), "F520", SHAPE)
    np.testing.assert_allclose(found, 36.0 * factor)


@pytest.mark.parametrize(
    ("data", "unit", "words"),
    [
        (np.ones(SHAPE), None, "BUNIT = missing.*electron/s"),
        (np.ones(SHAPE), "adu/s", "BUNIT = adu/s"),
        (np.ones(SHAPE), "electron", "BUNIT = electron"),
        (np.ones(SHAPE), "furlong per fortnight", "BUNIT"),
        (np.ones(SHAPE[::-1]), "electron/s", "12 rows x 15 columns.*it has 15 x 12"),
        (np.ones((2, *SHAPE)), "electron/s", "cube"),
        (np.where(np.eye(*SHAPE) > 0, np.nan, 1.0), "electron/s", "12 are not"),
        (np.where(np.eye(*SHAPE) > 0, -0.5, 1.0), "electron/s", "row 0, column 0 holds -0.5"),
    ],
)
def test_bad_maps_are_refused(tmp_path, data, unit, words):
    path = write(tmp_path / "a.fits", data, unit)
    with pytest.raises(InputError, match=f"sky.stray_light.map_file.*{words}"):
        stray_light_map(instrument_with(stray_light={"map_file": path}), "F520", SHAPE)


def test_other_files_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", map=np.ones(SHAPE))
    (tmp_path / "text.fits").write_text("SIMPLE")
    for name in ("a.npz", "text.fits", "missing.fits"):
        with pytest.raises(InputError, match="sky.earthshine.map_file"):
            stray_light_map(instrument_with(earthshine={"map_file": str(tmp_path / name)}), "F520", SHAPE)


def test_unknown_bands_are_refused(refused):
    refused("band = F999", stray_light_map, load_instrument(), "F999", SHAPE)


def test_a_window_is_cut_from_the_map_of_the_frame(tmp_path):
    values = np.arange(180.0).reshape(SHAPE)
    path = write(tmp_path / "glow.fits", values)
    instrument = instrument_with(earthshine={"rate_e_s": 0.25}, stray_light={"map_file": path})
    parts = stray_light_parts(instrument, "F520", SHAPE, first_pixel=(3, 5), window=(4, 6))
    np.testing.assert_array_equal(parts["stray_light"], values[3:7, 5:11])
    np.testing.assert_array_equal(parts["earthshine"], np.full((4, 6), 0.25))
    assert list(parts) == ["earthshine", "stray_light"]
    for first in ((-2, 12), (10, -3), (20, 0), (-9, -9)):
        around = np.pad(values, 20)[first[0] + 20 : first[0] + 24, first[1] + 20 : first[1] + 26]
        parts = stray_light_parts(instrument, "F520", SHAPE, first_pixel=first, window=(4, 6))
        np.testing.assert_array_equal(parts["stray_light"], around)
    assert stray_light_parts(load_instrument(), "F520", SHAPE) == {}


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
