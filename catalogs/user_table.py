"""A user's own star table: any CSV, ECSV, VOTable or FITS file with a name, a distance, V and a type or temperature.

Required per star: ``name``; ``distance_pc`` or ``parallax_mas``; ``v_mag``; ``sp_type`` or ``teff_k``. Everything else
may be missing and is then filled as in the shipped table, with ``*_src`` columns that say how. Headings may be what
people use (:mod:`catalogs.user_columns`), units those of an ECSV or VOTable, or written in the heading: ``plx [mas]``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from catalogs.errors import InputError
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key
from catalogs.stars import StarTable, load_stars, star_table
from catalogs.table_files import RawColumn, RawTable
from catalogs.user_columns import QUANTITIES, Quantity, quantity_of
from catalogs.user_fill import fill_row

__all__ = ["UserTable", "user_table"]

_ONE_OF = (("name",), ("v_mag",), ("distance_pc", "parallax_mas"), ("sp_type", "teff_k"))
_YES, _NO = ("1", "1.0", "true", "t", "yes", "y"), ("0", "0.0", "false", "f", "no", "n")
_HOURS = ("h", "hour", "hours", "hourangle")
_SHOWN = 40
_MANY = 12


@dataclass(frozen=True)
class UserTable:
    """A filled table and remarks for its owner: columns that are not used, what was read in an unusual way."""

    table: StarTable
    notes: tuple[str, ...]


def user_table(raw: RawTable) -> UserTable:
    """Turn the columns of a file into a star table.

    Parameters
    ----------
    raw : RawTable
        What :func:`catalogs.table_files.parse_table` read.

    Raises
    ------
    InputError
        Naming file, row, column, value, unit and range, if a column is missing or ambiguous, a unit is not
        understood, a cell is not what its column holds or out of range, or a name occurs twice.
    """
    chosen, notes = _choose(raw)
    given = {name: _values(raw, QUANTITIES[name], column) for name, column in chosen.items()}
    rows = []
    for i in range(len(raw)):
        row = {name: values[i] for name, values in given.items() if values[i] is not None}
        where = f"{raw.name} row {i + 1}" + (f" ({row['name']})" if "name" in row else "")
        for names in _ONE_OF:
            if not any(name in row for name in names):
                column = " or ".join(chosen[name].heading for name in names if name in chosen)
                allowed = " or ".join(_allowed(QUANTITIES[name]) for name in names if name in chosen)
                raise InputError(f"{where} column {column}", "missing", allowed=allowed)
        rows.append(fill_row(row, where, raw.name))
    _refuse_twins(raw.name, [str(row["name"]) for row in rows])
    table = star_table({name: [row[name] for row in rows] for name in rows[0]}, raw.name)
    return UserTable(table, notes + _companions_left_out(table))


def _choose(raw: RawTable) -> tuple[dict[str, RawColumn], tuple[str, ...]]:
    """Return quantity -> column, and remarks; refuse a table without the required ones."""
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
    lacking = [names for names in _ONE_OF if not any(name in chosen for name in names)]
    if lacking:
        forms = "; ".join(
            f"{name} ({', '.join(QUANTITIES[name].aliases[:6])}, ...)" for names in lacking for name in names
        )
        listed = ", ".join(column.heading for column in raw.columns[:_MANY]) + (", ..." if raw.columns[_MANY:] else "")
        wanted = ", ".join(" or ".join(names) for names in lacking)
        raise InputError(f"{raw.name} column {wanted}", "missing", allowed=forms, hint=f"the file has: {listed}")
    ignored = unknown + spare
    return chosen, raw.notes + ((f"{raw.name}: columns not used: {', '.join(ignored)}",) if ignored else ())


def _allowed(quantity: Quantity) -> str:
    if quantity.kind == "number":
        return quantity.allowed
    return {"name": "a unique name", "sp_type": "a spectral type such as G2V"}.get(quantity.name, "text")


def _values(raw: RawTable, quantity: Quantity, column: RawColumn) -> list[Any]:
    """Return the cells in the quantity's unit, checked; None where missing."""
    readers: dict[str, Callable[[Any], Any]] = {"text": _text, "flag": _flag, "hip": _hip, "number": _number}
    convert = _converter(raw.name, quantity, column) if quantity.kind == "number" else None
    unit = column.unit or quantity.unit
    names = next((other.cells for other in raw.columns if quantity_of(other.heading)[0] is QUANTITIES["name"]), None)
    values = []
    for i, cell in enumerate(column.cells):
        try:
            value = None if cell is None else readers[quantity.kind](cell)
            if value is not None and convert is not None:
                value = convert(value)
                if not quantity.low <= value <= quantity.high:
                    raise ValueError
        except (ValueError, OverflowError):
            who = f" ({names[i]})" if names and names[i] is not None else ""
            raise InputError(
                f"{raw.name} row {i + 1}{who} column {column.heading}",
                str(cell)[:_SHOWN],
                unit=unit if quantity.kind == "number" else "",
                allowed=_range(quantity),
                hint="write a decimal point" if isinstance(cell, str) and "," in cell else "",
            ) from None
        values.append(value)
    return values


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
    text = column.unit
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


def _companions_left_out(table: StarTable) -> tuple[str, ...]:
    """Say which stars have a companion in the snapshot whose light the table leaves out."""
    aliases, snapshot = snapshot_aliases(), load_stars()
    separations = zip(snapshot.column("name").tolist(), snapshot.column("companion_sep_arcsec").tolist(), strict=True)
    paired = {name for name, separation in separations if math.isfinite(separation)}
    names, hips, flags = (table.column(name).tolist() for name in ("name", "hip", "quality_flags"))
    stars = [
        name
        for name, hip, words in zip(names, hips, flags, strict=True)
        if "companions_not_listed" in words.split(";")
        and any(aliases.get(key, ("", 1))[0] in paired for key in (designation_key(name), f"hip {hip}"))
    ]
    if not stars:
        return ()
    shown = ", ".join(stars[:_MANY]) + (f" and {len(stars) - _MANY} more" if stars[_MANY:] else "")
    return (f"{table.label}: light of companions that the snapshot knows is left out, no companion column: {shown}",)


def _refuse_twins(name: str, stars: list[str]) -> None:
    first: dict[str, int] = {}
    for number, star in enumerate(stars, start=1):
        key = designation_key(star)
        if key in first:
            hint = f"rows {first[key]} and {number} are of one name"
            raise InputError(f"{name} row {number} column name", star, allowed="every name once", hint=hint)
        first[key] = number
