"""Tables of a user's own that are refused, in one line with file, row, column, value and range."""

import re

import pytest
from astropy.table import Table
from hypothesis import given, settings
from hypothesis import strategies as st

from catalogs.catalogue import open_catalogue
from catalogs.errors import InputError

SIMPLE = "name,distance_pc,v_mag,sp_type\nfirst,10,5.5,G2V\nsecond,20,6,K1V\n"
TEXT = st.text(st.characters(codec="utf-8", categories=["L", "N"]), min_size=1, max_size=12)


def refusal_of(tmp_path, content):
    """What is said on a file of this content."""
    (tmp_path / "mine.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as refusal:
        open_catalogue(tmp_path / "mine.csv")
    return str(refusal.value)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("v_mag", "Jy"),
        ("v_mag", "mag(AB)"),
        ("teff_k", "deg_C"),
        ("distance_pc", "mas"),
        ("teff_k", "eV"),
        ("log_g", "m"),
        ("metallicity", "K"),
        ("parallax_mas", "furlong"),
    ],
)
def test_other_units_are_refused_by_name(tmp_path, name, unit):
    header = {"name": "x", "distance_pc": "10", "v_mag": "5", "sp_type": "G2V"} | {name: "1"}
    text = (
        ",".join(f"{key} [{unit}]" if key == name else key for key in header) + "\n" + ",".join(header.values()) + "\n"
    )
    message = refusal_of(tmp_path, text)
    assert all(word in message for word in ("mine.csv", name, unit))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("third,abc,5,G2V", ["row 3 (third)", "distance_pc", "abc pc", "0.01 to 100000 pc"]),
        ("third,-10,5,G2V", ["row 3 (third)", "distance_pc", "-10", "0.01"]),
        ("third,0,5,G2V", ["row 3 (third)", "distance_pc"]),
        ("third,inf,5,G2V", ["row 3 (third)", "distance_pc"]),
        ("third,1_0,5,G2V", ["row 3 (third)", "distance_pc"]),
        ("third,10,nan,G2V", ["row 3 (third)", "v_mag", "missing", "-30 to 30 mag"]),
        ("third,10,,G2V", ["row 3 (third)", "v_mag", "missing"]),
        ("third,,5,G2V", ["row 3 (third)", "distance_pc", "missing", "pc"]),
        ("third,10,99,G2V", ["row 3 (third)", "v_mag", "99", "-30 to 30 mag"]),
        ("third,10,5,", ["row 3 (third)", "sp_type", "missing", "G2V"]),
        ("third,10,5,DA2", ["row 3 (third)", "sp_type", "DA2", "teff_k"]),
        ("third,10,5,blob", ["row 3 (third)", "sp_type", "blob", "teff_k"]),
        (",10,5,G2V", ["row 3", "name", "missing"]),
        ("FIRST,10,5,G2V", ["row 3", "name", "FIRST", "rows 1 and 3"]),
        ("third,10,5", ["row 3", "3 cells", "4"]),
        ("third,10,5,G2V,x", ["row 3", "5 cells", "4"]),
        ('third,10,"5,G2V', ["quoting"]),
    ],
)
def test_a_bad_row_is_named_with_column_value_and_range(tmp_path, line, words):
    text = refusal_of(tmp_path, SIMPLE + line + "\n")
    assert text.startswith("mine.csv")
    assert all(word in text for word in words), text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("parallax_mas", "-5", "0.01 to 100000 mas"),
        ("parallax_mas", "0", "0.01"),
        ("teff_k", "57", "2000 to 50000 K"),
        ("log_g", "44", "-2 to 7"),
        ("metallicity", "12", "-5 to 1.5 dex"),
        ("ra_deg", "400", "0 to 360 deg"),
        ("dec_deg", "-91", "-90 to 90 deg"),
        ("luminosity_lsun", "-1", "1e-06 to 1e+07"),
        ("hip", "abc", "Hipparcos number"),
        ("hip", "999999", "120404"),
        ("close_companion", "maybe", "yes or no"),
        ("companion_sep_arcsec", "-1", "arcsec"),
        ("ra_deg", "14 39 36.5", "a number"),
    ],
)
def test_optional_columns_have_ranges_too(tmp_path, name, value, allowed):
    text = f"name,distance_pc,v_mag,sp_type,{name}\nx,10,5,G2V,{value}\n"
    message = refusal_of(tmp_path, text)
    assert all(word in message for word in ("mine.csv row 1 (x)", name, value, allowed)), message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["mine.csv", "empty"]),
        (" \n\n", ["mine.csv", "empty"]),
        ("name,distance_pc,v_mag,sp_type\n", ["mine.csv", "no rows"]),
        ("x,10,5,G2V\ny,11,6,K1V\n", ["mine.csv", "first line"]),
        ("just words\nand more\n", ["separated by comma"]),
        (
            "distance_pc,v_mag,sp_type\n10,5,G2V\n",
            ["column name", "missing", "the file has: distance_pc, v_mag, sp_type"],
        ),
        ("name,v_mag,sp_type\nx,5,G2V\n", ["distance_pc or parallax_mas", "plx", "dist"]),
        ("name,dist,sp_type\nx,5,G2V\n", ["column v_mag", "johnsonv"]),
        ("name,dist,V\nx,5,5\n", ["sp_type or teff_k", "spt", "teff"]),
        (
            "designation,parallax,phot_g_mean_mag,bp_rp\nGaia DR3 1,100,4.8,0.8\n",
            ["column v_mag, sp_type or teff_k = missing", "the file has: designation, parallax, phot_g_mean_mag"],
        ),
        ("name,dist,V,SpT\n,,,\n", ["mine.csv", "no rows"]),
        ("name,dist,V,Vmag,SpT\nx,5,5,6,G2V\n", ["V and Vmag", "one column for v_mag"]),
        (bytes(range(256)) * 20, ["mine.csv", "binary"]),
        ("name,dist,V,SpT\nZoë,5,5,G2V\n".encode("latin-1"), ["mine.csv", "UTF-8"]),
        (b"SIMPLE  =                    T / broken", ["mine.csv", "FITS"]),
        ('<?xml version="1.0"?><VOTABLE><RESOURCE>', ["mine.csv", "VOTable"]),
        ("# %ECSV 1.0\n# ---\n# datatype: [}\nx\n", ["mine.csv", "ECSV"]),
    ],
)
def test_unusable_files_are_refused_in_one_line(tmp_path, text, words):
    message = refusal_of(tmp_path, text)
    assert all(word in message for word in words), message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("path", "words"), [("nothere.csv", "No such file"), (".", "folder"), ("", "snapshot, latest"), ("a\0b", "null")]
)
def test_places_without_a_table(path, words):
    with pytest.raises(InputError, match=words):
        open_catalogue(path)


@pytest.mark.parametrize(
    "text",
    [
        'name,dist,V,SpT\nx,"3,65",5,G2V\n',  # between commas it may be a thousands separator
        "name\tdist\tV\tSpT\nx\t3,65\t5\tG2V\n",
        "name;dist;V;SpT\nx;3,65;5;G2V\ny;1.234,5;5;G2V\n",
    ],
)
def test_a_doubtful_decimal_comma_is_refused_with_a_hint(tmp_path, text):
    assert re.search("3,65 pc.*decimal point", refusal_of(tmp_path, text))


def test_columns_of_arrays_are_refused(tmp_path):
    Table({"name": ["a"], "dist": [[1.0, 2.0]], "V": [5.0], "SpT": ["G2V"]}).write(tmp_path / "t.fits")
    with pytest.raises(InputError, match=r"t\.fits column dist = 2-dimensional"):
        open_catalogue(tmp_path / "t.fits")


@settings(max_examples=200, deadline=None)
@given(
    data=st.binary(max_size=300)
    | TEXT.map(str.encode)
    | st.lists(st.text("abc,;\n\t\"'#|0.5- ", max_size=40), max_size=6).map(lambda parts: "\n".join(parts).encode())
)
def test_any_file_is_read_or_refused_in_one_line(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(data)
    refused = None
    try:
        open_catalogue(path)
    except InputError as refusal:
        refused = str(refusal)
    assert refused is None or ("\n" not in refused and "any.csv" in refused)
