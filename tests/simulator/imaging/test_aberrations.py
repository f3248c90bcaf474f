import dataclasses
import itertools

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging.aberrations import draw_aberrations, flat_aberrations, power_law_map, pupil_disc
from simulator.imaging.apodizer import upsample
from simulator.imaging.build import bare_imager
from simulator.knobs import Knobs


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
