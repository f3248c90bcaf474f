"""Fill temperature, gravity, metallicity, luminosity, radius and mass of each row, and say how.

The relations are those of :mod:`catalogs.stellar_physics`, each checked against the ExoCat-1 values of this same table
(figures in the provenance notes).
"""

from collections.abc import Sequence

import numpy as np

from catalogs import luminosity_from_v
from catalogs.stars import parallax_flags, type_flags
from catalogs.stellar_physics import (
    GRAVITY_SOURCE,
    INFRARED_SOURCE,
    LUMINOSITY_SOURCE,
    RADIUS_SOURCE,
    TEFF_TOLERANCE_K,
    colour_temperature,
    gravity,
    is_giant,
    luminosity_class,
    mass_of,
    nearest_subtype,
    radius_from_luminosity,
    subtype_medians,
    temperatures_disagree,
    usual_gravity,
)
from tools.build_catalogue.builders._star_identity import Identity

_V_TOLERANCE_MAG = 0.15
_UNSATURATED_MAG = 0.05
"""Error of Ks above which 2MASS was saturated."""
_BLENDED_ARCSEC = 5.0
_BLENDED = {"composite", "composite_spectrum", "double_entry", "spectroscopic_binary", "v_conflict"}
#: ExoCat-1's words for its spectroscopic sources.
_SPECTROSCOPY = {"2005ApJS..159..141V": "Valenti & Fischer 2005, ApJS 159, 141", "Gray": "Gray"}


def fill_physics(people: Sequence[Identity]) -> None:
    """Fill the physical columns and the quality flags of every row, in place."""
    for person in people:
        _colours(person)
    expected = _expected_by_type(people)
    for person in people:
        _check_colour(person, expected)
        _flags(person)
        _metallicity(person)
        _temperature(person, expected)
        _luminosity_radius_mass(person)


def _colours(person: Identity) -> None:
    star, values = person.row.star, person.row.values
    values["spectral_class"] = star.sp_type[0]
    values["luminosity_class"] = luminosity_class(star.sp_type)
    values["v_mag"], values["v_mag_src"] = star.v_mag, "measured"
    values["b_v_mag"], values["b_v_mag_src"] = star.b_v_mag, "measured"
    if person.exocat and abs(person.exocat.number("st_vmag") - star.v_mag) > _V_TOLERANCE_MAG:
        person.row.flags.add("v_conflict")


def _expected_by_type(people: Sequence[Identity]) -> dict[tuple[bool, int], tuple[float, float]]:
    """Return the medians of the rows that ExoCat-1 lists without a conflict in V."""
    listed = [person for person in people if person.exocat and not person.row.flags & {"v_conflict"}]
    return subtype_medians(
        [
            (person.row.star.sp_type, person.exocat.number("st_teff"), person.row.star.b_v_mag)
            for person in listed
            if person.exocat
        ]
    )


def _check_colour(person: Identity, table: dict[tuple[bool, int], tuple[float, float]]) -> None:
    values = person.row.values
    teff, b_v = nearest_subtype(person.row.star.sp_type, table)
    found = float(values["b_v_mag"])  # type: ignore[arg-type]
    if np.isfinite(teff) and abs(colour_temperature(found, 0.0)[0] - teff) > 2.0 * TEFF_TOLERANCE_K:
        person.row.flags.add("colour_outlier")
        values["b_v_mag"], values["b_v_mag_src"] = b_v, "derived:median of the spectral subtype in this table"


def _metallicity(person: Identity) -> None:
    values = person.row.values
    found = person.exocat.number("st_metfe") if person.exocat else float("nan")
    known = np.isfinite(found)
    values["metallicity"] = found if known else 0.0
    values["metallicity_src"] = "measured" if known else "assumed:0"


def _temperature(person: Identity, table: dict[tuple[bool, int], tuple[float, float]]) -> None:
    """Fill the temperature: spectroscopy of ExoCat-1, else V-Ks of 2MASS, else B-V; flag what contradicts it."""
    row, values = person.row, person.row.values
    metallicity = float(values["metallicity"])  # type: ignore[arg-type]
    from_colour = colour_temperature(float(values["b_v_mag"]), metallicity)  # type: ignore[arg-type]
    found = [(_infrared(person, metallicity), INFRARED_SOURCE), from_colour]
    expected = nearest_subtype(row.star.sp_type, table)[0]
    method = person.exocat.values["st_teffsrc"] if person.exocat else ""
    if person.exocat and method in _SPECTROSCOPY and "v_conflict" not in row.flags:  # else perhaps of another star
        listed = person.exocat.number("st_teff")
        if np.isfinite(expected) and abs(listed - expected) > max(TEFF_TOLERANCE_K, abs(from_colour[0] - expected)):
            row.flags.add("teff_conflict")
        else:
            found.insert(0, (listed, f"measured:{_SPECTROSCOPY[method]} (ExoCat-1)"))
    adopted, values["teff_k_src"] = next((teff, src) for teff, src in found if np.isfinite(teff))
    values["teff_k"] = adopted
    if temperatures_disagree(adopted, [expected, *(teff for teff, _ in found)]):
        row.flags.add("teff_disagreement")


def infrared_temperature(v_ks_mag: float, metallicity: float) -> float:
    """Return effective temperature (K) of a dwarf or subgiant from V-Ks and [Fe/H], nan outside the relation's range.

    Casagrande et al. 2010, A&A 512, A54, table 4.

    Parameters
    ----------
    v_ks_mag : float
        V - Ks, mag, with Ks of 2MASS, unsaturated and of one star; from 0.78 to 3.15.
    metallicity : float
        [Fe/H], dex.
    """
    x, z = v_ks_mag, metallicity
    if not 0.78 < x < 3.15:
        return float("nan")
    return 5040.0 / (0.5057 + 0.2600 * x - 0.0146 * x**2 - 0.0131 * x * z + 0.0288 * z + 0.0016 * z**2)


def _infrared(person: Identity, metallicity: float) -> float:
    """Return the temperature from V-Ks; nan where Ks is missing, saturated, or of two stars, and for giants."""
    row, exocat = person.row, person.exocat
    if exocat is None or row.flags & _BLENDED or is_giant(row.star.sp_type):
        return float("nan")
    alone = not exocat.number("wds_sep") < _BLENDED_ARCSEC and exocat.values["st_ks2mblend"] == "0"
    sharp = exocat.values["st_kmagsrc"] == "2MASS" and exocat.number("st_ks2merr") < _UNSATURATED_MAG
    return infrared_temperature(exocat.number("st_vmk"), metallicity) if alone and sharp else float("nan")


def _luminosity_radius_mass(person: Identity) -> None:
    row, values, exocat = person.row, person.row.values, person.exocat
    teff = float(values["teff_k"])  # type: ignore[arg-type]
    trusted = exocat is not None and not row.flags & {"v_conflict", "teff_conflict"}
    log_g = exocat.number("st_logg") if exocat and trusted else float("nan")
    light_log_g = log_g if np.isfinite(log_g) else usual_gravity(row.star.sp_type)
    metallicity = float(values["metallicity"])  # type: ignore[arg-type]
    luminosity = luminosity_from_v(row.star.v_mag, 1000.0 / row.parallax_mas, teff, metallicity, light_log_g)
    radius = radius_from_luminosity(luminosity, teff)
    values["luminosity_lsun"], values["luminosity_lsun_src"] = luminosity, LUMINOSITY_SOURCE
    values["radius_rsun"], values["radius_rsun_src"] = (radius, RADIUS_SOURCE)

    mass = exocat.number("st_mass") if exocat and trusted else float("nan")
    mass_src = "derived:ExoCat-1"
    if exocat and np.isfinite(mass) and exocat.values["st_masssrc"] == "2007ApJS..168..297T":
        mass_src = "derived:isochrones (Takeda et al. 2007)"
    elif is_giant(row.star.sp_type) or not np.isfinite(mass):  # ExoCat-1 puts giants on a main-sequence relation
        mass, mass_src = mass_of(row.star.sp_type, luminosity)
    values["mass_msun"], values["mass_msun_src"] = mass, mass_src

    if np.isfinite(log_g):
        values["log_g"], values["log_g_src"] = log_g, "measured"
    else:
        values["log_g"] = gravity(mass, radius)
        values["log_g_src"] = GRAVITY_SOURCE


def _flags(person: Identity) -> None:
    row, star = person.row, person.row.star
    row.flags |= type_flags(star.sp_type, star.object_type, star.simbad_id)
    row.flags |= parallax_flags(row.parallax_mas, row.parallax_err_mas)
    if not row.hip:
        row.flags.add("no_hip")
