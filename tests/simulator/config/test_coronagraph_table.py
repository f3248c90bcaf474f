"""A coronagraph as a table: what a file may hold, and what is refused in one line."""

import math
import re

import numpy as np
import pytest

from cpic_core import InputError
from simulator.config import load_instrument, preset_names, shipped_tables
from simulator.config.coronagraph import COLUMNS, coronagraph_table

UNIT = 0.04
FLAT = "separation_arcsec,core_throughput,raw_contrast\n0.1,0.05,1e-9\n0.3,0.05,1e-9\n"


def more(heading, value):
    """The flat table with a further column."""
    return FLAT.replace("raw_contrast\n", f"raw_contrast,{heading}\n").replace("-9\n", f"-9,{value}\n")


def read(tmp_path, text, name="table.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return coronagraph_table(str(path), UNIT)


@pytest.mark.parametrize(
    ("heading", "values", "column", "expected"),
    [
        ("separation_arcsec", (0.1, 0.3), None, (0.1, 0.3)),
        ("separation [mas]", (100, 300), None, (0.1, 0.3)),
        ("Separation (arcsec)", (0.1, 0.3), None, (0.1, 0.3)),
        ("separation_mas", (100, 300), None, (0.1, 0.3)),
        ("separation [lambda/D]", (3, 9), None, (0.12, 0.36)),
        ("Separation (λ/D)", (3, 9), None, (0.12, 0.36)),
        ("separation_lambda_d", (3, 9), None, (0.12, 0.36)),
        ("r_lam_D", (3, 9), None, (0.12, 0.36)),
        ("core area [mas2]", (1000, 2000), "core_area_arcsec2", (0.001, 0.002)),
        ("core_area (lambda/D)^2", (1, 2), "core_area_arcsec2", (UNIT**2, 2 * UNIT**2)),
        ("core_area_lambda_d2", (1, 2), "core_area_arcsec2", (UNIT**2, 2 * UNIT**2)),
        ("area_sq_arcsec", (0.001, 0.002), "core_area_arcsec2", (0.001, 0.002)),
        ("occTrans", (0.3, 0.4), "occulter_transmission", (0.3, 0.4)),
        ("occulter transmission [%]", (30, 40), "occulter_transmission", (0.3, 0.4)),
        ("contrast stability", (1e-10, 2e-10), "contrast_stability", (1e-10, 2e-10)),
    ],
)
def test_columns_are_known_by_names_and_units(tmp_path, heading, values, column, expected):
    text = "core throughput [%],Raw contrast"
    own = "" if column is None else "separation_arcsec,"
    rows = [f"{heading},{own}{text}"]
    places = ("", "") if column is None else ("0.1,", "0.3,")
    rows += [f"{value},{at}5,1e-9" for value, at in zip(values, places, strict=True)]
    found = read(tmp_path, "\n".join(rows))
    np.testing.assert_allclose(found.separation_arcsec if column is None else found.columns[column], expected)
    np.testing.assert_allclose(found.columns["core_throughput"], 0.05)


def test_rows_may_stand_in_any_order_and_between_comments_and_semicolons(tmp_path):
    found = read(tmp_path, "# ours\nseparation_arcsec;core_throughput;raw_contrast\n0,3;0,06;1e-9\n0,1;0,05;1e-8\n")
    np.testing.assert_array_equal(found.separation_arcsec, [0.1, 0.3])
    np.testing.assert_array_equal(found.columns["core_throughput"], [0.05, 0.06])


def test_between_rows_light_is_linear_and_contrast_in_its_logarithm(tmp_path):
    found = read(tmp_path, "separation_arcsec,core_throughput,raw_contrast\n0.1,0.02,1e-8\n0.3,0.06,1e-10\n")
    np.testing.assert_allclose(found.at("core_throughput", [0.05, 0.2, 0.5]), [0.02, 0.04, 0.06])
    np.testing.assert_allclose(found.at("raw_contrast", [0.05, 0.2, 0.5]), [1e-8, 1e-9, 1e-10])


def test_a_column_that_is_not_known_is_left_out_and_said(tmp_path):
    found = read(tmp_path, more("temperature", 5))
    assert "temperature" in found.notes[0]
    assert set(found.columns) == {"core_throughput", "raw_contrast"}


def test_a_file_that_changes_is_read_again(tmp_path):
    first = read(tmp_path, FLAT)
    second = read(tmp_path, FLAT.replace("1e-9", "2.5e-9"))
    assert (first.columns["raw_contrast"][0], second.columns["raw_contrast"][0]) == (1e-9, 2.5e-9)
    assert first.sha256 != second.sha256


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("separation_arcsec,core_throughput\n0.1,0.05\n0.3,0.05\n", "raw_contrast"),
        ("core_throughput,raw_contrast\n0.05,1e-9\n0.05,1e-9\n", "separation_arcsec or separation_lambda_d"),
        (FLAT.replace("0.05", "1.5", 1), "0 to 1"),
        (FLAT.replace("0.05", "-0.1", 1), "0 to 1"),
        (FLAT.replace("0.05", "dark", 1), "a number"),
        (FLAT.replace("0.05", "", 1), "missing"),
        (FLAT.replace("0.05", "nan", 1), "missing"),
        (FLAT.replace("0.05", "0"), "above 0 at one separation"),
        (FLAT.replace("0.3", "0.1"), "every separation once"),
        ("separation_arcsec,core_throughput,raw_contrast\n0.1,0.05,1e-9\n", "at least two separations"),
        (FLAT.replace("separation_arcsec", "separation [kg]"), "unit"),
        (more("contrast_stabilty", 1), "stability"),
        (more("occulter_transmission", 0.01), "at least"),
        (more("separation_lambda_d", 9), "5 %"),
    ],
)
def test_what_is_no_coronagraph_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(InputError, match=said) as refused:
        read(tmp_path, text)
    assert "\n" not in str(refused.value)


HEADS = {
    "cgi_noise": "r_lam_D,r_as,I,contrast,coreThruput,PSFpeak,area_sq_arcsec,occTrans",
    "corgietc": "rlamD,r_as,intensity,core_contrast,core_thruput,core_mean_intensity,core_area,occ_trans",
}
ROMAN = """3.1,0.155,3.46E-12,5.56E-09,0.02448,0.00037,0.00229,0.24636
3.2,0.16,2.87E-12,4.08E-09,0.02792,0.00041,0.00234,0.27775
3.3,0.165,2.38E-12,3.06E-09,0.03062,0.00045,0.00234,0.30486
8.8,0.441,2.06E-12,2.38E-09,0.04367,0.00063,0.00241,0.42515
8.9,0.446,2.11E-12,2.46E-09,0.0435,0.00063,0.00241,0.42293
"""
"""Rows of cgi_noise's CGPERF_HLC_NFB1_190210 (github.com/roman-corgi/cgi_noise, 597dbfb; BSD-3-Clause), of 575 nm."""
ROMAN_UNIT = math.degrees(575e-9 / 2.363) * 3600.0


def roman(tmp_path, head="cgi_noise", unit=ROMAN_UNIT, text=ROMAN, **own):
    """Such a table, with the bytes of another encoding that its comments have."""
    said = "# the latest calculation: it\x92s\xa0ours,,,,,,,\n".encode("latin-1")
    (tmp_path / "CGPERF.csv").write_bytes(f"{HEADS[head]}\n{text}".encode() + said)
    return coronagraph_table(str(tmp_path / "CGPERF.csv"), unit, **own)


@pytest.mark.parametrize("head", HEADS)
def test_tables_of_romans_calculators_are_read_with_contrasts_over_cores(tmp_path, head):
    """Starlight in a core: contrast times peak times its pixels, 0.1 lambda/D wide (``CGI_Noise.json`` of corgietc)."""
    table = roman(tmp_path, head)
    _, at, _, contrast, core, peak, area, sky = np.loadtxt(ROMAN.splitlines(), delimiter=",").T
    np.testing.assert_array_equal(table.separation_arcsec, at)
    for name, values in (("core_throughput", core), ("core_area_arcsec2", area), ("occulter_transmission", sky)):
        np.testing.assert_array_equal(table.columns[name], values)
    starlight = contrast * peak * area / (0.1 * ROMAN_UNIT) ** 2
    np.testing.assert_allclose(table.columns["raw_contrast"] * core, starlight, rtol=1e-12)
    assert set(table.columns) == {"core_throughput", "core_area_arcsec2", "occulter_transmission", "raw_contrast"}
    assert "1.36 to 1.39 times the file's" in table.notes[-1]
    assert "raw_contrast from" in table.origin


@pytest.mark.parametrize(
    ("wavelength_nm", "diameter_m", "is_said"),
    [(575, 2.363, False), (575, 2.4, True), (520, 2.0, True), (520, 2.2, True), (640, 2.4, True)],
)
def test_lambda_d_of_another_diameter_is_derived_and_said(tmp_path, wavelength_nm, diameter_m, is_said):
    """Separations in arcsec are those of the file, whatever the D of its lambda/D."""
    unit = math.degrees(1e-9 * wavelength_nm / diameter_m) * 3600.0
    table = roman(tmp_path, unit=unit, diameter_m=diameter_m)
    np.testing.assert_array_equal(table.separation_arcsec[[0, -1]], [0.155, 0.446])
    notes = [note for note in table.notes if "that of a diameter of" in note]
    assert len(notes) == is_said
    for note in notes:
        derived = float(re.search(r"that of a diameter of (\S+) m in this band", note)[1])
        assert derived == pytest.approx(2.363 * wavelength_nm / 575, rel=4e-3)  # cells have two or three digits
    np.testing.assert_allclose(table.columns["raw_contrast"], roman(tmp_path).columns["raw_contrast"], rtol=1e-2)


def test_the_diameter_of_the_tables_is_a_key(tmp_path):
    """Without separations in arcsec nothing else says it; with them it may not say another."""
    text = FLAT.replace("separation_arcsec", "separation_lambda_d").replace("\n0.", "\n3.")
    (tmp_path / "units.csv").write_text(text, encoding="utf-8")
    for own, factor in (({}, 1.0), ({"diameter_m": 1.6}, 1.25)):
        made = load_instrument({"coronagraph": {"table": str(tmp_path / "units.csv")} | own})
        unit = made.lambda_d_arcsec("F662") * factor
        np.testing.assert_allclose(made.table("F662").separation_arcsec, [3.1 * unit, 3.3 * unit])
    assert roman(tmp_path, diameter_m=2.363, is_stated=True).notes == roman(tmp_path).notes
    with pytest.raises(InputError, match="r_as and r_lam_D.*to 5 %.*leave one of the two out"):
        roman(tmp_path, unit=ROMAN_UNIT * 0.93, diameter_m=2.54, is_stated=True)
    with pytest.raises(InputError, match=r"that of a diameter of 1\.5.* m in this band.*coronagraph\.diameter_m"):
        roman(tmp_path, unit=ROMAN_UNIT / 1.53, diameter_m=2.363 * 1.0)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("0.00037", "1e-10", "PSFpeak = 1e-10.*give raw_contrast instead"),
        ("0.02448", "0", "PSFpeak.*at least three rows"),
        ("0.441", "0.55", "r_as and r_lam_D.*one lambda/D in all rows, to 5 %"),
    ],
)
def test_contrasts_that_cannot_be_brought_over_cores_are_refused(tmp_path, old, new, said):
    with pytest.raises(InputError, match=said) as refused:
        roman(tmp_path, text=ROMAN.replace(old, new, 1))
    assert "\n" not in str(refused.value)


def test_constant_columns_have_one_value(tmp_path):
    text = more("noise_fraction", 0.9)
    assert read(tmp_path, text).constant("noise_fraction") == 0.9
    with pytest.raises(InputError, match="same value in every row"):
        read(tmp_path, text.replace("0.9", "0.8", 1))


def test_a_missing_file_and_a_wrong_name_name_what_is_shipped():
    with pytest.raises(InputError, match=r"coronagraph\.table = no_such.*roman_hlc_band1"):
        coronagraph_table("no_such", UNIT)


@pytest.mark.parametrize("name", shipped_tables())
def test_shipped_tables_are_used_by_a_preset_and_say_where_they_come_from(name):
    used = {load_instrument(preset).coronagraph.table for preset in preset_names("instrument")}
    assert name in used
    found = coronagraph_table(name, UNIT)
    assert found.notes == ()
    assert set(found.columns) <= set(COLUMNS)


def instrument(tmp_path, *, bands=None, **coronagraph):
    (tmp_path / "flat.csv").write_text(FLAT, encoding="utf-8")
    own = {"coronagraph": {"table": str(tmp_path / "flat.csv")} | coronagraph}
    return load_instrument(own if bands is None else own | {"bands": bands})


def test_bands_of_the_base_go_where_the_file_names_its_own(tmp_path):
    own = {"center_nm": 500, "width_nm": 50, "t_opt": 0.3, "qe": 0.9}
    assert list(instrument(tmp_path, bands={"blue": own}).bands) == ["blue"]
    by_band = instrument(tmp_path, table={"F662": str(tmp_path / "flat.csv")})
    assert list(by_band.bands) == ["F662"]
    with pytest.raises(InputError, match="red.*names of bands"):
        instrument(tmp_path, table={"red": str(tmp_path / "flat.csv")})
    with pytest.raises(InputError, match="a table for every band, blue has none"):
        instrument(tmp_path, bands={"blue": own, "F662": {}}, table={"F662": str(tmp_path / "flat.csv")})


def test_the_ring_reaches_an_aperture_beyond_the_table(tmp_path):
    made = instrument(tmp_path)
    for band in made.bands:
        radius = made.aperture_radius_arcsec(band)
        assert made.hole_inner_arcsec(band) == pytest.approx(0.1 - radius)
        assert made.hole_outer_arcsec(band) == pytest.approx(0.3 + radius)
        assert made.mask_half_width_arcsec(band) == 0.0
    squares = instrument(tmp_path, zone="quadrants")
    assert squares.hole_inner_arcsec("F662") == load_instrument().hole_inner_arcsec("F662")


def test_the_core_of_the_table_is_the_aperture(tmp_path):
    (tmp_path / "area.csv").write_text(more("core_area_lambda_d2", 1.5), encoding="utf-8")
    made = load_instrument({"coronagraph": {"table": str(tmp_path / "area.csv")}})
    for band in made.bands:
        expected = math.sqrt(1.5 / math.pi) * made.lambda_d_arcsec(band)
        assert made.aperture_radius_arcsec(band) == pytest.approx(expected)


def test_names_beside_the_instruments_file_are_found(tmp_path):
    (tmp_path / "flat.csv").write_text(FLAT, encoding="utf-8")
    (tmp_path / "mine.yaml").write_text("coronagraph: {table: flat.csv}\n", encoding="utf-8")
    assert load_instrument(tmp_path / "mine.yaml").coronagraph.table == str(tmp_path / "flat.csv")


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ({"coronagraph": {"zone": "ring"}}, "without coronagraph.table"),
        ({"coronagraph": {"stability_fraction": 0.1}}, "without coronagraph.table"),
        ({"coronagraph": {"diameter_m": 2.4}}, "without coronagraph.table"),
        ({"coronagraph": {"star_diameter_mas": 1.0}}, "without coronagraph.table"),
        ({"telescope": {"obstruction_diameter_ratio": 0.2}}, "clear disc"),
        ({"telescope": {"area_m2": 3.0}}, "clear disc"),
        ({"telescope": {"obstruction_diameter_ratio": 1.0}}, "0"),
    ],
)
def test_what_needs_a_table_is_refused_without(own, said):
    with pytest.raises(InputError, match=said):
        load_instrument(own)


def test_the_area_of_a_telescope():
    """Ring, or what is said; never more than the disc."""
    base = {"base": "roman_hlc_like"}
    ring = load_instrument(base | {"telescope": {"area_m2": None}}).telescope
    assert ring.area_cm2 == pytest.approx(math.pi / 4 * 236.3**2 * (1 - 0.303**2))
    assert load_instrument(base).telescope.area_cm2 == pytest.approx(35780.0)
    with pytest.raises(InputError, match="area_m2.*at most that of the disc, 4.385"):
        load_instrument(base | {"telescope": {"area_m2": 5.0}})
