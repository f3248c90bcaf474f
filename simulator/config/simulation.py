"""A simulation as configuration: sequences of frames to be taken one after another."""

import itertools
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from cpic_core import InputError, check_word
from simulator.config.base import FrozenModel, SpelledModel, other_names, required
from simulator.config.instrument import Instrument
from simulator.config.light import Real
from simulator.config.scene import Scene
from simulator.config.telescope import CameraName, ReferenceScheme, Utc

SequenceKind = Literal["SCI", "DSF", "CALS", "BIAS", "DARK", "FLAT", "BKG", "LASER"]
SKY_KINDS: tuple[SequenceKind, ...] = ("SCI", "DSF", "CALS")
SEQUENCE_KINDS: tuple[SequenceKind, ...] = (*SKY_KINDS, "BIAS", "DARK", "FLAT", "BKG", "LASER")
DEFAULT_EXPOSURE_S = 10.0

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
    frames: Annotated[Whole, Field(ge=1, le=1_000_000)] = Field(1, description="Frames of a sequence.")
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
        0.0,
        description="Least time between the end of a visit with its references and the begin of the next.",
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
        Where in the orbit references are taken (`simulator.config.telescope.Timing`); for ``half`` and ``swapped`` each
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
