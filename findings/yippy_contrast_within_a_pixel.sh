#!/usr/bin/env bash
# The raw contrast of yippy 2.10.6 depends on where in a pixel a source stands, and disagrees with its throughput.
#
# A yield input package has an even star and sources of one shape and brightness, at offsets that are whole pixels and
# between them. Expected: one raw contrast at all of them (even light of the star over the same light of a source), and
# raw contrast times throughput is the starlight in the aperture.
# Seen, with pixels of 0.25 lambda/D and sources of 0.94 lambda/D at half their maximum: from 2.00 to 2.24 lambda/D the
# raw contrast rises by 13 %, and is back where it was at 2.25, the next whole pixel; the throughput stays within 1 %.
# `compute_raw_contrast_curve` cuts the place of the source to the whole pixel before it (`astype(int)`), for star and
# source; `compute_throughput_curve` moves the aperture to the brightest pixel afterwards, the other does not.
# Who meets it: noise of planets from `raw_contrast_interp`, with any list of offsets that are no whole pixels, of which
# the usual lists (finer near the mask) have many; between offsets the saw goes into the interpolation.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
  yippy==2.10.6 hwoutils==1.10.0 jax==0.10.2 jaxlib==0.10.2 astropy==8.0.2 numpy==2.4.6
cd "$folder"
JAX_PLATFORMS=cpu "$folder/venv/bin/python" - <<'PYTHON'
import logging
from pathlib import Path

import numpy as np
from astropy.io import fits
from yippy import Coronagraph

logging.getLogger("yippy").setLevel(logging.ERROR)
SIDE, PIXEL, SIGMA = 64, 0.25, 0.4
place = (np.arange(SIDE) - SIDE / 2) * PIXEL
offsets = np.array([2.0, 2.06, 2.12, 2.18, 2.24, 2.25])


def source(x):
    shape = np.exp(-((place - x) ** 2 + place[:, None] ** 2) / (2 * SIGMA**2))
    return 0.5 * shape * PIXEL**2 / (2 * np.pi * SIGMA**2)


arrays = {
    "offax_psf": np.stack([source(x) for x in offsets]),
    "offax_psf_offset_list": np.column_stack([offsets, 0 * offsets]),
    "stellar_intens": np.full((2, SIDE, SIDE), 1e-12),
    "stellar_intens_diam_list": np.array([0.0, 0.1]),
    "sky_trans": np.full((SIDE, SIDE), 0.5),
}
Path("package").mkdir()
for name, data in arrays.items():
    unit = fits.PrimaryHDU(data)
    unit.header["PIXSCALE"] = PIXEL
    unit.header["XCENTER"] = unit.header["YCENTER"] = SIDE / 2
    unit.writeto(f"package/{name}.fits")
package = Coronagraph(Path("package"))
contrast = np.array([float(package.raw_contrast_interp(x)) for x in offsets])
throughput = np.array([float(package.throughput_interp(x)) for x in offsets])
contrast, throughput = contrast / contrast[0], throughput / throughput[0]
for row in zip(offsets, contrast, throughput, strict=True):
    print("offset {:.2f} lambda/D: raw contrast {:.3f}, throughput {:.3f} of those at 2.00".format(*row))
assert np.ptp(throughput) < 0.01, "throughputs no longer agree"
assert abs(contrast[-1] - 1.0) < 1e-3, "whole pixels no longer agree"
assert contrast[4] > 1.1, "the behaviour has changed: the raw contrast no longer depends on the part of a pixel"
PYTHON
