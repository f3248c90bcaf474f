"""Registries: what can be chosen by name, each with all that the package knows of it in one entry.

`cpic_planner.registry` has what a ranking can be by and where reference frames
can come from. Types, options of the command line, schemas and words derive from the entries.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Literal, Protocol, TypeVar

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

from cpic_core.errors import InputError


class _Named(Protocol):
    @property
    def name(self) -> str: ...


E = TypeVar("E", bound=_Named)


class Registry(Mapping[str, E]):
    """Entries of one kind by name, in the order in which they are shown.

    ``Annotated[str, registry]`` is the type of a field that holds one of the names: pydantic refuses others, and the
    JSON Schema lists them.

    Parameters
    ----------
    key : str
        What the names are, as messages call it.
    entries : iterable
        Objects with a ``name``.
    """

    def __init__(self, key: str, entries: Iterable[E] = ()) -> None:
        self.key = key
        self._entries: dict[str, E] = {}
        for entry in entries:
            self.register(entry)

    def __getitem__(self, name: str) -> E:
        """Return the entry of a name.

        Raises
        ------
        InputError
            If there is none.
        """
        try:
            return self._entries[name]
        except (KeyError, TypeError):
            raise InputError(self.key, name, allowed=", ".join(self)) from None

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._entries

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def choices(self) -> tuple[str, ...]:
        """Return the names, in order."""
        return tuple(self)

    def literal(self) -> Any:
        """Return ``Literal`` of the names as they are now, for what reads types when it is imported."""
        return Literal[self.choices()]

    def register(self, entry: E, *, after: str = "") -> E:
        """Add an entry and return it.

        Parameters
        ----------
        entry
            With a name of its own.
        after : str
            Name of the entry that it follows; the last so far by default.

        Raises
        ------
        InputError
            If its name is taken, or there is no entry that it could follow.
        """
        if entry.name in self._entries:
            raise InputError(self.key, entry.name, allowed="a name that is not registered yet")
        names = list(self._entries)
        place = names.index(self[after].name) + 1 if after else len(names)
        self._entries = {name: self._entries.get(name, entry) for name in [*names[:place], entry.name, *names[place:]]}
        return entry

    @contextmanager
    def holding(self, entry: E, *, after: str = "") -> Iterator[E]:
        """Hold an entry for the length of a ``with`` block; ``after`` as in `register`."""
        self.register(entry, after=after)
        try:
            yield entry
        finally:
            del self._entries[entry.name]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._known)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: Any) -> dict[str, Any]:
        return {"enum": list(self), "type": "string"}

    def _known(self, value: Any) -> str:
        if value not in self:
            *most, last = (repr(name) for name in self)
            raise PydanticKnownError("literal_error", {"expected": " or ".join(filter(None, [", ".join(most), last]))})
        return str(value)
