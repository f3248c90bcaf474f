"""Shifts of the light that a mask leaves of a star, against images that are made at a known place."""

import numpy as np
import pytest

from cpic_core import InputError
from cpic_planner.validation import measured_shift, moved, star_light
from simulator import observe

SIDE, CELL = 96, 8.0


def speckles(rng, at=(0.0, 0.0), changed=0.0):
    """Return Gaussian spots whose centres are at exact places: nothing is interpolated."""
    y, x = np.indices((SIDE, SIDE))
    image = np.zeros((SIDE, SIDE))
    for _ in range(150):
        cx, cy, height = *rng.uniform(0, SIDE, 2), rng.exponential(200.0)
        height *= 1.0 + changed * np.random.default_rng(int(1e6 * cx)).normal()
        image += height * np.exp(-((x - cx - at[0]) ** 2 + (y - cy - at[1]) ** 2) / (2 * 1.9**2))
    return image


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.2), (-0.04, 0.07), (1.1, 0.9)])
def test_a_known_shift_is_found_without_noise(shift):
    template = speckles(np.random.default_rng(3))
    found = measured_shift(2.5 * speckles(np.random.default_rng(3), shift) + 7.0, template, template >= 0, CELL)
    assert (found.x_pixel, found.y_pixel) == pytest.approx(shift, abs=2e-3)
    assert found.significant is bool(np.hypot(*shift) > 0)


def test_errors_hold_noise_and_speckles_that_changed():
    template, whole = speckles(np.random.default_rng(5)), np.ones((SIDE, SIDE), bool)
    image, draws = speckles(np.random.default_rng(5), (0.1, -0.05), changed=0.1), []
    rng = np.random.default_rng(9)
    for _ in range(30):
        noisy = image * (1 + 0.1 * speckles(rng) / 400.0) + 3.0 * rng.normal(size=image.shape)
        one = measured_shift(noisy, template, whole, CELL)
        draws.append(((one.x_pixel - 0.1) / one.x_error_pixel, (one.y_pixel + 0.05) / one.y_error_pixel))
    pulls = np.array(draws)
    assert np.all(np.abs(pulls).max(axis=0) < 5)
    assert 0.5 < pulls.std() < 1.4


def test_noise_alone_moves_nothing_and_unusable_pixels_do_not_count():
    rng, template = np.random.default_rng(11), speckles(np.random.default_rng(3))
    still = [
        measured_shift(template + 5 * rng.normal(size=template.shape), template, template >= 0, CELL) for _ in "abcde"
    ]
    assert not any(one.significant for one in still)
    region, broken = np.ones((SIDE, SIDE), bool), speckles(np.random.default_rng(3), (0.25, 0.0))
    region[40:44, 50:53] = False
    broken[~region] = 1e6
    assert measured_shift(broken, template, region, CELL).x_pixel == pytest.approx(0.25, abs=0.01)


def test_what_tells_no_shift_is_none():
    flat, whole = np.ones((SIDE, SIDE)), np.ones((SIDE, SIDE), bool)
    assert measured_shift(flat[:20, :20], flat[:20, :20], whole[:20, :20], CELL) is None
    assert measured_shift(-speckles(np.random.default_rng(3)), speckles(np.random.default_rng(3)), whole, CELL) is None
    with pytest.raises(InputError, match="template"):
        measured_shift(flat, flat[:5], whole, CELL)


def test_an_image_that_is_moved_back_is_itself():
    image = speckles(np.random.default_rng(3))
    back = moved(speckles(np.random.default_rng(3), (0.37, -0.21)), -0.37, 0.21)
    inner = (slice(8, -8),) * 2
    assert back[inner] == pytest.approx(image[inner], abs=2e-3 * image.max())


@pytest.mark.long
@pytest.mark.parametrize("shift", [(0.2, 0.1), (0.03, -0.02)])
def test_a_star_that_moves_behind_the_mask_is_followed(shift):
    """Of the optics themselves: the star moves, the mask stays. Light along the mask would tell three quarters."""

    def light(x, y):
        where = {"star_offset_arcsec": (x * pixel, y * pixel)}
        seen = observe("paper_reference", band="F662", exposure_s=10, fidelity="quick", **where)
        rows, columns, _ = seen.area.stamp(seen.psf.geometry.stamp_pixels)
        return seen.expected_e[rows, columns], seen.psf.geometry

    pixel = 0.0
    template, geometry = light(0.0, 0.0)
    pixel = geometry.pixel_scale_arcsec
    image, cell = light(*shift)[0], 2 * geometry.lambda_d_arcsec / pixel
    found = measured_shift(image, template, star_light(geometry), cell)
    assert (found.x_pixel, found.y_pixel) == pytest.approx(shift, rel=0.01, abs=2e-4)
    everywhere = measured_shift(image, template, np.ones(image.shape, bool), cell)
    assert np.hypot(everywhere.x_pixel, everywhere.y_pixel) < 0.85 * np.hypot(*shift)
