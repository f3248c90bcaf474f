"""Discs on pixels, against photutils."""

import numpy as np
import pytest

from cpic_core import overlap_weights


@pytest.mark.parametrize(("radius", "y", "x"), [(2.32, 0, 0), (3.8, 0.31, -0.47), (0.4, 0.5, 0.5), (1.0, -0.2, 0.1)])
def test_overlap_is_that_of_photutils(radius, y, x):
    from photutils.aperture import CircularAperture  # takes 2 s, which only the process that runs this should pay

    weights = overlap_weights(radius, y, x)
    half = len(weights) // 2
    exact = CircularAperture((half + x, half + y), radius).to_mask(method="exact").to_image(weights.shape)
    np.testing.assert_allclose(weights, exact, atol=1e-12)
    assert weights.sum() == pytest.approx(np.pi * radius**2, rel=1e-12)
