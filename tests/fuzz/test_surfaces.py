"""Everything that comes from outside is answered, or refused in one line: command line, YAML, tables, products, Python.

Cases are drawn by hypothesis, the same in every run. Each is watched (`tests.fuzz.watched`): no traceback, no warning,
no ten seconds without a word, no gigabyte more, and a refusal is one printable line that says what is allowed. A few
of them run with every change; ``make fuzz SEED=7`` draws 5000 others of each surface, and gives every argument of the
public functions every object of the pool. What hypothesis draws hangs on constants of the code too: the many cases are
a search, not a proof whose evidence could be kept.
"""

import time
import warnings
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import cpic_planner
from cpic_core import InputError
from tests.fuzz import command_line, product_files, python_calls, settings_files, table_files, watched

SURFACES: dict[str, tuple[ModuleType, int]] = {
    "command line": (command_line, 30),
    "yaml": (settings_files, 60),
    "tables": (table_files, 75),
    "products": (product_files, 40),
    "python": (python_calls, 100),
}
"""Cases of each surface, and how many run with every change: about a second each."""
LONG = 5000


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The only folder that cases know, and lines of progress as users get them."""
    place = tmp_path / "a" / "b"
    place.mkdir(parents=True)
    python_calls.prepare(place)
    monkeypatch.chdir(place)
    monkeypatch.setattr("cpic_planner.cli.progress.SHOW_AFTER_S", 2.0)
    with python_calls.held(place):
        yield place


@pytest.mark.parametrize(
    ("name", "count"),
    [(name, count) for name, (_, count) in SURFACES.items()]
    + [pytest.param(name, LONG, marks=pytest.mark.fuzz) for name in SURFACES],
)
def test_every_case_is_answered_or_refused_in_one_line(name, count, folder, record_property):
    surface, found = SURFACES[name][0], watched.Surface()
    if hasattr(surface, "prepare"):
        surface.prepare(folder)

    @settings(max_examples=count, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
    @given(surface.cases(folder))
    def every(case):
        found.tried(case)

    began = time.process_time()
    every()
    spent_s = time.process_time() - began
    assert found.ended.total() == count
    assert found.ended["answered"] > count / 50  # both, or the cases test nothing
    assert found.ended["refused"] > count / 50
    record_property("cases", " ".join(f"{number} {how}" for how, number in sorted(found.ended.items())))
    record_property("processor_s", f"{spent_s:.0f}, slowest case {found.slowest_s:.1f}")


@pytest.mark.fuzz
@pytest.mark.parametrize("surface", [python_calls, command_line])
def test_every_argument_is_given_every_object_and_every_option_the_ends_of_numbers(surface, folder, record_property):
    """What cases find by chance of one argument alone is found for certain."""
    found, faults = watched.Surface(), []
    for case in surface.every_one(folder):
        try:
            found.tried(case)
        except watched.Fault as fault:
            faults.append(str(fault)[:500])
    assert not faults, "\n".join(faults)
    assert found.ended["refused"] > found.ended["answered"] > 100
    record_property("cases", " ".join(f"{number} {how}" for how, number in sorted(found.ended.items())))


@pytest.mark.long
def test_good_cases_are_answered(folder):
    """Else nothing is tested behind their own fault."""
    for name, arguments in python_calls.good_calls(folder).items():
        how = watched.of_function(lambda name=name, arguments=arguments: getattr(cpic_planner, name)(**arguments))
        assert how == ("refused" if name in python_calls.REFUSED else "answered"), name
    called = set(python_calls.good_calls(folder)) | set(python_calls.NO_CALLS)
    public = {name for name in cpic_planner.__all__ if callable(getattr(cpic_planner, name))}
    assert public - called == set()
    for arguments in command_line.GOOD:
        assert watched.of_command(command_line.named(arguments, folder)) == "answered", arguments
    product_files.prepare(folder)
    for name in ("psf.fits", "psf.npz", "surface.fits", "surface.npz"):
        product_files.read(name.partition(".")[0], folder / "good" / name)
    assert product_files.read("run", folder / "good" / "run").resumed_parts == 2


def noisy():
    warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)


def hungry():
    return bytearray(2 * watched.MEMORY_BYTES)


def endless():
    while True:
        pass


def endless_but_caught():
    try:
        endless()
    except Exception as error:
        raise InputError("file", "a", allowed="a whole file", hint=str(error)) from None


def hungry_but_caught():
    try:
        np.ones(2 * watched.MEMORY_BYTES, np.uint8)
    except Exception as error:
        raise InputError("file", "a", allowed="a whole file", hint=str(error)) from None


def two_lines():
    error = InputError("key", 1, allowed="2")
    error.args = ("key = 1: not accepted\nallowed: 2",)
    raise error


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (noisy, "RuntimeWarning: overflow"),
        (hungry, "MemoryError"),
        (endless, "nothing was said"),
        (endless_but_caught, "nothing was said"),
        (hungry_but_caught, "more than 1e.09 bytes"),
        (two_lines, "more than one line"),
        (lambda: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_the_watch_sees_what_it_watches_for(function, words, monkeypatch):
    monkeypatch.setattr(watched, "SILENT_S", 0.2)
    with pytest.raises(watched.Fault, match=words):
        watched.of_function(function)
    assert watched.of_function(lambda: 1) == "answered"
