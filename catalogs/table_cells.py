"""What every table of a user's own shares: which column is which quantity, and cells read in its unit and range."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any

from catalogs.errors import InputError
from catalogs.table_files import RawColumn, RawTable
from catalogs.user_columns import Quantity

__all__ = ["allowed_text", "choose_columns", "read_cells"]

_YES, _NO = ("1", "1.0", "true", "t", "yes", "y"), ("0", "0.0", "false", "f", "no", "n")
_HOURS = ("h", "hour", "hours", "hourangle")
_PLURALS = {"days": "d", "degrees": "deg", "years": "yr", "hours": "h"}
_SHOWN = 40
_MANY = 12


def choose_columns(
    raw: RawTable,
    quantity_of: Callable[[str], tuple[Quantity | None, str]],
    required: Sequence[Sequence[Quantity]],
) -> tuple[dict[str, RawColumn], tuple[str, ...]]:
    """Return the column of each quantity by its name, and remarks.

    Parameters
    ----------
    raw : RawTable
    quantity_of : callable
        What a heading means, and the unit written in it.
    required : sequence of sequence of Quantity
        Of each of these the table must have one.

    Raises
    ------
    InputError
        If a required column is missing, or two columns claim to be one quantity.
    """
    candidates: dict[str, list[RawColumn]] = {}
    unknown = []
    for column in raw.columns:
        quantity, unit = quantity_of(column.heading)
        if quantity is None:
            unknown.append(column.heading or "(no heading)")
        else:
            candidates.setdefault(quantity.name, []).append(
                RawColumn(column.heading, column.unit or unit, column.cells)
            )
    chosen, spare = {}, []
    for name, columns in candidates.items():
        exact = [column for column in columns if column.heading == name]
        if len(columns) > 1 and len(exact) != 1:
            both = " and ".join(column.heading for column in columns)
            raise InputError(f"{raw.name} columns", both, allowed=f"one column for {name}", hint=f"name it {name}")
        chosen[name] = exact[0] if exact else columns[0]
        spare += [column.heading for column in columns if column is not chosen[name]]
    lacking = [group for group in required if not any(item.name in chosen for item in group)]
    if lacking:
        forms = "; ".join(f"{item.name} ({', '.join(item.aliases[:6])}, ...)" for group in lacking for item in group)
        listed = ", ".join(column.heading for column in raw.columns[:_MANY]) + (", ..." if raw.columns[_MANY:] else "")
        wanted = ", ".join(" or ".join(item.name for item in group) for group in lacking)
        # With one known column or none it may be any file at all, and is not quoted.
        hint = f"the file has: {listed}" if len(chosen) > 1 else f"the file has {len(raw.columns)} columns"
        raise InputError(f"{raw.name} column {wanted}", "missing", allowed=forms, hint=hint)
    ignored = unknown + spare
    shown = ", ".join(ignored[:_MANY]) + (f" and {len(ignored) - _MANY} more" if ignored[_MANY:] else "")
    return chosen, raw.notes + ((f"{raw.name}: columns not used: {shown}",) if ignored else ())


def read_cells(raw: RawTable, quantity: Quantity, column: RawColumn, names: Sequence[Any] | None) -> list[Any]:
    """Return the cells in the quantity's unit, checked; None where missing.

    Parameters
    ----------
    raw : RawTable
    quantity : Quantity
    column : RawColumn
        The column of `raw` that holds the quantity.
    names : sequence or None
        What the rows are about, for messages.

    Raises
    ------
    InputError
        Naming file, row, column, value, unit and range.
    """
    readers: dict[str, Callable[[Any], Any]] = {"text": _text, "flag": _flag, "hip": _hip, "number": _number}
    convert = _converter(raw.name, quantity, column) if quantity.kind == "number" else None
    unit = column.unit or quantity.unit
    values = []
    for i, cell in enumerate(column.cells):
        try:
            value = None if cell is None else readers[quantity.kind](cell)
            if value is not None and convert is not None:
                value = convert(value)
                if not quantity.low <= value <= quantity.high:
                    raise ValueError
        except (ValueError, OverflowError):
            who = f" ({names[i]})" if names is not None and names[i] is not None else ""
            raise InputError(
                f"{raw.name} row {i + 1}{who} column {column.heading}",
                str(cell)[:_SHOWN],
                unit=unit if quantity.kind == "number" else "",
                allowed=_range(quantity),
                hint="write a decimal point" if isinstance(cell, str) and "," in cell else "",
            ) from None
        values.append(value)
    return values


def allowed_text(quantity: Quantity) -> str:
    """Return what a cell may hold, in words."""
    return quantity.allowed if quantity.kind == "number" else "text"


def _range(quantity: Quantity) -> str:
    if quantity.kind == "flag":
        return "yes or no, true or false, 1 or 0"
    if quantity.kind == "hip":
        return "a Hipparcos number, 1 to 120404"
    return f"a number, {quantity.allowed}"


def _text(cell: Any) -> str | None:
    return " ".join(str(cell).split()) or None


def _number(cell: Any) -> float:
    if isinstance(cell, bool):
        raise ValueError
    if isinstance(cell, str) and "_" in cell:  # Python reads 1_000, people do not
        raise ValueError
    value = float(cell)
    if not math.isfinite(value):
        raise ValueError
    return value


def _flag(cell: Any) -> bool:
    text = str(cell).strip().lower()
    if text not in _YES + _NO:
        raise ValueError
    return text in _YES


def _hip(cell: Any) -> int | None:
    found = re.fullmatch(r"(?:HIP\s*)?(\d+)(?:\.0*)?", str(cell).strip(), re.IGNORECASE)
    if not found or int(found[1]) > 120404:
        raise ValueError
    return int(found[1]) or None


def _converter(name: str, quantity: Quantity, column: RawColumn) -> Callable[[float], float] | None:
    """Return the conversion from the column's unit, the identity where it names none or the same."""
    if column.unit.replace(" ", "") in ("", quantity.unit.replace(" ", ""), "---", "-", "none"):
        return float
    from astropy import units

    problem = InputError(
        f"{name} column {column.heading}", f"unit {column.unit}", allowed=f"a unit like {quantity.unit or 'none'}"
    )
    text = _PLURALS.get(column.unit.strip().lower(), column.unit)  # as archives write them
    if quantity.name == "log_g":  # dex(cm/s2), [cm/s2] and log(cm.s**-2) are all in use
        text = re.sub(r"^(?:\[(.*)\]|(?:dex|log|log10)\((.*)\))$", r"\1\2", text.strip())
    try:
        clock = quantity.name == "ra_deg" and text.lower() in _HOURS
        unit = units.hourangle if clock else units.Unit(text)
        if quantity.name == "metallicity" or text == "dex":
            factor = (1.0 * unit).to_value(units.dex)
            shift = 0.0
        else:
            wanted = units.cm / units.s**2 if quantity.name == "log_g" else units.Unit(quantity.unit)
            factor = (1.0 * unit).to_value(wanted)
            shift = math.log10(factor) if quantity.name == "log_g" else 0.0
    except (ValueError, TypeError):
        raise problem from None
    if quantity.name in ("log_g", "metallicity"):
        return lambda value: value + shift
    return lambda value: value * factor
