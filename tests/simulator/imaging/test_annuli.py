"""Light where the noise of a planet is measured, against images: of the star, of wavefront errors, of the planet."""

import dataclasses

import numpy as np
import pytest

from cpic_planner.queries import Strategy
from cpic_planner.validation.measure import pixels_of, place_at, radius_pixel
from cpic_planner.validation.photometry import kernel_at, sample_places
from cpic_planner.validation.rdi import surviving_fraction
from simulator.config import load_instrument
from simulator.imaging import (
    aperture_sums,
    build_imager,
    error_halo,
    light_around,
    overlap_weights,
    psf_metrics,
    single_band_psf,
    visit_responses,
)
from simulator.imaging.drift import screen_model, spectrum

INSTRUMENT = load_instrument()
BANDS = INSTRUMENT.visible_bands()
SLOPE, WIDTH = INSTRUMENT.drift.psd_slope, Strategy().annulus_lambda_d
SEPARATIONS = (0.55, 0.65, 0.75)


def errors_of(band):
    return {"psd_slope": SLOPE, "wavelength_nm": INSTRUMENT.band(band).center_nm}


@pytest.fixture(scope="module", params=[BANDS[0], *(pytest.param(band, marks=pytest.mark.long) for band in BANDS[1:])])
def seen(request):
    """A band, its metrics and PSF, and the offsets of pixels."""
    psf = single_band_psf(request.param, instrument=INSTRUMENT)
    return request.param, psf_metrics(INSTRUMENT, request.param), psf


def sums_of(image, metrics):
    return aperture_sums(image, overlap_weights(metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec))


def test_mean_starlight_of_the_apertures_around_a_planet(seen):
    """Of all apertures of which photometry takes the scatter, in images of the star: 7 % of it is 0.2 % of an SNR."""
    band, metrics, psf = seen
    sums, geometry = sums_of(psf.on_axis, metrics), psf.geometry
    for separation in SEPARATIONS:
        for sign_x, sign_y in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
            x, y = (sign * separation / np.sqrt(2.0) for sign in (sign_x, sign_y))
            place = place_at(geometry, Strategy(), "planet", ((x, y),))
            free, radius = place.around(geometry.hole, geometry, "aperture"), radius_pixel(geometry)
            row, column, *_ = sample_places(
                free, radius, kernel_at(place.apertures[0], *pixels_of(geometry, (x, y)), radius + 1.0)
            )
            found = light_around(metrics, WIDTH, x, y, **errors_of(band)).star
            assert float(found) == pytest.approx(sums[row, column].mean(), rel=0.07)


def test_light_of_wavefront_errors_is_the_mean_of_propagated_screens(seen):
    """Transforms of 150 random screens; the closed form has up to 6 % more, for the screens are steps on the pupil."""
    band, metrics, psf = seen
    imager = build_imager(INSTRUMENT, band)
    _, _, light = visit_responses(imager, imager.stamp_axis(masked=True), imager.stamp_axis(masked=True), SLOPE, 150, 3)
    side, pixel = len(psf.on_axis), metrics.pixel_scale_arcsec
    offset = (np.arange(side) - side // 2) * pixel
    y, x = np.broadcast_arrays(offset[:, None], offset)
    inside = metrics.zone.covers(offset, offset, -metrics.aperture_radius_arcsec)
    each = np.array([sums_of(image, metrics)[inside] for image in light])
    closed, separation = error_halo(metrics, x[inside], y[inside], **errors_of(band)), np.hypot(x, y)[inside]
    for low in (0.4, 0.55, 0.7):
        ring = (separation >= low) & (separation < low + 0.15)
        mean = each[:, ring].mean(axis=1)
        error = mean.std(ddof=1) / np.sqrt(len(mean))
        assert abs(closed[ring].mean() / 1.03 - mean.mean()) < 0.03 * mean.mean() + 4.0 * error


def test_light_of_errors_around_a_planet_is_their_mean_there(seen):
    band, metrics, _ = seen
    for separation in SEPARATIONS:
        x = separation / np.sqrt(2.0)
        around = float(light_around(metrics, WIDTH, x, x, **errors_of(band)).errors)
        circle = separation * np.exp(1j * np.pi * (np.arange(36) + 0.5) / 18.0)
        assert around == pytest.approx(error_halo(metrics, circle.real, circle.imag, **errors_of(band)).mean(), rel=0.2)


def test_what_the_mean_of_the_background_leaves_of_a_planet(seen):
    """That of its image, by the pixels that photometry takes for its background."""
    band, metrics, psf = seen
    for separation in SEPARATIONS:
        x = separation / np.sqrt(2.0)
        place = place_at(psf.geometry, Strategy(), "planet", ((x, x),))
        image, background = psf.at(x, x), place.around(psf.geometry.hole, psf.geometry, "aperture")
        expected = surviving_fraction("template", image, image, place.apertures[0], background)
        found = float(light_around(metrics, WIDTH, x, x, **errors_of(band)).planet_left)
        assert found == pytest.approx(expected, abs=0.004)
        assert found < 0.997


def test_the_power_of_waves_is_that_of_screens():
    """Their sum is the mean square of a screen that keeps its piston, tip and tilt."""
    frequency, power = spectrum(SLOPE)
    model, rng = screen_model(64, SLOPE), np.random.default_rng(5)
    whole = dataclasses.replace(model, removed=np.zeros_like(model.removed), planes=np.zeros_like(model.planes))
    drawn = [np.mean(whole.draw(rng, 1.0) ** 2) for _ in range(400)]
    assert np.mean(drawn) == pytest.approx(power.sum(), abs=4.0 * np.std(drawn) / 20.0)
    np.testing.assert_array_equal(power, power[::-1, ::-1])
    assert frequency[0] == -frequency[-1] == -31.5
    assert power[63, 63] == 0.0
