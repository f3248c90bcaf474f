"""Second looks at candidates: what they cost and confirm, against closed forms and a calculation of their own."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.survey.detection import expected_signals
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.universe import draw_planet_sample, star_mass_msun

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


def test_a_planet_is_confirmed_where_a_later_slot_shows_it(checked):
    """Without chance a planet is seen again where its significance reaches the threshold in one of two later slots."""
    survey = with_planets(with_rates(checked(0), 0.0, 0.0), 2.0)
    (visit,) = survey.schedule.visits
    star, way = survey.targets.select([visit.star]), survey.options[visit.star][visit.option]
    n, (slots, cost) = 1500, looks(survey)
    played = simulate_survey(survey, block=0, n=n, seed=6)
    bodies = draw_planet_sample(
        STAR,
        float(star_mass_msun(star)[0]),
        float(star.luminosity_lsun[0]),
        survey.strategy.population,
        epoch_mjd=survey.calendar.start_mjd,
        n=n,
        seed=6,
        block=0,
    )
    days = survey.calendar.day[visit.star, [visit.slot, *slots[:2]]]
    kinds = tuple(kind.albedo for kind in survey.strategy.population.mixture)
    seen = expected_signals(survey.model, star, way, bodies, kinds, bodies.places(days), np.zeros(3)).margin >= 1.0
    first, again = seen[0], seen[1] | seen[2]
    confirmed = np.bincount(bodies.universe[first & again], minlength=n)
    np.testing.assert_array_equal(played.universes["new_planets"], np.bincount(bodies.universe[first], minlength=n))
    np.testing.assert_array_equal(played.universes["confirmed_planets"], confirmed)
    assert 20 < confirmed.sum() < first.sum()
    hosts = [np.bincount(bodies.universe[some], minlength=n) > 0 for some in (first, first & ~seen[1])]
    spent = sum(cost[slot] * some for slot, some in zip(slots[:2], hosts, strict=True))
    np.testing.assert_allclose(played.universes["follow_up_h"], spent, rtol=1e-12)
    assert not played.universes["alarm_h"].any()


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
