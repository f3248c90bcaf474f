"""Noise of a planet's aperture sum over a visit, for the sizes of effects."""

from __future__ import annotations

from simulator.camera.noise import FrameNoise
from simulator.ledger.light import PlanetPlace, Sketch
from simulator.signal.variance import FrameTerm


def visit_variance_e2(
    planet: PlanetPlace,
    sketch: Sketch,
    noise: FrameNoise,
    *,
    source_noise_fraction: float,
    exposure_s: float,
    n_frames: int,
    speckle_e_s: float,
    line_shift_s: float,
    flaws_e: float = 0.0,
) -> dict[str, float]:
    """Return the variance of the aperture sum of a planet over a visit, by origin, electrons^2.

    Parameters
    ----------
    planet : PlanetPlace
    sketch : Sketch
        Light around it.
    noise : FrameNoise
    source_noise_fraction : float
        Mean weight of the planet's light in its aperture.
    exposure_s : float
        Of one frame.
    n_frames : int
    speckle_e_s : float
        Rms of aperture sums that a reference visit leaves.
    line_shift_s : float
        Time that a row of the frame transfer takes, 0 without smear.
    flaws_e : float
        What hot pixels and bad columns add to a frame, times the squared weights.

    Notes
    -----
    ``N (F^2 w (light t + charge) + n (read^2 + rounding)) + (N t speckle)^2``: w the mean squared weight of the pixels
    of the aperture, n the sum of squared weights (`simulator.signal.variance.aperture_noise_pixels`).
    """
    pixels = sketch.noise_pixels
    fraction = pixels / sketch.aperture_pixels
    bright = float((planet.weights**2).sum()) / max(float(planet.weights.sum()), 1e-300) if planet.weights.size else 1.0
    counted = {
        "planet": FrameTerm(rate_e_s=source_noise_fraction * planet.signal_e_s),
        "halo": FrameTerm(rate_e_s=max(fraction, bright) * planet.halo_e_s),
        "other": FrameTerm(rate_e_s=fraction * planet.other_e_s),
        "sky": FrameTerm(rate_e_s=fraction * planet.sky_e_s),
        "smear": FrameTerm(charge_e=fraction * line_shift_s * planet.column_e_s),
        "dark": FrameTerm(charge_e=pixels * noise.dark_e),
        "flaws": FrameTerm(charge_e=flaws_e),
    }
    electronic = {
        "clock": FrameTerm(charge_e=pixels * noise.clock_e),
        "read": FrameTerm(output_e2=pixels * noise.read_e2),
        "rounding": FrameTerm(output_e2=pixels * noise.rounding_e2),
    } | {name: FrameTerm(output_e2=pixels * part) for name, part in noise.added_e2.items()}
    counts = n_frames * noise.photons
    # The variances of the frame's noise are those at the register input already.
    found = {name: counts * term.variance_e2(exposure_s, noise.factor2, 1.0) for name, term in counted.items()}
    found |= {name: n_frames * term.variance_e2(exposure_s, noise.factor2, 1.0) for name, term in electronic.items()}
    return {name: float(value) for name, value in found.items()} | {
        "speckle": (n_frames * exposure_s * speckle_e_s) ** 2
    }
