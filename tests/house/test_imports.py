"""Heavy libraries stay out until they are needed."""

import json
import subprocess
import sys

import pytest

HEAVY = (
    "pandas",
    "synphot",
    "hcipy",
    "matplotlib",
    "photutils",
    "sep",
    "astropy",
    "astroquery",
    "pyvo",
    "requests",
    "scipy.stats",
    "numba",
    "dask",
)


# A ranking in one band loads what a ranking in four does, in a quarter of the time.
COMMANDS = [
    ["etc", "tau Cet", "--snr", "5"],
    ["etc", "HIP 71681", "--json"],
    ["rank", "--json", "--planets", "100"],
    ["rank", "--limit", "3", "--band", "F520", "--planets", "100"],
    ["--version"],
    ["rank", "--catalog", "snapshot", "--limit", "3", "--band", "F520"],
    ["catalog", "info"],
    ["catalog", "columns"],
    ["catalog", "refresh", "--help"],
    ["schema", "plan"],
    ["cache", "info"],
    ["simulate", "--help"],
    ["simulate", "--list-presets"],
    ["check", "--help"],
]
SCRIPT = f"""
import contextlib, io, json, sys
import cpic_planner, simulator, catalogs
def loaded():
    return {{m for m in {HEAVY!r} if m in sys.modules}}
told, before = [(0, sorted(loaded()))], loaded()
from cpic_planner.cli.main import main
for arguments in {COMMANDS!r}:
    with contextlib.redirect_stdout(io.StringIO()):
        status = main(arguments)
    told.append((status, sorted(loaded() - before)))
    before = loaded()
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def loads():
    """Status of the commands, one after the other in a new process, and what each loaded; first the import alone."""
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_import_loads_nothing_heavy(loads):
    assert loads[0] == [0, []]


@pytest.mark.parametrize("number", range(len(COMMANDS)), ids=lambda number: " ".join(COMMANDS[number]))
def test_answers_load_nothing_heavy(loads, number):
    assert loads[1 + number] == [0, []]


def test_public_names_exist_here_and_there():
    import cpic_planner
    import simulator

    assert set(simulator.__all__) <= set(cpic_planner.__all__)
    for name in cpic_planner.__all__:
        assert getattr(cpic_planner, name) is not None


def test_functions_are_not_shadowed_by_modules_of_their_name():
    code = "import cpic_planner.cli.main, cpic_planner.validation.confirm, cpic_planner.plan\n"
    code += "import simulator, cpic_planner\n"
    code += "for p in (simulator, cpic_planner):\n    for n in p.__all__:\n"
    code += "        assert not str(type(getattr(p, n))).count('module'), n"
    subprocess.run([sys.executable, "-c", code], check=True)
