"""Over whole domains: a number or a typed refusal, never nan, never a warning; monotonic where physics is."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings, strategies as st

import simulator
from cpic_core import InputError
from cpic_planner.etc import build_model, contrast_limit, threshold_array
from cpic_planner.etc.detection import detection_threshold
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.targets import find_target
from simulator import camera
from simulator.knobs import dial_of
from simulator.passbands import Passbands
from simulator.target import contrast_at, detector_to_sky, sky_to_detector
from tests.simulator.frames import expected_adu_map, expose_frame

DETECTOR = simulator.load_instrument().detector
BANDS = Passbands.from_bands()
MODEL = build_model(simulator.load_instrument(), ["F520"])
TAU_CET = find_target("tau Cet")[0]
ANY = st.floats(allow_nan=True, allow_infinity=True)
PHASES = st.one_of(st.floats(0, 180), st.floats(0, 1e-9), st.floats(0, 1e-9).map(lambda d: 180.0 - d))
GAINS = st.one_of(st.sampled_from([1.0, 1.0 + 1e-12, 1000.0, 1e4]), st.floats(1, 1e4))


def finite_or_refused(function, *arguments):
    """Every number of an answer, or nothing where the answer is a refusal of one line."""
    try:
        found = np.atleast_1d(np.asarray(function(*arguments), dtype=float))
    except InputError as error:
        line, found = str(error), None
    if found is None:
        assert "not accepted" in line
        assert "\n" not in line
        return
    assert np.isfinite(found).all(), (function, arguments, found)


PURE = {
    "lambert_phase": (simulator.lambert_phase, 1),
    "planet_contrast": (simulator.planet_contrast, 5),
    "contrast_at": (contrast_at, 4),
    "sky_to_detector": (sky_to_detector, 2),
    "detector_to_sky": (detector_to_sky, 2),
    "stage_probability": (camera.stage_probability, 1),
    "excess_noise_factor2": (camera.excess_noise_factor2, 1),
    "aperture_noise_pixels": (camera.aperture_noise_pixels, 1),
    "em_voltage_of": (camera.em_voltage_of, 2),
    "expected_adu_map": (lambda r, t, g: expected_adu_map(np.full((2, 2), r), t, g, DETECTOR), 3),
    "expose_frame": (lambda r, t, g: expose_frame(np.full((2, 2), r), t, g, DETECTOR, seed=1, path=("one",)).adu, 3),
    "star_rate_e_s": (BANDS.star_rate_e_s, 5),
}
EDGES = (
    0.0,
    -0.0,
    5e-324,
    1e-308,
    1e-12,
    1.0,
    1.0 + 1e-12,
    180.0,
    1e4,
    1e6,
    1e12,
    1e100,
    1.7e308,
    -1.0,
    -1.7e308,
    math.inf,
    -math.inf,
    math.nan,
)


@pytest.mark.parametrize("name", PURE)
def test_a_number_or_a_refusal_at_every_corner(name):
    """All pairs of extreme arguments, the others ordinary; then all of them extreme."""
    function, count = PURE[name]
    for value in EDGES:
        finite_or_refused(function, *(value,) * count)
    for i, j in itertools.combinations(range(count), 2):
        for a, b in itertools.product(EDGES[::2], EDGES[1::2]):
            finite_or_refused(function, *(a if k == i else b if k == j else 1.0 for k in range(count)))


@pytest.mark.parametrize("name", PURE)
@settings(max_examples=15)
@given(data=st.data())
def test_a_number_or_a_refusal_anywhere(name, data):
    function, count = PURE[name]
    finite_or_refused(function, *(data.draw(ANY) for _ in range(count)))


@settings(max_examples=200)
@given(PHASES, PHASES)
@example(180.0, 180.0 - 3e-14)
@example(0.0, 1e-12)
def test_a_planet_fades_with_its_phase(first, second):
    near, far = sorted((first, second))
    assert simulator.lambert_phase(far) <= simulator.lambert_phase(near) <= 1.0
    if near < far < 180.0 and far - near > 1e-6:
        assert 0.0 < simulator.lambert_phase(far) < simulator.lambert_phase(near)


@settings(max_examples=100)
@given(GAINS, GAINS)
def test_the_register_never_makes_less_noise_per_electron_than_it_must(first, second):
    low, high = sorted((first, second))
    assert 1.0 <= camera.excess_noise_factor2(low) < 2.0
    assert 0.0 <= camera.stage_probability(low) <= camera.stage_probability(high) <= 1.0


@settings(max_examples=100)
@given(st.floats(0, 1e12), st.floats(0, 1e12), GAINS)
def test_limits_bind_more_where_there_is_more_charge(first, second, gain):
    less, more = sorted((first, second))
    answer = camera.pixel_saturated(more, gain, DETECTOR)
    assert answer.status != "ok" or camera.pixel_saturated(less, gain, DETECTOR).status == "ok"
    assert answer.value is None or 0.0 <= answer.value <= 1.0


@settings(max_examples=100)
@given(st.floats(-27, 29.9), st.floats(3500, 8000))
def test_a_magnitude_is_a_factor(v_mag, teff_k):
    bright, faint = BANDS.star_rate_e_s([v_mag, v_mag + 0.1], teff_k, 4.44, 0.0, 1.0)
    assert bright / faint == pytest.approx(10.0**0.04, rel=1e-12)


@settings(max_examples=60)
@given(st.floats(0, 1e6), st.floats(0, 1e6), st.floats(1e-3, 20))
@example(2.9999999, 3.0, 20.0)
@example(3.0, 1e6, 1e-3)
def test_few_elements_ask_for_more(first, second, sigma):
    few, many = sorted((first, second))
    thresholds = threshold_array([few, many], sigma)
    assert thresholds[0] >= thresholds[1] * (1 - 1e-12)
    assert thresholds[1] >= sigma * (1 - 1e-12)
    answer = detection_threshold(few, sigma)
    assert (answer.status == "ok") == (few >= 3)
    assert (answer.value or math.inf) == thresholds[0]


@settings(max_examples=30)
@given(st.floats(0, 0.5))
def test_a_tolerance_is_kept(tolerance):
    dial = dial_of(tolerance=tolerance)
    assert set(dial.tolerance.values()) == {tolerance}
    assert dial.fidelity == ("reference" if tolerance == 0 else "custom")


def test_an_outcome_has_no_nan():
    with pytest.raises(ValueError, match="no nan"):
        simulator.Outcome.ok(math.nan)


def star(v_mag, distance_pc=10.0):
    return replace(TAU_CET, v_mag=np.array([v_mag]), distance_pc=np.array([distance_pc]))


def plain(answer):
    """Everything of an answer is finite, or it has a reason."""
    for value in answer.to_dict().values():
        for item in value.values() if isinstance(value, dict) else [value]:
            assert not isinstance(item, float) or math.isfinite(item), answer
    assert (answer.value is None) == (answer.status != "ok") == bool(answer.reason) == bool(answer.message)
    return answer


EXTREME = {
    "v_mag": st.sampled_from([-27.0, -1.5, 5.0, 30.0]),
    "contrast": st.sampled_from([1e-3, 1e-9, 1e-15]),
    "frame": st.sampled_from(
        [{}, {"exposure_s": 0.01}, {"exposure_s": 1e6}, {"em_gain": 1.0}, {"em_gain": 1 + 1e-12}, {"em_gain": 1000.0}]
    ),
    "separation": st.sampled_from([0.0, 1e-6, 0.55, 5.0, 120.0]),
}


@settings(max_examples=30)
@given(time_s=st.sampled_from([1e-3, 1.0, 1e4, 1e9]), snr=st.sampled_from([1e-6, 5.0, 1e6]), **EXTREME)
def test_questions_have_an_answer_or_a_reason(v_mag, contrast, frame, separation, time_s, snr):
    place = {"separation_arcsec": separation, **frame}
    plain(signal_to_noise(MODEL, star(v_mag), time_s=time_s, contrast=contrast, **place)[0])
    plain(exposure_time(MODEL, star(v_mag), snr=snr, contrast=contrast, **place)[0])
    plain(contrast_limit(MODEL, star(v_mag), time_s=time_s, **place)[0])


@settings(max_examples=15)
@given(st.floats(0, 12), st.floats(-12, -4), st.floats(1, 7))
def test_more_time_or_light_is_never_worse(v_mag, log_contrast, log_time):
    """In the best visit of at most a given time; and a brighter planet of the same star."""
    at = {"separation_arcsec": 0.55}
    some, longer, brighter = (
        signal_to_noise(MODEL, star(v_mag), time_s=time, contrast=ratio, **at)[0].value
        for time, ratio in (
            (10**log_time, 10**log_contrast),
            (2 * 10**log_time, 10**log_contrast),
            (10**log_time, 2 * 10**log_contrast),
        )
    )
    assume(None not in (some, longer, brighter))
    assert longer >= some * (1 - 1e-9)
    assert brighter >= some * (1 - 1e-9)


def test_particles_without_end_leave_no_frame_and_no_warning():
    """Many particles and frames of 1e6 s: the chance of a clean one is below any double."""
    stormy = build_model(simulator.load_instrument({"cosmic_rays": {"peak_rate_per_s_cm2": 100.0}}), ["F520"])
    answer = plain(
        signal_to_noise(stormy, star(30.0), time_s=1e9, separation_arcsec=0.55, contrast=1e-3, exposure_s=1e6)[0]
    )
    assert 0.0 < answer.value < 1e-100
