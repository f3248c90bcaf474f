"""Steps from raw numbers to electrons of light, each a pure function of a record of image, variance and mask.

Order, the last effect of the camera first: limits of the converter and of the charge are flagged; bias; level and
pick-up of the frame; gain; output curve; gain of the register; clock-induced charge; pixel curve; dark current; smear;
flat. The public Level-1 data model lists gain first and the non-linearity last. A curve is undone on what its part of
the camera saw, the output's before the division by the gain and the pixels' before dark current and flat, or it would
be that of another level; all other steps of the model keep their order. Charge left behind in transfers (the model's
CTE) stays where it arrived.

Errors are carried to first order. ``variance`` is the noise of the frame itself; what comes from a master is in
``shared``, by the name of the master: the signed change of a pixel for one standard deviation of that master. A bias
that enters through the dark and the flat too is then counted once, with the right sign; for a dark of equal exposure it
cancels.
"""

import math
from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, NDArray, Record
from simulator.camera import FrameNoise
from simulator.config import Detector
from simulator.detectors import RegisterClockCharge, output_curve, pixel_curve, wave_angles
from simulator.reduction.cosmic_rays import PixelLaw

LEAST_PIXELS = 100
"""Fewest pixels that a level is fitted to."""
# Clean pixels cut off at random would bias the level: the chance keeps that below 1e-4 of the mean.
_FALSE_ALARM = 1e-7

Shares = Mapping[str, FloatArray]


class Pixels(Record, eq=False):
    """Pixels of a frame on their way.

    Attributes
    ----------
    image : ndarray, shape (y, x)
        ADU or electrons, as the step says.
    variance : ndarray or None
        Variance of ``image`` by the noise of the frame; None where errors are not followed.
    mask : ndarray of uint8 or None
        `simulator.camera.MaskBit`.
    shared : mapping of str to ndarray
        Change of ``image`` for one standard deviation of each master.
    """

    image: FloatArray
    variance: FloatArray | None = None
    mask: NDArray[np.uint8] | None = None
    shared: Shares = field(default_factory=dict)

    @property
    def shared_variance(self) -> FloatArray:
        """Variance that the masters bring: the same error in every frame that they calibrate."""
        return sum((one**2 for one in self.shared.values()), np.zeros(self.image.shape))

    def _moved(self, image: FloatArray, slope: ArrayLike) -> "Pixels":
        """Return other numbers, which change by ``slope`` times the change of these."""
        if self.variance is None and not self.shared:
            return Pixels(image, None, self.mask)
        step = np.asarray(slope)
        variance = None if self.variance is None else self.variance * step**2
        return Pixels(image, variance, self.mask, {name: one * step for name, one in self.shared.items()})


class Master(Record, eq=False):
    """A calibration.

    Attributes
    ----------
    value : ndarray, shape (y, x)
        Bias (ADU, level off), dark current (electrons in the exposure) or flat (mean 1).
    shared : mapping of str to ndarray
        As of `Pixels`: its own noise, and that of the masters that it was made with; empty for a map without noise.
    mask : ndarray of uint8 or None
        Pixels that it shows to be bad, hot or warm.
    name : str
        Where it came from.
    """

    value: FloatArray
    shared: Shares = field(default_factory=dict)
    mask: NDArray[np.uint8] | None = None
    name: str = ""

    def times(self, factor: float) -> "Master":
        """Return the master of that many times the value."""
        return replace(
            self, value=self.value * factor, shared={name: one * factor for name, one in self.shared.items()}
        )


class Calibration(Record, eq=False):
    """The masters and numbers of the camera with which a frame is calibrated.

    Attributes
    ----------
    bias, dark, flat : Master
    cic_e : ndarray
        Clock-induced electrons a frame, those of the register over its gain included.
    gain_e_adu, em_gain : float
    output_b, pixel_b : float
        ``b`` of the curves ``x / (1 + b x)`` of output and pixels, 1/e-; 0 for straight lines.
    square_e : float
        What undoing the curves adds to the mean of a noisy frame: ``b`` times the Gaussian variance.
    smear : float
        Time that a line stands in the light of each other over the exposure.
    beyond_e : ndarray or float
        Smear by light beyond a window.
    """

    bias: Master
    dark: Master
    flat: Master
    cic_e: FloatArray
    gain_e_adu: float
    em_gain: float
    output_b: float = 0.0
    pixel_b: float = 0.0
    square_e: float = 0.0
    smear: float = 0.0
    beyond_e: FloatArray | float = 0.0


def calibration(
    detector: Detector,
    em_gain: float,
    exposure_s: float,
    *,
    bias: Master,
    dark: Master,
    flat: Master,
    cic_e: FloatArray,
    beyond_e: FloatArray | float = 0.0,
) -> Calibration:
    """Return a calibration with the numbers of a camera, as far as its effects are switched on.

    Parameters
    ----------
    detector : Detector
    em_gain : float
        Gain of the register.
    exposure_s : float
    bias, dark, flat : Master
    cic_e : ndarray
        Clock-induced charge of the parallel clocks; that of the register and of further effects is added.
    beyond_e : ndarray or float
        Smear by light beyond a window.
    """
    switches, numbers = detector.switches, {"output_b": 0.0, "pixel_b": 0.0}
    if switches.register_clock_charge:
        cic_e = cic_e + RegisterClockCharge.mean_output_e(detector, em_gain) / em_gain
    if switches.nonlinearity:
        numbers = {"output_b": output_curve(detector), "pixel_b": pixel_curve(detector)}
    noise_e2 = FrameNoise.of(detector, em_gain, 0.0).gaussian_e2
    return Calibration(
        bias,
        dark,
        flat,
        cic_e + FrameNoise.of(detector, em_gain, exposure_s).rest_e,
        detector.gain_e_adu,
        em_gain,
        **numbers,
        square_e=(numbers["output_b"] * em_gain + numbers["pixel_b"]) * noise_e2,
        smear=detector.line_shift_s / exposure_s if exposure_s > 0 else 0.0,
        beyond_e=beyond_e,
    )


def subtract(pixels: Pixels, master: Master) -> Pixels:
    """Return the pixels without a bias (ADU) or dark current (electrons), whose noise joins that of the masters."""
    left = pixels._moved(pixels.image - master.value, 1.0)
    return _with_shared(left, {name: -one for name, one in master.shared.items()})


def _with_shared(pixels: Pixels, more: Shares) -> Pixels:
    """Return the pixels with further changes by masters, those of one master added."""
    if not more:
        return pixels
    joined = dict(pixels.shared)
    for name, one in more.items():
        joined[name] = joined[name] + one if name in joined else one
    return replace(pixels, shared=joined)


def scale(pixels: Pixels, gain_e_adu: float) -> Pixels:
    """Return ADU as electrons at the output of the register."""
    return pixels._moved(pixels.image * gain_e_adu, gain_e_adu)


def straighten(pixels: Pixels, b: float) -> Pixels:
    """Return electrons before the curve ``x / (1 + b x)``."""
    if b == 0.0:
        return pixels
    room = 1.0 - b * pixels.image
    return pixels._moved(pixels.image / room, 1.0 / room**2 if pixels.variance is not None else 1.0)


def unmultiply(pixels: Pixels, em_gain: float) -> Pixels:
    """Return electrons at the output as those at the input of the register."""
    return pixels._moved(pixels.image / em_gain, 1.0 / em_gain)


def unsmear(pixels: Pixels, smear: float, beyond_e: FloatArray | float = 0.0) -> Pixels:
    """Return electrons without those that came from other lines during frame transfer.

    Each line collects the light of the others of its column: ``o = (1 - k) l + k sum(l)``, solved for ``l``; that of
    lines beyond a window is known from the whole frame.

    Parameters
    ----------
    pixels : Pixels
        Electrons, (y, x), lines along x.
    smear : float
        ``k``: time that a line stands in the light of each other, over the exposure.
    beyond_e : ndarray or float
        What lines beyond a window left.
    """
    if not smear:
        return pixels
    image = pixels.image - beyond_e
    share = smear / (1.0 + (len(image) - 1) * smear)
    image = image - share * image.sum(axis=0)
    return pixels._moved(image / (1.0 - smear), 1.0 / (1.0 - smear))


def flatten(pixels: Pixels, flat: Master) -> Pixels:
    """Return electrons over the response; the noise of the flat joins that of the masters."""
    even = pixels._moved(pixels.image / flat.value, 1.0 / flat.value if pixels.variance is not None else 1.0)
    return _with_shared(even, {name: -even.image / flat.value * one for name, one in flat.shared.items()})


def collected(pixels: Pixels, known: Calibration) -> Pixels:
    """Return ADU without bias and level as electrons that the pixels collected, with dark current."""
    pixels = straighten(scale(pixels, known.gain_e_adu), known.output_b)
    pixels = unmultiply(pixels, known.em_gain)
    pixels = straighten(pixels._moved(pixels.image - known.cic_e, 1.0), known.pixel_b)
    return pixels._moved(pixels.image - known.square_e, 1.0)


def light(pixels: Pixels, known: Calibration) -> Pixels:
    """Return ADU without bias and level as electrons of light."""
    return flatten(unsmear(subtract(collected(pixels, known), known.dark), known.smear, known.beyond_e), known.flat)


class FrameLevel(Record, eq=False):
    """Linear fit of the level of a frame.

    The bias drifts from frame to frame, and a sine of known period and unknown phase is picked up during readout. Both
    are fitted to pixels that see no light.

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
        if np.count_nonzero(kept) < LEAST_PIXELS:
            return None
        struck = kept & (seen > np.median(seen[kept]) + self.limit_adu)
        for place in np.flatnonzero(struck):
            row, column = np.abs(self.places - self.places[:, place, None])
            kept &= (row > 1) | (column > 1)
        shapes = self.shapes[:, kept]
        amplitude = np.linalg.solve(shapes @ shapes.T, shapes @ seen[kept])
        return np.asarray(np.tensordot(amplitude, self.wave, axes=1))


def frame_level(
    detector: Detector,
    em_gain: float,
    exposure_s: float,
    *,
    unlit: BoolArray,
    mean_e: FloatArray,
    first_pixel: tuple[int, int] = (0, 0),
) -> FrameLevel | None:
    """Return the fit of the level for frames of one gain and exposure.

    Parameters
    ----------
    detector : Detector
    em_gain : float
        Gain of the register.
    exposure_s : float
    unlit : ndarray of bool, shape (y, x)
        Pixels that see no light and have no flaw.
    mean_e : ndarray, shape (y, x)
        Dark current and clock-induced charge of a frame, at the register input.
    first_pixel : tuple of int
        Row and column of the frame that the image begins with.

    Returns
    -------
    FrameLevel or None
        None where the camera has neither drift nor pick-up.

    Raises
    ------
    InputError
        For fewer than 100 pixels.
    """
    structure, switches = detector.bias_structure, detector.switches
    drifts = switches.bias_drift and structure.drift_adu > 0
    waves = switches.interference and structure.interference_adu > 0
    if not drifts and not waves:
        return None
    shape, pixels = unlit.shape, np.flatnonzero(unlit)
    if pixels.size < LEAST_PIXELS:
        allowed, hint = f"at least {LEAST_PIXELS} pixels", "switch off bias_drift and interference"
        raise InputError("pixels without light", pixels.size, unit="px", allowed=allowed, hint=hint)
    along_rows, along_columns = wave_angles(detector, shape, *first_pixel)
    angle = along_rows[:, None] + along_columns
    shapes = [np.ones(shape)] + ([np.sin(angle), np.cos(angle)] if waves else [])
    wave = np.stack(shapes)
    mean = mean_e.reshape(-1)[pixels]
    rest_e2 = FrameNoise.of(detector, em_gain, exposure_s).rest_e2
    sigma = math.hypot(math.hypot(detector.read_noise_e, detector.gain_e_adu) / em_gain, math.sqrt(rest_e2))
    limit = PixelLaw(em_gain, detector.register_stages, sigma, _FALSE_ALARM).limit_of_mean(mean) - mean
    to_adu = em_gain / detector.gain_e_adu
    return FrameLevel(
        pixels=pixels,
        places=np.stack(np.divmod(pixels, shape[1])),
        mean_adu=mean * to_adu,
        limit_adu=limit * to_adu + 2.0 * structure.interference_adu,
        shapes=wave.reshape(len(wave), -1)[:, pixels],
        wave=wave,
    )
