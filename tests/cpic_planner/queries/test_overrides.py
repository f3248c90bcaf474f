import copy
import json
import math

import pytest
from astropy import units as u

from cpic_core import InputError
from cpic_planner.queries import Change, SimulatorOverrides
from cpic_planner.queries.changes import ALIASES, alterations, is_optical
from simulator.config import load_instrument, load_scene, unit_of
from simulator.imaging import metrics_key
from simulator.target import scene_sources

NOMINAL = load_instrument()
VALUES = json.loads(NOMINAL.model_dump_json())


def leaves(tree, path=""):
    for name, item in tree.items():
        if isinstance(item, dict):
            yield from leaves(item, f"{path}{name}.")
        else:
            yield f"{path}{name}", item


def differing(one, other):
    before, after = dict(leaves(one.model_dump())), dict(leaves(other.model_dump()))
    return {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)} - {"name"}


def altered(*items):
    return SimulatorOverrides.of(items).instrument(NOMINAL)


def test_nothing_altered_is_the_nominal_instrument():
    for source in (None, {}, [], SimulatorOverrides()):
        none = SimulatorOverrides.of(source)
        assert none.entries == ()
        assert not none.alters_optics
        assert none.instrument(NOMINAL) is NOMINAL
        assert none.companions("on") == "on"
        assert none.companions("off") == "off"
        assert none.text() == "none"


def test_the_usual_questions():
    assert differing(NOMINAL, dimmed := altered("throughput=x0.7")) == {f"bands.{band}.t_opt" for band in NOMINAL.bands}
    assert dimmed.bands["F520"].t_opt == pytest.approx(0.7 * NOMINAL.bands["F520"].t_opt, rel=1e-15)
    assert altered("read_noise=x1.5").detector.read_noise_e == 165.0
    assert altered("visit_drift=x3").drift.visit_nm == pytest.approx(0.15, rel=1e-15)
    assert altered("walk=x3").drift.walk_nm_per_sqrt_hour == pytest.approx(0.15, rel=1e-15)
    both = altered("read_noise=*1.5", "visit_drift=x 3", "detector.cic_e=0.05")
    assert differing(NOMINAL, both) == {"detector.read_noise_e", "drift.visit_nm", "detector.cic_e"}
    assert both.detector.cic_e == 0.05


@pytest.mark.parametrize("name", ALIASES)
def test_every_short_name_is_of_a_key_of_the_instrument(name):
    unit = unit_of(ALIASES[name])
    half = SimulatorOverrides.of({name: f"0.5 {unit}"} if unit else {ALIASES[name]: 0.5})
    values = alterations(NOMINAL, half.entries).values()
    assert values
    assert all(after == 0.5 for _, _, after in values)
    for _, before, after in alterations(NOMINAL, SimulatorOverrides.of(f"{name}=x2").entries).values():
        assert after == 2.0 * before


def test_drift_is_the_offset_of_a_visit_and_the_walk_in_the_same_ratio(refused):
    nominal = NOMINAL.drift
    assert (nominal.visit_nm, nominal.walk_nm_per_sqrt_hour) == (0.05, 0.05)
    for text in ("drift=x2", "drift=0.1nm", "drift=100 pm", "drift=1e-4um"):
        made = altered(text)
        assert differing(NOMINAL, made) == {"drift.visit_nm", "drift.walk_nm_per_sqrt_hour"}
        assert made.drift.visit_nm == 0.1
        assert made.drift.walk_nm_per_sqrt_hour == pytest.approx(0.1, rel=1e-15)
    one = SimulatorOverrides.of("drift=100pm")
    assert one.text() == "drift = 0.1 nm"
    assert SimulatorOverrides.of(one.as_mapping()) == one
    assert SimulatorOverrides.of({"drift": 0.1 * u.nm}) == one
    steady = NOMINAL.changed({"drift": {"visit_nm": 0.0}})
    refused(r"simulator_overrides.drift = 0.1 nm: .*drift.visit_nm is 0", one.instrument, steady)
    with pytest.raises(InputError, match="drift.visit_nm = 0.2: .*once"):
        SimulatorOverrides.of(["drift=x2", "drift.visit_nm=0.2"]).instrument(NOMINAL)


def test_values_are_converted_to_the_unit_of_their_key():
    made = altered(
        "visit_drift=70pm",
        "detector.pixel_scale_arcsec=16.0mas",
        "jitter=0.005arcsec",
        "exozodi=3zodi",
        "read_noise=160 e-",
        "walk=200pm/sqrt(h)",
        "bands.*.qe=80%",
    )
    assert made.drift.visit_nm == 0.07
    assert made.drift.walk_nm_per_sqrt_hour == 0.2
    assert made.detector.pixel_scale_arcsec == 0.016
    assert made.wavefront.jitter_mas == 5.0
    assert made.sky.exozodi_zodis == 3.0
    assert made.detector.read_noise_e == 160.0
    assert {band.qe for band in made.bands.values()} == {0.8}


def test_texts_have_units():
    given = {"detector.cic_e": 0.05, "visit_drift": "0.1nm", "walk": "x3", "bands.*.t_opt": 0.2}
    assert SimulatorOverrides.of(given).text() == (
        "throughput = 0.2, clock_charge = 0.05 e-, visit_drift = 0.1 nm, walk x3"
    )


def test_one_content_however_it_is_written(tmp_path):
    path = tmp_path / "reality.yaml"
    path.write_text("kind: simulator_overrides\ncompanions: on\ndetector: {read_noise_e: x1.50}\nthroughput: '*0.7'\n")
    sources = [
        ["throughput=x0.7", "read_noise=x1.5", "companions=on"],
        ["companions=on", "bands.*.t_opt=*0.7", "detector.read_noise_e=x1.5"],
        {"throughput": "x0.7", "detector": {"read_noise_e": "x1.5"}, "companions": True},
        path,
        [str(path)],
    ]
    found = [SimulatorOverrides.of(source) for source in sources]
    assert len({one.content_hash for one in found}) == 1
    assert all(one == found[0] for one in found)
    assert found[0].text() == "throughput x0.7, companions on, read_noise x1.5"
    one, two = (SimulatorOverrides.of(f"bands.*.t_opt={text}") for text in ("x0.8", "0.8"))
    assert one.content_hash != two.content_hash
    assert SimulatorOverrides.of("detector.cic_e=2") == SimulatorOverrides.of({"detector.cic_e": 2.0})


def test_survives_json_and_mappings():
    one = SimulatorOverrides.of(
        "throughput=x0.7 cosmic_rays.model=paper detector.switches.dark=off companions=off mirror.bits=null".split()
    )
    assert SimulatorOverrides.model_validate_json(one.model_dump_json()) == one
    assert SimulatorOverrides.of(one.as_mapping()) == one
    assert SimulatorOverrides.of(copy.deepcopy(one)) == one


def test_companions_are_those_of_the_scene():
    scene = load_scene("paper_science")
    on, off = SimulatorOverrides.of("companions=on"), SimulatorOverrides.of({"companions": "off"})
    assert (on.companions("off"), off.companions("on")) == ("on", "off")
    assert on.instrument(NOMINAL) is NOMINAL
    assert on.scene(scene).companions == "on"
    assert off.scene(scene) is scene
    assert on.scene(scene).planets == scene.planets


def test_words_truth_values_and_values_not_set():
    made = altered(
        "cosmic_rays.model=paper",
        "detector.switches.cosmic_rays=off",
        "detector.switches.interference=false",
        "sky.stray_light.rate_e_s=0.01",
        "mirror.bits=null",
        "mission.obsid_prefix=7",
        "coronagraph.inner_arcsec.F520=0.3",
        "detector.register_stages=x0.5",
    )
    assert made.cosmic_rays.model == "paper"
    assert made.detector.switches.cosmic_rays is False
    assert made.detector.switches.interference is False
    assert made.sky.stray_light.rate_e_s == 0.01
    assert made.mirror.bits is None
    assert made.mission.obsid_prefix == "7"
    assert made.coronagraph.inner_arcsec == {"F520": 0.3}
    assert made.detector.register_stages == 302


def test_stars_stand_for_names():
    made = altered("bands.F5*.qe=x0.5", "bands.*2.t_opt=0.1")
    assert differing(NOMINAL, made) == {"bands.F520.qe", "bands.F662.t_opt", "bands.F1542.t_opt"}


def test_the_altered_instrument_says_so():
    made = altered("read_noise=x1.5")
    assert made.name == "cpic_default+overrides"
    standing = made.provenance["detector.read_noise_e"]
    assert "read_noise x1.5" in standing.source
    assert "110" in standing.source
    assert made.provenance["detector.cic_e"] == NOMINAL.provenance["detector.cic_e"]


def test_changes_are_a_table():
    ((key, (_, before, after)),) = alterations(NOMINAL, SimulatorOverrides.of("read_noise=x1.5").entries).items()
    assert (key, before, after) == ("detector.read_noise_e", 110.0, 165.0)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("read_nose=x2", ("simulator_overrides.read_nose = x2:", "did you mean read_noise")),
        ("detector.read_noise=5", ("detector.read_noise = 5", "did you mean detector.read_noise_e")),
        ("bands.F521.t_opt=0.2", ("bands.F521.t_opt = 0.2", "did you mean bands.F520.t_opt")),
        ("bands.*.foo=0.2", ("bands.*.foo", "known keys: bands.F520")),
        ("nothing_like_it=1", ("nothing_like_it = 1", "known keys: telescope", "short ones: throughput", "companions")),
        ("name=5", ("simulator_overrides.name", "a key of the instrument")),
        ("detector=3", ("simulator_overrides.detector = 3", "a single value", "read_noise_e")),
        ("throughput=x6", ("bands.*.t_opt = x6", "above 0, at most 1", "is 0.19, and would be 1.14")),
        ("bands.*.t_opt=2", ("bands.*.t_opt = 2", "above 0, at most 1")),
        ("read_noise=-1e-", ("read_noise_e = -1 e-", "0 to 100000")),
        ("read_noise=nan", ("read_noise_e = nan", "0 to 100000")),
        ("read_noise=.inf", ("read_noise_e = inf", "finite")),
        ("read_noise=x-1", ("read_noise_e = x-1", "at least 0")),
        ("read_noise=x0,7", ("read_noise_e = x0,7", "a factor", "x0.7")),
        (
            "visit_drift=0.1",
            (
                "simulator_overrides.visit_drift = 0.1: not accepted; allowed: a unit (nm), or an x before "
                "a factor (visit_drift=x0.1 is 0.1 times the instrument's 0.05 nm: 0.005 nm; "
                "visit_drift=0.1nm is 0.1 nm)",
            ),
        ),
        ("drift=0.1", ("drift=x0.1 is 0.1 times the instrument's 0.05 nm: 0.005 nm; drift=0.1nm is 0.1 nm",)),
        ({"drift": 0.1}, ("simulator_overrides.drift = 0.1", "drift=0.1nm")),
        (
            "throughput=0.7",
            (
                "simulator_overrides.throughput = 0.7: not accepted; allowed: an x before a factor "
                "(throughput=x0.7 is 0.7 times the instrument's 0.19: 0.133; bands.*.t_opt=0.7 is the value "
                "itself)",
            ),
        ),
        ("exozodi=3", ("exozodi=3zodi is 3 zodi",)),
        ("read_noise=160", ("read_noise=x160 is 160 times the instrument's 110 e-: 17600 e-; read_noise=160e- is",)),
        ("walk=0.1nm", ("drift.walk_nm_per_sqrt_hour = 0.1nm", "pm/sqrt(h), nm/sqrt(h)")),
        ("drift.visit_nm=0.1mas", ("drift.visit_nm = 0.1mas: not accepted; allowed: a number with a unit: pm, nm",)),
        ("drift=wild", ("drift = wild", "0.1nm", "its keys: visit_nm, walk_nm_per_sqrt_hour")),
        ("drift=-1nm", ("drift = -1nm", "at least 0")),
        ("read_noise=lots", ("read_noise_e = lots", "valid number")),
        ("detector.switches.dark=x2", ("switches.dark = x2", "only numbers take a factor", "is true")),
        ("cosmic_rays.model=x2", ("cosmic_rays.model = x2", "only numbers", "is physical")),
        ("sky.earthshine.rate_e_s=x2", ("rate_e_s = x2", "only numbers", "is not set")),
        ("cosmic_rays.model=papr", ("cosmic_rays.model = papr", "'paper'")),
        ("detector.register_stages=x0.333", ("register_stages = x0.333", "integer", "is 604")),
        ("detector.pixel_scale_arcsec=x10", ("pixel_scale_arcsec x10", "pixels in the aperture radius")),
        ("detector.bias_adu=20000", ("bias_adu = 20000 ADU", "below the ADC maximum")),
        ("companions=yes", ("simulator_overrides.companions = yes", "on, off")),
        ("companions=x2", ("simulator_overrides.companions = x2", "on, off")),
        ("throughput", ("simulator_overrides = throughput", "KEY=VALUE", "YAML file that exists")),
        ("throughput=", ("throughput=", "KEY=VALUE")),
        ("=x2", ("=x2", "KEY=VALUE")),
        (
            ["throughput=x2", "bands.*.t_opt=x3"],
            ("simulator_overrides.bands.*.t_opt = given twice", "throughput is the same key"),
        ),
        (["companions=on", "companions=on"], ("simulator_overrides.companions = given twice",)),
        (["throughput=x.5", "bands.F520.t_opt=0.1"], ("bands.F520.t_opt = 0.1", "once", "altered by bands.*.t_opt")),
        ({"detector": {"read_noise_e": [1]}}, ("detector.read_noise_e = [1]", "a number, a word, or a factor")),
        ({"detector": {"read_noise_e": math.inf}}, ("detector.read_noise_e = inf", "finite")),
        (3, ("simulator_overrides = 3", "a mapping")),
        ([3], ("simulator_overrides = 3", "KEY=VALUE")),
    ],
)
def test_refusals_name_key_value_and_what_is_allowed(refused, source, words):
    text = refused("", lambda: SimulatorOverrides.of(source, NOMINAL).instrument(NOMINAL))
    for word in words:
        assert word in text


@pytest.mark.parametrize("text", ["- throughput\n", "kind: scene\n", "read_noise: 1\nread_noise: 2\n"])
def test_files_that_hold_no_overrides_are_refused(refused, tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    refused("", SimulatorOverrides.of, path)


def test_models_are_as_strict_as_the_text():
    with pytest.raises(ValueError, match="at least 0"):
        Change(key="detector.cic_e", action="scale", value="much")
    with pytest.raises(ValueError, match="given twice"):
        SimulatorOverrides(entries=(Change(key="a", value=1), Change(key="a", value=2)))


def _probe(value):
    """Another value of the same kind."""
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) else value * 1.01 if value else 0.01


def test_optics_are_computed_anew_for_exactly_what_they_are_made_of():
    nominal = {band: metrics_key(NOMINAL, band) for band in ("F520", "F940")}
    tried = 0
    for key, value in leaves(VALUES):
        if key == "name" or not isinstance(value, bool | int | float):
            continue
        try:
            made = SimulatorOverrides.of({key: _probe(value)}).instrument(NOMINAL)
        except InputError:  # a neighbour of this value that the instrument cannot have
            continue
        tried += 1
        anew = any(metrics_key(made, band) != known for band, known in nominal.items())
        if key.startswith("bands.") and key.split(".")[1] not in nominal:
            assert not anew
        else:
            assert anew == is_optical(key), key
    assert tried > 150


def test_the_usual_questions_keep_the_optics():
    for name in ("throughput", "quantum_efficiency", "read_noise", "dark_current", "visit_drift", "walk"):
        one = SimulatorOverrides.of({name: "x0.7"})
        assert not one.alters_optics
        assert metrics_key(one.instrument(NOMINAL), "F662") == metrics_key(NOMINAL, "F662")
    assert SimulatorOverrides.of("jitter=x2").alters_optics
    assert SimulatorOverrides.of("drift.*=x2").alters_optics
    assert SimulatorOverrides.of("bands.F662.width_nm=x2").alters_optics
    assert SimulatorOverrides.of("coronagraph.inner_arcsec.F520=0.3").alters_optics
    assert not SimulatorOverrides.of("companions=on").alters_optics


def test_the_simulator_sees_them():
    scene = load_scene("paper_science")
    nominal, dimmed = (scene_sources(scene, one, "F662") for one in (NOMINAL, altered("throughput=x0.7")))
    for before, after in zip(nominal, dimmed, strict=True):
        assert after.rate_e_s == pytest.approx(0.7 * before.rate_e_s, rel=1e-12)
    shining = scene_sources(SimulatorOverrides.of("companions=on").scene(scene), NOMINAL, "F662")
    assert [one.name for one in shining] == [*(one.name for one in nominal), "alpha Cen A"]
