"""Predicted over recovered SNR: one ratio in one direction, in every text, heading, legend and schema."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
TEXTS = ("*.py", "*.md", "*.yaml", "*.json", "*.ipynb", "*.j2")
WHERE = ("cpic_planner", "cpic_core", "simulator", "catalogs", "docs", "notebooks", "reports", "tools")
OTHER_DIRECTION = re.compile(
    r"recovered\W{1,3}(over|to|by)?\s*predicted\s+SNR|recovered\s*/\s*predicted|images\s*/\s*(ETC|SNR)\b"
    r"|recovered\s+SNR\s+is\s+\S+(\s*±\s*\S+)?\s+of\s+the\s+predicted|snr_ratio",
    re.IGNORECASE,
)


def texts():
    yield from (ROOT / name for name in ("README.md", "README.template.md", "CONTRIBUTING.md"))
    for folder in WHERE:
        for pattern in TEXTS:
            yield from (path for path in (ROOT / folder).rglob(pattern) if "_made" not in path.parts)


@pytest.mark.parametrize(
    "text",
    [
        "recovered over predicted SNR is 1.02",
        "mean of recovered / predicted SNR over bands",
        "the recovered SNR is 0.97 ± 0.02 of the predicted one",
        "images / ETC (95 %)",
    ],
)
def test_the_other_direction_is_recognised(text):
    assert OTHER_DIRECTION.search(text)


def test_no_text_has_the_other_direction():
    found = []
    for path in texts():
        text = path.read_text(encoding="utf-8")
        if path.name == "glossary.md":
            text = text.replace("*Instead of:* recovered over predicted", "")
        found += [f"{path}: {match[0]}" for match in OTHER_DIRECTION.finditer(text)]
    assert found == []


def test_one_definition_of_detected_and_margin_in_every_glossary():
    """The page of the site and the glossary of reports say the same, links aside."""
    prose = yaml.safe_load((ROOT / "cpic_planner/report/templates/prose.yaml").read_text(encoding="utf-8"))["terms"]
    page = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    for term in ("detected", "margin"):
        entry = re.search(rf"^{term}\n((?:  .+\n)+)", page, re.MULTILINE)[1]
        plain = re.sub(r"{term}`([^`<]*?)(?: <[^`]*>)?`", r"\1", entry.partition("*Instead of:*")[0])
        assert " ".join(plain.split()) == " ".join(prose[term].split())
    assert "known place" not in prose["detected"].partition(".")[0]  # the verdict is not that of the known place
