#!/usr/bin/env bash
# `prepare_library(dataset, badfiles=...)` of pyKLIP 2.10.1 takes names by its documentation, and leaves out none by name.
#
# Expected: "badfiles (np.ndarray): a list of filenames corresponding to bad files we want to also exclude".
# Seen: names raise a TypeError of NumPy's invert: the names are compared with those of the library, and the outcome is
# not used; the argument itself is. An array of truth values, one for each frame of the library, does what is meant.
# Who meets it: everybody who keeps a list of bad reference frames.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyklip==2.10.1 astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import warnings

warnings.simplefilter("ignore")
import numpy as np
import pyklip
from pyklip.instruments.Instrument import GenericData
from pyklip.rdi import PSFLibrary

cube = np.random.default_rng(1).normal(size=(5, 41, 41))
names = np.array(["target_0", "target_1", "star_0", "star_1", "star_2"])
dataset = GenericData(cube[:2], [[20.0, 20.0]] * 2, IWA=2, filenames=names[:2])
library = PSFLibrary(cube, [20.0, 20.0], names, compute_correlation=True)
library.prepare_library(dataset, badfiles=names == "star_1")
print(f"pyKLIP {pyklip.__version__}, truth values: {names[library.isgoodpsf].tolist()} are used")
assert names[library.isgoodpsf].tolist() == ["star_0", "star_2"], "truth values"
try:
    library.prepare_library(dataset, badfiles=np.array(["star_1"]))
except TypeError as fault:
    print(f"a name: TypeError: {str(fault).splitlines()[0][:90]}")
else:
    raise SystemExit("the behaviour has changed")
PYTHON
