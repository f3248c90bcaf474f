"""The compiled kernel against a brute-force integral and exact bookkeeping."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.special import erf

from simulator.effects.cosmic_rays import Canvas, Points, Tracks


def one_track(along, sigma, across=None, weight=None):
    along = np.asarray(along, dtype=np.float64)
    n = along.size
    length = np.array([np.ptp(along)])
    tracks = Tracks(length, length, np.array([sigma]), np.abs(along).max(keepdims=True), np.zeros(1, dtype=np.int64))
    points = Points(
        np.array([0, n]),
        along,
        np.zeros(n) if across is None else np.asarray(across, dtype=np.float64),
        np.ones(n) if weight is None else np.asarray(weight, dtype=np.float64),
    )
    return tracks, points


def add(canvas, tracks, points, row, column, azimuth_deg, charge):
    placed = (np.array([value]) for value in (float(row), float(column), np.deg2rad(azimuth_deg)))
    return int(canvas.add(tracks, points, *placed, np.array([charge]))[0])


def brute_force(rows, columns, y, x, weight, sigma):
    """Expected share of every pixel: Gaussians integrated over pixels, one point at a time."""

    def share(edges, place):
        return np.diff(0.5 * erf((edges - place) / (sigma * np.sqrt(2.0))))

    total = np.zeros((rows, columns))
    for py, px, w in zip(y, x, weight, strict=True):
        total += w * np.outer(share(np.arange(rows + 1) - 0.5, py), share(np.arange(columns + 1) - 0.5, px))
    return total / np.sum(weight)


@pytest.mark.parametrize(("azimuth_deg", "sigma"), [(0.0, 0.35), (37.0, 0.35), (90.0, 0.35), (210.0, 1.3)])
def test_track_is_what_the_integral_says(azimuth_deg, sigma):
    along = np.linspace(-6.0, 6.0, 41)
    weight = 1.0 + 0.5 * np.sin(along)
    canvas = Canvas((31, 29))
    assert add(canvas, *one_track(along, sigma, weight=weight), 15.3, 13.8, azimuth_deg, 1_000_000) == 1_000_000
    angle = np.deg2rad(azimuth_deg)
    expected = brute_force(31, 29, 15.3 + along * np.sin(angle), 13.8 + along * np.cos(angle), weight, sigma) * 1e6
    # 6e-5 of the charge, beyond four sigma, is moved inside; rounding takes one electron.
    assert np.abs(canvas.image - expected).max() < 1.0 + 1.5e-4 * expected.max() + 5.0
    assert canvas.image.sum() == 1_000_000


def test_azimuth_runs_from_columns_to_rows():
    for azimuth_deg, shape in ((0.0, (1, 11)), (90.0, (11, 1))):
        canvas = Canvas((21, 21))
        add(canvas, *one_track(np.linspace(-5.0, 5.0, 101), 0.01), 10, 10, azimuth_deg, 1100)
        rows, columns = np.nonzero(canvas.image)
        assert (np.ptp(rows) + 1, np.ptp(columns) + 1) == shape
    canvas = Canvas((21, 21))
    add(canvas, *one_track([5.0], 0.01, across=[3.0]), 10, 10, 0.0, 7)
    assert canvas.image[13, 15] == 7  # across is towards rows where along is towards columns


def test_whole_electrons_keep_a_faint_wing():
    # Rounding every pixel on its own would leave nothing of shares below half an electron.
    total = np.zeros((9, 9))
    for i in range(400):
        canvas = Canvas((9, 9))
        add(canvas, *one_track([0.0], 1.0), 4 + 1e-4 * i, 4 - 1e-4 * i, 0.0, 5)
        total += canvas.image
    assert total.sum() == 2000
    assert np.count_nonzero(total) >= 5


@settings(max_examples=150, deadline=None)
@given(
    row=st.floats(-40, 40),
    column=st.floats(-40, 40),
    azimuth=st.floats(0, 360),
    sigma=st.floats(0.02, 5),
    charge=st.integers(1, 10**9),
    length=st.floats(0, 60),
    rows=st.integers(1, 20),
    columns=st.integers(1, 20),
)
def test_charge_is_conserved_and_never_negative(row, column, azimuth, sigma, charge, length, rows, columns):
    canvas = Canvas((rows, columns))
    along = (np.arange(25) - 12) / 24 * length
    left = add(canvas, *one_track(along, sigma), row, column, azimuth, charge)
    assert 0 <= left <= charge
    assert canvas.image.sum() == left
    assert canvas.image.min() >= 0
    assert not canvas._work.any()


def test_tracks_add_up():
    both, single = Canvas((15, 15)), Canvas((15, 15))
    first, second = (one_track(np.linspace(-3, 3, 13), 0.4) for _ in range(2))
    add(both, *first, 5, 5, 20.0, 1234)
    add(both, *second, 6, 7, 80.0, 777)
    add(single, *second, 6, 7, 80.0, 777)
    alone = Canvas((15, 15))
    add(alone, *first, 5, 5, 20.0, 1234)
    np.testing.assert_array_equal(both.image, alone.image + single.image)
