import pytest

from cpic_planner.report.document import page_html
from cpic_planner.report.drawing import Picture
from cpic_planner.report.whatif import WhatIfReport, whatif_document
from cpic_planner.report.whatif_figures import WHATIF_FIGURES
from cpic_planner.report.words import decimals
from cpic_planner.results import (
    ChangeRecord,
    FactRow,
    FactsRecord,
    ImageSample,
    PlanetShare,
    SettingSource,
    TakenBack,
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
