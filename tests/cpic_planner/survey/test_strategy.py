"""Strategies as files state them, with values that are varied, and what they refuse."""

import re
from operator import attrgetter
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings, strategies as st

from cpic_core import InputError
from cpic_planner.survey import load_strategies, variation_lines, varied, with_exact_calendars, with_universe
from cpic_planner.survey.outcome import mean_interval
from cpic_planner.survey.strategy import SHORT_NAMES, SurveyStrategy, UniverseConfig, sources_of
from cpic_planner.survey.visibility import load_visibility
from simulator.config import load_instrument, validate

ONE = {"strategies": [{"name": "one", "revisits": {"max_visits": 4}}]}


def load(**more):
    return load_strategies(ONE | more)


def test_the_preset_has_five():
    config = load_strategies()
    assert (
        [item.name for item in config.strategies]
        == """
        single_visit multi_band wide_and_shallow few_and_deep known_planets_first
    """.split()
    )
    assert config.name == "survey_default"
    assert load_strategies("survey_default") == config


def test_what_is_left_out_is_that_of_the_defaults():
    config = load(
        defaults={"slot_share": 0.1, "visit": {"time_s": 100, "bands": ["F662"]}},
        strategies=[{"name": "a"}, {"name": "b", "slot_share": 0.2, "visit": {"bands": ["F850"]}}],
    )
    a, b = config.strategies
    assert (a.slot_share, a.visit.bands, a.visit.time_s) == (0.1, ("F662",), (100.0,))
    assert (b.slot_share, b.visit.bands, b.visit.time_s) == (0.2, ("F850",), (100.0,))
    shipped = load().strategies[0]
    assert a.time_budget_h == shipped.time_budget_h
    assert a.detection == shipped.detection
    assert a.description == ""


def test_one_strategy_alone(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("kind: strategy\nname: solo\nuniverse: {universes: 50}\nslot_share: {value: 0.1, source: me}\n")
    config = load_strategies(path)
    assert [item.name for item in config.strategies] == ["solo"]
    assert config.strategies[0].slot_share == 0.1
    assert config.universe.universes == 50
    assert load_strategies({"name": "solo"}).strategies[0].name == "solo"


def test_sources_of_numbers_follow_the_value():
    """A source stands for the value that it was given for, and for nothing that replaces it."""
    mine = {"value": 0.1, "source": "mine", "confidence": "P", "unit": ""}
    minute = {"value": 60, "unit": "s", "source": "c's"}
    config = load(
        universe={"slot_days": {"value": 20, "unit": "d", "source": "weeks"}, "universes": 50},
        defaults={"slot_share": mine, "visit": {"settlings": 3}},
        strategies=[{"name": "a"}, {"name": "b", "slot_share": 0.2}, {"name": "c", "visit": {"time_s": minute}}],
    )
    found = {(item.key, item.source): item for item in sources_of(config)}
    assert found["universe.slot_days", "weeks"].value == 20.0
    assert found["universe.slot_days", "weeks"].strategies == ["a", "b", "c"]
    share = found["slot_share", "mine"]
    assert (share.value, share.confidence, share.strategies) == (0.1, "P", ["a", "c"])
    assert [item.value for key, item in found.items() if key[0] == "visit.time_s"] == [[36000.0], [60.0]]
    assert found["visit.time_s", "c's"].strategies == ["c"]
    assert not any(key == "visit.settlings" for key, _ in found)
    law = [item for key, item in found.items() if key[0] == "detection.half_error"]
    assert [item.strategies for item in law] == [["a", "b", "c"]]
    assert law[0].value == config.strategies[0].detection.half_error
    # What is varied or given on the command line is nobody's.
    swept = sources_of(varied(with_universe(config, {"slot_days": 5.0}), ["slot_share=0.1,0.3"]))
    assert not any(item.key in ("slot_share", "universe.slot_days") for item in swept)
    times = next(item for item in swept if item.source == "c's")
    assert times.strategies == ["c slot_share=0.1", "c slot_share=0.3"]


@pytest.mark.parametrize("base", ["", "archive_2019+", "none+"])
def test_a_table_of_known_planets_beside_the_strategies(tmp_path, base):
    (tmp_path / "orbits.csv").write_text("star\n")
    path = tmp_path / "mine.yaml"
    path.write_text(f"universe: {{known_planets: {base}orbits.csv}}\nstrategies: [{{name: a}}]\n")
    assert load_strategies(path).universe.known_planets == f"{base}{tmp_path / 'orbits.csv'}"
    path.write_text(f"universe: {{known_planets: {base}elsewhere.csv}}\nstrategies: [{{name: a}}]\n")
    assert load_strategies(path).universe.known_planets == f"{base}elsewhere.csv"


def test_files_beside_the_strategies(tmp_path):
    (tmp_path / "log.csv").write_text("star\n")
    (tmp_path / "few.yaml").write_text("{base: giants, planets_per_star: 0.05}\n")
    path = tmp_path / "mine.yaml"
    path.write_text(
        "universe: {observed: log.csv, catalog: none.csv}\ndefaults: {population: few.yaml}\n"
        "strategies: [{name: a}, {name: b, population: giants}]\n"
    )
    config = load_strategies(path)
    assert config.name == "mine"
    assert config.universe.observed == str(tmp_path / "log.csv")
    assert config.universe.catalog == "none.csv"  # is not there: refused where it is read
    assert config.universe.instrument == "cpic_default"
    assert [item.population.planets_per_star for item in config.strategies] == [0.05, 0.21]


def test_slots_of_a_survey():
    for days, slot, n in ((3652.0, 30.0, 122), (60.0, 60.0, 1), (61.0, 60.0, 2), (91.0, 30.5, 3), (1.0, 1.0, 1)):
        assert UniverseConfig(duration_days=days, slot_days=slot).n_slots == n


def test_another_universe(refused):
    config = with_universe(load(), {"universes": 77, "duration_days": 10.0})
    assert (config.universe.universes, config.universe.slot_days) == (77, 10.0)
    assert with_universe(config, {}) is config
    refused(r"universe.duration_days = -1", with_universe, config, {"duration_days": -1.0})


def test_exact_calendars_change_nothing_else():
    config = load_strategies("survey_default")
    exact = with_exact_calendars(config)
    assert {item.scheduler.method for item in config.strategies} == {"auto"}
    assert {item.scheduler.method for item in exact.strategies} == {"exact"}
    assert with_exact_calendars(exact) == exact
    usual = [item.model_dump(exclude={"scheduler": {"method"}}) for item in config.strategies]
    assert [item.model_dump(exclude={"scheduler": {"method"}}) for item in exact.strategies] == usual
    assert exact.universe == config.universe


def test_the_former_name_of_a_share_says_which_two_it_could_be(refused):
    says = "strategies.share = 0.1: not accepted; allowed: slot_share or share_of_time .*one slot.*length of the survey"
    for tree in ({"defaults": {"share": 0.1}}, {"strategies": [{"name": "a", "share": 0.1}]}):
        refused(says, load, **tree)


def test_telescope_time_as_a_share_of_the_survey(refused):
    """One year at 5 %: 0.05 x 365 x 24 h = 438 h, whatever the hours of the layers below."""
    year = {"universe": {"duration_days": 365}}
    (one,) = load(**year, defaults={"share_of_time": 0.05}).strategies
    assert (one.time_budget_h, one.share_of_time) == (pytest.approx(438.0), 0.05)
    assert "time_budget_h" not in one.provenance
    own_hours, own_share = load(
        **year,
        defaults={"share_of_time": 0.05},
        strategies=[{"name": "a", "time_budget_h": 100}, {"name": "b", "share_of_time": 0.1}],
    ).strategies
    assert (own_hours.time_budget_h, own_hours.share_of_time) == (100.0, None)
    assert own_share.time_budget_h == pytest.approx(876.0)
    both = {"time_budget_h": 9, "share_of_time": 0.1}
    refused("strategies.share_of_time = given with time_budget_h 9", load, defaults=both)
    refused("share_of_time = 1.5", load, defaults={"share_of_time": 1.5})


def test_a_share_of_time_follows_the_length_of_the_survey():
    config = load(strategies=[{"name": "a", "share_of_time": 0.1}, {"name": "b", "time_budget_h": 100}])
    a, b = with_universe(config, {"duration_days": 100.0}).strategies
    assert (a.time_budget_h, b.time_budget_h) == (pytest.approx(240.0), 100.0)
    for asked in (with_universe(config, {"duration_days": 100.0}, 0.05), with_universe(config, {}, 0.05)):
        hours = 0.05 * 24.0 * asked.universe.duration_days
        assert [item.time_budget_h for item in asked.strategies] == [pytest.approx(hours)] * 2
    assert [item.share_of_time for item in config.strategies] == [0.1, None]  # left as it was


def test_a_share_of_time_is_varied(refused):
    config = load(universe={"duration_days": 100}, strategies=[{"name": "a", "share_of_time": 0.1}])
    swept = varied(config, ["share_of_time=0.05,x2"]).strategies
    assert [item.time_budget_h for item in swept] == [pytest.approx(120.0), pytest.approx(480.0)]
    (hours,) = varied(config, ["budget_h=50"]).strategies
    assert (hours.time_budget_h, hours.share_of_time) == (50.0, None)
    refused("--vary = budget_h and share_of_time", varied, config, ["budget_h=50", "share_of_time=0.1"])


def test_the_instrument_is_changed_for_all_strategies(refused):
    """One value for all, by the keys of the instrument; what strategies assume of it comes on top."""
    config = with_universe(load(), {"changes": ("drift=0.1nm", "throughput=x0.7")})
    made, own = config.universe.made_instrument(), load_instrument()
    assert made.drift.visit_nm == 0.1
    walk = own.drift.walk_nm_per_sqrt_hour
    assert made.drift.walk_nm_per_sqrt_hour == pytest.approx(walk * 0.1 / own.drift.visit_nm)
    passed = {name: band.t_opt for name, band in made.bands.items()}
    assert passed == pytest.approx({name: 0.7 * band.t_opt for name, band in own.bands.items()})
    (doubled,) = varied(config, ["drift=x2"]).strategies
    assert doubled.varied[0].text == "x2 (0.2 nm)"  # of the instrument as it was changed
    assert load(universe={"changes": ["throughput=x0.7"]}).universe.changes == ("throughput=x0.7",)
    assert "drift" in refused("drfit", with_universe, load(), {"changes": ("drfit=0.1nm",)})


def test_single_values_stand_for_lists():
    one = SurveyStrategy(
        name="x", visit={"bands": "F662", "time_s": 100}, targets={"names": "tau Cet"}, follow_up={"bands": "F850"}
    )
    assert one.visit.bands == ("F662",)
    assert one.visit.time_s == (100.0,)
    assert one.targets.names == ("tau Cet",)
    assert one.follow_up.wanted
    assert not SurveyStrategy(name="x").follow_up.wanted


def test_the_level_of_the_detection_is_that_of_the_reduction():
    with pytest.raises(InputError, match=r"give detection.sigma"):
        validate(SurveyStrategy, {"name": "x", "reduction": {"sigma": 3.0}, "detection": {"sigma": 4.0}}, where="x")
    assert SurveyStrategy(name="x", detection={"sigma": 3.0}).detection.sigma == 3.0
    assert SurveyStrategy(name="x", reduction={"sigma": 3.0}, detection={"sigma": 3.0}).reduction.sigma == 3.0


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


READERS = {
    "strategy": lambda tree: validate(SurveyStrategy, {"name": "x"} | tree, where="strategy"),
    "strategies": lambda tree: load_strategies(ONE | tree),
    "strategies_file": load_strategies,
    "vary": lambda sweep: varied(load_strategies(ONE), [sweep]),
    "mean_interval": mean_interval,
    "limits": load_visibility,
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
