"""The base of every question, and the names by which its refusals call its fields."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any, ClassVar, Self

from catalogs.errors import InputError
from catalogs.strict_yaml import load_mapping
from cpic_planner.queries.fields import asked_of, group_of, options_of
from simulator.config.base import FrozenModel, content_hash, validate
from simulator.config.scene import paths_beside

_OPTIONS: ContextVar[Mapping[str, str]] = ContextVar("options", default={})  # noqa: B039 (never changed in place)


def called(field: str) -> str:
    """Return what a field is called where the question was asked: its option on the command line, else its keyword."""
    return _OPTIONS.get().get(field, field)


@contextlib.contextmanager
def called_by_option(model: type[FrozenModel]) -> Iterator[None]:
    """Let refusals name options of the command in place of keywords.

    Parameters
    ----------
    model : type of FrozenModel
        The question of the command.

    Raises
    ------
    InputError
        Those of the body, with the name of the option where the key is a field of the question.
    """
    names = option_names(model)
    token = _OPTIONS.set(names)
    try:
        yield
    except InputError as error:
        key = error.key.rstrip(".0123456789").removeprefix("universe.")
        first, _, rest = key.partition(".")
        name = names.get(key) or (f"{names[first]} {rest}" if rest and first in names else "")
        if not name:
            raise
        value = ",".join(map(str, error.value)) if isinstance(error.value, tuple | list) else error.value
        raise InputError(name, value, unit=error.unit, allowed=error.allowed, hint=error.hint) from None
    finally:
        _OPTIONS.reset(token)


def option_names(model: type[FrozenModel]) -> dict[str, str]:
    """Return the option of each field of a question, by its dotted key, by its last part, and by the option's word."""
    names: dict[str, str] = {}
    options = sorted(options_of(model), key=lambda option: len(option.path))
    for option in options:
        for depth in range(1, len(option.path) + 1):
            names.setdefault(".".join(option.path[:depth]), option.flag)
    for option in options:
        names.setdefault(option.path[-1], option.flag)
        names.setdefault(option.flag.removeprefix("--").replace("-", "_"), option.flag)
    return names


class Question(FrozenModel):
    """What a command is asked: its fields are options, keywords of the Python function, keys of YAML and of the schema.

    Equal physics has an equal hash: fields that decide no number (workers, folders) are in no hash, and neither is what
    is said of a field. None stands for an answer that was not given.
    """

    KIND: ClassVar[str] = ""
    """What is asked, for hashes."""
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
        named = {cls.ALIASES.get(key, key): value for key, value in tree.items() if value is not None}
        return validate(cls, cls._read(named))

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
        """Values as people write them, read."""
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
        """Whether a field, or one inside it, was given something other than no."""
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


def _settings(model: type[FrozenModel]) -> dict[str, Any]:
    """Fields that decide no number, those of models inside a question too."""
    found: dict[str, Any] = {}
    for name, info in model.model_fields.items():
        own = asked_of(info)
        inner = group_of(info)
        if own is not None and not own.physics:
            found[name] = True
        elif inner is not None and (below := _settings(inner)):
            found[name] = below
    return found
