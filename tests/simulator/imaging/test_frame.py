"""Light of a scene on the pixels: windows, sky, companions, extended sources, the paper's shortcut.

Extended sources on the detector: absolute pictures, totals, and moments against closed forms.
"""

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError, write_npz
from simulator.config import load_instrument, load_scene
from simulator.config.scene import extended_source
from simulator.imaging import (
    build_imager,
    forget_starlight,
    frame,
    full_star_map,
    off_axis_light,
    single_band_psf,
    sky_transmission,
    window_of,
)
from simulator.imaging.external import load_psf, save_psf
from simulator.imaging.frame import render_extended
from simulator.imaging.scene_image import BandTransfer, PointSources, scene_image
from simulator.knobs import Knobs
from simulator.target import Source, extended_rates, sky_to_detector

SMALL = load_instrument({"detector": {"n_rows": 211, "n_columns": 190, "star_row": 90, "star_column": 100}})
STAR = {"name": "s", "v_mag": 5.0, "teff_k": 5800}


@pytest.fixture(scope="module")
def psf():
    return single_band_psf("F520", instrument=SMALL)


def source(x, y, rate=1.0):
    return Source("b", "planet", x, y, rate)


def test_windows_agree_on_where_the_mask_is(psf):
    full, hole = window_of(psf, SMALL, full=True), window_of(psf, SMALL, full=False)
    assert full.shape == (211, 190)
    assert hole.shape == (137, 137)
    assert full.rows[90] == full.columns[100] == hole.rows[68] == hole.columns[68] == 0.0
    rows, columns, inside = full.stamp(137)
    np.testing.assert_array_equal(full.rows[rows], hole.rows[inside[0]])
    np.testing.assert_array_equal(full.columns[columns], hole.columns[inside[1]])


def test_sky_passes_the_mask_by_its_area(psf):
    window = window_of(psf, SMALL, full=True)
    opened = sky_transmission(psf, window)
    pixel, bar = psf.pixel_scale_arcsec, psf.imager.mask_half_width_arcsec
    sides = [n * pixel - 2 * bar for n in window.shape]
    assert opened.sum() * pixel**2 == pytest.approx(sides[0] * sides[1], rel=1e-12)


@pytest.mark.parametrize("place", [(0.3127, 0.4031), (-0.2, 0.517), (5.0, -3.3), (-0.161, 0.1551)])
def test_a_source_is_its_own_propagation_behind_the_mask(psf, place):
    fine = single_band_psf("F520", fidelity=Knobs(pixel_nodes=8), instrument=SMALL)
    image = off_axis_light(psf, window_of(psf, SMALL, full=False), [source(*place)], (), roll_deg=0.0)
    assert np.abs(image - fine.at(*place)).max() < 1e-6 * fine.off_axis.max()


def test_stamp_and_frame_hold_the_same_light(psf):
    sources = [source(0.31, 0.42), source(-0.9, 0.66, 3.0), source(12.0, -9.0, 1e6)]
    hole, full = (window_of(psf, SMALL, full=full) for full in (False, True))
    small, large = (off_axis_light(psf, window, sources, (), roll_deg=0.0) for window in (hole, full))
    rows, columns, inside = full.stamp(137)
    assert np.abs(large[rows, columns] - small[inside]).max() < 1e-11 * 1e6 * psf.off_axis.max()
    assert small.min() >= 0


def test_a_bright_companion_far_outside_leaves_more_than_the_hole(psf):
    """Alpha Cen A seen from B at 8 arcsec: ten to a hundred times the light of the hole."""
    image = off_axis_light(psf, window_of(psf, SMALL, full=False), [source(5.0, 6.2, 3.5)], (), roll_deg=0.0)
    hole = psf.metrics.hole
    assert 3 < image[hole].mean() / psf.on_axis[hole].mean() < 300
    wing = psf.metrics.wing_at(-5.0 + 0.4, -6.2 + 0.4)
    assert image[hole].mean() == pytest.approx(3.5 * wing, rel=1.0)  # smoothed over 0.15 arcsec


def test_star_off_the_mask_moves_everything(psf):
    window = window_of(psf, SMALL, full=False)
    moved = off_axis_light(psf, window, [source(0.3, 0.3)], (), roll_deg=0.0, star_arcsec=(0.1, -0.05))
    there = off_axis_light(psf, window, [source(0.4, 0.25)], (), roll_deg=0.0)
    np.testing.assert_allclose(moved, there, rtol=1e-9, atol=1e-15)


def test_far_map_leaves_the_stamp_to_the_drifting_frames(psf):
    window = window_of(psf, SMALL, full=True)
    image = full_star_map(psf, window)
    rows, columns, _ = window.stamp(137)
    assert not image[rows, columns].any()
    assert image.max() > 0


def test_extended_light_is_that_of_its_points(psf):
    disc = {
        "kind": "disc",
        "inner_arcsec": 0.35,
        "outer_arcsec": 0.6,
        "contrast": 1e-6,
        "inclination_deg": 50,
        "pa_deg": 30,
    }
    scene = load_scene({"name": "s", "cstar": STAR, "extended": [disc]})
    items = extended_rates(scene, SMALL, "F520")
    window = window_of(psf, SMALL, full=False)
    image = off_axis_light(psf, window, (), items, roll_deg=10.0)
    assert image.min() >= 0
    # All light that passes the cross falls on the stamp, less the wings.
    unmasked = single_band_psf(
        "F520",
        instrument=load_instrument(
            {"detector": SMALL.detector.model_dump(), "coronagraph": {"mask_half_width_arcsec": 0.0}}
        ),
    )
    whole = off_axis_light(unmasked, window, (), items, roll_deg=10.0)
    assert whole.sum() == pytest.approx(items[0].rate_e_s * psf.metrics.apodizer_energy, rel=0.12)
    rotated = off_axis_light(psf, window, (), items, roll_deg=40.0)
    # PA 30 at roll 30 has its major axis along y: symmetric about both axes but for the aberrations.
    assert np.abs(rotated - image).max() > 0.1 * image.max()


def test_the_papers_model_forgets_the_mask_and_rounds_positions(psf):
    window = window_of(psf, SMALL, full=False)
    behind = [source(0.0, 0.5)]
    exact, paper = (off_axis_light(psf, window, behind, (), roll_deg=0.0, model=model) for model in ("exact", "paper"))
    assert paper.max() > 0.9 * psf.off_axis.max()
    assert exact.max() < 0.05 * psf.off_axis.max()
    disc = {"kind": "disc", "inner_arcsec": 0.3, "outer_arcsec": 0.5, "contrast": 1e-6}
    scene = load_scene({"name": "s", "cstar": STAR, "extended": [disc]})
    with pytest.raises(InputError, match="scene_model"):
        off_axis_light(psf, window, behind, extended_rates(scene, SMALL, "F520"), roll_deg=0.0, model="paper")


def test_a_psf_from_a_file_replaces_the_model(psf, tmp_path):
    save_psf(psf, tmp_path / "psf.npz")
    loaded = load_psf(tmp_path / "psf.npz", instrument=SMALL)
    window = window_of(loaded, SMALL, full=False)
    ours, theirs = (off_axis_light(one, window, [source(0.313, 0.402)], (), roll_deg=0.0) for one in (psf, loaded))
    clear = sky_transmission(psf, window) == 1.0
    assert np.abs(ours - theirs)[clear].max() < 2e-3 * psf.off_axis.max()  # wings beyond the kernel are missing
    assert not full_star_map(loaded, window_of(loaded, SMALL, full=True)).any()


def test_nothing_gives_no_light(psf):
    window = window_of(psf, SMALL, full=False)
    assert not off_axis_light(psf, window, (), (), roll_deg=0.0).any()


@pytest.mark.parametrize("distance", [4.0, 8.0])
def test_wings_of_a_far_companion_are_those_of_its_whole_band(psf, distance):
    """Four wavelengths turn the wings into a pattern; the companion gets as many as its distance asks for."""
    window = window_of(psf, SMALL, full=False)
    place = (distance * 0.6, distance * 0.8)
    companion = Source("A", "star", *place, 1.0)
    fine = build_imager(SMALL, "F520", Knobs(wavelength_nodes=33))
    axis = fine.stamp_axis(masked=True)
    exact = fine.image(axis, axis, source_arcsec=place)
    hole = psf.metrics.hole
    ours = off_axis_light(psf, window, [companion], (), roll_deg=0.0)
    assert np.abs(ours - exact)[hole].max() < 0.02 * exact[hole].mean()
    plain = off_axis_light(psf, window, [source(*place)], (), roll_deg=0.0)
    assert np.abs(plain - exact)[hole].max() > 0.05 * exact[hole].mean()


def test_field_stars_are_made_once_for_both_visits(psf, monkeypatch):
    made = []
    monkeypatch.setattr(frame, "scene_image", lambda *given, **more: (made.append(1), scene_image(*given, **more))[1])
    forget_starlight()
    window = window_of(psf, SMALL, full=False)
    stars = [Source("b", "star", 0.6, 0.4, 1.0), Source("c", "star", -2.0, 5.0, 3.0)]
    science = off_axis_light(psf, window, [*stars, source(0.4, 0.4, 1e-6)], (), roll_deg=0.0)
    first = len(made)
    reference = off_axis_light(psf, window, stars, (), roll_deg=0.0)
    assert len(made) == first
    alone = off_axis_light(psf, window, [source(0.4, 0.4, 1e-6)], (), roll_deg=0.0)
    np.testing.assert_array_equal(science, reference + alone)
    off_axis_light(psf, window, stars, (), roll_deg=0.0)[:] = 1.0  # what is kept is not what is given out
    np.testing.assert_array_equal(off_axis_light(psf, window, stars, (), roll_deg=0.0), reference)
    made.clear()
    for changed in ([Source("b", "star", 0.6, 0.4, 2.0), stars[1]], [Source("b", "star", 0.61, 0.4, 1.0), stars[1]]):
        assert not np.array_equal(off_axis_light(psf, window, changed, (), roll_deg=0.0), reference)
    finer = single_band_psf("F520", fidelity=Knobs(wavelength_nodes=5), instrument=SMALL)
    off_axis_light(finer, window, stars, (), roll_deg=0.0)
    assert len(made) >= 3
    forget_starlight()
    made.clear()
    off_axis_light(psf, window, stars, (), roll_deg=0.0)
    assert len(made) == first - 1


def test_a_finer_pupil_grid_is_the_same_light(psf):
    fine = single_band_psf("F520", fidelity=Knobs(pupil_samples=256), instrument=SMALL)
    stars = [Source("b", "star", 0.6, 0.4, 1.0), Source("c", "star", -2.0, 5.0, 3.0), source(0.4, 0.4, 2.0)]
    window = window_of(psf, SMALL, full=False)
    one, other = (off_axis_light(optics, window, stars, (), roll_deg=0.0) for optics in (psf, fine))
    assert np.abs(one - other).max() < 1e-12 * one.max()
    # What the finer grid itself gives.
    direct = scene_image(
        BandTransfer(fine.imager),
        window.rows,
        window.columns,
        fine.pixel_scale_arcsec,
        PointSources([0.4], [0.4], [2.0]),
        mask_half_width_arcsec=fine.imager.mask_half_width_arcsec,
    )
    planet = off_axis_light(fine, window, stars[2:], (), roll_deg=0.0)
    assert np.abs(planet - direct).max() < 1e-12 * direct.max()


def test_star_far_off_the_mask_has_its_core_at_full_accuracy(psf):
    window = window_of(psf, SMALL, full=True)
    place = (1.0, -1.2)
    image = full_star_map(psf, window, place)
    exact = psf.imager.image(
        psf.imager.axis(window.rows, masked=True), psf.imager.axis(window.columns, masked=True), source_arcsec=place
    )
    rows, columns, _ = window.stamp(137)
    exact[rows, columns] = 0.0
    peak = psf.off_axis.max()
    core = np.hypot(window.rows[:, None] - place[1], window.columns - place[0]) < 0.5
    assert np.abs(image - exact)[core].max() < 1e-7 * peak  # single precision in the cache
    assert np.abs(image - exact).max() < 1e-4 * peak  # one node a pixel on wings of 1e-3


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
        ({"step_arcsec": 1e-4}, "give reach_arcsec"),
        ({"step_arcsec": STEP, "parity": 0}, "parity"),
        ({"step_arcsec": STEP, "roll_deg": float("inf")}, "roll_deg"),
    ):
        refused(words, render_extended, disc(), **keys)
