"""Operating characteristics against exact laws, and against counts in simulated images."""

import math

import numpy as np
import pytest
from scipy.stats import binom, norm, poisson, t

from cpic_planner import ReferencePlanet, contrast_limit, roc_curve, signal_to_noise
from simulator import load_instrument
from simulator.imaging import BandGeometry

PLANET = {"target": "tau Cet", "bands": ["F662"], "contrast": 2e-9, "separation_arcsec": 0.6}


@pytest.fixture(scope="module")
def roc():
    return roc_curve(**PLANET, time_s=36000.0)


def test_false_alarms_are_elements_times_the_normal_tail(roc):
    geometry = BandGeometry.of(load_instrument(), "F662", 301)
    area = 4.0 * (geometry.zone.outer_arcsec - geometry.zone.inner_arcsec) ** 2
    of_hole = area / geometry.lambda_d_arcsec**2
    for row in roc.levels:
        assert row.false_alarms == pytest.approx(of_hole * norm.sf(row.sigma), rel=0.03)  # pixels of the hole
        assert row.false_alarms_known_place == pytest.approx(norm.sf(row.sigma), rel=1e-12)


def test_at_every_level_the_threshold_is_students_and_the_chance_that_of_the_law(roc):
    """A chance is one half or more where the contrast is that of the faintest planet of the level, or brighter."""
    (best,), n = roc.bands, elements()
    for row in roc.levels:
        strategy = {"visits": best.visits, "sigma": row.sigma}
        frames = {"exposure_s": best.exposure_s, "em_gain": best.em_gain, "exact": True}
        visit = {"visit_time_s": best.visit_time_s * (1 + 1e-12)}
        (answer,) = signal_to_noise(**PLANET, strategy=strategy, **frames, **visit)
        assert row.detection_probability == pytest.approx(answer.detection_probability, rel=1e-9)
        known = row.detection_probability_known_place
        assert known == pytest.approx(answer.detection_probability_known_place, rel=1e-9)
        threshold = t.isf(norm.sf(row.sigma), n - 2.0) * math.sqrt(1.0 + 1.0 / (n - 1.0))
        assert answer.threshold == pytest.approx(threshold, rel=1e-9)
        assert known >= row.detection_probability
        for search, chance in (("blind", row.detection_probability), ("known_place", known)):
            asked = {"separation_arcsec": PLANET["separation_arcsec"], "strategy": strategy | {"search": search}}
            (limit,) = contrast_limit(PLANET["target"], bands=PLANET["bands"], **asked, **frames, **visit)
            assert (chance >= 0.5) == (PLANET["contrast"] >= limit.value)
    for name in ("detection_probability", "detection_probability_known_place"):
        assert (np.diff([getattr(row, name) for row in roc.levels]) <= 0.0).all()
    assert roc.levels[0].detection_probability > 0.5 > roc.levels[-1].detection_probability


def elements():
    """Resolution elements at 0.6 arcsec: the arc of the circle in the four squares over lambda/D, by brute force."""
    geometry = BandGeometry.of(load_instrument(), "F662", 301)
    angle = (np.arange(400_000) + 0.5) / 400_000 * 2.0 * math.pi
    x, y = np.abs(0.6 * np.cos(angle)), np.abs(0.6 * np.sin(angle))
    zone = geometry.zone
    inside = (np.minimum(x, y) >= zone.inner_arcsec) & (np.maximum(x, y) <= zone.outer_arcsec)
    exact = 2.0 * math.pi * 0.6 * inside.mean() / geometry.lambda_d_arcsec
    assert geometry.resolution_elements(0.6) == pytest.approx(exact, rel=1e-4)
    return float(geometry.resolution_elements(0.6))


def test_a_planet_of_a_model_stands_where_it_is_clearest():
    found = roc_curve("tau Cet", bands=["F520"], planet=ReferencePlanet(radius_rjup=1.1), time_s=36000.0)
    (best,) = found.bands
    assert found.reference_planet.radius_rjup == 1.1

    def over_limit(place):
        """Return its contrast over the faintest that half of the searches find there."""
        asked = {"bands": ["F520"], "time_s": 36000.0, "separation_arcsec": place}
        (answer,) = signal_to_noise("tau Cet", planet=ReferencePlanet(radius_rjup=1.1), **asked)
        (limit,) = contrast_limit("tau Cet", **asked)
        return answer.contrast / limit.value

    clearest = over_limit(best.separation_arcsec)
    # From the least separation whose annulus has room for its background.
    for place in (*np.linspace(0.34, 0.42, 10), *np.linspace(0.45, 0.85, 5)):
        assert over_limit(place) <= clearest * 1.005
    assert 5.0 in [row.sigma for row in found.levels]


def test_the_level_of_the_strategy_is_among_the_levels():
    found = roc_curve(**PLANET, strategy={"sigma": 4.4})
    levels = [row.sigma for row in found.levels]
    assert 4.4 in levels
    assert levels == sorted(levels)


def test_images_count_the_planet_and_the_alarms():
    """A planet of ten times the limit is in every image, at its place; noise passes for none at 5 sigma."""
    found = roc_curve(**PLANET | {"contrast": 8e-8}, time_s=7200.0, strategy={"visits": 1}, images=2)
    five = next(row for row in found.levels if row.sigma == 5.0)
    assert (five.n_searches, five.n_planets, five.recovered, five.n_false) == (2, 2, 1.0, 0)
    for name in ("n_false", "n_detected"):
        assert (np.diff([getattr(row, name) for row in found.levels]) <= 0).all()
    low, high = (getattr(found.levels[0], f"recovered_{end}") for end in ("low", "high"))
    assert 0.5 < low < high == 1.0


@pytest.mark.long
def test_beside_a_bright_companion_images_find_as_many_as_predicted():
    """At the planet, the light of alpha Cen A is a seventh of its mean over the annulus: what is there counts."""
    asked = {"bands": ["F662"], "contrast": 1.4e-9, "separation_arcsec": 0.6, "time_s": 36000.0}
    found = roc_curve("alpha Cen B", **asked, images=6)
    rows = {row.sigma: row for row in found.levels}
    assert rows[4.0].detection_probability > 0.75 > 0.25 > rows[5.5].detection_probability
    for level in (4.0, 4.5, 5.0, 5.5):
        hits, chance = rows[level].n_detected, rows[level].detection_probability
        assert min(binom.cdf(hits, 6, chance), binom.sf(hits - 1, 6, chance)) > 0.01


def test_frames_that_sums_cannot_stand_for_have_no_images(monkeypatch):
    monkeypatch.setattr("cpic_planner.validation.search_task", lambda tree: {"refused": "they saturate"})
    found = roc_curve(**PLANET, time_s=7200.0, images=2)
    assert found.bands[0].images == 0
    assert found.bands[0].images_message == "they saturate"
    assert found.levels[0].recovered is None


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"contrast": 2.0}, "contrast"),
        ({"planet": {"radius_rjup": 2.0}}, "planet.radius_rjup"),
        ({"time_s": 100.0, "visit_time_s": 30.0, "strategy": {"visits": 2}}, "time_s"),
        ({"bands": ["F999"]}, "band"),
        ({"separation_arcsec": 200.0}, "separation_arcsec"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(refused, change, key):
    refused(key, roc_curve, **(PLANET | change))


def test_a_planet_outside_the_hole_has_no_levels():
    found = roc_curve(**(PLANET | {"separation_arcsec": 0.1}))
    assert found.levels == []
    assert found.bands[0].status == "outside_field"
    assert found.bands[0].message


@pytest.mark.long
def test_counts_are_those_of_the_law(record_property):
    """200 images: false alarms within Poisson at 3 and 3.5 sigma, the planet within binomial errors of the law."""
    found = roc_curve(**PLANET | {"contrast": 1.7e-9}, time_s=36000.0, images=200)
    for row in found.levels:
        if row.sigma in (3.0, 3.5):
            expected = row.n_searches * row.false_alarms
            record_property(f"false alarms at {row.sigma:g} sigma", f"{row.n_false} of {expected:.3g}")
            assert min(poisson.sf(row.n_false - 1, expected), poisson.cdf(row.n_false, expected)) > norm.sf(4.0)
        if row.sigma in (4.0, 5.0):
            spread = math.sqrt(row.detection_probability * (1.0 - row.detection_probability) / row.n_planets)
            record_property(f"found at {row.sigma:g} sigma", f"{row.recovered:.3f} of {row.detection_probability:.3f}")
            assert abs(row.recovered - row.detection_probability) < 4.0 * spread + 0.1
