"""Random scenes: what is left out changes no quantity by more than its tolerance."""

import numpy as np
import pytest

from simulator.ledger import error_of


@pytest.mark.parametrize(
    "number", [1001, 1002, *(pytest.param(number, marks=pytest.mark.long) for number in (1003, 1004, 1005, 1006))]
)
def test_shortcut_stays_within_its_tolerance(number, report):
    """Half a dozen; the report has hundreds."""
    case = report.scenes.random_case(number)
    whole, short, true = report.truth.measure(case)
    for name in case.quantity:
        assert getattr(true, name) <= case.tolerance, (name, short.choice.switches, short.psf.knobs)
        assert short.choice.predicted_error[name] <= case.tolerance * (1 + 1e-9)
    assert whole.choice is None
    assert short.tolerance == case.tolerance


def test_overlap_of_a_circle(report):
    weights = report.truth.circle((31, 31), 15.2, 14.7, 3.3)
    assert weights.sum() == pytest.approx(np.pi * 3.3**2, rel=2e-3)
    assert error_of("planet_flux", 0.25) == 0.25
