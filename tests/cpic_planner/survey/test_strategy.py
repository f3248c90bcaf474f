"""Strategies: what is refused, and what they say of it."""

import pytest

from cpic_core import InputError
from cpic_planner.survey.strategy import SurveyStrategy
from simulator.config import validate


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
