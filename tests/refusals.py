"""Tables of what readers make of what they are given: ``refusals.yaml`` and ``readings.yaml`` beside the tests.

A test with the fixture ``refusal`` or ``reading`` runs once for each reader of the table beside it. Whatever is refused
is refused by `InputError`, in one line, and the message holds every word of the case.
"""

import copy
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from cpic_core import InputError

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # that of libyaml, where it is there, takes a tenth of the time


@dataclass(frozen=True)
class Refusal:
    """One case: who reads (a key of the table), what is given, and what the message must say."""

    reader: str
    given: Any
    words: tuple[str, ...]

    def by(self, readers: dict[str, Callable[[Any], Any]]) -> None:
        """Give the case to its reader and check the refusal."""
        with pytest.raises(InputError) as caught:
            readers[self.reader](copy.deepcopy(self.given))
        message = str(caught.value)
        assert "\n" not in message
        for word in self.words:
            assert word in message, message


def refusals(path: Path) -> Iterator[Refusal]:
    """Yield the cases of a table, whose first lines say how they are written."""
    for reader, cases in yaml.load(path.read_text(encoding="utf-8"), _LOADER).items():
        for case in cases:
            if isinstance(case, list):
                yield Refusal(reader, case[0], tuple(case[1:]))
            elif "each" in case:
                yield from (Refusal(reader, given, tuple(case["says"])) for given in case["each"])
            else:
                yield from (
                    Refusal(reader, nested(key, value), (key,))
                    for key, values in case["keys"].items()
                    for value in values
                )


def nested(key: str, value: Any) -> Any:
    """Mapping that holds a value at a dotted key."""
    for name in reversed(key.split(".")):
        value = {name: value}
    return value


@dataclass(frozen=True)
class Reading:
    """One text and what it means to its reader (a key of the table)."""

    reader: str
    given: Any
    meaning: Any

    def by(self, readers: dict[str, Callable[[Any], Any]]) -> None:
        """Give the text to its reader; the type of the answer counts too."""
        found = readers[self.reader](self.given)
        assert found == self.meaning
        assert type(found) is type(self.meaning)


def readings(path: Path) -> Iterator[Reading]:
    """Yield the cases of a table, whose first line says how they are written."""
    for reader, cases in yaml.load(path.read_text(encoding="utf-8"), _LOADER).items():
        if isinstance(cases, dict):
            yield from (Reading(reader, text, meaning) for text, meaning in cases.items())
        else:
            yield from (Reading(reader, text, meaning) for meaning, texts in cases for text in texts)


@dataclass(frozen=True)
class Cases:
    """All cases of one reader; what is wrong names the case."""

    reader: str
    cases: tuple[Refusal | Reading, ...]

    def by(self, readers: dict[str, Callable[[Any], Any]]) -> None:
        """Give each case to the reader."""
        wrong = []
        for case in self.cases:
            try:
                case.by(readers)
            except (AssertionError, pytest.fail.Exception) as error:
                wrong.append(f"{case}: {error}")
        assert not wrong, "\n".join(wrong)


def by_reader(cases: Iterable[Refusal | Reading]) -> Iterator[Cases]:
    """Yield the cases of each reader together: to run a test takes longer than a case."""
    found: dict[str, list[Refusal | Reading]] = {}
    for case in cases:
        found.setdefault(case.reader, []).append(case)
    yield from (Cases(reader, tuple(own)) for reader, own in found.items())
