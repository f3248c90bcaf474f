"""Arguments that the camera refuses, and the one line that it refuses them with."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from refusal import Refusal

from simulator import camera
from simulator.config import load_instrument

NAN, INF = math.nan, math.inf
DETECTOR = load_instrument().detector
RNG = np.random.default_rng(0)


def adu(rate: Any, exposure_s: Any, em_gain: Any) -> Any:
    return camera.expected_adu_map(np.full((3, 3), rate), exposure_s, em_gain, DETECTOR)


REFUSALS = [
    *(
        Refusal(f"simulator.camera.{function.__name__}", function, given, says)
        for function in (camera.stage_probability, camera.gain_variance, camera.excess_noise_factor2)
        for given, says in (
            ((NAN, 604), "gain = nan: not accepted; allowed: 1 to 10000"),
            ((math.nextafter(1.0, 0.0), 604), "gain = 0.9999999999999999: not accepted; allowed: 1 to 10000"),
            ((1e4 + 1, 604), "gain = 10001.0: not accepted; allowed: 1 to 10000"),
            ((3.0, 1), "gain = 3.0: not accepted; allowed: 1 to 2"),
            (("2", 604), "gain = 2: not accepted; allowed: numbers, 1 to 10000"),
            ((2.0, 0), "stages = 0: not accepted; allowed: an integer of at least 1"),
            ((2.0, 1.5), "stages = 1.5: not accepted; allowed: an integer of at least 1"),
        )
    ),
    *(
        Refusal("simulator.camera.pixel_variance_e2", camera.pixel_variance_e2, (*given, DETECTOR), says)
        for given, says in (
            ((-1.0, 0.0, 1.0), "photon_e = -1.0 e-: not accepted; allowed: 0 to 1e+100"),
            ((1e308, 0.0, 1.0), "photon_e = 1e+308 e-: not accepted; allowed: 0 to 1e+100"),
            ((0.0, NAN, 1.0), "cic_e = nan e-: not accepted; allowed: 0 to 1e+100"),
        )
    ),
    *(
        Refusal(
            "simulator.camera.aperture_noise_pixels",
            camera.aperture_noise_pixels,
            (r,),
            f"radius_pixel = {r} px: not accepted; allowed: 1 to 1e+100",
        )
        for r in (0.5, NAN, INF, 1e200)
    ),
    *(
        Refusal("simulator.camera.gain_cap", camera.gain_cap, (q, DETECTOR, n), says)
        for q, n, says in (
            (-1.0, 5.0, "peak_e_per_frame = -1.0 e-: not accepted; allowed: finite and at least 0"),
            (NAN, 5.0, "peak_e_per_frame = nan e-: not accepted; allowed: finite and at least 0"),
            (1.0, 101.0, "n_sigma = 101.0: not accepted; allowed: 0 to 100"),
        )
    ),
    *(
        Refusal(
            f"simulator.camera.{function.__name__}",
            function,
            (1.0, 0.5, DETECTOR),
            "em_gain = 0.5: not accepted; allowed: 1 to 10000",
        )
        for function in (camera.binding_limit, camera.pixel_saturated)
    ),
    *(
        Refusal("simulator.camera.em_gain_of", camera.em_gain_of, given, says)
        for given, says in (
            ((19.0, 200.0), "voltage_v = 19.0 V: not accepted; allowed: 20 to 50"),
            ((40.0, INF), "temperature_k = inf K: not accepted; allowed: 120 to 320"),
        )
    ),
    *(
        Refusal("simulator.camera.em_voltage_of", camera.em_voltage_of, given, says)
        for given, says in (
            ((0.5, 200.0), "em_gain = 0.5: not accepted; allowed: 1 to 10000"),
            ((NAN, 200.0), "em_gain = nan: not accepted; allowed: 1 to 10000"),
        )
    ),
    *(
        Refusal("simulator.camera.to_electrons", camera.to_electrons, (a, DETECTOR, g), says)
        for a, g, says in (
            (NAN, 1.0, "adu = nan ADU: not accepted; allowed: finite"),
            (1e308, 1.0, "adu = 1e+308 ADU: not accepted; allowed: finite"),
            ("a", 1.0, "adu = a ADU: not accepted; allowed: numbers, finite"),
            (1.0, 0.0, "em_gain = 0.0: not accepted; allowed: 1 to 1000"),
        )
    ),
    *(
        Refusal("simulator.camera.expected_adu_map", adu, given, says)
        for given, says in (
            ((NAN, 1.0, 1.0), "rate_map_e_s[y=0, x=0] = nan e-/s: not accepted; allowed: finite and at least 0"),
            ((-1.0, 1.0, 1.0), "rate_map_e_s[y=0, x=0] = -1.0 e-/s: not accepted; allowed: finite and at least 0"),
            ((INF, 1.0, 1.0), "rate_map_e_s[y=0, x=0] = inf e-/s: not accepted; allowed: finite and at least 0"),
            ((1.0, 1e7, 1.0), "exposure_s = 10000000.0 s: not accepted; allowed: 0 to 1e+06"),
            ((1.0, 1.0, 1e5), "em_gain = 100000.0: not accepted; allowed: 1 to 1000"),
        )
    ),
    *(
        Refusal("simulator.camera.multiply", lambda e, g: camera.multiply(e, g, rng=RNG), given, says)
        for given, says in (
            (
                (np.array([-1]), 2.0),
                "electrons[0] = -1 e-: not accepted; allowed: whole electrons (integers), 0 to 1e+12",
            ),
            ((np.array([10**12 + 1]), 2.0), "electrons[0] = 1000000000001 e-: not accepted"),
            ((np.array([1.5]), 2.0), "electrons[0] = 1.5 e-: not accepted"),
            ((np.array([5]), NAN), "gain = nan: not accepted; allowed: 1 to 10000"),
        )
    ),
]
