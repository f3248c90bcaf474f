"""What thresholds refuse, each in one line."""

import pytest

from cpic_core import InputError
from cpic_planner.etc import threshold_array
from cpic_planner.etc.detection import detection_threshold


def elements(number):
    """Threshold of one number and of many refuse the same."""
    with pytest.raises(InputError, match="n_resolution_elements"):
        threshold_array(number)
    detection_threshold(number)


READERS = {"elements": elements, "sigma": lambda sigma: detection_threshold(19, sigma)}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
