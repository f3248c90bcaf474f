"""Keep a table of columns as it is: nobody changes its arrays, and it travels to worker processes whole."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

import numpy as np

from cpic_core import NDArray

_PLAIN = (dict, MappingProxyType)


@dataclass(frozen=True)
class FrozenTable:
    """An immutable table: its mappings cannot be changed, nor the arrays of its columns.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Arrays of equal length; they become read-only.
    """

    columns: Mapping[str, NDArray[np.generic]]

    def __post_init__(self) -> None:
        for values in self.columns.values():
            values.flags.writeable = False
        for name, value in self._values().items():
            if isinstance(value, _PLAIN):
                object.__setattr__(self, name, MappingProxyType(dict(value)))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.columns.values())))

    def __reduce__(self) -> tuple[object, ...]:
        """Travel to worker processes as plain data (a mapping proxy does not pickle)."""
        values = self._values().values()
        return (type(self), tuple(dict(value) if isinstance(value, _PLAIN) else value for value in values))

    def _values(self) -> dict[str, object]:
        return {field.name: getattr(self, field.name) for field in fields(self)}
