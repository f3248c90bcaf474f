"""Stacks whose photons are counted, drawn count by count: what the ETC's photon counting is held against.

How often a pixel with so many electrons passes the threshold is itself drawn, from the exact register and the read
noise. Frames are independent of each other, so that the counts of a pixel are binomial; the mean behind them is found
by inverting the same curve, pixel by pixel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from monte_carlo import Aperture, Readout, Recovered, Stack
from numpy.typing import NDArray
from regimes import RADIUS_PIXELS, camera_of, rates_of

from cpic_planner.etc import StackNoise, stack_noise
from cpic_planner.queries import Strategy
from simulator.detectors.gain import multiply

FloatArray = NDArray[np.float64]
DRAWS, LAST = 1_000_000, 16
EXPOSURE_S, FRAMES = 10.0, 3000
NO_BACKGROUND = 10**9  # apertures: the mean background has no error


class Curve:
    """Probability of a count against the mean electrons of a pixel, and its inverse."""

    def __init__(self, readout: Readout, em_gain: float, sigma: float, rng: np.random.Generator) -> None:
        threshold = sigma * readout.read_noise_e
        passed = []
        for electrons in range(LAST + 1):
            output = multiply(np.full(DRAWS, electrons), em_gain, rng=rng, stages=readout.stages)
            passed.append(np.mean(output + rng.normal(0.0, readout.read_noise_e, DRAWS) > threshold))
        self.passed = np.array(passed)
        self.means = np.linspace(0.0, 3.0, 3001)
        self.known = self(self.means)

    def __call__(self, mean_e: FloatArray) -> FloatArray:
        """Probability of a count."""
        n = np.arange(LAST + 1)
        log_factorial = np.concatenate([[0.0], np.cumsum(np.log(n[1:]))])
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = np.exp(np.where(n > 0, n * np.log(mean_e[..., None]), 0.0) - mean_e[..., None] - log_factorial)
        return np.asarray(weights @ self.passed)

    def mean_of(self, fraction: FloatArray) -> FloatArray:
        """Mean electrons behind a fraction of frames with a count; straight beyond the first two points."""
        slope = (self.known[1] - self.known[0]) / (self.means[1] - self.means[0])
        below = (fraction - self.known[0]) / slope
        return np.where(fraction < self.known[0], below, np.interp(fraction, self.known, self.means))


def counted_cases() -> Iterator[tuple[Stack, Readout, float]]:
    """Stacks from nearly dark to a third of an electron per pixel and frame, with the threshold in sigma."""
    readout = replace(Readout(), cic_e=0.003)
    area = np.pi * RADIUS_PIXELS**2
    for gain, sigma in ((300.0, 3.0), (1000.0, 5.0), (1000.0, 3.0)):
        for mean in (0.01, 0.1, 0.3):
            background = area * mean / EXPOSURE_S
            yield (
                Stack(0.3 * background, background, EXPOSURE_S, FRAMES, gain, background_apertures=NO_BACKGROUND),
                readout,
                sigma,
            )


def recover_counts(
    stack: Stack, places: Sequence[Aperture], readout: Readout, sigma: float, rng: np.random.Generator, trials: int
) -> Recovered:
    """SNR and significance of ``trials`` observations."""
    curve, each = Curve(readout, stack.em_gain, sigma, rng), trials // len(places)

    def sums(place: Aperture, frames: int, planet: bool) -> FloatArray:
        quiet = stack.background_e_s * stack.exposure_s / place.pixels + readout.cic_e
        mean = quiet + planet * stack.left_e_s * stack.exposure_s * place.light
        counts = rng.binomial(frames, curve(mean), (each, mean.size))
        return curve.mean_of(counts / frames) @ place.weights * stack.n_frames

    there, empty = (
        np.stack([sums(place, stack.n_frames, planet) - sums(place, stack.n_reference, False) for place in places])
        for planet in (True, False)
    )
    scatter, quiet = (float(np.sqrt(part.var(axis=1, ddof=1).mean())) for part in (there, empty))
    bias = (float(there.mean()) - stack.signal_e) / (scatter / np.sqrt(there.size))
    return Recovered(stack.signal_e / scatter, stack.signal_e / quiet, bias, 1.0 / np.sqrt(2.0 * there.size))


def predicted_counting(stack: Stack, places: Sequence[Aperture], readout: Readout, sigma: float) -> StackNoise:
    """What the ETC says."""
    return stack_noise(
        rates_of(stack, places),
        stack.exposure_s,
        stack.n_frames,
        stack.em_gain,
        camera_of(readout),
        Strategy(reference_ratio=stack.reference_ratio, mode="photon_counting", counting_sigma=sigma),
    )
