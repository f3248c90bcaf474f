"""The law of a search's statistic, against Student's law, against draws of the statistic, and as answers state it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import nct, norm, t as student

from cpic_planner.etc import (
    aperture_rates,
    band_law,
    build_model,
    detection_law as laws,
    light_share,
    lit_share,
    needed_margin,
    own_share,
    search_threshold,
    searched_region,
    snr_at,
    speckled_share,
    stack_noise,
    threshold_array,
    visit_chances,
)
from cpic_planner.etc.detection_law import PRIORS, bands_law
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from simulator.config import load_instrument
from simulator.signal import annulus_floor

MODEL = build_model(load_instrument())
BANDS = MODEL.instrument.visible_bands()
MANY = 1e6


def geometry(band):
    """Independent samples of the noise of a hole without the disc around a planet, and the middle of its places."""
    metrics = MODEL.metrics[band]
    lambda_d = metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec
    samples = (np.count_nonzero(metrics.hole) - math.pi * (1.22 * lambda_d) ** 2) / metrics.filter_positions
    return metrics, samples, float(np.mean(metrics.zone.usable_range_arcsec(metrics.aperture_radius_arcsec)))


def half_of_student(level, dof):
    """Mean of a normal variate that reaches the level half the time, over an estimate of so many degrees of freedom."""
    threshold = student.isf(norm.sf(level), dof)
    return brentq(lambda mean: nct.sf(threshold, dof, mean) - 0.5, 0.5 * threshold, 1.5 * threshold)


@pytest.mark.parametrize("band", BANDS)
def test_known_place_in_white_noise_is_students_law(band):
    """One visit: the level of the noise is told by the samples of the hole and what is believed of it."""
    metrics, samples, place = geometry(band)
    dof = 2.0 * (0.5 * samples + PRIORS[0] ** -2)
    gain = np.interp(place, metrics.floor_separation_arcsec, metrics.filter_gain)
    expected = half_of_student(5.0, dof) / gain
    assert band_law(MODEL, band).half(place, 0.0, 0.0, 1.0, at_place=True) == pytest.approx(expected, rel=3e-3)
    assert band_law(MODEL, band).half(place, 0.0, 0.0, MANY, at_place=True) == pytest.approx(5.0 / gain, rel=3e-3)


@pytest.mark.parametrize("level", [2.0, 3.7, 7.3])
def test_law_of_every_level_in_white_noise_is_students(level):
    """Thresholds between those that are tabulated are those of Student's law, too."""
    metrics, samples, place = geometry("F720")
    gain = np.interp(place, metrics.floor_separation_arcsec, metrics.filter_gain)
    expected = half_of_student(level, 2.0 * (0.5 * samples + PRIORS[0] ** -2)) / gain
    law = band_law(build_model(load_instrument(), ["F720"], Strategy(sigma=level)), "F720")
    assert law.half(place, 0.0, 0.0, 1.0, at_place=True) == pytest.approx(expected, rel=5e-3)


def test_law_of_many_planets_at_once_is_that_of_each():
    """Separations, shares and visits broadcast in any way, few with many, and more than are looked up at once."""
    law, rng = band_law(MODEL, "F520"), np.random.default_rng(8)
    shapes = ((1, 7, 1), (400, 7, 22), (22,)), ((400, 1, 1), (400, 1, 22), (22,)), ((1, 7, 1), (400, 7, 22), (1,))
    for places, shares, numbers in (*shapes, ((1, 7, 1), (400, 7, 11), (400, 7, 11)), ((30000,),) * 3):
        place, visits = rng.uniform(0.3, 0.9, places), rng.uniform(1.0, 60.0, numbers)
        speckled, light = rng.random((2, *shares))
        found = law.half(place, speckled, light, visits, at_place=False)
        every = np.broadcast_arrays(place, speckled, light, visits)
        for at in rng.integers(0, found.size, 5):
            alone = law.half(*(part.flat[at] for part in every), at_place=False)
            assert alone.shape == ()
            assert found.flat[at] == alone


def test_law_is_made_of_some_separations_as_of_all():
    """To the last bit, whichever are asked for first."""
    every, some = (laws._law.__wrapped__(MODEL.metrics["F850"], 2.0, 5.0, 0.1) for _ in range(2))
    place, where = every.separation_arcsec, (0.3, 0.6, 3.0)
    for way in (False, True):
        whole = every.half(place, *where, at_place=way)
        for i in (7, 0, place.size - 1):
            assert some.half(place[i], *where, at_place=way) == whole[i]


@pytest.mark.parametrize("band", BANDS)
def test_blind_search_in_known_white_noise_asks_for_its_threshold(band):
    """A maximum over two coordinates has the mean square of the signal plus 2."""
    metrics, _, place = geometry(band)
    region = searched_region(metrics.hole, metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec)
    level = search_threshold(region, metrics.filter_roughness).unwrap()
    gain = np.interp(place, metrics.floor_separation_arcsec, metrics.filter_gain)
    half = band_law(MODEL, band).half(place, 0.0, 0.0, MANY, at_place=False)
    assert half == pytest.approx(math.sqrt(level**2 - 2.0) / gain, rel=3e-3)
    assert 5.2 < level < 5.4


@pytest.mark.parametrize("at_place", [False, True])
def test_probability_in_white_noise_is_that_of_draws(at_place):
    """The statistic itself is drawn: its height, and the variance it is divided by, of the freedom of the fit."""
    rng, n = np.random.default_rng(5), 400_000
    metrics, samples, place = geometry("F662")
    gain = np.interp(place, metrics.floor_separation_arcsec, metrics.filter_gain)
    dof = 2.0 * (0.5 * samples + PRIORS[0] ** -2)
    region = searched_region(metrics.hole, metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec)
    level = 5.0 if at_place else search_threshold(region, metrics.filter_roughness).unwrap()
    threshold = student.isf(norm.sf(level), dof)
    estimate = np.sqrt(rng.chisquare(dof, n) / dof)
    law = band_law(MODEL, "F662")
    for significance in (4.0, 4.8, 5.6, 6.2, 6.8, 7.4):
        mean = significance * gain if at_place else math.sqrt((significance * gain) ** 2 + 2.0)
        drawn = np.mean((mean + rng.standard_normal(n)) / estimate > threshold)
        found = law.probability(significance, 0.0, place, 0.0, 0.0, 1.0, at_place=at_place)
        assert found == pytest.approx(drawn, abs=0.008)
        assert 1.0 - found == pytest.approx(1.0 - drawn, rel=0.2, abs=0.002)


@pytest.mark.parametrize("separation_arcsec", [0.4, 0.6, 0.85])
def test_a_lower_threshold_never_detects_fewer(separation_arcsec):
    """It holds for faint and for bright planets, in white noise and in speckles."""
    levels = [
        band_law(build_model(load_instrument(), None, Strategy(sigma=level)), "F520") for level in (2, 3, 4, 5, 6)
    ]
    bright, speckled, visits = (
        part.ravel() for part in np.meshgrid(np.geomspace(2.0, 40.0, 15), [0.0, 0.2, 0.8], [1.0, 9.0])
    )
    for way in (False, True):
        every = [law.probability(bright, 0.0, separation_arcsec, speckled, 0.5, visits, at_place=way) for law in levels]
        assert (np.diff(every, axis=0) <= 1e-9).all()


def test_heavy_tails_raise_the_threshold_as_their_own_law_says():
    """All noise is light of errors that the scatter of many visits tells: the threshold of known noise is left.

    The speckles' maps of 256 visits leave 2/256 of the variance.
    """
    metrics, _, place = geometry("F520")
    ring = band_law(MODEL, "F520").half(place, 1.0, 1.0, 16.0, at_place=True)
    share = math.sqrt(metrics.filter_tails)
    relative = 2.0 / 256.0 * (1.0 + 1.5 * share**2)
    gain = np.interp(place, metrics.floor_separation_arcsec, metrics.filter_gain) / math.sqrt(metrics.filter_square)
    least, most = (snr_at(5.0, share, 2.0 / part, 16.0)[0] / gain for part in (relative, 2.5 * relative))
    assert 0.9 * least < ring < 1.1 * most


# Variance of the errors' light in the filter over that in apertures less the hole's mean: exact quadratic forms of the
# screens in F662, at these separations.
EXACT_LIGHT = {0.47: 1.875, 0.52: 1.851, 0.621: 1.774, 0.672: 1.732, 0.74: 1.600, 0.772: 1.519, 0.815: 1.412}


@pytest.mark.parametrize("place", EXACT_LIGHT)
def test_light_of_the_errors_through_the_filter_falls_outward(place):
    """All noise is that light, of so many visits that all is known: the half is that of a normal variate of 5."""
    metrics, law = MODEL.metrics["F662"], band_law(MODEL, "F662")
    gain = np.interp(place, metrics.floor_separation_arcsec, metrics.filter_gain)
    local = np.interp(place, metrics.floor_separation_arcsec, metrics.floor_logs()[1])
    share = np.exp(local) / annulus_floor(metrics, MODEL.strategy.annulus_lambda_d, place)[1]
    half = law.half(place, 0.999, 1.0, MANY, at_place=True)
    relative = 2.0 / 256.0 * (1.0 + 1.5 * metrics.filter_tails)
    needed = snr_at(5.0, 0.0, 2.0 / relative)[0]
    assert (half * gain / needed) ** 2 / share == pytest.approx(EXACT_LIGHT[place], rel=0.08)


def test_a_planet_near_the_inner_edge_hides_what_tells_the_drift(monkeypatch):
    """One visit, mostly white noise: only places near the edge have speckles, many of them under the planet."""
    places, asked = np.array([0.37, 0.8]), (0.1, 0.9, 1.0)
    hidden = band_law(MODEL, "F662").half(places, *asked, at_place=True)
    monkeypatch.setattr(laws, "_EXCLUDED", 0.01)
    monkeypatch.setattr(laws, "_noise", laws._noise.__wrapped__)
    width, common = MODEL.strategy.annulus_lambda_d, MODEL.instrument.drift.common_fraction
    whole = laws._law.__wrapped__(MODEL.metrics["F662"], width, MODEL.strategy.sigma, common)
    near, far = hidden / whole.half(places, *asked, at_place=True)
    assert 1.03 < near < 1.5
    assert 1.0 <= far < 1.01


@pytest.mark.parametrize(("visits", "common"), [(1.0, 0.2), (64.0, 0.2), (64.0, 0.5), (64.0, 0.0), (3.0, 1.0)])
def test_noise_is_known_as_well_as_a_fit_of_three_numbers_tells(monkeypatch, visits, common):
    """Information on level, drift and common part, pixel by pixel of the hole, turned as a matrix."""
    monkeypatch.setattr(laws, "_inverse_visits", lambda: np.array([1.0 / visits]))
    metrics = MODEL.metrics["F520"]
    place = np.array([0.4, 0.6, 0.8])
    crossed, light = 2.0 * (place / 0.4) ** -3.0, 1.5 * (place / 0.4) ** -5.0
    hole, here = (
        laws._Terms(*(np.broadcast_to(part, (3, 1, 1, 3)) for part in parts), metrics.filter_tails)
        for parts in ((crossed, light), (crossed[:, None, None, None], light[:, None, None, None]))
    )
    found = laws._relative_variance(metrics, place, hole, here, common)[:, 0, 0, 0, 0]

    x, y = laws._hole_arcsec(metrics)
    ring = np.searchsorted(np.sqrt(place[1:] * place[:-1]), np.hypot(x, y))
    whole = 1.0 + crossed + light
    shared = common**2 / 2.0 / (1.0 / visits + common**2 / 2.0)
    slopes = np.stack([1.0 / whole, (crossed + 2.0 * light) / whole, shared * crossed / whole])
    speckled = 1.0 - 1.0 / whole
    heavy = np.minimum(np.sqrt(metrics.filter_tails * light * (light + 1.2 * crossed)) / whole, 1.0)
    for i, radius in enumerate(place):
        near = np.hypot(x - radius / np.sqrt(2.0), y - radius / np.sqrt(2.0)) < 1.22 * metrics.lambda_d_arcsec
        information = np.diag([PRIORS[0] ** -2, 1.0, 1.0])
        for j in range(3):
            here_too = ring == j
            once = here_too.sum() / (1.0 + speckled[j] ** 2)
            again = (visits - 1.0) * once / (1.0 + 3.0 * heavy[j] ** 2)
            once -= (here_too & near).sum()
            scattered = slopes[:, j] * [1.0, 1.0, 0.0]
            for weight, slope in ((once, slopes[:, j]), (again, scattered)):
                information += 0.5 * weight / metrics.filter_positions * np.outer(slope, slope)
        expected = slopes[:, i] @ np.linalg.inv(information) @ slopes[:, i]
        expected += 2.0 / 256.0 * speckled[i] ** 2 * (1.0 + 1.5 * heavy[i] ** 2)
        assert found[i] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("band", BANDS)
def test_order_of_the_law(band):
    """More visits ask for less, speckles for more than white noise, and a known place for less than a search."""
    law = band_law(MODEL, band)
    place = np.linspace(*MODEL.metrics[band].zone.usable_range_arcsec(MODEL.metrics[band].aperture_radius_arcsec), 7)
    for speckled, light in ((0.0, 0.0), (0.3, 0.5), (0.9, 0.9)):
        blind, known = (
            np.array([law.half(place, speckled, light, visits, at_place=way) for visits in (1.0, 2.0, 8.0, 64.0)])
            for way in (False, True)
        )
        assert (np.diff(blind, axis=0) < 0.0).all()
        assert (known < blind).all()
    assert (law.half(place, 0.9, 0.9, 1.0, at_place=False) > law.half(place, 0.0, 0.0, 1.0, at_place=False)).all()


@pytest.mark.parametrize("visits", [1.0, 3.0, 40.0])
def test_half_is_found_at_half_and_nothing_below_the_least(visits):
    law, rng = band_law(MODEL, "F720"), np.random.default_rng(2)
    place, speckled, light = rng.uniform(0.45, 0.95, 300), rng.random(300), rng.random(300)
    for way in (False, True):
        half = law.half(place, speckled, light, visits, at_place=way)
        found = law.probability(half, 0.0, place, speckled, light, visits, at_place=way)
        np.testing.assert_allclose(found, 0.5, atol=1e-9)
        least = 0.98 * law.least(place, 1e-6, at_place=way)
        assert (law.probability(least, 0.0, place, speckled, light, visits, at_place=way) < 2e-6).all()


def test_a_planets_own_light_widens_the_law():
    law = band_law(MODEL, "F520")
    narrow, wide = (law.probability(4.0, own, 0.6, 0.1, 0.5, 1.0, at_place=False) for own in (0.0, 3.0))
    assert narrow < wide < 0.5


def test_one_law_serves_every_band_and_mode():
    """Photons that are counted and the near infrared: half of the planets at the significance of the law."""
    for band, mode in (("F1265", "analogue"), ("F520", "photon_counting")):
        model = build_model(load_instrument(), [band], Strategy(mode=mode))
        place = float(np.mean(model.metrics[band].zone.usable_range_arcsec(model.metrics[band].aperture_radius_arcsec)))
        (answer,) = exposure_time(model, find_target("tau Cet")[0], detect=True, separation_arcsec=place, contrast=1e-7)
        assert answer.verdict == "detected"
        assert answer.verdict_mode == "blind"
        assert answer.detection_probability == pytest.approx(0.5, abs=0.02)


def visits_of(drift, exposure_s=20.0, n_frames=900.0):
    """Return a model with this drift, separations, the length of the visit, and its noise there."""
    model = replace(MODEL, instrument=MODEL.instrument.changed({"drift": drift}))
    separation = np.array([[0.45, 0.6, 0.75]])
    place = separation / math.sqrt(2.0)
    rates = aperture_rates(model, find_target("tau Cet")[0], "F520", place, place, np.full(place.shape, 1e-8))
    noise = stack_noise(rates, exposure_s, n_frames, 400.0, model.camera("F520"))
    return model, separation, n_frames * (exposure_s + 1.1), noise


def test_light_of_errors_varies_with_the_fourth_power_of_the_offset():
    """``|dE|^2`` of an offset of the wavefront; what is left of the speckles, ``2 Re(E0* dE)``, with the square."""
    offsets, light, crossed = (0.02, 0.1, 0.5), [], []
    for offset in offsets:
        still = {"walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0, "common_fraction": 0.0}
        model, separation, visit_s, noise = visits_of({"visit_nm": offset} | still)
        share = lit_share(noise, light_share(model, "F520", separation, visit_s))[0]
        whole = speckled_share(noise)[0] * noise.quiet[0]
        np.testing.assert_allclose(whole, noise.terms["speckle"][0], rtol=1e-9)
        light.append(share * whole)
        crossed.append((1.0 - share) * whole)
    for k, offset in enumerate(offsets):
        np.testing.assert_allclose(light[k], light[0] * (offset / offsets[0]) ** 4, rtol=1e-9)
        np.testing.assert_allclose(crossed[k], crossed[0] * (offset / offsets[0]) ** 2, rtol=1e-9)
    assert (light[0] > 0).all()


def test_a_still_wavefront_leaves_white_noise_alone():
    still = {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}
    model, separation, visit_s, noise = visits_of(still)
    np.testing.assert_array_equal(speckled_share(noise), 0.0)
    chances, law = visit_chances(model, "F520", separation, visit_s, noise), band_law(model, "F520")
    expected = law.probability(noise.significance, own_share(noise), separation, 0.0, 0.0, 1.0, at_place=False)
    np.testing.assert_allclose(chances.blind, expected, rtol=1e-12)
    assert (chances.known_place >= chances.blind).all()


def test_an_answer_states_the_law():
    """From the answer's own numbers: significance, budget and place."""
    model = build_model(load_instrument(), ["F520"], Strategy(visits=1))
    (answer,) = signal_to_noise(model, find_target("tau Cet")[0], time_s=7200.0, separation_arcsec=0.5)
    own = ("signal_e", "planet_e2", "background_mean_e2")
    quiet = sum(value for name, value in answer.budget.items() if name not in own)
    speckle, common = answer.budget["speckle_e2"], answer.budget["common_speckle_e2"]
    wide = (answer.budget["planet_e2"] + answer.budget["background_mean_e2"]) / quiet
    visit_s = answer.n_frames * (answer.exposure_s + model.camera("F520").readout_s)
    light = float(light_share(model, "F520", 0.5, visit_s)) * speckle / (speckle + common)
    law = band_law(model, "F520")
    where = answer.significance, wide, 0.5, (speckle + common) / quiet, light, 1.0
    assert answer.detection_probability == pytest.approx(float(law.probability(*where, at_place=False)), rel=1e-4)
    known = float(law.probability(*where, at_place=True))
    assert answer.detection_probability_known_place == pytest.approx(max(known, answer.detection_probability), rel=1e-4)


def test_the_needed_margin_is_the_half_over_the_small_sample_threshold():
    for search in ("blind", "known_place"):
        model = build_model(load_instrument(), ["F850"], Strategy(search=search))
        place, speckled = np.array([0.55, 0.7]), np.array([0.2, 0.8])
        threshold = threshold_array(model.metrics["F850"].resolution_elements(place), 5.0)
        half = band_law(model, "F850").half(place, speckled, 0.3, 4.0, at_place=search == "known_place")
        found = needed_margin(model, "F850", place, speckled, 0.3, 4.0)
        np.testing.assert_allclose(found * threshold, half, rtol=1e-5)


@pytest.mark.parametrize("stars", [3, 1200])
def test_laws_of_bands_are_looked_up_together_as_alone(stars):
    """Few cases, and so many of a few places and numbers of visits that each pair is worked out once."""
    bands, rng = ("F520", "F850"), np.random.default_rng(stars)
    place = rng.choice(np.linspace(0.5, 0.9, 7), (2, stars, 1))
    visits = np.broadcast_to(np.array([1.0, 2.0, 9.0]).reshape(3, 1, 1, 1), (3, 2, stars, 1))
    together = bands_law(MODEL, bands).polynomials(place, visits, at_place=False)
    for number, band in enumerate(bands):
        alone = band_law(MODEL, band).polynomials(place[number], visits[:, number], at_place=False)
        np.testing.assert_allclose(together[..., number, :, :], alone, rtol=1e-12)
