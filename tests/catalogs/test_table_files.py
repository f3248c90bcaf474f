"""Tables from files: nulls of every format are missing, and what a file says of its own completeness is heard."""

import io

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import MaskedColumn, Table

from catalogs import load_known_planets, open_catalogue
from catalogs.table_files import TableBytes, parse_table

STARS = Table(
    {
        "name": ["HD 10700", "HD 22049"],
        "plx": [273.8, 310.6],
        "v_mag": [3.49, 3.72],
        "sp_type": MaskedColumn(["G8V", "K2V"], mask=[False, False]),
        "teff": [5344.0, 5077.0],
    }
)


def parsed(data, name="mine.dat"):
    return parse_table(TableBytes(name, data, ""))


def cells(table):
    return {column.heading: column.cells.tolist() for column in table.columns}


def with_cards(columns, **cards):
    """The bytes of a FITS table, whose header says more of the integers than astropy writes."""
    file = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns(columns)]).writeto(file)
    with fits.open(io.BytesIO(file.getvalue())) as units:
        header, start = units[1].header.copy(), units.fileinfo(1)["datLoc"]
    header.update(cards)
    return (fits.PrimaryHDU().header.tostring() + header.tostring()).encode() + file.getvalue()[start:]


@pytest.mark.parametrize(
    ("form", "dtype", "null"), [("I", "i2", -9999), ("I", "i2", -32768), ("J", "i4", -1), ("B", "u1", 255)]
)
@pytest.mark.parametrize("scale", [{}, {"TSCAL1": 0.01}, {"TZERO1": 3.5}, {"TSCAL1": 0.5, "TZERO1": -2.0}])
def test_null_integers_of_fits_are_missing_before_they_are_scaled(form, dtype, null, scale):
    raw = np.array([52, null, 37]).astype(dtype)
    found = cells(parsed(with_cards([fits.Column("v", form, array=raw)], TNULL1=null, **scale)))["v"]
    expected = [value * scale.get("TSCAL1", 1.0) + scale.get("TZERO1", 0.0) for value in (52, 37)]
    assert found[1] is None
    assert found[::2] == pytest.approx(expected)


def test_null_integers_without_a_sign_are_missing():
    column = fits.Column("n", "I", bzero=32768, array=np.array([1, 65535, 40000], np.uint16))
    assert cells(parsed(with_cards([column], TNULL1=32767)))["n"] == [1, None, 40000]
    assert cells(parsed(with_cards([column])))["n"] == [1, 65535, 40000], "no TNULL, no null"


def test_a_star_without_v_in_a_scaled_column_is_refused(refused, tmp_path):
    columns = [
        fits.Column("name", "8A", array=np.array(["HD 10700", "HD 22049"])),
        fits.Column("plx", "D", array=np.array([273.8, 310.6])),
        fits.Column("V", "I", array=np.array([3490, -9999])),
        fits.Column("sp_type", "3A", array=np.array(["G8V", "K2V"])),
        fits.Column("rv", "I", array=np.array([-9999, 1600])),
    ]
    path = tmp_path / "v.fits"
    path.write_bytes(with_cards(columns, TSCAL3=0.001, TNULL3=-9999, TSCAL5=0.01, TNULL5=-9999))
    refused(r"v.fits row 2 \(HD 22049\) column V = missing", open_catalogue, path, strict=True)
    path.write_bytes(with_cards(columns, TSCAL3=0.001, TSCAL5=0.01, TNULL5=-9999, TZERO3=10.0))
    first, second = open_catalogue(path).table.column("rv_km_s")
    assert np.isnan(first) or first == 0.0
    assert second == pytest.approx(16.0)


@pytest.mark.parametrize("form", ["tabledata", "binary2"])
@pytest.mark.parametrize("kind", ["S3", "U3"])
def test_null_texts_of_a_votable_are_missing(form, kind):
    table = Table(
        {
            "name": ["a", "b", "c"],
            "sp_type": MaskedColumn(np.array(["K5V", "G8V", "K1V"], kind), mask=[False, True, False]),
            "hip": MaskedColumn([1, 2, 3], mask=[True, False, False]),
            "rv": MaskedColumn([1.5, 2.5, 3.5], mask=[False, False, True]),
        }
    )
    file = io.BytesIO()
    table.write(file, format="votable", tabledata_format=form)
    found = cells(parsed(file.getvalue()))
    assert found == {
        "name": ["a", "b", "c"],
        "sp_type": ["K5V", None, "K1V"],
        "hip": [None, 2, 3],
        "rv": [1.5, 2.5, None],
    }


def votable(status, place):
    file = io.BytesIO()
    STARS.write(file, format="votable")
    info = f'<INFO name="QUERY_STATUS" value="{status}">rows</INFO>'
    return file.getvalue().decode().replace(place, info + place, 1).encode()


def text(kind, remark):
    file = io.StringIO()
    STARS.write(file, format=f"ascii.{kind}")
    written = file.getvalue()
    if kind == "csv":
        return f"# {remark}\n{written}".encode()
    return written.replace("# ---\n", f"# ---\n# meta: {{{remark}}}\n", 1).encode()


def fits_table(remark):
    table = STARS.copy()
    table.meta["comments"] = [remark]
    file = io.BytesIO()
    table.write(file, format="fits")
    return file.getvalue()


CUT = [
    votable("OVERFLOW", "<TABLE>"),
    votable("OVERFLOW", "</RESOURCE>"),
    votable("overflow", "</TABLE>"),
    text("csv", "QUERY_STATUS=OVERFLOW"),
    text("csv", "The result was truncated to 2 rows."),
    text("ecsv", "QUERY_STATUS: OVERFLOW"),
    fits_table("QUERY_STATUS OVERFLOW"),
]
FAILED = [
    votable("ERROR", "<TABLE>"),
    votable("ERROR", "</RESOURCE>"),
    text("csv", "QUERY_STATUS=ERROR"),
    text("ecsv", "QUERY_STATUS: ERROR"),
    fits_table("QUERY_STATUS: ERROR"),
]


@pytest.mark.parametrize("data", CUT)
def test_a_table_that_says_that_it_was_cut_off_says_so_in_every_result(tmp_path, data):
    (tmp_path / "mine").write_bytes(data)
    made = open_catalogue(tmp_path / "mine")
    assert len(made.table) == 2
    assert "mine was cut off, as it says itself: rows are missing" in made.notes
    assert "cut off: rows are missing" in made.provenance
    assert "cut off: rows are missing" in made.sample


@pytest.mark.parametrize("data", FAILED)
def test_a_table_whose_query_failed_is_refused(refused, data):
    refused("^mine.dat = QUERY_STATUS ERROR", parsed, data)


@pytest.mark.parametrize("data", [votable("OK", "<TABLE>"), text("csv", "whole"), text("ecsv", "a: b")])
def test_other_tables_are_whole(tmp_path, data):
    (tmp_path / "mine").write_bytes(data)
    made = open_catalogue(tmp_path / "mine")
    assert "cut off" not in made.provenance
    assert not any("cut off" in note for note in made.notes)


def test_planets_of_a_table_that_was_cut_off_are_said_to_be(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("# OVERFLOW\nstar,planet,period,msini\nHD 10700,x,1000,1\n")
    assert "cut off: rows are missing" in load_known_planets(f"none+{path}").provenance
