"""

Variance of the light of wavefront errors: all waves one by one, and visits that are drawn.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import fftconvolve

from cpic_core import InputError, stream
from simulator.config import ARCSEC_PER_RAD, Drift, load_instrument
from simulator.imaging import (
    aperture_sums,
    build_imager,
    centred_axis,
    matched_kernel,
    measure,
    overlap_weights,
    psf_metrics,
    single_band_psf,
    visit_frames,
    visit_responses,
)
from simulator.imaging.build import dark_hole_of
from simulator.imaging.drift import ScreenModel, screen_model
from simulator.imaging.measure import (
    ErrorLight,
    _register_tail,
    kernel_smoothness,
    light_variance,
    measure_floor,
    stamp_figures,
    strehl,
)
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()
FLAT = load_instrument(
    {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}, "dark_hole": {"control": "off"}}
)
STILL = load_instrument({"wavefront": {"jitter_mas": 0}, "mirror": {"bits": None}})
MONO = Knobs(wavelength_nodes=1)


@pytest.mark.parametrize("band", INSTRUMENT.visible_bands())
def test_strehl_is_that_of_the_hole(band):
    """Sum of the pupil field over its sum without phase errors, squared: no propagation at all."""
    imager = build_imager(STILL, band, Knobs(wavelength_nodes=5))
    peaks = np.array(
        [
            [
                abs((imager.transmission * extra).sum()) ** 2
                for extra in (
                    imager.static.amplitude * np.exp(2j * np.pi * imager.static.opd_nm * 1e-9 / wavelength),
                    1.0,
                )
            ]
            for wavelength in imager.wavelengths_m
        ]
    )
    light, flat = (imager.weights / imager.wavelengths_m**2) @ peaks
    assert strehl(imager) == pytest.approx(light / flat, rel=1e-9)
    assert strehl(imager) == pytest.approx(dark_hole_of(STILL, band).own.strehl, rel=1e-9)


def test_strehl_of_perfect_optics_is_one_and_jitter_lowers_it():
    assert strehl(build_imager(FLAT, "F662")) == pytest.approx(1.0, rel=1e-9)
    jittered = dataclasses.replace(build_imager(FLAT, "F662", MONO), jitter_arcsec=0.005)
    # Curvature of the core from the second moment of the amplitude over the pupil, to first order in the variance.
    position = (np.arange(64) - 31.5) / 64 * 2.0
    moment = (jittered.transmission * position**2).sum() / jittered.transmission.sum()
    wave = 2 * np.pi / jittered.wavelengths_m[0] * 0.005 / ARCSEC_PER_RAD
    assert 1 - strehl(jittered) == pytest.approx(2 * wave**2 * moment, rel=0.02)


@pytest.mark.parametrize("instrument", [FLAT, INSTRUMENT])
def test_core_is_the_energy_in_the_circle(instrument):
    psf = single_band_psf("F720", fidelity=MONO, instrument=instrument)
    imager = psf.imager
    figures = stamp_figures(imager, psf.on_axis, psf.off_axis)
    # 161 x 161 points a lambda/D square, inside or out, averaged over the pointing by 7 x 7 directions.
    radius = imager.aperture_radius_arcsec
    points = (np.arange(400) + 0.5) / 400 * 2 * radius - radius
    inside = np.hypot(points[:, None], points) <= radius
    normal, shares = np.polynomial.hermite_e.hermegauss(5 if imager.jitter_arcsec else 1)
    shares, energy = shares / shares.sum(), 0.0
    for dy, weight_y in zip(normal * imager.jitter_arcsec, shares, strict=True):
        for dx, weight_x in zip(normal * imager.jitter_arcsec, shares, strict=True):
            energy += weight_x * weight_y * imager.intensity(points - dy, points - dx)[inside].sum()
    energy *= (2 * radius / 400 / imager.pixel_scale_arcsec) ** 2
    assert figures["core_continuous"] == pytest.approx(energy, rel=1e-3)
    assert 0.97 < figures["core_open"] / figures["core_continuous"] < 1


def test_stamp_figures_are_those_of_the_stamps():
    psf = single_band_psf("F520", instrument=INSTRUMENT)
    figures = stamp_figures(psf.imager, psf.on_axis, psf.off_axis)
    assert figures["peak_off_axis"] == psf.off_axis.max()
    np.testing.assert_array_equal(figures["raw_contrast"], psf.on_axis / psf.off_axis.max())
    offset = np.abs(centred_axis(137, psf.pixel_scale_arcsec))
    low, high = psf.imager.hole_arcsec
    touches = (offset + psf.pixel_scale_arcsec / 2 >= low) & (offset - psf.pixel_scale_arcsec / 2 <= high)
    assert figures["peak_on_axis_hole"] == psf.on_axis[np.ix_(touches, touches)].max()
    for name in ("core_open", "core_continuous", "iwa_arcsec", "peak_on_axis_hole"):
        assert getattr(psf.metrics, name) == pytest.approx(figures[name], rel=1e-6)


def test_register_tail_is_the_smallest_capacity_that_leaves_nothing():
    rng = np.random.default_rng(4)
    offset = np.arange(-20, 21) * 0.05
    rows = rng.exponential(size=(6, 41)) ** 3
    found = _register_tail(rows, offset, ((0.2, 0.7),))

    def left_over(capacity):
        worst = 0.0
        for row in rows:
            for run in (row[offset < 0.2], row[offset > 0.7][::-1]):  # in the order of transfer towards the hole
                charge = 0.0
                for value in run:
                    charge = max(charge + value - capacity, 0.0)
                worst = max(worst, charge)
        return worst

    assert left_over(found * 1.0001) == 0
    assert left_over(found * 0.999) > 0


def test_shipped_figures_of_the_whole_frame_bound_those_of_the_stamp():
    for band in INSTRUMENT.visible_bands():
        metrics = psf_metrics(INSTRUMENT, band)
        star = metrics.raw_contrast.max() * metrics.peak_off_axis
        assert metrics.peak_on_axis_frame >= star * (1 - 1e-9)
        assert metrics.peak_on_axis_columns <= metrics.peak_on_axis_frame
        assert metrics.register_tail <= metrics.peak_on_axis_frame
        assert 0.8 < metrics.source_noise_fraction < 1


@pytest.mark.parametrize(
    ("rms", "n_images"), [(0.05, 40), *(pytest.param(rms, 120, marks=pytest.mark.long) for rms in (0.05, 0.5))]
)
def test_floor_equals_exact_frames_of_visit_pairs(rms, n_images):
    """Full propagation, pair by pair, against the tabulated first-order floor."""
    imager = build_imager(INSTRUMENT, "F662")
    metrics = psf_metrics(INSTRUMENT, "F662")
    hole = metrics.hole
    weights = overlap_weights(metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec)
    offset = np.abs(np.arange(137) - 68) * metrics.pixel_scale_arcsec
    radius = metrics.aperture_radius_arcsec
    fits = (offset >= metrics.hole_inner_arcsec + radius) & (offset <= metrics.hole_outer_arcsec - radius)
    place = np.outer(fits, fits)
    drift = Drift(visit_nm=rms, walk_nm_per_sqrt_hour=0, psd_slope=2.5)
    images = [visit_frames(imager, drift, 1, 1.0, *(np.random.default_rng([k, 0]),) * 2)[0] for k in range(n_images)]
    squares = []
    for science, reference in zip(images, images[1:] + images[:1], strict=True):
        s, r = (image[hole] - image[hole].mean() for image in (science, reference))
        residual = np.zeros((137, 137))
        residual[hole] = s - r
        squares.append((aperture_sums(residual, weights)[place] ** 2).mean())
    error = np.std(squares) / np.mean(squares) / np.sqrt(len(squares)) / 2
    assert np.sqrt(np.mean(squares)) == pytest.approx(metrics.rdi_floor(rms), rel=4 * np.hypot(error, 0.02))


class OneWave(ScreenModel):
    """Screens of one wave each, in the order of the waves that have an amplitude."""

    def draw(self, rng, rms_nm):
        number = self.drawn.pop(0)
        coefficients = np.zeros((2, *self.amplitude.shape))
        where = np.argwhere(self.amplitude > 0)
        coefficients[(number % 2, *where[number // 2])] = 1.0
        unit = SimpleNamespace(standard_normal=lambda shape: coefficients)
        return super().draw(unit, rms_nm)


def small_hole(band):
    """A hole of a few apertures that no mirror digs, past the configuration's own check."""
    instrument = load_instrument({"dark_hole": {"control": "off"}})
    narrow = instrument.coronagraph.model_copy(update={"outer_half_side_arcsec": 0.36})
    knobs = Knobs(pupil_samples=64, wavelength_nodes=2, pixel_nodes=1)
    return build_imager(instrument.model_copy(update={"coronagraph": narrow}), band, knobs)


def cross_terms(imager, visits):
    """Sums of the cross term of visits of 1 nm in whole apertures, less the mean of the hole."""
    zone, pixel = imager.zone, imager.pixel_scale_arcsec
    side = np.arange(np.floor(zone.inner_arcsec / pixel), np.ceil(zone.outer_arcsec / pixel) + 1) * pixel
    y, x = zone.axes(side)
    axes = imager.axis(y, masked=True), imager.axis(x, masked=True)
    _, linear, _ = measure.visit_responses(imager, *axes, 2.5, visits, 8)
    weights = overlap_weights(imager.aperture_radius_arcsec / pixel)
    sums = aperture_sums(linear, weights)[..., zone.covers(y, x, -imager.aperture_radius_arcsec)]
    return sums - linear[..., zone.covers(y, x)].mean(axis=-1, keepdims=True) * weights.sum()


def tables_of(imager):
    """Floor, and what the matched filter of the imager's unmasked source makes of it."""
    pixel = imager.pixel_scale_arcsec
    axis = imager.axis(centred_axis(31, pixel), masked=False)
    return measure_floor(imager, 2.5, matched_kernel(imager.image(axis, axis), imager.lambda_d_arcsec / pixel))


def test_the_cross_term_is_the_sum_over_all_waves(monkeypatch):
    """Wave by wave through the optics: each wave's own sums, squared and added."""
    imager = small_hole("F520")
    model = screen_model(len(imager.transmission), 2.5)
    low = np.hypot(*np.indices(model.amplitude.shape) - np.array([[[0]], [[63]]])) < 6.0  # up to 3 cycles
    few = OneWave(**(vars(model) | {"amplitude": np.where(low, model.amplitude, 0.0)}))
    waves = 2 * int((few.amplitude > 0).sum())
    object.__setattr__(few, "drawn", [*range(waves), 0, 0])
    monkeypatch.setattr(measure, "screen_model", lambda samples, slope: few)
    sums, floor = cross_terms(imager, waves), tables_of(imager)
    assert floor["floor_linear"][0] == pytest.approx(2.0 * (sums**2).sum(axis=0).mean(), rel=1e-9)
    separation_arcsec = floor["floor_separation_arcsec"]
    assert floor["floor_linear"].shape == floor["floor_square"].shape == (1 + separation_arcsec.size,)
    assert (np.diff(separation_arcsec) > 0).all()


@pytest.mark.parametrize("n_visits", [36, pytest.param(100, marks=pytest.mark.long)])
def test_the_cross_term_of_visits_that_are_drawn(n_visits):
    imager = small_hole("F520")
    squares = (cross_terms(imager, n_visits) ** 2).mean(axis=-1)
    error = squares.std() / squares.mean() / np.sqrt(n_visits)
    assert tables_of(imager)["floor_linear"][0] == pytest.approx(2.0 * squares.mean(), rel=4.0 * error)


def test_the_light_between_the_apertures_that_are_measured():
    """A power of the separation times one of the azimuth, on a whole quadrant and on few apertures."""
    axis = np.arange(13.0, 42.0) * 0.0162

    def light(y, x):
        return np.hypot(y, x) ** -5.0 * (y * x / (y**2 + x**2)) ** -0.3

    for size, measured in ((29, 36), (6, 36), (3, 36)):
        y, x = (part.ravel() for part in np.meshgrid(axis[:size], axis[:size], indexing="ij"))
        y, x = np.tile(y, 4), np.tile(x, 4)
        chosen = measure._sampled(y, x)
        assert len(set(chosen)) == measured
        assert len(set(chosen // size**2)) == 4
        found = measure._everywhere(y, x, chosen, light(y[chosen], x[chosen]))
        np.testing.assert_allclose(found, light(y, x), rtol=5e-3)


@pytest.mark.long
def test_narrow_and_empty_holes():
    def floor_of(outer):
        # past the configuration's own check, which leaves room for an aperture
        narrow = INSTRUMENT.coronagraph.model_copy(update={"outer_half_side_arcsec": outer})
        instrument = INSTRUMENT.model_copy(update={"coronagraph": narrow})
        knobs = Knobs(pupil_samples=64, wavelength_nodes=1, pixel_nodes=1)
        return tables_of(build_imager(instrument, "F520", knobs))

    narrow = floor_of(0.2)  # narrower than the aperture
    for name, part in narrow.items():
        assert np.all(np.isfinite(part) & (part > 0)), name
    with pytest.raises(InputError, match="inner_lambda_d"):
        floor_of(0.1655)  # between two pixel centres


@pytest.fixture(scope="module")
def drawn():
    """F850 through the matched filter and in whole apertures, by direct sums over images of visits of 1 nm.

    Signal over noise of a source in white noise, filter over aperture, by place; sums of the cross term and of the
    light of the errors over the standard deviation of such noise, by visit and place, of filter and of apertures; the
    places' bins.
    """
    metrics, imager = psf_metrics(INSTRUMENT, "F850"), build_imager(INSTRUMENT, "F850")
    pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
    source = single_band_psf("F850", instrument=INSTRUMENT).off_axis
    kernel = matched_kernel(source, metrics.lambda_d_arcsec / pixel)
    lit = np.flatnonzero(metrics.hole.any(axis=0))
    box = np.arange(lit[0], lit[-1] + 1)
    offset = (box - len(metrics.hole) // 2) * pixel
    axis = imager.axis(offset, masked=True)
    images = measure.visit_responses(imager, axis, axis, INSTRUMENT.drift.psd_slope, 200, 8)[1:]
    hole, away = metrics.hole[np.ix_(box, box)], np.abs(offset)
    whole = (away >= metrics.hole_inner_arcsec + radius) & (away <= metrics.hole_outer_arcsec - radius)
    place = np.outer(whole, whole)
    half, fine = len(kernel) // 2, (np.arange(20 * len(kernel)) + 0.5) / 20 - len(kernel) / 2
    disc = np.hypot(fine[:, None], fine) <= radius / pixel
    disc = disc.reshape(len(kernel), 20, len(kernel), 20).mean(axis=(1, 3))

    def sums(image, weights):
        return fftconvolve(image, weights[..., ::-1, ::-1], mode="same", axes=(-2, -1))[..., place]

    noise = np.sqrt(sums(hole.astype(float), kernel**2)), np.sqrt(np.sum(disc**2))
    centre = slice(len(source) // 2 - half, len(source) // 2 + half + 1)
    gain = noise[0] * noise[1] / np.sum(disc * source[centre, centre])
    by_filter, by_aperture = [], []
    for image in images:
        even = image - image[:, hole].mean(axis=1)[:, None, None]
        by_filter.append(sums(image * hole, kernel[None]) / noise[0])
        by_aperture.append(sums(even * hole, disc[None]) / noise[1])
    apart = np.hypot(*np.meshgrid(offset, offset))[place]
    bins = np.abs(np.log(apart[:, None] / metrics.floor_separation_arcsec)).argmin(axis=1)
    return metrics, gain, by_filter, by_aperture, bins


def test_a_filter_sees_a_source_better_than_an_aperture_does(drawn):
    """Within 1 %: a bin holds few of the places that are looked at."""
    metrics, gain, _, _, bins = drawn
    np.testing.assert_allclose(metrics.filter_gain, np.bincount(bins, gain) / np.bincount(bins), rtol=0.01)
    assert (metrics.filter_gain > 1.0).all()


def test_a_filter_sees_the_cross_term_of_visits_that_are_drawn(drawn):
    """The same visits in apertures and through the filter; and fifths of the places, near one separation."""
    metrics, _, (crossed, _), (even, _), bins = drawn
    count, thirds = np.bincount(bins), np.array_split(np.arange(bins.max() + 1), 3)
    for part in thirds:
        mine = np.isin(bins, part)
        groups = [
            np.mean(crossed[rows][:, mine] ** 2) / np.mean(even[rows][:, mine] ** 2)
            for rows in np.array_split(np.arange(200), 8)
        ]
        weight = count[part] * metrics.floor_linear[1:][part]
        expected = np.average(metrics.filter_linear.mean(axis=1)[part], weights=weight)
        assert expected == pytest.approx(np.mean(groups), abs=4.0 * np.std(groups) / np.sqrt(8))
    variance, around = np.mean(crossed**2, axis=0), np.bincount(bins, np.mean(even**2, axis=0)) / count
    fifths = []
    for number in range(3, count.size - 1):
        level = np.sort((variance / around[bins])[np.abs(bins - number) <= 1])
        fifths.append([part.mean() for part in np.array_split(level, 5)])
    # Two hundred visits know a variance to a tenth, by which the ends of an order lie too far out.
    np.testing.assert_allclose(metrics.filter_linear[3:-1].mean(axis=0), np.mean(fifths, axis=0), rtol=0.12)
    assert (np.diff(metrics.filter_linear, axis=1) >= 0.0).all()


def test_a_filter_sees_the_light_of_errors_that_are_drawn(drawn):
    """One number for all places, from 1.2 at the outer corners to 2.2; and its kurtosis, of pairs of visits."""
    metrics, _, (_, light), (_, even), _ = drawn
    ratio = light.var(axis=0) / even.var(axis=0)
    assert metrics.filter_square == pytest.approx(ratio.mean(), rel=0.12)
    pairs = light[:100] - light[100:]
    kurtosis = np.mean(np.mean(pairs**4, axis=0) / np.mean(pairs**2, axis=0) ** 2) - 3.0
    assert metrics.filter_tails == pytest.approx(kurtosis / 3.0, rel=0.2)  # that of a Laplace variate is 3


def test_a_matched_filter_is_the_source_in_a_disc():
    rng = np.random.default_rng(2)
    for side, scale, reach in ((31, 4.2, 7), (31, 4.0, 6), (9, 4.2, 4)):  # ceil(1.5 scale), and a small stamp
        source = rng.uniform(1.0, 2.0, (side, side))
        kernel, middle = matched_kernel(source, scale), side // 2
        assert kernel.shape == (2 * reach + 1, 2 * reach + 1)
        cut = source[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]
        rows, columns = np.indices(kernel.shape) - reach
        inside = rows**2 + columns**2 <= (1.5 * scale + 0.5) ** 2
        np.testing.assert_array_equal(kernel, np.where(inside, cut, 0.0))


def test_smoothness_of_a_gaussian_filter():
    """Correlation ``exp(-d^2 / 4 w^2)``: its square summed over the plane, and the curvature at its top."""
    width, axis = 2.5, np.arange(-20, 21)
    kernel = np.exp(-(axis[:, None] ** 2 + axis**2) / (2.0 * width**2))
    assert kernel_smoothness(kernel) == pytest.approx((2.0 * np.pi * width**2, 1.0 / (2.0 * width**2)), rel=1e-6)


def test_smoothness_of_white_noise_that_is_filtered():
    """The scatter of the mean square of fields of noise, and the correlation of neighbours in them."""
    metrics = psf_metrics(INSTRUMENT, "F662")
    source = single_band_psf("F662", instrument=INSTRUMENT).off_axis
    kernel = matched_kernel(source, metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec)
    assert kernel_smoothness(kernel) == pytest.approx((metrics.filter_positions, metrics.filter_roughness), rel=1e-5)
    side, n = 64, 2000
    through = np.fft.rfft2(kernel, (side, side))
    fields = np.random.default_rng(4).standard_normal((n, side, side))
    fields = np.fft.irfft2(np.fft.rfft2(fields) * through)
    power = np.mean(fields**2, axis=(1, 2))
    positions = power.var() / power.mean() ** 2 * side**2 / 2.0
    assert metrics.filter_positions == pytest.approx(positions, rel=4.0 * np.sqrt(2.0 / n))
    beside = np.mean(fields * np.roll(fields, 1, axis=2)) / power.mean()
    assert metrics.filter_roughness == pytest.approx(-2.0 * np.log(beside), rel=0.01)


SLOPE = 2.5


class Hole:
    """A hole of a few apertures that no mirror digs, past the configuration's own check."""

    def __init__(self, **knobs):
        instrument = load_instrument({"dark_hole": {"control": "off"}})
        narrow = instrument.coronagraph.model_copy(update={"outer_half_side_arcsec": 0.36})
        instrument = instrument.model_copy(update={"coronagraph": narrow})
        self.imager = build_imager(instrument, "F520", Knobs(pupil_samples=64, wavelength_nodes=2, **knobs))
        zone, pixel = self.imager.zone, self.imager.pixel_scale_arcsec
        side = np.arange(np.floor(zone.inner_arcsec / pixel), np.ceil(zone.outer_arcsec / pixel) + 1) * pixel
        y, x = zone.axes(side)
        self.axes = self.imager.axis(y, masked=True), self.imager.axis(x, masked=True)
        self.inside = zone.covers(y, x)
        self.weights = overlap_weights(self.imager.aperture_radius_arcsec / pixel)
        self.mean = self.inside * (self.weights.sum() / self.inside.sum())
        first, last = len(side), 2 * len(side) - len(self.weights)  # in the quadrant of x and y above 0
        self.corners = [(first, first), (first, last), (last, last)]
        self.apertures = [(*corner, self.weights) for corner in self.corners]

    def sums(self, images):
        """Aperture sums less the mean of the hole, by the general code, shape (..., 3)."""
        half = len(self.weights) // 2
        sums = aperture_sums(images, self.weights)
        less = images[..., self.inside].mean(axis=-1) * self.weights.sum()
        return np.stack([sums[..., y + half, x + half] - less for y, x in self.corners], axis=-1)

    def variance(self):
        light = ErrorLight(self.imager, self.axes, SLOPE)
        return light_variance(light, light, self.mean, self.apertures)


@pytest.mark.long
def test_the_variance_is_that_of_the_form_of_all_waves(monkeypatch):
    """``M = Re(F^H W F)`` of the fields of all waves, and ``2 tr M^2``; waves up to 1.5 cycles."""
    hole = Hole(pixel_nodes=2)
    model = screen_model(len(hole.imager.transmission), SLOPE)
    low = np.hypot(*np.indices(model.amplitude.shape) - np.array([[[0]], [[63]]])) < 3.5
    few = dataclasses.replace(model, amplitude=np.where(low, model.amplitude, 0.0))
    monkeypatch.setattr(measure, "screen_model", lambda samples, slope: few)
    for name in ("FAINT", "APART"):
        monkeypatch.setattr(measure, name, 0.0)
    grid, screens = hole.imager.focal_grid(*hole.axes), []
    for place in np.argwhere(few.amplitude > 0):
        for part in range(2):
            unit = np.zeros((2, *few.amplitude.shape))
            unit[(part, *place)] = 1.0
            screens.append(few.draw(SimpleNamespace(standard_normal=lambda shape, unit=unit: unit), 1.0))
    waves = len(screens)
    assert 20 < waves <= measure.PROBES
    forms = np.zeros((waves, waves, 3))
    for index, (wavelength, weight) in enumerate(zip(hole.imager.wavelengths_m, hole.imager.weights, strict=True)):
        pupil = 2.0 * np.pi / (wavelength * 1e9) * hole.imager.pupil(index)
        fields = np.array([grid.transformed(index, pupil * screen) for screen in screens])
        for one, field in enumerate(fields):
            light = grid.pixels((field.conj() * fields).real) * hole.imager.pixel_solid_angle_sr
            forms[one] += weight * hole.sums(light)
    np.testing.assert_allclose(hole.variance(), 2.0 * (forms**2).sum(axis=(0, 1)), rtol=1e-9)


@pytest.mark.parametrize("visits", [300, pytest.param(1500, marks=pytest.mark.long)])
def test_the_variance_of_visits_that_are_drawn(visits):
    hole = Hole(pixel_nodes=1)
    _, _, light = visit_responses(hole.imager, *hole.axes, SLOPE, visits, 5)
    sums = hole.sums(light)
    squares = (sums - sums.mean(axis=0)) ** 2
    error = squares.std(axis=0) / visits**0.5
    assert np.all(np.abs(squares.mean(axis=0) - hole.variance()) < 3.5 * error)
    assert np.all(error < 0.15 * (1500 / visits) ** 0.5 * squares.mean(axis=0))


def test_apertures_are_sums_of_their_readings():
    """Light of one screen by readings of the pupil, by transform of the whole grid and by the waves' form."""
    hole = Hole(pixel_nodes=2)
    light = ErrorLight(hole.imager, hole.axes, SLOPE)
    waves = stream(3, "waves").standard_normal((1, 128, 128))
    screen = light.screens.screens(waves)
    for row, column, weights in hole.apertures:
        everywhere = np.zeros(hole.inside.shape)
        everywhere[row : row + len(weights), column : column + len(weights)] = weights
        whole = light.light(screen, everywhere)[0]
        by_mode = np.einsum("myx,yx->m", light.readings(row, column, weights), screen[0])
        assert (by_mode**2).sum() == pytest.approx(whole, rel=1e-3)
        assert (waves * light.product(waves, everywhere)).sum() == pytest.approx(whole, rel=1e-9)
