"""The ranking under other assumptions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kendalltau

import cpic_planner.ranking.sensitivity as module
from cpic_planner.etc import build_model
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import Strategy
from cpic_planner.ranking import KnownChoice, rank_targets
from cpic_planner.ranking.order import RankSetting
from cpic_planner.ranking.sensitivity import ASSUMPTIONS, Assumption, in_order, sensitivity
from cpic_planner.targets import rank_sample
from simulator.config import albedo_spec, load_instrument

MODEL = build_model(load_instrument(), ["F520", "F662"])
STARS = rank_sample(v_mag_max=3.5)
SMALL = PopulationChoice(PopulationChoice.default().config, n_planets=150)
ASKED = {"time_s": 7200.0, "population": SMALL}


def same(setting):
    return setting


def mirrored(setting):
    """Distances turned round: what was near is far."""
    return replace(setting, planet=setting.planet.model_copy(update={"radius_rjup": 0.1}))


def test_nothing_changed_changes_nothing():
    found = sensitivity(MODEL, STARS, assumptions=[Assumption("same", "nothing else", same)], **ASKED)
    row = found.rows[0]
    assert (row.kendall_tau, row.kept, row.largest_fall, row.largest_fall_ranks) == (1.0, 50, "", 0)
    assert row.kendall_tau_b == pytest.approx(1.0)
    assert 2 <= row.n_compared < 50
    assert row.n_ok == found.n_ok
    assert found.n_ranked == len(STARS)
    head = f"The reference planet is detected around {found.n_ok} of {len(STARS)} stars."
    told = "With nothing else it is detected around as many. All of the first 10 stars stay among the first 10."
    assert found.statement.startswith(f"{head} {told} The first star stays first. ")
    assert all(star.rank_lowest == star.rank == star.rank_highest for star in found.stars)


def test_stars_with_known_planets_are_ranked_again_by_them():
    """The albedo at 2 au is that of known planets too: the order of another table, not of a population."""
    choice = KnownChoice.at("snapshot", "2027-01-01", albedo_spec("jupiter"), load_instrument(), n_draws=60, seed=1)
    stars = choice.stars(STARS)
    found = sensitivity(MODEL, stars, time_s=7200.0, population=choice)
    assert found.top == len(stars)
    changed = next(item for item in ASSUMPTIONS if item.key == "albedo_2au").change(
        RankSetting.of(MODEL, time_s=7200.0, population=choice)
    )
    assert changed.population.albedo == changed.planet.albedo != choice.albedo


def test_tau_is_pairs_in_order_less_pairs_turned_round():
    found = sensitivity(MODEL, STARS, top=30, **ASKED)
    setting = RankSetting.of(
        MODEL, time_s=7200.0, bands=("F520", "F662"), population=SMALL, score="completeness_per_hour"
    )
    order = in_order(setting, STARS)
    nominal = order.rank
    assert np.count_nonzero(order.detected) == found.n_ok
    first = np.flatnonzero(nominal <= 30)
    assert [row.assumption for row in found.rows] == [item.key for item in ASSUMPTIONS]
    for row, item in zip(found.rows, ASSUMPTIONS, strict=True):
        other = in_order(item.change(setting), STARS)
        place = other.rank
        pairs = [np.sign((nominal[i] - nominal[j]) * (place[i] - place[j])) for i in first for j in first if i < j]
        assert row.kendall_tau == pytest.approx(np.mean(pairs), abs=1e-12)
        assert row.kept == np.count_nonzero(place[first] <= 30)
        assert row.n_ok == np.count_nonzero(other.detected)
        either = ((nominal <= 30) | (place <= 30)) & ((order.score > 0) | (other.score > 0))
        assert row.n_compared == np.count_nonzero(either)
        assert row.kendall_tau_b == pytest.approx(kendalltau(order.score[either], other.score[either]).statistic)
        assert row.best == STARS.name[np.argmin(place)]
        assert row.largest_fall_ranks == max((place - nominal)[first].max(), 0)
        assert row.kept_first == len({*STARS.name[nominal <= 10]} & {*STARS.name[place <= 10]})


@pytest.mark.parametrize("first", [1, 500])
def test_every_star_says_between_which_ranks_it_moves(first):
    """By ranking under each assumption, the nominal one included, for as many first stars as are asked."""
    some = [item for item in ASSUMPTIONS if item.key in ("drift_x2", "drift_x0.1", "albedo_2au")]
    found = sensitivity(MODEL, STARS, top=30, first=first, assumptions=some, **ASKED)
    setting = RankSetting.of(
        MODEL, time_s=7200.0, bands=("F520", "F662"), population=SMALL, score="completeness_per_hour"
    )
    orders = [in_order(one, STARS).rank for one in (setting, *(item.change(setting) for item in some))]
    assert found.first == min(first, 30)
    assert [star.rank for star in found.stars] == list(range(1, 31))
    for star in found.stars:
        at = int(np.flatnonzero(STARS.name == star.name)[0])
        ranks = [int(order[at]) for order in orders]
        assert (star.rank, star.rank_lowest, star.rank_highest) == (ranks[0], min(ranks), max(ranks))
    assert any(star.rank_lowest < star.rank_highest for star in found.stars)
    for row, order in zip(found.rows, orders[1:], strict=True):
        assert row.kept_first == np.count_nonzero(order[orders[0] <= found.first] <= found.first)


def test_an_assumption_that_turns_the_order_round_is_named(monkeypatch):
    """Scores with their sign changed: every pair changes its order."""
    real = module.ranked

    def turned(setting, targets, **more):
        found = real(setting, targets, **more)
        if setting.planet.radius_rjup == 0.1:
            mirror = replace(found.best, margin=-found.best.margin)
            names = np.argsort(np.argsort(STARS.name))
            found = replace(found, score=1.0 / found.score, best=replace(mirror, margin=mirror.margin - 1e-12 * names))
        return found

    monkeypatch.setattr(module, "ranked", turned)
    found = sensitivity(
        MODEL,
        STARS,
        score="detection_margin",
        time_s=7200.0,
        population=SMALL,
        assumptions=[Assumption("mirror", "the world turned round", mirrored)],
    )
    assert found.rows[0].kendall_tau < -0.5
    assert found.rows[0].kendall_tau_b < -0.5
    assert "changes most for the world turned round: Kendall's tau is -" in found.statement
    assert "Another star is first instead." in found.statement
    assert "decide" not in found.statement
    assert found.rows[0].largest_fall_ranks > 20


def test_stars_without_a_score_do_not_hide_what_an_assumption_changes():
    """Twice the drift takes most stars away that one visit detects, though the first 50 hardly change their ranks."""
    whole = build_model(load_instrument(), ["F520"], Strategy(visits=1))
    found = sensitivity(
        whole,
        rank_sample(v_mag_max=5.0),
        time_s=36000.0,
        population=SMALL,
        assumptions=[item for item in ASSUMPTIONS if item.key == "drift_x2"],
    )
    row = found.rows[0]
    assert row.kendall_tau > 0.8
    assert 0 < row.n_ok < 0.5 * found.n_ok
    assert row.n_compared < 60
    text = "With wavefront drift twice as large it is detected"
    number = f"around {found.n_ok} of {found.n_ranked} stars. {text} around {row.n_ok}."
    assert number in found.statement
    assert found.statement.index(number) < found.statement.index("Kendall's tau")


def test_detected_stars_are_counted_wherever_the_score_puts_them():
    """By the faintest contrast, stars with a detected planet stand anywhere: all are counted, under any assumption."""
    found = sensitivity(
        MODEL,
        STARS,
        time_s=7200.0,
        population=SMALL,
        score="contrast_limit",
        top=2,
        assumptions=[item for item in ASSUMPTIONS if item.key == "drift_x0.1"],
    )
    change = next(item.change for item in ASSUMPTIONS if item.key == "drift_x0.1")
    setting = RankSetting.of(MODEL, time_s=7200.0, bands=("F520", "F662"), population=SMALL, score="contrast_limit")
    every = in_order(change(setting), STARS)
    assert found.rows[0].n_ok == np.count_nonzero(every.detected)


def test_nominal_numbers_are_those_of_the_ranking():
    rank = rank_targets(MODEL, STARS, **ASKED)
    found = sensitivity(MODEL, STARS, assumptions=ASSUMPTIONS[:1], **ASKED)
    assert found.n_ok == rank.counts.get("ok", 0)
    assert found.rows[0].n_ok <= found.n_ok  # twice the drift


@pytest.mark.parametrize("item", ASSUMPTIONS, ids=lambda item: item.key)
def test_assumptions_change_what_they_say(item):
    before = RankSetting.of(MODEL, time_s=7200.0, population=SMALL)
    after = item.change(before)
    bands, old = after.model.instrument.bands, MODEL.instrument.bands
    drift = after.model.instrument.drift.visit_nm / MODEL.instrument.drift.visit_nm
    width = bands["F520"].width_nm / old["F520"].width_nm
    expected = {
        "drift_x2": (2.0, 1.0),
        "drift_x0.5": (0.5, 1.0),
        "drift_x0.1": (0.1, 1.0),
        "width_+50%": (1.0, 1.5),
        "width_-50%": (1.0, 0.5),
    }.get(item.key, (1.0, 1.0))
    assert (drift, width) == pytest.approx(expected)
    assert (bands["F520"].t_opt == 0.46) == (item.key == "t_opt_0.46")
    assert (after.planet != before.planet) == (item.key == "albedo_2au")
    assert (after.model.metrics is MODEL.metrics) == (item.key != "hole_1e-8")
    assert after.model.bands == MODEL.bands


def test_the_published_hole_stands_beside_the_default_one():
    """Its speckles and its light are those of the instrument `as_published`; other optics have no such neighbour."""
    setting = RankSetting.of(MODEL, time_s=7200.0, population=SMALL)
    item = next(item for item in ASSUMPTIONS if item.key == "hole_1e-8")
    found = in_order(item.change(setting), STARS)
    published = build_model(load_instrument("as_published"), MODEL.bands)
    alone = in_order(replace(setting, model=published), STARS)
    np.testing.assert_array_equal(found.rank, alone.rank)
    np.testing.assert_allclose(found.margin, alone.margin, rtol=1e-12)
    assert np.count_nonzero(found.detected) < np.count_nonzero(in_order(setting, STARS).detected)
    assert item.applies(setting)
    assert not item.applies(replace(setting, model=published))
    for other in ("as_published", "cpic_2q"):
        rows = sensitivity(build_model(load_instrument(other), ["F520"]), STARS, assumptions=[item], **ASKED).rows
        assert rows == []


def test_few_stars_and_odd_questions(refused):
    one = sensitivity(MODEL, STARS.select([0]), assumptions=ASSUMPTIONS[:1], **ASKED)
    assert one.rows[0].kendall_tau is None
    assert one.rows[0].kendall_tau_b is None
    assert "Too few stars have a score to compare their order." in one.statement
    for bad in ({"top": 0}, {"time_s": -1.0}, {"bands": ["F999"]}):
        refused("", sensitivity, MODEL, STARS, assumptions=ASSUMPTIONS[:1], **ASKED | bad)
    refused("targets", sensitivity, MODEL, STARS.select([]), assumptions=ASSUMPTIONS[:1], **ASKED)
