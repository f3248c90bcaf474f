"""Measuring one realisation: who is a subject, what stands in the way, and what the search has to do with it."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.queries import Strategy
from cpic_planner.validation import StarFlux, planet_templates
from cpic_planner.validation.confirm import _false, positions_of
from cpic_planner.validation.measure import (
    SpeckleModel,
    forced_photometry,
    measure_planets,
    obstacle,
    pixels_of,
    searcher_of,
)
from cpic_planner.validation.rdi import rdi_subtract, smoothed
from cpic_planner.validation.search import MATCH_LAMBDA_D, matched_sum
from simulator import load_instrument
from simulator.signal import REGION_LAMBDA_D
from tests.cpic_planner.validation.two_planets import scene_of, visits_of

SCENE = scene_of((0.5, 315), (0.52, 335))


@functools.cache
def prepared():
    visits = visits_of(SCENE, fidelity="standard", realisations=1)
    return visits, planet_templates(visits)


def star():
    rate = prepared()[0].science.truth.sources[0].rate_e_s
    return StarFlux(rate, 0.0, "off_mask")


def test_subjects_stand_where_the_scene_puts_them():
    visits, subjects = prepared()
    assert [subject.name for subject in subjects] == ["b", "c"]
    pixel, middle = visits.geometry.pixel_scale_arcsec, len(visits.geometry.hole) // 2
    for subject, source in zip(subjects, visits.science.truth.sources[1:], strict=True):
        assert subject.places_arcsec[0] == (source.x_arcsec, source.y_arcsec)
        # The window's own pixel of the source is that of the stamp.
        row = subjects.index(subject) + 1
        assert middle + source.x_arcsec / pixel == pytest.approx(visits.science.truth.x_pixel[row])
        assert subject.core == pytest.approx(
            float(visits.optics.metrics.core_throughput(source.x_arcsec, source.y_arcsec)), rel=0.02
        )


def test_a_search_knows_the_stripes_of_a_companions_wings():
    """White noise as the search takes it, beside the variance of the photons that the references show."""
    beside = {"name": "companion", "magnitude": 2.0, "spectral_type": "K5V", "separation_arcsec": 3.0, "pa_deg": 20.0}
    scene = SCENE | {"planets": SCENE["planets"][:1], "stars": [beside | {"companion": True}]}
    visits = visits_of(scene, bands=("F720",), n_frames=600)
    stack, rate = visits.draw(0).reduced, visits.science.truth.sources[0].rate_e_s
    dark = replace(visits)
    dark.__dict__["known_light_e_s"] = np.zeros(stack.region.shape)

    def apart(pair):
        field = searcher_of(pair, stack, rate)
        # Photons are counted over 1.5 pixels.
        white = smoothed(field.unfold(field.terms.white), stack.region)[stack.region]
        return np.std(white / stack.white_variance_e2[stack.region])

    assert apart(visits) < 0.1
    assert apart(dark) > 0.25


def test_noise_of_few_photons_is_alike_on_both_sides():
    """Its weights come from no photons that are in the residual, which is bright where the references were dark."""
    calm = {"drift": {"visit_nm": 1e-4, "walk_nm_per_sqrt_hour": 1e-4, "orbital_nm": 0}}
    faint = {"cstar": SCENE["cstar"] | {"v_mag": 6.0}, "planets": []}
    frames = {"bands": ("F662",), "exposure_s": 74.0, "n_frames": 40, "em_gain": 480.0}
    visits, filtered = visits_of(SCENE | faint, instrument=load_instrument(calm), **frames), []
    rate = visits.science.truth.sources[0].rate_e_s
    for number in range(60):
        stack = visits.draw(number).reduced
        filtered.append(searcher_of(visits, stack, rate).measure(stack.image_e).snr)
    values = np.stack(filtered)
    assert abs(float(np.mean((values - values.mean()) ** 3) / values.std() ** 3)) < 0.07


@pytest.mark.long
def test_neighbours_do_not_count_as_background():
    visits, (first, second) = prepared()
    aperture = visits.geometry.aperture_radius_arcsec / visits.geometry.pixel_scale_arcsec
    rows, columns = np.indices(first.background.shape)
    x, y = first.others[0]
    assert not first.background[np.hypot(columns - x, rows - y) < 1.4 * aperture].any()
    measured = [forced_photometry(visits.draw(0), subject, visits.geometry) for subject in (first, second)]
    lit = replace(first, background=visits.geometry.annulus(0.5, 1.5), others=())
    assert forced_photometry(visits.draw(0), lit, visits.geometry).sigma_background > 1.5 * measured[0].sigma_background


def test_both_planets_are_found_and_placed():
    visits, subjects = prepared()
    realised = visits.draw(1)
    measured, blind = measure_planets(visits, realised, subjects, star())
    for item, subject, source in zip(measured, subjects, visits.science.truth.sources[1:], strict=True):
        assert item.found
        assert item.search_snr > item.search_threshold
        assert abs(item.contrast - source.contrast) < 5 * item.contrast_error
        assert item.contrast_sigma < item.contrast_error
        place = positions_of(visits, realised, blind, subject)
        assert np.hypot(place.x_arcsec - source.x_arcsec, place.y_arcsec - source.y_arcsec) < 0.01
    nowhere = replace(subjects[0], places_arcsec=((-0.5, -0.5),))
    assert positions_of(visits, realised, blind, nowhere) is None


def test_a_detection_elsewhere_is_not_the_planet():
    visits, subjects = prepared()
    realised = visits.draw(2)
    aside = 1.2 * MATCH_LAMBDA_D * visits.geometry.lambda_d_arcsec
    x, y = subjects[0].places_arcsec[0]
    moved = replace(subjects[0], places_arcsec=((x, y - aside),))
    (item, _), _ = measure_planets(visits, realised, (moved, subjects[1]), star())
    assert not item.found


def test_detections_of_known_sources_are_not_false():
    visits, subjects = prepared()
    _, blind = measure_planets(visits, visits.draw(1), subjects, star())
    assert len(blind.detections) >= 2
    assert _false(blind, visits) == len(blind.detections) - 2
    alone = replace(
        visits,
        science=replace(visits.science, truth=replace(visits.science.truth, sources=visits.science.truth.sources[:1])),
    )
    assert _false(blind, alone) == len(blind.detections)


def test_what_limits_take_away_is_not_measured():
    visits, subjects = prepared()
    realised = visits.draw(0)
    region = realised.reduced.region.copy()
    region[subjects[0].apertures[0] > 0] = False
    stack = replace(realised.reduced, region=region, image_e=np.where(region, realised.reduced.image_e, 0.0))
    measured, _ = measure_planets(visits, replace(realised, reduced=stack), subjects, star())
    assert measured[0] is None
    assert measured[1] is not None


def test_what_stands_in_the_way_of_a_planet_is_named():
    visits, (planet, _) = prepared()
    assert obstacle(planet, visits.geometry, visits.strategy) is None
    crowded = replace(planet, background=np.zeros_like(planet.background))
    assert obstacle(crowded, visits.geometry, visits.strategy)[0].value == "too_few_resolution_elements"
    pixel = visits.geometry.pixel_scale_arcsec
    for apart, named in ((0.9, "source_on_place"), (1.1, None)):
        x, y = pixels_of(visits.geometry, planet.places_arcsec[0])
        beside = replace(planet, others=((x, y + apart * visits.geometry.lambda_d_arcsec / pixel),))
        found = obstacle(beside, visits.geometry, visits.strategy)
        assert (found and found[0].value) == named
    corner = visits.geometry.zone.outer_arcsec
    behind = replace(planet, places_arcsec=((0.0, 0.4),), apertures=(np.roll(planet.apertures[0], 30, axis=1),))
    beyond = replace(behind, places_arcsec=((corner, corner),))
    reasons = [obstacle(one, visits.geometry, visits.strategy)[0].value for one in (behind, beyond)]
    assert reasons == ["inside_inner_edge", "outside_outer_edge"]


def test_a_mirror_takes_out_what_is_alike_at_opposite_places():
    """Light of phase errors is the same at both places: all but the noise of two places goes, the planet stays."""
    visits, (planet, _) = prepared()
    realised, geometry = visits.draw(0), visits.geometry
    rng, side = np.random.default_rng(2), len(geometry.hole)
    smooth = matched_sum(rng.standard_normal((side, side)), np.ones((3, 3)))
    alike = smooth + smooth[::-1, ::-1]
    image = np.where(geometry.hole, 30.0 * alike + rng.standard_normal((side, side)), 0.0)
    light = 3000.0 * planet.templates[0]
    stack = replace(realised.reduced, image_e=image + np.where(geometry.hole, light, 0.0))
    found = {
        name: forced_photometry(replace(realised, reduced=stack), planet, geometry, name)
        for name in ("aperture", "mirror", "matched")
    }
    expected = 3000.0 * planet.core
    assert found["mirror"].sigma_background < 0.1 * found["aperture"].sigma_background
    for one in found.values():
        assert abs(one.flux - expected) < 4.0 * one.error
    with pytest.raises(ValueError, match="filter"):
        Strategy(library="roll", filter="mirror")


@pytest.mark.parametrize("filter_name", ["aperture", "matched", "mirror"])
def test_light_that_modes_spread_over_the_background_is_no_noise(filter_name):
    """With modes, a planet a hundred times brighter has the same scatter; without, its wings are all there is."""
    visits, (planet, _) = prepared()
    realised, geometry = visits.draw(0), visits.geometry
    rng, side = np.random.default_rng(3), len(geometry.hole)
    region = geometry.annulus(0.5, REGION_LAMBDA_D)
    references = np.stack([matched_sum(rng.standard_normal((side, side)), np.ones((5, 5))) for _ in range(20)])
    noise = np.where(region, rng.standard_normal((side, side)), 0.0)

    def measured(cut, flux_e):
        image = noise + flux_e * cut.project(planet.templates[0])
        stack = replace(realised.reduced, image_e=image, region=region, rdi=cut)
        return forced_photometry(replace(realised, reduced=stack), planet, geometry, filter_name)

    mean, modes = (rdi_subtract(noise, references, number, region=region, centering="temporal") for number in (0, 12))
    faint, bright = measured(modes, 100.0), measured(modes, 1e4)
    assert bright.sigma_background == pytest.approx(faint.sigma_background, rel=0.01)
    assert faint.sigma_background == pytest.approx(measured(modes, 0.0).sigma_background, rel=0.01)
    assert bright.flux / 1e4 == pytest.approx(measured(mean, 1e4).flux / 1e4, rel=0.02)
    assert measured(mean, 100.0).sigma_background == pytest.approx(faint.sigma_background, rel=0.05)


@pytest.mark.parametrize("filter_name", ["aperture", "matched", "mirror", "whitened"])
def test_the_wings_of_a_bright_planet_are_no_noise(filter_name):
    visits, (planet, _) = prepared()
    realised = visits.draw(0)
    stack = realised.reduced
    model = SpeckleModel.of(visits, star().rate_e_s) if filter_name == "whitened" else None
    sigma = []
    for electrons in (0.0, 1e7):
        lit = replace(stack, image_e=stack.image_e + np.where(stack.region, electrons * planet.templates[0], 0.0))
        measured = forced_photometry(replace(realised, reduced=lit), planet, visits.geometry, filter_name, model)
        sigma.append(measured.sigma_background)
    assert sigma[1] == pytest.approx(sigma[0], rel=1e-5)
    # Eq. 4 of the paper has the photons of the planet and the scatter of the others.
    assert measured.flux_paper_error**2 == pytest.approx(electrons * planet.core, rel=0.05)
