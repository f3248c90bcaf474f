import numpy as np
import pytest
from astropy.io import fits

from simulator.arrays import read_npz, write_npz
from simulator.config import load_instrument
from simulator.imaging.apodizer import disc_coverage, load_apodizer, shipped_apodizers, upsample
from simulator.imaging.build import bare_imager


def test_shipped_mask_is_a_read_only_transmission_map():
    assert "lpx43" in shipped_apodizers()
    assert not any(name.startswith("metrics") for name in shipped_apodizers())
    mask = load_apodizer("lpx43")
    assert mask.shape == (64, 64)
    assert mask.dtype == np.float64
    assert not mask.flags.writeable
    assert mask.min() >= 0
    assert mask.max() <= 1


def test_npz_and_fits_give_the_same_map(tmp_path):
    mask = np.linspace(0, 1, 64).reshape(8, 8)
    write_npz(tmp_path / "a.npz", {"transmission": mask})
    fits.writeto(tmp_path / "a.fits", mask)
    np.testing.assert_array_equal(load_apodizer(tmp_path / "a.npz"), mask)
    np.testing.assert_array_equal(load_apodizer(tmp_path / "a.fits"), mask)


@pytest.mark.parametrize(
    "mask",
    [
        np.full((8, 8), 1.1),
        np.full((8, 8), np.nan),
        np.zeros((8, 8)),
        np.ones((8, 9)),
        np.ones((9, 9)),
        np.ones((8, 8), dtype=complex),
    ],
)
def test_bad_maps_are_refused(refused, tmp_path, mask):
    write_npz(tmp_path / "a.npz", {"transmission": mask})
    refused("apodizer", load_apodizer, tmp_path / "a.npz")


def test_pickles_and_missing_files_are_refused(refused, tmp_path):
    np.savez(tmp_path / "evil.npz", transmission=np.array([{"a": 1}], dtype=object))
    refused("plain arrays", load_apodizer, tmp_path / "evil.npz")
    refused("lpx43", load_apodizer, "no_such_mask")
    (tmp_path / "text.npz").write_text("hello")
    refused("", load_apodizer, tmp_path / "text.npz")


def test_upsampling_repeats_steps(refused):
    mask = load_apodizer("lpx43")
    fine = upsample(mask, 256)
    np.testing.assert_array_equal(fine[::4, 3::4], mask)
    refused("pupil_samples", upsample, mask, 100)


def test_written_bytes_depend_on_content_only(tmp_path):
    arrays = {"b": np.arange(3), "a": np.array("key")}
    write_npz(tmp_path / "1.npz", arrays)
    write_npz(tmp_path / "2.npz", dict(reversed(arrays.items())))
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "2.npz").read_bytes()
    assert str(read_npz(tmp_path / "1.npz")["a"]) == "key"


def test_intensity_maps_give_the_root(refused, tmp_path):
    intensity = np.linspace(0, 1, 64).reshape(8, 8)
    fits.writeto(tmp_path / "a.fits", intensity.astype(np.float32))
    np.testing.assert_allclose(load_apodizer(tmp_path / "a.fits", kind="intensity"), np.sqrt(intensity), rtol=1e-7)
    write_npz(tmp_path / "a.npz", {"intensity": intensity})
    np.testing.assert_array_equal(load_apodizer(tmp_path / "a.npz", kind="intensity") ** 2, np.sqrt(intensity) ** 2)
    # A file that says what it holds is not taken for the other.
    refused("kind = amplitude: not accepted; allowed: intensity", load_apodizer, tmp_path / "a.npz")
    refused("kind = intensity.*shipped mask", load_apodizer, "lpx43", kind="intensity")
    refused("kind = energy", load_apodizer, tmp_path / "a.npz", kind="energy")


def test_binary_masks_are_maps(tmp_path):
    mask = np.add.outer(np.arange(8), np.arange(8)) % 3 > 0
    write_npz(tmp_path / "a.npz", {"mask": mask})
    fits.writeto(tmp_path / "a.fits", mask.astype(np.uint8))
    for name in ("a.npz", "a.fits"):
        np.testing.assert_array_equal(load_apodizer(tmp_path / name), mask.astype(float))


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (100.0, "divide by 100 if it is in per cent"),
        (255, "255 if it is a picture of 8 bits"),
        (65535, "65535 if it is a picture of 16 bits"),
        (1.7, "value of the open part"),
        (-1.0, "found -1 to 0"),
    ],
)
def test_other_scales_are_refused_with_a_hint(refused, tmp_path, scale, words):
    fits.writeto(tmp_path / "a.fits", np.linspace(0, 1, 64).reshape(8, 8) * scale)
    refused(words, load_apodizer, tmp_path / "a.fits")


def test_rounding_beyond_the_range_is_cut_off(tmp_path):
    mask = np.linspace(-1e-8, 1 + 1e-7, 64).reshape(8, 8)
    fits.writeto(tmp_path / "a.fits", mask)
    found = load_apodizer(tmp_path / "a.fits")
    assert (found.min(), found.max()) == (0.0, 1.0)


@pytest.mark.parametrize("shape", [(9, 9), (8, 10), (2, 8, 8), (6, 6), (2050, 2050)])
def test_odd_and_other_shapes_are_refused(refused, tmp_path, shape):
    fits.writeto(tmp_path / "a.fits", np.ones(shape, dtype=np.uint8))
    refused("apodizer", load_apodizer, tmp_path / "a.fits")


def test_averaging_onto_another_grid_keeps_the_core(refused, tmp_path):
    mask = np.random.default_rng(5).uniform(size=(45, 45))
    write_npz(tmp_path / "a.npz", {"transmission": mask})
    refused("found 45; average it", load_apodizer, tmp_path / "a.npz")
    for samples in (10, 64, 90):
        found = load_apodizer(tmp_path / "a.npz", samples=samples)
        assert found.shape == (samples, samples)
        assert found.mean() == pytest.approx(mask.mean(), rel=1e-13)
        # Against the common grid, by brute force.
        fine = np.kron(mask, np.ones((samples, samples))).reshape(samples, 45, samples, 45).mean(axis=(1, 3))
        np.testing.assert_allclose(found, fine, rtol=1e-12)
    np.testing.assert_array_equal(load_apodizer("lpx43", samples=64), load_apodizer("lpx43"))
    for bad in (7, 2050, 9):
        refused("samples", load_apodizer, tmp_path / "a.npz", samples=bad)


@pytest.mark.parametrize("samples", [8, 64, 130])
def test_coverage_is_the_area_of_the_disc(samples):
    covered = disc_coverage(samples)
    assert covered.mean() == pytest.approx(np.pi / 4, rel=1e-4)
    np.testing.assert_array_equal(covered, covered.T)
    np.testing.assert_array_equal(covered, covered[::-1])
    centre = np.abs(np.arange(samples) - (samples - 1) / 2)
    outer, inner = (np.hypot(centre[:, None] + part, centre + part) for part in (0.5, -0.5))
    assert (covered[outer <= samples / 2] == 1).all()
    assert (covered[inner >= samples / 2] == 0).all()


def test_light_beyond_the_rim_of_a_users_map_does_not_exist(tmp_path):
    """An open square map carries the energy of the clear disc, not 4 / pi of it."""
    write_npz(tmp_path / "open.npz", {"transmission": np.ones((64, 64))})
    instrument = load_instrument(
        {"coronagraph": {"apodizer": str(tmp_path / "open.npz")}, "dark_hole": {"control": "off"}}
    )
    assert bare_imager(instrument, "F662").apodizer_energy == pytest.approx(1.0, abs=0.02)
    for name in shipped_apodizers():
        mask = load_apodizer(name)
        np.testing.assert_array_equal(mask, mask * disc_coverage(len(mask)))
