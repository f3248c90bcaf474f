"""The table of synonyms: its own rows, and tables in the forms of the field's sources."""

import csv
import math
from pathlib import Path

import pytest
import yaml
from astropy import units as u

from catalogs import QUANTITIES
from catalogs.known_planets import COLUMNS, load_known_planets
from catalogs.nomenclature import designation_key
from catalogs.table_cells import CONVENTIONS, heading
from catalogs.table_files import TableBytes, parse_table
from catalogs.user_tables import user_table

KINDS = {"stars": QUANTITIES, "planets": COLUMNS}
FILE = Path(__file__).resolve().parents[2] / "catalogs" / "data" / "headings.csv"
with FILE.open(encoding="utf-8", newline="") as stream:
    ROWS = list(csv.DictReader(stream))
FORMS = yaml.safe_load((Path(__file__).parent / "forms.yaml").read_text(encoding="utf-8"))
LOGARITHMS = {"dex(cm/s2)": "cm/s2", "dex(solLum)": "solLum", "dex": ""}


def of(row, key):
    return [word for word in row["convention"].split() if word.startswith("beside:") == (key == "beside")]


def test_every_row_is_of_a_quantity_and_of_the_closed_list_of_conventions():
    assert list(ROWS[0]) == ["table", "quantity", "source", "headings", "unit", "convention"]
    for row in ROWS:
        assert row["quantity"] in ("", *KINDS[row["table"]]), row
        assert row["source"]
        assert row["headings"]
        assert set(of(row, "convention")) <= set(CONVENTIONS), row
        assert len(of(row, "beside")) <= 1


def test_every_heading_reduces_to_itself():
    for row in ROWS:
        for form in (*row["headings"].split(), *(word.removeprefix("beside:") for word in of(row, "beside"))):
            assert heading(form) == form.lower(), row


def test_units_are_those_of_their_quantities():
    for row in ROWS:
        unit = row["unit"]
        if "limit" in of(row, "convention") or not unit:
            continue
        column = KINDS[row["table"]][row["quantity"]]
        assert column.kind in ("float", "text", "int", "whole"), row
        if column.kind == "float":
            own, theirs = (u.Unit(LOGARITHMS.get(text, text)) for text in (column.unit, unit))
            equivalent = theirs.is_equivalent(own) or (theirs == u.hourangle and own.physical_type in ("angle", "time"))
            assert equivalent, row


def test_what_stands_together_has_the_same_sources():
    """A right ascension of one epoch is never read with a declination of another, nor an error of one side alone."""
    for one, two in (("ra_deg", "dec_deg"), ("pm_ra_mas_yr", "pm_dec_mas_yr")):
        angles = [row for row in ROWS if row["unit"] != "hourangle"]  # hours may stand beside degrees
        found = [
            {(row["source"], row["convention"]) for row in angles if row["quantity"] == name} for name in (one, two)
        ]
        hours = {(row["source"], row["convention"]) for row in ROWS if row["unit"] == "hourangle"}
        assert found[0] == found[1] - (hours - found[0])
    for row in ROWS:
        if "error_upper" in row["convention"]:
            upper = {(row["quantity"], row["source"]): len(row["headings"].split())}
            lower = {
                (other["quantity"], other["source"]): len(other["headings"].split())
                for other in ROWS
                if "error_lower" in other["convention"]
            }
            assert set(upper) <= set(lower), row


def same(given, wanted):
    if isinstance(wanted, str):
        return str(given) == wanted
    if wanted is None:
        return given == "" or math.isnan(given)
    digits = 2e-6 if abs(wanted) < 1e6 else 1e-9  # a Julian date to minutes
    return float(given) == pytest.approx(float(wanted), rel=digits, abs=2e-7)


def forms(kind):
    return [pytest.param(form["table"], form["means"], id=source) for source, form in FORMS[kind].items()]


@pytest.mark.parametrize(("text", "means"), forms("stars"))
def test_stars_of_a_source_are_read_as_it_means_them(text, means):
    table = user_table(parse_table(TableBytes("source.txt", text.encode(), ""))).table
    rows = {designation_key(name): i for i, name in enumerate(table.column("name").tolist())}
    assert len(rows) == sum(wanted is not None for wanted in means.values())
    for name, wanted in means.items():
        assert (designation_key(name) in rows) == (wanted is not None), sorted(rows)
        for quantity, value in (wanted or {}).items():
            given = table.row(rows[designation_key(name)])[quantity]
            assert same(given, value), f"{name} {quantity}: {given}"


@pytest.mark.parametrize(("text", "means"), forms("planets"))
def test_planets_of_a_source_are_read_as_it_means_them(tmp_path, text, means):
    (tmp_path / "source.txt").write_text(text, encoding="utf-8")
    table = load_known_planets(f"none+{tmp_path / 'source.txt'}")
    names = table.text("planet")
    assert len(names) == len(means)
    for name, wanted in means.items():
        row = names.index(name)
        for quantity, value in wanted.items():
            given = table.text(quantity)[row] if isinstance(value, str) else table.number(quantity)[row]
            if quantity == "omega_star_deg":
                given %= 360.0
            assert same(given, value), f"{name} {quantity}: {given}"


def test_a_planet_that_does_not_tell_its_star_is_left_out():
    text = "pl_name,sy_dist,sy_vmag,st_spectype\nnameless,10,5,G2V\n47 UMa b,13.8,5.03,G0V\n"
    made = user_table(parse_table(TableBytes("source.csv", text.encode(), "")))
    assert made.table.column("name").tolist() == ["47 UMa"]
    assert [(item.row, item.done) for item in made.left_out] == [(1, "row left out")]


@pytest.mark.parametrize("text", ["e[Fe/H]", "e [Fe/H]", "a [Fe/H]"])
def test_a_unit_of_another_quantity_makes_a_heading_another_one(tmp_path, text):
    (tmp_path / "mine.csv").write_text(f"star,planet,period,msini,{text}\nmine,mine b,100,1,0.03\n", encoding="utf-8")
    table = load_known_planets(f"none+{tmp_path / 'mine.csv'}")
    assert math.isnan(table.number("eccentricity")[0])
    assert math.isnan(table.number("semi_major_axis_au")[0])


UCDS = """<?xml version="1.0"?><VOTABLE version="1.3"><RESOURCE><TABLE>
<FIELD name="Stern" datatype="char" arraysize="*" ucd="meta.id;meta.main"/>
<FIELD name="alpha" datatype="double" unit="deg" ucd="pos.eq.ra;meta.main"/>
<FIELD name="delta" datatype="double" unit="deg" ucd="pos.eq.dec;meta.main"/>
<FIELD name="pi" datatype="double" unit="arcsec" ucd="pos.parallax.trig"/>
<FIELD name="{heading}" datatype="double" unit="mag" ucd="phot.mag;em.opt.V"/>
<FIELD name="Typ" datatype="char" arraysize="*" ucd="src.spType"/>
<FIELD name="T1" datatype="double" unit="K" ucd="phys.temperature.effective"/>
<FIELD name="T2" datatype="double" unit="K" ucd="phys.temperature.effective"/>
<DATA><TABLEDATA><TR><TD>tau Cet</TD><TD>26.017</TD><TD>-15.937</TD><TD>0.27381</TD><TD>3.5</TD><TD>G8V</TD>
<TD>5333</TD><TD>1</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>"""


def test_a_ucd_tells_what_a_heading_does_not():
    row = user_table(parse_table(TableBytes("a.vot", UCDS.format(heading="hell").encode(), ""))).table.row(0)
    assert (row["name"], row["ra_deg"], row["dec_deg"], row["v_mag"]) == ("tau Cet", 26.017, -15.937, 3.5)
    assert row["parallax_mas"] == pytest.approx(273.81)
    assert row["teff_k_src"].startswith("derived:spectral type"), "two columns with one UCD: neither is taken"


def test_what_is_known_to_be_another_quantity_is_not_taken_for_its_ucd(refused):
    table = parse_table(TableBytes("a.vot", UCDS.format(heading="VTmag").encode(), ""))
    refused("v_mag", user_table, table)


@pytest.mark.parametrize(
    ("kind", "text"),
    [("stars", text) for text in ("K", "gmag", "VTmag", "Hpmag", "BTmag", "rad", "st_rad", "PM", "pm", "_r", "RAB1950")]
    + [("stars", text) for text in ("ra2016", "sy_plxh2", "RA_EU", "GLON", "id", "ID", "rowid", "angDist", "r", "Imag")]
    + [("planets", text) for text in ("K", "k", "T", "T0", "lambda_angle", "tzero_vr", "tzero_tr_sec", "pl_rvamp", "r")]
    + [("planets", text) for text in ("angular_distance", "star_radius", "pl_eqt", "pl_insol", "st_rad", "periastron")],
)
def test_what_is_none_of_our_quantities_is_not_read(kind, text):
    assert KINDS[kind].meant_by(text).column is None


@pytest.mark.parametrize(
    ("kind", "one", "two"),
    [("stars", "gmag", "Gmag"), ("stars", "rad", "RA_d"), ("planets", "omega", "Omega"), ("stars", "b", "B")],
)
def test_a_capital_makes_another_quantity(kind, one, two):
    found = [KINDS[kind].meant_by(text).column for text in (one, two)]
    assert found[1] is not None
    assert found[0] != found[1]


def test_galactic_coordinates_are_no_luminosity_and_no_colour():
    text = "name,L,B,V,d,SpT\ntau Cet,173.1,-73.4,3.5,3.65,G8V\neps Eri,195.8,15.3,3.73,3.2,K2V\n"
    table = user_table(parse_table(TableBytes("mine.csv", text.encode(), ""))).table
    assert all(text.startswith("derived") for text in table.column("luminosity_lsun_src"))
    assert [math.isnan(colour) for colour in table.column("b_v_mag")] == [True, True]
