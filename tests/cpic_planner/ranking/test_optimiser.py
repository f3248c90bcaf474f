"""The best band, separation and frames against asking for each of them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import (
    build_model,
    contrast_limit,
    place_status,
    reference_contrast,
    separation_grid,
    usable_range_arcsec,
)
from cpic_planner.etc.frames import best_exposure_s
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import Change, ReferencePlanet, Strategy, changed
from cpic_planner.ranking import optimise
from cpic_planner.ranking.optimiser import Search, _Planned, best_of
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument

MODEL = build_model(load_instrument())
ONE = build_model(load_instrument(), None, Strategy(visits=1))
VISITED = build_model(load_instrument({"overhead_s": 600.0}))
_BRIGHT = rank_sample(v_mag_max=4.0)
# Arcturus has a companion 0.3 arcsec away: what it leaves to be seen lies between the places that the search looks at.
STARS = _BRIGHT.select(
    [
        i
        for i, name in enumerate(_BRIGHT.name)
        if (i % 13 == 0 or name in ("tau Cet", "alf CMi", "bet Hyi")) and name != "alf Boo"
    ]
)
BANDS = MODEL.bands


def each(question, **asked):
    """Answers by star, over all bands and separations of the grids."""
    found = {str(name): [] for name in STARS.name}
    for band in BANDS:
        for answer in question(
            MODEL, STARS, bands=[band], separation_arcsec=list(separation_grid(MODEL, band)), **asked
        ):
            if answer.value is not None:
                found[answer.target].append(answer)
    return found


def test_no_band_and_place_is_clearer():
    """Limits over the whole grid; the search looks at every fifth place first, and refines; visits chosen by both."""
    best = optimise(MODEL, STARS, time_s=7200.0)
    shown = best.contrast / best.contrast_limit
    np.testing.assert_allclose(shown, best.margin / best.needed_margin, rtol=1e-9)
    for i, answers in enumerate(each(contrast_limit, time_s=7200.0).values()):
        star = STARS.select([i])
        ratios = {}
        for answer in answers:
            place = np.array([answer.separation_arcsec])
            contrast = reference_contrast(MODEL, star, answer.band, place[None, :], ReferencePlanet())[0, 0]
            ratios[answer.band, round(answer.separation_arcsec, 9)] = contrast / answer.value
        assert shown[i] >= max(ratios.values()) * (1 - 5e-3)
        assert shown[i] <= ratios[best.band[i], round(best.separation_arcsec[i], 9)] * (1 + 5e-3)
        assert best.margin[i] == pytest.approx(best.significance[i] / best.threshold[i], rel=1e-12)
        assert best.time_s[i] <= 7200.0 * (1 + 1e-12)
        assert best.time_s[i] == best.visits[i] * best.visit_time_s[i]
        assert best.n_frames[i] == best.visits[i] * best.frames_per_visit[i]


@pytest.mark.parametrize("goal", [pytest.param({"snr": 0.5}, marks=pytest.mark.long), {"detect": True}], ids=str)
def test_no_band_and_place_is_quicker(goal):
    best = optimise(MODEL, STARS, **goal)
    answered = 0
    for i, answers in enumerate(each(exposure_time, **goal).values()):
        assert (best.n_frames[i] > 0) == bool(answers)
        if answers:
            # The least time is flat in the number of visits: twice or half the best cost 30 % at most.
            assert best.time_s[i] == pytest.approx(min(a.value for a in answers), rel=0.02)
            answered += 1
    assert answered >= (2 if "detect" in goal else 5)


def test_a_given_separation_is_the_one_of_the_etc():
    asked = {"time_s": 7200.0, "separation_arcsec": 0.6, "bands": ["F520"]}
    placed = replace(ONE, strategy=Strategy(visits=1, search="known_place"))
    best, answers = optimise(placed, STARS, **asked), signal_to_noise(ONE, STARS, **asked)
    np.testing.assert_allclose(best.separation_arcsec, 0.6)
    # The question maximises the SNR, the optimiser the chance: light of the wavefront's errors, which grows through a
    # visit, costs a search more than a significance, so that shorter visits may detect more.
    longer = np.array([answer.detection_probability_known_place for answer in answers])
    assert np.all(best.chance_known_place >= longer * (1 - 1e-4))
    assert np.all(best.significance <= np.array([answer.significance for answer in answers]) * (1 + 1e-4))
    for i in np.flatnonzero(longer > 1e-6):
        frames = {"exposure_s": best.exposure_s[i], "em_gain": best.em_gain[i], "exact": True}
        own = asked | {"time_s": best.time_s[i]}
        (answer,) = signal_to_noise(ONE, STARS.select([i]), **own, **frames)
        assert best.significance[i] == pytest.approx(answer.significance, rel=1e-6)
        assert best.chance_known_place[i] == pytest.approx(answer.detection_probability_known_place, rel=1e-4)
    outside = optimise(MODEL, STARS, time_s=7200.0, separation_arcsec=0.1, bands=["F520"])
    assert set(outside.outside) == {"inside_inner_edge"}
    assert not outside.detected.any()


@pytest.mark.parametrize("goal", [{"time_s": 36000.0}, {"detect": True}], ids=str)
def test_no_number_of_visits_is_better(goal):
    """Each number by itself, asked for: the chosen one beats them or comes within the flat top."""
    best = optimise(VISITED, STARS, bands=["F520"], **goal)
    others = [
        optimise(replace(VISITED, strategy=Strategy(visits=visits)), STARS, bands=["F520"], **goal)
        for visits in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 64, 200)
    ]
    if "detect" in goal:
        least = np.min([np.where(item.n_frames > 0, item.time_s, np.inf) for item in others], axis=0)
        there = np.isfinite(least)
        assert there.sum() >= 5
        assert np.all(best.time_s[there] <= least[there] * (1 + 5e-3))
    else:
        most = np.max([item.margin / item.needed_margin for item in others], axis=0)
        assert np.all(best.margin / best.needed_margin >= most * (1 - 2e-3))
        assert np.ptp(best.visits) > 5
    assert np.all(best.visits == np.rint(best.visits))


@pytest.mark.parametrize("visits", [None, 1, 8], ids=str)
def test_the_least_time_of_a_detection_is_one_and_no_more(visits):
    model = replace(VISITED, strategy=Strategy(visits=visits))
    best = optimise(model, STARS, bands=["F520"], detect=True)
    some = best.n_frames > 0
    assert some.sum() >= 2
    assert best.detected[some].all()
    # A relative 1e-9 of the margin, which is how exactly times are solved for, is 1.4 times as much of a chance.
    assert (best.chance_blind[some] >= 0.5 - 3e-9).all()
    # A visit of the one shortest frame cannot be shorter.
    longer = some & (best.exposure_s > model.camera("F520").exposure_min_s * (1.0 + 1e-9))
    assert longer.sum() >= 2
    np.testing.assert_allclose((best.margin / best.needed_margin)[longer], 1.0, rtol=3e-9)


def test_what_is_missing_is_enough():
    """More visits, a calmer wavefront, a brighter planet: what a row asks for detects, a little less does not."""
    one = replace(VISITED, strategy=Strategy(visits=1))
    best = optimise(one, STARS, time_s=36000.0, bands=["F520"])
    helped = np.isfinite(best.required_visits) & (best.required_drift_factor < 0.9)
    asked = np.flatnonzero(helped)
    assert len(asked) >= 2
    for i in asked[:3]:
        star, factor = STARS.select([i]), best.required_drift_factor[i]
        for part, detected in ((0.98, True), (1.03, False)):
            drift = Change.scaling("drift", float(factor * part))
            calmer = build_model(changed(VISITED.instrument, (drift,)), None, Strategy(visits=1))
            assert optimise(calmer, star, time_s=36000.0, bands=["F520"]).detected[0] == detected
        visits, place = int(best.required_visits[i]), float(best.separation_arcsec[i])
        for number, detected in ((visits, True), (visits - 1, False)):
            more = replace(VISITED, strategy=Strategy(visits=number))
            longer = {"time_s": number * best.visit_time_s[i], "separation_arcsec": place, "bands": ["F520"]}
            assert optimise(more, star, **longer).detected[0] == detected
        assert best.required_contrast_factor[i] == pytest.approx(best.needed_margin[i] / best.margin[i], rel=1e-12)
    for name in ("visits", "drift_factor", "contrast_factor"):
        assert np.all(np.isnan(getattr(best, f"required_{name}")[best.detected]))


def test_nothing_common_and_no_overhead_end_at_the_most_visits():
    free = build_model(load_instrument({"drift": {"common_fraction": 0.0, "walk_nm_per_sqrt_hour": 0.0}}))
    free = replace(free, instrument=free.instrument.changed({"overhead_s": 0.0}))
    best = optimise(free, STARS, time_s=3.6e6, bands=["F520"])
    assert best.visits.max() == 1000
    # For photometry; a search of a stack also learns its noise from the scatter of the visits.
    calm = load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}, "overhead_s": 600})
    still = optimise(build_model(calm), STARS, snr=0.5)
    assert np.all(still.n_frames > 0)
    assert np.all(still.visits == 1)


def test_more_time_never_loses_a_detection():
    """For one band and place strictly; over places to the spacing of the grid."""
    few, many = (optimise(MODEL, STARS, time_s=t, separation_arcsec=0.5).margin for t in (3000.0, 48000.0))
    assert np.all(many >= few * (1 - 1e-12))
    few, many = (optimise(MODEL, STARS, time_s=t).margin for t in (3000.0, 48000.0))
    assert np.all(many >= few * (1 - 1e-3))


@pytest.mark.parametrize("strategy", [{}, {"search": "known_place"}, {"visit_gap_h": 20.0}], ids=str)
def test_every_place_and_number_of_visits_beside_the_chosen_ones(strategy):
    """All places and all whole numbers of visits, at exact exposures, against the search of a few of them."""
    model = replace(MODEL, strategy=Strategy(**strategy))
    every, many = np.arange(len(STARS)), np.unique(np.rint(np.geomspace(1.0, 1000.0, 300)))
    for band in ("F520", "F850"):
        search = Search(model, STARS, band, ReferencePlanet())
        problem = search.places.problem("significance")
        exact_s = best_exposure_s(problem)[0]
        whole = search.places.outlook(replace(problem, best_s=exact_s))
        assert np.median(search.rough.white / whole.white) < 1 + 1e-4
        assert np.max(search.rough.white / whole.white) < 1.03
        for time_s in (7200.0, 360000.0):
            cost, visits, length_s = whole.in_time(time_s, many)
            least = cost.min(axis=1)
            rough = search.rough
            chosen = search.lowest(rough, rough.in_time(time_s), lambda item, n, t=time_s: item.in_time(t, n))
            assert np.all(chosen[1][0][:, 0] <= least * (1 + 1e-3))
            best = np.argmin(cost, axis=1)
            assert np.ptp(visits[every, best]) > 0
            assert np.all(length_s[every, best] > 0.0)
        least_s = whole.for_level(many)[0].min(axis=1)
        programme = search.least_programmes(every)
        found_s = np.where(programme[2].n_frames > 0, programme[3].visits * model.time_s(programme[2].visit_s), np.inf)
        some = np.isfinite(least_s)
        assert np.array_equal(some, np.isfinite(found_s[:, 0]))
        # Whole frames take longer than frames that need not be whole, where visits are of few.
        assert np.all(found_s[some, 0] <= least_s[some] * (1 + 5e-3))


@pytest.mark.parametrize("band", BANDS)
def test_places_hold_an_aperture_and_a_background(band):
    grid, metrics = separation_grid(MODEL, band), MODEL.metrics[band]
    low, high = usable_range_arcsec(MODEL.instrument, band)
    assert low * (1 - 1e-9) <= grid[0] < grid[-1] <= high * (1 + 1e-9)
    assert np.all(np.diff(grid) > 0)
    assert np.all(metrics.resolution_elements(grid) >= 3)


@pytest.mark.parametrize("scheme", ["interleaved", "half", "swapped", "other_star"])
def test_visits_are_chosen_for_the_scheme_of_references(scheme):
    """What the orbit moves averages in one scheme and stays in another: the choice is that of one star's question."""
    instrument = load_instrument({"drift": {"visit_nm": 0.02, "orbital_nm": 3.0}})
    model = build_model(instrument, ["F520"], Strategy(reference_scheme=scheme))
    stars = STARS.select(np.isin(STARS.name, ["tau Cet", "alf CMi", "bet Hyi"]))
    best = optimise(model, stars, time_s=36000.0)
    assert best.visits.min() > 1
    for i in range(len(stars)):
        one, place = stars.select([i]), [best.separation_arcsec[i]]
        asked = {"bands": ["F520"], "separation_arcsec": place, "time_s": 36000.0}
        assert best.contrast_limit[i] == pytest.approx(contrast_limit(model, one, **asked)[0].value, rel=5e-3)


@pytest.mark.long
def test_what_no_programme_can_pass():
    """The bound holds for every time, and where it decides it is reached by one."""
    for model, times in ((ONE, (1e4, 4e4, 1e6)), (MODEL, (1e5, 1e8))):
        best = optimise(model, STARS, time_s=3000.0)
        floor = best.floor_margin / best.needed_margin
        found = [optimise(model, STARS, time_s=time_s) for time_s in times]
        most = np.max([item.margin / item.needed_margin for item in found], axis=0)
        assert np.all(most <= floor * 1.05)
        # A blind search goes through ever more orbits: the bound is that of planets that are followed.
        followed = replace(model, strategy=model.strategy.model_copy(update={"search": "known_place"}))
        best, *found = (optimise(followed, STARS, time_s=time_s) for time_s in (3000.0, *times))
        most = np.max([item.margin / item.needed_margin for item in found], axis=0)
        assert np.median(most / (best.floor_margin / best.needed_margin)) > 0.9
    still = build_model(load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}))
    assert np.all(optimise(still, STARS, time_s=3000.0).floor_margin > 1.0)


def test_extrapolated_bands_win_only_alone():
    one = optimise(MODEL, STARS, time_s=3000.0, bands=["F520"])
    other = replace(
        one, band=np.full(len(STARS), "other"), margin=one.margin * 2, extrapolated=np.ones(len(STARS), bool)
    )
    assert set(best_of([other, one]).band) == {"F520"}
    assert set(best_of([other, replace(one, n_frames=0.0 * one.n_frames)]).band) == {"other"}
    assert set(best_of([replace(one, band=np.full(len(STARS), "first")), one]).band) == {"first"}


@pytest.mark.parametrize(
    "strategy", [{"mode": "photon_counting"}, {"library": "roll"}, {"library": "idealised"}], ids=str
)
def test_other_strategies_have_answers(strategy):
    best = optimise(build_model(load_instrument(), None, Strategy(**strategy)), STARS, time_s=7200.0)
    assert np.all(best.n_frames >= 1)
    assert np.all(np.isfinite(best.margin))
    assert np.all(best.margin > 0)


def test_goals_are_one_and_in_range(refused):
    for goal in ({}, {"time_s": 1.0, "snr": 5.0}, {"snr": 5.0, "detect": True}):
        refused("one of time_s, snr, detect", optimise, MODEL, STARS, **goal)
    for goal in (
        {"time_s": 0.0},
        {"time_s": np.nan},
        {"snr": -1.0},
        {"snr": np.inf},
        {"snr": 5.0, "bands": ["F999"]},
        {"snr": 5.0, "separation_arcsec": np.nan},
    ):
        refused("", optimise, MODEL, STARS, **goal)


def test_rolled_planets_stay_in_the_zone_and_no_place_is_refused(refused):
    roll = build_model(load_instrument(), ["F520"], Strategy(library="roll"))
    assert all(place_status(roll, "F520", float(place))[0] == "ok" for place in separation_grid(roll, "F520"))
    assert len(separation_grid(roll, "F520")) < len(separation_grid(MODEL, "F520"))
    for strategy in (Strategy(library="roll", roll_deg=2.0), Strategy(annulus_lambda_d=0.01)):
        refused("band = F520", optimise, build_model(load_instrument(), ["F520"], strategy), STARS, time_s=3600.0)


def test_a_star_has_the_least_time_that_it_has_alone(monkeypatch):
    """Rounds of the search go on for the stars that still change, which changes nothing for any of them."""
    rounds, closer_s = [], _Planned.closer_s

    def counted(planned, visits, length_s):
        rounds.append(len(length_s))
        return closer_s(planned, visits, length_s)

    monkeypatch.setattr(_Planned, "closer_s", counted)
    together = optimise(MODEL, STARS, detect=True)
    assert np.mean(np.array(rounds) < len(STARS)) > 0.3
    for star in range(0, len(STARS), 3):
        alone = optimise(MODEL, STARS.select([star]), detect=True)
        assert alone.time_s[0] == pytest.approx(together.time_s[star], rel=1e-12)
        assert alone.visits[0] == together.visits[star]


@pytest.mark.parametrize("correlation_time_h", [1.0, 20.0])
def test_visits_that_remember_each_other_are_the_shortest_that_detect(correlation_time_h):
    """Every length on a fine grid, planned with its own gap: longer visits are farther apart, and remember less."""
    model = build_model(load_instrument({"drift": {"correlation_time_h": correlation_time_h}}), ["F520"])
    stars = _BRIGHT.select(np.arange(len(_BRIGHT)) % 8 == 0)
    outlook = Search(model, stars, "F520", ReferencePlanet()).coarse(np.arange(len(stars)))
    visits, step = np.array([1.0, 2.0, 5.0, 13.0, 34.0, 100.0, 1000.0]), 1.02
    shape = np.broadcast_shapes(outlook.white.shape, visits.shape)
    shortest = np.where(visits > 1.0, outlook.shortest_s, 0.0)
    expected = np.full(shape, np.inf)
    for length_s in step ** np.arange(math.log(1e8) / math.log(step))[::-1]:
        reached = outlook.cost(visits, np.full(shape, length_s)) <= 1.0
        expected = np.where(reached & (length_s >= shortest), length_s, expected)
    found = outlook._shortest_visit_s(visits, 1e-10)
    some = np.isfinite(expected)
    assert np.count_nonzero(some) > 20
    assert np.array_equal(some, np.isfinite(found))
    assert np.all(found[some] <= expected[some])
    assert np.all(found[some] > expected[some] / step * (1 - 1e-9))
    least = np.where(some, visits * model.time_s(found), np.inf).min(axis=-1)
    np.testing.assert_allclose(outlook.for_level(visits)[0], least, rtol=1e-12)


def test_the_least_time_of_visits_that_remember_each_other_detects():
    """The limiting contrast of one star in that time is no brighter, also where shorter visits would be too close."""
    instrument = load_instrument({"drift": {"correlation_time_h": 6.0}})
    best = optimise(build_model(instrument, ["F520"]), STARS, detect=True)
    some = np.flatnonzero(best.n_frames > 0)
    assert np.any(best.visits[some] > 1)
    for i in some:
        model = build_model(instrument, ["F520"], Strategy(visits=int(best.visits[i])))
        asked = {"separation_arcsec": [best.separation_arcsec[i]], "time_s": float(best.time_s[i]) * (1 + 1e-9)}
        limit = contrast_limit(model, STARS.select([i]), bands=["F520"], **asked)[0].value
        assert best.contrast[i] >= limit * (1 - 1e-6)
