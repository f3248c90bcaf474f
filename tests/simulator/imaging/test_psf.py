import sys

import numpy as np
import pytest
from photutils.aperture import CircularAperture, aperture_photometry

from cpic_core import InputError
from simulator.config import load_instrument
from simulator.imaging import single_band_psf
from simulator.imaging.build import dark_hole_of
from simulator.imaging.measure import stamp_figures
from simulator.imaging.psf import forget_stamps, wide_on_axis
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()
FLAT = load_instrument(
    {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}, "dark_hole": {"control": "off"}}
)
BANDS = INSTRUMENT.visible_bands()


@pytest.fixture(scope="module")
def psfs():
    return {band: single_band_psf(band, instrument=INSTRUMENT) for band in BANDS}


@pytest.fixture(scope="module")
def flat():
    return {band: single_band_psf(band, instrument=FLAT) for band in BANDS}


@pytest.fixture(scope="module")
def references():
    return {band: single_band_psf(band, fidelity="reference", instrument=INSTRUMENT) for band in ("F520", "F850")}


def contrast_in_hole(psf):
    return (psf.on_axis / psf.off_axis.max())[psf.metrics.hole]


def core_of(image, psf, x=0.0, y=0.0):
    """Light in the photometric aperture at a position, by photutils."""
    middle, pixel = len(image) // 2, psf.pixel_scale_arcsec
    circle = CircularAperture((middle + x / pixel, middle + y / pixel), psf.imager.aperture_radius_arcsec / pixel)
    return aperture_photometry(image, circle)["aperture_sum"][0]


def test_stamps_have_the_promised_form(psfs, flat):
    for psf in (*psfs.values(), *flat.values()):
        for image in (psf.on_axis, psf.off_axis):
            assert image.shape == (137, 137)
            assert image.dtype == np.float64
            assert np.isfinite(image).all()
            assert image.min() >= 0
    for band, psf in flat.items():
        for mirrored in (psf.off_axis.T, psf.off_axis[::-1], psf.off_axis[:, ::-1]):
            np.testing.assert_allclose(mirrored, psf.off_axis, rtol=1e-6, atol=1e-15)
        # 95.8 to 96.8 % of the energy behind the ideal apodizer falls on the stamp; the mirror scatters 3 % further.
        assert 0.955 < psf.off_axis.sum() / psf.imager.apodizer_energy < 0.97
        assert 0.96 < psfs[band].off_axis.sum() / psf.off_axis.sum() < 1


def test_apodizer_alone_is_darker_than_its_design(flat):
    for psf in flat.values():
        dark = (psf.on_axis / psf.off_axis.max())[psf.imager.zone.covers(*[(np.arange(137) - 68) * 0.016153] * 2)]
        assert dark.mean() < 6e-10
        assert np.quantile(dark, 0.95) < 1.2e-9
        assert dark.max() < 2e-8  # single pixels on the outer edge


@pytest.mark.parametrize(
    ("band", "mean", "p95"), [("F520", 1e-8, 3e-8), ("F662", 1e-9, 3e-9), ("F720", 1e-9, 3e-9), ("F850", 1e-9, 3e-9)]
)
def test_hole_of_the_default_instrument(psfs, band, mean, p95):
    psf = psfs[band]
    dark = contrast_in_hole(psf)
    assert dark.mean() <= mean
    assert np.quantile(dark, 0.95) <= p95
    assert psf.flags == ()
    # The light in the zone itself, without pixels: the state's own score is the same optics.
    own = dark_hole_of(INSTRUMENT, band).own
    assert psf.metrics.raw_contrast[psf.metrics.hole].mean() == pytest.approx(dark.mean(), rel=1e-9)
    assert dark.mean() == pytest.approx(own.mean, rel=0.5)  # pixels on the steep edges weigh otherwise than points


def exact_image(imager, n_pixels, position, half_width):
    """Pixel means by 7 Gauss-Legendre nodes of every open part and 7 Gauss-Hermite nodes of the pointing."""
    nodes, weights = np.polynomial.legendre.leggauss(7)
    normal, shares = np.polynomial.hermite_e.hermegauss(7 if imager.jitter_arcsec else 1)
    pixel, sigma = imager.pixel_scale_arcsec, imager.jitter_arcsec
    places, sums, owners = [], [], []
    for index in range(n_pixels):
        low, high = ((index - n_pixels // 2 + part) * pixel for part in (-0.5, 0.5))
        for left, right in ((low, min(high, -half_width)), (max(low, half_width), high)):
            if right > left:
                middle, half = 0.5 * (left + right), 0.5 * (right - left)
                places.append(np.add.outer(middle + half * nodes, sigma * normal).ravel())
                sums.append(np.multiply.outer(half / pixel * weights, shares / shares.sum()).ravel())
                owners.append(np.full(places[-1].size, index))
    place, weight, owner = (np.concatenate(part) for part in (places, sums, owners))
    gather = np.zeros((n_pixels, place.size))
    gather[owner, np.arange(place.size)] = weight
    return gather @ imager.intensity(place - position[1], place - position[0]) @ gather.T


def centroid_mas(image, pixel_arcsec):
    index = np.arange(len(image))
    return np.array([image.sum(axis=axis) @ index for axis in (0, 1)]) / image.sum() * pixel_arcsec * 1e3


@pytest.mark.parametrize("position", [(0.0, 0.0), (0.2127, 0.2531), (-0.2, 0.317), (0.161, -0.25)])
@pytest.mark.parametrize("jitter_mas", [0, 5])
def test_at_is_the_exact_image_at_any_sub_pixel_position(position, jitter_mas):
    instrument = load_instrument({"wavefront": {"jitter_mas": jitter_mas}})
    half_width = instrument.mask_half_width_arcsec("F520")
    # Jitter asks for a node more than the pixel alone: three leave 5e-6 of the peak in the bluest band.
    for nodes, tolerance in ((3, 1e-6 if jitter_mas == 0 else 1e-5), (4, 1e-6)):
        knobs = Knobs(wavelength_nodes=1, stamp_pixels=41, pixel_nodes=nodes)
        psf = single_band_psf("F520", fidelity=knobs, instrument=instrument)
        image = psf.at(*position)
        exact = exact_image(psf.imager, 41, position, half_width)
        assert np.abs(image - exact).max() < tolerance * psf.off_axis.max()
        if position != (0.0, 0.0):  # the masked star has no core
            assert np.abs(centroid_mas(image, 0.016153) - centroid_mas(exact, 0.016153)).max() < 0.01


@pytest.mark.parametrize("margin", [0, 4])
def test_at_of_the_hole_is_the_same_image_on_its_rows_and_columns(psfs, margin):
    psf, place = psfs["F720"], (0.43, -0.37)
    whole, cut, hole = psf.at(*place), psf.at(*place, margin_pixels=margin), psf.geometry.hole
    wanted = [np.flatnonzero(hole.any(axis=k)) for k in (1, 0)]
    rows, columns = (np.abs(np.arange(len(hole))[:, None] - part).min(axis=1) <= margin for part in wanted)
    inside = np.outer(rows, columns)
    assert inside[hole].all()
    np.testing.assert_allclose(cut[inside], whole[inside], rtol=1e-9, atol=1e-17)
    assert not cut[~inside].any()


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


@pytest.mark.parametrize("place", [(np.nan, 0.0), (0.0, np.inf), (-np.inf, np.nan)])
def test_places_that_are_not_numbers_are_refused(refused, psfs, place):
    refused("x_arcsec, y_arcsec", psfs["F662"].at, *place)


def test_places_out_of_the_field_leave_next_to_nothing(psfs):
    image = psfs["F662"].at(300.0, -4000.0)
    assert image.shape == (137, 137)
    assert 0 <= image.min() <= image.max() < 1e-12


@pytest.mark.parametrize("band", ["F850", pytest.param("F520", marks=pytest.mark.long)])
def test_standard_settings_agree_with_the_reference(psfs, references, band):
    standard, reference = psfs[band], references[band]
    peak = reference.off_axis.max()
    # No more than the quadrature of the pixel; the optics are the same at every setting.
    assert np.abs(standard.off_axis - reference.off_axis).max() < 1e-5 * peak
    for place in ((0.4, 0.41), (0.2031, 0.25), (-0.161, 0.3), (0.5, -0.5)):
        cores = [core_of(psf.at(*place), psf, *place) for psf in (standard, reference)]
        assert cores[0] == pytest.approx(cores[1], rel=1e-4)
    hole = [(psf.on_axis / psf.off_axis.max())[standard.metrics.hole] for psf in (standard, reference)]
    assert hole[0].mean() == pytest.approx(hole[1].mean(), rel=5e-3)
    assert np.sqrt(((hole[0] - hole[1]) ** 2).mean()) < 5e-11


def test_estimated_error_is_the_difference_from_the_reference(psfs, references):
    standard, reference = psfs["F520"], references["F520"]
    error = standard.estimated_error
    assert error.tier == "standard"
    assert error.aperture <= 1e-4
    cores = [core_of(psf.off_axis, psf) for psf in (standard, reference)]
    assert error.aperture == pytest.approx(abs(cores[0] / cores[1] - 1), rel=0.05)
    assert error.peak == pytest.approx(abs(standard.off_axis.max() / reference.off_axis.max() - 1), rel=1e-6)
    hole = [psf.on_axis[standard.metrics.hole] for psf in (standard, reference)]
    assert error.hole_mean == pytest.approx(abs(hole[0].mean() / hole[1].mean() - 1), rel=1e-6)
    rms = np.sqrt(((hole[0] - hole[1]) ** 2).mean()) / reference.off_axis.max()
    assert error.hole_rms == pytest.approx(rms, rel=1e-6)
    error = reference.estimated_error
    assert (error.tier, error.peak, error.aperture, error.hole_mean, error.hole_rms) == ("reference", 0, 0, 0, 0)


def test_quick_is_good_for_a_look(references):
    quick = single_band_psf("F520", fidelity="quick", instrument=INSTRUMENT)
    reference = references["F520"]
    assert quick.metrics.raw_contrast.shape == quick.on_axis.shape
    assert quick.off_axis.max() == pytest.approx(reference.off_axis.max(), rel=0.04)
    assert quick.metrics.core_open == pytest.approx(reference.metrics.core_open, rel=2e-3)
    assert contrast_in_hole(quick).mean() == pytest.approx(contrast_in_hole(reference).mean(), rel=0.15)


def test_a_finer_pupil_grid_sees_the_same_optics(psfs):
    for band in ("F520", "F850"):
        fine = single_band_psf(band, fidelity=Knobs(pupil_samples=256), instrument=INSTRUMENT)
        assert (len(fine.imager.transmission), len(psfs[band].imager.transmission)) == (256, 128)
        peak = fine.off_axis.max()
        assert np.abs(fine.off_axis - psfs[band].off_axis).max() < 1e-14 * peak
        assert np.abs(fine.on_axis - psfs[band].on_axis).max() < 1e-17 * peak


@pytest.mark.parametrize("band", BANDS)
def test_single_precision_is_flagged_and_its_noise_is_below_1e_15(psfs, band):
    """|dE|^2 is the noise; times twice the speckle's field it moves single pixels by less than 1e-12 of the peak."""
    single = single_band_psf(band, fidelity=Knobs(precision="single"), instrument=INSTRUMENT)
    double = psfs[band]
    assert single.flags == ("single_precision",)
    assert single.on_axis.dtype == np.float64
    axis = single.imager.stamp_axis(masked=True).nodes_arcsec
    inside = single.imager.zone.covers(axis, axis)
    peak = np.abs(double.imager.field(1, np.zeros(1), np.zeros(1))[0, 0])
    fields = [psf.imager.field(1, axis, axis)[inside] for psf in (single, double)]
    assert (np.abs(fields[0] - fields[1]) ** 2).max() < 1e-15 * peak**2
    assert fields[0].dtype == np.complex64
    change = np.abs(contrast_in_hole(single) - contrast_in_hole(double))
    assert 0 < change.max() < 1e-12
    assert abs(contrast_in_hole(single).mean() / contrast_in_hole(double).mean() - 1) < 1e-5
    assert single.off_axis.max() == pytest.approx(double.off_axis.max(), rel=1e-6)


@pytest.mark.parametrize("engine", ["hcipy", "matrix"])
def test_engines_give_the_same_stamps(psfs, engine):
    psf = single_band_psf("F850", instrument=INSTRUMENT, engine=engine)
    assert np.abs(psf.on_axis - psfs["F850"].on_axis).max() < 1e-12 * psf.off_axis.max()
    assert np.abs(psf.off_axis - psfs["F850"].off_axis).max() < 1e-12 * psf.off_axis.max()


def test_an_engine_that_is_not_installed_is_refused_by_name(monkeypatch):
    monkeypatch.setitem(sys.modules, "hcipy", None)
    with pytest.raises(InputError, match=r"engine = hcipy: .*allowed: matrix .*pip install hcipy"):
        single_band_psf("F850", fidelity=Knobs(stamp_pixels=35), instrument=INSTRUMENT, engine="hcipy")


@pytest.mark.parametrize("kind", ["F5V", "G2V", "K1V"])
def test_the_star_s_type_changes_the_core_by_less_than_a_thousandth(psfs, kind):
    psf = single_band_psf("F662", fidelity=Knobs(stamp_pixels=33), instrument=INSTRUMENT, spectrum=kind)
    assert psf.imager.weights.sum() == pytest.approx(1.0, rel=1e-12)
    core = stamp_figures(psf.imager, psf.on_axis, psf.off_axis)["core_open"]
    assert 0 < abs(core / psfs["F662"].metrics.core_open - 1) < 1e-3


@pytest.mark.parametrize("band", BANDS)
def test_two_quadrants_are_dark_on_one_side_only(band):
    psf = single_band_psf(band, instrument=load_instrument("cpic_2q"))
    offset = (np.arange(137) - 68) * psf.pixel_scale_arcsec
    hole, contrast = psf.imager.zone.covers(offset, offset), psf.on_axis / psf.off_axis.max()
    assert hole[:, 69:].any()
    assert not hole[:, :69].any()
    assert contrast[hole].mean() <= 8e-9
    assert np.quantile(contrast[hole], 0.95) <= 2e-8
    assert contrast[:, ::-1][hole].mean() > 100 * contrast[hole].mean()


def test_wide_image_continues_the_stamp(psfs):
    wide = wide_on_axis("F662", INSTRUMENT, (151, 181), (70, 90))
    part = wide[2:139, 22:159]
    assert np.abs(part - psfs["F662"].on_axis).max() < 0.06 * psfs["F662"].on_axis.max()
    assert part.sum() == pytest.approx(psfs["F662"].on_axis.sum(), rel=0.02)


@pytest.mark.parametrize("n_pixels", [33, 35, 201])
def test_odd_stamps_are_cut_from_one_image(psfs, n_pixels):
    psf = single_band_psf("F662", fidelity=Knobs(stamp_pixels=n_pixels), instrument=INSTRUMENT)
    assert psf.on_axis.shape == psf.off_axis.shape == (n_pixels, n_pixels)
    small, large = sorted((psf.off_axis, psfs["F662"].off_axis), key=len)
    rim = (len(large) - len(small)) // 2
    np.testing.assert_allclose(large[rim : len(large) - rim, rim : len(large) - rim], small, rtol=1e-9, atol=1e-16)


@pytest.mark.parametrize(
    ("words", "arguments"),
    [
        ("stamp_pixels = 64 px.*odd", {"fidelity": Knobs(stamp_pixels=64)}),
        ("fidelity", {"fidelity": "best"}),
        ("engine", {"engine": "fft"}),
        ("band = F999", {"band": "F999"}),
        ("spectral_type", {"spectrum": "Q9"}),
    ],
)
def test_bad_requests_are_named(refused, words, arguments):
    refused(words, single_band_psf, **{"band": "F662", "instrument": INSTRUMENT} | arguments)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("pupil_samples", 32),
        ("pupil_samples", 4096),
        ("wavelength_nodes", 0),
        ("wavelength_nodes", 100),
        ("pixel_nodes", 0),
        ("pixel_nodes", 9),
        ("stamp_pixels", 31),
        ("stamp_pixels", 5001),
        ("precision", "half"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(key, value):
    with pytest.raises(ValueError, match=key):
        Knobs(**{key: value})


def test_metrics_of_a_stamp_that_cuts_the_hole_are_refused(refused):
    psf = single_band_psf("F662", fidelity=Knobs(stamp_pixels=33))
    assert psf.on_axis.shape == (33, 33)
    refused("stamp_pixels = 33 px", lambda: psf.metrics.halo_aperture(0.4, 0.4))


def test_electronics_that_spoil_a_hole_are_flagged():
    psf = single_band_psf("F850", instrument={"mirror": {"bits": 10}})
    assert psf.hole_state == "not_reached"
    assert psf.flags == ("hole_not_reached",)
    assert single_band_psf("F850").hole_state == "reached"
    assert single_band_psf("F850", instrument={"dark_hole": {"control": "off"}}).hole_state == "none"


def test_large_stamps_continue_small_ones():
    """They come in closed form: the same pixels to what the nodes of the small ones are good for."""
    large = single_band_psf("F850", fidelity=Knobs(stamp_pixels=401))
    small = single_band_psf("F850", fidelity=Knobs(pixel_nodes=8))
    part = slice(200 - 68, 200 + 69)
    peak = small.off_axis.max()
    assert np.abs(large.off_axis[part, part] - small.off_axis).max() < 1e-9 * peak
    assert np.abs(large.on_axis[part, part] - small.on_axis).max() < 1e-11 * peak
    hole = small.metrics.hole
    np.testing.assert_allclose(large.on_axis[part, part][hole], small.on_axis[hole], rtol=1e-3)


def test_stamps_of_the_same_optics_are_shared_and_forgotten():
    first = single_band_psf("F662", instrument=INSTRUMENT)
    quiet = load_instrument({"detector": {"read_noise_e": 1.0}})
    second = single_band_psf("F662", instrument=quiet)  # another instrument with the same optics
    assert second.instrument is quiet
    assert second.imager is first.imager
    assert second.on_axis is first.on_axis
    with pytest.raises(ValueError, match="read-only"):
        first.off_axis[0, 0] = 1.0
    forget_stamps()
    third = single_band_psf("F662", instrument=INSTRUMENT)
    assert third.on_axis is not first.on_axis
    np.testing.assert_array_equal(third.on_axis, first.on_axis)
    assert single_band_psf("F720", instrument=INSTRUMENT).on_axis is not third.on_axis
    other = load_instrument({"wavefront": {"seed": 99}, "dark_hole": {"control": "off"}})
    assert single_band_psf("F662", instrument=other).imager.content_key != third.imager.content_key
