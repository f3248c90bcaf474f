"""The project around the code: documents that stay true, commands that say what to do."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from cpic_planner import __version__

ROOT = Path(__file__).resolve().parents[2]


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_committed_plan_is_of_this_version_and_schema():
    from cpic_planner.results import PlanResult

    plan = PlanResult.model_validate_json(text("reports/examples/first_plan/plan.json"))
    assert plan.version == __version__


def test_versions_agree():
    assert f"version: {__version__}" in text("CITATION.cff")


def _pins(name):
    return dict(re.findall(r"^([A-Za-z0-9._-]+)==(\S+)", text(name).lower().replace("_", "-"), re.M))


def test_locked_versions_are_those_that_the_suite_runs_with():
    locked, run_with = _pins("requirements-lock.txt"), _pins("constraints.txt")
    differing = {name: version for name, version in locked.items() if run_with.get(name, version) != version}
    assert not differing
    named = re.findall(
        r'^    "([A-Za-z0-9._-]+)', text("pyproject.toml").split("\ndependencies = [")[1].split("\n]")[0], re.M
    )
    assert len(named) > 20
    assert set(named) <= set(locked)
    hashes = text("requirements-lock.txt").count("--hash=sha256:")
    assert hashes >= len(locked)


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md"])
def test_commands_and_files_of_a_page_exist(page):
    page_text = text(page)
    targets = set(re.findall(r"^([a-z-]+):", text("Makefile"), re.M))
    assert set(re.findall(r"(?:`|\$ )make ([a-z-]+)", page_text)) <= targets
    for link in re.findall(r"\]\(([^)#]+)\)", page_text):
        assert link.startswith("http") or (ROOT / link).exists(), link


@pytest.mark.parametrize("name", ["python3", "none"])
def test_makefile_names_the_remedy_when_python_is_missing_or_has_no_venv(tmp_path, name):
    tools = tmp_path / "bin"
    tools.mkdir()
    for tool in ("bash", "make", "awk", "test", "touch", "env"):
        if (path := shutil.which(tool)) is not None:
            (tools / tool).symlink_to(path)
    if name != "none":
        fake = tools / name
        # answers the version check, but has neither venv nor ensurepip
        fake.write_text('#!/bin/bash\n[[ "$2" == *venv* ]] && exit 1\nexit 0\n')
        fake.chmod(0o755)
    for item in ("Makefile", "pyproject.toml", "constraints.txt"):
        (tmp_path / item).write_text(text(item))
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHON", "MAKEFLAGS", "MAKELEVEL")}
    done = subprocess.run(
        ["make", "plan"],
        cwd=tmp_path,
        env=environment | {"PATH": str(tools)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "python3-venv" in done.stderr
    assert not (tmp_path / ".venv").exists()
