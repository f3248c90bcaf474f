"""Apodizers: amplitude transmission maps of the pupil."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.imaging.map_files import read_maps, real_map

__all__ = ["Kind", "cell_means", "load_apodizer", "shipped_apodizers", "upsample"]

FloatArray = NDArray[np.float64]
Kind: TypeAlias = Literal["amplitude", "intensity"]
KINDS: tuple[str, ...] = get_args(Kind)
MIN_SIDE, MAX_SIDE, MAX_FILE_SIDE = 8, 2048, 8192
ROUNDING = 1e-6  # single precision and resampling
STRIPS = 32  # of a cell that the rim of the disc cuts
SHIPPED_NAME = re.compile(r"lpx\d+")


def shipped_apodizers() -> tuple[str, ...]:
    """Names of the masks that come with the package."""
    folder = files("simulator.imaging") / "data"
    stems = (entry.name.removesuffix(".npz") for entry in folder.iterdir() if entry.name.endswith(".npz"))
    return tuple(sorted(stem for stem in stems if SHIPPED_NAME.fullmatch(stem)))


def load_apodizer(name_or_path: str | Path, *, kind: Kind = "amplitude", samples: int | None = None) -> FloatArray:
    """Amplitude transmission of an apodizer.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped mask (``lpx43``), an npz file with one array (or one named ``transmission``, ``amplitude`` or
        ``intensity``), or a FITS file (first image). The map spans the pupil diameter exactly. Pickled objects are
        refused.
    kind : {"amplitude", "intensity"}
        What a file holds. A laboratory measures intensity; its square root is the amplitude. Shipped masks are
        amplitudes.
    samples : int, optional
        Average the amplitude over the cells of a grid with this many samples a side: for measured maps whose side
        does not divide the pupil grid. The light of an unaberrated core (the mean amplitude) is kept; what varies
        within a cell, and with it some energy far from the core, is lost.

    Returns
    -------
    ndarray of float64, shape (n, n), read-only
        Transmission of the field amplitude, 0 to 1, indexed ``[y, x]``.

    Raises
    ------
    InputError
        If the file cannot be read, is not a square map of even side (any side with ``samples``), leaves 0 to 1, is
        opaque, or contradicts ``kind``.
    """
    name = str(name_or_path)
    if kind not in KINDS:
        raise InputError("apodizer kind", kind, allowed=", ".join(KINDS))
    if samples is not None and (samples % 2 or not MIN_SIDE <= samples <= MAX_SIDE):
        raise InputError("samples", samples, allowed=f"an even number, {MIN_SIDE} to {MAX_SIDE}")
    if name in shipped_apodizers():
        if kind != "amplitude":
            raise InputError("apodizer kind", kind, allowed="amplitude for a shipped mask", hint=name)
        file = read_maps("apodizer", str(files("simulator.imaging") / "data" / f"{name}.npz"))
    elif Path(name).is_file():
        file = read_maps("apodizer", name)
    else:
        raise InputError("apodizer", name, allowed=f"an npz or FITS file, or one of: {', '.join(shipped_apodizers())}")
    found = file.maps[0] if file.is_fits else file.named("transmission", *KINDS)
    if found is None and len(file.maps) == 1:
        found = file.maps[0]
    if found is None:
        raise InputError("apodizer", name, allowed="an npz file with an array named transmission")
    if found.name.lower() in KINDS and found.name.lower() != kind:
        raise InputError("apodizer kind", kind, allowed=f"{found.name.lower()}, the name of the array", hint=name)
    mask = _in_range(name, real_map("apodizer", name, found.data, sides=(MIN_SIDE, MAX_FILE_SIDE)))
    if kind == "intensity":
        mask = np.sqrt(mask)
    if samples is not None:
        mask = cell_means(mask, samples)
    if len(mask) % 2 or len(mask) > MAX_SIDE:
        raise InputError(
            "apodizer",
            name,
            allowed=f"an even number of samples, {MIN_SIDE} to {MAX_SIDE}",
            hint=f"found {len(mask)}; average it onto another grid with samples",
        )
    mask.flags.writeable = False
    return mask


def _in_range(name: str, mask: FloatArray) -> FloatArray:
    """Return the map within 0 to 1; what rounding left outside is cut off."""
    low, high = float(mask.min()) + 0.0, float(mask.max()) + 0.0  # no -0 in messages
    if low < -ROUNDING or high > 1 + ROUNDING:
        hint = f"found {low:.6g} to {high:.6g}"
        if low >= -ROUNDING:
            hint += f"; divide by {_likely_scale(high)}"
        raise InputError("apodizer", name, allowed="transmission from 0 to 1", hint=hint)
    if high <= 0:
        raise InputError("apodizer", name, allowed="a mask that is not opaque everywhere")
    return np.clip(mask, 0.0, 1.0)


def _likely_scale(high: float) -> str:
    """Words for what a map with this maximum was probably scaled to."""
    if 50 < high <= 100.5:
        return "100 if it is in per cent"
    for bits in (8, 16):
        if high == 2**bits - 1:
            return f"{high:g} if it is a picture of {bits} bits"
    return "the value of the open part"


def cell_means(values: FloatArray, samples: int) -> FloatArray:
    """Mean of a piecewise constant square map over the cells of another grid on the same square.

    Parameters
    ----------
    values : ndarray, shape (n, n)
    samples : int
        Cells a side, at least 1.

    Returns
    -------
    ndarray, shape (samples, samples)
    """
    n = len(values)
    edges = np.arange(samples + 1)[:, None] / samples * n
    covered = np.clip(edges - np.arange(n), 0.0, 1.0)  # part of each step that lies below each edge
    weights = np.diff(covered, axis=0) * (samples / n)
    return np.asarray(np.clip(weights @ values @ weights.T, values.min(), values.max()))


def disc_coverage(samples: int) -> FloatArray:
    """Fraction of each cell of the pupil grid that lies in the clear disc.

    Parameters
    ----------
    samples : int
        Cells a side, even.

    Returns
    -------
    ndarray, shape (samples, samples)
        Good to 1e-3 in the cells that the rim cuts, exactly 0 or 1 elsewhere.
    """
    half = samples // 2
    chord = np.sqrt(0.25 - ((np.arange(half * STRIPS) + 0.5) / (samples * STRIPS)) ** 2)
    covered = np.clip(chord * samples - np.arange(half)[:, None], 0.0, 1.0)
    quarter = covered.reshape(half, half, STRIPS).mean(axis=-1)
    quarter = 0.5 * (quarter + quarter.T)
    upper = np.concatenate([quarter[:, ::-1], quarter], axis=1)
    return np.concatenate([upper[::-1], upper])


def upsample(transmission: FloatArray, samples: int) -> FloatArray:
    """Repeat each step so that the map has ``samples`` samples a side: exact, since steps are constant.

    Parameters
    ----------
    transmission : ndarray
        Map of steps, shape (n, n).
    samples : int
        Samples of the pupil grid a side.

    Raises
    ------
    InputError
        If ``samples`` is not a multiple of the number of steps.
    """
    factor, rest = divmod(samples, len(transmission))
    if rest or factor < 1:
        raise InputError(
            "pupil_samples",
            samples,
            allowed=f"a multiple of the {len(transmission)} apodizer steps",
            hint="or average the map onto that many steps: load_apodizer(..., samples=)",
        )
    return np.repeat(np.repeat(transmission, factor, axis=0), factor, axis=1)
