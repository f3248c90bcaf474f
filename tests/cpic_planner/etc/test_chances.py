"""What is too faint to be detected, against the law itself."""

import numpy as np
import pytest

from cpic_planner.etc import LEAST_PROBABILITY, DetectionLaw, Programme, default_law, effective_visits, least_margin
from cpic_planner.etc.detection import detection_probability


def programme(visits, references):
    return Programme(visits=np.array(float(visits)), reference_visits=np.array(float(references)))


def laws():
    """The law of images, and some that nobody measured: wide or narrow, with tails that help or harm."""
    rng = np.random.default_rng(7)
    yield default_law()
    for _ in range(12):
        yield DetectionLaw(
            calibration=rng.uniform(0.5, 2.0),
            calibration_error=rng.uniform(0.0, 0.1),
            blind_margin=rng.uniform(0.3, 3.0),
            blind_width=rng.uniform(0.05, 0.6),
            blind_tails=rng.normal(),
            blind_inward=rng.normal(0.0, 5.0),
            blind_visits=rng.uniform(0.0, 1.0),
            stack_margin=rng.uniform(0.3, 3.0),
            stack_inward=rng.normal(0.0, 5.0),
            stack_width=rng.uniform(0.05, 0.6),
            blind_margin_error=rng.uniform(0.0, 0.1),
            known_margin=rng.uniform(0.3, 3.0),
            known_width=rng.uniform(0.05, 0.6),
            known_stack_width=rng.uniform(0.05, 0.6),
            known_margin_error=rng.uniform(0.0, 0.1),
        )


@pytest.mark.parametrize("most", [(1, 1), (4, 4), (40, 40), (1, 1000), (3, 1), (2, 6)])
@pytest.mark.parametrize("law", list(laws()))
def test_no_search_finds_what_lies_below_the_least_margin(law, most):
    """Any tails, place and independent wavefronts up to the visits, calibrations and middles within 6 s.e."""
    rng = np.random.default_rng(most)
    n = 100_000
    inward, tails = rng.uniform(0.03, 0.5, n), rng.choice([0.0, 0.5, 1.0], n)
    share = rng.uniform(0.0, 1.0, (2, n))
    share[1] = share[int(most[0] != most[1])]  # as many visits, equally far apart, remember each other as well
    wavefronts = effective_visits(*(np.array([most], float).T ** share))
    shift = rng.uniform(-6.0, 6.0, n)
    calibration = law.calibration + rng.uniform(-6.0, 6.0, n) * law.calibration_error
    least = least_margin(law, inward, programme(*most))
    settings = {"visits": wavefronts, "shift": shift, "calibration": np.maximum(calibration, 1e-3)}
    for place in (False, True):
        found = detection_probability(law, 0.999999 * least, place, tails, inward, **settings)
        assert found.max() < LEAST_PROBABILITY


def test_many_visits_find_near_the_star_what_lies_far_below_the_threshold():
    """Three elements from the star a stack of 20 visits finds 0.42 of the planets at a quarter of the threshold."""
    law = default_law()
    found = detection_probability(law, 0.25, False, 0.0, 0.3, visits=20.0)
    assert found == pytest.approx(0.42, abs=0.01)
    assert least_margin(law, 0.3, programme(20, 20)) < 0.06
    assert least_margin(law, 0.1, programme(1, 1)) > 0.12
