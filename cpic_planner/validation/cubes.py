"""Cubes of calibrated frames as other programs for high-contrast imaging take them: VIP and pyKLIP.

Frames are stamps of an odd side with the star on the middle pixel and east on the left at a roll of 0, in electrons per
second at the register input. They are calibrated as `cpic_planner.validation.frames` does it; pixels that a particle
hit in a frame have the mean of their other frames, and those that are never usable that of their neighbours.

Both programs turn frame ``i`` by its angle so that north is up: a source at position angle PA is at PA minus the angle
on the detector. The angle is therefore the roll, with the same sign in both.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, Record, dump_json, fingerprint, utf8
from cpic_planner.validation.frames import CalibratedFrames, calibrated_frames, filled, rejected_in
from simulator.observing import Observation

CubeKind = Literal["vip", "pyklip"]
_AT_ONCE = 8  # whole frames in memory
_NEAR = (3, 9)  # sides of the squares whose mean a bad pixel has: the first that holds a good one
_LEAST_SHARE = 1e-3
_PSF_LAMBDA_D = 10.0
_ON_PIXEL = 1e-6

_FILES = """{target} in {band}: calibrated frames of {side} x {side} pixels of {pixel_scale_arcsec:g} arcsec,
in electrons per second at the register input. The star is at pixel ({middle}, {middle}), counted from 0.

science.fits    {n_science} frames
reference.fits  {n_reference} frames of {reference}
angles.fits     roll of each science frame, degrees, by which both programs turn north up and east left
psf.fits        the star off the mask, {psf_side} x {psf_side} pixels, same unit: contrasts are fluxes over its flux
about.json      the same as numbers

"""
_LOADED: Mapping[CubeKind, str] = {
    "vip": """from vip_hci.fits import open_fits
from vip_hci.psfsub import pca
cube, references, angles, psf = (open_fits(f"{{name}}.fits") for name in ("science", "reference", "angles", "psf"))
image = pca(cube=cube, angle_list=angles, cube_ref=references, ncomp=5)
""",
    "pyklip": """import numpy as np
from astropy.io import fits
from pyklip.instruments.Instrument import GenericData
cube, references, angles, psf = (fits.getdata(f"{{name}}.fits") for name in ("science", "reference", "angles", "psf"))
names = np.array([f"science_{{k:05d}}" for k in range(len(cube))])
data = GenericData(cube, np.full((len(cube), 2), {middle}.0), parangs=angles, filenames=names, IWA={inner})
""",
}


class Cube(Record, eq=False):
    """Calibrated frames of one sequence around its star.

    Attributes
    ----------
    rate_e_s : ndarray of float32, shape (n_frames, side, side)
        Electrons of light per second at the register input; the star on the middle pixel, east left at a roll of 0.
    mended : float
        Share of the pixel-frames that particles, limits or flaws took out.
    """

    rate_e_s: np.ndarray[Any, np.dtype[np.float32]]
    mended: float


def calibrated_cube(observation: Observation, numbers: Sequence[int]) -> Cube:
    """Return the frames of a whole-frame observation around its star.

    Parameters
    ----------
    observation : Observation
    numbers : sequence of int
        Numbers of its frames.

    Raises
    ------
    InputError
        If the star is not on the middle of a pixel, or too near to an edge of the detector.
    """
    x, y = observation.truth.x_pixel[0], observation.truth.y_pixel[0]
    column, row = round(x), round(y)
    if max(abs(x - column), abs(y - row)) > _ON_PIXEL:
        raise InputError("star_offset_arcsec", observation.star_offset_arcsec, unit="arcsec", allowed="whole pixels")
    half = (observation.psf.on_axis.shape[0] - 1) // 2
    if any(observation.star_offset_arcsec):
        geometry = observation.psf.geometry
        half = min(half, round(_PSF_LAMBDA_D * geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec))
        groups = [numbers[first : first + _AT_ONCE] for first in range(0, len(numbers), _AT_ONCE)]
        place = slice(row - half, row + half + 1), slice(column - half, column + half + 1)
        if min(row, column) < half or np.empty(observation.shape)[place].shape != (2 * half + 1,) * 2:
            allowed = f"{half} pixels from every edge of the detector"
            raise InputError("star_offset_arcsec", observation.star_offset_arcsec, unit="arcsec", allowed=allowed)
        stamps = [_cut(calibrated_frames(observation, numbers=group), place) for group in groups]
    else:
        stamps = [calibrated_frames(observation, cropped=True, numbers=numbers)]
    images = np.concatenate([stamp.electrons for stamp in stamps])
    frames = replace(stamps[0], electrons=images, usable=np.concatenate([stamp.usable for stamp in stamps]))
    usable = frames.usable & ~rejected_in(frames).rejected
    electrons, covered = filled(frames.electrons, usable)
    rate = (_mended(electrons, covered) / observation.exposure_s).astype(np.float32)
    if observation.instrument.detector.parity == 1:
        rate = rate[:, :, ::-1]
    return Cube(np.ascontiguousarray(rate), float(1.0 - usable.mean()))


def _cut(frames: CalibratedFrames, place: tuple[slice, slice]) -> CalibratedFrames:
    """Return the part of frames that a cube is made of."""
    electrons, usable = frames.electrons[:, *place].copy(), frames.usable[:, *place].copy()
    return replace(frames, electrons=electrons, usable=usable, pedestal_e=frames.pedestal_e[place])


def _mended(electrons: FloatArray, covered: BoolArray) -> FloatArray:
    """Return frames in which pixels that are never usable have the mean of their neighbours."""
    from scipy.ndimage import uniform_filter

    result, known = electrons, covered
    for side in _NEAR:
        share = uniform_filter(covered.astype(np.float64), side)
        near = uniform_filter(np.where(covered, electrons, 0.0), (1, side, side)) / np.maximum(share, _LEAST_SHARE)
        result = np.where(known, result, near)
        known = known | (share > _LEAST_SHARE)
    return result


def cube_files(
    kind: CubeKind,
    science: Sequence[tuple[Cube, float]],
    references: Sequence[Cube],
    star: Cube,
    about: Mapping[str, Any],
) -> dict[str, bytes]:
    """Return the files of one band by their names: cubes, angles, the unmasked star, numbers, and how to read them.

    Parameters
    ----------
    kind : {"vip", "pyklip"}
    science : sequence of (Cube, float)
        Cubes of the science sequences in the order of time, and the roll of each, deg.
    references : sequence of Cube
    star : Cube
        Of the star off the mask.
    about : mapping
        What ``about.json`` says besides.
    """
    cube = np.concatenate([own.rate_e_s for own, _ in science])
    reference = np.concatenate([own.rate_e_s for own in references])
    angles = np.concatenate([np.full(len(own.rate_e_s), roll_deg) for own, roll_deg in science])
    psf = star.rate_e_s.mean(axis=0, dtype=np.float64).astype(np.float32)
    middle = cube.shape[-1] // 2
    numbers = {
        "fingerprint": str(fingerprint()),
        "unit": "electron/s",
        "star_pixel": [middle, middle],
        "n_science": len(cube),
        "n_reference": len(reference),
        "mended": {
            "science": float(np.mean([own.mended for own, _ in science])),
            "reference": float(np.mean([own.mended for own in references])),
            "star": star.mended,
        },
    }
    shown = dict(about) | numbers | {"side": cube.shape[-1], "psf_side": len(psf), "middle": middle}
    shown["inner"] = round(about["lambda_d_pixel"])
    text = (_FILES + _LOADED[kind]).format(**shown)
    images = {"science": cube, "reference": reference, "angles": angles, "psf": psf}
    units = {name: "deg" if name == "angles" else "electron/s" for name in images}
    files = {f"{name}.fits": _fits(image, units[name]) for name, image in images.items()}
    return files | {"about.json": utf8(dump_json(dict(about) | numbers)), "README.txt": utf8(text)}


def _fits(image: FloatArray, unit: str) -> bytes:
    from astropy.io import fits

    file = io.BytesIO()
    fits.PrimaryHDU(image, fits.Header({"BUNIT": unit, "FPRINT": str(fingerprint())})).writeto(file)
    return file.getvalue()
