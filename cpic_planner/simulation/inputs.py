"""What a person names on the command line, as one simulation: scenes, simulations, tables of stars, or a kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs.catalogue import NAMED_TABLES, open_catalogue
from catalogs.errors import InputError
from catalogs.strict_yaml import load_mapping
from simulator.config import Instrument, Scene, load_instrument, load_scene, scenes_from_table
from simulator.config.base import validate
from simulator.config.keys import nearest
from simulator.config.presets import preset_names, preset_path
from simulator.config.scene import SCENE_KEYS
from simulator.config.simulation import SKY_KINDS, SequenceConfig, SimulationConfig, meaningful_keys, of_no_use
from simulator.config.simulation_file import SIMULATION_KEYS, load_simulation, simulation_of

SimulationInput = SimulationConfig | Scene | Mapping[str, Any] | str | Path
_YAML = (".yaml", ".yml", ".json")


def simulation_from(
    what: Sequence[SimulationInput],
    *,
    settings: Mapping[str, Any] | None = None,
    changes: Mapping[str, Any] | None = None,
    instrument: Instrument | Mapping[str, Any] | str | Path | None = None,
) -> tuple[SimulationConfig, tuple[str, ...]]:
    """One simulation of everything that is named.

    Parameters
    ----------
    what : sequence
        Simulations and scenes (presets, YAML files, mappings, objects), and tables of stars (CSV, ECSV, VOTable or
        FITS; ``snapshot``, ``latest``, ``simbad_2012``), each row of which is a scene. Nothing for a calibration
        ``kind``.
    settings : mapping, optional
        Keys of `SequenceConfig` for the scenes; a simulation has its own.
    changes : mapping, optional
        Values that replace those of every sequence; see `simulator.config.simulation_file.simulation_of`.
    instrument : Instrument, mapping, str or Path, optional
        In place of the default one and of those of the simulations.

    Returns
    -------
    simulation : SimulationConfig
    notes : tuple of str
        Remarks on the reading, for the person who asked.

    Raises
    ------
    InputError
        For the first thing that cannot be used, and for settings that concern none of it.
    """
    own = dict(settings or {})
    kind = own.get("kind", "SCI")
    for key, value in own.items():
        if key not in meaningful_keys(kind):
            raise of_no_use(key, value, kind)
    if kind not in SKY_KINDS:
        if what:
            raise InputError("what", _label(what[0]), allowed=f"nothing: {kind} looks at no scene")
        chosen = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
        entry = validate(SequenceConfig, own | {"instrument": chosen})
        return simulation_of(kind, [entry], changes=changes), ()
    if not what:
        raise InputError(
            "what", "missing", allowed="scenes, simulations, tables of stars, or a calibration kind", hint=_presets()
        )
    names: list[str] = []
    notes: list[str] = []
    sequences: list[SequenceConfig] = []
    described = ""
    whole: Instrument | None = None
    for item in what:
        found = _read(item, instrument)
        if isinstance(found, SimulationConfig):
            names.append(found.name)
            described = found.description
            sequences += found.sequences
            continue
        name, scenes, remarks = found
        names.append(name)
        notes += remarks
        if whole is None:
            whole = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
        sequences += [validate(SequenceConfig, own | {"scene": scene, "instrument": whole}) for scene in scenes]
    if whole is None:
        for key, value in own.items():
            raise InputError(key, value, allowed="for scenes and tables; a simulation names its own")
    title = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    description = described if len(names) == 1 else ""
    return simulation_of(title, sequences, description=description, changes=changes), tuple(notes)


def _label(item: SimulationInput) -> str:
    return str(item) if isinstance(item, str | Path) else getattr(item, "name", "a mapping")


def _presets() -> str:
    return f"presets: {', '.join((*preset_names('simulation'), *preset_names('scene')))}"


def _read(item: SimulationInput, instrument: Any) -> SimulationConfig | tuple[str, Sequence[Scene], Sequence[str]]:
    """A simulation, or scenes with the name of what they come from and remarks."""
    if isinstance(item, SimulationConfig):
        return load_simulation(item, instrument=instrument)
    if isinstance(item, Scene):
        return item.name, (item,), ()
    if isinstance(item, Mapping):
        return _read_mapping(item, item, instrument)
    if not isinstance(item, str | Path) or not str(item):
        raise InputError("what", repr(item), allowed="a scene, a simulation or a table of stars")
    name = str(item)
    if preset_path("simulation", name) is not None:
        return load_simulation(name, instrument=instrument)
    if preset_path("scene", name) is not None:
        return _scene(name)
    path = Path(item).expanduser()
    if name not in NAMED_TABLES:
        if not path.exists():
            known = (*preset_names("simulation"), *preset_names("scene"))
            raise InputError(
                "what",
                name,
                allowed="a preset, a YAML file, or a table of stars that exists",
                hint=nearest(name, known) or _presets(),
            )
        if path.suffix.lower() in _YAML:
            return _read_mapping(load_mapping(path, "scene", (*SCENE_KEYS, *SIMULATION_KEYS)), path, instrument)
    stars = open_catalogue(name if name in NAMED_TABLES else path)
    return path.stem, scenes_from_table(stars.table), stars.notes


def _read_mapping(
    tree: Any, source: Any, instrument: Any
) -> SimulationConfig | tuple[str, Sequence[Scene], Sequence[str]]:
    """A mapping or a file by its ``kind``; without one, what has sequences is a simulation."""
    plain = tree if isinstance(tree, Mapping) else {}
    kind = plain.get("kind", "simulation" if "sequences" in plain else "scene")
    if kind == "simulation":
        return load_simulation(source, instrument=instrument)
    if kind != "scene":
        raise InputError(
            "what", _label(source), allowed="a file of kind: scene or kind: simulation", hint=f"it is of kind {kind}"
        )
    return _scene(source)


def _scene(source: Any) -> tuple[str, Sequence[Scene], Sequence[str]]:
    scene = load_scene(source)
    return scene.name, (scene,), ()
