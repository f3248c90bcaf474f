"""Runs that are broken on purpose, in forks of one process."""

import importlib.util
import sys
from pathlib import Path

import pytest


def _load(name):
    spec = importlib.util.spec_from_file_location(f"faults_{name}", Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def harness():
    return _load("harness")


@pytest.fixture(scope="session")
def kills(harness):
    """The script of the long proof, which imports its harness by name."""
    sys.modules["harness"] = harness
    return _load("kills")


@pytest.fixture(scope="session")
def server(harness, tmp_path_factory):
    running = harness.Server(tmp_path_factory.mktemp("server"))
    yield running
    running.close()


@pytest.fixture(scope="session")
def whole(harness, server, tmp_path_factory):
    """Run a question that is left alone, twice at most: its files by name and hash, and its steps of writing."""
    found = {}

    def run(question):
        if question not in found:
            place = harness.Place(tmp_path_factory.mktemp(question) / "whole", question)
            done = server.run(place.argv, place.folder, root=str(place.out))
            place.check_finished(done, place.results())
            found[question] = place.results(), done.proof
        return found[question]

    return run
