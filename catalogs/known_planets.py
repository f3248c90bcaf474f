"""Known planets: published orbits of companions of catalogue stars, and what each of them lacks.

The shipped table holds the confirmed planets of the NASA Exoplanet Archive, as of 2019-05-31, of stars in the
catalogue. Arguments of periastron are those of the star's orbit, as radial velocities have them; the planet's own is
180 degrees more. A number is nan where the source has none; nothing is filled in, and ``flags`` says what is missing.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.archive_planets import reference_text, settle
from catalogs.errors import InputError
from catalogs.known_planet_columns import COLUMNS, FLAGS, GIVEN_FLAGS, INPUT_ONLY, flags_of, planet_quantity_of
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key
from catalogs.table_cells import allowed_text, choose_columns, read_cells
from catalogs.table_files import RawTable, TableBytes, parse_table, read_bytes

__all__ = ["DATA_FILE", "KnownPlanetTable", "load_known_planets", "star_key"]

DATA_FILE = "known_planets.csv"
_DATA = Path(__file__).resolve().parent / "data"
_DIGITS = 12
_COLUMNS = tuple(name for name in COLUMNS if name not in INPUT_ONLY)
_TEXTS = tuple(name for name in _COLUMNS if COLUMNS[name].kind == "text")
_NUMBERS = tuple(name for name in _COLUMNS if name not in _TEXTS)
_REQUIRED = (
    ("star",),
    ("planet",),
    ("period_days", "semi_major_axis_au"),
    ("mass_mjup", "msini_mjup", "radius_rjup", "best_mass_mjup"),
)


@dataclass(frozen=True)
class KnownPlanetTable:
    """An immutable table of planets.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Read-only arrays of equal length: those of `catalogs.known_planet_columns.COLUMNS` less ``INPUT_ONLY``;
        float64 with nan where missing, or text.
    label : str
        What messages call the table.
    provenance : str
        One line for results: what it is, its vintage or file name, the first digits of its sha256.
    notes : tuple of str
        Remarks on the reading, for its owner.
    """

    columns: Mapping[str, NDArray[np.generic]]
    label: str
    provenance: str
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of planets."""
        return len(self.columns["planet"])

    def __reduce__(self) -> tuple[object, ...]:
        """Travel to worker processes (a mapping proxy does not pickle)."""
        return (_rebuild, (dict(self.columns), self.label, self.provenance, self.notes))

    def number(self, name: str) -> NDArray[np.float64]:
        """Return a column of numbers (read-only)."""
        if name not in _NUMBERS:
            raise InputError("column", name, allowed=", ".join(_NUMBERS))
        return np.asarray(self.columns[name], np.float64)

    def text(self, name: str) -> list[str]:
        """Return a column of texts."""
        if name not in _TEXTS:
            raise InputError("column", name, allowed=", ".join(_TEXTS))
        return [str(cell) for cell in self.columns[name]]

    def flags(self, row: int) -> tuple[str, ...]:
        """Return the flags of one planet."""
        return tuple(filter(None, str(self.columns["flags"][row]).split(";")))

    def select(self, rows: ArrayLike) -> KnownPlanetTable:
        """Return the table of the rows of a mask, or of row numbers in their order."""
        index = np.asarray(rows)
        index = np.flatnonzero(index) if index.dtype == np.bool_ else index.astype(np.int64)
        return _table({name: cells[index] for name, cells in self.columns.items()}, self.label, self.provenance)

    @functools.cached_property
    def by_star(self) -> Mapping[str, tuple[int, ...]]:
        """Rows of each star, by `star_key` of its name."""
        found: dict[str, list[int]] = {}
        for row, name in enumerate(self.text("star")):
            found.setdefault(star_key(name), []).append(row)
        return MappingProxyType({key: tuple(rows) for key, rows in found.items()})

    @functools.cached_property
    def placed(self) -> NDArray[np.bool_]:
        """Which planets have a place on the sky at any date: phase, inclination and node are known."""
        dated = np.array(["phase_unknown" not in self.flags(row) for row in range(len(self))], bool)
        return dated & np.isfinite(self.number("inclination_deg")) & np.isfinite(self.number("node_deg"))

    def rows_of(self, star: str) -> tuple[int, ...]:
        """Return the rows of a star's planets, by any of its names; empty if it has none."""
        return self.by_star.get(star_key(star), ())

    def row_of(self, name: str) -> int:
        """Return the row of a planet by its name: any name of its star, and its letter.

        Raises
        ------
        InputError
            If there is no such planet.
        """
        star, _, letter = " ".join(name.split()).rpartition(" ")
        rows = self.rows_of(star)
        planets = self.text("planet")
        for row in rows:
            if planets[row].rpartition(" ")[2] == letter:
                return row
        hint = f"of this star: {', '.join(planets[row] for row in rows)}" if rows else ""
        raise InputError("planet", name, allowed=f"a planet of {self.label}", hint=hint)


def star_key(name: str) -> str:
    """Return one key for all names of a star: that of its name in the embedded catalogue, where it is in there.

    Examples
    --------
    >>> from catalogs.known_planets import star_key
    >>> star_key("HD 22049") == star_key("epsilon Eridani") == star_key("eps Eri")
    True
    """
    key = designation_key(name)
    return designation_key(snapshot_aliases().get(key, (name, 0))[0])


def load_known_planets(source: str | Path = "snapshot") -> KnownPlanetTable:
    """Return a table of known planets.

    Parameters
    ----------
    source : str or Path
        ``"snapshot"`` (shipped), or a CSV, ECSV, VOTable or FITS file with the columns that ``cpic catalog columns``
        lists; headings of the NASA Exoplanet Archive are understood.

    Returns
    -------
    KnownPlanetTable

    Raises
    ------
    InputError
        If there is no such file or it cannot be used, naming file, row, column, value, unit and range.

    Examples
    --------
    >>> from catalogs.known_planets import load_known_planets
    >>> planets = load_known_planets()
    >>> row = planets.row_of("eps Eri b")
    >>> float(planets.number("period_days")[row])
    2502.0
    """
    if source == "snapshot":
        return _snapshot()
    file = read_bytes(source, key="known_planets", presets="snapshot")
    return _user_table(file, parse_table(file))


@functools.cache
def _snapshot() -> KnownPlanetTable:
    data = (_DATA / DATA_FILE).read_bytes()
    reader = csv.reader(io.StringIO(data.decode("utf-8")))
    header = next(reader)
    cells = dict(zip(header, zip(*reader, strict=True), strict=True))
    columns = {name: np.array(cells[name]) for name in _TEXTS}
    columns |= {name: np.array([float(text) if text else np.nan for text in cells[name]]) for name in _NUMBERS}
    ordered = {name: columns[name] for name in _COLUMNS}
    digest = hashlib.sha256(data).hexdigest()[:_DIGITS]
    about = f"NASA Exoplanet Archive of 2019-05-31, {len(cells['planet'])} planets ({DATA_FILE} {digest})"
    return _table(ordered, "the table of known planets", about)


def _user_table(file: TableBytes, raw: RawTable) -> KnownPlanetTable:
    """Turn the columns of a file into a table of planets."""
    chosen, notes = choose_columns(raw, planet_quantity_of, [[COLUMNS[name] for name in names] for names in _REQUIRED])
    if "omega_star_deg" in chosen and "omega_planet_deg" in chosen:
        raise InputError(f"{raw.name} columns", "omega_star_deg and omega_planet_deg", allowed="one of the two")
    names = chosen["planet"].cells
    cells = {name: read_cells(raw, COLUMNS[name], column, names) for name, column in chosen.items()}
    headings = {name: column.heading for name, column in chosen.items()}
    rows: list[dict[str, Any]] = []
    seen: dict[str, int] = {}
    for number in range(len(raw)):
        given = {name: values[number] for name, values in cells.items() if values[number] is not None}
        where = f"{raw.name} row {number + 1}" + (f" ({given['planet']})" if "planet" in given else "")
        rows.append(_user_row(given, where, headings))
        first = seen.setdefault(designation_key(given["planet"]), number)
        if first != number:
            hint = f"rows {first + 1} and {number + 1} are of one name; of an archive's solutions keep the default ones"
            raise InputError(f"{where} column planet", given["planet"], allowed="every planet once", hint=hint)
    columns: dict[str, NDArray[np.generic]] = {}
    for name in _COLUMNS:
        text = name in _TEXTS
        columns[name] = np.array([row.get(name, "" if text else math.nan) for row in rows])
    about = f"user's table of {len(raw)} planet{'s' * (len(raw) != 1)} ({raw.name} {file.sha256[:_DIGITS]})"
    return _table(columns, raw.name, about, notes)


def _user_row(given: dict[str, Any], where: str, headings: Mapping[str, str]) -> dict[str, Any]:
    """Return one row by the columns of the shipped table, its flags included.

    Raises
    ------
    InputError
        If it lacks what is required, or states a flag that nobody knows.
    """
    for names in _REQUIRED:
        if not any(name in given for name in names):
            own = [name for name in names if name in headings]
            allowed = " or ".join(allowed_text(COLUMNS[name]) for name in own)
            raise InputError(
                f"{where} column {' or '.join(headings[name] for name in own)}", "missing", allowed=allowed
            )
    stated = tuple(filter(None, str(given.get("flags", "")).replace(" ", "").split(";")))
    for word in stated:
        if word not in FLAGS:
            raise InputError(f"{where} column flags", word, allowed=", ".join(GIVEN_FLAGS))
    texts = {name: value for name, value in given.items() if isinstance(value, str)}
    # Archives write 0 for an error that nobody gave.
    numbers = {
        name: value for name, value in given.items() if name not in texts and not ("_err" in name and value == 0)
    }
    if "omega_planet_deg" in numbers:
        numbers["omega_star_deg"] = numbers.pop("omega_planet_deg") - 180.0
    numbers, found = settle(numbers, texts.get("best_mass_kind", ""), where)
    texts["reference"] = reference_text(texts.get("reference", ""))
    texts["flags"] = ";".join(flags_of(numbers, found + tuple(word for word in stated if word in GIVEN_FLAGS)))
    return texts | numbers


def _table(
    columns: Mapping[str, NDArray[np.generic]], label: str, provenance: str, notes: tuple[str, ...] = ()
) -> KnownPlanetTable:
    for cells in columns.values():
        cells.flags.writeable = False
    return KnownPlanetTable(MappingProxyType(dict(columns)), label, provenance, notes)


def _rebuild(
    columns: dict[str, NDArray[np.generic]], label: str, provenance: str, notes: tuple[str, ...]
) -> KnownPlanetTable:
    return _table(columns, label, provenance, notes)
