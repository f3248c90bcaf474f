"""Cosmic rays out of a sequence of frames, pixel by pixel in time.

A pixel is compared with itself in the other frames of its sequence. At high gain and low flux its law has an
exponential tail, so that no number of sigma fits all levels: the limit comes from the exact law (`PixelLaw`) and holds
at every gain and level.

Limits of what a pixel without a cosmic ray shows come from the exact law of the camera. One pixel of one frame holds a
Poisson number of electrons of mean ``lambda``, multiplied by the register and read with Gaussian noise. In electrons at
the register input its cumulant function is exactly ``lambda m(s) + sigma^2 s^2 / 2``, where ``1 + m(s)`` is the mean of
``exp(s output / gain)`` of one electron: the generating function of the register (`simulator.detectors.gain`) at real
arguments. Markov's inequality ``P(X > T) <= exp(lambda m(s) + sigma^2 s^2 / 2 - s T)`` (Chernoff 1952) then bounds the
tail for every ``s``, at any gain and level: no normal law and no exponential one is assumed.
"""

import functools
import math

import numpy as np

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    Record,
    check_mask,
    described,
    numeric_context,
    require,
)
from simulator.detectors import generating_function, stage_probability

# Slopes s of the bound in 1/e-: any set is valid, a dense one is sharp. Noise of 1e4 e- needs 5e-4.
_SLOPES = np.geomspace(1e-5, 30.0, 1500)
_LARGEST_GROWTH = 1e9
_DEPTHS = np.geomspace(1e-6, 1e4, 3000)
_PLACES = 256


FALSE_ALARM = 1e-6
MOST_E = 1e100
# The wavefront walks within a visit: speckles change by up to this fraction and more where they are faint.
DRIFT = 0.1
_MOST_PASSES = 20


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
        Electrons at the register input of frames of one exposure and gain .
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
    data, good = checked_stack(frames, usable)
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


def checked_stack(frames: ArrayLike, usable: ArrayLike) -> tuple[FloatArray, BoolArray]:
    """Return frames as float64 and their usable pixels; refused by name if they are none of one shape, or not finite.

    Parameters
    ----------
    frames : array_like, shape (n_frames, y, x)
    usable : array_like of bool, same shape
    """
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
