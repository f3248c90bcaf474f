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
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from statistics import median

import numpy as np

from catalogs import stellar_physics
from catalogs.coordinates import neighbours, position_angle, tangent_offset
from catalogs.nomenclature import designation_key
from catalogs.simbad import Cuts
from catalogs.simbad_answer import Answer, Measurements, Names, blends, match_snapshot, own_names, row_name
from catalogs.spectral_types import PARAMETERS_SOURCE, stellar_parameters
from catalogs.star_columns import parallax_flags, type_flags
from catalogs.star_systems import CLOSE_COMPANION_ARCSEC, Adopted, Member, adopt_parallaxes, group_systems
from catalogs.stars import StarTable, star_table
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
_COMPANION = ("name", "sep_arcsec", "pa_deg", "epoch_yr", "delta_v_mag")
_COMPANION_COLUMNS = tuple(f"companion_{what}" for what in _COMPANION)
_COMPANION_SOURCES = ("companion_src", "companion_pa_src", "companion_delta_v_src")

Row = dict[str, object]
Medians = dict[tuple[bool, int], tuple[float, float]]


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


def assemble(answer: Answer, measurements: Measurements, snapshot: StarTable, cuts: Cuts, label: str) -> Assembled:
    """Make the table.

    Parameters
    ----------
    answer, measurements : Answer, Measurements
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
    reasons: dict[int, tuple[str, str]] = {}
    counts: Counter[str] = Counter(objects=len(answer), measurements=len(measurements))
    kept = []
    for i in range(len(answer)):
        why = _why_not(answer, i, cuts, listed)
        if why is None:
            kept.append(i)
        else:
            reasons[i] = why
    names = {i: own_names(answer.main_id[i], answer.ids[i]) for i in kept}
    kept.sort(key=lambda i: (answer.v_mag[i], answer.main_id[i]))
    adopted = _parallaxes(answer, kept, names)
    counts.update(f"left out: {kind}" for kind, _ in reasons.values())
    if not kept:
        raise RefreshError("no star of class F, G or K is left in the answer", "check --v-mag-max and the service")
    measured = _spectroscopy(measurements)
    known = {i: snapshot.row(matched[i]) if matched[i] >= 0 else None for i in kept}
    shown = _shown_names(names, known, kept)
    medians = stellar_physics.measured_medians(snapshot.columns)
    near = neighbours(answer.ra_deg, answer.dec_deg, _NEIGHBOUR_ARCSEC)
    rows = []
    for i in kept:
        row: Row = {"name": shown[i], **_identity(names[i], known[i])}
        row |= _parallax(answer, i, adopted[i], shown)
        motion = (float(answer.pm_ra_mas_yr[i]), float(answer.pm_dec_mas_yr[i]))
        row |= stellar_physics.place_columns(
            answer.ra_deg[i], answer.dec_deg[i], motion, float(answer.rv_km_s[i]), "measured"
        )
        v_mag, b_mag = float(answer.v_mag[i]), float(answer.b_mag[i])
        row |= stellar_physics.light_columns(v_mag, b_mag - v_mag, answer.sp_type[i], "measured")
        flags = _fill(row, measured.get(int(answer.oid[i]), {}), known[i], medians)
        flags |= _companion(row, answer, i, known[i], shown, listed, near[i])
        flags |= type_flags(answer.sp_type[i], answer.object_type[i], answer.main_id[i])
        flags |= parallax_flags(adopted[i].parallax_mas, adopted[i].parallax_err_mas)
        flags |= {"shared_parallax"} if adopted[i].shared else set()
        flags |= {"composite"} if i in alone else set()
        flags |= set() if names[i].hip else {"no_hip"}
        flags |= set() if math.isfinite(answer.rv_km_s[i]) else {"rv_unknown"}
        row["quality_flags"] = ";".join(sorted(flags))
        rows.append(row)
    counts["stars"] = len(rows)
    counts["stars of the snapshot"] = sum(known[i] is not None for i in kept)
    return Assembled(
        table=star_table({name: [row[name] for row in rows] for name in rows[0]}, label),
        counts=dict(counts),
        left_out={answer.main_id[i]: text for i, (kind, text) in sorted(reasons.items()) if kind != _OTHER_CLASS},
        snapshot_rows=np.array([matched[i] for i in kept], dtype=np.int64),
        missed={matched[i]: text for i, (_, text) in reasons.items() if matched[i] >= 0},
    )


def _why_not(answer: Answer, i: int, cuts: Cuts, listed: Mapping[int, str]) -> tuple[str, str] | None:
    """Return the kind of reason and the reason why an object is no row, None if it is one."""
    sp_type = answer.sp_type[i]
    letter = stellar_physics.spectral_letter(sp_type)
    if not letter:
        what = f"type {sp_type!r}" if sp_type else "no type"
        return "spectral type missing or unreadable", f"{what} (V {answer.v_mag[i]:.2f})"
    if letter not in _KEPT_LETTERS:
        return _OTHER_CLASS, f"type {sp_type}"
    if answer.v_mag[i] > cuts.v_mag_max + 1e-6 or answer.parallax_mas[i] < cuts.parallax_min_mas - 1e-6:
        return "outside the cuts", f"V {answer.v_mag[i]:.3f}, parallax {answer.parallax_mas[i]:.3f} mas"
    if i in listed:
        return "blend of components that are listed", f"blend of {listed[i]}"
    return None


def _parallaxes(answer: Answer, kept: list[int], names: Mapping[int, Names]) -> dict[int, Adopted]:
    """Give the members of each bound system one parallax; `lender` is an object of the answer."""
    errors = np.where(answer.parallax_err_mas > 0.0, answer.parallax_err_mas, np.nan)
    columns = (answer.ra_deg, answer.dec_deg, answer.parallax_mas, errors, answer.pm_ra_mas_yr, answer.pm_dec_mas_yr)
    members = []
    for i in kept:
        ra, dec, *others = (float(column[i]) for column in columns)
        members.append(Member(ra, dec, names[i].hip, *others))
    taken = adopt_parallaxes(members, group_systems(members))
    return {
        i: item._replace(lender=kept[item.lender] if item.lender >= 0 else -1)
        for i, item in zip(kept, taken, strict=True)
    }


def _shown_names(
    names: Mapping[int, Names], known: Mapping[int, Mapping[str, object] | None], kept: list[int]
) -> dict[int, str]:
    shown = {i: str(row["name"]) for i in kept if (row := known[i]) is not None}
    taken = {designation_key(name) for name in shown.values()}
    return shown | {i: row_name(names[i], taken) for i in kept if i not in shown}


def _identity(names: Names, known: Mapping[str, object] | None) -> Row:
    """Return the designations, the snapshot's where SIMBAD's list has none."""
    old: Mapping[str, object] = known or {}
    component = old.get("component") or names.component
    return {
        "simbad_id": names.simbad_id,
        "hip": names.hip or old.get("hip", 0),
        **{name: getattr(names, name) or old.get(name, "") for name in ("hd", "gj")},
        **{name: old.get(name) or getattr(names, name) for name in ("bayer", "flamsteed", "common_name")},
        "component": component,
        "component_src": old.get("component_src") if old.get("component") else "measured" if component else "missing",
    }


def _parallax(answer: Answer, i: int, adopted: Adopted, shown: Mapping[int, str]) -> Row:
    return {
        "parallax_mas": adopted.parallax_mas,
        "parallax_err_mas": adopted.parallax_err_mas,
        "parallax_src": adopted.src or f"derived:shared with {shown.get(adopted.lender, '')}",
        "parallax_err_src": adopted.err_src,
        "parallax_own_mas": float(answer.parallax_mas[i]),
        "distance_pc": 1000.0 / adopted.parallax_mas,
        "distance_pc_src": "derived:parallax",
    }


def _spectroscopy(measurements: Measurements) -> dict[int, dict[str, tuple[float, str]]]:
    """Return star -> quantity -> (median, how many, and the newest reference)."""
    groups: dict[tuple[int, str], list[tuple[float, str]]] = {}
    columns = {"teff_k": measurements.teff_k, "log_g": measurements.log_g, "metallicity": measurements.fe_h}
    for name, values in columns.items():
        for oid, value, bibcode in zip(measurements.oid.tolist(), values.tolist(), measurements.bibcode, strict=True):
            if math.isfinite(value):
                groups.setdefault((oid, name), []).append((value, bibcode))
    found: dict[int, dict[str, tuple[float, str]]] = {}
    for (oid, name), pairs in groups.items():
        newest = max((bibcode for _, bibcode in pairs), default="")
        src = f"measured:median of {len(pairs)} (SIMBAD mesFe_h, newest {newest or 'without reference'})"
        found.setdefault(oid, {})[name] = (median(value for value, _ in pairs), src)
    return found


def _fill(
    row: Row, measured: Mapping[str, tuple[float, str]], known: Mapping[str, object] | None, medians: Medians
) -> set[str]:
    """Fill temperature, gravity, metallicity, luminosity, radius and mass; return the flags."""
    flags: set[str] = set()

    def old(name: str, least: tuple[str, ...]) -> tuple[float, str] | None:
        """Return the snapshot's value where its source is one of the better kinds."""
        if known is None or not any(kind in str(known[f"{name}_src"]) for kind in least):
            return None
        return float(str(known[name])), f"{known[f'{name}_src']}{_TAKEN_OVER}"

    def best(name: str) -> tuple[float, str] | None:
        """Return SIMBAD's median, else the snapshot's value if it is measured, or a temperature from V-Ks."""
        return measured.get(name) or old(name, ("measured", stellar_physics.INFRARED_SOURCE))

    sp_type, b_v = str(row["sp_type"]), float(str(row["b_v_mag"]))
    expected_teff, expected_b_v = stellar_physics.nearest_subtype(sp_type, medians)
    row["metallicity"], row["metallicity_src"] = best("metallicity") or (0.0, "assumed:0")
    off = (
        abs(stellar_physics.colour_temperature(b_v, 0.0)[0] - expected_teff) > 2 * stellar_physics.TEFF_TOLERANCE_K
    )  # not where one is unknown
    if off:
        flags.add("colour_outlier")
    if (off or not math.isfinite(b_v)) and math.isfinite(expected_b_v):
        b_v = expected_b_v
        row["b_v_mag"], row["b_v_mag_src"] = b_v, "derived:median of the spectral subtype in the snapshot"
    from_colour = stellar_physics.colour_temperature(b_v, float(str(row["metallicity"])))  # nan where B-V is unknown
    found = best("teff_k") or (from_colour if math.isfinite(b_v) else None)
    if found is None:
        found = stellar_parameters(sp_type).teff_k, PARAMETERS_SOURCE
    teff = found[0]
    if stellar_physics.temperatures_disagree(teff, (from_colour[0], expected_teff)):
        flags.add("teff_disagreement")
    row["teff_k"], row["teff_k_src"] = found
    v_mag, distance_pc = float(str(row["v_mag"])), float(str(row["distance_pc"]))
    measured_log_g = best("log_g")
    log_g = measured_log_g[0] if measured_log_g else stellar_physics.usual_gravity(sp_type)
    metallicity = float(str(row["metallicity"]))
    luminosity = stellar_physics.luminosity_from_v(v_mag, distance_pc, teff, metallicity, log_g)
    same_v = known is not None and abs(v_mag - float(str(known["v_mag"]))) < _SAME_V_MAG
    mass_found = old("mass_msun", ("ExoCat-1", "Takeda")) if same_v else None
    radius = stellar_physics.radius_from_luminosity(luminosity, teff)
    mass, mass_src = mass_found or stellar_physics.mass_of(sp_type, luminosity)
    row["luminosity_lsun"], row["luminosity_lsun_src"] = luminosity, stellar_physics.LUMINOSITY_SOURCE
    row["radius_rsun"], row["radius_rsun_src"] = radius, stellar_physics.RADIUS_SOURCE
    row["mass_msun"], row["mass_msun_src"] = mass, mass_src
    row["log_g"], row["log_g_src"] = measured_log_g or (
        stellar_physics.gravity(mass, radius),
        stellar_physics.GRAVITY_SOURCE,
    )
    return flags


def _companion(
    row: Row,
    answer: Answer,
    i: int,
    known: Mapping[str, object] | None,
    shown: Mapping[int, str],
    not_stars: Collection[int],
    near: Mapping[int, float],
) -> set[str]:
    """Fill the companion columns: the snapshot's, else the neighbour in the answer with most light; return the flags.

    `not_stars` are the objects that are blends of others, `near` the neighbours with their separations in arcsec.

    The neighbour's position is good to about an arcsecond, and orbital motion is not modelled, as in the snapshot.
    """
    if known is not None:
        row |= {name: known[name] for name in ("close_companion", *_COMPANION_COLUMNS)}
        row |= {
            name: known[name] if known[name] == "missing" else f"{known[name]}{_TAKEN_OVER}"
            for name in _COMPANION_SOURCES
        }
        return set()
    candidates = {
        j: sep
        for j, sep in near.items()
        if sep > _LEAST_SEPARATION_ARCSEC
        and abs(answer.parallax_mas[j] - answer.parallax_mas[i]) < _PARALLAX_TOLERANCE * answer.parallax_mas[i]
        and j not in not_stars
    }
    row |= dict.fromkeys(_COMPANION_COLUMNS, float("nan")) | {"companion_name": ""}
    row |= dict.fromkeys(_COMPANION_SOURCES, "missing")
    row["close_companion"] = answer.object_type[i] in _BINARY_TYPES
    if candidates:
        j = max(candidates, key=lambda j: 10.0 ** (-0.4 * answer.v_mag[j]) / candidates[j] ** 2)
        east, north = tangent_offset(answer.ra_deg[j], answer.dec_deg[j], answer.ra_deg[i], answer.dec_deg[i])
        row |= {
            "companion_name": shown.get(j, answer.main_id[j]),
            "companion_sep_arcsec": float(np.hypot(east, north)),
            "companion_pa_deg": float(position_angle(east, north)),
            "companion_epoch_yr": 2000.0,
            "companion_delta_v_mag": float(answer.v_mag[j] - answer.v_mag[i]),
            "companion_src": "derived:positions of the entries",
            "companion_pa_src": "derived:positions of the entries",
            "companion_delta_v_src": "derived:V of both entries",
        }
        row["close_companion"] = bool(row["close_companion"]) or candidates[j] < CLOSE_COMPANION_ARCSEC
    return {"companions_not_searched"}
