"""Every public name, option, key, column, keyword, status and unit has its entry; each is counted by another route."""

import ast
import json
import re
from pathlib import Path

import pytest

from cpic_core import Reason, Status
from cpic_planner.queries import LIBRARIES, options_of
from cpic_planner.registry import REDUCTIONS, SCORES
from cpic_planner.schemas import FOLDER, QUESTIONS, RESULTS
from simulator.products.keywords import KEYWORD_FILE
from tools.site import columns, commands, keys, products, python_api, words
from tools.site.markdown import anchored

ROOT = Path(__file__).resolve().parents[3]


def anchors(text):
    return re.findall(r'<span id="([^"]+)"></span>', text)


@pytest.fixture(scope="module")
def listed():
    return list(commands.commands())


def test_every_option_of_every_command(listed):
    """The questions that commands ask say which options they have, and the parser which commands there are."""
    by_words = {command.words: " ".join(left for left, _ in command.options) for command in listed}
    found = 0
    for name, model in QUESTIONS.items():
        module, _, own = model.partition(":")
        question = getattr(__import__(module, fromlist=[own]), own)
        for option in options_of(question):
            if not option.asked.hidden:
                assert re.search(rf"(?<![\w-]){re.escape(option.flag)}(?![\w-])", by_words[f"cpic {name}"]), option.flag
                found += 1
    assert found > 300
    commanded = {"cpic plan", "cpic catalog refresh", "cpic instrument diff", "cpic cache clear", "cpic check"}
    assert commanded <= set(by_words)
    page = commands.page()
    assert len(anchors(page)) == sum(len(command.options) for command in listed)
    assert all(right for command in listed for _, right in command.options), "an option without help"


@pytest.mark.parametrize("package", python_api.PACKAGES)
def test_every_public_name(package):
    """The stubs list the public names."""
    folder = ROOT.joinpath(*package.split("."))
    stub = ast.parse((folder / "__init__.pyi").read_text(encoding="utf-8"))
    listed = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    documented = python_api.public()
    held = {id(item) for item in documented.values()}
    module = __import__(package, fromlist=["__name__"])
    missing = [name for name in listed if not name.startswith("__") and id(getattr(module, name)) not in held]
    assert missing == []


def test_types_that_functions_return():
    """What a user gets back is documented, however deep it lies."""
    returned = python_api.returned(python_api.public())
    for name in ("SourceTable", "PsfMetrics", "Choice", "EffectRow", "PopulationConfig", "Finding", "SurveyStrategy"):
        assert any(place.endswith(f".{name}") for place in returned), name
    page = python_api.page()
    for name in [*python_api.public(), *returned]:
        assert f":: {name}\n" in page, name


def test_every_value_of_the_instrument_with_its_source():
    """The command shows every value of the instrument; those of bands, which have the same keys, stand once."""
    from cpic_planner.queries import instrument_rows
    from simulator import load_instrument

    rows = {found: line for line in keys.page().splitlines() for found in anchors(line)}
    for row in instrument_rows(load_instrument()):
        name = re.sub(r"^bands\.\w+", "bands.*", row.key)
        above = name.rpartition(".")[0]
        line = rows.get(anchored("key", "instrument", name)) or rows.get(anchored("key", "instrument", above))
        assert line, name
        if row.confidence and not name.startswith("bands"):
            assert f"| {row.confidence} |" in line, name
    assert len(rows) > 300


@pytest.mark.parametrize("kind", ["scene", "strategies", "population", "visibility", "ensemble", "simulation"])
def test_every_key_of_other_files(kind):
    """A file with an unknown key is refused with the known ones; here the models of the loaders say them."""
    own = {anchor: model for _, anchor, model, _, _ in keys.files()}
    page = keys.page()
    for name in own[kind].model_fields:
        assert re.search(rf"`{name}(`|\.|\[)", page), name


def test_every_column():
    """The shipped schemas name every field of every result."""
    page = columns.page()
    found = 0
    for name in RESULTS:
        schema = json.loads((FOLDER / f"{name}.schema.json").read_text(encoding="utf-8"))
        for title, part in {schema["title"]: schema, **schema.get("$defs", {})}.items():
            for field in part.get("properties", {}):
                assert f'"column-{title.lower()}-{field.lower().replace("_", "-").strip("-")}"' in page, (title, field)
                found += 1
    assert found > 900
    assert "| |\n" not in page, "a column without a meaning"


def test_every_keyword():
    written = re.findall(r"^  ([A-Z][A-Z0-9_-]*): \{hdu", KEYWORD_FILE.read_text(encoding="utf-8"), re.MULTILINE)
    assert [entry.name for entry in products.entries()] == written
    assert len(written) > 80


def test_every_status_and_reason_has_a_sentence():
    for enum in (Status, Reason):
        said = words.meanings(enum)
        assert set(said) == {str(item.value) for item in enum if item.value}
        assert all(text.endswith(".") and len(text) > 15 for text in said.values())
    page = words.page()
    for name in (*map(str, Status), *filter(None, map(str, Reason)), *LIBRARIES, *REDUCTIONS, *SCORES):
        assert f"`{name}`" in page, name


def test_every_flag_of_an_answer():
    """Those that answers about many stars carry."""
    from cpic_planner import rank_targets

    page = {entry.name for entry in words.flags()}
    rows = rank_targets(n_planets=20, bands=["F520"], v_mag_max=4.0).targets
    carried = {flag.partition(":")[0] for row in rows for flag in row.flags}
    assert len(carried) > 5
    assert carried <= page
