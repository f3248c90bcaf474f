"""Settings of the whole suite, and the TAP service that several parts of it ask."""

import gc
import importlib.util
import logging
import os
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# The same cases in every run, so that red can be repeated, and no verdict by the clock of a busy machine. New cases,
# twice as many: pytest --hypothesis-profile explore
settings.register_profile("explore", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("suite", parent=settings.get_profile("explore"), derandomize=True, max_examples=50)
settings.load_profile("suite")

# The matrices here are small: BLAS threads only get in each other's way, and sums should have one order.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
# A variance of 1e-20 is a number too: approx compares it by its relative tolerance, not as equal to 0 within 1e-12.
type(pytest.approx(1.0)).DEFAULT_ABSOLUTE_TOLERANCE = 0.0
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # every process that a test starts would compile the package anew


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """The tests and what they import stay to the end: a tenth of the time would go into looking for garbage there."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()
        gc.set_threshold(50_000, 100, 10)


def pytest_ignore_collect(collection_path, config):
    """With one mark alone (``-m long``), pass over the files of tests that do not write it: they are not imported.

    Nor are those of the browser where its mark is refused.
    """
    mark = config.getoption("markexpr")
    if "not browser" in mark and "browser" in collection_path.parts:
        return True
    if not mark.isidentifier() or not collection_path.match("test_*.py"):
        return None
    return f"mark.{mark}" not in collection_path.read_text(encoding="utf-8") or None


@pytest.fixture(autouse=True, scope="session")
def _no_lines_of_progress():
    """What a command prints does not depend on how busy the machine is; tests of progress set their own time."""
    from cpic_planner.cli import progress

    progress.SHOW_AFTER_S = float("inf")


@pytest.fixture(autouse=True)
def _own_levels():
    """Commands set the level of messages for their process; the next test begins with the default again."""
    yield
    for package in ("cpic_core", "catalogs", "simulator", "cpic_planner"):
        logging.getLogger(package).setLevel(logging.NOTSET)


def _load(name):
    """Import a helper that lies beside this file."""
    spec = importlib.util.spec_from_file_location(f"tests_{name}", Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def pytest_generate_tests(metafunc):
    """A test with the fixture ``refusal`` or ``reading`` runs for each reader of the table of that name beside it."""
    for name in {"refusal", "reading"} & set(metafunc.fixturenames):
        helper = _load("refusals")
        cases = list(helper.by_reader(getattr(helper, f"{name}s")(metafunc.definition.path.with_name(f"{name}s.yaml"))))
        metafunc.parametrize(name, cases, ids=[case.reader for case in cases])


@pytest.fixture(scope="session", autouse=True)
def _own_data_folder(tmp_path_factory):
    """No test sees the refreshed tables of the person who runs it, or leaves one there."""
    before = os.environ.get("CPIC_DATA_DIR")
    os.environ["CPIC_DATA_DIR"] = str(tmp_path_factory.mktemp("data"))
    yield
    if before is None:
        del os.environ["CPIC_DATA_DIR"]
    else:
        os.environ["CPIC_DATA_DIR"] = before


@pytest.fixture(scope="session")
def refused():
    """Call a function that refuses what it is given: by `InputError`, in one line that matches; returns that line."""
    from cpic_core import InputError

    def check(match, function, /, *arguments, **named):
        with pytest.raises(InputError, match=match or None) as caught:
            function(*arguments, **named)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    return check


@pytest.fixture(scope="session")
def _rankings():
    return {}


@pytest.fixture
def kept_rankings(_rankings, monkeypatch):
    """What decides a ranking is hashed: one that another test asked for, of commands or pages, is not made again."""
    from cpic_planner.ranking import order, sensitivity

    def kept(setting, targets, *, real=order.ranked, brief=False, counts=None):
        key = setting.digest(targets), targets.name.tobytes(), brief
        if key not in _rankings:
            _rankings[key] = real(setting, targets, brief=brief, counts=counts)
        return _rankings[key]

    for module in (order, sensitivity):
        monkeypatch.setattr(module, "ranked", kept)


@pytest.fixture
def data_folder(tmp_path, monkeypatch):
    """An empty data folder for one test."""
    monkeypatch.setenv("CPIC_DATA_DIR", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def nothing_is_lost(monkeypatch):
    """A refreshed table may lack any number of known rows: those of the tests are small."""
    monkeypatch.setattr("catalogs.archives.MOST_LOST", 1.0)


@pytest.fixture(scope="session")
def tap():
    """The module of the service: its column names and writers."""
    return _load("tap_service")


@pytest.fixture(scope="session")
def sky():
    """The module of the tables behind it."""
    return _load("simbad_sky")


@pytest.fixture(scope="session")
def recorded():
    """The module of the NASA Exoplanet Archive's rows."""
    return _load("archive_planets")


@pytest.fixture(scope="session")
def _shipped_rows(recorded):
    """The archive's rows of the shipped planets."""
    from catalogs import load_known_planets, load_stars

    return recorded.shipped_rows(load_known_planets(), load_stars())


@pytest.fixture
def archive(tap, _shipped_rows):
    """The NASA Exoplanet Archive on this machine, which has the shipped planets."""
    service = tap.ArchiveService([dict(row) for row in _shipped_rows])
    yield service
    service.close()


@pytest.fixture
def simbad(tap, sky):
    """A TAP service on this machine with a small sky of its own."""
    service = tap.TapService(sky.small_sky())
    yield service
    service.close()
