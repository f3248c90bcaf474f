"""What observations, calibration frames and plain numbers refuse, each in one line that names the setting."""

import numpy as np

from cpic_core import check_whole
from simulator import calibrate, observe, stream
from simulator.knobs import AlbedoFamily, dial_of

SCENE = {"name": "s", "cstar": {"name": "star", "v_mag": 5.0, "teff_k": 5800}}
FAMILY = AlbedoFamily(np.array([0.5, 4.0]), np.array([400.0, 800.0]), np.array([[0.1, 0.2], [0.5, 0.8]]), 1050.0)

READERS = {
    "calibrate": lambda settings: calibrate(**settings),
    "observe": lambda settings: observe(SCENE, **({"band": "F520", "exposure_s": 1.0} | settings)).frame(0),
    "dial": lambda settings: dial_of(**settings),
    "whole": lambda value: check_whole("n", value, 0, 5),
    "insolation": FAMILY.at,
    "seed": lambda seed: stream(seed, "a"),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
