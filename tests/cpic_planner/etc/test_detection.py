"""Small-sample thresholds, verdicts, and the visits behind a mean."""

import mpmath
import numpy as np
import pytest

from cpic_core import Reason, Status
from cpic_planner.etc import effective_visits, threshold_array, verdict_of
from cpic_planner.etc.detection import detection_threshold


def test_verdict_of_every_status():
    for status in Status:
        for detected in (True, False):
            expected = ("detected" if detected else "measured_not_detected") if status is Status.OK else "unreachable"
            assert verdict_of(status, detected) == expected


@pytest.mark.parametrize(("visits", "references"), [(1, 1), (3, 3), (16, 16), (4, 12), (1, 1000), (2, 1)])
def test_effective_visits_have_the_kurtosis_of_the_difference_of_means(visits, references):
    """Of exponential variates: the fourth cumulant of one is 6, its variance 1; of n Laplace variates 3/n is left."""
    cumulants = [1.0 / visits**k + 1.0 / references**k for k in (1, 3)]
    excess = 6.0 * cumulants[1] / cumulants[0] ** 2
    assert float(effective_visits(visits, references)) == pytest.approx(3.0 / excess, rel=1e-12)
    rng = np.random.default_rng(visits)
    science, library = (rng.standard_gamma(n, 200_000) / n for n in (visits, references))
    left = science - library
    left -= left.mean()
    drawn = (left**4).mean() / (left**2).mean() ** 2 - 3.0
    assert drawn == pytest.approx(excess, rel=0.15, abs=0.05)


@pytest.mark.parametrize(
    ("n", "expected"), [(6, 62), (13, 10.7), (19, 7.95), (25, 6.97), (38, 6.14), (63, 5.63), (94, 5.40)]
)
def test_table_for_five_sigma(n: int, expected: float) -> None:
    digits = 0 if n == 6 else 1 if n == 13 else 2
    assert round(detection_threshold(n).unwrap(), digits) == expected


@pytest.mark.parametrize("n", [3, 3.5, 4, 13, 52, 1002])
@pytest.mark.parametrize("sigma", [1.0, 5.0, 12.0, 20.0])
def test_false_alarm_probability_is_that_of_the_normal_law(n: float, sigma: float) -> None:
    threshold = detection_threshold(n, sigma).unwrap()
    with mpmath.workdps(40):
        t = mpmath.mpf(threshold) / mpmath.sqrt(1 + 1 / (mpmath.mpf(n) - 1))
        df = mpmath.mpf(n) - 2
        tail = mpmath.betainc(df / 2, mpmath.mpf(1) / 2, 0, df / (df + t * t), regularized=True) / 2
        normal = mpmath.erfc(sigma / mpmath.sqrt(2)) / 2
        assert float(tail / normal) == pytest.approx(1, rel=1e-9)


def test_many_elements_give_the_gaussian_threshold() -> None:
    assert detection_threshold(1e9).unwrap() == pytest.approx(5.0, rel=1e-7)
    thresholds = threshold_array(np.geomspace(3, 1e6, 200))
    assert (np.diff(thresholds) < 0).all()


def test_false_alarms_of_simulated_noise() -> None:
    n, trials = 7, 400_000
    values = np.random.default_rng(3).standard_normal((trials, n))
    rest = values[:, 1:]
    ratio = (values[:, 0] - rest.mean(axis=1)) / rest.std(axis=1, ddof=1)
    expected = 0.0013498980316300933  # one-sided 3 sigma
    found = np.mean(ratio > detection_threshold(n, 3.0).unwrap())
    assert abs(found - expected) < 4 * np.sqrt(expected / trials)


@pytest.mark.parametrize("n", [0, 1, 2, 2.999])
def test_too_few_elements_are_an_answer(n: float) -> None:
    outcome = detection_threshold(n)
    assert outcome.status is Status.UNREACHABLE
    assert outcome.reason is Reason.TOO_FEW_ELEMENTS
    assert outcome.value is None


def test_five_sigma_unless_said() -> None:
    assert threshold_array(19.0) == threshold_array(19.0, 5.0) != threshold_array(19.0, 4.9)


def test_array_form() -> None:
    out = threshold_array([[0, 2.5], [3, 19]], 5.0)
    assert np.isinf(out[0]).all()
    assert out[1, 1] == detection_threshold(19).unwrap()
    assert threshold_array(19, [3.0, 5.0]).shape == (2,)


def test_one_number_only(refused) -> None:
    refused("threshold_array", detection_threshold, [6, 13])
