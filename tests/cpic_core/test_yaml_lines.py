"""A refusal of what a YAML file says names the file and the line, whoever reads the file."""

import pytest

from cpic_core import InputError, faults_by_line
from cpic_planner.planets import load_population
from cpic_planner.queries import load_ensemble
from cpic_planner.survey import load_strategies
from cpic_planner.survey.visibility import load_visibility
from simulator import load_instrument, load_scene
from simulator.config import load_simulation

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
