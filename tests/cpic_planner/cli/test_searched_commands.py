import csv
import inspect
import io
import json
import re
import shlex

import pytest

from cpic_planner import contrast_curve
from cpic_planner.cli import star_commands
from cpic_planner.results import CurveResult, RocResult

PLACED = ("--band", "F662", "--separation-arcsec", "0.6")
CURVE = ("curve", "tau Cet", *PLACED)
ROC = ("roc", "tau Cet", *PLACED, "--contrast", "2e-9")


def test_the_answer_is_that_of_the_function(done):
    out, err = done(*CURVE, "--time", "2h", "--json")
    found = CurveResult.model_validate_json(out)
    assert err == ""
    same = contrast_curve("tau Cet", bands=["F662"], separation_arcsec=0.6, time_s=7200.0)
    assert found == same
    assert found.time_s == 7200.0
    other = contrast_curve("HIP 8102", bands=["F662"], separation_arcsec=0.6, time_s=7200)
    assert other.config_hash == same.config_hash
    rows = list(csv.DictReader(io.StringIO(done(*CURVE, "--time", "2h", "--format", "csv")[0])))
    (row,) = found.points
    assert [float(one["contrast_limit_blind"]) for one in rows] == [pytest.approx(row.contrast_limit_blind, rel=1e-3)]


def test_detection_statistics(done):
    found = RocResult.model_validate_json(done(*ROC, "--json")[0])
    assert len(found.levels) == 17
    assert found.reference_planet is None
    planet = RocResult.model_validate_json(done("roc", "tau Cet", *PLACED, "--planet-radius-rjup", "1.2", "--json")[0])
    assert planet.reference_planet.radius_rjup == 1.2


@pytest.mark.parametrize(
    ("command", "files"),
    [(CURVE, ("curve.json", "curve.csv", "completeness.csv", "recovered.csv")), (ROC, ("roc.json", "roc.csv"))],
)
def test_a_folder_has_the_report_and_the_tables(done, tmp_path, command, files):
    out, _ = done(*command, "--out", tmp_path / "run")
    assert out.endswith(f"report: {tmp_path / 'run' / 'report.html'}\n")
    for name in (*files, "run.json"):
        assert (tmp_path / "run" / name).stat().st_size > 0, name
    page = (tmp_path / "run" / "report.html").read_text()
    assert "τ Cet (HIP 8102)" in page
    assert "Programmes and assumptions" in page
    again, _ = done(*command, "--out", tmp_path / "run", "--json")
    assert json.loads(again) == json.loads((tmp_path / "run" / files[0]).read_text())


def test_the_cost_is_told_before_the_work(done):
    out, _ = done(*CURVE, "--images", "40", "--injections", "20", "--dry-run")
    assert re.match(r"40 images, 160 searches, about \d+ s with 1 worker\(s\), \d+ MB memory a worker\n$", out)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("curve",), ("TARGET",)),
        ((*CURVE, "--injections", "5"), ("--injections", "--images")),
        ((*CURVE, "--images", "5", "--library", "roll"), ("--images", "--library roll")),
        ((*CURVE, "--time", "2"), ("--time",)),
        ((*ROC, "--planet-radius-rjup", "1"), ("--planet-radius-rjup", "--contrast")),
        ((*ROC, "--contrast", "-1"), ("--contrast",)),
        ((*ROC, "--seed", "3"), ("--seed", "--images")),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(refuses, arguments, words):
    refuses(arguments, words)


@pytest.mark.parametrize("command", [star_commands.curve, star_commands.roc])
def test_the_examples_of_the_help_are_good_questions(done, monkeypatch, command):
    asked = []
    monkeypatch.setattr(star_commands, "_searched", lambda question, job, *rest: asked.append((question, job.digest)))
    lines = re.findall(r"^ *cpic (.*)$", inspect.getdoc(command), re.MULTILINE)
    for line in lines:
        done(*shlex.split(line))
    assert len({digest for _, digest in asked}) >= len(lines) - 1 >= 4  # of two that differ in what is written
    assert all(question.target for question, _ in asked)
