"""Statuses, reasons and the other words of answers that have one meaning, from their enums and literals."""

import ast
import inspect
from enum import Enum

from tools.site.markdown import Entry, anchored, marked, table


def meanings(enum: type[Enum]) -> dict[str, str]:
    """Return what stands below each member of an enum, by the value of the member."""
    body = ast.parse(inspect.getsource(enum)).body[0]
    assert isinstance(body, ast.ClassDef)
    found = {}
    for node, after in zip(body.body, body.body[1:], strict=False):
        if isinstance(node, ast.Assign) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            name = node.targets[0]
            assert isinstance(name, ast.Name)
            found[str(enum[name.id].value)] = inspect.cleandoc(str(after.value.value)).replace("\n", " ")
    return found


def entries(enum: type[Enum]) -> list[Entry]:
    """Return the members of an enum, but the empty one.

    Parameters
    ----------
    enum : type of Enum
    """
    said = meanings(enum)
    return [
        Entry(anchored(enum.__name__, str(item.value)), str(item.value), (marked(said[str(item.value)]),))
        for item in enum
        if item.value
    ]


def registered() -> dict[str, list[Entry]]:
    """Return the entries of the registries: reference libraries, reductions and scores."""
    from cpic_planner.queries import LIBRARIES
    from cpic_planner.registry import REDUCTIONS, SCORES

    return {
        kind: [Entry(anchored(kind, item.name), item.name, (marked(item.meaning),)) for item in registry.values()]
        for kind, registry in (("library", LIBRARIES), ("centring", REDUCTIONS), ("score", SCORES))
    }


def flags() -> list[Entry]:
    """Return the flags of answers, stars and known planets, with their words."""
    from catalogs import ADDED_FLAGS
    from catalogs.known_planets import FLAGS as OF_PLANETS
    from catalogs.stars import SHIPPED_FLAGS as OF_STARS
    from cpic_planner.queries import LIBRARIES
    from cpic_planner.report.words import FLAGS as OF_ANSWERS

    of_libraries = {flag: text for library in LIBRARIES.values() for flag, text in library.caveats.items()}
    kinds = {"answer": of_libraries | OF_ANSWERS, "star": OF_STARS | ADDED_FLAGS, "known planet": OF_PLANETS}
    return [
        Entry(anchored("flag", kind, flag), flag, (kind, marked(text)))
        for kind, words in kinds.items()
        for flag, text in sorted(words.items())
    ]


def units() -> str:
    """Return the units that names of numbers end in."""
    from cpic_planner.results.base import UNITS

    rows = [Entry(anchored("unit", suffix), f"_{suffix}", (f"`{unit}`",)) for suffix, unit in sorted(UNITS.items())]
    return table(("end of a name", "unit"), rows)


def page() -> str:
    """Return the statuses and reasons of answers, the reference libraries, the reductions and the scores."""
    from cpic_core import Reason, Status

    own = registered()
    flagged = "A flag is a remark on a value that stands: a caveat, never a refusal."
    return (
        f"(statuses)=\n## Status\n\n{table(('status', 'meaning'), entries(Status))}\n"
        f"(reasons)=\n## Reason\n\n{table(('reason', 'meaning'), entries(Reason))}\n"
        f"(reference-libraries)=\n## Reference libraries\n\n{table(('library', 'reference frames'), own['library'])}\n"
        f"(reductions)=\n## Reductions\n\n{table(('centring', 'taken off before the modes'), own['centring'])}\n"
        f"(scores)=\n## Scores of a ranking\n\n{table(('score', 'meaning'), own['score'])}\n"
        f"(flags)=\n## Flags\n\n{flagged}\n\n{table(('flag', 'of', 'meaning'), flags())}"
    )
