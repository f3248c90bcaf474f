"""Light of a scene on the pixels: windows, sky, companions, extended sources, the paper's shortcut."""

import numpy as np
import pytest

from cpic_core import InputError
from simulator.config import load_instrument, load_scene
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
from simulator.imaging.scene_image import BandTransfer, PointSources, scene_image
from simulator.knobs import Knobs
from simulator.target import Source, extended_rates

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
