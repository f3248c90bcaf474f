import pytest

from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.report import hanging_text, write_whatif
from cpic_planner.report.drawing import Picture
from cpic_planner.report.whatif import (
    WhatIfReport,
    between,
    changed_settings,
    extent_text,
    lead_sentences,
    planets_text,
    targets_csv,
    universe_facts,
    whatif_document,
)
from cpic_planner.report.whatif_figures import WHATIF_FIGURES
from cpic_planner.report.writing import page_html
from cpic_planner.results import OccurrenceRange, PlanetShare
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


@pytest.mark.parametrize(("source", "named"), [("archive_2019", True), ("mine.csv", True), ("none+mine.csv", False)])
def test_the_archive_is_named_where_its_table_is_used(compared, read, source, named):
    result = compared()
    result = result.model_copy(update={"universe": result.universe | {"known_planets": source}})
    assert ("Akeson et al. 2013" in read(page_html(whatif_document(WhatIfReport(result, PICTURES)))).words) == named


def test_the_strategy_that_finds_most_is_shaded(compared, reader):
    picked = [attributes for tag, attributes in reader.tags if tag == "tr" and attributes.get("class") == "pick"]
    assert len(picked) == 1


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


def test_many_strategies_keep_their_rows_but_not_all_their_stars(compared, read):
    names = [f"s{i}" for i in range(50)]
    reader = read(page_html(whatif_document(WhatIfReport(compared(names), {}))))
    words = reader.words
    assert "The first strategy and the 39 that find most; targets.csv has the stars of all 50." in words
    assert sum(attributes.get("aria-label", "").startswith("Stars of") for _, attributes in reader.tags) == 40
    assert all(f" {name} " in words for name in names)


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
