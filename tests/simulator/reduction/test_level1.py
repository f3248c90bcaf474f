"""Level-1 files: what is written is read again, by astropy too, and what is none is refused in one line."""

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError
from simulator.camera import MaskBit
from simulator.reduction import error_file, level1_name, read_level1, write_level1

SHAPE = (6, 9)


@pytest.fixture
def written(tmp_path):
    """Return a file of three frames, and what is in it."""
    rng = np.random.default_rng(1)
    images = [rng.normal(5.0, 2.0, SHAPE) for _ in range(3)]
    mask = np.zeros(SHAPE, dtype=np.uint8)
    mask[1, 2] = MaskBit.COSMIC_RAY
    error = rng.uniform(1.0, 2.0, SHAPE)
    path = tmp_path / "SCI" / "1" / level1_name(tmp_path / "CSST_CPIC_VIS_SCI_X_L0_V01.fits")
    frames = [(image, mask, {"FRAMEID": number + 1}) for number, image in enumerate(images)]
    primary = {"OBSTYPE": "SCI", "EXPTIME": 17.0, "ROLE": "science", "B_NAM": "bias.fits", "NEXTEND": 3}
    write_level1(path, primary, {"CRPIX1": 4.5, "NSAT": 3}, frames, lambda: (error, 0.1 * error), n_frames=3)
    return path, images, mask, error


def test_frames_are_read_as_they_were_written(written):
    path, images, mask, error = written
    found = read_level1(path)
    assert (found.n_frames, found.shape) == (3, SHAPE)
    assert {key: found.header[key] for key in ("OBSTYPE", "EXPTIME", "ROLE", "CRPIX1", "NFRAME")} == {
        "OBSTYPE": "SCI", "EXPTIME": 17.0, "ROLE": "science", "CRPIX1": 4.5, "NFRAME": 3,
    }  # fmt: skip
    frames = list(found.iter_frames())
    assert [frame.header["FRAMEID"] for frame in frames] == [1, 2, 3]
    for frame, image in zip(frames, images, strict=True):
        np.testing.assert_allclose(frame.image_e, image, rtol=1e-6)
        np.testing.assert_allclose(frame.error_e, error, rtol=1e-6)
        np.testing.assert_array_equal(frame.mask, mask)
    np.testing.assert_allclose(found.master_error_e, 0.1 * error, rtol=1e-6)


def test_a_file_is_pairs_for_every_reader(written):
    path, images, mask, _ = written
    with fits.open(path, checksum=True) as units:
        assert units[0].data is None
        assert "NSAT" not in units[1].header
        assert units[0].header["NEXTEND"] == len(units) - 1 == 6
        for image, reduced, bits in zip(images, units[1::2], units[2::2], strict=True):
            np.testing.assert_allclose(reduced.data, image, rtol=1e-6)
            np.testing.assert_array_equal(bits.data, mask)


def test_names_follow_level_0(tmp_path):
    assert level1_name(tmp_path / "CSST_CPIC_VIS_SCI_1_2_3_X_L0_V01.fits") == "CSST_CPIC_VIS_SCI_1_2_3_X_L1_V01.fits"
    assert level1_name(tmp_path / "night7.fits.gz") == "night7_L1.fits"


@pytest.mark.parametrize("damage", ["no errors", "no pairs", "no FITS", "no file"])
def test_what_is_no_level_1_is_refused_in_one_line(written, damage, tmp_path):
    path = written[0]
    if damage == "no errors":
        error_file(path).unlink()
    elif damage == "no pairs":
        fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(np.zeros(SHAPE), name="REDUCED")]).writeto(path, overwrite=True)
    elif damage == "no FITS":
        path.write_text("nothing")
    else:
        path = tmp_path / "absent.fits"
    with pytest.raises(InputError) as refused:
        read_level1(path)
    assert "\n" not in str(refused.value)
    assert "fits" in str(refused.value)
