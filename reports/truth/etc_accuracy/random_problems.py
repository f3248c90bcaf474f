"""Random but realistic problems of choosing frames: stars x bands, planets, halos, residuals and bright pixels."""

from __future__ import annotations

import numpy as np

from cpic_planner.etc import FrameCamera, FrameProblem

WAVELENGTHS_NM = np.array([520.0, 662.0, 720.0, 850.0, 940.0, 1265.0, 1425.0, 1542.0])
WIDTHS = np.array([0.2, 0.1, 0.06, 0.1, 0.1, 0.1, 0.1, 0.1])
FADING = np.array([1.0, 0.92, 0.68, 0.41, 0.3, 0.3, 0.2, 0.2])  # of the planet against the star
END_TO_END, CORE = 0.03, 0.14
AREA_CM2, PIXEL_ARCSEC, ARCSEC_PER_RAD = 31416.0, 0.016153, 206265.0


def random_problem(n_stars: int, camera: FrameCamera, *, seed: int) -> FrameProblem:
    """Problems of shape ``(n_stars, 8)``; a fifth of them without walk within a visit, a seventh without speckles."""
    rng = np.random.default_rng(seed)
    shape = (n_stars, WAVELENGTHS_NM.size)

    def decades(low: float, high: float) -> np.ndarray:
        return 10.0 ** rng.uniform(low, high, shape)

    magnitude = rng.uniform(0.0, 7.0, (n_stars, 1))
    photons = 1000.0 * 10.0 ** (-0.4 * magnitude) * (550.0 / WAVELENGTHS_NM) * WIDTHS * WAVELENGTHS_NM * 10.0
    star = photons * AREA_CM2 * END_TO_END
    planet = star * 10.0 ** rng.uniform(-9.5, -7.0, (n_stars, 1)) * FADING * CORE
    radius = 0.7 * WAVELENGTHS_NM * 1e-9 / 2.0 * ARCSEC_PER_RAD / PIXEL_ARCSEC  # pixels, 2 m telescope
    twice = 2.0 * (1.0 - 1.0 / (3.0 * radius))
    area = np.pi * radius**2
    residual = (decades(-12.0, -9.0) * 0.3 * star / planet) ** 2
    growth, kind = decades(-7.0, -3.5), rng.random(shape)
    z0 = np.where(kind < 0.15, 0.0, residual)
    brightest = star * decades(-9.0, -6.0)
    return FrameProblem(
        alpha_e_s=0.9 * planet + twice * (0.5 * star * decades(-10.0, -8.0) + decades(-4.0, -1.0)),
        beta_e=np.broadcast_to(twice * area * camera.cic_e, shape).copy(),
        gamma_e2=np.broadcast_to(twice * area * camera.read_variance_e2, shape).copy(),
        signal_e_s=planet,
        z0=z0,
        z1=np.where(kind > 0.8, 0.0, z0 * growth),
        z2=np.where(kind > 0.6, 0.0, z0 * growth**2 * rng.random(shape)),
        loss_per_s=decades(-6.0, -3.0),
        peak_columns_e_s=star * decades(-7.0, -3.0),
        peak_in_hole_e_s=brightest,
        register_tail_e_s=brightest * decades(-1.0, 1.0),
        visits=np.ones(shape),
        camera=camera,
    )
