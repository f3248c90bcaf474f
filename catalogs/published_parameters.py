"""Published temperatures of single stars, laid over a star table: ``stellar_parameters.csv``, kept by hand.

One row is what one publication says of one star: temperature, perhaps gravity, metallicity and limb-darkened angular
diameter, with the publication, where it was read and when. A star with rows takes the median of their temperatures, to
which the table's own value counts where it is measured too, and the medians of their gravities and metallicities. Where
a diameter was measured, luminosity is that of diameter and temperature of the same row, which is the bolometric flux;
elsewhere that of V, and the radius follows.

Rows are interferometry and benchmarks, spectroscopy beside them, and spectroscopy of stars that else have a colour
only; a star without rows has not been found there. A mean or median of the PASTEL catalogue may contain other rows of
its star. The diameters of psi Dra A, HD 16160 and 5 Ser and the H-band spectrum of HD 16160 (Olander et al. 2025,
4607 K) are left out: they contradict colour and spectroscopy by over 200 K.
"""

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from catalogs import stellar_physics as physics
from catalogs.shipped import shipped_digest, shipped_objects
from catalogs.star_columns import COLUMNS
from cpic_core import NDArray

_FILE = "stellar_parameters.csv"
_DECIMALS = {column.name: column.decimals for column in COLUMNS}
_READ = ["sp_type", "v_mag", "b_v_mag", "distance_pc", "teff_k", "teff_k_src", "log_g", "log_g_src", "metallicity"]
_READ += ["mass_msun", "mass_msun_src", "quality_flags"]
_DIAMETER_SOURCE = "derived:angular diameter and Teff of the same publication"


@dataclass(frozen=True)
class PublishedParameters:
    """The parameters that one publication gives of one star; nan for those that it does not give.

    Parameters
    ----------
    star : str
        Name as in the star table.
    teff_k, teff_err_k : float
        Effective temperature and its error, K.
    log_g, metallicity : float
        log10 of the surface gravity (cm/s2) and [Fe/H], dex.
    angular_diameter_mas : float
        Limb-darkened angular diameter, mas, from which the temperature follows.
    reference, read_in : str
        Publication, and the public copy in which the numbers were read.
    date : str
        When they were read, YYYY-MM-DD.
    """

    star: str
    teff_k: float
    teff_err_k: float
    log_g: float
    metallicity: float
    angular_diameter_mas: float
    reference: str
    read_in: str
    date: str


@functools.cache
def published_parameters() -> Mapping[str, tuple[PublishedParameters, ...]]:
    """Return the rows of ``stellar_parameters.csv`` by star, in the order of the file. It is read once per process."""
    found: dict[str, list[PublishedParameters]] = {}
    for row in shipped_objects(_FILE, PublishedParameters):
        found.setdefault(row.star, []).append(row)
    return {star: tuple(items) for star, items in found.items()}


@functools.cache
def parameters_vintage() -> str:
    """Return in one line what is laid over: the number of stars, the file, and the first digits of its checksum."""
    return f"temperatures of {len(published_parameters())} stars from {_FILE} {shipped_digest(_FILE)}"


def updated_columns(columns: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """Return the columns of a star table that change where its stars have published parameters.

    Parameters
    ----------
    columns : mapping of str to ndarray
        All columns of the table, by name. Stars without published parameters keep what they have.
    """
    medians = physics.measured_medians(columns)
    changed: dict[str, list[Any]] = {}
    for index, star in enumerate(columns["name"].tolist()):
        if star in published_parameters():
            old = {name: columns[name][index].item() for name in _READ}
            of_type_k = physics.nearest_subtype(old["sp_type"], medians)[0]
            for name, value in _row(old, published_parameters()[star], of_type_k).items():
                shown = round(value, _DECIMALS[name]) if isinstance(value, float) else value
                changed.setdefault(name, columns[name].tolist())[index] = shown
    return {name: np.array(cells) for name, cells in changed.items()}


def _row(old: Mapping[str, Any], rows: tuple[PublishedParameters, ...], of_type_k: float) -> dict[str, Any]:
    """Return the cells of one star that change; `of_type_k` is the temperature that stars of its type have."""
    own = [old["teff_k"]] if old["teff_k_src"].startswith("measured") else []
    temperatures = [row.teff_k for row in rows] + own
    teff_k = median(temperatures)
    new = dict(old) | {"teff_k": teff_k, "teff_k_src": _source(len(temperatures), rows)}
    for name in ("log_g", "metallicity"):
        if given := [row for row in rows if math.isfinite(getattr(row, name))]:
            new |= {name: median(getattr(row, name) for row in given), f"{name}_src": _source(len(given), given)}
    fluxes = [
        physics.luminosity_from_diameter(row.angular_diameter_mas, old["distance_pc"], row.teff_k)
        for row in rows
        if math.isfinite(row.angular_diameter_mas)
    ]
    derived = (physics.GRAVITY_SOURCE, physics.MASS_SOURCE)
    known = {name: (new[name], src) for name in ("log_g", "mass_msun") if (src := new[f"{name}_src"]) not in derived}
    if fluxes:
        known["luminosity_lsun"] = median(fluxes), _DIAMETER_SOURCE
    new |= physics.bulk_columns(new, known)
    from_colour = physics.colour_temperature(old["b_v_mag"], new["metallicity"])[0]
    disagrees = physics.temperatures_disagree(teff_k, [*temperatures, from_colour, of_type_k])
    flags = set(old["quality_flags"].split(";")) - {"teff_disagreement", ""}
    new["quality_flags"] = ";".join(sorted(flags | ({"teff_disagreement"} if disagrees else set())))
    return {name: value for name, value in new.items() if value != old.get(name)}


def _source(number: int, rows: Iterable[PublishedParameters]) -> str:
    """Return the words of a ``*_src`` column for the median of so many values."""
    return f"measured:median of {number} published values ({_FILE}: {'; '.join(row.reference for row in rows)})"
