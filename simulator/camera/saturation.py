"""Hard limits of a pixel: its own full well, the register's, and the converter's range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.config.detector import Detector
from simulator.outcome import Outcome, Reason, Status
from simulator.quantities import checked_array
from simulator.signal.saturation import crest_e

FloatArray = npt.NDArray[np.float64]

_LIMITS = np.array([Reason.PIXEL_FULL_WELL.value, Reason.REGISTER_FULL_WELL.value, Reason.ADC_RANGE.value])
_NAMES = {
    Reason.PIXEL_FULL_WELL.value: "pixel full well",
    Reason.REGISTER_FULL_WELL.value: "register full well",
    Reason.ADC_RANGE.value: "range of the converter",
}


@dataclass(frozen=True, eq=False)
class GainCap:
    """Largest usable EM gain.

    Attributes
    ----------
    gain : ndarray
        Largest gain, 1 to ``em_gain_max``; 0 where not even gain 1 is free of saturation.
    limit : ndarray of str
        Reason code of the limit that binds; ``""`` where it is ``em_gain_max`` alone.
    feasible : ndarray of bool
        Where there is a usable gain at all.
    """

    gain: FloatArray
    limit: npt.NDArray[np.str_]
    feasible: npt.NDArray[np.bool_]

    def outcome(self, index: tuple[int, ...] | int = ()) -> Outcome[float]:
        """Typed answer of one element."""
        if self.feasible[index]:
            limit = str(self.limit[index])
            return Outcome.ok(float(self.gain[index]), flags=(f"limited_by_{limit}",) if limit else ())
        reason = Reason(str(self.limit[index]))
        return Outcome.refuse(
            Status.SATURATED,
            reason,
            f"the {_NAMES[reason.value]} is exceeded even at EM gain 1; shorten the exposure",
        )


def gain_cap(peak_e_per_frame: npt.ArrayLike, detector: Detector, n_sigma: float = 5.0) -> GainCap:
    """Largest EM gain at which the hottest pixel stays ``n_sigma`` below every limit.

    Parameters
    ----------
    peak_e_per_frame : array_like
        Mean electrons of the hottest usable pixel per frame, everything included, at least 0.
    detector : Detector
        Gives full wells, converter and largest gain.
    n_sigma : float, optional
        Margin in standard deviations, 0 to 100.

    Returns
    -------
    GainCap
        ``min(em_gain_max, FW_register / q, ADC / q)`` with ``q = pk + n sqrt(2 pk)`` (the register's output
        has at most twice the Poisson variance) and ``ADC = (2^bits - 1 - bias) K - n read_noise``; nothing
        where ``pk + n sqrt(pk)`` exceeds the pixel full well or the cap is below 1.

    Raises
    ------
    InputError
        If an argument is negative, not finite or out of range.
    """
    fill = _fills(peak_e_per_frame, 1.0, detector, n_sigma)
    pixel, output = fill[0], fill[1:]
    worst = output.max(axis=0)
    with np.errstate(divide="ignore", over="ignore"):
        ceiling = 1.0 / worst
    limit = _LIMITS[1 + output.argmax(axis=0)]
    feasible = (pixel <= 1.0) & (ceiling >= 1.0)
    gain = np.where(feasible, np.minimum(ceiling, detector.em_gain_max), 0.0)
    limit = np.where(pixel > 1.0, _LIMITS[0], np.where(ceiling > detector.em_gain_max, "", limit))
    return GainCap(np.asarray(gain), np.asarray(limit), np.asarray(feasible))


def binding_limit(
    peak_e_per_frame: npt.ArrayLike, em_gain: npt.ArrayLike, detector: Detector, n_sigma: float = 5.0
) -> npt.NDArray[np.str_]:
    """Reason code of the limit that a pixel exceeds furthest at a given gain, ``""`` where it exceeds none.

    Parameters, margins and errors as `gain_cap`; ``em_gain`` (1 to 1e4) broadcasts against the peaks.
    """
    fill = _fills(peak_e_per_frame, em_gain, detector, n_sigma)
    return np.asarray(np.where(fill.max(axis=0) > 1.0, _LIMITS[fill.argmax(axis=0)], ""))


def pixel_saturated(
    peak_e_per_frame: float, em_gain: float, detector: Detector, n_sigma: float = 5.0
) -> Outcome[float]:
    """Whether one pixel saturates at a given gain.

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction (0 to 1, margin included) of the nearest limit, or ``saturated`` with
        the limit that binds as reason. Margins and errors as `gain_cap`.
    """
    fill = _fills(peak_e_per_frame, em_gain, detector, n_sigma)
    if fill.ndim != 1:
        raise InputError("peak_e_per_frame", np.asarray(peak_e_per_frame).shape, allowed="one number")
    worst = int(fill.argmax())
    if fill[worst] <= 1.0:
        return Outcome.ok(float(fill[worst]))
    reason = Reason(str(_LIMITS[worst]))
    return Outcome.refuse(
        Status.SATURATED,
        reason,
        f"{peak_e_per_frame:.4g} e- per frame at EM gain {em_gain:.4g} fill {fill[worst]:.3g} times "
        f"the {_NAMES[reason.value]} ({n_sigma:g} sigma included)",
    )


def _fills(peak_e: npt.ArrayLike, em_gain: npt.ArrayLike, detector: Detector, n_sigma: float) -> FloatArray:
    """Filled fractions of pixel, register and converter (first axis), noise margin included."""
    # What is beyond every limit stays so, and finite.
    peak = np.minimum(checked_array("peak_e_per_frame", peak_e, low=0.0, unit="e-"), 1e300)
    gain = checked_array("em_gain", em_gain, low=1.0, high=1e4)
    margin = float(checked_array("n_sigma", n_sigma, low=0.0, high=100.0))
    output = gain * crest_e(peak, 2.0, margin)
    adc_e = (detector.adc_max_adu - detector.bias_adu) * detector.gain_e_adu - margin * detector.read_noise_e
    pixel = crest_e(peak, 1.0, margin) / detector.full_well_e
    # A converter whose range is used up by bias and read noise alone is over-full whatever the charge.
    adc = output / adc_e if adc_e > 0 else np.full(output.shape, np.inf)
    return np.stack(np.broadcast_arrays(pixel, output / detector.register_full_well_e, adc)).astype(np.float64)
