#!/usr/bin/env bash
# One missing number in a Parquet file changes the Gaia numbers of all other stars that astropy 8.0.2 reads from it.
#
# Expected: `Table.read(format="parquet")` gives a masked column of 64-bit integers for a column of 64-bit integers with
# nulls, as pyarrow and pandas ("Int64") write it.
# Seen: with one null the whole column becomes double precision, with nan for the null and no mask. A Gaia source number
# has 19 digits, a double 16: 2452378776434477185 is read as 2452378776434477056. A join finds no star, or another one. A
# text that is null cannot be read at all (TypeError: NoneType has no len), nor can the files with masked texts that
# astropy itself writes with format="parquet.votable". No warning tells of the first.
# Who meets it: catalogues that pandas, polars or an archive wrote to Parquet, with a number or name missing somewhere.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    astropy==8.0.2 numpy==2.4.6 pandas==3.1.1 pyarrow==26.0.1
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import warnings

import astropy
import pyarrow as pa
import pyarrow.parquet as pq
from astropy.table import MaskedColumn, Table

warnings.simplefilter("error")
star = 2452378776434477185


def read(numbers):
    pq.write_table(pa.table({"gaia": pa.array(numbers, pa.int64())}), "stars.parquet")
    column = Table.read("stars.parquet", format="parquet")["gaia"]
    cells = [int(cell) if cell == cell else "nan" for cell in column]
    print(f"astropy {astropy.__version__}: file {numbers}, read {column.dtype} {cells}")
    return column


whole, gap = read([star, 16537]), read([star, None])
assert whole.dtype == "int64" and whole[0] == star
assert gap.dtype == "float64" and int(gap[0]) == 2452378776434477056, "the behaviour has changed"
assert not hasattr(gap, "mask"), "the behaviour has changed: the null is masked"

warnings.simplefilter("ignore")
table = Table({"name": MaskedColumn(["tau Cet", "x"], mask=[False, True])})
words = {"name": {"unit": "", "ucd": "", "utype": "", "description": ""}}
table.write("own.parquet", format="parquet.votable", metadata=words)
try:
    found = Table.read("own.parquet", format="parquet.votable")["name"].tolist()
except TypeError as error:
    found = f"TypeError: {error}"
print(f"astropy {astropy.__version__}, its own parquet.votable with a masked text: {found}")
assert isinstance(found, str), "the behaviour has changed: its own masked text is read"
PYTHON
