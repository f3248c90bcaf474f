"""Values as people write them on the command line: ``0.1nm``, ``x2``, ``1e-8``, ``blind``.

A value carries a unit or is a factor with an x before it. A number alone is taken by a key whose name ends in its unit
(``time_s=3600``), and by a quantity that has none (counts, fractions, contrasts). Where it could be read both ways, as
a value and as a factor, it is refused with both spellings (`two_spellings`).
"""

import math
import re
from dataclasses import dataclass
from typing import Any, Literal

from cpic_core import InputError, converted, number_and_unit, parse_yaml, units_like

_FACTOR = re.compile(r"[x*×]\s*([-+.\d].*)")


@dataclass(frozen=True)
class Written:
    """A value as it was written.

    Attributes
    ----------
    action : {"set", "scale"}
        ``scale`` for a factor on the present value.
    value : object
        The factor; or the number in the unit of its key, a list, or a word.
    text : str
        How tables and legends write it: ``x2``, ``0.1 nm``, ``1e-8``.
    bare : bool
        Whether it is a number with neither a unit nor an x.
    """

    action: Literal["set", "scale"]
    value: Any
    text: str
    bare: bool = False


def read_value(key: str, text: str, unit: str = "") -> Written:
    """Read a value.

    Parameters
    ----------
    key : str
        Its key, for refusals.
    text : str
        A number, a number with a unit, a factor as ``x0.7``, a list, or a word.
    unit : str
        Unit of the key's number, in the spelling of `simulator.config.base.unit_of`; empty where it has none.

    Returns
    -------
    Written

    Raises
    ------
    InputError
        For a factor that is negative or not finite, and for a unit that does not convert to that of the key.

    Examples
    --------
    >>> from cpic_planner.queries.written_values import read_value
    >>> read_value("drift.visit_nm", "100pm", "nm")
    Written(action='set', value=0.1, text='100 pm', bare=False)
    >>> read_value("throughput", "x0.7").action
    'scale'
    """
    text = text.strip()
    factor = _FACTOR.fullmatch(text)
    if factor is not None:
        number = _plain(key, factor[1])
        if not is_number(number) or not 0 <= number < math.inf:
            raise InputError(key, text, allowed="a factor on the present value, as x0.7: finite, at least 0")
        return Written("scale", number, f"x{factor[1].strip()}")
    if (unit or text.endswith("%")) and (parts := number_and_unit(text)):
        value = converted(text, unit)
        if value is None:
            allowed = f"a number with a unit: {', '.join(filter(None, units_like(unit)))}"
            raise InputError(key, text, allowed=allowed)
        return Written("set", value, " ".join(parts))
    value = _plain(key, text)
    if isinstance(value, list):
        items = [
            read_value(key, item, unit) if isinstance(item, str) else Written("set", item, str(item), True)
            for item in value
        ]
        plain = all(item.bare and is_number(item.value) for item in items)
        return Written("set", [item.value for item in items], with_unit(text, unit) if plain else text)
    if is_number(value):
        return Written("set", value, with_unit(text, unit), bare=True)
    return Written("set", value, text)


def seconds_text(key: str, text: str) -> str:
    """Return the seconds of a time with a unit (``2h``), as the shortest text of the number.

    Parameters
    ----------
    key : str
        For refusals.
    text : str
        What was written.

    Raises
    ------
    InputError
        For a number alone, and what is no time.
    """
    written = read_value(key, text, "s")
    if written.bare or written.action != "set" or not isinstance(written.value, float):
        raise InputError(key, text or "nothing", allowed="a time with a unit: s, min, h or d, as 2h")
    return repr(written.value)


def with_unit(text: str, unit: str) -> str:
    """Return a value followed by its unit, if it has one.

    Parameters
    ----------
    text : str
        What was written.
    unit : str
        Unit of the value, in words; empty without one.
    """
    return f"{text} {unit}" if unit else text


def two_spellings(
    key: str, name: str, text: str, *, unit: str, present: float | None = None, value_key: str = ""
) -> InputError:
    """Return the refusal of a number that could be a value or a factor; it names both spellings and their meanings.

    Parameters
    ----------
    key : str
        Key of the refusal.
    name : str
        Name of the value as it was written.
    text : str
        The number.
    unit : str
        Unit of the value; empty where it has none.
    present : float, optional
        What a factor multiplies.
    value_key : str
        Key that takes the number as a value where the quantity has no unit; empty where there is none.
    """
    number = _plain(key, text)
    times = f"{name}=x{text} is {text} times the instrument's"
    if present is not None:
        times += f" {with_unit(f'{present:g}', unit)}: {with_unit(f'{present * number:g}', unit)}"
    value = f"{name}={text}{unit} is {text} {unit}" if unit else f"{value_key}={text} is the value itself"
    spelled = f"{times}; {value}" if unit or value_key else times
    asked = f"a unit ({unit}), or an x before a factor" if unit else "an x before a factor"
    return InputError(key, text, allowed=asked, hint=spelled)


def _plain(key: str, text: str) -> Any:
    """Return a number, truth value, null, list or mapping as YAML reads it; other words as they are."""
    try:
        return parse_yaml(text, where=key)
    except InputError:
        if text[:1] in ("[", "{"):
            raise
        return text


def is_number(value: Any) -> bool:
    """Return whether a value is a number, which a truth value is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)
