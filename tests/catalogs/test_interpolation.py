"""Nodes around a value and their weights."""

import numpy as np
import pytest

from catalogs.interpolation import bracket

NODES = np.array([1.0, 2.0, 4.0])


@pytest.mark.parametrize("value", [0.0, 1.0, 1.25, 2.0, 3.0, 4.0, 9.0])
def test_weights_make_the_straight_line(value):
    index, weight = bracket(NODES, value)
    assert index.shape == weight.shape == (2,)
    assert np.all(weight >= 0.0)
    assert weight.sum() == 1.0
    assert weight @ (NODES**2)[index] == pytest.approx(np.interp(value, NODES, NODES**2), rel=1e-15)


def test_shape_is_kept():
    index, weight = bracket(NODES, np.ones((3, 4)))
    assert index.shape == weight.shape == (3, 4, 2)
