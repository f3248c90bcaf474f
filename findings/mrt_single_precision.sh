#!/usr/bin/env bash
# astropy 8.0.2 cannot write a table with a column of single precision as a machine-readable table (MRT).
#
# Expected: `Table.write(format="ascii.mrt")` writes numbers of single precision as those of double precision (Fortran F).
# Seen: ValueError "Invalid format for column 'V': could not display values in this column using this format", whatever
# the values are. The writer tells floats by `np.issubdtype(col.dtype, np.dtype(float).type)`, which float32 is not, so
# that the column counts as text and gets the format "4s".
# Who meets it: authors of MRT tables from FITS tables and Gaia's VOTables, whose magnitudes and errors are float32.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io

import astropy
import numpy as np
from astropy.io import fits
from astropy.table import Table


def written(table):
    file = io.StringIO()
    try:
        table.write(file, format="ascii.mrt")
    except ValueError as error:
        return f"ValueError: {error}"
    return "written: " + " | ".join(file.getvalue().splitlines()[-len(table) :])


# Through FITS, as such columns come.
column = fits.Column(name="V", format="E", array=np.array([3.49, 3.72]))
single = Table(fits.BinTableHDU.from_columns([column]).data)
double = Table({"V": single["V"].astype(float).round(2)})
for name, table in (("float32", single), ("float64", double)):
    print(f"astropy {astropy.__version__}, {table['V'].dtype}: {written(table)}")
assert written(double).startswith("written")
assert "could not display values" in written(single), "the behaviour has changed: single precision is written"
PYTHON
