"""Tables of a user's own: what is read, converted and filled."""

import csv
import io
import math

import numpy as np
import pytest
from astropy import units as u
from astropy.io.votable import from_table
from astropy.table import MaskedColumn, Table
from hypothesis import given, settings, strategies as st

from catalogs import ADDED_FLAGS, data_credits, load_stars, open_catalogue, stellar_parameters
from catalogs.stars import SHIPPED_FLAGS
from catalogs.stellar_physics import bolometric_correction

SIMPLE = "name,distance_pc,v_mag,sp_type\nfirst,10,5.5,G2V\nsecond,20,6,K1V\n"


def opened(tmp_path, text, name="mine.csv"):
    data = text if isinstance(text, bytes) else text.encode()
    (tmp_path / name).write_bytes(data)
    return open_catalogue(tmp_path / name)


def rows(catalogue):
    return [catalogue.table.row(i) for i in range(len(catalogue.table))]


def same(found, expected):
    assert len(found) == len(expected)
    for one, two in zip(found, expected, strict=True):
        assert one == pytest.approx(two, nan_ok=True)


def flags(row):
    return set(row["quality_flags"].split(";")) - {""}


def test_the_least_table_is_filled_and_labelled(tmp_path):
    made = opened(tmp_path, SIMPLE)
    first, second = rows(made)
    assert (first["name"], first["distance_pc"], first["v_mag"], first["sp_type"]) == ("first", 10.0, 5.5, "G2V")
    assert second["name"] == "second", "rows keep their order"
    solar = stellar_parameters("G2V")
    assert (first["teff_k"], first["log_g"]) == (solar.teff_k, solar.log_g)
    assert first["metallicity"] == 0.0
    assert first["parallax_mas"] == 100.0
    m_bol = 5.5 + bolometric_correction(solar.teff_k)  # at 10 pc apparent is absolute
    assert first["luminosity_lsun"] == pytest.approx(10 ** (-0.4 * (m_bol - 4.73)))
    assert first["radius_rsun"] == pytest.approx(math.sqrt(first["luminosity_lsun"]) * (5772 / solar.teff_k) ** 2)
    labels = {name: text for name, text in first.items() if name.endswith("_src")}
    assert labels["distance_pc_src"] == labels["v_mag_src"] == "measured:as listed in mine.csv"
    assert labels["teff_k_src"].startswith("derived:spectral type")
    assert labels["log_g_src"].startswith("derived:spectral type")
    assert labels["metallicity_src"] == "assumed:0"
    assert labels["luminosity_lsun_src"].startswith("derived:V, BC")
    assert labels["companion_src"] == labels["b_v_mag_src"] == labels["ecliptic_src"] == "missing"
    assert all(text.startswith(("measured", "derived:", "assumed:", "missing")) for text in labels.values())
    assert np.isnan(first["ra_deg"])
    assert "position_unknown" in flags(first)
    assert list(made.table.columns) == list(load_stars().columns)
    assert set().union(*map(flags, rows(made))) <= set(SHIPPED_FLAGS) | set(ADDED_FLAGS)


def test_what_is_given_stays(tmp_path):
    text = (
        "name,hip,ra_deg,dec_deg,parallax_mas,parallax_err_mas,v_mag,b_v_mag,sp_type,teff_k,log_g,metallicity,"
        "luminosity_lsun,companion_name,companion_sep_arcsec,companion_pa_deg,companion_delta_v_mag,rv_km_s\n"
        "x,HIP 8102,26.0,-15.9,273.8,0.2,3.5,0.72,G8V,5344,4.4,-0.5,0.49,y,3.5,-30,2.5,-16.7\n"
    )
    (row,) = rows(opened(tmp_path, text))
    assert row["hip"] == 8102
    for name, value in (
        ("ra_deg", 26.0),
        ("teff_k", 5344.0),
        ("log_g", 4.4),
        ("metallicity", -0.5),
        ("rv_km_s", -16.7),
        ("luminosity_lsun", 0.49),
        ("companion_sep_arcsec", 3.5),
        ("companion_delta_v_mag", 2.5),
    ):
        assert row[name] == value
    assert row["companion_pa_deg"] == 330.0
    assert row["companion_name"] == "y"
    assert row["close_companion"] is True, "3.5 arcsec is close"
    assert row["distance_pc"] == pytest.approx(1000 / 273.8)
    assert row["distance_pc_src"] == "derived:parallax"
    assert row["ecliptic_lat_deg"] == pytest.approx(-24.8, abs=0.2)
    for name in ("teff_k_src", "luminosity_lsun_src", "companion_src", "rv_km_s_src"):
        assert row[name] == "measured:as listed in mine.csv"
    assert flags(row) == set()


@pytest.mark.parametrize(
    "headings",
    [
        "Name,Dist,V,SpT,Teff",
        "STAR;distance;Vmag;Sp_Type;T_eff",
        "main_id\td\tFLUX_V\tsptype\tteff_K",
        "Target,distance (pc),V [mag],spectral type,Teff [K]",
        "hostname,sy_dist,sy_vmag,st_spectype,st_teff",
        " name , distance_pc , v_mag , sp_type , teff_k ",
    ],
)
def test_headings_that_people_use(tmp_path, headings):
    mark = next(m for m in (",", ";", "\t") if m in headings)
    text = headings + "\n" + mark.join(["my star", "12.5", "6.25", "G2V", "5800"]) + "\n"
    (row,) = rows(opened(tmp_path, text))
    assert (row["name"], row["distance_pc"], row["v_mag"], row["teff_k"]) == ("my star", 12.5, 6.25, 5800.0)


UNITS = [
    ("parallax_mas", u.arcsec, 0.25, 250.0),
    ("distance_pc", u.lyr, 32.615637769, 10.0),
    ("distance_pc", u.kpc, 0.02, 20.0),
    ("ra_deg", u.hourangle, 12.0, 180.0),
    ("dec_deg", u.rad, -0.5, math.degrees(-0.5)),
    ("luminosity_lsun", u.W, 3.828e26, 1.0),
    ("log_g", u.dex(u.m / u.s**2), 2.4, 4.4),
    ("teff_k", u.kK, 5.8, 5800.0),
    ("companion_sep_arcsec", u.mas, 2500.0, 2.5),
    ("pm_ra_mas_yr", u.arcsec / u.yr, 1.5, 1500.0),
]


@pytest.mark.parametrize(
    ("kind", "name", "unit", "value", "expected"),
    # VOTables write the unit of log g in ways of their own, see below
    [(kind, *case) for kind in ("ecsv", "votable") for case in UNITS if kind == "ecsv" or case[0] != "log_g"],
    ids=str,
)
def test_units_of_the_file_are_converted(tmp_path, kind, name, unit, value, expected):
    table = Table({"name": ["x"], "v_mag": [5.0] * u.mag, "sp_type": ["G2V"]})
    table["pm_ra_mas_yr"], table["pm_dec_mas_yr"] = [0.0], [0.0]
    if name not in ("distance_pc", "parallax_mas"):
        table["distance_pc"] = [10.0] * u.pc
    table["ra_deg"], table["dec_deg"] = [1.0], [2.0]
    table[name] = MaskedColumn([value], unit=unit)
    path = tmp_path / f"t.{kind}"
    table.write(path, format={"ecsv": "ascii.ecsv", "votable": "votable"}[kind])
    (row,) = rows(open_catalogue(path))
    assert row[name] == pytest.approx(expected, rel=1e-9)


def test_log_g_of_archives(tmp_path):
    for unit in ("[cm/s2]", "dex(cm / s2)", "dex", "log(cm.s**-2)", ""):
        columns = [
            "{name: name, datatype: string}",
            *(f"{{name: {n}, datatype: float64}}" for n in ("dist", "V", "teff")),
        ]
        columns.append(f"{{name: logg, {f'unit: {unit!r}, ' if unit else ''}datatype: float64}}")
        header = ["# %ECSV 1.0", "# ---", "# datatype:", *(f"# - {column}" for column in columns)]
        text = "\n".join([*header, "name dist V teff logg", "x 10 5 5800 4.4"]) + "\n"
        (row,) = rows(opened(tmp_path, text, "t.ecsv"))
        assert row["log_g"] == pytest.approx(4.4), unit


def test_decimal_commas_between_semicolons_are_read_and_said(tmp_path):
    made = opened(tmp_path, "name;dist;V;SpT;remark\nfirst, of two;10,25;5,5;G2V;a, b\nsecond;20;+6;K1V;\n")
    assert [(row["name"], row["distance_pc"], row["v_mag"]) for row in rows(made)] == [
        ("first, of two", 10.25, 5.5),
        ("second", 20.0, 6.0),
    ]
    assert made.notes[0] == "mine.csv: decimal commas read in dist, V"


def test_a_hipparcos_name_gives_the_number(tmp_path):
    made = rows(opened(tmp_path, "name,hip,dist,V,SpT\nHIP 8102,,10,5,G2V\nHIP 5,7,10,5,G2V\nother,,10,5,G2V\n"))
    assert [row["hip"] for row in made] == [8102, 7, 0]


def test_unknown_columns_are_ignored_and_named_once(tmp_path):
    made = opened(tmp_path, "name,dist,V,SpT,colour,comment\nx,5,5,G2V,red,hm\ny,6,6,G3V,blue,\n")
    assert made.notes == ("mine.csv: columns not used: colour, comment",)
    assert opened(tmp_path, SIMPLE).notes == ()


def test_the_exact_name_wins_over_its_alias(tmp_path):
    made = opened(tmp_path, "name,distance_pc,v_mag,V,SpT\nx,5,5.5,9,G2V\n")
    assert rows(made)[0]["v_mag"] == 5.5
    assert made.notes == ("mine.csv: columns not used: V",)


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffname,distance_pc,v_mag,sp_type\nfirst,10,5.5,G2V\nsecond,20,6,K1V\n",
        SIMPLE.replace("\n", "\r\n"),
        "# my stars, by hand\n\n" + SIMPLE + "\n# the end\n",
        "#name,distance_pc,v_mag,sp_type\nfirst,10,5.5,G2V\nsecond,20,6,K1V\n",
        SIMPLE.replace(",", ";"),
        SIMPLE.replace(",", "\t"),
        'name,distance_pc,v_mag,sp_type\n"first", 10, 5.5, "G2V"\nsecond,2e1,+6.0,K1V\n',
        SIMPLE.strip(),
        "name,distance_pc,v_mag,sp_type,,\nfirst,10,5.5,G2V,,\n,,,,,\nsecond,20,6,K1V,,\n , ,,,,\n",
        "name,distance_pc,v_mag,sp_type\nfirst,10,5.5,G2V,\nsecond,20,6,K1V, ,\n",
    ],
)
def test_ways_of_writing_a_csv(tmp_path, text):
    expected = rows(opened(tmp_path, SIMPLE))
    same(rows(opened(tmp_path, text)), expected)


def test_types_and_temperatures_beyond_the_spectral_grid_are_flagged(tmp_path):
    text = (
        "name,dist,V,SpT,Teff\nVega,7.68,0.03,A0V,\nred,5,7,M4V,\nhot,5,7,,12000\ngiant,30,4,K2III,\nsun,10,4.8,G2V,\n"
    )
    made = {row["name"]: row for row in rows(opened(tmp_path, text))}
    for name in ("Vega", "red", "hot"):
        assert "stellar_grid_clamped" in flags(made[name]), name
    assert "stellar_grid_clamped" not in flags(made["sun"])
    assert "giant" in flags(made["giant"])
    assert made["Vega"]["teff_k"] == pytest.approx(9700.0, abs=300.0), "the value itself is not changed"


def test_without_class_the_gravity_follows_from_mass_and_radius(tmp_path):
    made = rows(opened(tmp_path, "name,dist,V,SpT,Teff\ndwarf,10,4.8,G2,\nevolved,30,3.0,K0,\nplain,10,4.8,,5772\n"))
    assert [row["log_g_src"] for row in made] == ["derived:mass and radius"] * 3
    assert made[0]["log_g"] == pytest.approx(4.4, abs=0.1)
    assert made[1]["log_g"] < 3.6
    assert made[2]["log_g"] == pytest.approx(4.44, abs=0.05), "a star like the Sun"
    assert made[2]["luminosity_lsun"] == pytest.approx(1.0, abs=0.06)
    assert made[2]["spectral_class"] == ""


def test_a_temperature_serves_where_the_type_is_beyond_the_tables(refused, tmp_path):
    (row,) = rows(opened(tmp_path, "name,dist,V,SpT,Teff\nred,10,9,M8V,2600\n"))
    assert (row["teff_k"], row["log_g_src"]) == (2600.0, "derived:mass and radius")
    refused(r"mine.csv row 1 \(red\) column sp_type = M8V.*teff_k", opened, tmp_path, "name,dist,V,SpT\nred,10,9,M8V\n")


def test_a_luminosity_that_cannot_be_right_is_flagged(tmp_path):
    text = (
        "name,plx,V,SpT,Teff,logg,lum\narcsec for mas,0.274,3.5,G8V,,,\nfaint,100,15,G2V,,,\ntau Cet,274,3.5,G8V,,,\n"
        "Arcturus,88.8,-0.05,K1.5III,,,\nBarnard,547,9.51,M4V,3195,,\nBarnard too,547,9.51,M4V,3195,,0.0034\n"
        "dwarf by gravity,5,3.5,,5300,4.5,\n"
    )
    made = {
        row["name"]: flags(row) & {"luminosity_conflict", "luminosity_extrapolated"}
        for row in rows(opened(tmp_path, text))
    }
    assert made == {
        "arcsec for mas": {"luminosity_conflict"},
        "faint": {"luminosity_conflict"},
        "tau Cet": set(),
        "Arcturus": set(),
        "Barnard": {"luminosity_extrapolated"},
        "Barnard too": set(),
        "dwarf by gravity": {"luminosity_conflict"},
    }


def test_companions_that_the_table_does_not_mention_are_flagged_and_known_ones_named(tmp_path):
    text = "name,hip,plx,V,SpT\nAlpha Centauri B,,747,1.33,K1V\nmine,71683,747,0,G2V\ntau Cet,,274,3.5,G8V\n"
    made = opened(tmp_path, text)
    assert all("companions_not_listed" in flags(row) for row in rows(made))
    assert made.notes == (
        "mine.csv: light of companions that the snapshot knows is left out, no companion column: "
        "Alpha Centauri B, mine",
    )
    told = opened(tmp_path, "name,plx,V,SpT,close_companion\nalf Cen B,747,1.33,K1V,yes\nalf Cen A,747,0,G2V,\n")
    assert ["companions_not_listed" in flags(row) for row in rows(told)] == [False, True]
    assert [note.rpartition(": ")[2] for note in told.notes] == ["alf Cen A"]


def test_results_with_a_users_stars_credit_nobody_else_for_them(tmp_path):
    own, snapshot = opened(tmp_path, SIMPLE), open_catalogue()
    assert own.provenance.startswith("user's table of 2 stars (mine.csv ")
    assert "user's table of 1 star (" in opened(tmp_path, SIMPLE.replace("second,20,6,K1V\n", "")).provenance
    assert not any("SIMBAD" in credit for credit in data_credits(own.provenance))
    assert any("SIMBAD" in credit for credit in data_credits(snapshot.provenance))
    assert set(data_credits(own.provenance)) < set(data_credits(snapshot.provenance))


def test_distance_wins_over_a_parallax_that_contradicts_it(tmp_path):
    made = rows(opened(tmp_path, "name,dist,plx,V,SpT\nx,10,100.5,5,G2V\ny,10,50,5,G2V\nz,,50,5,G2V\n"))
    assert [row["distance_pc"] for row in made] == [10.0, 10.0, 20.0]
    assert ["distance_conflict" in flags(row) for row in made] == [False, True, False]


def test_a_companion_by_its_own_v(tmp_path):
    (row,) = rows(opened(tmp_path, "name,dist,V,SpT,companion_sep_arcsec,companion_v_mag\nx,10,5,G2V,20,7.5\n"))
    assert row["companion_delta_v_mag"] == 2.5
    assert row["close_companion"] is False, "20 arcsec is not close"
    assert np.isnan(row["companion_pa_deg"])


def test_formats_by_content_whatever_the_name(tmp_path):
    table = Table(
        {
            "name": ["a", "b"],
            "plx": [50.0, 40.0] * u.mas,
            "Vmag": [5.0, 6.0] * u.mag,
            "SpType": ["G2V", "K1V"],
            "Teff": MaskedColumn([5800, 0], mask=[False, True]),
        }
    )
    expected = None
    for kind, name in (("ascii.ecsv", "a.txt"), ("votable", "b.dat"), ("fits", "c.table"), ("ascii.csv", "d")):
        table.write(tmp_path / name, format=kind)
        found = [
            {key: value for key, value in row.items() if not key.endswith("_src")}
            for row in rows(open_catalogue(tmp_path / name))
        ]
        expected = expected or found
        same(found, expected)
    assert [row["teff_k"] for row in expected] == [5800.0, stellar_parameters("K1V").teff_k]


def test_a_byte_order_mark_does_not_hide_an_ecsv(tmp_path):
    text = io.StringIO()
    Table({"name": ["a"], "plx": [0.05] * u.arcsec, "V": [5.0], "SpT": ["G2V"]}).write(text, format="ascii.ecsv")
    (row,) = rows(opened(tmp_path, "\ufeff" + text.getvalue()))
    assert row["distance_pc"] == pytest.approx(20.0)


def test_several_tables_in_a_votable_are_said(tmp_path):
    file = from_table(Table({"name": ["a"], "dist": [10.0], "V": [5.0], "SpT": ["G2V"]}))
    file.resources[0].tables.append(from_table(Table({"x": [1]})).resources[0].tables[0])
    file.to_xml(str(tmp_path / "two.xml"))
    made = open_catalogue(tmp_path / "two.xml")
    assert len(made.table) == 1
    assert "several tables" in made.notes[0]


def test_the_shipped_table_itself_is_a_valid_table(tmp_path):
    """Saved and read as a user's table, the snapshot keeps names, distances, V and temperatures."""
    stars = load_stars()
    names = [name for name in stars.columns if not name.endswith("_src")]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(names)
    for i in range(len(stars)):
        row = stars.row(i)
        writer.writerow(["" if isinstance(row[name], float) and math.isnan(row[name]) else row[name] for name in names])
    made = opened(tmp_path, text.getvalue())
    for name in """
        name hip distance_pc v_mag teff_k log_g metallicity luminosity_lsun sp_type companion_sep_arcsec
        companion_pa_deg companion_delta_v_mag close_companion
    """.split():
        np.testing.assert_array_equal(made.table.column(name), stars.column(name), err_msg=name)


def test_provenance_has_name_and_content_but_no_folder(tmp_path):
    one = opened(tmp_path, SIMPLE)
    (tmp_path / "deep").mkdir()
    two = opened(tmp_path / "deep", SIMPLE)
    other = opened(tmp_path, SIMPLE.replace("5.5", "5.6"))
    assert one.provenance == two.provenance != other.provenance
    assert "mine.csv" in one.provenance
    assert str(tmp_path) not in one.provenance
    assert one.ranked_v_mag is None


ROW = st.fixed_dictionaries(
    {
        "distance_pc": st.floats(1, 9990),
        "v_mag": st.floats(-0.9, 25),
        "teff_k": st.floats(2000, 9990),
        "log_g": st.none() | st.floats(-0.9, 7),
        "metallicity": st.none() | st.floats(-5, 1.5),
        "ra_deg": st.none() | st.floats(0, 359.999),
        "dec_deg": st.none() | st.floats(-90, 90),
        "sp_type": st.none() | st.sampled_from(["G2V", "K1 III", "sdF8", "M3.5V", "(G8)V", "F5IV-V"]),
    }
)


@settings(max_examples=40, deadline=None)
@given(table=st.lists(ROW, min_size=1, max_size=5))
def test_numbers_survive_csv_unchanged_and_nothing_is_left_undefined(tmp_path_factory, table):
    folder = tmp_path_factory.mktemp("t")
    text = io.StringIO()
    writer = csv.DictWriter(text, ["name", *table[0]])
    writer.writeheader()
    for i, row in enumerate(table):
        writer.writerow({"name": f"star {i}"} | {key: "" if value is None else value for key, value in row.items()})
    made = rows(opened(folder, text.getvalue()))
    for row, given_row in zip(made, table, strict=True):
        for key, value in given_row.items():
            if value is not None and key not in ("ra_deg", "dec_deg"):
                assert row[key] == value
        both = given_row["ra_deg"] is not None and given_row["dec_deg"] is not None
        assert math.isfinite(row["ra_deg"]) == both
        for key in ("teff_k", "log_g", "metallicity", "luminosity_lsun", "radius_rsun", "mass_msun", "parallax_mas"):
            assert math.isfinite(row[key]), key
        for key in ("log_g", "metallicity"):
            given_value = given_row[key] is not None
            assert row[f"{key}_src"].startswith("measured" if given_value else ("derived", "assumed"))
