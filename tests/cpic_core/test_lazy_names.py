import gc
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import cpic_core
from cpic_core.lazy_names import lazy_names

SLOW = """import time
time.sleep(0.3)
answer = 42
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of a name that takes its time to load."""
    folder = tmp_path / "slow_names"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "__init__.pyi").write_text("from slow_names.late import answer as answer\n")
    (folder / "late.py").write_text(SLOW)
    monkeypatch.syspath_prepend(tmp_path)
    return lazy_names("slow_names", str(folder / "__init__.py"))


def test_names_are_those_of_the_stub(package):
    load, names, every = package
    assert names() == every == ["answer"]
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        load("other")


def test_threads_that_ask_at_once_all_get_the_name(package):
    load, *_ = package
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(load, ["answer"] * 8)) == [42] * 8


@pytest.fixture
def restless():
    """The search for garbage runs often, and lets other threads go on: Dask looks at how long it takes."""

    def look(phase, info):
        time.sleep(1e-5)

    before = gc.get_threshold()
    gc.callbacks.append(look)
    gc.set_threshold(20)
    yield
    gc.set_threshold(*before)
    gc.callbacks.remove(look)


def test_several_threads_read_stubs_at_once(restless):
    """Python 3.11 raises SystemError where two threads build trees: one counts the depth of the other."""
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda _: lazy_names("cpic_core", cpic_core.__file__)[2], range(24)))
    assert all(names == found[0] for names in found)


@pytest.mark.parametrize("root", ["cpic_core", "catalogs", "simulator", "cpic_planner"])
def test_no_name_is_that_of_a_module_beside_it(root):
    """Once it is imported, a module stands in its package under its own name, and hides what the stub promises."""
    found = []
    for stub in (Path(cpic_core.__file__).parents[1] / root).rglob("__init__.pyi"):
        names = lazy_names(".".join(stub.parent.parts), str(stub.with_suffix(".py")))[2]
        found += [
            name
            for name in names
            if (stub.parent / f"{name}.py").exists() or (stub.parent / name / "__init__.py").exists()
        ]
    assert not found


def test_a_home_is_imported_once_and_its_names_are_those_that_it_has_now(package, monkeypatch):
    load, *_ = package
    assert load("answer") == 42
    monkeypatch.setattr("importlib.import_module", None)
    monkeypatch.setattr(sys.modules["slow_names.late"], "answer", 43)
    assert load("answer") == 43
