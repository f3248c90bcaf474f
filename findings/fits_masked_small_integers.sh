#!/usr/bin/env bash
# Writing a masked column of small integers to FITS (astropy 8.0.2) makes a genuine number undefined: 63, or 16959.
#
# FITS tells an undefined integer by one reserved number, TNULL, so the writer has to choose one that the column does not
# hold (FITS standard 4.0, section 7.3.2).
# Expected: a masked column of integers comes back as it was, or is refused where no number is free.
# Seen: the writer always takes 999999, cut to the bytes of the column: 63 in 8 bits, 16959 in 16 bits, signed or not. A
# cell that really holds 63 (or 16959) comes back masked, without a warning. In 32 and 64 bits it is 999999 itself: a star
# whose number is 999999 loses it (numbers of the TIC reach that far, and counts of electrons). Column by column,
# `table["x"].fill_value = -1` before writing is the way round. A masked cell of a column of True and False is not even
# undefined: it comes back as True.
# Who meets it: everybody who keeps a table with gaps as FITS: quality flags, numbers of planets, catalogue numbers.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import warnings

import astropy
import numpy as np
from astropy.io import fits
from astropy.table import MaskedColumn, Table

warnings.simplefilter("error")


def back(values, kind, fill=None):
    """Return a column whose second cell is masked as it comes back from FITS, and the number reserved for a gap."""
    column = MaskedColumn(np.array(values, kind), mask=[False, True, False])
    if fill is not None:
        column.fill_value = fill
    Table({"x": column}).write("x.fits", overwrite=True)
    return Table.read("x.fits")["x"].tolist(), fits.getheader("x.fits", 1).get("TNULL1")


changed = "the behaviour has changed"
for kind, hit in (("u1", 63), ("i2", 16959), ("u2", 16959), ("i4", 999999), ("i8", 999999)):
    found, null = back([hit, 1, 7], kind)
    other, _ = back([hit - 1, 1, 7], kind)
    print(f"astropy {astropy.__version__}, {kind}: {[hit, None, 7]} comes back as {found}; beside it, {other}")
    assert other == [hit - 1, None, 7]
    assert null == hit and found == [None, None, 7], changed
assert back([63, 1, 7], "u1", fill=255)[0] == [63, None, 7]
found, null = back([True, False, False], bool)
print(f"astropy {astropy.__version__}, True and False: wrote {[True, None, False]}, read {found}")
assert null is None and found == [True, True, False], changed
PYTHON
