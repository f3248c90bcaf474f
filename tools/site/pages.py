"""Everything that is made before Sphinx reads the pages: parts of the reference, notebooks, reports, the gallery."""

import contextlib
import functools
import io
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

from cpic_planner import __version__
from tools import readme
from tools.reports import REPORT, folders
from tools.site import columns, commands, headings, keys, products, python_api, schemas, validation, words
from tools.words import GLOSSARY, replaced_words

ROOT = Path(__file__).resolve().parents[2]


def terms() -> str:
    """Return the terms of the glossary that replace other words, with those words."""
    replaced = replaced_words((ROOT / GLOSSARY).read_text(encoding="utf-8"))
    lines = ["| write | instead of |", "| --- | --- |"]
    for term in dict.fromkeys(replaced.values()):
        lines.append(f"| {{term}}`{term}` | {', '.join(other for other, word in replaced.items() if word == term)} |")
    return "\n".join(lines) + "\n"


PARTS: dict[str, Callable[[], str]] = {
    "commands": commands.page,
    "python": python_api.page,
    "keys": keys.page,
    "columns": columns.page,
    "headings": headings.page,
    "schemas": schemas.page,
    "keywords": products.page,
    "words": words.page,
    "units": words.units,
    "terms": terms,
    "validation": validation.page,
}
"""Generated parts of pages by name; a page includes them from ``_made``."""
_FIGURE = re.compile(r"\{\{ (\w+)\.(\w+) \}\}")
_RUN = re.compile(r"^```\{run\}\n(.*?)^```", re.MULTILINE | re.DOTALL)
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
    for report in folders().values():
        copy_report(report / REPORT, docs / "reports")
    (docs / "_made" / "gallery.md").write_text(gallery(), encoding="utf-8")


def prepared(text: str) -> str:
    """Return the text of a page as Sphinx reads it: with its figures, and with the answers of commands that it runs.

    Parameters
    ----------
    text : str
        Text of a page, with ``{{ group.figure }}`` and with blocks ``{run}`` that hold commands.

    Raises
    ------
    KeyError
        If it names a figure that is not there.
    RuntimeError
        If a command fails.
    """
    return _RUN.sub(lambda block: _answers(block[1]), with_figures(text))


def _answers(commands_: str) -> str:
    shown = [f"$ {line}\n{answer(line)}" for line in commands_.strip().splitlines()]
    return "```console\n" + "\n".join(shown) + "```"


def answer(line: str) -> str:
    """Return what a command prints.

    Parameters
    ----------
    line : str
        As it is typed: ``cpic etc ...``.

    Raises
    ------
    RuntimeError
        If it does not end well.
    """
    from cpic_planner.cli.main import main

    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(io.StringIO()) as complaint:
        status = main([*shlex.split(line)[1:], "-q"])
    if status != 0:
        raise RuntimeError(f"{line}: exit status {status}: {complaint.getvalue()}")
    return re.sub(r" +$", "", told.getvalue(), flags=re.MULTILINE)


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
    for name, folder in sorted(folders().items()):
        text = (folder / REPORT).read_text(encoding="utf-8")
        title = re.search(r"^# (.+)$", text, re.MULTILINE)
        figures = re.findall(r"!\[([^\]]*)\]\(([^)\s]+)\)", text)
        if figures and title:
            parts.append(
                f"## {title[1]}\n\n`python -m tools.reports {name}` makes it; [the report](reports/{name}.md).\n"
            )
            parts += [f"![{words_}](reports/{name}/{file})\n\n*{words_}*\n" for words_, file in figures]
    return "\n".join(parts)


def with_figures(text: str) -> str:
    """Return the text of a page with figures of the reports in the place of their names, as in the README.

    Parameters
    ----------
    text : str
        Text with ``{{ group.figure }}`` in it; ``{{ asked.report }}`` is what a report asks for and finds.

    Raises
    ------
    KeyError
        If it names a figure that is not there.
    """
    return _FIGURE.sub(lambda named: _figures(named[1])[named[2]], text).replace("{{ version }}", __version__)


@functools.cache
def _figures(group: str) -> readme.Figures:
    return readme.FIGURES[group]()
