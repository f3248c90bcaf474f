#!/usr/bin/env bash
# A hint for printing in a FITS or VOTable file rounds the values that astropy 8.0.2 writes on: 1.234e-9 becomes 0.000.
#
# TDISPn of FITS and `precision` of a FIELD say how a column should be shown; they are no statement on the values.
# Expected: a table that is read and written again, as CSV or as VOTable, keeps its numbers.
# Seen: the hint becomes the `format` of the column, and all text formats but ECSV are written with it: under TDISP F8.2
# an RA of 26.01701234 deg is 26.02 in the CSV file (11 arcsec off), a contrast of 1.234e-9 under F6.3 is 0.000, and under
# Z8 the flags 4096 are "1000", in hexadecimal. VOTable too, if the hint came in a FIELD: `precision="2"` and the
# rewritten TABLEDATA holds 26.02. ECSV, FITS and Parquet keep the numbers. No warning. `table["ra"].format = None` before
# writing helps.
# Who meets it: those who turn archives' FITS tables or VizieR's and SIMBAD's VOTables into CSV with two lines of Python.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import io
import warnings

import astropy
from astropy.io import fits
from astropy.table import Table

warnings.simplefilter("error")
VALUES = {"ra": 26.01701234, "contrast": 1.234e-9, "flags": 4096}
columns = [
    fits.Column(name="ra", format="D", unit="deg", disp="F8.2", array=[VALUES["ra"]]),
    fits.Column(name="contrast", format="D", disp="F6.3", array=[VALUES["contrast"]]),
    fits.Column(name="flags", format="J", disp="Z8", array=[VALUES["flags"]]),
]
fits.BinTableHDU.from_columns(columns).writeto("stars.fits")
XML = """<VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3"><RESOURCE><TABLE>
<FIELD name="ra" datatype="double" unit="deg" precision="2"/><FIELD name="contrast" datatype="double" precision="F3"/>
<DATA><TABLEDATA><TR><TD>26.01701234</TD><TD>1.234e-9</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>"""


def back(table, kind):
    """Return the first row as it comes back from a format."""
    if kind == "votable":
        file = io.BytesIO()
        table.write(file, format=kind)
        return Table.read(io.BytesIO(file.getvalue()), format=kind)[0].as_void().tolist()
    text = io.StringIO()
    table.write(text, format=kind)
    return Table.read(text.getvalue(), format=kind)[0].as_void().tolist()


changed = "the behaviour has changed"
table = Table.read("stars.fits")
assert tuple(table[0]) == tuple(VALUES.values())
found = {kind: back(table, kind) for kind in ("ascii.csv", "ascii.ecsv", "votable")}
print(f"astropy {astropy.__version__}, from FITS {tuple(VALUES.values())}: {found}")
assert found["ascii.ecsv"] == found["votable"] == tuple(VALUES.values())
assert found["ascii.csv"] == (26.02, 0.0, 1000), changed
table = Table.read(io.BytesIO(XML.encode()), format="votable")
assert tuple(table[0]) == (26.01701234, 1.234e-9)
found = {kind: back(table, kind) for kind in ("ascii.csv", "ascii.ecsv", "votable")}
print(f"astropy {astropy.__version__}, from VOTable (26.01701234, 1.234e-09): {found}")
assert found["ascii.ecsv"] == (26.01701234, 1.234e-9)
assert found["ascii.csv"] == found["votable"] == (26.02, 0.0), changed
PYTHON
