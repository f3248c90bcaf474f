"""Targets: catalogue stars with everything that the ETC and the images need of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from catalogs.names import resolve_star
from catalogs.stars import StarTable, load_stars

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Targets", "find_target", "load_targets", "rank_sample", "targets_from_table"]

FloatArray = NDArray[np.float64]
ASSUMED_PA_DEG = 30.0
"""Position angle of a companion that has none in the sources: between an arm of the mask and a diagonal."""


@dataclass(frozen=True)
class Targets:
    """Columns of ``n`` stars as arrays; missing companions are NaN."""

    name: NDArray[np.str_]
    hip: NDArray[np.int64]
    sp_type: NDArray[np.str_]
    ra_deg: FloatArray
    dec_deg: FloatArray
    distance_pc: FloatArray
    v_mag: FloatArray
    teff_k: FloatArray
    log_g: FloatArray
    metallicity: FloatArray
    luminosity_lsun: FloatArray
    companion_separation_arcsec: FloatArray
    companion_pa_deg: FloatArray
    companion_v_mag: FloatArray
    companion_teff_k: FloatArray
    flags: tuple[tuple[str, ...], ...]
    companions: Literal["on", "off"] = "on"

    def __len__(self) -> int:
        return len(self.name)

    def content(self) -> dict[str, Any]:
        """All columns as plain lists, for content hashes (missing numbers as None)."""
        plain: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value = [None if isinstance(cell, float) and math.isnan(cell) else cell for cell in value.tolist()]
            plain[item.name] = value
        return plain

    def select(self, mask: NDArray[Any] | Sequence[int]) -> Targets:
        """Rows where ``mask`` is true, or rows of the given indices in that order."""
        index = np.flatnonzero(mask) if np.asarray(mask).dtype == bool else np.asarray(mask, int)
        chosen: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "flags":
                chosen["flags"] = tuple(value[i] for i in index)
            elif isinstance(value, np.ndarray):
                chosen[item.name] = value[index]
        return replace(self, **chosen)


def targets_from_table(table: StarTable, *, companions: Literal["on", "off"] = "on") -> Targets:
    """Targets of a star table.

    A companion without its own temperature shares the star's (flagged ``companion_colour_assumed``).
    """
    if companions not in ("on", "off"):
        raise InputError("companions", companions, allowed="on, off")

    def number(name: str) -> FloatArray:
        return np.asarray(table.column(name), float)

    def text(name: str) -> NDArray[np.str_]:
        return np.asarray(table.column(name)).astype(str)

    companion_v = number("v_mag") + number("companion_delta_v_mag")
    located = np.isfinite(companion_v) & np.isfinite(number("companion_sep_arcsec"))
    pa = number("companion_pa_deg")
    assumed = located & ~np.isfinite(pa)
    flags = []
    for own, close, has, guessed in zip(
        text("quality_flags"), np.asarray(table.column("close_companion"), bool), located, assumed, strict=True
    ):
        names = [flag for flag in own.split(";") if flag]
        if has:
            names.append("companion_light_on" if companions == "on" else "companion_light_off")
            names.append("companion_colour_assumed")
            if guessed:
                names.append("companion_pa_assumed")
        elif close:
            names.append("companion_light_unknown")
        flags.append(tuple(names))
    return Targets(
        name=text("name"),
        hip=np.asarray(table.column("hip"), np.int64),
        sp_type=text("sp_type"),
        ra_deg=number("ra_deg"),
        dec_deg=number("dec_deg"),
        distance_pc=number("distance_pc"),
        v_mag=number("v_mag"),
        teff_k=number("teff_k"),
        log_g=number("log_g"),
        metallicity=number("metallicity"),
        luminosity_lsun=number("luminosity_lsun"),
        companion_separation_arcsec=number("companion_sep_arcsec"),
        companion_pa_deg=np.where(assumed, ASSUMED_PA_DEG, pa),
        companion_v_mag=companion_v,
        companion_teff_k=number("teff_k"),
        flags=tuple(flags),
        companions=companions,
    )


def rank_sample(
    *,
    v_mag_max: float = 7.0,
    dwarfs_only: bool = False,
    singles_only: bool = False,
    companions: Literal["on", "off"] = "on",
) -> Targets:
    """The stars that a ranking returns.

    By default every FGK star of the snapshot with parallax >= 25 mas and V <= 7, of any luminosity class;
    stars with companions are flagged, never dropped, unless ``singles_only``.
    """
    if not math.isfinite(v_mag_max):
        raise InputError("v_mag_max", v_mag_max, unit="mag", allowed="a finite magnitude")
    table = load_stars()
    keep = np.asarray(table.column("v_mag"), float) <= v_mag_max
    if dwarfs_only:
        keep &= np.isin(np.asarray(table.column("luminosity_class")).astype(str), ("V", "IV-V"))
    if singles_only:
        keep &= ~np.asarray(table.column("close_companion"), bool)
    if not keep.any():
        raise InputError("v_mag_max", v_mag_max, unit="mag", allowed="a magnitude that leaves a star in the sample")
    return targets_from_table(table.select(keep), companions=companions)


def find_target(name: str, *, companions: Literal["on", "off"] = "on") -> tuple[Targets, str]:
    """One star of the snapshot by any name people use, and a note when the name was ambiguous.

    Raises
    ------
    InputError
        If no star has that name; with the nearest suggestions.
    """
    table = load_stars()
    match = resolve_star(name, table)
    return targets_from_table(table.select([match.index]), companions=companions), match.note


def load_targets(source: str = "snapshot", **cuts: Any) -> pd.DataFrame:
    """The target list as a pandas DataFrame, units in column names.

    Parameters
    ----------
    source : str
        ``"snapshot"``, the catalogue that ships with the package.
    **cuts
        ``v_mag_max`` (default 7), ``dwarfs_only``, ``singles_only`` as in `rank_sample`.

    Raises
    ------
    InputError
        For an unknown source or cut.
    """
    import pandas as pd

    if source != "snapshot":
        raise InputError("source", source, allowed="snapshot")
    known = ("v_mag_max", "dwarfs_only", "singles_only", "companions")
    for key in cuts:
        if key not in known:
            raise InputError(key, cuts[key], allowed="no such cut", hint=f"known cuts: {', '.join(known)}")
    targets = rank_sample(**cuts)
    columns = {
        item.name: getattr(targets, item.name) for item in fields(targets) if item.name not in ("flags", "companions")
    }
    return pd.DataFrame(columns | {"flags": ["|".join(flags) for flags in targets.flags]})
