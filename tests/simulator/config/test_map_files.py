"""Files made elsewhere: what is read whatever its form, what is refused and how."""

import gzip

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import write_npz
from simulator.config.map_files import pixel_scale
from simulator.imaging import header_number, read_maps, real_map

RAMP = np.arange(64.0).reshape(8, 8)


def written(path, *hdus, **options):
    fits.HDUList(list(hdus)).writeto(path, **options)
    return path


def one(path):
    file = read_maps("map", path)
    return real_map("map", path, file.maps[0].data)


@pytest.mark.parametrize("kind", [">f8", ">f4", "<f4", "f8", "i2", "i4", "u1", "u2"])
def test_any_number_type_and_byte_order(tmp_path, kind):
    data = RAMP.astype(kind)
    write_npz(tmp_path / "a.npz", {"a": data})
    for path in (written(tmp_path / "a.fits", fits.PrimaryHDU(data)), tmp_path / "a.npz"):
        found = one(path)
        assert found.dtype == np.float64
        assert found.dtype.isnative
        np.testing.assert_array_equal(found, RAMP)


def test_compressed_scaled_and_zipped_images(tmp_path):
    tiles = fits.CompImageHDU(RAMP.astype("i4"), compression_type="RICE_1", name="map")
    np.testing.assert_array_equal(one(written(tmp_path / "rice.fits", fits.PrimaryHDU(), tiles)), RAMP)
    scaled = fits.PrimaryHDU(RAMP.copy())  # it is scaled in place
    scaled.scale("int16", bscale=0.5, bzero=3)
    np.testing.assert_array_equal(one(written(tmp_path / "scaled.fits", scaled)), RAMP)
    path = written(tmp_path / "plain.fits", fits.PrimaryHDU(RAMP))
    (tmp_path / "a.fits.gz").write_bytes(gzip.compress(path.read_bytes()))
    np.testing.assert_array_equal(one(tmp_path / "a.fits.gz"), RAMP)


def test_content_decides_not_the_name(tmp_path):
    write_npz(tmp_path / "a.npz", {"a": RAMP})
    (tmp_path / "a.fits").write_bytes((tmp_path / "a.npz").read_bytes())
    assert not read_maps("map", tmp_path / "a.fits").is_fits
    np.testing.assert_array_equal(one(tmp_path / "a.fits"), RAMP)


def test_names_and_headers_of_all_images(tmp_path):
    primary = fits.PrimaryHDU()
    primary.header["BUNIT"] = "nm"
    primary.header["PIXSCALE"] = 0.1
    second = fits.ImageHDU(RAMP, name="two")
    second.header["PIXSCALE"] = 0.2
    table = fits.BinTableHDU.from_columns([fits.Column("a", "D", array=np.ones(3))])
    file = read_maps("map", written(tmp_path / "a.fits", primary, table, fits.ImageHDU(RAMP + 1, name="One"), second))
    assert [item.name for item in file.maps] == ["ONE", "TWO"]
    assert file.named("one").header["BUNIT"] == "nm"
    assert [item.header["PIXSCALE"] for item in file.maps] == [0.1, 0.2]
    assert file.named("three") is None


def damaged(tmp_path):
    """Files that hold no usable map, and the words that say so."""
    whole = written(tmp_path / "whole.fits", fits.PrimaryHDU(np.ones((80, 80))), checksum=True).read_bytes()
    for name, size in (("short", 2880 * 5), ("header", 2880), ("half", 1000)):
        (tmp_path / f"{name}.fits").write_bytes(whole[:size])
        yield tmp_path / f"{name}.fits", "whole FITS"
    flipped = bytearray(whole)
    flipped[4000] ^= 1
    (tmp_path / "flipped.fits").write_bytes(flipped)
    yield tmp_path / "flipped.fits", "checksums"
    liar = whole.replace(b"NAXIS1  =                   80", b"NAXIS1  =               800000")
    (tmp_path / "liar.fits").write_bytes(liar)
    yield tmp_path / "liar.fits", "whole FITS"
    yield written(tmp_path / "wide.fits", fits.PrimaryHDU(np.ones((1, 9000)))), "8192 pixels a side"
    yield written(tmp_path / "empty.fits", fits.PrimaryHDU()), "with an image"
    (tmp_path / "nothing.fits").write_bytes(b"")
    yield tmp_path / "nothing.fits", "whole FITS"
    (tmp_path / "text.npz").write_text("hello")
    yield tmp_path / "text.npz", "whole FITS"
    np.save(tmp_path / "bare.npy", RAMP)
    yield tmp_path / "bare.npy", "np.savez"
    np.savez(tmp_path / "evil.npz", a=np.array([{"a": 1}], dtype=object))
    yield tmp_path / "evil.npz", "plain arrays"
    (tmp_path / "cut.npz").write_bytes((tmp_path / "evil.npz").read_bytes()[:200])
    yield tmp_path / "cut.npz", "whole npz"
    np.savez(tmp_path / "none.npz")
    yield tmp_path / "none.npz", "npz"
    yield tmp_path, "existing"
    yield tmp_path / "absent.fits", "existing"


def test_damaged_files_are_refused_in_one_line(refused, tmp_path):
    cases = list(damaged(tmp_path))
    assert len(cases) == 15
    for path, words in cases:
        message = refused(words, read_maps, "map", path)
        assert message.startswith(f"map = {path}")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (np.ones((3, 8, 8)), "one plane of the cube"),
        (np.ones(8), r"shape \(8,\)"),
        (np.ones((8, 9)), "square"),
        (np.ones((8, 8), complex), "complex128"),
        (np.full((8, 8), "x"), "real numbers"),
        (np.where(RAMP == 5, np.nan, RAMP), "finite values.*1 are not"),
        (np.where(RAMP < 2, np.inf, RAMP), "2 are not"),
        (np.ones((4, 4)), "5 to 100 samples"),
        (np.ones((101, 101)), "5 to 100 samples"),
        (np.ones((0, 0)), "samples a side"),
    ],
)
def test_unusable_maps_are_refused(refused, data, words):
    refused(words, real_map, "map", "file", data, sides=(5, 100))
    assert real_map("map", "file", np.ones((8, 9)), square=False).shape == (8, 9)


def test_blank_pixels_of_integers_are_no_numbers(refused, tmp_path):
    image = fits.ImageHDU(RAMP.astype("i2"))
    image.header["BLANK"] = 5
    refused("1 are not", one, written(tmp_path / "a.fits", fits.PrimaryHDU(), image))


@pytest.mark.parametrize(
    ("header", "scale"),
    [
        ({}, None),
        ({"PIXSCALE": 0.02}, 0.02),
        ({"PIXELSCL": 0.02}, 0.02),
        ({"CDELT1": -0.02 / 3600, "CDELT2": 0.02 / 3600}, 0.02),
        ({"CDELT1": -20, "CUNIT1": "mas", "CDELT2": 0.02, "CUNIT2": "arcsec", "PIXSCALE": 0.02}, 0.02),
        (
            {
                "CD1_1": -0.012 / 3600,
                "CD1_2": 0.016 / 3600,
                "CD2_1": 0.016 / 3600,
                "CD2_2": 0.012 / 3600,
                "CDELT1": 1.0,
            },
            0.02,
        ),
    ],
)
def test_pixel_scales_of_headers(header, scale):
    assert pixel_scale("map", "file", header) == (None if scale is None else pytest.approx(scale, rel=1e-12))


def test_numbers_of_headers(refused):
    assert header_number("map", "file", {"A": 3}, "A") == 3.0
    assert header_number("map", "file", {}, "A") is None
    refused("map A = True", header_number, "map", "file", {"A": True}, "A")


def test_a_file_short_of_its_last_byte_is_refused(refused, tmp_path):
    from simulator.imaging import single_band_psf
    from simulator.imaging.external import load_psf, save_psf

    path = save_psf(single_band_psf("F662"), tmp_path / "psf.fits")
    path.write_bytes(path.read_bytes()[:-1])
    refused("whole FITS", load_psf, path)
