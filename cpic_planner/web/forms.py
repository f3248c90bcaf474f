"""Forms: some fields of a question, with what the question itself says of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from typing import Any, Literal, get_args, get_origin

from cpic_core import InputError, Record
from cpic_planner.queries import Option, spelled
from cpic_planner.web.addresses import ETC, IMAGES, RANK, Addresses, parameter
from simulator.config import load_instrument, preset_names, unit_of

_WORDS = json.loads(resources.files("cpic_planner.web").joinpath("templates/forms.json").read_text(encoding="utf-8"))
_LABELS: dict[str, str] = _WORDS["labels"]
"""Labels that do not follow from the name of a field."""
_EXAMPLES: dict[str, str] = _WORDS["examples"]


_HINTS: dict[str, str] = _WORDS["hints"]
"""Where the help of the option speaks of files, which requests do not name, or of options that are repeated."""


class Field(Record):
    """One field of a form.

    Attributes
    ----------
    name : str
        Parameter of the address.
    label, hint : str
    kind : {"text", "choice", "tick", "ticks", "file"}
    choices : tuple of str
        Words of a choice or of several ticks.
    values : tuple of str
        What is filled in.
    error : str
        What is wrong with it; empty where nothing is.
    example : str
    check : tuple of (str, str)
        What a number has to be, for the script of the page: its kind, bounds and unit.
    """

    name: str
    label: str
    hint: str
    kind: Literal["text", "choice", "tick", "ticks", "file"] = "text"
    choices: tuple[str, ...] = ()
    values: tuple[str, ...] = ()
    error: str = ""
    example: str = ""
    check: tuple[tuple[str, str], ...] = ()


class Group(Record):
    """Fields that belong together; ``folded`` ones show when asked for, or where one of them says something."""

    title: str
    fields: tuple[Field, ...]
    folded: bool = False

    @property
    def open(self) -> bool:
        """Whether a folded group shows."""
        return any(field.values or field.error for field in self.fields)


class Form(Record):
    """A form: where it leads, its groups, and what is wrong beside its fields."""

    action: str
    groups: tuple[Group, ...]
    button: str
    error: str = ""
    method: Literal["get", "post"] = "get"

    @property
    def sends(self) -> bool:
        """Whether files are sent with it."""
        return any(field.kind == "file" for group in self.groups for field in group.fields)

    @property
    def wrong(self) -> tuple[Field, ...]:
        """Fields beside which something is wrong."""
        return tuple(field for group in self.groups for field in group.fields if field.error)


ETC_GROUPS, RANK_GROUPS, IMAGE_GROUPS = (_WORDS["groups"][name] for name in ("etc", "rank", "images"))
"""Groups of the forms: title, parameters, and whether it is folded."""


def etc_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    """Return the form of the calculator.

    Parameters
    ----------
    given : sequence of (str, str)
        Parameters of the address.
    error : InputError, optional
        What is wrong with them.
    """
    return _form(ETC, ETC_GROUPS, "Ask", given, error)


def rank_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    """Return the form of the ranking; parameters as of `etc_form`."""
    form = _form(RANK, RANK_GROUPS, "Rank", given, error)
    texts = tuple(text for name, text in given if name == "limit" and text)[:1]
    wrong = str(error) if error is not None and error.key == "limit" else ""
    limit = Field("limit", "Rows", "Stars that are shown, 1 to 1500.", values=texts, error=wrong, example="50")
    first, *others = form.groups
    groups = (replace(first, fields=(*first.fields, limit)), *others)
    return replace(form, groups=groups, error="" if wrong else form.error)


_FILES: dict[str, tuple[str, str]] = _WORDS["files"]


def own_form(form: Form) -> Form:
    """Return a form that sends files with its question; nothing of them is kept.

    Parameters
    ----------
    form : Form
        That of the question without files.
    """
    if form.sends:
        return form
    errors = {field.name: field.error for group in form.groups for field in group.fields}
    who, *others = (
        replace(group, fields=tuple(field for field in group.fields if field.name not in _FILES))
        for group in form.groups
    )
    files = tuple(
        Field(name, label, hint, "file", error=errors.get(name, ""))
        for name, (label, hint) in _FILES.items()
        if name != "other" or name in errors
    )
    return replace(form, groups=(who, Group("Files of your own, 2 MB in all", files), *others), method="post")


def _form(
    addresses: Addresses[Any],
    layout: Sequence[tuple[str, str, bool]],
    button: str,
    given: Sequence[tuple[str, str]],
    error: InputError | None,
) -> Form:
    values: dict[str, list[str]] = {}
    for name, text in given:
        option = addresses.by_name.get(name) or addresses.by_name.get(f"{name}_s")
        if option is not None and text:
            values.setdefault(parameter(option), []).append(text)
    wrong = {} if error is None else {addresses.names.get(error.key, error.key): str(error)}
    groups = tuple(
        Group(
            title,
            tuple(_field(addresses, name, values.get(name, []), wrong.get(name, "")) for name in names.split()),
            folded,
        )
        for title, names, folded in layout
    )
    shown = {field.name for group in groups for field in group.fields}
    rest = " ".join(text for name, text in wrong.items() if name not in shown)
    return Form(addresses.page, groups, button, rest)


def _field(addresses: Addresses[Any], name: str, values: Sequence[str], error: str) -> Field:
    option = addresses.by_name[name]
    choices = _choices(option)
    kind: Literal["text", "choice", "tick", "ticks"] = "choice" if choices else "text"
    if option.kind is bool:
        kind = "tick"
    elif name == "bands":
        kind, choices = "ticks", tuple(load_instrument().bands)
    elif option.several and option.kind is float:
        values = [", ".join(values)] if values else []
    labels = {one.path[-1]: _label(one).partition(" (")[0] for one in addresses.options}
    hint, example = (texts.get(f"{addresses.command}.{name}") or texts.get(name) for texts in (_HINTS, _EXAMPLES))
    hint = hint or spelled(option.text, labels)
    check = _check_of(option) if kind == "text" else ()
    return Field(name, _label(option), hint, kind, choices, tuple(values), error, example or "", check)


def _check_of(option: Option) -> tuple[tuple[str, str], ...]:
    """Return what a number of the question has to be."""
    if option.kind not in (int, float):
        return ()
    kind = "whole" if option.kind is int else "several" if option.several else "number"
    name = parameter(option)
    kind = "time" if name.endswith("_s") and kind == "number" else kind
    bounds = ((key, f"{bound:.12g}") for key, bound in option.bounds.items())
    return (("number", kind), *bounds, ("unit", option.asked.unit or unit_of(name)))


def _choices(option: Option) -> tuple[str, ...]:
    if get_origin(option.kind) is Literal:
        return get_args(option.kind)
    if option.flag == "--instrument":
        return preset_names("instrument")
    if option.flag == "--population":
        return preset_names("population", package="cpic_planner")
    return ("snapshot", "archive_2019") if option.flag == "--known-planets" else ()


def _label(option: Option) -> str:
    name = parameter(option)
    if name in _LABELS:
        return _LABELS[name]
    unit = option.asked.unit or unit_of(name)
    words = name.rsplit("_", 1)[0] if unit and "_" in name else name
    words = words.replace("_", " ")
    return f"{words[:1].upper()}{words[1:]}{f' ({unit})' * bool(unit)}"


def image_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    """Return the form that asks for images; parameters as of `etc_form`."""
    return replace(_form(IMAGES, IMAGE_GROUPS, "Simulate", given, error), method="post")
