#!/usr/bin/env bash
# TauREx 3.3.2 reads the middle and width of a band from a file of photometry, and bins models between other ends.
#
# Expected: a line with the wavelength 0.52 um and the width 0.05 um is compared with the mean of a model from 0.495 to
# 0.545 um. `ObservedSpectrum.binEdges` gives these ends.
# Seen: the binner of the same object lays the width, turned into wavenumbers, about the wavenumber of the middle: from
# 0.4961 to 0.5463 um. Both ends are 1.1 to 1.3 nm too red, 0.2 nm for a width of 0.02 um, and nothing warns. The shift
# is a quarter of the square of the width over the wavelength.
# Who meets it: who fits photometry in wide bands of planets whose molecular bands end near one of their ends.
# (About 1 minute.)
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check taurex==3.3.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PYTHON'
import math

import numpy as np
from taurex.data.spectrum.observed import ObservedSpectrum

MIDDLE_UM = 0.52
wavenumber = np.linspace(1e4 / 0.7, 1e4 / 0.4, 200_001)
shift_nm = {}
for width_um in (0.05, 0.02):
    np.savetxt("bands.txt", [[MIDDLE_UM, 3e-8, 1e-9, width_um], [0.65, 3e-8, 1e-9, 0.01]])
    seen = ObservedSpectrum("bands.txt")
    low, high = np.sort(1e4 / np.asarray(seen.binEdges))[:2]
    assert np.allclose((low, high), (MIDDLE_UM - width_um / 2, MIDDLE_UM + width_um / 2)), (low, high)
    # Of a model that is the wavelength itself: its mean over wavenumbers between the ends that are said, and what is binned.
    said_um = math.log(high / low) / (1 / low - 1 / high)
    binned_um = float(seen.create_binner().bindown(wavenumber, 1e4 / wavenumber)[1][-1])
    shift_nm[width_um] = 1e3 * (binned_um - said_um)
    print(f"{low:.4f} to {high:.4f} um: mean {said_um:.5f} um, binned {binned_um:.5f}: {shift_nm[width_um]:.2f} nm too red")
assert abs(shift_nm[0.05] - 1.2) < 0.1, "the behaviour has changed"
assert abs(shift_nm[0.02] - 0.19) < 0.05, "the behaviour has changed"
PYTHON
