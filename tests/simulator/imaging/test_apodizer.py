import numpy as np
import pytest
from astropy.io import fits

from catalogs.errors import InputError
from simulator.arrays import read_npz, write_npz
from simulator.imaging.apodizer import load_apodizer, shipped_apodizers, upsample


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
    [np.full((8, 8), 1.1), np.full((8, 8), np.nan), np.zeros((8, 8)), np.ones((8, 9)), np.ones((9, 9)),
     np.ones((8, 8), dtype=complex)],
)  # fmt: skip
def test_bad_maps_are_refused(tmp_path, mask):
    write_npz(tmp_path / "a.npz", {"transmission": mask})
    with pytest.raises(InputError, match="apodizer"):
        load_apodizer(tmp_path / "a.npz")


def test_pickles_and_missing_files_are_refused(tmp_path):
    np.savez(tmp_path / "evil.npz", transmission=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="plain arrays"):
        load_apodizer(tmp_path / "evil.npz")
    with pytest.raises(InputError, match="lpx43"):
        load_apodizer("no_such_mask")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(InputError):
        load_apodizer(tmp_path / "text.npz")


def test_upsampling_repeats_steps():
    mask = load_apodizer("lpx43")
    fine = upsample(mask, 256)
    np.testing.assert_array_equal(fine[::4, 3::4], mask)
    with pytest.raises(InputError, match="pupil_samples"):
        upsample(mask, 100)


def test_written_bytes_depend_on_content_only(tmp_path):
    arrays = {"b": np.arange(3), "a": np.array("key")}
    write_npz(tmp_path / "1.npz", arrays)
    write_npz(tmp_path / "2.npz", dict(reversed(arrays.items())))
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "2.npz").read_bytes()
    assert str(read_npz(tmp_path / "1.npz")["a"]) == "key"
