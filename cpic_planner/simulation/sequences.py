"""The sequences of a simulation, one by one: numbers, times, file names, and what makes their frames."""

import dataclasses
from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from cpic_core import InputError
from simulator import config, products


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


@dataclass(frozen=True)
class PlannedSequence:
    """One sequence: its entry in the simulation, its place in the entry's grid, its number and times.

    Attributes
    ----------
    entry : SequenceConfig
    obsid : str
        Eleven digits.
    band : str
        Empty for BIAS and DARK.
    camera : {"VIS", "NIR"}
    exposure_s, em_gain : float
    realisation : int
    start_utc : str
    name : ProductName
        Places of its files below `folder`.
    begin_mjd, end_mjd : float
        Begin of the first and end of the last exposure, MJD (UTC).
    part : VisitPart or None
        Which frames of which visit it has; None outside of a programme. The frames of ``entry`` are those of a visit.
    timing : Timing or None
        When the visits of its role are.
    programme : str
        Folder of the programme; empty for the only one of a simulation, and outside of one.
    """

    entry: config.SequenceConfig
    obsid: str
    band: str
    camera: str
    exposure_s: float
    em_gain: float
    realisation: int
    start_utc: str
    name: products.ProductName
    begin_mjd: float
    end_mjd: float
    part: products.VisitPart | None = None
    timing: config.Timing | None = None
    programme: str = ""

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

    def row(self) -> dict[str, Any]:
        """Return the row in plain values."""
        own = ("obsid", "target", "camera", "band", "exposure_s", "n_frames", "em_gain", "start_utc")
        role = self.entry.role if self.on_sky else ""
        about: dict[str, Any] = {"kind": self.entry.kind, "role": role, "file": self.place(self.name.file)}
        if self.part is not None:
            about |= {"visit": self.part.visit + 1, "window": self.part.window + 1}
        return {name: getattr(self, name) for name in own} | about

    def settings(self, digest: Callable[[config.FrozenModel], str] = lambda part: part.content_hash) -> dict[str, Any]:
        """Return what decides its frames, as plain values; scene and instrument by their hash."""
        entry = self.entry
        useful = set(config.meaningful_keys(entry.kind)) - {"scene", "instrument", *config.PROGRAMME_KEYS}
        plain = entry.model_dump(mode="json", include=useful)
        own = ("obsid", "band", "camera", "exposure_s", "em_gain", "realisation", "start_utc")
        scene = None if entry.scene is None else digest(entry.scene)
        hashes = {"scene": scene, "instrument": digest(entry.instrument)}
        switches = {"switches": entry.switches_for(self.camera)}
        visit = {} if self.part is None else {"part": dataclasses.asdict(self.part), "folder": self.folder}
        visit |= {} if self.timing is None else {"timing": dataclasses.asdict(self.timing)}
        return plain | {name: getattr(self, name) for name in own} | switches | hashes | visit

    def build(self) -> products.FrameSequence:
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
            band, exposure_s, em_gain = item.grid
            camera, times = entry.camera_of(band), item.times
            what = SimpleNamespace(camera=camera, kind=entry.kind, instrument=entry.instrument)
            planned.append(
                PlannedSequence(
                    entry=item.entry,
                    obsid=obsid,
                    band=band,
                    camera=camera,
                    exposure_s=exposure_s,
                    em_gain=em_gain,
                    realisation=realisations[item.step],
                    start_utc=item.start_utc,
                    name=products.product_name(cast(Any, what), times, obsid),
                    begin_mjd=float(times.begin_mjd[0]),
                    end_mjd=float(times.end_mjd[0]),
                    part=item.part,
                    timing=item.timing,
                    programme=folder,
                )
            )
    return tuple(planned)


@dataclass(frozen=True)
class _Dated:
    """A sequence of an entry with its times; ``step`` counts band, exposure and gain, which are its ``grid``."""

    entry: config.SequenceConfig
    step: int
    grid: tuple[str, float, float]
    start_utc: str
    times: products.SequenceTimes
    part: products.VisitPart | None = None
    timing: config.Timing | None = None


def _dated(entry: config.SequenceConfig, begin_utc: str) -> tuple[list[_Dated], str]:
    """Return the sequences of an entry in the order of time, and when the next entry may begin."""
    grid = list(entry.grid())
    paces_s = [exposure_s + _readout_s(entry, entry.camera_of(band)) for band, exposure_s, _ in grid]

    def lasts_s(step: int, n_frames: int) -> float:
        """Return the time from the begin of the first exposure to the end of the last."""
        return (n_frames - 1) * paces_s[step] + grid[step][1]

    found: list[_Dated] = []
    if not entry.is_programme:
        free_utc = begin_utc
        for step, pace_s in enumerate(paces_s):
            times = products.sequence_times(free_utc, lasts_s(step, entry.frames), 0.0, 1)
            found.append(_Dated(entry, step, grid[step], free_utc, times))
            free_utc = _later(free_utc, entry.frames * pace_s)
        return found, free_utc
    parts = products.visit_parts(entry, paces_s)
    timings = programme_timing(entry, parts)
    entries = {"science": entry, "reference": entry.reference_entry()}
    begins_s = np.array([part.start_s for part in parts])
    ends_s = begins_s + [lasts_s(part.step, part.n_frames) for part in parts]
    for part, times in zip(parts, products.times_after(begin_utc, begins_s, ends_s).each(), strict=True):
        own = entries[part.role], part.step, grid[part.step]
        found.append(_Dated(*own, times.start_utc, times, part, timings[part.role]))
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
