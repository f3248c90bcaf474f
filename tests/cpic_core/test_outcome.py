import numpy as np
import pytest

from cpic_core import Outcome, Outcomes, Reason, Status
from cpic_core.outcome import NotOk


def test_value_exists_exactly_when_ok():
    good = Outcome.ok(3.0, unit="s", flags=("clamped",))
    assert good.unwrap() == 3.0
    bad = Outcome.refuse(Status.UNREACHABLE, Reason.SPECKLE_FLOOR, "floor at 4")
    assert bad.value is None
    with pytest.raises(NotOk, match="unreachable: speckle_floor: floor at 4"):
        bad.unwrap()
    with pytest.raises(ValueError, match="value exactly"):
        Outcome(None)
    with pytest.raises(ValueError, match="value exactly"):
        Outcome(1.0, Status.SATURATED, Reason.ADC_RANGE)
    with pytest.raises(ValueError, match="reason exactly"):
        Outcome(None, Status.SATURATED)


def test_map_keeps_refusals():
    refused: Outcome[float] = Outcome.refuse(Status.SATURATED, Reason.ADC_RANGE, "full")
    assert refused.map(lambda value: value * 2).reason is Reason.ADC_RANGE
    assert Outcome.ok(2.0).map(lambda value: value * 2).unwrap() == 4.0


def test_json_form_is_plain():
    assert Outcome.ok(1.5, unit="s").to_dict() == {
        "value": 1.5,
        "unit": "s",
        "status": "ok",
        "reason": "",
        "message": "",
        "flags": [],
    }


def test_an_array_of_answers_names_what_has_none():
    value = np.array([[1.0, 2.0], [3.0, 4.0]])
    dark, late = np.array([[0, 1], [0, 0]], bool), np.array([[0, 1], [1, 0]], bool)
    why = {Reason.NO_LIGHT: "it is dark", Reason.NO_TIME: "it is late"}
    refused = {Reason.NO_LIGHT: (Status.INVALID, dark), Reason.NO_TIME: (Status.UNREACHABLE, late)}
    answers = Outcomes.of(value, refused, why, "s")
    assert answers.shape == (2, 2)
    assert answers[1, 1] == Outcome.ok(4.0, unit="s")
    assert answers[0, 1] == Outcome.refuse(Status.INVALID, Reason.NO_LIGHT, "it is dark", unit="s")
    assert answers[1, 0] == Outcome.refuse(Status.UNREACHABLE, Reason.NO_TIME, "it is late", unit="s")
    np.testing.assert_array_equal(answers.value, [[1.0, np.nan], [np.nan, 4.0]])
    with pytest.raises(NotOk, match=r"element \[0, 1\]: invalid: no_planet_light: it is dark"):
        answers.unwrap()
    nothing = {reason: (status, np.zeros(2, bool)) for reason, (status, _) in refused.items()}
    np.testing.assert_array_equal(Outcomes.of(value[0], nothing, why).unwrap(), value[0])
    assert Outcomes.of(np.array(5.0), {Reason.NO_TIME: (Status.UNREACHABLE, np.array(False))}, why) == Outcome.ok(5.0)
