"""Contrast curves and maps of completeness against the calculator and geometry, and against simulated images."""

import math

import numpy as np
import pytest
from scipy.stats import binom, norm

from cpic_planner import contrast_curve, contrast_limit, signal_to_noise
from cpic_planner.confirm.curve import Searched
from simulator import load_instrument
from simulator.imaging import HoleZone

STAR = {"target": "tau Cet", "bands": ["F662"], "time_s": 36000.0}


@pytest.fixture(scope="module")
def curve():
    return contrast_curve(**STAR)


def programme(curve):
    (one,) = curve.bands
    strategy = {"visits": one.visits}
    frames = {"exposure_s": one.exposure_s, "em_gain": one.em_gain, "visit_time_s": one.visit_time_s * (1 + 1e-12)}
    return {"target": STAR["target"], "bands": STAR["bands"], "exact": True, **frames}, strategy


def test_each_limit_is_the_calculators_for_the_same_frames(curve):
    frames, strategy = programme(curve)
    places = [row.separation_arcsec for row in curve.points][::6]
    rows = curve.points[::6]
    for search in ("blind", "known_place"):
        own = strategy | {"search": search}
        answers = contrast_limit(separation_arcsec=places, strategy=own, **frames)
        for row, answer in zip(rows, answers, strict=True):
            assert getattr(row, f"contrast_limit_{search}") == pytest.approx(answer.value, rel=1e-9)
    for row in rows:  # a plain significance of as much as the threshold
        at = {"separation_arcsec": row.separation_arcsec, "sigma": row.threshold}
        (answer,) = contrast_limit(strategy=strategy, **at, **frames)
        assert row.contrast_limit_threshold == pytest.approx(answer.value, rel=1e-9)


def test_the_programme_is_the_one_that_sees_faintest(curve):
    (best,) = curve.bands
    answers = contrast_limit(**STAR, separation_arcsec=[row.separation_arcsec for row in curve.points])
    free = np.array([answer.value for answer in answers])
    mine = np.array([row.contrast_limit_blind for row in curve.points])
    assert (mine >= free * (1 - 1e-9)).all()  # frames of one place are the best ones of no other
    assert best.contrast <= free.min() * 1.001
    (there,) = contrast_limit(**STAR, separation_arcsec=best.separation_arcsec)
    assert best.contrast == there.value
    alone = contrast_curve(**STAR, separation_arcsec=0.5)
    (there,) = contrast_limit(**STAR, separation_arcsec=0.5)
    assert alone.points[0].contrast_limit_blind == pytest.approx(there.value, rel=1e-9)


def test_half_are_found_at_the_limit_and_the_law_says_how_many_elsewhere(curve):
    (best,) = curve.bands
    frames, strategy = programme(curve)
    frames.pop("exact")
    row = min(curve.points, key=lambda one: abs(one.separation_arcsec - 0.6))
    assert best.independent_visits > 2.0
    widths = []
    for search, name in (("blind", ""), ("known_place", "_known_place")):
        limit = getattr(row, f"contrast_limit_{search}")
        for factor in (0.7, 1.0, 1.4):
            planet = {"separation_arcsec": row.separation_arcsec, "contrast": factor * limit}
            (answer,) = signal_to_noise(strategy=strategy, **planet, **frames, exact=True)
            chance = getattr(answer, f"detection_probability{name}")
            if factor == 1.0:
                assert chance == pytest.approx(0.5, abs=1e-6)
            else:
                widths.append((factor - 1.0) / norm.ppf(chance))
    # Normal laws in the significance: noise of 1 over what half are found at, 5 sigma and more, and a little wider.
    assert 0.9 / 5.0 < min(widths) < max(widths) < 1.5 / 5.0


def test_completeness_counts_the_part_of_the_circle_in_the_dark_hole(curve):
    (one,) = curve.maps
    instrument = load_instrument()
    radius = instrument.aperture_radius_arcsec("F662")
    inner, outer = instrument.hole_inner_arcsec("F662"), instrument.hole_outer_arcsec("F662")
    smaller = HoleZone(inner + radius, outer - radius)  # places whose whole aperture lies in the hole
    expected = smaller.azimuth_fraction(one.separation_arcsec)
    np.testing.assert_allclose(one.azimuth_share, expected, atol=0.003)
    chance = np.array(one.chance)
    assert (np.diff(chance, axis=1) >= -1e-12).all()  # a brighter planet is never harder to find
    assert (chance[:, 0] < 1e-3).all()
    assert (chance[:, -1] > 0.999).all()
    assert (np.array(one.chance_known_place) >= chance - 1e-9).all()


def test_what_was_counted_is_what_a_level_allows():
    """Peaks of a Poisson process of one a unit of expected alarms: as many as the tail of a normal law says."""
    rng, elements, n = np.random.default_rng(5), 200.0, 4000
    alarms = [np.sort(rng.uniform(0.0, 1.5, rng.poisson(1.5))) for _ in range(n)]
    empty = np.zeros((n, 0))
    images = Searched(n, "", empty, empty, alarms, np.full(n, elements), [])
    for sigma in (3.0, 3.5, 4.0):
        found = sum(int(images.detected(peaks, sigma).sum()) for peaks in alarms)
        expected = n * elements * norm.sf(sigma)
        assert abs(found - expected) < 4.0 * math.sqrt(expected)
    assert images.detected(np.array([np.inf]), 3.0).tolist() == [False]


SMALL = {
    "target": "tau Cet",
    "bands": ["F662"],
    "time_s": 7200.0,
    "separation_arcsec": [0.6],
    "strategy": {"visits": 1},
}


@pytest.mark.long
def test_images_measure_the_limit_and_find_bright_planets_alone():
    """A few images: the limit within its scatter, none of the faintest planets found and all of the brightest."""
    found = contrast_curve(**SMALL, images=3, injections=3)
    (row,) = found.points
    assert 0.5 < row.measured_limit / row.contrast_limit_threshold < 2.0
    assert 0.97 < row.measured_throughput <= 1.03
    assert [one.n_injected for one in found.recovered] == [3] * 6
    assert found.recovered[-1].n_recovered == 3
    assert found.recovered[0].n_recovered == 0
    predicted = [one.predicted for one in found.recovered]
    assert predicted == sorted(predicted)
    for one in found.recovered:
        assert one.recovered_low <= one.recovered <= one.recovered_high


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"injections": 3}, "injections"),
        ({"seed": 3}, "seed"),
        ({"images": 3, "strategy": {"library": "roll"}}, "images"),
        ({"target": "no such star"}, "star"),
        ({"separation_arcsec": [-0.5]}, "separation_arcsec"),
        ({"separation_arcsec": []}, "separation_arcsec"),
        ({"force": True}, "force"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(refused, change, key):
    refused(key, contrast_curve, **({"target": "tau Cet", "bands": ["F662"]} | change))


def test_places_outside_the_hole_say_so():
    curve = contrast_curve("tau Cet", bands=["F662"], separation_arcsec=[0.1, 0.6])
    outside, inside = curve.points
    assert (outside.status, inside.status) == ("outside_field", "ok")
    assert outside.contrast_limit_blind is None
    assert outside.contrast_limit_threshold is None
    assert len(curve.maps[0].separation_arcsec) == 1


@pytest.mark.long
def test_one_worker_and_two_write_the_same_bytes(tmp_path, monkeypatch):
    """Two pieces of work, of ten images and of two."""
    monkeypatch.setattr("cpic_planner.confirm.curve.IMAGES_A_TASK", 10)
    for workers in (1, 2):
        contrast_curve(**SMALL, images=12, injections=4, out=tmp_path / str(workers), workers=workers)
    story = {"run.json", "run.lock", "cpic-run.jsonl"}
    files = {path.relative_to(tmp_path / "1") for path in (tmp_path / "1").rglob("*") if path.is_file()}
    files = {path for path in files if path.name not in story}
    assert len([path for path in files if path.parts[0] == "parts"]) == 2
    for path in files:
        assert (tmp_path / "1" / path).read_bytes() == (tmp_path / "2" / path).read_bytes(), path


@pytest.mark.long
def test_planets_are_recovered_as_often_as_predicted(record_property):
    """Two bands, 60 images each: limits within four standard errors and 10 %, fractions within binomial errors."""
    found = contrast_curve("tau Cet", bands=["F520", "F850"], time_s=36000.0, images=60, injections=60)
    for row in found.points:
        if row.measured_limit is None:
            continue
        apart = abs(row.measured_limit - row.contrast_limit_threshold)
        assert apart < 4.0 * row.measured_limit_error + 0.1 * row.contrast_limit_threshold
    for band in ("F520", "F850"):
        rows = [row for row in found.recovered if row.band == band]
        hits, n = sum(row.n_recovered for row in rows), sum(row.n_injected for row in rows)
        expected = sum(row.n_injected * row.predicted for row in rows)
        spread = math.sqrt(sum(row.n_injected * row.predicted * (1 - row.predicted) for row in rows))
        record_property(f"planets recovered in {band}", f"{hits} of {n}, {expected:.0f} expected")
        assert abs(hits - expected) < 4.0 * spread + 0.05 * n
        for row in rows:  # the law holds within 0.15 at any place; each cell then within what chance allows
            low, high = (np.clip(row.predicted + off, 0.0, 1.0) for off in (-0.15, 0.15))
            assert binom.cdf(row.n_recovered, row.n_injected, low) > 1e-5
            assert binom.sf(row.n_recovered - 1, row.n_injected, high) > 1e-5
