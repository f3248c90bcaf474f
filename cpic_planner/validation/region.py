"""Images as rows of the pixels that take part in a reduction, and back."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError

__all__ = ["as_images", "checked_frames", "checked_region", "region_rows"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def checked_frames(key: str, value: npt.ArrayLike) -> FloatArray:
    """Image or images as float64; refused by name if they are no numbers of that shape.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : array_like
        Images, shape (n, y, x).
    """
    images = np.asarray(value)
    if images.dtype.kind not in "iufb" or images.ndim not in (2, 3) or images.size == 0:
        raise InputError(key, f"{images.dtype} array of shape {images.shape}", allowed="numbers, (y, x) or (n, y, x)")
    return images.astype(np.float64, copy=False)


def checked_region(key: str, value: npt.ArrayLike | None, shape: tuple[int, ...]) -> BoolArray:
    """Pixels (y, x) that take part: a copy; all without any.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : array_like or None
        Pixels that are meant, (y, x).
    shape : tuple of int
        Shape (y, x) of the images.
    """
    if value is None:
        return np.ones(shape, dtype=np.bool_)
    region = np.asarray(value)
    if region.dtype != np.bool_ or region.shape != tuple(shape) or not region.any():
        raise InputError(
            key,
            f"{region.dtype} array of shape {region.shape}",
            allowed=f"booleans of shape {tuple(shape)}, some of them true",
        )
    return region.copy()


def region_rows(key: str, images: FloatArray, region: BoolArray) -> FloatArray:
    """Region pixels of each image as one row, a copy; refused by name if not finite.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    images : ndarray
        Images, shape (n, y, x).
    region : ndarray of bool
        Pixels that are meant, (y, x).
    """
    stack = images.reshape(-1, *images.shape[-2:])
    # Flat indices: several times faster than a mask over two axes.
    rows = stack.reshape(len(stack), -1).take(np.flatnonzero(region), axis=1)
    if not np.isfinite(np.vdot(rows, rows)) and not (finite := np.isfinite(rows)).all():
        frame, pixel = np.unravel_index(int(np.argmin(finite)), rows.shape)
        y, x = np.argwhere(region)[pixel]
        raise InputError(f"{key}[frame={frame}, y={y}, x={x}]", float(rows[frame, pixel]), allowed="finite numbers")
    return rows


def as_images(rows: FloatArray, region: BoolArray, shape: tuple[int, ...]) -> FloatArray:
    """Rows as images of the given shape, 0 outside the region; may share the memory of the rows.

    Parameters
    ----------
    rows : ndarray
        Values of the region's pixels, one image a row, shape (n, k).
    region : ndarray of bool
        Pixels that are meant, (y, x).
    shape : tuple of int
        Shape (y, x) of the images.
    """
    if region.all():
        return rows.reshape(shape)
    images = np.zeros((len(rows), region.size))
    images[:, np.flatnonzero(region)] = rows
    return images.reshape(shape)
