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


def loaded_after(code, *arguments):
    script = f"import sys\n{code}\nimport json\nprint('\\n' + json.dumps([m for m in {HEAVY!r} if m in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_import_loads_nothing_heavy():
    assert loaded_after("import cpic_planner, simulator, catalogs") == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["etc", "tau Cet", "--snr", "5"],
        ["etc", "HIP 71681", "--json"],
        ["rank", "--json"],
        ["rank", "--limit", "3"],
        ["--version"],
        ["rank", "--catalog", "snapshot", "--limit", "3"],
        ["catalog", "info"],
        ["catalog", "columns"],
        ["catalog", "refresh", "--help"],
        ["schema", "plan"],
        ["cache", "info"],
        ["simulate", "--help"],
        ["simulate", "--list-presets"],
        ["check", "--help"],
    ],
)
def test_answers_load_nothing_heavy(arguments):
    code = f"from cpic_planner.cli.main import main\nassert main({arguments!r}) == 0"
    assert loaded_after(code) == []


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
