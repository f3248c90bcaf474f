"""Make one simulation of what a person names (scenes, tables of stars, a kind), and choose what it leaves out.

What a simulation costs before it is run: time, memory and disk from the number and size of its frames.
"""

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs import NAMED_TABLES, Catalogue, open_catalogue, stars_at
from cpic_core import InputError, at_home, faults_by_line, load_mapping
from cpic_planner.jobs import Cost, pace
from cpic_planner.queries import called, called_as
from cpic_planner.results import ModellingRecord, PlannedSequenceRow, SimulationEstimate
from cpic_planner.simulation.sequences import PlannedSequence, plan_sequences
from cpic_planner.validation import modelling_record
from simulator import config
from simulator.config import Instrument, Scene, SequenceConfig, SimulationConfig
from simulator.knobs import FIDELITIES
from simulator.ledger import Choice, observation_choice


def sequence_choice(item: PlannedSequence) -> Choice | None:
    """Return what `simulator.observe` decides for a sequence; None where nothing may be left out."""
    entry = item.entry
    if entry.scene is None or entry.tolerance == 0:
        return None
    frames = {name: getattr(item, name) for name in ("band", "exposure_s", "em_gain", "start_utc")}
    frames |= {"n_frames": entry.frames}
    light = {name: getattr(entry, name) for name in ("tolerance", "roll_deg", "star_offset_arcsec", "scene_model")}
    finest, switches = FIDELITIES[entry.fidelity], entry.switches_for(item.camera)
    settings: dict[str, Any] = {"quantity": None, "finest": finest, "full": True, "switches": switches}
    return observation_choice(entry.scene, entry.instrument, **settings, **frames, **light)


def modelled(item: PlannedSequence) -> ModellingRecord | None:
    """Return the record of what a sequence models and leaves out; None where nothing may be left out."""
    choice = sequence_choice(item)
    if choice is None:
        return None
    tolerance = dict.fromkeys(choice.predicted_error, item.entry.tolerance)
    return modelling_record(choice, fidelity="custom", tolerance=tolerance, draw="frames", region="full")


SimulationInput = SimulationConfig | Scene | Mapping[str, Any] | str | Path
_YAML = (".yaml", ".yml", ".json")


def simulation_from(
    what: Sequence[SimulationInput],
    *,
    settings: Mapping[str, Any] | None = None,
    changes: Mapping[str, Any] | None = None,
    instrument: Instrument | Mapping[str, Any] | str | Path | None = None,
    date_utc: str | None = None,
) -> tuple[SimulationConfig, tuple[str, ...]]:
    """Return one simulation of everything that is named.

    Parameters
    ----------
    what : sequence
        Simulations and scenes (presets, YAML files, mappings, objects), and tables of stars (a file in any usual
        format; ``snapshot``, ``latest``, ``simbad_2012``), each row of which is a scene. Nothing for a calibration
        ``kind``.
    settings : mapping, optional
        Keys of `SequenceConfig` for the scenes; a simulation has its own. The scene of references may have the forms
        that `simulator.config.scene.load_scene` reads.
    changes : mapping, optional
        Values that replace those of every sequence; see `simulator.config.scene_files.simulation_of`.
    instrument : Instrument, mapping, str or Path, optional
        In place of the default one and of those of the simulations.
    date_utc : str, optional
        Date of the places of the stars of tables and of their companions, UTC; that of the first frame by default.

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
    if own.get("reference_scene") is not None:
        with called_as({"scene": called("reference_scene")}):
            own["reference_scene"] = config.load_scene(own["reference_scene"])
    kind = own.get("kind", "SCI")
    for key, value in own.items():
        if key not in config.meaningful_keys(kind):
            raise config.of_no_use(key, value, kind)
    if kind not in config.SKY_KINDS:
        if what:
            raise InputError("what", _label(what[0]), allowed=f"nothing: {kind} looks at no scene")
        chosen = instrument if isinstance(instrument, Instrument) else config.load_instrument(instrument)
        entry = config.validate(SequenceConfig, own | {"instrument": chosen})
        return config.simulation_of(kind, [entry], changes=changes), ()
    if not what:
        allowed = "scenes, simulations, tables of stars, or a calibration kind"
        raise InputError("what", "missing", allowed=allowed, hint=_presets())
    names: list[str] = []
    notes: list[str] = []
    sequences: list[SequenceConfig] = []
    described = ""
    whole: Instrument | None = None
    dated = False
    for item in what:
        read = _read(item, instrument)
        if isinstance(read, SimulationConfig):
            names.append(read.name)
            described = read.description
            sequences += read.sequences
            continue
        name, found, remarks = read
        names.append(name)
        notes += remarks
        if whole is None:
            whole = instrument if isinstance(instrument, Instrument) else config.load_instrument(instrument)
        if isinstance(found, Catalogue):
            when = date_utc or (changes or {}).get("start_utc") or whole.mission.start_utc
            epoch_yr = config.julian_year(config.checked_utc("date_utc", when))
            found = config.scenes_from_table(stars_at(found.table, epoch_yr, orbits=found.orbits))
            dated = True
        sequences += [config.validate(SequenceConfig, own | {"scene": scene, "instrument": whole}) for scene in found]
    if whole is None:
        for key, value in own.items():
            raise InputError(key, value, allowed="for scenes and tables; a simulation names its own")
    if date_utc is not None and not dated:
        allowed = "together with a table of stars; scenes and simulations have places of their own"
        raise InputError("date_utc", date_utc, unit="UTC", allowed=allowed)
    title = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    description = described if len(names) == 1 else ""
    return config.simulation_of(title, sequences, description=description, changes=changes), tuple(notes)


def _label(item: SimulationInput) -> str:
    return str(item) if isinstance(item, str | Path) else getattr(item, "name", "a mapping")


def _presets() -> str:
    return f"presets: {', '.join((*config.preset_names('simulation'), *config.preset_names('scene')))}"


def _read(
    item: SimulationInput, instrument: Any
) -> SimulationConfig | tuple[str, Sequence[Scene] | Catalogue, Sequence[str]]:
    """Return a simulation, or scenes or a table of stars with the name of what they come from and remarks."""
    if isinstance(item, SimulationConfig):
        return config.load_simulation(item, instrument=instrument)
    if isinstance(item, Scene):
        return item.name, (item,), ()
    if isinstance(item, Mapping):
        return _read_mapping(item, item, instrument)
    if not isinstance(item, str | Path) or not str(item):
        raise InputError("what", repr(item), allowed="a scene, a simulation or a table of stars")
    name = str(item)
    if config.preset_path("simulation", name) is not None:
        return config.load_simulation(name, instrument=instrument)
    if config.preset_path("scene", name) is not None:
        return _scene(name)
    path = at_home(item)
    if name not in NAMED_TABLES:
        if not os.path.exists(path):
            known = (*config.preset_names("simulation"), *config.preset_names("scene"))
            allowed = "a preset, a YAML file, or a table of stars that exists"
            raise InputError("what", name, allowed=allowed, hint=config.nearest(name, known) or _presets())
        if path.suffix.lower() in _YAML:
            with faults_by_line(path):
                tree = load_mapping(path, "scene", (*config.SCENE_KEYS, *config.SIMULATION_KEYS))
                return _read_mapping(tree, path, instrument)
    stars = open_catalogue(name if name in NAMED_TABLES else path)
    return path.stem, stars, stars.notes


def _read_mapping(
    tree: Any, source: Any, instrument: Any
) -> SimulationConfig | tuple[str, Sequence[Scene], Sequence[str]]:
    """Return a mapping or a file by its ``kind``; without one, what has sequences is a simulation."""
    plain = tree if isinstance(tree, Mapping) else {}
    kind = plain.get("kind", "simulation" if "sequences" in plain else "scene")
    if kind == "simulation":
        return config.load_simulation(source, instrument=instrument)
    if kind != "scene":
        allowed = "a file of kind: scene or kind: simulation"
        raise InputError("what", _label(source), allowed=allowed, hint=f"it is of kind {kind}")
    return _scene(source)


def _scene(source: Any) -> tuple[str, Sequence[Scene], Sequence[str]]:
    scene = config.load_scene(source)
    return scene.name, (scene,), ()


_BLOCK = 2880
_START_S = 1.0  # libraries and compiled kernels, once in each process
_SETUP_S = {"sky": 0.6, "light": 0.4, "dark": 0.05}
_SOURCE_S = 0.7  # the light of a star off the axis at its own number of wavelengths
_MOST_SOURCES = 19  # more stars share numbers of wavelengths
_EPOCH_S = 0.06
_MOST_EPOCHS = 12
_FRAME_S_MPX = 0.06
_FRAME_S = 0.005
_RAY_S = 1e-4
_MEMORY_MB = 250.0
_MEMORY_MB_MPX = 150.0


def simulation_estimate(simulation: SimulationConfig, *, truth: bool = True, workers: int = 1) -> SimulationEstimate:
    """Return the sequences of a simulation, and what they would cost: wall time, memory of a worker, disk.

    Raises
    ------
    InputError
        As `cpic_planner.simulation.run.simulate`, for what can be known before frames are made.
    """
    planned = plan_sequences(simulation)
    check_light(planned)
    records = [modelled(item) for item in planned]
    rows = [PlannedSequenceRow(**item.row(), modelled=record) for item, record in zip(planned, records, strict=True)]
    return SimulationEstimate(
        name=simulation.name,
        n_sequences=len(planned),
        n_frames=sum(item.n_frames for item in planned),
        workers=workers,
        **sequences_cost(planned, records, truth=truth).at(workers, pace()),
        sequences=rows,
    )


def sequences_cost(
    planned: Sequence[PlannedSequence], records: Sequence[ModellingRecord | None], *, truth: bool
) -> Cost:
    """Return the expected cost of sequences.

    Parameters
    ----------
    planned : sequence of PlannedSequence
    records : sequence of ModellingRecord or None
        What each models, see `cpic_planner.simulation.inputs.modelled`.
    truth : bool
        Whether the truth is written beside the products.
    """
    return Cost(
        counts={},
        times_s=[_time_s(item, record) for item, record in zip(planned, records, strict=True)],
        start_s=_START_S,
        pool_s=2.0 * _START_S,
        memory_mb=_MEMORY_MB + _MEMORY_MB_MPX * max(map(_n_pixels, planned)) / 1e6,
        disk_mb=sum(disk_bytes(item, truth=truth) for item in planned) / 1e6,
    )


def disk_bytes(item: PlannedSequence, *, truth: bool) -> int:
    """Return the bytes of the files of a sequence: exact for the images, a bound for compressed masks and logs."""
    pixels = _n_pixels(item)
    level0 = 6 * _BLOCK + item.n_frames * (_padded(2 * pixels) + 2 * _BLOCK)
    params = 75_000 + 300 * item.n_frames + 1000 * _n_sources(item)
    masks = item.n_frames * (_padded(0.02 * pixels) + 2 * _BLOCK)
    return level0 + params + (2 * _padded(4 * pixels) + 12 * _BLOCK + masks if truth else 0)


def _padded(size: float) -> int:
    return math.ceil(size / _BLOCK) * _BLOCK


def _n_pixels(item: PlannedSequence) -> int:
    detector = item.entry.instrument.channel(item.camera).detector
    return detector.n_rows * detector.n_columns


def _n_sources(item: PlannedSequence) -> int:
    """Return the stars off the axis, and one for planets and extended sources together."""
    scene = item.entry.scene
    if scene is None:
        return 0
    return sum(map(scene.is_lit, scene.stars)) + bool(scene.planets or scene.extended)


def _time_s(item: PlannedSequence, record: ModellingRecord | None) -> float:
    gone = {row.key for row in record.effects if row.decision == "skipped"} if record else set()
    instrument = item.entry.instrument
    detector = instrument.channel(item.camera).detector
    setup = _SETUP_S["sky" if item.on_sky else "light" if item.band else "dark"]
    if item.on_sky:
        sources = _n_sources(item) - sum(key.startswith("star:") for key in gone)
        epochs = min(item.n_frames, _MOST_EPOCHS) if record is None else record.epochs
        setup += _EPOCH_S * epochs + _SOURCE_S * min(sources, _MOST_SOURCES)
    megapixels = _n_pixels(item) / 1e6
    area_cm2 = megapixels * 1e6 * (detector.pixel_um * 1e-4) ** 2
    rays = instrument.cosmic_rays.peak_rate_per_s_cm2 * area_cm2 * item.exposure_s
    rays = 0.0 if "cosmic_rays" in gone else rays
    return setup + item.n_frames * (_FRAME_S + _FRAME_S_MPX * megapixels + _RAY_S * rays)


def located(error: InputError, where: str) -> InputError:
    """Return the same refusal, which says where the value belongs to."""
    return InputError(f"{error.key} of {where}", error.value, unit=error.unit, allowed=error.allowed, hint=error.hint)


def check_light(planned: tuple[PlannedSequence, ...]) -> None:
    """Refuse scenes whose light cannot be computed, before any frame is made.

    Raises
    ------
    InputError
        Naming the sequence and the source.
    """
    from simulator.target import extended_rates, scene_sources

    seen: set[tuple[int, int, str]] = set()
    for item in planned:
        entry = item.entry
        if entry.scene is None:
            continue
        light = id(entry.scene), id(entry.instrument), item.band
        if light in seen:
            continue
        seen.add(light)
        try:
            scene_sources(entry.scene, entry.instrument, item.band, roll_deg=entry.roll_deg)
            extended_rates(entry.scene, entry.instrument, item.band)
        except InputError as error:
            raise located(error, f"{item.target} in {item.band}") from None
