"""The whitened filter on images whose covariance is known, at its place, at other places and at the edge."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from cpic_core import InputError
from cpic_planner.queries import Strategy
from cpic_planner.validation import StarFlux, aperture_weights, planet_templates
from cpic_planner.validation.measure import (
    SpeckleModel,
    WhitenedFilter,
    forced_photometry,
    measure_planets,
    reduced_around,
)
from simulator import load_instrument
from simulator.signal import unit_parts
from tests.cpic_planner.validation.two_planets import scene_of, visits_of

WHITE_E2, STRENGTH_E = 9.0, 1500.0


@functools.cache
def prepared(**drift):
    instrument = load_instrument({"drift": drift} if drift else None)
    visits = visits_of(scene_of((0.42, 315), (0.45, 330)), fidelity="quick", realisations=1, instrument=instrument)
    return visits, planet_templates(visits), visits.draw(0)


@pytest.fixture
def smooth(monkeypatch):
    """Speckles of 400 smooth patches in the annulus: a function that draws them, and the model that knows them."""
    visits = prepared()[0]
    geometry = visits.geometry
    hole = geometry.hole
    rows, columns = np.nonzero(hole)
    rng = np.random.default_rng(4)
    middles = rng.choice(np.flatnonzero(geometry.annulus(0.43, 4.0)[hole]), 400, replace=False)
    away = np.hypot(rows - rows[middles, None], columns - columns[middles, None])
    patches = 4.0 * np.exp(-0.5 * (away / 2.2) ** 2)

    def known(_instrument, _band, separation, linear, _square):
        part = patches[:, geometry.annulus(separation, 2.4)[hole]]
        return linear * part.T @ part

    monkeypatch.setattr("cpic_planner.validation.measure.speckle_covariance", known)

    def draw(n):
        image = np.zeros((n, *hole.shape))
        image[:, hole] = rng.standard_normal((n, 400)) @ patches + 3.0 * rng.standard_normal((n, rows.size))
        return image

    return draw, SpeckleModel(visits.instrument, "F520", 1.0, 1.0, 1.0)


def stack_of(image, white_e2=WHITE_E2, region=None):
    """A stack of this image without modes or gain."""
    visits, _, realised = prepared()
    hole = visits.geometry.hole if region is None else region
    return replace(
        realised.reduced,
        image_e=np.where(hole, image, 0.0),
        region=hole,
        white_variance_e2=np.where(hole, white_e2, 0.0),
        factor2=1.0,
    )


def filter_of(planet, model, stack, **changes):
    geometry = prepared()[0].geometry
    pixel, middle = geometry.pixel_scale_arcsec, geometry.stamp_pixels // 2
    x, y = planet.places_arcsec[0]
    settings = {"background_region": planet.background & stack.region, "neighbours": planet.neighbours} | changes
    place = middle + x / pixel, middle + y / pixel
    return WhitenedFilter(stack, planet.templates[0], place, geometry=geometry, model=model, **settings)


def test_flux_is_unbiased_and_its_error_that_of_many_draws(smooth):
    draw, model = smooth
    _, (planet, other), realised = prepared()
    light, rng = 30.0 * STRENGTH_E * other.templates[0] + 20.0, np.random.default_rng(6)
    stacks = [stack_of(image + light + rng.poisson(STRENGTH_E * planet.templates[0])) for image in draw(200)]
    fitted = filter_of(planet, model, stacks[0])
    found = [fitted.photometry(stack) for stack in stacks]
    flux, sigma, error = (
        np.array([getattr(one, key) for one in found]) for key in ("flux", "sigma_background", "error")
    )
    scatter, expected = flux.std(ddof=1), STRENGTH_E * planet.core
    assert abs(flux.mean() - expected) < 4.0 * scatter / np.sqrt(200)
    # The planet's own electrons, which are drawn too, count in the error and not in the noise of their surroundings.
    assert scatter == pytest.approx(np.sqrt((error**2).mean()), rel=4.0 / np.sqrt(400))
    assert np.sqrt((sigma**2).mean()) == pytest.approx(fitted.sigma_e, rel=0.05)
    assert np.all(error**2 > sigma**2 + 0.3 * flux)
    # As well known as so many apertures side by side tell it.
    freedom = found[0].n_background_apertures - 1
    assert (sigma**2).std() / (sigma**2).mean() < 1.3 * np.sqrt(2.0 / freedom)
    assert found[0].error_rel_uncertainty == pytest.approx(1.0 / np.sqrt(2.0 * freedom))
    assert found[0].significance == pytest.approx(found[0].flux / found[0].sigma_background)
    plain = [
        forced_photometry(replace(realised, reduced=stack), planet, prepared()[0].geometry) for stack in stacks[:40]
    ]
    assert np.mean([one.sigma_background / one.throughput for one in plain]) > 1.15 * fitted.sigma_e


def test_a_model_of_the_wrong_size_gives_the_same_error(smooth):
    draw, model = smooth
    planet = prepared()[1][0]
    stack = stack_of(draw(1)[0])
    right = filter_of(planet, model, stack).photometry(stack)
    scaled = stack_of(stack.image_e, white_e2=100.0 * WHITE_E2)
    wrong = filter_of(planet, replace(model, star_e=10.0), scaled).photometry(stack)
    assert wrong.flux == pytest.approx(right.flux, rel=1e-6)
    assert wrong.sigma_background == pytest.approx(right.sigma_background, rel=1e-6)


@pytest.mark.parametrize("white_e2", [WHITE_E2, 0.0])
def test_without_drift_it_is_the_matched_filter(white_e2):
    """With white noise; and where there is no noise at all, the image alone tells the error."""
    visits, (planet, _), _ = prepared()
    model = replace(SpeckleModel.of(visits, 1e6), linear_nm2=0.0, square_nm4=0.0)
    rng = np.random.default_rng(8)
    image = np.sqrt(WHITE_E2) * rng.standard_normal(visits.geometry.hole.shape) + STRENGTH_E * planet.templates[0]
    stack = stack_of(image, white_e2)
    fitted = filter_of(planet, model, stack, neighbours=())
    found = fitted.photometry(stack)
    region = visits.geometry.annulus(float(np.hypot(*planet.places_arcsec[0])), 2.4)
    template = planet.templates[0][region]
    template = template - template.mean()
    strength = template @ image[region] / (template @ template)
    assert found.flux == pytest.approx(planet.core * strength, rel=1e-9)
    expected = planet.core * np.sqrt(WHITE_E2 / (template @ template))
    assert found.sigma_background == pytest.approx(expected, rel=0.3)
    if white_e2 > 0.0:
        assert fitted.sigma_e == pytest.approx(expected, rel=1e-9)


def test_a_planet_at_the_edge_and_too_few_pixels(smooth):
    draw, model = smooth
    visits, (planet, _), _ = prepared()
    geometry = visits.geometry
    # As near to the mask as a planet is measured: a tenth of its aperture is cut off.
    hole = geometry.hole.copy()
    rows, columns = np.nonzero(planet.apertures[0])
    hole[: rows.min() + 1] &= np.indices(hole.shape)[1][: rows.min() + 1] < columns.min()
    light = STRENGTH_E * planet.templates[0]
    stacks = [stack_of(image + light, region=hole) for image in draw(100)]
    fitted = filter_of(planet, model, stacks[0])
    flux = np.array([fitted.photometry(stack).flux for stack in stacks])
    assert abs(flux.mean() - STRENGTH_E * planet.core) < 4.0 * flux.std() / 10.0
    assert flux.std() == pytest.approx(fitted.sigma_e, rel=0.3)
    small = geometry.hole & (np.indices(hole.shape)[0] < rows.max()) & (np.indices(hole.shape)[0] > rows.min())
    few = small & (np.indices(hole.shape)[1] < columns.max() + 12) & (np.indices(hole.shape)[1] > columns.min() - 12)
    with pytest.raises(InputError, match="background_region"):
        filter_of(planet, model, stack_of(light, region=few))


def test_modes_that_were_subtracted_take_nothing_of_the_planet(smooth):
    _, model = smooth
    visits, (planet, _), realised = prepared()
    few = replace(visits, strategy=visits.strategy.model_copy(update={"n_modes": 3, "filter": "whitened"}))
    library = np.random.default_rng(2).standard_normal((6, *visits.geometry.hole.shape))
    inputs = realised.reduced.inputs._replace(library_e=library)
    drawn = replace(realised, reduced=replace(realised.reduced, inputs=inputs))
    stack = reduced_around(drawn, planet, few).reduced
    assert stack.rdi.modes_used == 3
    alone = replace(stack, image_e=STRENGTH_E * stack.rdi.project(planet.templates[0]))
    found = filter_of(planet, model, stack).photometry(alone)
    assert found.flux == pytest.approx(STRENGTH_E * planet.core, rel=1e-6)
    assert found.sigma_background < 1e-6 * found.flux


def test_the_model_of_a_programme_is_what_its_wavefronts_leave():
    visits = prepared(visit_nm=0.05, walk_nm_per_sqrt_hour=0.2)[0]
    model = SpeckleModel.of(visits, 1e6)
    hours = (4.0 + visits.science.readout_s) * 60 / 3600.0
    walk = 0.2**2 * hours / 3.0
    assert model.linear_nm2 == pytest.approx(2.0 * (0.05**2 + walk), rel=1e-9)
    assert model.square_nm4 == pytest.approx(2.0 * (0.05**4 + 2.0 * 0.05**2 * walk + 1.5 * walk**2), rel=1e-9)
    assert model.star_e == 1e6 * 4.0 * 60
    many = replace(visits, plan=replace(visits.plan, visits=4, reference_visits=8))
    later = SpeckleModel.of(many, 1e6)
    half = 0.05**2 / 4 + 0.05**2 / 8 + walk / 4 + walk * (4 / 8) / 8
    assert later.linear_nm2 == pytest.approx(half, rel=1e-9)
    assert later.star_e == 4.0 * model.star_e
    assert SpeckleModel.of(replace(visits, plan=replace(visits.plan, noise_free=True)), 1e6).linear_nm2 == 0.0
    one, two = unit_parts(visits.instrument.drift)
    assert one.law().variance(0.0) == pytest.approx(2.0 * 0.05**2)
    assert two.law().variance(0.0) == pytest.approx(2.0 * 0.05**4)


def test_images_are_measured_with_it_where_the_strategy_says_so(smooth):
    visits, planets, realised = prepared()
    asked = replace(visits, strategy=visits.strategy.model_copy(update={"filter": "whitened"}))
    rate = visits.science.truth.sources[0].rate_e_s
    star = StarFlux(rate, 0.0, "off_mask")
    found, _ = measure_planets(asked, realised, planets, star, searched=False)
    for one, source, planet in zip(found, visits.science.truth.sources[1:], planets, strict=True):
        assert abs(one.contrast - source.contrast) < 5.0 * one.contrast_error
        assert one.throughput == 1.0
        radius = visits.geometry.aperture_radius_arcsec / visits.geometry.pixel_scale_arcsec
        middle, pixel = visits.geometry.stamp_pixels // 2, visits.geometry.pixel_scale_arcsec
        x, y = (middle + part / pixel for part in planet.places_arcsec[0])
        weights = aperture_weights(realised.reduced.image_e.shape, x, y, radius)
        assert one.contrast > 0.3 * np.sum(weights * realised.reduced.image_e) / (
            planet.core * rate * realised.reduced.integration_s
        )
    for refused, key in (({"library": "roll"}, "filter"), ({"choose_modes": True}, "choose_modes")):
        with pytest.raises(ValueError, match=key):
            Strategy(filter="whitened", **refused)
