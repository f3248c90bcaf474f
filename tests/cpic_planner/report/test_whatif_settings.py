"""Settings of survey strategies as people read them."""

from cpic_planner.models.surveyed import AssumedInstrument
from cpic_planner.report.whatif_settings import changed_settings, shared_facts, universe_facts
from cpic_planner.survey.strategy_file import load_strategies


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
            "blind_margin": 0.7,
            "blind_margin_error": 0.05,
            "known_margin": 0.97,
            "known_margin_error": 0.03,
            "blind_tails": 1.0,
            "calibration": 1.02,
            "calibration_error": 0.01,
        },
    )
    facts = dict(shared_facts(own))
    assert facts["Visit"] == "the best of F520, F662, as long as it pays, at most 10.0 h of wall time"
    assert facts["Revisits"] == facts["Follow-up"] == facts["Changes to the instrument"] == "none"
    assert f"{own['population']['planets_per_star']:g} planets per star" in facts["Population of unknown planets"]
    assert "SNR is 1.02 ± 0.01." in facts["Detection"]
    assert (
        "threshold is 0.70 (± 5.0%) in Gaussian noise ten resolution elements from the star, 1.90 where all"
        in (facts["Detection"])
    )
    assert "known planets at their place where it is 0.97 (± 3.0%)" in facts["Detection"]
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
        scheduler={"method": "milp"},
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
    assert facts["Calendar"].startswith("mixed-integer programme")


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
    assert found["time_budget_h"] == ("100 h", "1752 h")
    assert found["visit.time_s"] == ("60 s", "36000 s")


def test_assumptions_say_what_a_factor_makes_of_the_instrument():
    used = AssumedInstrument(
        visit_drift_nm=0.1, walk_nm_per_sqrt_hour=0.12, exozodi_zodis=0.0, throughput={"F520": 0.095}
    )
    facts = dict(shared_facts(settings(assumptions={"drift": 2, "throughput": 0.5}), used))
    assert facts["Changes to the instrument"] == (
        "wavefront drift × 2 (0.1 nm visit offset, 0.12 nm/√h walk), throughput of the optics × 0.5 (0.095 in F520)"
    )
