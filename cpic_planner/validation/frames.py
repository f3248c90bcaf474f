"""Calibrated frames: raw numbers of a camera back to the electrons that light left in each pixel.

The calibration products are those of the instrument (`simulator.camera.calibration_set`): bias, stripes, flat, dark
current, clock-induced charge and bad pixels as master frames *without noise*, and the two curves of the non-linearity
and the losses of charge transfer as configured. What a real reduction adds by the noise of its masters is not in here.

Steps and their order in the visible are those of a reduction, `simulator.reduction.steps`. Charge left behind in
transfers stays where it arrived: a template of a source is compared after `transferred`. In the near infrared: bias,
inter-pixel capacitance, pixel curve, dark current, flat; what earlier frames leave (persistence) stays, as light of the
same places.

The bias drifts from frame to frame, and a sine of known period and unknown phase is picked up during readout. Both are
fitted behind the upright bar of the cross mask: no light of star or planet gets there, nor does charge that transfers
leave behind along a column, so that the fit cannot touch a source.

Cosmic rays go out in time (`simulator.reduction.reject_cosmic_rays`); sums over frames with holes are here.
"""

import math
from collections.abc import Sequence

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, NDArray, Record, numeric_context
from simulator import detectors
from simulator.camera import FrameNoise, MaskBit, bias_level_adu, load_calibration_set
from simulator.config import AnyDetector, Detector, InfraredDetector
from simulator.observing import MAX_STACK_BYTES, Observation
from simulator.reduction import Master, PixelLaw, Pixels, Rejection, reject_cosmic_rays, steps
from simulator.reduction.cosmic_rays import checked_stack

# A tail of this chance that is cut off lowers a mean by less than 1e-3 of the noise of a frame. The curves of the
# non-linearity take up to 3 % and a flat its per cent on the way to a limit.
_LIMIT_CHANCE, _LIMIT_SHARE = 1e-3, 0.9
_UNCOUPLED = 6  # corrections, each less than a tenth of the one before at the usual per cent of coupling
MOST_LOST = 0.05
"""Share of its frames that a pixel may lose to particles; where it loses more, its own light does it."""


# Columns next to light collect what serial transfers leave behind, up to three pixels further on.
_TRAIL_PIXELS = 4


def dark_bar(observation: Observation) -> BoolArray:
    """Return the pixels behind the upright bar of the cross mask, a margin inside its edges; (y, x)."""
    area, geometry = observation.area, observation.psf.geometry
    half, pixel = geometry.mask_half_width_arcsec, geometry.pixel_scale_arcsec
    inside = (area.columns > -half + _TRAIL_PIXELS * pixel) & (area.columns < half - pixel)
    bar = np.zeros(observation.shape, dtype=np.bool_)
    rows = slice(None) if observation.first_pixel else observation.instrument.detector.sections["active"][0]
    bar[rows, inside] = True
    return bar


class CalibratedFrames(Record, eq=False):
    """Frames of one sequence, calibrated.

    Attributes
    ----------
    electrons : ndarray, shape (n_frames, y, x)
        Electrons of light at the register input, one frame each; 0 where a pixel is bad. Dark current, clock-induced
        charge and smear are taken off.
    usable : ndarray of bool, shape (n_frames, y, x)
        Pixels that a limit did not cut off and that are neither dead, in a bad column nor hot; pixels that their own
        light brings to a limit in some frames are out in all, or the low frames alone would count. Cosmic rays are
        still in: see `cpic_planner.validation.frames`.
    pedestal_e : ndarray, shape (y, x)
        Mean electrons of dark current, clock-induced charge and smear that were taken off each frame: they add noise.
    response : ndarray, shape (y, x)
        Flat that was divided out; 1 where a pixel is bad.
    n_lost : ndarray of int, shape (y, x)
        Frames in which a limit cut the pixel off.
    struck : ndarray of bool, shape (n_frames, y, x)
        Pixel-frames in which a particle left charge: the truth, which no reduction knows.
    lost_in, lost_outside : int
        Sums of ``n_lost`` inside the dark hole and outside it.
    n_frames : int
        Those that were drawn.
    exposure_s, em_gain
        Of the sequence.
    detector : Detector
        The camera.
    """

    electrons: FloatArray
    usable: BoolArray
    pedestal_e: FloatArray
    response: FloatArray
    n_lost: IntArray
    struck: BoolArray
    lost_in: int
    lost_outside: int
    n_frames: int
    exposure_s: float
    em_gain: float
    detector: AnyDetector

    @property
    def noise_e(self) -> float:
        """Gaussian noise of a pixel and frame referred to the register input: read noise and rounding."""
        return math.sqrt(self._noise.gaussian_e2)

    @property
    def _noise(self) -> FrameNoise:
        return FrameNoise.of(self.detector, self.em_gain, self.exposure_s)

    def variance_e2(self, light_e: ArrayLike) -> FloatArray:
        """Return the variance of ``electrons`` of one frame of mean ``light_e`` (y, x)."""
        counts = np.maximum(np.asarray(light_e, dtype=np.float64), 0.0) * self.response + self.pedestal_e
        return self._noise.charge_variance_e2(counts) / self.response**2


@numeric_context()
def calibrated_frames(
    observation: Observation, *, cropped: bool = False, numbers: Sequence[int] | None = None
) -> CalibratedFrames:
    """Draw frames of an observation and calibrate them.

    Parameters
    ----------
    observation : Observation
        Whole frames or the window around the hole.
    cropped : bool
        Keep the stamp around the mask alone, of the size of the PSF's. Whole frames are then drawn and calibrated one
        at a time, and only ``lost_outside`` tells of the rest.
    numbers : sequence of int, optional
        Numbers of the frames; all of them by default.

    Returns
    -------
    CalibratedFrames

    Raises
    ------
    InputError
        For more frames than 2 GB hold, too few pixels for the level, or a stamp that leaves the detector.

    Notes
    -----
    A number with noise of variance ``v`` has a square that is too large by ``v`` on average, so that undoing a curve
    ``x / (1 + b x)`` adds ``b v``: that of the Gaussian noise is taken off (0.002 e- at gain 1).

    Uniform light that reaches the pixels of the level (stray light) is taken off with it.
    """
    place = _stamp(observation) if cropped else (slice(None), slice(None))
    rows, columns = np.empty(observation.shape, dtype=np.bool_)[place].shape
    chosen = range(observation.n_frames) if numbers is None else numbers
    if 8 * len(chosen) * rows * columns > MAX_STACK_BYTES:
        raise InputError("n_frames", observation.n_frames, allowed=f"{MAX_STACK_BYTES / 1e9:g} GB of frames at once")
    detector = observation.channel.detector
    steps: _AnySteps
    steps = _Steps(observation, detector) if isinstance(detector, Detector) else _InfraredSteps(observation, detector)
    good = (steps.flaws & np.uint8(MaskBit.BAD | MaskBit.HOT)) == 0
    hole = observation.psf.geometry.zone.covers(observation.area.rows, observation.area.columns)
    electrons = np.empty((len(chosen), rows, columns))
    usable, struck = np.empty(electrons.shape, dtype=np.bool_), np.empty(electrons.shape, dtype=np.bool_)
    n_lost = np.zeros(observation.shape, dtype=np.int64)
    for index, number in enumerate(chosen):
        frame = observation.frame(number)
        lost = frame.lost
        kept = good & ~lost
        n_lost += lost
        electrons[index] = steps.light_e(frame.adu, kept)[place]
        usable[index] = kept[place]
        struck[index] = (frame.mask[place] & MaskBit.COSMIC_RAY) != 0
    pedestal = (steps.dark_e + steps.cic_e + observation.smear_e)[place]
    if n_lost.any():
        noise_e = math.sqrt(FrameNoise.of(detector, observation.em_gain, observation.exposure_s).gaussian_e2)
        usable &= ~_at_limit(electrons, usable, pedestal, detector, observation.em_gain, noise_e)
    return CalibratedFrames(
        electrons=electrons,
        usable=usable,
        pedestal_e=pedestal,
        response=steps.response[place],
        n_lost=n_lost[place],
        struck=struck,
        lost_in=int(n_lost[hole].sum()),
        lost_outside=int(n_lost[~hole].sum()),
        n_frames=len(chosen),
        exposure_s=observation.exposure_s,
        em_gain=observation.em_gain,
        detector=detector,
    )


def transferred(image_e: ArrayLike, detector: AnyDetector, first_pixel: tuple[int, int] | None) -> FloatArray:
    """Return the mean image after the transfers to the output, as calibrated frames show it.

    Parameters
    ----------
    image_e : array_like
        Light, (y, x).
    detector : Detector or InfraredDetector
        Gives the losses, as far as there are any and they are switched on, and the number of transfers.
    first_pixel : tuple of int or None
        Row and column of the frame that the image begins with (``Sequence.first_pixel``); None for a whole frame.

    Returns
    -------
    ndarray
        The same light with the fraction ``1 - (1 - c)^n`` of each pixel in the next row, and as much in the next
        column: 1.6 % each at 1e-5 a transfer. It hardly leaves an aperture: a planet loses 0.24 (F520), 0.15 (F662),
        0.13 (F720) and 0.10 % (F850) of its aperture sum, which a prediction without transfers does not know.
    """
    image = np.array(image_e, dtype=np.float64)
    row, column = (0, 0) if first_pixel is None else first_pixel
    everything = slice(0, image.shape[0]), slice(0, image.shape[1])
    place = detectors.Place(*everything, row, column, first_pixel is None)
    exposure = detectors.Exposure(detector, place, 0.0, 1.0, image)
    for effect in detector.chain:
        if isinstance(effect, detectors.ParallelTransfer | detectors.SerialTransfer) and effect.on(detector):
            effect.expect(image, exposure)
    return image


class _AnySteps:
    """The base of both cameras: the calibration set of the pixels of a sequence."""

    def __init__(self, observation: Observation, detector: AnyDetector) -> None:
        maps, switches = load_calibration_set(detector), detector.switches
        if observation.first_pixel is not None:
            (row, column), (rows, columns) = observation.first_pixel, observation.shape
            maps = maps.window(slice(row, row + rows), slice(column, column + columns))
        self.maps, self.cic_e = maps, np.zeros(observation.shape)
        self.dark_e = transferred(maps.dark_of(switches) * observation.exposure_s, detector, observation.first_pixel)
        response, flaws = maps.response_of(switches), maps.mask_of(switches)
        self.response = np.where(response > 0, response, 1.0)
        self.flaws = np.where(response > 0, flaws, flaws | np.uint8(MaskBit.BAD))

    def light_e(self, adu: NDArray[np.uint16], usable: BoolArray) -> FloatArray:
        """Return the electrons of light in one frame, 0 in bad pixels; without a level no pixel stays usable."""
        image = self.charge_e(adu, usable) / self.response
        image[(self.flaws & np.uint8(MaskBit.BAD)) != 0] = 0.0
        return image

    def charge_e(self, adu: NDArray[np.uint16], usable: BoolArray) -> FloatArray:
        """Return the electrons of light that the pixels collected."""
        raise NotImplementedError


class _InfraredSteps(_AnySteps):
    """Everything that does so in the near infrared."""

    def __init__(self, observation: Observation, detector: InfraredDetector) -> None:
        super().__init__(observation, detector)
        self.detector, switches = detector, detector.switches
        self.loss = detector.nonlinearity_at_full_well / detector.full_well_e if switches.nonlinearity else 0.0
        coupled = detector.interpixel_coupling if switches.interpixel_capacitance else 0.0
        self.coupling, self.passes = detectors.neighbour_kernel(coupled), _UNCOUPLED if coupled else 0

    def charge_e(self, adu: NDArray[np.uint16], usable: BoolArray) -> FloatArray:
        """Return the electrons of light that the pixels collected.

        The curve of a read, ``q - b q^2``, is also that of the straight line through reads at even steps: the slope of
        a square over them is 1.
        """
        seen = np.asarray((adu - self.detector.bias_adu) * self.detector.gain_e_adu, dtype=np.float64)
        image = seen
        for _ in range(self.passes):
            image = image + seen - self.coupling(image)
        if self.loss:
            image = (1.0 - np.sqrt(np.maximum(1.0 - 4.0 * self.loss * image, 0.0))) / (2.0 * self.loss)
        return image - self.dark_e


class _Steps(_AnySteps):
    """Everything that does so in the visible."""

    def __init__(self, observation: Observation, detector: Detector) -> None:
        super().__init__(observation, detector)
        gain, exposure_s, maps, switches = observation.em_gain, observation.exposure_s, self.maps, detector.switches
        bias = np.full(observation.shape, detector.bias_adu) if maps.bias_adu is None else maps.bias_adu
        beyond_e_s = observation.light.beyond_e_s
        self.known = steps.calibration(
            detector,
            gain,
            exposure_s,
            bias=Master(bias + maps.stripe_adu if switches.stripes else bias),
            dark=Master(self.dark_e),
            flat=Master(np.ones(observation.shape)),
            cic_e=maps.cic_e if switches.clock_charge else self.cic_e,
            beyond_e=0.0 if beyond_e_s is None else detector.line_shift_s * beyond_e_s,
        )
        self.cic_e = self.known.cic_e
        unlit = dark_bar(observation) & (maps.mask_of(switches) == MaskBit.GOOD)
        first = observation.first_pixel or (0, 0)
        about = {"unlit": unlit, "mean_e": self.dark_e + self.cic_e, "first_pixel": first}
        self.level = steps.frame_level(detector, gain, exposure_s, **about)

    def charge_e(self, adu: NDArray[np.uint16], usable: BoolArray) -> FloatArray:
        """Return the electrons of light that the pixels collected."""
        pixels = steps.subtract(Pixels(np.asarray(adu)), self.known.bias)
        level = None if self.level is None else self.level.of(pixels.image, usable)
        if level is not None:
            pixels = Pixels(pixels.image - level)
        elif self.level is not None:
            usable[...] = False
        return steps.light(pixels, self.known).image


def _at_limit(
    electrons: FloatArray, usable: BoolArray, pedestal: FloatArray, detector: AnyDetector, gain: float, noise_e: float
) -> BoolArray:
    """Return the pixels that reach a limit with their own light: their usable frames are those that came out low."""
    room = (detector.adc_max_adu - bias_level_adu(detector)) * detector.gain_e_adu
    limit = min(detector.full_well_e, detector.register_full_well_e / gain, room / gain)
    mean = np.einsum("nyx,nyx->yx", electrons, usable) / np.maximum(np.count_nonzero(usable, axis=0), 1)
    law = PixelLaw(gain, detector.register_stages, noise_e, _LIMIT_CHANCE)
    return law.limit_of_mean(np.maximum(mean + pedestal, 0.0)) > limit * _LIMIT_SHARE


def _stamp(observation: Observation) -> tuple[slice, slice]:
    """Return the stamp of the PSF in the frame."""
    side = observation.psf.on_axis.shape[0]
    rows, columns, _ = observation.area.stamp(side)
    if (rows.stop - rows.start, columns.stop - columns.start) != (side, side):
        allowed = f"a stamp of {side} pixels around the mask on the detector"
        raise InputError("detector.star_row", observation.area.centre, unit="px", allowed=allowed)
    return rows, columns


class Combined(Record, eq=False):
    """Sum of a sequence over frames with holes.

    Attributes
    ----------
    image_e : ndarray, shape (y, x)
        Mean of the usable frames times the number of all frames; NaN where ``covered`` is false.
    n_usable : ndarray of int, shape (y, x)
        Usable frames of each pixel.
    n_frames : int
        All frames.
    """

    image_e: FloatArray
    n_usable: IntArray
    n_frames: int

    @property
    def covered(self) -> BoolArray:
        """Pixels with a usable frame; the others are no part of any region."""
        return self.n_usable > 0

    @property
    def variance_factor(self) -> FloatArray:
        """Variance of a pixel over that of a sum without holes: ``n_frames / n_usable``; infinite where not covered."""
        with np.errstate(divide="ignore"):
            return self.n_frames / self.n_usable


def rejected_in(frames: CalibratedFrames) -> Rejection:
    """Find the hits of a calibrated sequence."""
    return reject_cosmic_rays(
        frames.electrons,
        frames.usable,
        em_gain=frames.em_gain,
        read_noise_e=frames.noise_e * frames.em_gain,
        pedestal_e=frames.pedestal_e,
        stages=frames.detector.register_stages,
    )


@numeric_context()
def combine(electrons: ArrayLike, usable: ArrayLike) -> Combined:
    """Return the sum of frames with holes: the mean of each pixel's usable frames times the number of frames.

    Parameters
    ----------
    electrons : array_like, shape (n_frames, y, x)
    usable : array_like of bool, same shape

    Raises
    ------
    InputError
        For arrays of wrong or different shapes, or numbers that are not finite or beyond 1e100 either way.
    """
    data, good = checked_stack(electrons, usable)
    mean, count = _means(data, good)
    return Combined(np.where(count > 0, mean * len(data), np.nan), count, len(data))


def filled(electrons: ArrayLike, usable: ArrayLike) -> tuple[FloatArray, BoolArray]:
    """Return the frames without holes, for reductions that need whole rows.

    Parameters
    ----------
    electrons : array_like, shape (n_frames, y, x)
    usable : array_like of bool, same shape

    Returns
    -------
    frames : ndarray, shape (n_frames, y, x)
        Unusable pixel-frames hold the mean of their pixel over the usable ones: linear in the light, and the sum over
        frames is that of `combine`. Pixels that are never usable hold 0.
    covered : ndarray of bool, shape (y, x)
        Pixels with a usable frame: the region of the reduction must lie inside.

    Raises
    ------
    InputError
        For arrays of wrong or different shapes, or numbers that are not finite or beyond 1e100 either way.
    """
    data, good = checked_stack(electrons, usable)
    mean, count = _means(data, good)
    return np.where(good, data, mean), count > 0


def _means(data: FloatArray, good: BoolArray) -> tuple[FloatArray, IntArray]:
    """Return the mean over usable frames, 0 without any, and their number."""
    count = np.count_nonzero(good, axis=0)
    total = np.einsum("nyx,nyx->yx", data, good)
    return total / np.maximum(count, 1), np.asarray(count, dtype=np.int64)
