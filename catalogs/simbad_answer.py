"""SIMBAD's answers as checked rows, and the names of their objects; what cannot be right is refused.

Names of a refreshed table's rows: which star of the snapshot each one is, what it is called, which are blends.

A row that the snapshot knows keeps the snapshot's name, so that a star is called the same in every plan. Others are
named by the snapshot's rule: Bayer, Flamsteed, HD, HIP, else SIMBAD's identifier.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence

from catalogs.archive_answers import asked_columns, read_answer
from catalogs.coordinates import neighbours
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import GREEK, designation_key, split_component
from catalogs.star_systems import is_blend_id
from catalogs.stars import StarTable
from catalogs.table_cells import Row
from catalogs.table_files import RawTable
from catalogs.tap_client import RefreshError

_BELIEVED = {"teff_k": (2000.0, 50000.0), "log_g": (-2.0, 7.0), "metallicity": (-5.0, 1.5)}
_NAMED_PART_ARCSEC = 300.0
_UNNAMED_PART_ARCSEC = 30.0
_TELLING = re.compile(r"(?:\*|V\*|NAME|HIP|HD|HR|GJ|Gl|LHS|LTT|NLTT|BD|CD|CPD|SAO|Wo|NN)[ +-]")
_DOUBLE_STAR_ID = re.compile(r"(WDS|CCDM) (J\S+?)([A-Z]{1,3})?(?:[a-z,].*)?")
_GREEK_BAYER = re.compile(rf"(?:{'|'.join(GREEK)})\d* ")


def read_stars(table: RawTable) -> list[Row]:
    """Check the answer to the first question and return its stars, each with every column; nan where one is missing.

    Raises
    ------
    RefreshError
        If it is empty, lacks a column, lists a star twice, or has a star without position, parallax or V.
    """
    if len(table) == 0:
        raise RefreshError("the answer holds no star", "check --v-mag-max and --parallax-min-mas, or the service")
    rows, _ = read_answer(table, "simbad_stars", unique=("oid", "main_id"))
    blank = {name: math.nan if row["kind"] == "float" else "" for name, row in asked_columns("simbad_stars").items()}
    names = [[" ".join(name.split()) for name in row.get("ids", "").split("|")] for row in rows]
    return [blank | row | {"ids": tuple(filter(None, ids))} for row, ids in zip(rows, names, strict=True)]


def read_measurements(table: RawTable) -> list[Row]:
    """Check the answer to the second question and return its rows, what is missing left out; an empty one is fine.

    Values that cannot be meant (temperature outside 2000 to 50 000 K, gravity outside -2 to 7, metallicity outside
    -5 to 1.5) count as missing: the table holds misprints of the literature.

    Raises
    ------
    RefreshError
        If it lacks a column.
    """

    def meant(name: str, value: float) -> bool:
        low, high = _BELIEVED[name]
        return low <= value <= high

    rows, _ = read_answer(table, "simbad_measurements")
    return [{name: cell for name, cell in row.items() if name not in _BELIEVED or meant(name, cell)} for row in rows]


def own_names(main_id: str, ids: Iterable[str]) -> Row:
    """Return the designations among the identifiers of one object by columns of a star table; ``""`` and 0 for none.

    Parameters
    ----------
    main_id : str
        SIMBAD's main identifier.
    ids : iterable of str
        All its identifiers.
    """
    kinds = ("hd", "gj", "bayer", "flamsteed", "common_name", "component")
    found: Row = {}
    for text in (main_id, *ids):
        if text.startswith("* "):
            base, letter = _without_letter(text[2:])
            found.setdefault("flamsteed" if base[:1].isdigit() else "bayer", base)
            if letter:
                found.setdefault("component", letter)
        elif text.startswith("NAME "):
            found.setdefault("common_name", text[5:])
        elif text.startswith(("HD ", "GJ ")):  # GJ 559B is GJ 559 B
            found.setdefault(text[:2].lower(), re.sub(r"(\d)([A-E])$", r"\1 \2", text))
        elif number := re.fullmatch(r"HIP (\d+)[A-D]?", text):
            found.setdefault("hip", int(number[1]))
    blank: Row = {"simbad_id": main_id, "hip": 0}
    found = blank | dict.fromkeys(kinds, "") | found
    letters = (found["component"], *(_without_letter(found[kind])[1] for kind in ("gj", "hd")))
    return found | {"component": next(filter(None, letters), "")}


def _without_letter(text: str) -> tuple[str, str]:
    found = re.fullmatch(r"(.*\S) ?([A-E])", text)
    return (found[1], found[2]) if found and (" " in found[1]) else (text, "")


def row_name(names: Row, taken: set[str]) -> str:
    """Return the name to show: the first of the usual kinds that is not taken, and take it.

    Parameters
    ----------
    names : Row
        Designations of the row, as `own_names` returns them.
    taken : set of str
        Keys of names that other rows have; that of the name is added.
    """
    letter = f" {names['component']}" if names["component"] else ""
    bayer, plain = names["bayer"], re.sub(r"^(?:V\*|NAME|\*\*|\*)\s+", "", names["simbad_id"])
    lettered = (bayer if _GREEK_BAYER.match(bayer) else "", names["flamsteed"], bayer)
    options = [f"{base}{letter}" for base in lettered if base]
    options += [names["hd"], f"HIP {names['hip']}" if names["hip"] else "", plain, names["simbad_id"]]
    for option in filter(None, options):
        if designation_key(option) not in taken:
            taken.add(designation_key(option))
            return str(option)
    raise AssertionError("unreachable: SIMBAD's main identifiers are unique")


def match_snapshot(answer: Sequence[Row], snapshot: StarTable) -> list[int]:
    """Return the snapshot row of each object, -1 where it has none; no two objects share a row.

    The row with most names in common wins; of two objects that claim one row, the one with more, then the one
    nearer in V.

    Parameters
    ----------
    answer : sequence of Row
        SIMBAD's stars.
    snapshot : StarTable
        The embedded table.
    """
    aliases = snapshot_aliases()
    rows = {name: row for row, name in enumerate(snapshot.column("name").tolist())}
    magnitudes = snapshot.column("v_mag").tolist()
    claims = []
    for i, star in enumerate(answer):
        keys = {designation_key(text) for text in (star["main_id"], *filter(_TELLING.match, star["ids"]))}
        votes = Counter(aliases[key][0] for key in keys if aliases.get(key, ("", 1))[1] == 0)
        for name, count in votes.items():
            claims.append((-count, abs(magnitudes[rows[name]] - star["v_mag"]), i, rows[name]))
    matched: dict[int, int] = {}
    used: set[int] = set()
    for _, _, i, row in sorted(claims):
        if i not in matched and row not in used:
            matched[i] = row
            used.add(row)
    return [matched.get(i, -1) for i in range(len(answer))]


def blends(answer: Sequence[Row]) -> tuple[dict[int, str], set[int]]:
    """Find the objects that are the blended light of several stars.

    Returns
    -------
    listed : dict of int to str
        Blends whose components are objects of their own in the answer, with the names of these.
    alone : set of int
        Blends of which no component is listed: kept, and flagged ``composite``.
    """
    names, v_mag, ra, dec = ([star[name] for star in answer] for name in ("main_id", "v_mag", "ra_deg", "dec_deg"))
    letters = [_double_star_letters((star["main_id"], *star["ids"])) for star in answer]
    bases: dict[str, set[int]] = {}
    for i, name in enumerate(names):
        base, letter = split_component(designation_key(name))
        if letter:
            bases.setdefault(base, set()).add(i)
    listed: dict[int, str] = {}
    alone: set[int] = set()
    for i, near in enumerate(neighbours(ra, dec, _NAMED_PART_ARCSEC)):
        parts = bases.get(designation_key(names[i]), set()) & near.keys()
        several = {system: held for system, held in letters[i].items() if len(held) > 1}
        for system, held in several.items():
            parts |= {j for j in near if len(letters[j].get(system, "")) == 1 and letters[j][system] in held}
        named = is_blend_id(names[i])
        if named:
            parts |= {j for j, sep in near.items() if sep < _UNNAMED_PART_ARCSEC and not is_blend_id(names[j])}
        if fainter := sorted(j for j in parts if v_mag[j] >= v_mag[i]):
            listed[i] = ", ".join(names[j] for j in fainter)
        elif named or several:
            alone.add(i)
    return listed, alone


def _double_star_letters(ids: Iterable[str]) -> dict[str, str]:
    """Return double-star designation -> component letters of an object, ``""`` for the system as a whole."""
    found = filter(None, map(_DOUBLE_STAR_ID.fullmatch, ids))
    return {f"{match[1]} {match[2]}": match[3] or "" for match in found}
