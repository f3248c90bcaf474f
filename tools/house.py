"""Show what a change adds to the house beside its parent: ``python -m tools.house [PARENT]``. Nothing here fails.

By room: lines of code and modules. For the whole: pairs of classes that are nearly equal, file names that stand in
several rooms, and circles of imports.
"""

from __future__ import annotations

import ast
import functools
import io
import subprocess
import sys
import tarfile
import tempfile
import tokenize
from collections import Counter, defaultdict
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("cpic_core", "catalogs", "simulator", "cpic_planner")
BESIDE = ("tests", "tools", "reports")
LEAST_FIELDS, LEAST_SHARED = 5, 6
_SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@functools.cache
def code_lines(text: str) -> int:
    """Return how many lines of a module hold code: no docstring, no comment, not blank."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _SILENT:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            lines -= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return len(lines)


def sources(root: Path, tops: tuple[str, ...]) -> dict[str, str]:
    """Return the text of each module below some folders, by its path from ``root``."""
    return {
        path.relative_to(root).as_posix(): path.read_text(encoding="utf-8")
        for top in tops
        for path in sorted((root / top).rglob("*.py"))
    }


def room_of(path: str) -> str:
    """Return the package of a module two levels deep, as simulator/imaging."""
    return "/".join(path.split("/")[:-1][:2])


def sizes(texts: dict[str, str]) -> dict[str, tuple[int, int]]:
    """Return code lines and modules of each room."""
    lines, modules = Counter[str](), Counter[str]()
    for path, text in texts.items():
        lines[room_of(path)] += code_lines(text)
        modules[room_of(path)] += 1
    return {room: (lines[room], modules[room]) for room in sorted(modules)}


def near_equal(texts: dict[str, str]) -> list[tuple[int, str, str]]:
    """Return pairs of classes that share six fields or more, and half of those of the smaller one.

    A class that inherits from the other does not count: its shared fields are said once.
    """
    fields = {}
    for path, text in texts.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ClassDef):
                own = {
                    s.target.id for s in node.body if isinstance(s, ast.AnnAssign) and isinstance(s.target, ast.Name)
                }
                if len(own) >= LEAST_FIELDS:
                    fields[f"{path}:{node.name}"] = own
    pairs = [
        (len(a & b), one, other)
        for (one, a), (other, b) in combinations(fields.items(), 2)
        if len(a & b) >= LEAST_SHARED and 2 * len(a & b) >= min(len(a), len(b))
    ]
    return sorted(pairs, reverse=True)


def repeated_names(texts: dict[str, str]) -> dict[str, int]:
    """Return the file names that stand in two rooms or more, and in how many."""
    names = Counter(path.rpartition("/")[2] for path in texts)
    return {name: count for name, count in sorted(names.items()) if count > 1 and not name.startswith("__")}


def circles(root: Path, texts: dict[str, str]) -> list[list[str]]:
    """Return the sets of modules that import each other in circles, largest first; lazy names are followed."""
    modules = {path.removesuffix(".py").removesuffix("/__init__").replace("/", "."): path for path in texts}
    lazy: dict[str, dict[str, str]] = defaultdict(dict)
    for module, path in modules.items():
        stub = root / (path + "i")
        if path.endswith("__init__.py") and stub.exists():
            for node in ast.walk(ast.parse(stub.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.module:
                    source = node.module if node.level == 0 else f"{module}.{node.module}"
                    lazy[module] |= {alias.asname or alias.name: source for alias in node.names}
    numbers = {module: index for index, module in enumerate(modules)}
    edges = set()
    for module, path in modules.items():
        for node in ast.walk(ast.parse(texts[path])):
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    edges.add((module, _place(node.module, alias.name, modules, lazy)))
            elif isinstance(node, ast.Import):
                edges |= {(module, alias.name) for alias in node.names}
    pairs = np.array([(numbers[a], numbers[b]) for a, b in edges if b in numbers and a != b]).T
    graph = coo_array((np.ones(pairs.shape[1]), pairs), shape=(len(numbers), len(numbers)))
    _, labels = connected_components(graph, connection="strong")
    groups = defaultdict(list)
    for module, label in zip(modules, labels, strict=True):
        groups[label].append(module)
    return sorted((group for group in groups.values() if len(group) > 1), key=len, reverse=True)


def _place(package: str, name: str, modules: dict[str, str], lazy: dict[str, dict[str, str]]) -> str:
    """Return the module in which an imported name is defined."""
    if f"{package}.{name}" in modules:
        return f"{package}.{name}"
    source = lazy.get(package, {}).get(name)
    return package if source in (None, package) else _place(source, name, modules, lazy)


def main(words: list[str]) -> None:
    """Print what stands here beside the parent."""
    parent = words[0] if words else "HEAD~1"
    archive = subprocess.run(["git", "archive", parent], cwd=ROOT, capture_output=True, check=True).stdout
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(folder, filter="data")
        before, now = (_house(root) for root in (Path(folder), ROOT))
    print(f"code lines and modules, {parent} -> here")
    for room in sorted(before[0].keys() | now[0].keys()):
        old, new = before[0].get(room, (0, 0)), now[0].get(room, (0, 0))
        if old != new:
            print(f"  {room:28}{old[0]:7} {old[1]:4}  ->{new[0]:7} {new[1]:4}   {new[0] - old[0]:+d}")
    for tops in (PRODUCT, BESIDE):
        sums = [
            [sum(size[i] for room, size in house[0].items() if room.split("/")[0] in tops) for i in (0, 1)]
            for house in (before, now)
        ]
        print(f"  {' '.join(tops)}: {sums[0][0]} in {sums[0][1]} -> {sums[1][0]} in {sums[1][1]}")
    for what, index in (("pairs of nearly equal classes", 1), ("file names in several rooms", 2)):
        print(f"{what}: {len(before[index])} -> {len(now[index])}")
        for entry in now[index]:
            if entry not in before[index]:
                print(f"  new: {entry}")
    print(f"circles of imports, modules in each: {[len(c) for c in before[3]]} -> {[len(c) for c in now[3]]}")


def _house(root: Path) -> tuple[dict[str, tuple[int, int]], list[tuple[str, str]], list[str], list[list[str]]]:
    texts = sources(root, PRODUCT)
    return (
        sizes(texts | sources(root, BESIDE)),
        [(one, other) for _, one, other in near_equal(texts)],
        list(repeated_names(texts)),
        circles(root, texts),
    )


if __name__ == "__main__":
    main(sys.argv[1:])
