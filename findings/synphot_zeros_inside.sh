#!/usr/bin/env bash
# synphot 1.8.0 writes a passband that is shut in its middle as one that is open there.
#
# Expected: `SpectralElement.to_fits` and `from_file` give the same curve back, to rounding. The argument `trim_zero`, true by
# default, is taken for what its name and its partner `pad_zero_ends` say: zeros beyond the ends.
# Seen: all rows of throughput 0 go, those between two open parts too, and the reader joins the two by a straight line. A
# filter with two windows of 200 A, shut over 300 A between them, comes back with 0.9 where it had 0: its equivalent width is
# 675 instead of 360 A. The manual's line, "Remove rows with zero-flux", does not say that the curve changes, and no message
# says it. The same befalls sources with gaps: lines, spectra of two arms. `trim_zero=False` keeps the curve.
# Who meets it: whoever stores multi-band, notch or leak-free filters with synphot for an exposure-time calculator.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check synphot==1.8.0 astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
import synphot
from synphot import SourceSpectrum, SpectralElement
from synphot.models import Empirical1D

wavelength = np.arange(5000.0, 5801.0, 50.0)
shut = ((wavelength >= 5250.0) & (wavelength <= 5550.0)) | np.isin(wavelength, (5000.0, 5800.0))
height = np.where(shut, 0.0, 0.9)


def back(cls, name, **options):
    """Return a curve and what comes back of it."""
    curve = cls(Empirical1D, points=wavelength, lookup_table=height)
    curve.to_fits(name, **options)
    return curve, cls.from_file(name)


for options in ({}, {"trim_zero": False}):
    before, after = back(SpectralElement, f"band{len(options)}.fits", **options)
    widths = [curve.equivwidth().value for curve in (before, after)]
    inside = [float(curve(5400.0)) for curve in (before, after)]
    print(f"synphot {synphot.__version__} {options}: at 5400 A {inside}, equivalent width {widths} A")
    if options:
        assert inside == [0.0, 0.0]
        assert np.isclose(*widths, rtol=1e-6)
    else:
        assert inside == [0.0, 0.9], "the behaviour has changed: the gap stays shut"
        assert widths[1] > 1.8 * widths[0]
before, after = back(SourceSpectrum, "source.fits")
print("a source:", *(f"{curve(5400.0).value:g}" for curve in (before, after)), "PHOTLAM in the gap")
PYTHON
