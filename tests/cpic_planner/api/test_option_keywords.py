"""An option of the command line is a keyword of the Python function too; another one is answered with the nearest."""

import pytest

import cpic_planner as cp
from cpic_core import InputError

ASKED = {"target": "tau Cet", "bands": ["F520"], "time_s": 3600.0}


def told(**keywords):
    return [answer.model_dump() for answer in cp.signal_to_noise(**ASKED | keywords)]


@pytest.mark.parametrize(
    ("option", "field"),
    [
        ({"bands": None, "band": "F520"}, {}),
        ({"bands": None, "band": ["F520", "F662"]}, {"bands": ["F520", "F662"]}),
        ({"planet_radius_rjup": 0.9}, {"planet": {"radius_rjup": 0.9}}),
        ({"planet_radius_rjup": 0.9, "planet": {"phase_deg": 60}}, {"planet": {"radius_rjup": 0.9, "phase_deg": 60}}),
        ({"albedo": "saturn"}, {"planet": {"albedo": "saturn"}}),
        ({"library": "roll"}, {"strategy": {"library": "roll"}}),
    ],
    ids=str,
)
def test_an_option_is_a_keyword(option, field):
    asked = {name: value for name, value in (ASKED | option).items() if value is not None}
    assert [answer.model_dump() for answer in cp.signal_to_noise(**asked)] == told(**field)


def test_a_change_of_the_instrument_is_a_keyword():
    assert told(drift_nm=0.1)[0]["value"] == told(set=["drift=x2"])[0]["value"] != told()[0]["value"]


def test_an_option_and_its_field_are_one_of_two():
    with pytest.raises(InputError, match="band = given with bands: not accepted; allowed: one of the two"):
        told(band="F520")
    with pytest.raises(InputError, match="library = given with strategy"):
        told(library="roll", strategy=cp.Strategy(library="roll") if hasattr(cp, "Strategy") else object())


@pytest.mark.parametrize(
    ("function", "keyword", "words"),
    [
        (cp.rank_targets, "limit", "rank_targets.. has no keyword 'limit' .it decides what the command line shows"),
        (cp.rank_targets, "plot", "it decides what the command line shows"),
        (cp.exposure_time, "bnad", "exposure_time.. has no keyword 'bnad' .did you mean band or bands?"),
        (cp.signal_to_noise, "seperation_arcsec", "did you mean separation_arcsec or separation_au"),
        (cp.contrast_limit, "zzz", "known: target, "),
    ],
)
def test_an_unknown_keyword_is_answered_with_the_nearest(function, keyword, words):
    with pytest.raises(TypeError, match=words):
        function(**{keyword: 3})
