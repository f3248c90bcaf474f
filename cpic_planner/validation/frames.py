"""Calibrated frames: raw numbers of a camera back to the electrons that light left in each pixel.

The calibration products are those of the instrument (`simulator.camera.calibration_set`): bias, stripes, flat, dark
current, clock-induced charge and bad pixels as master frames *without noise*, and the two curves of the non-linearity
and the losses of charge transfer as configured. What a real reduction adds by the noise of its masters is not in here.

Steps, the last effect of the camera first: bias and stripes; level and pick-up of each frame; output curve; gain;
clock-induced charge; pixel curve; dark current; smear; flat. Charge left behind in transfers stays where it arrived:
a template of a source is compared after `transferred`. In the near infrared: bias, inter-pixel capacitance, pixel
curve, dark current, flat; what earlier frames leave (persistence) stays, as light of the same places.

The bias drifts from frame to frame, and a sine of known period and unknown phase is picked up during readout. Both are
fitted behind the upright bar of the cross mask: no light of star or planet gets there, nor does charge that transfers
leave behind along a column, so that the fit cannot touch a source.

Cosmic rays out of a sequence of frames, pixel by pixel in time; and sums over frames with holes.

A pixel is compared with itself in the other frames of its sequence (science and reference each on their own). At high
gain and low flux its law has an exponential tail, so that no number of sigma fits all levels: the limit comes from the
exact law (`PixelLaw`) and holds at every gain and level.

Limits of what a pixel without a cosmic ray shows come from the exact law of the camera. One pixel of one frame holds a
Poisson number of electrons of mean ``lambda``, multiplied by the register and read with Gaussian noise. In electrons at
the register input its cumulant function is exactly ``lambda m(s) + sigma^2 s^2 / 2``, where ``1 + m(s)`` is the mean of
``exp(s output / gain)`` of one electron: the generating function of the register (`simulator.detectors.gain`) at real
arguments. Markov's inequality ``P(X > T) <= exp(lambda m(s) + sigma^2 s^2 / 2 - s T)`` (Chernoff 1952) then bounds the
tail for every ``s``, at any gain and level: no normal law and no exponential one is assumed.
"""

import functools
import math
from collections.abc import Sequence

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, NDArray, Record, numeric_context, require
from cpic_planner.validation.photometry import check_mask, described
from simulator import detectors
from simulator.camera import FrameNoise, MaskBit, bias_level_adu, load_calibration_set
from simulator.config import AnyDetector, Detector, InfraredDetector
from simulator.detectors import generating_function, stage_probability, wave_angles
from simulator.observing import MAX_STACK_BYTES, Observation

# Slopes s of the bound in 1/e-: any set is valid, a dense one is sharp. Noise of 1e4 e- needs 5e-4.
_SLOPES = np.geomspace(1e-5, 30.0, 1500)
_LARGEST_GROWTH = 1e9
_DEPTHS = np.geomspace(1e-6, 1e4, 3000)
_PLACES = 256


class PixelLaw(Record):
    """The law of a pixel of one frame, and the chance with which noise may exceed a limit.

    Attributes
    ----------
    em_gain : float
        Gain of the register.
    stages : int
        Its stages; 0 without one.
    sigma_e : float
        Gaussian noise referred to the register input.
    false_alarm : float
        Largest chance, above 0 and below 1.
    """

    em_gain: float
    stages: int
    sigma_e: float
    false_alarm: float

    def limit_of_mean(self, mean_e: ArrayLike) -> FloatArray:
        """Return the level that a pixel of known mean exceeds with at most the chance that is allowed.

        Parameters
        ----------
        mean_e : array_like
            Mean electrons of the pixel in a frame, dark current and clock-induced charge included, at least 0.

        Returns
        -------
        ndarray
            ``min over s of (mean m(s) + sigma^2 s^2 / 2 - log(false_alarm)) / s``.
        """
        slopes, growth, _ = _growth(float(self.em_gain), int(self.stages))
        mean = np.asarray(mean_e, dtype=np.float64)
        offset = (0.5 * (self.sigma_e * slopes) ** 2 - math.log(self.false_alarm)) / slopes
        return _lowest_line(mean, growth / slopes, offset)

    def limit_beside_others(self, total_e: ArrayLike, n_frames: int, drift: float = 0.0) -> FloatArray:
        """Return the level that one of several frames of a pixel exceeds at most so often, whatever the pixel's mean.

        Parameters
        ----------
        total_e : array_like
            Sum of the pixel over all ``n_frames`` frames, the one to be tested included.
        n_frames : int
            Number of frames, at least 2.
        drift : float
            The mean of the tested frame may exceed that of the others by this fraction.

        Returns
        -------
        ndarray
            Limits on a single frame.

        Notes
        -----
        With ``R`` the sum of the other ``n - 1`` frames, ``E exp(s X - u R) = exp(lambda [(1 + drift) m(s) + (n - 1)
        m(-u)] + sigma^2 (s^2 + (n - 1) u^2) / 2)``. Where ``u`` makes the bracket 0 (or negative) the unknown mean is
        gone and ``s X - u R > sigma^2 (s^2 + (n - 1) u^2) / 2 - log(false_alarm)`` happens with at most that chance.
        Written for the total, each ``s`` is a line in it; the lowest is taken. (That choice looks at the total, which
        costs less than what the inequality gives away: exact tails stay below ``false_alarm``.)
        """
        slopes, growth, depth = _growth(float(self.em_gain), int(self.stages))
        others = n_frames - 1
        index = np.searchsorted(depth, growth * (1.0 + drift) / others)
        possible = index < depth.size
        s, u = slopes[possible], _DEPTHS[index[possible]]
        constant = 0.5 * self.sigma_e**2 * (s**2 + others * u**2) - math.log(self.false_alarm)
        return _lowest_line(np.asarray(total_e, dtype=np.float64), u / (s + u), constant / (s + u))


@functools.lru_cache(maxsize=16)
def _growth(em_gain: float, stages: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the slopes ``s``, ``m(s)`` at them, and ``-m(-u)`` at the depths ``u``."""
    p = float(stage_probability(em_gain, max(stages, 1)))

    def m(s: FloatArray) -> FloatArray:
        with np.errstate(over="ignore", invalid="ignore"):
            value = generating_function(np.exp(s / em_gain).astype(np.complex128), p, stages).real - 1.0
        return np.asarray(value)

    up = m(_SLOPES)
    fine = np.isfinite(up) & (up < _LARGEST_GROWTH)
    # Beyond the first overflow the product of infinities is no number.
    last = int(np.argmin(fine)) if not fine.all() else fine.size
    return _SLOPES[:last], up[:last], -m(-_DEPTHS)


def _lowest_line(x: FloatArray, slope: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the minimum over lines ``slope x + offset``, to second order: the best line of a near place each."""
    if x.size == 0:
        return np.zeros(x.shape)
    places = np.unique(np.quantile(x, np.linspace(0.0, 1.0, min(_PLACES, x.size))))
    best = np.argmin(np.multiply.outer(places, slope) + offset, axis=1)
    middle = 0.5 * (places[1:] + places[:-1])
    chosen = best[np.searchsorted(middle, x)]
    return np.asarray(slope[chosen] * x + offset[chosen])


# A tail of this chance that is cut off lowers a mean by less than 1e-3 of the noise of a frame. The curves of the
# non-linearity take up to 3 % and a flat its per cent on the way to a limit.
_LIMIT_CHANCE, _LIMIT_SHARE = 1e-3, 0.9
_UNCOUPLED = 6  # corrections, each less than a tenth of the one before at the usual per cent of coupling
MOST_LOST = 0.05
"""Share of its frames that a pixel may lose to particles; where it loses more, its own light does it."""


# Columns next to light collect what serial transfers leave behind, up to three pixels further on.
_TRAIL_PIXELS = 4
_LEAST_PIXELS = 100
# Clean pixels cut off at random would bias the level: the chance keeps that below 1e-4 of the mean.
_FALSE_ALARM = 1e-7


class FrameLevel(Record, eq=False):
    """Linear fit of the level of a frame.

    Attributes
    ----------
    pixels : ndarray of int
        Flat indices of the pixels that it is fitted to.
    places : ndarray of int, shape (2, pixels)
        Their rows and columns.
    mean_adu : ndarray
        Mean of their dark current and clock-induced charge.
    limit_adu : ndarray
        How far above the median a pixel without a cosmic ray can be; those beyond and their neighbours are left out.
    shapes : ndarray, shape (k, pixels)
        Shapes fitted: a constant, and the two phases of the wave.
    wave : ndarray, shape (k, y, x)
        The same on all pixels.
    """

    pixels: NDArray[np.intp]
    places: NDArray[np.intp]
    mean_adu: FloatArray
    limit_adu: FloatArray
    shapes: FloatArray
    wave: FloatArray

    def of(self, image_adu: FloatArray, usable: BoolArray) -> FloatArray | None:
        """Return the level of a frame, (y, x), bias taken off before; None where too few pixels are usable.

        Parameters
        ----------
        image_adu : ndarray
            Frame, ADU, (y, x).
        usable : ndarray of bool
            Pixels that count, (y, x).
        """
        seen = image_adu.reshape(-1)[self.pixels] - self.mean_adu
        kept = usable.reshape(-1)[self.pixels]
        if np.count_nonzero(kept) < _LEAST_PIXELS:
            return None
        struck = kept & (seen > np.median(seen[kept]) + self.limit_adu)
        for place in np.flatnonzero(struck):
            row, column = np.abs(self.places - self.places[:, place, None])
            kept &= (row > 1) | (column > 1)
        shapes = self.shapes[:, kept]
        amplitude = np.linalg.solve(shapes @ shapes.T, shapes @ seen[kept])
        return np.asarray(np.tensordot(amplitude, self.wave, axes=1))


def dark_bar(observation: Observation) -> BoolArray:
    """Return the pixels behind the upright bar of the cross mask, a margin inside its edges; (y, x)."""
    area, geometry = observation.area, observation.psf.geometry
    half, pixel = geometry.mask_half_width_arcsec, geometry.pixel_scale_arcsec
    inside = (area.columns > -half + _TRAIL_PIXELS * pixel) & (area.columns < half - pixel)
    bar = np.zeros(observation.shape, dtype=np.bool_)
    rows = slice(None) if observation.first_pixel else observation.instrument.detector.sections["active"][0]
    bar[rows, inside] = True
    return bar


def frame_level(observation: Observation, *, flaws: NDArray[np.uint8], mean_e: FloatArray) -> FrameLevel | None:
    """Return the fit of the level for frames of an observation, by the pixels of `dark_bar`.

    Parameters
    ----------
    observation : Observation
    flaws : ndarray of uint8
        `MaskBit` of the pixels: flawed ones are left out.
    mean_e : ndarray
        Dark current and clock-induced charge of a frame, at the register input.

    Returns
    -------
    FrameLevel or None
        None where the camera has neither drift nor pick-up.

    Raises
    ------
    InputError
        For fewer than 100 pixels behind the bar.
    """
    detector, gain = observation.instrument.detector, observation.em_gain
    structure, switches = detector.bias_structure, detector.switches
    drifts = switches.bias_drift and structure.drift_adu > 0
    waves = switches.interference and structure.interference_adu > 0
    if not drifts and not waves:
        return None
    pixels = np.flatnonzero(dark_bar(observation) & (flaws == MaskBit.GOOD))
    if pixels.size < _LEAST_PIXELS:
        allowed, hint = f"at least {_LEAST_PIXELS} pixels", "switch off bias_drift and interference"
        raise InputError("pixels behind the mask", pixels.size, unit="px", allowed=allowed, hint=hint)
    along_rows, along_columns = wave_angles(detector, observation.shape, *(observation.first_pixel or (0, 0)))
    angle = along_rows[:, None] + along_columns
    shapes = [np.ones(observation.shape)] + ([np.sin(angle), np.cos(angle)] if waves else [])
    wave = np.stack(shapes)
    mean = mean_e.reshape(-1)[pixels]
    rest_e2 = FrameNoise.of(detector, gain, observation.exposure_s).rest_e2
    sigma = math.hypot(math.hypot(detector.read_noise_e, detector.gain_e_adu) / gain, math.sqrt(rest_e2))
    limit = PixelLaw(gain, detector.register_stages, sigma, _FALSE_ALARM).limit_of_mean(mean) - mean
    to_adu = gain / detector.gain_e_adu
    return FrameLevel(
        pixels=pixels,
        places=np.stack(np.divmod(pixels, observation.shape[1])),
        mean_adu=mean * to_adu,
        limit_adu=limit * to_adu + 2.0 * structure.interference_adu,
        shapes=wave.reshape(len(wave), -1)[:, pixels],
        wave=wave,
    )


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
    observation: Observation,
    *,
    cropped: bool = False,
    numbers: Sequence[int] | None = None,
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
        self.k_e_adu, self.em_gain = detector.gain_e_adu, gain
        bias = np.full(observation.shape, detector.bias_adu) if maps.bias_adu is None else maps.bias_adu
        self.bias_adu: FloatArray = bias + maps.stripe_adu if switches.stripes else bias
        cic = maps.cic_e if switches.clock_charge else np.zeros(observation.shape)
        if switches.register_clock_charge:
            cic = cic + detectors.RegisterClockCharge.mean_output_e(detector, gain) / gain
        self.cic_e = cic + FrameNoise.of(detector, gain, exposure_s).rest_e
        mean_e, flaws = self.dark_e + self.cic_e, maps.mask_of(switches)
        self.level = frame_level(observation, flaws=flaws, mean_e=mean_e)
        self.output_b = self.pixel_b = 0.0
        if switches.nonlinearity:
            self.output_b, self.pixel_b = detectors.output_curve(detector), detectors.pixel_curve(detector)
        noise_e2 = FrameNoise.of(detector, gain, 0.0).gaussian_e2
        self.square_e = (self.output_b * gain + self.pixel_b) * noise_e2
        smeared, beyond_e_s = switches.smear and exposure_s > 0, observation.light.beyond_e_s
        self.smear = detector.transfer.line_shift_s / exposure_s if smeared else 0.0
        self.beyond_e = 0.0 if beyond_e_s is None or not smeared else detector.transfer.line_shift_s * beyond_e_s

    def charge_e(self, adu: NDArray[np.uint16], usable: BoolArray) -> FloatArray:
        """Return the electrons of light that the pixels collected."""
        image = adu - self.bias_adu
        if self.level is not None:
            level = self.level.of(image, usable)
            if level is None:
                usable[...] = False
            else:
                image -= level
        image *= self.k_e_adu
        image /= 1.0 - self.output_b * image
        image /= self.em_gain
        image -= self.cic_e
        image /= 1.0 - self.pixel_b * image
        image -= self.square_e
        image -= self.dark_e
        if self.smear:
            # Each line collects the light of the others of its column: o = (1 - k) l + k sum(l), solved for l; that of
            # lines beyond a window is known from the whole frame.
            image -= self.beyond_e
            share = self.smear / (1.0 + (len(image) - 1) * self.smear)
            image -= share * image.sum(axis=0)
            image /= 1.0 - self.smear
        return np.asarray(image)


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


FALSE_ALARM = 1e-6
MOST_E = 1e100
# The wavefront walks within a visit: speckles change by up to this fraction and more where they are faint.
DRIFT = 0.1
_MOST_PASSES = 20


class Rejection(Record, eq=False):
    """The pixels that were taken out of a sequence.

    Attributes
    ----------
    rejected : ndarray of bool, shape (n_frames, y, x)
        Pixel-frames that are hit or lie next to one that is.
    n_hit : int
        Pixel-frames above the limit, the neighbours not counted.
    """

    rejected: BoolArray
    n_hit: int

    @property
    def fraction(self) -> float:
        """Rejected share of all pixel-frames."""
        return float(np.mean(self.rejected))


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


@numeric_context()
def reject_cosmic_rays(
    frames: ArrayLike,
    usable: ArrayLike,
    *,
    em_gain: float,
    read_noise_e: float,
    pedestal_e: ArrayLike = 0.0,
    stages: int = 604,
    gain_e_adu: float = 0.0,
    false_alarm: float = FALSE_ALARM,
    drift: float = DRIFT,
    grow: bool = True,
) -> Rejection:
    """Find the pixel-frames that cosmic rays hit.

    Parameters
    ----------
    frames : array_like, shape (n_frames, y, x)
        Electrons at the register input of frames of one exposure and gain (`calibrated_frames`).
    usable : array_like of bool, same shape
        Pixel-frames to use; the others are neither tested nor compared with.
    em_gain : float
        Gain of the register, 1 to 1e4.
    read_noise_e : float
        Read noise at the output of the register, at least 0.
    pedestal_e : array_like, optional
        Mean electrons per frame that calibration has taken off (``CalibratedFrames.pedestal_e``), (y, x) or a number.
    stages : int, optional
        Stages of the register; 0 without one.
    gain_e_adu : float, optional
        Electrons per ADU at the output: rounding of the converter.
    false_alarm : float, optional
        Largest chance of taking a pixel-frame without a hit for one, above 0 and below 0.1.
    drift : float, optional
        Fraction by which the light of a pixel may rise in a frame over its mean, 0 to 10.
    grow : bool, optional
        Whether the eight neighbours of a hit pixel in the same frame go with it.

    Returns
    -------
    Rejection
        With a single frame nothing is rejected: there is nothing to compare it with.

    Raises
    ------
    InputError
        For arrays of wrong or different shapes, numbers that are not finite or beyond 1e100 either way, or an argument
        out of range.

    Notes
    -----
    The limit on one frame follows from the sum of all of them without knowing the mean of the pixel
    (`PixelLaw.limit_beside_others`). Where a pixel is hit twice or more, the sum is too large at first and falls as
    hits go out: it is repeated until nothing more is found. Charge diffuses by 0.35 pixels (Gaussian) and transfers
    leave 1.6 % of it in the next row and column each, so that the neighbours hold what the limit lets through. They go
    whatever they hold: that takes light out of no mean.

    On clean frames of 0.01 to 1e4 e- at gains 1 to 1000 the chance of a false hit is 0.2 ``false_alarm`` at most; the
    mean loses less than 1e-3 of itself or, where read noise rules, 1e-6 of that.

    Particles that cross a layer of 14 um (the ``physical`` model) are found in every aperture from gain 20 on. At gain
    1 a third of them hides in the read noise and adds 1 to 2 % to that of the stack.
    """
    data, good = _checked(frames, usable)
    for key, value, low, high in (
        ("em_gain", em_gain, 1.0, 1e4),
        ("read_noise_e", read_noise_e, 0.0, 1e6),
        ("gain_e_adu", gain_e_adu, 0.0, 1e6),
        ("drift", drift, 0.0, 10.0),
    ):
        require(key, value, math.isfinite(value) and low <= value <= high, "", f"{low:g} to {high:g}")
    require("false_alarm", false_alarm, 0.0 < false_alarm < 0.1, "", "above 0 and below 0.1")
    n_frames, hit = len(data), np.zeros(data.shape, dtype=np.bool_)
    if n_frames < 2:
        return Rejection(hit, 0)
    pedestal = np.broadcast_to(np.asarray(pedestal_e, dtype=np.float64), data.shape[1:])
    sigma = math.sqrt(read_noise_e**2 + gain_e_adu**2 / 12.0) / em_gain
    # Unusable pixel-frames count as empty and are not tested.
    tested = data.reshape(n_frames, -1)
    counted = good.reshape(n_frames, -1)
    flat = hit.reshape(n_frames, -1)
    total = np.einsum("nyx,nyx->yx", data, good).reshape(-1)
    count = np.count_nonzero(good, axis=0).reshape(-1)
    offset = pedestal.reshape(-1)
    law = PixelLaw(em_gain, stages, sigma, false_alarm)
    active = np.flatnonzero(count >= 2)
    for _ in range(_MOST_PASSES):
        limit = np.empty(active.size)
        for number in np.unique(count[active]):
            same = count[active] == number
            where = active[same]
            limit[same] = law.limit_beside_others(total[where] + number * offset[where], int(number), drift)
        columns = slice(None) if active.size == total.size else active  # a choice of columns is a copy
        above = (tested[:, columns] > limit - offset[active]) & counted[:, columns] & ~flat[:, columns]
        changed = above.any(axis=0)
        if not changed.any():
            break
        frame, place = np.nonzero(above[:, changed])
        place = active[changed][place]
        flat[frame, place] = True
        np.subtract.at(total, place, tested[frame, place])
        np.subtract.at(count, place, 1)
        active = active[changed]
        active = active[count[active] >= 2]
    n_hit = int(np.count_nonzero(hit))
    return Rejection(grown(hit) if grow and n_hit else hit, n_hit)


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
    data, good = _checked(electrons, usable)
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
    data, good = _checked(electrons, usable)
    mean, count = _means(data, good)
    return np.where(good, data, mean), count > 0


def _means(data: FloatArray, good: BoolArray) -> tuple[FloatArray, IntArray]:
    """Return the mean over usable frames, 0 without any, and their number."""
    count = np.count_nonzero(good, axis=0)
    total = np.einsum("nyx,nyx->yx", data, good)
    return total / np.maximum(count, 1), np.asarray(count, dtype=np.int64)


def grown(hit: BoolArray, pixels: int = 1) -> BoolArray:
    """Mark each hit with its neighbours in the same frame, up to so many pixels away either way."""
    wide = hit.copy()
    for _ in range(pixels):
        across = wide.copy()
        across[:, :, 1:] |= wide[:, :, :-1]
        across[:, :, :-1] |= wide[:, :, 1:]
        wide = across.copy()
        wide[:, 1:] |= across[:, :-1]
        wide[:, :-1] |= across[:, 1:]
    return wide


def _checked(frames: ArrayLike, usable: ArrayLike) -> tuple[FloatArray, BoolArray]:
    data = np.asarray(frames)
    if data.dtype.kind not in "iuf" or data.ndim != 3 or data.size == 0:
        raise InputError("frames", described(data), unit="e-", allowed="frames (n, y, x)")
    good = check_mask("usable", usable, data.shape, empty=True)
    data = data.astype(np.float64, copy=False)
    if not max(data.max(), -data.min()) <= MOST_E:  # nor is nan
        bad, allowed = ~np.isfinite(data), "finite numbers"
        if not bad.any():
            bad, allowed = np.abs(data) > MOST_E, f"{-MOST_E:g} to {MOST_E:g}, so that sums stay finite"
        n, y, x = np.argwhere(bad)[0]
        raise InputError(f"frames[{n}, y={y}, x={x}]", float(data[n, y, x]), unit="e-", allowed=allowed)
    return data, good
