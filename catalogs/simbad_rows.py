"""Make a star table with the columns of the snapshot from SIMBAD's two answers.

Taken from SIMBAD: positions, proper motions, radial velocities, parallaxes with errors, V, B-V, spectral and object
types, identifiers, and the medians of the published temperatures, gravities and metallicities (``mesFe_h``). The two
questions say nothing about companions: the snapshot's are taken over where it has the star (the ``*_src`` columns say
so); elsewhere bright neighbours in the answer count, and the row is flagged ``companions_not_searched``. Values of the
literature that SIMBAD has not (temperatures and gravities of ExoCat-1, and masses while V is the same) are taken over
too. Everything else is derived by the relations that
filled the snapshot (:mod:`catalogs.stellar_physics`).
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from statistics import median
from typing import Any

import numpy as np

from catalogs import stellar_physics
from catalogs.coordinates import neighbours, position_angle, tangent_offset
from catalogs.nomenclature import designation_key
from catalogs.simbad import Cuts
from catalogs.simbad_answer import blends, match_snapshot, own_names, row_name
from catalogs.spectral_types import PARAMETERS_SOURCE, stellar_parameters
from catalogs.star_columns import parallax_flags, type_flags
from catalogs.star_systems import CLOSE_COMPANION_ARCSEC, Member, adopt_parallaxes, group_systems
from catalogs.stars import StarTable, star_table
from catalogs.table_cells import Row
from catalogs.tap_client import RefreshError
from cpic_core import NDArray

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


@dataclass(frozen=True)
class Assembled:
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
