"""What was modelled, in words and as tables."""

import pytest

from cpic_planner.report.confirm import ConfirmReport, confirm_blocks, confirm_document, measure_table, outcome_text
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import snr_figure
from cpic_planner.report.plan import PlanReport, plan_document
from cpic_planner.report.ranking import velocities_sentence
from cpic_planner.report.simulation import effect_rows, ways_texts
from cpic_planner.report.words import dial_text, error_text
from cpic_planner.report.writing import first_table, page_html

HOSTILE = "<script>alert('x')</script>"


@pytest.fixture(scope="module")
def page(confirmation):
    picture = Picture("data:image/png;base64,", "alt", "caption.")
    figures = {"calibration": snr_figure(confirmation), f"Clouds of {HOSTILE}": picture}
    return page_html(confirm_document(ConfirmReport(confirmation, figures, {"F520": picture})))


def test_nothing_is_loaded_from_outside_and_names_are_text(page, reader, words):
    reader.check_alone()
    assert HOSTILE not in page
    assert HOSTILE in words


def test_anchors_and_captions(reader):
    reader.check_anchors()


def test_a_scene_without_planets_has_its_search_alone(confirmation, read):
    update = {"bands": [], "positions": [], "albedos": [], "calibration": {"etc_ratio": None, "n_bands": 0}}
    text = " ".join(
        " ".join(
            read(page_html(confirm_document(ConfirmReport(confirmation.model_copy(update=update), {}, {})))).text
        ).split()
    )
    assert "0 planets in F520, F662" in text
    assert "nothing to compare with a prediction" in text
    assert "No band was measured, so" not in text
    assert "Positions" not in text


def test_rolls_are_not_searched(confirmation, read):
    rolled = confirmation.model_copy(update={"searches": [], "reference_library": "roll"})
    text = " ".join(" ".join(read(page_html(confirm_document(ConfirmReport(rolled, {}, {})))).text).split())
    assert "Two rolls show every planet twice" in text
    assert "searched blind and measured" not in text
    assert "the star subtracted, measured at the known place" in text
    assert "a realisation is a detection if the planet is significant at its known place" in text


@pytest.mark.parametrize(
    ("found", "outcome"),
    [
        ((True, True), "a scene: confirmed by simulated images in 2 of 2 bands"),
        ((False, True), "a scene: confirmed by simulated images in 1 of 2 bands"),
        ((False, False), "a scene: not confirmed by simulated images in any of 2 bands"),
        ((None, None), "a scene: not measured in simulated images"),
        ((None, True), "a scene: confirmed by simulated images in 1 of 2 bands"),
        ((None, False), "a scene: not confirmed by simulated images in any of 2 bands"),
        ((True,), "a scene: confirmed by simulated images in F520"),
        ((False,), "a scene: not confirmed by simulated images in F520"),
    ],
)
def test_the_title_follows_the_outcome_in_the_window_and_on_the_page(confirmation, found, outcome):
    """Nothing is called confirmed that images do not show: window, heading and console say the same."""
    one = next(band for band in confirmation.bands if band.recovered_snr is not None)
    blank = one.model_copy(update={"recovered_snr": None, "detected": None, "n_detected": None})
    bands = [
        (blank if seen is None else one.model_copy(update={"detected": seen})).model_copy(update={"band": name})
        for seen, name in zip(found, ("F520", "F662"), strict=False)
    ]
    result = confirmation.model_copy(update={"scene": "a scene", "bands": bands, "searches": []})
    page = page_html(confirm_document(ConfirmReport(result, {}, {})))
    assert f"<h1>{outcome}</h1>" in page
    assert f"<title>CPI-C: {outcome}, configuration" in page
    assert first_table(confirm_blocks(result)).title == f"{outcome}, 8 realisations a band"


def test_several_planets_count_their_measurements(confirmation):
    one = next(band for band in confirmation.bands if band.recovered_snr is not None)
    bands = [one.model_copy(update={"planet": planet, "detected": planet == "b"}) for planet in "bc"]
    assert outcome_text(bands) == "confirmed by simulated images in 1 of 2 measurements"


def test_two_statistics_in_one_table_are_told_apart(confirmation, read):
    """Found blind 7 of 8 and significant at the known place in none of 8: the table says why, and which decides."""
    one = next(band for band in confirmation.bands if band.recovered_snr is not None)
    seen = one.model_copy(update={"n_detected": 7, "n_significant": 0, "search_threshold": 5.4, "threshold": 9.0})
    table = measure_table("a", [seen], "a by band.")
    assert "Two statistics with two thresholds" in str(table.caption)
    assert "The blind search decides" in str(table.caption)
    looked = seen.model_copy(update={"search_threshold": None, "search_snr": None})  # two rolls: one statistic
    assert "Two statistics" not in str(measure_table("a", [looked], "a by band.").caption)


def test_the_dial_in_words(plan):
    assert dial_text(plan) == "fidelity standard"
    tolerant = plan.model_copy(update={"fidelity": "custom", "tolerance": {"planet_flux": 0.02, "snr": 0.02}})
    assert dial_text(tolerant) == "tolerance 2.0 %"


@pytest.mark.parametrize(
    ("errors", "text"),
    [
        ({"planet_flux": 0.0123, "snr": 0.0}, "planet flux 1.2 %, SNR 0 %"),
        ({"snr": 3e-9}, "SNR below 0.0001 %"),
        ({"pixel_map": 0.02}, "pixels of a frame 2.0 %"),
        ({}, ""),
    ],
)
def test_errors_in_words(errors, text):
    assert error_text(errors) == text


def test_sets_that_are_made_alike_share_a_paragraph(make_modelled):
    first, second, frames = make_modelled(0.001), make_modelled(0.003), make_modelled(0.0, "frames")
    (way, said), (_, other) = ways_texts([("a", first), ("b", second), ("c", frames)])
    assert way == "Sums of frames over the dark hole"
    assert said.startswith("a, b. ")
    assert other.startswith("c. ")
    for text in (
        "4 wavelengths a band",
        "6 epochs",
        "planet flux 0.20 %, SNR 0.70 % (asked: at most planet flux 1.0 %",
    ):
        assert text in said


def test_effects_stand_by_their_size(make_modelled):
    rows = effect_rows([("a", make_modelled(0.001)), ("b", make_modelled(0.003))])
    assert [row.effect.key for row in rows] == ["sky", "summed_frames", "serial_cti", "photon_noise"]
    assert [row.where for row in rows] == ["", "", "b", ""]
    assert [dict(row.decisions) for row in rows] == [{"kept": 2}, {"as sums": 2}, {"left out": 2}, {"kept": 2}]
    absent = effect_rows([("a", make_modelled(0.0))])
    assert [row.effect.key for row in absent][-2:] == ["photon_noise", "serial_cti"]


def test_the_report_has_the_table_once_and_escapes_it(plan, rank, read):
    page = page_html(plan_document(PlanReport(plan, rank, {}, {})))
    assert page.count("What was modelled") == 2  # heading and contents
    assert "uniform &lt;b&gt;" in page
    words = read(page).words if hasattr(read(page), "words") else page
    for text in ("Predicted size", "left out", "Predicted error of the images", "frame by frame"):
        assert text in words


def test_a_band_without_a_valid_tier_says_so(plan, rank, make_modelled):
    target = plan.targets[0]
    head = target.bands[0].model_copy(
        update={
            "status": "invalid",
            "reason": "tier_too_coarse",
            "verdict": "not modelled",
            "recovered_snr": None,
            "message": "quick is predicted to be off by 9 %: take --fidelity standard",
            "modelled": make_modelled(0.09),
            "detected": None,
            "n_detected": None,
            "etc_ratio": None,
            "realisations": None,
            "image": None,
        }
    )
    changed = target.model_copy(update={"bands": [head, *target.bands[1:]]})
    page = page_html(plan_document(PlanReport(plan.model_copy(update={"targets": [changed]}), rank, {}, {})))
    assert "take --fidelity standard" in page
    assert "✕" in page


def test_velocities_exclude_or_are_missing(rank):
    star, other = rank.targets[0], rank.targets[1]
    rank = rank.model_copy(
        update={
            "targets": [
                star.model_copy(update={"flags": [*star.flags, "excluded_by_rv"]}),
                other.model_copy(update={"flags": [], "completeness": 0.1, "rv_amplitude_m_s": 4.14}),
            ],
            "population": rank.population.model_copy(update={"exclusions": ["rv"]}),
        }
    )
    told = velocities_sentence(rank, 2)
    assert told.startswith("Radial velocities already exclude the reference planet around ")
    assert "amplitudes of: " in told
    assert " 4.1 m/s at " in told
    assert "amplitudes" not in velocities_sentence(rank, 1)
