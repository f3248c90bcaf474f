import pytest

from cpic_core import Outcome, Reason, Status
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
