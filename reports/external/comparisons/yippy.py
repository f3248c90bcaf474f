"""A yield input package read by yippy and by us."""

from __future__ import annotations

from typing import Any

import numpy as np

from reports.external.comparison import Reference, Row

TITLE = "Yield input packages: yippy"
REFERENCE = Reference(
    "yippy",
    "2.10.6",
    "package index and repository CoreySpohn/yippy",
    ("yippy==2.10.6", "hwoutils==1.10.0", "jax==0.10.2", "jaxlib==0.10.2", "astropy==8.0.2", "numpy==2.4.6"),
)
TEXT = """
One package whose images are closed forms (pixels of 0.25 lambda/D, sources of 0.94 lambda/D at half their maximum that
the mask dims towards the star, starlight that falls outward) is read by both: light of sources in an aperture of
0.7 lambda/D, starlight per pixel, sky, and raw contrast, at offsets of the list and between them. Light that is even
within an aperture agrees to 1 %; within 3 lambda/D of the star its light is not, and the mean of a ring is up to 2 %
more than that of apertures along it. The aperture of yippy counts whole half-pixels, 1.5 % less than the disc; ours
counts parts of pixels. Between two offsets near the mask both take throughput as linear; yippy takes the raw contrast
so too, while ours follows the starlight there. Beyond the last offset yippy extends its curves, and moves the last
image on; here the table ends there.
"""
SIDE, PIXEL, SIGMA, RADIUS = 64, 0.25, 0.4, 0.7
OFFSETS = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0])
PLACES = (1.5, 2.5, 3.25, 4.0, 4.75, 5.5)
NEAR, BEYOND, CURVED = 1.25, 6.5, 3.0
NAMES = {
    "throughput_interp": ("core throughput", 0.02, "theirs counts whole half-pixels, 1.5 % less than the disc"),
    "core_intensity_interp": ("starlight per pixel", 0.01, "theirs is the mean of a ring, ours of apertures along it"),
    "occ_trans_interp": ("transmission of an even sky", 0.01, "theirs is that of a ring, ours of apertures along it"),
    "raw_contrast_interp": ("raw contrast", 0.03, "theirs is that on the x axis, linear between offsets"),
}
_NARROW = "theirs is linear between offsets, and grows steeply towards the mask"


def package(folder: str) -> None:
    """Write the package to a folder."""
    from astropy.io import fits

    place = (np.arange(SIDE) - SIDE / 2) * PIXEL
    separation = np.hypot(place, place[:, None])
    shapes = [np.exp(-((place - x) ** 2 + place[:, None] ** 2) / (2 * SIGMA**2)) for x in OFFSETS]
    light = 0.6 * (1.0 - np.exp(-((OFFSETS / 2.0) ** 2))) * PIXEL**2 / (2 * np.pi * SIGMA**2)
    arrays = {
        "offax_psf": light[:, None, None] * np.array(shapes),
        "offax_psf_offset_list": np.column_stack([OFFSETS, 0 * OFFSETS]),
        "stellar_intens": 2e-9 * np.stack([np.exp(-separation / 3.0)] * 2),
        "stellar_intens_diam_list": np.array([0.0, 0.1]),
        "sky_trans": 0.7 - 0.3 * np.exp(-((separation / 3.0) ** 2)),
    }
    for name, data in arrays.items():
        unit = fits.PrimaryHDU(data)
        for card, value in (("PIXSCALE", PIXEL), ("XCENTER", SIDE / 2), ("YCENTER", SIDE / 2)):
            unit.header[card] = value
        unit.writeto(f"{folder}/{name}.fits")


def peer() -> dict[str, Any]:
    """Ask yippy."""
    import tempfile

    from yippy import Coronagraph

    with tempfile.TemporaryDirectory() as folder:
        package(folder)
        read = Coronagraph(folder)
    curves = {name: [float(getattr(read, name)(place)) for place in PLACES] for name in NAMES}
    return curves | {"near": float(read.raw_contrast_interp(NEAR)), "beyond": float(read.throughput_interp(BEYOND))}


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return the curves of both at offsets and between them."""
    import tempfile

    from simulator.config.coronagraph import coronagraph_table

    with tempfile.TemporaryDirectory() as folder:
        package(folder)
        table = coronagraph_table(folder, 1.0, aperture_arcsec=RADIUS)
    places = np.array([*PLACES, NEAR])
    core, contrast = table.at("core_throughput", places), table.at("raw_contrast", places)
    per_pixel = contrast * core * PIXEL**2 / (np.pi * RADIUS**2)
    ours = dict(zip(NAMES, (core, per_pixel, table.at("occulter_transmission", places), contrast), strict=True))
    found = [
        Row(f"{words} at {place:g} lambda/D", theirs, float(own), tolerance, why, expected=not near)
        for name, (words, tolerance, why) in NAMES.items()
        for place, theirs, own in zip(PLACES, recorded[name], ours[name][:-1], strict=True)
        # Near the star its light is curved within an aperture, and their curve goes straight from ring to ring.
        for near in [name == "core_intensity_interp" and place < CURVED]
    ]
    narrow = Row(
        f"raw contrast at {NEAR:g} lambda/D, between the first offsets",
        *(recorded["near"], float(contrast[-1]), 0.03, _NARROW),
        expected=False,
    )
    last = float(table.separation_arcsec[-1])
    beyond = f"outside: the table ends at {last:g}"
    words = "theirs extends the curve beyond the last image"
    return [
        *found,
        narrow,
        Row(f"core throughput at {BEYOND:g} lambda/D", recorded["beyond"], beyond, 0.02, words, expected=False),
    ]
