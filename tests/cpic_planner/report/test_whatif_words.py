import pytest

from cpic_planner.report.whatif_words import (
    between,
    changed_settings,
    lead_sentences,
    planets_text,
    shared_facts,
    universe_facts,
)
from cpic_planner.survey.strategy_file import load_strategies


def settings(**own):
    return load_strategies({"strategies": [{"name": "own"} | own]}).strategies[0].model_dump(mode="json")


def with_difference(result, low, high):
    found = [item.model_copy(update={"low": low, "high": high}) if item.quantity == "planets" else item
             for item in result.differences]  # fmt: skip
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
        detection={"rule": "blind", "sigma": 5, "blind_margin": 0.7, "blind_margin_error": 0.05, "known_margin": 0.97,
                   "known_margin_error": 0.03, "blind_tails": 1.0, "calibration": 1.02, "calibration_error": 0.01},
    )  # fmt: skip
    facts = dict(shared_facts(own))
    assert facts["Visit"] == "the best of F520, F662, as long as it pays, at most 10.0 h of wall time"
    assert facts["Revisits"] == facts["Follow-up"] == facts["Changes to the instrument"] == "none"
    assert f"{own['population']['planets_per_star']:g} planets per star" in facts["Population of unknown planets"]
    assert "SNR is 1.02 ± 0.01." in facts["Detection"]
    assert "threshold is 0.70 (± 5.0%) in Gaussian noise ten resolution elements from the star, 1.90 where all" in (
        facts["Detection"])  # fmt: skip
    assert "known planets at their place where it is 0.97 (± 3.0%)" in facts["Detection"]
    own = settings(
        population=None,
        targets={"known_planets": "only", "names": ["tau Cet"], "exclude": ["eps Eri"], "distance_max_pc": 10,
                 "singles_only": True, "v_mag_max": None, "max_targets": 50},
        visit={"bands": ["F662"], "time_s": [3600, 7200], "goal": "snr", "snr": 7, "exposure_s": 12, "em_gain": 30},
        revisits={"max_visits": 3, "min_gap_days": 30},
        follow_up={"bands": ["F720"], "time_s": 36000, "attempts": 2},
        detection={"rule": "expected", "visits_needed": 2, "sigma": 5},
        assumptions={"contrast": 3e-9, "drift": 2, "exozodi": 3},
        stop={"after_detection": False, "after_empty": 2, "after_planets": 5},
        scheduler={"method": "milp"},
    )  # fmt: skip
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
        "median raw contrast of the dark hole 3.0 × 10⁻⁹, drift × 2, dust of 3 solar systems"
    )
    assert facts["Stop rules"] == "or after 2 empty visits, the survey ends with 5 planets"
    assert facts["Calendar"].startswith("mixed-integer programme")


def test_changed_settings_name_every_key_that_differs():
    base = settings(visit={"bands": ["F520", "F720"]})
    own = settings(name="b", description="other", visit={"bands": ["F662"]}, stop={"after_detection": False},
                   assumptions={"contrast": 1e-9}, population=None)  # fmt: skip
    found = {key: (mine, theirs) for key, mine, theirs in changed_settings(own, base)}
    assert found["visit.bands"] == ("F662", "F520, F720")
    assert found["stop.after_detection"] == ("no", "yes")
    assert found["assumptions.contrast"] == ("1e-09", "none")
    assert found["population.planets_per_star"] == ("none", f"{base['population']['planets_per_star']:g}")
    assert not {"name", "description", "visit.goal"} & set(found)
    assert changed_settings(own, own) == []
