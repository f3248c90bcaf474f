"""Sampling of a product: against the exact product, and its integrals against the exact ones."""

import numpy as np
from hypothesis import given, strategies as st

from simulator.passbands import product_samples

columns = st.integers(2, 12).flatmap(
    lambda n: st.tuples(
        st.lists(st.floats(0.05, 1.0), min_size=n, max_size=n).map(lambda steps: 300.0 + np.cumsum(steps)),
        st.lists(st.floats(0.0, 1.0), min_size=n, max_size=n).map(np.array),
    )
)


def integral(x, y):
    return np.trapezoid(y, x)


@given(columns, columns)
def test_product_is_right_everywhere_and_in_the_mean(first, second):
    (x1, y1), (x2, y2) = first, second
    if max(x1[0], x2[0]) >= min(x1[-1], x2[-1]):
        return
    x, a, b = product_samples(x1, y1, x2, y2)
    assert np.all(np.diff(x) > 0.0)
    assert (x[0], x[-1]) == (max(x1[0], x2[0]), min(x1[-1], x2[-1]))
    np.testing.assert_allclose(a, np.interp(x, x1, y1), rtol=1e-14)
    # Simpson is exact for a parabola between neighbours of the union.
    middle = 0.5 * (x[1:] + x[:-1])
    there = np.interp(middle, x1, y1) * np.interp(middle, x2, y2)
    straight = 0.5 * ((a * b)[1:] + (a * b)[:-1])
    assert np.all(np.abs(there - straight) <= 1.6e-6 * there.max() + 1e-18)
    exact = np.sum(np.diff(x) / 6.0 * (2.0 * straight + 4.0 * there))
    assert abs(integral(x, a * b) - exact) <= 1e-6 * exact + 1e-18


def test_union_is_enough_where_one_factor_is_constant():
    x, a, b = product_samples(
        np.array([300.0, 500.0, 700.0]), np.array([1.0, 2.0, 1.0]), np.array([350.0, 800.0]), np.array([0.5, 0.5])
    )
    np.testing.assert_array_equal(x, [350.0, 500.0, 700.0])
    np.testing.assert_allclose(a * b, [0.625, 1.0, 0.5])
