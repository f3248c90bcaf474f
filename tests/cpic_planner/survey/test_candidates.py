"""Stars worth a visit, and the planets with which schedules are made: drawn once for all that share them."""

from dataclasses import replace

import numpy as np
import pytest

import cpic_planner.survey.candidates as module
from catalogs import load_known_planets
from cpic_planner.etc import LEAST_PROBABILITY, build_model
from cpic_planner.planets import StarLimits, load_population
from cpic_planner.queries import Strategy
from cpic_planner.survey.calendar import make_calendar
from cpic_planner.survey.candidates import (
    N_DRAWS,
    N_KNOWN,
    Host,
    Looks,
    PlanningSky,
    candidates,
    chosen_stars,
    outlooks,
    screen,
    settings_of,
)
from cpic_planner.survey.detection import detection_chance, expected_signals, reach_au
from cpic_planner.survey.strategy import VisitRule
from cpic_planner.survey.universe import KNOWN_ALBEDO, NEW, albedos_of, at_known_place
from cpic_planner.survey.visibility import load_visibility
from cpic_planner.targets import find_target, rank_sample
from simulator import load_instrument

INSTRUMENT = load_instrument()


@pytest.fixture(scope="module")
def model():
    return build_model(INSTRUMENT, ("F520",), Strategy(visits=1))


@pytest.fixture(scope="module")
def everyone():
    return rank_sample(v_mag_max=7.0)


@pytest.fixture(scope="module")
def known():
    return load_known_planets()


def nothing(screened):
    """No planet of any star is excluded."""
    return StarLimits.of(screened.targets.name.tolist(), ())


def looked(strategy, model, everyone, known):
    """Screened stars with their calendar and candidates."""
    config = strategy
    rules = config.strategies[0]
    sky = PlanningSky(1, reach_au(model, 1.0))
    screened = screen(rules, model, *chosen_stars(rules, everyone, known), 1, sky)
    stars = screened.targets.select(screened.rows)
    calendar = make_calendar(config.universe, INSTRUMENT, load_visibility(), stars)
    return (
        screened,
        calendar,
        sky,
        candidates(screened, calendar, sky, nothing(screened), outlooks(screened, calendar, known)),
    )


@pytest.fixture(scope="module")
def three(small, model, everyone, known):
    return looked(small(), model, everyone, known)


def test_stars_worth_a_visit(three):
    screened, calendar, _, found = three
    assert [str(screened.targets.name[item.index]) for item in found] == ["eps Eri", "alf Cen A", "tau Cet"]
    worth = [item.worth for item in found]
    assert worth == sorted(worth, reverse=True)
    for item in found:
        assert item.chance.shape == (1, calendar.n_slots, len(item.weight))
        assert np.all((item.chance >= 0) & (item.chance <= 1))
        assert item.visits_left == 4
        impossible = ~np.isfinite(item.cost_h)
        assert not item.chance[impossible].any()
        with np.errstate(invalid="ignore"):
            per_hour = np.where(impossible, 0.0, item.chance @ item.weight / item.cost_h)
        assert item.worth == pytest.approx(per_hour.max(), rel=1e-6)


def test_chances_are_those_of_single_visits(three, small, model, known):
    screened, calendar, sky, found = three
    rules, item = small().strategies[0], found[0]
    place = list(screened.rows).index(item.index)
    star = screened.targets.select([item.index])
    host = Host(star, rules.population, known, item.known_rows)
    bodies = sky.planets(host, calendar.start_mjd)
    slot = int(np.flatnonzero(np.isfinite(item.cost_h[0]))[2])
    seen = expected_signals(
        model,
        star,
        item.options[0],
        bodies,
        albedos_of(rules.population),
        bodies.places([calendar.day[place, slot]]),
        [calendar.sun_pa_deg[place, slot]],
    )
    new = bodies.known == NEW
    nowhere = np.zeros(len(bodies), bool)
    odds = detection_chance(seen, rules.detection, nowhere, calibration=rules.detection.calibration)[0]
    value = (odds * np.where(new, 0.21 / N_DRAWS, 1.0 / N_KNOWN)).sum()
    assert float(item.chance[0, slot] @ item.weight) == pytest.approx(value, rel=1e-5)
    # All that stands for planets: those that no date shows are left out.
    assert item.weight.sum() <= 0.21 + len(item.known_rows)


def test_planets_that_are_excluded_weigh_less(three, known, excluding):
    screened, calendar, sky, found = three
    limits = excluding(screened.targets.name, 0.7)
    fewer = {
        item.index: item for item in candidates(screened, calendar, sky, limits, outlooks(screened, calendar, known))
    }
    for item in found:
        new = item.weight < 1.0 / N_KNOWN - 1e-12
        assert new.any()
        other = fewer[item.index]
        assert np.array_equal(other.chance, item.chance)
        np.testing.assert_allclose(other.weight, np.where(new, 0.3, 1.0) * item.weight, rtol=1e-12)
    everything = excluding(screened.targets.name, 1.0)
    assert {
        item.known_rows for item in candidates(screened, calendar, sky, everything, outlooks(screened, calendar, known))
    } <= {item.known_rows for item in found if item.known_rows}


def test_values_weigh_known_and_new_planets(small, model, everyone, known):
    worth = {}
    for label, values in {"plain": {}, "known": {"value_known": 5.0}, "new": {"value_new": 5.0}}.items():
        *_, found = looked(small(values), model, everyone, known)
        worth[label] = {item.known_rows: item.worth for item in found}
    for rows in worth["plain"]:
        assert worth["new"][rows] / worth["plain"][rows] <= 5.0 * (1 + 1e-6)
        assert worth["known"][rows] / worth["plain"][rows] <= 5.0 * (1 + 1e-6)
    alone = next(rows for rows in worth["plain"] if not rows)
    assert worth["new"][alone] == pytest.approx(5.0 * worth["plain"][alone], rel=1e-5)
    assert worth["known"][alone] == worth["plain"][alone]


def test_cuts(refused, small, everyone, known):
    everyone = everyone.select(np.argsort(everyone.distance_pc)[:60])

    def names(**cuts):
        rules = small({"targets": {"names": []} | cuts}).strategies[0]
        return set(chosen_stars(rules, everyone, known)[0].name)

    assert len(names()) == len(everyone)
    assert names(names=["tau Cet"]) == {"tau Cet"}
    assert names() - names(exclude=["tau Cet", "eps Eri"]) == {"tau Cet", "eps Eri"}
    distance = dict(zip(everyone.name, everyone.distance_pc, strict=True))
    assert all(distance[name] <= 5.0 for name in names(distance_max_pc=5.0))
    magnitude = dict(zip(everyone.name, everyone.v_mag, strict=True))
    assert all(magnitude[name] <= 3.0 for name in names(v_mag_max=3.0))
    hosts = names(known_planets="only")
    assert "eps Eri" in hosts
    assert "alf Cen A" not in hosts
    for cuts, text in (
        ({"names": ["Vulcan"]}, "targets.names = Vulcan"),
        ({"exclude": ["Vulcan"]}, "targets.exclude"),
        ({"distance_max_pc": 0.5}, "cuts that leave a star"),
    ):
        refused(text, names, **cuts)


def test_most_targets_and_known_planets_first(small, model, everyone, known):
    *_, found = looked(small({"targets": {"max_targets": 1}}), model, everyone, known)
    assert len(found) == 1
    screened, _, _, found = looked(small({"targets": {"known_planets": "first"}}), model, everyone, known)
    assert [str(screened.targets.name[item.index]) for item in found] == ["eps Eri", "tau Cet", "alf Cen A"]


def test_without_a_population_known_planets_alone_count(small, model, everyone, known):
    screened, _, _, found = looked(small({"population": None}), model, everyone, known)
    assert {str(screened.targets.name[item.index]) for item in found} <= {"eps Eri", "tau Cet"}
    assert all(item.weight.sum() <= len(item.known_rows) for item in found)
    assert not screened.promising.any()


def test_frames_of_a_visit(model, everyone):
    stars = everyone.select(np.flatnonzero(np.isin(everyone.name, ["tau Cet", "eps Eri"])))
    for setting in settings_of(model, stars, "F520", VisitRule(), 36000.0):
        assert setting.time_s <= 36000.0 * (1 + 1e-9)
        readout = model.camera("F520").readout_s
        frames = 2.0 * setting.n_frames * (setting.exposure_s + readout)
        assert setting.time_s == pytest.approx(frames + INSTRUMENT.overhead_s, rel=1e-9)
    given = VisitRule(exposure_s=10.0, em_gain=100.0)
    for setting in settings_of(model, stars, "F520", given, 3600.0):
        assert (setting.exposure_s, setting.em_gain) == (10.0, 100.0)
        assert setting.time_s <= 3600.0 * (1 + 1e-9)
        assert 20.0 * setting.n_frames <= 3600.0


def test_frames_of_each_of_several_visits(model, everyone):
    """Those given, and as many of them as one of four visits holds, each with references and overheads of its own."""
    stars = everyone.select(np.flatnonzero(np.isin(everyone.name, ["tau Cet", "eps Eri"])))
    many = replace(model, strategy=model.strategy.model_copy(update={"visits": 4}))
    for setting in settings_of(many, stars, "F520", VisitRule(exposure_s=10.0, em_gain=100.0), 14400.0):
        visit_s = setting.n_frames * (10.0 + model.camera("F520").readout_s)
        assert setting.n_frames >= 1
        assert setting.time_s == pytest.approx(4.0 * float(model.time_s(visit_s)), rel=1e-9)
        assert setting.time_s <= 14400.0 * (1 + 1e-9)


def test_visits_that_end_with_their_goal(model, everyone):
    stars = everyone.select(np.flatnonzero(np.isin(everyone.name, ["alf Cen A", "eps Eri"])))
    most = settings_of(model, stars, "F520", VisitRule(), 36000.0)
    for goal in (VisitRule(goal="snr", snr=2.0), VisitRule(goal="detect")):
        ends = settings_of(model, stars, "F520", goal, 36000.0)
        assert all(one.time_s <= other.time_s * (1 + 1e-9) for one, other in zip(ends, most, strict=True))
    quick = settings_of(model, stars, "F520", VisitRule(goal="snr", snr=2.0), 36000.0)
    slow = settings_of(model, stars, "F520", VisitRule(goal="snr", snr=4.0), 36000.0)
    assert all(one.time_s < other.time_s for one, other in zip(quick, slow, strict=True))
    # What cannot be reached takes all that the time pays.
    assert settings_of(model, stars, "F520", VisitRule(goal="snr", snr=1e5), 36000.0) == most


def test_impossible_frames_leave_a_star_out(three, small, model, known):
    screened, calendar, _, found = three
    none = tuple(tuple(replace(item, n_frames=0.0) for item in by_star) for by_star in screened.settings)
    assert outlooks(replace(screened, settings=none), calendar, known) == []
    assert outlooks(screened, calendar.closed_before(calendar.start_mjd + 1e6), known) == []
    assert found


EPOCH_MJD = 61771.0
DAYS = np.arange(0.0, 720.0, 60.0)
GIANTS = load_population("giants")


@pytest.fixture(scope="module")
def star():
    return find_target("eps Eri")[0]


@pytest.fixture
def sky(model):
    return PlanningSky(1, reach_au(model, 1.0))


def hosts(star, *sources):
    tables = [load_known_planets(source) for source in sources]
    return [Host(star, GIANTS, table, table.rows_of("eps Eri")) for table in tables]


@pytest.fixture(scope="module")
def looks(model, small, star):
    (option,) = settings_of(model, star, "F520", small().strategies[0].visit, 36000.0)
    possible = np.ones((1, DAYS.size), bool)
    possible[0, 3:5] = False
    return Looks((option,), possible, DAYS, np.linspace(0.0, 90.0, DAYS.size))


@pytest.fixture
def worked_out(monkeypatch):
    """Names of what is worked out, one for each call."""
    calls = []

    def noting(name):
        work = getattr(module, name)

        def noted(*arguments, **named):
            calls.append(name)
            return work(*arguments, **named)

        monkeypatch.setattr(module, name, noted)

    noting("draw_planet_sample")
    noting("pair_signals")
    return calls


def test_planets_are_drawn_once(sky, star, worked_out):
    host = Host(star, GIANTS, None, ())
    one = sky.planets(host, EPOCH_MJD)
    again = sky.planets(replace(host, population=load_population("giants")), EPOCH_MJD)
    assert np.array_equal(one.semi_major_axis_au, again.semi_major_axis_au)
    assert len(worked_out) == 1
    sky.planets(replace(host, population=load_population("solar_system")), EPOCH_MJD)
    sky.planets(host, EPOCH_MJD + 1.0)
    assert len(worked_out) == 3


def test_known_planets_count_by_what_their_rows_say(sky, star, worked_out):
    now, again, before = hosts(star, "snapshot", "snapshot", "archive_2019")
    sky.planets(now, EPOCH_MJD)
    sky.planets(again, EPOCH_MJD)
    assert len(worked_out) == 2  # the known planet, and the population
    found = sky.planets(before, EPOCH_MJD)
    assert len(worked_out) == 3
    assert set(found.known[found.known != NEW]) == set(before.known_rows)
    assert (found.kind[found.known != NEW] == len(GIANTS.mixture)).all()


def test_chances_are_worked_out_once_for_visits_and_planets(sky, model, small, star, looks, worked_out):
    """For all strategies and states of what is known that share them; what is new is worked out, and only that."""
    strategy, other, same = small(
        {"name": "one"}, {"name": "two", "detection": {"rule": "expected"}}, {"name": "three", "value_new": 2.0}
    ).strategies
    now, before = hosts(star, "snapshot", "archive_2019")

    def calls(strategy, host, looks):
        worked_out.clear()
        shown = sky.shown(strategy, model, host, looks, EPOCH_MJD)
        return shown, worked_out.count("pair_signals")

    one, number = calls(strategy, now, looks)
    assert number == 2
    again, number = calls(same, now, looks)
    assert number == 0
    for name in ("chance", "seen"):
        assert np.array_equal(getattr(again, name), getattr(one, name))
    for changed, number in (
        ((other, now, looks), 2),
        ((strategy, before, looks), 1),
        ((strategy, replace(now, star=replace(star, v_mag=star.v_mag + 0.1)), looks), 2),
        ((strategy, now, replace(looks, open=np.ones_like(looks.open))), 2),
        ((strategy, now, replace(looks, roll_deg=looks.roll_deg + 1.0)), 2),
    ):
        assert calls(*changed)[1] == number


def test_places_are_kept_for_one_star(model, small, star, looks):
    """Chances that visits show stay for all stars."""
    strategy, sky, kept = small().strategies[0], PlanningSky(1, reach_au(model, 1.0)), []
    (host,) = hosts(star, "snapshot")
    for v_mag, name in ((5.0, "one"), (5.1, "one"), (5.0, "other")):
        other = replace(star, name=np.array([name]), v_mag=np.array([v_mag]))
        sky.ways(strategy, model, replace(host, star=other), looks, EPOCH_MJD)
        kept.append(len(sky._pairs))
    assert kept == [2, 2, 2]
    before = sky.ways(strategy, model, replace(host, star=other), looks, EPOCH_MJD)
    assert all(
        one is two
        for one, two in zip(
            before[0], sky.ways(strategy, model, replace(host, star=other), looks, EPOCH_MJD)[0], strict=True
        )
    )


def test_what_the_sky_shows_is_that_of_single_visits(sky, model, small, star, looks):
    strategy, (host,) = small().strategies[0], hosts(star, "snapshot")
    shown = sky.shown(strategy, model, host, looks, EPOCH_MJD)
    planets, rule = shown.planets, strategy.detection
    whole = np.zeros((DAYS.size, len(planets)), np.float32)
    for slot in np.flatnonzero(looks.open[0]):
        places, roll = planets.places([DAYS[slot]]), [looks.roll_deg[slot]]
        seen = expected_signals(model, star, looks.options[0], planets, albedos_of(GIANTS), places, roll)
        placed = at_known_place(planets, host.known)
        whole[slot] = detection_chance(seen, rule, placed, calibration=rule.calibration)[0]
    assert np.array_equal(shown.seen, np.flatnonzero((whole >= LEAST_PROBABILITY).any(axis=0)))
    assert 0 < shown.seen.size < len(planets)
    whole[whole < LEAST_PROBABILITY] = 0.0
    np.testing.assert_allclose(shown.chance[0], whole[:, shown.seen], rtol=1e-6)


def test_albedos_by_kind():
    mixed = load_population("solar_system")
    assert albedos_of(None) == (KNOWN_ALBEDO,)
    assert len(albedos_of(mixed)) == len(mixed.mixture) + 1
    assert albedos_of(mixed)[-1] == KNOWN_ALBEDO
