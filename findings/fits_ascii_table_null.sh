#!/usr/bin/env bash
# Table.read (astropy 8.0.2) cannot read an ASCII table of FITS whose integer column states how a null is written.
#
# The FITS standard 4.0, section 7.2.2: in an extension XTENSION = 'TABLE', TNULLn is the *text* of an undefined value.
# Expected: `astropy.table.Table.read` masks the cells that hold that text, or reads all as numbers; `fits.open` reads them.
# Seen: TypeError "Cannot set fill value of string with array of dtype int32", whatever the text is ("---" or "-999") and
# whether or not any cell holds it. Without TNULL the same file is read. A column of floating-point numbers fails
# likewise ("float64"). `fits.getdata` is the way round.
# Who meets it: readers of star catalogues from the archives' ASCII FITS, which state TNULL for every column with gaps.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import astropy
import numpy as np
from astropy.io import fits
from astropy.table import Table


def read(name, form, values, null):
    """Write two stars with a column that states its null, or none, and read them by the table and by the file."""
    stars = fits.Column(name="HIP", format="I6", ascii=True, array=np.array([8102, 16537]))
    column = fits.Column(name="RV", format=form, ascii=True, array=np.array(values), null=null)
    fits.TableHDU.from_columns([stars, column]).writeto(name, overwrite=True)
    direct = fits.getdata(name, 1)["RV"].tolist()
    try:
        found = Table.read(name)["RV"].tolist()
    except TypeError as error:
        found = f"TypeError: {error}"
    print(f"astropy {astropy.__version__}, {form}, TNULL {null!r}: fits.getdata {direct}, Table.read {found}")
    return direct, found


assert read("plain.fits", "I6", [-16, 17], None) == ([-16, 17], [-16, 17])
for null in ("---", "-999"):
    direct, found = read("null.fits", "I6", [-16, 17], null)
    assert direct == [-16, 17]
    assert isinstance(found, str), "the behaviour has changed: the table is read"
read("real.fits", "F8.3", [-16.5, 17.25], "---")
PYTHON
