"""Tables and entries of generated pages, and docstrings as Markdown."""

import inspect
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Entry:
    """One row of a generated table.

    Attributes
    ----------
    anchor : str
        Where links lead, unique in the site.
    name : str
        What the entry is about, shown as code in the first cell.
    cells : tuple of str
        The other cells, as Markdown.
    """

    anchor: str
    name: str
    cells: tuple[str, ...]


def anchored(*parts: str) -> str:
    """Return an anchor made of names."""
    return re.sub(r"[^a-z0-9]+", "-", "-".join(parts).lower()).strip("-")


def cell(text: Any) -> str:
    """Return a text as the cell of a table."""
    return re.sub(r"\s+", " ", str(text)).strip().replace(r"\|", "|").replace("|", r"\|")


def code(text: Any) -> str:
    """Return a text as code in a cell; nothing for an empty one."""
    return f"`{cell(text)}`" if str(text) else ""


def prose(text: str) -> str:
    """Return plain words as Markdown that shows them as they are."""
    return re.sub(r"([*_<>\[\]$])", r"\\\1", text)


def table(headings: Sequence[str], rows: Iterable[Entry]) -> str:
    """Return a table whose rows can be linked to.

    Parameters
    ----------
    headings : sequence of str
    rows : iterable of Entry
    """
    lines = [f"| {' | '.join(headings)} |", f"|{' --- |' * len(headings)}"]
    for row in rows:
        first = f'<span id="{row.anchor}"></span>{code(row.name)}'
        lines.append(f"| {' | '.join((first, *map(cell, row.cells)))} |")
    return "\n".join(lines) + "\n"


def summary(item: Any) -> str:
    """Return the docstring of a class or function as Markdown, without its numpydoc sections."""
    text = inspect.getdoc(item) or ""
    return marked(re.split(r"\n\n?[A-Z][A-Za-z ]+\n-{3,}\n", f"\n{text}\n", maxsplit=1)[0].strip())


def marked(text: str) -> str:
    """Return a text of a docstring as Markdown."""
    parts = re.split(r"(``.+?``|`[^`]+`)", text, flags=re.DOTALL)
    return "".join(f"`{part.strip('`')}`" if part.startswith("`") else prose(part) for part in parts)


def attributes(item: Any) -> dict[str, str]:
    """Return what the numpydoc section ``Attributes`` of a class says of each name, as Markdown.

    Classes that it inherits from are read too; nothing is said of names that stand there without a text.
    """
    found: dict[str, str] = {}
    for owner in reversed(inspect.getmro(item)):
        text = inspect.cleandoc(owner.__dict__.get("__doc__") or "")
        section = re.search(r"(?:^|\n)Attributes\n-+\n(.*?)(?:\n\n[A-Z]\w+\n-{3,}\n|\Z)", text, re.DOTALL)
        if section is None:
            continue
        for head, body in re.findall(r"^(\S[^\n]*)\n((?:[ ]+[^\n]*\n?|\n)*)", section[1] + "\n", re.MULTILINE):
            names = [name.strip() for name in head.partition(" : ")[0].split(",")]
            said = marked(re.sub(r"\s+", " ", body).strip())
            found |= {name: said for name in names if said}
    return found
