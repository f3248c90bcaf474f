"""Addresses as questions: parameters are the fields of a question, and become it as options of the command line do.

The same question as a command and as lines of Python; and files that come with a question, parsed from the body, held
in memory while it is answered, never written.
"""

from __future__ import annotations

import hashlib
import inspect
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin
from urllib.parse import parse_qsl, urlencode

from cpic_core import InputError, Record, was_sent
from cpic_planner import queries
from simulator.config import Instrument, nearest
from simulator.imaging import metrics_key, shipped_file

Q = TypeVar("Q", bound=queries.Question)
Pairs = tuple[tuple[str, str], ...]
"""Parameters of an address with their values, in order."""

MOST_PARAMETERS = 200
"""Of an address, and parts of a posted body."""
MOST_VALUES, LONGEST_VALUE = 16, 200
_YES, _NO = ("1", "true", "on", "yes"), ("0", "false", "off", "no")
_ON_THE_COMMAND_LINE = "without it: requests do not ask for this, the command line does"
_A_FILE = "a shipped preset by its name; files are named on the command line only"
_UNIT = r"(?:[A-Za-zµμ]{1,8}-?|%)?(?:/(?:sqrt\(h\)|√h|s))?"
_CHANGE = re.compile(rf"([\w.*]+)=(?:[x*×]?\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*{_UNIT}|on|off|true|false)")


class Addresses(Record, Generic[Q], eq=False):
    """The way in which an address asks a question.

    Attributes
    ----------
    model : type of Question
    command : str
        The command that asks the same.
    page : str
        Path of the page that answers it.
    left_out : frozenset of str
        Options that requests do not have: their work, or what they read, is for the command line.
    """

    model: type[Q]
    command: str
    page: str
    left_out: frozenset[str]

    @cached_property
    def options(self) -> tuple[queries.Option, ...]:
        """All options of the question."""
        return queries.options_of(self.model)

    @cached_property
    def by_name(self) -> dict[str, queries.Option]:
        """Options by the names of their parameters: the field, and what else it is called."""
        found: dict[str, queries.Option] = {}
        for name in (parameter, _dotted, _word, _last):
            for option in self.options:
                found.setdefault(name(option), option)
        return found

    @cached_property
    def names(self) -> dict[str, str]:
        """The parameter by what refusals call a field."""
        found: dict[str, str] = {}
        for option in queries.by_depth(self.options):
            for depth in range(1, len(option.path) + 1):
                found.setdefault(".".join(option.path[:depth]), parameter(option))
        found |= {name: parameter(option) for name, option in self.by_name.items()}
        return found | {option.flag: parameter(option) for option in self.options}

    def canonical(self, given: Iterable[tuple[str, str]]) -> Pairs:
        """Return parameters by the names of the fields, in the order of the question, without empty ones.

        Raises
        ------
        InputError
            For an unknown parameter, one that requests do not have, or a value that is too long or no text.
        """
        values: dict[str, list[str]] = {}
        for name, written in given:
            if (text := written.strip()) == "":
                continue
            if len(text) > LONGEST_VALUE or not text.isprintable():
                raise InputError(
                    name[:40], f"{len(text)} characters", allowed=f"at most {LONGEST_VALUE} printable ones"
                )
            known = self.by_name.get(name) or self.by_name.get(f"{name}_s")
            if known is None:
                raise self._unknown(name)
            if parameter(known).endswith("_s") and (name != parameter(known) or not _is_number(text)):
                text = queries.seconds_text(name, text).removesuffix(".0")
            if known.flag in self.left_out:
                raise InputError(parameter(known), "given", allowed=_ON_THE_COMMAND_LINE)
            values.setdefault(known.name, []).extend(_split(known, text))
        pairs = []
        for option in self.options:
            texts = values.get(option.name, [])
            # A page is about one star.
            several = option.several and not option.asked.argument
            if len(texts) > (MOST_VALUES if several else 1):
                most = f"at most {MOST_VALUES}" if several else "one value"
                raise InputError(parameter(option), f"{len(texts)} values", allowed=most)
            pairs += [(parameter(option), text) for text in texts]
        return tuple(pairs)

    def _unknown(self, name: str) -> InputError:
        shown = name[:40] if name[:40].isprintable() else "a name with other signs"
        offered = [known for known, option in self.by_name.items() if option.flag not in self.left_out]
        return InputError(
            shown or "a parameter", "given", allowed="fields of the question", hint=nearest(name, offered)
        )

    def given(self, pairs: Pairs) -> dict[str, Any]:
        """Return plain values by the names of options, as the command line has them.

        Parameters
        ----------
        pairs : sequence of (str, str)
            As `canonical` makes them.

        Raises
        ------
        InputError
            For a value of another kind, or one that could name a file.
        """
        values: dict[str, Any] = {option.name: None for option in self.options}
        for name, text in pairs:
            option = self.by_name[name]
            value = _value(name, text, option)
            values[option.name] = (*(values[option.name] or ()), value) if option.several else value
        return values

    def question(self, pairs: Pairs) -> Q:
        """Return the question of an address; `canonical` has its parameters.

        Raises
        ------
        InputError
            For the first fault, naming the parameter.
        """
        with queries.called_as(self.names):
            return self.model.of(self.tree(pairs))

    def tree(self, pairs: Pairs) -> dict[str, Any]:
        """Return what an address answers, as a tree of fields."""
        return queries.tree_of(self.options, self.given(pairs), {}, self.names)

    def command_line(self, pairs: Pairs) -> str:
        """Return the command that asks the same."""
        words = ["cpic", self.command]
        for name, text in pairs:
            option = self.by_name[name]
            value = _value(name, text, option)
            if option.asked.argument:
                words.append(text)
            elif isinstance(value, bool):
                words += [option.flag] if value else [f"--no-{option.flag[2:]}"] * option.switchable
            else:
                words += [option.flag, text]
        return shlex.join(words)


def address(path: str, pairs: Iterable[tuple[str, str]], **more: str) -> str:
    """Return the address of a path with parameters.

    Parameters
    ----------
    path : str
    pairs : iterable of (str, str)
    **more
        Further parameters.
    """
    asked = urlencode([*pairs, *more.items()])
    return f"{path}{'?' * bool(asked)}{asked}"


def parameter(option: queries.Option) -> str:
    """Return the parameter of an option: the field of the question, or the option's word for what is inside a field."""
    return option.path[0] if len(option.path) == 1 else _word(option)


def _word(option: queries.Option) -> str:
    return option.flag.lstrip("-").replace("-", "_").lower()


def _dotted(option: queries.Option) -> str:
    return ".".join(option.path)


def _last(option: queries.Option) -> str:
    return option.path[-1]


def _split(option: queries.Option, text: str) -> list[str]:
    """Split a text in which several numbers may stand between commas."""
    if not option.several or option.kind is not float:
        return [text]
    return [part for part in re.split(r"[,;\s]+", text) if part]


def _value(name: str, text: str, option: queries.Option) -> Any:
    """Return a text as the value that the command line makes of it."""
    kind = option.kind
    if option.path[-1] == "changes":
        return _change(name, text)
    if option.asked.names_file is not None and option.asked.names_file(text) and not was_sent(text):
        raise InputError(name, "another word", allowed=_A_FILE)
    if get_origin(kind) is Literal and text not in get_args(kind):
        raise InputError(name, text, allowed=", ".join(get_args(kind)))
    if kind is bool:
        if text.lower() not in (*_YES, *_NO):
            raise InputError(name, text, allowed="on or off")
        return text.lower() in _YES
    if kind in (int, float):
        try:
            if "_" in text or not text.isascii():  # Python reads these; people who write them mean something else
                raise ValueError
            return kind(text)
        except ValueError:
            raise InputError(name, text, allowed="a whole number" if kind is int else "a number") from None
    return text


def _change(name: str, text: str) -> str:
    """Return a change of the instrument, whose value is no word that could name a file, answered at once."""
    found = _CHANGE.fullmatch(text)
    if found is None or "file" in found[1] or "*" in found[1].rpartition(".")[2]:
        allowed = "KEY=VALUE with a number, a number with a unit, a factor as x0.7, on or off"
        raise InputError(name, "another change", allowed=allowed)
    if queries.is_optical(queries.long_key(found[1])):
        raise InputError(name, text, allowed="keys that leave the optics", hint="cpic etc --set computes optics anew")
    return text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_IMAGES = frozenset(("--fidelity", "--tolerance", "--realisations", "--seed"))
_MODES = frozenset(("--n-modes", "--choose-modes"))
_DRAWN = frozenset(("--instruments", "--ensemble"))
ETC = Addresses(queries.EtcQuestion, "etc", "/etc", _IMAGES | _MODES | _DRAWN)
"""Questions to the calculator; images, modes and drawn instruments are left out, they take seconds to minutes."""
RANK = Addresses(queries.RankQuestion, "rank", "/priorities", _MODES | _DRAWN | {"--planets", "--stars"})
"""Rankings; those under many instruments are left out, and lists of stars, which can be files."""

IMAGES = Addresses(
    queries.StarImagesQuestion,
    "images",
    "/jobs",
    _MODES | {"--simulator-overrides", "--catalog", "--workers", "--scheduler", "--force"},
)
"""Images of one star with its reference planet; they run as jobs."""


def image_lines(pairs: Pairs) -> str:
    """Return lines of Python that give the result of images."""
    tree, made = IMAGES.tree(pairs), _parts(IMAGES, pairs)
    return _lines(made, f"targets = {_call('confirm_targets', tree, made)}", "from cpic_planner import confirm_targets")


def python_lines(question: queries.EtcQuestion, pairs: Pairs) -> str:
    """Return lines of Python that give the answers of an address, as a list.

    Parameters
    ----------
    question : EtcQuestion
    pairs : sequence of (str, str)
        Its parameters.
    """
    import cpic_planner

    tree, made = {"target": question.target[0]} | ETC.tree(pairs), _parts(ETC, pairs)
    name = "contrast_limit" if question.contrast_limit else "exposure_time" if question.asks_time else "signal_to_noise"
    if name == "signal_to_noise" and question.strategy.visits is None:
        tree.setdefault("time_s", question.wall_s)
    if name == "contrast_limit":
        tree.pop("contrast_limit")
        tree.pop("detect", None)
        tree.setdefault("time_s", question.wall_s)
    if set(tree) <= set(inspect.signature(getattr(cpic_planner, name)).parameters):
        return _lines(made, f"answers = {_call(name, tree, made)}", f"from cpic_planner import {name}")
    answers = f"answers = answered(EtcQuestion.of({_literal(ETC.tree(pairs), (), made)})).result.answers"
    return _lines(
        made, answers, "from cpic_planner.api import answered", "from cpic_planner.queries import EtcQuestion"
    )


_Parts = dict[tuple[str, ...], tuple[str, str, dict[str, Any]]]


def _lines(made: _Parts, answer: str, *imports: str) -> str:
    """Return lines of Python: imports, also of what several options make, and the answer."""
    more = sorted({f"from {module} import {kind}" for module, kind, _ in made.values()})
    return "\n".join([*imports, *more, "", answer])


def _call(function: str, tree: Mapping[str, Any], made: _Parts) -> str:
    words = [f"{key}={_literal(value, (key,), made)}" for key, value in tree.items() if key != "target"]
    return f"{function}({', '.join([_literal(tree['target'], ('target',), made), *words])})"


def _parts(addresses: Addresses[Any], pairs: Pairs) -> _Parts:
    """Return the values that several options make: module and name of the model, and options, by place."""
    made: _Parts = {}
    given = addresses.given(pairs)
    for option, value in ((option, given[option.name]) for option in addresses.options):
        if option.parts is not None and value is not None:
            own = made.setdefault(option.path[:-1], (option.parts.__module__, option.parts.__name__, {}))
            own[2][option.path[-1]] = value
    return made


def _literal(value: Any, path: tuple[str, ...], made: _Parts) -> str:
    """Return a value as Python writes it, also where it is made of options."""
    if path in made:
        _, kind, given = made[path]
        return f"{kind}({', '.join(f'{name}={item!r}' for name, item in given.items())}).made(None)"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key!r}: {_literal(item, (*path, key), made)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return repr(value[0] if len(value) == 1 else list(value))
    return repr(value)


_FORM = "application/x-www-form-urlencoded"
_NAME = re.compile(r"[\w][\w.+ -]{0,79}")
_QUOTED = re.compile(rb'(name|filename)="((?:[^"\\]|\\.)*)"')
_FOLDED = re.compile(rb"\r\n[ \t]+")
FILE_FIELDS = ("instrument", "other", "catalog", "albedo", "known_planets", "table")
"""Parameters that take a file."""


class Submission(Record):
    """A posted question.

    Attributes
    ----------
    given : tuple of (str, str)
        Parameters; one that takes a file has the name of it.
    files : mapping
        Content by name.
    """

    given: tuple[tuple[str, str], ...]
    files: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def hashes(self) -> list[tuple[str, str]]:
        """Names of the files with the sha256 of their content."""
        return [(name, hashlib.sha256(data).hexdigest()) for name, data in self.files.items()]


def read_submission(content_type: str, body: bytes) -> Submission:
    """Return a posted question.

    Parameters
    ----------
    content_type : str
        Of the request: that of a form, with files or without.
    body : bytes

    Raises
    ------
    InputError
        For a body of another kind, a file without a name or with a strange one, or where none is taken.
    """
    kind = content_type.partition(";")[0].strip().lower()
    if kind == _FORM:
        return Submission(tuple(form_fields(content_type, body)))
    found = re.search(r'boundary="?([\w\'()+,./:=? -]{1,70})"?', content_type)
    if kind != "multipart/form-data" or found is None:
        raise InputError("body", kind[:60] or "no type", allowed="multipart/form-data, as forms and curl -F send it")
    given: list[tuple[str, str]] = []
    files: dict[str, bytes] = {}
    for head, content in _split_parts(body, found[1].rstrip().encode()):
        names = dict(_QUOTED.findall(_FOLDED.sub(b" ", head)))
        parameter = names.get(b"name", b"").decode("utf-8", "replace")
        if b"filename" not in names:
            given.append((parameter, content.decode("utf-8", "replace").strip()))
            continue
        if not names[b"filename"] and not content:
            continue  # a field of a form in which no file was chosen
        name = re.split(r"[/\\]", names[b"filename"].decode("utf-8", "replace"))[-1]
        _check_file(parameter, name, files)
        files[name] = content
        given.append((parameter, name))
    return Submission(tuple(given), files)


def form_fields(content_type: str, body: bytes) -> list[tuple[str, str]]:
    """Return the fields of a posted form without files.

    Parameters
    ----------
    content_type : str
        Of the request.
    body : bytes

    Raises
    ------
    InputError
        For a body of another kind.
    """
    kind = content_type.partition(";")[0].strip().lower()
    if kind != _FORM:
        raise InputError("content-type", kind[:60], allowed=_FORM)
    try:
        given = parse_qsl(body.decode(), keep_blank_values=True, errors="strict", max_num_fields=MOST_PARAMETERS)
    except ValueError:
        allowed = f"at most {MOST_PARAMETERS} fields of a form, in UTF-8"
        raise InputError("body", "another text", allowed=allowed) from None
    return [(name, value.strip()) for name, value in given]


def _split_parts(body: bytes, boundary: bytes) -> list[tuple[bytes, bytes]]:
    """Return the head and content of each part of a body."""
    first, *pieces = (b"\r\n" + body).split(b"\r\n--" + boundary)
    if first or not pieces or pieces[-1] not in (b"--", b"--\r\n") or len(pieces) > MOST_PARAMETERS:
        raise InputError(
            "body", "another text", allowed=f"a whole multipart/form-data body of at most {MOST_PARAMETERS} parts"
        )
    parts = []
    for piece in pieces[:-1]:
        head, blank, content = piece.partition(b"\r\n\r\n")
        if not head.startswith(b"\r\n") or not blank:
            raise InputError("body", "a part without a head", allowed="multipart/form-data")
        parts.append((head, content))
    return parts


def _check_file(parameter: str, name: str, files: Mapping[str, bytes]) -> None:
    if parameter not in FILE_FIELDS:
        raise InputError(parameter[:40] or "a file", "a file", allowed=f"files for {', '.join(FILE_FIELDS)}")
    if not _NAME.fullmatch(name) or "." not in name:
        allowed = "a name of letters, digits, blanks, points, + and -, with an ending such as .csv, .yaml or .fits"
        raise InputError(parameter, name[:80] if name.isprintable() else "another name", allowed=allowed)
    if name in files:
        raise InputError(parameter, name, allowed="files of different names")
    if len(files) >= MOST_VALUES:
        raise InputError(parameter, name, allowed=f"at most {MOST_VALUES} files")


def check_shipped(instrument: Instrument, bands: Sequence[str], key: str = "instrument") -> None:
    """Refuse an instrument that was sent where its optics are none that the package ships: they take minutes.

    Parameters
    ----------
    instrument : Instrument
    bands : sequence of str
    key : str
        What it is asked for as, for messages.

    Raises
    ------
    InputError
    """
    for band in bands if instrument.coronagraph.table is None else ():
        if band in instrument.bands and not shipped_file("metrics", metrics_key(instrument, band), band).is_file():
            hint = "on the command line it is computed once, which takes seconds to minutes"
            raise InputError(key, f"other optics in {band}", allowed="the optics of a shipped instrument", hint=hint)
