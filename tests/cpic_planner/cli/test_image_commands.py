import json

import pytest

from cpic_planner.etc import build_model
from cpic_planner.ranking import rank_targets
from cpic_planner.targets import find_target
from simulator import load_instrument

COMMAND = "plan"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--realisations", "0"], ["--realisations"]),
        (["--library", "reference_star"], ["--reference-v-mag"]),
        (["--reference-teff-k", "5000"], ["--reference-teff-k", "--library reference_star"]),
        (["--simulator-overrides", "read_noise=x-1"], ["read_noise", "finite, at least 0"]),
        (["--simulator-overrides", "nothing.yaml"], ["nothing.yaml", "throughput=x0.7"]),
        (["--date", "tomorrow"], ["--date = tomorrow UTC"]),
        (["--known-planets", "snapshot", "--population", "giants"], ["--population", "--known-planets"]),
        (["--known-planets", "nowhere.csv"], ["--known-planets = nowhere.csv"]),
        (["--known-planets", "snapshot", "--date", "soon"], ["--date = soon UTC"]),
    ],
)
def test_bad_input_is_one_clear_line_with_status_2(refuses, arguments, words, tmp_path):
    refuses([*arguments, "--out", str(tmp_path / "o")], words)
    assert not (tmp_path / "o").exists()


def test_dry_run_counts_realisations(call):
    options = ["--top", "1", "--band", "F520", "--planets", "50", "--dry-run"]
    _, out, _ = call(*options, "--realisations", "20", "--json")
    cost = json.loads(out)
    assert (cost["n_targets"], cost["n_tasks"], cost["n_realisations"]) == (1, 1, 20)
    _, out, _ = call(*options)
    assert "1 image sets (1 targets x bands), 8 realisations, " in out


def test_dry_run_ranks_nothing(call, monkeypatch):
    """As many image sets as targets and bands, with the frames of stars that may be among them."""
    monkeypatch.setattr("cpic_planner.confirm.plan.rank_under", lambda *_, **__: pytest.fail("ranked"))
    _, out, _ = call("--top", "7", "--band", "F520", "--band", "F662", "--dry-run", "--json")
    cost = json.loads(out)
    assert (cost["n_targets"], cost["n_tasks"], cost["n_realisations"]) == (7, 14, 7 * 2 * 8)
    one = json.loads(call("--top", "1", "--band", "F520", "--band", "F662", "--dry-run", "--json")[1])
    assert one["wall_s"] < cost["wall_s"] < 7 * one["wall_s"]  # ranking, sensitivity and report are as long for one
    # A fifth of the frames, science and reference, of the star that stands first, which its audit runs: the nearest
    # ones have fewer.
    procyon = find_target("alf CMi")[0]
    first = rank_targets(build_model(load_instrument(), ["F520", "F662"]), procyon, time_s=36000.0).targets[0]
    assert first.n_frames == first.visits * first.frames_per_visit > 1000
    assert one["n_frames"] == round(2 * first.n_frames / 5)
