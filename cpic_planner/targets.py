"""Targets: catalogue stars with everything that the ETC and the images need of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from catalogs import POSITION_ERROR, Catalogue, StarTable, open_catalogue, resolve_star, stability_limit, stars_at
from cpic_core import BoolArray, FloatArray, InputError, IntArray, NDArray, Record, check_flag, check_number, check_word
from simulator.config import Scene, checked_utc, julian_year, load_instrument

if TYPE_CHECKING:
    import pandas as pd


CatalogSource = Catalogue | str | Path
_NUMBERS = ("ra_deg", "dec_deg", "distance_pc", "v_mag", "teff_k", "log_g", "metallicity", "luminosity_lsun")
OLD_YR = 10.0
"""A companion without an orbit has an old place where it was seen longer ago, or nobody says when."""


# Places are turned to a date: the last digits are the processor's, and would make another question of the same one.
_DIGITS = {"ra_deg": 6, "dec_deg": 6, "companion_separation_arcsec": 4, "companion_pa_deg": 4}


class Targets(Record, eq=False):
    """Columns of ``n`` stars as arrays, at one date; missing companions and unknown position angles are NaN.

    ``roll_deg`` is the roll of the telescope at which they are observed, one for all or one each. A target from a
    ``scene`` has its light, and that of all other stars, from there: any spectrum, any number of them. ``hd`` and
    ``gj`` are further names, blank where a star has none, which decide nothing.
    """

    name: NDArray[np.str_]
    hip: IntArray
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
    companion_position_error_arcsec: FloatArray
    companion_v_mag: FloatArray
    companion_teff_k: FloatArray
    flags: tuple[tuple[str, ...], ...]
    companions: Literal["on", "off"] = "on"
    roll_deg: float | FloatArray = 0.0
    date_utc: str = ""
    scene: Scene | None = None
    hd: NDArray[np.str_] | None = None
    gj: NDArray[np.str_] | None = None

    def __len__(self) -> int:
        return len(self.name)

    def content(self) -> dict[str, Any]:
        """Return all columns as plain lists, for content hashes (missing numbers as None, places rounded)."""
        plain: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name in ("hd", "gj"):
                continue
            if isinstance(value, np.ndarray):
                value = value.round(_DIGITS[item.name]) if item.name in _DIGITS else value
                value = [None if isinstance(cell, float) and math.isnan(cell) else cell for cell in value.tolist()]
            plain[item.name] = value.model_dump(mode="json") if isinstance(value, Scene) else value
        return plain

    @classmethod
    def joined(cls, parts: Sequence[Targets]) -> Targets:
        """Return the rows of several targets, one after the other."""
        if len(parts) == 1:
            return parts[0]
        joined: dict[str, Any] = {}
        for item in fields(cls):
            values = [getattr(part, item.name) for part in parts]
            if item.name == "flags":
                joined["flags"] = tuple(flags for value in values for flags in value)
            elif isinstance(values[0], np.ndarray):
                joined[item.name] = np.concatenate(values)
        return replace(parts[0], **joined)

    @classmethod
    def distinct(cls, parts: Sequence[Targets]) -> tuple[Targets, list[IntArray]]:
        """Return rows of several targets of one date, equal ones once, and where those of each part are among them."""
        every = cls.joined(parts)
        columns = [cells for cells in every.content().values() if isinstance(cells, list | tuple)]
        number: dict[tuple[Any, ...], int] = {}
        where = np.array([number.setdefault(row, len(number)) for row in zip(*columns, strict=True)], np.int64)
        _, first = np.unique(where, return_index=True)
        return every.select(first), np.split(where, np.cumsum([len(part) for part in parts])[:-1])

    def select(self, mask: NDArray[Any] | Sequence[int]) -> Targets:
        """Return the rows where ``mask`` is true, or rows of the given indices in that order."""
        index = np.flatnonzero(mask) if np.asarray(mask).dtype == bool else np.asarray(mask, int)
        chosen: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "flags":
                chosen["flags"] = tuple(value[i] for i in index)
            elif isinstance(value, np.ndarray):
                chosen[item.name] = value[index]
        return replace(self, **chosen)


def targets_from_table(
    table: StarTable,
    *,
    companions: Literal["on", "off"] = "on",
    date_utc: str | None = None,
    orbits: bool = True,
    apart: bool = False,
) -> Targets:
    """Return the targets of a star table, where they and their companions stand at a date.

    A companion without its own temperature shares the star's (flagged ``companion_colour_assumed``).

    Parameters
    ----------
    table : StarTable
    companions : {"on", "off"}, optional
        ``on``: light of known stellar companions counts; ``off``: it is left out.
    date_utc : str, optional
        UTC; by default the start of the mission of the shipped instrument.
    orbits : bool, optional
        Whether companions follow their orbits.
    apart : bool, optional
        Whether each star is asked about alone, as of `catalogs.stars_at`.

    Raises
    ------
    InputError
        For a text that is no date.
    """
    utc = checked_utc("date_utc", load_instrument().mission.start_utc if date_utc is None else date_utc)
    table = stars_at(table, julian_year(utc), orbits=orbits, apart=apart)
    check_word("companions", companions, ("on", "off"))

    def number(name: str) -> FloatArray:
        return np.asarray(table.column(name), float)

    def text(name: str) -> NDArray[np.str_]:
        return np.asarray(table.column(name)).astype(str)

    companion_v = number("v_mag") + number("companion_delta_v_mag")
    located = np.isfinite(companion_v) & np.isfinite(number("companion_sep_arcsec"))
    pa = number("companion_pa_deg")
    age_yr = julian_year(utc) - number("companion_epoch_yr")
    columns: dict[str, Any] = {name: number(name) for name in _NUMBERS}
    columns |= {name: text(name) for name in ("sp_type", "hd", "gj")}
    flags, close_companion = [], np.asarray(table.column("close_companion"), bool)
    rows = zip(
        text("name").tolist(),
        text("quality_flags").tolist(),
        close_companion.tolist(),
        located.tolist(),
        np.isfinite(pa).tolist(),
        (age_yr <= OLD_YR).tolist(),
        strict=True,
    )
    for star, own, close, has, has_angle, recent in rows:
        names = [flag for flag in own.split(";") if flag]
        limit = stability_limit(star)
        if limit is not None and not limit.within_fit:
            names.append("stability_extrapolated")
        if has:
            names.append("companion_light_on" if companions == "on" else "companion_light_off")
            names.append("companion_colour_assumed")
            if not has_angle:
                names.append("companion_pa_unknown")
            if not recent:
                names.append("companion_position_old")
        elif close:
            names.append("companion_light_unknown")
        flags.append(tuple(names))
    return Targets(
        name=text("name"),
        hip=np.asarray(table.column("hip"), np.int64),
        **columns,
        companion_separation_arcsec=number("companion_sep_arcsec"),
        companion_pa_deg=pa,
        companion_position_error_arcsec=np.where(located, number(POSITION_ERROR), np.nan),
        companion_v_mag=companion_v,
        companion_teff_k=number("teff_k"),
        flags=tuple(flags),
        companions=companions,
        roll_deg=0.0,
        date_utc=utc,
    )


def as_catalogue(source: CatalogSource) -> Catalogue:
    """Return the catalogue itself, or what `catalogs.catalogue.open_catalogue` reads."""
    return source if isinstance(source, Catalogue) else open_catalogue(source)


def rank_sample(
    *,
    catalog: CatalogSource = "snapshot",
    v_mag_max: float | None = None,
    dwarfs_only: bool = False,
    singles_only: bool = False,
    companions: Literal["on", "off"] = "on",
    date_utc: str | None = None,
) -> Targets:
    """Return the stars that a ranking returns.

    By default every FGK star of the snapshot with parallax >= 25 mas and V <= 7, of any luminosity class;
    stars with companions are flagged, never dropped, unless ``singles_only``. A table of one's own counts whole
    unless ``v_mag_max`` is given.

    Parameters
    ----------
    catalog : CatalogSource, optional
        Star table: ``snapshot``, ``latest``, ``simbad_2012``, or a file.
    v_mag_max : float, optional
        Faintest V magnitude that is kept.
    dwarfs_only : bool, optional
        Whether only dwarfs are kept.
    singles_only : bool, optional
        Whether only stars without a close companion are kept.
    companions : {"on", "off"}, optional
        ``on``: light of known stellar companions counts; ``off``: it is left out.
    date_utc : str, optional
        Of the places, as of `targets_from_table`.
    """
    chosen = as_catalogue(catalog)
    table = _sample(chosen, v_mag_max, dwarfs_only=dwarfs_only, singles_only=singles_only)
    return targets_from_table(table, companions=companions, date_utc=date_utc, orbits=chosen.orbits)


def _sample(
    chosen: Catalogue, v_mag_max: float | None = None, *, dwarfs_only: bool = False, singles_only: bool = False
) -> StarTable:
    """Return the rows of a catalogue that are left by the cuts."""
    table = chosen.table
    limit = chosen.ranked_v_mag if v_mag_max is None else check_number("v_mag_max", v_mag_max, "mag")
    keep = np.ones(len(table), bool) if limit is None else np.asarray(table.column("v_mag"), float) <= limit
    if not keep.any():
        raise InputError("v_mag_max", limit, unit="mag", allowed="a magnitude that leaves a star in the sample")
    if dwarfs_only:
        keep &= np.isin(np.asarray(table.column("luminosity_class")).astype(str), ("V", "IV-V"))
    if singles_only:
        keep &= ~np.asarray(table.column("close_companion"), bool)
    if not keep.any():
        cuts = " and ".join(["dwarfs_only"] * dwarfs_only + ["singles_only"] * singles_only)
        raise InputError(cuts, "no star left", allowed="cuts that leave a star in the sample", hint=chosen.provenance)
    return table.select(keep)


def sample_text(catalogue: Catalogue, v_mag_max: float | None, dwarfs_only: bool, singles_only: bool) -> str:
    """Return which rows of the catalogue a ranking returns, in words.

    Parameters
    ----------
    catalogue : Catalogue
    v_mag_max : float or None
        Faintest V magnitude that is kept.
    dwarfs_only : bool
        Whether only dwarfs are kept.
    singles_only : bool
        Whether only stars without a close companion are kept.
    """
    limit = catalogue.ranked_v_mag if v_mag_max is None else v_mag_max
    joint = " and" if " with " in catalogue.sample else " with"
    bright = "" if limit is None else f"{joint} V <= {limit:g}"
    classes = "dwarfs (V, IV-V) only" if dwarfs_only else "all luminosity classes"
    pairs = "stars with a close companion left out" if singles_only else "stars with companions flagged, not dropped"
    return f"{catalogue.sample}{bright}; {classes}; {pairs}"


def named_among(targets: Targets, names: Sequence[str], catalogue: Catalogue) -> BoolArray:
    """Tell which targets have one of some names.

    Parameters
    ----------
    targets : Targets
        ``n`` stars of the catalogue.
    names : sequence of str
        Any names of stars.
    catalogue : Catalogue

    Returns
    -------
    ndarray of bool, shape (n,)

    Raises
    ------
    InputError
        For names that are unknown, mean several stars or are no target, all of them in one line.
    """
    ranked, found, faults = set(targets.name.tolist()), [], []
    for name in names:
        try:
            match = resolve_star(name, catalogue.table)
        except InputError as error:
            faults.append(f"{name}: {error.hint or 'unknown'}")
            continue
        found.append(match.name)
        if match.others:
            faults.append(f"{name}: several stars, {', '.join((match.name, *match.others))}")
        elif match.name not in ranked:
            faults.append(f"{name}: in the catalogue, but not in the sample that is ranked")
    if faults:
        bad = ", ".join(fault.partition(":")[0] for fault in faults)
        raise InputError("stars", bad, allowed="names of one ranked star each", hint="; ".join(faults))
    return np.isin(targets.name, found)


def find_target(
    name: str,
    *,
    companions: Literal["on", "off"] = "on",
    catalog: CatalogSource = "snapshot",
    date_utc: str | None = None,
) -> tuple[Targets, str]:
    """Return one star of a catalogue by any name people use, and a note when the name was ambiguous.

    Parameters
    ----------
    name : str
        Any name of the star.
    companions : {"on", "off"}, optional
        ``on``: light of known stellar companions counts; ``off``: it is left out.
    catalog : CatalogSource, optional
        Star table: ``snapshot``, ``latest``, ``simbad_2012``, or a file.
    date_utc : str, optional
        Of the places, as of `targets_from_table`.

    Raises
    ------
    InputError
        If no star has that name; with the nearest suggestions.
    """
    return find_targets([name], companions=companions, catalog=catalog, date_utc=date_utc)[0]


def find_targets(
    names: Sequence[str],
    *,
    companions: Literal["on", "off"] = "on",
    catalog: CatalogSource = "snapshot",
    date_utc: str | None = None,
) -> list[tuple[Targets, str]]:
    """Return what `find_target` does of each of some names, worked out together.

    Parameters
    ----------
    names : sequence of str
    companions, catalog, date_utc
        As of `find_target`.

    Raises
    ------
    InputError
        For the first name that no star has.
    """
    chosen = as_catalogue(catalog)
    matches = [resolve_star(name, chosen.table) for name in names]
    rows = chosen.table.select([match.index for match in matches])
    found = targets_from_table(rows, companions=companions, date_utc=date_utc, orbits=chosen.orbits, apart=True)
    return [(found.select([row]), match.note) for row, match in enumerate(matches)]


def load_targets(source: str | Path = "snapshot", **cuts: Any) -> pd.DataFrame:
    """Return the target list as a pandas DataFrame, units in column names.

    Parameters
    ----------
    source : str or Path
        ``"snapshot"``, the catalogue that ships with the package; ``"latest"``, the newest that
        ``cpic catalog refresh`` made; ``"simbad_2012"``, the snapshot with companions where they were first
        listed; or a table file (CSV, VOTable, FITS or another format).
    **cuts
        ``v_mag_max`` (default 7, none for a file of one's own), ``dwarfs_only``, ``singles_only``, ``companions`` and
        ``date_utc`` as in `rank_sample`.

    Returns
    -------
    pandas.DataFrame
        One row per star; columns ``*_src`` say where values come from, ``attrs["catalogue"]`` which table it is.

    Raises
    ------
    InputError
        For an unknown source or cut, or a table that cannot be used.
    """
    import pandas as pd

    known = ("v_mag_max", "dwarfs_only", "singles_only", "companions", "date_utc")
    for key in cuts:
        if key not in known:
            raise InputError(key, cuts[key], allowed="no such cut", hint=f"known cuts: {', '.join(known)}")
    for key in {"dwarfs_only", "singles_only"} & set(cuts):
        check_flag(key, cuts[key])
    catalogue = as_catalogue(source)
    where = {name: cuts.pop(name) for name in ("companions", "date_utc") if name in cuts}
    table = _sample(catalogue, **cuts)
    targets = targets_from_table(table, orbits=catalogue.orbits, **where)
    columns = {name: values for name, values in vars(targets).items() if isinstance(values, np.ndarray)}
    labels = [f"{quantity}_src" for quantity in columns]
    origins = {label: table.column(label) for label in labels if label in table.columns}
    frame = pd.DataFrame(columns | {"flags": ["|".join(flags) for flags in targets.flags]} | origins)
    frame.attrs["catalogue"] = catalogue.provenance
    frame.attrs["date_utc"] = targets.date_utc
    return frame
