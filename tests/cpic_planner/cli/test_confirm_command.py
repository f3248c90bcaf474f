import json

import pytest

PLANET = "{name: b, radius_rjup: 1, phase_deg: 90, separation_arcsec: 0.5, pa_deg: 315, albedo: jupiter}"
SCENE = f"""name: my scene
cstar: {{v_mag: 4.0, teff_k: 5500, distance_pc: 4.0}}
planets: [{PLANET}]
"""


COMMAND = "confirm"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["SCENE"]),
        (["nonsense"], ["nonsense", "paper_example"]),
        (["tau Cet"], ["tau Cet", "star of the catalogue", "cstar", "cpic plan"]),
        (["paper_example", "--frames", "3"], ["--frames", "--exposure-s"]),
        (["paper_example", "--exposure-s", "3"], ["--exposure-s", "--frames or --time-s"]),
        (["paper_example", "--frames", "3", "--exposure-s", "1", "--time-s", "9"], ["--time-s", "--frames"]),
        (["paper_example", "--time-s", "-1"], ["--time-s", "s"]),
        (["paper_example", "--exposure-s", "1", "--frames", "5000"], ["--frames", "4000"]),
        (["paper_example", "--em-gain", "0.5"], ["--em-gain", "1 to"]),
        (["paper_example", "--band", "F999"], ["F999", "F520"]),
        (["paper_example", "--roll-deg", "20"], ["--roll-deg", "--library roll"]),
        (["paper_example", "--library", "reference_star"], ["--reference-v-mag"]),
        (["paper_example", "--realisations", "0"], ["--realisations"]),
        (["paper_example", "--simulator-overrides", "thruput=x0.7"], ["thruput", "throughput"]),
        (["paper_example", "--force"], ["--force", "--out"]),
        (["paper_example", "--fidelity", "reference", "--audit"], ["--audit", "every realisation frame by frame"]),
    ],
)
def test_bad_input_is_one_clear_line_with_status_2(refuses, arguments, words):
    refuses(arguments, words)


def test_dry_run_counts_realisations_and_audited_frames(done, tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    options = ["--exposure-s", "5", "--frames", "7", "--em-gain", "100", "--realisations", "20"]
    out, _ = done(str(tmp_path / "scene.yaml"), *options, "--band", "F520", "--dry-run", "--json")
    cost = json.loads(out)
    assert (cost["n_tasks"], cost["n_realisations"], cost["n_frames"]) == (1, 20, 14)
    out, _ = done(str(tmp_path / "scene.yaml"), *options, "--band", "F520", "--dry-run", "--no-audit")
    assert "1 band of my scene, 20 realisations, 0 frames drawn one by one" in out


def test_a_planet_outside_the_hole_needs_no_image(done, tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE.replace("0.5, pa_deg: 315", "0.3, pa_deg: 0"))
    options = ["--exposure-s", "5", "--frames", "2", "--em-gain", "100", "--realisations", "1", "--no-audit"]
    out, _ = done(str(tmp_path / "scene.yaml"), *options, "--band", "F520", "--fidelity", "quick", "--json")
    (band,) = json.loads(out)["bands"]
    assert (band["status"], band["reason"]) == ("outside_field", "inside_inner_edge")
    assert "leaves the dark hole" in band["message"]
    out, _ = done(str(tmp_path / "scene.yaml"), *options, "--band", "F520", "--dry-run", "--json")
    cost = json.loads(out)
    assert (cost["n_tasks"], cost["n_refused"]) == (0, 1)
    _, told = done(str(tmp_path / "scene.yaml"), *options, "--band", "F520", "--dry-run")
    assert "1 of the measurements are impossible" in told
