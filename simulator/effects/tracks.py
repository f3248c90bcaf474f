"""The laws of tracks of cosmic rays: chord lengths, charge, width and texture.

Landau's lambda is the stable law of index 1 and skewness 1; the form of Chambers, Mallows & Stuck (1976, JASA 71, 340)
samples it exactly: with t uniform on (0, pi) and W exponential, ``lambda = -t cot t - ln(W sin t / t)``. Its tail
falls as ``1 / lambda^2``, so that the mean is that of a cut.
"""

import functools
import math
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from simulator.config import PaperTracks, PhysicalTracks

_BEYOND = 20.0


def cut_landau(n: int, cut: float, rng: np.random.Generator) -> FloatArray:
    """Draw ``n`` values of Landau's lambda, given that it is at most ``cut`` (at least 1)."""
    value = _landau(n, rng)
    (above,) = np.nonzero(value > cut)
    while above.size:
        value[above] = _landau(above.size, rng)
        above = above[value[above] > cut]
    return value


def _landau(n: int, rng: np.random.Generator) -> FloatArray:
    # 1 - [0, 1) leaves out 0, where t cot t is a limit; at t = pi the value is huge and cut off.
    t = np.pi * (1.0 - rng.random(n))
    sine = np.sin(t)
    return np.asarray(-t * np.cos(t) / sine - np.log(rng.standard_exponential(n) * sine / t))


@functools.lru_cache(maxsize=64)
def cut_landau_mean(cut: float) -> float:
    """Return the mean of Landau's lambda, given that it is at most ``cut`` (1 to 600).

    Integrating the sampling form over W leaves smooth functions of t alone:
    ``cut - integral(E1(w)) / integral(exp(-w))`` over 0 to pi, with ``w = exp(-t cot t - cut) t / sin t``.
    """
    from scipy.special import exp1

    # With t = pi s / (1 + s) both integrands fall from one value to 0 within a few units of s around the cut.
    nodes, weights = np.polynomial.legendre.leggauss(16)
    edges = np.linspace(0.0, cut + _BEYOND, math.ceil(cut + _BEYOND) + 1)
    half = 0.5 * np.diff(edges)[:, None]
    s = edges[:-1, None] + half * (1.0 + nodes)
    measure = half * weights / (1.0 + s) ** 2
    t = np.pi * s / (1.0 + s)
    w = np.exp(np.minimum(-t / np.tan(t) - cut + np.log(t / np.sin(t)), math.log(700.0)))
    return float(cut - np.sum(measure * exp1(w)) / np.sum(measure * np.exp(-w)))


REACH_SIGMA = 4.0  # a Gaussian holds all but 6e-5 of its charge within
_STEP_SIGMA, _SHORTEST_STEP = 1.0, 0.2  # points one sigma apart make a line smooth to 3e-9
_MAX_WIDTH_SIGMA = 3.0
_LEAST_WEIGHT = 0.05


@dataclass(frozen=True, eq=False)
class Tracks:
    """Shapes of tracks before they are placed; arrays of one length.

    Attributes
    ----------
    length_um, projected_um : ndarray
        Length in the layer and its projection on the detector.
    sigma_pixels : ndarray
        Gaussian sigma of the charge around every point.
    half_pixels : ndarray
        Farthest that a point lies from the middle.
    kind : ndarray of int
        Which template; 0 where there is none.
    """

    length_um: FloatArray
    projected_um: FloatArray
    sigma_pixels: FloatArray
    half_pixels: FloatArray
    kind: IntArray

    def __getitem__(self, chosen: BoolArray | slice) -> "Tracks":
        return replace(self, **{item.name: getattr(self, item.name)[chosen] for item in fields(self)})


@dataclass(frozen=True, eq=False)
class Points:
    """Points of tracks: ``start[i]`` to ``start[i + 1]`` are those of track i; offsets in pixels from its middle."""

    start: IntArray
    along: FloatArray
    across: FloatArray
    weight: FloatArray


class TrackModel(Protocol):
    """A model of cosmic-ray tracks on a detector of a given pixel size."""

    @property
    def reach_pixels(self) -> float:
        """Farthest from its middle that any track leaves charge."""

    def tracks(self, n: int, rng: np.random.Generator) -> Tracks:
        """Draw the shapes of ``n`` tracks."""

    def charges(self, tracks: Tracks, rng: np.random.Generator) -> IntArray:
        """Draw the charge of every track, whole electrons above 0.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """

    def point_counts(self, tracks: Tracks) -> IntArray:
        """Return the points that every track needs."""

    def points(self, tracks: Tracks, rng: np.random.Generator) -> Points:
        """Draw the points of every track.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """


def whole_electrons(charge_e: FloatArray) -> IntArray:
    """Return the nearest whole electrons, at least 1."""
    return np.maximum(np.rint(charge_e), 1.0).astype(np.int64)


def _chords(n: int, depth_um: float, max_length_um: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return the chords of an isotropic flux through a layer, and their projections on it.

    The flux through a plane goes as the cosine mu of the angle of incidence, so mu^2 = (d / L)^2 is uniform; chords
    beyond the longest are left out, which makes it uniform from (d / longest)^2 to 1.
    """
    least = (depth_um / max_length_um) ** 2
    mu2 = least + (1.0 - least) * (1.0 - rng.random(n))
    length = depth_um / np.sqrt(mu2)
    return length, length * np.sqrt(1.0 - mu2)


def _line_counts(tracks: Tracks, pixel_um: float) -> IntArray:
    step = np.maximum(_STEP_SIGMA * tracks.sigma_pixels, _SHORTEST_STEP)
    return np.maximum(np.ceil(tracks.projected_um / pixel_um / step), 1.0).astype(np.int64)


def _line(tracks: Tracks, pixel_um: float) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the starts, owners, fractions (-1/2 to 1/2) and offsets of points evenly along every track."""
    count = _line_counts(tracks, pixel_um)
    start = np.concatenate([[0], np.cumsum(count)])
    owner = np.repeat(np.arange(count.size), count)
    fraction = (np.arange(start[-1]) - start[owner] + 0.5) / count[owner] - 0.5
    return start, owner, fraction, fraction * (tracks.projected_um / pixel_um)[owner]


@dataclass(frozen=True)
class PhysicalModel:
    """Fast particles through a silicon layer; see `PhysicalTracks`.

    The charge of a chord L is ``L [m + w (lambda - <lambda>)]`` with lambda of Landau's law up to the cut: its mean is
    ``m L`` whatever the cut. The charge of the points along a track fluctuates by the same law.
    """

    config: PhysicalTracks
    pixel_um: float

    @property
    def reach_pixels(self) -> float:
        """Half the longest projection, and the reach of the diffusion."""
        longest = math.sqrt(self.config.max_length_um**2 - self.config.depth_um**2)
        return (0.5 * longest + REACH_SIGMA * self.config.diffusion_um) / self.pixel_um

    def tracks(self, n: int, rng: np.random.Generator) -> Tracks:
        """Return the chords with the diffusion of the layer."""
        length, projected = _chords(n, self.config.depth_um, self.config.max_length_um, rng)
        sigma = np.full(n, self.config.diffusion_um / self.pixel_um)
        return Tracks(length, projected, sigma, 0.5 * projected / self.pixel_um, np.zeros(n, dtype=np.int64))

    def charges(self, tracks: Tracks, rng: np.random.Generator) -> IntArray:
        """Return the charge of every chord.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        return whole_electrons(tracks.length_um * self._loss_e_um(tracks.length_um.size, rng))

    def _loss_e_um(self, n: int, rng: np.random.Generator) -> FloatArray:
        config = self.config
        excess = cut_landau(n, config.loss_cut, rng) - cut_landau_mean(config.loss_cut)
        return config.mean_loss_e_um + config.loss_width_e_um * excess

    def point_counts(self, tracks: Tracks) -> IntArray:
        """Return one point a sigma."""
        return _line_counts(tracks, self.pixel_um)

    def points(self, tracks: Tracks, rng: np.random.Generator) -> Points:
        """Return the points along every track, each with its own energy loss.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        start, _, _, along = _line(tracks, self.pixel_um)
        loss = self._loss_e_um(along.size, rng) / self.config.mean_loss_e_um
        return Points(start, along, np.zeros(along.size), np.maximum(loss, _LEAST_WEIGHT))


@dataclass(frozen=True)
class PaperModel:
    """Streaks of Zhu et al. 2025; see `PaperTracks`."""

    config: PaperTracks
    pixel_um: float

    @property
    def reach_pixels(self) -> float:
        """Half the longest projection, and the reach of the widest streak."""
        config = self.config
        longest = math.sqrt(config.max_length_um**2 - config.depth_um**2)
        widest = config.width_um * math.exp(_MAX_WIDTH_SIGMA * config.width_rms)
        return (0.5 * longest + REACH_SIGMA * widest) / self.pixel_um

    def tracks(self, n: int, rng: np.random.Generator) -> Tracks:
        """Return the chords, each with its own width: log-normal, cut off at three sigma."""
        config = self.config
        length, projected = _chords(n, config.depth_um, config.max_length_um, rng)
        scatter = np.clip(rng.standard_normal(n), -_MAX_WIDTH_SIGMA, _MAX_WIDTH_SIGMA)
        sigma = config.width_um / self.pixel_um * np.exp(config.width_rms * scatter)
        return Tracks(length, projected, sigma, 0.5 * projected / self.pixel_um, np.zeros(n, dtype=np.int64))

    def charges(self, tracks: Tracks, rng: np.random.Generator) -> IntArray:
        """Return the charge of every streak, whatever its length.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        return whole_electrons(paper_charges(tracks.length_um.size, self.config, rng))

    def point_counts(self, tracks: Tracks) -> IntArray:
        """Return one point a sigma."""
        return _line_counts(tracks, self.pixel_um)

    def points(self, tracks: Tracks, rng: np.random.Generator) -> Points:
        """Return the points along every streak, their weight varied by waves of random phase and never negative.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        config = self.config
        start, owner, fraction, along = _line(tracks, self.pixel_um)
        weight = np.ones(along.size)
        # Amplitudes fall as 1 / wave number; their squares add up to the variance asked for.
        number = np.arange(1, config.texture_waves + 1)
        amplitude = config.texture_rms * np.sqrt(2.0 / np.sum(1.0 / number**2)) / number
        for wave, size in zip(number, amplitude, strict=True):
            phase = rng.random(start.size - 1)
            weight += size * np.cos(2.0 * np.pi * (wave * fraction + phase[owner]))
        return Points(start, along, np.zeros(along.size), np.maximum(weight, _LEAST_WEIGHT))


def paper_charges(n: int, config: PaperTracks, rng: np.random.Generator) -> FloatArray:
    """Return charges (e-) from an exponential that becomes a power law, continuously, at ``tail_start`` e-foldings.

    The scale of the exponential follows from the mean in closed form.
    """
    knee, index = config.tail_start, config.tail_index
    at_knee = math.exp(-knee)
    body, tail = 1.0 - at_knee, at_knee * knee / (index - 1.0)
    mean = (1.0 - at_knee * (1.0 + knee) + at_knee * knee**2 / (index - 2.0)) / (body + tail)
    u = 1.0 - rng.random(n)  # the fraction of events above
    beyond = u * (body + tail) < tail
    exponential = -np.log(np.where(beyond, 1.0, u * (body + tail) - tail + at_knee))
    power = knee * np.power(np.where(beyond, u * (body + tail) / tail, 1.0), -1.0 / (index - 1.0))
    return np.asarray(config.mean_charge_e / mean * np.where(beyond, power, exponential))
