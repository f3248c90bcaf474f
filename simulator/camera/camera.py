"""Both cameras: from photon rate on the detector to the numbers of a frame, a window, or a sum of frames.

Light goes through the response of the pixels and dark current is added (``prepare``, noise-free, once for a sequence).
Each frame then runs through the chain of effects of its detector (`Camera.expose`), with the frames before it where an
effect remembers them. Every effect has its own switch and its own random stream.

The visible camera moves its charge through a multiplication register and reads it once. The charge of the near-infrared
one is read without destroying it, once, twice, or up the ramp; reads are reduced before they are rounded to whole ADU.

Poisson counts, transfer losses and the multiplication register act on every electron for itself, and the reads of a
ramp are reduced by sums and differences, so the sum of ``n`` frames has the law of one frame of ``n`` times the mean.
Limits, curves and memories of earlier frames do not add up: where they matter, frames are drawn one by one.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    NDArray,
    Outcome,
    PathPart,
    Reason,
    Record,
    Status,
    checked_array,
    checked_scalar,
    element_name,
    load_kernels,
    stream,
)
from simulator import detectors
from simulator.camera.calibration_set import CalibrationSet, MaskBit, bias_level_adu, load_calibration_set
from simulator.camera.noise import FrameNoise
from simulator.config import AnyDetector, CosmicRayConfig, Detector, InfraredDetector, ReadoutMode
from simulator.detectors import Chain, Effect, Exposure, PastExposure, Place, Smear, Work
from simulator.effects import draw_cosmic_rays

NEGATIVE_TOLERANCE = 1e-9
# More light than this counts as this: that of any exposure and any sum of it stays finite.
MOST_E_S = 1e100


def checked_rates(rate_map_e_s: ArrayLike) -> tuple[FloatArray, int]:
    """Return the rates of a 2-D map with rounding-error negatives set to 0 (those above 1e100 too), and their number.

    Raises
    ------
    InputError
        For an empty map or one of other dimensions, and for NaN, infinity or a rate more negative than 1e-9 of the
        largest, naming the pixel.
    """
    allowed = f"finite and at least 0 (rounding errors to -{NEGATIVE_TOLERANCE:g} of the largest count as 0)"
    key, unit = "rate_map_e_s", "e-/s"
    try:
        rates = np.asarray(rate_map_e_s)
    except ValueError:
        raise InputError(key, type(rate_map_e_s).__name__, unit=unit, allowed="a 2-D (y, x) array") from None
    if rates.dtype.kind not in "iuf" or rates.ndim != 2 or rates.size == 0:
        given = f"{rates.dtype} array of shape {rates.shape}"
        raise InputError(key, given, unit=unit, allowed="a non-empty 2-D (y, x) array of numbers")
    rates = rates.astype(np.float64, copy=False)
    lowest, highest = float(rates.min()), float(rates.max())
    if lowest >= 0.0 and highest <= MOST_E_S:
        return rates, 0
    finite = np.isfinite(rates)
    bad = ~finite if not finite.all() else rates < -NEGATIVE_TOLERANCE * max(highest, 0.0)
    if bad.any():
        name, index = element_name(key, bad)
        raise InputError(name, float(rates[index]), unit=unit, allowed=allowed)
    return np.clip(rates, 0.0, MOST_E_S), int(np.count_nonzero(rates < 0.0))


class Frame(Record, eq=False):
    """One raw frame and its bookkeeping.

    Attributes
    ----------
    adu : ndarray of uint16
        Image in ADU.
    mask : ndarray of uint8
        `MaskBit` of every pixel, same shape: saturated where a limit cut charge off or spilled charge arrived, cosmic
        ray where one left charge, bad and hot from the calibration set.
    charge : mapping of str to float
        Electrons of the whole frame by step: what came in and what was lost where; exact integers as floats.
    n_clipped : int
        Pixels cut off at either end of the converter's range.
    n_saturated_pixels : int
        Pixels filled to the pixel full well.
    n_register_saturated : int
        Pixels filled to the full well of the register.
    n_cosmic_rays : int
        Particles that crossed the frame.
    n_negative_rates : int
        Pixels whose rate was a rounding-error negative and was taken as 0.
    """

    adu: NDArray[np.uint16]
    mask: NDArray[np.uint8]
    charge: Mapping[str, float] = field(default_factory=dict)
    n_clipped: int = 0
    n_saturated_pixels: int = 0
    n_register_saturated: int = 0
    n_cosmic_rays: int = 0
    n_negative_rates: int = 0

    @property
    def lost(self) -> BoolArray:
        """Pixels whose number says nothing about their light: a limit cut them off."""
        return np.asarray((self.mask & MaskBit.SATURATED) != 0)


# Chance of a Gaussian beyond: 1e-15, once in 1e9 frames of a million pixels.
MARGIN_SIGMA = 8.0
MAX_FRAMES = 1_000_000
# Keeps sums over a column or a frame inside the whole numbers of float64 and int64; any full well is far below.
MAX_MEAN_E = 1e12
MAX_EXPOSURE_S = 1e6
MAX_RATE_E_S = 1e300


class Camera:
    """A chain of effects on a detector.

    Parameters
    ----------
    detector : Detector or InfraredDetector
        Everything about the camera, switches included.
    cosmic_rays : CosmicRayConfig, optional
        Particles; none without it.
    cosmic_ray_rate_per_s_cm2 : float
        Their rate at the date of the observation.
    chain : sequence of Effect, optional
        Effects in their order; those of the detector if not given.

    Notes
    -----
    Effects whose switch is off are not run, and leave the random numbers of the others as they are.
    """

    def __init__(
        self,
        detector: AnyDetector,
        *,
        cosmic_rays: CosmicRayConfig | None = None,
        cosmic_ray_rate_per_s_cm2: float = 0.0,
        chain: Chain | None = None,
    ) -> None:
        self._rays, self._rate = cosmic_rays, cosmic_ray_rate_per_s_cm2
        self.particles = cosmic_rays is not None and cosmic_ray_rate_per_s_cm2 > 0
        self.detector: Any = detector
        every = detector.chain if chain is None else chain
        running = [effect for effect in every if effect.runs(detector) and self._there(effect)]
        self.light = tuple(effect for effect in running if effect.stage == "light")
        self.charge = tuple(effect for effect in running if effect.stage == "charge")
        self.voltage = tuple(effect for effect in running if effect.stage == "voltage")

    def _there(self, effect: Effect) -> bool:
        return self.particles or effect.switch != "cosmic_rays"

    @property
    def memory_s(self) -> float:
        """Age from which on earlier frames leave nothing in a frame; 0 where no effect remembers them."""
        effects = (*self.light, *self.charge, *self.voltage)
        return max((effect.memory_s(self.detector) for effect in effects if effect.on(self.detector)), default=0.0)

    def response(self, shape: tuple[int, int], first_pixel: tuple[int, int] | None) -> FloatArray | float:
        """Return the sensitivity of the pixels of a window, 1 on average.

        Parameters
        ----------
        shape : tuple of int
            Rows and columns of the window.
        first_pixel : tuple of int or None
            Row and column of the frame at which it begins; around the star if None.
        """
        flaws = flaws_of(self.detector, shape, corner_of(self.detector, shape, first_pixel))
        return 1.0 if flaws is None else flaws.response_of(self.detector.switches)

    def expected_adu(self, exposure: Exposure) -> FloatArray:
        """Return the mean ADU of every pixel, without noise and without rounding."""
        raise NotImplementedError

    def fills(self, exposure: Exposure) -> dict[Reason, float]:
        """Return how far frames fill every limit, eight sigma of noise included; 1 is full."""
        raise NotImplementedError

    def summed(self, exposure: Exposure, n_frames: int, work: Work) -> FloatArray:
        """Return the sum of frames, electrons at the register input without the fixed bias, as one draw.

        Parameters
        ----------
        exposure : Exposure
            Of one frame.
        n_frames : int
            Number of frames, none of which reaches a limit.
        work : Work
            An empty frame.
        """
        raise NotImplementedError

    def expose(
        self, exposure: Exposure, *, seed: int, path: Sequence[PathPart], past: Sequence[PastExposure] = ()
    ) -> Frame:
        """Return one noisy frame.

        Parameters
        ----------
        exposure : Exposure
            What ``prepare`` made.
        seed : int
            Seed of the run.
        path : sequence of str or int
            Names of target, role, band, realisation, frame. Each effect draws from ``stream(seed, *path, switch)``;
            ``arrivals`` and ``cosmic_ray_times`` are the streams of what arrives when.
        past : sequence of PastExposure, optional
            Earlier frames, the youngest first; of no effect where no effect that is switched on remembers them.

        Returns
        -------
        Frame
            ``charge`` holds the electrons of the frame by step: what came in, what stayed, what was lost.

        Raises
        ------
        InputError
            For a path that is a string, or charges of past frames that do not fit.
        """
        work = begun(exposure, seed, path, past)
        run(self.charge, work, exposure)
        adu, n_clipped = self._read(work, exposure)
        mask = work.saturated.astype(np.uint8)
        mask *= np.uint8(MaskBit.SATURATED)
        if work.cosmic is not None:
            mask |= work.cosmic.view(np.uint8) * np.uint8(MaskBit.COSMIC_RAY)
        if exposure.flaws is not None:
            mask |= exposure.flaws
        work.counts["n_negative_rates"] = exposure.n_negative_rates
        return Frame(adu, mask, dict(work.charge), n_clipped, **work.counts)

    def _read(self, work: Work, exposure: Exposure) -> tuple[NDArray[np.uint16], int]:
        """Return the numbers of a frame from its charge, and how many the converter cut off; mark what says nothing."""
        raise NotImplementedError

    def _lit(
        self, rate_map_e_s: ArrayLike, exposure_s: float, first_pixel: tuple[int, int] | None
    ) -> tuple[FloatArray, int, float, Place, CalibrationSet | None]:
        """Return the rates of a frame, how many were negative, its exposure and place, and the flaws of its pixels."""
        rates, n_negative = checked_rates(rate_map_e_s)
        time = checked_scalar("exposure_s", exposure_s, low=0.0, high=MAX_EXPOSURE_S, unit="s")
        corner = corner_of(self.detector, rates.shape, first_pixel)
        place = Place(slice(0, rates.shape[0]), slice(0, rates.shape[1]), *(corner or (0, 0)), corner is None)
        if corner is None:
            place = dataclasses.replace(
                place, **dict(zip(("rows", "columns"), self.detector.sections["image"], strict=True))
            )
        return rates, n_negative, time, place, flaws_of(self.detector, rates.shape, corner)

    def _tracks(self, exposure_s: float) -> Any:
        """Return what draws the particles of one frame."""
        if self._rays is None or not self.particles:
            return None
        own = {"pixel_um": self.detector.pixel_um, "exposure_s": exposure_s, "rate_per_s_cm2": self._rate}
        return functools.partial(draw_cosmic_rays, self._rays, **own)


def earlier_frames(
    runs: Iterable[tuple[int, int]],
    mean_e: Callable[[int], FloatArray],
    *,
    before: int,
    full_well_e: float,
    exposure_s: float,
    readout_s: float,
    memory_s: float,
) -> Iterator[PastExposure]:
    """Yield the earlier frames of a sequence as one past exposure for each run of equal light.

    Frames of equal light hold equal mean charge and differ in age alone. The noise of the earlier frames, their cosmic
    rays and their own memory (of second order) are left out, so that a frame never depends on which others were drawn.

    Parameters
    ----------
    runs : iterable of tuple of int
        First and last frame of each run of equal light, the last one excluded; from the youngest to the oldest.
    mean_e : callable
        Mean electrons of a frame, by its number.
    before : int
        The frame that sees them; runs end at it or earlier.
    full_well_e : float
        Most that a pixel holds.
    exposure_s, readout_s : float
        Frames follow each other after their sum, above 0.
    memory_s : float
        Age from which on runs are forgotten.

    Yields
    ------
    PastExposure
        From the youngest run to the oldest that is not forgotten.
    """
    pace = exposure_s + readout_s
    for begin, end in runs:
        age = readout_s + (before - end) * pace
        if age > memory_s:
            return
        yield PastExposure(np.minimum(mean_e(begin), full_well_e), age, end - begin, pace)


def stackable(camera: Camera, exposure: Exposure) -> Outcome[float]:
    """Return whether frames of an exposure add up to one draw.

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction of the nearest limit (eight sigma of noise included); else ``saturated`` with
        the limit that frames can reach, or ``invalid`` where an effect that is no sum is switched on.
    """
    running = (effect for effect in (*camera.charge, *camera.voltage) if effect.on(exposure.detector))
    alone = next((effect.switch for effect in running if effect.in_sums == "not_additive"), None)
    if alone:
        message = f"{alone} does not add up over frames: switch it off"
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, message)
    fills = camera.fills(exposure)
    reason = max(fills, key=lambda name: fills[name])
    if fills[reason] > 1.0:
        return Outcome.refuse(Status.SATURATED, reason, f"frames can reach {fills[reason]:.3g} times a limit")
    return Outcome.ok(fills[reason])


def stack_electrons(
    camera: Camera, exposure: Exposure, n_frames: int, *, seed: int, path: Sequence[PathPart]
) -> FloatArray:
    """Return the sum of ``n_frames`` frames in electrons at the register input, the fixed bias taken off: one draw.

    Parameters
    ----------
    camera : VisibleCamera or InfraredCamera
    exposure : Exposure
        What ``camera.prepare`` made for one frame.
    n_frames : int
        Number of frames, 1 to 1e6.
    seed, path
        As `Camera.expose`; the draws are those of no single frame.

    Returns
    -------
    ndarray
        Mean, variance and law of the sum over frames of ``(adu - bias) K / g``; level, map and stripes of the bias are
        off. The converter's rounding enters as its variance, ``n / 12`` ADU^2.

    Raises
    ------
    InputError
        If frames can saturate or an effect is switched on that does not add up (see `stackable`), or the number of
        frames is out of range.
    """
    if isinstance(n_frames, bool) or not isinstance(n_frames, int | np.integer) or not 1 <= n_frames <= MAX_FRAMES:
        raise InputError("n_frames", n_frames, allowed=f"an integer from 1 to {MAX_FRAMES}")
    time, answer = exposure.exposure_s, stackable(camera, exposure)
    if answer.status is not Status.OK:
        raise InputError("exposure_s", time, unit="s", allowed="frames that add up to one draw", hint=answer.message)
    return camera.summed(exposure, int(n_frames), begun(exposure, seed, path))


def flaws_of(detector: AnyDetector, shape: tuple[int, ...], corner: tuple[int, int] | None) -> CalibrationSet | None:
    """Return the calibration set of a frame or of a window of it; None where all of it is switched off.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    shape : tuple of int
        Rows and columns.
    corner : tuple of int or None
        Row and column of the frame at which a window begins; None for the whole frame.

    Raises
    ------
    InputError
        For a window that reaches beyond the active pixels.
    """
    seeded = [effect.switch for effect in detector.chain if effect.seeded]
    if not detector.maps and not any(getattr(detector.switches, name) for name in seeded):
        return None
    whole = load_calibration_set(detector)
    if corner is None:
        return whole
    (rows, columns), (row, column) = detector.sections["active"], corner
    inside, size = rows.start <= row and row + shape[0] <= rows.stop, detector.active_shape
    if not (inside and columns.start <= column and column + shape[1] <= columns.stop):
        window = f"window of {shape[0]} x {shape[1]} from row {row}, column {column}"
        allowed = f"a window of the {size[0]} x {size[1]} active pixels, or the whole frame"
        raise InputError("rate_map_e_s", window, allowed=allowed, hint=f"or switch off {', '.join(seeded)}")
    return whole.window(slice(row, row + shape[0]), slice(column, column + shape[1]))


def corner_of(
    detector: AnyDetector, shape: tuple[int, ...], first_pixel: tuple[int, int] | None
) -> tuple[int, int] | None:
    """Return the row and column of the frame at which a window begins, around the star by default; None for a frame.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    shape : tuple of int
        Rows and columns of the window.
    first_pixel : tuple of int or None
        Where it begins.

    Raises
    ------
    InputError
        For anything but two integers.
    """
    if first_pixel is None:
        around = (detector.star_row - shape[0] // 2, detector.star_column - shape[1] // 2)
        return None if shape == detector.shape else around
    whole = isinstance(first_pixel, tuple | list) and all(isinstance(i, int | np.integer) for i in first_pixel)
    if not whole or len(first_pixel) != 2:
        raise InputError("first_pixel", first_pixel, unit="px", allowed="row and column of the frame, integers")
    return int(first_pixel[0]), int(first_pixel[1])


def begun(exposure: Exposure, seed: int, path: Sequence[PathPart], past: Sequence[PastExposure] = ()) -> Work:
    """Return an empty frame with its random streams.

    Parameters
    ----------
    exposure : Exposure
    seed : int
        Seed of the run.
    path : sequence of str or int
        Names of target, role, band, realisation, frame.
    past : sequence of PastExposure
        Earlier frames.

    Raises
    ------
    InputError
        For a path that is one string.
    """
    if isinstance(path, str):
        raise InputError("path", path, allowed="a sequence of names, not one string")
    shape = exposure.mean_e.shape
    return Work(np.zeros(shape), np.zeros(shape, dtype=np.bool_), functools.partial(stream, seed, *path), past=past)


def run(effects: Sequence[Effect], work: Work, exposure: Exposure) -> None:
    """Draw effects on a frame in their order, each from the stream of its switch."""
    for effect in effects:
        effect.draw(work, exposure, work.stream(effect.switch))


def means(effects: Sequence[Effect], image: FloatArray, exposure: Exposure) -> FloatArray:
    """Return a mean image after effects in their order; changed in place."""
    for effect in effects:
        effect.expect(image, exposure)
    return image


class VisibleCamera(Camera):
    """The EMCCD camera; parameters as `simulator.camera.camera.Camera`."""

    detector: Detector

    def prepare(
        self,
        rate_map_e_s: ArrayLike,
        exposure_s: float,
        em_gain: float,
        *,
        first_pixel: tuple[int, int] | None = None,
        beyond_e_s: ArrayLike | None = None,
    ) -> Exposure:
        """Return the noise-free part of a frame.

        Parameters
        ----------
        rate_map_e_s : array_like
            Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of any shape.
        exposure_s : float
            Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
        em_gain : float
            Actual gain of the register, 1 to ``detector.em_gain_max``.
        first_pixel : tuple of int, optional
            Row and column of the frame at which a window begins; around the star if not given.
        beyond_e_s : array_like, optional
            Light of the frame beyond a window, summed over each of its columns, at least 0: it smears into the window.
            Without it a window is all of the frame that sees light.

        Raises
        ------
        InputError
            For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), another
            argument out of range, or a window outside the active pixels where the flaws of pixels are switched on.
        """
        detector, switches, smear = self.detector, self.detector.switches, None
        gain = checked_scalar("em_gain", em_gain, low=1.0, high=detector.em_gain_max)
        rates, n_negative, time, place, flaws = self._lit(rate_map_e_s, exposure_s, first_pixel)
        light = self._light(rates, flaws, place)
        mean = light * time
        if detector.line_shift_s and time > 0:
            beyond = 0.0 if beyond_e_s is None else _beyond(beyond_e_s, place, rates.shape)
            smear = Smear.smear_e(light, place.rows, detector.line_shift_s, beyond)
            mean += smear
        if switches.dark:
            # Without flaws of the dark current `dark_of` is the same number everywhere.
            dark = detector.dark_rate_e_s if flaws is None else flaws.dark_of(switches)
            pixels = mean[place.rows, place.columns]
            pixels += (dark[place.rows, place.columns] if isinstance(dark, np.ndarray) else dark) * time
        np.minimum(mean, MAX_MEAN_E, out=mean)
        return Exposure(
            detector=detector,
            place=place,
            exposure_s=time,
            em_gain=gain,
            mean_e=mean,
            cic_e=flaws.cic_e if flaws is not None and flaws.cic_varies else None,
            stripe_adu=None if flaws is None else flaws.stripe_adu,
            bias_adu=None if flaws is None else flaws.bias_adu,
            flaws=None if flaws is None else flaws.mask_of(switches),
            smear_e=smear,
            n_negative_rates=n_negative,
            tracks=self._tracks(time),
        )

    def _light(self, rates: FloatArray, flaws: CalibrationSet | None, place: Place) -> FloatArray:
        """Return the rates as the pixels respond to them; borders see no light."""
        if flaws is not None:
            return rates * flaws.response_of(self.detector.switches)
        if not place.whole:
            return rates.copy()
        light = np.zeros_like(rates)
        active = self.detector.sections["active"]
        light[active] = rates[active]
        return light

    def expected_adu(self, exposure: Exposure) -> FloatArray:
        """Return the mean ADU of every pixel, without noise and without rounding.

        Each step acts on the mean image. Where a limit cuts off only the upper tail of the counts (within a few sigma
        of a full well) the mean of noisy frames is lower. Cosmic rays are not in it; interference and drift of the
        bias average out.
        """
        image = means(self.charge, exposure.mean_e.copy(), exposure)
        image /= self.detector.gain_e_adu
        image += self.detector.bias_adu if exposure.bias_adu is None else exposure.bias_adu
        means(self.voltage, image, exposure)
        return np.clip(image, 0.0, float(self.detector.adc_max_adu), out=image)

    def fills(self, exposure: Exposure) -> dict[Reason, float]:
        """Return how far frames fill every limit; see `Camera`."""
        detector, structure = exposure.detector, exposure.detector.bias_structure
        cic = detector.cic_e if exposure.cic_e is None else exposure.cic_e
        rest = FrameNoise.of(detector, 1.0, exposure.exposure_s)
        peak = float((exposure.mean_e * (1.0 + rest.of_past) + cic).max()) + rest.rest_e
        if detector.switches.register_clock_charge:
            peak += detector.register_cic_e * detector.register_stages
        pixel = peak + MARGIN_SIGMA * math.sqrt(peak)
        factor2 = float(detectors.excess_noise_factor2(exposure.em_gain, detector.register_stages))
        output = exposure.em_gain * (peak + MARGIN_SIGMA * math.sqrt(factor2 * peak + MARGIN_SIGMA))
        level = np.array(detector.bias_adu) if exposure.bias_adu is None else exposure.bias_adu
        stripes = np.zeros(1) if exposure.stripe_adu is None else exposure.stripe_adu
        amplifier_e = math.hypot(detector.read_noise_e, math.sqrt(rest.rest_e2))
        swing = MARGIN_SIGMA * math.hypot(amplifier_e / detector.gain_e_adu, structure.drift_adu)
        swing += structure.interference_adu
        room = detector.adc_max_adu - float(level.max() + stripes.max()) - swing
        low = float(level.min() + stripes.min()) - swing
        return {
            Reason.PIXEL_FULL_WELL: pixel / detector.full_well_e,
            Reason.REGISTER_FULL_WELL: output / detector.register_full_well_e,
            Reason.ADC_RANGE: math.inf if low < 0 or room <= 0 else output / detector.gain_e_adu / room,
        }

    def summed(self, exposure: Exposure, n_frames: int, work: Work) -> FloatArray:
        """Return the sum of frames; see `Camera`."""
        detector = exposure.detector
        brighter = {"cic_e": n_frames * detector.cic_e, "register_cic_e": n_frames * detector.register_cic_e}
        whole = dataclasses.replace(
            exposure,
            detector=detector.model_copy(update=brighter),
            mean_e=n_frames * exposure.mean_e,
            cic_e=None if exposure.cic_e is None else n_frames * exposure.cic_e,
        )
        for effects in (self.charge, self.voltage):
            for effect in effects:
                effect.draw_sum(work, whole, n_frames, work.stream(effect.switch))
            if effects is self.charge:
                work.image /= detector.gain_e_adu
        work.image *= detector.gain_e_adu / exposure.em_gain
        return work.image

    def _read(self, work: Work, exposure: Exposure) -> tuple[NDArray[np.uint16], int]:
        detector = self.detector
        work.image *= 1.0 / detector.gain_e_adu
        work.image += detector.bias_adu if exposure.bias_adu is None else exposure.bias_adu
        run(self.voltage, work, exposure)
        adu, level, cut_off = np.empty(work.image.shape, np.uint16), work.image.reshape(-1), work.saturated.reshape(-1)
        digitise = load_kernels(detectors.KERNELS).digitise
        return adu, int(digitise(level, float(detector.adc_max_adu), adu.reshape(-1), cut_off))


def _beyond(beyond_e_s: ArrayLike, place: Place, shape: tuple[int, ...]) -> FloatArray:
    if place.whole or np.shape(beyond_e_s) != shape[1:]:
        raise InputError("beyond_e_s", np.shape(beyond_e_s), unit="px", allowed=f"{shape[1]} columns of a window")
    return checked_array("beyond_e_s", beyond_e_s, low=0.0, high=MOST_E_S, unit="e-/s")


def camera_keywords(detector: AnyDetector, em_gain: float) -> dict[str, Any]:
    """Return what a header says of a camera, by keyword: gain, noise, bias, full well, temperature and clock voltage.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    em_gain : float
        Gain of the register, 1 without one.
    """
    values: dict[str, Any] = {"GAIN": detector.gain_e_adu, "RDNOISE": detector.read_noise_e}
    values |= {"BIASLEV": bias_level_adu(detector), "FULLWELL": detector.full_well_e}
    if isinstance(detector, Detector):
        voltage = float(detectors.em_voltage_of(em_gain, detector.temperature_k))
        values |= {"CCDTEMP": detector.temperature_k, "EMVOLT": voltage}
    return values


def read_times(mode: ReadoutMode, n_reads: int) -> FloatArray:
    """Return the times of the reads as fractions of the exposure: the last is at its end."""
    if mode == "single":
        return np.ones(1)
    return np.linspace(0.0, 1.0, n_reads)


class ReadStack:
    """Reads of one frame, reduced as they come, without keeping them.

    ``single`` keeps the read. ``cds`` subtracts the first read from the last. ``up_the_ramp`` fits a straight line of
    equal weights to the reads of each pixel before it saturates and gives slope times exposure; with fewer than two
    such reads there is no slope, and the pixel is at the top of the range. Differences and slopes stand on the bias.

    Parameters
    ----------
    mode : {"single", "cds", "up_the_ramp"}
        How reads become one number.
    shape : tuple of int
        Rows and columns.
    bias_adu, adc_max_adu : float
        Level of the bias, and largest number of the converter.
    """

    def __init__(self, mode: ReadoutMode, shape: tuple[int, ...], bias_adu: float, adc_max_adu: float) -> None:
        self.mode, self.bias_adu, self.adc_max_adu = mode, bias_adu, adc_max_adu
        self._lost: BoolArray = np.zeros(shape, dtype=np.bool_)
        self._clipped: BoolArray = np.zeros(shape, dtype=np.bool_)
        self._first: FloatArray | None = None
        self._last: FloatArray = np.zeros(shape)
        # Sums over the unsaturated reads: 1, t, t^2, y, t y.
        self._sums: FloatArray | None = np.zeros((5, *shape)) if mode == "up_the_ramp" else None

    def add(self, time: float, adu: FloatArray, full: BoolArray) -> None:
        """Take one read.

        Parameters
        ----------
        time : float
            Fraction of the exposure at which it is taken.
        adu : ndarray
            What the amplifier gives, before the range of the converter cuts it off.
        full : ndarray of bool
            Pixels filled to the full well.
        """
        above = adu > self.adc_max_adu
        self._lost |= full | above
        self._clipped |= above | (adu < 0.0)
        adu = np.clip(adu, 0.0, self.adc_max_adu)
        if self._sums is None:
            self._first = adu if self._first is None else self._first
            self._last = adu
            return
        y, good = adu - self.bias_adu, ~self._lost
        terms: tuple[FloatArray | float, ...] = (1.0, time, time * time, y, time * y)
        for row, term in enumerate(terms):
            self._sums[row] += np.where(good, np.asarray(term), 0.0)

    def result(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Return ADU before rounding, pixels that say nothing about their light, and pixels beyond the converter.

        A pixel is beyond it if a read or the number made from the reads was cut off, or if it saturated before there
        was a slope and was put at the top.
        """
        lost, adu = self._lost, self._last
        if self._sums is not None:
            n, t, tt, y, ty = (np.asarray(total) for total in self._sums)
            enough = n > 1.5
            slope = (n * ty - t * y) / np.where(enough, n * tt - t * t, 1.0)
            adu, lost = np.where(enough, slope + self.bias_adu, self.adc_max_adu), ~enough
            self._clipped |= lost
        elif self.mode == "cds" and self._first is not None:
            adu = self._last - self._first + self.bias_adu
        above = adu > self.adc_max_adu
        clipped = self._clipped | above | (adu < 0.0)
        return np.clip(adu, 0.0, self.adc_max_adu), lost | above, clipped


class InfraredCamera(Camera):
    """The near-infrared camera.

    Parameters
    ----------
    detector : InfraredDetector
        Everything about the camera, switches included.
    cosmic_rays : CosmicRayConfig, optional
        Particles; none without it.
    cosmic_ray_rate_per_s_cm2 : float
        Their rate at the date of the observation.
    persistence : LateCharge, optional
        What earlier frames leave; `simulator.detectors.infrared.ExponentialPersistence` of the configuration if not
        given.
    coupling : Coupling, optional
        Inter-pixel capacitance; the four nearest neighbours with ``interpixel_coupling`` if not given.

    Raises
    ------
    InputError
        For a plug-in whose switch is off, or a rate out of range.
    """

    detector: InfraredDetector

    def __init__(
        self,
        detector: InfraredDetector,
        *,
        cosmic_rays: CosmicRayConfig | None = None,
        cosmic_ray_rate_per_s_cm2: float = 0.0,
        persistence: detectors.LateCharge | None = None,
        coupling: detectors.Coupling | None = None,
    ) -> None:
        rate = checked_scalar("cosmic_ray_rate_per_s_cm2", cosmic_ray_rate_per_s_cm2, low=0.0, high=1e12)
        for key, given in (("persistence", persistence), ("interpixel_capacitance", coupling)):
            if given is not None and not getattr(detector.switches, key):
                raise InputError(f"near_infrared.detector.switches.{key}", False, allowed="true with a plug-in for it")
        instead = detectors.Persistence(persistence), detectors.InterpixelCapacitance(coupling)
        chain = tuple(next((own for own in instead if own.switch == one.switch), one) for one in detector.chain)
        super().__init__(detector, cosmic_rays=cosmic_rays, cosmic_ray_rate_per_s_cm2=rate, chain=chain)

    def _there(self, effect: Any) -> bool:
        return True  # particles can be given frame by frame

    def prepare(
        self, rate_map_e_s: ArrayLike, exposure_s: float, *, first_pixel: tuple[int, int] | None = None
    ) -> Exposure:
        """Return the noise-free part of a frame.

        Parameters
        ----------
        rate_map_e_s : array_like
            Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of it.
        exposure_s : float
            Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
        first_pixel : tuple of int, optional
            Row and column of the frame at which a window begins; around the star if not given.

        Raises
        ------
        InputError
            For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), an exposure
            out of range, or a window that reaches beyond the frame while flaws of pixels are switched on.
        """
        detector, switches = self.detector, self.detector.switches
        rates, n_negative, time, place, flaws = self._lit(rate_map_e_s, exposure_s, first_pixel)
        # The cap keeps products of the largest rates finite.
        light = np.minimum(rates, MAX_RATE_E_S)
        if flaws is not None:
            light = light * flaws.response_of(switches)
            dark, mask = flaws.dark_of(switches), flaws.mask_of(switches)
        else:
            dark = np.full(rates.shape, detector.dark_e_s if switches.dark else 0.0)
            mask = np.zeros(rates.shape, dtype=np.uint8)
        light_e, dark_e = np.minimum(light * time, MAX_MEAN_E), np.minimum(dark * time, MAX_MEAN_E)
        return Exposure(
            detector,
            place,
            time,
            1.0,
            light_e + dark_e,
            flaws=mask,
            n_negative_rates=n_negative,
            tracks=self._tracks(time) if time > 0 else None,
            light_e=light_e,
            dark_e=dark_e,
            n_reads=detector.reads_of(time),
        )

    def expected_adu(self, exposure: Exposure) -> FloatArray:
        """Return the mean ADU of every pixel, without noise, rounding, cosmic rays and persistence.

        Where a limit cuts off only the upper tail of the counts (within a few sigma of full well) the mean of noisy
        frames differs.
        """
        stack, collected = self._stack(exposure.mean_e.shape), means(self.charge, exposure.mean_e.copy(), exposure)
        for fraction in read_times(self.detector.readout_mode, exposure.n_reads):
            charge = fraction * collected
            full = charge >= self.detector.full_well_e
            stack.add(float(fraction), self._adu(means(self.voltage, charge, exposure)), full)
        return stack.result()[0]

    def _read(self, work: Work, exposure: Exposure) -> tuple[NDArray[np.uint16], int]:
        detector, collected, stack = self.detector, work.image, self._stack(work.image.shape)
        streams = {effect.switch: work.stream(effect.switch) for effect in self.voltage}
        for fraction, charge in self._collect(collected, exposure, work.stream("arrivals")):
            work.image = charge + self._struck(work, fraction)
            work.saturated = work.image >= detector.full_well_e
            for effect in self.voltage:
                effect.draw(work, exposure, streams[effect.switch])
            stack.add(fraction, self._adu(work.image), work.saturated)
        work.counts["n_saturated_pixels"] = int(np.count_nonzero(work.saturated))
        adu, work.saturated, clipped = stack.result()
        if work.cosmic is not None:
            collected = collected + work.held[detectors.HITS]
        work.book("lost_full_well", np.maximum(collected - detector.full_well_e, 0.0).sum())
        work.book("stored", np.minimum(collected, detector.full_well_e).sum())
        return np.rint(adu).astype(np.uint16), int(np.count_nonzero(clipped))

    def fills(self, exposure: Exposure) -> dict[Reason, float]:
        """Return how far frames fill every limit; see `Camera`."""
        detector, past = exposure.detector, FrameNoise.of(exposure.detector, 1.0, exposure.exposure_s).of_past
        peak_e = float(exposure.mean_e.max()) * (1.0 + past)
        charge_e = peak_e + MARGIN_SIGMA * math.sqrt(peak_e)
        swing_e = MARGIN_SIGMA * math.hypot(detector.read_noise_e, detector.reset_noise_e)
        below_e, room_e = detector.bias_adu * detector.gain_e_adu, detector.converter_e - swing_e
        return {
            Reason.PIXEL_FULL_WELL: charge_e / detector.full_well_e,
            Reason.ADC_RANGE: math.inf if swing_e > below_e or room_e <= 0 else charge_e / room_e,
        }

    def summed(self, exposure: Any, n_frames: int, work: Work) -> FloatArray:
        """Return the sum of frames; see `Camera`: numbers of equal reads add up, and so do slopes through them."""
        detector = exposure.detector
        whole = dataclasses.replace(exposure, mean_e=n_frames * exposure.mean_e)
        streams = {effect.switch: work.stream(effect.switch) for effect in (*self.charge, *self.voltage)}
        for effect in self.charge:
            effect.draw_sum(work, whole, n_frames, streams[effect.switch])
        bias_adu = n_frames * detector.bias_adu
        stack = ReadStack(detector.readout_mode, work.image.shape, bias_adu, n_frames * detector.adc_max_adu)
        for fraction, charge in self._collect(work.image, whole, work.stream("arrivals")):
            work.image = charge
            for effect in self.voltage:
                effect.draw_sum(work, whole, n_frames, streams[effect.switch])
            stack.add(fraction, work.image / detector.gain_e_adu + bias_adu, work.saturated)
        rounded = math.sqrt(n_frames / 12.0) * work.stream("quantisation").standard_normal(work.image.shape)
        return np.asarray((stack.result()[0] - bias_adu + rounded) * detector.gain_e_adu)

    def _stack(self, shape: tuple[int, ...]) -> ReadStack:
        return ReadStack(self.detector.readout_mode, shape, self.detector.bias_adu, self.detector.adc_max_adu)

    def _adu(self, signal_e: FloatArray) -> FloatArray:
        return signal_e / self.detector.gain_e_adu + self.detector.bias_adu

    @staticmethod
    def _struck(work: Work, fraction: float) -> FloatArray | float:
        """Return the charge of particles at a read."""
        if detectors.HITS not in work.held or fraction == 0.0:
            return 0.0
        hits, arrival = work.held[detectors.HITS], work.held.get(detectors.ARRIVAL)
        return hits if arrival is None else np.where(arrival <= fraction, hits, 0.0)

    def _collect(
        self, total: FloatArray, exposure: Exposure, rng: np.random.Generator
    ) -> Iterator[tuple[float, FloatArray]]:
        """Yield the charge at each read: electrons arrive at independent, uniform times."""
        fractions = read_times(self.detector.readout_mode, exposure.n_reads)
        if not self.detector.switches.photon_noise:
            yield from ((float(fraction), fraction * total) for fraction in fractions)
            return
        left, here, before = total.astype(np.int64), np.zeros(total.shape, dtype=np.int64), 0.0
        for fraction in fractions:
            if fraction == 1.0:
                here = here + left
            elif fraction > before:
                step = rng.binomial(left, (fraction - before) / (1.0 - before))
                here, left = here + step, left - step
            before = float(fraction)
            yield before, here.astype(np.float64)
