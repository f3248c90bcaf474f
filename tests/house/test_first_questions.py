"""The first question that help, README and notebooks ask has an answer: a planet that is detected, with a time."""

import inspect
import json
import re
import shlex
from pathlib import Path

import pytest

from cpic_planner.cli import star_commands
from cpic_planner.cli.main import main

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("source", ["README.md", "help"])
def test_first_command_detects(source, capsys):
    text = (
        inspect.getdoc(star_commands.etc).partition("Examples:")[2]
        if source == "help"
        else (ROOT / source).read_text("utf-8")
    )
    command = re.search(r"cpic (etc .*)", text)[1]
    assert main([*shlex.split(command), "--json"]) == 0
    answers = json.loads(capsys.readouterr().out)["answers"]
    assert [answer["verdict"] for answer in answers].count("detected") >= 2
    times_s = sorted(answer["time_s"] for answer in answers if answer["verdict"] == "detected")
    assert times_s[1] < 3600
    assert times_s[-1] < 36000


@pytest.mark.parametrize("name", ["quickstart", "etc_query"])
def test_first_question_of_a_notebook_was_answered(name):
    cells = json.loads((ROOT / "notebooks" / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    asked = next(
        cell for cell in cells if cell["cell_type"] == "code" and "cp.exposure_time(" in "".join(cell["source"])
    )
    shown = json.dumps(asked["outputs"])
    assert "detected" in shown
    assert shown.count("unreachable") <= shown.count("detected")
