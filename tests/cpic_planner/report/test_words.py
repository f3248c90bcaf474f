import re
from pathlib import Path

import numpy as np
import pytest

from catalogs import load_stars
from cpic_core import Reason
from cpic_planner import report
from cpic_planner.etc import budget, build_model
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.report import duration_text
from cpic_planner.report.plan import not_imaged_lines, targets_sentences
from cpic_planner.report.words import (
    FLAGS,
    LIMITS,
    MISSING,
    REMEDIES,
    TERMS,
    cap_sentence,
    contrast_text,
    count_text,
    decimals,
    flag_text,
    formatted,
    found_text,
    full_name,
    limit_text,
    percent_text,
    pretty_name,
    prose,
    reason_text,
    remedy_text,
    score_number,
    short_limit,
    significant,
    term_text,
    text,
)
from cpic_planner.results import LeftOutRow, NotImagedRow, PeriodRecord, Quantiles, ScheduleImages
from cpic_planner.targets import find_target
from simulator.config import load_instrument


@pytest.fixture(scope="module")
def answer():
    star, _ = find_target("tau Cet")
    model = build_model(load_instrument(), ["F520"])
    return signal_to_noise(model, star, time_s=3600.0, separation_arcsec=0.5)[0]


def test_every_term_and_remedy_of_an_answer_has_words(answer):
    names = {name.removesuffix("_e2") for name in answer.budget} - {"signal_e"}
    assert names == set(TERMS) - {
        "counting",
        "persistence",
    }  # of a camera that counts photons, and of the near infrared
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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (significant(31.04), "31.0"),
        (significant(0.0312345), "0.0312"),
        (significant(1234.5), "1234"),
        (significant(0.0), "0"),
        (significant(-1.5), "−1.50"),
        (decimals(-0.26, 1), "−0.3"),
        (contrast_text(5.163e-8), "5.16 × 10⁻⁸"),
        (contrast_text(0.0), "0"),
        (contrast_text(-2e-9, 2), "−2.0 × 10⁻⁹"),
        (duration_text(59.0), "59.0 s"),
        (duration_text(1800.0), "30.0 min"),
        (duration_text(36000.0), "10.0 h"),
        (count_text(1094), "1\u202f094"),
        (percent_text(0.944), "94 %"),
        (formatted(3.14159, ".2f"), "3.14"),
        (formatted(1234.5, ".3g"), "1234"),
        (formatted(5.163e-8, ".2e"), "5.16e-08"),
        (formatted(20.0, "g"), "20"),
        (formatted(12345, "d"), "12\u202f345"),
        (formatted(0.1234, "%"), "12.3"),
        (formatted(5400.0, "time"), "1.50 h"),
        (formatted(5400.0, "min"), "90.0"),
        (formatted(12_300_000, "bytes"), "12.3 MB"),
        (formatted("* alf Cen B", "star"), "α Cen B"),
        (formatted(Quantiles(low=1.0, median=2.0, high=3.0), ".1f"), "2.0"),
        (formatted(0.12345), "0.123"),
        (formatted(7), "7"),
        (formatted(True), "yes"),
        (formatted(["a", "b"]), "a, b"),
        (formatted([]), MISSING),
        (formatted(None, "d"), MISSING),
    ],
)
def test_formats(text, expected):
    assert text == expected


@pytest.mark.parametrize("function", [significant, contrast_text, duration_text, percent_text])
@pytest.mark.parametrize("value", [None, float("nan"), float("inf")])
def test_missing_numbers_are_a_dash(function, value):
    assert function(value) == MISSING
    assert decimals(value, 2) == MISSING


def test_missing_count():
    assert count_text(None) == MISSING


@pytest.mark.parametrize(
    ("identifier", "expected"),
    [
        ("* alf Cen B", "α Cen B"),
        ("* tau Cet", "τ Cet"),
        ("tau Cet", "τ Cet"),
        ("HD  10700", "HD 10700"),
        ("V* AK Lep", "AK Lep"),
        ("V* V538 Aur", "V538 Aur"),
        ("NAME Proxima Centauri", "Proxima Centauri"),
        ("* pi.03 Ori", "π³ Ori"),
        ("* alf01 Cen", "α¹ Cen"),
        ("*  61 Cyg A", "61 Cyg A"),
        ("* ksi Boo A", "ξ Boo A"),
        ("* e Eri", "e Eri"),
        ("* b03 Cyg", "b³ Cyg"),
        ("** STF 60A", "STF 60A"),
        ("* mu.02 Cnc", "μ² Cnc"),
        ("HIP 8102", "HIP 8102"),
        ("ups Foo", "ups Foo"),
        ("<script>", "<script>"),
        ("", ""),
    ],
)
def test_pretty_name(identifier, expected):
    assert pretty_name(identifier) == expected


def test_full_name():
    assert full_name("* tau Cet", 8102) == "τ Cet (HIP 8102)"
    assert full_name("HIP 8102", 8102) == "HIP 8102"
    assert full_name("* tau Cet", None) == "τ Cet"


def test_catalogue_names_stay_distinct_and_short():
    names = [pretty_name(str(name)) for name in np.asarray(load_stars().column("name"))]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) <= 18


def test_every_text_of_the_prose_is_used_and_none_is_missing():
    code = "\n".join(path.read_text(encoding="utf-8") for path in Path(report.__file__).parent.glob("*.py"))
    used = set(re.findall(r"\btext\(\s*\"texts\.(\w+)\"", code)) | {"curve_about", "roc_about"}
    assert used == set(prose()["texts"])
    assert set(re.findall(r"drawing\.picture\([^\"]+\"(\w+)\"", code)) <= set(prose()["pictures"])


def test_braces_of_the_prose_are_written_as_tables_write_them():
    about = {"title": "<b>", "key": "{not a brace}"}
    assert text("texts.whatif_facts", title=about["title"]).startswith("<b>, mean of a survey.")
    assert text("texts.whatif_settled", key=about["key"]).startswith("Which value of {not a brace} to plan")


def test_codes_in_what_images_showed_of_a_target_are_words():
    assert found_text("not observed: time_below_overheads") == "not observed: time shorter than the overheads"
    assert found_text("confirmed in F520; ratio 1.0 +- 0.1") == "confirmed in F520; ratio 1.0 ± 0.1"
