"""SIMBAD's answers as checked columns, under names old and new; what cannot be right is refused.

Names of a refreshed table's rows: which star of the snapshot each one is, what it is called, which are blends.

A row that the snapshot knows keeps the snapshot's name, so that a star is called the same in every plan. Others are
named by the snapshot's rule: Bayer, Flamsteed, HD, HIP, else SIMBAD's identifier.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from catalogs.coordinates import neighbours
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import GREEK, designation_key, split_component
from catalogs.star_systems import is_blend_id
from catalogs.stars import StarTable
from catalogs.table_cells import Column, Columns, Rows, read_rows
from catalogs.table_files import RawColumn, RawTable, column_of
from catalogs.tap_client import RefreshError
from cpic_core import FloatArray, InputError, NDArray

_ANY = (-np.inf, np.inf)
# Headings are those of TAP, of ``add_votable_fields``, and of astroquery before 0.4.8.
STARS = Columns(
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
MEASUREMENTS = Columns(
    Column("oid", "number of the object", "float", "", "oidref", 0.0, 1e15),
    Column("teff_k", "temperature", "float", "K", "teff mesfehteff fehteff", *_ANY),
    Column("log_g", "gravity", "float", "", "mesfehlogg fehlogg", *_ANY),
    Column("fe_h", "metallicity", "float", "", "mesfehfeh fehfeh", *_ANY),
    Column("bibcode", "reference", aliases="mesfehbibcode fehbibcode"),
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


def read_stars(table: RawTable) -> Answer:
    """Check the answer to the first question.

    Parameters
    ----------
    table : RawTable
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
            rows.refuse_twins(itemgetter(name), remedy=f"same {name}")

    columns = _columns(table, STARS, check)
    names = [tuple(filter(None, (" ".join(name.split()) for name in text.split("|")))) for text in columns.pop("ids")]
    return Answer(**columns, ids=names)


def read_measurements(table: RawTable) -> Measurements:
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


def _columns(table: RawTable, columns: Columns, check: Callable[[Rows], None]) -> dict[str, Any]:
    """Return the columns of an answer by our names; numbers as arrays, nan where missing."""
    try:
        raw = RawTable(table.name, [_raw(column, columns) for column in table.columns])
        rows = read_rows(raw, columns, [(name,) for name in columns], about="main_id" if columns is STARS else "oid")
        check(rows)
    except InputError as error:
        raise RefreshError(str(error), _REMEDY) from None
    blank = {"text": "", "float": np.nan}
    listed = {name: [row.get(name, blank[column.kind]) for row in rows.rows] for name, column in columns.items()}
    numbers = {name: np.array(cells, np.float64) for name, cells in listed.items() if columns[name].kind == "float"}
    return listed | numbers | {"oid": numbers["oid"].astype(np.int64)}


def _raw(given: RawColumn, columns: Columns) -> RawColumn:
    """Return one column of the answer with its cells as people write them; a pure number has no unit."""
    meant = columns.meant_by(given.heading).column
    cells = [None if cell == "~" else cell for cell in given.cells.tolist()]
    if meant is not None and meant.name in ("ra_deg", "dec_deg") and any(map(_is_sexagesimal, cells)):
        from astropy.coordinates import Angle

        unit = "hourangle" if meant.name == "ra_deg" else "deg"  # what SIMBAD gave before TAP
        try:
            return column_of(given.heading, "deg", [Angle(str(cell), unit=unit).deg for cell in cells])
        except ValueError as error:
            where = f"the answer column {given.heading}"
            raise InputError(where, "unreadable", allowed="angles", hint=str(error)) from None
    return column_of(given.heading, given.unit if meant is not None and meant.unit else "", cells)


def _is_sexagesimal(cell: object) -> bool:
    return isinstance(cell, str) and len(cell.split()) > 1


_NAMED_PART_ARCSEC = 300.0
_UNNAMED_PART_ARCSEC = 30.0
_TELLING = re.compile(r"(?:\*|V\*|NAME|HIP|HD|HR|GJ|Gl|LHS|LTT|NLTT|BD|CD|CPD|SAO|Wo|NN)[ +-]")
_DOUBLE_STAR_ID = re.compile(r"(WDS|CCDM) (J\S+?)([A-Z]{1,3})?(?:[a-z,].*)?")
_GREEK_BAYER = re.compile(rf"(?:{'|'.join(GREEK)})\d* ")


@dataclass(frozen=True)
class Names:
    """Designations of one row; ``""`` and 0 where it has none."""

    simbad_id: str
    hip: int
    hd: str
    gj: str
    bayer: str
    flamsteed: str
    common_name: str
    component: str


def own_names(main_id: str, ids: Iterable[str]) -> Names:
    """Return the designations among the identifiers of one object.

    Parameters
    ----------
    main_id : str
        SIMBAD's main identifier.
    ids : iterable of str
        All its identifiers.
    """
    found: dict[str, str] = {}
    hip = 0
    for text in (main_id, *ids):
        if text.startswith("* "):
            base, letter = _without_letter(text[2:])
            found.setdefault("flamsteed" if base[:1].isdigit() else "bayer", base)
            if letter:
                found.setdefault("component", letter)
        elif text.startswith("NAME "):
            found.setdefault("common_name", text[5:])
        elif text.startswith(("HD ", "GJ ")):
            found.setdefault(text[:2].lower(), _spaced(text))
        elif number := re.fullmatch(r"HIP (\d+)[A-D]?", text):
            hip = hip or int(number[1])
    letters = (found.get("component", ""), *(_without_letter(found.get(kind, ""))[1] for kind in ("gj", "hd")))
    letter = next(filter(None, letters), "")
    texts = {name: found.get(name, "") for name in ("hd", "gj", "bayer", "flamsteed", "common_name")}
    return Names(simbad_id=main_id, hip=hip, component=letter, **texts)


def _without_letter(text: str) -> tuple[str, str]:
    found = re.fullmatch(r"(.*\S) ?([A-E])", text)
    return (found[1], found[2]) if found and (" " in found[1]) else (text, "")


def _spaced(text: str) -> str:
    """Write ``GJ 559B`` as ``GJ 559 B``."""
    return re.sub(r"(\d)([A-E])$", r"\1 \2", text)


def row_name(names: Names, taken: set[str]) -> str:
    """Return the name to show: the first of the usual kinds that is not taken, and take it.

    Parameters
    ----------
    names : Names
        Designations of the row.
    taken : set of str
        Keys of names that other rows have; that of the name is added.
    """
    letter = f" {names.component}" if names.component else ""
    greek = names.bayer if _GREEK_BAYER.match(names.bayer) else ""
    hip = f"HIP {names.hip}" if names.hip else ""
    bases = [greek, names.flamsteed, names.bayer, names.hd, hip]
    plain = re.sub(r"^(?:V\*|NAME|\*\*|\*)\s+", "", names.simbad_id)
    options = [f"{base}{letter}" if base in (greek, names.flamsteed, names.bayer) else base for base in bases if base]
    for option in (*options, plain, names.simbad_id):
        if designation_key(option) not in taken:
            taken.add(designation_key(option))
            return option
    raise AssertionError("unreachable: SIMBAD's main identifiers are unique")


def match_snapshot(answer: Answer, snapshot: StarTable) -> list[int]:
    """Return the snapshot row of each object, -1 where it has none; no two objects share a row.

    The row with most names in common wins; of two objects that claim one row, the one with more, then the one
    nearer in V.

    Parameters
    ----------
    answer : Answer
        SIMBAD's stars.
    snapshot : StarTable
        The embedded table.
    """
    aliases = snapshot_aliases()
    rows = {name: row for row, name in enumerate(snapshot.column("name").tolist())}
    magnitudes = np.asarray(snapshot.column("v_mag"), float)
    claims = []
    for i in range(len(answer)):
        keys = {designation_key(text) for text in (answer.main_id[i], *filter(_TELLING.match, answer.ids[i]))}
        votes = Counter(aliases[key][0] for key in keys if aliases.get(key, ("", 1))[1] == 0)
        for name, count in votes.items():
            claims.append((-count, abs(float(magnitudes[rows[name]] - answer.v_mag[i])), i, rows[name]))
    matched = [-1] * len(answer)
    used: set[int] = set()
    for _, _, i, row in sorted(claims):
        if matched[i] < 0 and row not in used:
            matched[i] = row
            used.add(row)
    return matched


def blends(answer: Answer) -> tuple[dict[int, str], set[int]]:
    """Find the objects that are the blended light of several stars.

    Returns
    -------
    listed : dict of int to str
        Blends whose components are objects of their own in the answer, with the names of these.
    alone : set of int
        Blends of which no component is listed: kept, and flagged ``composite``.
    """
    letters = [_double_star_letters(answer.main_id[i], answer.ids[i]) for i in range(len(answer))]
    bases: dict[str, list[int]] = {}
    for i in range(len(answer)):
        base, letter = split_component(designation_key(answer.main_id[i]))
        if letter:
            bases.setdefault(base, []).append(i)
    listed: dict[int, str] = {}
    alone: set[int] = set()
    for i, near in enumerate(neighbours(answer.ra_deg, answer.dec_deg, _NAMED_PART_ARCSEC)):
        parts = {j for j in bases.get(designation_key(answer.main_id[i]), ()) if j in near}
        for system, held in letters[i].items():
            if len(held) > 1:
                parts |= {j for j in near if len(letters[j].get(system, "")) == 1 and letters[j][system] in held}
        named = is_blend_id(answer.main_id[i])
        if named:
            parts |= {j for j, sep in near.items() if sep < _UNNAMED_PART_ARCSEC and not is_blend_id(answer.main_id[j])}
        fainter = sorted(j for j in parts if answer.v_mag[j] >= answer.v_mag[i])
        if fainter:
            listed[i] = ", ".join(answer.main_id[j] for j in fainter)
        elif named or any(len(held) > 1 for held in letters[i].values()):
            alone.add(i)
    return listed, alone


def _double_star_letters(main_id: str, ids: Sequence[str]) -> dict[str, str]:
    """Return double-star designation -> component letters of an object, ``""`` for the system as a whole."""
    found = {}
    for text in (main_id, *ids):
        if match := _DOUBLE_STAR_ID.fullmatch(text):
            found[f"{match[1]} {match[2]}"] = match[3] or ""
    return found
