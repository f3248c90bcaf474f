import dataclasses

import mpmath
import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import build_imager, imager as imager_module
from simulator.imaging.drift import screen_model
from simulator.imaging.pupil_symmetry import (
    add_intensity,
    field_of,
    half_waves,
    parts_of,
    quadrants_of,
    unfolded,
    unit_phases,
)
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()
RNG = np.random.default_rng(20)


def direct_waves(frequencies, samples, scale):
    """The transform as it is written: complex, one column a sample."""
    position = np.arange(samples) - (samples - 1) / 2
    return scale * np.sinc(frequencies)[:, None] * np.exp(-2j * np.pi * np.outer(frequencies, position))


def frequencies(kind, count):
    values = np.sort(RNG.uniform(-0.4, 0.4, count))
    if kind == "mirrored":
        values = 0.5 * (values - values[::-1])
    return values


@pytest.mark.parametrize("samples", [8, 9, 64])
@pytest.mark.parametrize("counts", [(1, 7), (6, 7), (7, 6), (300, 5), (0, 4), (1, 1)])
@pytest.mark.parametrize("kinds", [("mirrored", "mirrored"), ("mirrored", "any"), ("any", "mirrored"), ("any", "any")])
def test_parity_is_the_complex_product(samples, counts, kinds):
    y, x = (frequencies(kind, count) for kind, count in zip(kinds, counts, strict=True))
    pupil = RNG.standard_normal((samples, samples)) + 1j * RNG.standard_normal((samples, samples))
    rows, columns = (half_waves(axis, samples, 0.3) for axis in (y, x))
    assert rows.mirrored is (kinds[0] == "mirrored" and counts[0] > 1)
    parts = parts_of(quadrants_of(pupil.real), quadrants_of(pupil.imag))
    expected = direct_waves(y, samples, 0.3) @ pupil @ direct_waves(x, samples, 0.3).T
    field = field_of(parts, rows, columns)
    assert field.shape == expected.shape
    scale = 0.3**2 * np.abs(pupil).sum()  # of a node on the axis of coherent samples
    assert np.abs(field - expected).max(initial=0.0) < 1e-14 * scale
    total = np.zeros((1 + rows.mirrored, 1 + columns.mirrored, len(rows.cosine), len(columns.cosine)))
    for _ in range(2):
        add_intensity(total, parts, rows, columns, None)
    light = unfolded(total, (rows.n_nodes, columns.n_nodes), (rows.sides, columns.sides))
    assert np.abs(light - 2 * np.abs(expected) ** 2).max(initial=0.0) < 1e-14 * scale**2


def test_nodes_that_are_symmetric_but_for_one_are_not_mirrored():
    axis = np.linspace(-0.4, 0.4, 12)
    assert half_waves(axis, 16, 1.0).mirrored
    axis[0] -= 1e-9
    waves = half_waves(axis, 16, 1.0)
    assert not waves.mirrored
    assert waves.cosine.shape == (12, 8)
    assert half_waves(axis, 16, 1.0, np.float32).sine.dtype == np.float32


@pytest.mark.parametrize("largest", [0.0, 1e-9, 1e-3, 0.05, 0.25, 0.2501, 3.0, 700.0])
def test_unit_phases_are_exact_to_rounding(largest):
    phase = np.concatenate([[0.0, largest, -largest], RNG.uniform(-largest, largest, 200)])
    cosine, sine = unit_phases(phase, largest)
    with mpmath.workdps(40):
        exact = [(float(mpmath.cos(float(one))), float(mpmath.sin(float(one)))) for one in phase]
    np.testing.assert_allclose(cosine, [pair[0] for pair in exact], rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(sine, [pair[1] for pair in exact], rtol=4.5e-16, atol=0)


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_images_agree_with_the_direct_product_to_1e_14_of_the_peak(band):
    imager = build_imager(INSTRUMENT, band)
    screen = screen_model(128, 2.5).draw(RNG, 1.0)
    nodes = imager.stamp_axis(masked=True).nodes_arcsec
    axes = [(nodes, nodes), (nodes - 0.35, nodes + 0.2), (nodes[len(nodes) // 2 :], nodes), (nodes, nodes[:9])]

    def direct(y, x, opd_nm):
        total = np.zeros((y.size, x.size))
        for index, (wavelength, weight) in enumerate(zip(imager.wavelengths_m, imager.weights, strict=True)):
            product = imager.transform(y, wavelength) @ imager.pupil(index, opd_nm) @ imager.transform(x, wavelength).T
            total += weight * np.abs(product) ** 2
        return total * imager.pixel_solid_angle_sr

    peak = direct(np.zeros(1), np.zeros(1), None)[0, 0]
    for opd_nm in (None, 0.05 * screen, 50.0 * screen):  # no screen, the series of small phases, large ones
        for y, x in axes:
            assert np.abs(imager.intensity(y, x, opd_nm=opd_nm) - direct(y, x, opd_nm)).max() < 1e-14 * peak


def test_large_pupils_are_not_kept(monkeypatch):
    imager = build_imager(INSTRUMENT, "F662", Knobs(wavelength_nodes=2, stamp_pixels=33))
    axis = imager.stamp_axis(masked=True)
    kept = imager.image(axis, axis)
    assert "_kept_quadrants" in vars(imager)
    monkeypatch.setattr(imager_module, "KEPT_SAMPLES", 1)
    monkeypatch.setattr(imager_module, "KEPT_WAVES", 1)
    fresh = dataclasses.replace(imager)
    np.testing.assert_array_equal(fresh.image(axis, axis), kept)
    assert "_kept_quadrants" not in vars(fresh)
    assert fresh.focal_grid(axis, axis).rows[0] is not fresh.focal_grid(axis, axis).rows[0]


def test_transforms_of_the_same_nodes_are_kept():
    imager = build_imager(INSTRUMENT, "F662", Knobs(wavelength_nodes=1, stamp_pixels=33))
    axis = imager.stamp_axis(masked=True)
    first, second = imager.focal_grid(axis, axis), imager.focal_grid(axis, axis)
    assert first.rows is second.rows is first.columns
    assert imager.focal_grid(axis, axis, source_arcsec=(0.1, 0.0)).columns is not first.columns
    assert dataclasses.replace(imager).focal_grid(axis, axis).rows is not first.rows


def test_content_key_tells_models_apart():
    imager = build_imager(INSTRUMENT, "F662")
    assert imager.content_key == build_imager(INSTRUMENT, "F662").content_key
    assert imager.static is not None
    other = [
        dataclasses.replace(imager, jitter_arcsec=0.006),
        dataclasses.replace(imager, static=None),
        dataclasses.replace(imager, static=imager.static.plus_opd(1e-9 * np.ones((128, 128)))),
        dataclasses.replace(imager, transmission=0.5 * imager.transmission),
        dataclasses.replace(imager, knobs=Knobs(precision="single")),
        build_imager(INSTRUMENT, "F720"),
    ]
    assert len({imager.content_key, *(one.content_key for one in other)}) == 1 + len(other)
