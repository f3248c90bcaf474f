"""Oracles that share no code with the survey: sampling, orbits, geometry and a fit, in a few lines each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cpic_planner.etc import EtcModel, aperture_rates, stack_noise, threshold_array
from cpic_planner.survey.detection import Setting
from cpic_planner.survey.universe import NEW, PlanetSample
from cpic_planner.targets import Targets
from simulator.config import MeasuredAlbedo
from simulator.target import albedo_source

FloatArray = np.ndarray[Any, np.dtype[np.float64]]


def giants(rng: np.random.Generator, n: int) -> dict[str, FloatArray]:
    """Planets of the preset ``giants``, by rejection and the generators of NumPy."""
    axis = np.empty(0)
    while axis.size < n:  # density a^-0.025 below 2.66 au and a^-1.975 above, joined there, 0.5 to 10 au
        x = rng.uniform(0.5, 10.0, 4 * n)
        density = np.where(x < 2.66, (x / 2.66) ** -0.025, (x / 2.66) ** -1.975)
        axis = np.append(axis, x[rng.uniform(0.0, 1.05, x.size) < density])
    e = np.empty(0)
    while e.size < n:
        drawn = rng.beta(1.12, 3.09, 2 * n)
        e = np.append(e, drawn[drawn < 0.95])
    return {
        "radius": rng.uniform(0.5, 1.2, n),
        "axis": axis[:n],
        "e": e[:n],
        "cos_i": rng.uniform(-1.0, 1.0, n),
        "omega": rng.uniform(0, 2 * np.pi, n),
        "node": rng.uniform(0, 2 * np.pi, n),
        "mean": rng.uniform(0, 2 * np.pi, n),
    }


def offsets(planets: dict[str, FloatArray], mass_msun: float, day: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """East, north and line-of-sight offsets (away from the observer), au, by rotation matrices."""
    period = 365.25 * np.sqrt(planets["axis"] ** 3 / mass_msun)
    mean = planets["mean"] + 2 * np.pi * day / period
    e = planets["e"]
    anomaly = mean + 0.85 * e * np.sign(np.sin(mean))
    for _ in range(50):  # Newton, damped near the pericentre
        anomaly = anomaly - np.clip((anomaly - e * np.sin(anomaly) - mean) / (1 - e * np.cos(anomaly)), -0.5, 0.5)
    true = 2 * np.arctan2(np.sqrt(1 + e) * np.sin(anomaly / 2), np.sqrt(1 - e) * np.cos(anomaly / 2))
    r = planets["axis"] * (1 - e**2) / (1 + e * np.cos(true))
    u = planets["omega"] + true
    sin_i = np.sqrt(1 - planets["cos_i"] ** 2)
    node = planets["node"]
    north = r * (np.cos(node) * np.cos(u) - np.sin(node) * np.sin(u) * planets["cos_i"])
    east = r * (np.sin(node) * np.cos(u) + np.cos(node) * np.sin(u) * planets["cos_i"])
    return east, north, r * np.sin(u) * sin_i


def detected(
    model: EtcModel, star: Targets, setting: Setting, mass_msun: float, days: Sequence[float], n: int, seed: int
) -> tuple[int, int]:
    """Planets of ``n`` that the first visit detects, and those that any of the visits does."""
    rng, first, ever = np.random.default_rng(seed), 0, 0
    metrics = model.metrics[setting.band]
    albedo = float(
        np.asarray(
            model.passbands.band_albedo(
                albedo_source(MeasuredAlbedo(model="jupiter")),
                star.teff_k,
                star.log_g,
                star.metallicity,
                only=setting.band,
            )
        ).ravel()[0]
    )
    low = metrics.hole_inner_arcsec + metrics.aperture_radius_arcsec
    high = metrics.hole_outer_arcsec - metrics.aperture_radius_arcsec
    for _ in range(10):
        planets = giants(rng, n // 10)
        hits = np.zeros((len(days), n // 10), bool)
        for k, day in enumerate(days):
            east, north, away = offsets(planets, mass_msun, day)
            r = np.sqrt(east**2 + north**2 + away**2)
            phase = np.arccos(np.clip(away / r, -1, 1))
            lambert = (np.sin(phase) + (np.pi - phase) * np.cos(phase)) / np.pi
            contrast = albedo * lambert * (planets["radius"] * 71492.0 / (r * 149597870.7)) ** 2
            # North is +y and east is -x for the default parity.
            x, y = -east / float(star.distance_pc[0]), north / float(star.distance_pc[0])
            inside = (np.abs(x) >= low) & (np.abs(x) <= high) & (np.abs(y) >= low) & (np.abs(y) <= high)
            rates = aperture_rates(model, star, setting.band, x[inside][None], y[inside][None], contrast[inside][None])
            noise = stack_noise(
                rates, setting.exposure_s, setting.n_frames, setting.em_gain, model.camera(setting.band), model.strategy
            )
            elements = metrics.resolution_elements(np.hypot(x[inside], y[inside]))
            hits[k, inside] = noise.significance[0] >= threshold_array(elements, model.strategy.sigma)
        first += int(hits[0].sum())
        ever += int(hits.any(axis=0).sum())
    return first, ever


def circle(distance_au: float, n: int) -> PlanetSample:
    """Bright planets on a face-on circle, evenly in position angle."""
    even = np.full(n, distance_au)
    whole = np.zeros(n, np.int64)
    zero = np.zeros(n)
    return PlanetSample(
        universe=np.arange(n),
        number=whole,
        known=np.full(n, NEW),
        kind=whole,
        radius_rjup=np.full(n, 1.0),
        semi_major_axis_au=even,
        eccentricity=zero,
        inclination_deg=zero,
        argument_of_pericentre_deg=zero,
        node_deg=zero,
        mean_anomaly_deg=(np.arange(n) + 0.5) * 360.0 / n,
        mass_mjup=np.ones(n),
        period_days=np.full(n, 1e3),
    )


def azimuth_share(rho: float, inner: float, outer: float) -> float:
    """Share of a circle in four squares ``inner <= |x|, |y| <= outer``, by the angles at which it enters and leaves."""
    if rho <= inner * math.sqrt(2.0) or rho >= outer * math.sqrt(2.0):
        return 0.0
    enters = math.asin(inner / rho)
    if rho > outer:
        enters = max(enters, math.acos(outer / rho))
    return max(0.0, (math.pi / 2 - 2 * enters) / (math.pi / 2))
