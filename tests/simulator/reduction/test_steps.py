"""Steps of the reduction against algebra: curves and smear undone, errors by finite differences and by draws."""

import numpy as np
import pytest

from simulator.reduction import Calibration, Master, Pixels
from simulator.reduction.steps import light, straighten, subtract, unsmear

SHAPE = (5, 4)
RNG = np.random.default_rng(3)
ONE = np.ones(SHAPE)


def known(**change):
    """Return a calibration with every step in it, without noise."""
    numbers = {"output_b": 2e-7, "pixel_b": 3e-7, "square_e": 0.01, "smear": 1e-6}
    masters = {"bias": Master(5.0 * ONE), "dark": Master(3.0 * ONE), "flat": Master(0.9 * ONE)}
    return Calibration(**{**masters, "cic_e": 0.02 * ONE, "gain_e_adu": 59.0, "em_gain": 20.0, **numbers, **change})


def test_light_is_what_went_in():
    """Send light through the camera by hand, step by step, and find it again."""
    lit = RNG.uniform(100.0, 3e4, SHAPE)
    seen = lit * 0.9
    smeared = seen * (1.0 - 1e-6) + 1e-6 * seen.sum(axis=0)
    charge = smeared + 3.0 + 0.01
    charge = charge / (1.0 + 3e-7 * charge) + 0.02
    output = 20.0 * charge
    adu = output / (1.0 + 2e-7 * output) / 59.0
    np.testing.assert_allclose(light(Pixels(adu), known()).image, lit, rtol=1e-6)


def test_variance_follows_the_slope():
    adu, step = RNG.uniform(100.0, 5000.0, SHAPE), 1e-3
    # The sum of a column in the smear is left out: 1e-6 of the slope.
    slope = (light(Pixels(adu + step), known()).image - light(Pixels(adu - step), known()).image) / (2.0 * step)
    found = light(Pixels(adu, 4.0 * ONE), known())
    np.testing.assert_allclose(found.variance, 4.0 * slope**2, rtol=2e-5)


def test_a_bias_that_enters_twice_cancels():
    """A dark of the same exposure holds the bias too: its noise is gone; of half the exposure it counts half."""
    noise = {"bias": 2.0 * ONE}
    dark = {"bias": -2.0 * ONE, "dark": 1.5 * ONE}
    frame = subtract(Pixels(100.0 * ONE, ONE), Master(ONE, noise))
    np.testing.assert_allclose(subtract(frame, Master(ONE, dark)).shared_variance, 1.5**2)
    half = subtract(frame, Master(ONE, dark).times(0.5))
    np.testing.assert_allclose(half.shared_variance, 1.0**2 + 0.75**2)


def test_errors_of_masters_are_those_of_draws():
    """Draw bias and flat 20 000 times: the scatter of the light is what is carried."""
    bias, flat = {"bias": 0.5 * ONE}, {"bias": -0.001 * ONE, "flat": 0.004 * ONE}
    whole = known(bias=Master(5.0 * ONE, bias), flat=Master(0.9 * ONE, flat), smear=0.0)
    adu = np.full(SHAPE, 1000.0)
    found = light(subtract(Pixels(adu, ONE), whole.bias), whole)
    drawn = []
    for b, f in RNG.standard_normal((20_000, 2)):
        one = known(flat=Master((0.9 - 0.001 * b + 0.004 * f) * ONE), smear=0.0)
        drawn.append(light(Pixels(adu - 5.0 - 0.5 * b), one).image[0, 0])
    assert np.sqrt(found.shared_variance[0, 0]) == pytest.approx(np.std(drawn), rel=0.02)


def test_without_errors_nothing_is_carried():
    assert straighten(Pixels(ONE), 1e-7).variance is None
    assert unsmear(Pixels(ONE), 1e-6).shared == {}
