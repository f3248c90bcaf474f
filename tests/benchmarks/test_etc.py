"""Answers of the exposure-time calculator, the solver of frames over the catalogue, and the ranking."""

import itertools
import os
import subprocess
import sys

import numpy as np
import pytest

import cpic_planner as api
from cpic_planner.etc import best_in_visit, build_model, cases_of, contrast_limit, least_time, planets_of
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.ranking import rank_targets
from cpic_planner.targets import find_target, rank_sample
from simulator.config import load_instrument

INSTRUMENT = load_instrument()
MODEL = build_model(INSTRUMENT)
EVERY = rank_sample()
STAR, _ = find_target("tau Cet")
PLACE = {"separation_arcsec": 0.65}
ASKED = {
    "SNR for a time": (signal_to_noise, {"time_s": 7200.0}),
    "time for an SNR": (exposure_time, {"snr": 5.0}),
    "contrast limit": (contrast_limit, {"time_s": 7200.0}),
}


@pytest.mark.parametrize(("count", "bands"), [("one band", ("F662",)), ("four bands", MODEL.bands)])
@pytest.mark.parametrize("question", ASKED)
def test_one_answer(timed, question, count, bands):
    ask, asked = ASKED[question]
    found = timed(f"etc: {question}, {count}", lambda: ask(MODEL, STAR, bands=bands, **PLACE, **asked), repeats=5)
    assert len(found) == len(bands)


QUESTIONS = {
    "signal_to_noise": (api.signal_to_noise, {"time_s": 36e3}),
    "exposure_time": (api.exposure_time, {"snr": 5.0}),
    "detection_time": (api.exposure_time, {"detect": True}),
    "contrast_limit": (api.contrast_limit, {"time_s": 36e3}),
}


@pytest.mark.parametrize(("how", "visits"), [("chosen", {}), ("given", {"visits": 4})])
@pytest.mark.parametrize("question", QUESTIONS)
def test_one_star_by_name(timed, question, how, visits):
    """As a user asks, at another place each time: nothing but the star and the instrument is known."""
    (ask, asked), place = QUESTIONS[question], itertools.count()

    def once():
        return ask("tau Cet", separation_arcsec=0.4 + 1e-4 * next(place), **asked, **visits)

    found = timed(f"one star, programme {how}, four bands: {question}", once, repeats=3)
    assert len(found) == 4


@pytest.fixture(scope="module")
def wide():
    """Every band of both cameras."""
    return build_model(INSTRUMENT, tuple(INSTRUMENT.bands))


def problems(model):
    planets = planets_of(0.65)
    return [cases_of(model, EVERY, [band], planets).problem("snr") for band in model.bands]


def test_least_times_of_the_catalogue(timed, wide):
    found = timed("etc: catalogue x 8 bands", lambda: [least_time(part, 5.0) for part in problems(wide)])
    assert sum(part.n_frames.size for part in found) == len(EVERY) * len(wide.bands)


def test_best_frames_of_the_catalogue(timed, wide):
    found = timed(
        "etc: best frames of the catalogue",
        lambda: [best_in_visit(part, np.full(part.z0.shape, 3600.0)) for part in problems(wide)],
    )
    assert all(part.visit_s.max() <= 3600.0 * (1.0 + 1e-12) for part in found)


def test_ranking(timed):
    found = timed("ranking of the catalogue", lambda: rank_targets(MODEL, EVERY, time_s=7200.0), rounds=2)
    assert len(found.targets) == len(EVERY)


@pytest.mark.parametrize(
    ("job", "words"), [("cold `cpic etc`", ["etc", "tau Cet", "--time-s", "7200"]), ("cold `cpic rank`", ["rank"])]
)
def test_cold_command(timed, job, words):
    command = [sys.executable, "-m", "cpic_planner.cli.main", *words, "--json"]
    done = timed(job, lambda: subprocess.run(command, capture_output=True, check=True, env=os.environ), rounds=3)
    assert done.stdout
