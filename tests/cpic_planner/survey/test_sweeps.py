"""``--vary``: what values mean, how they are told, and what is refused in one line."""

import re
from operator import attrgetter
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings, strategies as st

from cpic_planner.survey import load_strategies, variation_lines, varied, with_universe
from cpic_planner.survey.strategy import SHORT_NAMES

ONE = {"strategies": [{"name": "one", "revisits": {"max_visits": 4}}]}


def load(**more):
    return load_strategies(ONE | more)


VARIED = yaml.safe_load(Path(__file__).with_name("sweeps.yaml").read_text(encoding="utf-8"))


def listed(value):
    return [listed(item) for item in value] if isinstance(value, tuple) else value


@pytest.mark.parametrize(("sweep", "attribute", "values", "texts"), VARIED, ids=[item[0] for item in VARIED])
def test_every_kind_of_value_is_varied(sweep, attribute, values, texts):
    made = varied(load(), [sweep]).strategies
    assert [listed(attrgetter(attribute)(item)) for item in made] == values
    key = sweep.partition("=")[0]
    assert [item.name for item in made] == [f"one {key}={text}" for text in texts]
    for item in made:
        (setting,) = item.varied
        assert (setting.name, setting.key) == (key, SHORT_NAMES.get(key, key))
        assert item.name == f"one {setting.label}"
        assert setting.name in variation_lines(varied(load(), [sweep]))[0]
    # Nothing else changes.
    for item in made:
        plain, other = (one.model_dump(exclude={"name", "description"}) for one in (load().strategies[0], item))
        differ = [name for name in plain if plain[name] != other[name]]
        assert len(differ) <= 1


@settings(max_examples=40)
@given(
    number=st.floats(1e-3, 10.0).map(lambda value: f"{value:.3g}"),
    key=st.sampled_from(["drift", "exozodi", "throughput", "budget_h", "time_s", "revisits.min_gap_days"]),
    factor=st.booleans(),
)
def test_every_label_repeats_the_value_with_its_unit_or_its_x(number, key, factor):
    unit = {"drift": "nm", "exozodi": "zodi", "throughput": "", "budget_h": "h", "time_s": "s"}.get(key, "d")
    factor = factor or not unit
    factor = factor and key != "exozodi"  # the shipped instrument has no dust that could be multiplied
    made = varied(load(), [f"{key}={'x' if factor else ''}{number}{'' if factor else unit}"]).strategies[0]
    shown = f"x{number}" if factor else f"{number} {unit}"
    assert f"{key}={shown}" in made.name
    assert shown in made.varied[0].label
    if unit:
        assert re.search(rf" {unit}\)?$", made.name)
        assert made.varied[0].unit == unit


def test_what_drift_means_is_told_before_the_run():
    """0.1 nm where the instrument has 0.05 nm is twice the drift, and not a tenth of it."""
    config = varied(load(), ["drift=0.1nm,x0.1", "throughput=x0.5"])
    assert variation_lines(config) == [
        "drift 0.1 nm: 0.1 nm visit offset, 0.1 nm/sqrt(h) walk, x2 of the instrument's",
        "throughput x0.5: the optics pass 0.095 of the light",
        "drift x0.1: 0.005 nm visit offset, 0.005 nm/sqrt(h) walk, x0.1 of the instrument's",
    ]
    assert variation_lines(load()) == []


def test_a_varied_strategy_does_not_claim_what_it_was_before():
    tree = {"name": "deep", "description": "Up to twenty visits", "revisits": {"max_visits": 20}}
    one, two = varied(load(strategies=[tree]), ["max_visits=1,2"]).strategies
    assert one.description == "Up to twenty visits; here with max_visits=1"
    assert two.description == "Up to twenty visits; here with max_visits=2"


def test_sweeps_multiply():
    made = varied(load(strategies=[{"name": "a"}, {"name": "b"}]), ["contrast=1e-8,1e-9", "drift=x1,x2"]).strategies
    assert [item.name for item in made] == [
        f"{name} contrast={c} drift={d}"
        for name in "ab"
        for c in ("1e-8", "1e-9")
        for d in ("x1 (0.05 nm)", "x2 (0.1 nm)")
    ]


def test_nothing_is_a_multiple_of_an_instrument_without_drift(refused, tmp_path):
    path = tmp_path / "steady.yaml"
    path.write_text("name: steady\nbase: cpic_default\ndrift: {visit_nm: 0}\n")
    config = with_universe(load(), {"instrument": str(path)})
    for text in ("drift=0.1nm", "drift=x2"):
        refused("an instrument with drift", varied, config, [text])


@pytest.mark.parametrize("sweeps", [["contrast=1e-8", "contrast=1e-9"], ["contrast=1e-8", "assumptions.contrast=1e-9"]])
def test_each_key_once(refused, sweeps):
    refused("each key once", varied, load(), sweeps)


def test_too_many(refused):
    sweeps = [f"{key}={','.join(str(1 + k) for k in range(6))}" for key in ("time_s", "max_targets", "budget_h")]
    refused("216 strategies", varied, load(), sweeps)
