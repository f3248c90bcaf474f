"""Cases of the command line: good commands with options changed, dropped, doubled, misspelt and exchanged."""

import functools
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from tests.fuzz.values import texts
from tests.fuzz.watched import Case, of_command

_RANK = ("rank", "--catalog", "{stars}", "--planets", "20", "--band", "F520")
_ETC = ("etc", "tau Cet", "--band", "F520")
_PLACED = (*_ETC, "--separation-arcsec", "0.5")
_OWN = ("etc", "my star", "--v-mag", "5", "--sp-type", "G2V", "--distance-pc", "5", "--band", "F520", "--snr", "5")
_SCENE = ("simulate", "--dry-run", "paper_example", "--band", "F520", "--exposure-s", "10", "--em-gain", "10")
GOOD: tuple[tuple[str, ...], ...] = (
    *((*_PLACED, "--snr", "5"), (*_PLACED, "--time-s", "1e5"), (*_PLACED, "--detect"), (*_PLACED, "--sigma", "5")),
    *((*_PLACED, "--contrast-limit", "--time-s", "1e5"), (*_ETC, "--snr", "5"), (*_ETC, "--contrast-limit"), _OWN),
    ("etc", "eps Eri b", "--band", "F520", "--snr", "5"),
    *(_RANK, (*_RANK, "--explain", "A one"), (*_RANK, "--sensitivity"), (*_RANK, "--known-planets", "snapshot")),
    ("plan", "--dry-run", "--catalog", "{stars}", "--planets", "20", "--band", "F520", "--out", "{out}"),
    *(("known", "eps Eri", "--planets", "20"), ("known", "eps Eri", "--planets", "20", "--years", "1")),
    ("visibility", "tau Cet", "--days", "30"),
    ("curve", "tau Cet", "--band", "F520", "--separation-arcsec", "0.5"),
    ("roc", "tau Cet", "--band", "F520", "--separation-arcsec", "0.5", "--contrast", "3e-9"),
    ("confirm", "--dry-run", "paper_example", "--band", "F520", "--out", "{out}"),
    *(_SCENE, ("simulate", "--dry-run", "--kind", "BIAS"), ("simulate", "--dry-run", "calibration_set")),
    ("whatif", "--dry-run", "survey_default", "--out", "{out}"),
    *(("tradeoff", "--list"), ("catalog", "info"), ("catalog", "columns"), ("schema", "etc"), ("cache", "info")),
    *(("instrument", "show", "cpic_default"), ("instrument", "keys", "drift")),
    *(("instrument", "diff", "cpic_default", "as_published"), ("check", "{stars}"), ("check", "{folder}")),
)
"""Commands that are answered in milliseconds; ``{stars}`` and ``{out}`` are files of the test."""
_GROUPS = ("catalog", "cache", "instrument")
IMAGES = {"--fidelity", "--tolerance", "--images"}
"""Options by which the calculator makes images, which are work of minutes."""


@dataclass(frozen=True)
class Option:
    """An option of a command: its names, and whether it takes a value."""

    names: tuple[str, ...]
    takes_value: bool


@functools.cache
def options_of(*words: str) -> tuple[Option, ...]:
    """Return the options of a command, those that it shares with others too, but the one that asks for silence."""
    from cpic_planner.cli import command as making, main, run_commands, star_commands
    from cpic_planner.schemas import QUESTIONS

    late: dict[str, Any] = {
        name: getattr(star_commands if hasattr(star_commands, name) else run_commands, name) for name in QUESTIONS
    }
    if words[0] in late:
        command = making.command_of(late[words[0]], pkgutil.resolve_name(QUESTIONS[words[0]]))
    else:
        command = main.app.built
        for word in words:
            found = getattr(command, "commands", {}).get(word)
            command = command if found is None else found
    return tuple(
        Option(
            (*item.opts, *item.secondary_opts),
            not getattr(item, "is_flag", False) and not getattr(item, "count", False),
        )
        for item in command.params
        if item.param_type_name == "option"
        and "--quiet" not in item.opts
        and (words[0] not in ("etc", "curve", "roc") or not IMAGES & set(item.opts))
    )


def named(arguments: tuple[str, ...], folder: Path) -> list[str]:
    """Return a command with the files of a test."""
    places = {"{stars}": "stars.csv", "{out}": "out", "{folder}": "."}
    return [str(folder / places[word]) if word in places else word for word in arguments]


def every_one(folder: Path) -> Iterator[Case]:
    """Give each option of each command the numbers at the ends of what a computer holds, alone."""
    for words in {good[0]: good for good in reversed(GOOD)}.values():
        good = named(words, folder)
        for option in options_of(*words[:2]):
            for value in ("5e-324", "1e-308", "1e-30", "1e30", "1e308") if option.takes_value else ():
                arguments = [*good, f"{option.names[0]}={value}"]
                yield words[0], arguments, lambda arguments=arguments: of_command(arguments)


@st.composite
def cases(draw: Any, folder: Path) -> Case:
    """Draw a command: a good one with one to three changes."""
    good = draw(st.sampled_from(GOOD))
    arguments = named(good, folder)
    known = options_of(*good[:2])
    first = 1 + (good[0] in _GROUPS or good[1] in ("--dry-run", "--list"))  # which decide what is done at all
    for _ in range(draw(st.sampled_from((1, 1, 1, 2, 3)))):
        if len(arguments) == first:
            break
        change = draw(
            st.sampled_from(("option", "option", "option", "value", "value", "drop", "double", "swap", "junk"))
        )
        place = draw(st.integers(first, len(arguments) - 1))
        if change == "option" and known:  # of some commands they are not made before the first call
            option = draw(st.sampled_from(known))
            value = draw(texts)
            name = draw(st.sampled_from(option.names))
            if not option.takes_value:
                arguments += [name]
            elif draw(st.booleans()):
                arguments += [f"{name}={value}"]
            else:
                arguments += [name, value]
        elif change == "value":
            arguments[place] = draw(texts)
        elif change == "drop":
            del arguments[place]
        elif change == "double":
            arguments.insert(place, arguments[place])
        elif change == "swap":
            other = draw(st.integers(first, len(arguments) - 1))
            arguments[place], arguments[other] = arguments[other], arguments[place]
        elif change == "junk":
            arguments.insert(place, draw(texts))
    if good[0] == "check":  # not the files of the machine
        arguments = [str(folder) if word in ("/", "~", "..", "../..") else word for word in arguments]
    return arguments[0], arguments, lambda: of_command(arguments)
