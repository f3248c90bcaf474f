import numpy as np
import pytest

from cpic_planner.report.image_figures import Panels, compass, residual_limit, stack_scale
from simulator.imaging import HoleZone


def _panels(**changes):
    image = np.zeros((5, 7))
    values = {
        "band": "F520",
        "science": image,
        "reference": image,
        "residual": image,
        "pixel_scale_arcsec": 0.1,
        "aperture_radius_arcsec": 0.04,
        "zone": HoleZone(0.05, 0.25),
    }
    return Panels(**(values | changes))


def test_compass_of_the_default_detector_is_north_up_east_left():
    north, east = compass(-1)
    assert north == pytest.approx((0.0, 1.0), abs=1e-12)
    assert east == pytest.approx((-1.0, 0.0), abs=1e-12)


def test_compass_of_the_mirrored_detector_is_north_up_east_right():
    north, east = compass(1)
    assert north == pytest.approx((0.0, 1.0), abs=1e-12)
    assert east == pytest.approx((1.0, 0.0), abs=1e-12)


def test_roll_turns_the_compass():
    # A roll of 90 deg brings PA 90 (east) to +y; with parity -1 the PA 0 direction is then at +x.
    north, east = compass(-1, 90.0)
    assert north == pytest.approx((1.0, 0.0), abs=1e-12)
    assert east == pytest.approx((0.0, 1.0), abs=1e-12)


def test_geometry():
    panels = _panels()
    assert panels.star_pixel == (3.0, 2.0)
    assert panels.extent_arcsec == pytest.approx((-0.35, 0.35, -0.25, 0.25))
    hole = panels.inside_hole()
    assert hole.sum() == 16  # offsets of one or two pixels in x and in y, four quadrants
    assert not hole[2].any()
    assert not hole[:, 3].any()
    assert not hole[:, [0, 6]].any()


@pytest.mark.parametrize(
    "changes",
    [
        {"science": np.zeros(3)},
        {"residual": np.zeros((2, 2))},
        {"pixel_scale_arcsec": 0.0},
        {"aperture_radius_arcsec": float("nan")},
        {"parity": 0},
    ],
)
def test_bad_panels_are_refused(refused, changes):
    refused("", _panels, **changes)


def test_scales_come_from_the_hole(panels):
    one = next(iter(panels.values()))
    hole = one.inside_hole()
    low, high, width = stack_scale(one)
    assert one.science[hole].min() <= low < high <= max(one.science[hole].max(), one.reference[hole].max())
    assert 0 < width < high - low
    limit, sigma = residual_limit(one), np.nanstd(one.residual[hole])
    assert 4 * sigma < limit < 9 * sigma


def test_scales_of_empty_and_constant_images_are_usable():
    nothing = np.full((5, 7), np.nan)
    for image in (np.zeros((5, 7)), nothing):
        low, high, width = stack_scale(_panels(science=image, reference=image))
        assert low < high
        assert width > 0
        assert residual_limit(_panels(residual=image)) > 0
