"""Frozen dataclasses that cost nothing until one is made: a command defines hundreds and uses a few.

The methods of a dataclass are written as text and compiled, half a millisecond each class. Here that waits for the
first object, or for whoever asks for the fields or the signature.
"""

import threading
from dataclasses import Field, dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, dataclass_transform

_MAKING = threading.RLock()


def _make(cls: type) -> None:
    """Make a dataclass of a class, once."""
    with _MAKING:
        if "__dataclass_params__" not in vars(cls):
            dataclass(**{"frozen": True, **vars(cls)["_how"]})(cls)


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
        """Remember how the dataclass is made; one of another is made at once, as it has the methods of that else."""
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

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take what another process had."""
        _make(type(self))
        vars(self).update(state)
