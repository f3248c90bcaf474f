"""Planets in the dark zone: none that counts is left out as too faint, and none is placed twice or lost."""

import dataclasses

import numpy as np
import pytest

from catalogs import load_stars
from cpic_planner.etc import (
    LEAST_PROBABILITY,
    aperture_rates,
    band_law,
    build_model,
    stack_noise,
    threshold_array,
    visit_chances,
)
from cpic_planner.planets import draw_population, load_population
from cpic_planner.queries import Strategy
from cpic_planner.ranking import completeness as counting
from cpic_planner.ranking.completeness import N_RINGS, ZonePlanets, completeness, faintest_contrast, rectangles, ring_of
from cpic_planner.ranking.optimiser import programme_of
from cpic_planner.targets import targets_from_table
from simulator import load_instrument
from simulator.imaging import at_contrast, measured_states

BANDS = ("F520", "F850")


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), bands=BANDS)


@pytest.fixture(scope="module")
def stars():
    """The nearest stars, bright companions among them, and some others."""
    everyone = targets_from_table(load_stars())
    return everyone.select([*np.argsort(everyone.distance_pc)[:6], 100, 400])


def setting(n):
    return {
        "exposure_s": np.geomspace(1.0, 100.0, n),
        "n_frames": np.geomspace(1e4, 30.0, n),
        "em_gain": np.linspace(1.0, 300.0, n),
        "visits": np.linspace(1.0, 30.0, n).round(),
    }


def changed(model, strategy, drift, **metrics):
    instrument = model.instrument.changed({"drift": drift})
    holes = {band: dataclasses.replace(item, **metrics) for band, item in model.metrics.items()}
    return dataclasses.replace(model, instrument=instrument, metrics=holes, strategy=Strategy(**strategy))


CASES = [
    ({}, {}, {}),
    ({}, {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}, {}),
    ({}, {"visit_nm": 1.0, "common_fraction": 0.5, "correlation_time_h": 20.0}, {}),
    ({"library": "roll", "roll_deg": 30.0}, {}, {}),
    ({"library": "brighter_twin", "reference_ratio": 0.3}, {"walk_nm_per_sqrt_hour": 0.5}, {}),
    ({"library": "idealised"}, {}, {}),
    ({"reference_scheme": "swapped"}, {"orbital_nm": 1.0}, {"hole_mode": "2q", "hole_side": "left"}),
]


def margins(model, stars, band, x, y, contrast, frames):
    """Return significance over threshold at places around stars, its noise, and the wavefronts behind that."""
    exposure, number, gain, visits = (part[:, None] for part in frames.values())
    metrics, camera = model.metrics[band], model.camera(band)
    programme = programme_of(model, visits, number * (exposure + camera.readout_s))
    rates = aperture_rates(model, stars, band, x, y, contrast)
    noise = stack_noise(rates, exposure, number, gain, camera, model.strategy, programme=programme)
    threshold = threshold_array(metrics.resolution_elements(np.hypot(x, y)), model.strategy.sigma)
    return noise.significance / threshold, noise, programme.effective(rates.speckle)


@pytest.mark.parametrize(("strategy", "drift", "hole"), CASES)
def test_no_planet_below_the_faintest_contrast_is_detected(model, stars, strategy, drift, hole):
    """Contrasts at 4000 places around each star, a little below that of the ring: chances at a place and of a search.

    Without a law the threshold is what counts.
    """
    model, frames = changed(model, strategy, drift, **hole), setting(len(stars))
    for band in BANDS:
        metrics, camera = model.metrics[band], model.camera(band)
        radius, zone, random = metrics.aperture_radius_arcsec, metrics.zone, np.random.default_rng(3)
        low, high = zone.inner_arcsec + radius, zone.outer_arcsec - radius
        x, y = random.uniform(low, high, (2, 1, 4000)) * random.choice([-1, 1], (2, 1, 4000))
        if zone.mode == "2q":
            x = -abs(x)
        separation = np.hypot(x, y)
        place = model, stars, band, x, y
        ring = ring_of(zone, separation)[0]
        assert ring.min() >= 0
        assert len(np.unique(ring)) > 25
        least = faintest_contrast(model, stars, band, law=band_law(model, band), **frames)[:, ring]
        _, noise, wavefronts = margins(*place, 0.999 * least, frames)
        visit_s = (frames["n_frames"] * (frames["exposure_s"] + camera.readout_s))[:, None]
        found = visit_chances(model, band, separation, visit_s, noise, wavefronts)
        assert max(found.blind.max(), found.known_place.max()) < LEAST_PROBABILITY
        alone = faintest_contrast(model, stars, band, law=None, **frames)[:, ring]
        assert margins(*place, 0.999 * alone, frames)[0].max() < 1.0
        # They are bounds that leave out most of what can be left out.
        assert np.median(1.0 / margins(*place, alone, frames)[0]) < (8.0 if strategy or drift else 2.5)


@pytest.mark.parametrize("strategy", [{}, {"mode": "photon_counting"}])
def test_what_is_too_faint_counts_for_nothing(model, stars, strategy, monkeypatch):
    model = dataclasses.replace(model, strategy=Strategy(**strategy))
    frames, drawn = setting(len(stars)) | {"em_gain": 50.0}, draw_population(load_population(), 3000, 2)
    looked, chances = [0, 0], counting._Counts._chances

    def counted(whole):
        def seen(counts, stars, places, shown):
            looked[whole] += len(shown[0])
            return chances(counts, stars, places, shown)

        monkeypatch.setattr(counting._Counts, "_chances", seen)
        return [completeness(model, stars, band, drawn, **frames) for band in BANDS]

    some = counted(0)
    monkeypatch.setattr(counting, "faintest_contrast", lambda _, near, *others, **more: np.zeros((len(near), N_RINGS)))
    assert sum(one.completeness_known_place.sum() for one in some) > 0
    for one, other in zip(some, counted(1), strict=True):
        for item in dataclasses.fields(one):
            np.testing.assert_array_equal(getattr(one, item.name), getattr(other, item.name))
    assert looked[0] == looked[1] if strategy else looked[0] < 0.7 * looked[1]


def test_planets_that_are_kept_stand_where_they_stood(model, stars):
    drawn, frames = draw_population(load_population(), 2000, 5), setting(len(stars))
    states = {band: measured_states(model.instrument, band) for band in BANDS}
    kept = ZonePlanets(stars, drawn, keep=True)
    for contrast in (2e-9, 1e-8):
        metrics = {band: at_contrast(own, contrast) for band, own in states.items()}
        other = dataclasses.replace(model, metrics=metrics)
        for band in BANDS:
            again = completeness(other, stars, band, drawn, around=kept, **frames)
            alone = completeness(other, stars, band, drawn, **frames)
            np.testing.assert_array_equal(again.completeness, alone.completeness)
            assert next(iter(kept.of(other, band))) is next(iter(kept.of(model, band)))
    # Another geometry has other planets.
    narrow = {band: dataclasses.replace(item, hole_outer_arcsec=0.6) for band, item in model.metrics.items()}
    one, whole = (
        completeness(item, stars, "F520", drawn, around=kept, **frames)
        for item in (dataclasses.replace(model, metrics=narrow), model)
    )
    assert np.all(one.in_zone <= whole.in_zone)
    assert np.any(one.in_zone < whole.in_zone)


def test_rectangles_hold_every_pair_once():
    random = np.random.default_rng(0)
    star = np.sort(random.integers(0, 60, 20_000) ** 2 // 60)
    found = np.zeros(len(star), int)
    for stars, pair, filled in rectangles(star):
        assert pair.shape == filled.shape
        np.testing.assert_array_equal(star[pair], np.broadcast_to(stars[:, None], pair.shape))
        np.add.at(found, pair[filled], 1)
    assert np.all(found == 1)
    assert list(rectangles(star[:0])) == []
