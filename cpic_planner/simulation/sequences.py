"""The sequences of a simulation, one by one: numbers, times, file names, and what makes their frames."""

from collections import defaultdict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

from cpic_core import InputError
from simulator.config import SKY_KINDS, FrozenModel, SequenceConfig, SimulationConfig, at, meaningful_keys
from simulator.products import OBSID_DIGITS, FrameSequence, ProductName, checked_obsid, product_name, sequence_times


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
        Places of its files.
    """

    entry: SequenceConfig
    obsid: str
    band: str
    camera: str
    exposure_s: float
    em_gain: float
    realisation: int
    start_utc: str
    name: ProductName

    @property
    def target(self) -> str:
        """Name of the scene, or the kind where there is none."""
        return self.entry.kind if self.entry.scene is None else self.entry.scene.name

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.entry.frames

    @property
    def on_sky(self) -> bool:
        """Whether the sequence looks at a scene."""
        return self.entry.kind in SKY_KINDS

    @property
    def readout_s(self) -> float:
        """Dead time after each frame."""
        return _readout_s(self.entry, self.camera)

    def row(self) -> dict[str, Any]:
        """What it is, in plain values."""
        own = ("obsid", "target", "camera", "band", "exposure_s", "n_frames", "em_gain", "start_utc")
        role = self.entry.role if self.on_sky else ""
        about = {"kind": self.entry.kind, "role": role, "file": self.name.file.as_posix()}
        return {name: getattr(self, name) for name in own} | about

    def settings(self, digest: Callable[[FrozenModel], str] = lambda part: part.content_hash) -> dict[str, Any]:
        """What decides its frames, as plain values; scene and instrument by their hash."""
        entry = self.entry
        useful = set(meaningful_keys(entry.kind)) - {"scene", "instrument"}
        plain = entry.model_dump(mode="json", include=useful)
        own = ("obsid", "band", "camera", "exposure_s", "em_gain", "realisation", "start_utc")
        scene = None if entry.scene is None else digest(entry.scene)
        hashes = {"scene": scene, "instrument": digest(entry.instrument)}
        switches = {"switches": entry.switches_for(self.camera)}
        return plain | {name: getattr(self, name) for name in own} | switches | hashes

    def build(self) -> FrameSequence:
        """Set up the sequence; frames are drawn when they are asked for."""
        entry = self.entry
        shared = {name: getattr(self, name) for name in ("n_frames", "em_gain", "realisation", "start_utc")}
        shared |= {"seed": entry.seed, "instrument": entry.instrument, "switches": entry.switches_for(self.camera)}
        if entry.scene is not None:
            from simulator.observing import observe

            names = ("fidelity", "tolerance", "roll_deg", "star_offset_arcsec", "role", "scene_model")
            shared |= {name: getattr(entry, name) for name in names}
            kind = cast(Any, entry.kind)
            return observe(entry.scene, band=self.band, exposure_s=self.exposure_s, kind=kind, **shared)
        from simulator.observing import calibrate

        shared |= {name: getattr(entry, name) for name in ("level_e", "offset_arcsec", "ra_deg", "dec_deg")}
        camera = None if self.band else entry.camera
        return calibrate(cast(Any, entry.kind), band=self.band, camera=camera, exposure_s=self.exposure_s, **shared)


def plan_sequences(simulation: SimulationConfig) -> tuple[PlannedSequence, ...]:
    """Number and date the sequences of a simulation.

    A sequence without a begin of its own follows the one before it after the ``overhead_s`` of its instrument; the
    first begins with the mission. Numbers are the instrument's prefix and the position in the simulation, or those that
    an entry gives. Realisations are counted as `SequenceConfig` says.

    Raises
    ------
    InputError
        If a number is not one of the instrument's or used twice, or a time is out of range.
    """
    taken = _given_realisations(simulation)
    counts: dict[Hashable, int] = defaultdict(int)
    used: dict[str, int] = {}
    planned: list[PlannedSequence] = []
    free_utc: str | None = None
    for number, entry in enumerate(simulation.sequences):
        for step, (band, exposure_s, em_gain) in enumerate(entry.grid()):
            camera = entry.camera_of(band)
            where = f"simulation.sequences.{number}"
            try:
                obsid = _obsid(entry, len(planned) + 1, step)
                start = entry.start_utc if entry.start_utc is not None and step == 0 else free_utc
                start = start or entry.instrument.mission.start_utc
                pace_s = exposure_s + _readout_s(entry, camera)
                times = sequence_times(start, (entry.frames - 1) * pace_s + exposure_s, 0.0, 1)
                free_utc = sequence_times(start, entry.frames * pace_s + entry.instrument.overhead_s, 0.0, 1).stop_utc
            except InputError as error:
                raise at(where, error) from None
            if obsid in used:
                hint = f"simulation.sequences.{used[obsid]} has it too"
                raise InputError(f"{where}.obsid", obsid, allowed="a number of its own", hint=hint)
            used[obsid] = number
            realisation = entry.realisation
            if realisation is None:
                key = _stream(entry, band)
                while counts[key] in taken[key]:
                    counts[key] += 1
                realisation = counts[key]
                counts[key] += 1
            what = SimpleNamespace(camera=camera, kind=entry.kind, instrument=entry.instrument)
            name = product_name(cast(Any, what), times, obsid)
            planned.append(PlannedSequence(entry, obsid, band, camera, exposure_s, em_gain, realisation, start, name))
    return tuple(planned)


def _readout_s(entry: SequenceConfig, camera: str) -> float:
    return entry.instrument.channel(camera).detector.readout_s


def _stream(entry: SequenceConfig, band: str) -> Hashable:
    """What names the random streams of a sequence besides its realisation."""
    if entry.scene is not None:
        return entry.seed, entry.scene.name, entry.role, band
    return entry.seed, entry.kind, entry.camera_of(band), band


def _given_realisations(simulation: SimulationConfig) -> dict[Hashable, set[int]]:
    given: dict[Hashable, set[int]] = defaultdict(set)
    for entry in simulation.sequences:
        if entry.realisation is not None:
            for band, _, _ in entry.grid():
                given[_stream(entry, band)].add(entry.realisation)
    return given


def _obsid(entry: SequenceConfig, position: int, step: int) -> str:
    prefix = entry.instrument.mission.obsid_prefix
    if entry.obsid is not None:
        return checked_obsid(f"{entry.obsid + step:011d}", prefix)
    digits = OBSID_DIGITS - len(prefix)
    if position >= 10**digits:
        raise InputError("sequences", position, allowed=f"at most {10**digits - 1} with the prefix {prefix}")
    return f"{prefix}{position:0{digits}d}"


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
