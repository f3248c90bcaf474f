"""The expansion of the star's light against exact transforms of the same screens, and against closed forms."""

import functools

import numpy as np
import pytest

from simulator import load_instrument, single_band_psf
from simulator.config import Drift
from simulator.imaging import (
    aperture_sums,
    centred_axis,
    expands,
    light_expansion as expansion,
    overlap_weights,
    visit_light,
)
from simulator.imaging.drift import low_order_map, screen_model, wavefronts
from simulator.imaging.light_expansion import waves_of
from simulator.imaging.measure import ErrorLight

BANDS = ("F520", "F662", "F720", "F850")


class Hole:
    """The pixels of a hole, the exact transform to them, and the expansion with its waves."""

    def __init__(self, band, instrument="cpic_default", only=None):
        self.instrument = load_instrument(instrument)
        self.psf = single_band_psf(band, instrument=self.instrument)
        imager, self.region = self.psf.imager, self.psf.geometry.hole
        place = [np.flatnonzero(self.region.any(axis=axis)) for axis in (1, 0)]
        offset = centred_axis(len(self.region), imager.pixel_scale_arcsec)
        if only is not None:
            place[0] = place[0][offset[place[0]] > 0]
        self.place = np.ix_(*place)
        self.axes = [imager.axis(offset[part], masked=True) for part in place]
        self.grid = imager.focal_grid(*self.axes)
        self.screens = screen_model(len(imager.transmission), self.instrument.drift.psd_slope)
        slope = self.instrument.drift.psd_slope
        self.waves = waves_of(imager, *self.axes, slope).reshape(-1, 128 * 128)
        self.light = visit_light(imager, *self.axes, slope)

    def pairs(self, count, rms_nm, seed=3):
        """Return exact and fast images of the same screens."""
        drawn = np.random.default_rng(seed).standard_normal((count, 128, 128))
        numbers = np.zeros((count, 1, len(self.waves) + 1))
        numbers[:, 0, :-1] = rms_nm * (drawn.reshape(count, -1) @ self.waves.T)
        exact = np.array([self.grid.image(rms_nm * self.screens.screens(one)) for one in drawn])
        return exact, self.light.images(numbers)


hole = functools.lru_cache(maxsize=2)(Hole)


def sums(held, images):
    """Return sums over apertures that lie wholly in the hole, every third pixel, (n, places)."""
    radius = held.psf.imager.aperture_radius_arcsec / held.psf.imager.pixel_scale_arcsec
    weights = overlap_weights(radius)
    inside = np.isclose(aperture_sums(held.region.astype(float), weights), weights.sum())
    inside[np.arange(len(inside)) % 3 > 0] = inside[:, np.arange(len(inside)) % 3 > 0] = False
    answer = []
    for image in images:
        whole = np.zeros(held.region.shape)
        whole[held.place] = image
        answer.append(aperture_sums(whole, weights)[inside])
    return np.array(answer)


@pytest.mark.parametrize("rms_nm", [0.005, 0.05, 1.0])
def test_images_are_those_of_the_transform(rms_nm):
    held = hole("F850")
    exact, fast = held.pairs(24, rms_nm)
    change = exact - held.light.static
    assert np.sqrt(((fast - exact) ** 2).mean() / (change**2).mean()) < (0.005 if rms_nm < 1 else 0.01)
    assert np.all(fast >= 0)


def test_waves_are_orthonormal_and_their_light_is_the_closed_form():
    held = hole("F850")
    gram = held.waves @ held.waves.T
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=3e-6)
    numbers = np.zeros((len(gram), 1, len(gram) + 1))
    numbers[np.arange(len(gram)), 0, np.arange(len(gram))] = 1.0
    square = held.light.changes(numbers)[1].sum(axis=0)
    # The expectation of |dE|^2 in apertures over all screens of 1 nm, from the adjoint of the transform.
    exact = ErrorLight(held.psf.imager, tuple(held.axes), held.instrument.drift.psd_slope)
    for row, column in ((2, 3), (20, 6), (8, 40), (len(square) - 11, 1)):
        weights = overlap_weights(held.psf.imager.aperture_radius_arcsec / held.psf.imager.pixel_scale_arcsec)
        expected = held.screens.variance(exact.readings(row, column, weights)).sum()
        part = square[row : row + len(weights), column : column + len(weights)]
        assert (part * weights).sum() == pytest.approx(expected, rel=0.003)


@pytest.mark.long
@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("rms_nm", [0.005, 0.05, 0.2, 1.0])
def test_statistics_of_aperture_sums(band, rms_nm):
    held = hole(band)
    exact, fast = (sums(held, images) for images in held.pairs(300, rms_nm))
    mean, spread = exact.mean(axis=0), exact.std(axis=0)
    assert np.abs((fast - exact).mean(axis=0) / spread).max() < 0.005
    assert np.abs(fast.var(axis=0) / exact.var(axis=0) - 1.0).max() < 0.01
    assert np.abs(np.corrcoef(fast.T) - np.corrcoef(exact.T)).max() < 0.01
    for sigma in (3, 4, 5):
        counts = [np.count_nonzero((values - mean) / spread > sigma) for values in (exact, fast)]
        # The same screens: they differ by those that come to lie on the other side of the limit.
        assert abs(counts[1] - counts[0]) <= 3 + 0.02 * counts[0]


def test_the_low_order_map_and_the_walk_of_a_visit():
    """A visit with everything that moves it: the numbers make the same wavefronts, and one image is their mean."""
    held = hole("F850")
    light, screens = held.light, held.screens
    drift = Drift(visit_nm=0.05, walk_nm_per_sqrt_hour=0.05, psd_slope=2.5, orbital_nm=0.0)
    rngs = [np.random.default_rng(k) for k in (1, 2)]
    numbers = np.array(list(wavefronts(light, drift, 4, 900.0, *rngs)))
    numbers[:, -1] = (0.1, -0.1, 0.2, 0.0)
    maps = screens.screens((numbers[:, :-1] @ held.waves).reshape(-1, 128, 128))
    maps = maps + numbers[:, -1, None, None] * low_order_map(128)
    every = np.array([held.grid.image(one) for one in maps])
    change = every.mean(axis=0) - light.static
    shares = np.array([0.4, 0.3, 0.2, 0.1])
    assert np.sqrt(((light.images(numbers[:, None]) - every) ** 2).mean()) < 0.005 * change.std()
    for given, mean in ((None, every.mean(axis=0)), (shares, np.tensordot(shares, every, 1))):
        assert np.sqrt(((light.images(numbers[None], given)[0] - mean) ** 2).mean()) < 0.005 * change.std()
    # Steps of the walk are independent, the offset frozen: variances by hand.
    walk = []
    for k in range(8):
        rngs = [np.random.default_rng(seed) for seed in (k, 99 - k)]
        walk.append(np.diff(np.array(list(wavefronts(light, drift, 3, 900.0, *rngs))), axis=0))
    assert np.std(np.array(walk)[..., :-1]) == pytest.approx(0.05 * np.sqrt(0.25), rel=0.03)


def test_one_side_of_the_star_alone_has_numbers_of_its_own():
    """Opposite sides move together; a half plane has twice as many degrees of freedom for its area."""
    half, whole = hole("F850", only="upper"), hole("F850")
    assert len(half.waves) == pytest.approx(len(whole.waves), rel=0.15)
    exact, fast = half.pairs(12, 0.05)
    assert np.sqrt(((fast - exact) ** 2).mean() / ((exact - half.light.static) ** 2).mean()) < 0.01


def test_many_epochs_are_one_visit_whatever_their_number(monkeypatch):
    """Blocks of epochs do not change a mean but for single precision."""
    light = hole("F850").light
    rng = np.random.default_rng(4)
    numbers = np.stack([[light.draw(rng, 0.1) for _ in range(7)] for _ in range(5)])
    whole = light.images(numbers)
    np.testing.assert_array_equal(whole, light.images(numbers))
    monkeypatch.setattr(expansion, "_BATCH", 3)
    np.testing.assert_allclose(light.images(numbers), whole, rtol=1e-4, atol=1e-4 * whole.std())


def test_where_it_holds():
    small = Drift(visit_nm=0.6, walk_nm_per_sqrt_hour=0.5, psd_slope=2.5)
    assert expands(small, 3600.0)
    assert not expands(small, 4 * 3600.0)
    assert not expands(small.model_copy(update={"orbital_nm": 0.7, "orbital_period_s": 5500.0}), 3600.0)
    assert not expands(small.model_copy(update={"common_fraction": 1.0, "visit_nm": 0.8}), 0.0)
