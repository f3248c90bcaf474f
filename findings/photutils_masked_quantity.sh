#!/usr/bin/env bash
# photutils 3.0.0 counts a masked pixel of a masked quantity in one of its two ways to sum an aperture.
#
# Expected: `aperture_photometry` and `ApertureStats` leave out the pixels that the data say are masked, as both do for a
# numpy masked array and for NDData with a mask.
# Seen, with astropy 8.0.2: for `astropy.utils.masked.Masked(Quantity)`, which is what a QTable column or a cube with bad
# pixels and a unit is, `aperture_photometry` adds the masked pixel (28.27 electrons in a circle of 28.27 pixels of 1),
# `ApertureStats` does not (27.27). No warning tells. A saturated or hot pixel that was masked comes back into the flux.
# Who meets it: photometry of frames in electrons whose cosmic rays are masked.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check photutils==3.0.0 astropy==8.0.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import math

import astropy.units as u
import numpy as np
from astropy.nddata import NDData
from astropy.utils.masked import Masked
from photutils.aperture import ApertureStats, CircularAperture, aperture_photometry

image, bad = np.ones((21, 21)), np.zeros((21, 21), dtype=bool)
bad[10, 10] = True
circle = CircularAperture((10, 10), 3.0)
whole, left = math.pi * 9.0, math.pi * 9.0 - 1.0


def sums(data):
    return float(np.asarray(aperture_photometry(data, circle)["aperture_sum"])[0])


found = {
    "masked array": sums(np.ma.array(image, mask=bad)),
    "NDData": sums(NDData(image, mask=bad, unit=u.electron)),
    "Masked(Quantity)": sums(Masked(image * u.electron, mask=bad)),
    "Masked(Quantity), ApertureStats": float(ApertureStats(Masked(image * u.electron, mask=bad), circle).sum.value),
}
for name, value in found.items():
    print(f"{name}: {value:.6f} (with the masked pixel {whole:.6f}, without {left:.6f})")
for name in ("masked array", "NDData", "Masked(Quantity), ApertureStats"):
    assert math.isclose(found[name], left, rel_tol=1e-12), name
assert math.isclose(found["Masked(Quantity)"], whole, rel_tol=1e-12), "the behaviour has changed"
PYTHON
