"""Effects of the near-infrared detector: persistence, curve of the pixels, coupling, reset and read noise.

The charge is read without destroying it, once, twice or up the ramp: effects of stage ``voltage`` act on the signal of
every read, in electrons. How to write other laws of persistence and coupling: `LateCharge`, `Coupling`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Protocol

import numpy as np
from pydantic import Field

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    NDArray,
    Record,
    checked_array,
    checked_scalar,
    element_name,
)
from simulator.config import FrozenModel
from simulator.detectors.effect import Case, Effect, Exposure, PastExposure, Sizes, Work, counted, sizes
from simulator.detectors.variance import FrameTerm
from simulator.detectors.visible import CosmicRayHits, ReadNoise

# Keeps sums over a frame inside 64-bit integers, and charges exact in float64; any full well is far below.
MAX_MEAN_E = 1e12
# Width of the bend into saturation, as a fraction of the full well.
KNEE = 0.02
HITS, ARRIVAL = "hits", "arrival"
_FORGOTTEN = 50.0

LossAtFullWell = Annotated[float, Field(ge=0, le=0.4)]
Coupled = Annotated[float, Field(ge=0, le=0.2)]
ResetElectrons = Annotated[float, Field(ge=0, le=1e5)]


class InfraredPersistence(FrozenModel):
    """Charge of earlier frames that comes out late: ``fraction`` of it, with the decay time ``decay_s``."""

    fraction: Annotated[float, Field(ge=0, le=0.5)]
    decay_s: Annotated[float, Field(gt=0, le=1e7)]


class LateCharge(Protocol):
    """A law of the charge that earlier frames leave in a frame."""

    def __call__(self, past: Sequence[PastExposure], exposure_s: float) -> FloatArray:
        """Return mean electrons per second and pixel over an exposure (0 means at its start), finite and at least 0."""


class Coupling(Protocol):
    """A law by which the signal of a pixel appears in others."""

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Return the signal after coupling, of the same shape and sum."""


class ExponentialPersistence(Record):
    """Traps that catch ``fraction`` of the charge and release it with one decay time.

    A charge ``Q`` that ended ``a`` seconds before an exposure of ``t`` adds
    ``fraction Q (exp(-a / decay) - exp(-(a + t) / decay)) / t`` on average, the released electrons per second.
    """

    fraction: float
    decay_s: float

    def __post_init__(self) -> None:
        checked_scalar("fraction", self.fraction, low=0.0, high=1.0)
        checked_scalar("decay_s", self.decay_s, low=1e-6, high=1e9, unit="s")

    def __call__(self, past: Sequence[PastExposure], exposure_s: float) -> FloatArray:
        """Return the mean rate over the exposure, e-/s.

        Parameters
        ----------
        past : sequence of PastExposure
        exposure_s : float
            Exposure of the frame, at least 0 s.

        Raises
        ------
        InputError
            For a charge or an age that is negative or not finite, or charges of different shapes.
        """
        rate: FloatArray = np.zeros(())
        for one in past:
            charge = checked_array("past charge_e", one.charge_e, low=0.0, unit="e-") * one.weight(self.decay_s)
            age = checked_scalar("past age_s", one.age_s, low=0.0, high=1e12, unit="s")
            if rate.ndim and rate.shape != charge.shape:
                raise InputError("past charge_e", f"shape {charge.shape}", allowed=f"shape {rate.shape}")
            # -expm1(-x)/x -> 1 as the exposure goes to 0
            x = exposure_s / self.decay_s
            share = -math.expm1(-x) / x if x > 0 else 1.0
            rate = rate + charge * (self.fraction / self.decay_s * math.exp(-age / self.decay_s) * share)
        return rate


class InterpixelKernel(Record, eq=False):
    """Coupling to the eight neighbours by a 3 x 3 kernel of sum 1; what would leave the array stays in its edge.

    ``kernel[1 + dy, 1 + dx]`` is the part of a pixel's signal that appears ``dy`` rows up and ``dx`` columns right.
    """

    kernel: ArrayLike

    def __post_init__(self) -> None:
        kernel = checked_array("interpixel kernel", self.kernel, low=0.0, high=1.0)
        if kernel.shape != (3, 3):
            raise InputError("interpixel kernel", f"shape {kernel.shape}", allowed="shape (3, 3)")
        if abs(float(kernel.sum()) - 1.0) > 1e-9:
            raise InputError("interpixel kernel sum", float(kernel.sum()), allowed="1, so that charge is conserved")

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Return the coupled signal."""
        kernel = np.asarray(self.kernel, dtype=np.float64)
        rows, columns = signal.shape
        wide = np.zeros((rows + 2, columns + 2))
        for dy in range(3):
            for dx in range(3):
                if kernel[dy, dx] != 0.0:
                    wide[dy : dy + rows, dx : dx + columns] += kernel[dy, dx] * signal
        wide[1] += wide[0]
        wide[-2] += wide[-1]
        wide[:, 1] += wide[:, 0]
        wide[:, -2] += wide[:, -1]
        return wide[1:-1, 1:-1]


def neighbour_kernel(coupling: float) -> InterpixelKernel:
    """Return the kernel that gives each of the four nearest neighbours the part ``coupling``, 0 to 0.25."""
    a = checked_scalar("interpixel_coupling", coupling, low=0.0, high=0.25)
    return InterpixelKernel([[0.0, a, 0.0], [a, 1.0 - 4.0 * a, a], [0.0, a, 0.0]])


class InfraredHits(CosmicRayHits):
    """Charge that particles leave in the pixels, with its time of arrival where a ramp follows it."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Draw the tracks of one exposure; the reads after a hit see its charge."""
        if exposure.tracks is None:
            return
        found = exposure.tracks(work.image.shape, rng=rng)
        hits = found.image().astype(np.float64)
        work.cosmic = hits > 0
        work.held[HITS] = hits
        if exposure.n_reads > 2:
            work.held[ARRIVAL] = hit_times(work.cosmic, work.stream("cosmic_ray_times"))
        work.book("cosmic_rays", hits.sum())
        work.counts["n_cosmic_rays"] = found.n_events


class Persistence(Effect, Record, eq=False):
    """Mean charge of earlier frames that comes out late, drawn as counts.

    Attributes
    ----------
    late : LateCharge, optional
        Law of the release; `ExponentialPersistence` of the configuration if not given.
    """

    late: LateCharge | None = None

    switch, label, law = "persistence", "persistence", "mean charge of the earlier frames of the sequence"
    stage, remembers = "charge", True
    needs, number = "exposure", "persistence.fraction"

    def memory_s(self, detector: Any) -> float:
        """Return 50 decay times, after which 2e-22 is left; 0 where nothing is caught."""
        numbers = detector.persistence
        return float(_FORGOTTEN * numbers.decay_s) if numbers.fraction else 0.0

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the counts."""
        if not len(work.past):
            return
        numbers = exposure.detector.persistence
        late = self.late or ExponentialPersistence(numbers.fraction, numbers.decay_s)
        rate = checked_array("persistence", late(work.past, exposure.exposure_s), low=0.0, unit="e-/s")
        if rate.shape != work.image.shape:
            raise InputError("persistence", f"shape {rate.shape}", allowed=f"shape {work.image.shape}")
        charge = counted(np.minimum(rate * exposure.exposure_s, MAX_MEAN_E), exposure.detector, rng)
        work.image += charge
        work.book("persistence", charge.sum())

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return all that frames of the same light leave each other."""
        return FrameTerm(of_past=detector.persistence.fraction)


class PixelCurve(Effect):
    """Signal of a pixel against its charge, and its full well; without the switch a straight line to the full well."""

    switch, label, law = "nonlinearity", "non-linearity", "one curve for all pixels"
    stage, in_sums, always = "voltage", "not_additive", True

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Bend the mean of a read."""
        detector = exposure.detector
        loss = detector.nonlinearity_at_full_well if self.on(detector) else 0.0
        image[...] = well_signal(image, detector.full_well_e, loss)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Bend a read."""
        self.expect(work.image, exposure)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums of frames as they are: no frame among them is full, and the line below is straight."""

    def size(self, case: Case) -> Sizes:
        """Return the size of what is missing of the signal."""
        if case.reduced:
            return sizes(0.0)
        loss = case.detector.nonlinearity_at_full_well / case.detector.full_well_e
        charge = np.minimum(case.light_e + case.noise.dark_e, case.detector.full_well_e)
        spread = 2.0 * loss * case.noise.factor2 * charge**2 / case.sigma_e**2

        def slope(planet: Any) -> float:
            behind = max(case.behind_e_s(planet), float(case.light.star_e_s[planet.place].max(initial=0.0)))
            return float(loss * case.exposure_s * (2.0 * behind + planet.peak_e_s))

        pixel = float(np.max(loss * charge**2 / case.sigma_e + spread, initial=0.0))
        return sizes(pixel + 2.0 * case.struck() * loss * case.hits.typical_e, case.over_planets(slope))


class InterpixelCapacitance(Effect, Record, eq=False):
    """The signal of a pixel appears in its neighbours.

    Attributes
    ----------
    coupling : Coupling, optional
        The four nearest neighbours with ``interpixel_coupling`` if not given.
    """

    coupling: Coupling | None = None

    switch, label, law = "interpixel_capacitance", "inter-pixel capacitance", "coupling to four neighbours"
    stage, in_sums = "voltage", "moves_charge"
    number = "interpixel_coupling"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Couple the mean of a read."""
        coupling = self.coupling or neighbour_kernel(exposure.detector.interpixel_coupling)
        coupled = np.asarray(coupling(image), dtype=np.float64)
        if coupled.shape != image.shape or not np.isfinite(coupled).all():
            wrong = coupled.shape if coupled.shape != image.shape else element_name("", ~np.isfinite(coupled))[0]
            raise InputError("coupling", str(wrong), allowed=f"finite signals of shape {image.shape}")
        image[...] = coupled

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Couple the pixels of a read."""
        self.expect(work.image, exposure)

    def size(self, case: Case) -> Sizes:
        """Return the size of what leaves a pixel, undone by a reduction."""
        share = 0.0 if case.reduced else 4.0 * case.detector.interpixel_coupling
        return sizes(case.mean_change(share * case.light_e), share)


class ResetNoise(Effect):
    """Noise of the reset: one level per pixel that all reads of a frame share."""

    switch, label, law = "reset_noise", "reset noise", "one level per pixel and reset"
    stage = "voltage"
    number = "reset_noise_e"
    term = "read_noise"

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the level, drawn with the first read."""
        self.draw_sum(work, exposure, 1, rng)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the sum of the levels of frames, drawn with the first read."""
        rms_e = math.sqrt(n_frames) * exposure.detector.reset_noise_e
        if rms_e > 0:
            if self.switch not in work.held:
                work.held[self.switch] = rms_e * rng.standard_normal(work.image.shape)
            work.image += work.held[self.switch]

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return its variance; the difference of two reads and a slope are free of it."""
        return FrameTerm(output_e2=detector.reset_noise_e**2 if detector.readout_mode == "single" else 0.0)


class InfraredReadNoise(ReadNoise):
    """Gaussian noise in every read, in electrons."""

    law = "Gaussian in every read"
    always = False

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the noise of one read."""
        self.draw_sum(work, exposure, 1, rng)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the noise of the same read of all frames."""
        rms_e = math.sqrt(n_frames) * exposure.detector.read_noise_e
        if rms_e > 0:
            work.image += rms_e * rng.standard_normal(work.image.shape)

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the variance of what the reads of a frame are reduced to."""
        return FrameTerm(output_e2=detector.ramp(exposure_s)[0] * detector.read_noise_e**2)


def well_signal(charge_e: ArrayLike, full_well_e: float, loss: float) -> FloatArray:
    """Return the signal of collected charge, in electrons: a quadratic that bends smoothly into saturation.

    Parameters
    ----------
    charge_e : array_like
        Electrons collected, at least 0.
    full_well_e : float
        Charge at which the pixel is full.
    loss : float
        Fraction of the signal missing at full well, 0 to below 0.5; 0 is a straight line that ends at full well.

    Returns
    -------
    ndarray
        With ``x = charge / full_well``: ``full_well (x - loss x^2)`` up to ``x = 1``, beyond it
        ``full_well (1 - loss + (1 - 2 loss) k (1 - exp(-(x - 1) / k)))`` with ``k = 0.02``, of the same slope at 1.
        Never falls as the charge rises.
    """
    x = np.asarray(charge_e, dtype=np.float64) / full_well_e
    below = np.minimum(x, 1.0)
    if loss == 0.0:
        return np.asarray(below * full_well_e)
    signal = below * (1.0 - loss * below)
    over = x > 1.0
    if over.any():
        signal[over] -= (1.0 - 2.0 * loss) * KNEE * np.expm1((1.0 - x[over]) / KNEE)
    return np.asarray(signal * full_well_e)


def tracks_of(hit: BoolArray) -> tuple[NDArray[np.int32], int]:
    """Return the number of the track in every pixel (0 elsewhere) and of tracks in all: pixels that touch are one."""
    from scipy.ndimage import label

    tracks, number = label(hit, structure=np.ones((3, 3)))
    return tracks, int(number)


def hit_times(hit: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Return the time of arrival in every hit pixel as a fraction of the exposure; pixels of a track share theirs."""
    tracks, number = tracks_of(hit)
    return np.concatenate([[0.0], rng.random(number)])[tracks]
