"""The law of detections as calculator and ranking state it; `tests/cpic_planner/survey` judges its form."""

import math
from statistics import NormalDist

import numpy as np
import pytest

from catalogs.strict_yaml import load_yaml, split_sourced
from cpic_planner.etc.detection import (
    DetectionLaw,
    default_law,
    detection_probability,
    law_of,
    needed_margin,
    verdict_of,
    visit_chances,
)
from cpic_planner.etc.model import Strategy, build_model
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.survey.strategy_file import load_strategies
from cpic_planner.targets import find_target
from simulator.config import load_instrument
from simulator.config.presets import preset_path
from simulator.outcome import Status

MODEL = build_model(load_instrument())


def test_numbers_are_those_of_the_preset_and_of_surveys():
    stated = split_sourced(load_yaml(preset_path("strategy", "default", package="cpic_planner")))[0]["detection"]
    survey = load_strategies().strategies[0].detection
    for name in DetectionLaw.model_fields:
        assert getattr(default_law(), name) == stated[name] == getattr(survey, name), name


def test_half_of_the_visits_detect_at_the_needed_margin():
    """0.948 / 1.006 of the threshold; at the threshold itself 58.5 %."""
    assert needed_margin(MODEL, "F520") == pytest.approx(0.94235, abs=1e-5)
    law = default_law()
    at = [needed_margin(MODEL, "F520"), 1.0]
    found = detection_probability(law, at, True, 0.0, 0.1, calibration=law.calibration)
    assert found == pytest.approx([0.5, NormalDist().cdf(math.log(1.006 / 0.948) / 0.276)], rel=1e-12)
    assert found[1] == pytest.approx(0.585, abs=5e-4)


def test_no_law_where_no_images_were_measured():
    """Near-infrared bands and photon counting: no probability, and the threshold itself is what has to be reached."""
    counting = build_model(load_instrument(), ["F520"], Strategy(mode="photon_counting"))
    assert law_of(counting, "F520") is None
    assert needed_margin(counting, "F520") == 1.0
    (answer,) = exposure_time(counting, find_target("tau Cet")[0], detect=True, separation_arcsec=0.45)
    assert answer.verdict == "detected"
    assert answer.detection_probability is answer.detection_probability_known_place is None
    infrared = type(MODEL)(MODEL.instrument, MODEL.passbands, {"F1265": MODEL.metrics["F850"]}, MODEL.strategy)
    assert law_of(infrared, "F1265") is None
    assert np.isnan(visit_chances(infrared, "F1265", 0.6, 1.0, None, np.array([2.0])).blind).all()


def test_verdict_of_every_status():
    for status in Status:
        for detected in (True, False):
            expected = ("detected" if detected else "measured_not_detected") if status is Status.OK else "unreachable"
            assert verdict_of(status, detected) == expected


def test_blind_probability_of_an_answer():
    """From the answer's own numbers: margin, budget and place; the share of errors' light is that of the drift."""
    law = default_law()
    (answer,) = signal_to_noise(MODEL, find_target("tau Cet")[0], time_s=7200.0, separation_arcsec=0.5, bands=["F520"])
    margin = answer.significance / answer.threshold
    normal = NormalDist()
    known = normal.cdf(math.log(margin * law.calibration / law.known_margin) / law.known_width)
    assert answer.detection_probability_known_place == pytest.approx(known, rel=1e-9)
    quiet = sum(value for name, value in answer.budget.items()
                if name not in ("signal_e", "planet_e2", "background_mean_e2"))  # fmt: skip
    speckle = math.sqrt(answer.budget["speckle_e2"] / quiet)
    inward = MODEL.metrics["F520"].lambda_d_arcsec / 0.5 - 0.1
    harder = [law.blind_tails * tails + law.blind_inward * inward for tails in (speckle, 0.0)]
    middles = [law.blind_margin * math.exp(part) for part in harder]
    bounds = [normal.cdf(math.log(margin * law.calibration / middle) / law.blind_width) for middle in middles]
    assert bounds[0] < answer.detection_probability < bounds[1]
