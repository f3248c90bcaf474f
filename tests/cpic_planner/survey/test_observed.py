"""Observation logs: what they leave, against universes that are thrown away, and what is refused."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from astropy.time import Time

import cpic_planner.survey.candidates as candidates_module
from catalogs import load_known_planets, star_key
from cpic_core import InputError
from cpic_planner.etc import build_model
from cpic_planner.planets import load_population
from cpic_planner.survey.candidates import N_KNOWN, Host, PlanningSky
from cpic_planner.survey.detection import Setting, detection_chance, expected_signals, reach_au
from cpic_planner.survey.observed import ObservedVisit, missed, read_log, read_schedule, resampled
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.survey.universe import NEW, albedos_of, draw_planet_sample, star_mass_msun
from cpic_planner.targets import find_target
from simulator import load_instrument

HEAD = "star,start_utc,band,exposure_s,n_frames,em_gain,telescope_h,roll_deg,planets\n"
ROW = "tau Cet,2028-02-01T00:00:00,F520,20,100,400,5,10,0\n"
EPOCH = 61771.0


@pytest.fixture
def log_of(tmp_path):
    def written(*rows, head=HEAD):
        path = tmp_path / "visits.csv"
        path.write_text(head + "".join(rows))
        return path

    return written


def test_a_log_as_people_write_it(log_of):
    log = read_log(log_of(ROW, "HD 22049,2028-01-20T12:00:00,F662,30.5,60,350,,,2\n"))
    assert [visit.star for visit in log.visits] == ["HD 22049", "tau Cet"]  # by date
    first, second = log.visits
    assert first.setting == Setting("F662", 30.5, 60.0, 350.0, 3660.0)
    assert (first.planets, second.planets) == (2, 0)
    assert math.isnan(first.roll_deg)
    assert second.roll_deg == 10.0
    # Without a time it is that of science and reference frames.
    assert log.hours == pytest.approx(5.0 + 3660.0 / 3600.0)
    assert log.until_mjd == pytest.approx(61802.0)
    assert log.of("eps Eri") == (first,)
    assert log.of("alf Cen A") == ()
    assert "2 visits" in log.provenance


FAULTS = {
    "row 2 (tau Cet) column start_utc": ROW.replace("2028-02-01T00:00:00", "someday"),
    "row 2 (tau Cet) column em_gain": ROW.replace(",400,", ",0,"),
    "row 2 (tau Cet) column exposure_s": ROW.replace(",20,", ",-20,"),
    "row 2 (tau Cet) column n_frames": ROW.replace(",100,", ",many,"),
    "row 2 (tau Cet) column n_frames = 1.5": ROW.replace(",100,", ",1.5,"),
    "row 2 (tau Cet) column band": ROW.replace("F520", ""),
    "row 2 (tau Cet) column planets": ROW.replace(",10,0", ",10,0.5"),
    "row 2 (tau Cet) column roll_deg": ROW.replace(",10,0", ",1000,0"),
}


@pytest.mark.parametrize("where", FAULTS)
def test_faults_name_file_row_and_column(refused, log_of, where):
    message = refused("", read_log, log_of(ROW, FAULTS[where]))
    assert f"visits.csv {where}" in message


def test_files_that_are_no_log(refused, log_of, tmp_path):
    for rows, head, text in (
        ((), HEAD, "no rows"),
        ((), "", "empty"),
        (("tau Cet,F520\n",), "star,band\n", "start_utc"),
    ):
        refused(text, read_log, log_of(*rows, head=head))
    refused("nowhere", read_log, tmp_path / "nowhere.csv")


PLAN_HEAD = "strategy,star,band,exposure_s,frames_per_visit,em_gain,telescope_h,start_utc,outcome,planets\n"
PLANNED = "deep,tau Cet,F520,20,100,400,5,,,\n"
MADE = "deep,tau Cet,F520,20,100,400,5,2028-02-01T00:00:00,not_detected,\n"


def test_a_log_is_the_table_of_visits_with_outcomes(log_of):
    """Lines without one are still to be made, whatever stands before and behind them."""
    shown = MADE.replace("not_detected,", "Detected,").replace("02-01", "03-01")
    two = MADE.replace("not_detected,", "detected,2").replace("02-01", "04-01")
    lost = MADE.replace("not_detected", "lost").replace("02-01", "05-01")
    path = log_of(PLANNED, MADE, PLANNED, shown, two, lost, head=PLAN_HEAD)
    log = read_log(path)
    assert [(visit.planets, visit.lost) for visit in log.visits] == [(0, False), (1, False), (2, False), (0, True)]
    assert log.hours == 20.0
    assert "4 visits, 1 of them lost, 20 h, 3 planets" in log.provenance
    # What was lost took time, and says nothing of planets.
    assert len(log.of("tau Cet")) == 3
    visits, about = read_schedule(path)
    assert [visit.row for visit in visits] == [1, 3]
    assert "2 visits of deep" in about
    rows = [
        {"star": "tau Cet", "band": "F520", "exposure_s": 20.0, "frames_per_visit": 100, "em_gain": 400.0} | more
        for more in ({}, {"start_utc": "2028-02-01T00:00:00", "outcome": "not_detected", "telescope_h": 5.0})
    ]
    other = path.with_suffix(".json")
    other.write_text(json.dumps({"visits": rows}))
    assert read_log(other).visits == tuple(
        replace(visit, where="visits.json row 2 (tau Cet)") for visit in _nan(log, 0)
    )


def _nan(log, at):
    return [log.visits[at]]


BAD_OUTCOMES = {
    "column outcome = seen: not accepted; allowed: detected, not_detected, lost, or empty": ("not_detected", "seen"),
    "column outcome = missing: not accepted; allowed: detected": ("not_detected", ""),
    "column planets = 3: not accepted; allowed: 1 or more with outcome detected": ("not_detected,", "lost,3"),
    "column planets = 0: not accepted; allowed: 1 or more with outcome detected": ("not_detected,", "detected,0"),
    "column planets = 1.5: not accepted; allowed: a whole number, 0 to 1000": ("not_detected,", "detected,1.5"),
    "column start_utc = missing": ("2028-02-01T00:00:00", ""),
    "column telescope_h = -5 h: not accepted; allowed: a number, 0 to 100000 h": (",5,", ",-5,"),
    "column frames_per_visit = 0: not accepted; allowed: a whole number, 1 to 1e+09": (",100,", ",0,"),
}


@pytest.mark.parametrize("says", BAD_OUTCOMES)
def test_bad_outcomes_name_row_column_value_and_range(refused, log_of, says):
    message = refused("", read_log, log_of(PLANNED, MADE.replace(*BAD_OUTCOMES[says]), head=PLAN_HEAD))
    assert f"visits.csv row 2 (tau Cet) {says}" in message


def test_a_table_with_nothing_observed_or_nothing_left(refused, log_of, tmp_path):
    refused("at least one line with start_utc and outcome", read_log, log_of(PLANNED, PLANNED, head=PLAN_HEAD))
    refused("lines without an outcome", read_schedule, log_of(MADE, head=PLAN_HEAD))
    for text in ("{", "{}", '{"visits": 1}', '{"visits": [1]}', '{"visits": []}'):
        broken = tmp_path / "broken.json"
        broken.write_text(text)
        refused("JSON with a list of visits", read_schedule, broken)


def test_of_several_strategies_one_is_meant(refused, log_of):
    wide = MADE.replace("deep", "wide").replace("02-01", "03-01")
    own = MADE.replace("deep", "").replace("02-01", "04-01")  # a visit that nobody had planned
    path = log_of(MADE, wide, own, PLANNED, PLANNED.replace("deep", "wide"), head=PLAN_HEAD)
    message = refused("visits of one strategy", read_log, path)
    assert "those of deep, wide: choose one with --strategy" in message
    for names in (("deep", "wide"), ("other",)):
        refused("visits of one strategy", read_log, path, names)
    months = {name: [visit.where[15:17] for visit in read_log(path, (name,)).visits] for name in ("deep", "wide")}
    assert months == {"deep": ["1 ", "3 "], "wide": ["2 ", "3 "]}
    # A varied strategy is meant by its name before.
    assert read_log(path, ("deep drift=0.1 nm",)).visits == read_log(path, ("deep",)).visits
    refused("visits of one strategy", read_schedule, path)
    assert [visit.row for visit in read_schedule(path, "wide")[0]] == [5]
    refused("deep, wide", read_schedule, path, "narrow")
    # Only one was followed: what the others had planned does not matter.
    followed = log_of(MADE, PLANNED.replace("deep", "wide"), head=PLAN_HEAD)
    assert len(read_log(followed, ("wide", "deep")).visits) == 1


@pytest.mark.parametrize(
    ("row", "where"),
    [
        (ROW.replace("tau Cet", "Vulcan"), "row 2 (Vulcan) column star = Vulcan"),
        (ROW.replace("F520", "Q"), "row 2 (tau Cet) column band = Q"),
    ],
)
def test_a_survey_refuses_what_its_catalogue_or_instrument_lacks(refused, log_of, small, row, where):
    message = refused("", prepare, small(universe={"observed": str(log_of(ROW, row))}))
    assert f"visits.csv {where}" in message


def test_a_survey_that_is_over_is_refused(refused, log_of, small):
    refused("time_budget_h = 300", prepare, small(universe={"observed": str(log_of(ROW.replace(",5,", ",400,")))}))
    with pytest.raises(InputError, match="none of its 730 days is left"):
        prepare(small(universe={"observed": str(log_of(ROW.replace("2028", "2031")))}))


@pytest.fixture(scope="module")
def setup():
    """A star with known planets, visits of it that showed nothing, and many universes."""
    model, star = build_model(load_instrument(), ("F520",)), find_target("eps Eri")[0]
    table = load_known_planets()
    population = load_population("giants").model_copy(update={"planets_per_star": 1.5})
    rows = table.by_star[star_key("eps Eri")]
    bodies = draw_planet_sample(
        "eps Eri",
        float(star_mass_msun(star)[0]),
        float(star.luminosity_lsun[0]),
        population,
        known=table,
        known_rows=rows,
        epoch_mjd=EPOCH,
        n=6000,
        seed=1,
    )
    setting = Setting("F520", 25.0, 300.0, 450.0, 15000.0)
    visits = [
        ObservedVisit("eps Eri", EPOCH + day, setting, 10.0, roll, planets)
        for day, roll, planets in ((20.0, 0.0, 0), (70.0, math.nan, 0), (200.0, 30.0, 1))
    ]
    rule = DetectionRule(rule="blind", half_factor=0.4)
    return model, star, population, bodies, visits, rule


def misses(setup):
    model, star, population, bodies, visits, rule = setup
    return missed(
        model,
        star,
        bodies,
        albedos_of(population),
        visits,
        rule,
        epoch_mjd=EPOCH,
        sun_pa_deg=np.array([10.0, 55.0, 90.0]),
    )


def test_what_visits_miss(setup):
    model, star, population, bodies, visits, rule = setup
    odds = []
    for visit, roll in zip(visits, (0.0, 55.0, 30.0), strict=True):
        seen = expected_signals(
            model, star, visit.setting, bodies, albedos_of(population), bodies.places([visit.mjd - EPOCH]), [roll]
        )
        odds.append(detection_chance(seen, rule, np.zeros(len(bodies), bool))[0])
    # The third showed a planet, maybe the known one; what it did not show are new ones all the same.
    third = np.where(bodies.known == NEW, 1.0 - odds[2], 1.0)
    np.testing.assert_allclose(misses(setup), (1.0 - odds[0]) * (1.0 - odds[1]) * third, rtol=1e-12)
    twice = (*setup[:5], rule.model_copy(update={"visits_needed": 2}))
    np.testing.assert_allclose(misses(twice), (1.0 - odds[0]) * (1.0 - odds[1]), rtol=1e-12)
    assert misses(setup).min() < 0.2
    assert misses(setup).max() == 1.0


def test_planets_that_a_log_shows_are_not_found_again(setup):
    """New planets that one visit left unseen: as many as universes have in which it showed one, or two."""
    model, star, population, bodies, visits, rule = setup
    seen = expected_signals(
        model, star, visits[2].setting, bodies, albedos_of(population), bodies.places([200.0]), [30.0]
    )
    odds = detection_chance(seen, rule, np.zeros(len(bodies), bool))[0]
    new, n, rng = bodies.known == NEW, 6000, np.random.default_rng(8)
    shown = new & (rng.random(len(bodies)) < odds)
    hits, unseen = (np.bincount(bodies.universe[some], minlength=n) for some in (shown, new & ~shown))
    left = missed(
        model, star, bodies, albedos_of(population), visits[2:], rule, epoch_mjd=EPOCH, sun_pa_deg=np.array([90.0])
    )
    expected = left[new].sum() / n
    assert expected < 0.95 * new.sum() / n
    for number in (1, 2):
        mine = unseen[hits == number]
        assert mine.size > 50
        assert abs(mine.mean() - expected) < 4.0 * math.sqrt(expected / mine.size)


def test_what_is_left_is_what_universes_have_in_which_nothing_was_seen(setup):
    bodies, left = setup[3], misses(setup)
    n, rng = 6000, np.random.default_rng(5)
    # Every visit of every universe is tried; universes in which any planet shows are thrown away.
    shown = rng.random(len(bodies)) >= left
    quiet = np.ones(n, bool)
    quiet[bodies.universe[shown]] = False
    true = bodies.select(quiet[bodies.universe])
    found = resampled(bodies, left, rng.random(len(bodies)))
    new, kept = true.known == NEW, found.known == NEW
    # Each new planet stays with its own probability.
    fresh = (bodies.known == NEW) & (left < 0.999)
    stays = set(zip(found.universe.tolist(), found.number.tolist(), strict=True))
    kept_of = np.array([(u, j) in stays for u, j in zip(bodies.universe.tolist(), bodies.number.tolist(), strict=True)])
    partly = fresh & (left > 0.05) & (left < 0.95)
    for some in (fresh, partly):
        error = math.sqrt((left[some] * (1.0 - left[some])).sum())
        assert abs(kept_of[some].sum() - left[some].sum()) < 4.0 * error
        assert error < 0.05 * left[some].sum()
    # Numbers of new planets: mean and variance of a law of Poisson of less intensity.
    n_true = np.bincount(true.universe[new], minlength=n)[quiet]
    n_found = np.bincount(found.universe[kept], minlength=n)
    error = math.sqrt(n_true.var() / quiet.sum() + n_found.var() / n)
    assert abs(n_true.mean() - n_found.mean()) < 4.0 * error
    assert n_found.mean() < 1.5 - 4.0 * error
    assert abs(n_found.var() / n_found.mean() - 1.0) < 4.0 * math.sqrt(2.0 / n)
    close = reach_au(setup[0], float(setup[1].distance_pc[0]))
    for name in ("semi_major_axis_au", "radius_rjup", "eccentricity"):
        ends = [getattr(part, name)[mine & part.within(*close)] for part, mine in ((true, new), (found, kept))]
        miss = math.sqrt(sum(part.var() / part.size for part in ends))
        assert abs(ends[0].mean() - ends[1].mean()) < 4.0 * miss, name
    # The known planet is in every universe, on orbits that stay hidden: as often as in those that are left.
    known_true, known_found = (part.select(part.known != NEW) for part in (true, found))
    assert np.array_equal(np.sort(known_found.universe), np.arange(n))
    assert len(known_true) == quiet.sum()
    places = [part.places([20.0, 400.0]) for part in (known_true, known_found)]
    for k in range(2):
        rho = [np.hypot(place.east_au[k], place.north_au[k]) for place in places]
        # Draws may be used more than once: their effective number is Kish's.
        weight = left[bodies.known != NEW]
        effective = weight.sum() ** 2 / (weight**2).sum()
        miss = math.sqrt(rho[0].var() / rho[0].size + rho[1].var() / n + rho[1].var() / effective)
        assert abs(rho[0].mean() - rho[1].mean()) < 4.0 * miss
    # Orbits that the visits would have shown are drawn less often.
    again = (setup[0], setup[1], setup[2], found, setup[4], setup[5])
    assert misses(again)[found.known != NEW].mean() > left[bodies.known != NEW].mean() + 0.02


def test_the_weight_of_a_known_planet_stays_whole(setup, small, log_of):
    """Draws that no date shows are never ruled out: what visits take of the others goes to them as well."""
    model, star, *_ = setup
    log = read_log(log_of(ROW.replace("tau Cet", "eps Eri").replace(",20,100,", ",25,300,")))
    strategy = small({"detection": {"rule": "expected"}}).strategies[0]
    sky = PlanningSky(1, (1.8, 5.0))  # farther out than many of its orbits reach
    table = load_known_planets("archive_2019")  # an orbit that reaches there in some draws only
    rows = table.by_star[star_key("eps Eri")]
    host = Host(star, strategy.population, table, rows)
    bodies = sky.planets(host, EPOCH)
    calendar = SimpleNamespace(start_mjd=EPOCH)
    left = candidates_module._left(strategy, model, host, bodies, log.visits, calendar)
    known = bodies.known != NEW
    never = N_KNOWN - known.sum()
    assert never > 0
    missed_ones = left[known] > 0.0
    assert 0 < (~missed_ones).sum() < known.sum()
    # Posterior weights of all draws, those left out too, add up to one planet.
    (weight,) = set(np.round(left[known][missed_ones], 12))
    assert left[known].sum() + never * weight == pytest.approx(N_KNOWN)
    assert set(left[~known]) == {0.0, 1.0}


def test_a_known_planet_that_cannot_have_been_missed_is_kept(setup):
    bodies = setup[3]
    found = resampled(bodies, np.zeros(len(bodies)), np.full(len(bodies), 0.5))
    assert np.all(found.known != NEW)
    mine = bodies.select(bodies.known != NEW)
    assert np.array_equal(found.mean_anomaly_deg, mine.mean_anomaly_deg)


def test_names_numbers_and_rows_of_bodies_stay(setup):
    bodies = setup[3]
    found = resampled(bodies, np.ones(len(bodies)), np.random.default_rng(0).random(len(bodies)))
    key = lambda part: sorted(zip(part.universe.tolist(), part.number.tolist(), part.known.tolist(), strict=True))  # noqa: E731
    assert key(found) == key(bodies)


def test_what_is_left_of_a_survey(log_of, small):
    row = ROW.replace("tau Cet", "HD 22049")  # eps Eri
    prepared = prepare(small(universe={"observed": str(log_of(row))}))
    survey = prepared.surveys[0]
    assert survey.strategy.time_budget_h == 295.0
    assert {visit.slot for visit in survey.schedule.visits} <= set(range(1, 13))
    mine = list(survey.targets.name).index("eps Eri")
    visits = [visit for visit in survey.schedule.visits if visit.star == mine]
    assert len(visits) == 3  # of four, one is made
    assert min(survey.calendar.day[mine, visit.slot] for visit in visits) >= 31.0 + 30.0
    # A star that has shown its planet is left alone, unless the strategy goes on.
    shown = str(log_of(row.replace(",10,0", ",10,1")))
    assert "eps Eri" not in prepare(small(universe={"observed": shown})).surveys[0].targets.name
    goes_on = small({"stop": {"after_detection": False}}, universe={"observed": shown})
    assert "eps Eri" in prepare(goes_on).surveys[0].targets.name
    # One that was empty as often as the strategy bears it, as well.
    once = small({"stop": {"after_empty": 1}}, universe={"observed": str(log_of(row))})
    assert "eps Eri" not in prepare(once).surveys[0].targets.name


def test_what_was_not_seen_is_not_found_as_often(log_of, small):
    """The same schedule with and without an empty visit behind it, on the day of its own best visit.

    That visit shows the planet less often; where else it may be, others show it more often. The orbit is that of 2006,
    which is found so often that the difference shows in 300 universes.
    """
    survey = prepare(small(universe={"known_planets": "archive_2019"})).surveys[0]
    mine = list(survey.targets.name).index("eps Eri")
    best = max((visit for visit in survey.schedule.visits if visit.star == mine), key=lambda visit: visit.gain)
    way, day = survey.options[mine][best.option], survey.calendar.day[mine, best.slot]
    date = Time(survey.calendar.start_mjd + day, format="mjd", scale="tai").isot
    row = f"eps Eri,{date},F520,{way.exposure_s},{way.n_frames:.0f},{way.em_gain},5,,0\n"
    logged = replace(survey, log=read_log(log_of(row)))
    before, after = (simulate_survey(one, block=0, n=300, seed=1) for one in (survey, logged))
    counts = [
        np.count_nonzero(
            (part.detections["star"] == "eps Eri")
            & (part.detections["known_row"] >= 0)
            & (part.detections["ordinal"] == best.ordinal)
        )
        for part in (before, after)
    ]
    assert counts[0] > 30
    assert counts[1] < 0.7 * counts[0]
    others = [part.detections["star"] != "eps Eri" for part in (before, after)]
    for name, values in before.detections.items():
        if name != "used_h":
            np.testing.assert_array_equal(values[others[0]], after.detections[name][others[1]])
