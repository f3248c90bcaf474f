#!/usr/bin/env bash
# Table.read (astropy 8.0.2) says nothing of a query that a service cut off; pyvo 1.9.1 says it of the same bytes.
#
# The IVOA's rule (DALI 1.1, section 4.4.1): a service that reached its limit of rows writes QUERY_STATUS OVERFLOW *after*
# the table, since it could not know before; what stands before the table is OK.
# Expected: a reader that is used for such files warns, or keeps the status in the table's metadata.
# Seen: `Table.read` gives the rows that came, no warning, no metadata. `pyvo.dal.DALResults` warns of the same bytes that
# the result set is limited. A list of stars that was saved to a file and read later is taken for the whole sample.
# Who meets it: everybody who keeps TAP answers as files. The status is at `resource.infos` of `votable.parse`.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyvo==1.9.1 astropy==8.0.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io
import warnings

from astropy.io.votable import parse
from astropy.table import Table
from pyvo.dal.query import DALResults

TEXT = b"""<?xml version="1.0" encoding="UTF-8"?>
<VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3"><RESOURCE type="results">
<INFO name="QUERY_STATUS" value="OK"/>
<TABLE><FIELD name="hip" datatype="int"/><DATA><TABLEDATA><TR><TD>8102</TD></TR></TABLEDATA></DATA></TABLE>
<INFO name="QUERY_STATUS" value="OVERFLOW"/>
</RESOURCE></VOTABLE>"""

with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    table = Table.read(io.BytesIO(TEXT), format="votable")
print(f"Table.read: {len(table)} row, warnings {len(said)}, metadata {dict(table.meta)}")
silent = not said and not table.meta

with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    DALResults(parse(io.BytesIO(TEXT)))
messages = [str(one.message) for one in said]
print(f"DALResults: {messages}")
infos = [(info.name, info.value) for info in parse(io.BytesIO(TEXT)).resources[0].infos]
print(f"infos of the resource: {infos}")
assert messages, "pyvo no longer warns"
assert silent, "the behaviour has changed: Table.read tells of it"
PYTHON
