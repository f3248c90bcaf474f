#!/usr/bin/env bash
# By the WCS that pyKLIP 2.10.1 writes, the star of its own reduced image stands one pixel beside its centre, in x and y.
#
# Expected: `klip_dataset` turns frames north up about the star and writes its place twice: PSFCENTX and PSFCENTY in
# pixels from 0, and as the reference pixel of a celestial WCS, CRPIX1 and CRPIX2, which FITS counts from 1 (Greisen &
# Calabretta 2002, A&A 395, 1061, section 2.1.4): one more than the former.
# Seen: all four have the same number. What reads the header (astropy, DS9) puts the star at a pixel less in each
# direction; sources measured by the WCS have offsets from the star that are 1.4 pixels wrong, a whole lambda/D in images
# that are sampled coarsely. Offsets from PSFCENTX and PSFCENTY are right.
# Who meets it: everybody who takes positions of planets from a reduced image by its WCS. (About half a minute.)
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyklip==2.10.1 astropy==8.0.2 numpy==2.4.6
cd "$folder"
OMP_NUM_THREADS=1 "$folder/venv/bin/python" - 2> /dev/null <<'PYTHON'
import warnings

warnings.simplefilter("ignore")
import numpy as np
import pyklip
from astropy.io import fits
from astropy.wcs import WCS
from pyklip import parallelized
from pyklip.instruments.Instrument import GenericData

FRAMES, CENTRE = 6, 40.0
rng = np.random.default_rng(1)
y, x = np.mgrid[:81, :81]
star = 1000.0 * np.exp(-((y - CENTRE) ** 2 + (x - CENTRE) ** 2) / 50.0)
cube = star * (1.0 + 0.05 * rng.normal(size=(FRAMES, 81, 81))) + rng.normal(size=(FRAMES, 81, 81))
data = GenericData(
    cube, np.full((FRAMES, 2), CENTRE), parangs=np.linspace(0.0, 150.0, FRAMES), IWA=3,
    filenames=np.array([f"frame{number}" for number in range(FRAMES)]),
)
parallelized.klip_dataset(
    data, mode="ADI", annuli=3, subsections=1, movement=1, numbasis=[2], outputdir=".", fileprefix="made",
    calibrate_flux=False, verbose=False, numthreads=1,
)
header = fits.getheader("made-KLmodes-all.fits")
by_wcs = WCS(header).celestial.wcs_world2pix([[header["CRVAL1"], header["CRVAL2"]]], 0)[0]
print(f"pyKLIP {pyklip.__version__}: PSFCENTX, PSFCENTY {header['PSFCENTX']}, {header['PSFCENTY']}")
print(f"CRPIX1, CRPIX2 {header['CRPIX1']}, {header['CRPIX2']}; the star by the WCS, in pixels from 0: {by_wcs.round(3)}")
assert header["PSFCENTX"] == header["PSFCENTY"] == CENTRE, "the centre itself"
assert np.allclose(by_wcs, CENTRE - 1.0, atol=1e-6), "the behaviour has changed"
PYTHON
