"""Science, reference and residual images that look like those of a confirmed band."""

from __future__ import annotations

import math

import numpy as np

from cpic_planner.report.image_figures import Mark, Panels
from cpic_planner.results import PlanResult
from simulator.imaging import HoleZone

PIXEL = 0.016153
INNER = {"F520": 0.165, "F662": 0.18, "F720": 0.195, "F850": 0.21}


def make_panels(band: str = "F662", *, seed: int = 1, size: int = 137) -> Panels:
    """Speckle halo, cross mask, noise, and a planet at PA 315 deg (north-west: +x, +y at parity -1)."""
    draw = np.random.default_rng(seed)
    offset = (np.arange(size) - size // 2) * PIXEL
    x, y = offset[None, :], offset[:, None]
    rho = np.hypot(x, y)
    inner, outer = INNER[band], 0.707
    inside = (np.abs(x) >= inner) & (np.abs(x) <= outer) & (np.abs(y) >= inner) & (np.abs(y) <= outer)
    speckles = np.abs(draw.normal(size=(size, size)) + 1j * draw.normal(size=(size, size))) ** 2
    halo = (
        400.0
        + 4000.0 * np.exp(-rho / 0.15) * speckles / 2
        + np.where(inside, 0.0, 2e4 / (1 + (rho / 0.3) ** 3) * (np.abs(x) > 0.155) * (np.abs(y) > 0.155))
    )
    px = py = 0.5 / math.sqrt(2.0)
    planet = 300.0 * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * 0.022**2))
    science = draw.normal(halo + planet, 1.4 * np.sqrt(halo))
    reference = draw.normal(halo, 1.4 * np.sqrt(halo))
    return Panels(
        band=band,
        science=science,
        reference=reference,
        residual=np.where(inside, science - reference, np.nan),
        pixel_scale_arcsec=PIXEL,
        aperture_radius_arcsec=0.0375,
        zone=HoleZone(inner, outer),
        marks=(Mark(px, py),),
    )


def panels_of(plan: PlanResult) -> dict[str, Panels]:
    """One for each image that the plan names."""
    keys = [(band.image, band.band) for target in plan.targets for band in target.bands if band.image]
    return {key: make_panels(band, seed=i) for i, (key, band) in enumerate(keys)}
