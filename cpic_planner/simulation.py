"""Run a simulation: what a person names as sequences, their cost, and every one a task.

Scenes, tables of stars or a kind become one simulation, whose cost in time, memory and disk follows from the number and
size of its frames. Every finished sequence is kept, the rest is done when it is started again.
"""

import dataclasses
import math
import operator
import os
import shutil
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any, Unpack, cast

import numpy as np

from catalogs import NAMED_TABLES, Catalogue, open_catalogue, stars_at
from cpic_core import (
    InputError,
    Record,
    at_home,
    digest_of,
    dump_json,
    faults_by_line,
    fingerprint,
    is_file,
    load_mapping,
)
from cpic_planner import results
from cpic_planner.jobs import Cost, Job, RunFolder, Runner, RunSettings, Task, contents_of, pace, run
from cpic_planner.queries import called, called_as
from cpic_planner.validation import Cube, CubeKind, calibrated_cube, cube_files, modelling_record
from cpic_planner.version import __version__
from simulator import config, observing, products
from simulator.camera import Frame
from simulator.config import Instrument, Scene, SequenceConfig, SimulationConfig, content_hash
from simulator.knobs import FIDELITIES
from simulator.ledger import Choice, observation_choice


def programme_timing(entry: config.SequenceConfig, parts: Sequence[products.VisitPart]) -> dict[str, config.Timing]:
    """Return when the visits of each role are, for `simulator.observing.observation.observe`.

    Parameters
    ----------
    entry : SequenceConfig
    parts : sequence of VisitPart
        Its visits, see `visit_parts`.
    """
    timings = {}
    for role in dict.fromkeys(part.role for part in parts):
        starts = [part.start_s for part in parts if part.role == role and part.window == part.step == 0]
        gap_s = (max(starts) - min(starts)) / (len(starts) - 1) if len(starts) > 1 else None
        timings[role] = config.Timing(entry.reference_scheme, gap_s)
    return timings


class PlannedSequence(Record):
    """One sequence: its entry in the simulation, its place in the entry's grid, its number and times.

    Attributes
    ----------
    entry : SequenceConfig
    step : int
        Number of band, exposure and gain in the entry.
    band : str
        Empty for BIAS and DARK.
    exposure_s, em_gain : float
    start_utc : str
    times : SequenceTimes
        Begin of the first and end of the last exposure, as those of one.
    part : VisitPart or None
        Which frames of which visit it has; None outside of a programme. The frames of ``entry`` are those of a visit.
    timing : Timing or None
        When the visits of its role are.
    obsid : str
        Eleven digits.
    realisation : int
    programme : str
        Folder of the programme; empty for the only one of a simulation, and outside of one.
    """

    entry: config.SequenceConfig
    step: int
    band: str
    exposure_s: float
    em_gain: float
    start_utc: str
    times: products.SequenceTimes
    part: products.VisitPart | None = None
    timing: config.Timing | None = None
    obsid: str = ""
    realisation: int = 0
    programme: str = ""

    @property
    def kind(self) -> str:
        """What the frames are: SCI, BIAS and so on."""
        return self.entry.kind

    @property
    def instrument(self) -> Instrument:
        """The instrument of the entry."""
        return self.entry.instrument

    @property
    def camera(self) -> str:
        """VIS or NIR."""
        return self.entry.camera_of(self.band)

    @property
    def name(self) -> products.ProductName:
        """Places of its files below `folder`."""
        return products.product_name(cast(Any, self), self.times, self.obsid)

    @property
    def begin_mjd(self) -> float:
        """Begin of the first exposure, MJD (UTC)."""
        return float(self.times.begin_mjd[0])

    @property
    def end_mjd(self) -> float:
        """End of the last exposure, MJD (UTC)."""
        return float(self.times.end_mjd[0])

    @property
    def target(self) -> str:
        """Name of the scene, or the kind where there is none."""
        return self.entry.kind if self.entry.scene is None else self.entry.scene.name

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.entry.frames if self.part is None else self.part.n_frames

    @property
    def folder(self) -> str:
        """Folder of its tree of products below that of the run; empty outside of a programme."""
        return "" if self.part is None else PurePath(self.programme, self.part.folder).as_posix()

    def place(self, path: Path) -> str:
        """Return where a file of its tree is, below the folder of the run."""
        return PurePath(self.folder, path).as_posix()

    @property
    def on_sky(self) -> bool:
        """Whether the sequence looks at a scene."""
        return self.entry.kind in config.SKY_KINDS

    @property
    def readout_s(self) -> float:
        """Dead time after each frame."""
        return _readout_s(self.entry, self.camera)

    @property
    def about(self) -> dict[str, Any]:
        """What a `PlannedSequenceRow` has beside the attributes of the same name."""
        role = self.entry.role if self.on_sky else ""
        visit = {} if self.part is None else {"visit": self.part.visit + 1, "window": self.part.window + 1}
        return {"role": role, "file": self.place(self.name.file)} | visit

    def settings(self, hashes: Mapping[int, str] = MappingProxyType({})) -> dict[str, Any]:
        """Return what decides its frames, as plain values; scene and instrument by their hash, known or taken now."""
        entry = self.entry
        useful = set(config.meaningful_keys(entry.kind)) - {"scene", "instrument", *config.PROGRAMME_KEYS}
        plain = entry.model_dump(mode="json", include=useful)
        own = ("obsid", "band", "camera", "exposure_s", "em_gain", "realisation", "start_utc")
        looked_at = {"scene": entry.scene, "instrument": entry.instrument}
        plain |= {
            name: None if part is None else hashes.get(id(part)) or part.content_hash
            for name, part in looked_at.items()
        }
        plain |= {name: getattr(self, name) for name in own} | {"switches": entry.switches_for(self.camera)}
        plain |= {} if self.part is None else {"part": dataclasses.asdict(self.part), "folder": self.folder}
        return plain | ({} if self.timing is None else {"timing": dataclasses.asdict(self.timing)})

    def build(self) -> "observing.FrameSequence":
        """Set up the sequence; frames are drawn when they are asked for."""
        entry = self.entry
        shared = {name: getattr(self, name) for name in ("em_gain", "realisation", "start_utc")}
        shared |= {"n_frames": entry.frames}
        shared |= {"seed": entry.seed, "instrument": entry.instrument, "switches": entry.switches_for(self.camera)}
        if entry.scene is not None:
            from simulator.observing import observe

            names = ("fidelity", "tolerance", "roll_deg", "star_offset_arcsec", "role", "scene_model")
            shared |= {name: getattr(entry, name) for name in names}
            kind = cast(Any, entry.kind)
            shared |= {} if self.part is None else {"visit": self.part.visit, "timing": self.timing}
            visit = observe(entry.scene, band=self.band, exposure_s=self.exposure_s, kind=kind, **shared)
            return visit if self.part is None else cast(Any, products.PartOfVisit(visit, self.part))
        from simulator.observing import calibrate

        shared |= {name: getattr(entry, name) for name in ("level_e", "offset_arcsec", "ra_deg", "dec_deg")}
        camera = None if self.band else entry.camera
        return calibrate(cast(Any, entry.kind), band=self.band, camera=camera, exposure_s=self.exposure_s, **shared)


def plan_sequences(simulation: config.SimulationConfig) -> tuple[PlannedSequence, ...]:
    """Give the sequences of a simulation their numbers and dates.

    Sequences without a begin of their own follow each other at once, those of an entry on the sky after the
    ``overhead_s`` of its instrument, which is that of a visit; the first begins with the mission. Visits of a programme
    begin where windows of the orbit open (`visit_parts`). Numbers are the instrument's prefix and the position in the
    simulation, or those that an entry gives. Realisations are counted as `SequenceConfig` says; those of a programme
    have one number.

    Raises
    ------
    InputError
        If a number is not one of the instrument's or used twice, or a time is out of range.
    """
    taken, counts = _given_realisations(simulation), dict[Hashable, int]()
    programmes = [number for number, entry in enumerate(simulation.sequences) if entry.is_programme]
    used: dict[str, int] = {}
    planned: list[PlannedSequence] = []
    free_utc: str | None = None
    for number, entry in enumerate(simulation.sequences):
        where = f"simulation.sequences.{number}"
        try:
            begin_utc = entry.start_utc or entry.instrument.mission.start_utc
            if entry.start_utc is None and free_utc is not None:
                overhead_s = entry.instrument.overhead_s if entry.kind in config.SKY_KINDS else 0.0
                begin_utc = _later(free_utc, overhead_s)
            sequences, free_utc = _dated(entry, begin_utc)
            numbers = [_obsid(entry, len(planned) + 1 + count, count) for count in range(len(sequences))]
        except InputError as error:
            raise config.at(where, error) from None
        folder = f"programme_{programmes.index(number) + 1}" if entry.is_programme and len(programmes) > 1 else ""
        realisations = [
            _free_realisation(_streams(entry, band), taken, counts) if entry.realisation is None else entry.realisation
            for band, _, _ in entry.grid()
        ]
        for obsid, item in zip(numbers, sequences, strict=True):
            if obsid in used:
                hint = f"simulation.sequences.{used[obsid]} has it too"
                raise InputError(f"{where}.obsid", obsid, allowed="a number of its own", hint=hint)
            used[obsid] = number
            planned.append(replace(item, obsid=obsid, realisation=realisations[item.step], programme=folder))
    return tuple(planned)


def _dated(entry: config.SequenceConfig, begin_utc: str) -> tuple[list[PlannedSequence], str]:
    """Return the sequences of an entry in the order of time, without numbers, and when the next entry may begin."""
    grid = list(entry.grid())
    paces_s = [exposure_s + _readout_s(entry, entry.camera_of(band)) for band, exposure_s, _ in grid]

    def lasts_s(step: int, n_frames: int) -> float:
        """Return the time from the begin of the first exposure to the end of the last."""
        return (n_frames - 1) * paces_s[step] + grid[step][1]

    found: list[PlannedSequence] = []
    if not entry.is_programme:
        free_utc = begin_utc
        for step, pace_s in enumerate(paces_s):
            times = products.sequence_times(free_utc, lasts_s(step, entry.frames), 0.0, 1)
            found.append(PlannedSequence(entry, step, *grid[step], free_utc, times))
            free_utc = _later(free_utc, entry.frames * pace_s)
        return found, free_utc
    parts = products.visit_parts(entry, paces_s)
    timings = programme_timing(entry, parts)
    entries = {"science": entry, "reference": entry.reference_entry()}
    begins_s = np.array([part.start_s for part in parts])
    ends_s = begins_s + [lasts_s(part.step, part.n_frames) for part in parts]
    for part, times in zip(parts, products.times_after(begin_utc, begins_s, ends_s).each(), strict=True):
        own = entries[part.role], part.step, *grid[part.step]
        found.append(PlannedSequence(*own, times.start_utc, times, part, timings[part.role]))
    return found, _later(begin_utc, max(part.start_s + part.n_frames * paces_s[part.step] for part in parts))


def _later(utc: str, seconds: float) -> str:
    """Return a time of UTC some seconds later."""
    return products.sequence_times(utc, seconds, 0.0, 1).stop_utc


def _readout_s(entry: config.SequenceConfig, camera: str) -> float:
    return entry.instrument.channel(camera).detector.readout_s


def _stream(entry: config.SequenceConfig, band: str) -> Hashable:
    """Return what names the random streams of a sequence besides its realisation."""
    if entry.scene is not None:
        return entry.seed, entry.scene.name, entry.role, band
    return entry.seed, entry.kind, entry.camera_of(band), band


def _streams(entry: config.SequenceConfig, band: str) -> set[Hashable]:
    """Return what names the random streams of an entry, those of its reference visits too."""
    own = (entry, entry.reference_entry()) if entry.references else (entry,)
    return {_stream(one, band) for one in own}


def _given_realisations(simulation: config.SimulationConfig) -> dict[Hashable, set[int]]:
    given: dict[Hashable, set[int]] = defaultdict(set)
    for entry in simulation.sequences:
        if entry.realisation is not None:
            for band, _, _ in entry.grid():
                for key in _streams(entry, band):
                    given[key].add(entry.realisation)
    return given


def _free_realisation(keys: set[Hashable], taken: Mapping[Hashable, set[int]], counts: dict[Hashable, int]) -> int:
    """Return the first number that no sequence of these streams has, and count it."""
    number = max(counts.get(key, 0) for key in keys)
    while any(number in taken[key] for key in keys):
        number += 1
    counts.update(dict.fromkeys(keys, number + 1))
    return number


def _obsid(entry: config.SequenceConfig, position: int, step: int) -> str:
    prefix = entry.instrument.mission.obsid_prefix
    if entry.obsid is not None:
        return products.checked_obsid(f"{entry.obsid + step:011d}", prefix)
    digits = products.OBSID_DIGITS - len(prefix)
    if position >= 10**digits:
        raise InputError("sequences", position, allowed=f"at most {10**digits - 1} with the prefix {prefix}")
    return f"{prefix}{position:0{digits}d}"


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


def modelled(item: PlannedSequence) -> results.ModellingRecord | None:
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
    calibration_frames: int = 0,
    off_mask_arcsec: tuple[float, float] = (2.0, 2.0),
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
        Values that replace those of every sequence; see `simulator.config.simulation.simulation_of`.
    instrument : Instrument, mapping, str or Path, optional
        In place of the default one and of those of the simulations.
    date_utc : str, optional
        Date of the places of the stars of tables and of their companions, UTC; that of the first frame by default.
    calibration_frames : int
        Frames of the calibrations that are added, see `with_calibrations`, and make each scene a programme; none for 0.
    off_mask_arcsec : tuple of float
        As of `with_calibrations`.

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
        if calibration_frames:
            own = {"reference_visits": own.get("visits", 1)} | own
        sequences += [config.validate(SequenceConfig, own | {"scene": scene, "instrument": whole}) for scene in found]
    if whole is None:
        for key, value in own.items():
            raise InputError(key, value, allowed="for scenes and tables; a simulation names its own")
    if date_utc is not None and not dated:
        allowed = "together with a table of stars; scenes and simulations have places of their own"
        raise InputError("date_utc", date_utc, unit="UTC", allowed=allowed)
    title = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    description = described if len(names) == 1 else ""
    simulation = config.simulation_of(title, sequences, description=description, changes=changes)
    if calibration_frames:
        simulation = with_calibrations(simulation, calibration_frames, off_mask_arcsec)
    return simulation, tuple(notes)


FILLED = 0.5
"""Share of what it holds to which the brightest pixel of the star off the mask is filled."""


def with_calibrations(
    simulation: SimulationConfig, frames: int, off_mask_arcsec: tuple[float, float] = (2.0, 2.0)
) -> SimulationConfig:
    """Return a simulation with the calibrations that its programmes need behind them.

    Bias and dark frames have the gains and exposures of the visits, flat frames their bands at a gain of 1, with bias
    frames of their own; in each band and gain the star stands off the mask, at the exposure of `off_mask_exposure_s`.

    Parameters
    ----------
    simulation : SimulationConfig
    frames : int
        Frames of each of these sequences.
    off_mask_arcsec : tuple of float
        Place of the star from the centre of the mask, x and y, rounded to whole pixels.

    Raises
    ------
    InputError
        Without a programme, or where a star off the mask is not on the detector.
    """
    visits = [entry for entry in simulation.sequences if entry.is_programme]
    if not visits:
        hint = "visits or reference_visits make one of a sequence"
        raise InputError(called("programme"), simulation.name, allowed="a simulation with a programme", hint=hint)
    added: list[dict[str, Any]] = []
    for entry in visits:
        shared = {"frames": frames, **{name: getattr(entry, name) for name in ("instrument", "seed", "switches")}}
        sky = {name: getattr(entry, name) for name in ("fidelity", "tolerance", "scene_model", "roll_deg")}
        sky |= {"kind": "CALS", "scene": entry.scene and entry.scene.without_planets()}
        for camera in entry.cameras:
            own = shared | {"camera": camera}
            added.append(own | {"kind": "BIAS", "em_gain": tuple(dict.fromkeys((1.0, *entry.em_gain)))})
            added.append(own | {"kind": "DARK", "em_gain": entry.em_gain, "exposure_s": entry.exposure_s})
        added.append(shared | {"kind": "FLAT", "band": entry.band, "exposure_s": (1.0,)})
        for band in entry.band:
            scale = entry.instrument.pixel_scale_arcsec(band)
            star = tuple(round(offset / scale) * scale for offset in off_mask_arcsec)
            peak_e_s = _off_mask_peak_e_s(entry, band, star)
            for gain in entry.em_gain:
                limit_e = _limit_e(entry.instrument.channel_of(band).detector, gain)
                exposure_s = min(_rounded_down(FILLED * limit_e / peak_e_s), max(entry.exposure_s))
                place = {"star_offset_arcsec": star, "exposure_s": (exposure_s,)}
                added.append(shared | sky | place | {"band": (band,), "em_gain": (gain,)})
    unlike = [item for number, item in enumerate(added) if item not in added[:number]]
    entries = [config.validate(SequenceConfig, item) for item in unlike]
    return simulation.model_copy(update={"sequences": (*simulation.sequences, *entries)})


def _off_mask_peak_e_s(entry: SequenceConfig, band: str, off_mask_arcsec: tuple[float, ...]) -> float:
    """Return the rate of the brightest pixel with the star off the mask, electrons per second."""
    seen = observing.observe(
        cast(Scene, entry.scene),
        band=band,
        exposure_s=1.0,
        instrument=entry.instrument,
        fidelity=entry.fidelity,
        role="calibration",
        kind="CALS",
        star_offset_arcsec=cast(Any, off_mask_arcsec),
    )
    active = entry.instrument.detector_of(band).sections["active"]
    x, y = seen.truth.x_pixel[0], seen.truth.y_pixel[0]
    if not (active[0].start <= y < active[0].stop and active[1].start <= x < active[1].stop):
        allowed = f"a place on the detector in {band}"
        raise InputError(called("off_mask_arcsec"), off_mask_arcsec, unit="arcsec", allowed=allowed)
    return float(seen.mean_rate_map.max())


def _limit_e(detector: config.AnyDetector, em_gain: float) -> float:
    """Return the charge, at the register input, beyond which a limit cuts a pixel off."""
    return min(detector.full_well_e, min(detector.register_full_well_e, detector.converter_e) / em_gain)


def _rounded_down(value: float) -> float:
    """Return a number above 0 with two digits, not above it."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit) * unit:.1e}")


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


def simulation_estimate(
    simulation: SimulationConfig, *, truth: bool = True, workers: int = 1
) -> results.SimulationEstimate:
    """Return the sequences of a simulation, and what they would cost: wall time, memory of a worker, disk.

    Raises
    ------
    InputError
        As `cpic_planner.simulation.simulate`, for what can be known before frames are made.
    """
    planned = plan_sequences(simulation)
    check_light(planned)
    records = [modelled(item) for item in planned]
    rows = [
        results.PlannedSequenceRow.of(item, **item.about, modelled=record)
        for item, record in zip(planned, records, strict=True)
    ]
    return results.SimulationEstimate(
        name=simulation.name,
        n_sequences=len(planned),
        n_frames=sum(item.n_frames for item in planned),
        workers=workers,
        **sequences_cost(planned, records, truth=truth).at(workers, pace()),
        sequences=rows,
    )


def sequences_cost(
    planned: Sequence[PlannedSequence], records: Sequence[results.ModellingRecord | None], *, truth: bool
) -> Cost:
    """Return the expected cost of sequences.

    Parameters
    ----------
    planned : sequence of PlannedSequence
    records : sequence of ModellingRecord or None
        What each models, see `cpic_planner.simulation.modelled`.
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


def _time_s(item: PlannedSequence, record: results.ModellingRecord | None) -> float:
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


RESULT_VERSION = 4
"""Raised when the same configuration gives other frames, so that old folders are not continued."""


def simulation_job(
    planned: Sequence[PlannedSequence],
    simulation: SimulationConfig,
    *,
    truth: bool,
    notes: Sequence[str] = (),
    cubes: Sequence[CubeKind] = (),
) -> Job[results.SimulationResult]:
    """Return the job that makes the Level-0 products of a simulation.

    Parameters
    ----------
    planned : sequence of PlannedSequence
        Its sequences, see `cpic_planner.simulation.plan_sequences`.
    simulation : SimulationConfig
    truth : bool
        Write the truth beside the products.
    notes : sequence of str
        Remarks on the reading of tables of stars.
    cubes : sequence of {"vip", "pyklip"}
        Packages for which the frames of programmes are written, calibrated.

    Raises
    ------
    InputError
        For cubes of a programme without references or a star off the mask.
    """
    hashes, files = _hashes(planned)
    sets = _cube_sets(planned) if cubes else {}
    settings = [item.settings(hashes) for item in planned]

    def work(runner: Runner[Any]) -> results.SimulationResult:
        folder = runner.folder
        for item in planned:
            products.refuse_taken(folder.path / item.folder, item.name, overwrite=True)
        root = str(folder.temporary.resolve())
        tasks = [Task(item.obsid, (item, root, truth), steps=item.n_frames) for item in planned]
        bodies = runner.finish(make_sequence, tasks, tells=True)
        looked = {item.obsid: item for one in sets.values() for item in (*one.science, *one.references, one.star)}
        tasks = [Task(f"cube {key}", (item,), item.target, steps=0) for key, item in looked.items()]
        runner.finish(make_cube, tasks, kept=False)
        rows = [_row(item, own, bodies[item.obsid], truth) for item, own in zip(planned, settings, strict=True)]
        return results.SimulationResult(
            version=__version__,
            config_hash=runner.digest,
            name=simulation.name,
            description=simulation.description,
            n_frames=sum(item.n_frames for item in planned),
            size_bytes=sum(row.size_bytes for row in rows),
            sequences=rows,
            programmes=list(_programmes(planned, bodies)),
            notes=list(notes),
        )

    def write(folder: RunFolder, result: results.SimulationResult, bodies: Mapping[str, Any]) -> None:
        for programme in result.programmes:
            folder.write(programme.file, dump_json(programme.model_dump(mode="json")))
        for kind in cubes:
            for place, one in sets.items():
                for name, content in one.files(kind, bodies).items():
                    folder.write_bytes(f"{place.format(kind=kind)}/{name}", content)

    return Job(
        kind="simulation",
        results=RESULT_VERSION,
        decides=lambda: {"truth": truth, "sequences": settings, "files": files},
        work=work,
        write=write,
        products=[*(name for item in planned for name in _files(item, truth=truth)), *_manifests(planned)],
        cost=lambda: sequences_cost(planned, [modelled(item) for item in planned], truth=truth),
    )


def simulate(
    simulation: SimulationConfig,
    out: str | Path,
    *,
    truth: bool = True,
    notes: Sequence[str] = (),
    cubes: Sequence[CubeKind] = (),
    **how: Unpack[RunSettings],
) -> Runner[results.SimulationResult]:
    """Make the Level-0 products of a simulation.

    Parameters
    ----------
    simulation : SimulationConfig
        See `simulator.config.simulation.load_simulation`.
    out : str or Path
        Root of the tree of products; continued when it holds part of the same simulation.
    truth : bool
        Write the truth beside the products.
    notes : sequence of str
        Remarks on the reading of tables of stars, as `cpic_planner.simulation.simulation_from` returns them.
    cubes : sequence of {"vip", "pyklip"}
        As of `simulation_job`.
    **how
        As of `cpic_planner.jobs.job.run`. Workers of another ``scheduler`` see ``out`` under the same name.
        ``advance`` is told about frames: one by one in this process, a sequence at a time with several workers.

    Raises
    ------
    InputError
        For bad input, too small a disk, or if ``out`` is in use or holds another configuration.
    """
    planned = plan_sequences(simulation)
    check_light(planned)
    job = simulation_job(planned, simulation, truth=truth, notes=notes, cubes=cubes)
    _check_room(Path(out), planned, truth=truth)
    return run(job, out, **how)


def _hashes(planned: Sequence[PlannedSequence]) -> tuple[dict[int, str], dict[str, str]]:
    """Return the hashes of scenes and instruments by their identity, and those of the files that they name."""
    hashes: dict[int, str] = {}
    files: dict[str, str] = {}
    for part in (part for item in planned for part in (item.entry.scene, item.entry.instrument) if part is not None):
        if id(part) not in hashes:
            tree = part.model_dump(mode="json")
            files |= {name: digest_of(name) for name in _named_files(tree) if name not in files}
            hashes[id(part)] = content_hash(tree)
    return hashes, files


def _named_files(tree: Any) -> Iterator[str]:
    """Yield the texts of a configuration that are names of files."""
    if isinstance(tree, dict):
        for item in tree.values():
            yield from _named_files(item)
    elif isinstance(tree, list):
        for item in tree:
            yield from _named_files(item)
    elif isinstance(tree, str) and is_file(tree):
        yield tree


@dataclass
class _Tally:
    """The contents of the frames of a sequence, noted while they go by."""

    sequence: "observing.FrameSequence"
    adu_min: int = 2**16 - 1
    adu_max: int = 0
    saturated_pixels: int = 0
    clipped_pixels: int = 0
    cosmic_rays: int = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.sequence, name)

    def iter_full_frames(self) -> Iterator[Frame]:
        """Yield the frames of the sequence."""
        for frame in self.sequence.iter_full_frames():
            self.adu_min = min(self.adu_min, int(frame.adu.min()))
            self.adu_max = max(self.adu_max, int(frame.adu.max()))
            self.saturated_pixels = max(self.saturated_pixels, int(frame.lost.sum()))
            self.clipped_pixels = max(self.clipped_pixels, frame.n_clipped)
            self.cosmic_rays += frame.n_cosmic_rays
            yield frame


_TALLIED = ("adu_min", "adu_max", "saturated_pixels", "clipped_pixels", "cosmic_rays")


def make_sequence(
    item: PlannedSequence, root: str, truth: bool, *, progress: Callable[..., None] | None = None
) -> dict[str, Any]:
    """Make the files of one sequence below ``root/OBSID``; return their sizes and checksums, and what frames hold."""
    own = Path(root) / item.obsid
    try:
        tally = _Tally(item.build())
        shown = f"{item.target} {item.band}".strip()
        advance = None if progress is None else lambda done, total: progress(shown, 1)
        products.write_level0(
            cast(Any, tally), own / item.folder, obsid=item.obsid, overwrite=True, truth=truth, progress=advance
        )
    except InputError as error:
        raise located(error, f"sequence {item.obsid}") from None
    files = contents_of(own, _files(item, truth=truth))
    streams = {} if item.part is None else {"streams": list(tally.path)}
    return {"files": files} | {name: getattr(tally, name) for name in _TALLIED} | streams


def _files(item: PlannedSequence, *, truth: bool) -> list[str]:
    """Return the files of a sequence below the root, the Level-0 file first."""
    params = [item.name.params / file for file in products.PARAMS_FILES]
    return [item.place(path) for path in [item.name.file, *([item.name.truth] if truth else []), *params]]


def _manifests(planned: Sequence[PlannedSequence]) -> dict[str, list[PlannedSequence]]:
    """Return the sequences of each programme by the file that lists them."""
    found: dict[str, list[PlannedSequence]] = {}
    for item in planned:
        if item.part is not None:
            found.setdefault((Path(item.programme) / products.PROGRAMME_FILE).as_posix(), []).append(item)
    return found


def _programmes(planned: Sequence[PlannedSequence], bodies: Mapping[str, Any]) -> Iterator[results.SimulatedProgramme]:
    """Yield what each programme is."""
    for file, items in _manifests(planned).items():
        science = next(item for item in items if item.entry.role == "science").entry
        looked = {item.target for item in items if item.entry.role == "reference"}
        yield results.SimulatedProgramme(
            fingerprint=str(fingerprint()),
            file=file,
            target=science.scene.name if science.scene else "",
            reference=next(iter(looked), None),
            visits=science.visits,
            reference_visits=science.references,
            reference_scheme=science.reference_scheme,
            visit_gap_h=science.visit_gap_h,
            orbit_s=products.orbit_s(science),
            span_days=max(item.end_mjd for item in items) - min(item.begin_mjd for item in items),
            sequences=[_visit_row(item, bodies[item.obsid]["streams"], planned) for item in items],
            calibrations=[
                results.CalibrationRow.of(item, **_masters(item, items[0].programme, planned))
                for item in planned
                if item.kind in _CALIBRATIONS
            ],
        )


def _visit_row(item: PlannedSequence, streams: list[str | int], planned: Sequence[PlannedSequence]) -> results.VisitRow:
    assert item.part is not None
    return results.VisitRow.of(
        item.part,
        item,
        item.entry,
        visit=item.part.visit + 1,
        window=item.part.window + 1,
        streams=streams,
        **_masters(item, item.programme, planned),
    )


_CALIBRATIONS = ("CALS", "BIAS", "DARK", "FLAT")


def _nearest(
    item: PlannedSequence, planned: Iterable[PlannedSequence], kind: str, *same: str
) -> PlannedSequence | None:
    """Return the sequence of a kind with the exposure nearest to that of an item, and the same camera and settings."""
    like = operator.attrgetter("camera", "instrument", *same)
    fit = [other for other in planned if other.kind == kind and like(other) == like(item)]

    def ratio(other: PlannedSequence) -> float:
        return abs(math.log(max(other.exposure_s, 1e-9) / max(item.exposure_s, 1e-9)))

    return min(fit, key=ratio, default=None)


def _star_off_mask(item: PlannedSequence, planned: Sequence[PlannedSequence]) -> PlannedSequence | None:
    off = [other for other in planned if any(other.entry.star_offset_arcsec)]
    return _nearest(item, off, "CALS", "target", "band", "em_gain")


def _masters(item: PlannedSequence, programme: str, planned: Sequence[PlannedSequence]) -> dict[str, Any]:
    """Return where a file of a programme is, what it looks at, and the calibrations of the run that it needs."""

    def place(file: PlannedSequence | None) -> str | None:
        if file is None:
            return None
        return Path(os.path.relpath(file.place(file.name.file), programme or ".")).as_posix()

    found: dict[str, Any] = {"file": place(item), "roll_deg": None}
    if item.kind != "BIAS":
        found["bias"] = place(_nearest(item, planned, "BIAS", "em_gain"))
    if not item.on_sky:
        return found
    found["dark"] = place(_nearest(item, planned, "DARK", "em_gain"))
    found["flat"] = place(_nearest(item, planned, "FLAT", "band"))
    if item.kind != "CALS":
        found["star"] = place(_star_off_mask(item, planned))
    detector, scale = item.instrument.channel(item.camera).detector, item.instrument.pixel_scale_arcsec(item.band)
    x, y = (offset / scale for offset in item.entry.star_offset_arcsec)
    place_px = {"star_x_pixel": detector.star_column + x, "star_y_pixel": detector.star_row + y}
    return found | place_px | {"roll_deg": item.entry.roll_deg}


class CubeSet(Record):
    """The sequences of a programme that are reduced together: those of one band, exposure and gain.

    Attributes
    ----------
    science, references : tuple of PlannedSequence
    star : PlannedSequence
        The star off the mask.
    """

    science: tuple[PlannedSequence, ...]
    references: tuple[PlannedSequence, ...]
    star: PlannedSequence

    def files(self, kind: CubeKind, bodies: Mapping[str, Any]) -> dict[str, bytes]:
        """Return the files of the set by their names.

        Parameters
        ----------
        kind : {"vip", "pyklip"}
        bodies : mapping
            Bodies of finished tasks, those of `make_cube` among them.
        """
        first, instrument = self.science[0], self.star.instrument
        scale, band = instrument.pixel_scale_arcsec(first.band), instrument.band(first.band)
        about: dict[str, Any] = {
            "target": first.target,
            "reference": self.references[0].target,
            "band": first.band,
            "wavelength_um": 1e-3 * band.center_nm,
            "pixel_scale_arcsec": scale,
            "lambda_d_pixel": instrument.lambda_d_arcsec(first.band) / scale,
            "exposure_s": first.exposure_s,
            "star_exposure_s": self.star.exposure_s,
            "em_gain": first.em_gain,
        }
        for name, items in (("science", self.science), ("reference", self.references), ("star", (self.star,))):
            about[f"{name}_files"] = [item.place(item.name.file) for item in items]
        cube = {item.obsid: bodies[f"cube {item.obsid}"] for item in (*self.science, *self.references, self.star)}
        science = [(cube[item.obsid], item.entry.roll_deg) for item in self.science]
        return cube_files(kind, science, [cube[item.obsid] for item in self.references], cube[self.star.obsid], about)


def _cube_sets(planned: Sequence[PlannedSequence]) -> dict[str, CubeSet]:
    """Return what is reduced together in a simulation, by the folder of its cubes with the package left open."""
    steps: dict[tuple[str, int], list[PlannedSequence]] = {}
    for item in planned:
        if item.part is not None:
            steps.setdefault((item.programme, item.step), []).append(item)
    found = {}
    for items in steps.values():
        science = tuple(item for item in items if item.entry.role == "science")
        references = tuple(item for item in items if item.entry.role == "reference")
        star = _star_off_mask(science[0], planned)
        if star is None or not references:
            allowed = "for programmes with references and a star off the mask"
            raise InputError(called("cubes"), "given", allowed=allowed, hint=called("programme"))
        first = science[0]
        place = f"{first.band}_{first.exposure_s:g}s_gain{first.em_gain:g}"
        found[PurePath(first.programme, products.CUBE_FOLDER, "{kind}", place).as_posix()] = CubeSet(
            science, references, star
        )
    return found


def make_cube(item: PlannedSequence) -> Cube:
    """Return the calibrated frames of a sequence."""
    built = cast(Any, item.build())
    if item.part is None:
        return calibrated_cube(built, range(item.n_frames))
    return calibrated_cube(built.visit, range(item.part.first_frame, item.part.first_frame + item.n_frames))


def _check_room(root: Path, planned: Sequence[PlannedSequence], *, truth: bool) -> None:
    """Refuse a simulation that the disk has no room for, before anything is written."""
    needed = sum(disk_bytes(item, truth=truth) for item in planned if not (root / item.place(item.name.file)).exists())
    whole = root.resolve()
    free = shutil.disk_usage(next(place for place in (whole, *whole.parents) if place.is_dir())).free
    if needed > free:
        allowed = f"a disk with {needed / 1e6:,.1f} MB to spare"
        hint = f"{free / 1e6:,.1f} MB are free there, {(needed - free) / 1e6:,.1f} MB too few"
        raise InputError("--out", str(root), allowed=allowed, hint=hint)


def _row(
    item: PlannedSequence, settings: dict[str, Any], body: Mapping[str, Any], truth: bool
) -> results.SimulatedSequence:
    return results.SimulatedSequence.of(
        item,
        **item.about,
        modelled=modelled(item),
        settings=settings,
        truth=item.place(item.name.truth) if truth else None,
        params=item.place(item.name.params),
        size_bytes=sum(known["size_bytes"] for known in body["files"].values()),
        sha256=body["files"][item.place(item.name.file)]["sha256"],
        **{name: body[name] for name in _TALLIED},
    )
