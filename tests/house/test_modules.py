"""Modules are formatted, and the page on architecture names those that exist."""

import pkgutil
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MOST_SKIPS = 20


def sources():
    return {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
        for floor in ("cpic_core", "catalogs", "simulator", "cpic_planner")
        for path in (ROOT / floor).rglob("*.py")
    }


def test_the_formatter_formats():
    assert sum(text.count("# fmt: skip") for text in sources().values()) <= MOST_SKIPS


def test_the_page_on_architecture_names_what_exists():
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`((?:cpic_core|catalogs|simulator|cpic_planner)(?:[./]\w+)+(?:\.py)?)/?`", page))
    assert len(names) > 15
    for name in names:
        if "/" in name:
            assert (ROOT / name).exists(), name
        else:
            pkgutil.resolve_name(name)
    assert (ROOT / "docs" / "architecture.svg").exists()
    assert len(page.splitlines()) <= 70
