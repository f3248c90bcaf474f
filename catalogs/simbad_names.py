"""Names of a refreshed table's rows: which star of the snapshot each one is, what it is called, which are blends.

A row that the snapshot knows keeps the snapshot's name, so that a star is called the same in every plan. Others are
named by the snapshot's rule: Bayer, Flamsteed, HD, HIP, else SIMBAD's identifier.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from catalogs.coordinates import separation_arcsec
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import GREEK, designation_key, split_component
from catalogs.simbad_answer import Answer
from catalogs.star_systems import is_blend_id
from catalogs.stars import StarTable

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
    for i in range(len(answer)):
        sep = separation_arcsec(answer.ra_deg[i], answer.dec_deg[i], answer.ra_deg, answer.dec_deg)
        near = [j for j in np.flatnonzero(sep < _NAMED_PART_ARCSEC).tolist() if j != i]
        parts = {j for j in bases.get(designation_key(answer.main_id[i]), ()) if j in near}
        for system, held in letters[i].items():
            if len(held) > 1:
                parts |= {j for j in near if len(letters[j].get(system, "")) == 1 and letters[j][system] in held}
        named = is_blend_id(answer.main_id[i])
        if named:
            parts |= {j for j in near if sep[j] < _UNNAMED_PART_ARCSEC and not is_blend_id(answer.main_id[j])}
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
