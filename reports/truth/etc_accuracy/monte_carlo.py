"""Stacks of frames drawn electron by electron: what the noise model of the ETC is held against.

Nothing here knows a formula of noise. Charge is Poisson in every pixel, the register is the exact cascade
(`simulator.camera.multiply`), read noise is added and the converter rounds at its output, pixels that the edge of the
aperture cuts count in part, the mean reference frame is subtracted, and then the mean of other apertures.

Two ways lead to the same sums. `frame_sums` draws every frame and every pixel. `stack_sums` uses what is exact: sums of
Poisson numbers are Poisson, electrons multiply independently of each other, and sums of normal numbers are normal, so
that frames, and pixels of one weight, are drawn together; rounding alone is taken as a uniform error of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.detectors.gain import multiply
from simulator.imaging import overlap_weights

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Readout:
    """What the camera adds to a pixel of one frame; read noise and converter at the register output."""

    read_noise_e: float = 110.0
    gain_e_adu: float = 59.0
    cic_e: float = 0.02
    stages: int = 604


@dataclass(frozen=True)
class Stack:
    """One observation; rates are sums over the aperture.

    ``background_e_s`` is everything but the planet and the clock-induced charge. ``speckle_e_s`` is the rms of what the
    difference of the two visits leaves in an aperture. A reference star has its own ``reference_background_e_s``, and
    its frames are multiplied with ``reference_scale``.
    """

    planet_e_s: float
    background_e_s: float
    exposure_s: float
    n_frames: int
    em_gain: float
    reference_ratio: float = 1.0
    speckle_e_s: float = 0.0
    loss_per_s: float = 0.0
    background_apertures: int = 30
    rdi_throughput: float = 1.0
    reference_background_e_s: float | None = None
    reference_scale: float = 1.0

    @property
    def signal_e(self) -> float:
        """Planet electrons in the stack."""
        return self.planet_e_s * self.exposure_s * self.n_frames

    @property
    def left_e_s(self) -> float:
        """What the projection leaves of the planet, which makes noise like so much light."""
        return self.planet_e_s * self.rdi_throughput

    @property
    def n_reference(self) -> int:
        """Frames of the reference library."""
        return round(self.reference_ratio * self.n_frames)


@dataclass(frozen=True, eq=False)
class Aperture:
    """A circle on pixels.

    Attributes
    ----------
    weights, light : ndarray, shape (n,)
        Part of each pixel inside the circle, and part of the planet's light in it; ``sum(weights * light)`` is 1.
    y, x : ndarray, shape (n,)
        Pixels.
    energy : float
        Sum of the planet's image inside the circle.
    """

    weights: FloatArray
    light: FloatArray
    y: NDArray[np.intp]
    x: NDArray[np.intp]
    energy: float

    @property
    def pixels(self) -> float:
        """Area."""
        return float(self.weights.sum())

    @property
    def noise_fraction(self) -> float:
        """``sum(w^2) / sum(w)``."""
        return float((self.weights**2).sum() / self.weights.sum())

    @property
    def source_noise_fraction(self) -> float:
        """``sum(w^2 light) / sum(w light)``."""
        return float((self.weights**2 * self.light).sum() / (self.weights * self.light).sum())

    def pooled(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Distinct weights, how many pixels have each, the planet's light in them, and which pixel has which."""
        values, index = np.unique(self.weights.round(12), return_inverse=True)
        member = (index == np.arange(values.size)[:, None]).astype(np.float64)
        return values, member.sum(axis=1), member @ self.light, member


def aperture_on(
    radius_pixels: float, image: FloatArray | None = None, *, offset_y: float = 0.0, offset_x: float = 0.0
) -> Aperture:
    """Aperture of that radius about a point beside the centre of a pixel (offsets -0.5 to 0.5).

    ``image`` is the planet's light on pixels of the same size, centre pixel ``n // 2``; an Airy disc of an aperture of
    0.7 lambda/D if omitted.
    """
    weights = overlap_weights(radius_pixels, offset_y, offset_x)
    light = _airy(len(weights), radius_pixels / 0.7, offset_y, offset_x) if image is None else _middle(image, weights)
    y, x = np.nonzero(weights > 0)
    inside, shares = weights[y, x], light[y, x]
    energy = float((inside * shares).sum())
    return Aperture(inside, shares / energy, y, x, energy)


def _airy(n: int, lambda_d_pixels: float, offset_y: float, offset_x: float, parts: int = 9) -> FloatArray:
    """Airy disc integrated over pixels."""
    from scipy.special import j1

    place = (np.arange(n * parts) + 0.5) / parts - n / 2
    radius = np.pi * np.hypot(place[:, None] - offset_y, place - offset_x) / lambda_d_pixels
    radius = np.maximum(radius, 1e-9)
    disc: FloatArray = (2.0 * j1(radius) / radius) ** 2
    return disc.reshape(n, parts, n, parts).mean(axis=(1, 3))


def _middle(image: FloatArray, weights: FloatArray) -> FloatArray:
    first = len(image) // 2 - len(weights) // 2
    return image[first : first + len(weights), first : first + len(weights)]


def stack_sums(
    stack: Stack,
    aperture: Aperture,
    readout: Readout,
    rng: np.random.Generator,
    trials: int,
    *,
    planet: bool = True,
    background: bool = True,
) -> FloatArray:
    """Aperture sums of the science stack above the reference, in electrons; shape ``(trials,)``.

    With ``background`` the mean of other apertures is subtracted, too.
    """
    total = _difference(stack, aperture, readout, rng, trials, 1, planet)
    if background:  # a sum over several apertures is one draw as well, of that many times the means
        around = stack.background_apertures
        total = total - _difference(stack, aperture, readout, rng, trials, around, False) / around
    return total / stack.rdi_throughput


def _visits(stack: Stack) -> tuple[tuple[float, int, float], ...]:
    """Factor in the difference, frames and background rate of science and reference."""
    other = stack.background_e_s if stack.reference_background_e_s is None else stack.reference_background_e_s
    return (1.0, stack.n_frames, stack.background_e_s), (-stack.reference_scale, stack.n_reference, other)


def _difference(
    stack: Stack, aperture: Aperture, readout: Readout, rng: np.random.Generator, trials: int, copies: int, planet: bool
) -> FloatArray:
    """Science less scaled reference, summed over as many apertures (``copies``, each with speckles of its own)."""
    weights, counts, light, member = aperture.pooled()
    clean = float(np.exp(-stack.loss_per_s * stack.exposure_s))
    speckles = _speckles(stack, aperture, rng, trials, copies) @ member.T
    total = np.zeros(trials)
    for factor, frames, background_e_s in _visits(stack):
        taken = copies * frames
        kept = rng.binomial(taken, clean, trials).astype(np.float64)
        mean = background_e_s * stack.exposure_s / aperture.pixels + readout.cic_e
        per_frame = mean * counts + (planet and factor > 0) * stack.left_e_s * stack.exposure_s * light
        # Half of the residual stands in each visit, so that their difference has all of it.
        expected = kept[:, None] * (per_frame + 0.5 / factor * speckles * stack.exposure_s / copies)
        if (expected < 0).mean() > 1e-3:
            raise ValueError("speckles deeper than the light that they modulate")
        charge = rng.poisson(np.maximum(expected, 0.0))
        electrons = multiply(charge, stack.em_gain, rng=rng, stages=readout.stages)
        scatter = np.sqrt(kept[:, None] * counts * (readout.read_noise_e**2 + readout.gain_e_adu**2 / 12.0))
        output = electrons + rng.standard_normal(electrons.shape) * scatter
        total += factor * (output @ weights) / stack.em_gain * (taken / kept) * (stack.n_frames / frames)
    return total


def _speckles(stack: Stack, aperture: Aperture, rng: np.random.Generator, trials: int, copies: int = 1) -> FloatArray:
    """Fields of speckles as wide as the planet's image, e-/s per pixel, shape ``(trials, n)``.

    Summed over ``copies`` independent apertures. Their aperture sums have the rms of the stack.
    """
    if stack.speckle_e_s == 0.0:
        return np.zeros((trials, aperture.weights.size))
    separation = np.hypot(aperture.y[:, None] - aperture.y, aperture.x[:, None] - aperture.x)
    width = 0.6 * np.sqrt(aperture.pixels / np.pi)  # of the field, in sigma of a Gaussian: a core of lambda/D
    covariance = np.exp(-0.5 * (separation / width) ** 2 / 2.0)
    size, vectors = np.linalg.eigh(covariance)
    field = rng.standard_normal((trials, size.size)) @ (vectors * np.sqrt(np.maximum(size, 0.0))).T
    rms = np.sqrt(aperture.weights @ covariance @ aperture.weights)
    return field * stack.speckle_e_s * np.sqrt(copies) / rms


def frame_sums(
    stack: Stack,
    aperture: Aperture,
    readout: Readout,
    rng: np.random.Generator,
    trials: int,
    *,
    planet: bool = True,
    background: bool = True,
) -> FloatArray:
    """`stack_sums` without a shortcut: pixel by pixel and frame by frame, rounded by the converter."""
    total = _frames_difference(stack, aperture, readout, rng, trials, planet)
    if background:
        for _ in range(stack.background_apertures):
            total -= _frames_difference(stack, aperture, readout, rng, trials, False) / stack.background_apertures
    return total / stack.rdi_throughput


def _frames_difference(
    stack: Stack, aperture: Aperture, readout: Readout, rng: np.random.Generator, trials: int, planet: bool
) -> FloatArray:
    speckles = _speckles(stack, aperture, rng, trials)
    hit = 1.0 - np.exp(-stack.loss_per_s * stack.exposure_s)
    total = np.zeros(trials)
    for factor, frames, background_e_s in _visits(stack):
        per_frame = background_e_s * stack.exposure_s / aperture.pixels + readout.cic_e
        expected = per_frame + (planet and factor > 0) * stack.left_e_s * stack.exposure_s * aperture.light
        expected = np.maximum(expected + 0.5 / factor * speckles * stack.exposure_s, 0.0)
        summed, kept = np.zeros(trials), np.zeros(trials)
        for _ in range(frames):
            output = multiply(rng.poisson(expected), stack.em_gain, rng=rng, stages=readout.stages)
            adu = np.rint((output + rng.normal(0.0, readout.read_noise_e, expected.shape)) / readout.gain_e_adu)
            good = rng.random(trials) >= hit
            summed += good * (adu @ aperture.weights) * readout.gain_e_adu / stack.em_gain
            kept += good
        total += factor * summed / kept * stack.n_frames
    return total


@dataclass(frozen=True)
class Recovered:
    """What the trials give.

    ``bias`` is the error of the mean signal in its standard errors, ``relative_error`` that of SNR and significance.
    """

    snr: float
    significance: float
    bias: float
    relative_error: float


def recover(
    stack: Stack, apertures: Sequence[Aperture], readout: Readout, rng: np.random.Generator, trials: int
) -> Recovered:
    """SNR and significance of ``trials`` observations.

    SNR is the signal over its own scatter. Significance is the signal over the scatter of apertures without a planet;
    that their mean is not known better than their number allows is the business of the threshold.

    The trials are spread over the apertures: the circle may lie anywhere on the pixels. Scatter is taken about the mean
    of each.
    """
    each = trials // len(apertures)
    there = np.stack([stack_sums(stack, aperture, readout, rng, each) for aperture in apertures])
    empty = np.stack(
        [stack_sums(stack, aperture, readout, rng, each, planet=False, background=False) for aperture in apertures]
    )
    scatter, quiet = (float(np.sqrt(part.var(axis=1, ddof=1).mean())) for part in (there, empty))
    bias = (float(there.mean()) - stack.signal_e) / (scatter / np.sqrt(there.size))
    return Recovered(stack.signal_e / scatter, stack.signal_e / quiet, bias, 1.0 / np.sqrt(2.0 * there.size))
