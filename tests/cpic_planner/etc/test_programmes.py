"""Programmes of visits against sums by hand, closed forms, and every number of visits and length on a grid."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cpic_core import InputError
from cpic_planner.etc import (
    Programme,
    Span,
    build_model,
    cases_of as cases_in,
    light_share,
    lit_share,
    questions,
    speckled_share,
    stack_noise,
)
from cpic_planner.etc.frames import best_in_visit, least_time
from cpic_planner.etc.rates import planets_of
from cpic_planner.planets import star_masses_msun
from cpic_planner.queries import MAX_VISITS, Strategy
from cpic_planner.targets import find_target
from simulator.config import load_instrument
from tests.programme_motion import programme_motion

STARS = {name: find_target(name)[0] for name in ("tau Cet", "eps Ind", "bet Hyi")}
BANDS = ("F520", "F850")


def model_of(drift=None, overhead_s=600.0, **strategy):
    instrument = load_instrument({"overhead_s": overhead_s, "drift": drift or {}})
    return build_model(instrument, BANDS, Strategy(**strategy))


def cases_of(model, star="tau Cet", band="F520", contrast=3e-9, place=0.55):
    return cases_in(model, STARS[star], [band], planets_of(place, None, contrast))


def seen(model, cases, visits, frames=(60.0, 20.0, 300.0)):
    programme = Programme.of(model.strategy, visits)
    return stack_noise(cases.rates, *frames, model.camera(cases.bands[0]), model.strategy, programme)


CALM = {"common_fraction": 0.0, "orbital_nm": 0.0}


@pytest.mark.parametrize("visits", [1, 4, 16])
@pytest.mark.parametrize("common", [0.0, 0.5])
def test_noise_is_that_of_visits_summed_by_hand(visits, common):
    """Means of V visits less means of V references: signal V times, white noise and offsets by variance, rest as is."""
    model = model_of({"common_fraction": common, "orbital_nm": 0.0})
    cases = cases_of(model)
    one, all_of_them = seen(model, cases, 1), seen(model, cases, visits)
    np.testing.assert_allclose(all_of_them.signal_e, visits * one.signal_e, rtol=1e-14)
    np.testing.assert_allclose(all_of_them.white, visits * one.white, rtol=1e-12)
    for name, power in (("speckle", 1), ("common_speckle", 2), ("halo", 1), ("reference", 1), ("planet", 1)):
        np.testing.assert_allclose(all_of_them.terms[name], visits**power * one.terms[name], rtol=1e-12)
    if common == 0.0:
        np.testing.assert_allclose(all_of_them.snr, math.sqrt(visits) * one.snr, rtol=1e-12)
        assert not all_of_them.terms["common_speckle"].any()


@pytest.mark.parametrize("references", [1, 3, 400])
def test_few_references_and_many(references):
    """Each visit and each reference visit bring half of a pair's offset; a reference visit lasts V / R as long."""
    still = {"walk_nm_per_sqrt_hour": 0.0} | CALM
    pair = seen(model_of(still), cases_of(model_of(still)), 1).terms["speckle"]
    model = model_of(still, reference_visits=references)
    found = seen(model, cases_of(model), 5).terms["speckle"] / 25.0
    np.testing.assert_allclose(found, pair * (1.0 / 5.0 + 1.0 / references) / 2.0, rtol=1e-12)


def test_an_archive_takes_no_time_and_has_the_noise_of_its_visits():
    model, plain = (model_of(CALM, library=name) for name in ("archive", "same_star_planet_free"))
    cases = cases_of(model)
    assert float(plain.time_s(1000.0)) == 2600.0
    assert float(model.time_s(1000.0)) == 1600.0
    few, many = (seen(plain, cases_of(plain), 4), seen(model, cases, 4))
    np.testing.assert_allclose(many.terms["halo"], few.terms["halo"], rtol=1e-12)
    np.testing.assert_allclose(many.terms["reference"], few.terms["reference"] * 4.0 / 100.0, rtol=1e-12)
    np.testing.assert_allclose(many.terms["speckle"], few.terms["speckle"] * (1 / 4 + 1 / 100) / (1 / 2), rtol=1e-12)


def test_correlated_visits_average_less():
    quick, slow, free = (
        questions.signal_to_noise(model_of(drift, visits=16, visit_gap_h=gap), STARS["tau Cet"], **ASKED)[0].value
        for drift, gap in (({"correlation_time_h": 20.0}, 0.0), ({"correlation_time_h": 20.0}, 48.0), ({}, 0.0))
    )
    assert quick < 0.8 * slow < 0.8 * free * (1.0 + 1e-9)


ASKED = {"time_s": 36000.0, "separation_arcsec": 0.55, "bands": ["F520"], "contrast": 3e-9}


EVERY = np.unique(np.concatenate([np.arange(1, 30), np.geomspace(30, MAX_VISITS, 30).round()])).reshape(-1, 1, 1, 1)


def brute_in_time(model, cases, time_s, objective, level=lambda *_: lambda *_: 1.0):
    """Least ``(level / SNR)^2`` over many numbers of visits and lengths of them."""
    programme = Programme.of(model.strategy, EVERY, time_s / EVERY)
    problem, best = cases.problem(objective, programme=programme), math.inf
    longest = np.broadcast_to(model.visit_s(time_s / EVERY), problem.signal_e_s.shape)
    for part in (1.0, 0.98, 0.9, 0.7, 0.4):
        choice = best_in_visit(problem, longest * part, quickest=False)
        wanted = level(programme, problem)(choice.visit_s, choice.inverse_snr2)
        best = min(best, float(np.min(np.where(choice.n_frames >= 1, choice.inverse_snr2 * wanted**2, np.inf))))
    return best


@pytest.mark.parametrize("star", STARS)
@pytest.mark.parametrize("overhead_s", [60.0, 3600.0])
def test_no_programme_reaches_more_in_the_time(star, overhead_s):
    model = model_of(overhead_s=overhead_s)
    answer = questions.signal_to_noise(model, STARS[star], **ASKED)[0]
    best = brute_in_time(model, cases_of(model, star), 36000.0, "snr") ** -0.5
    assert best * (1.0 - 2e-3) <= answer.value <= best * (1.0 + 2e-3)
    assert answer.time_s == answer.visits * answer.visit_time_s <= 36000.0 * (1.0 + 1e-12)
    assert answer.n_frames == answer.visits * answer.frames_per_visit


@pytest.mark.parametrize("search", ["blind", "known_place"])
def test_no_programme_has_a_fainter_limit(search):
    model = model_of(search=search)
    cases = cases_of(model)
    wanted = cases.searched.level
    asked = {name: value for name, value in ASKED.items() if name != "contrast"}
    answer = questions.contrast_limit(model, STARS["tau Cet"], **asked)[0]
    missed = brute_in_time(model, cases, 36000.0, "significance", wanted)
    assert answer.value == pytest.approx(3e-9 * missed**0.5, rel=5e-3)


@pytest.mark.parametrize("star", STARS)
@pytest.mark.parametrize("level", [{"snr": 6.0}, {"sigma": 4.0}, {"detect": True}])
def test_no_programme_is_quicker(star, level):
    """Every number of visits, each at the least time for the level, which a blind search makes depend on the visits."""
    model = model_of()
    asked = {name: value for name, value in ASKED.items() if name != "time_s"}
    answer = questions.exposure_time(model, STARS[star], **level, **asked)[0]
    objective = "snr" if "snr" in level else "significance"
    cases = cases_of(model, star)
    searched = replace(cases, value=level.get("snr", level.get("sigma")))
    programme = Programme.of(model.strategy, EVERY)
    problem = cases.problem(objective, programme=programme)
    aim = np.array(searched.level_at(programme)(np.zeros(EVERY.shape), np.ones(EVERY.shape)))
    for _ in range(25 if "detect" in level else 1):
        choice = least_time(problem, np.broadcast_to(aim, problem.signal_e_s.shape))
        some = choice.n_frames >= 1
        visit, inverse = np.where(some, choice.visit_s, 1.0), np.where(some, choice.inverse_snr2, np.inf)
        aim = np.where(some, searched.level(programme, problem)(visit, inverse), aim)
    best = float(np.min(np.where(some, EVERY * model.time_s(visit), np.inf)))
    assert best * (1.0 - 0.01) <= answer.value <= best * (1.0 + 0.01)


def test_the_closed_optimum_of_a_visit():
    """Without a walk the best visit takes ``sqrt(c o / 2 z)`` on the star: the valley is flat, its time within 2 %."""
    model = model_of({"walk_nm_per_sqrt_hour": 0.0} | CALM)
    cases, level = cases_of(model, contrast=1e-9), 6.0
    asked = cases_in(model, STARS["tau Cet"], ["F520"], cases.planets, objective="significance", value=level)
    one = cases.problem("significance", programme=Programme())
    visit_s = np.full((1, 1), 600.0)
    cost = float((best_in_visit(one, visit_s).inverse_snr2 - one.z0)[0, 0, 0]) * 600.0
    residual = float(one.z0[0, 0, 0])
    least_s = level**2 * (math.sqrt(2.0 * cost) + math.sqrt(residual * 600.0)) ** 2
    answer = questions.exposure_time(
        model, STARS["tau Cet"], sigma=level, separation_arcsec=0.55, bands=["F520"], contrast=1e-9
    )
    assert answer[0].value == pytest.approx(least_s, rel=0.02)
    assert answer[0].visits == pytest.approx(level**2 * (residual + cost / math.sqrt(cost * 300.0 / residual)), rel=0.3)
    assert float(asked.quickest()[0][0, 0, 0]) == pytest.approx(answer[0].visits, abs=1.0)


FOR_VISITS = {"separation_arcsec": 0.55, "bands": ["F520"], "contrast": 3e-9}


@pytest.mark.parametrize("visits", [1, 3, 30])
@pytest.mark.parametrize("search", ["blind", "known_place"])
@pytest.mark.parametrize("band", BANDS)
def test_limit_and_time_are_inverses(visits, search, band):
    """Time for a detection of the limit of a time, to 1e-6; the level of a blind search depends on both."""
    model = model_of(visits=visits, search=search)
    place = {"separation_arcsec": 0.55, "bands": [band]}
    limit = questions.contrast_limit(model, STARS["tau Cet"], time_s=36000.0, **place)[0]
    again = questions.exposure_time(model, STARS["tau Cet"], detect=True, contrast=limit.value, **place)[0]
    assert again.value == pytest.approx(limit.time_s, rel=1e-6)
    assert again.level == pytest.approx(limit.level, rel=1e-6)
    assert again.significance == pytest.approx(again.level, rel=1e-6)
    assert (again.verdict, again.verdict_mode) == ("detected", search)
    chance = again.detection_probability if search == "blind" else again.detection_probability_known_place
    assert chance == pytest.approx(0.5, abs=1e-6)


def test_shares_are_those_of_the_law_of_detection():
    model = model_of()
    cases = cases_of(model)
    searched, programme = cases.searched, Programme.of(model.strategy, 4.0)
    noise = seen(model, cases, 4.0)
    visit = np.full((1, 1), 20.0 * (60.0 + model.camera("F520").readout_s))
    problem = cases.problem("significance", programme=programme)
    light = light_share(model, "F520", np.hypot(cases.x_arcsec, cases.y_arcsec), visit)
    there = searched.level(programme, problem)(visit, noise.significance**-2.0)
    expected = searched.level_at(programme)(speckled_share(noise), visit, lit_share(noise, light))
    np.testing.assert_allclose(there, expected, rtol=1e-9)


def test_fewest_visits_of_a_length_reach_the_level_and_one_less_does_not():
    asked = FOR_VISITS | {"visit_time_s": 2400.0}
    star, level = STARS["eps Ind"], 7.0
    answer = questions.exposure_time(model_of(), star, snr=level, **asked)[0]
    assert answer.snr >= level * (1.0 - 1e-9)
    less = questions.signal_to_noise(model_of(visits=answer.visits - 1), star, **asked)[0]
    assert less.value < level


def test_what_is_required_is_enough_and_no_more():
    """Each of the four alone makes the planet detected; a hair less does not."""
    star, asked = STARS["eps Ind"], FOR_VISITS | {"contrast": 1e-9}
    (lost,) = questions.signal_to_noise(model_of(visits=4), star, visit_time_s=3600.0, **asked)
    assert (lost.verdict, lost.verdict_mode) == ("measured_not_detected", "blind")

    def verdict(visits=4, drift=None, visit_time_s=3600.0, contrast=1e-9):
        given = asked | {"contrast": contrast, "visit_time_s": visit_time_s, "exact": True}
        frames = {"exposure_s": lost.exposure_s, "em_gain": lost.em_gain}
        return questions.signal_to_noise(model_of(drift, visits=visits), star, **given, **frames)[0].verdict

    assert verdict(visits=lost.required_visits) == "detected" != verdict(visits=lost.required_visits - 1)
    brighter = lost.required_contrast_factor * lost.contrast
    assert verdict(contrast=brighter * 1.001) == "detected" != verdict(contrast=brighter * 0.999)
    plain = load_instrument().drift
    for factor, expected in ((0.99, "detected"), (1.01, "measured_not_detected")):
        names = ("visit_nm", "walk_nm_per_sqrt_hour", "orbital_nm")
        calm = {name: getattr(plain, name) * factor * (lost.required_drift_factor or 0.0) for name in names}
        if lost.required_drift_factor is not None:
            assert verdict(drift=calm) == expected
    if lost.required_time_s is not None:
        longer = lost.required_time_s / 4.0
        free = asked | {"contrast": 1e-9, "exact": True}
        found = questions.signal_to_noise(model_of(visits=4), star, visit_time_s=longer * 1.02, **free)[0]
        assert found.verdict == "detected"


def test_a_common_floor_that_no_number_of_visits_beats():
    model = model_of({"visit_nm": 1.0, "common_fraction": 0.5})
    (answer,) = questions.exposure_time(model, STARS["tau Cet"], detect=True, **FOR_VISITS)
    assert (answer.status, answer.reason) == ("unreachable", "common_speckle_floor")
    assert (answer.limited_by, answer.verdict) == ("common_speckles", "unreachable")
    assert "however many visits" in answer.message
    one = questions.exposure_time(model_of({"visit_nm": 0.3} | CALM, visits=1), STARS["tau Cet"], snr=20, **FOR_VISITS)
    assert (one[0].reason, one[0].limited_by) == ("speckle_floor", "speckles")
    assert "in one visit" in one[0].message


@pytest.mark.parametrize(
    ("drift", "overhead_s"),
    [({"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}, 600.0), ({}, 1e5 / 3.0)],
)
def test_one_visit_wins_where_nothing_speaks_for_more(drift, overhead_s):
    """A wavefront that does not drift, or an overhead that takes most of the time."""
    answer = questions.signal_to_noise(model_of(drift, overhead_s=overhead_s), STARS["tau Cet"], **ASKED)[0]
    assert answer.visits == 1
    assert "visits_at_limit" not in answer.flags


def test_without_overhead_visits_are_as_short_as_they_can_be():
    (answer,) = questions.signal_to_noise(model_of(overhead_s=0.0), STARS["tau Cet"], **ASKED)
    assert "visits_at_limit" in answer.flags
    assert answer.visits == MAX_VISITS or answer.frames_per_visit == 1
    fixed = questions.signal_to_noise(model_of(overhead_s=0.0, visits=MAX_VISITS), STARS["tau Cet"], **ASKED)[0]
    assert fixed.status == "ok"
    assert fixed.value <= answer.value * (1.0 + 1e-3)


@pytest.mark.parametrize("visits", [None, 4])
@pytest.mark.parametrize(
    ("time_s", "visit_time_s", "expected"),
    [(36000.0, 9000.0, (4, 9000.0, 36000.0)), (None, 9000.0, (4, 9000.0, 36000.0)), (36000.0, None, None)],
)
def test_times_of_a_programme(visits, time_s, visit_time_s, expected):
    model = model_of(visits=visits)
    if visits is None and time_s is None:
        with pytest.raises(InputError, match="visits"):
            Span.of(model, time_s, visit_time_s)
        return
    span = Span.of(model, time_s, visit_time_s)
    expected = expected or (visits, None if visits is None else 9000.0, 36000.0)
    assert (span.visits, span.visit_time_s, span.time_s) == expected


@pytest.mark.parametrize(
    ("visits", "time_s", "visit_time_s", "asked", "key"),
    [
        (4, 36000.0, 8000.0, False, "time_s"),
        (None, 3600.0, 8000.0, False, "visit_time_s"),
        (None, None, None, False, "time_s"),
        (4, None, 8000.0, True, "visit_time_s"),
        (None, 0.0, None, False, "time_s"),
    ],
)
def test_times_that_contradict_each_other_are_refused(visits, time_s, visit_time_s, asked, key):
    with pytest.raises(InputError, match=key):
        Span.of(model_of(visits=visits), time_s, visit_time_s, asked=asked)


@pytest.mark.parametrize("given", [{"visits": 0}, {"visits": 1001}, {"reference_visits": 0}, {"visit_gap_h": -1.0}])
def test_programmes_out_of_range_are_refused(given):
    with pytest.raises(ValueError, match=next(iter(given))):
        Strategy(**given)


def test_bands_solved_together_are_those_solved_alone():
    model = model_of()
    star, asked = STARS["eps Ind"], FOR_VISITS | {"bands": None}
    both = questions.exposure_time(model, star, detect=True, **asked)
    for answer in both:
        (alone,) = questions.exposure_time(model, star, detect=True, **asked | {"bands": [answer.band]})
        assert (alone.visits, alone.value) == (answer.visits, pytest.approx(answer.value, rel=1e-8))


def test_limits_of_bands_solved_together_are_those_solved_alone():
    """A band whose search is served best by short visits does not shorten those of another one."""
    model, asked = model_of(visits=4), {"time_s": 36000.0, "separation_arcsec": 0.55}
    both = questions.contrast_limit(model, STARS["tau Cet"], **asked)
    for answer in both:
        (alone,) = questions.contrast_limit(model, STARS["tau Cet"], bands=[answer.band], **asked)
        assert alone.value == pytest.approx(answer.value, rel=1e-9)
    short, long = (("shorter_visit_is_better" in answer.flags) for answer in both)
    assert short
    assert not long


def test_a_case_of_a_programme_is_itself():
    cases = cases_of(model_of(visits=9))
    assert float(cases.programme.visits) == 9.0
    plain = replace(cases, programme=Programme())
    assert not np.allclose(plain.problem("snr").z0, cases.problem("snr").z0)


@pytest.mark.parametrize("gap_h", [0.0, 72.0])
def test_a_blind_search_pays_for_the_orbits_of_its_span_and_a_known_place_for_none(gap_h):
    asked = {"separation_arcsec": 0.55, "bands": ["F520"], "contrast": 3e-9, "detect": True}
    blind, known, packed = (
        questions.exposure_time(model_of(visits=16, visit_gap_h=gap, search=search), STARS["tau Cet"], **asked)[0]
        for gap, search in ((gap_h, "blind"), (gap_h, "known_place"), (0.0, "blind"))
    )
    star = STARS["tau Cet"]
    mass = star_masses_msun(star.name.tolist(), star.log_g, star.luminosity_lsun, star.teff_k)
    width = model_of().metrics["F520"].lambda_d_arcsec
    moves = programme_motion(0.55, star.distance_pc, mass, width, blind.time_s, 16, gap_h=gap_h)
    assert blind.span_days == pytest.approx(float(moves.span_days[0]), rel=1e-12)
    assert blind.span_days == pytest.approx((blind.time_s / 0.46 + 15 * 3600.0 * gap_h) / 86400.0, rel=1e-12)
    assert blind.orbits_searched == moves.n_orbits
    assert blind.motion_factor == pytest.approx(float(moves.sigma[0] / 5.0 / moves.kept[0]), rel=1e-5)
    assert blind.level / blind.motion_factor == pytest.approx(packed.level / packed.motion_factor, rel=2e-2)
    assert (blind.motion_factor > 1.1) == (blind.orbits_searched > 1) == (gap_h > 0.0)
    assert (known.orbits_searched, known.motion_factor) == (None, 1.0)
    assert known.time_s < blind.time_s


def test_motion_is_what_forbids_a_programme_of_years():
    """64 visits of alpha Cen B, ten days between them: the orbit is far from straight, one visit would be enough."""
    star = find_target("alf Cen B")[0]
    asked = {"separation_arcsec": 0.6, "bands": ["F520"]}
    found = {
        (visits, search): questions.exposure_time(
            model_of(visits=visits, visit_gap_h=240.0, search=search), star, detect=True, **asked
        )[0]
        for visits, search in ((4, "blind"), (64, "blind"), (64, "known_place"))
    }
    assert [answer.status.value for answer in found.values()] == ["ok", "unreachable", "ok"]
    lost = found[64, "blind"]
    assert (lost.reason.value, lost.limited_by, lost.verdict) == ("planet_moves", "motion", "unreachable")
    assert "stood still" in lost.message
    seen = questions.signal_to_noise(model_of(visits=64, visit_gap_h=240.0), star, time_s=1e5, **asked)[0]
    assert (seen.verdict, seen.limited_by) == ("measured_not_detected", "motion")
    assert seen.detection_probability < 0.5 < seen.detection_probability_known_place


def test_visits_that_follow_each_other_at_once_are_fewer_independent_ones():
    """Of 8 visits with a correlation time: the variance of the mean of an exponential process, summed by hand."""
    for gap_h in (0.0, 5.0):
        model = model_of({"correlation_time_h": 6.0}, visits=8, visit_gap_h=gap_h)
        answer = questions.signal_to_noise(model, STARS["tau Cet"], time_s=8 * 3600.0, **FOR_VISITS)[0]
        gap = answer.visit_time_s / 3600.0 + gap_h
        lags = np.abs(np.subtract.outer(np.arange(8), np.arange(8))) * gap
        assert answer.independent_visits == pytest.approx(1.0 / np.exp(-lags / 6.0).mean(), rel=2e-3)
    free = questions.signal_to_noise(model_of(visits=8), STARS["tau Cet"], time_s=8 * 3600.0, **FOR_VISITS)[0]
    assert free.independent_visits == 8.0


@pytest.mark.parametrize("tau_h", [1.0, 20.0])
def test_visits_that_remember_each_other_are_planned_with_their_own_gaps(tau_h):
    """The limiting contrast of a time is reached in it, and by brute force not sooner, in however many visits."""
    model, place = model_of({"correlation_time_h": tau_h}), {"separation_arcsec": 0.6, "bands": ["F520"]}
    limit = questions.contrast_limit(model, STARS["tau Cet"], time_s=36000.0, **place)[0]
    given = place | {"contrast": limit.value * (1.0 + 1e-7)}
    found = questions.exposure_time(model, STARS["tau Cet"], detect=True, **given)[0]
    assert found.time_s <= 36000.0 * (1.0 + 1e-6)
    for visits in (*range(1, 40, 7), found.visits):
        for share in np.geomspace(0.2, 0.995, 8):
            tried = model_of({"correlation_time_h": tau_h}, visits=int(visits))
            answer = questions.signal_to_noise(tried, STARS["tau Cet"], time_s=share * found.time_s, **given)[0]
            assert answer.verdict != "detected", (visits, share)
