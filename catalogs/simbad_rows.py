"""From SIMBAD's two answers to a star table with the columns of the snapshot.

Taken from SIMBAD: positions, proper motions, radial velocities, parallaxes with errors, V, B-V, spectral and object
types, identifiers, and the medians of the published temperatures, gravities and metallicities (``mesFe_h``). The two
questions say nothing about companions: the snapshot's are taken over where it has the star (the ``*_src`` columns say
so); elsewhere bright neighbours in the answer count, and the row is flagged ``companions_not_searched``. Values of the
literature that SIMBAD has not (temperatures, gravities, luminosities and masses of ExoCat-1) are taken over too,
luminosities scaled to the new distance and only while V is the same. Everything else is derived by the relations that
filled the snapshot (:mod:`catalogs.stellar_physics`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.coordinates import ecliptic
from catalogs.nomenclature import designation_key
from catalogs.simbad import Cuts, RefreshError
from catalogs.simbad_answer import Answer, Measurements
from catalogs.simbad_fill import companion, fill, snapshot_medians, spectroscopy
from catalogs.simbad_names import Names, blends, match_snapshot, own_names, row_name
from catalogs.star_flags import parallax_flags, type_flags
from catalogs.star_systems import Adopted, Member, adopt_parallaxes, group_systems
from catalogs.stars import StarTable, star_table
from catalogs.stellar_physics import luminosity_class, spectral_letter

__all__ = ["Assembled", "assemble"]

_KEPT_LETTERS = ("F", "G", "K")
_OTHER_CLASS = "not of class F, G or K"

Row = dict[str, object]


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
    measured = spectroscopy(measurements)
    known = {i: snapshot.row(matched[i]) if matched[i] >= 0 else None for i in kept}
    shown = _shown_names(names, known, kept)
    medians = snapshot_medians(snapshot)
    rows = []
    for i in kept:
        row: Row = {"name": shown[i], **_identity(names[i], known[i])}
        row |= _astrometry(answer, i, adopted[i], shown)
        row |= _light(answer, i)
        flags = fill(row, measured.get(int(answer.oid[i]), {}), known[i], medians)
        flags |= companion(row, answer, i, known[i], shown, listed)
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
    letter = spectral_letter(sp_type)
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
    members = [
        Member(
            float(answer.ra_deg[i]),
            float(answer.dec_deg[i]),
            names[i].hip,
            float(answer.parallax_mas[i]),
            float(answer.parallax_err_mas[i]) if answer.parallax_err_mas[i] > 0.0 else float("nan"),
            float(answer.pm_ra_mas_yr[i]),
            float(answer.pm_dec_mas_yr[i]),
        )
        for i in kept
    ]
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


def _astrometry(answer: Answer, i: int, adopted: Adopted, shown: Mapping[int, str]) -> Row:
    lon, lat = ecliptic(answer.ra_deg[i], answer.dec_deg[i])
    moves = math.isfinite(answer.pm_ra_mas_yr[i] + answer.pm_dec_mas_yr[i])
    rv_known = math.isfinite(answer.rv_km_s[i])
    lent = f"derived:shared with {shown.get(adopted.lender, '')}"
    return {
        "ra_deg": float(answer.ra_deg[i]) % 360.0,
        "dec_deg": float(answer.dec_deg[i]),
        "epoch_yr": 2000.0,
        "pm_ra_mas_yr": float(answer.pm_ra_mas_yr[i]) if moves else 0.0,
        "pm_dec_mas_yr": float(answer.pm_dec_mas_yr[i]) if moves else 0.0,
        "pm_src": "measured" if moves else "assumed:0",
        "parallax_mas": adopted.parallax_mas,
        "parallax_err_mas": adopted.parallax_err_mas,
        "parallax_src": adopted.src or lent,
        "parallax_err_src": adopted.err_src,
        "parallax_own_mas": float(answer.parallax_mas[i]),
        "distance_pc": 1000.0 / adopted.parallax_mas,
        "distance_pc_src": "derived:parallax",
        "rv_km_s": float(answer.rv_km_s[i]) if rv_known else 0.0,
        "rv_km_s_src": "measured" if rv_known else "assumed:0",
        "ecliptic_lon_deg": float(lon),
        "ecliptic_lat_deg": float(lat),
        "ecliptic_src": "derived:position",
    }


def _light(answer: Answer, i: int) -> Row:
    b_v = float(answer.b_mag[i] - answer.v_mag[i])
    return {
        "v_mag": float(answer.v_mag[i]),
        "v_mag_src": "measured",
        "b_v_mag": b_v,
        "b_v_mag_src": "measured" if math.isfinite(b_v) else "missing",
        "sp_type": answer.sp_type[i],
        "spectral_class": spectral_letter(answer.sp_type[i]),
        "luminosity_class": luminosity_class(answer.sp_type[i]),
    }
