#!/usr/bin/env bash
# A "#" in the name of a star makes one of astropy 8.0.2's three engines for ECSV lose the rest of its row.
#
# Expected: `Table.read(format="ecsv", engine=...)` gives one table, whether the engine is "io.ascii" (the default),
# "pyarrow" or "pandas"; only the speed differs.
# Seen: the writer puts no quotes around "Gl 4#B" in a comma-separated ECSV file. With engine="pandas" all that follows
# the sign is taken for a comment: the name is cut to "Gl 4", and the numbers after it come back masked, without a
# warning. An undefined result (nan), which the other two keep as a number, is masked by that engine as well.
# Who meets it: everybody who takes the pandas engine for a large table with names or remarks of observers in it.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    astropy==8.0.2 numpy==2.4.6 pandas==3.1.1 pyarrow==26.0.1
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import math
import warnings

import astropy
import pandas as pd
from astropy.table import Table

warnings.simplefilter("error")
table = Table({"name": ["tau Cet", "Gl 4#B"], "HIP": [8102, 473], "plx": [273.81, 86.8], "rms": [math.nan, 0.5]})
table.write("stars.ecsv", format="ascii.ecsv", delimiter=",")
found = {}
for engine in ("io.ascii", "pyarrow", "pandas"):
    read = Table.read("stars.ecsv", format="ecsv", engine=engine)
    found[engine] = [[None if str(cell) == "--" else cell for cell in row] for row in read.as_array().tolist()]
    print(f"astropy {astropy.__version__}, engine {engine}: {found[engine]}")
for engine in ("io.ascii", "pyarrow"):
    assert found[engine][1] == ["Gl 4#B", 473, 86.8, 0.5] and math.isnan(found[engine][0][3]), engine
assert found["pandas"] == [["tau Cet", 8102, 273.81, None], ["Gl 4", None, None, None]], "the behaviour has changed"
print(f"pandas {pd.__version__} without astropy: {pd.read_csv('stars.ecsv', comment='#').values.tolist()}")
PYTHON
