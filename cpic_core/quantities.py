"""Types of arrays, one name for each; numbers from outside, with or without a unit of `astropy.units`."""

import functools
import math
import re
from collections.abc import Collection
from fractions import Fraction
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import ArrayLike as ArrayLike, NDArray as NDArray

from cpic_core.errors import InputError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
ComplexArray = NDArray[np.complex128]
_ASTROPY_UNITS = {"R_Jup": "jupiterRad", "au": "AU", "L_sun": "solLum", "ADU": "adu", "px": "pixel", "e-": "electron"}
_ASTROPY_UNITS |= {"e-/ADU": "electron/adu", "e-/s": "electron/s", "e-/um": "electron/um", "1/s/cm2": "s-1 cm-2"}
_ASTROPY_UNITS |= {"M_Jup": "jupiterMass", "M_Sun": "solMass"}


def in_unit(name: str, value: Any, unit: str) -> Any:
    """Return a value that carries a unit (`astropy.units`) as plain numbers in the unit named; others unchanged.

    Parameters
    ----------
    name : str
        Name that a refusal gives.
    value : object
        Number(s), with or without a unit.
    unit : str
        Unit of the value, in words; empty without one.

    Raises
    ------
    InputError
        If the units do not convert.
    """
    if not hasattr(value, "to_value"):
        return value
    try:
        return value.to_value(_ASTROPY_UNITS.get(unit, unit))
    except (TypeError, ValueError):  # astropy's unit errors are both
        allowed = f"a number in {unit}, or a quantity that converts to it" if unit else "a number without a unit"
        raise InputError(name, str(value), allowed=allowed) from None


def is_quantity(value: Any) -> bool:
    """Tell whether a value carries a unit of `astropy.units`."""
    return hasattr(value, "to_value") and hasattr(value, "unit")


def real_array(name: str, value: ArrayLike, unit: str = "") -> np.ndarray:
    """Return numbers, plain or with a unit, as a float64 array; masked ones are nan.

    Parameters
    ----------
    name : str
        Name that a refusal gives.
    value : array_like
        Number(s).
    unit : str, optional
        Unit of the value, in words; empty without one.

    Raises
    ------
    InputError
        If they are not real numbers (text, truth values, complex) or carry a unit that does not convert.
    """
    plain = in_unit(name, value, unit)
    try:
        found = np.asarray(plain)
        # numpy would read text and truth values as numbers.
        array = found.astype(np.float64) if found.dtype.kind in "fiuO" else None
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is None:
        raise InputError(name, value, unit=unit, allowed="real numbers")
    mask = getattr(plain, "mask", None)  # of masked arrays; what tables of pandas call so is a method
    if isinstance(mask, np.ndarray | np.bool_):
        array[np.broadcast_to(mask, array.shape)] = np.nan
    return array


def check_finite(name: str, value: ArrayLike, unit: str = "") -> np.ndarray:
    """Return `real_array`; refuse values that are not finite.

    Parameters
    ----------
    name : str
        Name that a refusal gives.
    value : array_like
        Number(s), with or without a unit.
    unit : str, optional
        Unit of the value, in words; empty without one.
    """
    array = real_array(name, value, unit)
    if not np.isfinite(array).all():
        raise InputError(name, float(array[~np.isfinite(array)].flat[0]), unit=unit, allowed="finite numbers")
    return array


def check_number(name: str, value: Any, unit: str = "") -> float:
    """Return one number, plain or with a unit; refuse what is not finite.

    Parameters
    ----------
    name : str
        Name that a refusal gives.
    value : object
        One number, with or without a unit.
    unit : str, optional
        Unit of the value, in words; empty without one.
    """
    array = real_array(name, value, unit)
    if array.ndim or not np.isfinite(array):
        raise InputError(name, array.tolist(), unit=unit, allowed="a finite number")
    return float(array)


def check_whole(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number, of any type of number but truth values, that lies in a range.

    Parameters
    ----------
    name : str
        Name that a refusal gives.
    value : object
        One whole number.
    low : int
        Least value allowed.
    high : int
        Largest value allowed.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        number = check_number(name, value)
    except InputError:
        number = float("nan")
    if not (low <= number <= high and number.is_integer()):
        raise InputError(name, value, allowed=f"an integer from {low} to {high}")
    return int(number)


def check_flag(name: str, value: Any) -> bool:
    """Return a switch that Python code gives.

    Raises
    ------
    InputError
        Unless it is True or False.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(name, value, allowed="True or False")
    return bool(value)


_PROTOCOLS = ("tcp", "tls", "ws", "wss")


def check_word(name: str, value: Any, words: Collection[str]) -> None:
    """Refuse what is none of some words.

    Parameters
    ----------
    name : str
        Name that a refusal gives.
    value : object
    words : collection of str
    """
    if not isinstance(value, str) or value not in words:
        raise InputError(name, value, allowed=", ".join(words))


def check_address(scheduler: str | None) -> str | None:
    """Refuse what can be no address of a scheduler, before anything slow is done with it; returns what it got."""
    if scheduler is None:
        return None
    good = isinstance(scheduler, str)
    if good:
        try:
            parts = urlsplit(scheduler)
            good = parts.scheme in _PROTOCOLS and bool(parts.hostname) and bool(parts.port)
        except ValueError:  # no port
            good = False
    if not good:
        raise InputError("--scheduler", scheduler, allowed="an address tcp://host:port")
    return scheduler


def check_pair(name: str, value: Any, limit: float, unit: str = "", *, why: str = "") -> tuple[float, float]:
    """Return two finite numbers, x and y, each at most ``limit`` either way; ``why`` says where the limit comes from.

    Parameters
    ----------
    name : str
        Name that a refusal gives.
    value : object
        Two numbers.
    limit : float
        Largest absolute value.
    unit : str, optional
        Unit of the value, in words; empty without one.
    why : str, optional
        Reason that a refusal gives.

    Raises
    ------
    InputError
        If they are none.
    """
    allowed, value = f"x and y, each at most {limit:g}{why and f', {why}'}", in_unit(name, value, unit)
    try:
        values = real_array(name, value, unit)
    except InputError:
        values = np.empty(0)
    if values.shape != (2,) or not np.isfinite(values).all() or np.abs(values).max() > limit:
        raise InputError(name, value, unit=unit, allowed=allowed)
    return float(values[0]), float(values[1])


def element_name(key: str, bad: BoolArray) -> tuple[str, tuple[int, ...]]:
    """Return the name and index of the first ``True`` of ``bad``: ``("rate_map_e_s[y=3, x=7]", (3, 7))`` for images."""
    index = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), bad.shape))
    if not index:
        return key, index
    labels = [f"y={index[0]}", f"x={index[1]}"] if len(index) == 2 else [str(i) for i in index]
    return f"{key}[{', '.join(labels)}]", index


def checked_array(
    key: str, value: ArrayLike, *, low: float, high: float = np.inf, unit: str = "", allowed: str = ""
) -> FloatArray:
    """Return the ``value`` as float64, every element finite and within ``[low, high]``.

    Raises
    ------
    InputError
        Naming the first element that is not a finite number in range.
    """
    allowed = allowed or (f"{low:g} to {high:g}" if np.isfinite(high) else f"finite and at least {low:g}")
    value = in_unit(key, value, unit)
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf":
            raise TypeError
        array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(key, value, unit=unit, allowed=f"numbers, {allowed}") from None
    bad = ~((array >= low) & (array <= high) & np.isfinite(array))
    if bad.any():
        name, index = element_name(key, bad)
        raise InputError(name, float(array[index]), unit=unit, allowed=allowed)
    return array


def checked_scalar(key: str, value: ArrayLike, *, low: float, high: float, unit: str = "") -> float:
    """Return one finite number within ``[low, high]``, refused by name otherwise."""
    array = checked_array(key, value, low=low, high=high, unit=unit)
    if array.ndim:
        raise InputError(key, value, unit=unit, allowed="one number")
    return float(array)


_UNITS = {name: name for name in ("arcsec", "au", "deg", "h", "km", "m", "mag", "mas", "nm", "pc", "s", "um")}
_UNITS |= {"adu": "ADU", "days": "d", "e": "e-", "k": "K", "lambda_d": "lambda/D", "lsun": "L_sun", "mag_max": "mag"}
_UNITS |= {"pixel": "px", "pixels": "px", "rjup": "R_Jup", "zodis": "zodi", "per_s_cm2": "1/s/cm2", "deg_s": "deg/s"}
_UNITS |= {"e_adu": "e-/ADU", "e_s": "e-/s", "e_um": "e-/um", "mag_arcsec2": "mag/arcsec2", "mas_yr": "mas/yr"}
_UNITS |= {"nm_per_sqrt_hour": "nm/sqrt(h)"}


@functools.lru_cache(maxsize=4096)
def unit_of(key: str) -> str:
    """Return the unit named by the suffix of a key, ``""`` if none; that of an item of a list is that of the list."""
    key = re.sub(r"(\.\d+)+$", "", key)
    tails = (key[mark.end() :] for mark in re.finditer("_", key))
    return next((_UNITS[tail] for tail in tails if tail in _UNITS), "")


_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")
_LENGTHS = {"pm": -12, "nm": -9, "um": -6, "mm": -3, "cm": -2, "m": 0, "km": 3}
_FAMILIES: tuple[dict[str, Fraction], ...] = (
    {unit: Fraction(10) ** power for unit, power in _LENGTHS.items()},
    {"s": Fraction(1), "min": Fraction(60), "h": Fraction(3600), "d": Fraction(86400)},
    {"mas": Fraction(1, 1000), "arcsec": Fraction(1), "arcmin": Fraction(60), "deg": Fraction(3600)},
    {"pm/sqrt(h)": Fraction(1, 1000), "nm/sqrt(h)": Fraction(1), "um/sqrt(h)": Fraction(1000)},
    {"%": Fraction(1, 100), "": Fraction(1)},
)
"""Units that convert into each other, with their sizes; any other unit stands for itself."""
_SPELLED = {"µm": "um", "μm": "um", "sec": "s", "zodis": "zodi", "e": "e-", "e/s": "e-/s", "AU": "au"}
_SPELLED |= dict.fromkeys(("hr", "hour", "hours"), "h") | dict.fromkeys(("day", "days"), "d")
_SPELLED |= {f"{size}/√h": f"{size}/sqrt(h)" for size in ("pm", "nm", "um")}
"""Other spellings of units."""


def number_and_unit(text: str) -> tuple[str, str] | None:
    """Return the number of a text and the unit behind it as we spell it; None where there is no number or no unit."""
    match = _NUMBER.fullmatch(text.strip())
    return None if match is None or not match[2] else (match[1], _SPELLED.get(match[2].strip(), match[2].strip()))


def units_like(unit: str) -> dict[str, Fraction]:
    """Return the units that convert into a unit, itself too, with their sizes."""
    return next((family for family in _FAMILIES if unit in family), {unit: Fraction(1)})


def converted(text: str, unit: str) -> float | None:
    """Return the number of a text such as ``10h`` in a unit; None where the text has no unit that converts into it."""
    parts, sizes = number_and_unit(text), units_like(unit)
    if parts is None or parts[1] not in sizes:
        return None
    value = float(parts[0])
    if value == 0.0 or not math.isfinite(value):
        return value
    return float(Fraction(parts[0]) * sizes[parts[1]] / sizes[unit])


def described(array: np.ndarray) -> str:
    """Return the type and shape of an array, as refusals name it."""
    return f"{array.dtype} array of shape {array.shape}"


def check_mask(key: str, value: ArrayLike, shape: tuple[int, ...], *, empty: bool = False) -> BoolArray:
    """Return the pixels as a mask; refused by name if they are no truth values of that shape, or none of them is true.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : array_like
        Pixels that are meant.
    shape : tuple of int
        Shape of the images.
    empty : bool, optional
        Whether all of them may be false.
    """
    mask = np.asarray(value)
    if mask.dtype != np.bool_ or mask.shape != tuple(shape) or not (empty or mask.any()):
        allowed = f"booleans of shape {tuple(shape)}" + ("" if empty else ", some of them true")
        raise InputError(key, described(mask), allowed=allowed)
    return mask


def require(key: str, value: float, good: bool, unit: str, allowed: str) -> None:
    """Refuse a value that is not good, naming key, value, unit and what is allowed."""
    if not good:
        raise InputError(key, value, unit=unit, allowed=allowed)


def check_positive(key: str, value: float, unit: str = "") -> None:
    """Refuse a number that is not finite and above 0.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : float
    unit : str, optional
        Unit of the value.
    """
    require(key, value, math.isfinite(value) and value > 0, unit, "finite and above 0")
