"""What SIMBAD's stars are given besides their own astrometry: physical values and companions, each labelled."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from statistics import median

import numpy as np

from catalogs.coordinates import position_angle, separation_arcsec, tangent_offset
from catalogs.simbad_answer import Answer, Measurements
from catalogs.spectral_types import PARAMETERS_SOURCE, stellar_parameters
from catalogs.star_systems import CLOSE_COMPANION_ARCSEC
from catalogs.stars import StarTable
from catalogs.stellar_physics import (
    GRAVITY_SOURCE,
    LUMINOSITY_SOURCE,
    RADIUS_SOURCE,
    TEFF_TOLERANCE_K,
    colour_temperature,
    gravity,
    luminosity_from_v,
    mass_of,
    nearest_subtype,
    radius_from_luminosity,
    subtype_medians,
)

__all__ = ["companion", "fill", "snapshot_medians", "spectroscopy"]

_NEIGHBOUR_ARCSEC = 60.0
_LEAST_SEPARATION_ARCSEC = 0.1
_PARALLAX_TOLERANCE = 0.2
_SAME_V_MAG = 0.05
_BINARY_TYPES = ("**", "SB*", "El*", "EB*")
_TAKEN_OVER = "; from the snapshot"
_COMPANION_COLUMNS = (
    "companion_name",
    "companion_sep_arcsec",
    "companion_pa_deg",
    "companion_epoch_yr",
    "companion_delta_v_mag",
)
_COMPANION_SOURCES = ("companion_src", "companion_pa_src", "companion_delta_v_src")

Row = dict[str, object]
Medians = dict[tuple[bool, int], tuple[float, float]]


def spectroscopy(measurements: Measurements) -> dict[int, dict[str, tuple[float, str]]]:
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


def snapshot_medians(snapshot: StarTable) -> Medians:
    """Return the median (Teff, B-V) of each subtype, of the snapshot's stars with a measured temperature."""
    names = ("sp_type", "teff_k", "b_v_mag", "teff_k_src")
    cells = zip(*(snapshot.column(name).tolist() for name in names), strict=True)
    return subtype_medians((sp_type, teff, b_v) for sp_type, teff, b_v, src in cells if src == "measured")


def fill(
    row: Row,
    measured: Mapping[str, tuple[float, str]],
    known: Mapping[str, object] | None,
    medians: Medians,
) -> set[str]:
    """Fill temperature, gravity, metallicity, luminosity, radius and mass; return the flags."""
    flags: set[str] = set()

    def old(name: str, least: tuple[str, ...]) -> tuple[float, str] | None:
        """Return the snapshot's value where its source is one of the better kinds."""
        if known is None or not any(kind in str(known[f"{name}_src"]) for kind in least):
            return None
        return float(str(known[name])), f"{known[f'{name}_src']}{_TAKEN_OVER}"

    def best(name: str) -> tuple[float, str] | None:
        """Return SIMBAD's median, else the snapshot's value if it comes from the literature."""
        return measured.get(name) or old(name, ("measured", "ExoCat-1"))

    sp_type, b_v = str(row["sp_type"]), float(str(row["b_v_mag"]))
    expected_teff, expected_b_v = nearest_subtype(sp_type, medians)
    row["metallicity"], row["metallicity_src"] = best("metallicity") or (0.0, "assumed:0")
    off = (
        math.isfinite(b_v + expected_teff)
        and abs(colour_temperature(b_v, 0.0)[0] - expected_teff) > 2 * TEFF_TOLERANCE_K
    )
    if off:
        flags.add("colour_outlier")
    if (off or not math.isfinite(b_v)) and math.isfinite(expected_b_v):
        b_v = expected_b_v
        row["b_v_mag"], row["b_v_mag_src"] = b_v, "derived:median of the spectral subtype in the snapshot"
    found = best("teff_k")
    if found is None and math.isfinite(b_v):
        found = colour_temperature(b_v, float(str(row["metallicity"])))
    if found is None:
        found = stellar_parameters(sp_type).teff_k, PARAMETERS_SOURCE
    teff = found[0]
    if math.isfinite(expected_teff) and abs(teff - expected_teff) > TEFF_TOLERANCE_K:
        flags.add("teff_outlier")
    v_mag, distance_pc = float(str(row["v_mag"])), float(str(row["distance_pc"]))
    luminosity, luminosity_src = luminosity_from_v(v_mag, distance_pc, teff), LUMINOSITY_SOURCE
    mass_found = None
    listed = old("luminosity_lsun", ("ExoCat-1",))
    if listed is not None and known is not None and abs(v_mag - float(str(known["v_mag"]))) < _SAME_V_MAG:
        luminosity = listed[0] * (distance_pc / float(str(known["distance_pc"]))) ** 2
        luminosity_src = listed[1]
        mass_found = old("mass_msun", ("ExoCat-1", "Takeda"))
    radius = radius_from_luminosity(luminosity, teff)
    mass, mass_src = mass_found or mass_of(sp_type, luminosity)
    row |= {
        "teff_k": teff,
        "teff_k_src": found[1],
        "luminosity_lsun": luminosity,
        "luminosity_lsun_src": luminosity_src,
        "radius_rsun": radius,
        "radius_rsun_src": RADIUS_SOURCE,
        "mass_msun": mass,
        "mass_msun_src": mass_src,
    }
    row["log_g"], row["log_g_src"] = best("log_g") or (gravity(mass, radius), GRAVITY_SOURCE)
    return flags


def companion(
    row: Row,
    answer: Answer,
    i: int,
    known: Mapping[str, object] | None,
    shown: Mapping[int, str],
    not_stars: Collection[int],
) -> set[str]:
    """Fill the companion columns: the snapshot's, else the neighbour in the answer with most light; return the flags.

    `not_stars` are the objects that are blends of others.

    The neighbour's position is good to about an arcsecond, and orbital motion is not modelled, as in the snapshot.
    """
    if known is not None:
        row |= {name: known[name] for name in ("close_companion", *_COMPANION_COLUMNS)}
        row |= {
            name: known[name] if known[name] == "missing" else f"{known[name]}{_TAKEN_OVER}"
            for name in _COMPANION_SOURCES
        }
        return set()
    sep = separation_arcsec(answer.ra_deg[i], answer.dec_deg[i], answer.ra_deg, answer.dec_deg)
    near = (sep > _LEAST_SEPARATION_ARCSEC) & (sep < _NEIGHBOUR_ARCSEC)
    near &= np.abs(answer.parallax_mas - answer.parallax_mas[i]) < _PARALLAX_TOLERANCE * answer.parallax_mas[i]
    near[list(not_stars)] = False
    candidates = np.flatnonzero(near)
    row |= dict.fromkeys(_COMPANION_COLUMNS, float("nan")) | {"companion_name": ""}
    row |= dict.fromkeys(_COMPANION_SOURCES, "missing")
    row["close_companion"] = answer.object_type[i] in _BINARY_TYPES
    if candidates.size:
        light = 10.0 ** (-0.4 * answer.v_mag[candidates]) / sep[candidates] ** 2
        j = int(candidates[np.argmax(light)])
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
        row["close_companion"] = bool(row["close_companion"]) or float(sep[j]) < CLOSE_COMPANION_ARCSEC
    return {"companions_not_searched"}
