"""Simulations from files, presets and mappings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs.errors import InputError
from simulator.config import scene as scene_file
from simulator.config.base import validate
from simulator.config.instrument import Instrument, load_instrument, paths_beside
from simulator.config.keys import at, canonical_keys
from simulator.config.presets import preset_tree
from simulator.config.simulation import SequenceConfig, SimulationConfig, meaningful_keys, of_no_use

__all__ = ["SIMULATION_KEYS", "InstrumentSource", "SimulationSource", "load_simulation", "simulation_of"]

SimulationSource = SimulationConfig | Mapping[str, Any] | str | Path
InstrumentSource = Instrument | Mapping[str, Any] | str | Path | None
_TOP = ("name", "description", "instrument", "defaults", "sequences")
SIMULATION_KEYS = (*_TOP, "sequence")
"""Keys of a file of a simulation."""


def load_simulation(source: SimulationSource, *, instrument: InstrumentSource = None) -> SimulationConfig:
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
    try:
        tree = canonical_keys(tree, _TOP, {"sequence": "sequences"})
        chosen = tree.get("instrument") if instrument is None else instrument
        base = _instrument(chosen, folder if instrument is None else None)
        sequences = _with_defaults(tree)
    except InputError as error:
        raise at("simulation", error) from None
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
    """The sequences with the begin of the first."""
    own = [item.start_utc for item in sequences if item.start_utc is not None]
    if own:
        raise InputError(
            "start_utc",
            start_utc,
            unit="UTC",
            allowed="for sequences without a begin of their own",
            hint=f"one has {own[0]}",
        )
    return (_changed(sequences[0], "start_utc", start_utc), *sequences[1:])


def _with_defaults(tree: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Mappings of the sequences with the defaults that each has a use for."""
    fields, aliases = SequenceConfig.model_fields, SequenceConfig.ALIASES
    defaults = tree.get("defaults") or {}
    if not isinstance(defaults, Mapping):
        raise InputError("defaults", defaults, allowed="a mapping of keys to values")
    try:
        defaults = canonical_keys(defaults, fields, aliases)
    except InputError as error:
        raise at("defaults", error) from None
    listed = tree.get("sequences")
    listed = [listed] if isinstance(listed, Mapping) else listed
    if not isinstance(listed, Sequence) or isinstance(listed, str) or not listed:
        shown = "missing" if "sequences" not in tree else listed
        raise InputError("sequences", shown, allowed="a list of mappings, one for each sequence")
    result, unused = [], set(defaults)
    for number, item in enumerate(listed):
        if not isinstance(item, Mapping):
            raise InputError(f"sequences.{number}", item, allowed="a mapping of keys to values")
        try:
            own = canonical_keys(item, fields, aliases)
            useful = meaningful_keys(own.get("kind", defaults.get("kind", "SCI")))
        except InputError as error:
            raise at(f"sequences.{number}", error) from None
        result.append({key: value for key, value in defaults.items() if key in useful} | own)
        unused -= set(useful)
    for key in sorted(unused):
        raise InputError(f"defaults.{key}", defaults[key], allowed="what some sequence has a use for")
    return result


def _loaded(item: Mapping[str, Any], base: Instrument, folder: Path | None, where: str) -> dict[str, Any]:
    """A sequence's mapping with its scene and instrument loaded."""
    result = dict(item)
    try:
        own = result.get("instrument")
        if isinstance(own, Mapping):
            result["instrument"] = base.changed(own if folder is None else paths_beside(dict(own), folder))
        else:
            result["instrument"] = base if own is None else _instrument(own, folder)
        if result.get("scene") is not None:
            result["scene"] = _scene(result["scene"], folder)
    except InputError as error:
        raise at(where, error) from None
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
    """Path of a file that lies beside the simulation's, other sources as they are."""
    if folder is not None and isinstance(source, str) and (folder / source).is_file():
        return folder / source
    return source
