import numpy as np
import pytest

from catalogs.errors import InputError
from simulator.config import load_instrument
from simulator.imaging.psf import single_band_psf, wide_on_axis
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()
BANDS = INSTRUMENT.visible_bands()


@pytest.fixture(scope="module")
def psfs():
    return {band: single_band_psf(band, instrument=INSTRUMENT) for band in BANDS}


def test_stamps_have_the_promised_form(psfs):
    for psf in psfs.values():
        for image in (psf.on_axis, psf.off_axis):
            assert image.shape == (137, 137)
            assert image.dtype == np.float64
            assert np.isfinite(image).all()
            assert image.min() >= 0
            for mirrored in (image.T, image[::-1], image[:, ::-1]):
                np.testing.assert_allclose(mirrored, image, rtol=1e-6, atol=1e-15)
        assert np.unravel_index(psf.off_axis.argmax(), psf.off_axis.shape) == (68, 68)
        # 95.8 to 96.8 % of the energy behind the apodizer falls on the stamp.
        assert 0.955 < psf.off_axis.sum() / psf.metrics.apodizer_energy < 0.97


def test_hole_contrast_of_the_ideal_wavefront(psfs):
    for psf in psfs.values():
        dark = psf.metrics.raw_contrast[psf.metrics.hole]
        assert dark.mean() < 6e-10
        assert np.quantile(dark, 0.95) < 1.2e-9
        assert dark.max() < 2e-8  # single pixels on the outer edge


def test_masked_star_is_the_unmasked_one_times_the_open_area(psfs):
    psf = psfs["F662"]
    offset = np.abs(np.arange(137) - 68)
    half_width = INSTRUMENT.coronagraph.mask_half_width_arcsec / psf.pixel_scale_arcsec
    clear, shut = offset - 0.5 >= half_width, offset + 0.5 <= half_width
    np.testing.assert_allclose(
        psf.on_axis[np.ix_(clear, clear)], psf.off_axis[np.ix_(clear, clear)], rtol=1e-10, atol=1e-18
    )
    assert not psf.on_axis[shut].any()
    assert not psf.on_axis[:, shut].any()
    # The cut pixels against brute force: 40 x 40 points a pixel, 1 % of the pixel's light.
    row, column = 68 + 10, 68 + 25
    fine = (np.arange(40) + 0.5) / 40 - 0.5
    y, x = (10 + fine) * psf.pixel_scale_arcsec, (25 + fine) * psf.pixel_scale_arcsec
    values = psf.imager.intensity(y, x) * (y >= INSTRUMENT.coronagraph.mask_half_width_arcsec)[:, None]
    assert psf.on_axis[row, column] == pytest.approx(values.mean(), rel=0.02)


@pytest.mark.parametrize("position", [(0.0, 0.0), (0.3127, 0.4031), (-0.2, 0.517), (0.161, -0.3)])
def test_at_equals_fine_sampling_behind_the_mask(position):
    psf = single_band_psf("F520", fidelity=Knobs(wavelength_nodes=1, stamp_pixels=65), instrument=INSTRUMENT)
    image = psf.at(*position)
    n_fine = 16
    fine = (np.arange(65 * n_fine) + 0.5) / n_fine - 0.5 - 32
    angles = fine * psf.pixel_scale_arcsec
    is_open = np.abs(angles) >= INSTRUMENT.coronagraph.mask_half_width_arcsec
    brute = psf.imager.intensity(angles - position[1], angles - position[0], engine="matrix")
    brute *= np.outer(is_open, is_open)
    brute = brute.reshape(65, n_fine, 65, n_fine).mean(axis=(1, 3))
    # 2 nodes per pixel: 0.5 % of the peak; brute force: cut pixels to 1/16.
    edge = INSTRUMENT.coronagraph.mask_half_width_arcsec / psf.pixel_scale_arcsec
    uncut = np.abs(np.abs(np.arange(65) - 32) - edge) > 0.5
    assert np.abs(image - brute)[np.ix_(uncut, uncut)].max() < 5e-3 * psf.off_axis.max()
    knobs = Knobs(wavelength_nodes=1, stamp_pixels=65, pixel_nodes=6)
    finer = single_band_psf("F520", fidelity=knobs, instrument=INSTRUMENT)
    fields = np.abs(finer.at(*position) - brute)[np.ix_(uncut, uncut)]
    assert fields.max() < 2e-3 * psf.off_axis.max()  # the midpoint error of the brute force itself


def test_at_is_the_off_axis_image_on_whole_pixels(psfs):
    psf = psfs["F720"]
    shift = 30
    step = shift * psf.pixel_scale_arcsec
    image = psf.at(step, step)
    off = np.zeros_like(image)
    off[shift:, shift:] = psf.off_axis[:-shift, :-shift]
    half_width = INSTRUMENT.coronagraph.mask_half_width_arcsec / psf.pixel_scale_arcsec
    clear = np.abs(np.arange(137) - 68) - 0.5 >= half_width
    clear[:shift] = False
    np.testing.assert_allclose(image[np.ix_(clear, clear)], off[np.ix_(clear, clear)], rtol=1e-9, atol=1e-17)
    # x grows with the column.
    assert psf.at(0.4, 0.3).sum(axis=0).argmax() > 68 + 20


def test_sources_on_the_arms_of_the_cross_vanish(psfs):
    for psf in psfs.values():
        open_peak = psf.off_axis.max()
        for separation in (0.3, 0.65):
            assert psf.metrics.core_throughput(0.0, separation) < 0.01 * psf.metrics.core_open
            assert psf.at(0.0, separation).max() < 0.05 * open_peak


def test_far_companion_leaves_wings_of_the_order_of_the_profile(psfs):
    psf = psfs["F662"]
    # Companions at 8 arcsec on several position angles: mean over angle and stamp against the azimuthal mean.
    angle = np.radians(np.arange(5, 90, 10))
    means = [psf.at(8 * np.cos(t), 8 * np.sin(t))[30:107, 30:107].mean() for t in angle]
    open_area = (psf.at(0.5, 0.5)[30:107, 30:107] > 0).mean()
    assert 0.3 < np.mean(means) / open_area / psf.metrics.wing(8.0) < 3
    with pytest.raises(InputError, match="x_arcsec"):
        psf.at(np.nan, 0)


def test_convergence_of_the_knobs(psfs):
    for band in ("F520", "F850"):
        reference = single_band_psf(band, fidelity="reference", instrument=INSTRUMENT)
        standard = psfs[band]
        peak = reference.off_axis.max()
        assert np.abs(standard.off_axis - reference.off_axis).max() < 1e-3 * peak
        assert standard.metrics.core_open == pytest.approx(reference.metrics.core_open, rel=1e-6)
        hole = standard.metrics.hole
        mean = [psf.metrics.raw_contrast[hole].mean() for psf in (standard, reference)]
        assert mean[0] == pytest.approx(mean[1], rel=0.03)
        assert reference.metrics.raw_contrast.shape == reference.on_axis.shape
        quick = single_band_psf(band, fidelity="quick", instrument=INSTRUMENT)
        assert quick.off_axis.max() == pytest.approx(peak, rel=0.02)
        assert quick.metrics.core_open == pytest.approx(reference.metrics.core_open, rel=2e-3)


def test_wide_image_continues_the_stamp():
    wide = wide_on_axis("F662", INSTRUMENT, (151, 181), (70, 90))
    psf = single_band_psf("F662", instrument=INSTRUMENT)
    part = wide[2:139, 22:159]
    assert np.abs(part - psf.on_axis).max() < 0.06 * psf.on_axis.max()
    assert part.sum() == pytest.approx(psf.on_axis.sum(), rel=0.02)


def test_even_stamps_are_refused():
    with pytest.raises(InputError, match="odd"):
        single_band_psf("F662", fidelity=Knobs(stamp_pixels=64), instrument=INSTRUMENT)
