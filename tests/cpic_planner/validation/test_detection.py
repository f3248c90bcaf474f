"""The blind detector: false alarms, planets, and what it refuses."""

import dataclasses
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import fftconvolve
from scipy.stats import norm

from cpic_core import Status, stream
from cpic_planner.etc import SearchedRegion, equivalent_sigma
from cpic_planner.validation import RdiResult, ReducedStack
from cpic_planner.validation.injection import inject, recovered
from cpic_planner.validation.search import Peak, Searcher, filter_kernel, search, speckle_maps
from simulator import single_band_psf
from simulator.config import Drift
from simulator.imaging import visit_frames

STILL = Drift(visit_nm=0.0, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)
MOVING = Drift(visit_nm=0.05, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)
STAR_E_S = 1.0e9


@pytest.fixture(scope="module")
def psf():
    return single_band_psf("F850", fidelity="quick")


@pytest.fixture(scope="module")
def still(psf):
    return speckle_maps(psf, STILL)


@pytest.fixture(scope="module")
def moving(psf):
    return speckle_maps(psf, MOVING, n_visits=256)


def residual(psf, image, sigma_e=10.0, region=None, integration_s=100.0):
    """A reduced stack with known white noise and no modes."""
    hole = psf.metrics.hole if region is None else region
    image = np.where(hole, image, 0.0)
    none = np.zeros((0, int(hole.sum())))
    rdi = RdiResult(image[None], 0, False, "temporal", hole, none, np.zeros(0))
    return ReducedStack(image, hole, np.where(hole, sigma_e**2, 0.0), np.zeros(hole.shape), rdi, integration_s, 2.0)


def white(psf, seed, sigma_e=10.0, **settings):
    rng = np.random.default_rng(seed)
    return residual(psf, sigma_e * rng.standard_normal(psf.metrics.hole.shape), sigma_e, **settings)


def flux_error(psf, sigma_e=10.0):
    return sigma_e / math.sqrt(float(np.sum(filter_kernel(psf) ** 2)))


@pytest.mark.parametrize("n", [40, pytest.param(120, marks=pytest.mark.long)])
def test_white_noise_gives_the_false_alarms_that_were_asked_for(psf, still, n):
    found, elements = 0, 0.0
    for seed in range(n):
        answer = search(white(psf, seed), psf, still, star_rate_e_s=STAR_E_S, sigma=3.0)
        found += len(answer.detections)
        elements += answer.region.n_elements
        assert all(one.significance < 5.5 for one in answer.candidates)
    expected = elements * norm.sf(3.0)
    assert abs(found - expected) < 4.0 * math.sqrt(expected)


@pytest.mark.parametrize("n", [25, pytest.param(80, marks=pytest.mark.long)])
def test_wings_of_a_companion_are_noise_where_they_fall(psf, still, n):
    """Noise in stripes as wide as three resolution elements, twice as strong in one as in the next: as many alarms."""
    hole, geometry = psf.metrics.hole, psf.geometry
    row, column = np.indices(hole.shape)
    period = 6.0 * geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec
    sigma_e = 10.0 * 4.0 ** (0.5 * np.sin(2.0 * np.pi * (row + column) / math.sqrt(2.0) / period))
    found, elements = 0, 0.0
    for seed in range(n):
        rng = np.random.default_rng(seed)
        stack = replace(residual(psf, sigma_e * rng.standard_normal(hole.shape)), white_variance_e2=hole * sigma_e**2)
        answer = search(stack, psf, still, star_rate_e_s=STAR_E_S, sigma=3.0, known_light_e_s=sigma_e**2)
        found += len(answer.detections)
        elements += answer.region.n_elements
    expected = elements * norm.sf(3.0)
    assert abs(found - expected) < 4.0 * math.sqrt(expected)


def known_places(psf, step=10):
    """Pixels, columns and rows, on a grid in the quadrants whose filters hardly share any noise."""
    axis = np.flatnonzero(psf.metrics.hole.any(axis=0))
    near = [part[3::step][:3] for part in np.split(axis, 2)]
    return [(x, y) for x in np.concatenate(near) for y in np.concatenate(near)]


@pytest.mark.parametrize("n", [60, pytest.param(300, marks=pytest.mark.long)])
def test_one_trial_at_a_known_place_has_the_false_alarms_of_a_normal_variate(psf, still, n):
    """36 places of each image of white noise: how often the significance reaches 2 and 2.5 sigma, within 4 errors."""
    ready, counts = Searcher(white(psf, 0), psf, still, star_rate_e_s=STAR_E_S, sigma=2.5), []
    places, scale, middle = known_places(psf), psf.metrics.pixel_scale_arcsec, len(psf.metrics.hole) // 2
    for seed in range(n):
        image = white(psf, seed).image_e
        field = ready.anew()
        state = field.measure(image)
        seen = [field.at(state, float(x), float(y)) for x, y in places]
        counts.append([sum(one.significance >= level for one in seen) for level in (2.0, 2.5)])
        if seed < 4:  # the same as of a search that is told one of them
            x, y = places[7 * seed]
            (one,) = ready.search(image, [((x - middle) * scale, (y - middle) * scale)]).at_places
            assert one.significance == pytest.approx(seen[7 * seed].significance, rel=1e-9)
            assert one.detected is bool(one.significance >= 2.5)
            assert equivalent_sigma(one.threshold, *one.law[1:])[0] == pytest.approx(2.5, rel=1e-6)
    for count, level in zip(np.transpose(counts), (2.0, 2.5), strict=True):
        expected = len(places) * norm.sf(level)
        assert abs(count.mean() - expected) < 4.0 * max(count.std(), math.sqrt(expected)) / math.sqrt(n)


@pytest.mark.parametrize(
    "place", [(0.42, 0.40), pytest.param((-0.4137, 0.4581), marks=pytest.mark.long), (0.3551, -0.6213)]
)
def test_a_planet_at_a_known_place_has_the_snr_of_its_flux(psf, still, place):
    """Injected flux over the known noise of the filter, whole in the hole, at pixel centres and between them."""
    ready, unit, found = Searcher(white(psf, 0), psf, still, star_rate_e_s=STAR_E_S), flux_error(psf), []
    for seed in range(40):
        stack = inject(white(psf, seed), psf.at(*place), 7.0 * unit)
        answer = ready.search(stack.image_e, [place])
        (one,) = answer.at_places
        assert (one.x_arcsec, one.y_arcsec) == pytest.approx(place, abs=1e-9)
        assert one.law[0] == answer.sigma == 5.0 < answer.threshold.unwrap()
        found.append([one.snr_mf, one.flux_e / unit])
    mean, error = np.mean(found, axis=0), np.std(found, axis=0) / math.sqrt(40)
    np.testing.assert_array_less(np.abs(mean - 7.0), 4.0 * error + 0.02 * 7.0)
    assert np.std(found, axis=0)[1] == pytest.approx(1.0, abs=4.0 / math.sqrt(80))


@pytest.mark.parametrize("height", [4.0, 8.0, 12.0])
def test_wings_of_a_planet_are_no_noise_to_it(psf, still, height):
    """Its flux over its signal-to-noise ratio is the noise there, the same as without the planet."""
    stack, unit, place = white(psf, 3), flux_error(psf), (0.42, 0.40)
    ready, found = Searcher(stack, psf, still, star_rate_e_s=STAR_E_S), []
    for flux in (0.0, height * unit):
        field = ready.anew()
        one = field.at(field.measure(inject(stack, psf.at(*place), flux).image_e), *field.pixel_of(*place))
        found.append(one.flux_e / one.snr)
    assert found[1] == pytest.approx(found[0], rel=5e-3)


def test_light_that_all_visits_share_is_no_source(psf, moving):
    """In every visit the science has one wavefront's error more than the reference: its mean light lifts no place."""
    fraction, lifted = 0.3, []
    shared = {"visits": 64, "reference_visits": 64, "common_fraction": fraction}
    for seed in range(8):
        stack = white(psf, seed, sigma_e=0.2)
        light = fraction**2 * STAR_E_S * stack.integration_s * moving.stray
        ready = Searcher(stack, psf, moving, star_rate_e_s=STAR_E_S, **shared)
        empty, lit = (ready.anew().measure(image).snr.mean() for image in (stack.image_e, stack.image_e + light))
        lifted.append(lit - empty)
    assert abs(np.mean(lifted)) < 0.15


def test_each_known_place_is_judged_without_the_others(psf, still):
    """A faint planet beside a bright one, and a place without any: nothing of the bright one is noise to them."""
    unit, places = flux_error(psf), [(0.42, 0.40), (-0.41, 0.45), (0.42, -0.60)]
    stack = inject(white(psf, 1), psf.at(*places[0]), 100 * unit)
    stack = inject(stack, psf.at(*places[1]), 14 * unit)
    ready = Searcher(stack, psf, still, star_rate_e_s=STAR_E_S)
    bright, faint, nothing = ready.search(stack.image_e, places).at_places
    assert bright.snr_mf == pytest.approx(100, rel=0.1)
    assert faint.snr_mf == pytest.approx(14, abs=3)
    assert abs(nothing.snr_mf) < 4.0
    assert [one.detected for one in (bright, faint, nothing)] == [True, True, False]
    without = inject(white(psf, 1), psf.at(*places[1]), 14 * unit)
    (alone,) = ready.search(without.image_e, places[1:2]).at_places
    assert faint.snr_mf == pytest.approx(alone.snr_mf, rel=0.03)
    # What the search reports besides is the same as without the places.
    assert ready.search(stack.image_e, places).candidates == ready.search(stack.image_e).candidates


def test_a_bright_planet_does_not_hide_itself_nor_a_faint_one(psf, still):
    unit = flux_error(psf)
    stack = inject(white(psf, 1), psf.at(0.42, 0.40), 100 * unit)
    stack = inject(stack, psf.at(-0.41, 0.45), 14 * unit)
    answer = search(stack, psf, still, star_rate_e_s=STAR_E_S)
    bright, faint = answer.detections
    assert (bright.x_arcsec, bright.y_arcsec) == pytest.approx((0.42, 0.40), abs=0.004)
    assert bright.flux_e == pytest.approx(100 * unit, rel=0.05)
    assert bright.snr_mf == pytest.approx(100, rel=0.1)
    assert (faint.x_arcsec, faint.y_arcsec) == pytest.approx((-0.41, 0.45), abs=0.01)
    assert faint.snr_mf == pytest.approx(14, abs=3)
    assert bright.separation_arcsec == pytest.approx(math.hypot(0.42, 0.40), abs=0.005)
    assert bright.x_pixel - len(stack.region) // 2 == pytest.approx(bright.x_arcsec / psf.metrics.pixel_scale_arcsec)
    assert faint.false_alarms < 1e-6


def test_a_planet_far_brighter_than_everything_is_one_planet(psf, still):
    stack = inject(white(psf, 2), psf.at(0.45, -0.45), 3000 * flux_error(psf))
    first = search(stack, psf, still, star_rate_e_s=STAR_E_S).detections[0]
    assert first.flux_e == pytest.approx(3000 * flux_error(psf), rel=0.05)
    assert (first.x_arcsec, first.y_arcsec) == pytest.approx((0.45, -0.45), abs=0.003)


def test_a_known_planet_is_neither_reported_nor_noise(psf, still):
    stack = inject(white(psf, 3), psf.at(0.42, 0.40), 20 * flux_error(psf))
    answer = search(stack, psf, still, star_rate_e_s=STAR_E_S, known=[(0.42, 0.40)])
    assert recovered(answer, 0.42, 0.40, psf.metrics.lambda_d_arcsec) is None
    assert answer.white_level == pytest.approx(1.0, abs=0.3)


def test_noise_that_is_stronger_than_stated_is_found(psf, still):
    levels = []
    for seed in range(20):
        loud = white(psf, seed, 15.0)
        stack = dataclasses.replace(loud, white_variance_e2=loud.white_variance_e2 / 2.25)
        answer = search(stack, psf, still, star_rate_e_s=STAR_E_S, sigma=3.0)
        levels.append(answer.white_level)
    assert 1.4 < np.median(levels) < 2.3  # drawn towards 1 by what is believed of white noise


@pytest.mark.long
def test_speckles_tell_the_drift_and_pass_for_no_planet(psf, moving):
    drift = []
    for seed in range(12):
        stamps = [visit_frames(psf, MOVING, 1, 1.0, stream(seed, role), stream(seed, role, "walk"))[0] for role in "sr"]
        noise = np.random.default_rng(seed).standard_normal(stamps[0].shape)
        stack = residual(psf, 1e12 * (stamps[0] - stamps[1]) + 3.0 * noise, 3.0, integration_s=1000.0)
        answer = search(stack, psf, moving, star_rate_e_s=STAR_E_S)
        drift.append(answer.drift_nm)
        assert not answer.detections
    assert np.mean(drift) == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("true_nm", [0.03, 0.1])
def test_the_drift_is_that_of_the_images_not_of_the_maps(psf, moving, true_nm):
    drift, found = Drift(visit_nm=true_nm, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5), []
    for seed in range(4):
        stamps = [visit_frames(psf, drift, 1, 1.0, stream(seed, role), stream(seed, role, "walk"))[0] for role in "sr"]
        noise = np.random.default_rng(seed).standard_normal(stamps[0].shape)
        stack = residual(psf, 1e12 * (stamps[0] - stamps[1]) + 3.0 * noise, 3.0, integration_s=1000.0)
        found.append(search(stack, psf, moving, star_rate_e_s=STAR_E_S).drift_nm)
    assert np.mean(found) == pytest.approx(true_nm, rel=0.25)


@pytest.fixture(scope="module")
def offsets(psf):
    """Stamps of 48 visits of independent offsets of 0.05 nm."""
    pairs = [(stream(n, "visit"), stream(n, "walk")) for n in range(48)]
    return np.stack([visit_frames(psf, MOVING, 1, 1.0, *pair)[0] for pair in pairs])


def programme(psf, stamps, seed, visits, references, common=0.0):
    """Science visits less the mean of the reference visits, as bright each as one pair of visits above."""
    chosen = np.random.default_rng(seed).permutation(len(stamps))
    science, library = stamps[chosen[:visits]], stamps[chosen[visits : visits + references]]
    rng = np.random.default_rng(seed)
    # White noise of a variance of 9 e-^2 in a pair of visits, half of it in the science frames.
    own = 3.0 * math.sqrt(0.5) * rng.standard_normal(science.shape)
    other = 3.0 * math.sqrt(0.5) * rng.standard_normal(library.shape)
    left = 1e12 * (science + common - library.mean(axis=0)) + own - other.mean(axis=0)
    sigma_e = 3.0 * math.sqrt(0.5 * visits * (1.0 + visits / references))
    stack = residual(psf, left.sum(axis=0), sigma_e, integration_s=1000.0 * visits)
    images = np.where(stack.region, left, 0.0)
    return dataclasses.replace(stack, rdi=dataclasses.replace(stack.rdi, residuals=images))


@pytest.mark.parametrize(("visits", "references"), [(4, 4), (12, 12), (6, 24)])
def test_a_stack_tells_the_drift_of_a_single_visit(psf, moving, offsets, visits, references):
    """Taken for one visit it seems to drift less, by the root of what is left; and its noise is known less."""
    known, taken, more = [], [], []
    for seed in range(6):
        stack = programme(psf, offsets, seed, visits, references)
        many = {"visits": visits, "reference_visits": references}
        answer = search(stack, psf, moving, star_rate_e_s=STAR_E_S, **many)
        single = search(stack, psf, moving, star_rate_e_s=STAR_E_S)
        assert not answer.detections
        known.append(answer.drift_nm)
        taken.append(single.drift_nm)
        more.append(answer.dof / single.dof)
    assert np.mean(known) == pytest.approx(0.05, rel=0.1)
    assert np.mean(taken) < 0.8 * np.mean(known)
    assert min(more) > 1.5


def test_a_planet_of_all_visits_is_no_scatter_of_them(psf, moving, offsets):
    """Two hundred times the noise: what is known of the noise elsewhere is what it was without the planet."""
    stack = programme(psf, offsets, 3, 8, 8)
    many = {"star_rate_e_s": STAR_E_S, "visits": 8, "reference_visits": 8}
    alone = search(stack, psf, moving, **many)
    bright = inject(stack, psf.at(0.42, 0.40), 200 * float(alone.sigma_e.max()))
    images = stack.rdi.residuals + (bright.image_e - stack.image_e) / 8
    bright = dataclasses.replace(bright, rdi=dataclasses.replace(bright.rdi, residuals=images))
    found = search(bright, psf, moving, **many)
    assert found.detections[0].flux_e == pytest.approx(200 * alone.sigma_e.max(), rel=0.05)
    assert found.drift_nm == pytest.approx(alone.drift_nm, rel=0.02)
    assert found.white_level == pytest.approx(alone.white_level, rel=0.02)


def test_one_search_looks_at_many_images_each_as_if_it_were_the_first(psf, moving, offsets):
    """A planet that is put into a residual is found as one that all visits show, and is forgotten after its search."""
    stack = programme(psf, offsets, 3, 8, 8)
    many = {"star_rate_e_s": STAR_E_S, "visits": 8, "reference_visits": 8}
    ready, alone = Searcher(stack, psf, moving, **many), search(stack, psf, moving, **many)
    bright = inject(stack, psf.at(0.42, 0.40), 60 * float(alone.sigma_e.max()))
    images = stack.rdi.residuals + (bright.image_e - stack.image_e) / 8
    whole = dataclasses.replace(bright, rdi=dataclasses.replace(bright.rdi, residuals=images))
    first, found, last = (ready.search(image) for image in (stack.image_e, bright.image_e, stack.image_e))
    assert first.candidates == last.candidates == alone.candidates
    expected = search(whole, psf, moving, **many)
    assert found.detections
    for name in ("snr_mf", "significance", "threshold", "flux_e", "false_alarms"):
        ours, true = ([getattr(one, name) for one in answer.candidates] for answer in (found, expected))
        np.testing.assert_allclose(ours, true, rtol=1e-6)


@pytest.mark.long
def test_what_all_visits_share_is_noise_that_no_scatter_shows(psf, moving, offsets):
    """The difference of two offsets in every science visit: who believes in none takes its peaks for planets."""
    blind, aware = 0, 0
    for seed in range(8):
        stack = programme(psf, offsets[:40], seed, 16, 16, offsets[40 + seed] - offsets[47 - seed])
        many = {"star_rate_e_s": STAR_E_S, "visits": 16, "reference_visits": 16}
        blind += len(search(stack, psf, moving, **many).detections)
        aware += len(search(stack, psf, moving, common_fraction=1.0, **many).detections)
    assert aware < blind / 5


def test_ten_planets_are_taken_out_and_the_others_seen_beside_them(psf, still):
    """Twelve bright ones: all are found, and the map of what is left shows the two faintest."""
    scale, middle = psf.metrics.pixel_scale_arcsec, len(psf.metrics.hole) // 2
    pixels = [(x * a, y * b) for x, y in ((21, 21), (39, 21), (30, 39)) for a in (1, -1) for b in (1, -1)]
    stack = white(psf, 8)
    for number, (x, y) in enumerate(pixels):
        stack = inject(stack, psf.at(x * scale, y * scale), (40 + 12 * number) * flux_error(psf))
    answer = search(stack, psf, still, star_rate_e_s=STAR_E_S)
    assert {(round(one.x_pixel) - middle, round(one.y_pixel) - middle) for one in answer.detections} == set(pixels)
    left = [answer.snr_map[middle + y, middle + x] for x, y in pixels]
    assert min(left[:2]) > 5.0
    assert np.abs(left[2:]).max() < 1.0


def test_half_a_hole_is_searched_as_half(psf, still):
    half = psf.metrics.hole.copy()
    half[:, : len(half) // 2] = False
    answer = search(white(psf, 4, region=half), psf, still, star_rate_e_s=STAR_E_S)
    whole = search(white(psf, 4), psf, still, star_rate_e_s=STAR_E_S)
    assert answer.region.n_elements == pytest.approx(whole.region.n_elements / 2)
    assert all(one.x_arcsec > 0 for one in answer.candidates)
    assert answer.threshold.status is Status.OK


@pytest.mark.parametrize("size", [0, 6])
def test_a_few_pixels_are_no_search(refused, psf, still, size):
    patch = np.zeros_like(psf.metrics.hole)
    y, x = np.argwhere(psf.metrics.hole)[len(np.argwhere(psf.metrics.hole)) // 3]
    patch[y : y + size, x : x + size] = psf.metrics.hole[y : y + size, x : x + size]
    answer = search(white(psf, 5, region=patch), psf, still, star_rate_e_s=STAR_E_S)
    assert answer.threshold.status is Status.UNREACHABLE
    assert answer.threshold.message.startswith(f"{answer.region.n_positions / shared_pixels(psf):.3g} independent")
    assert answer.candidates == ()
    assert answer.region.n_positions == patch.sum()
    # Nothing is known of the noise but what was predicted, white and without drift.
    assert (answer.white_level, answer.drift_nm, answer.roughness, answer.dof) == (1.0, 0.0, 0.0, 0.0)
    assert not answer.sigma_e.any()
    assert not answer.snr_map.any()
    refused("sigma", search, white(psf, 5, region=patch), psf, still, star_rate_e_s=STAR_E_S, sigma=20.1)


def shared_pixels(psf):
    """Pixels that share their noise after the filter: the sum of its squared autocorrelation."""
    kernel = filter_kernel(psf)
    correlation = fftconvolve(kernel, kernel[::-1, ::-1])
    return float(np.sum(correlation**2) / correlation.max() ** 2)


@pytest.mark.parametrize("size", [10, 14, 15, 18, 20])
def test_three_independent_samples_of_noise_are_a_search(psf, still, size):
    """Squares in one quadrant of 27 x 27 pixels, of which about 71 share their noise."""
    patch = np.zeros_like(psf.metrics.hole)
    y, x = np.argwhere(psf.metrics.hole)[0]
    patch[y : y + size, x : x + size] = True
    answer = search(white(psf, 5, region=patch & psf.metrics.hole), psf, still, star_rate_e_s=STAR_E_S)
    enough = size**2 / shared_pixels(psf) >= 3.0
    assert answer.threshold.status is (Status.OK if enough else Status.UNREACHABLE)


def test_no_noise_and_no_light_find_nothing_and_a_planet_is_found_without_noise(psf, still):
    quiet = residual(psf, np.zeros(psf.metrics.hole.shape), 0.0)
    assert not search(quiet, psf, still, star_rate_e_s=STAR_E_S).candidates
    answer = search(inject(quiet, psf.at(0.42, 0.40), 1e4), psf, still, star_rate_e_s=STAR_E_S)
    assert (answer.detections[0].x_arcsec, answer.detections[0].y_arcsec) == pytest.approx((0.42, 0.40), abs=0.004)


def test_bad_input_is_named(refused, psf, still):
    stack = white(psf, 7)
    image = stack.image_e.copy()
    image[tuple(np.argwhere(stack.region)[0])] = math.nan
    refused("finite", search, dataclasses.replace(stack, image_e=image), psf, still, star_rate_e_s=STAR_E_S)
    refused("star_rate_e_s", search, stack, psf, still, star_rate_e_s=0.0)
    for sigma in (1.0, math.nextafter(2.5, 0.0), math.nextafter(20.0, 21.0), math.nan):
        refused("sigma", search, stack, psf, still, star_rate_e_s=STAR_E_S, sigma=sigma)
    for name in ("visits", "reference_visits"):
        for number in (0, 10_001, 1.5):
            refused(name, search, stack, psf, still, star_rate_e_s=STAR_E_S, **{name: number})
    for fraction in (-0.1, 1.1, math.nan):
        refused("common_fraction", search, stack, psf, still, star_rate_e_s=STAR_E_S, common_fraction=fraction)
    small = dataclasses.replace(still, linear=np.zeros((3, 3)))
    refused("maps", search, stack, psf, small, star_rate_e_s=STAR_E_S)


@pytest.mark.parametrize("sigma", [2.5, 20.0])
def test_ends_of_the_range_are_allowed(psf, still, sigma):
    assert search(white(psf, 7), psf, still, star_rate_e_s=STAR_E_S, sigma=sigma).sigma == sigma


def test_a_star_that_does_not_drift_may_be_of_any_light(psf, still):
    stack = inject(white(psf, 9), psf.at(0.42, 0.40), 20 * flux_error(psf))
    faint, bright = (search(stack, psf, still, star_rate_e_s=rate) for rate in (1e-3, STAR_E_S))
    assert faint.candidates == bright.candidates
    assert faint.drift_nm == bright.drift_nm == 0.0
    assert len(faint.detections) == 1


@pytest.mark.parametrize("significance", [0.3, 1.0, 1.4, 2.1, 5.2, 9.0])
def test_a_candidate_says_how_often_noise_does_as_much(significance):
    """Expected Euler characteristic of a Gaussian field above the level, which is 1 at least; the threshold counts."""
    region, roughness = SearchedRegion(2704.0, 208.0, 4.0, 2916, 99.0), 0.05
    where = {"x_pixel": 40.5, "y_pixel": 70.0, "place": 0, "noise": None}
    peak = Peak(**where, snr=6.0, flux_e=1e3, significance=significance, laplace=0.1, dof=80.0)
    level = max(significance, 1.0)
    curve = math.exp(-(level**2) / 2.0) / (2.0 * math.pi)
    expected = (
        4.0 * norm.sf(level)
        + 208.0 * math.sqrt(roughness) * curve
        + 2704.0 * roughness * level * curve / math.sqrt(2.0 * math.pi)
    )
    place = -27.5 * 0.016, 2.0 * 0.016
    ready = SimpleNamespace(size=region, pairs=4.0, offset_arcsec=lambda peak: place)
    for threshold, detected in ((significance, True), (math.nextafter(significance, 99.0), False)):
        found = Searcher._candidate(ready, peak, threshold, roughness)
        assert found.false_alarms == pytest.approx(expected, rel=1e-12)
        assert found.detected is detected
        assert (found.x_arcsec, found.y_arcsec) == pytest.approx(place, rel=1e-12)
        assert equivalent_sigma(found.threshold, 0.1, 80.0, 4.0)[0] == pytest.approx(threshold, rel=1e-9)
