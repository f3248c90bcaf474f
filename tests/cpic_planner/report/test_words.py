import numpy as np
import pytest

from cpic_core import Reason
from cpic_planner.etc import budget, build_model
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.report.plan import not_imaged_lines, targets_sentences
from cpic_planner.report.words import (
    FLAGS,
    LIMITS,
    REMEDIES,
    TERMS,
    cap_sentence,
    flag_text,
    limit_text,
    reason_text,
    remedy_text,
    score_number,
    short_limit,
    term_text,
)
from cpic_planner.results import LeftOutRow, NotImagedRow, PeriodRecord, ScheduleImages
from cpic_planner.targets import find_target
from simulator.config import load_instrument


@pytest.fixture(scope="module")
def answer():
    star, _ = find_target("tau Cet")
    model = build_model(load_instrument(), ["F520"])
    return signal_to_noise(model, star, time_s=3600.0, separation_arcsec=0.5)[0]


def test_every_term_and_remedy_of_an_answer_has_words(answer):
    names = {name.removesuffix("_e2") for name in answer.budget} - {"signal_e"}
    assert names == set(TERMS) - {"counting"}
    assert set(answer.remedies) == set(REMEDIES)
    assert term_text("read_noise") == "read noise"
    assert term_text("dark") == "dark current"
    assert remedy_text("half_the_drift") == "half the drift of the wavefront"


def test_every_limit_has_words():
    known = {budget.EXPOSURE_MAX, budget.EXPOSURE_MIN, budget.EM_GAIN_MAX}
    known |= {reason.value for reason in (Reason.PIXEL_FULL_WELL, Reason.REGISTER_FULL_WELL, Reason.ADC_RANGE)}
    assert set(LIMITS) == known
    assert short_limit("adc_range") == "converter"
    assert limit_text("em_gain_max") == "the largest gain of the register"


def test_every_reason_has_words():
    for reason in Reason:
        if reason not in (Reason.NONE, Reason.NOT_ADDITIVE):
            assert reason_text(reason.value) != reason.value.replace("_", " "), reason


def test_every_flag_of_a_library_has_words():
    assert {"exposure_beyond_max", "shorter_visit_is_better"} <= set(FLAGS)
    for name in ("visits_at_limit", "idealised", "exposure_beyond_max", "shorter_visit_is_better"):
        assert flag_text(name) != name.replace("_", " ")


def test_unknown_codes_are_spelled_out():
    assert term_text("some_new_term") == "some new term"
    assert remedy_text("a_b") == "a b"
    assert limit_text("a_b") == short_limit("a_b") == "a b"
    assert short_limit("") == ""


@pytest.mark.parametrize(
    ("value", "score", "text"),
    [
        (0.0, "completeness", "0"),
        (0.07251, "completeness", "7.25"),
        (2.5e-4, "completeness_per_hour", "0.0250"),
        (2.5e-6, "completeness_per_hour", "2.5e-04"),
        (2.5e-4, "detection_time", "2.5e-04"),
        (8.7512, "contrast_limit", "8.75"),
        (0.0, "contrast_limit", "0.00"),
        (15.62, "detection_margin", "15.6"),
    ],
)
def test_scores_as_text(value, score, text):
    assert score_number(value, score) == text


@pytest.mark.parametrize("name", ["hole", "register_tail", "frame"])
def test_gains_that_spare_something(name):
    assert cap_sentence(name, 482.2).startswith("EM gain up to 482 ")
    assert cap_sentence(name, float(np.float64(0.0))).startswith("no EM gain ")


def test_who_is_left_out_and_why(plan):
    assert targets_sentences(plan) == not_imaged_lines(plan) == []  # an older result
    left = [
        LeftOutRow(name=f"HD {i}", rank=i + 1, usable_h=0.0, needed_h=2.0, message="not seen in 3 d") for i in range(12)
    ]
    period = PeriodRecord(
        start_utc="2028-01-01T00:00:00", n_days=3, pointing="default", left_out=left, not_checked=["tau Cet"]
    )
    first, unknown, named = targets_sentences(plan.model_copy(update={"period": period}))
    assert "in the 3 days from 2028-01-01 on (limits of pointing: default)" in first
    assert "not known of τ Cet" in unknown
    assert "limited by visibility: HD 0, rank 1 (not seen in 3 d); HD 1" in named
    assert named.endswith("HD 9, rank 10 (not seen in 3 d); and 2 more stars, which plan.json names.")


def test_what_a_schedule_has_no_images_of(plan):
    bad = [NotImagedRow(row=row, star="tau Cet", band="F520", message="a reserve visit") for row in (2, 5)]
    made = ScheduleImages(source="9 visits of deep", n_visits=9, n_imaged=7, n_stars=50, not_imaged=bad)
    shown = plan.model_copy(update={"schedule": made})
    what, _ = targets_sentences(shown)
    rest = 50 - len(plan.targets)
    assert what.endswith(f"for 7 of 9 visits; {rest} more stars can be imaged (a larger --top).")
    assert not_imaged_lines(shown) == ["No images of rows 2 (τ Cet, F520), 5 (τ Cet, F520): a reserve visit."]
