"""Results on two answers to one kind of question: what differs in question and answer, and what explains it."""

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal

from cpic_planner.results.base import Document, Result, Row, column, optional, unit_of


class SettingChange(Row):
    """A setting that differs between two answers."""

    key: str = column("key of the instrument, field of the answer, or option of the command", label="setting")
    before: str
    after: str
    unit: str = column("empty: none, or the texts have it", default="")


class ComparedAnswer(Result):
    """One of two answers that are compared."""

    name: str = column("the file or the folder")
    kind: str
    config_hash: str = column("hash of everything that decides its numbers; empty where it has none")
    fingerprint: str = column("what made it, as `cpic --version` prints it; empty where it does not say it")


class AnswerChange(Row):
    """One value of an answer that differs."""

    row: str = column("star, band, strategy ... in words; empty for the answer as a whole", label="of")
    quantity: str = column("dotted name of the field, as JSON has it")
    before: str | None = column("null where there was no value")
    after: str | None
    unit: str
    relative: float | None = optional(
        "after over before, less 1; null for words, and where either is missing or 0",
        label="change",
        short="change %",
        format="%",
    )


class AnswerComparison(Document):
    """The differences of two answers to one kind of question, and what explains them."""

    main_rows: ClassVar[str] = "changes"
    kind: Literal["answer_comparison"] = "answer_comparison"
    before: ComparedAnswer
    after: ComparedAnswer
    settings: list[SettingChange] = column("what the answers and the commands of their runs say of the questions")
    software: list[str] = column("what differs in what made them: code, presets, catalogue, libraries, processor")
    only_before: list[str] = column("rows that only the first answer has")
    only_after: list[str] = column("rows that only the second answer has")
    changes: list[AnswerChange] = column(
        "of rows that both have: verdicts and limits first, then by how much a number changes"
    )
    explained_by: Literal["nothing", "question", "software", "both", "unknown"] = column(
        "nothing: there is no difference; unknown: neither question nor software is known to differ"
    )
    statement: str = column("the comparison in words")


def differing(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[SettingChange]:
    """Return the settings in which two trees of settings differ, by their dotted keys."""
    old, new = dict(leaves(before)), dict(leaves(after))
    return [
        SettingChange(key=key, before=old.get(key, "none"), after=new.get(key, "none"), unit=unit_of(key))
        for key in old | new
        if old.get(key, "none") != new.get(key, "none")
    ]


def leaves(tree: Any, above: str = "") -> Iterator[tuple[str, str]]:
    """Yield the dotted keys of a tree of settings, and what is there as text."""
    if hasattr(tree, "model_dump"):
        tree = {name: getattr(tree, name) for name in type(tree).model_fields}
    if isinstance(tree, Mapping):
        for name, below in tree.items():
            yield from leaves(below, f"{above}.{name}" if above else str(name))
    elif isinstance(tree, float):
        yield above, f"{tree:.6g}"
    elif isinstance(tree, list | tuple):
        yield above, ", ".join(text for item in tree for _, text in leaves(item, above)) or "none"
    else:
        yield above, "none" if tree is None else str(tree)
