"""Whole electrons: Poisson counts of means, drawn by the kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.camera.gain import pixel_keys
from simulator.detectors.effect import KERNELS, Exposure, FloatArray, Work
from simulator.lazy import load_kernels


def counted(mean_e: FloatArray, detector: Any, rng: np.random.Generator) -> FloatArray:
    """Return Poisson counts of a mean image; the mean itself where photon noise is switched off."""
    if not detector.switches.photon_noise:
        return mean_e
    counts = np.empty(mean_e.shape)
    zero = np.exp(-mean_e)
    load_kernels(KERNELS).draw_poisson(mean_e.reshape(-1), zero.reshape(-1), pixel_keys(rng), counts.reshape(-1))
    return counts


def made_whole(work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
    """Round mean charge to whole electrons, the mean kept: only they can be moved."""
    if not exposure.detector.switches.photon_noise:
        load_kernels(KERNELS).round_stochastic(work.image.reshape(-1), pixel_keys(rng))
