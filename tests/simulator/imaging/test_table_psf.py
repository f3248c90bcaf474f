"""Images of coronagraphs given by tables: the light of a core, and the residual that the table states."""

import numpy as np
import pytest
from scipy.signal import fftconvolve
from scipy.special import j1

from simulator.config import load_instrument
from simulator.imaging import overlap_weights, psf_metrics, psf_of_table
from simulator.imaging.external import save_psf
from simulator.imaging.table_psf import coherent_field, core_coherence

ROMAN = load_instrument("roman_hlc_like")


def psf_of(instrument=ROMAN, band="CGI1"):
    psf = psf_of_table(instrument, band)
    offset = (np.arange(len(psf.on_axis)) - len(psf.on_axis) // 2) * psf.pixel_scale_arcsec
    return psf, np.hypot(offset[:, None], offset)


def test_an_instrument_with_optics_has_none():
    assert psf_of_table(load_instrument(), "F520") is None


def test_a_field_behind_a_round_pupil():
    """Mean light, and correlation of the field against the transform of a disc."""
    fields = np.array([coherent_field(96, 4.0, np.random.default_rng(seed)) for seed in range(40)])
    assert np.mean(np.abs(fields) ** 2) == pytest.approx(1.0, rel=0.02)
    for shift in (1, 2, 4, 7):
        found = np.mean(np.conj(fields) * np.roll(fields, shift, axis=2)).real
        u = np.pi * shift / 4.0
        assert found == pytest.approx(2.0 * j1(u) / u, abs=0.03)


def test_sums_of_coherent_light_scatter_as_said():
    weights, sums = overlap_weights(2.8), []
    for seed in range(60):
        one, two = (coherent_field(96, 4.0, np.random.default_rng((seed, k))) for k in (0, 1))
        beat = 2.0 * (np.conj(one) * two).real
        sums.append(fftconvolve(beat, weights, mode="valid")[::9, ::9])
    crossed, _ = core_coherence(2.8, 4.0, 1.0)
    assert np.var(sums) / weights.sum() ** 2 == pytest.approx(2.0 * crossed, rel=0.05)


@pytest.mark.parametrize(("name", "band"), [("roman_hlc_like", "CGI1"), ("hwo_like", "V500")])
def test_light_of_a_core_is_that_of_the_table(name, band):
    psf, _ = psf_of(load_instrument(name), band)
    table, radius = psf.figures.table, psf.geometry.aperture_radius_arcsec / psf.pixel_scale_arcsec
    for place in np.quantile(table.separation_arcsec, [0.3, 0.7]):
        image = psf.at(place / np.sqrt(2.0), place / np.sqrt(2.0), margin_pixels=0)
        x = place / np.sqrt(2.0) / psf.pixel_scale_arcsec
        whole = round(x)
        weights, middle = overlap_weights(radius, x - whole, x - whole), len(image) // 2 + whole
        reach = slice(middle - len(weights) // 2, middle + len(weights) // 2 + 1)
        assert np.sum(image[reach, reach] * weights) == pytest.approx(
            float(table.at("core_throughput", place)), rel=0.05
        )


@pytest.mark.parametrize(("name", "band"), [("roman_hlc_like", "CGI1"), ("hwo_like", "V500")])
def test_the_residual_is_that_of_the_table(name, band):
    """Sums over cores, from the middle of the zone outwards; the mean of the starlight is that of the table too."""
    psf, away = psf_of(load_instrument(name), band)
    place, rng = psf.figures.floor_separation_arcsec, np.random.default_rng(3)
    variance, common = psf.figures.stability(place)
    assert common
    weights = overlap_weights(psf.geometry.aperture_radius_arcsec / psf.pixel_scale_arcsec)
    images = [np.abs(psf.field + psf.moved(place, variance, rng)) ** 2 for _ in range(60)]
    sums = fftconvolve(np.array(images) - psf.on_axis, weights[None], mode="same", axes=(1, 2))
    middle, outer = np.quantile(place, [0.4, 0.95])
    ring = (away > middle) & (away < outer)
    expected = np.interp(away[ring], place, variance)
    assert np.sqrt(np.mean(sums.var(axis=0)[ring] / expected)) == pytest.approx(1.0, abs=0.06)
    core = fftconvolve(psf.on_axis, weights, mode="same")[ring]
    assert np.mean(core / psf.figures.starlight(away[ring])) == pytest.approx(1.0, abs=0.02)


def test_images_of_a_file_keep_their_place(tmp_path):
    """The star and the source of the file; the residual is the table's."""
    plain, _ = psf_of()
    path = save_psf(plain, tmp_path / "psf.npz")
    psf, away = psf_of(ROMAN.changed({"coronagraph": {"psf": str(path)}}))
    np.testing.assert_array_equal(psf.off_axis, plain.off_axis)
    np.testing.assert_array_equal(psf.on_axis, plain.on_axis)
    place, rng = psf.figures.floor_separation_arcsec, np.random.default_rng(3)
    variance, _ = psf.figures.stability(place)
    weights = overlap_weights(psf.geometry.aperture_radius_arcsec / psf.pixel_scale_arcsec)
    images = [np.abs(psf.field + psf.moved(place, variance, rng)) ** 2 for _ in range(60)]
    sums = fftconvolve(np.array(images) - psf.on_axis, weights[None], mode="same", axes=(1, 2))
    ring = (away > 0.28) & (away < 0.43)
    found = np.mean(sums.var(axis=0)[ring] / np.interp(away[ring], place, variance))
    # The static speckles of the file are even here: their phases alone set how fast the residual varies.
    assert 0.7 < np.sqrt(found) < 1.3


def test_dust_passes_as_extended_light():
    psf, _ = psf_of()
    table = psf.figures.table
    place = float(np.median(table.separation_arcsec))
    total = psf.extended(place, 0.0) * psf.off_axis.sum()
    assert total == pytest.approx(float(table.at("occulter_transmission", place)), rel=1e-9)


def test_metrics_of_images_count_edges_in_part():
    figures = psf_metrics(ROMAN, "CGI1")
    weights = [overlap_weights(1.249, y, x) for y in (-0.3, 0.0, 0.4) for x in (-0.2, 0.1, 0.45)]
    share = np.mean([np.sum(one**2) for one in weights]) / (np.pi * 1.249**2)
    assert figures.noise_fraction == 1.0
    assert figures.measured().noise_fraction == pytest.approx(share, rel=0.03)


def test_no_visit_is_brighter_than_the_brightest():
    psf, _ = psf_of()
    place, rng = psf.figures.floor_separation_arcsec, np.random.default_rng(9)
    variance, _ = psf.figures.stability(place)
    most = psf.brightest(place, variance)
    seen = np.max([np.abs(psf.field + psf.moved(place, variance, rng)) ** 2 for _ in range(100)], axis=0)
    assert (seen < most).all()
    assert np.max(seen / most) > 0.4  # and not far above what is seen
