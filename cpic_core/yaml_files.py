"""Strict, safe YAML: no duplicate keys, no aliases, numbers as people write them.

PyYAML follows YAML 1.1, where ``1e-8`` is a string, ``on`` is a boolean and ``12:30`` is 750. This
loader resolves plain scalars by the YAML 1.2 core schema instead (https://yaml.org/spec/1.2.2/#103-core-schema).
"""

import contextlib
import copy
import functools
import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from cpic_core.errors import InputError
from cpic_core.files import is_file, read_text
from cpic_core.quantities import checked_array, converted, unit_of
from cpic_core.records import Record

P = ParamSpec("P")
R = TypeVar("R")

MAX_BYTES = 4_000_000
PARSED = Path(__file__).parent / "parsed"
"""Folder of shipped documents as JSON, each by what its text says (`digest`): ``python -m tools.parsed`` makes them."""
_MAX_KEPT = 100_000
_SETTINGS = ("instrument", "scene", "simulation", "strategies", "strategy", "population", "visibility")
KINDS = (*_SETTINGS, "simulator_overrides", "question", "ensemble")
"""Kinds by which our files name themselves."""
_KIND_LINE = re.compile(rf"^kind:[ \t]*(?:{'|'.join(KINDS)})[ \t]*(?:#.*)?$", re.MULTILINE)
_QUOTED = re.compile(r"\s*('[^']*'|\"[^\"]*\")")
_NO_EVIDENCE = ("kind", "name", "description", "base")  # keys that any file may have
_WORDS = ("source", "confidence", "unit", "note")
_SOURCED_KEYS = {"value", "range", *_WORDS}


class Provenance(Record):
    """The standing of a number: where it comes from.

    ``confidence`` is ``"P"`` (published and read), ``"I"`` (inferred from published numbers) or ``"A"`` (assumed).
    """

    source: str
    confidence: str
    unit: str = ""
    range: tuple[float, float] | None = None
    note: str = ""


def parse_yaml(text: str, *, where: str = "YAML text", quoting: bool = True) -> Any:
    """Parse one YAML document.

    Parameters
    ----------
    text : str
        The document.
    where : str
        Name shown in error messages (a file name).
    quoting : bool
        Whether messages may quote the document.

    Returns
    -------
    object
        Nested dict, list, str, int, float, bool and None.

    Raises
    ------
    InputError
        On duplicate keys, aliases, tags outside the safe set or malformed text, with line and column.
    """
    import yaml

    try:
        return copy.deepcopy(_tree_of(text)) if len(text) <= _MAX_KEPT else _parsed(text)
    except RecursionError:
        raise InputError(where, "nested too deeply", allowed="one well-formed YAML document") from None
    except (ValueError, OverflowError):  # of PyYAML, which does not check the numbers of escapes
        raise InputError(where, "an escape of no character", allowed="one well-formed YAML document") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" line {mark.line + 1} column {mark.column + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        problem = problem if quoting else _QUOTED.sub("", problem)
        raise InputError(f"{where}{place}", problem, allowed="one well-formed YAML document") from None


def _parsed(text: str) -> Any:
    import yaml

    from cpic_core.yaml_loaders import StrictLoader

    return yaml.load(text, Loader=StrictLoader)  # noqa: S506 - StrictLoader derives from SafeLoader


def digest(text: str) -> str:
    """Return the name of a document among `PARSED`."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


_tree_of = functools.lru_cache(maxsize=32)(_parsed)  # presets are asked for again and again, and slow to parse


def load_yaml(path: str | Path) -> Any:
    """Read one YAML file strictly; see `parse_yaml`.

    A number with a unit that converts into the one in which its key ends (``time_s: 10h``) is read as on the command
    line.

    Parameters
    ----------
    path : str or Path
        Of a file, or of a document of the package, which ships parsed as well.

    Raises
    ------
    InputError
        If the file is missing, no regular file, larger than 4 MB, not UTF-8, or not strict YAML. The message quotes a
        file only if that says in a line of its own that it is of one of our kinds.
    """
    text = read_text(path, key="file", allowed="a readable YAML file", max_bytes=MAX_BYTES)
    parsed = PARSED / f"{digest(text)}.json"
    if parsed.exists():
        return json.loads(parsed.read_bytes())
    return in_units(parse_yaml(text, where=Path(path).name, quoting=_KIND_LINE.search(text) is not None))


def in_units(tree: Any, key: str = "") -> Any:
    """Return a tree whose texts of a number and a unit (``10h``) are numbers where their key ends in its unit."""
    if isinstance(tree, dict):
        sourced = "value" in tree and set(tree) <= _SOURCED_KEYS
        return {name: in_units(item, key if sourced and name == "value" else str(name)) for name, item in tree.items()}
    if isinstance(tree, list):
        return [in_units(item, key) for item in tree]
    unit = unit_of(key) if isinstance(tree, str) else ""
    found = converted(tree, unit) if unit else None
    return tree if found is None else found


def load_mapping(path: str | Path, kind: str, keys: Iterable[str]) -> dict[str, Any]:
    """Read one YAML file that holds a mapping of ours.

    Parameters
    ----------
    path : str or Path
        The file.
    kind : str
        What it is read as.
    keys : iterable of str
        Keys that such a file has; one of them makes it ours if it does not say its kind.

    Returns
    -------
    dict
        With its ``kind``, which may be another of ours, if it has one.

    Raises
    ------
    InputError
        As `load_yaml`, or if the file is not of one of our kinds; the message then quotes nothing of it.
    """
    tree = load_yaml(path)
    if isinstance(tree, dict):
        said = tree.get("kind")
        known = {_reduced(key) for key in keys} - set(_NO_EVIDENCE)
        if said in KINDS if "kind" in tree else not known.isdisjoint(_reduced(str(key)) for key in tree):
            return tree
    raise InputError(kind, str(path), allowed=f"a YAML mapping of kind {kind}", hint=f"its first line: kind: {kind}")


@contextlib.contextmanager
def faults_by_line(source: Any, *, whole: bool = True) -> Iterator[None]:
    """Name file and line in refusals of what a YAML file says.

    Parameters
    ----------
    source : object
        The file; nothing is named where it is none, as a preset or a mapping.
    whole : bool
        Whether the file says everything, so that a key that it does not have is its fault too.

    Raises
    ------
    InputError
        Those of the body. Where a key is missing, the line is that of what should have it.
    """
    try:
        yield
    except InputError as error:
        name = Path(source).name if isinstance(source, str | Path) and is_file(source) else ""
        if not name or error.key.startswith((f"{name} ", f"{name}:")) or str(error.value) == str(source):
            raise
        line = _line_of(source, error.key)
        if not line and not whole:
            raise
        key, about = f"{name}{f' line {line}' * bool(line)}: {error.key}", (error.unit, error.allowed, error.hint)
        raise InputError(key, error.value, unit=about[0], allowed=about[1], hint=about[2]) from None


def by_line(load: Callable[P, R]) -> Callable[P, R]:
    """Return a function that loads what its first argument names, with `faults_by_line` of that."""

    @functools.wraps(load)
    def told(*args: P.args, **keywords: P.kwargs) -> R:
        with faults_by_line(args[0] if args else keywords.get("source")):
            return load(*args, **keywords)

    return told


def _line_of(path: str | Path, key: str) -> int:
    """Return the line of the key, or of the last part of it that a YAML file has; 0 for none."""
    text = read_text(path, key="file", allowed="a readable YAML file", max_bytes=MAX_BYTES)
    import yaml

    from cpic_core.yaml_loaders import StrictLoader

    try:
        node: Any = yaml.compose(text, Loader=StrictLoader)
    except (yaml.YAMLError, RecursionError, ValueError):
        return 0
    parts = [part for part in re.split(r"[.\[\]]+", key) if part]
    # The first part may stand for the file, and what an item of a list does not say for itself is of the defaults.
    shared = [["defaults", *parts[n + 1 :]] for n, part in enumerate(parts) if part.isdigit()]
    return max(_deepest(node, path) for path in (parts, parts[1:], *shared))[-1]


def _deepest(node: Any, parts: Sequence[str]) -> tuple[bool, int, int]:
    """Return whether all parts of a key are there, one in the other, how many are, and the line of the last of them."""
    found, line = 0, 0
    while found < len(parts):
        below = _below(node)
        more = next((n for n in range(len(parts), found, -1) if ".".join(parts[found:n]) in below), 0)
        if not more:
            break
        line, node = below[".".join(parts[found:more])]
        found = more
    return found == len(parts) > 0, found, line


def _below(node: Any) -> dict[str, tuple[int, Any]]:
    """Return line and node of what is below one, by key or number."""
    if node.id == "mapping":
        return {key.value: (key.start_mark.line + 1, item) for key, item in node.value if isinstance(key.value, str)}
    items = node.value if node.id == "sequence" else ()
    return {str(number): (item.start_mark.line + 1, item) for number, item in enumerate(items)}


def _reduced(key: str) -> str:
    return key.split(".")[0].strip().lower().replace("-", "_").replace(" ", "_")


def split_sourced(tree: Any, path: str = "") -> tuple[Any, dict[str, Provenance]]:
    """Separate values from their provenance.

    A leaf may be written plainly (``width_nm: 50``) or with its standing
    (``width_nm: {value: 50, unit: nm, source: "...", confidence: A}``).

    Parameters
    ----------
    tree : object
        Parsed YAML.
    path : str
        Dotted path of ``tree`` itself.

    Returns
    -------
    values : object
        The same tree with plain leaves.
    provenance : dict of str to Provenance
        Dotted path of each sourced leaf to its provenance.
    """
    if isinstance(tree, dict):
        if "value" in tree and set(tree) <= _SOURCED_KEYS:
            limits = None if tree.get("range") is None else checked_array(f"{path}.range", tree["range"], low=-np.inf)
            if limits is not None and limits.shape != (2,):
                raise InputError(f"{path}.range", tree["range"], allowed="two numbers")
            words = {key: str(tree.get(key, "A" if key == "confidence" else "")) for key in _WORDS}
            between = None if limits is None else (float(limits[0]), float(limits[1]))
            return tree["value"], {path: Provenance(**words, range=between)}
        values: dict[Any, Any] = {}
        found: dict[str, Provenance] = {}
        for key, item in tree.items():
            values[key], inner = split_sourced(item, f"{path}.{key}" if path else str(key))
            found.update(inner)
        return values, found
    if isinstance(tree, list):
        items, found = [], {}
        for number, item in enumerate(tree):
            value, inner = split_sourced(item, f"{path}[{number}]")
            items.append(value)
            found.update(inner)
        return items, found
    return tree, {}
