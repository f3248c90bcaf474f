"""Point-spread functions of other software, and ours written for it."""

import functools
import types

import numpy as np
import pytest
from astropy.io import fits
from scipy.special import erf

from cpic_core import InputError, read_npz, write_npz
from simulator.config import load_instrument
from simulator.imaging import ExternalPsf, overlap_weights, single_band_psf
from simulator.imaging.aperture import core_from_table
from simulator.imaging.external import load_psf, save_psf
from simulator.imaging.measure import stamp_figures
from simulator.imaging.sampling import displaced

INSTRUMENT = load_instrument({"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0}, "dark_hole": {"control": "off"}})
PIXEL = INSTRUMENT.pixel_scale_arcsec("F662")


@functools.cache
def model():
    return single_band_psf("F662", instrument=INSTRUMENT)


def gaussian(n=41, sigma=1.7, energy=0.3, y=0.0, x=0.0):
    edges = np.arange(n + 1) - n // 2 - 0.5
    rows, columns = (np.diff(erf((edges - at) / (sigma * np.sqrt(2)))) / 2 for at in (y, x))
    return energy * np.outer(rows, columns)


def stored(path, **change):
    arrays = {"off_axis": gaussian(), "pixel_scale_arcsec": PIXEL, "band": np.asarray("F662")} | change
    write_npz(path, {name: value for name, value in arrays.items() if value is not None})
    return path


@pytest.mark.parametrize("suffix", [".npz", ".fits"])
def test_our_own_round_trip(tmp_path, suffix):
    psf = model()
    path = save_psf(psf, tmp_path / f"a{suffix}")
    again = load_psf(path, instrument=INSTRUMENT)
    for name in ("on_axis", "off_axis"):
        np.testing.assert_array_equal(getattr(again, name), getattr(psf, name))
        assert getattr(again, name).dtype.isnative
        assert not getattr(again, name).flags.writeable
    assert (again.band, again.pixel_scale_arcsec, again.flags) == ("F662", psf.pixel_scale_arcsec, ())
    assert again.apodizer_energy == psf.imager.apodizer_energy
    twice = save_psf(again, tmp_path / f"b{suffix}")
    assert twice.read_bytes() == path.read_bytes()
    if suffix == ".fits":
        with fits.open(path, checksum=True) as hdus:
            hdus.verify("exception")
            assert [hdu.name for hdu in hdus] == ["PRIMARY", "OFF_AXIS", "ON_AXIS"]


def test_metrics_are_those_of_the_model(tmp_path):
    psf = model()
    metrics = load_psf(save_psf(psf, tmp_path / "a.npz"), instrument=INSTRUMENT).metrics
    figures = stamp_figures(psf.imager, psf.on_axis, psf.off_axis)
    x, y = np.random.default_rng(1).uniform(-1, 1, (2, 2000))
    width = INSTRUMENT.mask_half_width_arcsec("F662")
    theirs = core_from_table(figures["core_table"], figures["core_table_half_arcsec"], width, x, y)
    assert np.abs(metrics.core_throughput(x, y) - theirs).max() < 1e-3 * figures["core_open"]
    assert metrics.core_open == pytest.approx(figures["core_open"], rel=1e-3)
    assert metrics.iwa_arcsec == pytest.approx(figures["iwa_arcsec"], abs=1e-5)
    assert metrics.peak_off_axis == figures["peak_off_axis"]
    np.testing.assert_array_equal(metrics.raw_contrast, figures["raw_contrast"])
    np.testing.assert_array_equal(metrics.halo_map, figures["halo_map"])
    np.testing.assert_array_equal(metrics.column_light, psf.on_axis.sum(axis=0))
    assert metrics.strehl is None
    offset = np.abs(np.arange(137) - 68) * PIXEL
    inside = (offset >= INSTRUMENT.hole_inner_arcsec("F662")) & (offset <= INSTRUMENT.hole_outer_arcsec("F662"))
    np.testing.assert_array_equal(metrics.hole, np.outer(inside, inside))
    assert metrics.owa_arcsec == pytest.approx(INSTRUMENT.hole_outer_arcsec("F662") * np.sqrt(2))


@pytest.mark.parametrize("position", [(0.3127, 0.4031), (-0.25, 0.517), (0.5, -0.5), (-0.008, 0.003)])
def test_at_is_the_models_where_the_kernel_reaches(tmp_path, position):
    psf = model()
    found = load_psf(save_psf(psf, tmp_path / "a.npz"), instrument=INSTRUMENT).at(*position)
    error = np.abs(found - psf.at(*position)) / psf.off_axis.max()
    offset = np.arange(137) - 68
    near = [np.abs(offset - at / PIXEL) < 66 for at in position]
    whole = np.abs(np.abs(offset) - INSTRUMENT.mask_half_width_arcsec("F662") / PIXEL) > 0.6
    assert error[np.ix_(near[1] & whole, near[0] & whole)].max() < 1e-5
    assert error[np.ix_(near[1], near[0])].max() < 1e-2  # a pixel that the edge cuts gets light by its open area
    far = np.outer(near[1], near[0]) | ~np.outer(whole, whole)
    assert error[~far].max(initial=0.0) < 1e-3  # beyond the kernel's stamp its wings are missing
    assert found.min() >= 0


def test_core_of_a_gaussian_is_the_mean_of_aperture_sums(tmp_path):
    metrics = load_psf(stored(tmp_path / "a.npz"), instrument=INSTRUMENT).metrics
    radius = INSTRUMENT.aperture_radius_arcsec("F662") / PIXEL
    # Brute force: photometry in an aperture on every phase within a pixel.
    phases = (np.arange(8) + 0.5) / 8 - 0.5
    half = len(overlap_weights(radius)) // 2
    sums = [
        (overlap_weights(radius, dy, dx) * gaussian(2 * half + 1, y=dy, x=dx)).sum() for dy in phases for dx in phases
    ]
    assert metrics.core_open == pytest.approx(np.mean(sums), rel=2e-4)
    # Half the light where the bars of the cross leave half of it, far along one arm.
    width = INSTRUMENT.mask_half_width_arcsec("F662")
    assert float(metrics.core_throughput(1.0, width)) == pytest.approx(metrics.core_open / 2, rel=1e-6)
    assert float(metrics.core_throughput(1.0, 0.0)) < 0.01 * metrics.core_open


def test_fits_of_others(tmp_path):
    image = fits.PrimaryHDU(gaussian(sigma=4).astype(">f4"))
    image.header["CDELT1"], image.header["CDELT2"], image.header["FILTER"] = -PIXEL / 3600, PIXEL / 3600, "F662"
    image.writeto(tmp_path / "a.fits")
    psf = load_psf(tmp_path / "a.fits")
    assert isinstance(psf, ExternalPsf)
    assert psf.band == "F662"
    assert set(psf.flags) == {"on_axis_derived", "apodizer_energy_of_stamp"}
    assert psf.apodizer_energy == pytest.approx(0.3, rel=1e-6)
    np.testing.assert_array_equal(psf.on_axis, psf.at(0.0, 0.0))
    assert psf.on_axis[5, 5] == psf.off_axis[5, 5] > 0
    assert not psf.on_axis[20].any()
    primary = fits.PrimaryHDU()
    primary.header["PIXELSCL"] = PIXEL
    pair = [fits.ImageHDU(gaussian() * 1e-3, name="on_axis"), fits.CompImageHDU(gaussian(), name="Off_Axis")]
    fits.HDUList([primary, *pair]).writeto(tmp_path / "b.fits")
    again = load_psf(tmp_path / "b.fits", band="F720")
    assert again.band == "F720"
    np.testing.assert_array_equal(again.on_axis, gaussian() * 1e-3)


def test_a_band_is_needed_for_metrics_only(refused, tmp_path):
    psf = load_psf(stored(tmp_path / "a.npz", band=None))
    assert psf.band == ""
    assert psf.at(0.25, 0.25).sum() > 0.2
    with pytest.raises(InputError, match="band = missing.*F662"):
        _ = psf.metrics
    assert load_psf(tmp_path / "a.npz", band="F662").metrics.core_open > 0.2
    refused("band = F720.*F662, as the file says", load_psf, stored(tmp_path / "b.npz"), band="F720")
    refused("band = F999", load_psf, stored(tmp_path / "b.npz", band=np.asarray("F999")))


def test_the_near_infrared_has_pixels_of_its_own(refused, tmp_path):
    band = next(name for name, item in INSTRUMENT.bands.items() if item.camera == "NIR")
    pixel = INSTRUMENT.pixel_scale_arcsec(band)
    path = stored(tmp_path / "a.npz", band=np.asarray(band), pixel_scale_arcsec=pixel)
    assert load_psf(path, instrument=INSTRUMENT).pixel_scale_arcsec == pixel
    refused("detector's pixel", load_psf, stored(tmp_path / "b.npz", pixel_scale_arcsec=pixel))


def test_scaling_to_a_stated_energy_is_flagged(refused, tmp_path):
    peaked = gaussian() / gaussian().max()
    path = stored(tmp_path / "a.npz", off_axis=peaked, on_axis=0.01 * peaked)
    refused("sums to .*normalised to its peak, give energy", load_psf, path)
    psf = load_psf(path, energy=0.25)
    assert psf.off_axis.sum() == pytest.approx(0.25, rel=1e-14)
    assert psf.on_axis.sum() == pytest.approx(0.0025, rel=1e-14)
    assert "energy_scaled" in psf.flags
    for energy in (0.0, 1.1, -1.0, float("nan")):
        refused("energy = ", load_psf, path, energy=energy)


def test_what_was_assumed_is_flagged(tmp_path):
    assert "sums_to_one" in load_psf(stored(tmp_path / "a.npz", off_axis=gaussian() / gaussian().sum())).flags
    tiny = gaussian()
    tiny[0, 0] = -1e-18
    psf = load_psf(stored(tmp_path / "b.npz", off_axis=tiny))
    assert "negative_rounding" in psf.flags
    assert psf.off_axis.min() == 0
    wide = load_psf(stored(tmp_path / "c.npz", mask_half_width_arcsec=0.2))
    assert "mask_of_file" in wide.flags
    assert wide.metrics.iwa_arcsec == pytest.approx(0.2 * np.sqrt(2), abs=0.03)
    assert (
        "core_beyond_stamp" in load_psf(stored(tmp_path / "d.npz", off_axis=gaussian(9), band=np.asarray("F850"))).flags
    )
    told = load_psf(stored(tmp_path / "e.npz", apodizer_energy=0.33))
    assert told.metrics.apodizer_energy == 0.33


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"off_axis": None, "on_axis": gaussian()}, "array named off_axis"),
        ({"off_axis": gaussian(40)}, "odd number.*found 40"),
        ({"off_axis": gaussian(7)}, "9 to 2201"),
        ({"off_axis": gaussian()[:-2]}, "square"),
        ({"off_axis": np.ones((3, 9, 9)) * 1e-3}, "cube"),
        ({"off_axis": gaussian() * 1j}, "complex"),
        ({"off_axis": gaussian() * np.nan}, "finite"),
        ({"off_axis": gaussian() - 1e-6}, "no negative values"),
        ({"off_axis": np.zeros((9, 9))}, "light in it"),
        ({"off_axis": gaussian(x=2.0)}, r"peak on the centre pixel \[20, 20\].*\[20, 22\]"),
        ({"off_axis": 4 * gaussian()}, "sums to 1.2"),
        ({"on_axis": gaussian(43)}, r"shape of off_axis"),
        ({"on_axis": gaussian() * 4}, "psf on_axis"),
        ({"pixel_scale_arcsec": None}, "pixel_scale_arcsec = missing arcsec.*0.0161"),
        ({"pixel_scale_arcsec": 0.02}, "pixel_scale_arcsec = 0.02 arcsec.*0.0161.*bin or resample"),
        ({"pixel_scale_arcsec": 1.002 * PIXEL}, "to 1e-3"),
        ({"pixel_scale_arcsec": -PIXEL}, "to 1e-3"),
        ({"pixel_scale_arcsec": np.array([PIXEL, PIXEL])}, "one finite number"),
        ({"pixel_scale_arcsec": np.nan}, "one finite number"),
        ({"mask_half_width_arcsec": -0.1}, "mask_half_width_arcsec = -0.1 arcsec.*0 to 4"),
        ({"apodizer_energy": 0.1}, "apodizer_energy = 0.1.*to 1"),
        ({"band": np.asarray(3)}, "psf band"),
    ],
)
def test_bad_kernels_are_refused_by_name(refused, tmp_path, change, words):
    refused(words, load_psf, stored(tmp_path / "a.npz", **change))


def test_unusable_fits_files_are_refused(refused, tmp_path):
    two = [fits.PrimaryHDU(), fits.ImageHDU(gaussian()), fits.ImageHDU(gaussian())]
    fits.HDUList(two).writeto(tmp_path / "two.fits")
    refused("image OFF_AXIS, or a single image", load_psf, tmp_path / "two.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(gaussian(), name="ON_AXIS")]).writeto(tmp_path / "on.fits")
    refused("image OFF_AXIS", load_psf, tmp_path / "on.fits")
    fits.writeto(tmp_path / "bare.fits", gaussian())
    refused("pixel_scale_arcsec = missing", load_psf, tmp_path / "bare.fits")
    save_psf(model(), tmp_path / "whole.fits")
    data = bytearray((tmp_path / "whole.fits").read_bytes())
    data[9000] ^= 1
    (tmp_path / "bad.fits").write_bytes(data)
    refused("checksums", load_psf, tmp_path / "bad.fits")


def test_pickles_are_not_opened(refused, tmp_path):
    np.savez(tmp_path / "evil.npz", off_axis=np.array([{"a": 1}], dtype=object), pixel_scale_arcsec=PIXEL)
    refused("plain arrays", load_psf, tmp_path / "evil.npz")


def test_positions_are_finite_and_far_sources_leave_nothing(refused, tmp_path):
    psf = load_psf(stored(tmp_path / "a.npz"))
    for bad in ((float("nan"), 0.0), (0.0, float("inf"))):
        refused("x_arcsec, y_arcsec", psf.at, *bad)
    assert not psf.at(8.0, 0.5).any()
    np.testing.assert_array_equal(psf.at(0.0, 20 * PIXEL)[30:], (displaced(psf.off_axis, 20, 0) * psf._open)[30:])


def test_saving_is_whole_or_not_at_all(refused, tmp_path):
    good = types.SimpleNamespace(band="F662", on_axis=gaussian(), off_axis=gaussian(), pixel_scale_arcsec=PIXEL)
    save_psf(good, tmp_path / "a.npz")
    assert set(read_npz(tmp_path / "a.npz")) == {"band", "on_axis", "off_axis", "pixel_scale_arcsec"}
    refused("ends in .npz or .fits", save_psf, good, tmp_path / "a.txt")
    bad = types.SimpleNamespace(**vars(good) | {"off_axis": gaussian() * np.nan})
    for name in ("a.npz", "b.fits"):
        refused("finite", save_psf, bad, tmp_path / name)
    refused("no_such_folder.*a writable file", save_psf, good, tmp_path / "no_such_folder" / "a.fits")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]
    np.testing.assert_array_equal(load_psf(tmp_path / "a.npz").off_axis, gaussian())
