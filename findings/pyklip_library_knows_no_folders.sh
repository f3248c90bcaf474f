#!/usr/bin/env bash
# References of another star leave the library of pyKLIP 2.10.1 where a science frame in another folder has their name.
#
# Expected: `PSFLibrary.prepare_library` takes the frames that are not of the dataset itself; `reference/frame_0.fits` is
# another file than `science/frame_0.fits`.
# Seen: folders are cut off before names are compared. Of six references four are left out without a word where four
# science frames count from 0 as well, and their rows of the correlation matrix stand for those of the science frames,
# by which the most similar references are chosen. Where all names are the same it is refused ("no good PSFs"); under
# names of their own all six are used.
# Who meets it: everybody whose pipeline numbers the frames of each target from the same number on.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyklip==2.10.1 astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import contextlib
import io
import warnings

warnings.simplefilter("ignore")
import numpy as np
import pyklip
from pyklip.instruments.Instrument import GenericData
from pyklip.rdi import PSFLibrary

SCIENCE, REFERENCES, CENTRE = 4, 6, [20.0, 20.0]
cube = np.random.default_rng(1).normal(size=(SCIENCE + REFERENCES, 41, 41))
science = np.array([f"science/frame_{number}.fits" for number in range(SCIENCE)])
dataset = GenericData(cube[:SCIENCE], [CENTRE] * SCIENCE, IWA=2, filenames=science)


def used(stem):
    """Return which references a library uses that holds the science frames too, as the documentation asks."""
    names = np.array([f"reference/{stem}_{number}.fits" for number in range(REFERENCES)])
    every = np.append(science, names)
    library = PSFLibrary(cube, CENTRE, every, compute_correlation=True)
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        library.prepare_library(dataset)
    return every[library.isgoodpsf].tolist(), library.correlation.shape, said.getvalue()


for stem in ("star", "frame"):
    names, shape, said = used(stem)
    print(f"pyKLIP {pyklip.__version__}, reference/{stem}_*.fits: {len(names)} of {REFERENCES} used, correlations {shape}, said {said!r}")
assert used("star")[:2] == ([f"reference/star_{number}.fits" for number in range(6)], (4, 10)), "names of their own"
assert used("frame") == (["reference/frame_4.fits", "reference/frame_5.fits"], (8, 10), ""), "the behaviour has changed"
PYTHON
