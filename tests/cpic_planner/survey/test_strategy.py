"""Strategies: what is refused, and what they say of it."""

import pytest

from catalogs.errors import InputError
from cpic_planner.survey.strategy import SurveyStrategy
from simulator.config.base import validate

FAULTS = [
    ({"time_budget_h": 0}, "time_budget_h = 0"),
    ({"time_budget_h": "much"}, "time_budget_h = much"),
    ({"time_budget_h": True}, "time_budget_h = True"),
    ({"slot_share": 1.5}, "slot_share = 1.5"),
    ({"name": ""}, "name"),
    ({"name": "x" * 121}, "name"),
    ({"visit": {"bands": []}}, "visit.bands"),
    ({"visit": {"time_s": []}}, "visit.time_s"),
    ({"visit": {"time_s": -1}}, "visit.time_s"),
    ({"visit": {"goal": "snr"}}, "visit.snr = None"),
    ({"visit": {"snr": 5}}, "visit.snr = 5"),
    ({"visit": {"goal": "win"}}, "visit.goal = win"),
    ({"visit": {"em_gain": 0.5}}, "visit.em_gain = 0.5"),
    ({"revisits": {"max_visits": 0}}, "revisits.max_visits = 0"),
    ({"revisits": {"roll": "up"}}, "revisits.roll = up"),
    ({"detection": {"visits_needed": 2}}, "revisits.max_visits = 1"),
    ({"detection": {"rule": "guess"}}, "detection.rule = guess"),
    ({"detection": {"blind_width": 0}}, "detection.blind_width = 0"),
    ({"reduction": {"sigma": 3}}, "reduction.sigma = 3"),
    ({"reduction": {"mode": "photon_counting"}}, "reduction.mode = photon_counting"),
    ({"reduction": {"library": "reference_star"}}, "reduction.reference_star"),
    ({"assumptions": {"contrast": -1e-9}}, "assumptions.contrast"),
    ({"assumptions": {"contrast": float("nan")}}, "assumptions.contrast"),
    ({"assumptions": {"throughput": 0}}, "assumptions.throughput = 0"),
    ({"stop": {"after_empty": 0}}, "stop.after_empty = 0"),
    ({"scheduler": {"method": "luck"}}, "scheduler.method = luck"),
    ({"scheduler": {"look_ahead": 9}}, "scheduler.look_ahead = 9"),
    ({"population": "unicorns"}, "population = unicorns"),
    ({"targets": {"max_targets": 0}}, "targets.max_targets = 0"),
    ({"targets": {"v_mag": 4}}, "targets.v_mag"),
    ({"weather": "fine"}, "weather = fine"),
]


@pytest.mark.parametrize(("tree", "text"), FAULTS, ids=[text for _, text in FAULTS])
def test_one_clear_line(tree, text):
    with pytest.raises(InputError) as fault:
        validate(SurveyStrategy, {"name": "x"} | tree, where="strategy")
    assert str(fault.value).startswith("strategy.")
    assert text in str(fault.value)
    assert "\n" not in str(fault.value)


def test_single_values_stand_for_lists():
    one = SurveyStrategy(
        name="x", visit={"bands": "F662", "time_s": 100}, targets={"names": "tau Cet"}, follow_up={"bands": "F850"}
    )
    assert one.visit.bands == ("F662",)
    assert one.visit.time_s == (100.0,)
    assert one.targets.names == ("tau Cet",)
    assert one.follow_up.wanted
    assert not SurveyStrategy(name="x").follow_up.wanted


def test_the_level_of_the_detection_is_that_of_the_reduction():
    with pytest.raises(InputError, match=r"give detection.sigma"):
        validate(SurveyStrategy, {"name": "x", "reduction": {"sigma": 3.0}, "detection": {"sigma": 4.0}}, where="x")
    assert SurveyStrategy(name="x", detection={"sigma": 3.0}).detection.sigma == 3.0
    assert SurveyStrategy(name="x", reduction={"sigma": 3.0}, detection={"sigma": 3.0}).reduction.sigma == 3.0
