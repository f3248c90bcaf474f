"""Dotted keys of models and nested mappings: which values a key with ``*`` means, and trees with other values.

The base of every question, and the names by which its refusals call its fields.
"""

import contextlib
import functools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import ConfigDict

from cpic_core import InputError, files_read, load_mapping
from cpic_planner.queries.fields import Option, asked_of, group_of, options_of
from simulator.config import FrozenModel, Instrument, content_hash, deep_merge, nearest, plain_numbers, validate
from simulator.config.scene import paths_beside


def children(node: Any) -> Mapping[str, Any] | None:
    """Return what is below a section by name; None for a value."""
    if isinstance(node, FrozenModel):
        return {name: getattr(node, name) for name in type(node).model_fields}
    return node if isinstance(node, Mapping) else None


def sections(instrument: Instrument) -> dict[str, Any]:
    """Return the sections of an instrument by name; its own name is none."""
    return {name: item for name, item in (children(instrument) or {}).items() if name != "name"}


def _every(node: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Yield the dotted keys of all values."""
    for name, item in node.items():
        below = children(item)
        if below is None:
            yield f"{above}{name}"
        else:
            yield from _every(below, f"{above}{name}.")


def matching(root: Mapping[str, Any], key: str) -> Iterator[tuple[str, Any]]:
    """Yield the keys that a key means, and what is there.

    A mapping of values by the names of bands may be given more of them; None is there before.
    """
    yield from _below(root, key.split("."), "")


def _below(node: Mapping[str, Any], parts: list[str], above: str) -> Iterator[tuple[str, Any]]:
    head, rest = parts[0], parts[1:]
    wild = "*" in head
    for name, item in node.items():
        if not (fnmatchcase(name, head) if wild else name == head):
            continue
        below = children(item)
        if not rest:
            yield f"{above}{name}", item
        elif below is not None:
            yield from _below(below, rest, f"{above}{name}.")
            if len(rest) == 1 and rest[0] not in below and "*" not in rest[0] and _takes_new(item):
                yield f"{above}{name}.{rest[0]}", None


def _takes_new(node: Any) -> bool:
    """Return whether a mapping holds values by the names of bands, so that there may be more."""
    return isinstance(node, Mapping) and not any(children(item) is not None for item in node.values())


def advice(root: Mapping[str, Any], key: str, short: tuple[str, ...]) -> str:
    """Return the nearest keys, or those of the section that was meant."""
    near = nearest(key, (*short, *_every(root)))
    if near:
        return near
    node, path = root, ""
    for part in key.split("."):
        below = children(node.get(part))
        if below is None:
            break
        node, path = below, f"{path}{part}."
    words = f"known keys: {', '.join(f'{path}{name}' for name in node)}"
    return words if path else f"{words}; short ones: {', '.join(short)}"


def get(tree: Mapping[str, Any], key: str) -> Any:
    """Return the value of a dotted key of nested mappings.

    Raises
    ------
    KeyError
        If there is none.
    """
    return functools.reduce(lambda part, name: part[name], key.split("."), tree)


def put(tree: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """Return a copy of nested mappings with the value of a dotted key; what is above it is made."""
    head, _, rest = key.partition(".")
    return dict(tree) | {head: put(tree.get(head, {}), rest, value) if rest else value}


def keys_of(model: type[FrozenModel], above: str = "") -> tuple[str, ...]:
    """Return the dotted keys of a model whose values are plain.

    Parameters
    ----------
    model : type of FrozenModel
    above : str
        What every key begins with.
    """
    found: list[str] = []
    for name, field in model.model_fields.items():
        below = field.annotation
        if isinstance(below, type) and issubclass(below, FrozenModel):
            found += keys_of(below, f"{above}{name}.")
        else:
            found.append(f"{above}{name}")
    return tuple(found)


def scaled(present: Any, factor: float) -> Any:
    """Return a number, or each of several, times a factor; None for what is no number.

    Whole numbers stay whole where the product is.
    """
    if isinstance(present, tuple) and present:
        found = tuple(scaled(item, factor) for item in present)
        return None if None in found else found
    if not isinstance(present, int | float) or isinstance(present, bool):
        return None
    value = present * factor
    return int(value) if isinstance(present, int) and value == int(value) else value


_OPTIONS: ContextVar[Mapping[str, str]] = ContextVar("options", default={})  # noqa: B039 (never changed in place)


def called(field: str) -> str:
    """Return what a field is called where the question was asked: its option on the command line, else its keyword."""
    return _OPTIONS.get().get(field, field)


@contextlib.contextmanager
def called_as(names: Mapping[str, str]) -> Iterator[None]:
    """Let refusals name options of the command in place of keywords.

    Parameters
    ----------
    names : mapping
        Option of each field, by its dotted key; `option_names` has those of a question.

    Raises
    ------
    InputError
        Those of the body, with the name of the option where there is one; those about files that were read stay.
    """
    token = _OPTIONS.set(names)
    try:
        with files_read() as files:
            yield
    except InputError as error:
        if any(re.match(rf"{re.escape(file)}(?![\w.])", error.key) for file in files):
            raise
        key = error.key.rstrip(".0123456789").removeprefix("universe.")
        first, _, rest = key.partition(".")
        name = names.get(key) or (f"{names[first]} {rest}" if rest and first in names else "")
        if not name:
            raise
        value = ",".join(map(str, error.value)) if isinstance(error.value, tuple | list) else error.value
        raise InputError(name, value, unit=error.unit, allowed=error.allowed, hint=error.hint) from None
    finally:
        _OPTIONS.reset(token)


def by_depth(options: Iterable[Option]) -> list[Option]:
    """Return options by how deep they lie; the one that is called as its group comes before the others of that."""
    return sorted(options, key=lambda option: (len(option.path), option.path[-1] not in option.path[:-1]))


def option_names(model: type[FrozenModel]) -> dict[str, str]:
    """Return the option of each field of a question, by its dotted key, by its last part, and by the option's word."""
    names: dict[str, str] = {}
    options = by_depth(options_of(model))
    for option in options:
        for depth in range(1, len(option.path) + 1):
            names.setdefault(".".join(option.path[:depth]), option.flag)
    for option in options:
        names.setdefault(option.path[-1], option.flag)
        names.setdefault(option.flag.removeprefix("--").replace("-", "_"), option.flag)
    return names


class Question(FrozenModel):
    """A question to a command: its fields are options, keywords of Python, keys of YAML and of the schema.

    Equal physics has an equal hash: fields that decide no number (workers, folders) are in no hash, and neither is what
    is said of a field. None stands for an answer that was not given.
    """

    KIND: ClassVar[str] = ""
    """What is asked, for hashes."""
    model_config = ConfigDict(defer_build=True)  # of the questions that are imported only some are asked
    ALIASES: ClassVar[dict[str, str]] = {}
    """Other names of fields, which keywords and files may use."""

    @classmethod
    def of(cls, tree: Mapping[str, Any]) -> Self:
        """Return the question that keywords, options or a file ask.

        Parameters
        ----------
        tree : mapping
            Values by field, as people write them: presets and files by their names, models as mappings.

        Raises
        ------
        InputError
            For the first fault, naming the field, its value, unit and range.
        """
        named = cls.named({key: value for key, value in tree.items() if value is not None})
        return validate(cls, cls._read(plain_numbers(named)))

    @classmethod
    def named(cls, tree: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by the names of the fields; refuse one that is given under two names."""
        found: dict[str, Any] = {}
        for key, value in tree.items():
            field = cls.ALIASES.get(key, key)
            if field in found:
                raise InputError(field, "given twice", allowed="once", hint=f"{key} is another name of it")
            found[field] = value
        return found

    @classmethod
    def load(cls, source: str | Path) -> dict[str, Any]:
        """Return what a YAML file answers, for `of`; files that it names are looked for beside it first."""
        tree = load_mapping(source, "question", tuple(cls.model_fields))
        kind = tree.get("kind", "question")
        if kind == "question":
            tree.pop("kind", None)
        elif "kind" not in cls.model_fields:
            raise InputError("kind", kind, allowed="question")
        return dict(paths_beside(tree, Path(source).parent))

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        """Return the values as people write them, read."""
        for name, info in cls.model_fields.items():
            own = asked_of(info)
            if own is not None and own.read is not None and name in tree:
                tree[name] = own.read(tree[name])
        return tree

    def hashed(self) -> dict[str, Any]:
        """Return the fields that decide numbers, as plain data."""
        return self.model_dump(mode="json", exclude=_settings(type(self)))

    @property
    def content_hash(self) -> str:
        """Hash of what decides numbers (16 hex digits)."""
        return content_hash({"kind": self.KIND} | self.hashed())

    def is_given(self, *path: str) -> bool:
        """Return whether a field, or one inside it, was given something other than no."""
        value: Any = self
        for name in path:
            if not isinstance(value, FrozenModel) or name not in value.model_fields_set:
                return False
            value = getattr(value, name)
        return value is not None and value is not False

    def refuse_together(self, fields: Sequence[str], why: str) -> None:
        """Refuse two fields of which at most one has a meaning.

        Raises
        ------
        InputError
            Naming the first two that were given.
        """
        given = [field for field in fields if self.is_given(*field.split("."))]
        if len(given) > 1:
            raise InputError(given[0], f"given with {called(given[1])}", allowed="one of the two", hint=why)


class Parts(FrozenModel):
    """Options from which one value of a question is made."""

    def made(self, base: Any) -> Any:
        """Return the value; ``base`` is what was given for it otherwise, None for nothing."""
        raise NotImplementedError


def tree_of(
    options: Sequence[Option], given: Mapping[str, Any], file: Mapping[str, Any], names: Mapping[str, str]
) -> dict[str, Any]:
    """Return what options and a file answer, as a tree of fields.

    Parameters
    ----------
    options : sequence of Option
    given : mapping
        Plain values by the names of options; None and nothing for what was not given.
    file : mapping
        Answers of a file, which those of options stand above.
    names : mapping
        Option of each field, for refusals.

    Raises
    ------
    InputError
        For an option that has no meaning with the others.
    """
    tree: dict[str, Any] = {}
    parts: dict[tuple[str, ...], dict[str, Any]] = {}
    answered = {option.path: given[option.name] for option in options if given[option.name] not in (None, [], ())}
    for option in options:
        if option.path not in answered:
            continue
        value = answered[option.path]
        if option.parts is not None:
            parts.setdefault(option.path[:-1], {})[option.path[-1]] = value
        else:
            tree = put(tree, ".".join(option.path), value)
    for option in options:
        if option.parts is not None and (below := parts.pop(option.path[:-1], None)) is not None:
            made = validate(option.parts, below).made(_at(file, option.path[:-1]))
            tree = put(tree, ".".join(option.path[:-1]), made)
    merged = deep_merge(file, tree)
    for option in options:
        needed = option.asked.only_with
        if option.path in answered and needed is not None and not _has(merged, option.path, *needed):
            raise InputError(
                option.flag, answered[option.path], allowed=f"together with {names[needed[0]]} {needed[1]}"
            )
    return merged


def _at(tree: Any, path: Sequence[str]) -> Any:
    for name in path:
        tree = tree.get(name) if isinstance(tree, Mapping) else None
    return tree


def _has(tree: Mapping[str, Any], path: Sequence[str], field: str, wanted: str) -> bool:
    """Return whether a field beside a path, or above it, has a value."""
    return any(_at(tree, (*path[:depth], field)) == wanted for depth in range(len(path)))


def _settings(model: type[FrozenModel]) -> dict[str, Any]:
    """Return the fields that decide no number, those of models inside a question too."""
    found: dict[str, Any] = {}
    for name, info in model.model_fields.items():
        own = asked_of(info)
        inner = group_of(info)
        if own is not None and not own.physics:
            found[name] = True
        elif inner is not None and (below := _settings(inner)):
            found[name] = below
    return found


MOST_TIME_S = 1e9
"""Longest wall time of all visits."""


def check_visits(visits: int | None, visit_time_s: float | None, time_s: float | None, *, asked: bool = False) -> None:
    """Refuse a number of visits, their length and the time of all that contradict each other.

    Parameters
    ----------
    visits : int, optional
    visit_time_s, time_s : float, optional
    asked : bool
        Whether the time is what is asked for.
    """
    if visits is None or visit_time_s is None:
        return
    if asked:
        allowed = f"{called('visits')} or {called('visit_time_s')}: together they set the time that is asked for"
        raise InputError("visit_time_s", visit_time_s, unit="s", allowed=allowed)
    both_s = visits * visit_time_s
    if both_s > MOST_TIME_S:
        hint = f"{called('visits')} {visits} times it is at most {MOST_TIME_S:g} s"
        raise InputError("visit_time_s", visit_time_s, unit="s", allowed=f"at most {MOST_TIME_S / visits:g}", hint=hint)
    if time_s is not None and abs(both_s / time_s - 1.0) > 1e-9:
        hint = f"{called('visits')} times {called('visit_time_s')} set it"
        raise InputError("time_s", time_s, unit="s", allowed=f"{both_s:g}, or none", hint=hint)
