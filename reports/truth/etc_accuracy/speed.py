"""How long answers, catalogues and rankings take."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_planner.etc import build_model, cases_of, contrast_limit, least_time, planets_of
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.ranking import rank_targets
from cpic_planner.targets import find_target, rank_sample
from simulator.config import load_instrument

__all__ = ["SpeedRow", "speed_rows"]

STAR, SEPARATION_ARCSEC, TIME_S = "tau Cet", 0.65, 7200.0
CALL_S, CATALOGUE_S, RANKING_S = 5e-3, 0.3, 10.0
CALLS = 20


@dataclass(frozen=True)
class SpeedRow:
    """Median time of a job."""

    job: str
    cpu_s: float
    wall_s: float
    asked_s: float | None = None


def timed(job: str, run: Callable[[], Any], *, asked_s: float | None = None, rounds: int = CALLS) -> SpeedRow:
    """Median of warm runs."""
    run()
    cpu, wall = [], []
    for _ in range(rounds):
        clock, began = time.perf_counter(), time.process_time()
        run()
        cpu.append(time.process_time() - began)
        wall.append(time.perf_counter() - clock)
    return SpeedRow(job, float(np.median(cpu)), float(np.median(wall)), asked_s)


def speed_rows() -> list[SpeedRow]:
    """Every job."""
    instrument = load_instrument()
    model, every = build_model(instrument), rank_sample()
    wide = build_model(instrument, tuple(instrument.bands))
    star, _ = find_target(STAR)
    place: dict[str, Any] = {"separation_arcsec": SEPARATION_ARCSEC}
    one: dict[str, Any] = place | {"bands": "F662"}
    planets = planets_of(SEPARATION_ARCSEC)

    def catalogue() -> None:
        for band in wide.bands:
            least_time(cases_of(wide, every, [band], planets).problem("snr"), 5.0)

    return [
        timed(
            "SNR for a time, one star and band",
            lambda: signal_to_noise(model, star, time_s=TIME_S, **one),
            asked_s=CALL_S,
        ),
        timed("time for an SNR, one star and band", lambda: exposure_time(model, star, snr=5.0, **one), asked_s=CALL_S),
        timed(
            "contrast limit, one star and band",
            lambda: contrast_limit(model, star, time_s=TIME_S, **one),
            asked_s=CALL_S,
        ),
        timed("SNR for a time, one star, four bands", lambda: signal_to_noise(model, star, time_s=TIME_S, **place)),
        timed("time for an SNR, one star, four bands", lambda: exposure_time(model, star, snr=5.0, **place)),
        timed("contrast limit, one star, four bands", lambda: contrast_limit(model, star, time_s=TIME_S, **place)),
        timed(
            f"rates and least times, catalogue ({len(every)}) x {len(wide.bands)} bands",
            catalogue,
            asked_s=CATALOGUE_S,
            rounds=5,
        ),
        timed(
            "full ranking of the catalogue",
            lambda: rank_targets(model, every, time_s=TIME_S),
            asked_s=RANKING_S,
            rounds=1,
        ),
    ]
