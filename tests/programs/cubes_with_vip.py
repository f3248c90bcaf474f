"""Reduce the cubes of folders with VIP, print position and contrast of the planet in each, and its error."""

import json
import sys
from pathlib import Path

from cubes_measured import Field, measured
from vip_hci.fits import open_fits
from vip_hci.fm import cube_inject_companions, normalize_psf
from vip_hci.psfsub import pca

MODES = 5


def main(folder, separation_arcsec, pa_deg):
    cube, references, angles, psf = (
        open_fits(str(folder / f"{name}.fits"), verbose=False).astype(float)
        for name in ("science", "reference", "angles", "psf")
    )
    about = json.loads((folder / "about.json").read_text())
    time_s = about["n_science"] * about["exposure_s"]
    scale = about["pixel_scale_arcsec"]
    unit_psf, star_e_s, fwhm = normalize_psf(psf, fwhm="fit", full_output=True, verbose=False)

    def reduced(frames):
        return pca(cube=frames, angle_list=angles, cube_ref=references, ncomp=MODES, verbose=False)

    def injected(flux_e_s, theta_deg):
        # VIP counts angles from x to y: position angles are 90 degrees less
        return cube_inject_companions(
            cube, unit_psf, angles, flux_e_s, separation_arcsec / scale, theta=(theta_deg + 90.0) % 360.0, verbose=False
        )

    image = reduced(cube)
    field = Field(about["star_pixel"][0], scale, fwhm, float(angles[0]))
    print(json.dumps(measured(field, image, reduced, injected, star_e_s, time_s, separation_arcsec, pa_deg)))


for name in sys.argv[3:]:
    main(Path(name), float(sys.argv[1]), float(sys.argv[2]))
