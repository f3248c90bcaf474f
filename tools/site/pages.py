"""Everything that is made before Sphinx reads the pages: parts of the reference, notebooks, reports, the gallery."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

from tools import readme
from tools.site import columns, commands, keys, products, python_api, schemas, words

ROOT = Path(__file__).resolve().parents[2]
PARTS: dict[str, Callable[[], str]] = {
    "commands": commands.page,
    "python": python_api.page,
    "keys": keys.page,
    "columns": columns.page,
    "schemas": schemas.page,
    "keywords": products.page,
    "words": words.page,
}
"""Generated parts of pages by name; a page includes them from ``_made``."""
_FIGURE = re.compile(r"\{\{ (\w+)\.(\w+) \}\}")
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)\s]+)\)")


def make(docs: Path) -> None:
    """Write what is made into the folder of the pages.

    Parameters
    ----------
    docs : Path
        Folder of ``conf.py``. Its folders ``_made``, ``notebooks`` and ``reports`` are replaced.
    """
    for folder in ("_made", "notebooks", "reports"):
        shutil.rmtree(docs / folder, ignore_errors=True)
        (docs / folder).mkdir()
    for name, page in PARTS.items():
        (docs / "_made" / f"{name}.md").write_text(page(), encoding="utf-8")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        shutil.copy(path, docs / "notebooks")
    for path in sorted((ROOT / "reports").glob("*/report.md")):
        copy_report(path, docs / "reports")
    (docs / "_made" / "gallery.md").write_text(gallery(), encoding="utf-8")


def copy_report(path: Path, to: Path) -> None:
    """Copy a report with its figures; files that it names beside them become plain names.

    Parameters
    ----------
    path : Path
        Its ``report.md``.
    to : Path
        Folder of the copies; the copy is called as the folder of the report.
    """
    name = path.parent.name
    text = _LINK.sub(r"`\2`", path.read_text(encoding="utf-8"))
    text = re.sub(r"(!\[[^\]]*\]\()(?!https?:)([^)/\s]+\))", rf"\1{name}/\2", text)
    for figure in set(re.findall(rf"\]\({name}/([^)\s]+)\)", text)):
        (to / name).mkdir(exist_ok=True)
        shutil.copy(path.parent / figure, to / name)
    (to / f"{name}.md").write_text(text, encoding="utf-8")


def gallery() -> str:
    """Return every figure of the reports, with the command that makes it."""
    parts = []
    for path in sorted((ROOT / "reports").glob("*/report.md")):
        text, name = path.read_text(encoding="utf-8"), path.parent.name
        title = re.search(r"^# (.+)$", text, re.MULTILINE)
        figures = re.findall(r"!\[([^\]]*)\]\(([^)\s]+)\)", text)
        if figures and title:
            parts.append(f"## {title[1]}\n\n`{_command(path)}` makes it; [the report](reports/{name}.md).\n")
            parts += [f"![{words_}](reports/{name}/{file})\n\n*{words_}*\n" for words_, file in figures]
    return "\n".join(parts)


def _command(report: Path) -> str:
    made = report.parent / "make.py"
    return f"python reports/{report.parent.name}/make.py" if made.exists() else f"python -m tools.{report.parent.name}"


def with_figures(text: str) -> str:
    """Return the text of a page with figures of the reports in the place of their names, as in the README.

    Parameters
    ----------
    text : str
        Text with ``{{ group.figure }}`` in it.

    Raises
    ------
    KeyError
        If it names a figure that is not there.
    """
    return _FIGURE.sub(lambda named: readme.FIGURES[named[1]]()[named[2]], text)
