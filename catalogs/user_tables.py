"""Tables of a user's own: how strictly they are read, and what was left out of them.

A star table is any table with a name or number, a distance, a brightness and a type or temperature.

Commands and functions open tables in many places. What a user asks of all of them, and the list of what was left out
of any, is kept here while one question is answered.

Required per star: ``name``, or a number of Hipparcos, Henry Draper, Gliese, TIC or Gaia, or a planet's name;
``distance_pc`` or ``parallax_mas``; ``v_mag``, or Gaia's ``gaia_g_mag`` and ``bp_rp_mag``; ``sp_type`` or ``teff_k``.
Everything else may be missing and is then filled as in the shipped table, with ``*_src`` columns that say how. What
other headings and units are understood stands in one table (:mod:`catalogs.table_cells`).
"""

import contextlib
import functools
import itertools
import logging
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from catalogs import stellar_physics
from catalogs.coordinates import ecliptic
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key, host_of_planet, split_component, star_name_of
from catalogs.spectra import load_stellar_grid
from catalogs.stars import (
    CLOSE_COMPANION_ARCSEC,
    QUANTITIES,
    OwnColumns,
    StarTable,
    load_stars,
    once,
    parallax_flags,
    star_table,
    type_flags,
)
from catalogs.stellar_physics import PARAMETERS_SOURCE, stellar_parameters
from catalogs.table_cells import Row, Rows, Use, join_sexagesimal, read_positions, read_rows
from catalogs.table_files import LeftOut, RawTable
from cpic_core import InputError, Record, listed

_LOG = logging.getLogger(__name__)


def _log(remark: str) -> None:
    _LOG.warning("%s", remark)


@dataclass
class OwnTables:
    """The tables of a user's own that were read for one question.

    Parameters
    ----------
    strict : bool
        Whether a table is refused for the first row or cell that cannot be used.
    tell : callable
        Gets remarks on the reading.
    tables : dict
        What was left out of each table, by its name and what its columns were taken for, in the order of reading.
    told : set of str
        Remarks that were told.
    """

    strict: bool = False
    tell: Callable[[str], None] = _log
    tables: dict[tuple[str, tuple[Use, ...]], list[LeftOut]] = field(default_factory=dict)
    told: set[str] = field(default_factory=set)

    @property
    def left_out(self) -> list[tuple[str, LeftOut]]:
        """Rows and cells that were not used, after the name of their table; by row."""
        tables = ((name, sorted(items, key=lambda item: item.row)) for (name, _), items in self.tables.items())
        return [(name, item) for name, items in tables for item in items]


_READ: ContextVar[OwnTables | None] = ContextVar("tables_read", default=None)


@contextlib.contextmanager
def tables_read(
    *, strict: bool = False, tell: Callable[[str], None] | None = None, apart: bool = False
) -> Iterator[OwnTables]:
    """Read tables of a user's own as one question asks, and yield those that were read.

    Parameters
    ----------
    strict : bool
        As of `OwnTables`.
    tell : callable, optional
        Gets remarks on the reading, each once; by default they are logged.
    apart : bool
        Whether it is no part of a question around it; else it is as strict as that, and tells what that tells.
    """
    outer = _READ.get()
    made = OwnTables(strict, tell or _log)
    if outer is not None and not apart:
        made = OwnTables(strict or outer.strict, tell or outer.tell, outer.tables, outer.told)
    token = _READ.set(made)
    try:
        yield made
    finally:
        _READ.reset(token)


def is_strict(strict: bool) -> bool:
    """Return whether a table is to be refused for what cannot be used: where the caller or the question says so."""
    asked = _READ.get()
    return strict or (asked is not None and asked.strict)


def keep(rows: Rows) -> Rows:
    """Put a table that is being read beside the others of the question; what is left out of it may grow."""
    asked = _READ.get()
    if asked is not None:
        asked.tables[rows.label, rows.uses] = rows.left_out
    return rows


def tell(*remarks: str) -> None:
    """Tell remarks on the reading of a table, each once for a question."""
    asked = _READ.get() or OwnTables()
    for remark in remarks:
        if remark not in asked.told:
            asked.told.add(remark)
            asked.tell(remark)


_NAMES = ("name", "hip", "hd", "gj", "hr", "tic", "gaia", "planet")
REQUIRED = (_NAMES, ("v_mag", "opt_mag", "gaia_g_mag"), ("distance_pc", "parallax_mas"), ("sp_type", "teff_k"))
"""Names of columns; of each group a table of stars, and each of its rows, needs one."""
_SPLIT = tuple(f"ra_split_{part}" for part in "hms") + tuple(f"dec_split_{part}" for part in ("sign", *"dms"))
_MOTION = ("pm_ra_mas_yr", "pm_dec_mas_yr")
_PAIRS = (("ra_deg", "dec_deg"), _MOTION)
_INSTEAD = {"ra_deg": (_SPLIT[0], "coordinates"), "dec_deg": (_SPLIT[4], "coordinates")}
"""Columns that say where a star is instead of those that are named."""
ASSUMED_PC = 10.0
"""Distance of a star of which none is given, pc."""
_NAN = float("nan")
_TOGETHER = 2000  # rows that are turned into columns at once
_DISTANCE_TOLERANCE = 0.05
#: dex; as much as 3.75 mag in V. A parallax in arcsec that is read as mas is off by six.
_GRAVITY_TOLERANCE = 1.5


class UserTable(Record):
    """A filled table, remarks for its owner, what each column was taken for, and what was left out."""

    table: StarTable
    notes: tuple[str, ...]
    uses: tuple[Use, ...] = ()
    left_out: tuple[LeftOut, ...] = ()


def user_table(raw: RawTable, *, strict: bool = False) -> UserTable:
    """Turn the columns of a file into a star table.

    Parameters
    ----------
    raw : RawTable
        What :func:`catalogs.table_files.parse_table` read.
    strict : bool
        Refuse the table for the first row or cell that cannot be used, instead of leaving it out with a remark.

    Raises
    ------
    InputError
        Naming file, row, column, value, unit and range, if a column is missing or ambiguous, no row can be used or, in
        a strict table, a unit is not understood, a cell is not what its column holds, or a name occurs twice.
    """
    given = keep(read_rows(raw, QUANTITIES, REQUIRED, about="name", strict=is_strict(strict)))
    _refuse_half(raw.name, given.headings)

    def named(where: str, row: Row) -> Row:
        _write_out(row)
        given.refuse_missing(where, row, (("name",), *REQUIRED[1:]))
        return row

    _place(given.rows)
    given.make(named)
    counts = Counter(designation_key(row["name"]) for row in given.rows)
    for row in given.rows:
        if counts[designation_key(row["name"])] > 1 and "component" in row:
            row["name"] += f" {row['component']}"
    given.refuse_twins(lambda row: designation_key(row["name"]))
    _place_on_the_ecliptic(given.rows)
    made: list[Row] = []
    parts: list[StarTable] = []

    def filled(where: str, row: Row) -> Row:
        made.append(_filled(row, where, raw.name))
        if len(made) == _TOGETHER:
            parts.append(_table(made, raw.name))
            made.clear()
        return row

    given.make(filled)
    parts += [_table(made, raw.name)] if made else []
    columns = {name: once(np.concatenate([part.columns[name] for part in parts])) for name in parts[0].columns}
    table = star_table(columns, raw.name, _own(raw, given))
    notes = given.remarks() + _companions_left_out(table)
    return UserTable(table, notes, given.uses, tuple(given.left_out))


def _own(raw: RawTable, given: Rows) -> OwnColumns:
    """Return the columns of a file that are not used, of the rows that are; a heading that is there twice gets a 2."""
    cells: dict[str, Callable[[], Any]] = {}
    for column, use in zip(raw.columns, given.uses, strict=True):
        if not use.quantity and column.heading:
            heading = next(
                name for n in itertools.count(1) if (name := column.heading + f" {n}" * (n > 1)) not in cells
            )
            cells[heading] = functools.partial(getattr, column, "cells")
    return OwnColumns(cells, np.searchsorted(raw.numbers, given.numbers))


def _refuse_half(label: str, headings: dict[str, str]) -> None:
    """Refuse a table with half of a pair of coordinates: the other half was not understood."""
    for one, two in (*_PAIRS, *(pair[::-1] for pair in _PAIRS)):
        found, other = (headings.keys() & {name, *_INSTEAD.get(name, ())} for name in (one, two))
        if found and not other:
            key, hint = f"{label} column {headings[min(found)]}", f"name the other one {two}"
            raise InputError(key, f"without {two}", allowed="both or neither", hint=hint)


def _place(rows: list[Row]) -> None:
    """Give rows, in place, the coordinates that they split over several columns, or have in one cell."""
    for kind in ("coordinates", _SPLIT[0]):
        lacking = [row for row in rows if kind in row and not {"ra_deg", "dec_deg"} <= set(row)]
        if not lacking:
            continue
        if kind == "coordinates":
            pair = read_positions([row["coordinates"] for row in lacking])
        else:
            parts = [np.array([row.get(key) for row in lacking], object) for key in _SPLIT]
            hours, minutes, seconds, sign, degrees, arcmin, arcsec = parts
            right = join_sexagesimal(hours, minutes, seconds, clock=True)
            pair = right, join_sexagesimal(degrees, arcmin, arcsec, sign if any(sign) else None)
        for row, ra, dec in zip(lacking, *(item.tolist() for item in pair), strict=True):
            if math.isfinite(ra + dec):
                row |= {"ra_deg": ra, "dec_deg": dec}


def _place_on_the_ecliptic(rows: list[Row]) -> None:
    """Give rows, in place, their ecliptic coordinates, all at once."""
    placed = [row for row in rows if {"ra_deg", "dec_deg"} <= set(row)]
    lon, lat = ecliptic([row["ra_deg"] for row in placed], [row["dec_deg"] for row in placed])
    for row, *place in zip(placed, lon.tolist(), lat.tolist(), strict=True):
        row["lon_lat_deg"] = tuple(place)


def _write_out(row: Row) -> None:
    """Give a row, in place, the name and the magnitude that other columns of it imply."""
    host = host_of_planet(row["planet"]) if "planet" in row and "name" not in row else None
    if "name" not in row and (name := host[0] if host else star_name_of(row)):
        row["name"] = name
    if name := row.pop("name", "").replace("_", " ").strip():
        row["name"] = name
    if "hip" in row:
        row["hip"] = int(re.sub(r"\D", "", str(row["hip"])))
    b_v = row.get("b_mag", _NAN) - row.get("v_mag", _NAN)
    if QUANTITIES["b_v_mag"].low <= b_v <= QUANTITIES["b_v_mag"].high:  # B may be a galactic latitude
        row.setdefault("b_v_mag", b_v)
    optical, band = row.pop("opt_mag", None), row.pop("opt_band", "")
    if "v_mag" not in row and optical is not None and band.upper().startswith("V"):
        row["v_mag"] = optical
    green, blue, red = (row.pop(key, _NAN) for key in ("gaia_g_mag", "bp_mag", "rp_mag"))
    colour = row.pop("bp_rp_mag", blue - red)
    if "v_mag" not in row and math.isfinite(green + colour):
        row["v_mag"] = stellar_physics.v_of_gaia(green, colour)
        row["v_mag_src"] = stellar_physics.GAIA_V_SOURCE


def named_star(
    name: str, v_mag: float, *, sp_type: str | None, teff_k: float | None, distance_pc: float | None
) -> StarTable:
    """Return the table of one star that is in none: what is missing is filled as in a table of one's own.

    Parameters
    ----------
    name : str
    v_mag : float
        Johnson V, -30 to 30 mag.
    sp_type : str or None
    teff_k : float or None
        Effective temperature, 2000 to 50 000 K; one of the two is needed.
    distance_pc : float or None
        0.01 to 100 000 pc; without it `ASSUMED_PC` is taken, and flagged ``distance_assumed``.

    Raises
    ------
    InputError
        For a spectral type that gives no temperature, where there is none.
    """
    given: Row = {"name": name, "v_mag": v_mag, "sp_type": sp_type, "teff_k": teff_k}
    given["distance_pc"] = ASSUMED_PC if distance_pc is None else distance_pc
    row = _filled({key: value for key, value in given.items() if value is not None}, "", "the question")
    if distance_pc is None:
        row["distance_pc_src"] = f"assumed:{ASSUMED_PC:g}"
        row["quality_flags"].add("distance_assumed")
    return _table([row], name)


def _table(rows: list[Row], label: str) -> StarTable:
    """Return the table of filled rows, with a flag where the stellar grid ends."""
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    clamped = load_stellar_grid().flags(*(columns[name] for name in ("teff_k", "log_g", "metallicity"))).any
    for flags, beyond in zip(columns["quality_flags"], clamped.tolist(), strict=True):
        flags.update({"stellar_grid_clamped"} if beyond else ())
    columns["quality_flags"] = [";".join(sorted(flags)) for flags in columns["quality_flags"]]
    return star_table(columns, label)


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
    shown = listed(stars)
    return (f"{table.label}: light of companions that the snapshot knows is left out, no companion column: {shown}",)


def _filled(given: Row, where: str, source: str) -> Row:
    """Return all columns of one star.

    Parameters
    ----------
    given : dict
        Checked values by quantity (:data:`catalogs.stars.QUANTITIES`), missing ones left out.
    where : str
        File, row and star, for messages.
    source : str
        File name, for the ``*_src`` columns.

    Raises
    ------
    InputError
        If there is no temperature and the spectral type gives none.
    """
    listed = f"measured:as listed in {source}"
    texts = ("simbad_id", "hd", "gj", "bayer", "flamsteed", "common_name")
    row: Row = {"name": given["name"], "hip": given.get("hip", 0)} | {name: given.get(name, "") for name in texts}
    key = designation_key(given["name"])
    if not row["hip"] and (found := re.fullmatch(r"hip (\d+)", key)):
        row["hip"] = int(found[1])
    for name in ("hd", "gj"):
        row[name] = f"{name.upper()} {row[name]}" if row[name][:1].isdigit() else row[name]
    component = split_component(key)[1].upper()
    row |= {"component": component, "component_src": listed if component else "missing"}
    flags = _astrometry_and_light(row, given, listed) | _physics(row, given, listed, where)
    flags |= _companion(row, given, listed)
    flags |= type_flags(row["sp_type"], "", "") if row["sp_type"] else {"no_class"}
    return row | {"quality_flags": flags}


def _astrometry_and_light(row: Row, given: Row, listed: str) -> set[str]:
    flags: set[str] = set()
    distance, own, error = (given.get(name, _NAN) for name in ("distance_pc", "parallax_mas", "parallax_err_mas"))
    parallax, sources = own, ("derived:parallax", listed)
    if math.isfinite(distance):
        parallax, sources = 1000.0 / distance, (listed, "derived:distance")
        if abs(own / parallax - 1.0) > _DISTANCE_TOLERANCE:
            flags.add("distance_conflict")
        own = given.get("parallax_mas", parallax)
    row |= {"distance_pc": given.get("distance_pc", 1000.0 / parallax), "parallax_mas": parallax}
    row |= dict(zip(("distance_pc_src", "parallax_src"), sources, strict=True))
    row |= {"parallax_own_mas": own, "parallax_err_mas": error, "parallax_err_src": _listed(error, listed)}
    flags |= parallax_flags(own, error) if math.isfinite(error) else set()
    ra, dec, *motion, rv = (given.get(name, _NAN) for name in ("ra_deg", "dec_deg", *_MOTION, "rv_km_s"))
    if not math.isfinite(ra + dec):
        flags.add("position_unknown")
        ra = dec = _NAN
    row |= stellar_physics.place_columns(ra, dec, (motion[0], motion[1]), rv, listed, given.get("lon_lat_deg"))
    row["epoch_yr"] = given.get("epoch_yr", 2000.0)
    row |= stellar_physics.light_columns(given["v_mag"], given.get("b_v_mag", _NAN), given.get("sp_type", ""), listed)
    row["v_mag_src"] = given.get("v_mag_src", listed)
    return flags


def _listed(value: float, listed: str) -> str:
    """Return the origin of a number that is as it is listed, or missing."""
    return listed if math.isfinite(value) else "missing"


def _physics(row: Row, given: Row, listed: str, where: str) -> set[str]:
    flags: set[str] = set()
    sp_type = row["sp_type"]
    if "teff_k" in given:
        row["teff_k"], row["teff_k_src"] = given["teff_k"], listed
    else:
        try:
            row["teff_k"], row["teff_k_src"] = stellar_parameters(sp_type).teff_k, PARAMETERS_SOURCE
        except InputError as error:
            hint = "or give a temperature in a column teff_k"
            allowed = "; ".join(filter(None, (error.allowed, error.hint)))
            raise InputError(f"{where} column sp_type", sp_type, allowed=allowed, hint=hint) from None
    row["metallicity"] = given.get("metallicity", 0.0)
    row["metallicity_src"] = listed if "metallicity" in given else "assumed:0"
    known = {name: (value, listed) for name, value in given.items() if name in ("luminosity_lsun", "log_g")}
    if "luminosity_lsun" not in known and row["teff_k"] < stellar_physics.COOLEST_BC_K:
        flags.add("luminosity_extrapolated")
    row |= stellar_physics.bulk_columns(row, known)
    implied = stellar_physics.gravity(row["mass_msun"], row["radius_rsun"])
    typical = _typical_gravity(row["luminosity_class"], sp_type)
    if "log_g" not in given and typical is not None:
        row["log_g"], row["log_g_src"] = typical, PARAMETERS_SOURCE
    if abs(implied - row["log_g"]) > _GRAVITY_TOLERANCE:
        flags.add("luminosity_conflict")
    return flags


def _typical_gravity(luminosity_class: str, sp_type: str) -> float | None:
    """Return log g of a spectral type, None if it has no class or is beyond the tables (M8V with a temperature)."""
    if not luminosity_class:
        return None
    try:
        return stellar_parameters(sp_type).log_g
    except InputError:
        return None


def _companion(row: Row, given: Row, listed: str) -> set[str]:
    separation = given.get("companion_sep_arcsec", _NAN)
    apart = math.isfinite(separation)
    angle = given.get("companion_pa_deg", _NAN) % 360.0 if apart else _NAN
    delta = given.get("companion_delta_v_mag", given.get("companion_v_mag", _NAN) - given["v_mag"]) if apart else _NAN
    close = given.get("close_companion", apart and separation < CLOSE_COMPANION_ARCSEC)
    row |= {
        "close_companion": bool(close),
        "companion_name": given.get("companion_name", "companion" if apart else ""),
        "companion_sep_arcsec": separation,
        "companion_pa_deg": angle,
        "companion_epoch_yr": given.get("companion_epoch_yr", _NAN),
        "companion_delta_v_mag": delta,
        "companion_src": _listed(separation, listed),
        "companion_pa_src": _listed(angle, listed),
        "companion_delta_v_src": _listed(delta, listed),
    }
    return set() if apart or "close_companion" in given else {"companions_not_listed"}
