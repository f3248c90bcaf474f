"""Plans under doubt: played as another plan would be, and chosen as tables that can be worked out by hand say."""

import hashlib
import itertools
from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.planets import read_law
from cpic_planner.results import WhatIfResult
from cpic_planner.survey import load_strategies, run_whatif, varied, with_doubt
from cpic_planner.survey.doubt import decide, doubted, law_weights, played, quantiles, record_of, weights_of
from cpic_planner.survey.prepare import assumed_model, prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.strategy import DoubtRule
from cpic_planner.survey.universe import BLOCK
from cpic_planner.survey.whatif import whatif_cost

VALUES = ("0.02nm", "0.2nm")
STRATEGIES = ({"name": "plain"}, {"name": "dear", "value_known": 3.0, "visit": {"time_s": 18000}})
UNIVERSE = {"universes": BLOCK + 20, "background": "on"}


@pytest.fixture(scope="module")
def config(small):
    return with_doubt(small(*STRATEGIES, universe=UNIVERSE), f"drift={','.join(VALUES)}")


@pytest.fixture(scope="module")
def run(config, tmp_path_factory):
    folder, told = tmp_path_factory.mktemp("doubt"), []
    result = run_whatif(
        config, folder, pages=False, advance=lambda text, steps=1, /: told.extend([text] * steps)
    ).result
    return folder, result, told


@pytest.fixture(scope="module")
def plans(config):
    """Surveys of the two strategies, planned for each value."""
    return prepare(doubted(config)).surveys


def play(survey, n=100, block=0):
    return simulate_survey(survey, block=block, n=n, seed=1)


def same(one, other):
    for table in ("universes", "detections", "stars"):
        first, second = getattr(one, table), getattr(other, table)
        assert list(first) == list(second)
        for name in first:
            np.testing.assert_array_equal(first[name], second[name])


def test_a_plan_under_its_own_value_is_the_ordinary_survey_to_the_bit(config, plans):
    for plan in plans:
        own = played(plan, plan, config.universe)
        assert (own.noise_alarms, own.background_alarms) == (plan.noise_alarms, plan.background_alarms)
        same(play(own), play(plan))


def test_plans_are_those_of_the_comparison_that_varies_the_number(config, small):
    assert doubted(config) == varied(small(*STRATEGIES, universe=UNIVERSE), [f"drift={','.join(VALUES)}"])


def test_visits_and_frames_stay_and_light_is_that_of_the_truth(config, plans):
    calm, rough = plans[:2]
    found = played(calm, rough, config.universe)
    assert found.schedule is calm.schedule
    assert found.options is calm.options
    assert found.model is rough.model
    assert found.strategy.assumptions.drift == 4.0
    # What a visit shows is what the other model says of the same frames: brute force, one star and planet at a time.
    own, other = play(calm), play(found)
    margins = {name: tables.detections["margin"] for name, tables in (("own", own), ("other", other))}
    assert margins["other"].max() < margins["own"].max()
    assert other.universes["new_planets"].sum() < own.universes["new_planets"].sum()
    # Fainter stars in the background pass a threshold of less noise.
    assert np.sum(found.background_alarms[0]) < np.sum(calm.background_alarms[0])


def test_every_cell_is_a_replay_by_hand(run, config, plans):
    """The plan's calendar with an instrument that is made anew, block after block."""
    _, result, _ = run
    doubt = result.doubt
    assert [(value.text, value.weight > 0.0) for value in doubt.values] == [("0.02 nm", True), ("0.2 nm", True)]
    instrument = prepare(config).ground.instrument
    worth, planets, value = {}, {}, {}
    for s, strategy in enumerate(config.strategies):
        for p, t in ((0, 0), (0, 1), (1, 0), (1, 1)):
            plan, factor = plans[2 * s + p], (0.4, 4.0)[t]
            assumed = strategy.assumptions.model_copy(update={"drift": factor})
            model = assumed_model(instrument, strategy.model_copy(update={"assumptions": assumed}), ("F520",))
            survey = replace(plan, model=model)
            parts = [play(survey, n, block).universes for block, n in ((0, BLOCK), (1, 20))]
            names = "new_planets", "known_planets", "visits"
            new, known, visits = (np.concatenate([part[name] for part in parts]) for name in names)
            worth[s, p, t] = new + known
            planets[s, p, t] = strategy.value_new * new + strategy.value_known * known
            value[s, p, t] = planets[s, p, t] - 0.001 * visits
    means = {key: found.mean() for key, found in worth.items()}
    cells = {(cell.strategy, cell.planned_for, cell.played_under): cell for cell in doubt.cells}
    for (s, p, t), found in worth.items():
        cell = cells[config.strategies[s].name, doubt.values[p].text, doubt.values[t].text]
        best = max(means[key] for key in means if key[2] == t)
        assert cell.planets.mean == pytest.approx(found.mean())
        assert cell.loss.mean == pytest.approx(best - found.mean())
        assert cell.regret_of_planets.mean == pytest.approx((planets[s, t, t] - planets[s, p, t]).mean(), abs=1e-12)
        change = value[s, t, t] - value[s, p, t]
        assert cell.regret.mean == pytest.approx(change.mean(), abs=1e-12)
        assert cell.regret.error == pytest.approx(change.std(ddof=1) / np.sqrt(BLOCK + 20), abs=1e-12)
    largest = {
        (s, p): max(max(means[k] for k in means if k[2] == t) - means[s, p, t] for t in (0, 1))
        for s in (0, 1)
        for p in (0, 1)
    }
    assert doubt.decision.cautious.largest_loss == pytest.approx(min(largest.values()))
    w = [value.weight for value in doubt.values]
    expected = max(w[0] * means[s, p, 0] + w[1] * means[s, p, 1] for s in (0, 1) for p in (0, 1))
    assert doubt.decision.expected.planets == pytest.approx(expected)
    knowing = sum(w[t] * max(means[k] for k in means if k[2] == t) for t in (0, 1)) - expected
    assert doubt.decision.value_of_knowing.mean == pytest.approx(knowing)


def test_steps_are_told_and_the_result_is_kept(run, config):
    folder, result, told = run
    assert len(told) == whatif_cost(config).counts["n_steps"]
    assert WhatIfResult.model_validate_json((folder / "whatif.json").read_text()) == result


@pytest.mark.long
def test_workers_and_a_break_change_nothing(run, config, tmp_path):
    folder, *_ = run
    run_whatif(config, tmp_path, pages=False, workers=2)
    bodies = [(where / "whatif.json").read_bytes() for where in (folder, tmp_path)]
    assert len({hashlib.sha256(body).hexdigest() for body in bodies}) == 1
    assert run_whatif(config, tmp_path, pages=False).computed_parts == 0


def counts(config, found):
    shape = len(config.strategies), 2, 2, 4
    new = np.broadcast_to(np.asarray(found, float)[..., None], shape)
    return {"new_planets": new} | {name: np.zeros(shape) for name in ("known_planets", "visits", "hours")}


def test_the_statement_names_the_plans_and_where_they_lose(config):
    every = doubted(config)
    made = counts(config, [[[3.0, 0.0], [2.0, 1.0]], [[1.0, 2.0], [0.0, 2.0]]])
    said = record_of(config, every, made).statement
    assert "A cautious team takes plain planned for drift 0.2 nm: it loses at most 1.000 planets a survey" in said
    assert "where drift is really 0.02 nm and plain planned for 0.02 nm finds most" in said
    assert "By the weights of the values plain planned for drift 0.02 nm finds most" in said
    made = counts(config, [[[3.0, 2.0], [2.0, 1.0]], [[1.0, 2.0], [0.0, 2.0]]])
    said = record_of(config, every, made).statement
    assert "plain planned for drift 0.02 nm: no other plan finds more, whatever drift is. By the weights of" in said
    assert "it finds most" in said
    said = record_of(config, every, counts(config, np.zeros((2, 2, 2)))).statement
    assert said == "No plan finds any planets, whatever drift is."


def asked(**doubt):
    config = load_strategies({"strategies": [{"name": "one", "targets": {"names": ["eps Eri"]}}], "doubt": doubt})
    return config, doubted(config)


@pytest.mark.parametrize(
    ("doubt", "weights", "source"),
    [
        ({"key": "drift", "values": ["x0.5", "x1"], "weights": [1, 3]}, [0.25, 0.75], "given"),
        ({"key": "contrast", "values": [1e-9, 3e-9, "1e-8"]}, [1 / 3] * 3, "all the same"),
        ({"key": "exozodi", "values": ["3zodi", "null"]}, [0.5, 0.5], "all the same"),
        ({"key": "population", "values": ["giants", "solar_system"]}, [0.5, 0.5], "all the same"),
        # One factor for all bands, log-uniform from 0.63 to 2.42.
        ({"key": "throughput", "values": ["x0.7", "x2"]}, None, "the law of optical throughput"),
        ({"key": "drift", "values": ["0.05nm", "0.2nm"]}, None, "the law of wavefront drift"),
    ],
)
def test_weights_are_given_or_those_of_the_ensemble(doubt, weights, source):
    found, said = weights_of(*asked(**doubt))
    assert said.startswith(source)
    assert found.sum() == pytest.approx(1.0)
    if weights is None:
        (low, high), ends = ((1.0, 4.0), (0.1, 4.0)) if "drift" in said else ((0.7, 2.0), (0.63, 2.42))
        below = np.log(np.sqrt(low * high) / ends[0]) / np.log(ends[1] / ends[0])
        weights = [below, 1.0 - below]
    assert found.tolist() == pytest.approx(weights, abs=1e-4)


def test_a_file_and_the_option_say_the_same():
    file = {"key": "drift", "values": ["0.02nm", "0.1nm"]}
    config, _ = asked(**file)
    plain = load_strategies({"strategies": [{"name": "one", "targets": {"names": ["eps Eri"]}}]})
    assert with_doubt(plain, "drift=0.02nm, 0.1nm") == config
    assert with_doubt(plain, None) is plain
    assert plain.doubt is None
    single = load_strategies({"name": "one", "targets": {"names": ["eps Eri"]}, "doubt": file})
    assert single.doubt == config.doubt


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("max_visits=1,2", ("--doubt = max_visits", "everything else of a strategy is a choice")),
        ("drift=0.1nm,100pm", ("--doubt drift", "each value once")),
        ("drift=0.1,0.2", ("--doubt drift", "0.1nm")),
        ("drift.visit_nm=0.1nm,0.2nm", ("--doubt", "drift=0.1nm")),
    ],
)
def test_what_is_no_doubt_is_refused(refused, small, tmp_path, key, says):
    for part in says:
        refused(part, run_whatif, with_doubt(small(), key), tmp_path)


def test_a_number_that_varies_cannot_be_in_doubt_as_well(refused, small, tmp_path):
    both = with_doubt(varied(small(), ["drift=x1,x2"]), "drift=0.1nm,0.2nm")
    refused("not varied as well", run_whatif, both, tmp_path)


@pytest.mark.parametrize("text", ["drift", "drift=0.1nm", "=1,2", "drift=0.1nm,"])
def test_a_rule_needs_values(refused, text):
    refused("--doubt", DoubtRule.of, text)


@pytest.mark.parametrize("weights", [[1.0], [0.0, 0.0], [1.0, -1.0]])
def test_weights_fit_the_values(refused, weights):
    tree = {"strategies": [{"name": "one"}], "doubt": {"key": "drift", "values": ["x1", "x2"], "weights": weights}}
    refused("weights", load_strategies, tree)


# A textbook table: three plans under two values.
MEANS = np.array([[10.0, 0.0], [7.0, 4.0], [4.0, 6.0]])


def worth(means, scatter=0.0, n=50, seed=1):
    """Universes with these means exactly."""
    noise = np.random.default_rng(seed).normal(size=(*means.shape, n))
    return means[..., None] + scatter * (noise - noise.mean(axis=2, keepdims=True))


@pytest.mark.parametrize("scatter", [0.0, 3.0])
def test_a_table_by_hand(scatter):
    found = decide(worth(MEANS, scatter), np.array([0.25, 0.75]))
    np.testing.assert_allclose(found.loss, [[0.0, 6.0], [3.0, 2.0], [6.0, 0.0]], atol=1e-12)
    assert found.best.tolist() == [0, 2]
    assert found.cautious == 1  # largest losses 6, 3, 6
    assert found.expected == 2  # 2.5, 4.75, 5.5
    assert found.knowing.mean() == pytest.approx(0.25 * 10.0 + 0.75 * 6.0 - 5.5)


def test_equal_largest_losses_leave_the_choice_to_the_weights():
    found = decide(worth(np.array([[5.0, 3.0], [3.0, 5.0]])), np.array([0.4, 0.6]))
    assert (found.cautious, found.expected) == (1, 1)


@pytest.mark.parametrize("seed", range(20))
def test_every_choice_is_that_of_brute_force(seed):
    random = np.random.default_rng(seed)
    plans, values, universes = (int(n) for n in random.integers((2, 2, 3), (6, 5, 9)))
    made = random.poisson(1.5, (plans, values, universes)).astype(float)
    weights = random.dirichlet(np.ones(values))
    found = decide(made, weights)
    mean = [[sum(made[o, t]) / universes for t in range(values)] for o in range(plans)]
    expected = [sum(w * m for w, m in zip(weights, row, strict=True)) for row in mean]
    largest = [max(max(mean[q][t] for q in range(plans)) - mean[o][t] for t in range(values)) for o in range(plans)]
    assert expected[found.expected] == pytest.approx(max(expected))
    assert largest[found.cautious] == pytest.approx(min(largest))
    # Who knows the value may follow any rule from values to plans: the best of all rules less the best single plan.
    rules = itertools.product(range(plans), repeat=values)
    best = max(sum(w * mean[o][t] for t, (w, o) in enumerate(zip(weights, rule, strict=True))) for rule in rules)
    assert found.knowing.mean() == pytest.approx(best - max(expected))
    assert found.knowing.mean() >= -1e-12


def test_the_weight_of_a_value_is_the_part_of_the_law_nearest_to_it():
    law = read_law({"law": "log_uniform", "low": 0.1, "high": 4.0})
    shares = np.log(np.array([0.4, 1.0, 2.0, 4.0]) / 0.1) / np.log(40.0)
    ends = [0.0, *(0.5 * (shares[1:] + shares[:-1])), 1.0]
    order = [2, 0, 3, 1]
    found = law_weights(law, np.array([0.4, 1.0, 2.0, 4.0])[order])
    np.testing.assert_allclose(found, np.diff(ends)[order], atol=2e-5)
    # One value stands for everything; values beyond the law for what lies at its end.
    assert law_weights(law, np.array([1.0])) == pytest.approx([1.0])
    np.testing.assert_allclose(law_weights(law, np.array([0.01, 40.0])), [0.5, 0.5])


def test_weighted_quantiles_are_those_of_repeated_values():
    random = np.random.default_rng(3)
    values = random.normal(size=40)
    times = random.integers(1, 30, 40)
    every = np.repeat(values, times)
    expected = np.quantile(every, [0.05, 0.95], method="inverted_cdf")
    assert quantiles(values, times / times.sum()) == tuple(expected)
    assert quantiles(np.array([2.0, 1.0]), np.array([0.5, 0.5])) == (1.0, 2.0)
    assert quantiles(np.array([2.0, 1.0]), np.array([0.0, 1.0])) == (1.0, 1.0)
