"""Probabilities of detection at any place, and false alarms: noise over the hole, and background stars from counts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import SkyCoord
from scipy.stats import norm

from catalogs import ORBIT, OrbitPlaces
from cpic_planner.etc import (
    LEAST_PROBABILITY,
    Programme,
    aperture_rates,
    band_law,
    build_model,
    diagonal_pa_deg,
    light_share,
    lit_share,
    motion_factor,
    search_motion,
    speckled_share,
    stack_noise,
)
from cpic_planner.etc.detection import detection_threshold
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.planets import draw_population, load_population
from cpic_planner.planets.population import QUANTITIES
from cpic_planner.queries import Strategy
from cpic_planner.ranking.completeness import completeness
from cpic_planner.survey import detection
from cpic_planner.survey.detection import (
    ExpectedSignals,
    Pairs,
    Setting,
    alarms,
    background_alarms,
    detection_chance,
    expected_signals,
    faintest_of,
    galactic_deg,
    least_factor,
    noise_alarms,
    of_ways,
    pair_signals,
    reach_au,
    rolled,
    star_counts_deg2,
)
from cpic_planner.survey.strategy import DetectionRule, SurveyStrategy, UniverseConfig
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
    for rule, share in (("blind", counted.completeness), ("known_place", counted.completeness_known_place)):
        chance = detection_chance(seen, DetectionRule(rule=rule), np.zeros(3000, bool))
        # Completeness leaves out planets that are too faint to matter, and takes thresholds from a table.
        assert chance.mean() == pytest.approx(share[0], rel=1e-5, abs=2e-6)
    assert np.count_nonzero(seen.contrast[0]) <= round(counted.observable[0] * 3000)


@pytest.mark.parametrize("rule", ["blind", "known_place", "expected"])
@pytest.mark.parametrize("name", ["70 Oph A", "sig Dra"])
def test_what_is_too_faint_is_not_looked_at_and_nothing_else(model, name, rule):
    """Planets below the faintest contrast have a chance below 1e-6, and the others are as they were."""
    config, one = load_population("giants"), star(name)
    planets, own = draw_population(config, 3000, 7), DetectionRule(rule=rule)
    shown = SETTING, bodies_of(planets), planets.albedos, places_of(planets), [0.0]
    whole = expected_signals(model, one, *shown)
    some = expected_signals(model, one, *shown, faintest=faintest_of(model, one, [SETTING], own)[0])
    chance = detection_chance(whole, own, np.zeros(3000, bool), calibration=own.calibration)
    left = some.margin > 0.0
    assert chance[~left].max() < LEAST_PROBABILITY
    # What is needed in any noise, also in that of a companion's wings, is about half of what the noise of these stars
    # asks for: half as bright means 0.7 of the radius, and more planets are looked at than have a chance.
    assert left.sum() < 0.85 * (whole.margin > 0.0).sum()
    assert left.sum() <= 10 + 5 * (chance >= LEAST_PROBABILITY).sum()
    for part in ("margin", "reached_blind", "width_blind", "reached_known", "width_known", "snr"):
        np.testing.assert_array_equal(getattr(some, part)[left], getattr(whole, part)[left])
    for part in ("contrast", "separation_arcsec", "pa_deg"):
        np.testing.assert_array_equal(getattr(some, part), getattr(whole, part))


def test_errors_of_a_universe_lower_what_is_looked_at(model):
    """Six standard errors of the law and of the calibration together, unless a plan knows no errors."""
    rule = DetectionRule(half_factor=0.8, half_error=0.1, calibration=1.25, calibration_error=0.05)
    assert least_factor(rule, errors=False) == pytest.approx(0.64, rel=1e-12)
    assert least_factor(rule) == pytest.approx(0.64 * math.exp(-0.9), rel=1e-12)
    assert least_factor(rule.model_copy(update={"rule": "expected"})) == 1.0
    sure = faintest_of(model, star("tau Cet"), [SETTING], rule, errors=False)
    np.testing.assert_allclose(faintest_of(model, star("tau Cet"), [SETTING], rule), sure * math.exp(-0.9), rtol=1e-12)


@pytest.mark.parametrize("rule", ["blind", "known_place"])
def test_the_law_is_asked_of_all_that_it_may_detect_and_of_few_others(model, rule):
    planets, own = draw_population(load_population("giants"), 2000, 7), DetectionRule(rule=rule)
    at_place = rule == "known_place"
    one, near = star("eps Eri"), Pairs.between(places_of(planets), 0.3, 10.0)
    shown = model, one, SETTING, bodies_of(planets), planets.albedos, near, [0.0]
    some, whole = pair_signals(*shown, at_place=at_place)
    same, few = pair_signals(*shown, at_place=at_place, least=least_factor(own))
    np.testing.assert_array_equal(same, some)
    chance, less = (detection_chance(part, own, np.zeros(some.size, bool)) for part in (whole, few))
    asked = np.isfinite(few.reached_blind)
    assert asked.any()
    np.testing.assert_array_equal(less[asked], chance[asked])
    assert chance[~asked].max() < LEAST_PROBABILITY
    assert np.isfinite(whole.reached_blind).sum() > asked.sum()


def test_a_visit_whose_number_is_left_open_is_one(model):
    open_number = build_model(load_instrument(), ("F520",), Strategy())
    assert open_number.strategy.visits is None
    one, rule = star("eps Eri"), DetectionRule(rule="blind")
    faintest = faintest_of(open_number, one, [SETTING], rule)
    np.testing.assert_array_equal(faintest, faintest_of(model, one, [SETTING], rule))


def test_planets_between_two_distances_are_counted():
    """Planets at either end count."""
    east = np.array([[1.0, 2.0, 3.0, 0.5], [0.0, 2.5, 2.0, 4.0]])
    places = OrbitPlaces(east, np.zeros((2, 4)), east + 10.0, east + 20.0)
    pairs = Pairs.between(places, 1.0, 2.5)
    assert list(zip(pairs.visit.tolist(), pairs.planet.tolist(), strict=True)) == [(0, 0), (0, 1), (1, 1), (1, 2)]
    np.testing.assert_array_equal(pairs.distance_au, [11.0, 12.0, 12.5, 12.0])


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
    chance = detection_chance(seen, DetectionRule(rule="blind"), np.zeros(3000, bool))
    assert chance.mean() == pytest.approx(counted.completeness[0], rel=1e-5, abs=2e-6)
    # Mean of 16 offsets a step apart, from science and references alike: the sum over all pairs of visits.
    step_h = float(model.time_s(100.0 * (20.0 + model.camera("F520").readout_s))) / 3600.0
    apart = np.abs(np.subtract.outer(np.arange(16), np.arange(16))) * step_h
    alike = np.exp(-apart / correlation_time_h) if correlation_time_h else np.eye(16)
    shown, separation = seen.margin > 0.0, seen.separation_arcsec
    noise, light, motion = noise_of(model, one, setting, seen)
    where = separation[shown], speckled_share(noise), lit_share(noise, light), 256.0 / alike.sum()
    half = band_law(model, "F520").half(*where, at_place=False)
    over_half = noise.significance / (half * motion)
    np.testing.assert_allclose(seen.reached_blind[shown], np.log(over_half), rtol=1e-9, atol=1e-12)


def test_months_between_visits_cost_a_blind_search_and_no_look_at_a_known_place():
    """Planets move meanwhile: chances are those of completeness, which pays for the orbits that a search tries."""
    model, one = build_model(load_instrument(), ("F520",), Strategy(visits=4, visit_gap_h=720.0)), star("eps Eri")
    planets, frames = draw_population(load_population("giants"), 3000, 7), {"exposure_s": 20.0, "n_frames": 100.0}
    counted = completeness(model, one, "F520", planets, **frames, em_gain=300.0, visits=4.0)
    setting = Setting("F520", 20.0, 100.0, 300.0, 36000.0)
    shown = bodies_of(planets), planets.albedos, places_of(planets), [0.0]
    seen = expected_signals(model, one, setting, *shown)
    for rule, share in (("blind", counted.completeness), ("known_place", counted.completeness_known_place)):
        chance = detection_chance(seen, DetectionRule(rule=rule), np.zeros(3000, bool))
        assert chance.mean() == pytest.approx(share[0], rel=1e-5, abs=2e-6)
    at_once = build_model(load_instrument(), ("F520",), Strategy(visits=4))
    still, usable = expected_signals(at_once, one, setting, *shown), seen.margin > 0.0
    # Half of the planets are found at a significance that is higher by the cost of the search.
    assert np.all(still.reached_blind[usable] - seen.reached_blind[usable] > 0.01)
    np.testing.assert_allclose(seen.reached_known[usable], still.reached_known[usable], rtol=1e-9)


def noise_of(model, one, setting, seen):
    """Noise at the places of planets that are shown, the share of the errors' light in it, and the cost of motion."""
    shown, camera = seen.margin > 0.0, model.camera("F520")
    x, y = sky_to_detector(seen.separation_arcsec[shown], seen.pa_deg[shown], parity=model.instrument.detector.parity)
    rates = aperture_rates(model, one, "F520", x[None], y[None], seen.contrast[shown][None])
    visit_s = setting.n_frames * (setting.exposure_s + 1.1)  # readout of the default camera
    programme = Programme.of(model.strategy, visit_time_s=model.time_s(visit_s))
    noise = stack_noise(rates, setting.exposure_s, setting.n_frames, setting.em_gain, camera, model.strategy, programme)
    arrays = "signal_e", "quiet", "white", "speckle", "snr", "significance"
    flat = {name: np.broadcast_to(getattr(noise, name), noise.snr.shape)[0] for name in arrays}
    place = seen.separation_arcsec[shown]
    motion = motion_factor(model, search_motion(model, one, "F520", place[None]), programme, visit_s)[0]
    return replace(noise, **flat), light_share(model, "F520", place, visit_s), motion


@pytest.mark.parametrize("frames", [(0.2, 9000.0), (20.0, 150.0), (200.0, 40.0)])
def test_the_reach_of_a_visit_is_that_of_its_noise_at_the_place_of_the_planet(model, frames):
    """Significance over that of half of the planets, whose law knows the length of the visit with its readouts."""
    one, setting = star("tau Cet"), Setting("F520", *frames, 300.0, 36000.0)
    bodies = bodies_of(draw_population(load_population("giants"), 1000, 5))
    seen = expected_signals(model, one, setting, bodies, JUPITER, bodies.places([0.0]), [0.0])
    shown = seen.margin > 0.0
    assert 10 < shown.sum() < shown.size
    noise, light, motion = noise_of(model, one, setting, seen)
    speckled = 1.0 - noise.white / noise.quiet
    # With one visit all that does not average is drawn anew by it, but for the light that all visits have.
    lit = light * noise.speckle / (noise.quiet - noise.white)
    own = (noise.significance / noise.snr) ** 2 - 1.0
    law = band_law(model, "F520")
    for at_place, reached, width, paid in (
        (False, seen.reached_blind, seen.width_blind, noise.significance / motion),
        (True, seen.reached_known, seen.width_known, noise.significance),
    ):
        where = seen.separation_arcsec[shown], speckled, lit, 1.0
        half = law.half(*where, at_place=at_place)
        np.testing.assert_allclose(reached[shown], np.log(paid / half), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(width[shown], law.reach(paid, own, *where, at_place=at_place)[1], rtol=1e-9)
        assert np.all(reached[~shown] == -np.inf)
        assert np.all(width[~shown] == 1.0)


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


@pytest.mark.parametrize(("roll_deg", "turned"), [(40.0, 40.0), (-30.0, 330.0), (0.0, 0.0), (725.0, 5.0)])
def test_rolls_lie_within_one_turn(roll_deg, turned):
    assert rolled(star("alf Cen A"), roll_deg).roll_deg == turned


def test_no_frames_and_nobody_show_nothing(model):
    bodies = face_on(50, 2.0)
    for n_frames in (0.0, 0.5):
        setting = replace(SETTING, n_frames=n_frames)
        seen = expected_signals(model, star("tau Cet"), setting, bodies, JUPITER, bodies.places([0.0]), [0.0])
        for name in ("margin", "snr", "contrast"):
            assert not getattr(seen, name).any(), name
        for name in ("reached_blind", "reached_known"):
            assert np.all(getattr(seen, name) == -np.inf), name
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


RULE = DetectionRule(rule="blind", half_factor=0.8, half_error=0.1)


def expecting(blind, known=0.0, *, widths=(0.3, 0.2)):
    """Visits of planets of these significances over that of half of the planets, blind and at a known place."""
    shape = np.shape(blind)
    with np.errstate(divide="ignore"):
        reached = [np.log(np.broadcast_to(part, shape)) for part in (blind, known)]
    parts = reached[0], widths[0], reached[1], widths[1], *[0.0] * 4
    return ExpectedSignals(np.zeros(shape), *(np.broadcast_to(part, shape) for part in parts))


@pytest.mark.parametrize("rule", ["blind", "known_place"])
def test_chance_of_a_detection_is_that_of_noisy_significances(rule):
    rng, n = np.random.default_rng(1), 400_000
    blind, known = np.array([0.3, 0.9, 1.1, 1.7, 2.4, 0.9, 1.2]), np.array([False] * 5 + [True] * 2)
    at_place = np.array([0.4, 0.7, 1.3, 1.9, 2.5, 1.0, 0.9])
    own = RULE.model_copy(update={"rule": rule})
    for shift, calibration in ((0.0, 1.0), (1.5, 0.9)):
        found = detection_chance(expecting(blind, at_place), own, known, shift, calibration)
        for k in range(blind.size):
            ways = [(blind[k], 0.3)]
            if known[k] or rule == "known_place":  # looked for there, or anywhere
                ways.append((at_place[k], 0.2))
            share = max(
                np.mean(calibration * over * np.exp(width * rng.standard_normal(n)) > 0.8 * np.exp(0.1 * shift))
                for over, width in ways
            )
            assert abs(found[k] - share) < 4.0 * np.sqrt(max(share * (1 - share), 1e-6) / n), (k, shift)


def test_the_middle_of_the_law_is_where_half_are_found():
    """Without a shift of the middle, which has an error of 10 % here."""
    blind, at_place = np.array([0.8, 0.8, 0.5]), np.array([0.0, 0.5, 0.8])
    found = detection_chance(expecting(blind, at_place), RULE, np.array([False, True, True]))
    np.testing.assert_allclose(found, 0.5, rtol=1e-14)


@pytest.mark.parametrize("factor", [0.25, 1.0, 3.0])
def test_a_worse_search_needs_planets_brighter_by_its_factor(factor):
    blind, new = np.array([0.4, 0.9, 1.0, 1.6]), np.zeros(4, bool)
    found = detection_chance(expecting(factor * blind), DetectionRule(half_factor=factor), new)
    np.testing.assert_allclose(found, detection_chance(expecting(blind), DetectionRule(), new), rtol=1e-12)


def test_expected_detections_have_no_chance_in_them():
    margin = np.array([0.0, np.nextafter(1.0, 0.0), 1.0, 3.0])
    seen = replace(expecting(np.ones(4)), margin=margin)
    found = detection_chance(seen, DetectionRule(rule="expected"), np.array([False, True, False, True]), 5.0, 0.1)
    assert found.tolist() == [0.0, 0.0, 1.0, 1.0]


def test_what_cannot_be_seen_is_never_found():
    easy, wide = DetectionRule(rule="blind", half_factor=0.1), {"widths": (10.0, 10.0)}
    assert detection_chance(expecting(np.array([0.0]), **wide), easy, np.array([False]))[0] == 0.0
    # Phi(ln(1e-9 / 0.1) / 10)
    found = detection_chance(expecting(np.array([1e-9]), **wide), easy, np.array([False]))[0]
    assert found == pytest.approx(0.0327, abs=1e-3)


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
        light = light_share(other, "F520", separation, 900.0 * 21.1)
        shares.append(float((speckled_share(noise) * lit_share(noise, light))[0, 0]))
        assert shares[-1] <= float(noise.terms["speckle"][0, 0] / noise.quiet[0, 0])
        assert float(noise.signal_e[0, 0] / np.sqrt(noise.quiet[0, 0])) == pytest.approx(
            float(noise.significance[0, 0]), rel=1e-12
        )
    assert shares[0] == 0.0
    assert np.all(np.diff(shares) > 0.0)
    assert shares[-1] > 0.99


def test_light_of_errors_grows_with_a_walk(model):
    """Of a walk alone, the light of errors over the rest is proportional to the length of the visit."""
    walking = model.instrument.changed({"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.4, "orbital_nm": 0.0}})
    visit_s = np.array([21.1, 2107.7, 6500.0, 18990.0, 124000.0])
    share = light_share(replace(model, instrument=walking), "F520", 0.6, visit_s)
    odds = share / (1.0 - share)
    np.testing.assert_allclose(odds, odds[0] / visit_s[0] * visit_s, rtol=1e-9)


def test_two_rolls_show_a_planet_half_the_angle_to_either_side():
    """Where it is at the first, and that both quadrants and its own shadow of the other roll leave room for it."""
    two = build_model(load_instrument(), ("F520",), Strategy(library="roll", roll_deg=40.0))
    metrics, parity = two.metrics["F520"], two.instrument.detector.parity
    separation, pa = (part.ravel() for part in np.meshgrid(np.linspace(0.3, 1.4, 12), np.arange(0.0, 360.0, 7.0)))
    offset = separation * np.sin(np.deg2rad(pa)), separation * np.cos(np.deg2rad(pa))
    x, y, usable = detection.on_detector(two, "F520", *offset, 0.0)
    first, second = (sky_to_detector(separation, pa + turn, parity=parity) for turn in (-20.0, 20.0))
    np.testing.assert_allclose((x, y), first, rtol=1e-12, atol=1e-14)
    radius = metrics.aperture_radius_arcsec
    apart = np.hypot(first[0] - second[0], first[1] - second[1]) >= 2.0 * radius
    seen = metrics.zone.contains(*first, radius) & metrics.zone.contains(*second, radius)
    assert 0 < usable.sum() < usable.size
    assert np.array_equal(usable, seen & apart)


@pytest.fixture(scope="module")
def one_band():
    return build_model(load_instrument(), bands=("F520",))


def test_galactic_places_are_those_of_astropy():
    rng = np.random.default_rng(0)
    ra, dec = rng.uniform(0.0, 360.0, 300), np.rad2deg(np.arcsin(rng.uniform(-1.0, 1.0, 300)))
    there = SkyCoord(ra * units.deg, dec * units.deg).galactic
    longitude, latitude = galactic_deg(ra, dec)
    found = SkyCoord(longitude * units.deg, latitude * units.deg, frame="galactic")
    assert found.separation(there).deg.max() < 1e-4


def test_counts_grow_with_magnitude_and_towards_the_plane():
    limits = np.linspace(5.0, 30.0, 60)
    assert np.all(np.diff(star_counts_deg2(limits, 90.0, 40.0)) > 0.0)
    assert np.all(np.diff(star_counts_deg2(18.0, 90.0, np.linspace(10.0, 90.0, 30))) < 0.0)
    assert star_counts_deg2(18.0, 10.0, 30.0) > star_counts_deg2(18.0, 180.0, 30.0)
    assert star_counts_deg2(18.0, 90.0, -40.0) == star_counts_deg2(18.0, 90.0, 40.0)
    assert star_counts_deg2(18.0, 90.0, 1.0) == star_counts_deg2(18.0, 90.0, 10.0)
    assert star_counts_deg2(40.0, 90.0, 40.0) == star_counts_deg2(30.0, 90.0, 40.0)


@pytest.mark.parametrize(("v_mag", "l_deg", "b_deg"), [(8.0, 30.0, 25.0), (15.75, 90.0, 40.0), (21.0, 200.0, -70.0)])
def test_counts_are_those_of_bahcall_and_soneira(v_mag, l_deg, b_deg):
    """Equation B1 of 1980 ApJS 44, 73 with the constants of its table for V, term by term."""
    slope = min(max(v_mag, 12.0), 20.0) - 12.0
    mu, gamma = 0.03 + 0.0075 * slope, 0.36 - 0.04 * slope
    b, towards = math.radians(abs(b_deg)), math.cos(math.radians(l_deg))
    disc = 925.0 * math.exp(math.log(10.0) * 0.035 * (v_mag - 15.75))
    disc *= (1.0 + math.pow(10.0, -0.132 * (v_mag - 15.75))) ** -3
    disc *= (math.sin(b) * (1.0 - mu * towards / math.tan(b))) ** (5.0 * gamma - 3.0)
    halo = 1050.0 * math.exp(math.log(10.0) * 0.087 * (v_mag - 17.5))
    halo *= (1.0 + math.pow(10.0, -0.180 * (v_mag - 17.5))) ** -2.5
    centre = math.cos(b) * towards
    halo *= (1.0 - centre) ** (0.20 * centre - 1.45)
    assert star_counts_deg2(v_mag, l_deg, b_deg) == pytest.approx(disc + halo, rel=1e-12)


def test_counts_at_the_pole_are_of_the_right_order():
    # Between one and three thousand stars a square degree to V = 20 at either pole.
    assert 1e3 < star_counts_deg2(20.0, 0.0, 90.0) < 3e3
    assert star_counts_deg2(20.0, 0.0, 90.0) == pytest.approx(star_counts_deg2(20.0, 137.0, 90.0), rel=1e-9)


def test_noise_alarms_are_those_of_the_area_of_the_quadrants(one_band):
    metrics = one_band.metrics["F520"]
    area = 4.0 * (metrics.hole_outer_arcsec - metrics.hole_inner_arcsec) ** 2 / metrics.lambda_d_arcsec**2
    # Pixel centres in the squares stand for their area.
    assert noise_alarms(one_band, "F520") == pytest.approx(area * norm.sf(5.0), rel=0.15)
    weak = replace(one_band, strategy=Strategy(sigma=3.0))
    assert noise_alarms(weak, "F520") / noise_alarms(one_band, "F520") == pytest.approx(
        norm.sf(3.0) / norm.sf(5.0), rel=1e-9
    )


def test_background_stars(one_band):
    rule, star = DetectionRule(), find_target("tau Cet")[0]
    one = background_alarms(one_band, star, [SETTING], rule)
    assert 0.0 < one < 0.1
    assert background_alarms(one_band, star, [replace(SETTING, n_frames=0.0)], rule) == 0.0
    # From some length on the walk of the wavefront, not the photons, says how deep a visit is.
    assert background_alarms(one_band, star, [replace(SETTING, n_frames=30.0)], rule) < one
    # Less is detected where more is asked for, and more stars stand near the plane.
    assert background_alarms(one_band, star, [SETTING], DetectionRule(half_factor=3.9)) < one
    low = replace(star, ra_deg=np.array([266.4]), dec_deg=np.array([-28.9]))
    assert background_alarms(one_band, low, [SETTING], rule) > 3.0 * one
    # No more than the brightest stars that any place of the hole shows, over its whole area.
    metrics = one_band.metrics["F520"]
    area = 4.0 * (metrics.hole_outer_arcsec - metrics.hole_inner_arcsec - 2.0 * metrics.aperture_radius_arcsec) ** 2
    deepest = star_counts_deg2(30.0, *galactic_deg(star.ra_deg, star.dec_deg))[0] / 3600.0**2
    assert one < 1.2 * area * deepest


def test_background_stars_of_an_even_sky(one_band, monkeypatch):
    """A thousand stars a square degree, however faint: those on the area in which an aperture lies in the hole."""
    looked_at, rates = [], detection.etc.aperture_rates
    monkeypatch.setattr(detection, "star_counts_deg2", lambda limit, *place: np.full(np.shape(limit), 1000.0))
    monkeypatch.setattr(detection.etc, "aperture_rates", lambda *of: looked_at.append(of[3:5]) or rates(*of))
    found = background_alarms(one_band, find_target("tau Cet")[0], [SETTING], DetectionRule())
    metrics = one_band.metrics["F520"]
    side = metrics.hole_outer_arcsec - metrics.hole_inner_arcsec - 2.0 * metrics.aperture_radius_arcsec
    # A grid of 32 points across the hole tells a side to one step.
    step, per_arcsec2 = metrics.hole_outer_arcsec / 16.0, 1000.0 / 3600.0**2
    assert per_arcsec2 * 4.0 * (side - step) ** 2 < found < per_arcsec2 * 4.0 * (side + step) ** 2
    for part in looked_at[0]:  # as many places to either side
        np.testing.assert_allclose(np.sort(part.ravel()), np.sort(-part.ravel()), atol=1e-12)


def test_alarms_of_each_visit_are_those_of_its_band_and_time(model):
    """By star and option; background stars where the survey counts them."""
    stars = find_target("tau Cet")[0]
    options = ((SETTING, replace(SETTING, band="F850", n_frames=30.0)),)
    strategy = SurveyStrategy(name="one")
    noise, background = alarms(UniverseConfig(background="on"), strategy, model, stars, options)
    assert noise == (tuple(noise_alarms(model, way.band) for way in options[0]),)
    each = [float(background_alarms(model, stars, [way], strategy.detection)[0]) for way in options[0]]
    assert background == (tuple(each),)
    assert alarms(UniverseConfig(background="off"), strategy, model, stars, options) == (noise, ((0.0, 0.0),))


def test_ways_in_several_bands_are_worked_on_band_by_band():
    targets = star("tau Cet").select([0, 0])
    ways = tuple(tuple(replace(SETTING, band=band) for band in bands) for bands in (("F850", "F520"), ("F520",)))
    asked = []

    def worked(stars, settings):
        asked.append([way.band for way in settings])
        return [f"{way.band} of {len(stars)}" for way in settings]

    assert of_ways(targets, ways, worked) == (("F850 of 1", "F520 of 2"), ("F520 of 2",))
    assert asked == [["F850"], ["F520", "F520"]]
