"""The paper's error formula as a prediction: by hand, against its measured version, and against the full model."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from cpic_planner.etc import ApertureRates, FrameCamera, Programme, stack_noise
from cpic_planner.etc.noise import SPECKLE_COHERENCE, snr_paper
from cpic_planner.validation import aperture_photometry
from simulator import load_instrument, observe
from simulator.detectors import excess_noise_factor2
from simulator.imaging import aperture_sums, overlap_weights, psf_metrics
from simulator.signal import ProgrammeLaw, SpeckleLaw

CAMERA = FrameCamera.of(load_instrument(), "F520")
QUIET = replace(CAMERA, read_noise_e=0.0, rounding_e=0.0, cic_e=0.0)
AREA = 20.0


def rates(planet=0.02, halo=0.03, dark=0.01, speckle=(0.0, 0.0, 0.0), **changes):
    one = np.ones(1)
    given = {field.name: one for field in fields(ApertureRates)}  # of no account, but for what follows
    given |= {
        "planet_e_s": planet * one,
        "halo_e_s": halo * one,
        "companion_e_s": 0.0 * one,
        "sky_e_s": 0.0 * one,
        "exozodi_e_s": 0.0 * one,
        "dark_e_s": dark * one,
        "speckle": ProgrammeLaw(*[SpeckleLaw(*(0.5 * k * one for k in speckle))] * 2, SpeckleLaw(*np.zeros((3, 1)))),
        "wings_e2_s2": 0.0 * one,
        "aperture_pixels": AREA,
        "noise_fraction": 1.0,
        "source_noise_fraction": 1.0,
        "background_apertures": 1e12 * one,
        "loss_per_s": 0.0,
        "reference_light_e_s": (halo + dark) * one,
        "reference_scale": one,
        "smear_e": 0.0 * one,
        "reference_smear_e": 0.0 * one,
        "variance_factor": 1.0,
    }
    return ApertureRates(**(given | changes))


def test_by_hand():
    """30 frames of 100 s at gain 20: every term written out."""
    factor2 = 2 * 19 * 20 ** (-605 / 604) + 1 / 20
    s0 = 0.02 * 100 * 30
    light = (0.04 * 100 / AREA) * factor2
    frame = 0.02 * factor2 + (110**2 + 59**2 / 12) / 20**2
    sigma2 = 30 * 2 * (light + frame)
    expected = s0 / math.sqrt(s0 + sigma2 * AREA * (1 + AREA / 400))
    found = snr_paper(rates(), 100.0, 30, 20.0, CAMERA, 400.0)
    assert found.shape == (1,)
    assert found[0] == pytest.approx(expected, rel=1e-9)
    # 0.5 electrons of smear in every frame are as much as 0.005 e-/s of light in these
    smeared = rates(smear_e=np.full(1, 0.5), reference_smear_e=np.full(1, 0.5))
    lit = rates(halo=0.035)
    assert snr_paper(smeared, 100.0, 30, 20.0, CAMERA, 400.0) == pytest.approx(
        snr_paper(lit, 100.0, 30, 20.0, CAMERA, 400.0), rel=1e-12
    )
    # twice as many reference frames halve their part, and speckles of 0.001 e-/s in the sum are one pixel's over 20
    sigma2 = 30 * 1.5 * (light + frame) + (3000 * 0.001 / AREA) ** 2 / SPECKLE_COHERENCE
    expected = s0 / math.sqrt(s0 + sigma2 * AREA * (1 + AREA / 400))
    found = snr_paper(rates(speckle=(1e-6, 0, 0)), 100.0, 30, 20.0, CAMERA, 400.0, reference_ratio=2.0)
    assert found[0] == pytest.approx(expected, rel=1e-9)


def test_planet_alone_gives_the_root_of_its_electrons():
    alone = rates(halo=0.0, dark=0.0)
    for frames in (1, 30, 1000):
        assert snr_paper(alone, 100.0, frames, 300.0, QUIET)[0] == pytest.approx(math.sqrt(2.0 * frames), rel=1e-12)


@pytest.mark.parametrize("gain", [1.0, 2.0, 20.0, 300.0])
def test_lacks_the_excess_noise_of_the_planet(gain):
    alone = rates(halo=0.0, dark=0.0)
    full = stack_noise(alone, 100.0, 30, gain, QUIET).snr[0]
    excess = math.sqrt(float(excess_noise_factor2(gain)))
    assert snr_paper(alone, 100.0, 30, gain, QUIET)[0] / full == pytest.approx(excess, rel=1e-12)


def test_agrees_with_the_full_model_where_only_read_noise_counts():
    """A clear regime for the formula: independent pixels, no light to speak of, gain 1, a wide background."""
    faint = rates(planet=1e-4, halo=0.0, dark=0.0)
    full = stack_noise(faint, 10.0, 30, 1.0, CAMERA).snr[0]
    assert snr_paper(faint, 10.0, 30, 1.0, CAMERA)[0] == pytest.approx(full, rel=1e-5)


def test_speckles_are_understated():
    noisy = rates(planet=1.0, speckle=(0.04, 0.0, 0.0))
    full = stack_noise(noisy, 100.0, 10000, 300.0, CAMERA).snr[0]
    paper = snr_paper(noisy, 100.0, 10000, 300.0, CAMERA)[0]
    assert full == pytest.approx(5.0, rel=0.02)
    assert paper / full == pytest.approx(math.sqrt(SPECKLE_COHERENCE * AREA), rel=0.05)
    walking = [snr_paper(rates(planet=1.0, speckle=(0.0, 1e-6, 0.0)), 100.0, n, 300.0, CAMERA)[0] for n in (10, 10000)]
    assert walking[1] < 1.2 * walking[0] * math.sqrt(1000) / 10  # the residual grows with the visit


@pytest.mark.parametrize(("planet", "gain"), [(2.0, 1.0), (0.05, 300.0)])
def test_is_the_expectation_of_the_measured_version(planet, gain):
    """Frames drawn pixel by pixel, summed, reference subtracted, and measured as `aperture_photometry` does."""
    frames, exposure, radius = 30, 100.0, 2.5
    side, middle, rng = 61, 30, np.random.default_rng(4)
    y, x = np.indices((side, side)) - middle
    distance = np.hypot(x, y)
    source = np.exp(-0.5 * (distance / 1.2) ** 2)
    weights = overlap_weights(radius)
    half = len(weights) // 2
    near = slice(middle - half, middle + half + 1)
    source *= planet * exposure * frames / (source[near, near] * weights).sum()
    area = math.pi * radius**2
    given = rates(planet=planet, halo=0.03, dark=0.01, aperture_pixels=area)
    quiet = 0.04 * exposure * frames / area + frames * CAMERA.cic_e
    factor2 = float(excess_noise_factor2(gain))
    electronic = frames * CAMERA.read_variance_e2 / gain**2
    background = (distance > 10) & (distance < 29)
    measured = []
    for _ in range(60):
        # Sums of thirty frames are many electrons or much read noise: Gaussian.
        sigma = np.sqrt(factor2 * (2 * quiet + source) + 2 * electronic)
        stack = source + sigma * rng.standard_normal((side, side))
        found = aperture_photometry(stack, middle, middle, radius, background_region=background, em_gain=gain)
        measured.append(found.snr_paper)
    expected = float(snr_paper(given, exposure, frames, gain, CAMERA, float(background.sum()))[0])
    error = np.std(measured, ddof=1) / math.sqrt(len(measured))
    assert abs(np.mean(measured) - expected) < 4.5 * error + 0.01 * expected


@pytest.mark.parametrize(("band", "expected"), [("F520", 0.47), ("F850", 0.28)])
def test_coherence_is_that_of_images(band, expected):
    """Two visits at 0.05 nm, subtracted: scatter of aperture sums over that of pixels, in a middle annulus."""
    instrument = load_instrument({"drift": {"visit_nm": 0.05, "walk_nm_per_sqrt_hour": 0}})
    metrics = psf_metrics(instrument, band)
    radius = metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec
    inner = metrics.hole_inner_arcsec + metrics.aperture_radius_arcsec
    outer = metrics.hole_outer_arcsec - metrics.aperture_radius_arcsec
    asked = {"band": band, "exposure_s": 1.0, "window": "hole", "fidelity": "quick", "instrument": instrument}
    sums = pixels = 0.0
    for seed in range(6):
        science, reference = (
            observe({"name": "s", "cstar": {"v_mag": 0.0, "teff_k": 5800}}, seed=seed, role=role, **asked).mean_rate_map
            for role in ("science", "reference")
        )
        left = science - reference
        offset = np.abs(np.arange(len(left)) - len(left) // 2) * metrics.pixel_scale_arcsec
        usable = (offset >= inner) & (offset <= outer)
        separation = np.hypot(offset[:, None], offset)
        chosen = usable[:, None] & usable & (separation > 0.5) & (separation < 0.7)
        sums += aperture_sums(left, overlap_weights(radius))[chosen].var()
        pixels += (math.pi * radius**2) ** 2 * left[chosen].var()
    assert sums / pixels == pytest.approx(expected, abs=0.05)
    assert abs(SPECKLE_COHERENCE - expected) <= 0.1


def test_rolls_and_lost_frames_count():
    one = snr_paper(rates(), 100.0, 30, 20.0, CAMERA, 400.0)[0]
    assert snr_paper(rates(variance_factor=0.5), 100.0, 30, 20.0, CAMERA, 400.0)[0] == pytest.approx(one * math.sqrt(2))
    lossy = snr_paper(rates(loss_per_s=1e-3), 100.0, 30, 20.0, CAMERA, 400.0)[0]
    assert lossy == pytest.approx(one * math.exp(-0.05), rel=1e-9)
    taken = Programme(throughput=np.array(0.9))
    assert snr_paper(rates(), 100.0, 30, 20.0, CAMERA, 400.0, programme=taken)[0] < one


def test_camera_without_register_and_shapes():
    near_infrared = FrameCamera.of(load_instrument(), "F1265")
    given = rates(planet=np.array([[0.1], [0.0]]))
    found = snr_paper(given, np.array([1.0, 10.0, 20.0]), 30, 1.0, near_infrared)
    assert found.shape == (2, 3)
    assert np.all(np.diff(found[0]) > 0)
    assert found[1].tolist() == [0.0] * 3
    assert snr_paper(given, 1.0, 0, 1.0, near_infrared).tolist() == [[0.0], [0.0]]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"exposure_s": -1.0}, "exposure_s"),
        ({"n_frames": math.nan}, "n_frames"),
        ({"em_gain": 0.5}, "em_gain"),
        ({"background_pixels": 0.0}, "background_pixels"),
        ({"reference_ratio": 0.0}, "reference_ratio"),
    ],
)
def test_bad_input_is_refused(refused, changes, word):
    asked = {"exposure_s": 100.0, "n_frames": 30, "em_gain": 20.0, "camera": CAMERA} | changes
    refused(word, snr_paper, rates(), **asked)
