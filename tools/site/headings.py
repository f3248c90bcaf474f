"""Columns that tables of a user's own may have and what else they may be called, from the table of synonyms."""

from typing import Literal

from catalogs import CONVENTIONS, Column, possible_columns
from tools.site.markdown import Entry, anchored, code, prose, table

HEADINGS = ("column", "meaning", "allowed", "other headings, by who uses them")
_TITLES: dict[Literal["stars", "planets"], str] = {
    "stars": "Stars (`--catalog`)",
    "planets": "Planets (`--known-planets`)",
}


def page() -> str:
    """Return the reference of the columns of stars and of planets."""
    return "\n".join(f"## {title}\n\n{_kind(kind)}" for kind, title in _TITLES.items())


def _kind(kind: Literal["stars", "planets"]) -> str:
    columns, groups = possible_columns(kind)
    lines = "".join(f"- {' or '.join(map(code, group))}\n" for group in groups)
    needed = f"A row needs one of each of these lines:\n\n{lines}"
    if kind == "planets":
        needed += "\nA row with a planet and a `status` alone changes the status of a planet of the table below.\n"
    rows = [
        Entry(anchored("heading", kind, name), name, (prose(column.description), _allowed(column), _others(kind, name)))
        for name, column in columns.items()
    ]
    return f"{needed}\n{table(HEADINGS, rows)}"


def _allowed(column: Column) -> str:
    words = {"text": "text", "bool": "yes or no", "int": "Hipparcos number"}
    return prose(words.get(column.kind, column.range))


def _others(kind: Literal["stars", "planets"], name: str) -> str:
    """Return what else a column may be called, by sources, with the unit and the convention that each means."""
    columns = possible_columns(kind)[0]
    by_source: dict[str, dict[tuple[str, ...], list[str]]] = {}
    for form in columns.synonyms_of(name):
        unit = form.unit if form.unit != columns[name].unit else ""
        said = (f"in {unit}" * bool(unit), CONVENTIONS.get(form.convention, form.convention))
        beside = f"beside {form.beside}" if form.beside else ""
        by_source.setdefault(form.source, {}).setdefault((*said, beside), []).append(form.heading)
    return "; ".join(
        f"{prose(source)}: {', '.join(_said(told, forms) for told, forms in groups.items())}"
        for source, groups in by_source.items()
    )


def _said(told: tuple[str, ...], forms: list[str]) -> str:
    words = "; ".join(filter(None, told))
    return ", ".join(map(code, dict.fromkeys(forms))) + (f" ({prose(words)})" if words else "")
