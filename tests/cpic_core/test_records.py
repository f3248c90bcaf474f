"""Frozen dataclasses that are made when they are first used, and nobody can tell."""

import copy
import inspect
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, field, fields, is_dataclass, replace

import pytest

from cpic_core import Record


class Place(Record):
    x: float
    y: float = 0.0
    words: list[str] = field(default_factory=list)


class Named(Place, kw_only=True):
    name: str


class Plain(Place):
    def doubled(self):
        return replace(self, x=2.0 * self.x)


class Alone(Record, eq=False):
    x: float

    def __post_init__(self):
        if self.x < 0:
            raise ValueError(self.x)


def is_made(kind):
    return "__dataclass_params__" in vars(kind)


def test_it_is_made_by_the_first_object():
    class Late(Record):
        x: int

    assert not is_made(Late)
    assert Late(1) == Late(1) != Late(2)
    assert is_made(Late)
    assert repr(Late(1)).endswith("Late(x=1)")
    assert {Late(1): 2}[Late(1)] == 2


@pytest.mark.parametrize("ask", [is_dataclass, fields, inspect.signature])
def test_it_is_made_for_who_asks(ask):
    class Late(Record):
        x: int
        y: str = ""

    assert ask(Late)
    assert is_made(Late)
    assert [item.name for item in fields(Late)] == ["x", "y"]
    assert str(inspect.signature(Late)).startswith("(x: int, y: str = '')")


def test_objects_are_those_of_a_frozen_dataclass():
    place = Place(1.0)
    with pytest.raises(FrozenInstanceError):
        place.x = 2.0
    with pytest.raises(TypeError, match="missing 1 required positional argument"):
        Place()
    assert place.words == []
    assert place.words is not Place(1.0).words
    assert replace(place, y=3.0) == Place(1.0, 3.0) == copy.copy(Place(1.0, 3.0))
    with pytest.raises(ValueError, match="-1"):
        Alone(-1)
    assert Alone(1) != Alone(1)


def test_one_of_another_has_the_fields_of_both():
    assert Named(1.0, name="a") == Named(1.0, 0.0, [], name="a") != Place(1.0)
    assert [item.name for item in fields(Named)] == ["x", "y", "words", "name"]
    assert Plain(1.0).doubled() == Plain(2.0)


def test_threads_make_it_once():
    for _ in range(50):

        class Late(Record):
            x: int
            words: list[str] = field(default_factory=list)

        with ThreadPoolExecutor(8) as pool:
            assert {item.x for item in pool.map(Late, range(64))} == set(range(64))
        assert Late(1).words == []


def test_objects_travel_to_a_process_that_has_made_none():
    from catalogs.names import StarMatch

    code = (
        "import pickle, sys; from catalogs.names import StarMatch\n"
        "assert '__dataclass_params__' not in vars(StarMatch)\n"
        "found = pickle.load(sys.stdin.buffer)\n"
        "try: found.index = 1\nexcept AttributeError: print('frozen')\n"
        "assert found == StarMatch(3, 'a', others=('b',)), found"
    )
    sent = pickle.dumps(StarMatch(3, "a", others=("b",)))
    done = subprocess.run([sys.executable, "-c", code], input=sent, capture_output=True, check=True)
    assert done.stdout.decode().strip() == "frozen"
