"""What is missing, by brute force: asked again with that change alone the planet is detected, with less not."""

import pytest

from cpic_core import InputError
from cpic_planner import contrast_limit, exposure_time, optimise, signal_to_noise
from cpic_planner.queries import Change, changed
from simulator.config import load_instrument

CASES = [
    # star, visits, time_s, separation_arcsec, band, search, gap_h, what limits it
    ("eps Ind", 1, 2000.0, 0.4, "F520", "blind", 0.0, "speckles"),
    ("del Pav", 4, 7200.0, 0.5, "F662", "blind", 0.0, "speckles"),
    ("tau Cet", 1, 1500.0, 0.6, "F520", "known_place", 0.0, "background"),
    ("tau Cet", 12, 8100.0, 0.55, "F520", "blind", 240.0, "motion"),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}-{case[-1]}")
def test_the_least_change_of_one_number_makes_the_planet_detected(case):
    star, visits, time_s, separation, band, search, gap_h, limit = case
    instrument = load_instrument("cpic_default")
    common = {
        "separation_arcsec": separation,
        "bands": [band],
        "strategy": {"search": search, "visit_gap_h": gap_h},
        "instrument": instrument,
    }
    lost = signal_to_noise(star, time_s=time_s, visits=visits, **common)[0]
    assert (lost.verdict, lost.limited_by) == ("measured_not_detected", limit)
    frames = common | {"exposure_s": lost.exposure_s, "em_gain": lost.em_gain, "exact": True}

    def found(time_s=lost.time_s, visits=visits, **change):
        answer = signal_to_noise(star, time_s=time_s, visits=visits, **(frames | change))[0]
        assert answer.frames_per_visit == lost.frames_per_visit
        return answer

    brighter = lost.required_contrast_factor
    assert found(contrast=lost.contrast * brighter * 1.0005).verdict == "detected"
    assert found(contrast=lost.contrast * brighter * 0.999).verdict != "detected"
    if (more := lost.required_visits) is not None:
        assert found(more * lost.visit_time_s, more).verdict == "detected"
        assert found((more - 1) * lost.visit_time_s, more - 1).verdict != "detected"
    if (longer := lost.required_time_s) is not None:
        # Frames of their own, of the most significance: a visit of one frame more detects, a shorter one does not.
        then = exposure_time(star, detect=True, visits=visits, **common)[0]
        assert then.time_s == pytest.approx(longer, rel=2e-4)  # whole frames, the other a fraction of one
        theirs = common | {"exposure_s": then.exposure_s, "em_gain": then.em_gain}
        frame_s = 2.0 * (then.exposure_s + instrument.detector_of(band).readout_s)
        one_more = signal_to_noise(star, time_s=longer + 1.01 * visits * frame_s, visits=visits, **theirs)[0]
        assert (one_more.frames_per_visit, one_more.verdict) == (then.frames_per_visit + 1, "detected")
        shorter = signal_to_noise(star, time_s=longer * 0.995, visits=visits, **common)[0]
        assert shorter.verdict == "measured_not_detected"
    if (calmer := lost.required_drift_factor) is not None:
        there = found(instrument=changed(instrument, (Change.scaling("drift", calmer),)))
        chance = "detection_probability" + "_known_place" * (search == "known_place")
        assert getattr(there, chance) == pytest.approx(0.5, abs=1e-3)
    asked = (lost.required_visits, lost.required_time_s, lost.required_drift_factor)
    assert any(number is not None for number in asked)


PLACE = {"separation_arcsec": 0.5, "bands": ["F520"]}
QUIET = {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "common_fraction": 0.0, "orbital_nm": 0.0}


@pytest.mark.parametrize(
    ("ask", "given", "line"),
    [
        (signal_to_noise, {"time_s": 36000, "visits": 0}, r"^strategy\.visits = 0: .*allowed: 1 to 1000$"),
        (signal_to_noise, {"time_s": 36000, "visits": 1001}, r"^strategy\.visits = 1001: .*allowed: 1 to 1000$"),
        (signal_to_noise, {"time_s": 36000, "reference_visits": 0}, r"reference_visits = 0: .*allowed: 1 to 100000$"),
        (signal_to_noise, {"visits": 4, "visit_time_s": 0}, r"^visit_time_s = 0 s: .*allowed: 0.001 to 1e\+09$"),
        (
            signal_to_noise,
            {"time_s": 1000, "visit_time_s": 3600},
            r"^visit_time_s = 3600.0 s: .*at most time_s, 1000 s$",
        ),
        (contrast_limit, {"time_s": 1000, "visits": 4, "visit_time_s": 3600}, r"^time_s = 1000.0 s: .*14400, or none"),
        (
            exposure_time,
            {"detect": True, "visits": 4, "visit_time_s": 3600},
            r"^visit_time_s = 3600.0 s: .*visits or visit_time_s: together",
        ),
        (optimise, {"time_s": 1000, "visits": 4, "visit_time_s": 3600}, r"^time_s = 1000.0 s: .*14400, or none"),
        (optimise, {"time_s": 1000, "visit_time_s": 3600}, r"^visit_time_s = 3600.0 s: .*at most time_s, 1000 s$"),
        (optimise, {"detect": True, "visit_time_s": 3600}, r"^detect = given with visit_time_s: .*one of the two"),
        (optimise, {"visits": 4, "visit_time_s": 0}, r"^visit_time_s = 0 s: .*allowed: 0.001 to 1e\+09$"),
    ],
)
def test_extremes_and_contradictions_are_refused_in_one_line(ask, given, line):
    place = {"bands": ["F520"]} if ask is optimise else PLACE
    with pytest.raises(InputError, match=line) as caught:
        ask("tau Cet", **given, **place)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "status", "reason"),
    [
        ({"time_s": 36000, "visits": 1}, "ok", ""),
        ({"time_s": 36000, "visits": 1000}, "unreachable", "time_below_overheads"),
        ({"time_s": 2e6, "visits": 1000}, "ok", ""),
        ({"visits": 4, "visit_time_s": 600.5}, "unreachable", "time_below_overheads"),
        pytest.param(
            {"time_s": 36000, "visits": 4, "strategy": {"n_modes": 1000}}, "ok", "", marks=pytest.mark.long
        ),  # measures 1500 visits of the optical model
        ({"time_s": 36000, "visits": 4, "instrument": {"drift": QUIET}}, "ok", ""),
    ],
)
def test_extremes_have_typed_answers(given, status, reason):
    answer = signal_to_noise("tau Cet", **given, **PLACE)[0]
    assert (answer.status.value, answer.reason.value) == (status, reason)
    assert answer.verdict in ("detected", "measured_not_detected" if status == "ok" else "unreachable")


def test_a_thousand_visits_of_one_frame_are_the_inverse_of_their_limit():
    """The level grows with the span: visits of a single frame each are solved as such."""
    instrument = load_instrument("cpic_default")
    for visits in (64, 1000):
        answer = exposure_time("tau Cet", detect=True, visits=visits, **PLACE)[0]
        assert (answer.status.value, answer.verdict, answer.frames_per_visit) == ("ok", "detected", 1)
        assert answer.detection_probability == pytest.approx(0.5, abs=1e-9)
        # A science frame and a reference frame after each overhead.
        frames_s = 2.0 * (answer.exposure_s + instrument.detector_of("F520").readout_s)
        assert answer.time_s == pytest.approx(visits * (instrument.overhead_s + frames_s), rel=1e-9)
        assert signal_to_noise("tau Cet", time_s=0.995 * answer.time_s, visits=visits, **PLACE)[0].verdict != "detected"


def test_optimise_takes_visits_of_a_length():
    by_length, by_number, both = (
        optimise("tau Cet", bands=["F520"], **given).iloc[0]
        for given in (
            {"visit_time_s": 3600.0},
            {"visits": 10, "time_s": 36000.0},
            {"visits": 10, "visit_time_s": 3600.0},
        )
    )
    assert by_length.visits == by_number.visits == both.visits == 10
    assert by_length.time_s == pytest.approx(by_number.time_s, rel=1e-12)
    assert by_length.margin == pytest.approx(both.margin, rel=1e-12)
