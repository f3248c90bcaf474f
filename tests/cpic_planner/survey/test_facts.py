"""Which fact moved which number: each column is the run that anyone can make without that fact."""

import hashlib

import numpy as np
import pandas as pd
import pytest

from cpic_planner.results import WhatIfResult
from cpic_planner.survey import load_strategies, run_whatif, with_universe
from cpic_planner.survey.outcome import (
    ALL,
    FACTS,
    QUANTITIES,
    counts_of,
    difference_interval,
    facts_record,
    mean_interval,
    taken_back,
)
from cpic_planner.survey.whatif import whatif_cost

ALL_FACTS = ("known_planets", "rv", "stability", "known_giants", "companions", ALL)
STRATEGIES = ({"name": "plain"}, {"name": "plain 1", "visit": {"time_s": 18000}})
UNIVERSE = {"universes": 120, "exclusions": ["rv", "known_giants"], "facts": True}


def asked(**universe):
    return taken_back(with_universe(load_strategies(), {"facts": True} | universe))


def test_each_state_takes_one_fact_back():
    states = {name: state.universe for name, state in asked().items()}
    assert tuple(states) == ALL_FACTS
    now = with_universe(load_strategies(), {"facts": True}).universe
    changed = {
        "known_planets": {"known_planets": "archive_2019"},
        "rv": {"exclusions": ("stability", "known_giants")},
        "stability": {"exclusions": ("rv", "known_giants")},
        "known_giants": {"exclusions": ("rv", "stability")},
        "companions": {"catalog": "simbad_2012"},
        ALL: {"known_planets": "archive_2019", "exclusions": (), "catalog": "simbad_2012"},
    }
    for name, state in states.items():
        assert state == now.model_copy(update=changed[name]), name


@pytest.mark.parametrize(
    ("universe", "names"),
    [
        ({"facts": False}, ()),
        ({"known_planets": "off"}, ("rv", "stability", "known_giants", "companions", ALL)),
        ({"known_planets": "archive_2019"}, ("rv", "stability", "known_giants", "companions", ALL)),
        ({"known_planets": "none+mine.csv"}, ("rv", "stability", "known_giants", "companions", ALL)),
        ({"exclusions": "none"}, ("known_planets", "companions", ALL)),
        ({"exclusions": "rv", "known_planets": "off", "catalog": "simbad_2012"}, ("rv",)),
    ],
)
def test_facts_that_a_survey_does_not_use_are_left_out(universe, names):
    assert tuple(asked(**universe)) == names


def test_a_table_of_ones_own_is_laid_over_that_of_2019():
    for source in ("mine.csv", "snapshot+mine.csv"):
        assert asked(known_planets=source)["known_planets"].universe.known_planets == "archive_2019+mine.csv"


@pytest.fixture(scope="module")
def config(small):
    return small(*STRATEGIES, universe=UNIVERSE)


@pytest.fixture(scope="module")
def run(config, tmp_path_factory):
    """Two strategies, the name of one the beginning of the other's, with every fact that they use."""
    folder, told = tmp_path_factory.mktemp("facts"), []
    result = run_whatif(config, folder, pages=False, advance=lambda text, steps=1, /: told.append(steps)).result
    return folder, result, told


def universes_of(folder, strategy):
    columns = pd.read_parquet(folder / "universes.parquet")
    mine = columns["strategy"] == strategy
    return counts_of({name: columns[name][mine] for name in ("new_planets", "known_planets")})


@pytest.mark.parametrize("fact", ["known_planets", "rv", ALL])
def test_every_row_is_a_run_without_the_fact(run, config, tmp_path, fact):
    folder, result, _ = run
    state = with_universe(taken_back(config)[fact], {"facts": False})
    run_whatif(state, tmp_path / "separate", pages=False)
    for row in (row for row in result.facts.rows if row.fact == fact):
        before, now = (universes_of(where, row.strategy) for where in (tmp_path / "separate", folder))
        for name in QUANTITIES:
            mean, change = mean_interval(before[name]), difference_interval(before[name] - now[name])
            assert getattr(row, name).mean == mean.mean
            assert getattr(row, name).error == mean.error
            found = getattr(row, f"{name}_change")
            assert (found.mean, found.low, found.high) == (change.mean, change.low, change.high)


def test_the_record_says_what_was_taken_back(run):
    _, result, _ = run
    found = {item.name: item for item in result.facts.facts}
    assert tuple(found) == ("known_planets", "rv", "known_giants", "companions", ALL)
    assert found["known_planets"].known_planets == "archive_2019"
    assert found["companions"].catalog == "simbad_2012"
    assert [item.exclusions for item in found.values()] == [
        ["rv", "known_giants"],
        ["known_giants"],
        ["rv"],
        ["rv", "known_giants"],
        [],
    ]
    pairs = [(row.fact, row.strategy) for row in result.facts.rows]
    assert pairs == [(name, item["name"]) for name in found for item in STRATEGIES]


def test_velocities_take_new_planets_away(run):
    """Around eps Eri, tau Cet and alpha Centauri most giants would have been found."""
    _, result, _ = run
    change = next(row.new_planets_change for row in result.facts.rows if (row.fact, row.strategy) == ("rv", "plain"))
    assert change.mean > 0.0
    assert "The fact that moves most" in result.facts.statement


def test_steps_are_told_and_the_result_is_kept(run, config):
    folder, result, told = run
    assert sum(told) == whatif_cost(config).counts["n_steps"]
    assert WhatIfResult.model_validate_json((folder / "whatif.json").read_text()) == result


@pytest.mark.long
def test_workers_and_a_break_change_nothing(small, tmp_path):
    config = small(universe={"universes": 40, "exclusions": ["rv"], "facts": True})
    for name, workers in (("alone", 1), ("two", 2)):
        made = run_whatif(config, tmp_path / name, pages=False, workers=workers)
        assert made.computed_parts > 0
    assert [fact.name for fact in made.result.facts.facts] == ["known_planets", "rv", "companions", ALL]
    bodies = [(tmp_path / name / "whatif.json").read_bytes() for name in ("alone", "two")]
    assert len({hashlib.sha256(body).hexdigest() for body in bodies}) == 1
    again = run_whatif(config, tmp_path / "two", pages=False)
    assert again.computed_parts == 0


def test_without_being_asked_there_is_no_comparison(small, tmp_path):
    config = small(universe={"universes": 10})
    assert run_whatif(config, tmp_path, pages=False).result.facts is None


def counts(new, known):
    return counts_of({"new_planets": np.array(new), "known_planets": np.array(known)})


def test_the_statement_names_the_fact_that_moves_most_planets_and_most_new_ones(run, config):
    _, result, _ = run
    (outcome, _), zero = result.strategies, [0] * 200
    now = counts(zero, zero)
    one, two, rare = [1, 0] * 100, [2, 1] * 100, [1] + [0] * 199
    states = {fact.name: config for fact in FACTS}
    without = {name: [now] for name in states} | {"rv": [counts(one, zero)], "known_planets": [counts(zero, two)]}
    said = facts_record(states, [outcome], [now], without).statement
    assert said.startswith("The fact that moves most planets is what was published on known planets since 2019: plain")
    assert f"finds {outcome.planets.mean:.2f} with it and 1.50 without" in said
    assert "The fact that moves most new planets is what radial velocities exclude: plain finds" in said
    without["known_planets"] = [now]
    said = facts_record(states, [outcome], [now], without).statement
    assert said.count("The fact that moves most") == 1
    without["rv"] = [counts(rare, zero)]
    said = facts_record(states, [outcome], [now], without).statement
    assert said == "No single fact changes the planets found by more than chance."
