"""Strategy files and ``--vary``: what is taken from where, and what is refused in one line."""

import pytest

from catalogs.errors import InputError
from cpic_planner.survey.strategy_file import UniverseConfig, load_strategies, sources_of, varied, with_universe

ONE = {"strategies": [{"name": "one", "revisits": {"max_visits": 4}}]}


def load(**more):
    return load_strategies(ONE | more)


def test_the_preset_has_five():
    config = load_strategies()
    assert [item.name for item in config.strategies] == [
        "single_visit", "multi_band", "wide_and_shallow", "few_and_deep", "known_planets_first",
    ]  # fmt: skip
    assert config.name == "survey_default"
    assert load_strategies("survey_default") == config


def test_what_is_left_out_is_that_of_the_defaults():
    config = load(defaults={"share": 0.1, "visit": {"time_s": 100, "bands": ["F662"]}},
                  strategies=[{"name": "a"}, {"name": "b", "share": 0.2, "visit": {"bands": ["F850"]}}])  # fmt: skip
    a, b = config.strategies
    assert (a.share, a.visit.bands, a.visit.time_s) == (0.1, ("F662",), (100.0,))
    assert (b.share, b.visit.bands, b.visit.time_s) == (0.2, ("F850",), (100.0,))
    shipped = load().strategies[0]
    assert a.time_budget_h == shipped.time_budget_h
    assert a.detection == shipped.detection
    assert a.description == ""


def test_one_strategy_alone(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("kind: strategy\nname: solo\nuniverse: {universes: 50}\nshare: {value: 0.1, source: me}\n")
    config = load_strategies(path)
    assert [item.name for item in config.strategies] == ["solo"]
    assert config.strategies[0].share == 0.1
    assert config.universe.universes == 50
    assert load_strategies({"name": "solo"}).strategies[0].name == "solo"


def test_sources_of_numbers_follow_the_value():
    """A source stands for the value that it was given for, and for nothing that replaces it."""
    mine = {"value": 0.1, "source": "mine", "confidence": "P", "unit": ""}
    minute = {"value": 60, "unit": "s", "source": "c's"}
    config = load(universe={"slot_days": {"value": 20, "unit": "d", "source": "weeks"}, "universes": 50},
                  defaults={"share": mine, "visit": {"settlings": 3}},
                  strategies=[{"name": "a"}, {"name": "b", "share": 0.2},
                              {"name": "c", "visit": {"time_s": minute}}])  # fmt: skip
    found = {(item.key, item.source): item for item in sources_of(config)}
    assert found["universe.slot_days", "weeks"].value == 20.0
    assert found["universe.slot_days", "weeks"].strategies == ["a", "b", "c"]
    share = found["share", "mine"]
    assert (share.value, share.confidence, share.strategies) == (0.1, "P", ["a", "c"])
    assert [item.value for key, item in found.items() if key[0] == "visit.time_s"] == [[36000.0], [60.0]]
    assert found["visit.time_s", "c's"].strategies == ["c"]
    assert not any(key == "visit.settlings" for key, _ in found)
    law = [item for key, item in found.items() if key[0] == "detection.blind_margin"]
    assert [item.strategies for item in law] == [["a", "b", "c"]]
    assert law[0].value == config.strategies[0].detection.blind_margin
    # What is varied or given on the command line is nobody's.
    swept = sources_of(varied(with_universe(config, {"slot_days": 5.0}), ["share=0.1,0.3"]))
    assert not any(item.key in ("share", "universe.slot_days") for item in swept)
    times = next(item for item in swept if item.source == "c's")
    assert times.strategies == ["c share=0.1", "c share=0.3"]


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
    path.write_text("universe: {observed: log.csv, catalog: none.csv}\ndefaults: {population: few.yaml}\n"
                    "strategies: [{name: a}, {name: b, population: giants}]\n")  # fmt: skip
    config = load_strategies(path)
    assert config.name == "mine"
    assert config.universe.observed == str(tmp_path / "log.csv")
    assert config.universe.catalog == "none.csv"  # is not there: refused where it is read
    assert config.universe.instrument == "cpic_default"
    assert [item.population.planets_per_star for item in config.strategies] == [0.05, 0.21]


FAULTS = [
    ({"strategies": []}, "strategies.strategies"),
    ({"strategies": 3}, "a list of mappings"),
    ({"strategies": [3]}, "a list of mappings"),
    ({"strategies": [{}]}, "strategies.strategies.0.name = missing"),
    ({"strategies": [{"name": "a"}, {"name": "a"}]}, "name = a: not accepted; allowed: each name once"),
    ({"strategies": [{"name": "a"}, {"name": "b", "visit": {"bandz": 1}}]}, "strategies.1.visit.bandz"),
    ({"defaults": 3}, "strategies.defaults = 3"),
    ({"defaults": {"foo": 3}}, "foo = 3"),
    ({"universe": 3}, "strategies.universe = 3"),
    ({"universe": {"foo": 3}}, "universe.foo = 3"),
    ({"universe": {"universes": 1}}, "universe.universes = 1"),
    ({"universe": {"slot_days": 100, "duration_days": 50}}, "universe.slot_days = 100"),
    ({"universe": {"start_utc": "yesterday"}}, "universe.start_utc = yesterday"),
    ({"universe": {"seed": -1}}, "universe.seed = -1"),
    ({"universe": {"background": "maybe"}}, "universe.background = maybe"),
    ({"kind": "plan"}, "strategies.kind"),
    ({"foo": 1}, "strategies.foo = 1"),
]


@pytest.mark.parametrize(("tree", "text"), FAULTS, ids=[text for _, text in FAULTS])
def test_one_clear_line(tree, text):
    with pytest.raises(InputError) as fault:
        load(**tree)
    assert text in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize("source", ["nowhere.yaml", "nothing", [1], 3, None])
def test_no_strategies_at_all(source):
    with pytest.raises(InputError, match="strategies"):
        load_strategies(source)


def test_slots_of_a_survey():
    for days, slot, n in ((3652.0, 30.0, 122), (60.0, 60.0, 1), (61.0, 60.0, 2), (91.0, 30.5, 3), (1.0, 1.0, 1)):
        assert UniverseConfig(duration_days=days, slot_days=slot).n_slots == n


def test_another_universe():
    config = with_universe(load(), {"universes": 77, "duration_days": 10.0})
    assert (config.universe.universes, config.universe.slot_days) == (77, 10.0)
    assert with_universe(config, {}) is config
    with pytest.raises(InputError, match=r"universe.duration_days = -1"):
        with_universe(config, {"duration_days": -1.0})


VARIED = [
    ("contrast=1e-8,3e-9", lambda s: s.assumptions.contrast, [1e-8, 3e-9]),
    ("assumptions.drift=1,2", lambda s: s.assumptions.drift, [1.0, 2.0]),
    ("time_s=3600,36000", lambda s: s.visit.time_s, [(3600.0,), (36000.0,)]),
    ("visit.time_s=[3600,7200],36000", lambda s: s.visit.time_s, [(3600.0, 7200.0), (36000.0,)]),
    ("visit.bands=F520,F662", lambda s: s.visit.bands, [("F520",), ("F662",)]),
    ("visit.bands=[F520,F662],F850", lambda s: s.visit.bands, [("F520", "F662"), ("F850",)]),
    ("targets.names=eps Eri,tau Cet", lambda s: s.targets.names, [("eps Eri",), ("tau Cet",)]),
    ("max_visits=1, 4", lambda s: s.revisits.max_visits, [1, 4]),
    ("rule=expected,blind", lambda s: s.detection.rule, ["expected", "blind"]),
    ("stop.after_detection=true,false", lambda s: s.stop.after_detection, [True, False]),
    ("stop.after_empty=null,3", lambda s: s.stop.after_empty, [None, 3]),
    ("budget_h=100", lambda s: s.time_budget_h, [100.0]),
    ("population=giants,solar_system", lambda s: s.population.name, ["giants", "solar_system"]),
    ("reduction.reference_star={v_mag: 3, teff_k: 5000}", lambda s: s.reduction.reference_star.v_mag, [3.0]),
]


@pytest.mark.parametrize(("sweep", "read", "values"), VARIED, ids=[item[0] for item in VARIED])
def test_every_kind_of_value_is_varied(sweep, read, values):
    made = varied(load(), [sweep]).strategies
    assert [read(item) for item in made] == values
    key = sweep.partition("=")[0]
    assert all(item.name.startswith(f"one {key}=") for item in made)
    # Nothing else changes.
    for item in made:
        plain, other = (one.model_dump(exclude={"name"}) for one in (load().strategies[0], item))
        differ = [name for name in plain if plain[name] != other[name]]
        assert len(differ) <= 1


def test_sweeps_multiply():
    made = varied(load(strategies=[{"name": "a"}, {"name": "b"}]), ["contrast=1e-8,1e-9", "drift=1,2"]).strategies
    assert [item.name for item in made] == [
        f"{name} contrast={c} drift={d}" for name in "ab" for c in ("1e-8", "1e-9") for d in "12"
    ]  # fmt: skip


REFUSED = [
    ("contrast", "KEY=VALUE"), ("contrast=", "KEY=VALUE"), ("=3", "KEY=VALUE"), ("contrast=1e-8,", "between commas"),
    ("contrast=1e-8,,1e-9", "between commas"), ("contrast=abc", "assumptions.contrast = abc"),
    ("contrast=2", "assumptions.contrast = 2"), ("foo=1", "= foo"), ("visit=3", "= visit"), ("name=a,b", "= name"),
    ("description=a", "= description"), ("contrast=1e-8,1e-8", "each value once"),
    ("max_visits=1.5", "max_visits = 1.5"), ("rule=guess", "detection.rule = guess"),
    ("population=unicorns", "population = unicorns"),
    ("visit.bands=[F520,F662", "--vary"), ("detection.visits_needed=9", "revisits.max_visits = 4"),
    ("known_planets=first", "targets.known_planets"), ("reduction.sigma=3,4", "give detection.sigma"),
    ("contrast=.nan", "contrast = nan"), ("targets.max_targets=null", "targets.max_targets"),
]  # fmt: skip


@pytest.mark.parametrize(("sweep", "text"), REFUSED, ids=[item[0] for item in REFUSED])
def test_sweeps_that_are_refused_in_one_line(sweep, text):
    with pytest.raises(InputError) as fault:
        varied(load(), [sweep])
    assert str(fault.value).startswith("--vary")
    assert text in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize("sweeps", [["contrast=1e-8", "contrast=1e-9"], ["contrast=1e-8", "assumptions.contrast=1e-9"]])
def test_each_key_once(sweeps):
    with pytest.raises(InputError, match="each key once"):
        varied(load(), sweeps)


def test_too_many():
    sweeps = [f"{key}={','.join(str(1 + k) for k in range(6))}" for key in ("drift", "max_targets", "budget_h")]
    with pytest.raises(InputError, match="216 strategies"):
        varied(load(), sweeps)
