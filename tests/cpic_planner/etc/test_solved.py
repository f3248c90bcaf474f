"""From solved frames to typed answers: reasons, flags, and numbers that agree with each other."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import build_model, contrast_limit, questions
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target, rank_sample
from simulator.config import load_instrument

ONE = Strategy(visits=1, search="known_place")
MODEL = build_model(load_instrument({"overhead_s": 0.0}), ["F520"], ONE)
TAU_CET = find_target("tau Cet")[0]
STARS = rank_sample(v_mag_max=5.0)


def test_numbers_of_an_answer_agree():
    for answer in signal_to_noise(MODEL, STARS.select(range(40)), time_s=5000.0, separation_arcsec=0.6, contrast=1e-8):
        assert answer.value == pytest.approx(answer.snr, rel=1e-12)
        assert answer.snr < answer.significance
        assert answer.integration_s == pytest.approx(answer.n_frames * answer.exposure_s, rel=1e-15)
        assert answer.time_s == pytest.approx(2 * (answer.integration_s + answer.n_frames * 1.1), rel=1e-12)
        assert answer.time_s <= 5000.0
        assert answer.question == "signal_to_noise"
        assert answer.unit == ""
        assert isinstance(answer.n_frames, int)


def test_a_shorter_visit_is_flagged_only_where_one_was_chosen():
    drifting = signal_to_noise(MODEL, TAU_CET, time_s=1e6, separation_arcsec=0.5, contrast=1e-8)[0]
    assert "shorter_visit_is_better" in drifting.flags
    assert drifting.time_s < 0.5e6
    whole = signal_to_noise(MODEL, TAU_CET, time_s=1e6, separation_arcsec=0.5, contrast=1e-8, exact=True)[0]
    assert "shorter_visit_is_better" not in whole.flags
    assert whole.time_s == pytest.approx(1e6, rel=1e-3)
    assert whole.snr < drifting.snr
    short = signal_to_noise(MODEL, TAU_CET, time_s=300.0, separation_arcsec=0.5, contrast=1e-8)[0]
    assert "shorter_visit_is_better" not in short.flags
    left = signal_to_noise(MODEL, TAU_CET, time_s=300.0, separation_arcsec=0.5, contrast=1e-8, exposure_s=20.0)[0]
    assert "shorter_visit_is_better" not in left.flags  # what is left of the time holds no further frame


def test_the_floor_is_stated_with_the_most_that_is_reached():
    lost = exposure_time(MODEL, TAU_CET, snr=50.0, separation_arcsec=0.5, contrast=1e-8)[0]
    most = signal_to_noise(MODEL, TAU_CET, time_s=1e9, separation_arcsec=0.5, contrast=1e-8)[0]
    assert lost.reason == "speckle_floor"
    assert f"the most is {most.snr:.4g}" in lost.message
    assert "significance" in exposure_time(MODEL, TAU_CET, sigma=50.0, separation_arcsec=0.5, contrast=1e-8)[0].message


def test_too_bright_to_count():
    model = build_model(load_instrument(), ["F520"], Strategy(mode="photon_counting", visits=1))
    bright = replace(TAU_CET, v_mag=np.array([3.0]))
    asked = {"time_s": 3600.0, "separation_arcsec": 0.6, "contrast": 3e-7}
    short = signal_to_noise(model, bright, **asked)[0]
    long = signal_to_noise(model, bright, exposure_s=60.0, em_gain=600.0, **asked)[0]
    assert short.status == "ok"
    assert (long.status, long.reason) in (("saturated", "too_bright_to_count"), ("saturated", "register_full_well"))
    low = signal_to_noise(model, bright, exposure_s=60.0, em_gain=30.0, **asked | {"contrast": 1e-6})[0]
    assert (low.status, low.reason) == ("saturated", "too_bright_to_count")


def test_limits_hold_their_own_level():
    for answer in contrast_limit(MODEL, STARS.select(range(20)), time_s=5000.0, separation_arcsec=0.6):
        assert answer.value == answer.contrast
        assert answer.level == pytest.approx(answer.significance, rel=1e-9)
    for answer in contrast_limit(MODEL, STARS.select(range(20)), time_s=5000.0, separation_arcsec=0.6, snr=3.0):
        assert answer.level == 3.0 == pytest.approx(answer.snr, rel=1e-9)


def test_reasons_of_a_catalogue_are_worked_out_together(monkeypatch):
    """Once for a band, not star by star: the time grows with the number of stars, not with its square."""
    calls, real = [], questions.best_in_visit
    monkeypatch.setattr(questions, "best_in_visit", lambda *given: calls.append(1) or real(*given))
    found = exposure_time(MODEL, STARS, snr=1e3, contrast=1e-12, separation_arcsec=0.6)
    assert {answer.reason for answer in found} == {"common_speckle_floor"}
    assert len(found) > 100
    assert len(calls) == 1


def test_json_of_every_kind_of_answer():
    for answer in exposure_time(
        MODEL, TAU_CET, snr=5.0, separation_arcsec=[0.1, 0.5, 0.6, 2.0], contrast=[1e-8, 1e-8, 0, 1e-8]
    ):
        tree = answer.to_dict()
        assert isinstance(tree["status"], str)
        assert isinstance(tree["flags"], list)
        assert (tree["value"] is None) == (tree["status"] != "ok")
        assert not any(isinstance(value, float) and not math.isfinite(value) for value in tree.values())
