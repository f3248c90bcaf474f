"""What photometry and thresholds refuse, each in one line."""

import pytest

from cpic_core import InputError
from cpic_planner.etc import threshold_array
from cpic_planner.etc.detection import detection_threshold
from cpic_planner.validation import contrast

MEASURED = {"flux": 80.0, "throughput": 0.8, "core": 0.25, "star_rate_e_s": 2e7, "time_s": 1000.0}


def elements(number):
    """Threshold of one number and of many refuse the same."""
    with pytest.raises(InputError, match="n_resolution_elements"):
        threshold_array(number)
    detection_threshold(number)


READERS = {
    "contrast": lambda change: contrast(**(MEASURED | change)),
    "elements": elements,
    "sigma": lambda sigma: detection_threshold(19, sigma),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
