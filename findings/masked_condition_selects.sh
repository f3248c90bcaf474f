#!/usr/bin/env bash
# A star without a magnitude is brighter than 5 mag for astropy 8.0.2, if -9999 lies under its mask; np.where disagrees.
#
# Expected: rows whose condition is itself unknown (masked) are not selected, as in SQL and in pandas, and
# `table[condition]` selects the rows that `table[np.where(condition)]` does.
# Seen: `table[table["V"] < 5]` gives the star whose V is masked if the number under the mask is below 5, and leaves it
# out if that is above; the shown condition is "--" for it. What lies there depends on the file: nan from VOTable text,
# -9999 from FITS, 0 or 1e20 from others, so that the same stars from two formats give two samples. For a QTable with
# masked quantities, whose conditions are of astropy's own class, the two ways to select disagree: [tau Cet, unknown] by
# the condition, [tau Cet] by np.where of it. `(table["V"] < 5).filled(False)` is right for both.
# Who meets it: every cut by magnitude, distance or temperature in a catalogue with gaps.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6 pandas==3.1.1
"$folder/venv/bin/python" - <<'PYTHON'
import warnings

import astropy
import astropy.units as u
import numpy as np
import pandas as pd
from astropy.table import MaskedColumn, QTable, Table
from astropy.utils.masked import Masked

warnings.simplefilter("error")
NAMES, MASK = ["tau Cet", "unknown", "Proxima"], [False, True, False]


def selected(under):
    """Return which stars are brighter than 5 mag, by three ways, where this number lies under the mask."""
    values = [3.49, under, 11.1]
    table = Table({"name": NAMES, "V": MaskedColumn(values, mask=MASK)})
    quantities = QTable({"name": NAMES, "V": Masked(np.array(values), mask=MASK) * u.mag})
    condition = quantities["V"] < 5 * u.mag
    return {
        "Table": table[table["V"] < 5]["name"].tolist(),
        "QTable": quantities[condition]["name"].tolist(),
        "QTable, np.where": quantities[np.where(condition)[0]]["name"].tolist(),
        "filled": table[(table["V"] < 5).filled(False)]["name"].tolist(),
        "pandas": (lambda frame: frame[frame["V"] < 5]["name"].tolist())(table.to_pandas()),
    }


low, high = selected(-9999.0), selected(9999.0)
print(f"astropy {astropy.__version__}, pandas {pd.__version__}, -9999 under the mask: {low}")
print(f"9999 under the mask: {high}")
for way in ("QTable, np.where", "filled", "pandas"):
    assert low[way] == high[way] == ["tau Cet"], way
for way in ("Table", "QTable"):
    assert high[way] == ["tau Cet"]
    assert low[way] == ["tau Cet", "unknown"], "the behaviour has changed"
PYTHON
