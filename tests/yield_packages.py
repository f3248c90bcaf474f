"""Yield input packages whose images are closed forms: lambda/D throughout, 60 pixels a side."""

import math

import numpy as np
from astropy.io import fits

PIXEL, SIDE, RADIUS = 0.25, 60, 0.7
SIGMA, LEAK = 0.5, 2e-9
STEPS = np.arange(0.0, 6.01, 0.5)
DIAMETERS = np.array([0.0, 0.1, 0.2])


def grid(centre):
    at = (np.arange(SIDE) - centre) * PIXEL
    return at, at[:, None]


def passed(separation):
    """Light of a source behind the mask."""
    return 0.6 * (1.0 - np.exp(-((separation / 2.0) ** 2)))


def source(x, y, centre):
    right, up = grid(centre)
    shape = np.exp(-((right - x) ** 2 + (up - y) ** 2) / (2 * SIGMA**2)) * PIXEL**2 / (2 * math.pi * SIGMA**2)
    return passed(math.hypot(x, y)) * shape


def star(centre, diameter):
    """Falls outward, is brighter on the right than on the left, and grows with the diameter."""
    right, up = grid(centre)
    r = np.hypot(right, up)
    return LEAK * (1.0 + 30.0 * diameter) * np.exp(-r / 3.0) * (1.0 + 0.5 * right / np.maximum(r, 1e-9))


def sky(centre):
    right, up = grid(centre)
    return 0.7 * (1.0 - np.exp(-(np.hypot(right, up) ** 2) / 4.0)) + 0.1


def write(folder, *, centre=30.0, stated="centre", offsets=None, listed=None, cards=(), without=(), **arrays):
    """Write a package: sources at offsets along x unless others are given."""
    folder.mkdir(exist_ok=True)
    places = np.column_stack([STEPS, 0 * STEPS]) if offsets is None else np.asarray(offsets, float)
    made = {
        "stellar_intens": np.stack([star(centre, diameter) for diameter in DIAMETERS]),
        "stellar_intens_diam_list": DIAMETERS,
        "offax_psf": np.stack([source(x, y, centre) for x, y in places]),
        "offax_psf_offset_list": places if listed is None else listed,
        "sky_trans": sky(centre),
    } | arrays
    for name, data in made.items():
        unit = fits.PrimaryHDU(np.asarray(data))
        own = {"PIXSCALE": PIXEL, "LAMBDA": 0.55, "MINLAM": 0.5, "MAXLAM": 0.6, "D": 6.5}
        if stated == "centre":
            own |= {"XCENTER": centre, "YCENTER": centre}
        for card, value in (own | dict(cards)).items():
            if value is not None and "list" not in name:
                unit.header[card] = value
        if f"{name}.fits" not in without:
            unit.writeto(folder / f"{name}.fits", overwrite=True)
    return str(folder)
