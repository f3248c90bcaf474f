"""Curves around an answer of the exposure-time calculator: SNR against time, contrast limit against separation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.answer import EtcAnswer
from cpic_planner.etc.cases import FrameWish, band_cases, planets_of
from cpic_planner.etc.frames import best_in_visit
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import Objective
from cpic_planner.etc.questions import contrast_limit
from cpic_planner.optimiser import separation_grid
from cpic_planner.targets import Targets
from simulator.outcome import Status

FloatArray = NDArray[np.float64]
N_TIMES = 90
TIME_SPAN = (1.0 / 300.0, 30.0)


@dataclass(frozen=True)
class TimeCurve:
    """SNR and significance of one planet in one band against the wall time that is allowed; NaN without a frame.

    ``point`` holds time, SNR and significance of the answer, if there is one.
    """

    label: str
    time_s: FloatArray
    snr: FloatArray
    significance: FloatArray
    threshold: float
    point: tuple[float, float, float] | None


@dataclass(frozen=True)
class SeparationCurve:
    """Contrast limit in one band against separation; NaN where there is none. ``planets``: separation and contrast."""

    label: str
    separation_arcsec: FloatArray
    contrast: FloatArray
    planets: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class EtcCurves:
    """What a figure of an answer shows; ``limit_time_s`` is the time of the limits, ``limit_level`` their level."""

    times: tuple[TimeCurve, ...]
    limits: tuple[SeparationCurve, ...]
    limit_time_s: float
    limit_level: str


def etc_curves(
    model: EtcModel,
    star: Targets,
    answers: Sequence[EtcAnswer],
    *,
    time_s: float,
    best_band: str | None = None,
    snr: float | None = None,
    sigma: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> EtcCurves:
    """Curves around the answers to one question about one star.

    Parameters
    ----------
    model : EtcModel
    star : Targets
        One star.
    answers : sequence of EtcAnswer
    time_s : float
        Wall time that the limits are for; the middle of the axis of times where an answer has none.
    best_band : str, optional
        Band of the lines against time where there are several planets; with one planet every band has its line.
    snr, sigma : float, optional
        Level of the limits; the small-sample threshold where neither is given.
    exposure_s, em_gain : float, optional
        What was fixed.
    """
    wish = FrameWish(exposure_s, em_gain)
    objective: Objective = "snr" if sigma is None and (snr is not None or not _detects(answers)) else "significance"
    several = len(answers) > len({answer.band for answer in answers})
    drawn = [answer for answer in answers if answer.band == best_band or not several]
    times = [_against_time(model, star, answer, wish, objective, time_s, several) for answer in drawn]
    limits = [
        _against_separation(model, star, band, answers, time_s, snr, sigma, wish)
        for band in dict.fromkeys(answer.band for answer in answers)
    ]
    level = "a detection"
    if snr is not None or sigma is not None:
        level = f"SNR {snr:g}" if snr is not None else f"{sigma:g} sigma"
    return EtcCurves(tuple(curve for curve in times if curve is not None), tuple(limits), time_s, level)


def _detects(answers: Sequence[EtcAnswer]) -> bool:
    return any(answer.question != "signal_to_noise" for answer in answers)


def _against_time(
    model: EtcModel,
    star: Targets,
    answer: EtcAnswer,
    wish: FrameWish,
    objective: Objective,
    time_s: float,
    several: bool,
) -> TimeCurve | None:
    """One line of SNR against time; none where the planet is outside the field or sends no light."""
    if answer.contrast is None or not 0.0 < answer.contrast <= 1.0 or answer.status is Status.OUTSIDE_FIELD:
        return None
    centre = answer.time_s or time_s
    grid = np.geomspace(TIME_SPAN[0] * centre, TIME_SPAN[1] * centre, N_TIMES)
    planets = planets_of([answer.separation_arcsec] * N_TIMES, None, answer.contrast)
    cases = band_cases(model, star, answer.band, planets, wish)
    choice = best_in_visit(cases.problem(objective), model.visit_s(grid)[None, :])
    noise = cases.noise(choice)
    point = None
    if answer.time_s is not None and answer.snr is not None and answer.significance is not None:
        point = (answer.time_s, answer.snr, answer.significance)
    label = answer.band + (f", {answer.separation_arcsec:.3f}″" if several else "")
    seen = choice.n_frames[0] >= 1
    return TimeCurve(
        label,
        grid,
        np.where(seen, noise.snr[0], np.nan),
        np.where(seen, noise.significance[0], np.nan),
        float(cases.threshold[0]),
        point,
    )


def _against_separation(
    model: EtcModel,
    star: Targets,
    band: str,
    answers: Sequence[EtcAnswer],
    time_s: float,
    snr: float | None,
    sigma: float | None,
    wish: FrameWish,
) -> SeparationCurve:
    grid = separation_grid(model, band)
    found = contrast_limit(
        model,
        star,
        time_s=time_s,
        separation_arcsec=grid.tolist(),
        bands=[band],
        snr=snr,
        sigma=sigma,
        exposure_s=wish.exposure_s,
        em_gain=wish.em_gain,
    )
    planets = tuple(
        (answer.separation_arcsec, answer.contrast) for answer in answers if answer.band == band and answer.contrast
    )
    return SeparationCurve(band, grid, np.array([np.nan if one.value is None else one.value for one in found]), planets)
