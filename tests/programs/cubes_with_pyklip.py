"""Reduce the cubes of folders with pyKLIP, print position and contrast of the planet in each, and its error."""

import contextlib
import io
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from astropy.io import fits
from cubes_measured import Field, measured
from pyklip.fakes import inject_planet
from pyklip.instruments.Instrument import GenericData
from pyklip.parallelized import klip_dataset
from pyklip.rdi import PSFLibrary

MODES = 5


def data_of(cube, angles, middle):
    """Return the data set as the README of the folder makes it."""
    names = np.array([f"science_{k:05d}" for k in range(len(cube))])
    centres = np.full((len(cube), 2), float(middle))
    return GenericData(cube.copy(), centres, parangs=angles, filenames=names, IWA=3), names


def main(folder, separation_arcsec, pa_deg):
    cube, references, angles, psf = (
        fits.getdata(folder / f"{name}.fits").astype(float) for name in ("science", "reference", "angles", "psf")
    )
    about = json.loads((folder / "about.json").read_text())
    time_s = about["n_science"] * about["exposure_s"]
    middle, scale = about["star_pixel"][0], about["pixel_scale_arcsec"]
    radius = np.hypot(*(np.mgrid[: len(psf), : len(psf)] - len(psf) // 2))
    fwhm = 2.0 * radius[psf > psf.max() / 2.0].max()
    field = Field(middle, scale, fwhm, float(angles[0]))
    half = len(psf) // 2
    star = np.zeros(cube.shape[1:])
    star[middle - half : middle + half + 1, middle - half : middle + half + 1] = psf
    star_e_s = field.sum_at(star, middle, middle)

    def reduced(frames):
        data, names = data_of(frames, angles, middle)
        others = np.array([f"reference_{k:05d}" for k in range(len(references))])
        library = PSFLibrary(
            np.concatenate([frames, references]),
            [middle, middle],
            np.concatenate([names, others]),
            compute_correlation=True,
        )
        library.prepare_library(data)
        with tempfile.TemporaryDirectory() as out, contextlib.redirect_stdout(io.StringIO()):
            klip_dataset(
                data,
                mode="RDI",
                psf_library=library,
                numbasis=[MODES],
                annuli=1,
                subsections=1,
                outputdir=out,
                fileprefix="made",
                calibrate_flux=False,
                numthreads=1,
                verbose=False,
            )
            return np.nan_to_num(fits.getdata(Path(out) / "made-KLmodes-all.fits")[0].astype(float))

    def injected(flux_e_s, at_deg):
        data, _ = data_of(cube, angles, middle)
        stamps = np.repeat(psf[None] * (flux_e_s / star_e_s), len(cube), axis=0)
        inject_planet(data.input, data.centers, stamps, data.wcs, separation_arcsec / scale, at_deg % 360.0)
        return data.input

    print(json.dumps(measured(field, reduced(cube), reduced, injected, star_e_s, time_s, separation_arcsec, pa_deg)))


for name in sys.argv[3:]:
    main(Path(name), float(sys.argv[1]), float(sys.argv[2]))
