"""Input checks shared by the camera: refuse by name, with the offending pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError

__all__ = ["checked_array", "checked_rates", "checked_scalar", "element_name"]

FloatArray = npt.NDArray[np.float64]
NEGATIVE_TOLERANCE = 1e-9
# More light than this counts as this: that of any exposure and any sum of it stays finite.
MOST_E_S = 1e100


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


def checked_scalar(key: str, value: npt.ArrayLike, *, low: float, high: float, unit: str = "") -> float:
    """One finite number within ``[low, high]``, refused by name otherwise."""
    array = checked_array(key, value, low=low, high=high, unit=unit)
    if array.ndim:
        raise InputError(key, value, unit=unit, allowed="one number")
    return float(array)


def checked_rates(rate_map_e_s: npt.ArrayLike) -> tuple[FloatArray, int]:
    """Rates of a 2-D map with rounding-error negatives set to 0 (and those above 1e100 to that), and their number.

    Raises
    ------
    InputError
        For an empty map or one of other dimensions, and for NaN, infinity or a rate more negative than 1e-9 of the
        largest, naming the pixel.
    """
    allowed = f"finite and at least 0 (rounding errors to -{NEGATIVE_TOLERANCE:g} of the largest count as 0)"
    try:
        rates = np.asarray(rate_map_e_s)
    except ValueError:
        raise InputError(
            "rate_map_e_s", type(rate_map_e_s).__name__, unit="e-/s", allowed="a 2-D (y, x) array"
        ) from None
    if rates.dtype.kind not in "iuf" or rates.ndim != 2 or rates.size == 0:
        raise InputError(
            "rate_map_e_s",
            f"{rates.dtype} array of shape {rates.shape}",
            unit="e-/s",
            allowed="a non-empty 2-D (y, x) array of numbers",
        )
    rates = rates.astype(np.float64, copy=False)
    lowest, highest = float(rates.min()), float(rates.max())
    if lowest >= 0.0 and highest <= MOST_E_S:
        return rates, 0
    finite = np.isfinite(rates)
    bad = ~finite if not finite.all() else rates < -NEGATIVE_TOLERANCE * max(highest, 0.0)
    if bad.any():
        name, index = element_name("rate_map_e_s", bad)
        raise InputError(name, float(rates[index]), unit="e-/s", allowed=allowed)
    return np.clip(rates, 0.0, MOST_E_S), int(np.count_nonzero(rates < 0.0))
