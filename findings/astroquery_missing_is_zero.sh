#!/usr/bin/env bash
# A star without a magnitude has V = 0 and 0 K in what astroquery 0.4.11 returns from the NASA Exoplanet Archive.
#
# Expected: `NasaExoplanetArchive` returns masked values where the archive's table has none.
# Seen: while it attaches units it takes every mask away. What was filled in below appears as a value: 0.0 in the format
# "ipac", which is the default for the tables that TAP does not have (the ExoCat list of targets for direct imaging is
# one), and in "csv"; in answers of TAP nan for real numbers and 0 for whole ones (a planet found in the year 0). The mask
# is still there and False, so that asking it says that all is known. No warning.
# Who meets it: star lists for imaging (a V of 0 is the brightest star of the sample), statistics of planets by year.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    astroquery==0.4.11 pyvo==1.9.1 astropy==8.0.2 numpy==2.4.6
cd "$folder"
HOME="$folder" "$folder/venv/bin/python" - <<'PYTHON'
import io
import warnings

warnings.simplefilter("ignore")
import astroquery
from astropy.io import ascii
from astropy.io.votable import parse
from astroquery.ipac.nexsci.nasa_exoplanet_archive import NasaExoplanetArchive
from pyvo.dal.tap import TAPResults

IPAC = """\\fixlen = T
|star_name|st_teff|st_vmag|pl_num|
|char     |double |double |int   |
|         |K      |mag    |      |
|null     |null   |null   |null  |
 tau Cet    5333.0   3.496      4
 dark star    null    null   null
"""
CSV = "star_name,st_teff,st_vmag,pl_num\ntau Cet,5333.0,3.496,4\ndark star,,,\n"
VOTABLE = b"""<VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3"><RESOURCE type="results">
<INFO name="QUERY_STATUS" value="OK"/><TABLE><FIELD name="star_name" datatype="char" arraysize="*"/>
<FIELD name="st_teff" datatype="double" unit="K"/><FIELD name="st_vmag" datatype="double" unit="mag"/>
<FIELD name="pl_num" datatype="int"/><DATA><TABLEDATA>
<TR><TD>tau Cet</TD><TD>5333.0</TD><TD>3.496</TD><TD>4</TD></TR><TR><TD>dark star</TD><TD/><TD/><TD/></TR>
</TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>"""


class Answer:
    """An answer of the service, as `requests` holds it."""

    def __init__(self, text, kind):
        self.text, self.content, self.requested_format = text, text.encode(), kind


def numbers(table):
    return [str(table[name][1]) for name in ("st_teff", "st_vmag", "pl_num")]


plain = ascii.read(IPAC, format="ipac")
print(f"astropy alone, of the same text: {numbers(plain)}")
assert numbers(plain) == ["--", "--", "--"]
answers = {
    "ipac": (Answer(IPAC, "ipac"), ["0.0 K", "0.0 mag", "0"]),
    "csv": (Answer(CSV, "csv"), ["0.0", "0.0", "0"]),
    "TAP": (TAPResults(parse(io.BytesIO(VOTABLE))), ["nan K", "nan mag", "0"]),
}
for kind, (answer, seen) in answers.items():
    table = NasaExoplanetArchive._parse_result(answer)
    mask = bool(table["st_vmag"].mask[1])
    print(f"astroquery {astroquery.__version__}, {kind}: {numbers(table)}, mask of V {mask}")
    assert numbers(table) == seen and not mask, "the behaviour has changed"
PYTHON
