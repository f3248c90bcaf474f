"""Examples in docstrings do what they say."""

import doctest
import importlib
import inspect
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WITH_EXAMPLES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for floor in ("cpic_core", "catalogs", "simulator", "cpic_planner")
    for path in sorted((ROOT / floor).rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


class Finder(doctest.DocTestFinder):
    """Finds the examples of decorated functions too."""

    def _from_module(self, module, object):
        return super()._from_module(module, inspect.unwrap(object))


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_hold(name):
    module = importlib.import_module(name)
    runner = doctest.DocTestRunner()
    for example in Finder().find(module, module.__name__):
        runner.run(example)
    written = sum(line.lstrip().startswith(">>> ") for line in Path(module.__file__).read_text("utf-8").splitlines())
    assert runner.tries == written
    assert runner.failures == 0
