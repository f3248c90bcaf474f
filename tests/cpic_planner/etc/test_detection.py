"""The law of detections as calculator and ranking state it, and its form written out here."""

import math
from dataclasses import replace
from statistics import NormalDist

import mpmath
import numpy as np
import pytest

from cpic_core import Reason, Status, load_yaml, split_sourced
from cpic_planner.etc import (
    DetectionLaw,
    aperture_rates,
    build_model,
    default_law,
    effective_visits,
    needed_margin,
    stack_noise,
    threshold_array,
    verdict_of,
    visit_chances,
)
from cpic_planner.etc.detection import detection_probability, detection_threshold, half_margin, law_of, tail_share
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import Strategy
from cpic_planner.survey import load_strategies
from cpic_planner.targets import find_target
from simulator.config import load_instrument, preset_path

MODEL = build_model(load_instrument())


def test_numbers_are_those_of_the_preset_and_of_surveys():
    stated = split_sourced(load_yaml(preset_path("strategy", "default", package="cpic_planner")))[0]["detection"]
    survey = load_strategies().strategies[0].detection
    for name in DetectionLaw.model_fields:
        assert getattr(default_law(), name) == stated[name] == getattr(survey, name), name


@pytest.mark.parametrize("search", ["blind", "known_place"])
@pytest.mark.parametrize("visits", [1.0, 16.0])
def test_half_of_the_visits_detect_at_the_needed_margin(search, visits):
    """The stated search, at any share of tails and any place."""
    model, law = build_model(load_instrument(), ["F520"], Strategy(search=search)), default_law()
    tails, inward = np.array([0.0, 0.4, 0.9]), np.array([0.05, 0.1, 0.15])
    margin = needed_margin(model, "F520", tails, inward, visits)
    chances = [
        detection_probability(law, margin, place, tails, inward, visits=visits, calibration=law.calibration)
        for place in (False, True)
    ]
    np.testing.assert_allclose(chances[search == "known_place"], 0.5, rtol=1e-12)
    assert (chances[True] >= chances[False]).all()


def test_photometry_decides_where_a_search_asks_for_more():
    """0.963 / 1.006 of the threshold in one visit of many speckles; at the threshold itself 56.0 %."""
    model, law = build_model(load_instrument(), ["F520"], Strategy(search="known_place")), default_law()
    assert needed_margin(model, "F520", 0.9, 0.15) == pytest.approx(0.95726, abs=1e-5)
    found = detection_probability(law, 1.0, True, 0.9, 0.15, calibration=law.calibration)
    assert found == pytest.approx(NormalDist().cdf(math.log(1.006 / 0.963) / 0.287), rel=1e-12)
    assert found == pytest.approx(0.5605, abs=5e-4)


def test_no_law_where_no_images_were_measured():
    """Near-infrared bands and photon counting: no probability, and the threshold itself is what has to be reached."""
    counting = build_model(load_instrument(), ["F520"], Strategy(mode="photon_counting"))
    assert law_of(counting, "F520") is None
    assert needed_margin(counting, "F520", 0.5, 0.1) == 1.0
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
    model = build_model(load_instrument(), ["F520"], Strategy(visits=1))
    (answer,) = signal_to_noise(model, find_target("tau Cet")[0], time_s=7200.0, separation_arcsec=0.5)
    margin = answer.significance / answer.threshold
    normal = NormalDist()
    known = normal.cdf(math.log(margin * law.calibration / law.known_margin) / law.known_width)
    larger = max(known, answer.detection_probability)
    assert answer.detection_probability_known_place == pytest.approx(larger, rel=1e-9)
    quiet = sum(
        value for name, value in answer.budget.items() if name not in ("signal_e", "planet_e2", "background_mean_e2")
    )
    speckle = math.sqrt(answer.budget["speckle_e2"] / quiet)
    inward = MODEL.metrics["F520"].lambda_d_arcsec / 0.5 - 0.1
    harder = [law.blind_tails * tails + law.blind_inward * inward for tails in (speckle, 0.0)]
    middles = [law.blind_margin * math.exp(part) for part in harder]
    bounds = [normal.cdf(math.log(margin * law.calibration / middle) / law.blind_width) for middle in middles]
    assert bounds[0] < answer.detection_probability < bounds[1]


def random_cases(seed, n=400):
    """Return margins, whether the place is known, shares of tails, elements over separation, shifts, calibrations."""
    rng = np.random.default_rng(seed)
    margin = np.where(rng.random(n) < 0.02, 0.0, 10.0 ** rng.uniform(-1.5, 1.5, n))
    known, tails, inward = rng.random(n) < 0.5, rng.uniform(0, 1, n), rng.uniform(0.03, 0.5, n)
    return margin, known, tails, inward, rng.normal(0, 2, n), rng.uniform(0.3, 3.0, n)


@pytest.mark.parametrize("seed", range(5))
def test_form_of_the_law(seed):
    """Phi(ln(c m / middle) / width); blind searches ten elements from the star and without tails have their middle."""
    rng = np.random.default_rng(seed)
    law = DetectionLaw(
        blind_margin=rng.uniform(0.1, 5),
        blind_width=rng.uniform(0.05, 2),
        blind_tails=rng.normal(),
        blind_inward=rng.normal(0, 5),
        blind_visits=rng.uniform(0, 1),
        stack_margin=rng.uniform(0.1, 5),
        stack_inward=rng.normal(0, 5),
        stack_width=rng.uniform(0.05, 2),
        blind_margin_error=rng.uniform(0, 0.5),
        known_margin=rng.uniform(0.1, 5),
        known_width=rng.uniform(0.05, 2),
        known_stack_width=rng.uniform(0.05, 2),
        known_margin_error=rng.uniform(0, 0.5),
    )
    many = rng.choice([1.0, 4.0, 16.0, 300.0], 400)
    cases = (*random_cases(seed), many)
    margin, known, tails, inward, shift, calibration, _ = cases
    own = margin, known, tails, inward
    shifted = detection_probability(law, *own, visits=many, shift=shift, calibration=calibration)
    plain = detection_probability(law, *own, visits=many)
    for case, found, found_plain in zip(zip(*cases, strict=True), shifted, plain, strict=True):
        m, at_place, share, width_over_separation, errors, c, visits = case
        tails = math.exp(share / visits**law.blind_visits * law.blind_tails)
        away, alone = width_over_separation - 1 / 10, 1 / visits
        single = law.blind_margin**alone * math.exp(alone * away * law.blind_inward)
        others = law.stack_margin ** (1 - alone) * math.exp((1 - alone) * away * law.stack_inward)
        width = math.hypot(law.blind_width * alone**0.5, law.stack_width * (1 - alone) ** 0.5)
        ways = [(tails * single * others, width, law.blind_margin_error)]
        if at_place:  # photometry at the place, or the search
            width = math.hypot(law.known_width * alone**0.5, law.known_stack_width * (1 - alone) ** 0.5)
            ways.append((law.known_margin, width, law.known_margin_error))
        least = min(middle for middle, _, _ in ways)
        assert half_margin(law, at_place, share, width_over_separation, visits) == pytest.approx(least, rel=1e-12)
        for shifts, times, one in ((errors, c, found), (0.0, 1.0, found_plain)):
            reached = [
                math.erfc(-(math.log(m * times / middle) - error * shifts) / width / math.sqrt(2.0)) / 2.0
                for middle, width, error in ways
                if m > 0
            ]
            assert one == pytest.approx(max(reached, default=0.0), rel=1e-9, abs=1e-300)


@pytest.mark.parametrize(("visits", "references"), [(1, 1), (3, 3), (16, 16), (4, 12), (1, 1000), (2, 1)])
def test_effective_visits_have_the_kurtosis_of_the_difference_of_means(visits, references):
    """Of exponential variates: the fourth cumulant of one is 6, its variance 1; of n Laplace variates 3/n is left."""
    cumulants = [1.0 / visits**k + 1.0 / references**k for k in (1, 3)]
    excess = 6.0 * cumulants[1] / cumulants[0] ** 2
    assert float(effective_visits(visits, references)) == pytest.approx(3.0 / excess, rel=1e-12)
    rng = np.random.default_rng(visits)
    science, library = (rng.standard_gamma(n, 200_000) / n for n in (visits, references))
    left = science - library
    left -= left.mean()
    drawn = (left**4).mean() / (left**2).mean() ** 2 - 3.0
    assert drawn == pytest.approx(excess, rel=0.15, abs=0.05)


def test_a_law_without_numbers_knows_no_errors_tails_or_calibration():
    """Half at the threshold for everybody, with a width of 0.2."""
    law = DetectionLaw()
    margin, known, tails, inward, shift, _ = random_cases(7)
    expected = [NormalDist().cdf(math.log(m) / 0.2) if m > 0 else 0.0 for m in margin]
    found = detection_probability(law, margin, known, tails, inward, shift=shift)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-15)
    assert (law.calibration, law.calibration_error) == (1.0, 0.0)


def visits(drift, exposure_s=20.0, n_frames=900.0):
    """Return a model with this drift, separations, the length of the visit, and its noise there."""
    model = replace(MODEL, instrument=MODEL.instrument.changed({"drift": drift}))
    separation = np.array([[0.45, 0.6, 0.75]])
    place = separation / math.sqrt(2.0)
    rates = aperture_rates(model, find_target("tau Cet")[0], "F520", place, place, np.full(place.shape, 1e-8))
    noise = stack_noise(rates, exposure_s, n_frames, 400.0, model.camera("F520"))
    return model, separation, n_frames * (exposure_s + 1.1), noise


def test_light_of_errors_varies_with_the_fourth_power_of_the_offset():
    """``|dE|^2`` of an offset of the wavefront; what is left of the speckles, ``2 Re(E0* dE)``, with the square."""
    offsets, light, crossed = (0.02, 0.1, 0.5), [], []
    for offset in offsets:
        still = {"walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}
        model, separation, visit_s, noise = visits({"visit_nm": offset} | still)
        light.append(tail_share(model, "F520", separation, visit_s, noise)[0] ** 2 * noise.quiet[0])
        crossed.append(noise.terms["speckle"][0] - light[-1])
    for k, offset in enumerate(offsets):
        np.testing.assert_allclose(light[k], light[0] * (offset / offsets[0]) ** 4, rtol=1e-9)
        np.testing.assert_allclose(crossed[k], crossed[0] * (offset / offsets[0]) ** 2, rtol=1e-9)
    assert (light[0] > 0).all()


def test_chances_without_tails():
    """A still wavefront leaves no light of errors: only margin and separation decide. No visit detects nothing."""
    law = default_law()
    model, separation, visit_s, noise = visits({"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0})
    margin = np.array([[0.8, 1.4, 2.1], [0.0, 0.0, 0.0], [1.2, 0.9, 0.7]])
    found = visit_chances(model, "F520", separation, visit_s, noise, margin)
    width_arcsec = 520e-9 / 2.0 * 206264.806
    for row, column in np.ndindex(margin.shape):
        own = law.calibration * margin[row, column]
        harder = law.blind_inward * (width_arcsec / separation[0, column] - 0.1)
        blind = math.log(own / (law.blind_margin * math.exp(harder))) / law.blind_width if own else -math.inf
        known = math.log(own / law.known_margin) / law.known_width if own else -math.inf
        assert found.blind[row, column] == pytest.approx(NormalDist().cdf(blind), rel=1e-6)
        at_place = NormalDist().cdf(max(known, blind))
        assert found.known_place[row, column] == pytest.approx(at_place, rel=1e-6)


@pytest.mark.parametrize(
    ("n", "expected"), [(6, 62), (13, 10.7), (19, 7.95), (25, 6.97), (38, 6.14), (63, 5.63), (94, 5.40)]
)
def test_table_for_five_sigma(n: int, expected: float) -> None:
    digits = 0 if n == 6 else 1 if n == 13 else 2
    assert round(detection_threshold(n).unwrap(), digits) == expected


@pytest.mark.parametrize(("n", "expected"), [(6, 7.3), (13, 4.0), (25, 3.4), (94, 3.1)])
def test_table_for_three_sigma(n: int, expected: float) -> None:
    assert round(detection_threshold(n, 3.0).unwrap(), 1) == expected


@pytest.mark.parametrize("n", [3, 3.5, 4, 13, 52, 1002])
@pytest.mark.parametrize("sigma", [1.0, 5.0, 12.0, 20.0])
def test_false_alarm_probability_is_that_of_the_normal_law(n: float, sigma: float) -> None:
    threshold = detection_threshold(n, sigma).unwrap()
    with mpmath.workdps(40):
        t = mpmath.mpf(threshold) / mpmath.sqrt(1 + 1 / (mpmath.mpf(n) - 1))
        df = mpmath.mpf(n) - 2
        tail = mpmath.betainc(df / 2, mpmath.mpf(1) / 2, 0, df / (df + t * t), regularized=True) / 2
        normal = mpmath.erfc(sigma / mpmath.sqrt(2)) / 2
        assert float(tail / normal) == pytest.approx(1, rel=1e-9)


def test_many_elements_give_the_gaussian_threshold() -> None:
    assert detection_threshold(1e9).unwrap() == pytest.approx(5.0, rel=1e-7)
    thresholds = threshold_array(np.geomspace(3, 1e6, 200))
    assert (np.diff(thresholds) < 0).all()


def test_false_alarms_of_simulated_noise() -> None:
    n, trials = 7, 400_000
    values = np.random.default_rng(3).standard_normal((trials, n))
    rest = values[:, 1:]
    ratio = (values[:, 0] - rest.mean(axis=1)) / rest.std(axis=1, ddof=1)
    expected = 0.0013498980316300933  # one-sided 3 sigma
    found = np.mean(ratio > detection_threshold(n, 3.0).unwrap())
    assert abs(found - expected) < 4 * np.sqrt(expected / trials)


@pytest.mark.parametrize("n", [0, 1, 2, 2.999])
def test_too_few_elements_are_an_answer(n: float) -> None:
    outcome = detection_threshold(n)
    assert outcome.status is Status.UNREACHABLE
    assert outcome.reason is Reason.TOO_FEW_ELEMENTS
    assert outcome.value is None


def test_array_form() -> None:
    out = threshold_array([[0, 2.5], [3, 19]], 5.0)
    assert np.isinf(out[0]).all()
    assert out[1, 1] == detection_threshold(19).unwrap()
    assert threshold_array(19, [3.0, 5.0]).shape == (2,)


def test_one_number_only(refused) -> None:
    refused("threshold_array", detection_threshold, [6, 13])
