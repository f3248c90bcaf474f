import numpy as np
import pytest
from photutils.aperture import CircularAperture, aperture_photometry

from simulator.imaging import aperture_sums, overlap_weights
from simulator.imaging.aperture import core_from_table, cumulative_table, photon_weights


def test_aperture_sums_equal_photutils_on_every_pixel():
    image = np.random.default_rng(1).random((2, 15, 17))
    sums = aperture_sums(image, overlap_weights(2.3))
    for y, x in ((0, 0), (7, 8), (14, 3)):
        exact = [aperture_photometry(part, CircularAperture((x, y), 2.3))["aperture_sum"][0] for part in image]
        np.testing.assert_allclose(sums[:, y, x], exact, rtol=1e-3)


def test_photon_weight_is_the_phase_average_of_pixel_apertures():
    rng = np.random.default_rng(2)
    radius = 2.32
    for y, x in ((0.0, 0.0), (1.5, 1.4), (2.1, 0.9), (3.1, 0.2), (3.0, 3.0)):
        found = []
        for phase_y, phase_x in rng.uniform(-0.5, 0.5, (4000, 2)):
            weights = overlap_weights_fast(radius, phase_y, phase_x)
            row, column = np.rint([y + phase_y, x + phase_x]).astype(int) + len(weights) // 2
            inside = 0 <= row < len(weights) and 0 <= column < len(weights)
            found.append(weights[row, column] if inside else 0.0)
        expected = photon_weights(np.array([y]), np.array([x]), radius)[0, 0]
        assert abs(np.mean(found) - expected) < 4 * np.std(found) / np.sqrt(len(found)) + 1e-3


def overlap_weights_fast(radius, y, x):
    half = int(np.ceil(radius + 0.5))
    return CircularAperture((half + x, half + y), radius).to_mask(method="exact").to_image((2 * half + 1,) * 2)


def test_core_table_against_direct_sums():
    rng = np.random.default_rng(3)
    cells = rng.random((40, 40))
    table = cumulative_table(cells)
    edges = np.linspace(-1, 1, 41)
    centre = (edges[1:] + edges[:-1]) / 2
    bar = 0.3
    for x, y in ((0.5, -0.45), (0.0, 0.0), (0.15, 5.0), (-0.7, 0.3), (9.0, 9.0)):
        # Positions on cell edges, so that no cell is cut.
        closed = (np.abs(centre[None, :] + x) < bar) | (np.abs(centre[:, None] + y) < bar)
        assert core_from_table(table, 1.0, bar, x, y) == pytest.approx(cells[~closed].sum(), abs=1e-9)
    assert core_from_table(table, 1.0, 0.0, 0.0, 0.0) == pytest.approx(cells.sum())
    assert core_from_table(table, 1.0, bar, np.zeros((2, 1)), np.zeros(3)).shape == (2, 3)
