"""A call that is refused, and the line of its refusal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from cpic_core import InputError


class Refusal(NamedTuple):
    """A call and what its refusal says, but for the closing words ``not accepted``."""

    name: str
    call: Callable[..., Any]
    arguments: tuple[Any, ...]
    says: str


def answer(refusal: Refusal) -> str:
    """The line of a refusal; what was answered instead where the call is not refused."""
    try:
        return f"answered {refusal.call(*refusal.arguments)!r}"
    except InputError as error:
        return str(error)
