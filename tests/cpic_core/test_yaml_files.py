"""A refusal of what a YAML file says names the file and the line, whoever reads the file.

Numbers with units in YAML files are read as on the command line, wherever a key ends in its unit.
"""

import json
import math
from pathlib import Path

import pytest

import cpic_core
from cpic_core import InputError, Provenance, converted, faults_by_line, parse_yaml, split_sourced, unit_of
from cpic_core.provenance import PACKAGES
from cpic_core.yaml_files import load_yaml
from cpic_planner.planets import load_population
from cpic_planner.queries import EtcQuestion, Written, load_ensemble, read_value
from cpic_planner.survey.strategy import load_strategies
from cpic_planner.survey.visibility import load_visibility
from simulator import load_instrument, load_scene
from simulator.config import load_simulation


def test_inf_and_nan_are_numbers_for_the_model_to_refuse():
    tree = parse_yaml("a: .inf\nb: -.inf\nc: .nan")
    assert tree["a"] == math.inf
    assert tree["b"] == -math.inf
    assert math.isnan(tree["c"])


def test_missing_file_and_wrong_encoding_are_named(refused, tmp_path):
    refused("nothing.yaml", load_yaml, tmp_path / "nothing.yaml")
    bad = tmp_path / "latin.yaml"
    bad.write_bytes(b"name: \xe9toile")
    refused("UTF-8", load_yaml, bad)


def test_values_and_their_standing_are_separated():
    tree = {
        "a": {"b": {"value": 3, "unit": "nm", "source": "paper", "confidence": "P", "range": [1, 5]}, "c": 4},
        "d": [{"value": 1}],
    }
    values, provenance = split_sourced(tree)
    assert values == {"a": {"b": 3, "c": 4}, "d": [1]}
    assert provenance["a.b"] == Provenance("paper", "P", "nm", (1.0, 5.0))
    assert set(provenance) == {"a.b", "d[0]"}


def test_shipped_files_are_read_as_if_a_user_had_written_them(monkeypatch, tmp_path):
    root = Path(cpic_core.__file__).resolve().parents[1]
    found = [path for package in PACKAGES for path in (root / package).rglob("*.yaml")]
    assert len(found) > 20
    parsed = [repr(load_yaml(path)) for path in found]
    monkeypatch.setattr("cpic_core.yaml_files.PARSED", tmp_path)
    assert parsed == [repr(load_yaml(path)) for path in found]


STAR = "cstar: {name: a, v_mag: 4, spectral_type: G2V, distance_pc: 5}\n"
PLANET = "planets:\n  - name: b\n    separation_arcsec: -1\n    pa_deg: 4\n"
SEQUENCE = "sequences:\n  - scene: paper_example\n    band: F520\n    exposure_s: -3\n"
CASES = [
    (load_strategies, "strategies:\n  - name: a\n    visit:\n      time: 10h\n", 5, "0.visit.time = 10h"),
    (load_strategies, "defaults:\n  time_budget_h: -1\nstrategies:\n  - name: a\n", 3, "time_budget_h = -1"),
    (load_scene, f"name: x\n{STAR}{PLANET}", 6, "separation_arcsec = -1"),
    (load_scene, "name: x\ncstar:\n  name: a\n", 3, "scene.cstar.v_mag = missing"),
    (load_scene, "# a remark\n\nname: x\ncstar: 3\n", 5, "cstar = 3"),
    (load_instrument, "detector:\n  # mine\n  read_noise_e: -3\n", 4, "instrument.detector.read_noise_e = -3"),
    (load_instrument, "bands:\n  F520:\n    qee: 3\n", 4, "instrument.bands.F520.qee = 3: not accepted; allowed: no"),
    (load_instrument, "bands:\n  F520:\n    qe: {value: 7, source: me, confidence: A}\n", 4, "bands.F520.qe = 7"),
    (load_visibility, "moon_deg: -40\n", 2, "visibility.moon_deg = -40"),
    (load_ensemble, "foo: 3\n", 2, "ensemble.foo = 3"),
    (load_simulation, SEQUENCE, 5, "exposure_s.0 = -3"),
    (load_population, "radius_rjup:\n  low: 3\n", 3, "radius_rjup.low = 3"),
]
KINDS = {load_strategies: "strategies", load_scene: "scene", load_instrument: "instrument"}
KINDS |= {load_visibility: "visibility", load_ensemble: "ensemble", load_simulation: "simulation"}
KINDS |= {load_population: "population"}


@pytest.mark.parametrize(("load", "text", "line", "words"), CASES)
def test_file_line_and_key(tmp_path, load, text, line, words):
    path = tmp_path / "my file.yaml"
    path.write_text(f"kind: {KINDS[load]}\n{text}")
    with pytest.raises(InputError) as refused:
        load(path)
    assert str(refused.value).startswith(f"my file.yaml line {line}: ")
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_mappings_and_presets_have_no_lines():
    with pytest.raises(InputError, match=r"^instrument\.detector\.read_noise_e = -3"):
        load_instrument({"detector": {"read_noise_e": -3}})
    with pytest.raises(InputError, match="^scene = nowhere"):
        load_scene("nowhere")


def test_a_key_of_others_is_no_fault_of_the_file(tmp_path):
    path = tmp_path / "question.yaml"
    path.write_text("kind: question\nsnr: 3\n")
    with pytest.raises(InputError, match="^time_s = 1"), faults_by_line(path, whole=False):
        raise InputError("time_s", 1)
    with pytest.raises(InputError, match="^question.yaml line 2: snr = 3"), faults_by_line(path, whole=False):
        raise InputError("snr", 3)


WRITTEN = [
    ("time_s", "10h", 36000.0),
    ("time_s", "1.5 h", 5400.0),
    ("visit_time_s", "45min", 2700.0),
    ("visit_gap_h", "30 min", 0.5),
    ("duration_days", "48h", 2.0),
    ("separation_arcsec", "500mas", 0.5),
    ("visit_nm", "100pm", 0.1),
    ("walk_nm_per_sqrt_hour", "50 pm/sqrt(h)", 0.05),
    ("distance_pc", "3.5pc", 3.5),
    ("diameter_m", "200 cm", 2.0),
    ("center_nm", "0.606um", 606.0),
    ("phase_deg", "90 deg", 90.0),
    ("read_noise_e", "5e-", 5.0),
]


@pytest.fixture
def file(tmp_path):
    def write(text, name="own.yaml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(("key", "text", "value"), WRITTEN)
@pytest.mark.parametrize("shape", ["{0}: {1}", "{0}: '{1}'", "a: {{{0}: '{1}'}}", "{0}: ['{1}', 7]"])
def test_a_number_with_a_unit_is_that_of_the_command_line(file, shape, key, text, value):
    tree = load_yaml(file(f"kind: question\n{shape.format(key, text)}\n"))
    node = tree.get("a", tree)[key]
    found = node[0] if isinstance(node, list) else node
    assert found == value
    assert read_value(key, text, unit_of(key)) == Written("set", found, read_value(key, text, unit_of(key)).text)


@pytest.mark.parametrize(
    ("key", "text"), [("time_s", "10kg"), ("name", "10h"), ("time_s", "x2"), ("ra_deg", "12h"), ("sp_type", "2 s")]
)
def test_what_does_not_convert_stays_as_it_is_written(file, key, text):
    assert load_yaml(file(f"{key}: '{text}'\n"))[key] == text
    assert not unit_of(key) or converted(text, unit_of(key)) is None


def test_a_value_with_its_source_may_have_a_unit(file):
    tree = load_yaml(file("time_s: {value: 2h, source: me, confidence: A}\n"))
    assert tree["time_s"] == {"value": 7200.0, "source": "me", "confidence": "A"}


@pytest.mark.parametrize("time", ["10h", "600 min", "36000", "36000 s", "{value: 10h, source: me, confidence: A}"])
def test_strategies(file, time):
    config = load_strategies(file(f"kind: strategies\nstrategies:\n- {{name: a, visit: {{time_s: {time}}}}}\n"))
    assert config.strategies[0].visit.time_s == (36000.0,)


def test_questions_scenes_and_instruments(file):
    tree = EtcQuestion.load(file("kind: question\ntarget: tau Cet\ntime_s: 2h\nseparation_arcsec: [500mas, 0.6]\n"))
    question = EtcQuestion.of(tree)
    assert (question.time_s, question.separation_arcsec) == (7200.0, (0.5, 0.6))
    star = "cstar: {name: s, v_mag: 4 mag, spectral_type: K1V, distance_pc: 5 pc}"
    body = "{radius_rjup: 1, phase_deg: 90, separation_arcsec: 400mas, pa_deg: 1deg, albedo: 0.5}"
    scene = load_scene(file(f"kind: scene\nname: s\n{star}\nplanet: {body}\n"))
    assert scene.cstar.v_mag == 4.0
    assert scene.planets[0].separation_arcsec == 0.4
    made = load_instrument(file("kind: instrument\nname: mine\ndrift: {visit_nm: 20pm}\n"))
    assert made.drift.visit_nm == 0.02


def test_the_answer_is_that_of_plain_numbers(file, capsys):
    from cpic_planner.cli.main import main

    answers = []
    for time in ("2h", "7200"):
        path = file(f"kind: question\ntarget: tau Cet\nbands: F520\nseparation_arcsec: 0.5\ntime_s: {time}\n")
        assert main(["etc", "--question", str(path), "--json"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert answers[0] == answers[1]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("time: 10h", ["visit.time = 10h", "did you mean time_s: 10h?"]),
        ("time_s: 10kg", ["visit.time_s = 10kg", "with a unit: s, min, h, d"]),
        ("exposure: 30 s", ["visit.exposure = 30 s", "did you mean exposure_s: 30 s?"]),
    ],
)
def test_what_is_refused_says_what_to_write(file, line, words):
    with pytest.raises(InputError) as caught:
        load_strategies(file(f"kind: strategies\nstrategies:\n- {{name: a, visit: {{{line}}}}}\n"))
    assert [word for word in words if word not in str(caught.value)] == []
