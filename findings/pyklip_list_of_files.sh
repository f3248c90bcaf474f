#!/usr/bin/env bash
# `GenericData` of pyKLIP 2.10.1 takes a list of FITS files by its documentation, and reads nothing from any.
#
# Expected: "input_data: either a 1-D list of filenames to read in, or a 3-D cube"; with a list, `input` is the cube of
# their images.
# Seen: AttributeError: 'NoneType' object has no attribute 'shape'. The method that reads the files stacks their images
# and returns none. A cube in memory works; so one has to read the files oneself.
# Who meets it: everybody who hands a folder of frames to pyKLIP without a class of an instrument.
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
from astropy.io import fits
from pyklip.instruments.Instrument import GenericData

cube = np.random.default_rng(1).normal(size=(3, 21, 21))
names = [f"frame_{number}.fits" for number in range(3)]
for name, image in zip(names, cube):
    fits.PrimaryHDU(image).writeto(name)
about = {"centers": np.full((3, 2), 10.0), "parangs": np.array([0.0, 30.0, 60.0])}
print(f"pyKLIP {pyklip.__version__}, a cube: {GenericData(cube, **about).input.shape}")
try:
    shape = GenericData(names, **about).input.shape
except AttributeError as fault:
    print(f"a list of three files: {type(fault).__name__}: {fault}")
    assert "NoneType" in str(fault), "the behaviour has changed"
else:
    raise SystemExit(f"the behaviour has changed: {shape}")
PYTHON
