"""Frames of another camera and another writer: drawn here by hand, with none of the code that is tested."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

SHAPE, ACTIVE = (64, 80), (slice(0, 64), slice(8, 72))
GAIN_E_ADU, READ_NOISE_E, DARK_E_S = 2.0, 10.0, 0.5


@dataclass
class Night:
    """Files of one night and what went into them."""

    root: Path
    light_e: np.ndarray
    flat: np.ndarray
    paths: dict[str, Path]


def draw(rng, mean_e, stripes, n_frames):
    """Return raw frames: Poisson counts, read noise, stripes, a level of its own for each, rounding."""
    charge = rng.poisson(np.broadcast_to(mean_e, (n_frames, *SHAPE))) + rng.normal(0, READ_NOISE_E, (n_frames, *SHAPE))
    level = 300.0 + rng.normal(0.0, 1.0, (n_frames, 1, 1))
    return np.clip(np.rint(charge / GAIN_E_ADU + stripes + level), 0, 65535).astype(np.uint16)


def write(path, kind, frames, exposure_s, compressed=False):
    """Write frames with the keywords of early files, exposure in every image, a table and a thumbnail beside them."""
    header = {"EXPTIME": float(exposure_s), "GAIN1": GAIN_E_ADU, "RDNOISE1": READ_NOISE_E, "ADCBITS": 16}
    header |= {"DATASEC": "[9:72,1:64]", "PRESCAN": "[1:8,1:64]", "OVERSCAN": "[73:80,1:64]"}
    header |= {"CRPIX1": 40.5, "CRPIX2": 33.0}
    primary = fits.PrimaryHDU(header=fits.Header({"FILETYPE": kind, "TARGET": "a star"}))
    unit = fits.CompImageHDU if compressed else fits.ImageHDU
    images = [unit(frame, header=fits.Header(header), name=f"EXP{number}") for number, frame in enumerate(frames)]
    table = fits.BinTableHDU.from_columns([fits.Column("t", "D", array=np.arange(3.0))], name="LOG")
    fits.HDUList([primary, *images, table, fits.ImageHDU(np.zeros((4, 4)), name="THUMB")]).writeto(path)
    return path


@pytest.fixture(scope="session")
def night(tmp_path_factory):
    """Return bias, dark, flat and science frames in a folder."""
    root, rng = tmp_path_factory.mktemp("night"), np.random.default_rng(11)
    inside = np.zeros(SHAPE)
    inside[ACTIVE] = 1.0
    flat = np.where(inside > 0, rng.normal(1.0, 0.03, SHAPE), 0.0)
    flat /= flat[ACTIVE].mean()
    flat[10, 20] = 0.0
    rows, columns = np.indices(SHAPE)
    light_e = inside * (50.0 + 800.0 * np.exp(-((rows - 32) ** 2 + (columns - 39.5) ** 2) / 50.0))
    stripes, dark = rng.normal(0.0, 3.0, SHAPE[1]), DARK_E_S * inside
    means = {"BIAS": (0.0, 0.0), "DARK": (20.0, 0.0), "FLAT": (1.0, 9000.0 * flat), "SCI": (10.0, light_e * flat)}
    paths = {
        kind: write(root / f"{kind.lower()}.fits", kind, draw(rng, mean + dark * t, stripes, 20), t, kind == "SCI")
        for kind, (t, mean) in means.items()
    }
    return Night(root, light_e[ACTIVE], flat[ACTIVE], paths)
