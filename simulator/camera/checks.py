"""Input checks shared by the camera: refuse by name, with the offending pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError

__all__ = ["checked_array", "element_name"]

FloatArray = npt.NDArray[np.float64]


def element_name(key: str, bad: npt.NDArray[np.bool_]) -> tuple[str, tuple[int, ...]]:
    """Name and index of the first ``True`` of ``bad``: ``("rate_map_e_s[y=3, x=7]", (3, 7))`` for images."""
    index = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), bad.shape))
    if not index:
        return key, index
    labels = [f"y={index[0]}", f"x={index[1]}"] if len(index) == 2 else [str(i) for i in index]
    return f"{key}[{', '.join(labels)}]", index


def checked_array(
    key: str, value: npt.ArrayLike, *, low: float, high: float = np.inf, unit: str = "", allowed: str = ""
) -> FloatArray:
    """``value`` as float64, every element finite and within ``[low, high]``.

    Raises
    ------
    InputError
        Naming the first element that is not a finite number in range.
    """
    allowed = allowed or (f"{low:g} to {high:g}" if np.isfinite(high) else f"finite and at least {low:g}")
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf":
            raise TypeError
        array = array.astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(key, value, unit=unit, allowed=f"numbers, {allowed}") from None
    bad = ~((array >= low) & (array <= high) & np.isfinite(array))
    if bad.any():
        name, index = element_name(key, bad)
        raise InputError(name, float(array[index]), unit=unit, allowed=allowed)
    return array
