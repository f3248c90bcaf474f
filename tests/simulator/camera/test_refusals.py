"""What the register refuses, each in one line that names the setting."""

from cpic_core import stream
from simulator.camera import em_voltage_of
from simulator.detectors.gain import multiply

READERS = {
    "stages": lambda stages: multiply([1], 2.0, rng=stream(1, "x"), stages=stages),
    "voltage_at_temperature": lambda temperature_k: em_voltage_of(44.0, temperature_k),
    "voltage_of_gain": lambda em_gain: em_voltage_of(em_gain, 223.0),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
