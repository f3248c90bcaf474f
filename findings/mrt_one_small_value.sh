#!/usr/bin/env bash
# One number below 0.0001 makes astropy 8.0.2's writer of machine-readable tables round its whole column to one digit.
#
# Expected: `Table.write(format="ascii.mrt")`, the format in which journals and CDS take tables, keeps the digits of a
# column, as it does where all numbers are of like size (an eccentricity of 0.20563069 is written F10.8).
# Seen: if the shortest text of one number has an exponent (below 1e-4, or from 1e16 on), the column becomes E format with
# as many digits as the longest mantissa among *those* numbers has. Beside an eccentricity of 5e-05 the others are written
# with one digit: 0.20563069 is read back as 0.2. Beside a transit depth of 9.9e-05 one of 0.0123456 becomes 0.012. No
# warning. With `formats={"e": "%.9e"}` in the call the digits stay.
# Who meets it: tables of eccentricities, mass ratios, contrasts, transit depths and limb-darkening coefficients.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io
import warnings

import astropy
from astropy.table import Table

warnings.simplefilter("error")


def back(values, **keywords):
    """Return a column of numbers as it comes back from the format."""
    text = io.StringIO()
    Table({"name": [f"planet {i}" for i in range(len(values))], "e": values}).write(text, format="ascii.mrt", **keywords)
    return Table.read(text.getvalue(), format="ascii.mrt")["e"].tolist()


plain, small, depths = [0.20563069, 0.04838624, 0.00677672], [0.20563069, 0.04838624, 5e-05], [0.0123456, 9.9e-05]
for values in (plain, small, depths):
    print(f"astropy {astropy.__version__}: wrote {values}, read {back(values)}")
assert back(plain) == plain
assert back(small, formats={"e": "%.9e"}) == small, "the way round"
assert back(small) == [0.2, 0.05, 5e-05], "the behaviour has changed: the digits stay"
assert back(depths) == [0.012, 9.9e-05], "the behaviour has changed: the digits stay"
PYTHON
