"""Tables from files: nulls of every format are missing, and what a file says of its own completeness is heard."""

import gzip
import io
import json
import zipfile
from datetime import time, timedelta

import numpy as np
import openpyxl
import pyarrow as pa
import pytest
from astropy.io import fits
from astropy.table import MaskedColumn, Table
from pyarrow import parquet

from catalogs import load_known_planets, open_catalogue, table_files
from catalogs.table_files import ROW_OUT, TableBytes, column_of, parse_table, read_bytes
from cpic_core import InputError

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


@pytest.mark.parametrize(
    "data",
    [
        votable("OK", "<TABLE>"),
        text("csv", "whole"),
        text("csv", "Truncated at T<1% due to noise"),
        text("ecsv", "a: b"),
    ],
)
def test_other_tables_are_whole(tmp_path, data):
    (tmp_path / "mine").write_bytes(data)
    made = open_catalogue(tmp_path / "mine")
    assert "cut off" not in made.provenance
    assert not any("cut off" in note for note in made.notes)


def test_planets_of_a_table_that_was_cut_off_are_said_to_be(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("# OVERFLOW\nstar,planet,period,msini\nHD 10700,x,1000,1\n")
    assert "cut off: rows are missing" in load_known_planets(f"none+{path}").provenance


def test_rows_of_another_number_of_cells_are_left_out_and_listed():
    table = parsed(b"name,V,plx\na,1,2\nb,3\n,,\nc,4,5,,\nd,6,7,8\n\ne,9,10\n")
    assert cells(table) == {"name": ["a", "c", "e"], "V": ["1", "4", "9"], "plx": ["2", "5", "10"]}
    why = "allowed: 3 cells, as in the heading"
    rows = ((item.row, item.value, item.why, item.done) for item in table.rejects)
    assert [*rows] == [(2, "2 cells", why, ROW_OUT), (4, "4 cells", why, ROW_OUT)]
    assert table.numbers.tolist() == [1, 3, 5]


def test_a_table_of_broken_rows_alone_is_refused(refused):
    refused(r"mine.dat row 1 = 2 cells: .*3 cells, as in the heading", parsed, b"name,V,plx\nb,3\nd,6,7,8\n")


def test_cells_without_types_keep_every_digit():
    found = cells(parsed(b"source_id,HIP,V\n2452378776434477184,1475B,03.490\n5164707970261890560,16537,NULL\n"))
    assert found["source_id"] == ["2452378776434477184", "5164707970261890560"]
    assert found["HIP"] == ["1475B", "16537"]
    assert found["V"] == ["03.490", None]


def test_repeated_headings_are_kept():
    table = parsed(b"HIP,V,HIP\n8102,3.5,8102\n16537,3.7,1\n")
    assert [column.heading for column in table.columns] == ["HIP", "V", "HIP"]
    assert [column.cells.tolist() for column in table.columns][2] == ["8102", "1"]


@pytest.mark.parametrize("word", ["", " ", "nan", "NaN", "NULL", "None", "N/A", "--", "-", "~", "...", r"\N", "<NA>"])
def test_words_for_missing_values_are_none(word):
    assert cells(parsed(f"name,V,x\na,{word},1\n".encode()))["V"] == [None]


@pytest.mark.parametrize("heading", ["DE-", "DEsign", "sign"])
def test_the_sign_of_a_declination_is_no_missing_value(heading):
    found = cells(parsed(f"name,{heading},DEd,DEm\nalf Aqr,-,00,19\nx,+,00,01\ny,,-,5\n".encode()))
    assert found[heading] == ["-", "+", None]
    assert found["DEd"] == ["00", "00", None]


@pytest.mark.parametrize(
    ("encoding", "said"),
    [("utf-8", ""), ("utf-8-sig", ""), ("utf-16", "UTF-16"), ("cp1252", "Windows-1252"), ("latin-1", "Windows-1252")],
)
def test_texts_of_other_encodings_are_read_and_it_is_said(encoding, said):
    table = parsed("name;Bayer;V\nZoë;µ Cas;5,2\n".encode(encoding))
    assert cells(table) == {"name": ["Zoë"], "Bayer": ["µ Cas"], "V": ["5.2"]}
    notes = (f"mine.dat: read as {said}, not being UTF-8",) if said else ()
    assert table.notes == (*notes, "mine.dat: decimal commas read in V")


@pytest.mark.parametrize("encoding", ["utf-16", "iso-8859-1"])
def test_a_votable_of_another_encoding_is_guarded_too(refused, encoding):
    start = (
        f'<?xml version="1.0" encoding="{encoding}"?><VOTABLE><RESOURCE><TABLE><FIELD name="ö" datatype="int"/><DATA>'
    )
    rows = "<TABLEDATA><TR><TD>1</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>"
    assert cells(parsed((start + rows).encode(encoding))) == {"ö": [1]}
    stream = start + '<BINARY><STREAM href="file:///etc/passwd"/></BINARY></DATA></TABLE></RESOURCE></VOTABLE>'
    refused("a STREAM with href", parsed, stream.encode(encoding))


def test_what_hides_in_the_cells_of_a_votable_is_seen(refused):
    start = '<VOTABLE><RESOURCE><TABLE><FIELD name="x" datatype="int"/><DATA>'
    stream = '<BINARY><STREAM href="file:///etc/passwd"/></BINARY>'
    for hidden in (
        f"<TABLEDATA>{stream}</TABLEDATA>",
        f"<!-- <TABLEDATA> -->{stream}<!-- </TABLEDATA> -->",
        f"<!-- <TABLEDATA> --><TABLEDATA><TR></TR></TABLEDATA>{stream}",
        f"<![CDATA[<TABLEDATA>]]><TABLEDATA><TR></TR></TABLEDATA>{stream}",
        f"<TABLEDATA><TR><TD>1</TD></TR></TABLEDATA>{stream}",
    ):
        refused("a STREAM with href", parsed, f"{start}{hidden}</DATA></TABLE></RESOURCE></VOTABLE>".encode())


BYTES = """Byte-by-byte Description of file: {name}
--------------------------------------------------------------------------------
   Bytes Format Units   Label     Explanations
--------------------------------------------------------------------------------
   1-  8  A8    ---     Name      Star
  10- 11  I2    h       RAh       Hours
  13- 14  I2    min     RAm       Minutes
  16- 20  F5.2  s       RAs       Seconds
      22  A1    ---     DE-       Sign
  23- 24  I2    deg     DEd       Degrees
  26- 27  I2    arcmin  DEm       Minutes
  29- 32  F4.1  arcsec  DEs       Seconds
  34- 37  F4.2  mag     Vmag      ? V
--------------------------------------------------------------------------------
"""
ROWS = """tau Cet  01 44 04.08 -15 56 14.9 3.49
alf Aqr  22 05 47.04 -00 19 11.5
x        00 00 01.00 +00 00 05.0 9.00
"""
README = "J/AAA/1  Stars  (Doe, 2026)\n\n" + BYTES.format(name="stars.dat") + "\n" + BYTES.format(name="other.dat")


def described_rows(table):
    found = cells(table)
    assert found["DE-"] == ["-", "-", "+"]
    assert found["DEd"] == [15, 0, 0]
    assert found["DEs"] == [14.9, 11.5, 5.0]
    assert found["Vmag"] == [3.49, None, 9.0]
    assert [column.unit for column in table.columns][1:4] == ["h", "min", "s"]
    assert table.columns[8].description == "V"


def test_declinations_in_parts_keep_their_sign_in_mrt_and_cds(tmp_path, refused):
    head = "Title: Stars\nAuthors: Doe\nTable: 1\n" + "=" * 80 + "\n"
    described_rows(parsed((head + BYTES.format(name="stars.dat") + ROWS).encode()))
    described_rows(parse_table(TableBytes("stars.dat", ROWS.encode(), ""), readme=README.encode()))
    (tmp_path / "stars.dat").write_text(ROWS)
    (tmp_path / "unknown.dat").write_text(ROWS)
    alone = read_bytes(tmp_path / "stars.dat").sha256
    (tmp_path / "ReadMe").write_text(README)
    beside = read_bytes(tmp_path / "stars.dat")
    described_rows(parse_table(beside))
    assert beside.sha256 != alone, "what is read has changed"
    assert read_bytes(tmp_path / "unknown.dat").data == ROWS.encode()


def test_nulls_of_ascii_tables_of_fits_are_missing():
    columns = [
        fits.Column("n", "I6", array=np.array([52, -999, 37]), ascii=True, null="-999"),
        fits.Column("v", "F8.3", array=np.array([3.5, 99.0, 3.75]), ascii=True, null="---"),
        fits.Column("b", "F8.3", array=np.array([1.5, 2.5, 77.0]), ascii=True),
    ]
    file = io.BytesIO()
    fits.TableHDU.from_columns(columns).writeto(file)
    data = file.getvalue().replace(b"  99.000", b"     ---").replace(b"  77.000", b"        ")
    assert cells(parsed(data)) == {"n": [52, None, 37], "v": [3.5, None, 3.75], "b": [1.5, 2.5, None]}


def test_first_of_several_tables_is_read_and_it_is_said():
    tables = [fits.BinTableHDU(STARS), fits.BinTableHDU(STARS[:1])]
    file = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), *tables]).writeto(file)
    assert parsed(file.getvalue()).notes == ("mine.dat holds several tables: the first is read",)


def test_the_largest_table_of_a_page_is_read_and_it_is_said():
    menu, last = "<table><tr><td>menu</table>", "<table><tr><th>c<tr><td>3</table>"
    stars = "<table><tr><th>a<th>b<br>c<tr><td>1&lt;2<td><i>x</i> y</table>"
    page = f"<html><table><tr><td>{menu}{stars}{last}<tr><td></table>"
    table = parsed(page.encode())
    assert cells(table) == {"a": ["1<2"], "b c": ["x y"]}
    assert table.notes == ("mine.dat holds several tables: the largest is read",)


def test_numbers_of_single_precision_are_the_decimals_that_they_stand_for():
    table = Table({"v": np.array([7.3, 0.1, np.nan], np.float32)})
    file = io.BytesIO()
    table.write(file, format="fits")
    single = io.BytesIO()
    parquet.write_table(pa.table({"v": pa.array([7.3, 0.1, None], pa.float32())}), single)
    for data in (file.getvalue(), single.getvalue()):
        column = parsed(data).columns[0].cells
        assert column.dtype == np.float64
        assert column.tolist() == [7.3, 0.1, None]


def test_columns_of_parquet_keep_their_kind_and_every_digit():
    file = io.BytesIO()
    made = {
        "source_id": pa.array([2452378776434477184, None], pa.int64()),
        "huge": pa.array([2**64 - 1, None], pa.uint64()),
        "ok": pa.array([None, True]),
        "name": pa.array(["tau Cet", None]).dictionary_encode(),
        "when": pa.array([None, 0], pa.timestamp("s")),
        "many": pa.array([[1, 2], None]),
    }
    parquet.write_table(pa.table(made), file)
    table = parsed(file.getvalue())
    assert cells(table) == {
        "source_id": [2452378776434477184, None],
        "huge": [str(2**64 - 1), None],
        "ok": [None, True],
        "name": ["tau Cet", None],
        "when": [None, "1970-01-01 00:00:00.000"],
    }
    assert table.notes == ("mine.dat: columns of several values per row are left out: many",)


def test_descriptions_and_ucds_travel():
    file = io.BytesIO()
    table = STARS[["name", "v_mag"]]
    table["v_mag"].description, table["v_mag"].meta["ucd"] = "Johnson V", "phot.mag;em.opt.V"
    table.write(file, format="votable")
    vizier = "#Column\tv_mag\t(F5.2)\t? Johnson V\t[ucd=phot.mag;em.opt.V]\nname\tv_mag\n \tmag\n--\t--\na\t5\n"
    for data, about in ((file.getvalue(), "Johnson V"), (vizier.encode(), "? Johnson V")):
        column = next(item for item in parsed(data).columns if item.heading == "v_mag")
        assert (column.description, column.ucd) == (about, "phot.mag;em.opt.V")


def test_cells_are_made_once():
    column = parsed(b"a,b\n1,2\n").columns[1]
    assert column.cells is column.cells


@pytest.mark.parametrize(
    ("given", "dtype", "read"),
    [
        ([True, None, False], np.bool_, [True, None, False]),
        ([1, None, 2**40], np.int64, [1, None, 2**40]),
        ([1, 2.5, None, float("nan")], np.float64, [1.0, 2.5, None, None]),
        (["a", 1, None, " ~ "], object, ["a", "1", None, None]),
        ([2**70, None], np.float64, [float(2**70), None]),
        ([None, None], object, [None, None]),
        ([], object, []),
    ],
)
def test_a_column_of_a_list(given, dtype, read):
    column = column_of("x", "mag", given)
    assert column.cells.dtype == dtype
    assert column.cells.tolist() == read
    assert json.dumps(column.cells.tolist())


def workbook(*parts):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in parts:
            archive.writestr(name, content)
    return file.getvalue()


def flat_parquet():
    file = io.BytesIO()
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(10**5, np.int32)), ["x" * 10**5])
    parquet.write_table(pa.table({"name": column}), file)
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), r"an old Excel file \(.xls\): .*save it as .xlsx or CSV"),
        (gzip.compress(b"name,V\na,5\n", mtime=0), "packed: .*unpack it first"),
        (workbook(("xl/workbook.xml", bytes(60_000_000))), "60 MB unpacked: .*up to 50 MB"),
        (workbook(("xl/workbook.xml", b"<!DOCTYPE x [<!ENTITY a 'b'>]><x/>")), "DOCTYPE"),
        (workbook(("a", b"b")), "unreadable: .*a whole Excel workbook"),
        (b"PAR1" + bytes(40), "unreadable: .*a whole Parquet file"),
        (b"<html><p>no rows</p></html>", "no table"),
        (fits.PrimaryHDU().header.tostring().encode().ljust(2880), "it has no table extension"),
        (b"Some words of prose\nthat say\nnothing at all of any star\n", "heading = one column"),
        (b"\\startdata\nx\n\\begin{tabular}{c}\na & b\n", "no rows"),
        (b"<html><table><tr><td></td></tr><tr><td>1</td></tr></table>", "heading = empty"),
    ],
)
def test_what_is_damaged_or_too_large_is_refused_in_one_line(refused, data, message):
    assert "\n" not in str(refused(f"^mine.dat.*{message}", parsed, data) or "")


def test_long_texts_of_a_short_parquet_file_are_refused(refused):
    data = flat_parquet()
    assert len(data) < 10**5
    refused("too long texts", parsed, data)


def test_pages_larger_than_50_mb_are_refused(refused, monkeypatch):
    monkeypatch.setattr(table_files, "_MAX_PAGE_BYTES", 100)
    for start in (b"<table><tr><th>a</tr>", b"\\begin{tabular}{c}\na & b \\\\\n\\end{tabular}\n"):
        refused("unpacked", parsed, start + b"<!-- % -->" * 20)


def test_commands_of_latex_and_pages_are_not_followed(tmp_path):
    secret = tmp_path / "secret.csv"
    secret.write_text("hidden,1\n")
    latex = (
        "\\begin{tabular}{cc}\nname & V \\\\\n" + rf"\input{{{secret}}} & 5 \\ $\tau$ Cet & $-$3.5 \\ \end{{tabular}}"
    )
    page = f'<table><tr><th>name<th>V<tr><td><object data="file://{secret}">x</object><td>5</table>'
    for text in (latex, page):
        assert "hidden" not in str(cells(parsed(text.encode())))
    assert cells(parsed(latex.encode()))["name"][1] == "tau Cet"
    assert cells(parsed(latex.encode()))["V"][1] == "-3.5"


@pytest.mark.parametrize(
    "text",
    [
        *(
            "\\tablehead{",
            "\\begin{tabular}",
            "\\begin{tabular}\n",
            "\\startdata",
            "\\a=b\r\n",
            "|a|b|\r\n",
            "<table>",
            "\\frac{",
        ),
        *(
            "#Column\ta\t(I6)\t" + " " * 999 + "x\n",
            "# " + " " * 999 + "\n",
            "-",
            "- ",
            "--|",
            "a ",
            " a,",
            '"',
            "\t|;,",
            "%",
        ),
    ],
)
@pytest.mark.parametrize("start", ["", "\\tablehead{\\startdata ", "\\begin{tabular}{c}\n", "a,b\n1,2\n"])
def test_texts_that_repeat_themselves_are_read_or_refused_in_one_line(start, text):
    """Time that grew with the square of the length, or faster, would let none of these end."""
    try:
        told = parsed((start + text * (100_000 // len(text)) + "x").encode()).name
    except InputError as error:
        told = str(error)
    assert "\n" not in told


def test_an_angle_that_a_sheet_keeps_as_a_time_is_read_as_it_was_typed():
    book = openpyxl.Workbook()
    for row in (["name", "RA", "Dec", "V"], ["HD 1", time(7, 39, 18), timedelta(hours=61, minutes=3), 5.0]):
        book.active.append(row)
    written = io.BytesIO()
    book.save(written)
    read = parse_table(TableBytes("mine.xlsx", written.getvalue(), ""))
    assert [column.cells[0] for column in read.columns[1:3]] == ["07:39:18", "61:03:0"]
