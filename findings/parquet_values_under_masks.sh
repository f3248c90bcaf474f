#!/usr/bin/env bash
# A masked cell that astropy 8.0.2 writes to Parquet is a plain number for pandas 3.1.1 and pyarrow 26.0.1.
#
# Parquet has nulls of its own, for every type; pandas and pyarrow read and write them.
# Expected: a masked cell is a null in the file.
# Seen: `Table.write(format="parquet")` writes what lies under the mask as an ordinary number, no null, and beside it a
# second column "V.mask" of True and False that only astropy understands. What lies there is what the table was made from:
# -9999, 0 or nan. pandas, pyarrow and all who read by them get a star of magnitude -9999.0 and a column more. The other
# format of the same library, "parquet.votable", does write nulls.
# Who meets it: tables with gaps that go from astropy to pandas, dask, DuckDB or a program of one's own.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    astropy==8.0.2 numpy==2.4.6 pandas==3.1.1 pyarrow==26.0.1
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import astropy
import pandas as pd
import pyarrow.parquet as pq
from astropy.table import MaskedColumn, Table

table = Table({"HIP": [8102, 16537], "V": MaskedColumn([3.49, -9999.0], mask=[False, True], unit="mag")})
table.write("stars.parquet", format="parquet")
read = Table.read("stars.parquet", format="parquet")["V"].tolist()
frame, arrow = pd.read_parquet("stars.parquet"), pq.read_table("stars.parquet")
print(f"written {table['V'].tolist()}; astropy {astropy.__version__} reads {read}")
print(f"pandas {pd.__version__} reads {frame.to_dict('list')}; nulls of pyarrow: {arrow['V'].null_count}")
words = {"HIP": {"unit": ""}, "V": {"unit": "mag"}}
words = {name: {"ucd": "", "utype": "", "description": "", **said} for name, said in words.items()}
table.write("vo.parquet", format="parquet.votable", metadata=words)
print(f"format parquet.votable: pyarrow reads {pq.read_table('vo.parquet')['V'].to_pylist()}")
assert read == [3.49, None]
assert pq.read_table("vo.parquet")["V"].to_pylist() == [3.49, None]
assert frame["V"].tolist() == [3.49, -9999.0] and arrow["V"].null_count == 0, "the behaviour has changed"
assert frame["V.mask"].tolist() == [False, True], "the behaviour has changed"
PYTHON
