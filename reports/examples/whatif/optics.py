"""Predicted beside recovered SNR where a strategy assumes another raw contrast, and what scaled light would predict."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_planner.etc import build_model
from cpic_planner.survey.prepare import (
    assumed_model,
    imaged_model,
    mirror_noise_nm,
    with_contrast,
)
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.targets import find_target
from cpic_planner.validation import Frames, confirm_task, expected_of, star_scene, task_of
from simulator import load_instrument
from simulator.config import ConstantAlbedo, Planet
from simulator.target import sky_to_detector

STAR, FRAMES, REALISATIONS = "eps Eri", Frames(25.0, 200, 300.0), 24
PLACES = tuple((pa_deg, separation) for separation in (0.55, 0.7) for pa_deg in (45.0, 135.0, 225.0, 315.0))
CASES = tuple(itertools.product(("F520", "F850"), (1e-8, 3e-9)))
ALBEDO = 0.5
PLANET_CONTRAST = {1e-8: 1.5e-7, 3e-9: 7e-8}


def images(band: str, contrast: float) -> dict[str, Any]:
    """One band at one contrast: ratios of SNRs over all places."""
    from simulator.target import contrast_at

    instrument, strategy = load_instrument(), SurveyStrategy(name="x", assumptions={"contrast": contrast})
    model = imaged_model(assumed_model(instrument, strategy, (band,)), strategy, band)
    assert model is not None
    nominal = build_model(instrument, (band,)).metrics[band]
    scaled = replace(model, metrics={band: with_contrast(nominal, contrast)})
    star, ratios, errors, light = find_target(STAR)[0], [], [], []
    for pa_deg, separation in PLACES:
        distance_au = float(separation * star.distance_pc[0])
        radius = float(np.sqrt(PLANET_CONTRAST[contrast] / float(contrast_at(1.0, distance_au, 90.0, ALBEDO))))
        planet = Planet(
            name="planet",
            separation_arcsec=float(separation),
            pa_deg=pa_deg,
            radius_rjup=radius,
            albedo=ConstantAlbedo(value=ALBEDO),
            distance_au=distance_au,
            phase_deg=90.0,
        )
        place = sky_to_detector(float(separation), pa_deg, parity=instrument.detector.parity)
        expected = expected_of(model, star, band, place, PLANET_CONTRAST[contrast], FRAMES)
        task = task_of(
            model,
            star_scene(star, (planet,), name=STAR, exozodi_zodis=1.0),
            band,
            FRAMES,
            [expected],
            seed=3,
            fidelity="standard",
            realisations=REALISATIONS,
            audit=False,
            overrides=None,
        )
        found = confirm_task(task.to_dict())["confirmations"][0]
        ratios.append(found["etc_ratio"])
        errors.append(found["etc_ratio_error"])
        other = expected_of(scaled, star, band, place, PLANET_CONTRAST[contrast], FRAMES)
        light.append(found["etc_ratio"] * other["snr_full"] / expected["snr_full"])
    n = len(ratios)
    return {
        "band": band,
        "contrast": contrast,
        "nominal": nominal.median_contrast,
        "mirror_noise_nm": mirror_noise_nm(instrument, band, contrast),
        "ratio": float(np.mean(ratios)),
        "error": float(np.std(ratios, ddof=1) / np.sqrt(n)),
        "worst": float(max(ratios, key=lambda value: abs(np.log(value)))),
        "scaled": float(np.mean(light)),
        "scaled_worst": float(max(light)),
        "images": n * REALISATIONS,
    }


def run() -> list[dict[str, Any]]:
    """All cases."""
    return [images(*case) for case in CASES]
