"""Check the words that people read: ``python -m tools.words``, which is part of ``make lint``.

Docstrings of functions begin with a verb, those of modules and classes with no question word. The help of commands and
the pages of the site use the words of the glossary, not those that stand behind *Instead of* there. Ruff's D400 and
D401 (a full stop, no other mood than the imperative) go before: they let a summary that has no verb at all pass.
"""

import ast
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("cpic_core", "catalogs", "simulator", "cpic_planner", "tools")
GLOSSARY = "docs/glossary.md"
STYLE = "docs/style.md"
MADE = frozenset({"_made", "_build", "notebooks", "reports"})

# A verb that is missing is added here if it is plain.
_PLAIN = """
Accept Add Allow Answer Append Apply Ask Assemble Attach Average Begin Bend Book Bound Bring Build Call Change Charge
Check Choose Clear Clip Close Collect Compare Compute Confirm Convert Copy Count Couple Create Cut Deal Decide Declare
Delete Derive Describe Design Detect Dig Do Draw Drop End Enter Estimate Expand Explain Extend Extract Fetch Fill
Filter Find Fit Fold Follow Forbid Forget Format Free Gather Get Give Group Guard Hand Handle Hide Hold Import Improve
Insert Install Integrate Interpolate Join Keep Leave Let Link List Load Lock Look Make Map Mark Mask Match Measure
Merge Mix Move Multiply Name Normalise Note Notice Observe Open Order Parse Pass Pick Place Plan Predict Prefer
Prepare Print Propagate Put Raise Rank Read Rebuild Record Reduce Refuse Register Remove Rename Render Repeat Replace
Reset Resolve Restore Return Round Run Sample Save Say Scale Scatter Schedule Screen Search See Select Send Separate
Serve Set Shade Shift Show Simulate Skip Solve Sort Spill Split Start Stop Store Subtract Sum Survive Swap Take Tell
Test Throw Time Trace Track Trail Transform Translate Travel Turn Update Use Validate Verify Visit Wait Walk Warn
Weigh Withdraw Work Wrap Write Yield
"""
VERBS = frozenset(_PLAIN.split())
# "What fills a table" is a riddle, "Name of a band" no sentence, although "name" is a verb too.
QUESTION_WORDS = frozenset({"What", "How", "Where", "When", "Whether", "Why", "Which", "Of", "From"})
_NOUN = re.compile(r"\w+ of\b")
# Options, keys and code are names, not words.
_NAMES = re.compile(r"```.*?```|``[^`]*``|`[^`]*`|\]\([^)]*\)|--[\w-]+|\b\w+[_=.]\w[\w=.]*", re.DOTALL)
_INSTEAD = re.compile(r"\*Instead of:\* ([^*]+?)\.$", re.MULTILINE)


def replaced_words(glossary: str) -> dict[str, str]:
    """Return the word of the glossary for each word that it replaces.

    Parameters
    ----------
    glossary : str
        Content of ``docs/glossary.md``: terms at the margin, their definitions below them.

    Returns
    -------
    dict of str to str
        For example ``{"S/N": "SNR"}``.
    """
    body = glossary.partition("```{glossary}\n")[2].partition("\n```")[0]
    entries = (entry.partition("\n") for entry in re.split(r"\n\n(?=\S)", body.strip()))
    return {
        other: term
        for term, _, definition in entries
        for others in _INSTEAD.findall(definition)
        for other in re.split(r",\s+", others)
    }


def wrong_words(where: str, text: str, replaced: Mapping[str, str]) -> Iterator[str]:
    """Yield a line for each word of a text in whose place the glossary has another.

    Parameters
    ----------
    where : str
        The text's place, for the line.
    text : str
        Help or a page; options, keys and code in it do not count.
    replaced : mapping of str to str
        As `replaced_words` returns them.
    """
    plain = re.sub(r"\s+", " ", _NAMES.sub(" ", text))
    for other, term in replaced.items():
        if re.search(rf"(?<![\w-]){re.escape(other)}s?(?![\w-])", plain, re.IGNORECASE):
            yield f'{where}: "{other}": write "{term}", the word of the glossary'


def is_fragment(summary: str) -> bool:
    """Return whether the summary of a function begins with no verb, such as "Name of the band."."""
    return re.split(r"\W", summary, maxsplit=1)[0] not in VERBS or _NOUN.match(summary) is not None


def docstring_fragments(where: str, code: str) -> Iterator[str]:
    """Yield a line for each docstring of a module that is a fragment of a sentence.

    Parameters
    ----------
    where : str
        The module's place, for the line.
    code : str
        Its content. Docstrings of properties say what the value is, as those of attributes do, and may be nouns.
    """
    for node in ast.walk(ast.parse(code)):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        summary = (ast.get_docstring(node) or "").partition("\n")[0]
        line = 1 if isinstance(node, ast.Module) else node.lineno
        if not summary:
            continue
        if isinstance(node, ast.Module | ast.ClassDef):
            if summary.split()[0] in QUESTION_WORDS:
                yield f'{where}:{line}: "{summary}": name the thing, or begin with a verb'
        elif is_fragment(summary) and not any("property" in ast.unparse(name) for name in node.decorator_list):
            yield f'{where}:{line}: "{summary}": begin with a verb, such as "Return"'


def help_texts() -> Iterator[tuple[str, str, bool]]:
    """Yield the help of every command, argument and option: place, text, and whether it is that of a command."""
    from tools.site.commands import commands

    for command in commands():
        yield command.words, command.help_text.strip(), True
        for left, right in command.options:
            yield f"{command.words} {left}", right, False


def help_findings(texts: Iterable[tuple[str, str, bool]], replaced: Mapping[str, str]) -> Iterator[str]:
    """Yield a line for each help with a word that the glossary replaces, and for each command without a verb.

    Parameters
    ----------
    texts : iterable of (str, str, bool)
        As `help_texts` yields them.
    replaced : mapping of str to str
        As `replaced_words` returns them.
    """
    for where, text, of_command in texts:
        yield from wrong_words(f"help of {where}", text, replaced)
        if of_command and is_fragment(text):
            yield f'help of {where}: "{text.splitlines()[0]}": begin with a verb, such as "Show"'


def findings(root: Path = ROOT) -> Iterator[str]:
    """Yield everything that is to be said of the docstrings, the help and the pages of the repository.

    Parameters
    ----------
    root : Path
        Top of the repository.
    """
    replaced = replaced_words((root / GLOSSARY).read_text(encoding="utf-8"))
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            yield from docstring_fragments(path.relative_to(root).as_posix(), path.read_text(encoding="utf-8"))
    yield from help_findings(help_texts(), replaced)
    pages = [path for path in sorted((root / "docs").rglob("*.md")) if not MADE & set(path.relative_to(root).parts)]
    pages.remove(root / STYLE)  # it shows what not to write
    for page in [*pages, root / "README.template.md", root / "CONTRIBUTING.md"]:
        text = _INSTEAD.sub("", page.read_text(encoding="utf-8"))
        yield from wrong_words(page.relative_to(root).as_posix(), text, replaced)


def main() -> int:
    """Print the findings; return 1 if there are any."""
    found = list(findings())
    for line in found:
        print(line, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
