"""What was modelled, in words and as tables."""

import pytest

from cpic_planner.report.confirm import modelled_groups, modelled_sentence
from cpic_planner.report.document import page_html
from cpic_planner.report.plan import PlanReport, plan_document
from cpic_planner.report.ranking import velocities_sentence
from cpic_planner.report.words import dial_text, error_text


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


def test_sets_that_are_made_alike_share_a_table(make_modelled):
    first, second, frames = make_modelled(0.001), make_modelled(0.003), make_modelled(0.0, "frames")
    alike, other = modelled_groups([("a", first), ("b", second), ("c", frames)])
    assert (alike.names, other.names) == (("a", "b"), ("c",))
    assert alike.title == "Sums of frames over the dark hole"
    assert "4 wavelengths a band" in alike.knobs
    assert "6 epochs" in alike.knobs
    assert alike.errors == "planet flux 0.20 %, SNR 0.70 % (asked: at most planet flux 1.0 %, SNR 3.0 %)"


def test_rows_stand_by_their_size(make_modelled):
    (group,) = modelled_groups([("a", make_modelled(0.001)), ("b", make_modelled(0.003))])
    assert [row.effect.key for row in group.rows] == ["sky", "summed_frames", "serial_cti", "photon_noise"]
    assert [row.size for row in group.rows] == ["21 %", "0.40 %", "0.30 %", ""]
    assert [row.where for row in group.rows] == ["", "", "b", ""]
    assert [row.word for row in group.rows] == ["kept", "as sums", "left out", "kept"]
    (absent,) = modelled_groups([("a", make_modelled(0.0))])
    assert [row.effect.key for row in absent.rows][-2:] == ["photon_noise", "serial_cti"]


def test_one_sentence_for_all_images(plan):
    bands = [band for target in plan.targets for band in target.bands]
    largest = max(band.modelled.predicted_error["snr"] for band in bands if band.modelled)
    text = modelled_sentence(bands)
    assert text.startswith("Images: sums of frames over the dark hole; predicted error beside the reference: planet")
    assert error_text({"snr": largest}) in text
    assert modelled_sentence([]) == ""


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
