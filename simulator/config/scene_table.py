"""Scenes from a table of stars: pandas, astropy or the star catalogue, one star a row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeGuard

import numpy as np

from simulator.config.base import validate
from simulator.config.bodies import Planet
from simulator.config.keys import required, to_unit
from simulator.config.scene import Scene

__all__ = [
    "ASSUMED_PA_DEG",
    "COMPANION_LIMIT_ARCSEC",
    "StarColumns",
    "companion_of",
    "is_table",
    "scenes_from_table",
]

COMPANION_LIMIT_ARCSEC = 60.0
"""Farthest companion of a catalogue star that is put into its scene."""

ASSUMED_PA_DEG = 30.0
"""Position angle of a companion where none is known (A): between an arm of the mask and a diagonal."""

_STAR = {
    "v_mag": ("v_mag", "magnitude"),
    "teff_k": ("teff_k", "teff"),
    "log_g": ("log_g", "logg"),
    "metallicity": ("metallicity",),
    "ra_deg": ("ra_deg", "ra"),
    "dec_deg": ("dec_deg", "dec"),
    "distance_pc": ("distance_pc", "distance"),
    "luminosity_lsun": ("luminosity_lsun",),
    "spectral_type": ("spectral_type", "sp_type"),
}
_COMPANION = {
    "separation_arcsec": ("companion_separation_arcsec", "companion_sep_arcsec"),
    "pa_deg": ("companion_pa_deg",),
    "v_mag": ("companion_v_mag",),
    "delta_v_mag": ("companion_delta_v_mag",),
    "teff_k": ("companion_teff_k",),
}


class StarColumns(Protocol):
    """A table with named columns."""

    @property
    def columns(self) -> Any:
        """Names of the columns, or a mapping of them."""


def is_table(thing: Any) -> TypeGuard[StarColumns]:
    """Whether something has named columns as a table of pandas, astropy or `catalogs.stars` has."""
    return hasattr(thing, "columns") and hasattr(thing, "__len__") and not isinstance(thing, Mapping)


def scenes_from_table(table: StarColumns, *, planet: Planet | Mapping[str, Any] | None = None) -> tuple[Scene, ...]:
    """One scene for each star of a table.

    Parameters
    ----------
    table : pandas.DataFrame, astropy Table or StarTable
        Columns ``name`` and ``v_mag``, and ``teff_k`` or ``sp_type``, which serves where the temperature is missing. Of
        use are ``log_g``, ``metallicity``, ``ra_deg``, ``dec_deg``, ``distance_pc``, ``luminosity_lsun``, and
        ``companion_separation_arcsec``, ``companion_pa_deg``, ``companion_v_mag`` (or ``companion_delta_v_mag``),
        ``companion_teff_k``: companions within 60 arcsec join the scene, see `companion_of`. Other columns are passed
        over; a cell without a value (nan, masked) counts as not given.
    planet : Planet or mapping, optional
        The same planet for every star.

    Returns
    -------
    tuple of Scene
        In the order of the rows.

    Raises
    ------
    InputError
        For a missing column or the first bad row, by its number.
    """
    names = _names(table)
    star, companion = _found(table, names, _STAR), _found(table, names, _COMPANION)
    if "name" not in names:
        raise required("table.name", "a column of names")
    if "v_mag" not in star:
        raise required("table.v_mag", "a column of Johnson V magnitudes")
    scenes = []
    for row, name in enumerate(_cells(table, "name", "name")):
        body = {key: cells[row] for key, cells in star.items() if cells[row] is not None}
        if "teff_k" in body:
            body.pop("spectral_type", None)
        tree: dict[str, Any] = {"name": name, "cstar": body, "planets": () if planet is None else (planet,)}
        near = {key: cells[row] for key, cells in companion.items()}
        tree["stars"] = companion_of(body, **near)
        scenes.append(validate(Scene, tree, where=f"table.{row}"))
    return tuple(scenes)


def companion_of(
    star: Mapping[str, Any],
    *,
    separation_arcsec: float | None = None,
    pa_deg: float | None = None,
    v_mag: float | None = None,
    delta_v_mag: float | None = None,
    teff_k: float | None = None,
) -> tuple[dict[str, Any], ...]:
    """Known companion of a star as another star of its scene; empty where it is too far or its light is not known.

    Parameters
    ----------
    star : mapping
        Keys of `SceneStar`: what the companion shares where it has no temperature of its own.
    separation_arcsec, pa_deg : float, optional
        Place; an unknown position angle is taken as 30 degrees, which the name says.
    v_mag, delta_v_mag : float, optional
        Its magnitude, or how much fainter than the star it is.
    teff_k : float, optional
        Its temperature.
    """
    if v_mag is None and delta_v_mag is not None:
        v_mag = star["v_mag"] + delta_v_mag
    if separation_arcsec is None or v_mag is None or separation_arcsec > COMPANION_LIMIT_ARCSEC:
        return ()
    shared = {key: star[key] for key in ("teff_k", "log_g", "metallicity", "spectral_type") if key in star}
    if teff_k is not None:
        shared = {key: shared[key] for key in ("log_g", "metallicity") if key in shared} | {"teff_k": teff_k}
    name = "companion" if pa_deg is not None else "companion, position angle assumed"
    pa = ASSUMED_PA_DEG if pa_deg is None else pa_deg
    return ({"name": name, "v_mag": v_mag, "separation_arcsec": separation_arcsec, "pa_deg": pa} | shared,)


def _found(table: StarColumns, names: tuple[str, ...], wanted: Mapping[str, tuple[str, ...]]) -> dict[str, list[Any]]:
    """Cells of the columns that there are, by key."""
    chosen = {key: next((name for name in spellings if name in names), None) for key, spellings in wanted.items()}
    return {key: _cells(table, name, key) for key, name in chosen.items() if name is not None}


def _names(table: StarColumns) -> tuple[str, ...]:
    return tuple(str(name) for name in table.columns)


def _cells(table: Any, name: str, key: str) -> list[Any]:
    """Cells of a column in the unit of the key, None where there is no value."""
    column = table.column(name) if hasattr(table, "column") else table[name]
    if hasattr(column, "isna"):
        column = column.astype(object).where(~column.isna(), None)
    values = to_unit(key, column)
    cells = values.tolist() if hasattr(values, "tolist") else list(values)
    return [None if _absent(cell) else cell for cell in cells]


def _absent(cell: Any) -> bool:
    return cell is None or cell == "" or (isinstance(cell, float) and bool(np.isnan(cell)))
