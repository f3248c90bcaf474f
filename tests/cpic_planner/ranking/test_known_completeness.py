"""Known planets in completeness and ranking: against completeness of one population, and at their limits."""

import dataclasses

import numpy as np
import pytest

from catalogs import load_known_planets, load_stars
from cpic_planner.etc import build_model
from cpic_planner.ranking import KnownChoice, rank_targets
from cpic_planner.ranking.completeness import completeness, known_completeness, known_rows
from cpic_planner.ranking.order import RankSetting
from cpic_planner.results import KNOWN_PLANETS
from cpic_planner.targets import targets_from_table
from simulator import load_instrument
from simulator.config import albedo_spec

SETTING = {"exposure_s": 100.0, "n_frames": 200.0, "em_gain": 20.0}
JUPITER = albedo_spec("jupiter")


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), bands=("F520",))


@pytest.fixture(scope="module")
def everyone():
    return targets_from_table(load_stars())


def named(everyone, *names):
    return everyone.select([everyone.name.tolist().index(name) for name in names])


def choice(table=None, *, mjd=61771.0, n=400, seed=1, albedo=JUPITER):
    return KnownChoice(load_known_planets() if table is None else table, "2028-01-01T00:00:00", mjd, albedo, n, seed)


@pytest.fixture(scope="module")
def bright(tmp_path_factory):
    """Around tau Cet: a planet in the hole with every phase, another that is always there, one far outside."""
    path = tmp_path_factory.mktemp("known") / "bright.csv"
    path.write_text(
        "star,planet,a,e,mass,inclination,radius,star_mass\n"
        "tau Cet,tau Cet x,1.6,0.0,1,40,1.4,0.78\nHD 10700,tau Cet y,1.9,0.1,1,10,1.3,0.78\n"
        "tau Cet,tau Cet z,50,0,1,0,1.3,0.78\nno such star,n b,1,0,1,0,1,1\n"
    )
    return load_known_planets(f"none+{path}")


def test_rows_by_any_name_of_the_star(everyone, bright):
    rows = known_rows(bright, named(everyone, "tau Cet", "eps Eri"))
    assert rows == [(0, 1, 2), ()]
    assert choice(bright).stars(everyone).name.tolist() == ["tau Cet"]


def test_probability_of_at_least_one(model, everyone, bright):
    """Each planet by itself through the completeness of a population, and one minus the product of misses."""
    star = named(everyone, "tau Cet")
    sample = choice(bright).draw(star)
    found = known_completeness(model, star, "F520", sample, **SETTING)
    alone = [completeness(model, star, "F520", planets, **SETTING) for planets in sample.planets[0]]
    shares, blind = (
        np.array([getattr(one, name)[0] for one in alone]) for name in ("completeness_known_place", "completeness")
    )
    assert 0.05 < shares[0] < 1.0
    assert 0.05 < shares[1] < 1.0
    assert shares[2] == 0.0
    assert found.search == "known_place"
    assert found.counted[0] == found.completeness_known_place[0] == pytest.approx(1 - np.prod(1 - shares))
    assert found.completeness[0] == pytest.approx(1 - np.prod(1 - blind))
    assert found.expected_planets[0] == pytest.approx(shares.sum())
    assert found.in_zone[0] == pytest.approx(1 - np.prod([1 - one.in_zone[0] for one in alone]))
    assert found.observable[0] >= found.completeness_known_place[0]


def test_the_stated_error_is_the_scatter_over_seeds(model, everyone, bright):
    star = named(everyone, "tau Cet")
    made = [
        known_completeness(model, star, "F520", choice(bright, seed=seed, n=100).draw(star), **SETTING)
        for seed in range(60)
    ]
    scatter = np.std([one.counted[0] for one in made], ddof=1)
    stated = np.mean([one.standard_error[0] for one in made])
    assert scatter == pytest.approx(stated, rel=4 / np.sqrt(2 * 59))


def test_stars_without_planets_and_without_frames_have_none(model, everyone, bright):
    stars = named(everyone, "tau Cet", "eps Eri")
    sample = choice(bright).draw(stars)
    found = known_completeness(model, stars, "F520", sample, exposure_s=100.0, n_frames=[0, 200], em_gain=20.0)
    np.testing.assert_array_equal(found.completeness, 0.0)
    np.testing.assert_array_equal(found.expected_planets, 0.0)
    assert found.in_zone[0] > 0
    assert found.in_zone[1] == 0


def test_the_date_decides(model, everyone):
    """eps Eri b: in the hole at the beginning of 2027, nearly always outside in the middle of 2032."""
    star = named(everyone, "eps Eri")
    shares = [
        known_completeness(model, star, "F520", choice(mjd=mjd).draw(star), **SETTING).observable[0]
        for mjd in (61408.0, 63421.0)
    ]
    assert shares[0] > 0.05
    assert shares[1] < 0.1 * shares[0]


def test_refuted_planets_are_neither_drawn_nor_ranked(model, everyone):
    """omi2 Eri has no other planet, tau Cet three: refuted after 2019."""
    stars = named(everyone, "tau Cet", "omi2 Eri", "eps Eri")
    assert choice().stars(stars).name.tolist() == ["tau Cet", "eps Eri"]
    assert [len(planets) for planets in choice(n=20).draw(stars).planets] == [3, 0, 1]
    before = choice(load_known_planets("archive_2019"), n=20)
    assert before.stars(stars).name.tolist() == ["tau Cet", "omi2 Eri", "eps Eri"]
    assert [len(planets) for planets in before.draw(stars).planets] == [4, 1, 1]
    rank = rank_targets(model, stars, time_s=36000.0, population=choice(n=20))
    assert next(row for row in rank.targets if row.name == "omi2 Eri").expected_planets == 0.0


def test_ranked_with_known_planets(model, everyone, bright):
    stars = named(everyone, "eps Eri", "tau Cet")
    result = rank_targets(model, stars, time_s=36000.0, population=choice(bright, n=200))
    assert (result.population.name, result.population.n_planets) == (KNOWN_PLANETS, 200)
    assert "bright.csv" in result.population.description
    first, second = result.targets
    assert (first.name, second.completeness) == ("tau Cet", 0.0)
    assert result.search == "known_place"
    placed = first.completeness_known_place
    assert placed > 0.05
    assert first.expected_planets > placed - 1e-12
    assert first.score == pytest.approx(placed / first.completeness_time_s * 3600.0)


def test_what_decides_is_in_the_hash(model, everyone, bright):
    star = named(everyone, "tau Cet")

    def key(known):
        return RankSetting.of(model, time_s=3600.0, population=known).digest(star)

    nominal = key(choice(bright))
    assert key(choice(bright)) == nominal
    others = [
        choice(),
        choice(bright, mjd=61772.0),
        choice(bright, n=401),
        choice(bright, seed=2),
        choice(bright, albedo=albedo_spec(0.3)),
    ]
    assert len({nominal, *map(key, others)}) == 6


def test_refusals(refused, everyone, bright):
    refused("known_planets", choice(bright).stars, named(everyone, "eps Eri"))
    for change in ({"n_draws": 0}, {"mjd": np.nan}):
        refused("", dataclasses.replace(choice(bright), **change).draw, named(everyone, "tau Cet"))
