"""Fill temperature, gravity, metallicity, luminosity, radius and mass of each row, and say how.

Relations, each checked against the ExoCat-1 values of this same table (figures in the provenance notes):

- Teff from B-V and [Fe/H]: Casagrande et al. 2010, A&A 512, A54, table 4, for 0.18 < B-V < 1.29; outside, the
  black-body relation of Ballesteros 2012, EPL 97, 34008. Made for dwarfs and subgiants, used for giants too.
- Bolometric correction from Teff: Flower 1996, ApJ 469, 355, coefficients as corrected by Torres 2010, AJ 140, 1158,
  with M_bol,sun = 4.73, the value that belongs to them.
- Mass of dwarfs and subgiants from luminosity: Eker et al. 2018, MNRAS 479, 5491. Giants: 1.5 Msun assumed.
- log g = 4.438 + log M - 2 log R (solar units), R from L and Teff with Teff,sun = 5772 K.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from statistics import median

import numpy as np

from catalogs.builders._star_identity import Identity

__all__ = [
    "bolometric_correction",
    "colour_temperature",
    "fill_physics",
    "luminosity_class",
    "mass_from_luminosity",
    "spectral_subtype",
]

_M_BOL_SUN = 4.73
_TEFF_SUN_K = 5772.0
_LOG_G_SUN = 4.438
_GIANT_MASS_MSUN = 1.5
_TEFF_TOLERANCE_K = 600.0
_V_TOLERANCE_MAG = 0.15
_NEAR_SUBTYPES = 2.0
_CLASSES = re.compile(r"(III|II|IV|I|V)(?:ab|a|b)?(?:\s*[-/]\s*(III|II|IV|I|V))?")
_GIANTS = ("III", "II", "I", "III-IV", "II-III")
_VARIABLE_TYPES = frozenset(
    (
        "V*",
        "V*?",
        "BY*",
        "RS*",
        "dS*",
        "gD*",
        "Fl*",
        "Pu*",
        "TT*",
        "BS*",
        "a2*",
        "Ce*",
        "El*",
        "Ro*",
        "WU*",
        "Al*",
    )
)
_FLOWER_COOL = (-0.190537291496456e05, 0.155144866764412e05, -0.421278819301717e04, 0.381476328422343e03)
_FLOWER_WARM = (
    -0.370510203809015e05,
    0.385672629965804e05,
    -0.150651486316025e05,
    0.261724637119416e04,
    -0.170623810323864e03,
)
_FLOWER_HOT = (
    -0.118115450538963e06,
    0.137145973583929e06,
    -0.636233812100225e05,
    0.147412923562646e05,
    -0.170587278406872e04,
    0.788731721804990e02,
)


def luminosity_class(sp_type: str) -> str:
    """Return the luminosity class of the first component of a spectral type, ``""`` if it has none."""
    found = _CLASSES.search(sp_type[1:])
    if not found:
        return ""
    return found[1] if found[2] in (None, found[1]) else f"{found[1]}-{found[2]}"


def spectral_subtype(sp_type: str) -> float:
    """Return the position in the sequence F0 = 0, G0 = 10, K0 = 20, nan without a digit."""
    found = re.match(r"([FGK])(\d(?:\.\d)?)", sp_type)
    return 10.0 * "FGK".index(found[1]) + float(found[2]) if found else float("nan")


def colour_temperature(b_v_mag: float, metallicity: float) -> tuple[float, str]:
    """Return effective temperature from B-V and [Fe/H], and the name of the relation used."""
    x, z = b_v_mag, metallicity
    if 0.18 < x < 1.29:
        theta = 0.5665 + 0.4809 * x - 0.0060 * x**2 - 0.0613 * x * z - 0.0042 * z - 0.0055 * z**2
        return 5040.0 / theta, "derived:B-V (Casagrande et al. 2010)"
    teff = 4600.0 * (1.0 / (0.92 * x + 1.7) + 1.0 / (0.92 * x + 0.62))
    return teff, "derived:B-V (Ballesteros 2012)"


def bolometric_correction(teff_k: float) -> float:
    """Return BC_V (mag) of Flower 1996 as corrected by Torres 2010."""
    x = float(np.log10(teff_k))
    series = _FLOWER_COOL if x < 3.70 else _FLOWER_WARM if x < 3.90 else _FLOWER_HOT
    return sum(c * x**n for n, c in enumerate(series))


def mass_from_luminosity(luminosity_lsun: float) -> float:
    """Return main-sequence mass (Msun), Eker et al. 2018, from 0.45 to 2.4 Msun."""
    x = float(np.log10(luminosity_lsun))
    if x < 4.572 * np.log10(0.72) - 0.102:
        return float(10.0 ** ((x + 0.102) / 4.572))
    if x < 5.743 * np.log10(1.05) - 0.007:
        return float(10.0 ** ((x + 0.007) / 5.743))
    return float(10.0 ** ((x - 0.010) / 4.329))


def fill_physics(people: Sequence[Identity]) -> None:
    """Fill the physical columns and the quality flags of every row, in place."""
    for person in people:
        _colours(person)
    expected = _expected_by_type(people)
    for person in people:
        _check_colour(person, expected)
        _metallicity(person)
        _temperature(person, expected)
        _luminosity_radius_mass(person)
        _flags(person)


def _colours(person: Identity) -> None:
    star, values = person.row.star, person.row.values
    values["spectral_class"] = star.sp_type[0]
    values["luminosity_class"] = luminosity_class(star.sp_type)
    values["v_mag"], values["v_mag_src"] = star.v_mag, "measured"
    values["b_v_mag"], values["b_v_mag_src"] = star.b_v_mag, "measured"
    if person.exocat and abs(person.exocat.number("st_vmag") - star.v_mag) > _V_TOLERANCE_MAG:
        person.row.flags.add("v_conflict")


def _expected_by_type(people: Sequence[Identity]) -> dict[tuple[bool, int], tuple[float, float]]:
    """Return median (Teff, B-V) of ExoCat rows by (giant scale, subtype), subtypes without three stars left out."""
    samples: dict[tuple[bool, int], list[tuple[float, float]]] = {}
    for person in people:
        subtype = spectral_subtype(person.row.star.sp_type)
        if person.exocat and np.isfinite(subtype) and not person.row.flags & {"v_conflict"}:
            teff = person.exocat.number("st_teff")
            if np.isfinite(teff):
                key = (_has_giant_scale(person), int(subtype))
                samples.setdefault(key, []).append((teff, person.row.star.b_v_mag))
    return {
        key: (median(t for t, _ in pairs), median(c for _, c in pairs))
        for key, pairs in samples.items()
        if len(pairs) >= 3
    }


def _expected(person: Identity, table: dict[tuple[bool, int], tuple[float, float]]) -> tuple[float, float]:
    """Return (Teff, B-V) of the nearest tabulated subtype of the same kind, nan if none is within two subtypes."""
    subtype = spectral_subtype(person.row.star.sp_type)
    keys = [key for key in table if key[0] == _has_giant_scale(person) and abs(key[1] - subtype) <= _NEAR_SUBTYPES]
    return table[min(keys, key=lambda key: (abs(key[1] - subtype), key[1]))] if keys else (float("nan"), float("nan"))


def _has_giant_scale(person: Identity) -> bool:
    """Tell whether the type follows the giants' temperature scale; F giants share the dwarfs'."""
    return _is_giant(person) and person.row.star.sp_type[0] != "F"


def _is_giant(person: Identity) -> bool:
    return luminosity_class(person.row.star.sp_type) in _GIANTS


def _check_colour(person: Identity, table: dict[tuple[bool, int], tuple[float, float]]) -> None:
    values = person.row.values
    teff, b_v = _expected(person, table)
    found = float(values["b_v_mag"])  # type: ignore[arg-type]
    if np.isfinite(teff) and abs(colour_temperature(found, 0.0)[0] - teff) > 2.0 * _TEFF_TOLERANCE_K:
        person.row.flags.add("colour_outlier")
        values["b_v_mag"], values["b_v_mag_src"] = b_v, "derived:median of the spectral subtype in this table"


def _metallicity(person: Identity) -> None:
    values = person.row.values
    found = person.exocat.number("st_metfe") if person.exocat else float("nan")
    known = np.isfinite(found)
    values["metallicity"] = found if known else 0.0
    values["metallicity_src"] = "measured" if known else "assumed:0"


def _temperature(person: Identity, table: dict[tuple[bool, int], tuple[float, float]]) -> None:
    values = person.row.values
    teff, src = colour_temperature(float(values["b_v_mag"]), float(values["metallicity"]))  # type: ignore[arg-type]
    listed = person.exocat.number("st_teff") if person.exocat else float("nan")
    expected = _expected(person, table)[0]
    if person.exocat and np.isfinite(listed):
        if np.isfinite(expected) and abs(listed - expected) > max(_TEFF_TOLERANCE_K, abs(teff - expected)):
            person.row.flags.add("teff_conflict")
        else:
            method = person.exocat.values["st_teffsrc"]
            spectroscopic = method not in ("V-K", "B-V", "")
            teff, src = listed, "measured" if spectroscopic else f"derived:{method or 'unstated'} (ExoCat-1)"
    if np.isfinite(expected) and abs(teff - expected) > _TEFF_TOLERANCE_K:
        person.row.flags.add("teff_outlier")
    values["teff_k"], values["teff_k_src"] = teff, src


def _luminosity_radius_mass(person: Identity) -> None:
    row, values, exocat = person.row, person.row.values, person.exocat
    teff = float(values["teff_k"])  # type: ignore[arg-type]
    distance = 1000.0 / row.parallax_mas
    trusted = exocat is not None and not row.flags & {"v_conflict", "teff_conflict"}
    listed = exocat.number("st_lbol") if exocat and trusted else float("nan")
    if exocat and np.isfinite(listed) and listed > 0.0:
        luminosity = listed * (distance / exocat.number("st_dist")) ** 2
        src = f"derived:{exocat.values['st_lbolsrc'] or 'unstated'} (ExoCat-1), scaled to distance_pc"
    else:
        m_bol = row.star.v_mag - 5.0 * np.log10(distance / 10.0) + bolometric_correction(teff)
        luminosity = 10.0 ** (-0.4 * (m_bol - _M_BOL_SUN))
        src = "derived:V, BC (Flower 1996; Torres 2010)"
    radius = np.sqrt(luminosity) * (_TEFF_SUN_K / teff) ** 2
    values["luminosity_lsun"], values["luminosity_lsun_src"] = luminosity, src
    values["radius_rsun"], values["radius_rsun_src"] = (
        radius,
        "derived:luminosity and Teff (Stefan-Boltzmann)",
    )

    mass = exocat.number("st_mass") if exocat and trusted else float("nan")
    mass_src = "derived:ExoCat-1"
    if exocat and np.isfinite(mass) and exocat.values["st_masssrc"] == "2007ApJS..168..297T":
        mass_src = "derived:isochrones (Takeda et al. 2007)"
    elif _is_giant(person):  # ExoCat-1 puts giants on a main-sequence relation
        mass, mass_src = _GIANT_MASS_MSUN, f"assumed:{_GIANT_MASS_MSUN} Msun, giant"
    elif not np.isfinite(mass):
        mass, mass_src = mass_from_luminosity(luminosity), "derived:luminosity (Eker et al. 2018)"
    values["mass_msun"], values["mass_msun_src"] = mass, mass_src

    log_g = exocat.number("st_logg") if exocat and trusted else float("nan")
    if np.isfinite(log_g):
        values["log_g"], values["log_g_src"] = log_g, "measured"
    else:
        values["log_g"] = _LOG_G_SUN + np.log10(mass) - 2.0 * np.log10(radius)
        values["log_g_src"] = "derived:mass and radius"


def _flags(person: Identity) -> None:
    row, flags = person.row, person.row.flags
    star = row.star
    checks = {
        "giant": _is_giant(person),
        "no_class": not luminosity_class(star.sp_type),
        "composite_spectrum": "+" in star.sp_type[1:] and not re.search(r"\+\d", star.sp_type),
        "peculiar": bool(re.search(r"p|m", star.sp_type[1:])),
        "variable": star.object_type in _VARIABLE_TYPES or star.simbad_id.startswith("V*"),
        "spectroscopic_binary": star.object_type in ("SB*", "El*", "WU*"),
        "double_entry": star.object_type == "**",
        "no_hip": not row.hip,
        "parallax_unknown_error": not np.isfinite(row.parallax_err_mas),
        "low_parallax_snr": bool(row.parallax_mas / row.parallax_err_mas < 50.0),
    }
    flags.update(name for name, applies in checks.items() if applies)
