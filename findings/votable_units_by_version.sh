#!/usr/bin/env bash
# The version number of a VOTable decides whether "Mjup" is a mass and "hr" a time (astropy 8.0.2).
#
# Expected: a unit means the same in version="1.3" and "1.4" of the format, or is an `UnrecognizedUnit`, for which
# programs look out.
# Seen: from 1.4 on the string is read by the VOUnits grammar, which lets unknown words through and takes a prefix off
# them first: "Mjup" is a million "jup", "Rsun" 1e27 "sun", "hr" a hundred "r", "days" ten "ys", "mags" a thousandth of
# "ags", "ppm" a million-millionth of "pm". Each is an ordinary unit with a scale, `isinstance(unit, UnrecognizedUnit)` is
# False, and no warning comes: (2 Mjup / 1 Msun) is 2 without the right factor of 1/1048. Up to 1.3 the CDS grammar reads
# "Mjup", "Rsun", "hr", "ppm" as they are meant. "%" goes the other way: good in 1.3, unrecognised in 1.4. "pct", the
# percentage of astropy's own parser, is a million-millionth of a count in both. `str(unit)` is still the file's word.
# Who meets it: readers of VOTables that people and archives write: most units of planets are not in the standard.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io
import warnings

import astropy
import astropy.units as u
from astropy.table import Table

warnings.simplefilter("error")


def unit(text, version):
    """Return a unit as the table has it whose FIELD states this text."""
    xml = f"""<VOTABLE version="{version}" xmlns="http://www.ivoa.net/xml/VOTable/v1.3"><RESOURCE><TABLE>
<FIELD name="x" datatype="double" unit="{text}"/><DATA><TABLEDATA><TR><TD>1</TD></TR></TABLEDATA></DATA>
</TABLE></RESOURCE></VOTABLE>"""
    return Table.read(io.BytesIO(xml.encode()), format="votable")["x"].unit


def said(found):
    if isinstance(found, u.UnrecognizedUnit):
        return "unrecognised"
    parts = found.decompose()
    return f"{parts.scale:.6g} {' '.join(str(base) for base in parts.bases)}".strip()


meant = {"Mjup": u.M_jup, "Rsun": u.R_sun, "hr": u.hour, "ppm": u.Unit(1e-6)}
changed = "the behaviour has changed"
for text in (*meant, "days", "mags", "pct", "%"):
    old, new = unit(text, "1.3"), unit(text, "1.4")
    print(f"astropy {astropy.__version__}, unit {text!r}: version 1.3 {said(old)}, version 1.4 {said(new)}")
    assert str(new) == text
    if text in meant:
        assert old.is_equivalent(meant[text]) and abs(old.to(meant[text]) - 1) < 1e-9, text
    if text == "%":
        assert old.is_equivalent(u.percent) and isinstance(new, u.UnrecognizedUnit), changed
    else:
        assert not isinstance(new, u.UnrecognizedUnit), changed
        assert not any(new.is_equivalent(one) for one in (u.kg, u.m, u.s, u.one)), changed
ratio = (2 * unit("Mjup", "1.4") / unit("Msun", "1.4")).decompose()
print(f"2 Mjup / Msun: version 1.3 {(2 * unit('Mjup', '1.3') / unit('Msun', '1.3')).decompose():.6f}, version 1.4 {ratio}")
assert ratio.value == 2.0, changed
PYTHON
