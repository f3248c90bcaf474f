"""The star catalogue: nearby F, G and K stars with every filled value labelled.

Rows are all stars of the SIMBAD extract of spectral class F, G or K with parallax >= 25 mas and V <= 7.5, without a
bright limit and of every luminosity class, less blends whose components are listed and less four rows that a better
parallax puts beyond 40 pc (``stars_removed.csv``). A ranking uses all rows with V <= 7. Companions are flagged, never
dropped: dwarfs without a close companion are the paper's "nearly 700", but its own example, alpha Cen B, has one.

Values are read from ``data/stars.csv``; units and descriptions are in ``data/columns.csv``. A number is nan only where
its ``*_src`` column says ``missing``.

Stars and companions stand where their sources saw them: alpha Cen B where Hipparcos did in 1991;
`catalogs.binaries` moves them to a date. ``close_companion`` is SIMBAD's flag, by which the paper counts its sample.

Published temperatures of single stars are laid over the base table, and over refreshed tables; a table of one's own is
never touched. ``stellar_parameters.csv`` is kept by hand: one row is what one publication says of one star,
temperature, perhaps gravity, metallicity and limb-darkened angular diameter, with the publication, where it was read
and when. A star with rows takes the median of their temperatures, to which the table's own value counts where it is
measured too, and the medians of their gravities and metallicities. Where a diameter was measured, luminosity is that of
diameter and temperature of the same row, which is the bolometric flux; elsewhere that of V, and the radius follows.

Rows are interferometry and benchmarks, spectroscopy beside them, and spectroscopy of stars that else have a colour
only; a star without rows has not been found there. A mean or median of the PASTEL catalogue may contain other rows of
its star. The diameters of psi Dra A, HD 16160 and 5 Ser and the H-band spectrum of HD 16160 (Olander et al. 2025,
4607 K) are left out: they contradict colour and spectroscopy by over 200 K.
"""

import functools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, fields, replace
from statistics import median
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from catalogs import stellar_physics as physics
from catalogs.nomenclature import designation_key
from catalogs.shipped import parsed, shipped_digest, shipped_lines, shipped_objects, shipped_words
from catalogs.stellar_physics import is_composite, is_giant, luminosity_class
from catalogs.table_cells import Column, Columns, columns_of
from cpic_core import ArrayLike, InputError, NDArray, Record

COLUMNS: tuple[Column, ...] = columns_of("stars", without="not_shipped")
"""Columns of a star table, in the order of the shipped file."""
QUANTITIES = Columns(*columns_of("stars", only="own"), table="stars")
"""Every column that a user's table may give, by its name."""

SHIPPED_FLAGS = shipped_words("star_flags", "shipped")
"""Words of the column quality_flags in the shipped table, and what each means."""
ADDED_FLAGS = shipped_words("star_flags", "added")
"""Words that only refreshed tables and tables of a user's own have."""

CLOSE_COMPANION_ARCSEC = 10.0
"""A companion nearer than this is a close one."""
_LOW_PARALLAX_SNR = 50.0
# SIMBAD's codes of object types.
_VARIABLE_TYPES = "V* V*? BY* RS* dS* gD* Fl* Er* Pu* TT* BS* a2* Ce* LP* El* Ro* WU* Al* EB*"
_BINARY_TYPES = "SB* El* WU* EB*"


def type_flags(sp_type: str, object_type: str, simbad_id: str) -> set[str]:
    """Return the flags that spectral type, SIMBAD object type (old or new code) and identifier call for.

    Parameters
    ----------
    sp_type : str
        Spectral type.
    object_type : str
        SIMBAD's code of the type of object, "" if unknown.
    simbad_id : str
        SIMBAD's main identifier.
    """
    checks = {
        "variable": object_type in _VARIABLE_TYPES.split() or simbad_id.startswith("V*"),
        "spectroscopic_binary": object_type in _BINARY_TYPES.split(),
        "double_entry": object_type == "**",
    }
    return {name for name, applies in checks.items() if applies}.union(_type_flags(sp_type))


@functools.lru_cache(maxsize=10_000)
def _type_flags(sp_type: str) -> frozenset[str]:
    """Return the flags that a spectral type calls for; a table has few types and many stars."""
    checks = {
        "giant": is_giant(sp_type),
        "no_class": not luminosity_class(sp_type),
        "composite_spectrum": is_composite(sp_type),
        "peculiar": bool(re.search(r"p|m", sp_type[1:])),
    }
    return frozenset(name for name, applies in checks.items() if applies)


def parallax_flags(parallax_mas: float, parallax_err_mas: float) -> set[str]:
    """Return the flags that a parallax and its error (nan if unknown) call for.

    Parameters
    ----------
    parallax_mas, parallax_err_mas : float
        Parallax and its standard error, mas; nan if unknown.
    """
    if not math.isfinite(parallax_err_mas):
        return {"parallax_unknown_error"}
    low = parallax_err_mas > 0.0 and parallax_mas / parallax_err_mas < _LOW_PARALLAX_SNR
    return {"low_parallax_snr"} if low else set()


_FILE = "stellar_parameters.csv"
_DECIMALS = {column.name: column.decimals for column in COLUMNS}
_READ = ["sp_type", "v_mag", "b_v_mag", "distance_pc", "teff_k", "teff_k_src", "log_g", "log_g_src", "metallicity"]
_READ += ["mass_msun", "mass_msun_src", "quality_flags"]
_DIAMETER_SOURCE = "derived:angular diameter and Teff of the same publication"


class PublishedParameters(Record):
    """The parameters that one publication gives of one star; nan for those that it does not give.

    Parameters
    ----------
    star : str
        Name as in the star table.
    teff_k, teff_err_k : float
        Effective temperature and its error, K.
    log_g, metallicity : float
        log10 of the surface gravity (cm/s2) and [Fe/H], dex.
    angular_diameter_mas : float
        Limb-darkened angular diameter, mas, from which the temperature follows.
    reference, read_in : str
        Publication, and the public copy in which the numbers were read.
    date : str
        When they were read, YYYY-MM-DD.
    """

    star: str
    teff_k: float
    teff_err_k: float
    log_g: float
    metallicity: float
    angular_diameter_mas: float
    reference: str
    read_in: str
    date: str


@functools.cache
def published_parameters() -> Mapping[str, tuple[PublishedParameters, ...]]:
    """Return the rows of ``stellar_parameters.csv`` by star, in the order of the file. It is read once per process."""
    found: dict[str, list[PublishedParameters]] = {}
    for row in shipped_objects(_FILE, PublishedParameters):
        found.setdefault(row.star, []).append(row)
    return {star: tuple(items) for star, items in found.items()}


@functools.cache
def parameters_vintage() -> str:
    """Return in one line what is laid over: the number of stars, the file, and the first digits of its checksum."""
    return f"temperatures of {len(published_parameters())} stars from {_FILE} {shipped_digest(_FILE)}"


def updated_columns(columns: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """Return the columns of a star table that change where its stars have published parameters.

    Parameters
    ----------
    columns : mapping of str to ndarray
        All columns of the table, by name. Stars without published parameters keep what they have.
    """
    medians = physics.measured_medians(columns)
    changed: dict[str, dict[int, Any]] = {}
    for index, star in enumerate(columns["name"].tolist()):
        if star in published_parameters():
            old = {name: columns[name][index].item() for name in _READ}
            of_type_k = physics.nearest_subtype(old["sp_type"], medians)[0]
            for name, value in _row(old, published_parameters()[star], of_type_k).items():
                shown = round(value, _DECIMALS[name]) if isinstance(value, float) else value
                changed.setdefault(name, {})[index] = shown
    return {
        name: np.array([new.get(index, old) for index, old in enumerate(columns[name].tolist())])
        for name, new in changed.items()
    }


def _row(old: Mapping[str, Any], rows: tuple[PublishedParameters, ...], of_type_k: float) -> dict[str, Any]:
    """Return the cells of one star that change; `of_type_k` is the temperature that stars of its type have."""
    own = [old["teff_k"]] if old["teff_k_src"].startswith("measured") else []
    temperatures = [row.teff_k for row in rows] + own
    teff_k = median(temperatures)
    new = dict(old) | {"teff_k": teff_k, "teff_k_src": _source(len(temperatures), rows)}
    for name in ("log_g", "metallicity"):
        if given := [row for row in rows if math.isfinite(getattr(row, name))]:
            new |= {name: median(getattr(row, name) for row in given), f"{name}_src": _source(len(given), given)}
    fluxes = [
        physics.luminosity_from_diameter(row.angular_diameter_mas, old["distance_pc"], row.teff_k)
        for row in rows
        if math.isfinite(row.angular_diameter_mas)
    ]
    derived = (physics.GRAVITY_SOURCE, physics.MASS_SOURCE)
    known = {name: (new[name], src) for name in ("log_g", "mass_msun") if (src := new[f"{name}_src"]) not in derived}
    if fluxes:
        known["luminosity_lsun"] = median(fluxes), _DIAMETER_SOURCE
    new |= physics.bulk_columns(new, known)
    from_colour = physics.colour_temperature(old["b_v_mag"], new["metallicity"])[0]
    disagrees = physics.temperatures_disagree(teff_k, [*temperatures, from_colour, of_type_k])
    flags = set(old["quality_flags"].split(";")) - {"teff_disagreement", ""}
    new["quality_flags"] = ";".join(sorted(flags | ({"teff_disagreement"} if disagrees else set())))
    return {name: value for name, value in new.items() if value != old.get(name)}


def _source(number: int, rows: Iterable[PublishedParameters]) -> str:
    """Return the words of a ``*_src`` column for the median of so many values."""
    return f"measured:median of {number} published values ({_FILE}: {'; '.join(row.reference for row in rows)})"


_PLAIN = (dict, MappingProxyType)


class FrozenTable(Record):
    """An immutable table: its mappings cannot be changed, nor the arrays of its columns.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Arrays of equal length; they become read-only.
    """

    columns: Mapping[str, NDArray[np.generic]]

    def __post_init__(self) -> None:
        for values in self.columns.values():
            values.flags.writeable = False
        for name, value in self._values().items():
            if isinstance(value, _PLAIN):
                object.__setattr__(self, name, MappingProxyType(dict(value)))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.columns.values())))

    def __reduce__(self) -> tuple[object, ...]:
        """Travel to worker processes as plain data (a mapping proxy does not pickle)."""
        values = self._values().values()
        return (type(self), tuple(dict(value) if isinstance(value, _PLAIN) else value for value in values))

    def _values(self) -> dict[str, object]:
        return {field.name: getattr(self, field.name) for field in fields(self)}


_KINDS: dict[str, type] = {"int": np.int64, "bool": np.bool_, "float": np.float64, "text": np.str_}
_READERS: dict[str, Callable[[str], Any]] = {"int": int, "bool": int, "float": lambda text: float(text or math.nan)}


class OwnColumns(Mapping[str, NDArray[np.generic]]):
    """Columns of a user's table that are not used, by their headings: they travel to the output as the file has them.

    Parameters
    ----------
    cells : mapping of str to callable
        Returns the cells of a column, one a row of the file, masked where missing; called when they are asked for.
    rows : array_like
        Row of the file of each star, from 0.
    """

    def __init__(
        self,
        cells: Mapping[str, Callable[[], "np.ma.MaskedArray[Any, Any]"]] = MappingProxyType({}),
        rows: ArrayLike = (),
    ) -> None:
        self._cells, self._rows = cells, np.asarray(rows, np.int64)

    def __getitem__(self, heading: str) -> NDArray[np.generic]:
        """Return a column: numbers, truth values and texts, None where missing."""
        cells = self._cells[heading]()[self._rows]
        found = np.ma.getdata(cells).astype(object)
        found[np.ma.getmaskarray(cells)] = None
        found.flags.writeable = False
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._cells)

    def __len__(self) -> int:
        return len(self._cells)

    def __reduce__(self) -> tuple[object, ...]:
        """Travel without the columns: what works in other processes does not need them."""
        return (OwnColumns, ())

    def select(self, rows: ArrayLike) -> "OwnColumns":
        """Return the same columns of some of the stars."""
        return OwnColumns(self._cells, self._rows[np.asarray(rows)]) if self._cells else self


class StarTable(FrozenTable):
    """An immutable table of stars.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Read-only arrays of equal length: float64, int64 (``hip``, 0 if none), bool or text.
    units : mapping of str to str
        Unit of each column, ``""`` for pure numbers and text.
    descriptions : mapping of str to str
        One line on each column.
    label : str
        What messages call the table; ``""`` for the embedded catalogue and selections of it.
    own : OwnColumns
        Columns of a user's file that are not used; none of other tables.
    """

    units: Mapping[str, str]
    descriptions: Mapping[str, str]
    label: str = ""
    own: OwnColumns = field(default_factory=OwnColumns)

    def column(self, name: str) -> NDArray[np.generic]:
        """Return one column (read-only).

        Raises
        ------
        InputError
            If there is no such column.
        """
        if name not in self.columns:
            raise InputError("column", name, allowed=", ".join(self.columns))
        return self.columns[name]

    def select(self, mask: ArrayLike) -> Self:
        """Return the table of the chosen rows.

        Parameters
        ----------
        mask : array_like
            Boolean mask of the table's length, or integer row numbers in the wanted order.

        Raises
        ------
        InputError
            If a mask has another length, or a row number is out of range.
        """
        chosen = np.asarray(mask)
        if chosen.size == 0 and chosen.dtype != np.bool_:
            chosen = chosen.astype(np.int64)
        if chosen.dtype == np.bool_:
            if chosen.shape != (len(self),):
                raise InputError("mask", f"shape {chosen.shape}", allowed=f"({len(self)},)")
        elif not np.issubdtype(chosen.dtype, np.integer):
            raise InputError("mask", str(chosen.dtype), allowed="booleans or integer row numbers")
        elif chosen.size and (chosen.min() < -len(self) or chosen.max() >= len(self)):
            raise InputError("mask", int(np.abs(chosen).max()), allowed=f"row numbers below {len(self)}")
        parts = {name: once(values[chosen]) for name, values in self.columns.items()}
        return replace(self.with_columns(parts), own=self.own.select(chosen))

    def row(self, index: int) -> dict[str, str | int | float | bool]:
        """Return one star as a dictionary of plain Python values.

        Raises
        ------
        InputError
            If the index is out of range.
        """
        if not -len(self) <= index < len(self):
            raise InputError("row", index, allowed=f"0 to {len(self) - 1}")
        return {name: values[index].item() for name, values in self.columns.items()}

    def with_columns(self, columns: Mapping[str, NDArray[np.generic]]) -> Self:
        """Return the table with other columns, or more, which become read-only."""
        return replace(self, columns={**self.columns, **columns})

    @functools.cached_property
    def name_keys(self) -> Mapping[str, tuple[int, ...]]:
        """Rows by the canonical key of every name in the table's own columns; rows of that ``name`` come first."""
        found: dict[str, list[int]] = {}

        def add(text: str, row: int) -> None:
            rows = found.setdefault(designation_key(text), [])
            if row not in rows:
                rows.append(row)

        letters = self.column("component").tolist()
        for name in ("name", "simbad_id", "hd", "gj", "bayer", "flamsteed", "common_name"):
            for row, text in enumerate(self.column(name).tolist()):
                if text:
                    add(text, row)
                    if name in ("bayer", "flamsteed") and letters[row]:
                        add(f"{text} {letters[row]}", row)
        for row, number in enumerate(self.column("hip").tolist()):
            if number:
                add(f"HIP {number}", row)
        return MappingProxyType({key: tuple(rows) for key, rows in found.items() if key})


def once(column: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return a column that takes the room of one cell where all cells are the same."""
    equal = (column == column[:1]) | ((column != column) & (column[:1] != column[:1]))
    return np.broadcast_to(column[:1].copy(), column.shape) if len(column) > 1 and equal.all() else column


def star_table(
    values: Mapping[str, Sequence[object] | NDArray[np.generic]], label: str, own: OwnColumns | None = None
) -> StarTable:
    """Return a table with the columns and units of the embedded one.

    Parameters
    ----------
    values : mapping of str to sequence
        One sequence per column of :data:`catalogs.stars.COLUMNS`, of equal length.
    label : str
        What messages call the table.
    own : OwnColumns, optional
        What else the file has.

    Raises
    ------
    InputError
        If a column is missing or unknown, or the lengths differ.
    """
    names = [column.name for column in COLUMNS]
    if set(values) != set(names):
        wrong = sorted(set(values) ^ set(names))
        raise InputError(f"{label} columns", ", ".join(wrong), allowed="those of the embedded catalogue")
    lengths = {len(cells) for cells in values.values()}
    if len(lengths) > 1:
        raise InputError(f"{label} columns", f"lengths {sorted(lengths)}", allowed="one length")
    columns = {column.name: once(np.asarray(values[column.name], _KINDS[column.kind])) for column in COLUMNS}
    units = {column.name: column.unit for column in COLUMNS}
    descriptions = {column.name: column.description for column in COLUMNS}
    descriptions |= shipped_words("star_columns_of_any_table")
    return StarTable(columns, units, descriptions, label, own or OwnColumns())


def load_stars(*, updates: bool = True) -> StarTable:
    """Return the embedded catalogue, brightest star first. It is read once per process.

    Parameters
    ----------
    updates : bool
        Lay published temperatures over the base table (:func:`with_updates`); without them temperatures are those of
        ExoCat-1 and of colours.

    Returns
    -------
    StarTable
        All rows with V <= 7.5; ``table.select(table.column("v_mag") <= 7.0)`` is the ranked part.
    """
    return _stars(updates)


@functools.cache
def _stars(updates: bool) -> StarTable:
    descriptions = {column.name: column.description for column in COLUMNS}
    if updates:
        return StarTable(parsed("stars")[0], {column.name: column.unit for column in COLUMNS}, descriptions)
    header, *rows = shipped_lines("stars.csv")
    texts = dict(zip(header, zip(*rows, strict=True), strict=True))
    cells = {column.name: list(map(_READERS.get(column.kind, str), texts[column.name])) for column in COLUMNS}
    return replace(star_table(cells, ""), descriptions=descriptions)


def with_updates(table: StarTable) -> StarTable:
    """Return the table with the published parameters of its stars."""
    return table.with_columns(updated_columns(table.columns))
