"""Scenes from a table of stars: pandas, astropy or the star catalogue, one star a row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeGuard

import numpy as np

from simulator.config.base import validate
from simulator.config.bodies import Planet
from simulator.config.keys import required, to_unit
from simulator.config.scene import Scene

__all__ = ["COMPANION_LIMIT_ARCSEC", "StarColumns", "is_table", "scenes_from_table"]

COMPANION_LIMIT_ARCSEC = 60.0
"""Farthest companion of a catalogue star that is put into its scene."""

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
    "v_mag": "companion_v_mag",
    "teff_k": "companion_teff_k",
    "separation_arcsec": "companion_separation_arcsec",
    "pa_deg": "companion_pa_deg",
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
        ``companion_separation_arcsec``, ``companion_pa_deg``, ``companion_v_mag``, ``companion_teff_k`` (companions
        within 60 arcsec join the scene). Other columns are passed over; a cell without a value (nan, masked) counts
        as not given.
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
    star = {key: _cells(table, found, key) for key, spellings in _STAR.items()
            if (found := next((name for name in spellings if name in names), None))}  # fmt: skip
    if "name" not in names:
        raise required("table.name", "a column of names")
    if "v_mag" not in star:
        raise required("table.v_mag", "a column of Johnson V magnitudes")
    companion = {key: _cells(table, name, key) for key, name in _COMPANION.items() if name in names}
    scenes = []
    for row, name in enumerate(_cells(table, "name", "name")):
        body = {key: cells[row] for key, cells in star.items() if cells[row] is not None}
        if "teff_k" in body:
            body.pop("spectral_type", None)
        tree: dict[str, Any] = {"name": name, "cstar": body, "planets": () if planet is None else (planet,)}
        near = {key: cells[row] for key, cells in companion.items() if cells[row] is not None}
        if len(near) == len(_COMPANION) and near["separation_arcsec"] <= COMPANION_LIMIT_ARCSEC:
            shared = {key: body[key] for key in ("log_g", "metallicity") if key in body}
            tree["stars"] = ({"name": "companion"} | near | shared,)
        scenes.append(validate(Scene, tree, where=f"table.{row}"))
    return tuple(scenes)


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
