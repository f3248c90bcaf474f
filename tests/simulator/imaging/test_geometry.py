"""Geometry of a band on a stamp: what no numerical setting changes, and what is known without measuring."""

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import measure
from simulator.imaging.external import load_psf, save_psf
from simulator.imaging.geometry import BandGeometry
from simulator.imaging.psf import single_band_psf
from simulator.imaging.store import psf_metrics
from simulator.knobs import FIDELITIES, Knobs

INSTRUMENT = load_instrument()


@pytest.mark.parametrize("band", ["F520", "F662", "F720", "F850"])
def test_it_is_that_of_the_metrics(band):
    stored, found = psf_metrics(INSTRUMENT, band), BandGeometry.of(INSTRUMENT, band, 137)
    assert found == stored.geometry
    np.testing.assert_array_equal(found.hole, stored.hole)
    assert found.zone.inner_corner_arcsec == stored.hole_inner_corner_arcsec
    assert found.zone.outer_corner_arcsec == stored.owa_arcsec
    right = BandGeometry.of(load_instrument("cpic_2q"), band, 137).hole
    assert right[:, 68:].any()
    assert not right[:, :69].any()


def test_other_settings_measure_nothing_for_it(monkeypatch):
    def refuse(*given):
        raise AssertionError("measured")

    monkeypatch.setattr(measure, "stamp_figures", refuse)
    standard = single_band_psf("F662").geometry
    for knobs in (FIDELITIES["quick"], FIDELITIES["reference"].model_copy(update={"pupil_samples": 64})):
        assert single_band_psf("F662", fidelity=knobs).geometry == standard
    larger = single_band_psf("F662", fidelity=Knobs(wavelength_nodes=1, stamp_pixels=161)).geometry
    assert larger.hole.shape == (161, 161)
    np.testing.assert_array_equal(larger.hole[12:-12, 12:-12], standard.hole)


def test_annuli_and_resolution_elements_are_those_of_a_count():
    geometry = BandGeometry.of(INSTRUMENT, "F520", 137)
    pixel, inner, outer = geometry.pixel_scale_arcsec, geometry.zone.inner_arcsec, geometry.zone.outer_arcsec
    expected = 0
    for y in (np.arange(137) - 68) * pixel:
        for x in (np.arange(137) - 68) * pixel:
            square = inner <= abs(x) <= outer and inner <= abs(y) <= outer
            expected += square and abs(np.hypot(x, y) - 0.55) <= 1.5 * geometry.lambda_d_arcsec
    assert np.count_nonzero(geometry.annulus(0.55, 1.5)) == expected
    angle = (np.arange(200_000) + 0.5) / 200_000 * 2 * np.pi
    x, y = np.abs(0.55 * np.cos(angle)), np.abs(0.55 * np.sin(angle))
    dark = (np.minimum(x, y) >= inner) & (np.maximum(x, y) <= outer)
    arcs = 2 * np.pi * 0.55 * dark.mean() / geometry.lambda_d_arcsec
    assert geometry.resolution_elements(0.55) == pytest.approx(arcs, rel=1e-4)
    assert geometry.aperture_pixels == pytest.approx(np.pi * (0.7 * geometry.lambda_d_arcsec / pixel) ** 2)


def test_a_psf_from_a_file_has_the_mask_of_its_file(refused, tmp_path):
    psf = load_psf(save_psf(single_band_psf("F662"), tmp_path / "a.npz"), instrument=INSTRUMENT)
    assert psf.geometry == single_band_psf("F662").geometry
    wide = BandGeometry.of(INSTRUMENT, "F662", 137, 0.3)
    assert (wide.mask_half_width_arcsec, wide.zone) == (0.3, psf.geometry.zone)
    refused("band", BandGeometry.of, INSTRUMENT, "F1", 137)
