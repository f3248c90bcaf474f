"""Templates: files of every kind, refusals, and what a set means."""

import numpy as np
import pytest
from astropy.io import fits

from simulator.effects import draw_cosmic_rays, read_templates
from simulator.effects.cosmic_rays import TemplateModel, generated_templates

BAR = np.zeros((5, 21))
BAR[2] = 1.0  # a bar of 21 samples along the columns
DOT = np.zeros((5, 21))
DOT[4, 3] = 7.0


def write_npz(path, templates, **more):
    np.savez(path, templates=templates, **({"pixel_um": 6.5} | more))
    return str(path)


def write_fits(path, data, card=6.5, extension=False):
    hdus = [fits.PrimaryHDU(None if extension else data)] + ([fits.ImageHDU(data)] if extension else [])
    if card is not None:
        hdus[-1].header["PIXUM"] = card
    fits.HDUList(hdus).writeto(path, overwrite=True)
    return str(path)


@pytest.mark.parametrize("kind", ["npz", "fits", "extension"])
def test_a_set_is_read(tmp_path, kind):
    cube = np.stack([BAR, DOT]).astype(np.float32)
    path = (
        write_npz(tmp_path / "a.npz", cube)
        if kind == "npz"
        else write_fits(tmp_path / "a.fits", cube, extension=kind == "extension")
    )
    found = read_templates(path)
    np.testing.assert_array_equal(found.start, [0, 21, 22])
    np.testing.assert_allclose(found.column_um[:21], (np.arange(21) - 10) * 6.5, atol=1e-9)
    np.testing.assert_allclose(found.row_um, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.weight, [1 / 21] * 21 + [1.0])
    np.testing.assert_allclose(found.radius_um, [65.0, 0.0], atol=1e-9)
    # A bar of points: variance (n^2 - 1) / 12 samples^2.
    np.testing.assert_allclose(found.extent_um, [np.sqrt(21**2 - 1) * 6.5, 0.0], atol=1e-6)
    assert found.pixel_um == 6.5


def test_one_image_is_a_set_of_one(tmp_path):
    assert read_templates(write_fits(tmp_path / "a.fits", BAR)).radius_um.size == 1


def test_a_changed_file_is_read_again(tmp_path):
    path = tmp_path / "a.npz"
    write_npz(path, BAR)
    assert read_templates(str(path)).start[-1] == 21
    write_npz(path, np.stack([BAR, BAR, DOT]))
    assert read_templates(str(path)).start[-1] == 43


@pytest.mark.parametrize(
    ("templates", "more", "words"),
    [
        (np.full((2, 3, 3), np.nan), {}, "template 0, row 0, column 0 is not finite"),
        (np.stack([BAR, BAR - 0.5]), {}, "template 1, row 0, column 0 is negative"),
        (np.stack([BAR, 0 * BAR]), {}, "template 1 has none"),
        (np.ones(5), {}, "cube"),
        (np.ones((2, 2, 2, 2)), {}, "cube"),
        (np.ones((0, 3, 3)), {}, "cube"),
        (np.ones((2, 3, 3), dtype=complex), {}, "complex"),
        (np.array([["a", "b"], ["c", "d"]]), {}, "real numbers"),
        (BAR, {"pixel_um": 0.0}, "size of a sample"),
        (BAR, {"pixel_um": -3.0}, "size of a sample"),
        (BAR, {"pixel_um": np.nan}, "one finite number"),
        (BAR, {"pixel_um": [1.0, 2.0]}, "one finite number"),
    ],
)
def test_bad_sets_are_refused(refused, tmp_path, templates, more, words):
    refused(f"template_file.*{words}", read_templates, write_npz(tmp_path / "a.npz", templates, **more))


def test_files_of_another_kind_are_refused(refused, tmp_path):
    (tmp_path / "text.fits").write_text("no templates")
    np.savez(tmp_path / "other.npz", tracks=BAR, pixel_um=6.5)
    np.savez(tmp_path / "pickled.npz", templates=np.array([{"a": 1}], dtype=object), pixel_um=6.5)
    np.savez(tmp_path / "unscaled.npz", templates=BAR)
    unscaled = write_fits(tmp_path / "unscaled.fits", BAR, card=None)
    for name in ("missing.npz", "text.fits", "other.npz", "pickled.npz", "unscaled.npz", unscaled):
        refused("template_file", read_templates, str(tmp_path / name))


def test_file_reaches_the_image(tmp_path, cosmic, rng):
    path = write_npz(tmp_path / "a.npz", BAR, pixel_um=13.0)
    config = cosmic("template", template={"template_file": path})
    rays = draw_cosmic_rays(config, (200, 200), 13.0, 3000.0, 1.0, rng)
    np.testing.assert_allclose(rays.projected_um, np.sqrt(21**2 - 1) * 13.0)
    # One whole event: a bar of 21 pixels, turned; the second moment along its direction is that of the bar.
    whole = np.flatnonzero(rays.left_e == rays.charge_e)
    other = whole[np.argmax(rays.charge_e[whole])]
    y, x = np.mgrid[:200, :200]
    angle = np.deg2rad(rays.azimuth_deg[other])
    along = (x - rays.column[other]) * np.cos(angle) + (y - rays.row[other]) * np.sin(angle)
    across = (y - rays.row[other]) * np.cos(angle) - (x - rays.column[other]) * np.sin(angle)
    near = (np.abs(along) < 12) & (np.abs(across) < 3)
    assert rays.image()[near].sum() >= 0.9 * rays.charge_e[other]


def test_one_event_keeps_moments_under_rotation(tmp_path, rng):
    from simulator.config import load_instrument
    from simulator.effects.cosmic_rays import Canvas

    found = read_templates(write_npz(tmp_path / "a.npz", BAR, pixel_um=13.0))
    model = TemplateModel(found, load_instrument().cosmic_rays.paper, 13.0)
    tracks = model.tracks(1, rng)
    y, x = np.mgrid[:61, :61]
    for azimuth in np.deg2rad([0.0, 33.0, 90.0, 250.0]):
        canvas = Canvas((61, 61))
        placed = (np.array([30.25]), np.array([29.5]), np.array([azimuth]))
        canvas.add(tracks, model.points(tracks, rng), *placed, np.array([10_000_000]))
        share = canvas.image / 1e7
        # A Gaussian of half a pixel, sampled by pixels, moves by up to exp(-2 pi^2 sigma^2) / pi = 0.0023.
        assert (share * y).sum() == pytest.approx(30.25, abs=2.5e-3)
        assert (share * x).sum() == pytest.approx(29.5, abs=2.5e-3)
        along = (x - 29.5) * np.cos(azimuth) + (y - 30.25) * np.sin(azimuth)
        # Bar of points, blending of half a sample, and a pixel's width along any direction.
        assert (share * along**2).sum() == pytest.approx((21**2 - 1) / 12 + 0.25 + 1 / 12, rel=2e-3)


def test_generated_set_is_the_physical_model_finely_sampled(cosmic):
    config = cosmic("template")
    found = generated_templates(config.template, config.physical)
    assert found is generated_templates(config.template, config.physical)
    assert found.radius_um.size == 200
    assert found.pixel_um == 3.25
    # Extents: a projected chord, wider by diffusion and sampling: median depth x 1 and some.
    longest = np.sqrt(1000.0**2 - 14.0**2)
    assert 15.0 < np.median(found.extent_um) < 30.0
    assert found.extent_um.max() < longest + 40.0
    np.testing.assert_allclose(np.add.reduceat(found.weight, found.start[:-1]), 1.0, rtol=1e-12)
    other = generated_templates(cosmic("template", template={"generated_seed": 2}).template, config.physical)
    assert not np.array_equal(other.extent_um, found.extent_um)
