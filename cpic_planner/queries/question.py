"""Questions: their fields, options and dotted keys, and the names by which refusals call them.

One declaration of a field gives option, keyword, schema, help, and the place in the hash.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, TypeGuard, Union, get_args, get_origin

from pydantic import ConfigDict, Field
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from cpic_core import InputError, Record, files_read, load_mapping
from simulator import config

Meaning = tuple[str, str | bool]
"""A field, and the value of it with which another field has a meaning."""


class Asked(Record):
    """The metadata of a field of a question beside its type, range and default.

    Attributes
    ----------
    option : str
        Name on the command line; that of the field where empty.
    unit : str
        Unit of a number whose name does not end in it.
    physics : bool
        Whether the value decides numbers, so that it enters the hash of a run.
    argument : bool
        Whether the command line takes it by position.
    unset : str
        The default in words, where it is no plain value.
    accepts : str
        Types that the Python function takes, in words.
    metavar : str
        What the help shows for the value.
    hidden : bool
        Whether the help leaves the option out.
    only_with : tuple of (field, value)
        Another field's value without which the option has no meaning; none where empty.
    command : type, optional
        Type of one value on the command line, where it differs from that of the field.
    read : callable, optional
        Turns what people write (a preset, a file, a mapping) into the value.
    several : bool, optional
        Whether the command line takes several values, where the type does not say it.
    parts : type of Parts, optional
        Options that are put together to the value, in place of one option.
    group : type of FrozenModel, optional
        The model whose fields are asked one by one, where it is not that of the field.
    completes : callable, optional
        ``completes()``: words that a shell completes on the command line.
    names_file : callable, optional
        ``names_file(word)``: whether a word can name a file, where the field takes files; who asks over a network may
        not name one.
    """

    option: str = ""
    unit: str = ""
    physics: bool = True
    argument: bool = False
    unset: str = ""
    accepts: str = ""
    metavar: str = ""
    hidden: bool = False
    only_with: Meaning | None = None
    command: Any = None
    read: Callable[[Any], Any] | None = None
    several: bool | None = None
    parts: type[Parts] | None = None
    group: type[config.FrozenModel] | None = None
    completes: Callable[[], Iterable[str]] | None = None
    names_file: Callable[[str], bool] | None = None

    def __call__(self, schema: dict[str, Any]) -> None:
        """Add to the JSON Schema of the field what is said here."""
        schema["description"] = spelled(schema.get("description", ""))
        if self.unit:
            schema["unit"] = self.unit
        if self.option:
            schema["option"] = self.option
        schema["decides_numbers"] = self.physics


def asked(default: Any = ..., text: str = "", **settings: Any) -> Any:
    """Declare a field of a question.

    Parameters
    ----------
    default : object
        Value without an answer; ``...`` for a field that has to be given, a function without arguments for a value
        that is made when it is needed.
    text : str
        Help of the option and description of the keyword, in complete sentences, without range and default. Other
        fields in braces are named as options or as keywords, whichever the reader has: ``{library} roll``.
    **settings
        Limits ``ge``, ``gt``, ``le``, ``lt``, ``min_length``; ``exclude_if`` of pydantic, for a value that records do
        not state; and the attributes of `Asked`.

    Returns
    -------
    FieldInfo
    """
    of_pydantic = "ge", "gt", "le", "lt", "min_length", "exclude_if"
    limits = {name: settings.pop(name) for name in of_pydantic if name in settings}
    own = Asked(**settings)
    made = {"default_factory": default} if callable(default) and not isinstance(default, type) else {"default": default}
    return Field(**made, description=text, json_schema_extra=own, **limits)


def spelled(text: str, names: Mapping[str, str] | None = None) -> str:
    """Return a text with the fields in its braces by their names, which are their keywords without ``names``."""
    return re.sub(r"\{(\w+)\}", lambda match: (names or {}).get(match[1], match[1]), text)


def asked_of(info: FieldInfo) -> Asked | None:
    """Return what was declared of a field; None for one that is no field of a question."""
    return info.json_schema_extra if isinstance(info.json_schema_extra, Asked) else None


class Option(Record):
    """One option of a command.

    Attributes
    ----------
    path : tuple of str
        Where the value belongs in the question, field by field.
    flag : str
        ``--name``, or the name of an argument.
    text : str
        Help with default, range and unit.
    kind : type
        Type of one value on the command line.
    several : bool
        Whether it may be repeated.
    required : bool
    asked : Asked
    switchable : bool
        Whether a yes-or-no option has a no of its own.
    parts : type of Parts or None
        The model of which it is a part, where the value above it is made of parts.
    bounds : mapping
        Range of the value: numbers by ``ge``, ``gt``, ``le`` and ``lt``.
    """

    path: tuple[str, ...]
    flag: str
    text: str
    kind: Any
    several: bool
    required: bool
    asked: Asked = field(repr=False)
    switchable: bool = False
    parts: type[Parts] | None = None
    bounds: Mapping[str, float] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        """A name that no other option of the command has."""
        return "__".join(self.path)


@functools.cache
def options_of(model: type[config.FrozenModel]) -> tuple[Option, ...]:
    """Return the options of a question, those of models inside it in the place of these.

    What a question itself declares comes before what it shares with others, and what decides no number comes last.
    """
    return tuple(_below_of(model, ()))


def _below_of(model: type[config.FrozenModel], above: tuple[str, ...]) -> Iterator[Option]:
    for name in sorted(model.model_fields, key=functools.partial(_distance, model)):
        info = model.model_fields[name]
        own = asked_of(info)
        if own is None:
            continue
        inner = None if own.option else group_of(info)
        if own.parts is not None:
            yield from (replace(item, parts=own.parts) for item in _below_of(own.parts, (*above, name)))
        elif inner is not None:
            yield from _below_of(inner, (*above, name))
        else:
            yield _option(name, info, own, above)


def _distance(model: type[config.FrozenModel], name: str) -> tuple[bool, int]:
    own = asked_of(model.model_fields[name])
    declared = next(i for i, base in enumerate(model.__mro__) if name in inspect.get_annotations(base))
    return own is not None and not own.physics and not own.argument, declared


def group_of(info: FieldInfo) -> type[config.FrozenModel] | None:
    """Return the model of fields that are asked one by one inside a field; None where it is a single value."""
    own = asked_of(info)
    for part in (own.group,) if own is not None and own.group is not None else _parts(info.annotation):
        if (
            isinstance(part, type)
            and issubclass(part, config.FrozenModel)
            and any(map(asked_of, part.model_fields.values()))
        ):
            return part
    return None


def _option(name: str, info: FieldInfo, own: Asked, above: tuple[str, ...]) -> Option:
    kind, several = kind_of(info)
    return Option(
        path=(*above, name),
        flag=own.option or (name.upper() if own.argument else f"--{name.replace('_', '-')}"),
        text=help_of(name, info, own),
        kind=own.command or kind,
        several=several if own.several is None else own.several,
        required=info.is_required(),
        asked=own,
        switchable=kind is bool and (info.default is not False or bool(own.unset)),
        bounds=config.bounds_of(info),
    )


def kind_of(info: FieldInfo) -> tuple[Any, bool]:
    """Return the type of one value on the command line, and whether there may be several; a text for what is read."""
    registered = next((item for item in info.metadata if hasattr(item, "choices")), None)
    if registered is not None:
        return Literal[registered.choices()], False
    return _kind(info.annotation)


def _kind(annotation: Any) -> tuple[Any, bool]:
    parts = [part for part in _parts(annotation) if part is not type(None)]
    for part in parts:
        if get_origin(part) is tuple and get_args(part)[-1] is Ellipsis:
            return _kind(get_args(part)[0])[0], True
    for part in parts:
        if part in (bool, int, float, str, Path) or get_origin(part) is Literal:
            return part, False
    return str, False


def _parts(annotation: Any) -> tuple[Any, ...]:
    """Return the members of a union, those of annotated types too, or the type itself."""
    if hasattr(annotation, "__metadata__"):
        return _parts(annotation.__origin__)
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(part for item in get_args(annotation) for part in _parts(item))
    if get_origin(annotation) is tuple and get_args(annotation)[-1:] == (Ellipsis,):
        inner = _parts(get_args(annotation)[0])
        return inner if any(_is_model(one) for one in inner) else (annotation,)
    return (annotation,)


def help_of(name: str, info: FieldInfo, own: Asked) -> str:
    """Return the help of an option: its text, then default, range and unit."""
    said = [f"default: {word}"] if (word := own.unset or _plain(info.default)) else []
    limits = config.limits_of(info)
    unit = own.unit or config.unit_of(name)
    said += [f"{limits} {unit}".strip()] if limits else []
    return f"{info.description or ''} [{'; '.join(said)}]" if said else info.description or ""


def _plain(default: Any) -> str:
    """Return a default that is a number, a word or several of them; empty for others."""
    if default is PydanticUndefined or isinstance(default, bool):
        return "on" if default is True else ""
    if isinstance(default, tuple):
        return ", ".join(map(_plain, default))
    if isinstance(default, int | float):
        return f"{default:g}"
    return str(default) if isinstance(default, str | Path) else ""


def asked_changes(**settings: Any) -> Any:
    """Declare the field of changes of the instrument; ``settings`` as of `asked`."""
    return asked(
        (),
        "Change a value of the instrument by its key (cpic instrument keys lists them): drift.visit_nm=0.1nm, "
        "throughput=x0.7, bands.F850.qe=0.4; repeat for several.",
        option="--set",
        metavar="KEY=VALUE",
        **settings,
    )


def children(node: Any) -> Mapping[str, Any] | None:
    """Return what is below a section by name; None for a value."""
    if isinstance(node, config.FrozenModel):
        return {name: getattr(node, name) for name in type(node).model_fields}
    return node if isinstance(node, Mapping) else None


def sections(instrument: config.Instrument) -> dict[str, Any]:
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
    near = config.nearest(key, (*short, *_every(root)))
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


def keys_of(model: type[config.FrozenModel], above: str = "") -> tuple[str, ...]:
    """Return the dotted keys of a model whose values are plain.

    Parameters
    ----------
    model : type of FrozenModel
    above : str
        What every key begins with.
    """
    keys: list[str] = []
    for name, info in model.model_fields.items():
        below = info.annotation
        keys += keys_of(below, f"{above}{name}.") if _is_model(below) else [f"{above}{name}"]
    return tuple(keys)


def _is_model(kind: Any) -> TypeGuard[type[config.FrozenModel]]:
    return isinstance(kind, type) and issubclass(kind, config.FrozenModel)


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


def option_names(model: type[config.FrozenModel]) -> dict[str, str]:
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


class Question(config.FrozenModel):
    """A question to a command: its fields are options, keywords of Python, keys of YAML and of the schema.

    Equal physics has an equal hash: fields that decide no number (workers, folders) are in no hash, and neither is what
    is said of a field. None stands for an answer that was not given.
    """

    KIND: ClassVar[str] = ""
    """What is asked, for hashes."""
    model_config = ConfigDict(defer_build=True)  # of the questions that are imported only some are asked
    ALIASES: ClassVar[dict[str, str]] = {}
    """Other names of fields, which keywords and files may use."""
    ASKED: ClassVar[dict[str, Asked]] = {}
    """What is said of fields that a configuration declares, beside their description; nothing for the others."""

    @classmethod
    def __pydantic_init_subclass__(cls, **settings: Any) -> None:
        """Ask the fields of a configuration too."""
        for name, info in cls.model_fields.items():
            if info.json_schema_extra is None:
                info.json_schema_extra = cls.ASKED.get(name, Asked())

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
        named = cls.by_field({key: value for key, value in tree.items() if value is not None})
        return config.validate(cls, cls._read(config.plain_numbers(named)))

    @classmethod
    def by_field(cls, tree: Mapping[str, Any]) -> dict[str, Any]:
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
        from simulator.config.scene import paths_beside

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
                try:
                    tree[name] = own.read(tree[name])
                except InputError as error:
                    raise error if error.key else config.at(name, error) from None
        return tree

    def hashed(self) -> dict[str, Any]:
        """Return the fields that decide numbers, as plain data."""
        return self.model_dump(mode="json", exclude=_settings(type(self)))

    @property
    def content_hash(self) -> str:
        """Hash of what decides numbers (16 hex digits)."""
        return config.content_hash({"kind": self.KIND} | self.hashed())

    def is_given(self, *path: str) -> bool:
        """Return whether a field, or one inside it, was given something other than no."""
        value: Any = self
        for name in path:
            if not isinstance(value, config.FrozenModel) or name not in value.model_fields_set:
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


class Parts(config.FrozenModel):
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
            made = config.validate(option.parts, below).made(_at(file, option.path[:-1]))
            tree = put(tree, ".".join(option.path[:-1]), made)
    merged = config.deep_merge(file, tree)
    for option in options:
        needed = option.asked.only_with
        if option.path in answered and needed is not None and not _has(merged, option.path, *needed):
            other = names[needed[0]] if needed[1] is True else f"{names[needed[0]]} {needed[1]}"
            raise InputError(option.flag, answered[option.path], allowed=f"together with {other}")
    return merged


def _at(tree: Any, path: Sequence[str]) -> Any:
    for name in path:
        tree = tree.get(name) if isinstance(tree, Mapping) else None
    return tree


def _has(tree: Mapping[str, Any], path: Sequence[str], field: str, wanted: str | bool) -> bool:
    """Return whether a field beside a path, or above it, has a value."""
    return any(_at(tree, (*path[:depth], field)) == wanted for depth in range(len(path)))


def _settings(model: type[config.FrozenModel]) -> dict[str, Any]:
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
