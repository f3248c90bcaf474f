"""From strategies to surveys that can be played."""

import numpy as np
import pytest

from cpic_planner.survey.prepare import known_table, prepare
from cpic_planner.survey.strategy import UniverseConfig


def test_surveys_share_their_calendar_and_stars(small):
    told = []
    prepared = prepare(
        small({"name": "all"}, {"name": "two", "targets": {"names": ["tau Cet", "eps Eri"]}}), advance=told.append
    )
    assert told == ["all: schedule", "two: schedule"]
    every, two = (survey.calendar for survey in prepared.surveys)
    names = [list(survey.targets.name) for survey in prepared.surveys]
    assert sorted(names[0]) == ["alf Cen A", "eps Eri", "tau Cet"]
    for field in ("fraction", "window_s", "day", "sun_pa_deg"):
        own = getattr(every, field)[[names[0].index(name) for name in names[1]]]
        np.testing.assert_array_equal(own, getattr(two, field))
    for survey in prepared.surveys:
        assert len(survey.options) == len(survey.targets) == len(survey.known_rows) == len(survey.noise_alarms)
    assert [len(survey.targets) for survey in prepared.surveys] == [3, 2]


def test_schedules_stay_within_their_strategy(plain):
    survey = plain.surveys[0]
    planned = [visit for visit in survey.schedule.visits if not visit.reserve]
    assert sum(visit.cost_h for visit in planned) <= survey.strategy.time_budget_h
    for slot in range(survey.calendar.n_slots):
        used = sum(visit.cost_h for visit in survey.schedule.visits if visit.slot == slot)
        assert used <= survey.strategy.slot_share * survey.calendar.slot_h[slot] + 1e-6
    for star in range(len(survey.targets)):
        own = [visit for visit in survey.schedule.visits if visit.star == star]
        assert len(own) <= survey.strategy.revisits.max_visits
        assert [visit.ordinal for visit in own] == list(range(len(own)))
        days = [survey.calendar.day[star, visit.slot] for visit in own]
        assert np.all(np.diff(days) >= survey.strategy.revisits.min_gap_days)
        for visit in own:
            setting = survey.options[star][visit.option]
            cost = survey.calendar.cost_h(survey.model, star, setting, survey.strategy.visit.settlings)
            assert visit.cost_h == cost[visit.slot]


def test_the_gap_is_kept_in_days(small):
    prepared = prepare(small({"revisits": {"min_gap_days": 60}}))
    survey = prepared.surveys[0]
    for star in range(len(survey.targets)):
        days = [survey.calendar.day[star, visit.slot] for visit in survey.schedule.visits if visit.star == star]
        assert np.all(np.diff(days) >= 60.0)


@pytest.mark.parametrize("slot_days", [45.7, 33.3333, 61.0])
def test_slots_that_are_no_whole_number_of_days(small, slot_days):
    prepared = prepare(small(universe={"slot_days": slot_days, "duration_days": 200}))
    assert prepared.surveys[0].calendar.n_slots == int(np.ceil(200 / slot_days))
    assert prepared.surveys[0].schedule.visits


def test_refuted_planets_make_no_host_and_are_in_no_schedule(refused, small):
    """tau Cet e and the one planet of omi2 Eri, which the archive of 2019 has."""

    def planets(source):
        names = ["tau Cet", "omi2 Eri"]
        surveys = prepare(
            small(
                {"targets": {"names": names}, "visit": {"time_s": 7200}, "time_budget_h": 20},
                {"name": "hosts", "targets": {"names": ["tau Cet"], "known_planets": "only"}},
                universe={"known_planets": source, "duration_days": 120},
            )
        ).surveys
        survey = surveys[0]
        listed = survey.known.text("planet")
        found = zip(survey.targets.name, survey.known_rows, strict=True)
        return {str(star): {listed[row] for row in rows} for star, rows in found}

    now, before = planets("snapshot"), planets("archive_2019")
    assert before["tau Cet"] == now["tau Cet"] | {"tau Cet e"}
    assert before.get("omi2 Eri", set()) >= now.get("omi2 Eri", set()) == set()
    refused("cuts that leave a star", prepare, small({"targets": {"names": ["omi2 Eri"], "known_planets": "only"}}))


def test_background_stars_and_follow_up_are_options(small):
    quiet = prepare(small()).surveys[0]
    assert not any(any(ways) for ways in quiet.background_alarms)
    assert quiet.follow == ((), (), ())
    loud = prepare(small({"follow_up": {"bands": ["F520"], "time_s": 3000}}, universe={"background": "on"})).surveys[0]
    assert all(min(ways) > 0.0 for ways in loud.background_alarms)
    assert loud.noise_alarms == quiet.noise_alarms
    assert all(way.band == "F520" and way.time_s <= 3000.0 * (1 + 1e-9) for (way,) in loud.follow)


def test_a_survey_that_nobody_can_make(small):
    for strategy in ({"time_budget_h": 0.01}, {"population": None, "targets": {"names": ["alf Cen A"]}}):
        survey = prepare(small(strategy)).surveys[0]
        assert survey.schedule.visits == ()
        assert survey.schedule.distance == 0.0


def test_what_is_refused(refused, small):
    faults = {
        "band = F999": {"visit": {"bands": ["F999"]}},
        "band = Q": {"follow_up": {"bands": ["Q"]}},
        "planets_per_star = missing": {"population": "jupiters"},
        "revisits.roll_dither_deg = 40": {"revisits": {"roll_dither_deg": 40}},
        "targets.names = Vulcan": {"targets": {"names": ["Vulcan"]}},
    }
    for text, strategy in faults.items():
        refused(text, prepare, small(strategy))


def test_candidates_are_known_planets_when_asked_for():
    """A survey reads the table as cpic known does."""
    counted = [known_table(UniverseConfig(candidates=asked)) for asked in (False, True)]
    assert [table.rows_of("alpha Cen A") for table in counted] == [(), (counted[1].row_of("alf Cen A S1"),)]
    assert known_table(UniverseConfig(known_planets="off", candidates=True)) is None
