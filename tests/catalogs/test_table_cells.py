"""Tables: which quantity and unit their headings mean, and which of their rows and cells are used.

Values as people write them: numbers, angles, dates and units, against astropy's own readers.
"""

import math

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import Angle
from astropy.time import Time
from hypothesis import given, strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from catalogs import QUANTITIES, RawTable, load_known_planets, open_catalogue
from catalogs.known_planets import COLUMNS, own_rows
from catalogs.table_cells import (
    converted,
    heading,
    join_sexagesimal,
    read_angles,
    read_dates,
    read_numbers,
    read_positions,
    unit_of,
)
from catalogs.table_files import TableBytes, column_of, parse_table
from catalogs.user_tables import user_table


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("plx", "parallax_mas"),
        ("PLX_VALUE", "parallax_mas"),
        ("Plx [mas]", "parallax_mas"),
        ("log(g)", "log_g"),
        ("logg", "log_g"),
        ("[Fe/H]", "metallicity"),
        ("fe_h", "metallicity"),
        ("M/H", "metallicity"),
        ("flux(V)", "v_mag"),
        ("B-V", "b_v_mag"),
        ("RA", "ra_deg"),
        ("RAJ2000", "ra_deg"),
        ("_DE", "dec_deg"),
        ("V", "v_mag"),
        ("RAdeg", "ra_deg"),
        ("DEdeg", "dec_deg"),
        ("RA_d", "ra_deg"),
        ("DEC_d", "dec_deg"),
        ("rad", None),
        ("DE-", "dec_split_sign"),
        ("DE -", "dec_split_sign"),
        ("DEd", "dec_split_d"),
        ("nonsense", None),
        ("", None),
    ],
)
def test_heading_to_quantity(text, name):
    quantity, unit, *_ = QUANTITIES.meant_by(text)
    assert (quantity.name if quantity else None) == name
    assert unit in ("mas", "dex", "mag", "deg", "dex(cm/s2)", "")


def test_a_unit_in_the_heading_stands_for_that_of_its_source():
    assert QUANTITIES.meant_by("plx").unit == "mas"
    assert QUANTITIES.meant_by("plx [arcsec]").unit == "arcsec"
    assert QUANTITIES.meant_by("st_lum").unit == "dex(solLum)"
    assert QUANTITIES.meant_by("lum").unit == "solLum"


def test_another_heading_tells_whose_words_they_are():
    assert QUANTITIES.meant_by("name").column.name == "name"
    assert QUANTITIES.meant_by("name", {"planetstatus"}).column.name == "planet"
    assert QUANTITIES.meant_by("RA_ICRS").convention == ""
    assert QUANTITIES.meant_by("RA_ICRS", {"gmag"}).convention == "j2016"


@pytest.mark.parametrize("columns", [QUANTITIES, COLUMNS], ids=["stars", "planets"])
def test_no_heading_means_two_things(columns):
    forms = [(item.heading, item.beside, name) for name in columns for item in columns.synonyms_of(name)]
    forms += [(heading(name), "", name) for name in columns]
    meant = {}
    for form, beside, name in forms:
        assert form.lower() == heading(form)
        assert meant.setdefault((form, beside), name) == name


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("omega", "omega_star_deg"),
        ("Omega", "node_deg"),
        ("omega [deg]", "omega_star_deg"),
        ("Omega (deg)", "node_deg"),
        ("omega_err", "omega_err_deg"),
        ("Omega_err", "node_err_deg"),
        ("Omega_Err", "node_err_deg"),
        ("OMEGA_STAR_DEG", "omega_star_deg"),
        ("omega_planet", "omega_planet_deg"),
        ("m", "mass_mjup"),
        ("W", None),
    ],
)
def test_headings_that_differ_by_a_capital_alone(text, name):
    meant = COLUMNS.meant_by(text)[0]
    assert (meant.name if meant else None) == name


@pytest.mark.parametrize("text", ["OMEGA", "OMEGA [deg]", "OMEGA_ERR", "M", "M [Msun]"])
def test_headings_whose_capitals_leave_their_meaning_open_are_refused(refused, text):
    refused("more than one meaning", COLUMNS.meant_by, text)


@pytest.mark.parametrize(
    ("name", "filled", "measured"),
    [
        ("v_mag", [-1.0, -9.99, -9.999, -99.9], [-1.46, 9.99, 0.0]),
        ("rv_km_s", [-99.99, -999.0, -999.9, -9999.0, 999.9], [-9.99, -99.0, -99.9, 99.9, 0.0]),
        ("pm_ra_mas_yr", [-99.99, -9999.0, 9999.0, 99999.0], [-99.9, 999.0, -1.0, 9.0]),
        ("companion_delta_v_mag", [-9.99], [-9.9, -1.0, 9.99]),
        ("distance_pc", [9999.0], [9.99, 99.99, 999.0]),
    ],
)
def test_numbers_that_stand_for_missing_ones(name, filled, measured):
    assert all(map(QUANTITIES[name].is_fill, filled))
    assert not any(map(QUANTITIES[name].is_fill, measured))


STARS, PLANETS = "distance_pc,v_mag,sp_type,default_flag", "period_days,mass_mjup,default_flag"
REPEATED = [
    ("stars", f"name,{STARS}", ["a,{},5,G2V,{}", "b,{},5,G2V,{}"]),
    ("stars", f"hd,hip,{STARS}", ["10700,8102,{},5,G2V,{}", "22049,16537,{},5,G2V,{}"]),
    ("planets", f"star,planet,{PLANETS}", ["x,x b,{},1,{}", "x,x c,{},1,{}"]),
    ("planets", f"star,letter,{PLANETS}", ["x,b,{},1,{}", "x,c,{},1,{}"]),
]


@pytest.mark.parametrize(("kind", "head", "things"), REPEATED)
@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(0, 10, 0), (0, 20, 1), (1, 30, 0)], [20, 30]),
        ([(0, 10, 1), (0, 20, 0), (1, 30, 1)], [10, 30]),
        ([(0, 10, 0), (1, 20, 0)], [10, 20]),
        ([(0, 10, ""), (0, 20, 0), (1, 30, 0)], [10, 30]),
    ],
)
def test_what_has_no_default_row_keeps_its_other_one(tmp_path, kind, head, things, rows, expected):
    file = tmp_path / "own.csv"
    file.write_text("\n".join([head, *(things[thing].format(number, default) for thing, number, default in rows)]))
    if kind == "stars":
        found = open_catalogue(file).table.column("distance_pc")
    else:
        found = load_known_planets(f"none+{file}").number("period_days")
    assert found.tolist() == expected


def of_table(**columns):
    given = {"name": ["a", "b"], "distance_pc": [10.0, 20.0], "v_mag": [5.0, 6.0], "sp_type": ["G2V", "K1V"]} | columns
    return user_table(RawTable("own", [column_of(name, "", cells) for name, cells in given.items()]))


@pytest.mark.parametrize(
    ("other", "differ"), [(["8102", "16537"], 0), (["HIP 8102 A", "16537"], 1), ([8103, 16537], 1), ([None, 16538], 1)]
)
def test_numbers_of_two_columns_are_compared_as_they_are(other, differ):
    made = of_table(hip_number=[8102, 16537], hip_name=other)
    assert made.table.column("hip").tolist() == [8102, 16537]
    assert len([note for note in made.notes if f"differs in {differ} row" in note]) == differ


@pytest.mark.parametrize(("written", "expected"), [([10700.0, None], "HD 10700"), (["10700.0", "K"], "HD 10700")])
def test_a_number_that_has_a_point_because_others_are_missing_is_whole(written, expected):
    assert of_table(hd=written).table.column("hd")[0] == expected
    assert of_table(gj=[71.0, None]).table.column("gj").tolist() == ["GJ 71", ""]
    assert of_table(bayer=["12.05", "v1.0"]).table.column("bayer").tolist() == ["12.05", "v1.0"]


def test_a_name_of_blanks_alone_is_none():
    made = of_table(name=["a", "_"])
    assert made.table.column("name").tolist() == ["a"]
    assert [(item.row, item.column, item.value) for item in made.left_out] == [(2, "name", "missing")]


def test_a_table_without_rows_is_refused(refused):
    columns = [column_of(name, "", []) for name in ("name", "distance_pc", "v_mag", "sp_type")]
    refused("no rows", user_table, RawTable("own", columns))


@pytest.mark.parametrize("cells", [[True, False], ["True", "False"], [1, 0], [1.0, 0.0], ["yes", "no"]])
def test_truth_values_are_understood_as_people_write_them(cells):
    given = {"star": ["x", "x"], "planet": ["x b", "x c"], "period_days": [9.0, 99.0], "mass_mjup": [1.0, 2.0]}
    columns = [column_of(name, "", cells) for name, cells in (given | {"pl_controv_flag": cells}).items()]
    rows, read = own_rows(RawTable("own", columns))
    assert ["controversial" in row["flags"] for row in rows] == [True, False]
    assert not read.left_out


def test_remarks_name_the_most_frequent_reasons_and_the_first_row_of_each():
    rows = "name,dist,V,SpT\na,10,5,G2V\nb,10,,G2V\nc,10,,G2V\nd,-1,5,G2V\ne,10,5,blob\n"
    table = parse_table(TableBytes("mine.csv", rows.encode(), ""))
    (left_out,) = (note for note in user_table(table).notes if "left out: " in note and "row" in note)
    assert left_out.startswith("mine.csv: 4 rows left out: 2 because of V (first missing in row 2, b); 1 because of ")
    assert "dist (first -1 pc in row 4, d; allowed: a number, 1 to 100000 pc)" in left_out
    assert "SpT (first blob in row 5, e; " in left_out or "sp_type (first blob in row 5, e; " in left_out


@pytest.mark.parametrize(
    ("cell", "value"),
    [
        ("12.3", 12.3),
        (" +.5 ", 0.5),
        ("5.", 5.0),
        ("1.2e-3", 0.0012),
        ("1.2D+03", 1200.0),
        ("−0.52", -0.52),
        ("–0.52", -0.52),
        ("$-$0.52", -0.52),
        ("12.3*", 12.3),
        ("12.3:", 12.3),
        ("~3", 3.0),
        ("$\\sim$3", 3.0),
        ("12,3", 12.3),
        ("0,123", 0.123),
        ("1,234.5", 1234.5),
        ("1,234,567", 1234567.0),
        ("12.3(4)", 12.3),
        ("1234(5)", 1234.0),
        ("-12.345(12)", -12.345),
        ("12.3±0.4", 12.3),
        ("12,3±0,4", 12.3),
        ("12.3 +/- 0.4", 12.3),
        ("12.3\\pm0.4", 12.3),
        ("12.3 +0.4 -0.5", 12.3),
        ("12.3+0.4/-0.3", 12.3),
        ("12.3 (0.4)", 12.3),
        ("$12.3_{-0.3}^{+0.4}$", 12.3),
        ("-0.52 -0.03 +0.02", -0.52),
        ("$12.3^{+0.4}_{-0.3}$", 12.3),
    ],
)
def test_numbers_with_what_stands_around_them(cell, value):
    read = read_numbers(["1.5", cell])
    assert_allclose(read, [1.5, value], rtol=1e-14)


@pytest.mark.parametrize("cell", ["<0.3", "< 0,3", "≤0.3", "$<$0.3", "<=4", ">5"])
def test_limits_are_no_values(cell):
    read = read_numbers([cell, "2.5"])
    assert_array_equal(read, [math.nan, 2.5])


@pytest.mark.parametrize(
    "cell",
    [
        "abc",
        "1_000",
        "True",
        "12 20",
        "2005-06-12",
        "inf",
        "-",
        "1e400",
        "12d30",
        "1.2.3",
        "1-2-3",
        "1+2+3",
        "0x10",
        "1.234,5",
        "1,234",
    ],
)
def test_what_is_no_number_or_may_be_two_is_refused(cell):
    assert math.isnan(read_numbers([cell])[0])


@pytest.mark.parametrize(
    ("others", "value"), [(["3.5"], 1234.0), (["3,5"], 1.234), (["1,234,567"], 1234.0), (["3,5", "2.5"], math.nan)]
)
def test_the_other_cells_decide_what_a_comma_is(others, value):
    read = read_numbers(["1,234", *others])
    assert_array_equal(read[0], value)
    assert np.isfinite(read[1:]).all()


def test_empty_cells_are_no_values_and_not_refused():
    text = np.ma.array(["1", "2", "", "nan", None], object, mask=[False, True, False, False, False])
    read = read_numbers(text)
    assert_array_equal(read, [1.0, math.nan, math.nan, math.nan, math.nan])
    numbers = read_numbers(np.ma.array([1, 2], mask=[False, True]))
    assert_array_equal(numbers, [1.0, math.nan])
    assert_array_equal(read_numbers([1.0, math.inf]), [1.0, math.nan])
    assert_array_equal(read_numbers([True]), [math.nan])
    assert_array_equal(read_numbers(np.array([1.5, "2.5", 3], object)), [1.5, 2.5, 3.0])
    assert read_numbers([]).shape == read_angles(np.array([], object)).shape == (0,)


CLOCK = [
    "01:44:04.08",
    "01 44 04.08",
    "1h44m4.08s",
    "01h 44m 04.1s",
    "23:59:59.999999",
    "12 30.5",
    "12h30m",
    "17 54 .19",
]
SLOPE = [
    "-00 12 34.5",
    "+15 56 14.9",
    "-15d56m14s",
    "+15°56'14\"",
    "+15° 56′ 14.5″",
    "-00:12",
    "89 59 59.99",
    "-0d0m1s",
]


@pytest.mark.parametrize("unit", ["", "h", "hourangle", '"h:m:s"', "h:m:s", "hh mm ss.s", "hms", "deg"])
@pytest.mark.parametrize("text", CLOCK)
def test_right_ascensions_against_astropy(text, unit):
    read = read_angles([text], unit, clock=True)
    assert_allclose(read, [Angle(text, "hourangle").deg], rtol=1e-14)


@pytest.mark.parametrize("unit", ["", "deg", '"d:m:s"', "dd:mm:ss"])
@pytest.mark.parametrize("text", SLOPE)
def test_declinations_against_astropy(text, unit):
    read = read_angles([text, text.replace("-", "−")], unit)
    assert_allclose(read, [Angle(text, "deg").deg] * 2, rtol=1e-14)


@pytest.mark.parametrize(
    ("cell", "unit", "degrees"),
    [
        ("26.017", "", 26.017),
        ("26.017", "deg", 26.017),
        (26.017, "degrees", 26.017),
        ("1.5", "h", 22.5),
        (1.5, "hourangle", 22.5),
        ("1.5", "h:m:s", 22.5),
        (26.017, "d:m:s", 26.017),
        ("0.5", "rad", math.degrees(0.5)),
        ("1.5h", "", 22.5),
        ("26.017°", "", 26.017),
        ("26d01m01.2s", "", 26.017),
    ],
)
def test_plain_right_ascensions_are_in_their_unit_or_in_degrees(cell, unit, degrees):
    assert_allclose(read_angles([cell], unit, clock=True), [degrees], rtol=1e-14)


def test_right_ascensions_in_degrees_minutes_and_seconds():
    read = read_angles(["12 20 43.02", "200 10 05"], "deg", clock=True)
    assert_allclose(read, [Angle("12 20 43.02", "deg").deg, Angle("200 10 05", "deg").deg], rtol=1e-14)
    assert_array_equal(np.isnan(read_angles(["12 20 43.02", "200 10 05"], clock=True)), [False, True])


@pytest.mark.parametrize(
    "cell", ["25:00:00", "01:60:00", "01:44:60.5", "-01 44 4", "1.5h30m", "01:44.5:04", "01:", "x"]
)
def test_right_ascensions_that_are_none(cell):
    read = read_angles([cell, "01 00 00"], clock=True)
    assert_array_equal(read, [math.nan, 15.0])


@pytest.mark.parametrize("cell", ["90 00 01", "-91:00:00", "01h44m04s", "12 60 00", "1 2 3 4", "north"])
def test_declinations_that_are_none(cell):
    assert np.isnan(read_angles([cell, None])).all()


@pytest.mark.parametrize(
    "cell",
    [
        "01 44 04.0831371 -15 56 14.926547",
        "01:44:04.0831371 -15:56:14.926547",
        "01 44 04.0831371 −15 56 14.926547",
        "01h44m04.0831371s -15d56m14.926547s",
        "01 44 04.0831371, -15 56 14.926547",
        "01:44:04.0831371-15:56:14.926547",
        "26.01701307125 -15.937479596388889",
        "26.01701307125, -15.937479596388889",
    ],
)
def test_positions_in_one_cell(cell):
    """SIMBAD's position of tau Ceti."""
    ra, dec = read_positions([cell, None])
    assert_allclose(ra, [Angle("01 44 04.0831371", "hourangle").deg, math.nan], rtol=1e-14)
    assert_allclose(dec, [Angle("-15 56 14.926547", "deg").deg, math.nan], rtol=1e-14)


@pytest.mark.parametrize("cell", ["01 44 04.08 15 56 14.9", "01:44:04.08 +15:56:14.9", "26.017 15.9374722222222"])
def test_northern_positions_in_one_cell(cell):
    ra, dec = read_positions([cell])
    assert_allclose([ra[0], dec[0]], [26.017, 15.9374722222222], rtol=1e-12)


@pytest.mark.parametrize("cell", ["01 44 04", "26.017", "tau Cet", "01 44.5 15 56.2", "01 44 04 -15 56 14 12"])
def test_cells_that_are_no_pair(cell):
    ra, dec = read_positions([cell])
    assert np.isnan(ra + dec).all()


@pytest.mark.parametrize(
    ("whole", "sign", "degrees"),
    [
        ("00", "-", -12.0 / 60.0 - 34.5 / 3600.0),
        ("00", "−", -12.0 / 60.0 - 34.5 / 3600.0),
        ("00", "+", 12.0 / 60.0 + 34.5 / 3600.0),
        ("00", "", 12.0 / 60.0 + 34.5 / 3600.0),
        ("15", "-", -15.0 - 12.0 / 60.0 - 34.5 / 3600.0),
    ],
)
def test_split_declinations_take_their_sign_column(whole, sign, degrees):
    for cell in (whole, float(whole), int(whole)):
        read = join_sexagesimal([cell], [12], [34.5], [sign])
        assert_allclose(read, [degrees], rtol=1e-14)


@pytest.mark.parametrize("whole", ["-00", "−0", -0.0])
def test_without_a_sign_column_minus_nought_is_a_minus(whole):
    assert_allclose(join_sexagesimal([whole], ["12"], ["34.5"]), [Angle("-0d12m34.5s").deg], rtol=1e-14)


def test_split_right_ascensions_and_missing_parts():
    read = join_sexagesimal(
        ["01", "02", "", "03", "04"], ["44", "30.5", "", "", "61"], ["04.08", "", "", "", "0"], clock=True
    )
    assert_allclose(read, [26.017, 37.625, math.nan, math.nan, math.nan], rtol=1e-14)
    assert_allclose(join_sexagesimal([1], [30], clock=True), [22.5])


@pytest.mark.parametrize(
    ("convention", "zero"),
    [
        ("JD", 0.0),
        ("[BJD]", 0.0),
        ("HJD", 0.0),
        ("days", 0.0),
        ("", 0.0),
        ("MJD", 2400000.5),
        ("BMJD_TDB", 2400000.5),
        ("RJD", 2400000.0),
        ("JD-2400000", 2400000.0),
        ("BJD - 2,400,000", 2400000.0),
        ("jd-2450000", 2450000.0),
        ("BJD-2450000.0", 2450000.0),
        ("BKJD", 2454833.0),
        ("BJD_TDB - 2454833", 2454833.0),
        ("BTJD", 2457000.0),
        ("T0 (BJD-2457000) [d]", 2457000.0),
    ],
)
def test_julian_dates_of_every_convention(convention, zero):
    for cell in (2458000.25 - zero, repr(2458000.25 - zero)):
        read = read_dates([cell], convention)
        assert_allclose(read, [2458000.25], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    "text", ["2005-06-12", "2005-06-12T03:04:05.5", "2005-06-12 03:04:05", "2005 Jun 12", "12 June 2005", "2005/06/12"]
)
def test_calendar_dates_against_astropy(text):
    iso = text if text[:5] == "2005-" else "2005-06-12"
    assert_allclose(read_dates(["2455000.5", text]), [2455000.5, Time(iso).jd], rtol=0.0, atol=1e-8)


def test_julian_years_against_astropy():
    expected = Time([1991.25, 2016.0], format="jyear").jd
    assert_allclose(read_dates([1991.25, "2016.0"], "yr"), expected, rtol=0.0, atol=1e-8)
    assert_allclose(read_dates(["J1991.25", "J2016"]), expected, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize(
    ("cell", "convention"),
    [
        (54321.5, ""),
        ("4321.5", "days"),
        (2005.3, ""),
        (54321.5, "BJD"),
        (2455000.5, "MJD"),
        (54321.5, "BKJD"),
        (54321.5, "yr"),
        ("03/04/2005", ""),
        ("2005-13-01", ""),
        ("<2455000", "JD"),
        ("soon", "JD"),
    ],
)
def test_times_that_may_be_another_day_are_refused_with_the_reason(cell, convention):
    assert np.isnan(read_dates([cell, None], convention)).all()


UNITS = {
    u.mag: "mag mags MAG magnitudes",
    u.jupiterMass: (
        "jovMass Mjup M_J MJ M_jup MJup jupiterMass Jupiter~mass [Jupiter~mass] $M_{\\rm~Jup}$ M_{Jup} M$_\\mathrm{J}$"
    ),
    u.earthMass: "M_E Me Mearth M⊕ Earth~mass M_earth $M_\\oplus$",
    u.jupiterRad: "Rjup R_J RJ [Jupiter~radii] Rjupiter",
    u.earthRad: "R_E Rearth R⊕ [Earth~radii] Re",
    u.solMass: "Msun M_sun solMass Solar~mass [Solar~mass] M☉ M_⊙ M$_\\odot$ M(sun)",
    u.solRad: "Rsun solRad [Solar~Radius]",
    u.solLum: "Lsun L_sun solLum L_⊙",
    u.day: "days day [d] d JD [BJD] [days]",
    u.year: "yrs yr year",
    u.deg: "degrees deg deg. [deg] ° degree degree(s) $^\\circ$",
    u.arcsec: "as arcsec \" '' arc-second arcseconds",
    u.mas: "mas MAS milliarcsec",
    u.mas / u.yr: (
        "mas/year mas/yr mas.yr-1 mas~yr**-1 mas.yr**-1 MAS/YR "
        "mas~yr^-1 mas~yr$^{-1}$ mas·yr⁻¹ mas~yr−1 mas/yr. (mas/yr)"
    ),
    u.arcsec / u.yr: '"/yr arcsec/yr as/yr ″/yr',
    u.km / u.s: "km/sec km/s KM/S km.s-1 km~s-1 km~s^-1 km~s$^{-1}$ kms-1",
    u.m / u.s: "m/s m/sec m~s**-1",
    u.km / u.h: "km/h",
    u.pc: "parsec parsecs pc PC",
    u.lyr: "ly lyr light-years",
    u.AU: "AU au a.u.",
    u.K: "K Kelvin [K]",
    u.hourangle: "hourangle h",
    u.rad: "rad radians",
    u.erg: "ergs erg",
}
LOGARITHMS = {
    u.solLum: (
        "log(Lsun) log10(Solar) [log(Solar)] dex(Lsun) [Lsun] "
        "log10(L/Lsun) dex(solLum) log~Lsun logLsun $\\log(L/L_\\odot)$"
    ),
    u.cm / u.s**2: (
        "[cm/s2] log(cm/s**2) dex(cm/s2) [log10(cm/s**2)] dex(cm~/~s2) "
        "log(cm.s**-2) [cm~s-2] log10(cm/s^2) log_{10}(cm~s$^{-2}$) log(cm/s²)"
    ),
    u.dimensionless_unscaled: "dex [Fe/H] [dex] [M/H]",
}


@pytest.mark.parametrize(
    ("text", "unit", "is_log10"),
    [
        (text.replace("~", " "), unit, is_log10)
        for table, is_log10 in ((UNITS, False), (LOGARITHMS, True))
        for unit, texts in table.items()
        for text in texts.split()
    ],
)
def test_units_as_people_write_them(text, unit, is_log10):
    found = unit_of(text)
    assert found.unit == unit
    assert found.is_log10 == is_log10


@pytest.mark.parametrize(
    ("text", "own", "unit"),
    [
        ("h", "d", u.h),
        ("h", "deg", u.hourangle),
        ("MJ", "jupiterMass", u.jupiterMass),
        ("as", "mas", u.arcsec),
        ("Solar", "solMass", u.solMass),
        ("Solar", "solRad", u.solRad),
        ("dex", "dex(cm/s2)", u.cm / u.s**2),
        ("log(cgs)", "dex(cm/s2)", u.cm / u.s**2),
        ("Jupiter", "jupiterMass", u.jupiterMass),
        ("Jupiter", "jupiterRad", u.jupiterRad),
        ("[-]", "", u.one),
        ("m/s2", "dex(cm/s2)", u.m / u.s**2),
        ("", "mas", u.mas),
        ("---", "mas", u.mas),
    ],
)
def test_the_quantity_chooses_among_the_meanings_of_a_unit(text, own, unit):
    assert unit_of(text, own).unit == unit


@pytest.mark.parametrize(("text", "own"), [("mag", "mas"), ("bananas", "mas"), ("as", "jupiterMass"), ("log g", "dex")])
def test_units_of_something_else_are_refused(refused, text, own):
    assert own in refused("a unit like", unit_of, text, own)


@pytest.mark.parametrize(
    ("value", "text", "own", "kept"),
    [
        (1.0, "M_E", "jupiterMass", (1.0 * u.earthMass).to_value("jupiterMass")),
        (2.0, '"/yr', "mas/yr", 2000.0),
        (0.5, "log10(Solar)", "Lsun", 10.0**0.5),
        (33.0, "log(erg/s)", "Lsun", (1e33 * u.erg / u.s).to_value("Lsun")),
        (2.44, "log(m/s2)", "dex(cm/s2)", 4.44),
        (274.0, "m/s2", "dex(cm/s2)", math.log10(27400.0)),
        (4.44, "dex", "dex(cm/s2)", 4.44),
        (4.44, "[cm/s2]", "dex(cm/s2)", 4.44),
        (-0.5, "[Fe/H]", "dex", -0.5),
        (-0.5, "[Sun]", "dex", -0.5),
        (24.0, "h", "d", 1.0),
        (12.0, "%", "", 0.12),
        (5.5, "", "mag", 5.5),
    ],
)
def test_values_in_our_unit(value, text, own, kept):
    assert_allclose(converted(read_numbers([value]), text, own), [kept], rtol=1e-12)


def test_no_logarithm_of_a_negative_number():
    assert math.isnan(converted(read_numbers([-1.0]), "m/s2", "dex(cm/s2)")[0])


PIECES = st.sampled_from(
    [*"0123456789 .,:;+-−±<>~*()[]$^_{}hdmsHDeE°'\"′″\n", "pm", "+/-", "nan", "12", "2005", "Jun", "\\"]
)


@given(st.lists(st.one_of(st.lists(PIECES, max_size=12).map("".join), st.text(max_size=12)), max_size=4))
def test_any_text_is_a_finite_value_or_none(cells):
    columns = [read_numbers(cells), read_angles(cells), read_angles(cells, clock=True), read_dates(cells)]
    for read in (*columns, *read_positions(cells), join_sexagesimal(cells, cells)):
        empty = [not text.strip() or text.strip().lower() == "nan" for text in cells]
        assert read.shape == (len(cells),)
        assert np.isnan(read[empty]).all()
        assert not np.isinf(read).any()


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_as_python_writes_them(value):
    assert_array_equal(read_numbers([repr(value), f"{value}*"]), [value, value])


@given(st.integers(-1, 1), st.integers(0, 89), st.integers(0, 59), st.floats(0.0, 59.99))
def test_sexagesimal_texts_of_astropy(sign, degrees, minutes, seconds):
    angle = Angle((sign or 1) * (degrees + minutes / 60.0 + seconds / 3600.0), "deg")
    texts = [angle.to_string(sep=sep, precision=9, pad=sign == 0) for sep in ("fromunit", ":", " ", "dms")]
    assert_allclose(read_angles(texts), [angle.deg] * 4, rtol=0.0, atol=1e-12)
    hours = [abs(angle).to_string("hourangle", sep=sep, precision=9) for sep in ("fromunit", ":", " ", "hms")]
    assert_allclose(read_angles(hours, clock=True), [abs(angle).deg] * 4, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize(
    "text", ["1" * 30000 + "x", "1," * 30000, "1 " * 30000, "-" * 30000, "1.5" * 20000, "(" * 30000]
)
def test_long_cells_are_refused_in_time_that_grows_as_their_length(text):
    """The square of this length would take minutes."""
    columns = [read_numbers([text]), read_angles([text]), read_dates([text]), *read_positions([text])]
    assert all(math.isnan(read[0]) for read in columns)


@pytest.mark.parametrize("text", ["log" + " " * 30000 + "x", "[" * 30000, "x" + "." * 30000, "jd" * 20000])
def test_long_units_and_conventions_are_refused_likewise(refused, text):
    refused("a unit like mas", unit_of, text, "mas")
    assert read_dates([2455000.5], text)[0] == 2455000.5


def test_columns_of_a_catalogue():
    seconds = np.random.default_rng(5).uniform(0.0, 86399.0, 20000)
    texts = [f"{int(s // 3600):02d}:{int(s // 60 % 60):02d}:{s % 60:08.5f}" for s in seconds]
    read = read_angles(np.array(texts, object), clock=True)
    assert_allclose(read, seconds / 240.0, rtol=0.0, atol=1e-7)
