"""The reference of the command line, from the commands themselves."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tools.site.markdown import Entry, anchored, code, prose, table

HEADINGS = ("option", "value", "what it does")
_FLAGS = re.compile(r"((?:--?[\w-]+(?:, | / |/)?)+) ?(.*)", re.DOTALL)


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes
    ----------
    words : str
        What is typed to call it.
    help_text : str
    options : tuple of (str, str)
        Left and right column of its help: names with the form of a value, and what it does.
    """

    words: str
    help_text: str
    options: tuple[tuple[str, str], ...]


def commands() -> Iterator[Command]:
    """Yield every command that can be called, with its arguments and options as its help lists them."""
    from cpic_planner.cli.main import app

    yield from _from(app.built, "cpic", None)


def _from(command: Any, words: str, parent: Any) -> Iterator[Command]:
    # The options of a question come from its model when a context is made.
    context = command.make_context(words.split()[-1], [], parent, resilient_parsing=True)
    records = (item.get_help_record(context) for item in command.get_params(context))
    shown = tuple((str(left), str(right)) for left, right in filter(None, records))
    yield Command(words, command.help or "", shown)
    for name, below in getattr(command, "commands", {}).items():
        if not below.hidden:
            yield from _from(below, f"{words} {name}", context)


def worded(text: str) -> str:
    """Return help as Markdown: options as code."""
    parts = re.split(r"(?<![\w-])(--[a-z][\w-]*(?: KEY=VALUE)?)", re.sub(r"\s+", " ", text).strip())
    return "".join(code(part) if part.startswith("--") else prose(part) for part in parts)


def entries(command: Command) -> list[Entry]:
    """Return the arguments and options of a command.

    Parameters
    ----------
    command : Command
    """
    found = []
    for left, right in command.options:
        flags = _FLAGS.fullmatch(left)
        name, value = flags.groups() if flags else (left.partition(" ")[0], left.partition(" ")[2])
        form = ", ".join(code(one) for one in value.strip("<>").split("|"))
        flag = next((one for one in re.split(", | / |/", name) if one.startswith("--")), name)
        anchor = anchored(command.words, flag)
        found.append(Entry(anchor, name, (form, worded(right))))
    return found


def _paragraphs(help_text: str) -> str:
    """Return the help of a command as Markdown: its examples as code."""
    text, _, examples = help_text.partition("Examples:")
    lines = [re.sub(r"\s+", " ", line).strip() for line in re.split(r"\n\s*\n", examples) if line.strip()]
    ran = [line for line in lines if line.startswith("cpic ")]
    said = [worded(part) for part in re.split(r"\n\s*\n", text) if part.strip()]
    after = [worded(line) for line in lines if not line.startswith("cpic ")]
    block = ["```console\n" + "\n".join(f"$ {line}" for line in ran) + "\n```"] if ran else []
    return "\n\n".join((*said, *block, *after))


def page() -> str:
    """Return the reference of every command."""
    parts = []
    for command in commands():
        title = f"({anchored('command', command.words)})=\n## `{command.words}`"
        parts.append(f"{title}\n\n{_paragraphs(command.help_text)}\n\n{table(HEADINGS, entries(command))}")
    return "\n".join(parts)
