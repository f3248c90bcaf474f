import json
from shlex import split

import pytest

SMALL = '{"detector": {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}}'


COMMAND = "simulate"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder but for an instrument of small frames."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    return tmp_path


def test_a_scene_on_a_grid(call, here):
    grid = ("--band", "F520,F662", "--exposure-s", "1", "--exposure-s", "2", "--em-gain", "1,20", "--frames", "2")
    rest = (
        *split(
            "--instrument small.yaml --fidelity quick --off cosmic_rays,smear --roll-deg -20 "
            "--star-offset-arcsec -0.3,0.3 --seed 4 --role reference"
        ),
    )
    status, out, err = call("paper_example", *grid, *rest, "--json", "--start-utc", "2029-02-03T04:05")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert out == (here / "out" / "simulate" / "simulation.json").read_text()
    rows = result["sequences"]
    assert [(row["band"], row["exposure_s"], row["em_gain"]) for row in rows] == [
        (band, exposure, gain) for band in ("F520", "F662") for exposure in (1.0, 2.0) for gain in (1.0, 20.0)
    ]
    assert {row["cosmic_rays"] for row in rows} == {0}
    assert all((here / "out" / "simulate" / row["file"]).is_file() for row in rows)
    settings = rows[0]["settings"]
    assert (settings["roll_deg"], settings["star_offset_arcsec"]) == (-20.0, [-0.3, 0.3])
    assert (settings["seed"], settings["role"], settings["fidelity"]) == (4, "reference", "quick")
    assert settings["switches"] == {"cosmic_rays": False, "smear": False}
    assert rows[0]["start_utc"] == "2029-02-03T04:05:00"


def test_a_table_of_stars_prints_a_row_each_and_continues(call, done, here):
    (here / "stars.csv").write_text("name,distance_pc,v_mag,sp_type\nA [b] star,10,5.0,G2V\nB star,3,4.0,K1V\n")
    asked = ("stars.csv", "--band", "F520", "--fidelity", "quick", "--instrument", "small.yaml", "--out", "o")
    out, err = done(*asked)
    for word in ("stars: 2 sequences", "40000000002", "A [b] star", "1 × 10", "o/SCI/61771/CSST_CPIC_VIS_SCI_"):
        assert word in out
    assert "earlier run" not in err
    status, again, err = call(*asked)
    assert (status, again) == (0, out)
    assert "reused 2 finished sequences" in err


def test_calibration_frames_without_a_scene(done, here):
    out, _ = done("--kind", "DARK", "--camera", "NIR", "--frames", "2", "--exposure-s", "3", "--no-truth", "--json")
    (row,) = json.loads(out)["sequences"]
    assert (row["kind"], row["camera"], row["band"], row["truth"]) == ("DARK", "NIR", "", None)
    assert "/CSST_CPIC_NIR_DARK_" in row["file"]


def test_a_simulation_with_changes(done, here):
    tree = {"name": "x", "sequences": [{"kind": "BIAS", "frames": 50}, {"kind": "FLAT", "frames": 50, "level_e": 100}]}
    (here / "x.yaml").write_text(json.dumps(tree))
    out, _ = done("x.yaml", "--frames", "1", "--instrument", "small.yaml", "--off", "all", "--json")
    rows = json.loads(out)["sequences"]
    assert [(row["kind"], row["band"], row["n_frames"]) for row in rows] == [
        ("BIAS", "", 1),
        ("FLAT", "F520", 1),
        ("FLAT", "F662", 1),
        ("FLAT", "F720", 1),
        ("FLAT", "F850", 1),
    ]
    # every effect off: bias, and bias plus electrons over the gain of 59 e-/ADU
    assert [(row["adu_min"], row["adu_max"]) for row in rows] == [(200, 200)] + [(200, 202)] * 4


def test_dry_run_says_what_would_be_made_and_makes_nothing(done, here):
    out, _ = done("paper_alpha_cen_b", "--dry-run")
    for word in ("40000000008", "SCI reference", "30 × 100", "2028-01-01T00:19:03", "240 frames", "disk"):
        assert word in out
    out, _ = done("paper_alpha_cen_b", "--dry-run", "--json", "--workers", "2")
    cost = json.loads(out)
    assert (cost["n_sequences"], cost["n_frames"]) == (8, 240)
    assert 500 < cost["disk_mb"] < 1000
    assert 5 < cost["wall_s"] < 300
    assert cost["sequences"][0]["file"].startswith(
        "SCI/61771/CSST_CPIC_VIS_SCI_20280101000000_20280101000901_40000000001"
    )
    assert sorted(path.name for path in here.iterdir()) == ["small.yaml"]


def test_presets_are_listed(call, done, here):
    out, _ = done("--list-presets")
    for word in ("paper_alpha_cen_b", "calibration_set", "paper_example", "star_field"):
        assert word in out
    assert set(json.loads(call("--list-presets", "--json")[1])) == {"simulations", "scenes"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["WHAT", "missing", "paper_example"]),
        (["paper_exmple"], ["WHAT", "did you mean paper_example"]),
        (["--kind", "SCI"], ["WHAT", "missing"]),
        (["--kind", "BIAS", "paper_example"], ["WHAT", "paper_example", "BIAS"]),
        (["--kind", "BIAS", "--band", "F520"], ["--band", "F520", "not for BIAS"]),
        (["--kind", "BIAS", "--fidelity", "quick"], ["--fidelity", "quick", "not for BIAS"]),
        (["--kind", "BIAS", "--tolerance", "0.02"], ["--tolerance", "0.02", "not for BIAS"]),
        (["paper_example", "--tolerance", "0.6"], ["--tolerance", "0.6", "0 to 0.5"]),
        (["paper_example", "--tolerance", "nan"], ["--tolerance", "nan"]),
        (["--kind", "DARK", "--roll-deg", "3"], ["--roll-deg", "3", "not for DARK"]),
        (["--kind", "DARK", "--level-e", "3"], ["--level-e", "FLAT, LASER"]),
        (["--kind", "CAL"], ["--kind", "CAL"]),
        (["paper_example", "--camera", "NIR"], ["--camera", "NIR", "BIAS, DARK"]),
        (["paper_example", "--band", "F521"], ["--band", "F521", "F520"]),
        (["paper_example", "--band", "F940", "--em-gain", "20"], ["--em-gain", "20", "near infrared"]),
        (["paper_example", "--exposure-s", "-1"], ["--exposure-s", "-1", " s", "1e-06 to 1e+06"]),
        (["paper_example", "--exposure-s", "1,x"], ["--exposure-s", "x", "number"]),
        (["paper_example", "--em-gain", "5000"], ["--em-gain", "5000", "1 to 1000"]),
        (["paper_example", "--star-offset-arcsec", "1"], ["--star-offset-arcsec", "two numbers"]),
        (["paper_example", "--star-offset-arcsec", "9,0"], ["--star-offset-arcsec", "9", "-8 to 8"]),
        (["paper_example", "--start-utc", "soon"], ["--start-utc", "soon", "UTC"]),
        (["paper_example", "--frames", "0"], ["--frames"]),
        (["paper_example", "--off", "smer"], ["--off", "smer", "smear"]),
        (["paper_example", "--off", "reset_noise"], ["--off", "reset_noise"]),
        (["paper_example", "--instrument", "none.yaml"], ["none.yaml", "cpic_default"]),
        (["paper_alpha_cen_b", "--band", "F520"], ["--band", "F520", "simulation"]),
        (["paper_alpha_cen_b", "--role", "science"], ["--role", "science", "simulation"]),
        (["paper_example", "--band", "F520", "--workers", "0"], ["--workers"]),
    ],
)
def test_bad_input_is_one_clear_line_with_status_2(refuses, here, arguments, words):
    refuses(arguments, words)
    assert sorted(path.name for path in here.iterdir()) == ["small.yaml"]


def test_another_configuration_needs_force(call, here):
    bias = ("--kind", "BIAS", "--instrument", "small.yaml")
    assert call(*bias)[0] == 0
    status, _, err = call(*bias, "--seed", "2")
    assert status == 2
    assert "--force" in err
    assert call(*bias, "--seed", "2", "--force")[0] == 0


def test_a_tolerance_says_what_it_leaves_out(call, done, here):
    asked = ("paper_example", "--band", "F520", "--instrument", "small.yaml", "--tolerance", "0.05", "--frames", "3")
    planned, _ = done(*asked, "--dry-run")
    out, _ = done(*asked)
    story = out[out.index("left out for the tolerance") : out.index("(asked: at most") + 50]
    assert story in planned
    for word in ("alpha Cen B F520", "predicted size", "Predicted error beside the reference: planet flux"):
        assert word in " ".join(story.split())
    status, text, _ = call(*asked, "--json")
    (row,) = json.loads(text)["sequences"]
    assert row["settings"]["tolerance"] == 0.05
    gone = [effect for effect in row["modelled"]["effects"] if effect["decision"] == "skipped" and effect["size"]]
    assert gone
    assert all(error <= 0.05 for error in row["modelled"]["predicted_error"].values())
    for effect in gone:
        assert effect["effect"] in story
    status, _, err = call(*asked[:-4], "--frames", "3")
    assert status == 2
    assert "--force" in err


def test_without_a_tolerance_nothing_is_said(call, done, here):
    asked = ("paper_example", "--band", "F520", "--instrument", "small.yaml", "--fidelity", "quick")
    out, _ = done(*asked)
    assert "left out for the tolerance" not in out
    (row,) = json.loads(call(*asked, "--json")[1])["sequences"]
    assert row["modelled"] is None
    assert row["settings"]["tolerance"] == 0.0


def test_a_programme_is_planned_from_options(done, here):
    options = "--band F520 --exposure-s 300 --frames 10 --visits 2 --reference-visits 1 --reference-roll-deg 30"
    plan = json.loads(done("paper_science", *options.split(), "--dry-run", "--json")[0])
    folders = [row["file"].partition("/")[0] for row in plan["sequences"]]
    # Ten frames need two windows of eight; the one reference visit has as many frames as both science visits.
    assert folders == ["visit_001_science"] * 2 + ["visit_001_reference"] * 3 + ["visit_002_science"] * 2
    assert [row["n_frames"] for row in plan["sequences"]] == [8, 2, 8, 8, 4, 8, 2]
    assert plan["n_frames"] == 40


def test_references_without_visits_are_refused(call, here):
    status, _, err = call("paper_science", "--band", "F520", "--reference-scheme", "half", "--dry-run")
    assert status == 2
    assert "programmes with reference visits" in err
