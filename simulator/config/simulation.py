"""A simulation as configuration: sequences of frames taken one after another, from files, presets and mappings."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from cpic_core import InputError, by_line, check_word, is_file
from simulator.config import scene as scene_file
from simulator.config.base import (
    FrozenModel,
    Real,
    SpelledModel,
    canonical_keys,
    inside,
    other_names,
    preset_tree,
    required,
    validate,
)
from simulator.config.instrument import (
    CameraName,
    Instrument,
    InstrumentLike,
    ReferenceScheme,
    Utc,
    load_instrument,
    paths_beside,
)
from simulator.config.scene import Scene

SequenceKind = Literal["SCI", "DSF", "CALS", "BIAS", "DARK", "FLAT", "BKG", "LASER"]
SKY_KINDS: tuple[SequenceKind, ...] = ("SCI", "DSF", "CALS")
SEQUENCE_KINDS: tuple[SequenceKind, ...] = (*SKY_KINDS, "BIAS", "DARK", "FLAT", "BKG", "LASER")
DEFAULT_EXPOSURE_S = 10.0
MAX_FRAMES = 1_000_000

_COMMON = ("kind", "instrument", "em_gain", "frames", "seed", "realisation", "switches", "start_utc", "obsid")
_SKY = ("scene", "band", "exposure_s", "roll_deg", "star_offset_arcsec", "role", "fidelity", "tolerance", "scene_model")
_REFERENCE = ("reference_visits", "reference_ratio", "reference_scheme", "reference_scene", "reference_roll_deg")
PROGRAMME_KEYS = ("visits", "visit_gap_h", *_REFERENCE)
"""Keys of a sequence that make it a programme of visits."""
_OF_KIND: dict[SequenceKind, tuple[str, ...]] = dict.fromkeys(SKY_KINDS, (*_SKY, *PROGRAMME_KEYS)) | {
    "BIAS": ("camera",),
    "DARK": ("camera", "exposure_s"),
    "FLAT": ("band", "exposure_s", "level_e"),
    "BKG": ("band", "exposure_s", "ra_deg", "dec_deg"),
    "LASER": ("band", "exposure_s", "level_e", "offset_arcsec"),
}
_LISTS = ("band", "exposure_s", "em_gain")

Exposure = Annotated[Real, Field(ge=1e-6, le=1e6)]
Gain = Annotated[Real, Field(ge=1, le=10000)]
Offset = Annotated[Real, Field(ge=-8, le=8)]
Whole = Annotated[int, Field(strict=True)]


def meaningful_keys(kind: Any) -> tuple[str, ...]:
    """Return the keys that a sequence of a kind has a use for.

    Raises
    ------
    InputError
        If there is no such kind.
    """
    check_word("kind", kind, SEQUENCE_KINDS)
    return (*_COMMON, *_OF_KIND[kind])


def of_no_use(key: str, value: Any, kind: str) -> InputError:
    """Return the refusal of a key that a kind of sequence has no use for.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : object
        What was given.
    kind : str
        Kind of the sequence.
    """
    kinds = [name for name in SEQUENCE_KINDS if key in meaningful_keys(name)]
    return InputError(key, value, allowed=f"for {', '.join(kinds)}, not for {kind}")


class SequenceSettings(FrozenModel):
    """The settings of a sequence beside its scene and instrument: keys of files, and options of a question alike."""

    kind: SequenceKind = Field("SCI", description="Type of the sequence; BIAS to LASER need no scene.")
    band: tuple[str, ...] = Field((), description="Band, e.g. F662; repeat, or F520,F662, for several.")
    camera: CameraName = Field("VIS", description="Camera of BIAS and DARK.")
    exposure_s: tuple[Exposure, ...] = Field(
        (DEFAULT_EXPOSURE_S,), description="Exposure of a frame; repeat, or 30,300, for several."
    )
    em_gain: tuple[Gain, ...] = Field((1.0,), description="Actual EM gain; repeat, or 1,20, for several.")
    frames: Annotated[Whole, Field(ge=1, le=MAX_FRAMES)] = Field(1, description="Frames of a sequence.")
    roll_deg: Real = Field(0.0, description="Roll of the telescope.")
    star_offset_arcsec: tuple[Offset, Offset] = Field(
        (0.0, 0.0), description="Place of the star relative to the centre of the mask."
    )
    role: Literal["science", "reference", "calibration"] = Field(
        "science", description="Which visit: each has a wavefront of its own; {visits} has both."
    )
    fidelity: Literal["quick", "standard", "reference"] = Field(
        "standard", description="Speed against accuracy of the optics."
    )
    tolerance: Annotated[Real, Field(ge=0, le=0.5)] = Field(
        0.0, description="Leave out what is predicted to change planet flux, SNR and pixels by less than this."
    )
    scene_model: Literal["exact", "paper"] = Field(
        "exact", description="Light of the scene: exact, or in the paper's approximation."
    )
    visits: Annotated[Whole, Field(ge=1, le=1000)] = Field(
        1, description="Science visits that are reduced together, each with a wavefront of its own."
    )
    reference_visits: Annotated[Whole, Field(ge=0, le=100_000)] | None = Field(
        None, description="Visits that the reference frames are spread over."
    )
    reference_ratio: Annotated[Real, Field(ge=0.001, le=1000)] = Field(
        1.0, description="Reference frames of a programme per science frame."
    )
    reference_scheme: ReferenceScheme = Field(
        "interleaved",
        description="When references are taken: in the next orbit at the same phase, in the second half of each "
        "orbit's window, in halves whose order turns from visit to visit, or of another star a quarter of an orbit "
        "later.",
    )
    reference_roll_deg: Real | None = Field(None, description="Roll of reference visits.")
    visit_gap_h: Annotated[Real, Field(ge=0, le=1e5)] = Field(
        0.0, description="Least time between the end of a visit with its references and the begin of the next."
    )
    level_e: Annotated[Real, Field(ge=0, le=1e12)] | None = Field(
        None, description="Electrons of a pixel of FLAT, of the whole spot of LASER."
    )
    offset_arcsec: tuple[Offset, Offset] | None = Field(None, description="Place of the spot of LASER.")
    ra_deg: Annotated[Real, Field(ge=0, lt=360)] | None = Field(None, description="Right ascension of BKG.")
    dec_deg: Annotated[Real, Field(ge=-90, le=90)] | None = Field(None, description="Declination of BKG.")
    seed: Annotated[Whole, Field(ge=0, lt=2**63)] = Field(1, description="Seed of every random number.")
    realisation: Annotated[Whole, Field(ge=0, lt=2**31)] | None = Field(
        None, description="Number of the noise realisation."
    )
    switches: dict[str, bool] = Field(
        default_factory=dict, description="Effects of the camera to switch on or off; all stands for every one."
    )
    start_utc: Utc | None = Field(None, description="Begin of the first frame.")
    obsid: Annotated[Whole, Field(ge=0, lt=10**11)] | None = Field(
        None, description="Number of the first sequence, eleven digits."
    )


class SequenceConfig(SequenceSettings, SpelledModel):
    """One entry of a simulation: a sequence for each of its bands, exposures and gains, in this order.

    Attributes
    ----------
    kind : str
        SCI, DSF and CALS (science, dense star field, calibration star) look at a ``scene``; BIAS, DARK, FLAT, BKG (sky
        background) and LASER do not.
    scene : Scene
    instrument : Instrument
    band : tuple of str
        All bands of the visible camera if none is given; none for BIAS and DARK, which name their ``camera``.
    exposure_s, em_gain : tuple of float
        Exposure of a frame, and the actual EM gain. BIAS has no exposure, the near infrared no gain.
    frames : int
        Frames of each sequence.
    roll_deg, star_offset_arcsec, role, fidelity, tolerance, scene_model
        As `simulator.observe`: the optics are those of ``fidelity``, and above a ``tolerance`` of 0 the effect ledger
        leaves out what is predicted to matter less than that, with the cheapest knobs that meet it, never finer than
        those of ``fidelity``. The role of CALS is ``calibration`` unless another one is given.
    visits : int
        Science visits, each with ``frames`` frames and a wavefront of its own. Several, or one with reference visits,
        are a programme.
    reference_visits : int, optional
        Reference visits; without a number as many as science visits, and none for a single visit.
    reference_ratio : float
        Reference frames per science frame of the whole programme; see `reference_entry`.
    reference_scheme : {"interleaved", "half", "swapped", "other_star"}
        Where in the orbit references are taken (`simulator.config.Timing`); for ``half`` and ``swapped`` each
        science visit has one reference visit.
    reference_scene : Scene, optional
        What reference visits look at; the scene without its planets by default.
    reference_roll_deg : float, optional
        Roll of reference visits; that of the science visits by default.
    visit_gap_h : float
        Least time between the end of a visit with its references and the start of the next.
    level_e, offset_arcsec, ra_deg, dec_deg
        As `simulator.calibrate`.
    seed : int
    realisation : int, optional
        Number of the noise realisation. Without one, sequences of the same scene, role and band (or of the same kind,
        camera and band) are numbered, so that their noise is independent; the sequences of one entry that has one share
        their random numbers.
    switches : dict of str to bool
        Effects of the camera to switch on or off; ``all`` stands for every one, names beside it are exceptions.
    start_utc : str, optional
        Begin of the first of its sequences; without one, sequences follow each other.
    obsid : int, optional
        Number of the first of its sequences, eleven digits; without one, sequences are counted.
    """

    ALIASES = other_names(band="bands", frames="n_frames", exposure_s="exposures_s", em_gain="em_gains")

    scene: Scene | None = None
    instrument: Instrument
    reference_scene: Scene | None = None

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        result, kind = dict(tree), tree.get("kind", "SCI")
        known = meaningful_keys(kind)
        for key in _LISTS:
            if key in result and not isinstance(result[key], list | tuple):
                result[key] = (result[key],)
            if key in result and not result[key]:
                raise InputError(key, [], allowed="at least one value")
        if kind == "BIAS" and result.get("exposure_s") in ((0,), [0]):
            del result["exposure_s"]
        for key, value in result.items():
            if key not in known:
                raise of_no_use(key, value, kind)
        if kind in SKY_KINDS and result.get("scene") is None:
            raise required("scene", f"a scene for {kind}: a preset, a YAML file or a mapping")
        instrument = result.get("instrument")
        if isinstance(instrument, Instrument) and "band" in known:
            result.setdefault("band", instrument.visible_bands())
        if kind == "CALS":
            result.setdefault("role", "calibration")
        if kind == "BIAS":
            result["exposure_s"] = ()
        if isinstance(result.get("obsid"), str) and result["obsid"].isdecimal():
            result["obsid"] = int(result["obsid"])
        return result

    def _check_values(self) -> None:
        for band in self.band:
            self.instrument.band(band)
        for camera in self.cameras:
            for gain in self.em_gain:
                self.instrument.channel(camera).check_gain(gain)
        for name in self.switches:
            if name not in self.known_switches:
                raise InputError("switches", name, allowed=", ".join(self.known_switches))
        self._check_programme()

    def _check_programme(self) -> None:
        """Refuse what concerns references where there are none, and visits that cannot share a window."""
        if self.is_programme and self.role != "science":
            allowed = "1, without references, for visits of this role"
            raise InputError("visits", self.visits, allowed=allowed, hint=f"role is {self.role}")
        for key in PROGRAMME_KEYS if not self.is_programme else _REFERENCE if not self.references else ():
            value = getattr(self, key)
            if key not in ("visits", "reference_visits") and value != type(self).model_fields[key].default:
                allowed = "for several visits" if key == "visit_gap_h" else "for programmes with reference visits"
                raise InputError(key, value if isinstance(value, str | float) else "given", allowed=allowed)
        if self.reference_scheme in ("half", "swapped") and self.references not in (0, self.visits):
            allowed = f"as many as visits, {self.visits}: {self.reference_scheme} divides windows between pairs"
            raise InputError("reference_visits", self.references, allowed=allowed)

    @property
    def references(self) -> int:
        """Number of reference visits."""
        if self.reference_visits is None:
            return self.visits if self.visits > 1 else 0
        return self.reference_visits

    @property
    def is_programme(self) -> bool:
        """Whether it is a programme of several visits, and not a single one without references."""
        return self.visits > 1 or self.references > 0

    @property
    def total_frames(self) -> int:
        """Frames of all its sequences and visits."""
        own = self.frames * self.visits
        own += self.reference_entry().frames * self.references if self.references else 0
        return own * len(list(self.grid()))

    def reference_entry(self) -> Self:
        """Return what each reference visit is.

        The reference frames of all visits together are ``reference_ratio`` times the science frames, rounded to a whole
        number a visit, at least 1.
        """
        scene = self.reference_scene
        if scene is None and self.scene is not None:
            scene = self.scene.without_planets()
        frames = round(self.frames * self.reference_ratio * self.visits / max(self.references, 1))
        roll_deg = self.roll_deg if self.reference_roll_deg is None else self.reference_roll_deg
        changes = {"role": "reference", "scene": scene, "roll_deg": roll_deg, "frames": max(frames, 1)}
        return self.model_copy(update=changes)

    @property
    def cameras(self) -> tuple[CameraName, ...]:
        """Cameras that the sequences are taken with."""
        return tuple(dict.fromkeys(self.camera_of(band) for band in self.band)) or (self.camera,)

    def camera_of(self, band: str) -> CameraName:
        """Return the camera of a band, or that of the entry where the band is empty."""
        return self.instrument.band(band).camera if band else self.camera

    @property
    def known_switches(self) -> tuple[str, ...]:
        """Names of the switches of its cameras, and ``all``."""
        names = {name for camera in self.cameras for name in self.instrument.channel(camera).switches}
        return ("all", *sorted(names))

    def switches_for(self, camera: str) -> dict[str, bool]:
        """Return the switches of one camera by name."""
        names = self.instrument.channel(camera).switches
        every = dict.fromkeys(names, self.switches["all"]) if "all" in self.switches else {}
        return every | {name: value for name, value in self.switches.items() if name in names}

    def grid(self) -> Iterator[tuple[str, float, float]]:
        """Yield band, exposure and gain of each sequence."""
        yield from itertools.product(self.band or ("",), self.exposure_s or (0.0,), self.em_gain)


class SimulationConfig(FrozenModel):
    """Sequences in the order in which they are taken."""

    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    sequences: Annotated[tuple[SequenceConfig, ...], Field(min_length=1)]


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
            result["instrument"] = base.changed(_beside(own, folder, paths_beside))
        else:
            result["instrument"] = base if own is None else _instrument(own, folder)
        for key in ("scene", "reference_scene"):
            if result.get(key) is not None:
                result[key] = scene_file.load_scene(_beside(result[key], folder, scene_file.paths_beside))
    return result


def _instrument(source: Any, folder: Path | None) -> Instrument:
    return source if isinstance(source, Instrument) else load_instrument(_beside(source, folder, paths_beside))


def _beside(source: Any, folder: Path | None, whole: Callable[[Any, Path], Any]) -> Any:
    """Return a source with the paths of files that lie beside the simulation's made whole, its own or those in it."""
    if folder is not None and isinstance(source, Mapping):
        return whole(dict(source), folder)
    if folder is not None and isinstance(source, str) and is_file(folder / source):
        return folder / source
    return source
