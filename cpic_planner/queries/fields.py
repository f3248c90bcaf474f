"""Fields of questions: one declaration gives option, keyword, schema, help, and the place in the hash."""

from __future__ import annotations

import functools
import inspect
import re
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin

from pydantic import Field
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from simulator.config import FrozenModel, bounds_of, limits_of, unit_of

if TYPE_CHECKING:
    from cpic_planner.queries.base import Parts

Meaning = tuple[str, str]
"""A field, and the value of it with which another field has a meaning."""


@dataclass(frozen=True)
class Asked:
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
    group: type[FrozenModel] | None = None
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


@dataclass(frozen=True)
class Option:
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


def options_of(model: type[FrozenModel], above: tuple[str, ...] = ()) -> Iterator[Option]:
    """Yield the options of a question, those of models inside it in the place of these.

    What a question itself declares comes before what it shares with others, and what decides no number comes last.
    """
    for name in sorted(model.model_fields, key=functools.partial(_distance, model)):
        info = model.model_fields[name]
        own = asked_of(info)
        if own is None:
            continue
        inner = None if own.option else group_of(info)
        if own.parts is not None:
            yield from (replace(item, parts=own.parts) for item in options_of(own.parts, (*above, name)))
        elif inner is not None:
            yield from options_of(inner, (*above, name))
        else:
            yield _option(name, info, own, above)


def _distance(model: type[FrozenModel], name: str) -> tuple[bool, int]:
    own = asked_of(model.model_fields[name])
    declared = next(i for i, base in enumerate(model.__mro__) if name in inspect.get_annotations(base))
    return own is not None and not own.physics and not own.argument, declared


def group_of(info: FieldInfo) -> type[FrozenModel] | None:
    """Return the model of fields that are asked one by one inside a field; None where it is a single value."""
    own = asked_of(info)
    for part in (own.group,) if own is not None and own.group is not None else _parts(info.annotation):
        if isinstance(part, type) and issubclass(part, FrozenModel) and any(map(asked_of, part.model_fields.values())):
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
        switchable=kind is bool and info.default is not False,
        bounds=bounds_of(info),
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
        return inner if any(isinstance(one, type) and issubclass(one, FrozenModel) for one in inner) else (annotation,)
    return (annotation,)


def help_of(name: str, info: FieldInfo, own: Asked) -> str:
    """Return the help of an option: its text, then default, range and unit."""
    said = [f"default: {word}"] if (word := own.unset or _plain(info.default)) else []
    limits = limits_of(info)
    unit = own.unit or unit_of(name)
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


def asked_changes(default: tuple[str, ...] | None = (), **settings: Any) -> Any:
    """Declare the field of changes of the instrument; ``settings`` as of `asked`."""
    return asked(
        default,
        "Change a value of the instrument by its key (cpic instrument keys lists them): drift.visit_nm=0.1nm, "
        "throughput=x0.7, bands.F850.qe=0.4; repeat for several.",
        option="--set",
        metavar="KEY=VALUE",
        **settings,
    )


def asked_visit_time() -> Any:
    """Declare the field of the wall time of a visit."""
    text = "Wall time of one visit with its references and overhead; with {visits} it sets {time_s}."
    return asked(None, text, ge=1e-3, le=1e9)
