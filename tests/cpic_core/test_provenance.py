import dataclasses
import os
import subprocess
import sys

import pytest

from cpic_core import PROMISES, differing_words, fingerprint, promise_of, provenance

PRINT = "from cpic_core import fingerprint; print(fingerprint())"


def printed(folder, **environment):
    """The fingerprint of another process."""
    run = [sys.executable, "-c", PRINT]
    done = subprocess.run(run, cwd=folder, env=os.environ | environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_it_is_that_of_the_machine_and_installation_and_of_nothing_else(tmp_path):
    mine = str(fingerprint())
    settings = {"PYTHONHASHSEED": "7", "TZ": "Pacific/Apia", "LC_ALL": "C", "OMP_NUM_THREADS": "2"}
    assert printed(tmp_path, **settings) == mine
    tuned = printed(tmp_path, NUMBA_CPU_NAME="generic", OPENBLAS_CORETYPE="Prescott", NPY_DISABLE_CPU_FEATURES="X86_V3")
    assert differing_words(mine, tuned) == ["processor"]
    assert promise_of(mine, mine) == PROMISES[0] == "same bytes"
    assert promise_of(mine, tuned) == PROMISES[1]
    assert "within 1e-09" in PROMISES[1]


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of three files in place of the distribution's."""
    home = tmp_path / "little_package"
    (home / "presets").mkdir(parents=True)
    for name in ("__init__.py", "law.py", "presets/deep.yaml"):
        (home / name).write_text(f"# {name}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(provenance, "PACKAGES", (home.name,))
    return home


def taken():
    return str(fingerprint.__wrapped__())


@pytest.mark.parametrize(("name", "word"), [("law.py", "code"), ("presets/deep.yaml", "presets")])
def test_one_byte_changes_the_word_of_its_kind(package, name, word):
    before = taken()
    with (package / name).open("a") as file:
        file.write(" ")
    assert differing_words(before, taken()) == [word]


def test_files_count_by_name_and_content_and_not_what_python_left(package):
    before = taken()
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "law.nbi").write_text("compiled")
    (package / ".law.py.swp").write_text("edited")
    assert taken() == before
    (package / "law.py").rename(package / "rule.py")
    assert differing_words(before, taken()) == ["code"]


def test_the_shipped_tables_are_the_catalogue():
    kinds = {name: provenance._kind(name) for name, _ in provenance._files("catalogs")}
    assert {"code", "catalogue"} == set(kinds.values())
    tables = "catalogs/data/", "catalogs/parsed/"
    assert all((kind == "catalogue") == name.startswith(tables) for name, kind in kinds.items())


def test_differences_name_versions_and_builds():
    mine = fingerprint()
    assert mine.differences(mine) == []
    assert mine.differences(dataclasses.replace(mine, processor=("abacus",))) == []
    versions = {
        **mine.libraries,
        "numpy": "1.2.3 0badc0de",
        "scipy": f"{mine.libraries['scipy'].split(' ')[0]} 0badc0de",
    }
    other = dataclasses.replace(mine, code="f" * 64, libraries=versions)
    here = {name: mine.libraries[name].split(" ")[0] for name in ("numpy", "scipy")}
    told = ["other code", f"numpy 1.2.3 (here {here['numpy']})", f"another build of scipy {here['scipy']}"]
    assert mine.differences(other) == told
    assert differing_words(str(mine), str(other)) == ["code", "libraries"]
    assert differing_words(str(mine), "of an older version") == list(provenance.WORDS)


def test_short_answers_do_not_pay_for_it(capsys):
    from cpic_planner.cli.main import main

    fingerprint.cache_clear()
    assert main(["etc", "tau Cet", "--band", "F662", "--json"]) == 0
    assert fingerprint.cache_info().misses == 0
