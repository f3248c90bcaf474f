"""Blocks of code in the README and the pages of the site."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted(path for path in (ROOT / "docs").rglob("*.md"))]
PAGES = [
    path for path in PAGES if not {"_made", "_build", "reports", "notebooks"} & set(path.relative_to(ROOT).parts[:-1])
]
_FENCE = re.compile(r"^```(\{?[\w-]*\}?)(?: [^\n]*)?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NAMED = re.compile(r"# (\w[\w-]*\.(?:yaml|csv|txt))\b")


@dataclass(frozen=True)
class Block:
    """One block: the page, its place there, its language and its text."""

    page: str
    line: int
    language: str
    text: str

    @property
    def file_name(self):
        """Name of the file that the block shows, by its first line; empty for none."""
        found = _NAMED.match(self.text)
        return found[1] if found else ""

    @property
    def commands(self):
        """Lines that are typed into a shell, without the prompt and what is said beside them."""
        lines = [line for line in self.text.splitlines() if line.strip()]
        if self.language != "{run}":
            lines = [line[2:] for line in lines if line.startswith("$ ")]
        return [re.sub(r"\s+# .*", "", line).strip() for line in lines]


def blocks_of(path):
    """Return the blocks of a page in their order."""
    text = path.read_text(encoding="utf-8")
    name = path.relative_to(ROOT).as_posix()
    found = [Block(name, text[: fence.start()].count("\n") + 1, fence[1], fence[2]) for fence in _FENCE.finditer(text)]
    assert len(re.findall(r"^```", text, re.MULTILINE)) == 2 * len(found), f"{name}: a block is not closed"
    return [block for block in found if block.language not in ("{math}", "{include}", "{toctree}", "{glossary}")]


def python_of(block):
    """Return a block of Python as it runs."""
    return compile(block.text, f"{block.page}:{block.line}", "exec")
