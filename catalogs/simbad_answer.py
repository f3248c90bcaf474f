"""SIMBAD's answers as checked columns, under names old and new; what cannot be right is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.columns import Column, Columns
from catalogs.errors import InputError
from catalogs.simbad import RefreshError
from catalogs.table_cells import Row, Rows, read_rows
from catalogs.table_files import RawColumn, RawTable, raw_column

FloatArray = NDArray[np.float64]

_ANY = (-np.inf, np.inf)
# Headings are those of TAP, of ``add_votable_fields``, and of astroquery before 0.4.8.
STARS = Columns(
    (
        Column("oid", "number of the object", "float", "", "oidref", 0.0, 1e15),
        Column("main_id", "main identifier"),
        Column("ra_deg", "right ascension", "float", "deg", "ra rad", 0.0, 360.0),
        Column("dec_deg", "declination", "float", "deg", "dec decd", -90.0, 90.0),
        Column("parallax_mas", "parallax", "float", "mas", "plxvalue plx", 1e-3, 1e3),
        Column("parallax_err_mas", "its standard error", "float", "mas", "plxerr plxerror", *_ANY),
        Column("pm_ra_mas_yr", "proper motion, with cos(dec)", "float", "mas / yr", "pmra", *_ANY),
        Column("pm_dec_mas_yr", "proper motion", "float", "mas / yr", "pmdec", *_ANY),
        Column("rv_km_s", "radial velocity", "float", "km / s", "rvzradvel rvvalue radvel", *_ANY),
        Column("sp_type", "spectral type", aliases="sp"),
        Column("object_type", "type of the object", aliases="otype otypes otypev"),
        Column("b_mag", "B magnitude", "float", "mag", "b fluxb", *_ANY),
        Column("v_mag", "V magnitude", "float", "mag", "v fluxv", -30.0, 30.0),
        Column("ids", "all identifiers"),
    )
)
MEASUREMENTS = Columns(
    (
        Column("oid", "number of the object", "float", "", "oidref", 0.0, 1e15),
        Column("teff_k", "temperature", "float", "K", "teff mesfehteff fehteff", *_ANY),
        Column("log_g", "gravity", "float", "", "mesfehlogg fehlogg", *_ANY),
        Column("fe_h", "metallicity", "float", "", "mesfehfeh fehfeh", *_ANY),
        Column("bibcode", "reference", aliases="mesfehbibcode fehbibcode"),
    )
)
_NEEDED = tuple((name,) for name in ("oid", "main_id", "ra_deg", "dec_deg", "parallax_mas", "v_mag"))
_BELIEVED = {"teff_k": (2000.0, 50000.0), "log_g": (-2.0, 7.0), "fe_h": (-5.0, 1.5)}
_REMEDY = "SIMBAD may have changed or the service is not SIMBAD; catalogues already here stay as they are"


@dataclass(frozen=True)
class Answer:
    """The stars as SIMBAD lists them, arrays of one length; nan where a number is missing."""

    oid: NDArray[np.int64]
    main_id: list[str]
    ra_deg: FloatArray
    dec_deg: FloatArray
    parallax_mas: FloatArray
    parallax_err_mas: FloatArray
    pm_ra_mas_yr: FloatArray
    pm_dec_mas_yr: FloatArray
    rv_km_s: FloatArray
    sp_type: list[str]
    object_type: list[str]
    b_mag: FloatArray
    v_mag: FloatArray
    ids: list[tuple[str, ...]]

    def __len__(self) -> int:
        return len(self.main_id)


@dataclass(frozen=True)
class Measurements:
    """Spectroscopic measurements, one row each; `oid` says of which star."""

    oid: NDArray[np.int64]
    teff_k: FloatArray
    log_g: FloatArray
    fe_h: FloatArray
    bibcode: list[str]

    def __len__(self) -> int:
        return len(self.bibcode)


def read_stars(table: Any) -> Answer:
    """Check the answer to the first question.

    Parameters
    ----------
    table : astropy.table.Table
        Columns under any name of :data:`STARS`.

    Raises
    ------
    RefreshError
        If it is empty, lacks a column, lists a star twice, or has a star without position, parallax or V.
    """
    if len(table) == 0:
        raise RefreshError("the answer holds no star", "check --v-mag-max and --parallax-min-mas, or the service")

    def check(rows: Rows) -> None:
        for where, row in rows:
            rows.refuse_missing(where, row, _NEEDED)
        for name in ("oid", "main_id"):
            rows.refuse_twins(_cell_of(name), remedy=f"same {name}")

    columns = _columns(table, STARS, check)
    names = [tuple(filter(None, (" ".join(name.split()) for name in text.split("|")))) for text in columns.pop("ids")]
    return Answer(**columns, ids=names)


def read_measurements(table: Any) -> Measurements:
    """Check the answer to the second question; an empty one is fine.

    Values that cannot be meant (temperature outside 2000 to 50 000 K, gravity outside -2 to 7, metallicity outside
    -5 to 1.5) count as missing: the table holds misprints of the literature.

    Raises
    ------
    RefreshError
        If it lacks a column.
    """

    def check(rows: Rows) -> None:
        for where, row in rows:
            rows.refuse_missing(where, row, (("oid",),))

    columns = _columns(table, MEASUREMENTS, check)
    for name, (low, high) in _BELIEVED.items():
        columns[name] = np.where((columns[name] >= low) & (columns[name] <= high), columns[name], np.nan)
    return Measurements(**columns)


def _cell_of(name: str) -> Callable[[Row], Any]:
    return lambda row: row[name]


def _columns(table: Any, columns: Columns, check: Callable[[Rows], None]) -> dict[str, Any]:
    """Return the columns of an answer by our names; numbers as arrays, nan where missing."""
    try:
        raw = RawTable("the answer", [_raw(table, name, columns) for name in table.colnames])
        rows = read_rows(raw, columns, [(name,) for name in columns], about="main_id" if columns is STARS else "oid")
        check(rows)
    except InputError as error:
        raise RefreshError(str(error), _REMEDY) from None
    found: dict[str, Any] = {}
    for name, column in columns.items():
        if column.kind == "text":
            found[name] = [row.get(name, "") for row in rows.rows]
        else:
            found[name] = np.array([row.get(name, np.nan) for row in rows.rows], dtype=np.float64)
    return found | {"oid": found["oid"].astype(np.int64)}


def _raw(table: Any, name: str, columns: Columns) -> RawColumn:
    """Return one column of the answer with its cells as people write them; a pure number has no unit."""
    column, meant = table[name], columns.meant_by(name)[0]
    raw = raw_column("the answer", name, column)
    cells = [None if cell == "~" else cell for cell in raw.cells]
    if column.dtype == np.float32:  # 7.3 shall be 7.3, not 7.300000190734863
        cells = [None if cell is None else str(np.float32(cell)) for cell in cells]
    if meant is not None and meant.name in ("ra_deg", "dec_deg") and any(map(_is_sexagesimal, cells)):
        from astropy.coordinates import Angle

        unit = "hourangle" if meant.name == "ra_deg" else "deg"  # what SIMBAD gave before TAP
        try:
            return RawColumn(name, "deg", [Angle(str(cell), unit=unit).deg for cell in cells])
        except ValueError as error:
            raise InputError(f"the answer column {name}", "unreadable", allowed="angles", hint=str(error)) from None
    return RawColumn(name, raw.unit if meant is not None and meant.unit else "", cells)


def _is_sexagesimal(cell: object) -> bool:
    return isinstance(cell, str) and len(cell.split()) > 1
