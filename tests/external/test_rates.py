"""Conventions of other calculators: which of ours explains which of theirs."""

import numpy as np
import pytest

from cpic_planner import CONVENTIONS, time_for_rates
from reports.external import comparison
from reports.external.comparisons.rates import STARK_SNR


@pytest.mark.parametrize("code", ["ayo", "ebs", "exosims"])
def test_no_other_convention_fits(code):
    """A convention that explains a code is the only one of ours that does."""
    cases = [case for case in comparison.recorded("rates")["stark"] if case["code"] == code]
    columns = ("planet", "background", "floor", "time_s")
    planet, background, floor, time_s = (np.array([case[name] for case in cases]) for name in columns)
    for convention in ({"planet_noise": a, "background_noise": b} for a in (0, 1) for b in (1, 2)):
        found = time_for_rates(planet, background, floor_rate=floor, snr=STARK_SNR, convention=convention).unwrap()
        fits = np.abs(found / time_s - 1.0).max() < 5e-3
        own = CONVENTIONS[code]
        assert fits == (convention == {"planet_noise": own.planet_noise, "background_noise": own.background_noise})
