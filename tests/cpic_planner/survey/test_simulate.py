"""Universes played: what is found, what it costs, second looks, follow-up and chaos."""

import importlib.util
import sys
import time
from collections import Counter, defaultdict
from dataclasses import replace
from math import factorial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import cpic_planner.survey.simulate as module
from cpic_planner.planets import draw_population, load_population
from cpic_planner.ranking.completeness import completeness
from cpic_planner.survey.candidates import N_DRAWS
from cpic_planner.survey.detection import expected_signals
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.tables import TABLES
from cpic_planner.survey.universe import BLOCK, NEW, draw_planet_sample, star_mass_msun
from simulator.config import deep_merge
from simulator.target import sky_to_detector

KEYS = ("universe", "star", "planet")


def found(played, *, star=None):
    """Detections as a set of keys."""
    d = played.detections
    return {key for key in zip(*(d[name].tolist() for name in KEYS), strict=True) if star in (None, key[1])}


def planets_of(played):
    return played.universes["new_planets"] + played.universes["known_planets"]


def denser(survey, rate):
    """The survey with another occurrence rate."""
    population = survey.strategy.population.model_copy(update={"planets_per_star": rate})
    return replace(survey, strategy=survey.strategy.model_copy(update={"population": population}))


def star_number(survey, name):
    return list(survey.targets.name).index(name)


def first_visit(survey, only_visits, name):
    number = star_number(survey, name)
    return only_visits(survey, lambda visit: visit.star == number and visit.ordinal == 0)


@pytest.mark.parametrize("name", ["eps Eri", "alf Cen A"])
def test_one_visit_finds_the_planets_whose_significance_is_enough(sharp, only_visits, name):
    survey = denser(first_visit(sharp.surveys[0], only_visits, name), 2.0)
    n, i, visit = 2000, star_number(survey, name), survey.schedule.visits[0]
    star, population = survey.targets.select([i]), survey.strategy.population
    played = simulate_survey(survey, block=3, n=n, seed=5)
    bodies = draw_planet_sample(
        name,
        float(star_mass_msun(star)[0]),
        float(star.luminosity_lsun[0]),
        population,
        epoch_mjd=survey.calendar.start_mjd,
        n=n,
        seed=5,
        block=3,
    )
    place = bodies.places([survey.calendar.day[i, visit.slot]])
    drawn = draw_population(population, 1, 1)
    way = survey.options[i][visit.option]
    seen = expected_signals(survey.model, star, way, bodies, drawn.albedos, place, [0.0])
    assert int(played.universes["new_planets"].sum()) == np.count_nonzero(seen.margin >= 1.0) > 20
    assert not played.universes["known_planets"].any()


@pytest.mark.parametrize("name", ["eps Eri", "tau Cet", "alf Cen A"])
def test_the_yield_of_one_visit_is_completeness_times_planets_per_star(sharp, only_visits, change, name):
    rate = 3.0
    survey = denser(first_visit(sharp.surveys[0], only_visits, name), rate)
    sure = {"calibration": 1.0, "calibration_error": 0.0, "half_error": 0.0}
    survey = change(survey, detection={"rule": "blind"} | sure)
    star = survey.targets.select([star_number(survey, name)])
    way = survey.options[star_number(survey, name)][survey.schedule.visits[0].option]
    drawn = draw_population(load_population("giants"), 100_000, 3)
    counted = completeness(
        survey.model, star, way.band, drawn, exposure_s=way.exposure_s, n_frames=way.n_frames, em_gain=way.em_gain
    )
    yields = simulate_survey(survey, block=0, n=10_000, seed=2).universes["new_planets"]
    error = np.hypot(yields.std() / 100.0, rate * counted.standard_error[0])
    assert abs(yields.mean() - rate * counted.completeness[0]) < 4.0 * error


@pytest.mark.long
def test_visits_of_a_star_against_brute_force_to_a_percent(sharp, only_visits, brute_force, record_property):
    name = "eps Eri"
    survey = sharp.surveys[0]
    i = star_number(survey, name)
    survey = denser(only_visits(survey, lambda visit: visit.star == i), 40.0)
    star = survey.targets.select([i])
    days = [survey.calendar.day[i, visit.slot] for visit in survey.schedule.visits]
    assert len(days) == 4
    (way,) = {survey.options[i][visit.option] for visit in survey.schedule.visits}
    mass, n = float(star_mass_msun(star)[0]), 400_000
    first, ever = brute_force.detected(survey.model, star, way, mass, days, n, seed=8)
    once = only_visits(survey, lambda visit: visit.ordinal == 0)
    for count, one in ((ever, survey), (first, once)):
        planets = simulate_survey(one, block=0, n=7_500, seed=4).universes["new_planets"].sum()
        share, expected = planets / (7_500 * 40.0), count / n
        # Errors of counting: half a percent of all visits together, more of the first alone.
        error = np.hypot(np.sqrt(share / (7_500 * 40.0)), np.sqrt(expected / n))
        assert abs(share - expected) < 4.0 * error
        if one is survey:
            assert error < 0.0065 * expected
            record_property("share of planets over that of brute force", f"{share / expected:.4f}")
            assert share == pytest.approx(expected, rel=0.01)


def test_the_schedule_promises_what_the_survey_finds(sharp):
    survey = sharp.surveys[0]
    yields = planets_of(simulate_survey(denser(survey, 2.1), block=0, n=4000, seed=6)) / 10.0
    # Planning has so many planets a star: a share p of them is known to p (1 - p) / N_DRAWS.
    planning = sum(visit.gain for visit in survey.schedule.visits)
    error = np.hypot(yields.std() / np.sqrt(4000), np.sqrt(0.21 * planning / N_DRAWS))
    assert abs(yields.mean() - planning) < 4.0 * error
    assert planning == pytest.approx(survey.schedule.value, rel=1e-9)


class Watched(module.Clock):
    """A clock that notes what it is asked for."""

    lowest, most = np.inf, 0.0

    def spend(self, go, cost_h, on):
        Watched.most = max(Watched.most, float(self.slot.max()))
        super().spend(go, cost_h, on)
        Watched.lowest = min(Watched.lowest, float(self.left.min()), float(self.slot.min()))


@pytest.mark.parametrize("follow", [(), ("F520",)])
@pytest.mark.parametrize("stop", [{}, {"after_detection": False, "after_empty": 1}])
def test_time_never_exceeds_budget_or_slot(plain, small, monkeypatch, follow, stop):
    config = small(
        {
            "time_budget_h": 40,
            "slot_share": 0.01,
            "stop": stop,
            "revisits": {"max_visits": 12},
            "follow_up": {"bands": list(follow), "attempts": 3},
            "scheduler": {"reserve": 3},
        }
    )
    survey = prepare(config).surveys[0]
    assert any(visit.reserve for visit in survey.schedule.visits)
    monkeypatch.setattr(module, "Clock", Watched)
    Watched.lowest, Watched.most = np.inf, 0.0
    played = simulate_survey(survey, block=0, n=200, seed=1)
    assert -1e-6 < Watched.lowest < 6.0
    assert Watched.most <= 0.01 * 60 * 24 + 1e-9  # what a slot gives
    used = played.universes["search_h"] + played.universes["follow_up_h"]
    assert used.max() <= 40.0 + 1e-6
    assert (played.universes["follow_up_h"] > 0).any() == bool(follow)
    assert np.all(played.detections["used_h"] <= 40.0 + 1e-6)


def test_tables_agree_with_each_other(plain):
    survey = plain.surveys[0]
    played = simulate_survey(survey, block=2, n=150, seed=3)
    d, u, s = played.detections, played.universes, played.stars
    assert len(found(played)) == len(d["universe"]) > 0
    for column, mine in (("new_planets", d["known_row"] == NEW), ("known_planets", d["known_row"] != NEW)):
        np.testing.assert_array_equal(u[column], np.bincount(d["universe"][mine], minlength=150))
        assert s[column].sum() == mine.sum()
    hosts = Counter(universe for universe, _ in {(a, b) for a, b, _ in found(played)})
    np.testing.assert_array_equal(u["stars_with_planet"], [hosts.get(k, 0) for k in range(150)])
    assert s["visits"].sum() == u["visits"].sum()
    assert s["search_h"].sum() == pytest.approx(u["search_h"].sum())
    assert np.all(s["block"] == 2)
    assert np.all(s["universes"] == 150)
    # What a detection says of itself.
    assert np.all((d["margin"] > 0) & (d["chance"] > 0) & (d["chance"] <= 1) & (d["contrast"] > 0))
    for row in range(len(d["universe"])):
        i = star_number(survey, d["star"][row])
        visit = next(v for v in survey.schedule.visits if (v.star, v.ordinal) == (i, d["ordinal"][row]))
        assert d["day"][row] == survey.calendar.day[i, visit.slot]
        assert d["band"][row] == survey.options[i][visit.option].band


def test_a_star_is_left_alone_after_a_detection(plain, change):
    survey = denser(plain.surveys[0], 1.0)
    stops, goes_on = (
        simulate_survey(change(survey, stop={"after_detection": after}), block=0, n=100, seed=1)
        for after in (True, False)
    )
    assert planets_of(stops).sum() < planets_of(goes_on).sum()
    assert np.all(stops.universes["search_h"] <= goes_on.universes["search_h"] + 1e-9)
    last = {}
    for universe, star, ordinal in zip(
        *(stops.detections[name].tolist() for name in ("universe", "star", "ordinal")), strict=True
    ):
        assert last.setdefault((universe, star), ordinal) == ordinal  # all planets in one visit


def test_a_star_is_left_alone_after_empty_visits(plain, change):
    survey = denser(plain.surveys[0], 1e-3)
    survey = replace(survey, known_rows=tuple(() for _ in survey.known_rows))
    for after, stars in ((1, 3), (2, 3)):
        played = simulate_survey(change(survey, stop={"after_empty": after}), block=0, n=50, seed=1)
        assert not planets_of(played).any()
        assert np.all(played.universes["visits"] == after * stars)


def test_the_survey_ends_with_its_planets(plain, change):
    survey = denser(plain.surveys[0], 3.0)
    every = simulate_survey(change(survey, stop={"after_planets": None}), block=0, n=100, seed=1)
    one = simulate_survey(change(survey, stop={"after_planets": 1}), block=0, n=100, seed=1)
    assert found(one) < found(every)
    # The first visit that shows any ends it.
    by_universe = defaultdict(set)
    for universe, star, ordinal in zip(
        *(one.detections[name].tolist() for name in ("universe", "star", "ordinal")), strict=True
    ):
        by_universe[universe].add((star, ordinal))
    assert all(len(visits) == 1 for visits in by_universe.values())
    assert np.all((planets_of(one) > 0) == (planets_of(every) > 0))
    none = simulate_survey(change(survey, stop={"after_planets": 10_000}), block=0, n=100, seed=1)
    assert found(none) == found(every)


@pytest.mark.long
def test_reserve_visits_displace_no_planned_one(small, sharp_tree):
    rules = deep_merge(
        sharp_tree, {"time_budget_h": 45, "stop": {"after_detection": True}, "revisits": {"max_visits": 6}}
    )
    without, with_reserve = (
        denser(
            prepare(
                small(deep_merge(rules, {"scheduler": {"reserve": reserve}}), universe={"known_planets": "off"})
            ).surveys[0],
            1.5,
        )
        for reserve in (0, 3)
    )
    planned = [(v.star, v.option, v.slot) for v in with_reserve.schedule.visits if not v.reserve]
    assert planned == [(v.star, v.option, v.slot) for v in without.schedule.visits]
    assert len(with_reserve.schedule.visits) > len(planned)
    few, more = (simulate_survey(survey, block=0, n=150, seed=1) for survey in (without, with_reserve))
    assert np.all(more.universes["stars_with_planet"] >= few.universes["stars_with_planet"])
    assert more.universes["stars_with_planet"].sum() > few.universes["stars_with_planet"].sum()
    assert np.all(more.universes["search_h"] <= 45.0 + 1e-6)
    quiet = planets_of(more) == 0  # nothing freed: nothing on top
    np.testing.assert_array_equal(more.universes["search_h"][quiet], few.universes["search_h"][quiet])


def test_detections_that_need_two_visits(small, sharp_tree, change, only_visits):
    survey = denser(prepare(small(sharp_tree, universe={"known_planets": "off"})).surveys[0], 3.0)
    i = star_number(survey, "eps Eri")
    survey = only_visits(survey, lambda visit: visit.star == i)
    alone = [
        found(simulate_survey(only_visits(survey, lambda v, k=k: v.ordinal == k), block=0, n=200, seed=1))
        for k in range(4)
    ]
    for needed in (1, 2, 3):
        twice = found(simulate_survey(change(survey, detection={"visits_needed": needed}), block=0, n=200, seed=1))
        counts = Counter(key for part in alone for key in part)
        assert twice == {key for key, count in counts.items() if count >= needed}
    assert twice


def test_follow_up(small):
    survey = prepare(
        small({"follow_up": {"bands": ["F520"], "attempts": 2, "time_s": 36000}, "detection": {"rule": "expected"}})
    ).surveys[0]
    played = simulate_survey(survey, block=0, n=200, seed=1)
    u = played.universes
    assert 0 < u["characterised_planets"].sum() <= planets_of(played).sum()
    assert np.all(u["characterised_planets"] <= planets_of(played))
    assert np.all((u["follow_up_h"] == 0) | (planets_of(played) > 0))
    assert not (u["characterised_planets"][u["follow_up_h"] == 0]).any()
    settlings = survey.strategy.visit.settlings
    costs = [survey.calendar.cost_h(survey.model, i, way, settlings) for i, (way,) in enumerate(survey.follow)]
    dearest = max(cost[np.isfinite(cost)].max() for cost in costs)
    most = survey.strategy.alarms.attempts + survey.strategy.follow_up.attempts
    assert np.all(u["follow_up_h"] <= most * dearest * u["stars_with_planet"] + 1e-9)


def test_strategies_that_make_the_same_visit_find_the_same_planets(small):
    """Other stars, another budget, other rules elsewhere: the chance of a visit stays that of its star and number."""
    one_visit = {"revisits": {"max_visits": 1}, "detection": {"half_factor": 1.3}}
    others = ({"targets": {"names": ["eps Eri"]}, "time_budget_h": 20}, {"time_budget_h": 280, "value_known": 2})
    few, many = (prepare(small(one_visit | more)).surveys[0] for more in others)
    visits = [
        {(survey.targets.name[v.star], v.slot, survey.options[v.star][v.option]) for v in survey.schedule.visits}
        for survey in (few, many)
    ]
    assert visits[0] < visits[1]
    played = [simulate_survey(denser(survey, 2.0), block=1, n=300, seed=9) for survey in (few, many)]
    assert found(played[0]) == found(played[1], star="eps Eri")
    assert len(found(played[0])) > 30
    assert found(played[1]) > found(played[0])


def test_a_likelier_detection_keeps_what_was_found(plain, change):
    """The same numbers decide: a lower threshold adds planets and loses none."""
    survey = change(denser(plain.surveys[0], 1.0), stop={"after_detection": False})
    strict, easy = (
        found(simulate_survey(change(survey, detection={"half_factor": factor}), block=0, n=200, seed=1))
        for factor in (2.3, 1.6)
    )
    assert strict < easy


def test_blocks_and_seeds_are_independent(plain):
    survey = denser(plain.surveys[0], 2.0)
    one, same, other, seeded = (
        simulate_survey(survey, block=block, n=1500, seed=seed) for block, seed in ((0, 1), (0, 1), (1, 1), (0, 2))
    )
    assert found(one) == found(same)
    for name in one.universes:
        np.testing.assert_array_equal(one.universes[name], same.universes[name])
    for another in (other, seeded):
        r = np.corrcoef(planets_of(one), planets_of(another))[0, 1]
        assert abs(r) < 4.0 / np.sqrt(1500)


def test_the_luck_of_a_visit_is_its_own():
    """Numbers of star, block, visit and seed: equal names give equal numbers, others independent ones."""
    bodies = draw_planet_sample(
        "tau Cet", 0.8, 0.5, load_population("giants"), epoch_mjd=61771.0, n=2000, seed=1, one_each=True
    )
    names = [
        (1, "tau Cet", 0, 0),
        (2, "tau Cet", 0, 0),
        (1, "eps Eri", 0, 0),
        (1, "tau Cet", 1, 0),
        (1, "tau Cet", 0, 1),
    ]
    one, *others = (module.uniform_draws(bodies, *name, 2000) for name in names)
    np.testing.assert_array_equal(one, module.uniform_draws(bodies, *names[0], 2000))
    for other in others:
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.0 / np.sqrt(2000)


@pytest.mark.parametrize("n", [1, 30, 99])
def test_the_last_block_may_be_shorter(plain, n):
    survey = denser(plain.surveys[0], 2.0)
    whole, part = (simulate_survey(survey, block=1, n=size, seed=1) for size in (100, n))
    for name, values in part.universes.items():
        np.testing.assert_array_equal(values, whole.universes[name][:n])
    assert found(part) == {key for key in found(whole) if key[0] < n}


def test_false_alarms_are_poisson_numbers_of_the_visits(plain):
    survey = plain.surveys[0]
    u = simulate_survey(with_rates(survey, 0.3, 0.05), block=0, n=2000, seed=1).universes
    for name, rate in (("noise_alarms", 0.3), ("background_alarms", 0.05)):
        expected = rate * u["visits"].sum()
        assert abs(u[name].sum() - expected) < 4.0 * np.sqrt(expected)
    quiet = simulate_survey(survey, block=0, n=2000, seed=1).universes
    np.testing.assert_array_equal(quiet["new_planets"], u["new_planets"])


def test_the_error_of_the_calibration_is_one_for_a_universe(plain, change):
    """With an error as large as this, universes differ in how much they detect, more than by chance."""
    survey = denser(plain.surveys[0], 20.0)
    survey = change(survey, stop={"after_detection": False})
    sure, unsure = (
        planets_of(
            simulate_survey(
                change(survey, detection={"calibration_error": error, "half_error": error}), block=0, n=600, seed=1
            )
        )
        for error in (0.0, 0.4)
    )
    assert unsure.var() > 1.5 * sure.var()


def test_excluded_planets_are_left_out_and_counted_beside(plain, change, excluding):
    """Of planets that the same visits show, the allowed ones are a sample with the probability that they are there."""
    survey = change(denser(plain.surveys[0], 2.0), stop={"after_detection": False})
    share = 0.3
    whole, part = (
        simulate_survey(replace(survey, limits=excluding(survey.targets.name, missed)), block=0, n=1000, seed=1)
        for missed in (0.0, 1.0 - share)
    )
    before, now = whole.universes, part.universes
    assert np.array_equal(before["new_planets"], before["new_planets_unconditional"])
    assert np.array_equal(now["new_planets_unconditional"], before["new_planets"])
    for name in ("known_planets", "visits", "search_h", "noise_alarms"):
        assert np.array_equal(now[name], before[name]), name
    n, new = before["new_planets"].sum(), now["new_planets"].sum()
    assert n > 900
    assert abs(new - share * n) < 4.0 * np.sqrt(n * share * (1.0 - share))
    assert found(part) < found(whole)
    assert part.stars["new_planets_unconditional"].sum() == n
    assert part.stars["new_planets"].sum() == new


def test_excluded_planets_stop_nothing(plain, change, excluding):
    """Where nothing can be there, a survey goes on as one without a population."""
    survey = change(denser(plain.surveys[0], 5.0), stop={"after_empty": 2}, follow_up={"bands": ("F520",)})
    survey = replace(survey, follow=tuple((ways[0],) for ways in survey.options))
    excluded = replace(survey, limits=excluding(survey.targets.name, 1.0))
    none = replace(survey, strategy=survey.strategy.model_copy(update={"population": None}))
    played, empty = (simulate_survey(one, block=0, n=200, seed=1) for one in (excluded, none))
    assert played.universes["new_planets_unconditional"].sum() > 100
    assert found(played) == found(empty)
    for name, values in empty.universes.items():
        if name != "new_planets_unconditional":
            assert np.array_equal(played.universes[name], values), name


def test_new_planets_go_with_the_occurrence_rate(plain, change):
    """Planets are independent: the same visits find as many more as there are more, if they do not end earlier."""
    survey = change(plain.surveys[0], stop={"after_detection": False})
    rates = (0.14, 0.21, 0.26)
    counts = [
        simulate_survey(denser(survey, rate), block=0, n=10_000, seed=2).universes["new_planets"] for rate in rates
    ]
    for rate, values in zip(rates, counts, strict=True):
        expected = counts[1].mean() * rate / rates[1]
        error = np.hypot(values.std(), counts[1].std() * rate / rates[1]) / np.sqrt(values.size)
        assert abs(values.mean() - expected) < 3.0 * error, rate
    assert counts[0].mean() < counts[1].mean() < counts[2].mean()


def test_nothing_planned_finds_nothing(plain):
    survey = plain.surveys[0]
    played = simulate_survey(replace(survey, schedule=replace(survey.schedule, visits=())), block=0, n=10, seed=1)
    assert not any(values.any() for name, values in played.universes.items() if name != "universe")
    columns = played.detections
    assert not any(len(values) for values in (*columns.values(), played.stars["star"]))
    assert columns["universe"].dtype == columns["known_row"].dtype == np.int64
    assert columns["snr"].dtype == float
    assert columns["star"].dtype == columns["band"].dtype == object


STAR, GAP = "eps Eri", 60.0


def with_rates(survey, noise, background):
    """The survey with other false alarms a visit."""
    rates = {"noise_alarms": noise, "background_alarms": background}
    return replace(
        survey, **{name: tuple((rate,) * len(ways) for ways in survey.options) for name, rate in rates.items()}
    )


@pytest.fixture
def checked(sharp, change, only_visits):
    """The visits of one star with these numbers, with second looks at its candidates."""
    survey = change(sharp.surveys[0], alarms={"check": True, "gap_days": GAP})
    number = list(survey.targets.name).index(STAR)

    def made(*ordinals):
        return only_visits(survey, lambda visit: visit.star == number and visit.ordinal in ordinals)

    return made


def looks(survey, gap=GAP):
    """Slots after the last visit in which a second look is possible, and the cost of each."""
    last = survey.schedule.visits[-1]
    way = survey.options[last.star][last.option]
    cost = survey.calendar.cost_h(survey.model, last.star, way, survey.strategy.visit.settlings)
    days = survey.calendar.day[last.star]
    later = np.flatnonzero(np.isfinite(cost) & (days >= days[last.slot] + gap))
    return later[later > last.slot], cost


def test_a_false_alarm_costs_one_more_visit(checked):
    """Of Poisson numbers of alarms one visit in (1 - exp(-rate)) asks for a second look; its cost is the slot's."""
    survey = denser(with_rates(checked(0), 0.2, 0.5), 1e-9)
    slots, cost = looks(survey)
    n = 4000
    universes = simulate_survey(survey, block=0, n=n, seed=3).universes
    alarms = universes["noise_alarms"] + universes["background_alarms"]
    np.testing.assert_allclose(universes["alarm_h"], cost[slots[0]] * (alarms > 0), rtol=1e-12)
    share = 1.0 - np.exp(-0.7)
    error = np.sqrt(share * (1.0 - share) / n)
    assert abs(universes["alarm_h"].mean() / cost[slots[0]] - share) < 4.0 * error
    assert not universes["follow_up_h"].any()
    assert not universes["confirmed_planets"].any()
    np.testing.assert_array_equal(universes["visits"], 1 + (alarms > 0))


@pytest.mark.parametrize("patient", [False, True])
def test_a_planned_visit_refutes_what_an_earlier_one_showed(checked, change, patient):
    """Only alarms of the second of two visits cost time; of both where the gap asked for is longer."""
    survey = denser(with_rates(checked(0, 1), 0.0, 1.0), 1e-9)
    first, second = (survey.calendar.day[visit.star, visit.slot] for visit in survey.schedule.visits)
    gap = second - first + (1.0 if patient else -1.0)
    survey, n = change(survey, alarms={"gap_days": gap}), 2000
    slots, cost = looks(survey, gap)
    hours = simulate_survey(survey, block=0, n=n, seed=4).universes["alarm_h"]
    share = 1.0 - np.exp(-2.0 if patient else -1.0)
    assert set(np.round(hours[hours > 0], 6)) <= set(np.round(cost[np.isfinite(cost)], 6))
    assert slots.size
    assert abs(np.mean(hours > 0) - share) < 4.0 * np.sqrt(share * (1.0 - share) / n)


def test_nothing_is_spent_without_checks(checked, change):
    survey = change(with_rates(checked(0), 0.2, 0.5), alarms={"check": False})
    universes = simulate_survey(survey, block=0, n=200, seed=3).universes
    assert universes["background_alarms"].any()
    assert not (universes["alarm_h"] + universes["follow_up_h"]).any()


def sky(survey, n, days, way):
    """Planets of the only star of a survey, and what visits on some days expect of them, north up."""
    (number,) = {visit.star for visit in survey.schedule.visits}
    star, population = survey.targets.select([number]), survey.strategy.population
    who = STAR, float(star_mass_msun(star)[0]), float(star.luminosity_lsun[0])
    bodies = draw_planet_sample(*who, population, epoch_mjd=survey.calendar.start_mjd, n=n, seed=6, block=0)
    albedos = tuple(kind.albedo for kind in population.mixture)
    places = bodies.places(days)
    return bodies, expected_signals(survey.model, star, way, bodies, albedos, places, np.zeros(len(days)))


def test_a_planet_is_confirmed_where_a_later_slot_shows_it(checked):
    """Without chance a planet is seen again where its significance reaches the threshold in one of two later slots."""
    survey = denser(with_rates(checked(0), 0.0, 0.0), 2.0)
    (visit,) = survey.schedule.visits
    n, (slots, cost) = 1500, looks(survey)
    played = simulate_survey(survey, block=0, n=n, seed=6)
    days = survey.calendar.day[visit.star, [visit.slot, *slots[:2]]]
    bodies, signals = sky(survey, n, days, survey.options[visit.star][visit.option])
    seen = signals.margin >= 1.0
    first, again = seen[0], seen[1] | seen[2]
    # North is up in every visit: where a planet was seen stays in the dark hole.
    confirmed = np.bincount(bodies.universe[first & again], minlength=n)
    np.testing.assert_array_equal(played.universes["new_planets"], np.bincount(bodies.universe[first], minlength=n))
    np.testing.assert_array_equal(played.universes["confirmed_planets"], confirmed)
    assert 20 < confirmed.sum() < first.sum()
    hosts = [np.bincount(bodies.universe[some], minlength=n) > 0 for some in (first, first & ~seen[1])]
    spent = sum(cost[slot] * some for slot, some in zip(slots[:2], hosts, strict=True))
    np.testing.assert_allclose(played.universes["follow_up_h"], spent, rtol=1e-12)
    assert not played.universes["alarm_h"].any()


def test_a_second_look_waits_for_a_roll_that_shows_the_place(checked, change):
    """With the roll of the Sun the dark quadrants turn by a degree a day: no look where they left the place."""
    survey = change(denser(with_rates(checked(0), 0.0, 0.0), 2.0), revisits={"roll": "sun"})
    (visit,), n = survey.schedule.visits, 1500
    slots, cost = looks(survey)
    played = simulate_survey(survey, block=0, n=n, seed=6)
    found = played.detections
    way, turns = survey.options[visit.star][visit.option], survey.calendar.sun_pa_deg[visit.star, slots]
    metrics, parity = survey.model.metrics[way.band], survey.model.instrument.detector.parity
    spent = played.universes["follow_up_h"]
    alone = np.flatnonzero(np.bincount(found["universe"], minlength=n)[found["universe"]] == 1)
    waited = 0
    for row in alone:
        x, y = sky_to_detector(found["separation_arcsec"][row], found["pa_deg"][row] - turns, parity=parity)
        open_slots = slots[metrics.zone.contains(x, y, metrics.aperture_radius_arcsec)]
        waited += len(open_slots) < len(slots)
        ways = np.concatenate([[0.0], np.cumsum(cost[open_slots[:2]])])
        assert np.abs(ways[1:] - spent[found["universe"][row]]).min(initial=np.inf) < 1e-9 or not len(open_slots)
    assert waited > 10


def test_blocks_together_are_the_same_as_each_alone(plain):
    """Universes, and what is added up for each block; events stand in another order."""
    n = 2 * BLOCK + 30
    for survey in plain.surveys:
        whole = simulate_survey(survey, block=range(4, 7), n=n, seed=3).rows("all", 4 * BLOCK)
        sizes = {4: BLOCK, 5: BLOCK, 6: 30}
        parts = [
            simulate_survey(survey, block=block, n=size, seed=3).rows("all", block * BLOCK)
            for block, size in sizes.items()
        ]
        for table in TABLES:
            rows, alone = pd.DataFrame(whole[table.name]), pd.concat([pd.DataFrame(part[table.name]) for part in parts])
            first, second = (item.sort_values(list(table.key), ignore_index=True) for item in (rows, alone))
            assert len(rows) or table.name != "universes"
            pd.testing.assert_frame_equal(first, second, rtol=1e-12, check_dtype=False)


def test_a_known_planet_is_looked_at_where_its_orbit_has_it(plain):
    """Its aperture lies in the dark hole where a visit expects anything of it; that of a new one where it was seen."""
    survey = plain.surveys[0]
    run = module._Simulation(survey, block=0, n=100, seed=1)
    number = list(survey.targets.name).index(STAR)
    star, band = run.stars[number], survey.options[number][0].band
    known = star.planets.known != NEW
    star.place[0], every = 9.0, np.arange(len(star.planets))  # arcsec: far outside
    answers = set()
    for slot in np.flatnonzero(survey.calendar.fraction[number] > 0):
        when = np.array([[slot], [slot]])
        found, *_ = run._visited(number, survey.options[number][0], star.planets, when, known, None)
        inside = star.inside(survey, number, every, band, int(slot))
        np.testing.assert_array_equal(inside[known], found.contrast[0, known] > 0.0)
        assert not inside[~known].any()
        answers |= set(inside[known].tolist())
    assert answers == {True, False}


@pytest.fixture(scope="module")
def followed(small, sharp_tree):
    """Some visits of a star with several planets, and follow-up in the same band to an SNR, calibrated to 1."""
    law = {"calibration": 1.0, "calibration_error": 0.0}
    rules = deep_merge(sharp_tree, {"detection": law, "alarms": {"check": False}, "revisits": {"max_visits": 4}})
    rules |= {"follow_up": {"bands": ["F520"], "time_s": 18000, "attempts": 3, "snr": 9.0}}
    rules["targets"] = {"names": [STAR]}
    return denser(prepare(small(rules, universe={"known_planets": "off"})).surveys[0], 1.5)


@pytest.mark.parametrize(("goal", "visits"), [(6.0, 4), (9.0, 1), (14.0, 4)])
def test_follow_up_to_an_snr_adds_in_quadrature(followed, change, only_visits, goal, visits):
    """Slot after slot by hand: a visit where the SNR can still be reached, until the root of squares is there.

    Planets share visits, but not their number: one that is found late has as many as the first.
    """
    survey = change(only_visits(followed, lambda visit: visit.ordinal < visits), follow_up={"snr": goal})
    n, ((way,),) = 500, survey.follow
    played = simulate_survey(survey, block=0, n=n, seed=6)
    slots = [visit.slot for visit in survey.schedule.visits]
    assert len(slots) == visits
    bodies, search = sky(survey, n, survey.calendar.day[0, slots], survey.options[0][survey.schedule.visits[0].option])
    snr = sky(survey, n, survey.calendar.day[0], way)[1].snr
    cost = survey.calendar.cost_h(survey.model, 0, way, survey.strategy.visit.settlings)
    hours, characterised, stacked, late = np.zeros(n), np.zeros(n), 0, 0
    shown = search.margin >= 1.0
    for universe in range(n):
        mine = np.flatnonzero(shown.any(axis=0) & (bodies.universe == universe))
        since = {planet: slots[int(np.argmax(shown[:, planet]))] for planet in mine}
        reached, left, done = dict.fromkeys(mine, 0.0), dict.fromkeys(mine, 3), set()
        for slot in np.flatnonzero(np.isfinite(cost)):
            lacking = [planet for planet in mine if planet not in done and since[planet] < slot]
            if any(left[p] > 0 and np.sqrt(reached[p] ** 2 + left[p] * snr[slot, p] ** 2) >= goal for p in lacking):
                hours[universe] += cost[slot]
                for planet in lacking:
                    left[planet] -= 1
                    reached[planet] = np.sqrt(reached[planet] ** 2 + snr[slot, planet] ** 2)
                    done |= {planet} if reached[planet] >= goal else set()
        characterised[universe] = len(done)
        stacked += any(left[planet] < 2 for planet in done)
        late += len({since[planet] for planet in done}) > 1
    np.testing.assert_array_equal(played.universes["characterised_planets"], characterised)
    np.testing.assert_allclose(played.universes["follow_up_h"], hours, rtol=1e-9)
    assert 0 < characterised.sum() < np.count_nonzero(shown.any(axis=0))
    assert stacked  # several visits of one planet
    assert late or goal > 6.0


def test_several_planets_of_a_star_are_found_each_for_itself(sharp, change, only_visits):
    """Thinned Poisson numbers stay Poisson: the share of stars with none, one and more follows from the mean alone."""
    number = list(sharp.surveys[0].targets.name).index(STAR)
    survey = denser(only_visits(sharp.surveys[0], lambda visit: visit.star == number), 3.5)
    n = 4000
    found = simulate_survey(survey, block=0, n=n, seed=2).universes["new_planets"]
    mean = found.mean()
    assert mean > 0.5
    for count, share in enumerate(mean**k * np.exp(-mean) / factorial(k) for k in range(4)):
        assert abs(np.mean(found == count) - share) < 4.0 * np.sqrt(share * (1.0 - share) / n)
    # The rule that leaves a star once it has shown a planet takes only what later visits would have added.
    stopped = simulate_survey(change(survey, stop={"after_detection": True}), block=0, n=n, seed=2).universes
    np.testing.assert_array_equal(stopped["new_planets"] > 0, found > 0)
    assert 0 < np.count_nonzero(stopped["new_planets"] > 1) < np.count_nonzero(found > 1)
    assert np.all(stopped["new_planets"] <= found)


def test_a_visit_for_a_planet_is_no_cost_of_the_alarm_beside_it(checked):
    survey = denser(with_rates(checked(0), 0.0, 50.0), 2.0)
    universes = simulate_survey(survey, block=0, n=300, seed=6).universes
    planets = universes["new_planets"] > 0
    assert planets.any()
    assert (universes["follow_up_h"][planets] > 0).all()
    assert not universes["follow_up_h"][~planets].any()
    assert (universes["alarm_h"][~planets] > 0).all()
    assert not universes["alarm_h"][planets].any()


def test_where_checks_are_on(small):
    def on(**more):
        return small({"revisits": {"max_visits": 4}} | more).strategies[0].checks_candidates

    assert not on()
    assert on(alarms={"check": True})
    assert on(follow_up={"bands": ["F662"]})
    assert not on(follow_up={"bands": ["F662"]}, alarms={"check": False})
    assert not on(follow_up={"bands": ["F662"]}, detection={"visits_needed": 2})


HERE = Path(__file__).resolve().parent


def load(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def chaos():
    return load("chaos", HERE / "chaos.py")


@pytest.fixture
def tasks(monkeypatch):
    monkeypatch.syspath_prepend(HERE)
    return load("cluster_tasks", HERE / "cluster_tasks.py")


@pytest.mark.long
def test_random_kills_do_not_change_the_files(chaos, tasks, tmp_path):
    whole = tasks.survey(tmp_path / "serial")[1]

    def victims():
        return chaos.worker_pids() if len(kills) < 3 else []

    def advance(done):
        while done in (10, 20) and len(kills) < done // 10:  # two at least, by the middle of the run
            time.sleep(0.01)

    with chaos.random_kills(victims, seed=2, every_s=0.2) as kills:
        parts, files = tasks.survey(tmp_path / "out", workers=2, advance=advance)
    assert 2 <= len(kills) == len(set(kills)) <= 3
    assert sorted(parts) == list(range(40))
    assert files == whole
    assert chaos.worker_pids() == []


def test_nothing_is_killed_where_nothing_runs(chaos):
    with chaos.random_kills(chaos.worker_pids, seed=1, every_s=0.001) as done:
        pass
    assert done == []
