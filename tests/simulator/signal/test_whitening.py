"""Whitened sums against constrained least squares, against drawn noise, and on visits that they have not seen."""

import numpy as np
import pytest

from cpic_core import InputError
from simulator.config import load_instrument
from simulator.imaging import centred_axis, single_band_psf, visit_responses
from simulator.signal import OpticalBand, Whitening, speckle_covariance, visit_changes, with_noise
from simulator.signal.speckle_modes import stamps_around

P = 80


@pytest.fixture(scope="module")
def field():
    """Covariance of smooth speckles and white noise on a line of pixels, and images of three planets."""
    x = np.arange(P)
    patches = np.exp(-0.5 * ((x - x[:, None]) / 2.5) ** 2) * (1.0 + 0.8 * np.sin(x / 7.0))[:, None]
    covariance = patches.T @ patches
    planets = np.exp(-0.5 * ((x - np.array([[20.0], [41.0], [63.0]])) / 2.0) ** 2)
    return covariance, np.linspace(0.05, 0.2, P), planets


def brute(covariance, image, beside):
    """Sum of least variance that finds the whole image and nothing of what is beside: by Lagrange multipliers."""
    held = np.vstack([image, beside])
    k = len(held)
    matrix = np.block([[covariance, held.T], [held, np.zeros((k, k))]])
    return np.linalg.solve(matrix, np.concatenate([np.zeros(len(image)), [1.0], np.zeros(k - 1)]))[: len(image)]


def test_weights_are_those_of_least_variance(field):
    covariance, white, planets = field
    whole = with_noise(covariance, white)
    beside = np.vstack([np.ones(P), planets[2], 2.0 * planets[2]])  # told twice
    whitening = Whitening(whole, beside)
    found = whitening.weights(planets[:2])
    for one, planet in zip(found, planets[:2], strict=True):
        np.testing.assert_allclose(one, brute(whole, planet, beside[:2]), rtol=1e-6, atol=1e-9)
        assert one @ planet == pytest.approx(1.0, rel=1e-10)
        assert abs(one @ np.ones(P)) < 1e-9
        assert abs(one @ planets[2]) < 1e-9
        seen = whitening.of(planet)
        assert one @ whole @ one == pytest.approx(1.0 / (seen @ seen), rel=1e-9)
    # The same from whitened images, of any shape.
    image = 3.0 * planets[0] + 7.0 - 2.0 * planets[2]
    seen, own = whitening.of(image), whitening.of(planets[0])
    assert own @ seen / (own @ own) == pytest.approx(3.0, rel=1e-8)


def test_error_is_the_scatter_of_drawn_noise(field):
    covariance, white, planets = field
    whole = with_noise(covariance, white)
    rng = np.random.default_rng(3)
    drawn = rng.multivariate_normal(np.zeros(P), whole, size=20_000) + 5.0 * planets[1]
    own = (planets[1] - planets[1].mean()) / ((planets[1] - planets[1].mean()) ** 2).sum()
    weights = Whitening(whole, np.ones((1, P))).weights(planets[1])
    strength = drawn @ weights
    sigma = np.sqrt(weights @ whole @ weights)
    assert strength.mean() == pytest.approx(5.0, abs=4.0 * sigma / np.sqrt(20_000))
    assert strength.std() == pytest.approx(sigma, rel=0.02)
    assert (drawn @ own).std() > 2.0 * sigma


def test_without_speckles_it_is_the_matched_filter(field):
    planet, none = field[2][1], np.zeros((P, P))
    matched = planet - planet.mean()
    for white in (0.3, 0.0):  # and without any noise at all
        found = Whitening(with_noise(none, white), np.ones((1, P))).weights(planet)
        np.testing.assert_allclose(found, matched / (matched @ planet), rtol=1e-9, atol=1e-12)


def test_without_white_noise_a_floor_keeps_the_covariance_regular():
    one = np.ones(P)
    rank_one = np.outer(one, one)
    found = with_noise(rank_one, 0.0)
    np.testing.assert_allclose(found - rank_one, 1e-4 * np.eye(P), atol=1e-15)
    with pytest.raises(InputError, match="covariance"):
        Whitening(-np.eye(3), np.ones((1, 3)))


def test_covariance_is_that_of_the_visits_in_its_two_parts(monkeypatch):
    """Of one visit and of many, in the pixels of the annulus."""
    instrument = load_instrument()
    geometry = single_band_psf("F520", instrument=instrument).geometry
    rng, n = np.random.default_rng(1), 40
    changes = [rng.standard_normal((n, np.count_nonzero(geometry.hole))) for _ in range(2)]
    monkeypatch.setattr("simulator.signal.speckle_modes.visit_changes", lambda *_: changes)
    found = speckle_covariance(instrument, "F520", 0.31, 2.0, 3.0)
    inside = geometry.annulus(0.31, 2.4)[geometry.hole]
    linear, square = (np.cov(part[:, inside], rowvar=False, bias=True) for part in changes)
    np.testing.assert_allclose(found, 2.0 * linear + 3.0 * square, rtol=1e-10, atol=1e-12)
    assert not speckle_covariance(instrument, "F520", 0.31, 0.0, 0.0).any()


@pytest.mark.long
@pytest.mark.parametrize(("band", "places"), [("F520", (0.4, 0.6, 0.85)), ("F850", (0.52, 0.6, 0.8))])
def test_gain_and_error_hold_on_visits_that_it_has_not_seen(band, places, record_property):
    """Visits of another seed: scatter over the error foreseen, and SNR over that of aperture sums."""
    instrument, offset_nm, n = load_instrument(), 0.05, 1000
    psf = single_band_psf(band, instrument=instrument)
    hole, imager = psf.geometry.hole, psf.imager
    rows, columns = (np.flatnonzero(hole.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(hole), imager.pixel_scale_arcsec)
    axes = [imager.axis(offset[part], masked=True) for part in (rows, columns)]
    _, linear, square = visit_responses(imager, *axes, instrument.drift.psd_slope, n, 7)
    images = (offset_nm * linear + offset_nm**2 * square)[:, hole[np.ix_(rows, columns)]]
    images -= images.mean(axis=0)
    assert visit_changes(OpticalBand.of(instrument, band))[0].shape[1] == images.shape[1]
    for separation in places:
        around = stamps_around(psf, separation)
        speckles = speckle_covariance(instrument, band, separation, offset_nm**2, offset_nm**4)
        seen = images[:, around.inside]
        for noise in (0.3, 1.0):
            rms2 = ((around.apertures @ speckles) * around.apertures).sum(axis=1).mean()
            white = noise**2 * rms2 / (around.apertures**2).sum(axis=1).mean()
            whole = with_noise(speckles, white)
            whitening = Whitening(whole, np.ones((1, len(speckles))))
            weights = whitening.weights(around.planets)

            def error(sums, seen=seen, white=white, planets=around.planets):
                noise_rms = np.sqrt(((seen @ sums.T) ** 2).mean(axis=0) + white * (sums**2).sum(axis=1))
                return noise_rms / (sums * planets).sum(axis=1)

            foreseen = 1.0 / np.sqrt((whitening.of(around.planets) ** 2).sum(axis=1))
            honest = float(np.mean(error(weights) / foreseen))
            gain = float(np.mean(error(around.own - around.mean) / error(weights)))
            sums = around.own - around.mean
            plain = np.sqrt(((sums @ whole) * sums).sum(axis=1)) / (sums * around.planets).sum(axis=1)
            said = float(np.mean(plain / foreseen))
            record_property(f"{band} {separation} noise {noise}: gain, over foreseen, error over foreseen",
                            f"{gain:.2f}, {gain / said:.3f}, {honest:.3f}")  # fmt: skip
            assert honest == pytest.approx(1.0, abs=0.04)
            assert gain == pytest.approx(said, rel=0.05)
