"""The visible camera: the effects of an EMCCD in their order, on a whole frame, a window, or a sum of frames.

Light goes through the response of the pixels, smear and dark current are added (`prepare`, noise-free, once for a
sequence). Each frame then runs through photon noise, cosmic rays, non-linearity, full well and blooming, parallel
transfer, clock-induced charge, serial transfer, the multiplication register and its full well, the output amplifier,
read noise, bias and converter. Every step is an `Effect` with its own switch and its own random stream. One-call
functions make a noiseless map, a noisy frame, or electrons.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
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
    checked_array,
    checked_scalar,
    load_kernels,
)
from simulator.camera.calibration_set import CalibrationSet, bias_level_adu
from simulator.camera.camera import (
    MARGIN_SIGMA,
    MAX_EXPOSURE_S,
    MAX_MEAN_E,
    Camera,
    begun,
    corner_of,
    flaws_of,
    means,
    run,
)
from simulator.camera.frame import MOST_E_S, Frame, MaskBit, checked_rates
from simulator.camera.noise import FrameNoise
from simulator.config import AnyDetector, Detector
from simulator.detectors import GAIN_LIMIT, LIMIT_KERNELS, Exposure, Place, Smear, Work, excess_noise_factor2


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
        rates, n_negative = checked_rates(rate_map_e_s)
        time = checked_scalar("exposure_s", exposure_s, low=0.0, high=MAX_EXPOSURE_S, unit="s")
        gain = checked_scalar("em_gain", em_gain, low=1.0, high=detector.em_gain_max)
        corner = corner_of(detector, rates.shape, first_pixel)
        place, flaws = _place(detector, rates.shape, corner), flaws_of(detector, rates.shape, corner)
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
            tracks=self._tracks(detector, time),
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
        peak = float((exposure.mean_e + cic).max()) + rest.rest_e
        if detector.switches.register_clock_charge:
            peak += detector.register_cic_e * detector.register_stages
        pixel = peak + MARGIN_SIGMA * math.sqrt(peak)
        factor2 = float(excess_noise_factor2(exposure.em_gain, detector.register_stages))
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

    def expose(self, exposure: Exposure, *, seed: int, path: Sequence[PathPart]) -> Frame:
        """Return one noisy frame.

        Parameters
        ----------
        exposure : Exposure
            What `prepare` made.
        seed : int
            Seed of the run.
        path : sequence of str or int
            Names of target, role, band, realisation, frame. Each effect draws from ``stream(seed, *path, switch)``.
        """
        work, detector = begun(exposure, seed, path), self.detector
        run(self.charge, work, exposure)
        work.image *= 1.0 / detector.gain_e_adu
        work.image += detector.bias_adu if exposure.bias_adu is None else exposure.bias_adu
        run(self.voltage, work, exposure)
        adu, level, cut_off = np.empty(work.image.shape, np.uint16), work.image.reshape(-1), work.saturated.reshape(-1)
        digitise = load_kernels(LIMIT_KERNELS).digitise
        n_clipped = int(digitise(level, float(detector.adc_max_adu), adu.reshape(-1), cut_off))
        work.counts["n_negative_rates"] = exposure.n_negative_rates
        return Frame(adu, _mask(work, exposure), dict(work.charge), n_clipped, **work.counts)


def _mask(work: Work, exposure: Exposure) -> NDArray[np.uint8]:
    mask = work.saturated.astype(np.uint8)
    mask *= np.uint8(MaskBit.SATURATED)
    if work.cosmic is not None:
        mask |= work.cosmic.view(np.uint8) * np.uint8(MaskBit.COSMIC_RAY)
    if exposure.flaws is not None:
        mask |= exposure.flaws
    return mask


def _beyond(beyond_e_s: ArrayLike, place: Place, shape: tuple[int, ...]) -> FloatArray:
    if place.whole or np.shape(beyond_e_s) != shape[1:]:
        raise InputError("beyond_e_s", np.shape(beyond_e_s), unit="px", allowed=f"{shape[1]} columns of a window")
    return checked_array("beyond_e_s", beyond_e_s, low=0.0, high=MOST_E_S, unit="e-/s")


def _place(detector: Detector, shape: tuple[int, ...], corner: tuple[int, int] | None) -> Place:
    if corner is None:
        return Place(*detector.sections["image"], 0, 0, True)
    return Place(slice(0, shape[0]), slice(0, shape[1]), *corner, False)


# ln G = a + b v + c v^2 + d v^3, v = V - 39 V - 0.029 V/K (T - 223 K), fitted to the curves of the e2v CCD201-20 data
# sheet (gain against clock amplitude, 223 K to 293 K, read to 10 %). Its slope has no zero: one voltage per gain.
_A, _B, _C, _D = 0.582, 0.860, -0.0530, 0.01465
_REFERENCE_V, _REFERENCE_K, _V_PER_K = 39.0, 223.0, 0.029
VOLTAGE_RANGE_V = (20.0, 50.0)
TEMPERATURE_RANGE_K = (120.0, 320.0)
FITTED_TEMPERATURE_K = (223.0, 293.0)
FITTED_GAIN = (5.0, 300.0)


@dataclass(frozen=True, eq=False)
class GainSetting:
    """Gain, voltage and temperature that belong together; arrays of one shape.

    Attributes
    ----------
    em_gain, voltage_v, temperature_k : ndarray
        Mean gain of the register, amplitude of its high-voltage clock, temperature of the detector.
    clipped : ndarray of bool
        Where the fit fell below 1 and the gain is 1.
    beyond_temperature : ndarray of bool
        Where the temperature is outside the 223 K to 293 K of the fitted curves.
    beyond_gain : ndarray of bool
        Where the gain is outside the 5 to 300 for which the fit is good.
    """

    em_gain: FloatArray
    voltage_v: FloatArray
    temperature_k: FloatArray
    clipped: BoolArray
    beyond_temperature: BoolArray
    beyond_gain: BoolArray

    def flags(self, index: tuple[int, ...] | int = ()) -> tuple[str, ...]:
        """Return the caveats of one element."""
        names = "clamped", "extrapolated_temperature", "extrapolated_gain"
        where = self.clipped, self.beyond_temperature, self.beyond_gain
        return tuple(name for name, flagged in zip(names, where, strict=True) if flagged[index])

    def gain(self, index: tuple[int, ...] | int = ()) -> Outcome[float]:
        """Return the gain of one element as a typed answer."""
        return Outcome.ok(float(self.em_gain[index]), flags=self.flags(index))

    def voltage(self, index: tuple[int, ...] | int = ()) -> Outcome[float]:
        """Return the voltage of one element as a typed answer."""
        return Outcome.ok(float(self.voltage_v[index]), unit="V", flags=self.flags(index))


def em_gain_of(voltage_v: ArrayLike, temperature_k: ArrayLike) -> GainSetting:
    """Return the gain of the register at a clock voltage and temperature.

    Parameters
    ----------
    voltage_v : array_like
        Amplitude of the high-voltage clock, 20 to 50 V.
    temperature_k : array_like
        Temperature of the detector, 120 to 320 K; broadcasts.

    Returns
    -------
    GainSetting
        Gain of at least 1, rising with the voltage and falling with the temperature. Against the data sheet of the
        e2v CCD201-20: within 15 % for gains of 5 to 300 at 223 K to 273 K, 28 % low at gain 5.5 and 293 K, up to 40 %
        high near gain 1000; below gain 5 only good (15 %) at 223 K and 233 K. What lies outside is flagged.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.
    """
    voltage = checked_array("voltage_v", voltage_v, low=VOLTAGE_RANGE_V[0], high=VOLTAGE_RANGE_V[1], unit="V")
    temperature = _checked_temperature(temperature_k)
    v = voltage - _shift(temperature)
    log_gain = _A + v * (_B + v * (_C + v * _D))
    return _setting(np.exp(np.maximum(log_gain, 0.0)), voltage, temperature, log_gain < 0.0)


def em_voltage_of(em_gain: ArrayLike, temperature_k: ArrayLike) -> GainSetting:
    """Return the clock voltage that gives a gain at a temperature: the inverse of `em_gain_of`.

    Parameters
    ----------
    em_gain : array_like
        Gain of the register, 1 to 1e4.
    temperature_k : array_like
        Temperature of the detector, 120 to 320 K; broadcasts.

    Returns
    -------
    GainSetting
        For gain 1 the highest voltage that gives it. Accuracy and flags as `em_gain_of`.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.
    """
    gain = checked_array("em_gain", em_gain, low=1.0, high=GAIN_LIMIT)
    temperature = _checked_temperature(temperature_k)
    # The one real root of the cubic (Vieta's hyperbolic form): with v = t - c/3d it reads t^3 + p t + q = 0, p > 0.
    shift = _C / (3.0 * _D)
    p = _B / _D - 3.0 * shift**2
    q = 2.0 * shift**3 - shift * _B / _D + (_A - np.log(gain)) / _D
    t = -2.0 * np.sqrt(p / 3.0) * np.sinh(np.arcsinh(1.5 * q / p * np.sqrt(3.0 / p)) / 3.0)
    return _setting(gain, t - shift + _shift(temperature), temperature, np.False_)


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
        voltage = float(em_voltage_of(em_gain, detector.temperature_k).voltage_v)
        values |= {"CCDTEMP": detector.temperature_k, "EMVOLT": voltage}
    return values


def _shift(temperature: FloatArray) -> FloatArray:
    return _REFERENCE_V + _V_PER_K * (temperature - _REFERENCE_K)


def _checked_temperature(temperature_k: ArrayLike) -> FloatArray:
    low, high = TEMPERATURE_RANGE_K
    return checked_array("temperature_k", temperature_k, low=low, high=high, unit="K")


def _setting(gain: FloatArray, voltage: FloatArray, temperature: FloatArray, clipped: Any) -> GainSetting:
    gain, voltage, temperature, clipped = map(np.array, np.broadcast_arrays(gain, voltage, temperature, clipped))
    return GainSetting(
        em_gain=gain,
        voltage_v=voltage,
        temperature_k=temperature,
        clipped=clipped,
        beyond_temperature=_outside(temperature, FITTED_TEMPERATURE_K),
        beyond_gain=_outside(gain, FITTED_GAIN),
    )


def _outside(values: FloatArray, limits: tuple[float, float]) -> BoolArray:
    return np.asarray((values < limits[0]) | (values > limits[1]))


_MOST_ADU = 1e100


def expected_adu_map(rate_e_s_map: ArrayLike, exposure_s: float, em_gain: float, detector: Detector) -> FloatArray:
    """Return the mean ADU of every pixel, without noise and without rounding.

    Parameters
    ----------
    rate_e_s_map : array_like
        Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of any shape around the star.
    exposure_s : float
        Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
    em_gain : float
        Actual gain of the register, 1 to ``detector.em_gain_max``.
    detector : Detector
        The camera.

    Returns
    -------
    ndarray
        As `simulator.camera.VisibleCamera.expected_adu`. With every effect off ``rate t g / K + bias``.

    Raises
    ------
    InputError
        For a rate that is NaN, infinite or negative (naming the pixel), or another argument out of range.
    """
    camera = VisibleCamera(detector)
    return camera.expected_adu(camera.prepare(rate_e_s_map, exposure_s, em_gain))


def expose_frame(
    rate_map_e_s: ArrayLike,
    exposure_s: float,
    em_gain: float,
    detector: Detector,
    *,
    seed: int,
    path: Sequence[PathPart],
) -> Frame:
    """Return one noisy frame, without cosmic rays.

    Parameters
    ----------
    rate_map_e_s : array_like
        Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of any shape around the star.
    exposure_s, em_gain, detector
        As `expected_adu_map`.
    seed : int
        Seed of the run.
    path : sequence of str or int
        Names of target, role, band, realisation, frame. Each effect draws from a stream of its own.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), or
        another argument out of range.
    """
    camera = VisibleCamera(detector)
    return camera.expose(camera.prepare(rate_map_e_s, exposure_s, em_gain), seed=seed, path=path)


def to_electrons(adu: ArrayLike, detector: Detector, em_gain: float) -> FloatArray:
    """Return electrons at the register input: ``(adu - bias) gain_e_adu / em_gain``; dark and clock charge included.

    Raises
    ------
    InputError
        If ``em_gain`` is out of range, or a number is not finite.
    """
    gain = checked_scalar("em_gain", em_gain, low=1.0, high=detector.em_gain_max)
    level = checked_array("adu", adu, low=-_MOST_ADU, high=_MOST_ADU, unit="ADU", allowed="finite")
    return (level - detector.bias_adu) * (detector.gain_e_adu / gain)
