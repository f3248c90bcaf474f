#!/usr/bin/env bash
# With a library in another order than the data, pyKLIP 2.10.1 judges each frame by the correlations of another frame.
#
# Expected: `PSFLibrary.correlation` is "ordered in the same way as the dataset object", so that the references that are
# most like a frame are taken for it (``maxnumbasis``), wherever the library holds that frame.
# Seen: the rows have the order of the library. Where it lists the science frames backwards, the first frame gets the
# references that are most like the last one, and nothing warns. In one order the rows are right.
# Who meets it: everybody who makes the library of a folder listing and the data set of an observing log, or the like.
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

rng = np.random.default_rng(1)
patterns = rng.normal(size=(2, 41, 41))  # of two wavefronts: a science frame and a reference have either
frames = np.concatenate([patterns, patterns]) + 0.1 * rng.normal(size=(4, 41, 41))
names = np.array(["target_a", "target_b", "star_like_a", "star_like_b"])
dataset = GenericData(frames[:2], [[20.0, 20.0]] * 2, IWA=2, filenames=names[:2])
best = {}
for text, order in (("as the data", [0, 1, 2, 3]), ("backwards", [3, 2, 1, 0])):
    library = PSFLibrary(frames[order], [20.0, 20.0], names[order], compute_correlation=True)
    library.prepare_library(dataset)
    good = library.isgoodpsf
    best[text] = [str(names[order][good[np.argmax(row[good])]]) for row in library.correlation]
    print(f"pyKLIP {pyklip.__version__}, library {text}: most like {names[:2].tolist()} are {best[text]}")
assert best["as the data"] == ["star_like_a", "star_like_b"], "in one order"
assert best["backwards"] == ["star_like_b", "star_like_a"], "the behaviour has changed"
PYTHON
