"""Hard limits of a pixel: its own full well, the register's, and the converter's range.

Saturation: the longest frame and the largest EM gain that keep the hole clean, and what a limit cuts off.

Hard limits hold inside the hole, and wherever a bloom column or a register tail enters it; the rest of the frame may
saturate (its own cap is known as well, for those who want none of it to).
"""

import math

import numpy as np

from cpic_core import ArrayLike, FloatArray, Outcome, Reason, Record, Status, checked_scalar
from simulator.config import AnyDetector

_NAMES = {Reason.PIXEL_FULL_WELL: "pixel full well", Reason.REGISTER_FULL_WELL: "register full well"}
_NAMES |= {Reason.ADC_RANGE: "range of the converter"}


def pixel_saturated(
    peak_e_per_frame: float, em_gain: float, detector: AnyDetector, n_sigma: float = 5.0
) -> Outcome[float]:
    """Return whether one pixel saturates at a given gain.

    Parameters
    ----------
    peak_e_per_frame : float
        Mean electrons of the pixel per frame, everything included, at least 0.
    em_gain : float
        Gain of the register, 1 to 1e4.
    detector : Detector or InfraredDetector
        Gives full wells and converter.
    n_sigma : float, optional
        Margin in standard deviations, 0 to 100: of a Poisson law in the pixel, of twice its variance behind the
        register, and of the read noise in the converter.

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction (0 to 1, margin included) of the nearest limit, or ``saturated`` with
        the limit that binds as reason.

    Raises
    ------
    InputError
        If an argument is negative, not finite or out of range.
    """
    # What is beyond every limit stays so, and finite.
    peak = min(checked_scalar("peak_e_per_frame", peak_e_per_frame, low=0.0, high=math.inf, unit="e-"), 1e300)
    gain = checked_scalar("em_gain", em_gain, low=1.0, high=1e4)
    margin = checked_scalar("n_sigma", n_sigma, low=0.0, high=100.0)
    output = gain * float(crest_e(peak, 2.0, margin))
    adc_e = (detector.adc_max_adu - detector.bias_adu) * detector.gain_e_adu - margin * detector.read_noise_e
    filled = {
        Reason.PIXEL_FULL_WELL: float(crest_e(peak, 1.0, margin)) / detector.full_well_e,
        Reason.REGISTER_FULL_WELL: output / detector.register_full_well_e,
        # A converter whose range is used up by bias and read noise alone is over-full whatever the charge.
        Reason.ADC_RANGE: output / adc_e if adc_e > 0 else math.inf,
    }
    worst = max(filled, key=lambda reason: filled[reason])
    if filled[worst] <= 1.0:
        return Outcome.ok(filled[worst])
    light = f"{peak_e_per_frame:.4g} e- per frame at EM gain {em_gain:.4g}"
    text = f"{light} fill {filled[worst]:.3g} times the {_NAMES[worst]} ({n_sigma:g} sigma included)"
    return Outcome.refuse(Status.SATURATED, worst, text)


N_SIGMA = 5.0


class Wells(Record, kw_only=True):
    """The limits of a camera; electrons at the register input unless said.

    Attributes
    ----------
    full_well_e : float
        Charge that a pixel holds.
    register_full_well_e, converter_e : float
        Charge at the register output that the register and the converter hold (the converter after five sigma of read
        noise); infinite where there is none.
    em_gain_max : float
        Largest EM gain, 1 without a register.
    blooms : bool
        Whether overfull pixels spill along columns and rows into the hole.
    """

    full_well_e: float
    register_full_well_e: float
    converter_e: float
    em_gain_max: float
    blooms: bool = True

    @property
    def output_well_e(self) -> float:
        """Charge at the output that register and converter hold."""
        return min(self.register_full_well_e, self.converter_e)


def crest_e(mean_e: ArrayLike, factor2: float, n_sigma: float = N_SIGMA) -> FloatArray:
    """Return the mean of counts plus a margin of so many of their standard deviations, ``q + n sqrt(F^2 q)``.

    Parameters
    ----------
    mean_e : array_like
        Electrons at the register input, at least 0.
    factor2 : float
        Variance over mean: 1 in a pixel, 2 at most behind the register.
    n_sigma : float
        Margin.
    """
    mean = np.asarray(mean_e, float)
    return np.asarray(mean + n_sigma * np.sqrt(factor2 * mean))


def largest_mean_e(level_e: float, factor2: float) -> float:
    """Return the mean whose `crest_e` is ``level_e``: 0 for a level below 0, infinite for an infinite one.

    Parameters
    ----------
    level_e : float
        Electrons that must not be passed.
    factor2 : float
        Variance over mean, as of `crest_e`.
    """
    half = N_SIGMA * math.sqrt(factor2) / 2.0
    return (math.sqrt(half * half + max(level_e, 0.0)) - half) ** 2 if math.isfinite(level_e) else math.inf


def overflow(mean_e: FloatArray | float, well_e: float, factor2: float) -> FloatArray:
    """Return what a limit cuts off, in standard deviations of the pixel or of its darkest neighbour.

    Parameters
    ----------
    mean_e : array_like
        Mean electrons of the pixel; below 0 counts as 0.
    well_e : float
        The limit, at the register input.
    factor2 : float
        Variance over mean of the counts, 1 to 2.

    Notes
    -----
    Counts of excess noise F^2 exceed a level q with the chance of a Gaussian beyond ``z = 2 (sqrt q - sqrt m) / F``
    (Poisson, and Poisson electrons multiplied by an exponential law, both to leading order in the exponent). Mean and
    second moment beyond it are ``phi - z Q`` and ``(1 + z^2) Q - z phi``; beyond the limit itself it is the excess.
    """
    mean = np.maximum(np.asarray(mean_e, dtype=np.float64), 0.0)
    z = 2.0 * (math.sqrt(well_e) - np.sqrt(mean)) / math.sqrt(factor2)
    density = np.exp(-0.5 * np.square(z)) / math.sqrt(2.0 * math.pi)
    # The chance beyond z is below phi / z; a limit that is reached for certain costs a standard deviation of the pixel.
    excess = np.where(z > 0.5, density * (1.0 + 1.0 / np.maximum(z, 0.5)), 1.0)
    # The overflow goes to neighbours, whose own noise can be as small as that of an empty pixel.
    contrast = np.sqrt(np.maximum(mean, 1.0))
    return np.where(z > 12.0, 0.0, np.where(z > 0.5, excess * contrast, excess + contrast))


def longest_exposure_s(
    column_peak_e_s: ArrayLike, hole_peak_e_s: ArrayLike, register_e_s: ArrayLike, camera: Wells, em_gain: float = 1.0
) -> FloatArray:
    """Return the exposure at which a hard limit is met at a gain.

    Parameters
    ----------
    column_peak_e_s : array_like
        Hottest pixel of the central star in the columns that cross the hole, e-/s: it must not overflow its well,
        because blooming charge runs along the column into the hole.
    hole_peak_e_s : array_like
        Hottest pixel inside the hole, e-/s: it must fit the register and the converter as well.
    register_e_s : array_like
        Light beside the hole that must fit the register, lest charge trails into the hole.
    camera : Wells
    em_gain : float

    Returns
    -------
    ndarray
        Seconds, without regard to ``exposure_max_s``; ``inf`` for dark pixels.
    """
    hole, tail = np.asarray(hole_peak_e_s, float), np.asarray(register_e_s, float)
    column = np.maximum(np.asarray(column_peak_e_s, float), hole) if camera.blooms else hole
    well = largest_mean_e(camera.full_well_e, 1.0)
    output = largest_mean_e(camera.output_well_e / em_gain, 2.0)
    register = largest_mean_e(camera.register_full_well_e / em_gain, 2.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        trail = tail if camera.blooms else np.zeros_like(tail)
        rates = ((well, column), (output, hole), (register, trail))
        limits = [np.where(rate > 0, level / rate, np.inf) for level, rate in rates]
    return np.minimum(np.minimum(limits[0], limits[1]), limits[2])


def largest_gain(hole_peak_e_s: ArrayLike, register_e_s: ArrayLike, exposure_s: ArrayLike, camera: Wells) -> FloatArray:
    """Return the largest EM gain that keeps the hole clean: its pixels unsaturated, no register tail running into it.

    Parameters
    ----------
    hole_peak_e_s, register_e_s, camera
        As of `longest_exposure_s`; the pixel's own well is its business.
    exposure_s : array_like
        Of a frame.

    Returns
    -------
    ndarray
        At most the camera's largest gain. Below 1 not even gain 1 will do.
    """
    exposure = np.asarray(exposure_s, float)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # nothing binds what is dark
        cap = np.fmin(camera.output_well_e / crest_e(np.multiply(hole_peak_e_s, exposure), 2.0), camera.em_gain_max)
        if camera.blooms:
            trail = crest_e(np.multiply(register_e_s, exposure), 2.0)
            cap = np.fmin(cap, camera.register_full_well_e / trail)
    return np.asarray(cap)


def gain_caps(
    hole_peak_e_s: float, register_e_s: float, frame_peak_e_s: float, exposure_s: float, camera: Wells
) -> dict[str, float]:
    """Return the largest gains of one exposure by what they spare; 0 where not even gain 1 does.

    Parameters
    ----------
    hole_peak_e_s, register_e_s, camera
        As of `longest_exposure_s`.
    frame_peak_e_s : float
        Hottest pixel of the central star anywhere, e-/s.
    exposure_s : float
        Of the frame.

    Returns
    -------
    dict of str to float
        ``hole``: the pixels inside the hole fit register and converter. ``register_tail``: no charge trails into the
        hole. ``frame``: no pixel of the whole frame saturates.
    """
    wells = {
        "hole": (hole_peak_e_s, camera.output_well_e),
        "register_tail": (register_e_s if camera.blooms else 0.0, camera.register_full_well_e),
        "frame": (frame_peak_e_s, camera.output_well_e),
    }
    caps = {}
    for name, (rate, well) in wells.items():
        crest = float(crest_e(rate * exposure_s, 2.0))
        cap = camera.em_gain_max if crest <= 0 else min(well / crest, camera.em_gain_max)
        overfull = rate * exposure_s > largest_mean_e(camera.full_well_e, 1.0)
        caps[name] = cap if cap >= 1.0 and not (overfull and name != "register_tail") else 0.0
    return caps


def frame_limit(
    column_peak_e_s: float, hole_peak_e_s: float, register_e_s: float, exposure_s: float, em_gain: float, camera: Wells
) -> Reason:
    """Return the limit that a frame breaks furthest, `Reason.NONE` if none.

    Parameters
    ----------
    column_peak_e_s, hole_peak_e_s, register_e_s, em_gain, camera
        As of `longest_exposure_s`.
    exposure_s : float
        Of the frame.
    """
    column = max(column_peak_e_s, hole_peak_e_s) if camera.blooms else hole_peak_e_s
    output = em_gain * float(crest_e(hole_peak_e_s * exposure_s, 2.0))
    tail = em_gain * float(crest_e(register_e_s * exposure_s, 2.0)) if camera.blooms else 0.0
    well = float(crest_e(column * exposure_s, 1.0))
    fills = {
        Reason.PIXEL_FULL_WELL: well / camera.full_well_e,
        Reason.REGISTER_FULL_WELL: max(output, tail) / camera.register_full_well_e,
        Reason.ADC_RANGE: output / camera.converter_e if camera.converter_e > 0 else math.inf,
    }
    worst = max(fills, key=lambda reason: fills[reason])
    return worst if fills[worst] > 1.0 + 1e-12 else Reason.NONE
