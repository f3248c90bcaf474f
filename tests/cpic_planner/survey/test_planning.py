"""Planets with which schedules are made: kept where nothing about a star has changed, drawn anew where it has."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from catalogs import load_known_planets
from cpic_planner.etc import LEAST_PROBABILITY, build_model
from cpic_planner.planets import load_population
from cpic_planner.survey import candidates
from cpic_planner.survey.candidates import Host, Looks, PlanningSky, _Latest, settings_of
from cpic_planner.survey.detection import detection_chance, expected_signals, reach_au
from cpic_planner.survey.universe import KNOWN_ALBEDO, NEW, albedos_of, at_known_place
from cpic_planner.targets import find_target
from simulator import load_instrument

EPOCH_MJD = 61771.0
DAYS = np.arange(0.0, 720.0, 60.0)
GIANTS = load_population("giants")


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), bands=("F520",))


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
        work = getattr(candidates, name)

        def noted(*arguments, **named):
            calls.append(name)
            return work(*arguments, **named)

        monkeypatch.setattr(candidates, name, noted)

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


def test_what_is_kept_has_a_limit():
    kept, made = _Latest[SimpleNamespace](3000), []

    def make(name):
        made.append(name)
        return SimpleNamespace(part=np.zeros(125))  # 1000 bytes

    for name in "abcabcdab":
        kept.get(name, lambda name=name: make(name))
    assert made == list("abcdab")


def test_chances_are_those_of_single_visits(sky, model, small, star, looks):
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
