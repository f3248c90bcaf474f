"""Seeded calibration set of the near-infrared camera."""

from __future__ import annotations

import functools

import numpy as np

from simulator.camera.calibration_set import CalibrationSet
from simulator.camera.flaws import chosen_places, excess_map, flaw_mask, response_map, scatter_map
from simulator.config.infrared import InfraredDetector
from simulator.rng import stream

__all__ = ["load_infrared_set"]


@functools.lru_cache(maxsize=2)
def load_infrared_set(detector: InfraredDetector) -> CalibrationSet:
    """Calibration set of the near-infrared camera: every pixel sees light, there are no columns of flaws.

    Clock-induced charge, stripes and bad columns of the set are 0. Each flaw draws from its own stream.
    """
    shape, flaws = detector.shape, detector.flaws
    rngs = {
        flaw: stream(flaws.seed, "calibration", "infrared", flaw)
        for flaw in ("response", "dead", "dark", "hot", "hot_excess")
    }
    sensitivity = response_map(shape, flaws.prnu_rms, rngs["response"])
    dead = chosen_places(shape, flaws.dead_fraction, rngs["dead"])
    hot = chosen_places(shape, flaws.hot_fraction, rngs["hot"])
    smooth = detector.dark_e_s * scatter_map(shape, flaws.dsnu_rms, rngs["dark"])
    dark = smooth + detector.dark_e_s * excess_map(hot, flaws.hot_factor, rngs["hot_excess"])
    whole = (slice(0, shape[0]), slice(0, shape[1]))
    return CalibrationSet(
        response=np.where(dead, 0.0, sensitivity),
        dark_e_s=dark,
        dark_uniform_e_s=np.full(shape, detector.dark_e_s),
        cic_e=np.zeros(shape),
        stripe_adu=np.zeros(shape[1]),
        bias_adu=None,
        mask=flaw_mask(dead, dark, whole),
        sensitivity=sensitivity,
        dark_smooth_e_s=smooth,
        dead=dead,
        hot=hot,
        bad_column=np.zeros(shape, dtype=np.bool_),
        bias_level_adu=detector.bias_adu,
    )
