"""Extended sources on the detector: absolute pictures, totals, and moments against closed forms."""

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import write_npz
from simulator.config.scene import extended_source
from simulator.imaging.frame import render_extended
from simulator.target import sky_to_detector

STEP = 0.008
INNER, OUTER = 0.3, 0.6


def disc(**keys):
    return extended_source({"contrast": 1e-6, "inner_arcsec": INNER, "outer_arcsec": OUTER} | keys)


def moments(grid):
    """Total, photocentre (x, y), and second moments about it (xx, yy, xy)."""
    total = grid.flux.sum()
    flux = grid.flux / total
    x, y = flux.sum(axis=0) @ grid.x_arcsec, flux.sum(axis=1) @ grid.y_arcsec
    dx, dy = grid.x_arcsec - x, grid.y_arcsec - y
    return total, x, y, flux.sum(axis=0) @ dx**2, flux.sum(axis=1) @ dy**2, dy @ flux @ dx


def axes_of(grid):
    """Rms along the major and minor axis, and the angle of the major one from +x in degrees, -90 to 90."""
    _, _, _, xx, yy, xy = moments(grid)
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    return np.sqrt(values[1]), np.sqrt(values[0]), (angle + 90) % 180 - 90


def test_a_face_on_disc_is_round():
    total, x, y, xx, yy, xy = moments(render_extended(disc(), step_arcsec=STEP))
    assert total == pytest.approx(1, abs=1e-12)
    assert (x, y, xy) == pytest.approx((0, 0, 0), abs=1e-12)
    assert xx == pytest.approx(yy, rel=1e-12)
    # Uniform between two radii: (R^2 + r^2) / 4, and at most a quarter of a step squared from the grid.
    assert 0 < xx - (OUTER**2 + INNER**2) / 4 < STEP**2 / 4


@pytest.mark.parametrize("slope", [-3.5, -2.0, -1.0, 0.0, 2.0])
def test_the_light_falls_off_as_asked(slope):
    grid = render_extended(disc(slope=slope, outer_arcsec=1.2), step_arcsec=STEP)
    r = np.hypot(grid.x_arcsec, grid.y_arcsec[:, None])

    def inside(radius):
        q = slope + 2
        return np.log(radius / INNER) / np.log(4) if q == 0 else (radius**q - INNER**q) / (1.2**q - INNER**q)

    for radius in (0.5, 0.8, 1.1):
        # Mean over radii, since a grid does not cut a circle smoothly.
        found = np.mean([grid.flux[r < radius + part * STEP].sum() for part in np.linspace(-2, 2, 81)])
        assert found == pytest.approx(inside(radius), abs=5e-4)
    assert grid.flux.sum() == pytest.approx(1, abs=1e-12)
    assert not grid.flux[r < INNER - 2 * STEP].any()
    assert not grid.flux[r > 1.2 + 2 * STEP].any()


@pytest.mark.parametrize(("inclination", "error"), [(0, 5e-4), (75, 1e-3), (90, 2e-3)])
def test_the_grid_does_not_show_through_the_telescope(inclination, error):
    pixel = 0.0162

    def seen(parts):
        """On pixel centres, through a Gaussian of 1.7 pixels."""
        grid = render_extended(disc(inclination_deg=inclination, pa_deg=30), step_arcsec=pixel / parts, roll_deg=17)
        centres = np.arange(-45, 46) * pixel
        y, x = (
            np.exp(-0.5 * ((centres[:, None] - axis) / (1.7 * pixel)) ** 2) for axis in (grid.y_arcsec, grid.x_arcsec)
        )
        return y @ grid.flux @ x.T

    fine = seen(16)
    coarse, quarter = (np.abs(seen(parts) - fine).max() / fine.max() for parts in (2, 4))
    assert quarter < error
    assert coarse < 5 * error


def test_a_disc_to_the_centre_is_finite():
    grid = render_extended(disc(inner_arcsec=0, slope=-1.99), step_arcsec=STEP)
    assert grid.flux.sum() == pytest.approx(1, abs=1e-12)
    # Light within r is (r / R)^0.01.
    r = np.hypot(grid.x_arcsec, grid.y_arcsec[:, None])
    assert grid.flux[r < 0.02].sum() == pytest.approx((0.02 / OUTER) ** 0.01, abs=2e-3)


@pytest.mark.parametrize("inclination", [30, 60, 80, 90])
def test_inclination_squeezes_the_minor_axis(inclination):
    # Position angle 90: the major axis lies east-west, along x.
    grid = render_extended(disc(inclination_deg=inclination, pa_deg=90), step_arcsec=STEP)
    _, x, y, xx, yy, xy = moments(grid)
    broad = xx - (OUTER**2 + INNER**2) / 4  # the same on both axes, but for the phase on the grid
    assert 0 < broad < STEP**2 / 4
    assert yy == pytest.approx(np.cos(np.radians(inclination)) ** 2 * (OUTER**2 + INNER**2) / 4, abs=STEP**2 / 4)
    assert (x, y, xy) == pytest.approx((0, 0, 0), abs=1e-12)
    if inclination == 60:
        major, minor, angle = axes_of(grid)
        assert minor / major == pytest.approx(0.5, abs=1e-3)
        assert angle == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("pa", "roll", "parity", "angle"),
    [
        (90, 0, -1, 0),  # east-west: along x
        (0, 0, -1, -90),  # north-south: along y
        (45, 0, -1, -45),  # from north to east: up to left
        (45, 0, 1, 45),  # mirrored: up to right
        (45, 45, -1, -90),  # a roll of 45 deg brings it upright
        (30, 0, -1, -60),
        (120, 50, 1, 20),
    ],
)
def test_position_angle_roll_and_parity(pa, roll, parity, angle):
    grid = render_extended(disc(inclination_deg=70, pa_deg=pa), step_arcsec=STEP, roll_deg=roll, parity=parity)
    found = axes_of(grid)[2]
    assert abs((found - angle + 90) % 180 - 90) < 0.05


def test_the_near_half_of_an_offset_disc_stands_where_a_star_would():
    offset = {"center_separation_arcsec": 0.2, "center_pa_deg": 90}
    _, x, y, *_ = moments(render_extended(disc(**offset), step_arcsec=STEP))
    assert x == pytest.approx(-0.2, abs=1e-12)  # east is to the left
    assert y == pytest.approx(0, abs=1e-12)
    _, x, y, *_ = moments(render_extended(disc(**offset), step_arcsec=STEP, parity=1))
    assert x == pytest.approx(0.2, abs=1e-12)
    for roll, parity in ((33, -1), (-120, 1)):
        _, x, y, *_ = moments(render_extended(disc(**offset), step_arcsec=STEP, roll_deg=roll, parity=parity))
        assert (x, y) == pytest.approx(sky_to_detector(0.2, 90, roll_deg=roll, parity=parity), abs=1e-12)


def test_a_ring_is_a_gaussian_about_its_radius():
    ring = extended_source({"contrast": 1e-6, "radius_arcsec": 0.5, "fwhm_arcsec": 0.1})
    total, _, _, xx, yy, _ = moments(render_extended(ring, step_arcsec=STEP))
    sigma2 = (0.1 / 2.354820045) ** 2
    assert total == pytest.approx(1, abs=1e-12)
    # <r^2> of r exp(-(r - a)^2 / 2 s^2): (a^3 + 3 a s^2) / a.
    assert 0 < xx - (0.25 + 3 * sigma2) / 2 < STEP**2 / 4
    assert xx == pytest.approx(yy, rel=1e-12)
    thin = extended_source({"contrast": 1e-6, "radius_arcsec": 0.5, "fwhm_arcsec": 1e-4, "inclination_deg": 90})
    assert render_extended(thin, step_arcsec=STEP).flux.sum() == pytest.approx(1, abs=1e-12)
    wide = extended_source({"contrast": 1e-6, "radius_arcsec": 0.01, "fwhm_arcsec": 0.2})
    assert render_extended(wide, step_arcsec=STEP).flux.sum() == pytest.approx(1, abs=1e-12)


def test_the_grid_belongs_to_the_detector():
    grid = render_extended(disc(center_separation_arcsec=0.123, center_pa_deg=7), step_arcsec=STEP, roll_deg=19)
    for axis in (grid.x_arcsec, grid.y_arcsec):
        np.testing.assert_allclose(axis / STEP, np.rint(axis / STEP), atol=1e-9)
        np.testing.assert_allclose(np.diff(axis), STEP, rtol=1e-9)
    assert grid.flux.shape == (grid.y_arcsec.size, grid.x_arcsec.size)
    assert grid.flux.min() >= 0


def test_reach_leaves_out_what_lies_beyond():
    wide = disc(outer_arcsec=3.0, inclination_deg=50, pa_deg=20, center_separation_arcsec=0.4, center_pa_deg=100)
    whole = render_extended(wide, step_arcsec=0.02)
    part = render_extended(wide, step_arcsec=0.02, reach_arcsec=1.0)
    assert np.abs(part.x_arcsec).max() <= 1.0
    near = [np.abs(axis) < 0.99 for axis in (whole.y_arcsec, whole.x_arcsec)]
    inner = [np.abs(axis) < 0.99 for axis in (part.y_arcsec, part.x_arcsec)]
    np.testing.assert_allclose(part.flux[np.ix_(*inner)], whole.flux[np.ix_(*near)], rtol=1e-9, atol=1e-18)
    away = disc(center_separation_arcsec=5.0, center_pa_deg=0)
    assert not render_extended(away, step_arcsec=0.02, reach_arcsec=1.0).flux.any()


def image_of(tmp_path, data, **keys):
    header = fits.Header({"PIXSCALE": keys.pop("scale")}) if "scale" in keys else None
    fits.writeto(tmp_path / "a.fits", np.asarray(data, dtype=float), header=header, overwrite=True)
    return extended_source({"contrast": 1e-6, "file": str(tmp_path / "a.fits")} | keys)


def test_images_stand_with_north_up_and_east_left(tmp_path):
    data = np.zeros((7, 9))
    data[5, 1] = 3.0  # two up, three to the left of the middle
    image = image_of(tmp_path, data, scale=0.1)
    total, x, y, xx, *_ = moments(render_extended(image, step_arcsec=STEP))
    assert total == pytest.approx(1, abs=1e-12)
    assert (x, y) == pytest.approx((-0.3, 0.2), abs=1e-12)
    assert xx == pytest.approx(0.1**2 / 12, abs=STEP**2 / 4)
    # The pixel is at (3, 2) toward east and north: a roll or a parity moves it as a point there.
    pa, rho = np.degrees(np.arctan2(0.3, 0.2)), np.hypot(0.3, 0.2)
    for roll, parity, own in ((0, 1, 0), (40, -1, 0), (40, 1, 0), (0, -1, 25), (10, 1, -70)):
        turned = image.model_copy(update={"pa_deg": float(own)})
        grid = render_extended(turned, step_arcsec=STEP, roll_deg=roll, parity=parity)
        assert moments(grid)[1:3] == pytest.approx(
            sky_to_detector(rho, pa + own, roll_deg=roll, parity=parity), abs=1e-12
        )
        assert grid.flux.sum() == pytest.approx(1, abs=1e-12)


def test_image_pixels_are_squares_of_even_light(tmp_path):
    data = np.random.default_rng(1).uniform(size=(6, 5))
    grid = render_extended(image_of(tmp_path, data, scale=0.1), step_arcsec=0.02)
    # Grid points that belong to one pixel wholly hold its surface brightness; columns run to the west.
    where = np.ix_(np.abs(grid.y_arcsec - 0.05) < 0.025, np.abs(grid.x_arcsec - 0.2) < 0.025)
    np.testing.assert_allclose(grid.flux[where], data[3, 4] / data.sum() * (0.02 / 0.1) ** 2, rtol=1e-9)


def test_the_centre_of_an_image_can_be_told(tmp_path):
    data = np.zeros((4, 4))
    data[2, 3] = 1
    image = image_of(
        tmp_path, data, pixel_scale_arcsec=0.05, center_pixel=[3, 2], center_separation_arcsec=0.3, center_pa_deg=180
    )
    assert moments(render_extended(image, step_arcsec=STEP))[1:3] == pytest.approx((0, -0.3), abs=1e-12)


def test_images_in_npz_files(tmp_path):
    write_npz(tmp_path / "a.npz", {"image": np.ones((3, 3)), "pixel_scale_arcsec": 0.1})
    image = extended_source({"contrast": 1e-6, "file": str(tmp_path / "a.npz")})
    _, _, _, xx, yy, _ = moments(render_extended(image, step_arcsec=STEP))
    assert (xx, yy) == pytest.approx((0.3**2 / 12, 0.3**2 / 12), abs=STEP**2 / 4)


@pytest.mark.parametrize(
    ("data", "keys", "words"),
    [
        (np.ones((5, 5)), {}, "pixel_scale_arcsec = missing arcsec.*PIXSCALE or CDELT"),
        (np.ones((5, 5)), {"scale": 0.1, "pixel_scale_arcsec": 0.2}, "pixel_scale_arcsec = 0.2 arcsec.*0.1, as the"),
        (np.ones((5, 5)), {"scale": 11.0}, "pixel_scale_arcsec = 11.0 arcsec.*at most 10"),
        (-np.ones((5, 5)), {"scale": 0.1}, "no negative values.*25 are, down to -1"),
        (np.full((5, 5), np.nan), {"scale": 0.1}, "finite values.*25 are not"),
        (np.zeros((5, 5)), {"scale": 0.1}, "light in it"),
        (np.ones((2, 5, 5)), {"scale": 0.1}, "plane of the cube"),
        (np.ones((5, 5)), {"scale": 0.1, "center_pixel": [7, 1]}, r"center_pixel = \(7.0, 1.0\) px.*5 x 5"),
    ],
)
def test_bad_images_are_refused(refused, tmp_path, data, keys, words):
    image = image_of(tmp_path, data, name="dust", **keys)
    refused(words, render_extended, image, step_arcsec=STEP)


def test_bad_grids_are_refused(refused):
    for keys, words in (
        ({"step_arcsec": 0.0}, "step_arcsec = 0.0 arcsec"),
        ({"step_arcsec": float("nan")}, "step_arcsec"),
        ({"step_arcsec": STEP, "reach_arcsec": -1.0}, "reach_arcsec = -1.0 arcsec"),
        ({"step_arcsec": 1e-4}, "give reach_arcsec"),
        ({"step_arcsec": STEP, "parity": 0}, "parity"),
        ({"step_arcsec": STEP, "roll_deg": float("inf")}, "roll_deg"),
    ):
        refused(words, render_extended, disc(), **keys)
