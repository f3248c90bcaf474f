"""Noise of a visit against sums over the pixels of an aperture."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from simulator.camera import FrameNoise
from simulator.config import load_instrument, load_scene
from simulator.detectors import FrameTerm
from simulator.ledger import visit
from simulator.ledger.visit import stamp_flaws, visit_variance_e2


def random_visit(rng):
    """Return weights of the planet's and of a mean aperture, light of every pixel, frame noise and settings."""
    own, mean = rng.uniform(0.0, 1.0, (2, 5, 6)) ** rng.uniform(0.2, 4.0, (2, 1, 1))
    spread = 10.0 ** rng.uniform(-4, 4, 6)
    light = dict(zip(("planet", "halo", "other", "sky", "column", "speckle"), spread, strict=True))
    frame = FrameNoise(rng.uniform(1.0, 2.0), *10.0 ** rng.uniform(-3, 3, 4), bool(rng.random() < 0.8))
    frame = replace(frame, added={"pattern": FrameTerm(output_e2=float(10.0 ** rng.uniform(-3, 3)))})
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
    pattern_e2 = float(frame.added["pattern"].variance_e2(0.0, frame.factor2, 1.0, frame.dark_e))
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
        "pattern": over_pixels(mean, pattern_e2, 1.0),
        "speckle": systematic * systematic,
    }
    assert visit_variance_e2(planet, around, frame, **settings) == pytest.approx(expected, rel=1e-9, abs=0.0)
    del settings["flaws_e"]
    without = visit_variance_e2(planet, around, frame, **settings)
    assert without == pytest.approx(expected | {"flaws": 0.0}, rel=1e-9, abs=0.0)


def test_shares_of_speckles_are_of_the_whole_variance():
    """Squares of what builds up in the time, over everything; the least counts where it is more than the most."""
    variances = {"planet": 100.0, "halo": 44.0, "speckle": 1e6}
    speckle, walk = visit._shares(variances, (0.5, 1.2, 0.4), 10.0)
    assert speckle == pytest.approx(12.0**2 / (144.0 + 12.0**2), rel=1e-12)
    assert walk == pytest.approx(4.0**2 / (144.0 + 12.0**2), rel=1e-12)
    assert visit._shares(variances, (2.0, 1.2, 0.4), 10.0)[0] == pytest.approx(12.0**2 / (144.0 + 20.0**2), rel=1e-12)


def test_speckles_inside_the_hole_are_its_floor_and_beyond_it_the_beat_with_other_light():
    """A floor of 5 e-/s of which 3 are frozen: the walk makes 4. Beyond the hole nobody measured a floor."""
    hours = 2.5

    def floor(visit_nm, *, walk_nm_per_sqrt_hour, visit_hours, separation_arcsec):
        assert (visit_nm, visit_hours, separation_arcsec) == (0.05, hours, 0.5)
        return np.hypot(3e-9, 4e-9 if walk_nm_per_sqrt_hour > 0 else 0.0)

    metrics = SimpleNamespace(rdi_floor=floor)
    drift = SimpleNamespace(visit_nm=0.05, walk_nm_per_sqrt_hour=0.07)
    place = {"x_arcsec": 0.3, "y_arcsec": 0.4, "halo_e_s": 20.0, "scattered_e_s": 30.0}
    asked = (1e9, hours * 3600.0)
    within = visit._speckles(metrics, drift, SimpleNamespace(inside=True, **place), *asked, still=False)
    least, most, beat = visit._FLOOR_LEAST, visit._FLOOR_MOST, visit._BEAT * math.sqrt(2 * 20.0 * 30.0 + 30.0**2)
    assert within == pytest.approx((least * 5.0, most * 5.0, most * 4.0), rel=1e-12)
    beyond = visit._speckles(metrics, drift, SimpleNamespace(inside=False, **place), *asked, still=False)
    assert beyond == pytest.approx((0.0, max(most * 5.0, beat), max(most * 4.0, beat)), rel=1e-12)
    assert visit._speckles(metrics, drift, SimpleNamespace(inside=True, **place), *asked, still=True) == (0.0, 0.0, 0.0)


def test_flaws_in_an_aperture_are_counted_on_the_pixels_of_the_frame():
    """Hot pixels and bad columns of the calibration set under the weights of the planet, by their switches."""
    detector = load_instrument().detector
    side = 137
    corner = (detector.star_row - side // 2, detector.star_column - side // 2)
    flaws, _ = stamp_flaws(detector, corner, side)
    weights = np.full((side, side), 0.5)
    planet = SimpleNamespace(weights=weights, place=(slice(0, side), slice(0, side)))
    parts = {key: 0.25 * float(flaws[key].dark_e_s.sum()) for key in ("bad_pixels", "bad_columns")}
    assert sum(parts.values()) > 0.0
    assert visit._flaws_e(detector, corner, side, planet) == pytest.approx(sum(parts.values()), rel=1e-12)
    for off, left in (("bad_pixels", "bad_columns"), ("bad_columns", "bad_pixels")):
        some = detector.switched(off=(off,))
        assert visit._flaws_e(some, corner, side, planet) == pytest.approx(parts[left], rel=1e-12)
    assert visit._flaws_e(detector.switched(off=("dark",)), corner, side, planet) == 0.0


def test_the_window_of_a_visit_is_centred_on_the_star():
    scene = load_scene({"name": "s", "cstar": {"name": "star", "v_mag": 4.0, "teff_k": 5800}})
    found = visit.Visit(scene, load_instrument(), band="F662", exposure_s=10.0, n_frames=4, em_gain=50.0)
    side, detector = len(found.metrics.raw_contrast), load_instrument().detector
    row, column = found.first_pixel
    assert (row + side // 2, column + side // 2) == (detector.star_row, detector.star_column)
    assert found.visit_s == pytest.approx(4 * (10.0 + detector.readout_s), rel=1e-12)
