"""From rates to signal-to-noise: one noise model for every question."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.rates import ApertureRates
from simulator.camera.gain import excess_noise_factor2
from simulator.camera.noise import pixel_variance_e2
from simulator.config.detector import Detector

__all__ = ["StackNoise", "best_gain", "frame_terms", "stack_noise"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class StackNoise:
    """Signal and noise of a summed stack, in input-referred electrons.

    ``snr`` = S / sqrt(Var S) with the source's own noise; ``significance`` = S / sigma without the planet.
    """

    signal_e: FloatArray
    source_variance_e2: FloatArray
    background_variance_e2: FloatArray
    detector_variance_e2: FloatArray
    speckle_variance_e2: FloatArray
    snr: FloatArray
    significance: FloatArray


def frame_terms(
    rates: ApertureRates, exposure_s: ArrayLike, detector: Detector, *, reference_ratio: float
) -> tuple[FloatArray, FloatArray, float]:
    """Signal, light variance at F^2 = 1 and read variance at gain 1 of one frame's aperture sum.

    Returns
    -------
    signal_e : ndarray
        Planet electrons per frame, after RDI throughput correction the unbiased signal.
    light_variance_e2 : ndarray
        Variance of planet, background and CIC before the excess noise factor.
    read_variance_e2 : float
        Read-noise and quantisation variance at gain 1.

    Notes
    -----
    Everything but the planet itself is measured twice, in science and in reference frames: factor ``1 + N/M``.
    A sum over a circle has the variance of ``sum(w^2)`` pixels, fewer than its area.
    """
    exposure = np.asarray(exposure_s, float)
    twice = (1.0 + 1.0 / reference_ratio) * rates.noise_fraction
    signal = rates.planet_e_s * exposure
    quiet = twice * (rates.background_e_s * exposure + detector.cic_e * rates.aperture_pixels)
    read = twice * rates.aperture_pixels * float(pixel_variance_e2(0.0, 0.0, 1.0, detector))
    return signal, rates.source_noise_fraction * signal + quiet, read


def stack_noise(
    rates: ApertureRates,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    detector: Detector,
    *,
    reference_ratio: float = 1.0,
) -> StackNoise:
    """Signal and noise of ``n_frames`` frames.

    ``Var = F^2(g) [S + (1 + N/M) (B + a0 cic)] + (1 + N/M) a0 (RN^2 + K^2/12) / g^2``, summed over frames, with the
    weights of cut pixels squared, plus the speckle residual ``(N t sigma_spk)^2`` that does not average. White noise
    is divided by the RDI throughput; ``snr`` adds the error of the mean background.
    """
    exposure, frames, gain = (np.asarray(item, float) for item in (exposure_s, n_frames, em_gain))
    signal, light, read = frame_terms(rates, exposure, detector, reference_ratio=reference_ratio)
    factor2 = excess_noise_factor2(gain, detector.register_stages)
    throughput2 = rates.rdi_throughput**2
    own = rates.source_noise_fraction * signal
    source = frames * factor2 * own / throughput2
    background = frames * factor2 * (light - own) / throughput2
    electronic = frames * read / gain**2 / throughput2
    speckle = (frames * exposure * rates.speckle_e_s) ** 2
    total_signal = frames * signal
    quiet = background + electronic + speckle
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.sqrt(source + quiet * (1.0 + 1.0 / rates.background_apertures))
        snr = np.where(total_signal > 0, total_signal / error, 0.0)
        significance = np.where(total_signal > 0, total_signal / np.sqrt(quiet), 0.0)
    return StackNoise(total_signal, source, background, electronic, speckle, snr, significance)


def best_gain(light_variance_e2: ArrayLike, read_variance_e2: float, gain_cap: ArrayLike) -> FloatArray:
    """EM gain of least variance, ``clip(2 B / A, 1, cap)``.

    Minimises ``F^2(g) A + B / g^2`` with ``F^2 ~ 2 - 1/g``; within 0.2 % of the true minimum of the variance.
    """
    light = np.maximum(np.asarray(light_variance_e2, float), 1e-300)
    cap = np.maximum(np.asarray(gain_cap, float), 1.0)
    return np.clip(2.0 * read_variance_e2 / light, 1.0, cap)
