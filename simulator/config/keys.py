"""Keys and values as people write them: other names of a key, near misses, units, numbers of other libraries."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

from catalogs.errors import InputError
from simulator.config.base import unit_of
from simulator.quantities import in_unit

__all__ = ["at", "canonical_keys", "nearest", "required", "to_unit"]


def canonical_keys(
    tree: Mapping[Any, Any],
    fields: Iterable[str],
    aliases: Mapping[str, str],
    *,
    hints: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Return a mapping with its keys spelled as the model's fields and its numbers as plain numbers.

    Parameters
    ----------
    tree : mapping
        What the user wrote. Values that carry a unit (`astropy.units`) are converted to that of the key.
    fields : iterable of str
        Names that the model knows.
    aliases : mapping of str to str
        Other spellings and the field that each means.
    hints : mapping of str to str, optional
        What to say of a key that is not accepted.

    Raises
    ------
    InputError
        For an unknown key, naming the nearest known ones, and for one thing given under two names.
    """
    known = tuple(fields)
    result: dict[str, Any] = {}
    origin: dict[str, str] = {}
    for given, value in tree.items():
        key = _spelled(given, known, aliases)
        if key not in known:
            hint = (hints or {}).get(given) or nearest(given, (*known, *aliases)) or f"known keys: {', '.join(known)}"
            raise InputError(str(given), _plain(value), allowed="no such key", hint=hint)
        if key in result:
            first, second = sorted((given, origin[key]), key=lambda name: name == key)
            raise InputError(first, f"given with {second}", allowed="one of the two")
        result[key], origin[key] = to_unit(key, value), given
    return result


def _spelled(given: Any, known: tuple[str, ...], aliases: Mapping[str, str]) -> Any:
    """Return the field that a key means; capitals do not matter: RA, Dec."""
    for key in (given, given.lower() if isinstance(given, str) else given):
        if key in aliases or key in known:
            return aliases.get(key, key)
    return given


def nearest(word: Any, known: Iterable[str]) -> str:
    """Return ``did you mean ...?`` with the nearest known words, empty if none is near.

    Parameters
    ----------
    word : object
        What was written.
    known : iterable of str
        Words that are known.
    """
    close = difflib.get_close_matches(str(word), list(known), n=3, cutoff=0.6)
    return f"did you mean {' or '.join(close)}?" if close else ""


def required(key: str, allowed: str) -> InputError:
    """Return the refusal of a mapping that lacks a key.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    allowed : str
        Values that are allowed, in words.
    """
    return InputError(key, "missing", allowed=allowed)


def at(path: str, error: InputError) -> InputError:
    """Return the same refusal with its key under a dotted path.

    Parameters
    ----------
    path : str
    error : InputError
    """
    return InputError(f"{path}.{error.key}", error.value, unit=error.unit, allowed=error.allowed, hint=error.hint)


def _plain(value: Any) -> Any:
    """Return scalars and arrays of numpy as Python's own."""
    return value.tolist() if hasattr(value, "dtype") and hasattr(value, "tolist") else value


def to_unit(key: str, value: Any) -> Any:
    """Return a value that carries a unit (`astropy.units`) as a plain number in that of the key; others unchanged.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : object
        Number, with or without a unit.
    """
    return _plain(in_unit(key, value, unit_of(key)))
