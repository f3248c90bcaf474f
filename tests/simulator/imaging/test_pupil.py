""""""

import dataclasses
import itertools

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import read_npz, write_npz
from simulator.config import load_instrument
from simulator.imaging.build import bare_imager
from simulator.imaging.pupil import (
    disc_coverage,
    draw_aberrations,
    flat_aberrations,
    load_apodizer,
    power_law_map,
    pupil_disc,
    shipped_apodizers,
    upsample,
)
from simulator.knobs import Knobs


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


def test_rms_is_exact_and_piston_tip_tilt_are_gone():
    maps = draw_aberrations(3, samples=128, opd_rms_nm=20.0, amplitude_rms=0.003)
    odd = 2 * np.arange(128) - 127
    inside = odd**2 + odd[:, None] ** 2 <= 128**2
    np.testing.assert_array_equal(pupil_disc(128), inside)
    position = np.arange(128) / 128
    y, x = np.meshgrid(position, position, indexing="ij")
    planes = np.stack([np.ones(inside.sum()), y[inside], x[inside]], axis=1)
    fitted = np.linalg.lstsq(planes, maps.opd_nm[inside], rcond=None)[0]
    assert np.abs(fitted).max() < 1e-10
    assert np.sqrt((maps.opd_nm[inside] ** 2).mean()) == pytest.approx(20.0, rel=1e-12)
    assert maps.amplitude[inside].mean() == pytest.approx(1.0, rel=1e-13)
    assert maps.amplitude[inside].std() == pytest.approx(0.003, rel=1e-12)


@pytest.mark.parametrize("slope", [1.5, 2.5, 3.5])
def test_power_spectrum_has_the_slope(slope):
    n = 128
    taper = np.hanning(n)
    frequency = np.fft.fftfreq(n, 1 / n)
    radius = np.hypot(frequency[:, None], frequency)
    power = np.zeros((n, n))
    for seed in range(20):
        screen = power_law_map(n, slope, np.random.default_rng(seed), remove_tilt=False)
        power += np.abs(np.fft.fft2(screen * np.outer(taper, taper))) ** 2
    edges = np.geomspace(5, 40, 9)
    rings = [(radius >= low) & (radius < high) for low, high in itertools.pairwise(edges)]
    mean_power = [power[ring].mean() for ring in rings]
    mean_radius = [np.exp(np.log(radius[ring]).mean()) for ring in rings]
    fitted = np.polyfit(np.log(mean_radius), np.log(mean_power), 1)[0]
    assert fitted == pytest.approx(-slope, abs=0.06)


def test_opposite_edges_are_independent():
    screens = [power_law_map(64, 2.5, np.random.default_rng(seed), remove_tilt=False) for seed in range(40)]
    across = np.mean([(screen[:, 0] - screen[:, -1]) ** 2 for screen in screens])
    beside = np.mean([(screen[:, 0] - screen[:, 1]) ** 2 for screen in screens])
    # The structure function grows as the square root of the distance, by 8 over 64 samples; a map that is periodic
    # over the pupil has across = beside.
    assert across > 4 * beside


def test_a_seed_names_an_instrument():
    one, again, other = draw_aberrations(1), draw_aberrations(1), draw_aberrations(2)
    assert one.opd_nm.tobytes() == again.opd_nm.tobytes()
    assert one.amplitude.tobytes() == again.amplitude.tobytes()
    assert not np.array_equal(one.opd_nm, other.opd_nm)
    # Another size of one map leaves the other map alone, and the two are uncorrelated.
    twice = draw_aberrations(1, opd_rms_nm=40.0, amplitude_rms=0.0)
    np.testing.assert_allclose(twice.opd_nm, 2 * one.opd_nm, rtol=1e-14)
    np.testing.assert_array_equal(twice.amplitude, np.ones((128, 128)))
    correlations = []
    for seed in range(30):
        maps = draw_aberrations(seed, samples=32)
        correlations.append(np.corrcoef(maps.opd_nm.ravel(), maps.amplitude.ravel())[0, 1])
    assert abs(np.mean(correlations)) < 4 * np.std(correlations) / np.sqrt(30)
    with pytest.raises(ValueError, match="read-only"):
        one.opd_nm[0, 0] = 1.0


def test_a_finer_grid_sees_the_same_optics():
    instrument = load_instrument()
    coarse, fine = (bare_imager(instrument, "F662", Knobs(pupil_samples=n)) for n in (64, 192))
    maps = draw_aberrations(5, samples=64).plus_opd(np.linspace(0, 30, 64) * np.ones((64, 1)))
    np.testing.assert_array_equal(maps.upsampled(192).opd_nm, upsample(maps.opd_nm, 192))
    angles = np.array([-0.7, 0.0, 0.21, 5.3])
    wavelength = float(coarse.wavelengths_m[1])
    fields = [
        imager.transform(angles, wavelength)
        @ maps.upsampled(len(imager.transmission)).pupil(imager.transmission, wavelength)
        @ imager.transform(angles, wavelength).T
        for imager in (coarse, fine)
    ]
    assert np.abs(fields[0] - fields[1]).max() < 1e-13 * np.abs(fields[0]).max()


def test_pupil_field_is_amplitude_and_phase():
    maps = draw_aberrations(1, samples=64)
    field = maps.pupil(np.full((64, 64), 0.5), 600e-9, opd_nm=np.full((64, 64), 150.0))
    np.testing.assert_allclose(np.abs(field), 0.5 * maps.amplitude, rtol=1e-14)
    np.testing.assert_allclose(field, 0.5 * maps.amplitude * 1j * np.exp(2j * np.pi * maps.opd_nm / 600.0), rtol=1e-11)
    flat = flat_aberrations(64).pupil(np.ones((64, 64)), 600e-9)
    np.testing.assert_array_equal(flat, np.ones((64, 64)))


def test_only_a_multiple_is_finer(refused):
    refused("a multiple of 64", flat_aberrations(64).upsampled, 96)


def test_pointed_maps_put_the_star_on_the_centre_and_change_nothing_else():
    imager = bare_imager(load_instrument({"wavefront": {"jitter_mas": 0}}), "F662")
    maps = draw_aberrations(4, samples=128)
    pointed = maps.pointed(imager.transmission)
    moved = pointed.opd_nm - maps.opd_nm
    np.testing.assert_allclose(np.diff(moved, n=2, axis=0), 0.0, atol=1e-9)  # a plane
    np.testing.assert_allclose(np.diff(moved, n=2, axis=1), 0.0, atol=1e-9)
    assert pointed.amplitude is not maps.amplitude
    np.testing.assert_array_equal(pointed.amplitude, maps.amplitude)
    again = pointed.pointed(imager.transmission)
    np.testing.assert_allclose(again.opd_nm, pointed.opd_nm, atol=1e-9)
    # A pure tilt is wholly removed; the peak of a random map then stands within half a milliarcsecond of the centre.
    fine = np.linspace(-0.004, 0.004, 81)
    light = dataclasses.replace(imager, static=pointed).intensity(fine, fine)
    row, column = np.unravel_index(light.argmax(), light.shape)
    assert np.hypot(fine[row], fine[column]) < 5e-4
