"""What particles leave in a near-infrared frame: where, how much, and when between the reads."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.camera.checks import checked_array

__all__ = ["Hits", "checked_hits", "hit_times", "tracks_of"]

Hits = tuple[npt.ArrayLike, npt.ArrayLike]

# Keeps charges exact in float64 when added up.
MAX_HIT_E = 1e12


def checked_hits(cosmic_rays: Hits, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """Electrons of cosmic rays as a map.

    Raises
    ------
    InputError
        Unless indices are integers inside the array and electrons whole, at least 0, and as many.
    """
    size = int(np.prod(shape))
    pixels = np.asarray(cosmic_rays[0])
    electrons = checked_array("cosmic_rays electrons", cosmic_rays[1], low=0.0, high=MAX_HIT_E, unit="e-")
    if pixels.dtype.kind not in "iu" and pixels.size:
        raise InputError("cosmic_rays pixels", f"array of {pixels.dtype}", allowed="integer indices of the flat array")
    if pixels.ndim != 1 or pixels.shape != electrons.shape:
        raise InputError(
            "cosmic_rays",
            f"shapes {pixels.shape} and {electrons.shape}",
            allowed="two lists of one length: indices and electrons",
        )
    pixels = pixels.astype(np.int64)
    outside = (pixels < 0) | (pixels >= size)
    if outside.any():
        raise InputError("cosmic_rays pixels", int(pixels[outside][0]), allowed=f"0 to {size - 1}")
    if (electrons != np.rint(electrons)).any():
        raise InputError(
            "cosmic_rays electrons",
            float(electrons[electrons != np.rint(electrons)][0]),
            unit="e-",
            allowed="whole electrons",
        )
    return np.bincount(pixels, weights=electrons, minlength=size).reshape(shape).astype(np.float64)


def tracks_of(hit: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int32], int]:
    """Number of the track in every hit pixel (0 elsewhere) and the number of tracks: pixels that touch are one."""
    from scipy.ndimage import label

    tracks, number = label(hit, structure=np.ones((3, 3)))
    return tracks, int(number)


def hit_times(hit: npt.NDArray[np.bool_], rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Time of arrival in every hit pixel as a fraction of the exposure; pixels of a track share theirs."""
    tracks, number = tracks_of(hit)
    return np.concatenate([[0.0], rng.random(number)])[tracks]
