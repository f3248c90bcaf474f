"""What the register refuses, each in one line that names the setting."""

from cpic_core import stream
from simulator.camera import em_gain_of, em_voltage_of
from simulator.detectors.gain import multiply

READERS = {
    "stages": lambda stages: multiply([1], 2.0, rng=stream(1, "x"), stages=stages),
    "gain_of_voltage": lambda setting: em_gain_of(*setting),
    "voltage_of_gain": lambda em_gain: em_voltage_of(em_gain, 223.0),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
