"""Apodizers: amplitude transmission maps of the pupil."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.arrays import read_npz

__all__ = ["load_apodizer", "shipped_apodizers", "upsample"]

FloatArray = NDArray[np.float64]
SHIPPED_NAME = re.compile(r"lpx\d+")


def shipped_apodizers() -> tuple[str, ...]:
    """Names of the masks that come with the package."""
    folder = files("simulator.imaging") / "data"
    stems = (entry.name.removesuffix(".npz") for entry in folder.iterdir() if entry.name.endswith(".npz"))
    return tuple(sorted(stem for stem in stems if SHIPPED_NAME.fullmatch(stem)))


def load_apodizer(name_or_path: str | Path) -> FloatArray:
    """Amplitude transmission of an apodizer.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped mask (``lpx43``), an npz file with one array (or one named ``transmission``), or a FITS
        file (first image). The map spans the pupil diameter exactly. Pickled objects are refused.

    Returns
    -------
    ndarray of float64, shape (n, n), read-only
        Transmission of the field amplitude, 0 to 1, indexed ``[y, x]``.

    Raises
    ------
    InputError
        If the file cannot be read, is not a square map of even side, leaves 0 to 1, or is opaque.
    """
    name = str(name_or_path)
    if name in shipped_apodizers():
        transmission = _from_npz(Path(str(files("simulator.imaging") / "data" / f"{name}.npz")))
    elif not Path(name).is_file():
        raise InputError("apodizer", name, allowed=f"an npz or FITS file, or one of: {', '.join(shipped_apodizers())}")
    elif Path(name).suffix == ".npz":
        transmission = _from_npz(Path(name))
    else:
        transmission = _from_fits(Path(name))
    return _checked(name, transmission)


def _from_npz(path: Path) -> NDArray[np.float64]:
    arrays = read_npz(path)
    if "transmission" not in arrays and len(arrays) != 1:
        raise InputError("apodizer", str(path), allowed="an npz file with an array named transmission")
    return arrays.get("transmission", next(iter(arrays.values())))


def _from_fits(path: Path) -> NDArray[np.float64]:
    from astropy.io import fits

    try:
        with fits.open(path, memmap=False) as hdus:
            images = [hdu.data for hdu in hdus if hdu.is_image and hdu.data is not None]
    except (OSError, ValueError) as error:
        raise InputError("apodizer", str(path), allowed="an npz or FITS file", hint=str(error)) from None
    if not images:
        raise InputError("apodizer", str(path), allowed="a FITS file with an image")
    return np.asarray(images[0], dtype=np.float64)


def _checked(name: str, transmission: NDArray[np.float64]) -> FloatArray:
    if transmission.dtype.kind not in "fiu" or transmission.ndim != 2 or len(set(transmission.shape)) != 1:
        raise InputError("apodizer", name, allowed="a square map of real numbers", hint=f"shape {transmission.shape}")
    mask = np.array(transmission, dtype=np.float64)
    if len(mask) % 2 or not 8 <= len(mask) <= 2048:
        raise InputError("apodizer", name, allowed="an even number of samples, 8 to 2048", hint=f"found {len(mask)}")
    if not np.isfinite(mask).all() or mask.min() < 0 or mask.max() > 1:
        raise InputError("apodizer", name, allowed="amplitude transmission from 0 to 1")
    if not mask.any():
        raise InputError("apodizer", name, allowed="a mask that is not opaque everywhere")
    mask.flags.writeable = False
    return mask


def upsample(transmission: FloatArray, samples: int) -> FloatArray:
    """Repeat each step so that the map has ``samples`` samples a side: exact, since steps are constant.

    Raises
    ------
    InputError
        If ``samples`` is not a multiple of the number of steps.
    """
    factor, rest = divmod(samples, len(transmission))
    if rest or factor < 1:
        raise InputError("pupil_samples", samples, allowed=f"a multiple of the {len(transmission)} apodizer steps")
    return np.repeat(np.repeat(transmission, factor, axis=0), factor, axis=1)
