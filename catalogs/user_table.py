"""A user's own star table: any CSV, ECSV, VOTable or FITS file with a name, a distance, V and a type or temperature.

Required per star: ``name``; ``distance_pc`` or ``parallax_mas``; ``v_mag``; ``sp_type`` or ``teff_k``. Everything else
may be missing and is then filled as in the shipped table, with ``*_src`` columns that say how. Headings may be what
people use (:mod:`catalogs.user_columns`), units those of an ECSV or VOTable, or written in the heading: ``plx [mas]``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catalogs.errors import InputError
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key
from catalogs.stars import StarTable, load_stars, star_table
from catalogs.table_cells import allowed_text, choose_columns, read_cells
from catalogs.table_files import RawTable
from catalogs.user_columns import QUANTITIES, Quantity, quantity_of
from catalogs.user_fill import fill_row

__all__ = ["UserTable", "user_table"]

_ONE_OF = (("name",), ("v_mag",), ("distance_pc", "parallax_mas"), ("sp_type", "teff_k"))
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
    chosen, notes = choose_columns(raw, quantity_of, [[QUANTITIES[name] for name in names] for names in _ONE_OF])
    names = chosen["name"].cells
    given = {name: read_cells(raw, QUANTITIES[name], column, names) for name, column in chosen.items()}
    rows = []
    for i in range(len(raw)):
        row = {name: values[i] for name, values in given.items() if values[i] is not None}
        where = f"{raw.name} row {i + 1}" + (f" ({row['name']})" if "name" in row else "")
        for either in _ONE_OF:
            if not any(name in row for name in either):
                column = " or ".join(chosen[name].heading for name in either if name in chosen)
                allowed = " or ".join(_allowed(QUANTITIES[name]) for name in either if name in chosen)
                raise InputError(f"{where} column {column}", "missing", allowed=allowed)
        rows.append(fill_row(row, where, raw.name))
    _refuse_twins(raw.name, [str(row["name"]) for row in rows])
    table = star_table({name: [row[name] for row in rows] for name in rows[0]}, raw.name)
    return UserTable(table, notes + _companions_left_out(table))


def _allowed(quantity: Quantity) -> str:
    words = {"name": "a unique name", "sp_type": "a spectral type such as G2V"}
    return words.get(quantity.name) or allowed_text(quantity)


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
