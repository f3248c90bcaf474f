"""The stars ranked under an ensemble of instruments."""

import numpy as np
import pytest

import cpic_planner.ranking.sensitivity as module
from cpic_planner.etc import build_model
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import Change, EnsembleChoice, changed, load_ensemble
from cpic_planner.ranking import rank_targets, rank_under
from cpic_planner.ranking.sensitivity import instrument_of, states_of
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument
from simulator.imaging import mean_contrast

MODEL = build_model(load_instrument(), ["F520"])
STARS = rank_sample(v_mag_max=3.2)
SMALL = PopulationChoice(PopulationChoice.default().config, n_planets=300)
ASKED = {"time_s": 36000.0, "population": SMALL}
LAW = {"law": "log_uniform", "low": 0.1, "high": 4.0}
FEW = load_ensemble()
FEW = FEW.model_copy(update={"numbers": {key: FEW.numbers[key] for key in ("drift", "detector.cic_e", "overhead_s")}})
CHOICE = EnsembleChoice(FEW, 6, 1)


def ranked_alone(drawn):
    """The ranking of one drawn instrument, asked by its own configuration."""
    changes = [Change.scaling("drift", drawn["drift"])] if "drift" in drawn else []
    changes += [Change(key=key, value=drawn[key]) for key in ("detector.cic_e", "overhead_s") if key in drawn]
    model = build_model(changed(MODEL.instrument, changes), MODEL.bands)
    return {row.name: row for row in rank_targets(model, STARS, **ASKED).targets}


@pytest.fixture(scope="module")
def found():
    return rank_under(MODEL, STARS, CHOICE, **ASKED)


def test_rows_are_counts_over_rankings_of_each_instrument(found):
    """Brute force: each instrument as a configuration of its own."""
    draws = CHOICE.draws()
    alone = [ranked_alone({key: float(values[i]) for key, values in draws.items()}) for i in range(6)]
    for row in found.targets:
        own = [rows[row.name] for rows in alone]
        ranks = sorted(item.rank for item in own)
        assert row.p_reachable == pytest.approx(np.mean([item.status == "ok" for item in own]), abs=1e-12)
        assert row.p_rank_le_10 == pytest.approx(np.mean([rank <= 10 for rank in ranks]), abs=1e-12)
        assert (row.rank_p05, row.rank_median, row.rank_p95) == (ranks[0], ranks[2], ranks[5])
    total = [sum(row.expected_planets for row in rows.values()) for rows in alone]
    record = found.ensemble
    expected = np.quantile(total, [0.05, 0.5, 0.95])
    np.testing.assert_allclose([record.planets_p05, record.planets_median, record.planets_p95], expected, rtol=1e-9)
    assert record.n_stars == len(STARS)


def test_bars_are_rankings_with_one_number_changed(found):
    plain = rank_targets(MODEL, STARS, **ASKED)
    for bar in found.ensemble.bars:
        for share, planets, reached in (
            (0.05, bar.planets_low, bar.n_reachable_low),
            (0.95, bar.planets_high, bar.n_reachable_high),
        ):
            value = float(FEW.numbers[bar.key].law.quantile(np.array([share]))[0])
            rows = ranked_alone({bar.key: value}).values()
            assert planets == pytest.approx(sum(row.expected_planets for row in rows), rel=1e-9)
            assert reached == sum(row.status == "ok" for row in rows)
    lengths = [abs(bar.planets_high - bar.planets_low) for bar in found.ensemble.bars]
    assert lengths == sorted(lengths, reverse=True)
    assert found.ensemble.decides == "drift"
    assert "wavefront drift" in found.ensemble.statement
    assert found.ensemble.planets_nominal == pytest.approx(sum(row.expected_planets for row in plain.targets))
    assert [row.name for row in found.targets] == [row.name for row in plain.targets]
    assert found.config_hash != plain.config_hash


def test_stars_that_do_not_matter_take_ranks_from_few_instruments(found, monkeypatch):
    """With a small pool the stars that matter are found again, and have the same numbers as without one."""
    monkeypatch.setattr(module, "MOST_RANKED", 6)
    monkeypatch.setattr(module, "WHOLE", 3)
    small = rank_under(MODEL, STARS, CHOICE, **ASKED)
    assert small.ensemble.n_stars < len(STARS)
    assert small.ensemble.planets_p95 == pytest.approx(found.ensemble.planets_p95, rel=3e-3)
    for row, full in zip(small.targets, found.targets, strict=True):
        assert row.name == full.name
        assert row.p_reachable == full.p_reachable
        if full.rank_p95 <= 3:
            assert (row.rank_p05, row.rank_median, row.rank_p95) == (full.rank_p05, full.rank_median, full.rank_p95)


def test_the_contrast_is_that_of_a_dark_hole_between_measured_states():
    ensemble = load_ensemble()
    bright = instrument_of(MODEL, ensemble, states_of(MODEL, ensemble), {"contrast": 1.5e-8})
    assert mean_contrast(bright.metrics["F520"]) == pytest.approx(1.5e-8)
    assert bright.instrument == MODEL.instrument
    planets = [
        sum(row.expected_planets for row in rank_targets(model, STARS, **ASKED).targets) for model in (MODEL, bright)
    ]
    assert planets[1] < 0.7 * planets[0]


def test_bands_without_a_published_contrast_keep_their_hole():
    model, ensemble = build_model(load_instrument(), ["F850", "F940"]), load_ensemble()
    drawn = instrument_of(model, ensemble, states_of(model, ensemble), {"contrast": 5e-9})
    assert drawn.metrics["F940"] is model.metrics["F940"]
    assert mean_contrast(drawn.metrics["F850"]) == pytest.approx(5e-9)


def test_only_the_stars_that_are_asked_are_ranked_under_the_ensemble(found):
    chosen = np.arange(len(STARS)) % 2 == 0
    some = rank_under(MODEL, STARS, CHOICE, chosen=chosen, **ASKED)
    alone = rank_under(MODEL, STARS.select(chosen), CHOICE, **ASKED)
    assert [(row.name, row.rank_median, row.p_reachable) for row in some.targets] == [
        (row.name, row.rank_median, row.p_reachable) for row in alone.targets
    ]
    reached = {row.name: row.p_reachable for row in found.targets}
    assert all(row.p_reachable == reached[row.name] for row in some.targets)


def test_occurrence_scales_the_planets_and_nothing_else():
    only = FEW.model_copy(update={"numbers": {"planets_per_star": load_ensemble().numbers["planets_per_star"]}})
    result = rank_under(MODEL, STARS.select(np.arange(4)), EnsembleChoice(only, 8, 1), **ASKED)
    factors = EnsembleChoice(only, 8, 1).draws()["planets_per_star"]
    assert result.ensemble.planets_p95 == pytest.approx(
        result.ensemble.planets_nominal * np.quantile(factors, 0.95), rel=1e-9
    )
    assert all(row.rank_p05 == row.rank_p95 for row in result.targets)
    assert "No number alone changes the order" in result.ensemble.statement


def test_one_star_and_odd_questions(refused):
    one = rank_under(MODEL, STARS.select([0]), EnsembleChoice(FEW, 2, 1), **ASKED)
    assert one.targets[0].rank_median == 1.0
    assert one.ensemble.bars[0].tau_low is None
    beyond = {"numbers": {"contrast": {"label": "contrast", "value": 1e-6, "source": "a test"}}}
    refused("ensemble.contrast", rank_under, MODEL, STARS, EnsembleChoice(load_ensemble(beyond), 2, 1), **ASKED)
