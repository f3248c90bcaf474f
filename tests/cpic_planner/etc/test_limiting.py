"""What limits an answer, against the noise budget and against instruments that do not drift."""

import itertools
import math

import pytest

from cpic_planner.etc.detection import needed_margin
from cpic_planner.etc.limiting import limit_of
from cpic_planner.etc.model import build_model
from cpic_planner.etc.questions import contrast_limit, exposure_time, signal_to_noise
from cpic_planner.targets import Targets, find_target
from simulator.config import load_instrument
from simulator.outcome import Reason, Status

MODEL = build_model(load_instrument())
STILL = build_model(load_instrument().changed({"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0}}))
STARS = Targets.joined([find_target(name)[0] for name in ("tau Cet", "omi2 Eri", "10 Tau", "alf Cen B")])
TAU_CET = find_target("tau Cet")[0]
NEEDED = needed_margin(MODEL, "F520")


def test_the_budget_tells_it_where_frames_are_given():
    """Frames of fixed length, gain and number: each change takes terms out of the budget, and nothing else moves."""
    frames = {"exposure_s": 20.0, "separation_arcsec": 0.45, "bands": ["F662"], "exact": True}
    seen = set()
    contrasts = [10 ** (k / 10 - 8.6) for k in range(14)]
    for (time_s, gain), contrast in itertools.product(((900.0, 30.0), (7200.0, 300.0)), contrasts):
        (answer,) = signal_to_noise(MODEL, TAU_CET, time_s=time_s, contrast=contrast, em_gain=gain, **frames)
        terms = {name.removesuffix("_e2"): value for name, value in answer.budget.items()}
        signal = terms.pop("signal_e")
        level = NEEDED * answer.threshold
        own, lasting = terms.pop("planet"), terms["speckle"] + terms["companion_wings"]
        white = sum(value for name, value in terms.items() if name != "background_mean") - lasting
        if signal / math.sqrt(white + lasting) >= level:
            expected = "none"
        elif signal / math.sqrt(white) >= level:
            expected = "speckles"
        else:
            expected = "background" if signal / math.sqrt(lasting + own) >= level else "photons"
        assert answer.limited_by == expected, (time_s, contrast)
        assert (answer.verdict == "detected") == (expected == "none")
        seen.add(expected)
    assert seen == {"none", "speckles", "background", "photons"}


@pytest.mark.parametrize("separation", [0.4, 0.5, 0.65])
def test_speckles_are_what_an_instrument_without_drift_detects(separation):
    asked = {"time_s": 36000.0, "separation_arcsec": separation}
    pairs = list(zip(signal_to_noise(MODEL, STARS, **asked), signal_to_noise(STILL, STARS, **asked), strict=True))
    for now, still in pairs:
        if now.status is not Status.OK:
            continue
        detected = still.significance / still.threshold >= NEEDED
        assert (now.limited_by in ("none", "speckles")) == detected
        assert (now.limited_by == "none") == (now.significance / now.threshold >= NEEDED)
    assert len({now.limited_by for now, _ in pairs}) >= 3


def test_a_time_that_does_not_exist_is_that_of_an_instrument_without_drift():
    """The message states it; 1e9 s is the longest time that can be given."""
    asked = {"snr": 10.0, "separation_arcsec": 0.45, "bands": ["F520"]}
    (now,), (still,) = (exposure_time(model, TAU_CET, **asked) for model in (MODEL, STILL))
    assert (now.status, now.verdict, now.limited_by) == ("unreachable", "unreachable", "speckles")
    assert f"without drift of the wavefront it would take {still.value:.3g} s" in now.message
    (faint,) = exposure_time(MODEL, TAU_CET, contrast=1e-14, **asked)
    (never,) = exposure_time(STILL, TAU_CET, contrast=1e-14, **asked)
    assert never.value > 1e9
    assert (faint.reason, faint.limited_by) == ("speckle_floor", "photons")
    assert "without drift of the wavefront the planet would still be too faint" in faint.message


def test_every_answer_is_consistent():
    """A verdict for every planet, none for a limit; detected where half of the visits show it, and only there."""
    places, seen = [0.1, 0.45, 0.6], set()
    asked = [(signal_to_noise, {"time_s": time_s}) for time_s in (1.0, 600.0, 36000.0)]
    asked += [(exposure_time, level) for level in ({"detect": True}, {"snr": 5.0}, {"snr": 500.0}, {"sigma": 3.0})]
    for ask, given in asked:
        for answer in ask(MODEL, STARS, separation_arcsec=places, **given):
            probability = answer.detection_probability_known_place
            assert answer.verdict_mode == "known_place"
            assert (answer.verdict == "unreachable") == (answer.status is not Status.OK)
            assert (answer.limited_by == "none") == (answer.verdict == "detected")
            assert (probability is None) == (answer.status is not Status.OK)
            if probability is not None:
                assert (answer.verdict == "detected") == (probability >= 0.5 - 1e-9)
            if given.get("detect") and answer.status is Status.OK:
                assert answer.verdict == "detected"
                assert probability == pytest.approx(0.585, abs=1e-3)
            if answer.status is Status.OUTSIDE_FIELD:
                assert answer.limited_by == "geometry"
            seen.add((answer.verdict, answer.limited_by))
    assert {
        ("detected", "none"),
        ("measured_not_detected", "speckles"),
        ("measured_not_detected", "photons"),
        ("unreachable", "geometry"),
        ("unreachable", "speckles"),
    } <= seen
    for answer in contrast_limit(MODEL, STARS, time_s=3600.0, separation_arcsec=places):
        assert answer.verdict is answer.verdict_mode is answer.limited_by is None
        assert answer.detection_probability is answer.detection_probability_known_place is None


def test_limits_by_status():
    no = {"detected": False, "without_speckles": False, "without_background": False}
    assert limit_of(Status.OUTSIDE_FIELD, Reason.INSIDE_INNER_EDGE, **no) == "geometry"
    assert limit_of(Status.UNREACHABLE, Reason.TOO_FEW_ELEMENTS, **no) == "geometry"
    assert limit_of(Status.SATURATED, Reason.PIXEL_FULL_WELL, **no) == "saturation"
    assert limit_of(Status.UNREACHABLE, Reason.NO_TIME, **no) == "photons"
    assert limit_of(Status.OK, Reason.NONE, **no | {"detected": True}) == "none"
    assert limit_of(Status.OK, Reason.NONE, **no | {"without_speckles": True, "without_background": True}) == "speckles"
    assert limit_of(Status.OK, Reason.NONE, **no | {"without_background": True}) == "background"
