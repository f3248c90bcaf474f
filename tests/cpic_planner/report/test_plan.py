import base64
import hashlib
import html
import re
from dataclasses import replace

import pytest

from cpic_planner.etc import build_model
from cpic_planner.queries import LIBRARIES
from cpic_planner.queries.shared import Library
from cpic_planner.ranking import KnownChoice
from cpic_planner.ranking.known_answer import known_answer
from cpic_planner.registry import SCORES
from cpic_planner.report.confirm import calibration_sentence
from cpic_planner.report.document import page_html
from cpic_planner.report.drawing import Picture
from cpic_planner.report.plan import PlanReport, panel_pictures, plan_document, plan_figures, summary_sentences
from cpic_planner.report.words import dec_text, duration_text, ra_text
from cpic_planner.results import LeftOutRow, NotImagedRow, PeriodRecord, PlanResult, ScheduleImages, SeenRow
from cpic_planner.targets import find_target
from cpic_planner.validation import calibrate
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


def test_page_one_says_what_to_observe_first(plan, rank, sensitivity, read):
    """Which star, in which band, with which frames, when, how long, what a detection asks for, and what changes."""
    season = {"start_utc": "2028-02-03T00:00:00", "end_utc": "2028-05-20T12:00:00", "days": 100.0}
    seen = [SeenRow(name=plan.targets[0].name, usable_h=900.0, seasons=[season])]
    period = PeriodRecord(start_utc="2028-01-01", n_days=365, pointing="x", seen=seen, left_out=[], not_checked=[])
    tiers = {"ok": 1, "unreachable": 2}
    rows = [row.model_copy(update={"tier": tiers.get(row.status, 4)}) for row in rank.targets]
    page = plan_document(
        PlanReport(
            plan.model_copy(update={"period": period}), rank.model_copy(update={"targets": rows}), {}, {}, sensitivity
        )
    )
    words = read(page_html(page)).words
    first = words[words.index("What to observe first") : words.index("What the images show", words.index("Credits"))]
    best = next(band for band in plan.targets[0].bands if band.band == plan.targets[0].chosen_band)
    assert f"Observe α Cen B first, in {best.band}: {best.n_frames} frames of {best.exposure_s:g} s at EM gain" in first
    assert "It can be seen 2028-02-03 to 2028-05-20." in first
    assert first.count("2028-02-03 to 2028-05-20") == 2
    assert f" {duration_text(plan.targets[0].ranked.detection_time_s)} " in first
    counts = [sum(row.tier == tier for row in rows) for tier in (1, 2, 4)]
    for tier, count in zip((1, 2, 4), counts, strict=True):
        assert f"Tier {tier}: {count} star" in first
    assert f"What would change {sensitivity.statement}" in first
    assert "decide" not in first


def page_one(plan, rank, read, sensitivity=None):
    """Text of page one, and the cells of its table by the names of stars."""
    page = page_html(plan_document(PlanReport(plan, rank, {}, {}, sensitivity)))
    table = page[page.index("<table") : page.index("</table>")]
    rows = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.DOTALL) for row in table.split("<tr")[2:]]
    cells = [[" ".join(html.unescape(re.sub(r"<[^>]+>", " ", cell)).split()) for cell in row] for row in rows]
    words = read(page).words
    return words[: words.index("What the images show")], {row[1].partition(" HIP")[0]: row for row in cells}


def timed(plan, *hours):
    """The plan with telescope time for the chosen bands of its first targets, and of the least detection."""
    targets = []
    for target, (own, least) in zip(plan.targets, hours, strict=True):
        bands = [
            band.model_copy(
                update={"telescope_h": own, "visits": 5, "predicted_detection_probability": 0.99973}
                if band.band == target.chosen_band
                else {}
            )
            for band in target.bands
        ]
        ranks = {"rank_lowest": 1, "rank_highest": 12}
        targets.append(target.model_copy(update={"bands": bands, "detection_telescope_h": least, **ranks}))
    return plan.model_copy(update={"targets": targets})


def test_page_one_can_be_signed(plan, rank, sensitivity, read):
    """For each star visits, telescope time, least detection, SNR, probability and ranks; sums are in telescope time."""
    signed = timed(plan, (41.0, 3.7), (81.5, 11.6))
    words, rows = page_one(signed, rank, read, sensitivity)
    assert "first, in F662: 5 visits, in all 118 frames" in words
    assert "It takes 41.0 h of telescope time (2.86 h of wall time with references and readouts)." in words
    assert "All 2 stars together take 122 h of telescope time (5.72 h of wall time" in words  # 41.0 + 81.5
    assert "Rank under 3 assumptions" in words
    row = rows["α Cen B"]
    least = duration_text(plan.targets[0].ranked.detection_time_s)
    assert row[2:9] == [
        "F662 gain 36.2",
        "5 118 × 42.5 s",
        "41.0 h 2.86 h",
        row[5],
        "31.0",
        ">99.9",
        "1 to 12",
    ]
    assert row[5].startswith(f"3.70 h {least}")
    assert "The same star without its planet" in words


def test_page_one_says_which_telescope_times_it_lacks(plan, rank, read):
    words, rows = page_one(timed(plan, (41.0, 3.7), (None, None)), rank, read)
    assert "take 41.0 h of telescope time without the 1 where it is not known (5.72 h of wall time" in words
    assert rows["τ Cet"][4] == "– 2.86 h"
    words, rows = page_one(plan, rank, read)
    assert "All 2 stars together take 5.72 h of wall time; the telescope time is not known." in words
    assert rows["α Cen B"][8] == "–"


def test_page_one_takes_the_ranks_of_an_ensemble_where_there_is_one(plan, rank, read):
    first = plan.targets[0].ranked.model_copy(update={"rank_p05": 1.0, "rank_p95": 4.0})
    known = timed(plan, (41.0, 3.7), (81.5, 11.6))
    target = known.targets[0].model_copy(update={"ranked": first})
    _, rows = page_one(known.model_copy(update={"targets": [target, known.targets[1]]}), rank, read)
    assert rows["α Cen B"][8] == "1 to 4"


def test_page_one_says_what_the_reference_star_has_to_be(plan, rank, read):
    star = {"reference_star_v_mag": 3.0, "reference_star_teff_k": 5772.0}
    other = plan.model_copy(update={"reference_library": "reference_star", **star})
    words, _ = page_one(other, rank, read)
    assert "Reference frames Another star, with its own magnitude and colour. It is taken to have V 3" in words
    assert "5772 K; the plan does not choose it" in words


def test_what_the_images_show_is_a_list(plan, rank, read):
    page = page_html(plan_document(PlanReport(plan, rank, {}, {})))
    section = page[page.index('<h2 id="first"') : page.index('<h2 id="priorities"')]
    items = section[section.index("<ul>") : section.index("</ul>")]
    assert items.count("<li>") == len(summary_sentences(plan, rank)) > 3


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


def test_page_one_asks_for_a_line_for_each_target(plan, rank, page, read):
    table = page[page.index("<table") : page.index("</table>")]
    assert table.count("<tr") == len(plan.targets) + 1
    for target in plan.targets:
        assert ra_text(target.ranked.ra_deg) in table
    nothing = plan.model_copy(update={"targets": []})
    assert "so that none is proposed" in read(page_html(plan_document(PlanReport(nothing, rank, {}, {})))).words
    unseen = [target.model_copy(update={"chosen_band": None}) for target in plan.targets]
    page = page_html(plan_document(PlanReport(plan.model_copy(update={"targets": unseen}), rank, {}, {})))
    assert "the images of 2 stars show the reference planet in no band" in read(page).words


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


def test_content(words):
    for text in (
        "α Cen B",
        "HIP 71681",
        "τ Cet",
        "F662",
        "118 × 42.5",
        "outside field",
        "saturated",
        "inside the inner edge of F850",
        "What is not modelled",
        "pointing jitter",
        "SIMBAD",
        "Open Database License",
        "9d1c44ab01fe",
        "Schema version",
        "same_star_planet_free",
        "Glossary",
        "temperature, gravity or metallicity clamped",
    ):
        assert text in words, text


def test_page_one_says_what_the_ranking_depends_on(words, page):
    assert page.index('id="sensitivity"') < page.index('id="figures"')
    assert words.count("7 (wavefront drift twice as large) to 10 stay among the first 10.") == 2
    assert "Kept of first 10 Kept of first 20" in words
    assert re.search(r"wavefront drift twice as large 3 7 14 0\.42 11 α Cen A 6 τ Cet", words)
    assert re.search(r"optical throughput 0\.46 9 9 19 0\.91 13 <script>alert\('x'\)</script> 2 α Cen B", words)
    assert "the same again 7 10 20 – 0 0 α Cen B" in words
    assert "The same 1 077 stars" in words


def test_sentences_follow_the_options_of_the_run(plan, rank, read):
    page = page_html(plan_document(PlanReport(plan, rank, {}, {})))
    words = " ".join(read(page).text).split()
    words = " ".join(words)
    assert "the named template at any insolation" not in words  # a parametric albedo may follow the insolation
    assert "as many reference frames" not in words  # their number is an option
    assert "one more with every effect of single frames" in words
    assert "reduced, searched blind and measured" in words

    plain = [
        target.model_copy(update={"bands": [band.model_copy(update={"audit": None}) for band in target.bands]})
        for target in plan.targets
    ]
    other = plan.model_copy(update={"targets": plain, "reference_library": "roll"})
    words = " ".join(" ".join(read(page_html(plan_document(PlanReport(other, rank, {}, {})))).text).split())
    assert "one more with every effect of single frames" not in words
    assert "searched blind" not in words
    assert "reduced, measured at the known place" in words
    assert "a realisation is a detection if the planet is significant at its known place" in words


def test_a_report_without_sensitivity_has_no_empty_section(plan, rank):
    page = page_html(plan_document(PlanReport(plan, rank, {}, {})))
    assert 'id="sensitivity"' not in page
    assert 'href="#sensitivity"' not in page


def test_completeness_and_its_population(words):
    assert (
        "giants (Giant planets, 0.21 planets per star, 0.14 to 0.26 by different surveys), 4 000 drawn with seed 1"
        in words
    )
    assert "by completeness per hour: fraction of the population that one observation detects" in words
    assert re.search(r"α Cen B HIP 71681 1\.33 K1V 1\.255 0\.800 8\.00 ± 0\.4 F520 9\.60 F520", words)
    assert (
        "Completeness 6.80 % in F520; blind 8.16 % whatever is known of the star Expected planets of one observation "
        "0.014; 0.017 if nothing were known of the star Predicted margin 5.69 in F662" in words
    )
    for word in ("completeness", "score", "Kendall tau", "speckle floor"):
        assert f" {word} " in words


@pytest.mark.parametrize(
    ("score", "text"),
    [
        (
            "completeness_per_hour",
            "ranked by the fraction of the population giants that one observation detects per hour",
        ),
        ("completeness", "ranked by the fraction of the population giants that one observation detects, in at"),
        ("detection_margin", "ranked by how clearly a reference planet is detected"),
        ("detection_time", "ranked by how soon a reference planet is detected"),
        ("contrast_limit", "ranked by the faintest contrast that is detected"),
    ],
)
def test_the_summary_names_the_score(plan, rank, score, text):
    assert text in summary_sentences(plan, rank.model_copy(update={"score_name": score}))[0]


def test_status_badges_have_words_and_symbols(words):
    for text in ("✓ detected", "▲ saturated", "□ outside field", "○ unreachable"):
        assert text in words
    assert "✓ ok" not in words


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


def test_top_rows(plan, rank):
    page = page_html(plan_document(PlanReport(plan, rank, {}, {}, top_rows=3)))
    assert "First 3 of 20 ranked stars" in page
    assert "ε Ind A" not in page


def test_plan_without_targets(plan, rank, read):
    empty = plan.model_copy(update={"targets": [], "calibration": {"etc_ratio": None, "n_bands": 0}})
    text = " ".join(read(page_html(plan_document(PlanReport(empty, rank, {}, {})))).text)
    assert "No target was simulated as images" in text


def test_target_without_a_confirmed_band(plan, rank, read):
    bands = [plan.targets[0].bands[3]]
    target = plan.targets[0].model_copy(update={"chosen_band": None, "bands": bands})
    text = " ".join(
        read(page_html(plan_document(PlanReport(plan.model_copy(update={"targets": [target]}), rank, {}, {})))).text
    )
    assert "the images show the planet in no band" in text


def test_no_comparison_without_measurements(plan):
    nothing = plan.model_copy(update={"calibration_text": calibrate([]).text})
    assert "No band was measured" in calibration_sentence(nothing)


def test_page_one_says_how_the_etc_stands(page, words):
    sentence = "Predicted over recovered SNR 1.03 ± 0.04 over 6 measurements: the ETC agrees with the images"
    assert words.index(sentence) < words.index("What the images show")
    assert "+-" not in words
    assert "Images altered" not in words


def test_what_is_altered_is_named_before_anything_else(plan, rank, read):
    altered = plan.model_copy(update={"simulator_overrides": {"bands.*.t_opt": "x0.7", "detector.cic_e": 0.05}})
    text = " ".join(" ".join(read(page_html(plan_document(PlanReport(altered, rank, {}, {})))).text).split())
    sentence = "Images altered: throughput ×0.7, clock_charge = 0.05 e-. Predictions are nominal."
    assert text.index(sentence) < text.index("stars were ranked")


def test_the_verdict_of_every_target_and_what_was_recovered(words):
    for text in (
        "Confirmed in F662, F720; ETC agrees, 0.97 ± 0.04.",
        "8 as sums of frames",
        "Found by the blind search 8 of 8 8 of 8 8 of 8 –",
        "SNR of the search 21.6",
        "Threshold of the search 7.25",
        "Significant at the known place 8 of 8",
        "Recovered SNR ± error of the mean 26.0 ± 1.0",
        "0.3310 ± 0.0021″ PA 314.60 ± 0.35°",
        "series of the star off the mask (0.020 %)",
        "the scene's own rate: the shortest exposure off the mask saturates",
        "a realisation is a detection if the blind search finds the planet",
    ):
        assert text in words, text


def test_the_audited_case_stands_beside(words):
    assert re.search(
        r"F662 48 236 30\.7 31\.3 \S+ × 10\S+ \S+ × 10\S+ ± \S+ × 10\S+ 1\.3 ✓ found 0 444 1\.5\d 0 259", words
    )


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


def test_the_page_says_where_the_targets_come_from(plan, rank):
    """Text of a file, such as the name of a star in a schedule, is text."""
    left = LeftOutRow(name="tau Cet", rank=1, usable_h=0.0, needed_h=2.0, message="not seen in 3 d")
    period = PeriodRecord(start_utc="2028-01-01", n_days=3, pointing="default", left_out=[left], not_checked=[])
    seen = page_html(plan_document(PlanReport(plan.model_copy(update={"period": period}), rank, {}, {})))
    assert "limited by visibility: τ Cet, rank 1 (not seen in 3 d)" in seen
    bad = NotImagedRow(row=2, star=HOSTILE, band="F520", message="no star of the catalogue has this name")
    made = ScheduleImages(source="2 visits of deep", n_visits=2, n_imaged=1, n_stars=1, not_imaged=[bad])
    target = plan.targets[0].model_copy(update={"roll_deg": 30.0})
    asked = plan.model_copy(update={"schedule": made, "targets": [target]})
    page = page_html(plan_document(PlanReport(asked, rank, {}, {})))
    assert "the images stand for 1 of 2 visits." in page
    assert "No images of row 2 (&lt;script&gt;" in page
    assert "First and confirmed is" in page or "Highest ranked" not in page
    assert "30 deg" in page


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
