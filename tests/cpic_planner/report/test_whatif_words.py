import pytest

from cpic_planner.models.surveyed import PlanetShare
from cpic_planner.report.whatif_words import (
    between,
    extent_text,
    hanging_text,
    lead_sentences,
    planets_text,
)


def changed(result, which, **update):
    strategies = list(result.strategies)
    strategies[which] = strategies[which].model_copy(update=update)
    return result.model_copy(update={"strategies": strategies})


def with_difference(result, low, high):
    found = [
        item.model_copy(update={"low": low, "high": high}) if item.quantity == "planets" else item
        for item in result.differences
    ]
    return result.model_copy(update={"differences": found})


def test_the_lead_names_the_runner_up_and_the_budget(compared):
    said = lead_sentences(compared(["one", "two"]))
    assert said == [
        "two finds most planets",
        "In the same universes two finds 0.30 planets more than one, the next best (0.19 to 0.42), in 50 h more.",
        "No strategy uses more than 8.6 % of its budget of 1752 h on average: its rules on stars and visits end it "
        "before the time does.",
    ]


def test_a_lead_that_may_be_chance_is_said_to_be(compared):
    said = lead_sentences(with_difference(compared(["one", "two"]), -0.1, 0.7))
    assert (
        said[1] == "The lead of two on one, the next best, may be chance: 0.30 planets (−0.10 to 0.70), in 50 h more."
    )


def test_pairs_are_found_either_way(compared):
    result = with_difference(compared(["one", "two"]), 0.2, 0.7)
    assert between(result, "two", "one", "planets") == pytest.approx((0.3, 0.2, 0.7))
    assert between(result, "one", "two", "planets") == pytest.approx((-0.3, -0.7, -0.2))
    assert between(result, "one", "three", "planets") is None


def test_without_a_pair_or_planets_there_is_no_runner_up(compared):
    assert len(lead_sentences(compared(["one", "two", "three"]))) == 2  # the two best are not compared
    assert len(lead_sentences(compared(["one", "two"], empty=True))) == 2
    assert lead_sentences(compared(["one"]))[1].startswith("The strategy uses 5.7 % of its budget")


def test_a_budget_that_is_used_up_needs_no_word(compared):
    result = compared(["one"])
    item = result.strategies[0]
    spent = item.model_copy(update={"settings": item.settings | {"time_budget_h": 101.0}})
    assert lead_sentences(result.model_copy(update={"strategies": [spent]})) == ["one finds most planets"]


def test_small_numbers_of_planets():
    assert [planets_text(value) for value in (0.0, 0.0004, 0.0123, 1.5)] == ["0", "<0.001", "0.012", "1.500"]


def test_an_empty_calendar_is_said_in_the_lead(compared):
    result = compared(["one", "two"])
    plan = result.strategies[0].schedule
    several = result.strategies[0].settings | {"detection": {"visits_needed": 3}}
    nothing = plan.model_copy(update={"visits": 0, "hours": 0.0, "value": 0.0, "bound": 0.446, "distance": 1.0})
    assert lead_sentences(changed(result, 0, schedule=nothing, settings=several))[1] == (
        "one plans no visit at all: no calendar can be worth more than 0.45, this one is worth 0. Where 3 visits "
        "have to show a planet, those of a star have to be worth 0.001 planets each on average (scheduler.min_gain)."
    )
    nowhere = nothing.model_copy(update={"bound": 0.0, "distance": 0.0})
    assert "no visit of its stars fits" in lead_sentences(changed(result, 0, schedule=nowhere))[1]
    hardly = plan.model_copy(update={"visits": 2, "hours": 12.0, "value": 0.01, "bound": 0.4, "distance": 0.975})
    said = lead_sentences(changed(result, 0, schedule=hardly))[1]
    assert said.startswith("one plans 2 visits only, 12.0 h: no calendar can be worth more than 0.40, this one is")
    assert len(lead_sentences(changed(result, 0, schedule=hardly.model_copy(update={"hours": 400.0})))) == 3


def test_a_yield_that_hangs_on_one_planet_says_so(compared):
    result = compared(["one", "two", "three"])
    most, few = (PlanetShare(name="eps Eri b", share=share, planets=0.5) for share in (0.85, 0.3))
    assert hanging_text(changed(result, 0, leading_planet=most).strategies[0]) == (
        "85 % of the planets found are eps Eri b"
    )
    assert hanging_text(changed(result, 0, leading_planet=few).strategies[0]) == ""
    assert hanging_text(result.strategies[0]) == ""
    said = lead_sentences(changed(result, 0, leading_planet=most))
    assert "Other yields hang on one planet, too. one: 85 % of the planets found are eps Eri b." in said
    # That of the best one is in the statement.
    assert not any("hang" in text for text in lead_sentences(changed(result, 2, leading_planet=most)))


def test_what_is_compared_is_told_by_its_numbers(compared):
    result = compared(["one", "two"])
    assert extent_text(result) == (
        "2 strategies with 1752 h of telescope time, 20 % of 360 days (0.99 years) from 2028-01-01"
    )
    short = result.model_copy(update={"universe": result.universe | {"duration_days": 3652.0}})
    short = changed(short, 0, settings=result.strategies[0].settings | {"time_budget_h": 438.0})
    assert extent_text(short) == (
        "2 strategies with 438 to 1752 h of telescope time, 0.50 % to 2.0 % of 3\u202f652 days "
        "(10.0 years) from 2028-01-01"
    )
