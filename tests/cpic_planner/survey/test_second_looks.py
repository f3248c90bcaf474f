"""Second looks at candidates: what they cost and confirm, against closed forms and a calculation of their own."""

from dataclasses import replace
from math import factorial

import numpy as np
import pytest

import cpic_planner.survey.simulate as module
from cpic_planner.ranking import inside_zone
from cpic_planner.survey.detection import expected_signals
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.universe import NEW, draw_planet_sample, star_mass_msun
from simulator.config import deep_merge
from simulator.target import sky_to_detector

STAR, GAP = "eps Eri", 60.0


def with_rates(survey, noise, background):
    """The survey with other false alarms a visit."""
    rates = {"noise_alarms": noise, "background_alarms": background}
    return replace(
        survey, **{name: tuple((rate,) * len(ways) for ways in survey.options) for name, rate in rates.items()}
    )


def with_planets(survey, rate):
    population = survey.strategy.population.model_copy(update={"planets_per_star": rate})
    return replace(survey, strategy=survey.strategy.model_copy(update={"population": population}))


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
    survey = with_planets(with_rates(checked(0), 0.2, 0.5), 1e-9)
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
    survey = with_planets(with_rates(checked(0, 1), 0.0, 1.0), 1e-9)
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
    survey = with_planets(with_rates(checked(0), 0.0, 0.0), 2.0)
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
    survey = change(with_planets(with_rates(checked(0), 0.0, 0.0), 2.0), revisits={"roll": "sun"})
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
        open_slots = slots[inside_zone(metrics.zone, x, y, metrics.aperture_radius_arcsec)]
        waited += len(open_slots) < len(slots)
        ways = np.concatenate([[0.0], np.cumsum(cost[open_slots[:2]])])
        assert np.abs(ways[1:] - spent[found["universe"][row]]).min(initial=np.inf) < 1e-9 or not len(open_slots)
    assert waited > 10


def test_a_known_planet_is_looked_at_where_its_orbit_has_it(plain):
    """Its aperture lies in the dark hole where a visit expects anything of it; that of a new one where it was seen."""
    survey = plain.surveys[0]
    run = module._Simulation(survey, block=0, n=100, seed=1)
    number = list(survey.targets.name).index(STAR)
    star, band = run.stars[number], survey.options[number][0].band
    known = star.planets.known != NEW
    star.place[0] = 9.0  # arcsec: far outside
    answers = set()
    for slot in np.flatnonzero(survey.calendar.fraction[number] > 0):
        when = np.array([[slot], [slot]])
        found, _, _ = run._visited(number, survey.options[number][0], star.planets, when, known, None)
        inside = star.inside(survey, number, band, int(slot))
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
    return with_planets(prepare(small(rules, universe={"known_planets": "off"})).surveys[0], 1.5)


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
    survey = with_planets(only_visits(sharp.surveys[0], lambda visit: visit.star == number), 3.5)
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
    survey = with_planets(with_rates(checked(0), 0.0, 50.0), 2.0)
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
