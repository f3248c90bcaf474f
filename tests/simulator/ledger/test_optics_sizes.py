"""Remainders of the quadratures against the quadratures themselves."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from simulator.imaging import aperture_sums, overlap_weights, psf_metrics, single_band_psf
from simulator.knobs import Knobs
from simulator.ledger.visit import Optics, gauss_remainder, precision_error_e_s


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7])
@pytest.mark.parametrize("phase", [0.05, 0.5, 1.5, 3.0])
def test_remainder_bounds_the_error_of_a_wave(n, phase):
    nodes, weights = np.polynomial.legendre.leggauss(n)
    # Odd waves are integrated exactly: the cosine is the worst of all.
    error = abs(0.5 * weights @ np.cos(phase * nodes) - np.sinc(phase / np.pi))
    bound = float(gauss_remainder(n, phase))
    assert error <= bound * (1 + 1e-9) + 1e-15
    if 1e-12 < bound < 1e-2:  # the first term of its series
        assert error > 0.7 * bound


def optics(band, instrument):
    figures = psf_metrics(instrument, band)
    config = instrument.band(band)
    jitter = instrument.wavefront.jitter_mas * 1e-3
    return figures, Optics(
        config.width_nm / config.center_nm, figures.lambda_d_arcsec, figures.pixel_scale_arcsec, jitter
    )


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_sizes_of_settings_bound_the_images(band, calm):
    figures, model = optics(band, calm)
    best = single_band_psf(band, fidelity=Knobs(wavelength_nodes=7, pixel_nodes=5), instrument=calm)
    weights = overlap_weights(figures.aperture_radius_arcsec / figures.pixel_scale_arcsec)
    offset = (np.arange(137) - 68) * figures.pixel_scale_arcsec
    radius = np.hypot(offset[:, None], offset)
    near = (np.abs(offset) > 0.12) & (np.abs(offset) < 0.78)
    near = near & near[:, None]
    bright = best.on_axis > 0.1 * best.on_axis.max()
    inside = figures.zone.covers(offset, offset, -figures.aperture_radius_arcsec)
    halo = aperture_sums(best.on_axis, weights)
    around = aperture_sums(np.maximum(best.on_axis, uniform_filter(best.on_axis, 5)), weights)
    for knobs in (
        Knobs(wavelength_nodes=1, pixel_nodes=5),
        Knobs(wavelength_nodes=3, pixel_nodes=5),
        Knobs(wavelength_nodes=7, pixel_nodes=1),
        Knobs(wavelength_nodes=7, pixel_nodes=3),
    ):
        seen = single_band_psf(band, fidelity=knobs, instrument=calm)
        relative = np.abs(seen.on_axis / np.where(bright, best.on_axis, 1.0) - 1.0)
        sums = np.abs(aperture_sums(seen.on_axis, weights) - halo) / np.where(around > 0, around, 1.0)
        if knobs.pixel_nodes == 5:
            said = model.wavelength_error(knobs.wavelength_nodes, radius)
            places = zip(radius.flat, inside.flat, strict=True)
            waves = [model.wavelength_halo_error(knobs.wavelength_nodes, *place) for place in places]
            at_halo = np.reshape(waves, radius.shape)
        else:
            said = np.full(radius.shape, model.pixel_error(knobs.pixel_nodes))
            at_halo = np.where(inside, *(model.pixel_halo_error(knobs.pixel_nodes, part) for part in (True, False)))
        assert (relative[bright] <= 1.3 * said[bright]).all()
        assert relative[bright].max() > 0.02 * said[bright].max()
        for part in (inside, near & ~inside):
            assert np.percentile((sums / at_halo)[part], 99) < 1.0
            assert (sums / at_halo)[part].max() > 0.02


@pytest.mark.parametrize("band", ["F520", "F662", "F720", "F850"])
def test_one_wavelength_is_enough_for_a_planet(band, calm):
    _, model = optics(band, calm)
    sums = []
    for nodes in (1, 7):
        seen = single_band_psf(band, fidelity=Knobs(wavelength_nodes=nodes), instrument=calm)
        weights = overlap_weights(seen.imager.aperture_radius_arcsec / seen.pixel_scale_arcsec)
        sums.append(aperture_sums(seen.off_axis, weights)[68, 68])
    true, said = abs(sums[0] / sums[1] - 1.0), model.wavelength_flux_error(1)
    assert 0.7 * said < true < said


def test_single_precision_adds_less_than_is_said(calm):
    double, single = (
        single_band_psf("F662", fidelity=Knobs(precision=part), instrument=calm) for part in ("double", "single")
    )
    error = np.abs(single.on_axis - double.on_axis)
    said = precision_error_e_s(double.on_axis, double.off_axis.max())
    assert (error <= 1.5 * said).all()
    assert error.max() > 0.05 * said.max()
