"""What a visit sees: against completeness, the ETC of one planet, the geometry of the quadrants, and chance."""

import math
from dataclasses import replace

import numpy as np
import pytest

from catalogs import ORBIT, OrbitPlaces
from cpic_planner.etc import LEAST_PROBABILITY, aperture_rates, build_model, diagonal_pa_deg, stack_noise
from cpic_planner.etc.detection import default_law, detection_threshold
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.planets import draw_population, load_population
from cpic_planner.planets.population_config import QUANTITIES
from cpic_planner.queries import Strategy
from cpic_planner.ranking.known_completeness import completeness
from cpic_planner.survey import detection
from cpic_planner.survey.detection import (
    ExpectedSignals,
    Setting,
    detection_chance,
    expected_signals,
    faintest_of,
    half_margin,
    reach_au,
    rolled,
    tail_share,
)
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.survey.universe import NEW, PlanetSample
from cpic_planner.targets import find_target
from simulator import load_instrument
from simulator.config import MeasuredAlbedo
from simulator.target import sky_to_detector

JUPITER = (MeasuredAlbedo(model="jupiter"),)
SETTING = Setting("F520", 20.0, 150.0, 300.0, 6500.0)


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), ("F520", "F850"), Strategy(visits=1))


def star(name):
    return find_target(name)[0]


def bodies_of(planets):
    n = len(planets)
    return PlanetSample(
        universe=np.arange(n),
        number=np.zeros(n, np.int64),
        known=np.full(n, NEW),
        kind=planets.kind,
        **{name: getattr(planets, name) for name in QUANTITIES},
        mass_mjup=np.ones(n),
        period_days=np.full(n, 400.0),
    )


def places_of(planets):
    return OrbitPlaces(*(getattr(planets, name)[None] for name in OrbitPlaces.__dataclass_fields__))


# alf Cen A has a companion whose wings count, and the mixture of the solar system has albedos that follow insolation.
@pytest.mark.parametrize("band", ["F520", "F850"])
@pytest.mark.parametrize(
    ("name", "population"),
    [("alf Cen A", "giants"), ("eps Eri", "giants"), ("tau Cet", "solar_system"), ("HD 10700", "jupiters")],
)
def test_as_many_planets_as_completeness_counts(model, name, population, band):
    config = load_population(population)
    planets, one = draw_population(config, 3000, 7), star(name)
    setting = replace(SETTING, band=band)
    counted = completeness(
        model, one, band, planets, exposure_s=setting.exposure_s, n_frames=setting.n_frames, em_gain=setting.em_gain
    )
    seen = expected_signals(model, one, setting, bodies_of(planets), planets.albedos, places_of(planets), [0.0])
    law = default_law()
    for rule, share in (("blind", counted.completeness), ("known_place", counted.completeness_known_place)):
        own = DetectionRule(rule=rule, **law.model_dump())
        chance = detection_chance(seen, own, np.zeros(3000, bool), calibration=law.calibration)
        # Completeness leaves out planets that are too faint to matter, and takes thresholds from a table.
        assert chance.mean() == pytest.approx(share[0], rel=1e-5, abs=2e-6)
    assert np.count_nonzero(seen.contrast[0]) <= round(counted.observable[0] * 3000)


@pytest.mark.parametrize("rule", ["blind", "known_place", "expected"])
@pytest.mark.parametrize("name", ["70 Oph A", "sig Dra"])
def test_what_is_too_faint_is_not_looked_at_and_nothing_else(model, name, rule):
    """Planets below the faintest contrast have a chance below 1e-6, and the others are as they were."""
    config, one = load_population("giants"), star(name)
    planets, own = draw_population(config, 3000, 7), DetectionRule(rule=rule, **default_law().model_dump())
    shown = SETTING, bodies_of(planets), planets.albedos, places_of(planets), [0.0]
    whole = expected_signals(model, one, *shown)
    some = expected_signals(model, one, *shown, faintest=faintest_of(model, one, [SETTING], own)[0])
    chance = detection_chance(whole, own, np.zeros(3000, bool), calibration=own.calibration)
    left = some.margin > 0.0
    assert chance[~left].max() < LEAST_PROBABILITY
    assert left.sum() < 0.7 * (whole.margin > 0.0).sum()
    assert left.sum() <= 10 + 2 * (chance >= LEAST_PROBABILITY).sum()
    for part in ("margin", "tails", "inward", "snr", "visits", "motion"):
        np.testing.assert_array_equal(getattr(some, part)[left], getattr(whole, part)[left])
    for part in ("contrast", "separation_arcsec", "pa_deg", "distance_au", "phase_deg"):
        np.testing.assert_array_equal(getattr(some, part), getattr(whole, part))


@pytest.mark.parametrize("correlation_time_h", [0.0, 12.0])
def test_a_programme_of_visits_is_that_of_every_other_command(correlation_time_h):
    """Visits that follow each other at once share some of their wavefront: as in a ranking, by the same law."""
    remembering = load_instrument().changed({"drift": {"correlation_time_h": correlation_time_h}})
    model, one = build_model(remembering, ("F520",), Strategy(visits=16)), star("eps Eri")
    planets = draw_population(load_population("giants"), 3000, 7)
    frames = {"exposure_s": 20.0, "n_frames": 100.0, "em_gain": 300.0}
    counted = completeness(model, one, "F520", planets, **frames, visits=16.0)
    setting = Setting("F520", *frames.values(), 16.0 * float(model.time_s(100.0 * 21.1)))
    seen = expected_signals(model, one, setting, bodies_of(planets), planets.albedos, places_of(planets), [0.0])
    law = default_law()
    own = DetectionRule(rule="blind", **law.model_dump())
    chance = detection_chance(seen, own, np.zeros(3000, bool), calibration=law.calibration)
    assert chance.mean() == pytest.approx(counted.completeness[0], rel=1e-5, abs=2e-6)
    # Mean of 16 offsets a step apart, from science and references alike: the sum over all pairs of visits.
    step_h = float(model.time_s(100.0 * (20.0 + model.camera("F520").readout_s))) / 3600.0
    apart = np.abs(np.subtract.outer(np.arange(16), np.arange(16))) * step_h
    alike = np.exp(-apart / correlation_time_h) if correlation_time_h else np.eye(16)
    np.testing.assert_allclose(np.unique(seen.visits[seen.margin > 0.0]), 256.0 / alike.sum(), rtol=1e-9)
    assert np.all(seen.visits[seen.margin == 0.0] == 1.0)


@pytest.mark.parametrize("name", ["tau Cet", "alf Cen A"])
def test_one_planet_on_the_diagonal_as_the_etc_has_it(model, name):
    one, rho, contrast = star(name), 0.6, 2e-8
    answer = signal_to_noise(model, one, time_s=7200.0, separation_arcsec=rho, bands=["F520"], contrast=contrast)[0]
    setting = Setting("F520", answer.exposure_s, answer.n_frames, answer.em_gain, answer.time_s)
    au = rho * float(one.distance_pc[0])
    phase = 40.0
    lambert = (np.sin(np.deg2rad(phase)) + np.deg2rad(180 - phase) * np.cos(np.deg2rad(phase))) / np.pi
    distance = au / np.sin(np.deg2rad(phase))
    albedo = float(
        np.squeeze(model.passbands.band_albedo(_source(), one.teff_k, one.log_g, one.metallicity, only="F520"))
    )
    radius_km = distance * 149597870.7 * np.sqrt(contrast / (albedo * lambert))
    bodies = face_on(1, au, radius_rjup=radius_km / 71492.0)
    pa = np.deg2rad(diagonal_pa_deg(model, one, "F520"))
    for roll in (0.0, 33.0):
        turned = pa + np.deg2rad(roll)
        place = OrbitPlaces(
            *(np.array([[value]]) for value in (au * np.sin(turned), au * np.cos(turned), distance, phase))
        )
        turned_star = replace(one, companion_pa_deg=one.companion_pa_deg + roll)
        seen = expected_signals(model, turned_star, setting, bodies, JUPITER, place, [roll])
        assert seen.contrast[0, 0] == pytest.approx(contrast, rel=1e-9)
        assert seen.snr[0, 0] == pytest.approx(answer.value, rel=1e-9)
        threshold = detection_threshold(float(model.metrics["F520"].resolution_elements(rho)), 5.0).unwrap()
        assert seen.margin[0, 0] == pytest.approx(answer.significance / threshold, rel=1e-9)


def _source():
    from simulator.target import albedo_source

    return albedo_source(JUPITER[0])


def face_on(n, au, radius_rjup=1.0):
    zero, whole = np.zeros(n), np.zeros(n, np.int64)
    around = (np.arange(n) + 0.5) * 360.0 / n
    elements = dict.fromkeys(ORBIT, zero) | {"semi_major_axis_au": np.full(n, au), "mean_anomaly_deg": around}
    return PlanetSample(
        universe=np.arange(n),
        number=whole,
        known=np.full(n, NEW),
        kind=whole,
        radius_rjup=np.full(n, radius_rjup),
        **elements,
        mass_mjup=np.ones(n),
        period_days=np.full(n, 1000.0),
    )


@pytest.mark.parametrize("side", ["4q", "2q"])
@pytest.mark.parametrize("rho", [0.3, 0.42, 0.55, 0.65, 0.75, 0.9])
def test_without_noise_the_quadrants_alone_decide(model, brute_force, rho, side):
    perfect = replace(model, strategy=Strategy(library="idealised"))
    if side == "2q":
        metrics = {"F520": replace(model.metrics["F520"], hole_mode="2q", hole_side="right")}
        perfect = replace(perfect, metrics=metrics)
    one, n = star("tau Cet"), 7200
    bodies = face_on(n, rho * float(one.distance_pc[0]))
    setting = Setting("F520", 20.0, 1e14, 300.0, 1e15)
    places = bodies.places([0.0])
    seen = expected_signals(perfect, one, setting, bodies, JUPITER, places, [0.0])
    metrics = perfect.metrics["F520"]
    low = metrics.hole_inner_arcsec + metrics.aperture_radius_arcsec
    high = metrics.hole_outer_arcsec - metrics.aperture_radius_arcsec
    found = seen.margin[0] >= 1.0
    elements = float(metrics.resolution_elements(rho))
    half = 0.5 if side == "2q" else 1.0
    share = half * brute_force.azimuth_share(rho, low, high) * (elements >= 3.0)
    assert abs(found.mean() - share) <= 8.0 / n
    whole = half * brute_force.azimuth_share(rho, metrics.hole_inner_arcsec, metrics.hole_outer_arcsec)
    assert abs(metrics.zone.azimuth_fraction(rho) - whole) < 1e-12
    if side == "2q" and found.any():  # +x is west
        assert np.all(places.east_au[0][found] < 0.0)
    # A roll turns what is found, degree by degree: 600 planets are 30 degrees.
    turned = expected_signals(perfect, one, setting, bodies, JUPITER, places, [30.0]).margin[0] >= 1.0
    pa = np.rad2deg(np.arctan2(places.east_au[0], places.north_au[0])) % 360.0
    step = np.argsort(pa)
    assert np.array_equal(np.roll(found[step], 600), turned[step])


def test_the_wings_of_a_companion_turn_with_the_roll(model):
    one = star("alf Cen A")
    assert np.isfinite(one.companion_v_mag[0])
    n = 720
    bodies = face_on(n, 0.6 * float(one.distance_pc[0]))
    places = bodies.places([0.0])
    still, turned = (expected_signals(model, one, SETTING, bodies, JUPITER, places, [roll]) for roll in (0.0, 40.0))
    # Sky and companion turned the other way before a detector at rest are the same.
    back = np.deg2rad(-40.0)
    east = places.east_au * np.cos(back) + places.north_au * np.sin(back)
    north = places.north_au * np.cos(back) - places.east_au * np.sin(back)
    other = expected_signals(
        model,
        replace(one, companion_pa_deg=one.companion_pa_deg - 40.0),
        SETTING,
        bodies,
        JUPITER,
        replace(places, east_au=east, north_au=north),
        [0.0],
    )
    np.testing.assert_allclose(turned.margin, other.margin, rtol=1e-7)
    np.testing.assert_allclose(turned.snr, other.snr, rtol=1e-7)
    assert not np.allclose(still.margin, turned.margin)
    assert rolled(one, 40.0).roll_deg == 40.0
    # Without its light only the quadrants turn: the largest margins are the same.
    alone = replace(one, companions="off")
    tops = [
        expected_signals(model, alone, SETTING, bodies, JUPITER, places, [roll]).margin.max() for roll in (0.0, 40.0)
    ]
    assert tops[0] == pytest.approx(tops[1], rel=1e-3)


@pytest.mark.parametrize("angle", [20.0, 8.0])
def test_two_rolls_show_what_both_show(model, angle):
    """The library of two rolls: half of the angle to either side, companions where the first roll has them."""
    two = replace(model, strategy=Strategy(library="roll", roll_deg=angle))
    one = star("alf Cen A")
    bodies = bodies_of(draw_population(load_population("giants"), 2000, 3))
    places = bodies.places([0.0])
    seen = expected_signals(two, one, SETTING, bodies, JUPITER, places, [35.0])
    rolls = 35.0 - 0.5 * angle, 35.0 + 0.5 * angle
    each = [expected_signals(model, one, SETTING, bodies, JUPITER, places, [roll]).margin[0] > 0.0 for roll in rolls]
    rho, (second, first) = seen.separation_arcsec, (np.deg2rad(seen.pa_deg - roll) for roll in rolls)
    x, y = -rho * np.sin(first), rho * np.cos(first)
    # The image of a planet moves by the diameter of the aperture, 2 x 0.7 lambda/D, or more.
    moved = np.hypot(x + rho * np.sin(second), y - rho * np.cos(second))[0]
    apart = moved >= 1.4 * 520e-9 / 2.0 * 206264.806
    shown = seen.margin[0] > 0.0
    np.testing.assert_array_equal(shown, each[0] & each[1] & apart)
    assert 10 < shown.sum() < each[0].sum()
    assert (each[0] & each[1] & ~apart).any() == (angle < 10.0)
    # Noise is that of the first roll: of a planet there, with a companion turned as far.
    rates = aperture_rates(two, rolled(one, rolls[1]), "F520", x[:, shown], y[:, shown], seen.contrast[:, shown])
    noise = stack_noise(rates, SETTING.exposure_s, SETTING.n_frames, SETTING.em_gain, two.camera("F520"))
    np.testing.assert_allclose(seen.snr[:, shown], noise.snr, rtol=1e-9)


def test_many_dates_are_as_one_by_one(model):
    """More rolls than are worked out together, two of them the same."""
    one = star("alf Cen A")
    bodies = bodies_of(draw_population(load_population("giants"), 400, 3))
    days, rolls = 9.0 * np.arange(70), 2.0 * np.arange(70)
    rolls[2] = rolls[1]
    every = expected_signals(model, one, SETTING, bodies, JUPITER, bodies.places(days), rolls)
    for row in (0, 1, 2, 32, 33, 34, 66, 69):
        alone = expected_signals(model, one, SETTING, bodies, JUPITER, bodies.places(days[[row]]), rolls[[row]])
        for name in alone.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(every, name)[row])


@pytest.mark.parametrize("n_frames", [0.0, 0.5, math.nextafter(1.0, 0.0), 1.0, 1.5, 1e9])
def test_a_visit_takes_one_frame_or_more(n_frames):
    assert replace(SETTING, n_frames=n_frames).possible == (n_frames >= 1.0)


def test_resolution_elements_count_the_way_to_the_star(model):
    """Their width, 520 nm over 2 m, over the separation; 0 where nothing is seen."""
    bodies = bodies_of(draw_population(load_population("giants"), 1000, 5))
    seen = expected_signals(model, star("tau Cet"), SETTING, bodies, JUPITER, bodies.places([0.0]), [0.0])
    width = 520e-9 / 2.0 * 206264.806
    shown = seen.margin > 0.0
    np.testing.assert_allclose(seen.inward[shown], width / seen.separation_arcsec[shown], rtol=1e-6)
    assert 10 < shown.sum() < shown.size
    assert not seen.inward[~shown].any()


@pytest.mark.parametrize(("roll_deg", "turned"), [(40.0, 40.0), (-30.0, 330.0), (0.0, 0.0), (725.0, 5.0)])
def test_rolls_lie_within_one_turn(roll_deg, turned):
    assert rolled(star("alf Cen A"), roll_deg).roll_deg == turned


def test_no_frames_and_nobody_show_nothing(model):
    bodies = face_on(50, 2.0)
    for n_frames in (0.0, 0.5):
        setting = replace(SETTING, n_frames=n_frames)
        seen = expected_signals(model, star("tau Cet"), setting, bodies, JUPITER, bodies.places([0.0]), [0.0])
        for name in ("margin", "tails", "inward", "snr", "contrast"):
            assert not getattr(seen, name).any(), name
        assert np.all(seen.separation_arcsec > 0.0)
    none = bodies.select(np.zeros(50, bool))
    assert expected_signals(model, star("tau Cet"), SETTING, none, JUPITER, none.places([0.0]), [0.0]).margin.shape == (
        1,
        0,
    )


def test_position_angles_on_the_sky(model):
    one, au = star("tau Cet"), 2.0
    east, north = np.array([[au, 0.0, -au]]), np.array([[0.0, au, 0.0]])
    bodies = face_on(3, au)
    place = OrbitPlaces(east, north, np.full((1, 3), 4.0), np.full((1, 3), 60.0))
    seen = expected_signals(model, one, SETTING, bodies, JUPITER, place, [0.0])
    np.testing.assert_allclose(seen.pa_deg[0], [90.0, 0.0, -90.0])
    np.testing.assert_allclose(seen.separation_arcsec, au / one.distance_pc[0])


def test_reach_is_that_of_the_corners(model):
    inner, outer = reach_au(model, 10.0)
    assert inner == pytest.approx(
        10.0 * min(item.zone.inner_corner_arcsec for item in model.metrics.values()), rel=1e-12
    )
    assert outer == pytest.approx(
        10.0 * max(item.zone.outer_corner_arcsec for item in model.metrics.values()), rel=1e-12
    )
    # No planet beyond is usable: the corners of the usable squares lie inside.
    for metrics in model.metrics.values():
        x, y = sky_to_detector(np.array([outer / 10.0 * 1.0001, inner / 10.0 * 0.9999]), 45.0)
        assert np.all((np.abs(x) > metrics.hole_outer_arcsec) | (np.abs(x) < metrics.hole_inner_arcsec))
        assert np.allclose(np.abs(x), np.abs(y))


RULE = DetectionRule(
    rule="blind",
    blind_margin=0.8,
    blind_width=0.3,
    blind_margin_error=0.1,
    blind_tails=1.2,
    blind_inward=5.0,
    known_margin=1.0,
    known_width=0.2,
    known_margin_error=0.05,
)


def expecting(margin, tails=0.0, inward=0.1):
    """Visits of these margins."""
    rest = np.zeros_like(margin)
    return ExpectedSignals(
        margin,
        np.broadcast_to(tails, margin.shape),
        np.broadcast_to(inward, margin.shape),
        rest,
        rest,
        rest,
        rest,
        rest,
        rest,
    )


@pytest.mark.parametrize("rule", ["blind", "known_place"])
def test_chance_of_a_detection_is_that_of_noisy_margins(rule):
    rng, n = np.random.default_rng(1), 400_000
    margin = np.array([0.3, 0.9, 1.1, 1.7, 2.4, 0.9, 1.2])
    known = np.array([False] * 5 + [True] * 2)
    law = RULE.model_copy(update={"rule": rule})
    tails, inward = np.array([0.0, 0.0, 0.3, 0.6, 0.9, 0.2, 0.9]), np.array([0.1, 0.2, 0.1, 0.12, 0.1, 0.2, 0.2])
    for shift, calibration in ((0.0, 1.0), (1.5, 0.9)):
        found = detection_chance(expecting(margin, tails, inward), law, known, shift, calibration)
        for k in range(margin.size):
            ways = [(0.8 * math.exp(1.2 * tails[k] + 5.0 * (inward[k] - 0.1)), 0.3, 0.1)]
            if known[k] or rule == "known_place":  # photometry there, or the search
                ways.append((1.0, 0.2, 0.05))
            share = max(
                np.mean(
                    calibration * margin[k] * np.exp(width * rng.standard_normal(n)) > middle * np.exp(error * shift)
                )
                for middle, width, error in ways
            )
            assert abs(found[k] - share) < 4.0 * np.sqrt(max(share * (1 - share), 1e-6) / n), (k, shift)


def test_the_middle_of_the_law_is_where_half_are_found():
    """Without a shift of the middle, which has errors of 10 % and 5 % here.

    At a known place: that of photometry among tails, that of the search, which asks for less, without.
    """
    margin, tails = np.array([0.8, 1.0, 0.8]), np.array([0.0, 1.0, 0.0])
    found = detection_chance(expecting(margin, tails), RULE, np.array([False, True, True]))
    np.testing.assert_allclose(found, 0.5, rtol=1e-14)


def test_expected_detections_have_no_chance_in_them():
    margin = np.array([0.0, np.nextafter(1.0, 0.0), 1.0, 3.0])
    found = detection_chance(
        expecting(margin), DetectionRule(rule="expected"), np.array([False, True, False, True]), 5.0, 0.1
    )
    assert found.tolist() == [0.0, 0.0, 1.0, 1.0]


def test_what_cannot_be_seen_is_never_found():
    wide = DetectionRule(rule="blind", blind_margin=0.1, blind_width=10.0)
    assert detection_chance(expecting(np.array([0.0])), wide, np.array([False]))[0] == 0.0
    assert detection_chance(expecting(np.array([1e-9])), wide, np.array([False]))[0] == pytest.approx(0.0327, abs=1e-3)


def test_a_blind_search_is_harder_in_tails_and_near_the_star():
    law = half_margin(RULE, np.zeros(4, bool), np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.1, 0.1, 0.2, 0.2]))
    np.testing.assert_allclose(law, 0.8 * np.exp([0.0, 1.2, 0.5, 1.7]), rtol=1e-14)
    placed = half_margin(RULE, np.ones(2, bool), np.array([0.0, 1.0]), np.array([0.1, 0.3]))
    np.testing.assert_allclose(placed, [0.8, 1.0], rtol=1e-14)  # the search where it asks for less than photometry
    sure = DetectionRule(rule="expected", blind_tails=1.0)
    np.testing.assert_array_equal(half_margin(sure, np.zeros(2, bool), np.array([0.0, 1.0]), np.array([0.1, 0.3])), 1.0)


def test_visits_that_are_reduced_together_are_searched_as_such():
    """Sixteen wavefronts instead of one: half as much light of errors counts where its power is a quarter.

    Nothing else of the law knows how many visits there are, where a stack has the numbers of a single visit.
    """
    same = {f"stack_{name}": getattr(RULE, f"blind_{name}") for name in ("margin", "inward", "width")}
    rule, new = RULE.model_copy(update=same), np.array([False])
    seen = replace(expecting(np.array([1.0])), tails=np.array([0.6]), inward=np.array([0.1]))
    alone, together = (detection_chance(replace(seen, visits=np.array(v)), rule, new) for v in (1.0, 16.0))
    half = detection_chance(replace(seen, tails=np.array([0.3])), rule, new)
    assert together == pytest.approx(half, rel=1e-12)
    assert alone < together


def test_the_share_of_light_of_errors(model):
    """No drift leaves none of it; under much drift it is all of the noise."""
    star, separation = find_target("tau Cet")[0], np.array([[0.6]])
    place, shares = np.array([[0.6 / math.sqrt(2.0)]]), []
    for times in (0.0, 0.3, 1.0, 3.0, 100.0):
        drift = model.instrument.drift
        own = {"visit_nm": drift.visit_nm * times, "walk_nm_per_sqrt_hour": drift.walk_nm_per_sqrt_hour * times}
        other = replace(model, instrument=model.instrument.changed({"drift": own}))
        rates = aperture_rates(other, star, "F520", place, place, np.array([[1e-8]]))
        noise = stack_noise(rates, 20.0, 900.0, 400.0, other.camera("F520"))
        setting = Setting("F520", 20.0, 900.0, 400.0, 36000.0)
        shares.append(float(tail_share(other, setting, separation, noise)[0, 0]))
        assert shares[-1] ** 2 <= float(noise.terms["speckle"][0, 0] / noise.quiet[0, 0])
        assert float(noise.signal_e[0, 0] / np.sqrt(noise.quiet[0, 0])) == pytest.approx(
            float(noise.significance[0, 0]), rel=1e-12
        )
    assert shares[0] == 0.0
    assert np.all(np.diff(shares) > 0.0)
    assert shares[-1] > 0.99


def test_light_of_errors_grows_with_a_walk(model):
    """Of a walk alone, the light of errors over the rest is proportional to the visit, readouts included."""
    walking = model.instrument.changed({"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.4, "orbital_nm": 0.0}})
    other, place = replace(model, instrument=walking), np.array([[0.6 / math.sqrt(2.0)]])
    rates = aperture_rates(other, find_target("tau Cet")[0], "F520", place, place, np.array([[1e-8]]))
    odds, visit_s = [], []
    for exposure_s, n_frames in ((0.2, 5000.0), (20.0, 1.0), (20.0, 900.0), (300.0, 7.0), (2.0, 40000.0)):
        noise = stack_noise(rates, exposure_s, n_frames, 100.0, other.camera("F520"))
        setting = Setting("F520", exposure_s, n_frames, 100.0, math.nan)
        tails2 = tail_share(other, setting, np.array([[0.6]]), noise)[0, 0] ** 2
        share = tails2 * noise.quiet[0, 0] / noise.terms["speckle"][0, 0]
        odds.append(share / (1.0 - share))
        visit_s.append(n_frames * (exposure_s + 1.1))  # readout of the default camera
    np.testing.assert_allclose(odds, odds[0] / visit_s[0] * np.array(visit_s), rtol=1e-9)


def test_two_rolls_show_a_planet_half_the_angle_to_either_side():
    """Where it is at the first, and that both quadrants and its own shadow of the other roll leave room for it."""
    two = build_model(load_instrument(), ("F520",), Strategy(library="roll", roll_deg=40.0))
    metrics, parity = two.metrics["F520"], two.instrument.detector.parity
    separation, pa = (part.ravel() for part in np.meshgrid(np.linspace(0.3, 1.4, 12), np.arange(0.0, 360.0, 7.0)))
    x, y, usable = detection.on_detector(two, "F520", separation, pa)
    first, second = (sky_to_detector(separation, pa + turn, parity=parity) for turn in (-20.0, 20.0))
    assert (x, y) == (pytest.approx(first[0], rel=1e-12), pytest.approx(first[1], rel=1e-12))
    radius = metrics.aperture_radius_arcsec
    apart = np.hypot(first[0] - second[0], first[1] - second[1]) >= 2.0 * radius
    seen = detection.inside_zone(metrics.zone, *first, radius) & detection.inside_zone(metrics.zone, *second, radius)
    assert 0 < usable.sum() < usable.size
    assert np.array_equal(usable, seen & apart)
