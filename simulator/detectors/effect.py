"""The base class of the effects of a detector: all that the program knows about an effect stands in its class.

A new effect is a subclass of `Effect` in a file of its own and one entry in `simulator.detectors.chains`. From there it
has its switch and its numbers in the configuration of the camera, is drawn in frames, is part of the expected image,
adds its variance to the noise of the exposure-time calculator and of the effect ledger, and has its words in both.

Whole electrons are Poisson counts of means; the kernels draw them.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, NDArray, Record, load_kernels
from simulator.config import FrozenModel
from simulator.detectors.gain import pixel_keys
from simulator.detectors.variance import FrameTerm

if TYPE_CHECKING:
    from simulator.knobs import Quantity

Sizes: TypeAlias = "dict[Quantity, float]"
Case: TypeAlias = Any
"""A `simulator.ledger.visit.Visit`, for which the size of an effect is worked out: the ledger imports effects."""
KERNELS = "simulator.detectors.kernels"


class Place(Record):
    """The place of an array of pixels on the detector.

    Attributes
    ----------
    rows, columns : slice
        Part of the array that is made of pixels, light-sensitive or shielded; the rest is clocked out of none.
    first_row, first_column : int
        Row and column of the frame that the array begins with.
    whole : bool
        Whether the array is the whole frame.
    """

    rows: slice
    columns: slice
    first_row: int
    first_column: int
    whole: bool


class Exposure(Record, eq=False):
    """The noise-free part of a frame: made once, exposed many times.

    Attributes
    ----------
    detector : Detector or InfraredDetector
    place : Place
    exposure_s, em_gain : float
    mean_e : ndarray
        Mean electrons that every pixel collects: light, smear and dark current.
    cic_e : ndarray or None
        Mean clock-induced electrons per pixel where they differ; else ``detector.cic_e`` everywhere.
    stripe_adu, bias_adu : ndarray or None
        Fixed structure of the bias: per column, and a whole map.
    flaws : ndarray of uint8 or None
        Bits of `simulator.camera.MaskBit` that belong to the pixels themselves.
    smear_e : ndarray or None
        Of ``mean_e``, what the light of the other rows leaves during the transfer; None without smear.
    n_negative_rates : int
        Pixels whose rate was a rounding-error negative and was taken as 0.
    tracks : callable or None
        Draws the particles of one frame on an array of a ``shape`` by ``rng``; None without particles.
    light_e, dark_e : ndarray or None
        Of ``mean_e``, light and dark current, where each has a random stream of its own (near infrared).
    n_reads : int
        Reads that are taken between the first (the reset, for a single read) and the end of the exposure.
    """

    detector: Any
    place: Place
    exposure_s: float
    em_gain: float
    mean_e: FloatArray
    cic_e: FloatArray | None = None
    stripe_adu: FloatArray | None = None
    bias_adu: FloatArray | None = None
    flaws: NDArray[np.uint8] | None = None
    smear_e: FloatArray | None = None
    n_negative_rates: int = 0
    tracks: Callable[..., Any] | None = None
    light_e: FloatArray | None = None
    dark_e: FloatArray | None = None
    n_reads: int = 1

    @functools.cached_property
    def zero(self) -> FloatArray:
        """``exp(-mean_e)``, the chance of none."""
        return np.exp(-self.mean_e)


class PastExposure(NamedTuple):
    """Earlier frames of one light, one after the other.

    Attributes
    ----------
    charge_e : array_like
        Mean electrons that every pixel held in each of them.
    age_s : float
        Time from the end of the youngest to the start of this frame.
    n_frames : int
        How many they are.
    pace_s : float
        Time from one to the next.
    """

    charge_e: ArrayLike
    age_s: float
    n_frames: int = 1
    pace_s: float = 0.0

    def weight(self, decay_s: float) -> float:
        """Return how many frames of the youngest's age they act as together, where what they leave decays so.

        ``sum(exp(-k pace / decay))`` over the frames: exact for one decay time, at a cost that does not grow with them.
        """
        if self.n_frames == 1:
            return 1.0
        # the geometric series, stable where the pace is short
        return math.expm1(-self.n_frames * self.pace_s / decay_s) / math.expm1(-self.pace_s / decay_s)


@dataclass(eq=False)
class Work:
    """A frame in the making: electrons, then ADU, with its bookkeeping.

    Attributes
    ----------
    image : ndarray
    saturated : ndarray of bool
        Pixels that a limit cut off.
    stream : callable
        Further random streams of the frame, by name.
    cosmic : ndarray of bool or None
        Pixels that particles hit.
    charge : dict of str to float
        Electrons of the whole frame by step.
    counts : dict of str to int
    held : dict of str to ndarray
        What an effect keeps from one read of a frame to the next.
    past : sequence of PastExposure
        Earlier frames, the youngest first; empty where no effect remembers them.
    """

    image: FloatArray
    saturated: BoolArray
    stream: Callable[[str], np.random.Generator]
    cosmic: BoolArray | None = None
    charge: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    held: dict[str, FloatArray] = field(default_factory=dict)
    past: Sequence[PastExposure] = ()

    def book(self, step: str, electrons: float) -> None:
        """Enter electrons of the whole frame under the name of a step."""
        self.charge[step] = self.charge.get(step, 0.0) + float(electrons)


class Setting(Record):
    """A setting that decides whether an effect exists, for its row in the ledger.

    Attributes
    ----------
    detector : Detector or InfraredDetector
    lit, exposed : bool
        Whether light falls on the detector, and whether frames have an exposure.
    particles_per_s_cm2 : float
        Rate of cosmic rays.
    dated : bool
        Whether that is the rate of a date.
    """

    detector: Any
    lit: bool = True
    exposed: bool = True
    particles_per_s_cm2: float = 0.0
    dated: bool = False


class Effect:
    """One effect of a detector; the methods of this class are those of an effect that changes nothing.

    Attributes
    ----------
    switch : str
        Name of its switch in the configuration, of its random stream and of its row in the ledger.
    label, law : str
        Its name for people, and how it is modelled.
    stage : {"light", "charge", "voltage"}
        Where in the chain it acts: on mean rates; on electrons, those behind the register multiplied already; on the
        signal at the output, in ADU in the visible camera and in electrons in every read of the near-infrared one.
    always, fixed : bool
        Whether it runs (in a plain form) with its switch off; whether it has none.
    settings : type of FrozenModel, optional
        Model of numbers of its own: a key of the detector of the name of the switch.
    preset : mapping
        Defaults of these numbers and of the switch, as in the file of an instrument under ``detector``.
    needs : {"", "light", "exposure"}
        What there must be for it to exist.
    number : str
        Dotted key of the detector that it grows with: at 0 there is none of it.
    map_kind : str
        Calibration map that replaces its numbers.
    hides : tuple of str
        Switches of effects that disappear with it: it is left out after them.
    in_sums : {"added", "per_electron", "left_out", "moves_charge", "not_additive"}
        What becomes of it where sums of frames stand for frames: what it adds to each frame is drawn and added; it acts
        on every electron for itself, so that a sum is drawn as one frame; a reduction takes it out; it acts on every
        electron but moves charge between pixels; it does not add up.
    remembers : bool
        Whether it needs earlier frames (`Work.past`): then it does not add up over frames, and ``added`` says what of
        their electrons comes back (`FrameTerm.of_past`).
    seeded : bool
        Whether it is read from the calibration set of the camera.
    frame_s, set_up_s : float
        Processor time of a frame of the window around the hole (137 x 137), and once a sequence, seconds.
    term, term_label : str
        Name of its variance in budgets of noise and its words there; those of the switch if empty.
    colour : str
        Colour of this term in figures.
    """

    switch: ClassVar[str] = ""
    label: ClassVar[str] = ""
    law: ClassVar[str] = ""
    stage: ClassVar[Literal["light", "charge", "voltage"]] = "light"
    always: ClassVar[bool] = False
    fixed: ClassVar[bool] = False
    settings: ClassVar[type[FrozenModel] | None] = None
    preset: ClassVar[Mapping[str, Any]] = {}
    needs: ClassVar[Literal["", "light", "exposure"]] = ""
    number: ClassVar[str] = ""
    map_kind: ClassVar[str] = ""
    hides: ClassVar[tuple[str, ...]] = ()
    in_sums: ClassVar[Literal["added", "per_electron", "left_out", "moves_charge", "not_additive"]] = "added"
    remembers: ClassVar[bool] = False
    seeded: ClassVar[bool] = False
    frame_s: ClassVar[float] = 0.0
    set_up_s: ClassVar[float] = 0.0
    term: ClassVar[str] = ""
    term_label: ClassVar[str] = ""
    colour: ClassVar[str] = "#117733"

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Refuse a memory that predictions would not know of, and take sums of frames from what has one."""
        super().__init_subclass__(**kwargs)
        if cls.remembers:
            cls.in_sums = "not_additive"
            if cls.added is Effect.added:
                raise TypeError(f"{cls.__name__} remembers earlier frames: its method added must say what comes back")

    @property
    def budget_term(self) -> str:
        """Name of its variance in budgets of noise."""
        return self.term or self.switch

    def on(self, detector: Any) -> bool:
        """Return whether its switch is on, or it has none."""
        return self.fixed or bool(getattr(detector.switches, self.switch))

    def runs(self, detector: Any) -> bool:
        """Return whether it is part of the chain of a camera."""
        return self.always or self.on(detector)

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Do to a mean image, in place, what the effect does on average."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Do to one frame, in place, what the effect does at random.

        Parameters
        ----------
        work : Work
        exposure : Exposure
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Do the same to the sum of frames, whose means ``exposure`` holds: frame by frame if it adds to each.

        Parameters
        ----------
        work : Work
        exposure : Exposure
        n_frames : int
            Number of frames.
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        for _ in range(n_frames if self.in_sums == "added" else 1):
            self.draw(work, exposure, rng)

    def memory_s(self, detector: Any) -> float:
        """Return the age from which on frames leave nothing in it; 0 where it needs none."""
        return math.inf if self.remembers else 0.0

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the variance that it adds to a pixel and frame where it is switched on.

        Parameters
        ----------
        detector : Detector or InfraredDetector
        exposure_s : float, optional
            Exposure of the frame; one that has room for all reads if not given.
        """
        return FrameTerm()

    def size(self, case: Case) -> Sizes | None:
        """Return its size on every quantity for the ledger; by default that of the variance and mean that it adds."""
        added = self.added(case.detector, case.exposure_s)
        if added == FrameTerm():
            return None
        past = added.of_past
        variance = added.variance_e2(case.exposure_s, case.noise.factor2, case.em_gain, past and case.counted_e)
        pixel = max(case.variance_change(variance), case.mean_change(past * case.light_e) if past else 0.0)
        return sizes(pixel, past, past + case.snr_share(self.budget_term))

    def row(self, setting: Setting) -> tuple[str, str]:
        """Return how it is modelled, and why it does not exist; empty if it does."""
        file = self.file_of(setting.detector)
        return f"from the map {file}" if file else self.law, self.why_not(setting)

    def why_not(self, setting: Setting) -> str:
        """Return why it does not exist; empty if it does."""
        if not self.on(setting.detector):
            return "switched off"
        if self.needs and not setting.exposed:
            return "frames without exposure"
        if self.needs == "light" and not setting.lit:
            return "no light on the detector"
        if not self.number or self.file_of(setting.detector):
            return ""
        return f"{self.number} is 0" if operator.attrgetter(self.number)(setting.detector) == 0 else ""

    def file_of(self, detector: Any) -> str:
        """Return the name of the calibration map that it is read from; empty without one."""
        path = detector.maps.get(self.map_kind)
        return "" if path is None else Path(path).name


def sizes(pixel: float, flux: float = 0.0, snr: float | None = None) -> Sizes:
    """Return sizes by quantity; that on the SNR is that on the flux of the planet if not given."""
    return {"pixel_map": pixel, "planet_flux": flux, "snr": flux if snr is None else snr}


def counted(mean_e: FloatArray, detector: Any, rng: np.random.Generator) -> FloatArray:
    """Return Poisson counts of a mean image; the mean itself where photon noise is switched off."""
    if not detector.switches.photon_noise:
        return mean_e
    counts, mean = np.empty(mean_e.shape), mean_e.reshape(-1)
    load_kernels(KERNELS).draw_poisson(mean, np.exp(-mean), pixel_keys(rng), counts.reshape(-1))
    return counts


def rounded(work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
    """Round mean charge to whole electrons, the mean kept: only they can be moved."""
    if not exposure.detector.switches.photon_noise:
        load_kernels(KERNELS).round_stochastic(work.image.reshape(-1), pixel_keys(rng))
