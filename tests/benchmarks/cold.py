"""Run every compiled kernel once and print the seconds: ``NUMBA_CACHE_DIR=<empty folder> python cold.py``."""

from __future__ import annotations

import json
import time

import numpy as np

from simulator import load_instrument
from simulator.camera import InfraredCamera, VisibleCamera
from simulator.detectors.gain import multiply

LEVELS_E = (0.0, 2.0, 50.0, 5e3, 3e5)


def main() -> None:
    """Take a frame with every effect, whole and in a window, without photon noise, and one of the other camera."""
    import numba  # noqa: F401 (its own import is not compilation)

    config = load_instrument()
    seconds = {}
    began = time.perf_counter()
    for off in ((), ("photon_noise",)):
        detector = config.detector.switched(off=off, on=("register_clock_charge",))
        camera = VisibleCamera(detector, cosmic_rays=config.cosmic_rays, cosmic_ray_rate_per_s_cm2=1.0)
        for shape in ((detector.n_rows, detector.n_columns), (101, 101)):
            rates = np.resize(np.repeat(LEVELS_E, 7), shape)
            for gain in (1.0, 1.5, 20.0, 300.0):
                camera.expected_adu(exposure := camera.prepare(rates, 1.0, gain))
                camera.expose(exposure, seed=1, path=("cold", int(10 * gain)))
    seconds["visible camera, particles included"] = time.perf_counter() - began
    began = time.perf_counter()
    infrared = config.near_infrared.detector
    other = InfraredCamera(infrared, cosmic_rays=config.cosmic_rays, cosmic_ray_rate_per_s_cm2=1.0)
    rates = np.resize(np.repeat(LEVELS_E, 7), (infrared.n_rows, infrared.n_columns))
    other.expose(other.prepare(rates, 1.0), seed=1, path=("cold",))
    seconds["near-infrared camera"] = time.perf_counter() - began
    began = time.perf_counter()
    multiply(np.arange(2000), 20.0, rng=np.random.default_rng(1))
    seconds["multiply"] = time.perf_counter() - began
    print(json.dumps(seconds))


if __name__ == "__main__":
    main()
