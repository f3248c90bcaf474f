"""Photon counting: a pixel above a threshold holds a photon, one below holds none.

The threshold removes read noise and the excess noise of the register, and loses pixels whose electron was multiplied
too little and every photon after the first in a pixel (Basden, Haniff & Mackay 2003, MNRAS 345, 985; Nemati 2020,
Proc. SPIE 11443). Here the probability of a count is that of the exact law of the register, not of an exponential.
"""

import functools
import math

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, NDArray, Record, checked_array, checked_scalar, special
from cpic_planner.etc.model import FrameCamera
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.etc.searches import CaseArrays
from cpic_planner.queries import Strategy
from simulator.detectors import GAIN_LIMIT, generating_function, stage_probability

MAX_MEAN_E = 8.0
"""Mean electrons per pixel and frame up to which counts are inverted; one pixel in 3000 is then still dark."""
MAX_THRESHOLD_SIGMA = 20.0
# A Poisson law of mean 8 has 3e-13 of its weight beyond 40.
_N_MAX = 40
# One of mean 0.5 has 2e-17 beyond 14.
_N_FAINT, _FAINT_E = 14, 0.5
# Inversion of a Laplace transform by the trapezoidal rule: folding from above is damped to exp(-28) = 7e-13, or to what
# rounding (exp(-37)), amplified by the damping, leaves; the Gaussian reaches 10.5 sigma below 0, where 4e-26 is left.
_DAMPING, _ROUNDING = 28.0, 37.0
_BELOW_SIGMA = 10.5
_CUTOFF_SIGMA = 9.0  # of the Gaussian in the transformed variable: exp(-40)
# The probabilities are good to 1e-8; slopes of their differences below this are not known well enough.
_LEAST_SLOPE = 1e-7
_N_MEANS = 500  # where the line touches is of no weight


class CountingLaw(Record, eq=False):
    """Probability that a pixel counts, for a register, a read noise and a threshold.

    Attributes
    ----------
    em_gain : float
        Gain of the register.
    read_noise_e : float
        Rms at the register output, electrons.
    threshold_e : float
        Threshold at the register output, electrons.
    e : ndarray, shape (n_max + 1,)
        Probability of a count from 0 to ``n_max`` electrons at the register input; ``e[0]`` is that of a false count
        from read noise alone. Never decreases.
    """

    em_gain: float
    read_noise_e: float
    threshold_e: float
    e: FloatArray

    def q(self, mean_e: ArrayLike) -> FloatArray:
        """Return the probability of a count from Poisson electrons.

        Parameters
        ----------
        mean_e : array_like
            Mean electrons per pixel and frame at the register input, from whatever source (photons, dark current,
            clock-induced charge before the register), 0 to `MAX_MEAN_E`.

        Returns
        -------
        ndarray
            ``sum over n of Pois(n; mean) e_n``, 0 to 1.

        Raises
        ------
        InputError
            If a mean is out of range or not finite.
        """
        mean = checked_array("mean_e", mean_e, low=0.0, high=MAX_MEAN_E, unit="e-")
        return 1.0 - _poisson_mean(1.0 - self.e, mean)

    def electrons(self, share: ArrayLike, about: ArrayLike) -> FloatArray:
        """Return the electrons per frame that counts tell, to first order in their scatter.

        Parameters
        ----------
        share : array_like
            Frames that count over all of them.
        about : array_like
            The same of many pixels or frames of nearly the same light, 0 to 1: the inverse of `q` is the straight line
            that touches it there, so that a share of few frames, 1 say, has no infinite light.
        """
        means = MAX_MEAN_E * np.linspace(0.0, 1.0, _N_MEANS) ** 3
        level = np.interp(np.asarray(about, float), self.q(means), means)
        slope = np.maximum(_poisson_mean(np.diff(self.e), level), _LEAST_SLOPE)
        return np.asarray(level + (np.asarray(share, float) - self.q(level)) / slope)

    def usable(self, mean_e: ArrayLike) -> NDArray[np.bool_]:
        """Return whether counts tell the mean: it is at most `MAX_MEAN_E`, and a count's probability follows it.

        Parameters
        ----------
        mean_e : array_like
            Mean electrons per pixel and frame, at least 0.
        """
        mean = checked_array("mean_e", mean_e, low=0.0, unit="e-")
        return (mean <= MAX_MEAN_E) & (_poisson_mean(np.diff(self.e), np.minimum(mean, MAX_MEAN_E)) > _LEAST_SLOPE)


def counting_law(em_gain: float, stages: int, read_noise_e: float, threshold_e: float) -> CountingLaw:
    """Return the probabilities of counts; the last 64 laws are kept.

    Parameters
    ----------
    em_gain : float
        Gain of the register, 1 to 1e4 and at most ``2**stages``.
    stages : int
        Stages of the register, at least 1.
    read_noise_e : float
        Rms at the register output (with the rounding of the converter, if it counts), 0 to 1e5 electrons.
    threshold_e : float
        Threshold at the register output, 0 to 20 times ``read_noise_e``, electrons: without read noise it is 0, and one
        electron is enough to pass it.

    Returns
    -------
    CountingLaw
        ``e_n = P(output of n electrons + N(0, read_noise^2) > threshold)``, at any gain exact to 1e-11
        up to 5 sigma and to 1e-8 up to 20, in 2 ms.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.

    Notes
    -----
    With ``phi(z)`` the generating function of the register's output for one electron, the probability to stay below
    the threshold ``y`` is the inverse Laplace transform

        ``P(n; y) = 1/(2 pi i) integral of exp(s y) phi(exp(-s))^n exp(s^2 sigma^2 / 2) / s ds``, ``Re s > 0``.

    The Gaussian ends the integral after some thirty nodes of the trapezoidal rule, whatever gain and read noise; the
    sum of Poisson makes its error known: the law at ``y`` plus whole periods, damped (Abate & Whitt 1992, Queueing
    Systems 10, 5).
    """
    read_noise = checked_scalar("read_noise_e", read_noise_e, low=0.0, high=1e5, unit="e-")
    threshold = checked_scalar("threshold_e", threshold_e, low=0.0, high=np.inf, unit="e-")
    if threshold > MAX_THRESHOLD_SIGMA * read_noise * (1.0 + 1e-12):
        allowed = f"at most {MAX_THRESHOLD_SIGMA:g} times read_noise_e = {read_noise:g}"
        raise InputError("threshold_e", threshold_e, unit="e-", allowed=allowed)
    gain = checked_scalar("em_gain", em_gain, low=1.0, high=GAIN_LIMIT)
    return _law(gain, stages, read_noise, threshold)


def counting_variance(mean_e: ArrayLike, law: CountingLaw) -> FloatArray:
    """Return the variance of the mean that counts give, per pixel and frame.

    Parameters
    ----------
    mean_e : array_like
        Mean electrons per pixel and frame at the register input, finite and at least 0.
    law : CountingLaw

    Returns
    -------
    ndarray
        ``q (1 - q) / (dq/dmean)^2`` in electrons^2: ``N`` frames divide it by ``N``. It is the variance of the estimate
        that inverts ``q`` exactly, by the delta method: to first order in the scatter of the counts of the stack, which
        must know the mean to well below one electron. ``inf`` where counts do not tell the mean
        (`CountingLaw.usable`); never NaN.

    Raises
    ------
    InputError
        If a mean is negative or not finite.

    Notes
    -----
    A perfect register without read noise gives ``exp(mean) - 1``, which is above the Poisson variance ``mean`` by the
    photons that fall into a pixel that counts already.
    """
    mean = checked_array("mean_e", mean_e, low=0.0, unit="e-")
    near = np.minimum(mean, MAX_MEAN_E)
    # Both from their own sums: a rare count would be lost in 1 - (1 - q).
    counts, dark = _poisson_mean(law.e, near), _poisson_mean(1.0 - law.e, near)
    slope = _poisson_mean(np.diff(law.e), near)
    variance = counts * dark / np.maximum(slope, _LEAST_SLOPE) ** 2
    return np.asarray(np.where((mean <= MAX_MEAN_E) & (slope > _LEAST_SLOPE), variance, np.inf))


class CountingLight(CaseArrays, Record):
    """Light per pixel in the aperture and how often it enters the variance.

    ``planet_e_s`` and ``quiet_e_s``, everything else, count in ``science_pixels``; ``quiet_e_s`` alone in
    ``mean_pixels`` (of the mean background); ``reference_e_s``, what a reference frame really holds, in
    ``reference_pixels``. ``quiet_e`` and ``reference_e`` are in every frame, whatever its exposure: smear and
    clock-induced charge. The planet's light is spread evenly over the aperture. Without ``own_noise`` it adds none, but
    may still be too much to be counted: the variance is then infinite.
    """

    planet_e_s: FloatArray
    quiet_e_s: FloatArray
    reference_e_s: FloatArray
    quiet_e: FloatArray
    reference_e: FloatArray
    science_pixels: FloatArray
    mean_pixels: FloatArray
    reference_pixels: FloatArray
    law: CountingLaw
    own_noise: bool

    def frame_variance(self, exposure_s: FloatArray) -> FloatArray:
        """Return the variance of one science frame's aperture sum with its share of reference frames."""
        quiet = self.quiet_e_s * exposure_s + self.quiet_e
        both = quiet + self.planet_e_s * exposure_s
        reference = self.reference_e_s * exposure_s + self.reference_e
        science = counted(self.science_pixels, both, self.law)
        if not self.own_noise:
            science = np.where(np.isfinite(science), counted(self.science_pixels, quiet, self.law), np.inf)
        mean = counted(self.mean_pixels, quiet, self.law)
        return science + mean + counted(self.reference_pixels, reference, self.law)


def counted(pixels: FloatArray, mean_e: FloatArray, law: CountingLaw) -> FloatArray:
    """Return the variance of a sum over pixels; 0 over none, however bright they are.

    Parameters
    ----------
    pixels : ndarray
        How many pixels.
    mean_e : ndarray
        Mean electrons of each.
    law : CountingLaw
    """
    with np.errstate(invalid="ignore"):
        return np.where(pixels > 0, pixels * counting_variance(mean_e, law), 0.0)


@functools.lru_cache(maxsize=64)
def _law(em_gain: float, stages: int, read_noise_e: float, threshold_e: float) -> CountingLaw:

    p = float(stage_probability(em_gain, stages))
    n = np.arange(_N_MAX + 1)
    if read_noise_e == 0.0:
        passed = np.where(n > 0, 1.0, 0.0)
    else:
        # Everything in units of the read noise: the nodes then depend on the threshold alone.
        level = threshold_e / read_noise_e
        period = level + _BELOW_SIGMA
        damping = min(_DAMPING, _ROUNDING / (1.0 + level / period))
        step, shift = 2.0 * math.pi / period, damping / period
        s = shift + 1j * step * np.arange(math.ceil(_CUTOFF_SIGMA / step) + 1)
        weight = step / math.pi * np.exp(s * level + 0.5 * s**2) / s
        weight[0] *= 0.5
        phi = generating_function(np.exp(-s / read_noise_e), p, stages)
        passed = 1.0 - (weight * phi ** n[:, None]).sum(axis=1).real
        passed[0] = special().ndtr(-level)
        # Rounding must not make a law that falls or leaves its range.
        passed = np.maximum.accumulate(np.clip(passed, 0.0, 1.0))
    passed.flags.writeable = False
    return CountingLaw(em_gain, read_noise_e, threshold_e, passed)


def _poisson_mean(values: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the mean of ``values[n]`` over a Poisson law (Horner's scheme), less terms of 1e-16, one by one."""
    faint = mean <= _FAINT_E
    if faint.all():
        return _horner(values[: _N_FAINT + 1], mean)
    total = _horner(values, mean)
    total[faint] = _horner(values[: _N_FAINT + 1], mean[faint])
    return total


def _horner(values: FloatArray, mean: FloatArray) -> FloatArray:
    total = np.full(mean.shape, values[-1])
    for n in range(values.size - 1, 0, -1):
        total *= mean / n
        total += values[n - 1]
    return np.asarray(np.exp(-mean) * total)


def counting_probabilities(camera: FrameCamera, em_gain: float, strategy: Strategy) -> CountingLaw:
    """Return the probabilities of counts at the threshold of a strategy."""
    noise_e = camera.amplifier_e
    return counting_law(em_gain, camera.register_stages, noise_e, strategy.counting_sigma * noise_e)


def reference_pixel(scaled: FloatArray, rates: ApertureRates) -> FloatArray:
    """Return what a pixel of a reference frame holds of some light before it is scaled to the science frames."""
    scale = np.asarray(rates.reference_scale, float)
    return np.where(scale > 0, scaled / np.where(scale > 0, scale, 1.0) / rates.aperture_pixels, 0.0)


def counted_terms(
    rates: ApertureRates,
    exposure_s: FloatArray,
    stack: FloatArray,
    law: CountingLaw,
    camera: FrameCamera,
    reference_ratio: FloatArray,
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return the terms of white noise where photons are counted, and what the planet's light adds to them."""
    pixels = stack * rates.noise_fraction * rates.aperture_pixels
    own = camera.charge_e + camera.rate_e_s * exposure_s
    quiet = (rates.background_e_s * exposure_s + rates.smear_e) / rates.aperture_pixels + own
    held = rates.reference_light_e_s * exposure_s + rates.reference_smear_e
    reference = reference_pixel(held, rates) + own
    alone = counted(pixels, quiet, law)
    both = counted(pixels, quiet + rates.planet_e_s / rates.aperture_pixels * exposure_s, law)
    with np.errstate(invalid="ignore"):
        planet = np.where(np.isfinite(alone), both - alone, 0.0)
    scale = rates.reference_scale / reference_ratio
    return {"counting": alone, "reference": counted(pixels * scale, reference, law)}, planet
