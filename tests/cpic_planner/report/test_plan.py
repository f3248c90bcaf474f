import base64
import hashlib
import re
from dataclasses import replace

import pytest

from cpic_planner.etc import build_model
from cpic_planner.queries import LIBRARIES
from cpic_planner.queries.shared import Library
from cpic_planner.ranking import KnownChoice
from cpic_planner.ranking.known_answer import known_answer
from cpic_planner.registry import SCORES
from cpic_planner.report.drawing import Picture
from cpic_planner.report.plan import PlanReport, panel_pictures, plan_document, plan_figures, summary_sentences
from cpic_planner.report.words import dec_text, ra_text
from cpic_planner.report.writing import page_html
from cpic_planner.results import PlanResult
from cpic_planner.targets import find_target
from simulator.config import albedo_spec, load_instrument

HOSTILE = "<script>alert('x')</script>"


@pytest.fixture(scope="module")
def page(plan, rank, panels, limits, holes, sensitivity):
    figures = plan_figures(plan, rank, limits=limits, holes=holes)
    return page_html(plan_document(PlanReport(plan, rank, figures, panel_pictures(plan, panels), sensitivity)))


def test_nothing_is_loaded_from_outside(reader, page):
    reader.check_alone()
    assert "url(" not in page
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_drawings_load_nothing_either(reader):
    for tag, attributes in reader.tags:
        if tag == "img" and attributes["src"].startswith("data:image/svg"):
            svg = base64.b64decode(attributes["src"].split(",", 1)[1]).decode()
            assert not re.search(r'(?:href|src)="(?!#|data:)', svg)


@pytest.mark.parametrize(
    "rule",
    [
        "@page { size: A4",
        ".wider::before { content:",
        "p, li, caption",
        ".sort { display: contents",
        "break-before: page",
    ],
)
def test_the_page_keeps_to_paper_and_says_that_it_scrolls(page, rule):
    style = page[page.index("<style>") : page.index("</style>")]
    assert rule in style
    assert "44rem; max-width: none" not in style  # figures shrink with the window


def test_every_star_that_is_shown_has_a_page_that_tables_lead_to(plan, rank, page, reader):
    reader.check_anchors()
    targets = [target.name for target in plan.targets]
    others = [row for row in rank.targets if row.name not in targets]
    for anchor in [f"target-{number}" for number in range(1, len(targets) + 1)] + [
        f"star-{row.rank}" for row in others
    ]:
        assert f'id="{anchor}"' in page
        assert page.count(f'href="#{anchor}"') >= 2, anchor  # priorities and ranking


def test_effects_are_listed_once_and_folded(page, reader):
    modelled = page[page.index('id="modelled"') : page.index('id="missing"')]
    assert modelled.count("<table") == 1
    assert modelled.index("<details>") < modelled.index("<table")
    effects = re.findall(r'<th scope="row" class="left">\s*([^<]*)</th>', modelled)
    assert len(effects) == len(set(effects)) > 1


def test_only_the_script_of_reports_may_run(page):
    script = page[page.index("<script>") + 8 : page.index("</script>")]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page
    assert page.count("<script") == 1


def test_drawings_follow_dark_mode(reader):
    drawings = [one["src"] for tag, one in reader.tags if tag == "img" and one["src"].startswith("data:image/svg")]
    assert drawings
    for source in drawings:
        svg = base64.b64decode(source.split(",", 1)[1]).decode()
        assert "@media (prefers-color-scheme:dark)" in svg
        if "<image" in svg and "mix-blend-mode" in svg:
            continue  # pixels, see `test_a_picture_in_both_lights_is_the_same_pixels_and_turns_all_but_the_images`
        assert not re.search(r": #([0-9a-f]{2})\1\1(?![0-9a-f])", svg)  # every grey is one of the two lights
        assert "var(--gffffff)" in svg
        for used in set(re.findall(r"var\((--g[0-9a-f]{6})\)", svg)):
            assert svg.count(f"{used}:#") == 2


def test_hostile_name_is_text(page, words):
    assert HOSTILE not in page
    assert "&lt;script&gt;" in page
    assert HOSTILE in words


def test_hostile_name_of_a_confirmed_target(plan, rank):
    target = plan.targets[0].model_copy(update={"name": '"><img src=x onerror=alert(1)>'})
    page = page_html(plan_document(PlanReport(plan.model_copy(update={"targets": [target]}), rank, {}, {})))
    assert "<img" not in page


def test_every_anchor_has_its_target_once(reader):
    ids = [attributes["id"] for _, attributes in reader.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    for _, attributes in reader.tags:
        for reference in [attributes.get("href", "#first"), "#" + attributes.get("aria-labelledby", "first")]:
            assert reference[1:] in ids


def test_language_and_alternative_texts(reader):
    assert reader.tags[0] == ("html", {"lang": "en"})
    images = [attributes for tag, attributes in reader.tags if tag == "img"]
    assert len(images) == 4 + 6
    assert all(attributes["alt"] for attributes in images)
    assert sum(tag == "caption" for tag, _ in reader.tags) == sum(tag == "table" for tag, _ in reader.tags)


def test_numbers_are_finite_and_no_object_leaks(words):
    assert not re.search(r"\b(?:nan|inf|None|NaN|undefined|Undefined)\b", words)
    assert "{{" not in words


def test_a_report_without_sensitivity_has_no_empty_section(plan, rank):
    page = page_html(plan_document(PlanReport(plan, rank, {}, {})))
    assert 'id="sensitivity"' not in page
    assert 'href="#sensitivity"' not in page


def test_size_with_five_targets_in_four_bands(page, plan):
    # The page grows by its images only: scale the measured ones to 5 x 4.
    drawings = re.findall(r'src="data:image/svg\+xml;base64,([^"]*)"', page)
    images = [len(part) for part in drawings if b"mix-blend-mode" in base64.b64decode(part)]
    assert len(images) == 6
    assert len(page) + 14 * max(images) < 5_000_000


def test_same_text_twice(plan, rank):
    figures = {"sky": Picture("data:image/png;base64,", "alt", "caption.")}
    assert page_html(plan_document(PlanReport(plan, rank, figures, {}))) == page_html(
        plan_document(PlanReport(plan, rank, figures, {}))
    )


def test_plan_without_targets(plan, rank, read):
    empty = plan.model_copy(update={"targets": [], "calibration": {"etc_ratio": None, "n_bands": 0}})
    text = " ".join(read(page_html(plan_document(PlanReport(empty, rank, {}, {})))).text)
    assert "No target was simulated as images" in text


def test_what_is_altered_is_named_before_anything_else(plan, rank, read):
    altered = plan.model_copy(update={"simulator_overrides": {"bands.*.t_opt": "x0.7", "detector.cic_e": 0.05}})
    text = " ".join(" ".join(read(page_html(plan_document(PlanReport(altered, rank, {}, {})))).text).split())
    sentence = "Images altered: throughput ×0.7, clock_charge = 0.05 e-. Predictions are nominal."
    assert text.index(sentence) < text.index("stars were ranked")


def test_summary_counts(plan: PlanResult, rank):
    text = " ".join(summary_sentences(plan, rank))
    assert text.startswith("20 stars were ranked")
    assert "around 7 of them" in text
    assert "around 2 of 2, in 5 of 6 measurements" in text
    assert "up to 8 times in every band in reach, reduced, searched blind" in text
    assert "F662 (2)" in text


def test_coordinates_as_text():
    from astropy.coordinates import SkyCoord

    place = SkyCoord(219.896, -60.837, unit="deg")
    assert ra_text(219.896) == f"{int(place.ra.hms.h):02d} h {int(place.ra.hms.m):02d} m {round(place.ra.hms.s):02d} s"
    assert dec_text(-60.837) == "−60° 50′"
    assert ra_text(359.9999) == "00 h 00 m 00 s"
    assert dec_text(0.999) == "+01° 00′"


def test_scores_and_libraries_bring_their_words(plan, rank, read):
    score = replace(
        SCORES["completeness"], name="toy_score", meaning="toys seen", aim="how many toys are seen", unit="m"
    )
    words = {"name": "toy_library", "meaning": "a toy box", "found": "a toy squeaks", "searched": "searched for toys"}
    with SCORES.holding(score), LIBRARIES.holding(type("Toy", (Library,), words)()):
        other = plan.model_copy(update={"reference_library": "toy_library"})
        text = read(
            page_html(plan_document(PlanReport(other, rank.model_copy(update={"score_name": "toy_score"}), {}, {})))
        ).words
    for said in ("ranked by how many toys are seen", "by toy score: toys seen", "a toy box", "if a toy squeaks"):
        assert said in text
    assert "reduced, searched for toys: the planet" in text


def test_known_planets_come_with_their_next_windows(plan, rank, read):
    """The windows of the band that covers the planet best; planets without one, and those not counted, are named so."""
    targets = find_target("eps Eri")[0]
    instrument = load_instrument()
    choice = KnownChoice.at("snapshot", "2028-01-01", albedo_spec("jupiter"), instrument, n_draws=200, seed=1)
    model = build_model(instrument, ["F520", "F850"])
    known = known_answer(model, targets, choice, years=10.0)
    (row,) = (row for row in known.planets if row.counted)
    assert row.windows
    best = max(row.windows, key=lambda window: window.best_share)
    page = page_html(plan_document(PlanReport(plan, rank, {}, {}, known=known)))
    text = " ".join(read(page).text)
    assert f"{best.best_utc}: {100 * best.best_share:.0f} %" in text
    for window in [item for item in row.windows if item.band == best.band][:3]:
        assert f"{window.start_utc} to {window.end_utc}" in text
    assert "known.json" in text
    never = known.model_copy(update={"planets": [row.model_copy(update={"windows": []})]})
    text = " ".join(read(page_html(plan_document(PlanReport(plan, rank, {}, {}, known=never)))).text)
    assert "In no dark hole more likely than not in that time: ε Eri b." in text


def test_remarks_on_a_users_table_stand_in_the_report(plan, rank, read):
    """Rows that are left out and a table that was cut off: on the page of whoever reads the plan."""
    remark = f"mine.csv: 2 rows left out: 2 by v_mag, {HOSTILE}"
    noted = plan.model_copy(update={"notes": [remark]})
    assert remark in " ".join(" ".join(read(page_html(plan_document(PlanReport(noted, rank, {}, {})))).text).split())
    assert "Remarks on your tables" not in page_html(plan_document(PlanReport(plan, rank, {}, {})))
