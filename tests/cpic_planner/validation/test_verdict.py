"""From realisations to words: who decides, and what is said of the ETC."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_core import Outcome
from cpic_planner.validation import ConfirmTask, FrameStatistics, Measurement, Modelling, StarFlux, target_verdict
from cpic_planner.validation.verdict import audit_of, confirmation_of
from simulator.knobs import FIDELITIES, dial_of
from simulator.ledger import EffectRow
from tests.cpic_planner.measured import refused

EXPECTED = {
    "contrast": 1e-8,
    "separation_arcsec": 0.5,
    "pa_deg": 315.0,
    "time_s": 7200.0,
    "threshold": 6.0,
    "snr": 10.0,
    "significance": 12.0,
    "snr_full": 9.9,
    "significance_full": 11.9,
    "verdict": "detected",
    "chance_blind": 0.8,
    "chance_known_place": 0.99,
}
TASK = ConfirmTask(
    name="star",
    band="F520",
    simulator={},
    scene={},
    exposure_s=10.0,
    n_frames=100,
    em_gain=200.0,
    strategy={"reference_ratio": 1.0, "visit_gap_h": 0.0},
    seed=1,
    fidelity="standard",
    realisations=8,
    audit=False,
    predictions=[EXPECTED],
    planets=["b"],
)
MODELLING = Modelling(
    dial=dial_of().of("planet_flux", "snr"),
    exact=False,
    draw="sums",
    region="hole",
    knobs=FIDELITIES["standard"],
    epochs=6,
    switches={},
    left_out=(),
    still=(),
    sky=True,
    rows=(EffectRow("sums", "skipped", "sums of frames", key="summed_frames", size=0.004),),
    predicted_error={"planet_flux": 0.001, "snr": 0.004},
    outcome=Outcome.ok(0.004),
)
STAR = StarFlux(1e6, 1e3, "off_mask")


def measurement(contrast=1e-8, snr=10.0, found=True):
    return Measurement(
        contrast=contrast,
        contrast_error=1e-8 / snr,
        contrast_sigma=1e-8 / (1.2 * snr),
        snr=snr,
        significance=1.2 * snr,
        throughput=0.99,
        n_apertures=14,
        modes=1,
        found=found,
        found_at_place=True,
        search_snr=9.0,
        search_threshold=8.0,
    )


def answer(measured, *, task=TASK, story=None, star=STAR):
    how = MODELLING if story is None else MODELLING.whole()
    return confirmation_of(task, how, 0, measured, star, 0.13, statistics=story)


def realisations(n=24, factor=1.0, found=lambda k: True):
    rng = np.random.default_rng(0)
    return [measurement(1e-8 * (factor + 0.1 * z), 10.0, found(k)) for k, z in enumerate(rng.standard_normal(n))]


@pytest.mark.parametrize(
    ("seen", "chance", "placed", "word"),
    [
        (8, 0.8, 8, "confirmed (8 of 8)"),
        (4, 0.5, 5, "confirmed (4 of 8)"),
        (3, 0.8, 4, "seen at its known place, not confirmed blind (3 of 8)"),
        (3, 0.5, 3, "not confirmed (3 of 8)"),
        (0, 0.49, 0, "not detected, as predicted (0 of 8)"),
        (8, 0.125, 8, "detected, though a probability of 0.12 was predicted (8 of 8)"),
    ],
)
@pytest.mark.parametrize("significance", [3.0, 12.0])
@pytest.mark.parametrize("measured", [4.0, 12.0])
def test_the_blind_search_decides(seen, chance, placed, word, significance, measured):
    """Neither predicted nor measured significance over the small-sample threshold does: the probability says what was
    likely, and the filtered map what stands at the known place."""
    task = replace(TASK, predictions=[EXPECTED | {"significance": significance, "chance_blind": chance}])
    drawn = [
        replace(item, significance=measured, found_at_place=k < placed)
        for k, item in enumerate(realisations(8, found=lambda k: k < seen))
    ]
    found = answer(drawn, task=task)
    assert found.verdict.startswith(word)
    assert found.detected is (seen >= 4)
    assert found.n_detected == seen
    assert found.n_significant == placed
    assert (found.search_snr, found.search_threshold) == (9.0, 8.0)


@pytest.mark.parametrize(
    ("strategy", "chances", "word"),
    [
        ({}, (0.2, 0.9), "detected, though a probability of 0.20 was predicted"),
        ({"search": "known_place"}, (0.2, 0.9), "confirmed"),
        ({"library": "roll"}, (0.2, 0.9), "confirmed"),
        ({"library": "roll"}, (0.1, 0.3), "detected, though a probability of 0.30 was predicted"),
    ],
)
def test_what_was_likely_is_asked_in_the_way_that_decides(strategy, chances, word):
    expected = EXPECTED | {"chance_blind": chances[0], "chance_known_place": chances[1]}
    task = replace(TASK, predictions=[expected], strategy=TASK.strategy | strategy)
    assert answer(realisations(8), task=task).verdict.startswith(f"{word} (8 of 8)")


@pytest.mark.parametrize(
    ("significance", "word"),
    [(6.0, "confirmed"), (5.9, "detected, though a significance below the threshold was predicted")],
)
def test_where_no_law_was_measured_the_threshold_says_what_was_likely(significance, word):
    expected = EXPECTED | {"significance": significance, "chance_blind": None, "chance_known_place": None}
    assert answer(realisations(8), task=replace(TASK, predictions=[expected])).verdict.startswith(f"{word} (8 of 8)")


def test_numbers_are_those_of_one_observation():
    measured = realisations(24)
    found = answer(measured)
    contrast = np.array([item.contrast for item in measured])
    assert found.recovered_contrast == pytest.approx(contrast.mean())
    assert found.contrast_error == pytest.approx(1e-9)
    assert found.contrast_mean_error == pytest.approx(contrast.std(ddof=1) / np.sqrt(24))
    assert found.recovered_snr == pytest.approx(contrast.mean() / 1e-9)
    assert found.recovered_significance == pytest.approx(contrast.mean() / 1e-9 * 1.2)
    assert found.star_flux == "off_mask"
    assert found.star_flux_error == pytest.approx(1e-3)
    assert found.drawn_as == "sums"
    assert answer(measured, star=StarFlux.known(1e6)).star_flux == "known"


@pytest.mark.parametrize(
    ("factor", "word"),
    [
        (1.0, "ETC agrees (predicted over recovered SNR "),
        (0.7, "ETC optimistic by 4"),
        (1.5, "ETC pessimistic by 3"),
        (0.05, "ETC optimistic (predicted over recovered SNR above "),
    ],
)
def test_the_etc_is_named_where_it_is_off(factor, word):
    found = answer(realisations(24, factor))
    assert word in found.verdict
    assert (found.etc_ratio is None) == (factor == 0.05)


def test_light_that_a_limit_cuts_off_in_the_hole_is_no_detection():
    story = FrameStatistics(lost_in=7, lost_outside=400, rejected_fraction=0.01, hits=3, frames_run=400)
    found = answer(realisations(2), story=story)
    assert found.contrast_mean_error == pytest.approx(1e-9 / np.sqrt(2))
    assert found.status == "saturated"
    assert not found.detected
    assert found.saturated_in_hole == 7
    assert found.saturated_outside == pytest.approx(400 / (200 * 2))
    assert found.drawn_as == "frames"


def test_an_audit_is_compared_with_all_that_is_predicted():
    story = FrameStatistics(lost_in=0, lost_outside=10, rejected_fraction=0.02, hits=40, frames_run=50)
    record = audit_of(TASK, 0, measurement(1.15e-8), story, 1)
    assert record.predicted_snr == 9.9
    assert record.deviation_sigma == pytest.approx(1.5)
    assert record.detected
    assert record.false_detections == 1
    assert (record.frames_run, record.frames_in_all, record.n_frames) == (50, 200, 100)
    assert record.saturated_outside == pytest.approx(10 / 50)
    assert not audit_of(TASK, 0, measurement(), replace(story, lost_in=1), 0).detected


def test_a_target_in_words():
    good, bad = (
        answer(realisations(24)),
        answer(realisations(24, 0.7, lambda k: False)).model_copy(update={"band": "F850"}),
    )
    never = refused("F720")
    text, factor, error = target_verdict([good, bad, never])
    assert text.startswith("confirmed in F520; ETC")
    assert 1.0 < factor < 1.5
    assert error > 0
    assert target_verdict([bad])[0].startswith("seen at its known place, not confirmed blind; ETC optimistic by 4")
    unseen = bad.model_copy(update={"n_significant": 3})
    assert target_verdict([unseen])[0].startswith("not confirmed; ETC optimistic by 4")
    assert target_verdict([never]) == ("not observed: adc_range", None, None)
    cut = answer(realisations(2), story=FrameStatistics(5, 0, 0.0, 0, 100))
    assert target_verdict([cut])[0].startswith("saturated")
    missed = answer(realisations(24, 0.02, lambda k: False)).model_copy(update={"n_significant": 0})
    text, *ratio = target_verdict([missed])
    assert text.startswith("not confirmed; ETC optimistic (predicted over recovered SNR above ")
    assert ratio == [None, None]
    faint = missed.model_copy(update={"predicted_snr": 0.5, "recovered_snr": 0.4, "recovered_snr_error": 0.2})
    assert target_verdict([faint, faint, faint]) == ("not confirmed; too faint to measure the ETC by", None, None)


def test_how_the_images_were_made_stands_beside_the_answer():
    found = answer(realisations(8))
    assert (found.drawn_as, found.modelled.draw, found.modelled.fidelity) == ("sums", "sums", "standard")
    assert found.modelled.predicted_error == {"planet_flux": 0.001, "snr": 0.004}
    assert found.modelled.tolerance == {"planet_flux": 0.01, "snr": 0.03}
    (row,) = found.modelled.effects
    assert (row.key, row.decision, row.size) == ("summed_frames", "skipped", 0.004)
    gone = answer([*realisations(2), None], story=FrameStatistics(5, 0, 0.0, 0, 100))
    assert (gone.status, gone.drawn_as, gone.modelled.draw) == ("saturated", "frames", "frames")
