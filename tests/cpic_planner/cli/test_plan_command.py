import json

import pytest

from cpic_planner.cli.main import main


def call(capsys, *arguments):
    status = main(["plan", *arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--photon-counting"], ["--photon-counting", "cpic etc", "not yet measured"]),
        (["--realisations", "0"], ["--realisations"]),
        (["--library", "reference_star"], ["--reference-v-mag"]),
        (["--reference-teff-k", "5000"], ["--reference-teff-k", "--library reference_star"]),
        (["--simulator-overrides", "read_noise=x-1"], ["read_noise", "finite, at least 0"]),
        (["--simulator-overrides", "nothing.yaml"], ["nothing.yaml", "throughput=x0.7"]),
        (["--band", "F1265"], ["F1265", "near-infrared"]),
        (["--date", "2030-01-01"], ["--date", "only with --known-planets"]),
        (["--known-planets", "snapshot", "--population", "giants"], ["--population", "--known-planets"]),
        (["--known-planets", "nowhere.csv"], ["--known-planets = nowhere.csv"]),
        (["--known-planets", "snapshot", "--date", "soon"], ["--date = soon UTC"]),
    ],
)
def test_bad_input_is_one_clear_line_with_status_2(capsys, arguments, words, tmp_path):
    status, out, err = call(capsys, *arguments, "--out", str(tmp_path / "o"))
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1
    assert not (tmp_path / "o").exists()
    for word in words:
        assert word in err, err


def test_dry_run_counts_realisations(capsys):
    options = ["--top", "1", "--band", "F520", "--planets", "50", "--dry-run"]
    _, out, _ = call(capsys, *options, "--realisations", "20", "--json")
    cost = json.loads(out)
    assert (cost["n_targets"], cost["n_tasks"], cost["n_realisations"]) == (1, 1, 20)
    _, out, _ = call(capsys, *options)
    assert "1 image sets (1 targets x bands), 8 realisations, " in out


def test_help_shows_examples_and_what_overrides_are(capsys):
    status, out, _ = call(capsys, "--help")
    assert status == 0
    for text in ("cpic plan --top 20 --realisations 20 --dry-run", "--simulator-overrides", "[default: 8;"):
        assert text in " ".join(out.split())
