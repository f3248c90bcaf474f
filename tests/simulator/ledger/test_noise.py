"""Noise of the ledger against a register followed stage by stage, and against sums over the pixels of an aperture."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from simulator import load_instrument
from simulator.ledger.noise import FrameNoise, visit_variance_e2

INSTRUMENT = load_instrument()
SWITCHES = ("photon_noise", "dark", "clock_charge", "em_register", "read_noise")
LIGHT = np.array([0.0, 1e-4, 0.3, 50.0, 1e6])


def through_register(mean_e, variance_e2, gain, stages):
    """Return the variance at the output over gain^2: a stage doubles each electron with the probability ``p``."""
    p, mean, variance = gain ** (1.0 / stages) - 1.0, mean_e, variance_e2
    for _ in range(stages):
        mean, variance = mean * (1.0 + p), variance * (1.0 + p) ** 2 + mean * p * (1.0 - p)
    return variance / gain**2


# Without photon noise the register's own noise on light that does not fluctuate is outside what is asked here.
@pytest.mark.parametrize("on", [on for on in itertools.product((True, False), repeat=5) if on[0] or not on[3]])
def test_a_pixel_has_the_variance_of_its_electrons_stage_by_stage(on):
    switched = dict(zip(SWITCHES, on, strict=True))
    own = {"cic_e": 0.07, "read_noise_e": 83.0, "gain_e_adu": 47.0, "switches": switched}
    detector = load_instrument({"detector": own}).detector
    for gain, dark_e in itertools.product((1.0, 1.7, 40.0, 1000.0), (0.0, 0.2, 30.0)):
        drawn = (LIGHT + dark_e * switched["dark"]) * switched["photon_noise"] + 0.07 * switched["clock_charge"]
        charge = drawn  # of Poisson counts and a gain without noise
        if switched["em_register"]:
            charge = through_register(drawn, drawn, gain, detector.register_stages)
        # A uniform error of one step, and the amplifier behind the register.
        behind = ((83.0**2 if switched["read_noise"] else 0.0) + 47.0**2 / 12.0) / gain**2
        found = FrameNoise.of(detector, gain, dark_e).variance_e2(LIGHT)
        np.testing.assert_allclose(found, charge + behind, rtol=1e-10, atol=1e-300)


@pytest.mark.parametrize("on", list(itertools.product((True, False), repeat=3)))
def test_a_pixel_of_a_hybrid_array_has_neither_register_nor_clocks(on):
    photons, dark, read = on
    own = {
        "read_noise_e": 21.0,
        "gain_e_adu": 3.0,
        "switches": {"photon_noise": photons, "dark": dark, "read_noise": read},
    }
    detector = load_instrument({"near_infrared": {"detector": own}}).near_infrared.detector
    expected = (LIGHT + 5.0 * dark) * photons + 441.0 * read + 0.75
    np.testing.assert_allclose(FrameNoise.of(detector, 1.0, 5.0).variance_e2(LIGHT), expected, rtol=1e-14)


def random_visit(rng):
    """Return weights of the planet's and of a mean aperture, light of every pixel, frame noise and settings."""
    own, mean = rng.uniform(0.0, 1.0, (2, 5, 6)) ** rng.uniform(0.2, 4.0, (2, 1, 1))
    spread = 10.0 ** rng.uniform(-4, 4, 6)
    light = dict(zip(("planet", "halo", "other", "sky", "column", "speckle"), spread, strict=True))
    frame = FrameNoise(rng.uniform(1.0, 2.0), *10.0 ** rng.uniform(-3, 3, 4), bool(rng.random() < 0.8))
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
    sketch = SimpleNamespace(noise_pixels=np.sum(mean * mean), aperture_pixels=np.sum(mean))
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
        "speckle": systematic * systematic,
    }
    assert visit_variance_e2(planet, sketch, frame, **settings) == pytest.approx(expected, rel=1e-9, abs=0.0)
    del settings["flaws_e"]
    without = visit_variance_e2(planet, sketch, frame, **settings)
    assert without == pytest.approx(expected | {"flaws": 0.0}, rel=1e-9, abs=0.0)
