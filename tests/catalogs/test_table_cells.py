"""Tables: which quantity and unit their headings mean, and which of their rows and cells are used."""

import pytest

from catalogs import QUANTITIES, RawTable, load_known_planets, open_catalogue
from catalogs.known_planets import COLUMNS, own_rows
from catalogs.table_cells import heading
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
