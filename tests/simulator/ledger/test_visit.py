"""Noise of a visit against sums over the pixels of an aperture."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from simulator.camera import FrameNoise
from simulator.ledger.visit import visit_variance_e2


def random_visit(rng):
    """Return weights of the planet's and of a mean aperture, light of every pixel, frame noise and settings."""
    own, mean = rng.uniform(0.0, 1.0, (2, 5, 6)) ** rng.uniform(0.2, 4.0, (2, 1, 1))
    spread = 10.0 ** rng.uniform(-4, 4, 6)
    light = dict(zip(("planet", "halo", "other", "sky", "column", "speckle"), spread, strict=True))
    frame = FrameNoise(rng.uniform(1.0, 2.0), *10.0 ** rng.uniform(-3, 3, 4), bool(rng.random() < 0.8))
    frame = replace(frame, added_e2={"pattern": float(10.0 ** rng.uniform(-3, 3))})
    settings = {
        "exposure_s": 10.0 ** rng.uniform(-2, 2.5),
        "n_frames": int(10 ** rng.uniform(0, 4)),
        "line_shift_s": 10.0 ** rng.uniform(-7, -3),
        "flaws_e": 10.0 ** rng.uniform(-3, 3),
    }
    return own, mean, light, frame, settings


@pytest.mark.parametrize("seed", range(40))
def test_a_visit_has_the_variance_of_its_pixels_and_frames(seed):
    """Every pixel counts with its squared weight; even light of a halo as in the wider of two apertures."""
    rng = np.random.default_rng(seed)
    own, mean, light, frame, settings = random_visit(rng)
    image = light["planet"] * rng.exponential(size=own.shape)
    off_stamp = seed % 4 == 3
    planet = SimpleNamespace(
        weights=np.zeros((0, 0)) if off_stamp else own,
        signal_e_s=np.sum(own * image),
        halo_e_s=light["halo"] * np.sum(own),
        other_e_s=light["other"] * np.sum(mean),
        sky_e_s=light["sky"] * np.sum(mean),
        column_e_s=light["column"] * np.sum(mean),
    )
    around = SimpleNamespace(noise_pixels=np.sum(mean * mean), aperture_pixels=np.sum(mean))
    share = np.sum(own * own * image) / np.sum(own * image)
    settings |= {"source_noise_fraction": share, "speckle_e_s": light["speckle"]}
    exposure_s, n_frames = settings["exposure_s"], settings["n_frames"]

    def over_pixels(weights, electrons, factor2):
        """Variance of weighted sums of independent pixels over all frames."""
        pairs = zip(weights.flat, np.broadcast_to(electrons, weights.shape).flat, strict=True)
        return sum(n_frames * factor2 * float(w) * float(w) * float(e) for w, e in pairs)

    counted = frame.factor2 if frame.photons else 0.0
    halo = light["halo"] * np.sum(own) * exposure_s
    # Off the stamp no weight is known; none is above 1.
    likely = n_frames * counted * halo if off_stamp else over_pixels(own, light["halo"] * exposure_s, counted)
    systematic = sum(exposure_s * light["speckle"] for _ in range(n_frames))  # the same error in every frame
    expected = {
        "planet": over_pixels(own, image * exposure_s, counted),
        "halo": max(likely, over_pixels(mean, halo / np.sum(mean), counted)),
        "other": over_pixels(mean, light["other"] * exposure_s, counted),
        "sky": over_pixels(mean, light["sky"] * exposure_s, counted),
        "smear": over_pixels(mean, light["column"] * settings["line_shift_s"], counted),
        "dark": over_pixels(mean, frame.dark_e, counted),
        "flaws": n_frames * counted * settings["flaws_e"],
        "clock": over_pixels(mean, frame.clock_e, frame.factor2),
        "read": over_pixels(mean, frame.read_e2, 1.0),
        "rounding": over_pixels(mean, frame.rounding_e2, 1.0),
        "pattern": over_pixels(mean, frame.added_e2["pattern"], 1.0),
        "speckle": systematic * systematic,
    }
    assert visit_variance_e2(planet, around, frame, **settings) == pytest.approx(expected, rel=1e-9, abs=0.0)
    del settings["flaws_e"]
    without = visit_variance_e2(planet, around, frame, **settings)
    assert without == pytest.approx(expected | {"flaws": 0.0}, rel=1e-9, abs=0.0)
