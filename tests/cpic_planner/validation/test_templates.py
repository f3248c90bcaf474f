"""Where images show a planet: everywhere the calculator answers, from corner to corner and along the edges."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from cpic_core import Status
from cpic_planner.etc import build_model, place_status, planet_offsets, usable_range_arcsec
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from cpic_planner.validation import aperture_weights
from cpic_planner.validation.measure import obstacle, pixels_of, place_at
from cpic_planner.validation.photometry import outside_discs, radius_pixel, sample_places, sample_scatter
from simulator import load_instrument
from simulator.target import detector_to_sky, sky_to_detector

PRESETS = {name: load_instrument(name) for name in ("cpic_default", "cpic_2q")}
BANDS = ("F520", "F662", "F720", "F850")
STAR = find_target("tau Cet")[0]


@functools.cache
def model_of(preset, band, **reduction):
    return build_model(PRESETS[preset], [band], Strategy(**reduction))


def places_of(model, band, separation_arcsec):
    """Where a planet of the calculator stands at the rolls that the library shows it at."""
    x, y = planet_offsets(model, STAR, band, np.array([[separation_arcsec]]))
    rho, pa_deg = detector_to_sky(x.item(), y.item())
    rolls = model.strategy.rolls_deg
    return tuple(
        tuple(float(part) for part in sky_to_detector(rho, pa_deg, roll_deg=roll - rolls[0])) for roll in rolls
    )


def hidden(model, band, places):
    geometry = model.metrics[band].geometry
    return obstacle(place_at(geometry, model.strategy, "b", places), geometry, model.strategy)


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize(
    ("preset", "reduction"),
    [
        ("cpic_default", {}),
        ("cpic_default", {"filter": "matched"}),
        ("cpic_default", {"filter": "mirror"}),
        ("cpic_default", {"filter": "whitened"}),
        ("cpic_default", {"n_modes": 4}),
        ("cpic_default", {"library": "roll"}),
        ("cpic_2q", {}),
    ],
    ids=lambda value: "-".join(map(str, value.values())) if isinstance(value, dict) else value,
)
def test_what_the_calculator_answers_images_can_measure(preset, band, reduction):
    model = model_of(preset, band, **reduction)
    geometry, turn_deg = model.metrics[band].geometry, max(model.strategy.rolls_deg)
    inner, outer = geometry.zone.usable_range_arcsec(geometry.aperture_radius_arcsec, turn_deg)
    near = [inner, inner + 2e-3, inner + 8e-3, inner + 0.02, *np.linspace(inner, outer, 6)[1:-1]]
    near += [outer - 0.02, outer - 4e-3, outer]
    answered = [at for at in near if place_status(model, band, at)[0] is Status.OK]
    assert len(answered) >= 4
    for separation in answered:
        assert hidden(model, band, places_of(model, band, separation)) is None, separation


@pytest.mark.parametrize("band", BANDS)
def test_a_place_outside_is_refused_by_both_for_one_reason(band):
    model = model_of("cpic_default", band)
    inner, outer = usable_range_arcsec(model.instrument, band)
    for separation in (0.8 * inner, 1.1 * outer):
        reason, _ = hidden(model, band, places_of(model, band, separation))
        assert (Status.OUTSIDE_FIELD, reason) == place_status(model, band, separation)[:2]


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_apertures_that_touch_the_edges_are_measured(band, share):
    """Along the inner and the outer edge of a quadrant, beside both axes, in two quadrants."""
    model = model_of("cpic_default", band)
    geometry = model.metrics[band].geometry
    low = geometry.zone.inner_arcsec + geometry.aperture_radius_arcsec
    high = geometry.zone.outer_arcsec - geometry.aperture_radius_arcsec
    along = low + share * (high - low)
    for x, y in ((low, along), (along, -low), (high, -along), (-along, high)):
        assert hidden(model, band, ((x, y),)) is None, (x, y)


@pytest.mark.parametrize("band", BANDS)
def test_apertures_of_the_corners_do_not_overlap(band):
    """Three or more side by side at the inner corner, in the background and without the planet."""
    model = model_of("cpic_default", band)
    geometry, (place,) = (
        model.metrics[band].geometry,
        places_of(model, band, usable_range_arcsec(model.instrument, band)[0]),
    )
    planet = place_at(geometry, model.strategy, "b", (place,))
    radius, side = radius_pixel(geometry), geometry.stamp_pixels
    free = planet.around(geometry.hole, geometry, "aperture")
    np.testing.assert_array_equal(free, outside_discs(planet.background, [pixels_of(geometry, place)], 1.5 * radius))
    kernel = aperture_weights((9, 9), 4.0, 4.0, radius)
    y, x, grid, n = sample_places(free, radius, kernel)
    assert n == np.bincount(grid).max() >= 3
    for number in np.unique(grid):
        own = [
            aperture_weights((side, side), *at, radius) for at in zip(x[grid == number], y[grid == number], strict=True)
        ]
        assert np.sum(own, axis=0).max() <= 1.0 + 1e-9
        assert not np.any(np.sum(own, axis=0)[~free] > 0.0)


def test_the_scatter_of_the_corners_is_that_of_white_noise():
    """Of apertures with weights at their rims, over many images; the variance is unbiased."""
    geometry = model_of("cpic_default", "F520").metrics["F520"].geometry
    model, radius = model_of("cpic_default", "F520"), radius_pixel(geometry)
    planet = place_at(geometry, model.strategy, "b", places_of(model, "F520", 0.3))
    free, rng = planet.around(geometry.hole, geometry, "aperture"), np.random.default_rng(1)
    found = [sample_scatter(rng.standard_normal(free.shape), free, radius)[0] ** 2 for _ in range(200)]
    weights = aperture_weights((9, 9), 4.0, 4.0, radius)
    assert np.mean(found) == pytest.approx(np.sum(weights**2), abs=4.0 * np.std(found) / np.sqrt(200))


def test_a_source_in_the_way_widens_the_background():
    """A quadrant full of other sources leaves fewer apertures at the corner: those farther out are taken."""
    model = model_of("cpic_default", "F520")
    geometry, place = model.metrics["F520"].geometry, places_of(model, "F520", 0.3)
    beside = [(-0.21, 0.21), (-0.21, -0.21)]
    alone, crowded = (place_at(geometry, model.strategy, "b", place, others) for others in ((), beside))
    assert obstacle(crowded, geometry, model.strategy) is None
    width = [np.hypot(*np.argwhere(one.background).T - geometry.stamp_pixels // 2).max() for one in (alone, crowded)]
    assert width[1] > width[0] + 0.2 * geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec
    nowhere = replace(crowded, background=np.zeros_like(crowded.background))
    assert obstacle(nowhere, geometry, model.strategy)[0].value == "too_few_resolution_elements"
