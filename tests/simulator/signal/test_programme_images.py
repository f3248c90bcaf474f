"""Means over visits in images against the law of programmes.

Visits are drawn by the streams of observations and propagated in full; what is left of science after the mean of the
references is summed in apertures all over the hole.
"""

import numpy as np
import pytest

from simulator.config import Drift, Timing, load_instrument
from simulator.imaging import aperture_sums, overlap_weights, psf_metrics, single_band_psf
from simulator.imaging.drift import low_order_map, screen_model
from simulator.observing.observation import Visit, visit_stamps
from simulator.signal import programme_law
from simulator.signal.speckles import LOW_ORDER_LINEAR, LOW_ORDER_SQUARE, programme_parts

PLACES = {"F520": (0.4, 0.6, 0.85), "F850": (0.52, 0.6, 0.8)}
WINDOW_S = 0.46 * 5553.6
NO_TIMINGS = (Timing(),)


class Hole:
    """Apertures all over the dark hole of a band.

    Parameters
    ----------
    band : str
    """

    def __init__(self, band):
        self.places = PLACES[band]
        self.metrics = psf_metrics(load_instrument(), band)
        imager = single_band_psf(band).imager
        self.samples = len(imager.transmission)
        zone, pixel, radius = imager.zone, imager.pixel_scale_arcsec, imager.aperture_radius_arcsec
        pixels = np.arange(np.floor(zone.inner_arcsec / pixel), np.ceil(zone.outer_arcsec / pixel) + 1)
        y, x = zone.axes(pixels * pixel)
        self.grid = imager.focal_grid(imager.axis(y, masked=True), imager.axis(x, masked=True))
        self.inside, self.whole = zone.covers(y, x), zone.covers(y, x, -radius)
        self.separation = np.hypot(y[:, None], x)[self.whole]
        self.weights, self.blocks = overlap_weights(radius / pixel), (y.size // pixels.size, x.size // pixels.size)

    def sums(self, image):
        """Aperture sums of an image, the mean of the hole taken off; quadrants are apart."""
        image = image - image[self.inside].mean()
        rows, columns = (size // count for size, count in zip(image.shape, self.blocks, strict=True))
        blocks = image.reshape(self.blocks[0], rows, self.blocks[1], columns).swapaxes(1, 2)
        return aperture_sums(blocks, self.weights).swapaxes(1, 2).reshape(image.shape)[self.whole]

    def visits(self, drift, role, realisation, count, timing, visit_s=WINDOW_S, epochs=1):
        """Aperture sums of successive visits."""
        found = []
        for number in range(count):
            visit = Visit("s", "SCI", role, "", realisation, number, timing)
            stamps = visit_stamps(self.grid, drift, epochs, visit_s, 77, visit)
            found.append(self.sums(stamps.mean(axis=0)))
        return np.array(found)

    def residuals(self, drift, realisations, count, *, timings=NO_TIMINGS, **settings):
        """Science less references of every visit, shape (realisations, visits, apertures)."""
        left = []
        for number in range(realisations):
            timing = timings[number % len(timings)]
            pair = [self.visits(drift, role, number, count, timing, **settings) for role in ("science", "reference")]
            left.append(pair[0] - pair[1])
        return np.array(left)

    def around(self, squares):
        """Mean over the whole apertures of the annuli around the three places."""
        reach = 1.5 * self.metrics.lambda_d_arcsec - self.metrics.aperture_radius_arcsec
        near = [np.abs(self.separation - place) <= reach for place in self.places]
        return np.stack([squares[..., apertures].mean(axis=-1) for apertures in near], axis=-1)

    def squares(self, left, visits):
        """Variance there of the mean of so many visits, a row for each mean.

        What is the same in all of them, a ring of the light of common errors, is no noise and is taken off.
        """
        means = left.reshape(-1, visits, left.shape[-1]).mean(axis=1)
        return self.around((means - means.mean(axis=0)) ** 2) * len(means) / (len(means) - 1)

    def rms(self, left, visits):
        """The root of its mean over the rows."""
        return np.sqrt(self.squares(left, visits).mean(axis=0))

    def error(self, left, visits):
        """Relative standard error of that."""
        squares = self.squares(left, visits)
        return squares.std(axis=0, ddof=1) / squares.mean(axis=0) / np.sqrt(len(squares)) / 2

    def law(self, drift, visits, timing=None, visit_s=WINDOW_S):
        """The same by the law."""
        when = timing or Timing()
        law = programme_law(self.metrics, drift, np.array(self.places), 1.5, timing=when)
        gap_s = visit_s if when.gap_s is None else when.gap_s
        return np.sqrt(law.law(visits, gap_s=gap_s).variance(visit_s))


def drift(visit=0.05, **more):
    return Drift(visit_nm=visit, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5, orbital_period_s=5553.6, **more)


@pytest.mark.long
def test_a_few_programmes_follow_the_law():
    hole, numbers = Hole("F520"), np.array([1, 4, 12])
    left = hole.residuals(drift(), 1, 120)
    found = np.array([hole.rms(left, visits) for visits in numbers])
    slope = np.polyfit(np.log(numbers), np.log(found), 1, w=numbers**-0.5)[0]
    np.testing.assert_allclose(slope, -0.5, atol=0.07)
    np.testing.assert_allclose(found[0] / hole.law(drift(), 1), 1.0, atol=0.1)
    shared = drift(common_fraction=0.5)
    left = hole.residuals(shared, 10, 8)
    np.testing.assert_allclose(hole.rms(left, 8) / hole.law(shared, 8), 1.0, atol=0.15)


@pytest.mark.long
@pytest.mark.parametrize("band", PLACES)
def test_independent_visits_average_with_the_root_of_their_number(band, record_property):
    hole, count = Hole(band), 1024
    left, numbers = hole.residuals(drift(), 1, count), np.array([1, 4, 16, 64])
    found = np.array([hole.rms(left, visits) for visits in numbers])
    slope = np.polyfit(np.log(numbers), np.log(found), 1, w=numbers**-0.5)[0]
    record_property("exponents", np.round(slope, 3).tolist())
    np.testing.assert_allclose(slope, -0.5, atol=0.03)
    ratio = found / [hole.law(drift(), visits) for visits in numbers]
    error = np.array([hole.error(left, visits) for visits in numbers])
    record_property("images over law", np.round(ratio, 3).tolist())
    record_property("error of the images", np.round(error, 3).tolist())
    assert np.all(np.abs(ratio - 1.0) < 0.01 + 2.0 * error), ratio


@pytest.mark.long
@pytest.mark.parametrize("fraction", [0.2, 0.5])
def test_a_common_screen_ends_the_slope(fraction, record_property):
    """V visits and as many references leave ``(a o^2 + b o^4) / V``, and the common screen ``a (f o)^2 / 2``.

    They are equal at ``V = 2 / f^2`` where errors beat with the static field, 50 with a fifth and 8 with a half, and at
    more near the inner edge, where the errors' own light counts: from there on more visits hardly help.
    """
    hole, settings = Hole("F520"), drift(common_fraction=fraction)
    left, numbers = hole.residuals(settings, 64, 64), (1, 4, 16, 64)
    # Means of visits that share the common screen of their realisation: 64 of them say what the images can.
    error = hole.error(left, 64)
    ratio = np.array([hole.rms(left, visits) / hole.law(settings, visits) for visits in numbers])
    record_property("images over law", np.round(ratio, 3).tolist())
    record_property("error of the images at V = 64", np.round(error, 3).tolist())
    assert np.all(np.abs(ratio - 1.0) < 2.0 * error), ratio
    law = programme_law(hole.metrics, settings, np.array(hole.places), 1.5)
    ends = law.averaging().law().variance(WINDOW_S) / law.common.variance(WINDOW_S)
    record_property("visits that leave as much as is common", np.round(ends, 1).tolist())
    assert np.all((ends > 2.0 / fraction**2) & (ends < 6.0 / fraction**2))


@pytest.mark.long
@pytest.mark.parametrize("fraction", [0.2, 0.5])
def test_a_common_screen_in_many_programmes(fraction, record_property):
    """The law to 1 %, from 500 programmes of 64 visits and two images each.

    Light is quadratic in the screen: the mean image of visits is that of their mean screen, and the mean light of what
    they scatter about it, which knows nothing of the rest and has the variance ``b o^4 / 2`` times ``(V - 1) / V^2``.
    """
    hole, settings, visits, count = Hole("F520"), drift(common_fraction=fraction), 64, 500
    screens, rng = screen_model(hole.samples, settings.psd_slope), np.random.default_rng(11)
    left = np.empty((count, hole.separation.size))
    for number in range(count):
        mean, reference = (screens.draw(rng, settings.visit_nm / visits**0.5) for _ in range(2))
        common = screens.draw(rng, settings.common_nm)
        left[number] = hole.sums(hole.grid.image(common + mean)) - hole.sums(hole.grid.image(reference))
    _, light = programme_parts(hole.metrics, drift(), np.array(hole.places), 1.5)
    scattered = 2.0 * light.science.k0 * (visits - 1) / visits**2
    ratio = np.sqrt(hole.rms(left, 1) ** 2 + scattered) / hole.law(settings, visits)
    error = hole.error(left, 1)
    record_property("images over law", np.round(ratio, 3).tolist())
    record_property("error of the images", np.round(error, 3).tolist())
    assert np.all(np.abs(ratio - 1.0) < 0.01 + error), ratio


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["interleaved", "half", "swapped", "other_star"])
def test_the_orbit_leaves_what_the_scheme_of_references_lets(scheme, record_property):
    """A screen of 0.03 nm on offsets of 0.05 nm, over all phases; light in rings is small at this size."""
    hole, settings = Hole("F520"), drift(orbital_nm=0.03, orbital_orders="all")
    timings = [Timing(scheme, start_turns=(k + 0.5) / 32) for k in range(32)]
    visit_s = WINDOW_S * (0.5 if scheme in ("half", "swapped") else 1.0)
    left = hole.residuals(settings, 32, 32, timings=timings, visit_s=visit_s, epochs=3)
    ratio = np.array([hole.rms(left, v) / hole.law(settings, v, timings[0], visit_s) for v in (1, 4, 32)])
    record_property("images over law", np.round(ratio, 3).tolist())
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)


@pytest.mark.long
def test_correlated_visits_average_as_fewer(record_property):
    """In small offsets, where the cross term with the static field is all: it forgets as the wavefront does."""
    settings, timing = drift(0.005, correlation_time_h=3.0), Timing(gap_s=3600.0)
    hole = Hole("F520")
    left = hole.residuals(settings, 96, 16, timings=(timing,))
    ratio = np.array([hole.rms(left, v) / hole.law(settings, v, timing) for v in (1, 4, 16)])
    record_property("images over law", np.round(ratio, 3).tolist())
    np.testing.assert_allclose(ratio, 1.0, atol=0.08)
    assert np.all(hole.law(settings, 16, timing) > 1.7 * hole.law(drift(0.005), 16))


@pytest.mark.parametrize("band", PLACES)
def test_low_orders_leave_a_small_share_of_what_a_screen_leaves(band):
    """Light of the errors and its cross term apart, by the difference and the mean of both signs of the map."""
    hole = Hole(band)
    shape, still = low_order_map(hole.samples), hole.sums(hole.grid.image())
    for rms_nm in (0.1, 3.0):
        crossed, light = programme_parts(hole.metrics, drift(rms_nm), np.array(hole.places), 1.5)
        said = np.sqrt(LOW_ORDER_LINEAR * crossed.science.k0 + LOW_ORDER_SQUARE * light.science.k0)
        up, down = (hole.sums(hole.grid.image(sign * rms_nm * shape)) - still for sign in (1.0, -1.0))
        found = np.sqrt(hole.around((up - down) ** 2 + (up + down) ** 2)) / 2
        assert np.all((said / found > 1 / 4) & (said / found < 4)), said / found
    # At the default 0.1 nm nothing that counts: less than a fortieth of a pair of visits.
    up = hole.sums(hole.grid.image(0.1 * shape)) - still
    assert np.all(np.sqrt(hole.around(up**2)) < 0.025 * hole.law(drift(), 1))
