"""One-call functions of the visible camera (noiseless map, noisy frame, electrons) and of its gain and voltage."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, Outcome, PathPart, checked_array, checked_scalar
from simulator.camera.calibration_set import bias_level_adu
from simulator.camera.frame import Frame
from simulator.camera.visible import VisibleCamera
from simulator.config import AnyDetector, Detector
from simulator.detectors import GAIN_LIMIT

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
