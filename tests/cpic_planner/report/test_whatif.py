import pytest

from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.report import hanging_text, write_whatif
from cpic_planner.report.document import page_html
from cpic_planner.report.drawing import Picture
from cpic_planner.report.whatif import (
    WhatIfReport,
    between,
    changed_settings,
    extent_text,
    lead_sentences,
    planets_text,
    shared_facts,
    targets_csv,
    universe_facts,
    whatif_document,
)
from cpic_planner.report.whatif_figures import WHATIF_FIGURES
from cpic_planner.report.words import decimals
from cpic_planner.results import (
    AssumedInstrument,
    ChangeRecord,
    FactRow,
    FactsRecord,
    ImageSample,
    OccurrenceRange,
    PlanetShare,
    SettingSource,
    TakenBack,
)
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


HOSTILE = "<script>alert('x')</script>"
PICTURES = {
    key: Picture("data:image/svg+xml;base64,", f"alt {key}", f"caption {key}.")
    for key in WHATIF_FIGURES
    if key != "doubt"
}


@pytest.fixture(scope="module")
def page(compared):
    return page_html(whatif_document(WhatIfReport(compared(), PICTURES)))


def test_nothing_is_loaded_from_outside_and_names_are_text(page, reader, words):
    reader.check_alone()
    assert HOSTILE not in page
    assert HOSTILE in words


def test_anchors_and_captions(reader):
    reader.check_anchors()
    assert sum(tag == "figure" for tag, _ in reader.tags) == len(PICTURES)


def test_yields_are_those_of_the_result(compared, words):
    for item in compared().strategies:
        found, new, known, orbits = item.planets, item.new_planets, item.known_planets, item.orbits_known
        whole = item.new_planets_unconditional
        row = (
            f"{item.name} {item.description} {decimals(found.mean, 2)} {found.low:.2f} to {found.high:.2f} "
            f"0 to {found.survey_high:.3g} {new.mean:.2f} {new.low:.2f} to {new.high:.2f} "
            f"{whole.mean:.2f} {whole.low:.2f} to {whole.high:.2f} "
            f"{known.mean:.2f} {known.low:.2f} to {known.high:.2f} 0.00 0.00 to 0.01 "
            f"{orbits.mean:.2f} {orbits.low:.2f} to {orbits.high:.2f} 40.0 20.0 {item.hours.mean:.0f}"
        )
        assert row in words


def test_differences_and_verdicts(words):
    found = "+0.600 0.490 to 0.720 +0.180 0.070 to 0.300 0.000 −0.110 to 0.120 +0.060 −0.050 to 0.180 +100 100 to 100"
    assert f"wide single {found} 0.62" in words
    assert "✓ finds more" in words
    assert "All other pairs" not in words


def test_time_stars_changes_and_settings(words):
    for text in (
        "wide 200 (0 to 400) 1752 (20 %) 0.56 3 5 + 2 5.4 10.0 0.004; 0",
        "deep & long beside single. Star Rank in single Rank here Why",
        f"{HOSTILE} 2 not visited 2 visits, not 1",
        "1 ε Eri ε Eri b 3.80 3.200 F520, F662 2.00 h 6.2 3 2.7 2028-03-01 16.8 1.5 0.2 0.100 0.500 1.0",
        "Set otherwise than in single: visit.bands F520 (there F520, F662, F720, F850); revisits.max_visits 4",
        "No images were asked for",
        "weather of space",
        "Known planets: the NASA Exoplanet Archive (Akeson et al. 2013)",
    ):
        assert text in words, text


@pytest.mark.parametrize(("source", "named"), [("archive_2019", True), ("mine.csv", True), ("none+mine.csv", False)])
def test_the_archive_is_named_where_its_table_is_used(compared, read, source, named):
    result = compared()
    result = result.model_copy(update={"universe": result.universe | {"known_planets": source}})
    assert ("Akeson et al. 2013" in read(page_html(whatif_document(WhatIfReport(result, PICTURES)))).words) == named


def test_the_strategy_that_finds_most_is_shaded(compared, reader):
    picked = [attributes for tag, attributes in reader.tags if tag == "tr" and attributes.get("class") == "pick"]
    assert len(picked) == 1


def test_which_fact_moved_which_number(compared, read):
    result = compared(["one", "two"])
    assert 'id="facts"' not in page_html(whatif_document(WhatIfReport(result, {})))
    shared = {"catalog": "snapshot", "known_planets": "snapshot"}
    facts = [
        TakenBack(name="rv", words="velocities", heading="Without radial velocities", exclusions=[], **shared),
        TakenBack(name="companions", words="companions", heading="Companions of old", exclusions=["rv"], **shared),
    ]
    sure = ChangeRecord(mean=0.25, error=0.02, low=0.2, high=0.3)
    none = ChangeRecord(mean=-0.01, error=0.02, low=-0.05, high=0.03)
    rows = []
    for item in result.strategies:
        numbers = {name: getattr(item, name) for name in ("planets", "new_planets", "known_planets")}
        for fact, change in (("rv", sure), ("companions", none)):
            changes = {f"{name}_change": change for name in numbers}
            rows.append(FactRow(strategy=item.name, fact=fact, **numbers, **changes))
    record = FactsRecord(facts=facts, rows=rows, statement="Velocities move most.")
    page = page_html(whatif_document(WhatIfReport(result.model_copy(update={"facts": record}), {})))
    words = read(page).words
    assert "Velocities move most." in words
    assert "Strategy With all facts Without radial velocities Companions of old" in words
    for item in result.strategies:
        for name in ("planets", "new_planets", "known_planets"):
            mean = f"{getattr(item, name).mean:.2f}"
            row = f"{item.name} {mean} {mean} +0.250 (0.200 to 0.300) {mean} −0.010 (−0.050 to 0.030)"
            assert row in words
    assert page.count("<strong>+0.250</strong>") == 6
    assert "<strong>−0.01" not in page


def test_images_tell_their_correction(compared, read):
    result = compared(["one", "two"])
    sample = ImageSample(
        detections=40, images=120, expected=31.5, found=28, correction=0.889, low=0.75, high=1.02, note="24 stars"
    )
    without = sample.model_copy(update={"correction": None, "low": None, "high": None})
    shown = [
        item.model_copy(update={"images": own}) for item, own in zip(result.strategies, (sample, without), strict=True)
    ]
    words = read(page_html(whatif_document(WhatIfReport(result.model_copy(update={"strategies": shown}), {})))).words
    assert f"one 40 120 31.5 28 0.89 0.75 to 1.02 {0.889 * 0.512:.2f} 24 stars" in words
    assert "two 40 120 31.5 28 – – 24 stars" in words
    assert "No images were asked for" not in words


def test_one_strategy_has_nothing_to_differ_from(compared, read):
    page = page_html(whatif_document(WhatIfReport(compared(["one"]), {})))
    words = read(page).words
    assert 'id="differences"' not in page
    assert "Changes of rank" not in words
    assert "the others differ" not in words


def test_nothing_found_is_an_answer(compared, read):
    reader = read(page_html(whatif_document(WhatIfReport(compared(["one", "two"], empty=True), {}))))
    words = reader.words
    assert "Nothing is detected in any universe." in words
    assert "No strategy visits a star." in words
    assert "No star is visited." in words
    assert not any(attributes.get("class") == "pick" for _, attributes in reader.tags)
    assert "may be chance" in words


def test_other_pairs_and_other_verdicts(compared, read):
    result = compared(["one", "two", "three"])
    extra = [
        item.model_copy(update={"first": "two", "second": "three", "mean": -0.3, "low": -0.4, "high": -0.2})
        for item in result.differences[:1]
    ]
    changed = result.model_copy(update={"differences": [*result.differences, *extra]})
    words = read(page_html(whatif_document(WhatIfReport(changed, {})))).words
    assert "All other pairs (1)" in words
    assert "two three −0.300 −0.400 to −0.200 – – – – 0.62 ✕ finds fewer" in words


def test_many_strategies_keep_their_rows_but_not_all_their_stars(compared, read):
    names = [f"s{i}" for i in range(50)]
    reader = read(page_html(whatif_document(WhatIfReport(compared(names), {}))))
    words = reader.words
    assert "The first strategy and the 39 that find most; targets.csv has the stars of all 50." in words
    assert sum(attributes.get("aria-label", "").startswith("Stars of") for _, attributes in reader.tags) == 40
    assert all(f" {name} " in words for name in names)


def test_sources_of_the_settings(compared, read):
    result = compared()
    names = [item.name for item in result.strategies]
    rows = [
        SettingSource(
            key="visit.time_s", value=[36000.0, 60.0], unit="s", source=HOSTILE, confidence="A", strategies=names
        ),
        SettingSource(key="slot_share", value=0.25, unit="", source="a guess", confidence="I", strategies=names[:1]),
    ]
    page = page_html(whatif_document(WhatIfReport(result.model_copy(update={"sources": rows}), {})))
    words = read(page).words
    assert f"visit.time_s 36000, 60 s A {HOSTILE} all" in words
    assert f"slot_share 0.25 I a guess {names[0]}" in words
    assert HOSTILE not in page
    assert "Where these numbers are from" not in page_html(whatif_document(WhatIfReport(result, {})))


def test_the_subtitle_and_the_yields_follow_the_run(compared):
    result = compared(["deep drift=x1 (0.05 nm)", "deep drift=0.1 nm"])
    share = PlanetShare(name="eps Eri b", share=0.68, planets=0.59)
    strategies = [item.model_copy(update={"leading_planet": share}) for item in result.strategies]
    html = page_html(whatif_document(WhatIfReport(result.model_copy(update={"strategies": strategies}), {})))
    assert "2 strategies with 1752 h of telescope time, 20 % of 360 days" in html
    assert html.count("68 % of the planets found are eps Eri b") >= 2
    assert "deep drift=0.1 nm" in html


def test_remarks_on_a_users_table_stand_in_the_report(compared, page, read):
    noted = compared().model_copy(update={"notes": ["pl.csv: 2 rows left out: 2 by period"]})
    words = " ".join(" ".join(read(page_html(whatif_document(WhatIfReport(noted, PICTURES)))).text).split())
    assert "pl.csv: 2 rows left out: 2 by period" in words
    assert "Remarks on your tables" not in page


def test_page_and_table_are_written_the_same_every_time(compared, tmp_path):
    result = compared(["one", "two"])
    pages = []
    for name in ("a", "b"):
        with open_run_folder(tmp_path / name, kind="whatif", config_hash="0") as folder:
            write_whatif(folder, result)
        assert (tmp_path / name / "targets.csv").read_text(encoding="utf-8") == targets_csv(result)
        pages.append((tmp_path / name / "report.html").read_bytes())
    assert pages[0] == pages[1]
    assert b'id="figure-curves"' in pages[0]
