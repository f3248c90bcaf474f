"""Frozen dataclasses that cost little until one is made: a command defines hundreds and uses a few.

The methods of a dataclass are written as text and compiled, half a millisecond each class. Here the one that differs
from class to class is, for the first object or for whoever asks for the fields or the signature; the others are the
same for all.
"""

import threading
from dataclasses import MISSING, Field, FrozenInstanceError, dataclass, field, fields
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, ClassVar, dataclass_transform

_MAKING = threading.RLock()


def _make(cls: Any) -> None:
    """Make a dataclass of a class, once."""
    with _MAKING:
        if "__dataclass_params__" not in vars(cls):
            how = {"eq": True, **vars(cls)["_how"]}
            eq = how.pop("eq")
            dataclass(init=False, repr=False, eq=False, **how)(cls)
            methods = {"__repr__": _shown} | ({"__eq__": _equal, "__hash__": _hash} if eq else {})
            cls._counts = attrgetter("__class__", *(item.name for item in fields(cls) if item.compare))
            for name, method in (methods | {"__init__": _init_of(cls)}).items():
                if name not in vars(cls):
                    setattr(cls, name, method)


def _init_of(cls: Any) -> Any:
    """Return the method that takes the fields, as that of a frozen dataclass."""
    scope: dict[str, Any] = {"_set": object.__setattr__}
    taken: dict[Any, list[str]] = {False: [], True: []}
    body = []
    for item in fields(cls):
        name, default, value = item.name, f"_of_{item.name}", item.name
        if item.default_factory is not MISSING:
            scope[default], value = item.default_factory, f"{default}() if {name} is ... else {name}"
            taken[item.kw_only].append(f"{name}=...")
        elif item.default is not MISSING:
            scope[default] = item.default
            taken[item.kw_only].append(f"{name}={default}")
        else:
            taken[item.kw_only].append(name)
        if not item.init:
            taken[item.kw_only].pop()
            value = f"{default}()" if item.default_factory is not MISSING else ""
        body += [f"_set(self, {name!r}, {value})"] * bool(value)
    body += ["self.__post_init__()"] * hasattr(cls, "__post_init__")
    named = ["*", *taken[True]] if taken[True] else []
    exec(f"def __init__({', '.join(['self', *taken[False], *named])}):\n " + "\n ".join(body or ["pass"]), scope)  # noqa: S102 - as dataclasses do
    made = scope["__init__"]
    made.__qualname__ = f"{cls.__qualname__}.__init__"
    made.__annotations__ = {item.name: item.type for item in fields(cls) if item.init} | {"return": None}
    return made


def _equal(self: Any, other: Any) -> Any:
    return self._counts(self) == self._counts(other) if type(other) is type(self) else NotImplemented


def _hash(self: Any) -> int:
    return hash(self._counts(self))


@recursive_repr()
def _shown(self: Any) -> str:
    parts = (f"{item.name}={getattr(self, item.name)!r}" for item in fields(self) if item.repr)
    return f"{type(self).__qualname__}({', '.join(parts)})"


class _Late:
    """An attribute that the dataclass has: asked of the class, it makes one of it first."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, instance: object, cls: type) -> Any:
        if cls is Record:
            raise AttributeError(self.name)
        _make(cls)
        if self.name not in vars(cls):
            raise AttributeError(self.name)
        return vars(cls)[self.name]


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
class Record:
    """A frozen dataclass; what is said to `dataclass` stands behind the bases: ``(Record, eq=False)``."""

    if TYPE_CHECKING:
        __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    else:
        __dataclass_fields__, __signature__ = _Late("__dataclass_fields__"), _Late("__signature__")
    _how: ClassVar[dict[str, bool]]

    def __init_subclass__(cls, **how: bool) -> None:
        """Note how the dataclass is made; one of another is made at once, as it has the methods of that else."""
        super().__init_subclass__()
        above = [base for base in cls.__mro__[1:] if issubclass(base, Record) and base is not Record]
        for base in above[:1]:
            _make(base)
        if not above or how or "__annotations__" in vars(cls):
            cls._how = how
            if above:
                _make(cls)

    def __init__(self, *args: Any, **values: Any) -> None:
        _make(type(self))
        type(self).__init__(self, *args, **values)

    if not TYPE_CHECKING:

        def __setattr__(self, name: str, value: object) -> None:
            """Refuse it; only classes that add no fields of their own have other attributes."""
            if "_how" in vars(type(self)) or name in self.__dataclass_fields__:
                raise FrozenInstanceError(f"cannot assign to field {name!r}")
            object.__setattr__(self, name, value)

        def __delattr__(self, name: str) -> None:
            """Refuse it, likewise."""
            if "_how" in vars(type(self)) or name in self.__dataclass_fields__:
                raise FrozenInstanceError(f"cannot delete field {name!r}")
            object.__delattr__(self, name)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take what another process had."""
        _make(type(self))
        vars(self).update(state)
