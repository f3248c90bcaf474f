import pytest

from cpic_planner.report import hanging_text
from cpic_planner.report.whatif import (
    between,
    changed_settings,
    extent_text,
    lead_sentences,
    planets_text,
    shared_facts,
    universe_facts,
)
from cpic_planner.results import AssumedInstrument, OccurrenceRange, PlanetShare
from cpic_planner.survey import load_strategies


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
        "New planets of two: 0.24; in the same visits 0.49 with those that radial velocities or companion stars or "
        "known giants exclude.",
        "In the same universes two finds 0.30 planets more than one, the next best (0.19 to 0.42), in 50 h more.",
        "No strategy uses more than 8.6 % of its budget of 1752 h on average: its rules on stars and visits end it "
        "before the time does.",
    ]


def test_a_lead_that_may_be_chance_is_said_to_be(compared):
    said = lead_sentences(with_difference(compared(["one", "two"]), -0.1, 0.7))
    assert (
        said[2] == "The lead of two on one, the next best, may be chance: 0.30 planets (−0.10 to 0.70), in 50 h more."
    )


def test_pairs_are_found_either_way(compared):
    result = with_difference(compared(["one", "two"]), 0.2, 0.7)
    assert between(result, "two", "one", "planets") == pytest.approx((0.3, 0.2, 0.7))
    assert between(result, "one", "two", "planets") == pytest.approx((-0.3, -0.7, -0.2))
    assert between(result, "one", "three", "planets") is None


def test_without_a_pair_or_planets_there_is_no_runner_up(compared):
    assert len(lead_sentences(compared(["one", "two", "three"]))) == 3  # the two best are not compared
    assert len(lead_sentences(compared(["one", "two"], empty=True))) == 2
    assert lead_sentences(compared(["one"]))[2].startswith("The strategy uses 5.7 % of its budget")


def test_a_budget_that_is_used_up_needs_no_word(compared):
    result = compared(["one"])
    item = result.strategies[0]
    spent = item.model_copy(update={"settings": item.settings | {"time_budget_h": 101.0}})
    said = lead_sentences(result.model_copy(update={"strategies": [spent]}))
    assert said[0] == "one finds most planets"
    assert not any("budget" in text for text in said)


def test_small_numbers_of_planets():
    assert [planets_text(value) for value in (0.0, 0.0004, 0.0123, 1.5)] == ["0", "<0.001", "0.012", "1.500"]


def test_an_empty_calendar_is_said_in_the_lead(compared):
    result = compared(["one", "two"])
    plan = result.strategies[0].schedule
    several = result.strategies[0].settings | {"detection": {"visits_needed": 3}}
    nothing = plan.model_copy(update={"visits": 0, "hours": 0.0, "value": 0.0, "bound": 0.446, "distance": 1.0})
    assert lead_sentences(changed(result, 0, schedule=nothing, settings=several))[2] == (
        "one plans no visit at all: no calendar can be worth more than 0.45, this one is worth 0. Where 3 visits "
        "have to show a planet, those of a star have to be worth 0.001 planets each on average (scheduler.min_gain)."
    )
    nowhere = nothing.model_copy(update={"bound": 0.0, "distance": 0.0})
    assert "no visit of its stars fits" in lead_sentences(changed(result, 0, schedule=nowhere))[2]
    hardly = plan.model_copy(update={"visits": 2, "hours": 12.0, "value": 0.01, "bound": 0.4, "distance": 0.975})
    said = lead_sentences(changed(result, 0, schedule=hardly))[2]
    assert said.startswith("one plans 2 visits only, 12.0 h: no calendar can be worth more than 0.40, this one is")
    assert len(lead_sentences(changed(result, 0, schedule=hardly.model_copy(update={"hours": 400.0})))) == 4


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


def test_new_planets_are_told_with_other_occurrence_rates_and_with_nothing_excluded(compared):
    result = compared(["one", "two"])
    known = OccurrenceRange(
        planets_per_star=0.21, planets_per_star_low=0.14, planets_per_star_high=0.26, low=0.16, high=0.3
    )
    assert lead_sentences(changed(result, 1, occurrence=known))[1] == (
        "New planets of two: 0.24; in the same visits 0.16 to 0.30 for 0.14 to 0.26 planets a star, and 0.49 with "
        "those that radial velocities or companion stars or known giants exclude."
    )
    everything = result.model_copy(update={"universe": result.universe | {"exclusions": []}})
    assert not any("New planets" in text for text in lead_sentences(everything))
    assert lead_sentences(changed(everything, 1, occurrence=known))[1].endswith("for 0.14 to 0.26 planets a star.")
    assert [dict(universe_facts(one))["What excludes unknown planets"] for one in (result, everything)] == [
        "radial velocities (planets that they would have shown), companion stars (orbits that do not last), known "
        "giants (no room for another planet)",
        "nothing",
    ]


def settings(**own):
    return load_strategies({"strategies": [{"name": "own"} | own]}).strategies[0].model_dump(mode="json")


def test_what_all_share(compared):
    facts = dict(universe_facts(compared()))
    assert facts["Time"] == "360 days (0.99 years) from 2028-01-01, planned in slots of 30 days"
    assert facts["Known planets"].startswith("NASA Exoplanet Archive")
    assert "Already observed" not in facts
    seen = compared().model_copy(update={"observed": "log.csv, 12 visits", "known_planets": ""})
    assert dict(universe_facts(seen))["Already observed"] == "log.csv, 12 visits"
    assert dict(universe_facts(seen))["Known planets"] == "left out"


def test_rules_in_words():
    own = settings(
        visit={"bands": ["F520", "F662"], "time_s": 36000, "goal": "time"},
        detection={
            "rule": "blind",
            "sigma": 5,
            "calibration": 1.02,
            "calibration_error": 0.01,
            "half_factor": 1.3,
            "half_error": 0.045,
        },
    )
    facts = dict(shared_facts(own))
    assert facts["Visit"] == "the best of F520, F662, as long as it pays, at most 10.0 h of wall time"
    assert facts["Revisits"] == facts["Follow-up"] == facts["Changes to the instrument"] == "none"
    assert f"{own['population']['planets_per_star']:g} planets per star" in facts["Population of unknown planets"]
    assert facts["Detection"] == (
        "a search that does not know where planets are; 5σ per resolution element. Predicted over recovered SNR of "
        "images is 0.980 ± 0.010. Half of the planets are found at 1.3 times the significance that the law of "
        "simulated images asks for, which is known to 4.5 %. These errors are drawn anew in each universe"
    )
    usual = dict(shared_facts(settings(detection={"rule": "known_place", "half_error": 0.03})))["Detection"]
    assert "found at the significance that the law of simulated images asks for, which is known to 3.0 %." in usual
    own = settings(
        population=None,
        targets={
            "known_planets": "only",
            "names": ["tau Cet"],
            "exclude": ["eps Eri"],
            "distance_max_pc": 10,
            "singles_only": True,
            "v_mag_max": None,
            "max_targets": 50,
        },
        visit={"bands": ["F662"], "time_s": [3600, 7200], "goal": "snr", "snr": 7, "exposure_s": 12, "em_gain": 30},
        revisits={"max_visits": 3, "min_gap_days": 30},
        follow_up={"bands": ["F720"], "time_s": 36000, "attempts": 2},
        detection={"rule": "expected", "visits_needed": 2, "sigma": 5},
        assumptions={"contrast": 3e-9, "drift": 2, "exozodi": 3},
        stop={"after_detection": False, "after_empty": 2, "after_planets": 5},
        scheduler={"method": "exact"},
    )
    facts = dict(shared_facts(own))
    assert facts["Population of unknown planets"] == "none: only known planets are looked for"
    assert facts["Targets"] == (
        "at most 50, within 10 pc, no close companions, 1 named stars, 1 stars left out by name, only stars with known "
        "planets"
    )
    assert facts["Visit"] == (
        "F662, until the reference planet has the SNR asked for, at most 1.00 h or 2.00 h of wall time; "
        "frames of 12 s; EM gain 30"
    )
    assert facts["Revisits"] == "up to 3 visits of a star, at least 30 days apart"
    assert facts["Follow-up"] == "of planets found, in F720: 10.0 h each, up to 2 attempts"
    assert facts["Detection"].endswith("no chance in it; 5σ per resolution element, in 2 visits")
    assert facts["Changes to the instrument"] == (
        "median raw contrast of the dark hole 3.0 × 10⁻⁹, wavefront drift × 2, dust of 3 solar systems (zodi)"
    )
    assert facts["Stop rules"] == "or after 2 empty visits, the survey ends with 5 planets"
    assert facts["Calendar"].startswith("whole plans of stars weighed against each other, with a long search")


def test_changed_settings_name_every_key_that_differs():
    base = settings(visit={"bands": ["F520", "F720"]})
    own = settings(
        name="b",
        description="other",
        visit={"bands": ["F662"]},
        stop={"after_detection": False},
        assumptions={"contrast": 1e-9},
        population=None,
    )
    found = {key: (mine, theirs) for key, mine, theirs in changed_settings(own, base)}
    assert found["visit.bands"] == ("F662", "F520, F720")
    assert found["stop.after_detection"] == ("no", "yes")
    assert found["assumptions.contrast"] == ("1e-09", "none")
    assert found["population.planets_per_star"] == ("none", f"{base['population']['planets_per_star']:g}")
    assert not {"name", "description", "visit.goal"} & set(found)
    assert changed_settings(own, own) == []


def test_settings_have_their_units_and_factors_their_x():
    own = settings(assumptions={"drift": 2, "throughput": 0.5, "exozodi": 3}, time_budget_h=100, visit={"time_s": 60})
    found = {key: (mine, theirs) for key, mine, theirs in changed_settings(own, settings())}
    assert found["assumptions.drift"] == ("x2", "x1")
    assert found["assumptions.throughput"] == ("x0.5", "x1")
    assert found["assumptions.exozodi"] == ("3 zodi", "none")
    law = changed_settings(settings(assumptions={"exozodi": {"median": 3, "p95": 27}}), settings())
    assert ("assumptions.exozodi.p95", "27 zodi", "none") in law
    assert found["time_budget_h"] == ("100 h", "1752 h")
    assert found["visit.time_s"] == ("60 s", "36000 s")


def test_rules_on_candidates_follow_up_and_dust_in_words():
    follow = {"bands": ["F720"], "snr": 5}
    facts = dict(shared_facts(settings(follow_up=follow, assumptions={"exozodi": {"median": 3, "p95": 27}})))
    assert facts["Follow-up"].endswith("in slots in which they reach a photometric SNR of 5 together, the orbit known")
    assert facts["Candidates"].startswith("looked at again after 30 days or more")
    assert "median 3 and 95 % below 27 solar systems" in facts["Changes to the instrument"]
    assert "cost no telescope time" in dict(shared_facts(settings()))["Candidates"]
    several = settings(detection={"visits_needed": 2}, revisits={"max_visits": 2})
    assert dict(shared_facts(several))["Candidates"].endswith("by the 2 visits that a detection takes")


def test_assumptions_say_what_a_factor_makes_of_the_instrument():
    used = AssumedInstrument(
        visit_drift_nm=0.1, walk_nm_per_sqrt_hour=0.12, exozodi_zodis=0.0, throughput={"F520": 0.095}
    )
    facts = dict(shared_facts(settings(assumptions={"drift": 2, "throughput": 0.5}), used))
    assert facts["Changes to the instrument"] == (
        "wavefront drift × 2 (0.1 nm visit offset, 0.12 nm/√h walk), throughput of the optics × 0.5 (0.095 in F520)"
    )
