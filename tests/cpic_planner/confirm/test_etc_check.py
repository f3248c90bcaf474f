"""Answers of the exposure-time calculator against simulated images."""

import dataclasses

import numpy as np
import pytest

from cpic_core import Outcome, Reason, Status
from cpic_planner import validation
from cpic_planner.confirm import checked_answers, etc_images, needs_images
from cpic_planner.etc import build_model, closed_form_fidelity, contrast_limit
from cpic_planner.etc.fidelity import etc_fidelity
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.targets import find_target
from simulator.config import load_instrument
from simulator.knobs import FIDELITIES, dial_of
from simulator.target import scene_sources

HOUR_S = 3600.0
SMALL = {"detector": {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}}


def model_of(*bands, **strategy):
    return build_model(load_instrument(), bands, Strategy(**strategy))


def check(model, star, answers, planet=None, dial="standard", tolerance=None, **options):
    dial = dial_of(None if tolerance is not None else dial, tolerance)
    every = len(answers)
    return checked_answers(model, [star] * every, answers, [planet] * every, dial, **options)


@pytest.fixture(scope="module")
def tau_ceti():
    return find_target("tau Cet")[0]


@pytest.fixture(scope="module")
def answer(tau_ceti):
    return signal_to_noise(model_of("F520"), tau_ceti, time_s=HOUR_S, separation_arcsec=0.6)[0]


@pytest.mark.parametrize(
    ("name", "band", "place", "strategy", "planet"),
    [
        ("tau Cet", "F520", 0.6, {}, ReferencePlanet()),
        # Companions light the hole in test_etc_images too.
        pytest.param("alpha Cen B", "F520", 0.65, {}, ReferencePlanet(radius_rjup=0.4), marks=pytest.mark.long),
        pytest.param("eps Eri", "F520", 0.65, {"library": "roll"}, ReferencePlanet(), marks=pytest.mark.long),
        pytest.param("eps Eri", "F850", 0.7, {"library": "idealised"}, None, marks=pytest.mark.long),
        ("eps Eri", "F1265", 1.0, {}, None),
        ("eps Eri", "F520", 0.65, {"mode": "photon_counting"}, None),
    ],
)
def test_images_agree_with_the_closed_form(name, band, place, strategy, planet):
    star, model = find_target(name)[0], model_of(band, **strategy)
    if planet is None:
        answers = contrast_limit(model, star, time_s=HOUR_S, separation_arcsec=place)
    else:
        answers = signal_to_noise(model, star, time_s=HOUR_S, separation_arcsec=place, planet=planet)
    (found,) = check(model, star, answers, planet, seed=5, realisations=8)
    record = found.fidelity
    assert (record.status, record.fidelity) == ("ok", "standard")
    images = record.images
    assert images.draw == "sums"
    assert images.light_ratio == pytest.approx(1.0, abs=0.005)
    assert abs(images.flux_ratio - 1.0) <= 4.0 * images.flux_ratio_error
    share, error = images.snr / images.predicted_snr, images.snr_error / images.predicted_snr
    assert images.etc_ratio == pytest.approx(images.predicted_snr / images.snr)
    assert images.etc_ratio_error / images.etc_ratio == pytest.approx(images.snr_error / images.snr)
    stated = 0.05 if record.closed_form_error is None else record.closed_form_error["snr"]
    assert abs(share - 1.0) <= stated + 3.0 * error
    assert error < 0.15
    if record.closed_form_error is not None:
        assert images.agrees == (abs(share - 1.0) <= stated + 2.0 * error)
    # Sums hold no particles: what they are compared with is the answer but for those.
    assert images.predicted_snr == pytest.approx(found.snr, rel=0.02)
    assert found.value == answers[0].value


def test_a_wrong_closed_form_is_found_out(answer, tau_ceti):
    """A planet of three times the light: flux and SNR of images say so."""
    wrong = answer.model_copy(update={"contrast": answer.contrast / 3.0})
    (found,) = check(model_of("F520"), tau_ceti, [wrong], ReferencePlanet(), realisations=4)
    images = found.fidelity.images
    assert images.light_ratio == pytest.approx(3.0, rel=0.01)
    assert images.flux_ratio == pytest.approx(3.0, abs=5.0 * images.flux_ratio_error)
    assert images.etc_ratio < 0.5  # pessimistic: images have more than twice the SNR
    assert not images.agrees


def test_a_given_contrast_is_a_grey_planet_of_that_contrast(tau_ceti):
    model = model_of("F662")
    for contrast in (1e-12, 1e-8, 1e-4):
        scene = etc_images.grey_scene(model, tau_ceti, "F662", 0.6, contrast, None)
        source = scene_sources(scene, model.instrument, "F662")[1]
        assert source.contrast == pytest.approx(contrast, rel=1e-12)
        assert np.hypot(source.x_arcsec, source.y_arcsec) == pytest.approx(0.6)


def test_the_same_seed_gives_the_same_images_and_another_seed_others(answer, tau_ceti):
    first, again, other = (
        check(model_of("F520"), tau_ceti, [answer], seed=seed, realisations=2)[0].fidelity.images for seed in (1, 1, 2)
    )
    assert first == again  # no clocks in results
    assert first.snr != other.snr
    assert first.light_ratio == other.light_ratio


@pytest.mark.parametrize("aim", [0.1, pytest.param(0.07, marks=pytest.mark.long)])
def test_the_number_of_realisations_follows_the_accuracy(answer, tau_ceti, monkeypatch, aim):
    monkeypatch.setattr(etc_images, "FEWEST", 1)
    monkeypatch.setattr(etc_images, "AIM", aim)
    images = check(model_of("F520"), tau_ceti, [answer])[0].fidelity.images
    assert images.realisations > 2
    assert 0.8 * aim < images.snr_error / images.predicted_snr < 2.0 * aim
    few = check(model_of("F520"), tau_ceti, [answer], realisations=2)[0].fidelity.images
    assert few.realisations == 2
    assert few.snr_error / few.predicted_snr > images.snr_error / images.predicted_snr


def test_a_tolerance_takes_the_cheapest_that_meets_it(answer, tau_ceti):
    model = model_of("F520")
    stated = closed_form_fidelity(0, answer).predicted_error["snr"]
    loose, least = (  # both without images
        check(model, tau_ceti, [answer], tolerance=value)[0].fidelity for value in (1.01 * stated, 1e-4)
    )
    assert (loose.fidelity, loose.status, loose.images) == ("quick", "ok", None)
    assert (least.fidelity, least.status, least.reason) == ("quick", "invalid", "tolerance_not_met")
    assert "realisations" in least.message or "sums of frames" in least.message
    assert not needs_images(answer, dial_of(tolerance=1.01 * stated))
    assert needs_images(answer, dial_of(tolerance=0.99 * stated))


@pytest.mark.long
def test_a_tolerance_below_what_is_stated_takes_images(answer, tau_ceti):
    tolerance = 0.99 * closed_form_fidelity(0, answer).predicted_error["snr"]
    tight = check(model_of("F520"), tau_ceti, [answer], tolerance=tolerance)[0].fidelity
    assert (tight.fidelity, tight.status) == ("standard", "ok")
    assert tight.predicted_error["snr"] <= 1.3 * tolerance  # the scatter of few draws is itself uncertain


@pytest.mark.long
def test_frame_by_frame_with_every_effect(tau_ceti):
    model = build_model(load_instrument(SMALL), ["F520"])
    few = signal_to_noise(model, tau_ceti, time_s=1020.0, separation_arcsec=0.6, exposure_s=60.0)[0]
    (found,) = check(model, tau_ceti, [few], ReferencePlanet(), dial="reference", realisations=1)
    images = found.fidelity.images
    assert (found.fidelity.fidelity, images.draw, images.modelled.region) == ("reference", "frames", "full")
    assert images.modelled.knobs == FIDELITIES["reference"]
    assert found.fidelity.predicted_error["planet_flux"] == 0.0
    assert images.light_ratio == pytest.approx(1.0, abs=0.005)
    assert images.predicted_snr == pytest.approx(found.snr, rel=1e-9)
    assert abs(images.flux_ratio - 1.0) <= 4.0 * images.flux_ratio_error


@pytest.mark.parametrize("averages", ["never", "visits"])
def test_a_table_agrees_with_its_images(averages, tau_ceti):
    """A residual that is the same in all visits, and one that is new in each; at a gain that bright speckles allow."""
    table = load_instrument("roman_hlc_like").changed({"coronagraph": {"stability_averages": averages}})
    model = build_model(table, None, Strategy(visits=3))
    place = {"time_s": 20 * HOUR_S, "separation_arcsec": 0.33, "em_gain": 100.0}
    answers = signal_to_noise(model, tau_ceti, contrast=6e-9, **place)
    (found,) = check(model, tau_ceti, answers, seed=2, realisations=16)
    images = found.fidelity.images
    assert images.light_ratio == pytest.approx(1.0, abs=0.03)
    assert abs(images.snr / images.predicted_snr - 1.0) < 4.0 * images.snr_error / images.predicted_snr
    assert images.n_found >= 8


def test_more_frames_than_can_be_drawn_one_by_one(answer, tau_ceti):
    many = answer.model_copy(update={"n_frames": 4001, "frames_per_visit": 4001})
    record = check(model_of("F520"), tau_ceti, [many], dial="reference")[0].fidelity
    assert (record.status, record.reason, record.images) == ("invalid", "too_many_frames", None)


def test_what_images_refuse_is_typed(tau_ceti, answer, monkeypatch):
    counted = model_of("F520", mode="photon_counting")
    there = signal_to_noise(counted, tau_ceti, time_s=HOUR_S, separation_arcsec=0.6)
    record = check(counted, tau_ceti, there, dial="reference")[0].fidelity
    assert (record.status, record.reason) == ("invalid", "not_measured_in_images")
    assert "counted in sums" in record.message
    assert record.images is None
    assert record.fidelity == "quick"
    # A frame that overfills the hole: only a contradictory answer asks for one.
    full = answer.model_copy(update={"exposure_s": 1e6, "n_frames": 1, "frames_per_visit": 1})
    record = check(model_of("F520"), tau_ceti, [full])[0].fidelity
    assert record.status == "saturated"
    assert "fidelity reference" in record.message
    refusal = Outcome.refuse(Status.INVALID, Reason.TIER_TOO_COARSE, "too coarse here")
    made = validation.modelling_of
    monkeypatch.setattr(validation, "modelling_of", lambda task: dataclasses.replace(made(task), outcome=refusal))
    record = check(model_of("F520"), tau_ceti, [answer])[0].fidelity
    assert (record.status, record.reason, record.message) == ("invalid", "tier_too_coarse", "too coarse here")


def test_answers_without_frames_stay_as_they_are(tau_ceti):
    model = model_of("F520")
    answers = signal_to_noise(model, tau_ceti, time_s=HOUR_S, separation_arcsec=[0.05, 0.6])
    steps = []
    found = check(model, tau_ceti, answers, realisations=2, advance=lambda text, n: steps.append((text, n)))
    assert found[0] is answers[0]
    assert found[1].fidelity.answer == 1
    assert sum(n for _, n in steps) == 100
    assert {text for text, _ in steps} == {"tau Cet F520"}
    record = etc_fidelity(found, dial_of("standard"), seed=1)
    assert (record.seed, [item.answer for item in record.answers]) == (1, [1])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"realisations": 0}, ["realisations", "1 to"]),
        ({"realisations": 2.5}, ["realisations"]),
        ({"seed": -1}, ["seed"]),
        ({"realisations": 3, "dial": "quick"}, ["realisations", "standard or reference"]),
        ({"realisations": 3, "tolerance": 0.1}, ["realisations", "standard or reference"]),
    ],
)
def test_bad_settings_are_refused(refused, answer, tau_ceti, options, words):
    message = refused("", check, model_of("F520"), tau_ceti, [answer], **options)
    for word in words:
        assert word in message
