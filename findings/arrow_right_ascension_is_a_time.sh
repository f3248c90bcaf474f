#!/usr/bin/env bash
# A right ascension becomes a time of day in pyarrow 26.0.1, a declination does not, and neither does one with a decimal.
#
# Expected: the CSV reader of pyarrow finds numbers, dates and texts; "07:39:18" stays a text, as for pandas' own reader
# and for `astropy.io.ascii`.
# Seen: a column whose cells all look like hh:mm:ss or hh:mm from 00:00 to 23:59:59 has the type time32. So RA is
# `datetime.time` and Dec, with its sign, text in one table; northern declinations below 24 deg written without a sign are
# times as well; one cell of "07:39:18.1" or "24:00:00" in a million turns the whole column into texts again. The same in
# `pandas.read_csv(engine="pyarrow")` (3.1.1) and in astropy 8.0.2's new `Table.read(format="pyarrow.csv")`, whose columns
# then are Python objects that `SkyCoord` refuses; in a Parquet file made of it the RA is a time for every later reader.
# Who meets it: sexagesimal catalogues read by the fast reader; `column_types={"ra": pyarrow.string()}` keeps the text.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    astropy==8.0.2 numpy==2.4.6 pandas==3.1.1 pyarrow==26.0.1
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import datetime
import io

import astropy
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from astropy.table import Table

STARS = b"ra,dec,north\n07:39:18,-05:13:30,05:13:30\n14:29:43,+62:40:46,19:10:56\n"


def types(text):
    return {field.name: str(field.type) for field in pyarrow.csv.read_csv(io.BytesIO(text)).schema}


time, changed = datetime.time(7, 39, 18), "the behaviour has changed"
plain, tenth = types(STARS), types(STARS.replace(b"14:29:43", b"14:29:43.1"))
print(f"pyarrow {pa.__version__}: {plain}; with one second of 43.1: {tenth}")
frames = {engine: pd.read_csv(io.BytesIO(STARS), engine=engine)["ra"][0] for engine in ("c", "pyarrow")}
tables = {kind: Table.read(STARS.decode(), format=kind)["ra"][0] for kind in ("ascii.csv",)}
tables["pyarrow.csv"] = Table.read(io.BytesIO(STARS), format="pyarrow.csv")["ra"][0]
print(f"pandas {pd.__version__}: {frames}; astropy {astropy.__version__}: {tables}")
pq.write_table(pyarrow.csv.read_csv(io.BytesIO(STARS)), "stars.parquet")
kept = pq.read_table("stars.parquet")["ra"][0].as_py()
print(f"Parquet: {kept!r}")
assert frames["c"] == tables["ascii.csv"] == "07:39:18"
assert plain == {"ra": "time32[s]", "dec": "string", "north": "time32[s]"} and tenth["ra"] == "string", changed
assert frames["pyarrow"] == tables["pyarrow.csv"] == kept == time, changed
PYTHON
