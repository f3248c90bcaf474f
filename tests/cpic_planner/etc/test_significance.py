import mpmath
import numpy as np
import pytest

from cpic_planner.validation import detection_threshold, threshold_array
from simulator.outcome import Reason, Status


@pytest.mark.parametrize(
    ("n", "expected"), [(6, 62), (13, 10.7), (19, 7.95), (25, 6.97), (38, 6.14), (63, 5.63), (94, 5.40)]
)
def test_table_for_five_sigma(n: int, expected: float) -> None:
    digits = 0 if n == 6 else 1 if n == 13 else 2
    assert round(detection_threshold(n).unwrap(), digits) == expected


@pytest.mark.parametrize(("n", "expected"), [(6, 7.3), (13, 4.0), (25, 3.4), (94, 3.1)])
def test_table_for_three_sigma(n: int, expected: float) -> None:
    assert round(detection_threshold(n, 3.0).unwrap(), 1) == expected


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


def test_array_form() -> None:
    out = threshold_array([[0, 2.5], [3, 19]], 5.0)
    assert np.isinf(out[0]).all()
    assert out[1, 1] == detection_threshold(19).unwrap()
    assert threshold_array(19, [3.0, 5.0]).shape == (2,)


def test_one_number_only(refused) -> None:
    refused("threshold_array", detection_threshold, [6, 13])
