#!/usr/bin/env bash
# astropy 8.0.2 takes a header's text such as 'flat: 2.10' for a number under another keyword, and rounds it in a copy.
#
# Expected: a card F_NAM = 'flat: 2.10', a text by the quotes of the FITS standard, is the keyword F_NAM with that
# text in every way of reading a header, and keeps it in a copy.
# Seen: header["F_NAM"] is the text; keys(), items() and dict(header) have no F_NAM but F_NAM.flat with the number 2.1
# (a "record-valued keyword" of the proposal on distortions), whereas 'flat: 17 s' stays a text. A header made of
# these items says 'flat: 2.1': another version, number or date than the file that it was copied from.
# Who meets it: who copies keywords of pipelines through a dict, where values are remarks such as "mode: 3".
# (About 30 s.)
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from astropy.io import fits

cards = ("F_NAM   = 'flat: 2.10'", "B_NAM   = 'bias: 17 s'", "END")
header = fits.Header.fromstring("".join(card.ljust(80) for card in cards))
assert header["F_NAM"] == "flat: 2.10"
found = dict(header.items())
print(found)
assert found == {"F_NAM.flat": 2.1, "B_NAM": "bias: 17 s"}, "the behaviour has changed"
again = fits.Header(found)
print(again["F_NAM"])
assert again["F_NAM"] == "flat: 2.1", "the behaviour has changed"
PYTHON
