"""Answers of the exposure-time calculator, the solver of frames over the catalogue, and the ranking.

``make bench`` prints the times. There is no limit on the clock here: machines differ. ``reports/etc_accuracy`` has the
figures of one machine.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from cpic_planner.etc.cases import FrameWish, band_cases, planets_of
from cpic_planner.etc.frames import best_in_visit, least_time
from cpic_planner.etc.model import build_model
from cpic_planner.etc.questions import contrast_limit, exposure_time, signal_to_noise
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
MEDIANS: dict[tuple[str, str], float] = {}


@pytest.fixture(scope="module", autouse=True)
def times(printed) -> Iterator[None]:
    yield
    with printed() as line:
        line("\nexposure-time calculator, median seconds")
        for (job, name), seconds in MEDIANS.items():
            line(f"  {job:28s} {name:44s} {seconds:9.4f} s")


def timed(benchmark, job, name, function, *, rounds=10):
    """Run a job, once before it counts, and keep its median."""
    answer = benchmark.pedantic(function, rounds=rounds, warmup_rounds=1)
    MEDIANS[job, name] = benchmark.stats.stats.median
    return answer


@pytest.mark.parametrize("bands", [("F662",), MODEL.bands], ids=["one band", "four bands"])
@pytest.mark.parametrize("question", ASKED)
def test_one_answer(benchmark, question, bands):
    ask, asked = ASKED[question]
    found = timed(
        benchmark, question, f"one star, {len(bands)} bands", lambda: ask(MODEL, STAR, bands=bands, **PLACE, **asked)
    )
    assert len(found) == len(bands)


@pytest.fixture(scope="module")
def wide():
    """Every band of both cameras."""
    return build_model(INSTRUMENT, tuple(INSTRUMENT.bands))


def problems(model):
    planets = planets_of(0.65)
    return [band_cases(model, EVERY, band, planets, FrameWish()).problem("snr") for band in model.bands]


@pytest.mark.parametrize("level", [1.0, 5.0])
def test_least_times_of_the_catalogue(benchmark, wide, level):
    name = f"{len(EVERY)} stars x {len(wide.bands)} bands, SNR {level:g}"
    found = timed(
        benchmark, "rates and least times", name, lambda: [least_time(part, level) for part in problems(wide)]
    )
    assert sum(part.n_frames.size for part in found) == len(EVERY) * len(wide.bands)


def test_best_frames_of_the_catalogue(benchmark, wide):
    name = f"{len(EVERY)} stars x {len(wide.bands)} bands, 3600 s"
    found = timed(benchmark, "rates and best frames", name,
                  lambda: [best_in_visit(part, np.full(part.z0.shape, 3600.0)) for part in problems(wide)])  # fmt: skip
    assert all(part.visit_s.max() <= 3600.0 * (1.0 + 1e-12) for part in found)


def test_ranking(benchmark):
    found = timed(
        benchmark, "ranking", f"{len(EVERY)} stars", lambda: rank_targets(MODEL, EVERY, time_s=7200.0), rounds=2
    )
    assert len(found.targets) == len(EVERY)
