"""SIMBAD's nearby F, G and K stars as a table with the columns of the snapshot: ask, check, assemble, compare.

The first of two questions asks for every object with a parallax and a V magnitude within the cuts, one row each; the
second for all temperatures, gravities and metallicities of the same objects, many rows each. Spectral types are not
part of the cut: ``LIKE 'F%'`` would miss ``sdF8``, ``(G2)V`` or ``dK5``, so types are read here.

A row that the snapshot knows keeps the snapshot's name, so that a star is called the same in every plan. Others are
named by the snapshot's rule: Bayer, Flamsteed, HD, HIP, else SIMBAD's identifier.

Rows close on the sky with consistent parallax and proper motion are one system, and all its members take the parallax
of the member with the best parallax over error: the components' own values can differ by more than their distance does.

Taken from SIMBAD: positions, proper motions, radial velocities, parallaxes with errors, V, B-V, spectral and object
types, identifiers, and the medians of the published temperatures, gravities and metallicities (``mesFe_h``). The two
questions say nothing about companions: the snapshot's are taken over where it has the star (the ``*_src`` columns say
so); elsewhere bright neighbours in the answer count, and the row is flagged ``companions_not_searched``. Values of the
literature that SIMBAD has not (temperatures and gravities of ExoCat-1, and masses while V is the same) are taken over
too. Everything else is derived by the relations that filled the snapshot (:mod:`catalogs.stellar_physics`).

Where refreshed tables are kept, `catalogs.archives` says. Nothing is written here: whoever does writes the whole text
at once.
"""

import math
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from operator import itemgetter
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from catalogs import stellar_physics
from catalogs.archives import Refresh, RefreshError, TapService, answer_columns, ask, ecsv_of, loss_refused, read_answer
from catalogs.catalogue import STAR_CREDITS, snapshot_vintage
from catalogs.coordinates import neighbours, position_angle, tangent_offset
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import GREEK, designation_key, split_component
from catalogs.stars import (
    CLOSE_COMPANION_ARCSEC,
    COLUMNS,
    StarTable,
    load_stars,
    parallax_flags,
    star_table,
    type_flags,
)
from catalogs.stellar_physics import PARAMETERS_SOURCE, stellar_parameters
from catalogs.table_cells import Row
from catalogs.table_files import RawTable
from cpic_core import InputError, NDArray, Record, checked_scalar

CLOSE_ARCSEC = 30.0
"""Rows of consistent parallax this close are one system whatever their proper motions say."""
_GROUP_ARCSEC = 600.0
#: Identifiers of blended light end in two or more component letters.
_COMPOSITE_ID = re.compile(r"(?:CCDM|\*\*|ADS|IDS|WDS) .*\d ?[A-Z]{2,}")


class Member(NamedTuple):
    """The columns that decide whether two rows are bound; nan where unknown, `hip` 0 if none."""

    ra_deg: float
    dec_deg: float
    hip: int
    parallax_mas: float
    parallax_err_mas: float
    pm_ra_mas_yr: float
    pm_dec_mas_yr: float


class Adopted(NamedTuple):
    """The parallax that one row takes; `lender` is the row that it comes from, -1 if its own or a mean."""

    parallax_mas: float
    parallax_err_mas: float
    src: str
    err_src: str
    lender: int
    shared: bool


def is_blend_id(simbad_id: str) -> bool:
    """Tell whether an identifier names the blended light of several components."""
    return _COMPOSITE_ID.fullmatch(simbad_id) is not None


def group_systems(members: Sequence[Member]) -> list[int]:
    """Return the system number of each row: that of its first member, a single star is a system of its own."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ra, dec, hip, parallax, error, *motion = np.array(members, float).reshape(-1, len(Member._fields)).T
    near = neighbours(ra, dec, _GROUP_ARCSEC)
    if not any(near):
        return list(range(len(members)))
    pairs = [(i, j, sep) for i, others in enumerate(near) for j, sep in others.items() if j > i]
    first, second, sep = (np.array(part) for part in zip(*pairs, strict=True))
    one, other = (np.array([hip, parallax, error, *motion])[:, rows] for rows in (first, second))
    tolerance = np.maximum(0.1 * np.maximum(one[1], other[1]), 3.0 * np.nan_to_num(np.hypot(one[2], other[2])))
    differ = np.hypot(*(one[3:] - other[3:])) >= 0.3 * np.hypot(*one[3:]) + 20.0  # not where a motion is unknown
    bound = (np.abs(one[1] - other[1]) <= tolerance) & ((sep < CLOSE_ARCSEC) | ~differ)
    bound |= (one[0] > 0) & (one[0] == other[0])
    links = coo_array((np.ones(bound.sum()), (first[bound], second[bound])), shape=(len(members),) * 2)
    _, label = connected_components(links, directed=False)
    _, begin, system = np.unique(label, return_index=True, return_inverse=True)
    return [int(row) for row in begin[system]]


def adopt_parallaxes(members: Sequence[Member], systems: Sequence[int]) -> list[Adopted]:
    """Return the parallax of each row: that of its system's best member, or the mean where none has an error.

    Parameters
    ----------
    members : sequence of Member
        The rows of a table.
    systems : sequence of int
        System of each, as `group_systems` numbers them.
    """
    rows_of: dict[int, list[int]] = {}
    for row, system in enumerate(systems):
        rows_of.setdefault(system, []).append(row)
    adopted: dict[int, Adopted] = {}
    for rows in rows_of.values():
        measured = [row for row in rows if np.isfinite(members[row].parallax_err_mas)]
        if measured:
            best = max(measured, key=lambda row: members[row].parallax_mas / members[row].parallax_err_mas)
            value, error = members[best].parallax_mas, members[best].parallax_err_mas
            for row in rows:
                own = (members[row].parallax_mas, members[row].parallax_err_mas) == (value, error)
                lender = -1 if own else best
                adopted[row] = Adopted(value, error, "measured" if own else "", "measured", lender, shared=not own)
            continue
        values = [members[row].parallax_mas for row in rows]
        taken = Adopted(values[0], float("nan"), "measured", "missing", -1, shared=False)
        if len(rows) > 1:
            src, err_src = (
                "derived:mean of the components' values",
                "derived:half the difference of the components' values",
            )
            spread = float(max(values) - min(values))
            taken = Adopted(float(np.mean(values)), spread / 2.0, src, err_src, -1, shared=True)
        adopted |= dict.fromkeys(rows, taken)
    return [adopted[row] for row in range(len(members))]


NARROWER = "ask for less with --v-mag-max or --parallax-min-mas"
"""Advice of messages on an answer with too many rows."""
URL_VARIABLE = "CPIC_SIMBAD_URL"
"""Environment variable with the address of the TAP service to ask, where none is given."""


class Cuts(Record):
    """The cuts that say which stars are asked for.

    Parameters
    ----------
    v_mag_max : float
        Faintest Johnson V, mag; there is no bright limit.
    parallax_min_mas : float
        Smallest parallax, mas.
    """

    v_mag_max: float = 7.5
    parallax_min_mas: float = 25.0

    def __post_init__(self) -> None:
        checked_scalar("v_mag_max", self.v_mag_max, low=-2.0, high=15.0, unit="mag")
        checked_scalar("parallax_min_mas", self.parallax_min_mas, low=1.0, high=700.0, unit="mas")


def queries(cuts: Cuts) -> tuple[str, str]:
    """Return the ADQL of the two questions: the stars, and their spectroscopic measurements."""
    where = f"WHERE b.plx_value >= {float(cuts.parallax_min_mas)!r} AND f.V <= {float(cuts.v_mag_max)!r}"
    stars = (
        "SELECT b.oid, b.main_id, b.ra, b.dec, b.plx_value, b.plx_err, b.pmra, b.pmdec, b.rvz_radvel, b.sp_type, "
        "b.otype, f.B, f.V, i.ids "
        "FROM basic AS b JOIN allfluxes AS f ON f.oidref = b.oid LEFT JOIN ids AS i ON i.oidref = b.oid " + where
    )
    measurements = (
        "SELECT m.oidref, m.teff, m.log_g, m.fe_h, m.bibcode, m.mespos "
        "FROM mesFe_h AS m JOIN basic AS b ON b.oid = m.oidref JOIN allfluxes AS f ON f.oidref = b.oid " + where
    )
    return stars, measurements


def service_url(service: TapService) -> str:
    """Return the base address that is asked (its ``/sync`` is).

    Raises
    ------
    InputError
        If ``$CPIC_SIMBAD_URL`` is no address.
    """
    if given := service.address(URL_VARIABLE):
        return given
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from astroquery.simbad import conf

    return f"https://{conf.server}/simbad/sim-tap"


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
    blank = {name: math.nan if row["kind"] == "float" else "" for name, row in answer_columns("simbad_stars").items()}
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


_KEPT_LETTERS = ("F", "G", "K")
_OTHER_CLASS = "not of class F, G or K"

_NEIGHBOUR_ARCSEC = 60.0
_LEAST_SEPARATION_ARCSEC = 0.1
_PARALLAX_TOLERANCE = 0.2
_SAME_V_MAG = 0.05
_BINARY_TYPES = ("**", "SB*", "El*", "EB*")
_TAKEN_OVER = "; from the snapshot"
_COMPANION = tuple(f"companion_{what}" for what in ("sep_arcsec", "pa_deg", "epoch_yr", "delta_v_mag"))
_NO_COMPANION: Row = {"companion_name": "", **dict.fromkeys(_COMPANION, math.nan)}
_COMPANION_SOURCES = ("companion_src", "companion_pa_src", "companion_delta_v_src")
_PLACES = "derived:positions of the entries"


class Assembled(Record):
    """A refreshed table and how it came about.

    Parameters
    ----------
    table : StarTable
        Brightest star first.
    counts : mapping of str to int
        Rows at each step.
    left_out : mapping of str to str
        SIMBAD identifier of each object of the answer that is not in the table -> why, except those of another type.
    snapshot_rows : ndarray of int
        Row of the snapshot that each row of the table is, -1 where it is none.
    missed : mapping of int to str
        Row of the snapshot that the answer has but the table has not -> why.
    """

    table: StarTable
    counts: Mapping[str, int]
    left_out: Mapping[str, str]
    snapshot_rows: NDArray[np.int64]
    missed: Mapping[int, str]


def assemble(
    answer: Sequence[Row], measurements: Sequence[Row], snapshot: StarTable, cuts: Cuts, label: str
) -> Assembled:
    """Make the table.

    Parameters
    ----------
    answer, measurements : sequence of Row
        The checked answers.
    snapshot : StarTable
        Where names and companions are taken over from.
    cuts : Cuts
        What was asked for; rows outside are left out.
    label : str
        What messages call the new table.

    Raises
    ------
    RefreshError
        If no star is left.
    """
    matched = match_snapshot(answer, snapshot)
    listed, alone = blends(answer)
    reasons = {i: why for i, star in enumerate(answer) if (why := _why_not(star, cuts, listed.get(i)))}
    counts: Counter[str] = Counter(objects=len(answer), measurements=len(measurements))
    counts.update(f"left out: {kind}" for kind, _ in reasons.values())
    kept = [i for i in range(len(answer)) if i not in reasons]
    kept.sort(key=lambda i: (answer[i]["v_mag"], answer[i]["main_id"]))
    if not kept:
        raise RefreshError("no star of class F, G or K is left in the answer", "check --v-mag-max and the service")
    known: dict[int, Row] = {i: snapshot.row(matched[i]) if matched[i] >= 0 else {} for i in kept}
    names = {i: own_names(answer[i]["main_id"], answer[i]["ids"]) for i in kept}
    shown = {i: known[i]["name"] for i in kept if known[i]}
    taken = {designation_key(name) for name in shown.values()}
    shown |= {i: row_name(names[i], taken) for i in kept if not known[i]}
    measured, medians = _spectroscopy(measurements), stellar_physics.measured_medians(snapshot.columns)
    near = neighbours([star["ra_deg"] for star in answer], [star["dec_deg"] for star in answer], _NEIGHBOUR_ARCSEC)
    rows = []
    for i, parallax in zip(
        kept, _parallaxes([answer[i] | names[i] for i in kept], [shown[i] for i in kept]), strict=True
    ):
        star, error = answer[i], parallax["parallax_err_mas"]
        motion = (star["pm_ra_mas_yr"], star["pm_dec_mas_yr"])
        place = (star["ra_deg"], star["dec_deg"], motion, star["rv_km_s"])
        light = (star["v_mag"], star["b_mag"] - star["v_mag"], star["sp_type"])
        row: Row = {"name": shown[i], **_identity(names[i], known[i]), **parallax}
        row |= stellar_physics.place_columns(*place, "measured") | stellar_physics.light_columns(*light, "measured")
        flags = _fill(row, measured.get(star["oid"], {}), known[i], medians)
        others = {j: sep for j, sep in near[i].items() if j not in listed}
        flags |= _companion(row, answer, i, known[i], shown, others)
        flags |= type_flags(star["sp_type"], star["object_type"], star["main_id"])
        flags |= parallax_flags(parallax["parallax_mas"], error)
        said = {"shared_parallax": row.pop("shared"), "composite": i in alone, "no_hip": not names[i]["hip"]}
        said |= {"rv_unknown": not math.isfinite(star["rv_km_s"])}
        row["quality_flags"] = ";".join(sorted(flags | {word for word, applies in said.items() if applies}))
        rows.append(row)
    counts.update({"stars": len(rows), "stars of the snapshot": sum(map(bool, known.values()))})
    return Assembled(
        table=star_table({name: [row[name] for row in rows] for name in rows[0]}, label),
        counts=dict(counts),
        left_out={answer[i]["main_id"]: text for i, (kind, text) in reasons.items() if kind != _OTHER_CLASS},
        snapshot_rows=np.array([matched[i] for i in kept], dtype=np.int64),
        missed={matched[i]: text for i, (_, text) in reasons.items() if matched[i] >= 0},
    )


def _why_not(star: Row, cuts: Cuts, parts: str | None) -> tuple[str, str] | None:
    """Return the kind of reason and the reason why an object is no row, None if it is one; `parts` of a blend."""
    sp_type, v_mag, parallax = star["sp_type"], star["v_mag"], star["parallax_mas"]
    letter = stellar_physics.spectral_letter(sp_type)
    if not letter:
        what = f"type {sp_type!r}" if sp_type else "no type"
        return "spectral type missing or unreadable", f"{what} (V {v_mag:.2f})"
    if letter not in _KEPT_LETTERS:
        return _OTHER_CLASS, f"type {sp_type}"
    if v_mag > cuts.v_mag_max + 1e-6 or parallax < cuts.parallax_min_mas - 1e-6:
        return "outside the cuts", f"V {v_mag:.3f}, parallax {parallax:.3f} mas"
    return ("blend of components that are listed", f"blend of {parts}") if parts else None


def _parallaxes(stars: Sequence[Row], shown: Sequence[str]) -> list[Row]:
    """Return the columns of the parallax that the members of each bound system share, and whether it is shared."""
    values = itemgetter(*Member._fields)
    members = [Member(*values(star)) for star in stars]
    members = [item if item.parallax_err_mas > 0.0 else item._replace(parallax_err_mas=math.nan) for item in members]
    return [
        {
            "parallax_mas": item.parallax_mas,
            "parallax_err_mas": item.parallax_err_mas,
            "parallax_src": item.src or f"derived:shared with {shown[item.lender]}",
            "parallax_err_src": item.err_src,
            "parallax_own_mas": star["parallax_mas"],
            "distance_pc": 1000.0 / item.parallax_mas,
            "distance_pc_src": "derived:parallax",
            "shared": item.shared,
        }
        for star, item in zip(stars, adopt_parallaxes(members, group_systems(members)), strict=True)
    ]


def _identity(names: Row, known: Row) -> Row:
    """Return the designations, the snapshot's where SIMBAD's list has none, and in those that people use first."""
    old = dict.fromkeys(names, "") | {"hip": 0} | known
    of_old = ("bayer", "flamsteed", "common_name", "component")
    row = {name: old[name] or own if name in of_old else own or old[name] for name, own in names.items()}
    src = old["component_src"] if old["component"] else "measured" if row["component"] else "missing"
    return row | {"component_src": src}


def _spectroscopy(measurements: Sequence[Row]) -> dict[float, dict[str, tuple[float, str]]]:
    """Return star -> quantity -> (median, how many, and the newest reference)."""
    groups: dict[tuple[float, str], list[tuple[float, str]]] = {}
    for row in measurements:
        for name in row.keys() & {"teff_k", "log_g", "metallicity"}:
            groups.setdefault((row["oid"], name), []).append((row[name], row.get("bibcode", "")))
    found: dict[float, dict[str, tuple[float, str]]] = {}
    for (oid, name), pairs in groups.items():
        newest = max(bibcode for _, bibcode in pairs) or "without reference"
        src = f"measured:median of {len(pairs)} (SIMBAD mesFe_h, newest {newest})"
        found.setdefault(oid, {})[name] = (median(value for value, _ in pairs), src)
    return found


def _fill(row: Row, measured: Mapping[str, tuple[float, str]], known: Row, medians: Any) -> set[str]:
    """Fill temperature, gravity, metallicity, luminosity, radius and mass; return the flags."""

    def old(name: str, *least: str) -> tuple[float, str] | None:
        """Return the snapshot's value where its source is one of the better kinds."""
        src = known.get(f"{name}_src", "")
        return (known[name], f"{src}{_TAKEN_OVER}") if any(kind in src for kind in least) else None

    def best(name: str) -> tuple[float, str] | None:
        """Return SIMBAD's median, else the snapshot's value if it is measured, or a temperature from V-Ks."""
        return measured.get(name) or old(name, "measured", stellar_physics.INFRARED_SOURCE)

    sp_type, b_v = row["sp_type"], row["b_v_mag"]
    expected_teff, expected_b_v = stellar_physics.nearest_subtype(sp_type, medians)
    tolerance = 2 * stellar_physics.TEFF_TOLERANCE_K
    off = abs(stellar_physics.colour_temperature(b_v, 0.0)[0] - expected_teff) > tolerance  # not where one is unknown
    if (off or not math.isfinite(b_v)) and math.isfinite(expected_b_v):
        b_v = expected_b_v
        row |= {"b_v_mag": b_v, "b_v_mag_src": "derived:median of the spectral subtype in the snapshot"}
    row["metallicity"], row["metallicity_src"] = best("metallicity") or (0.0, "assumed:0")
    of_colour = stellar_physics.colour_temperature(b_v, row["metallicity"])  # nan where B-V is unknown
    if (temperature := best("teff_k") or (of_colour if math.isfinite(b_v) else None)) is None:
        temperature = stellar_parameters(sp_type).teff_k, PARAMETERS_SOURCE
    row["teff_k"], row["teff_k_src"] = temperature
    same_v = known and abs(row["v_mag"] - known["v_mag"]) < _SAME_V_MAG
    mass = old("mass_msun", "ExoCat-1", "Takeda") if same_v else None
    row |= stellar_physics.bulk_columns(row, {"log_g": best("log_g"), "mass_msun": mass})
    disagrees = stellar_physics.temperatures_disagree(temperature[0], (of_colour[0], expected_teff))
    return {word for word, applies in (("colour_outlier", off), ("teff_disagreement", disagrees)) if applies}


def _companion(
    row: Row, answer: Sequence[Row], i: int, known: Row, shown: Mapping[int, str], near: Mapping[int, float]
) -> set[str]:
    """Fill the companion columns: the snapshot's, else the neighbour in the answer with most light; return the flags.

    `near` are the neighbours that are stars, with their separations in arcsec.

    The neighbour's position is good to about an arcsecond, and orbital motion is not modelled, as in the snapshot.
    """
    if known:
        row |= {name: known[name] for name in ("close_companion", *_NO_COMPANION)}
        sources = {name: known[name] for name in _COMPANION_SOURCES}
        row |= {name: src if src == "missing" else f"{src}{_TAKEN_OVER}" for name, src in sources.items()}
        return set()
    star, light = answer[i], {}
    for j, sep in near.items():
        apart = abs(answer[j]["parallax_mas"] - star["parallax_mas"])
        if sep > _LEAST_SEPARATION_ARCSEC and apart < _PARALLAX_TOLERANCE * star["parallax_mas"]:
            light[j] = 10.0 ** (-0.4 * answer[j]["v_mag"]) / sep**2
    row |= _NO_COMPANION | dict.fromkeys(_COMPANION_SOURCES, "missing")
    row["close_companion"] = star["object_type"] in _BINARY_TYPES
    if light:
        j = max(light, key=lambda j: light[j])
        other = answer[j]
        east, north = tangent_offset(other["ra_deg"], other["dec_deg"], star["ra_deg"], star["dec_deg"])
        row |= {
            "companion_name": shown.get(j, other["main_id"]),
            "companion_sep_arcsec": float(np.hypot(east, north)),
            "companion_pa_deg": float(position_angle(east, north)),
            "companion_epoch_yr": 2000.0,
            "companion_delta_v_mag": other["v_mag"] - star["v_mag"],
            "companion_src": _PLACES,
            "companion_pa_src": _PLACES,
            "companion_delta_v_src": "derived:V of both entries",
            "close_companion": row["close_companion"] or near[j] < CLOSE_COMPANION_ARCSEC,
        }
    return {"companions_not_searched"}


_LICENCE = "Open Database License (ODbL) 1.0: a database derived from SIMBAD"
V_CHANGE_MAG = 0.05
"""A V that differs by at least this from the snapshot's counts as changed."""
PARALLAX_CHANGE = 0.01
"""A parallax that differs by at least this fraction from the snapshot's counts as changed."""
INSIDE_V_MAG, INSIDE_PARALLAX = 0.2, 0.1
"""Snapshot stars this much brighter than the cut (mag), with a parallax larger by this fraction, cannot drop out of the
answer because SIMBAD has newer values: by them it is judged whether the answer is whole."""


class Refreshed(Refresh, kw_only=True):
    """A refreshed table of stars with its story; its changes are those of `compare`."""

    table: StarTable
    cuts: Cuts


def refresh_stars(
    service: TapService,
    cuts: Cuts,
    *,
    step: Callable[[str], None] = lambda text: None,
    tell: Callable[[str], None] = lambda text: None,
) -> Refreshed:
    """Ask SIMBAD for the stars within the cuts and return them as a table with the columns of the snapshot.

    Parameters
    ----------
    service : TapService
        Where and how patiently to ask.
    cuts : Cuts
        Which stars.
    step : callable
        Called with a word when a piece of work is done (three times).
    tell : callable
        Called with a sentence when a failure is tried again.

    Raises
    ------
    RefreshError
        If the service fails or its answers cannot be right.
    """
    questions = queries(cuts)
    url = service_url(service)
    answers = []
    when = datetime.now(UTC).replace(microsecond=0)
    for question, what in zip(questions, ("stars", "measurements"), strict=True):
        answers.append(ask(service, url, question, narrower=NARROWER, tell=tell))
        step(what)
    snapshot = load_stars(updates=False)  # they are laid over when the table is opened
    label = f"the catalogue refreshed on {when:%Y-%m-%d}"
    try:
        made = assemble(read_stars(answers[0]), read_measurements(answers[1]), snapshot, cuts, label)
    except InputError as error:
        raise RefreshError(str(error), "the service is not SIMBAD; tables already here stay as they are") from None
    step("table")
    changes, refusal = compare(made, snapshot, cuts)
    asked: dict[str, Any] = {"kind": "simbad", "queried_utc": when, "url": url, "queries": questions, "cuts": cuts}
    story: dict[str, Any] = {"counts": made.counts, "left_out": made.left_out, "changes": changes, "refusal": refusal}
    return Refreshed(**asked, **story, table=made.table)


def compare(made: Assembled, snapshot: StarTable, cuts: Cuts) -> tuple[dict[str, Any], str]:
    """Return what differs from the snapshot's stars within the cuts, and why the table is set aside, if it is.

    Parameters
    ----------
    made : Assembled
        The refreshed table, with the row of the snapshot that each of its rows is.
    snapshot : StarTable
        The embedded table.
    cuts : Cuts
        What was asked for.

    Returns
    -------
    changes : dict
        ``same``, the number of stars in both whose V and parallax do not differ; names of those that are ``added``,
        ``removed`` (with the reason), and whose V or parallax differs (``v_mag_changed``, ``parallax_changed``).
    refusal : str
        Empty, unless stars are lost that newer values do not take out of the cuts.
    """
    names, old_names = (table.column("name").tolist() for table in (made.table, snapshot))
    rows = made.snapshot_rows
    known = np.flatnonzero(rows >= 0)
    v_mag, parallax = (np.asarray(snapshot.column(name), float) for name in ("v_mag", "parallax_mas"))
    new_v, new_parallax = (np.asarray(made.table.column(name), float) for name in ("v_mag", "parallax_mas"))
    # the snapshot keeps three decimals of V and two of the parallax
    v_differs = np.abs(new_v[known] - v_mag[rows[known]]) >= V_CHANGE_MAG - 1e-9
    before = parallax[rows[known]]
    parallax_differs = np.abs(new_parallax[known] - before) >= PARALLAX_CHANGE * before
    gone = (v_mag <= cuts.v_mag_max) & (parallax >= cuts.parallax_min_mas)
    gone[rows[known]] = False
    inside = v_mag <= cuts.v_mag_max - INSIDE_V_MAG
    inside &= parallax >= (1.0 + INSIDE_PARALLAX) * cuts.parallax_min_mas
    changes = {
        "same": int(np.sum(~(v_differs | parallax_differs))),
        "added": [names[i] for i in np.flatnonzero(rows < 0)],
        "removed": {old_names[row]: made.missed.get(int(row), "not in the answer") for row in np.flatnonzero(gone)},
        "v_mag_changed": [names[i] for i in known[v_differs]],
        "parallax_changed": [names[i] for i in known[parallax_differs]],
    }
    what = "stars of the snapshot well within the cuts"
    return changes, loss_refused(int(np.sum(gone & inside)), int(inside.sum()), what)


def ecsv_text(made: Refreshed, versions: Mapping[str, str]) -> str:
    """Return a refreshed table as ECSV 1.0: units and descriptions of every column, and its story in the header.

    Parameters
    ----------
    made : Refreshed
        What to write; numbers are rounded as in the snapshot.
    versions : mapping of str to str
        Software that made it.
    """
    values: dict[str, Any] = {column.name: made.table.column(column.name).tolist() for column in COLUMNS}
    values |= {item.name: np.round(values[item.name], item.decimals) for item in COLUMNS if item.kind == "float"}
    about = {"cuts": asdict(made.cuts), "snapshot": snapshot_vintage(), "licence": _LICENCE, "credit": STAR_CREDITS[0]}
    columns = [replace(column, description=made.table.descriptions[column.name]) for column in COLUMNS]
    return ecsv_of(made, columns, values, versions, **about)
