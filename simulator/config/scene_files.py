"""Scenes from a table of stars: pandas, astropy or the star catalogue, one star a row.

Simulations from files, presets and mappings.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeGuard

import numpy as np

from cpic_core import InputError, by_line, is_file
from simulator.config import scene as scene_file
from simulator.config.base import canonical_keys, inside, required, to_unit, validate
from simulator.config.bodies import Planet
from simulator.config.instrument import Instrument, InstrumentLike, load_instrument, paths_beside
from simulator.config.presets import preset_tree
from simulator.config.scene import Scene
from simulator.config.simulation import SequenceConfig, SimulationConfig, meaningful_keys, of_no_use

COMPANION_LIMIT_ARCSEC = 60.0
"""Farthest companion of a catalogue star that is put into its scene."""

ASSUMED_PA_DEG = 30.0
"""Position angle of a companion where none is known (A): between an arm of the mask and a diagonal."""

_STAR: dict[str, tuple[str, ...]] = {key: (key,) for key in ("metallicity", "luminosity_lsun")}
_STAR |= {"v_mag": ("v_mag", "magnitude"), "teff_k": ("teff_k", "teff"), "log_g": ("log_g", "logg")}
_STAR |= {"ra_deg": ("ra_deg", "ra"), "dec_deg": ("dec_deg", "dec"), "distance_pc": ("distance_pc", "distance")}
_STAR |= {"spectral_type": ("spectral_type", "sp_type")}
_COMPANION: dict[str, tuple[str, ...]] = {key: (f"companion_{key}",) for key in ("pa_deg", "v_mag", "teff_k")}
_COMPANION |= {"separation_arcsec": ("companion_separation_arcsec", "companion_sep_arcsec")}
_COMPANION |= {"delta_v_mag": ("companion_delta_v_mag",)}


class StarColumns(Protocol):
    """A table with named columns."""

    @property
    def columns(self) -> Any:
        """Names of the columns, or a mapping of them."""


def is_table(thing: Any) -> TypeGuard[StarColumns]:
    """Return whether something has named columns as a table of pandas, astropy or `catalogs.stars` has."""
    return hasattr(thing, "columns") and hasattr(thing, "__len__") and not isinstance(thing, Mapping)


def scenes_from_table(table: StarColumns, *, planet: Planet | Mapping[str, Any] | None = None) -> tuple[Scene, ...]:
    """Return one scene for each star of a table.

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
    if not is_table(table):
        raise InputError("table", table, allowed="a table with named columns")
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
    """Return a star's known companion as another star of its scene; empty if it is too far or its light is unknown.

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
    """Return the cells of the columns that there are, by key."""
    chosen = {key: next((name for name in spellings if name in names), None) for key, spellings in wanted.items()}
    return {key: _cells(table, name, key) for key, name in chosen.items() if name is not None}


def _names(table: StarColumns) -> tuple[str, ...]:
    return tuple(str(name) for name in table.columns)


def _cells(table: Any, name: str, key: str) -> list[Any]:
    """Return the cells of a column in the unit of the key, None where there is no value."""
    column = table.column(name) if hasattr(table, "column") else table[name]
    if hasattr(column, "isna"):
        column = column.astype(object).where(~column.isna(), None)
    values = to_unit(key, column)
    cells = values.tolist() if hasattr(values, "tolist") else list(values)
    return [None if _absent(cell) else cell for cell in cells]


def _absent(cell: Any) -> bool:
    return cell is None or cell == "" or (isinstance(cell, float) and bool(np.isnan(cell)))


SimulationSource = SimulationConfig | Mapping[str, Any] | str | Path
_TOP = ("name", "description", "instrument", "defaults", "sequences")
SIMULATION_KEYS = (*_TOP, "sequence")
"""Keys of a file of a simulation."""


@by_line
def load_simulation(source: SimulationSource, *, instrument: InstrumentLike = None) -> SimulationConfig:
    """Load a simulation from a YAML path, a preset name or a mapping.

    Parameters
    ----------
    source : SimulationConfig, str, Path or mapping
        Keys ``name``, ``description``, ``instrument`` (what `simulator.load_instrument` reads), ``defaults`` and
        ``sequences``, both with the keys of `SequenceConfig`. A default counts for the sequences that have a use for it
        and do not say otherwise. The ``scene`` of a sequence is what `simulator.load_scene` reads; its ``instrument`` a
        preset, a file, or a mapping of what differs from the simulation's. Files named in a YAML file are looked for
        beside it first.
    instrument : Instrument, mapping, str or Path, optional
        In place of the simulation's.

    Returns
    -------
    SimulationConfig

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.
    """
    if isinstance(source, SimulationConfig):
        if instrument is not None:
            raise InputError("instrument", "given with a loaded simulation", allowed="one of the two")
        return source
    tree, folder = preset_tree("simulation", source, keys=SIMULATION_KEYS)
    with inside("simulation"):
        tree = canonical_keys(tree, _TOP, {"sequence": "sequences"})
        chosen = tree.get("instrument") if instrument is None else instrument
        base = _instrument(chosen, folder if instrument is None else None)
        sequences = _with_defaults(tree)
    ready = [_loaded(item, base, folder, f"simulation.sequences.{n}") for n, item in enumerate(sequences)]
    head = {key: tree[key] for key in ("name", "description") if key in tree}
    return validate(SimulationConfig, {**head, "sequences": ready}, where="simulation")


def simulation_of(
    name: str, sequences: Iterable[SequenceConfig], *, description: str = "", changes: Mapping[str, Any] | None = None
) -> SimulationConfig:
    """Put sequences together.

    Parameters
    ----------
    name, description : str
    sequences : iterable of SequenceConfig
    changes : mapping, optional
        Values that replace those of every sequence that has a use for them; ``switches`` are added to those of the
        sequence, and ``start_utc`` is that of the first one.

    Raises
    ------
    InputError
        If a change is of no use to any of them, or impossible for one.
    """
    listed = tuple(sequences)
    known = {name for item in listed for name in item.known_switches}
    for key, value in (changes or {}).items():
        for effect in value if key == "switches" else ():
            if effect not in known:
                raise InputError("switches", effect, allowed=", ".join(sorted(known)))
        if key == "start_utc":
            listed = _begun(listed, value)
            continue
        changed = tuple(_changed(item, key, value) for item in listed)
        if listed and all(new is old for new, old in zip(changed, listed, strict=True)):
            raise of_no_use(key, value, listed[0].kind)
        listed = changed
    return validate(SimulationConfig, {"name": name, "description": description, "sequences": listed})


def _changed(item: SequenceConfig, key: str, value: Any) -> SequenceConfig:
    if key not in meaningful_keys(item.kind):
        return item
    if key == "switches":
        # What the other camera alone has is of no use here.
        useful = {name: on for name, on in value.items() if name in item.known_switches}
        if not useful:
            return item
        value = useful if "all" in useful else item.switches | useful
    given = {name: getattr(item, name) for name in item.model_fields_set}
    if item.kind == "BIAS":
        del given["exposure_s"]
    return validate(SequenceConfig, given | {key: value})


def _begun(sequences: tuple[SequenceConfig, ...], start_utc: Any) -> tuple[SequenceConfig, ...]:
    """Return the sequences with the begin of the first."""
    own = [item.start_utc for item in sequences if item.start_utc is not None]
    if own:
        allowed = "for sequences without a begin of their own"
        raise InputError("start_utc", start_utc, unit="UTC", allowed=allowed, hint=f"one has {own[0]}")
    return (_changed(sequences[0], "start_utc", start_utc), *sequences[1:])


def _with_defaults(tree: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the mappings of the sequences with the defaults that each has a use for."""
    fields, aliases = SequenceConfig.model_fields, SequenceConfig.ALIASES
    defaults = tree.get("defaults") or {}
    if not isinstance(defaults, Mapping):
        raise InputError("defaults", defaults, allowed="a mapping of keys to values")
    with inside("defaults"):
        defaults = canonical_keys(defaults, fields, aliases)
    listed = tree.get("sequences")
    listed = [listed] if isinstance(listed, Mapping) else listed
    if not isinstance(listed, Sequence) or isinstance(listed, str) or not listed:
        shown = "missing" if "sequences" not in tree else listed
        raise InputError("sequences", shown, allowed="a list of mappings, one for each sequence")
    result, unused = [], set(defaults)
    for number, item in enumerate(listed):
        if not isinstance(item, Mapping):
            raise InputError(f"sequences.{number}", item, allowed="a mapping of keys to values")
        with inside(f"sequences.{number}"):
            own = canonical_keys(item, fields, aliases)
            useful = meaningful_keys(own.get("kind", defaults.get("kind", "SCI")))
        result.append({key: value for key, value in defaults.items() if key in useful} | own)
        unused -= set(useful)
    for key in sorted(unused):
        raise InputError(f"defaults.{key}", defaults[key], allowed="what some sequence has a use for")
    return result


def _loaded(item: Mapping[str, Any], base: Instrument, folder: Path | None, where: str) -> dict[str, Any]:
    """Return a sequence's mapping with its scene and instrument loaded."""
    result = dict(item)
    with inside(where):
        own = result.get("instrument")
        if isinstance(own, Mapping):
            result["instrument"] = base.changed(own if folder is None else paths_beside(dict(own), folder))
        else:
            result["instrument"] = base if own is None else _instrument(own, folder)
        for key in ("scene", "reference_scene"):
            if result.get(key) is not None:
                result[key] = _scene(result[key], folder)
    return result


def _scene(source: Any, folder: Path | None) -> scene_file.Scene:
    if folder is not None and isinstance(source, Mapping):
        source = scene_file.paths_beside(dict(source), folder)
    return scene_file.load_scene(_beside(source, folder))


def _instrument(source: Any, folder: Path | None) -> Instrument:
    if isinstance(source, Instrument):
        return source
    if folder is not None and isinstance(source, Mapping):
        source = paths_beside(dict(source), folder)
    return load_instrument(_beside(source, folder))


def _beside(source: Any, folder: Path | None) -> Any:
    """Return the path of a file that lies beside the simulation's, other sources as they are."""
    if folder is not None and isinstance(source, str) and is_file(folder / source):
        return folder / source
    return source
