"""One frame of a camera for the exposure-time calculator: what it adds, holds and costs, and its best gain.

A frame has the variance ``F^2(g) A + B / g^2``, so that the best gain depends on ``u = B / A`` and on the largest gain
alone. ``F^2`` rises from 1 to a broad top (1.98 near gain 300 of 604 stages) and falls a little beyond it, so there can
be two minima: one where reading is beaten, one at the largest gain.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from cpic_core import FloatArray, IntArray, NDArray
from simulator.config import Instrument
from simulator.detectors import FrameTerm, added_variance, frame_variance_e2, noise_factor2
from simulator.signal import Wells

_N_RATIOS, _N_GAINS, _N_PARTS = 3000, 300, 30
_STEP = 1e-4
_BISECTIONS = 45


@dataclass(frozen=True, kw_only=True)
class FrameCamera(Wells):
    """Noise, limits and times of one frame; electrons at the register input unless said.

    Attributes
    ----------
    full_well_e, register_full_well_e, converter_e, em_gain_max, blooms
        As of `simulator.signal.saturation.Wells`.
    register_stages : int
        Stages of the register, 0 without one: then ``F^2`` is 1.
    read_noise_e, rounding_e : float
        Rms of read noise and of the converter's rounding, per pixel and frame, at the register output.
    light_factor : float
        Variance over mean of the light in a frame: 1, or what a fitted ramp makes of it.
    cic_e : float
        Clock-induced electrons per pixel and frame.
    dark_e_s : float
        Dark current per pixel.
    line_shift_s : float
        Time that a line of the frame stands in the light of each other during the transfer; 0 without smear.
    readout_s, exposure_min_s, exposure_max_s : float
        Dead time after a frame, shortest and longest exposure.
    added : tuple of (str, FrameTerm)
        Variance of a pixel and frame that further effects of the detector add, by term of the budget of noise.
    """

    register_stages: int
    read_noise_e: float
    rounding_e: float
    cic_e: float
    dark_e_s: float
    readout_s: float
    exposure_min_s: float
    exposure_max_s: float
    light_factor: float = 1.0
    line_shift_s: float = 0.0
    added: tuple[tuple[str, FrameTerm], ...] = ()

    @functools.cached_property
    def _rest(self) -> FrameTerm:
        return FrameTerm.total([FrameTerm(), *(term for _, term in self.added)])

    @property
    def read_variance_e2(self) -> float:
        """Variance of a pixel and frame at the register output: read noise, rounding and what other effects add."""
        return self.read_noise_e**2 + self.rounding_e**2 + float(self._rest.output_e2)

    @property
    def charge_e(self) -> float:
        """Electrons of a pixel and frame that come without light, before the register: clock-induced and other."""
        return self.cic_e + float(self._rest.charge_e)

    @property
    def rate_e_s(self) -> float:
        """Electrons of a pixel that come with time besides light and dark current."""
        return float(self._rest.rate_e_s)

    @property
    def of_past(self) -> float:
        """Electrons that come back for each that the frames before collected, all of the same light."""
        return self._rest.of_past

    @property
    def amplifier_e(self) -> float:
        """Rms of read noise and of what else comes behind the register but the rounding, at the register output."""
        return math.hypot(self.read_noise_e, math.sqrt(float(self._rest.output_e2)))

    @classmethod
    def of(cls, instrument: Instrument, band: str) -> Self:
        """Return the camera of a band; effects that are switched off count nothing.

        Parameters
        ----------
        instrument : Instrument
        band : str
            Name of a band of the instrument, such as ``F520``.
        """
        channel = instrument.channel_of(band)
        detector, terms = channel.detector, added_variance(channel.detector)
        read, rounding, cic, dark = (terms.pop(name, FrameTerm()) for name in ("read_noise", "rounding", "cic", "dark"))
        rest = FrameTerm.total([FrameTerm(), *terms.values()])
        one_read_e = detector.read_noise_e if detector.switches.read_noise else 0.0
        swing_e = math.hypot(one_read_e, math.sqrt(float(rest.output_e2)))
        same = ("full_well_e", "register_full_well_e", "readout_s", "exposure_min_s", "line_shift_s")
        return cls(
            **{name: getattr(detector, name) for name in same},
            converter_e=max(detector.converter_e - 5.0 * swing_e, 0.0),
            em_gain_max=detector.em_gain_max if detector.multiplies else 1.0,
            register_stages=detector.register_stages if detector.multiplies else 0,
            read_noise_e=math.sqrt(float(read.output_e2)),
            rounding_e=math.sqrt(float(rounding.output_e2)),
            cic_e=float(cic.charge_e),
            dark_e_s=float(dark.rate_e_s),
            exposure_max_s=channel.exposure_max_s,
            light_factor=detector.ramp()[1],
            blooms=channel.multiplies,
            added=tuple(terms.items()),
        )


@dataclass(frozen=True, eq=False)
class GainTable:
    """Logarithms of the best gains for logarithms of ``B / A``.

    ``near`` is the first minimum of the variance, ``far`` the largest gain where that has less, else ``near``;
    ``two_minima`` says where they differ there or at the next point. The logarithms are evenly spaced.
    """

    log_ratio: FloatArray
    near: FloatArray
    far: FloatArray
    two_minima: NDArray[np.bool_]
    stages: int


@functools.lru_cache(maxsize=16)
def gain_table(gain_max: float, stages: int) -> GainTable:
    """Return a table of the best gains of a register.

    Parameters
    ----------
    gain_max : float
        Largest gain, above 1.
    stages : int
        Of the register.
    """
    log_ratio = np.linspace(np.log(0.1), np.log(1e8), _N_RATIOS)
    ratio, top = np.exp(log_ratio), np.log(gain_max)

    def variance(log_gain: FloatArray) -> FloatArray:
        result: FloatArray = noise_factor2(np.exp(log_gain), stages) + ratio * np.exp(-2.0 * log_gain)
        return result

    def rises(log_gain: FloatArray) -> NDArray[np.bool_]:
        return variance(log_gain + _STEP) > variance(log_gain - _STEP)

    grid = np.linspace(0.0, top, _N_GAINS)
    factor2, falls = noise_factor2(np.exp(grid), stages)[:, None], np.exp(-2.0 * grid)[:, None]

    def first_rise(some: FloatArray) -> IntArray:
        rising = np.diff(factor2 + some * falls, axis=0) > 0
        return np.where(rising.any(axis=0), rising.argmax(axis=0), _N_GAINS - 1)

    # First minimum: where the variance first rises, the largest gain where it never does; parts fit the cache.
    k = np.concatenate([first_rise(some) for some in np.array_split(ratio, _N_PARTS)])
    low, high = grid[np.maximum(k - 1, 0)], grid[np.minimum(k + 1, _N_GAINS - 1)]
    first = np.where(k == 0, 0.0, np.where(k == _N_GAINS - 1, top, _switch(rises, low, high)))
    far = np.where(variance(np.full(_N_RATIOS, top)) < variance(first), top, first)
    two = far > first
    return GainTable(log_ratio, first, far, two | np.append(two[1:], False), stages)


def _switch(true: Callable[[FloatArray], NDArray[np.bool_]], low: FloatArray, high: FloatArray) -> FloatArray:
    """Return where a condition that holds from some point on becomes true: bisection, ``low`` if it holds at once."""
    at_low = true(low)
    a, b = low.copy(), high.copy()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (a + b)
        yes = true(middle)
        a, b = np.where(yes, a, middle), np.where(yes, middle, b)
    return np.where(at_low, low, b)


def best_gain(
    light_variance_e2: FloatArray, read_variance_e2: FloatArray, gain_cap: FloatArray, gain_max: float, stages: int
) -> tuple[FloatArray, FloatArray]:
    """Return the gain of least variance up to a cap, and that variance.

    Parameters
    ----------
    light_variance_e2 : ndarray
        ``A``: variance of a frame that the register multiplies, at ``F^2 = 1``.
    read_variance_e2 : ndarray
        ``B``: variance added at the output.
    gain_cap : ndarray
        Largest gain that saturates nothing; below 1 there is none, and gain 1 is returned for the caller to refuse.
    gain_max : float
        Largest gain of the register.
    stages : int
        Stages of the register; 0 for none.

    Returns
    -------
    gain, variance : ndarray
        Exact but for the table between its points.
    """
    if stages == 0 or gain_max <= 1.0:
        return np.ones(np.broadcast(light_variance_e2, gain_cap).shape), light_variance_e2 + read_variance_e2
    table = gain_table(gain_max, stages)
    with np.errstate(divide="ignore"):
        first, last = table.log_ratio[0], table.log_ratio[-1]
        where = np.fmin(np.fmax(np.log(read_variance_e2) - np.log(light_variance_e2), first), last)
    # The logarithms are evenly spaced.
    steps = (where - first) * ((_N_RATIOS - 1) / (last - first))
    below = np.minimum(steps.astype(np.intp), _N_RATIOS - 2)
    above = steps - below
    cap = np.maximum(gain_cap, 1.0)

    def of_table(logs: FloatArray) -> FloatArray:
        low = logs[below]
        return np.asarray(np.minimum(np.exp(low + above * (logs[below + 1] - low)), cap))

    gain = of_table(table.near)
    variance = frame_variance_e2(light_variance_e2, noise_factor2(gain, stages), read_variance_e2, gain)
    if not table.two_minima[below].any():
        return gain, variance
    other = of_table(table.far)
    if np.any(other > gain):
        there = frame_variance_e2(light_variance_e2, noise_factor2(other, stages), read_variance_e2, other)
        better = there < variance
        gain, variance = np.where(better, other, gain), np.where(better, there, variance)
    return gain, variance
