"""Run the long proofs and keep what they found: ``python -m tools.proofs`` (``make test-long``).

A proof is a file of tests with ones that are marked ``long``. Its evidence in ``reports/long_proofs`` holds the result
of each of them, the figures that it recorded (``record_property``), and a digest of the code that it proves: its own
file and fixtures, and the modules that it imports itself or mirrors; or the modules and packages that it names in
``PROVES``. The digest is that of the syntax trees without docstrings and comments, so that words may change.

Only proofs whose evidence is missing, older than the code or not of success are run, all with ``--all``. ``--check``
runs nothing and fails if there are any.
"""

import argparse
import ast
import functools
import hashlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
TESTS, EVIDENCE = "tests", Path("reports") / "long_proofs"
PACKAGES = ("cpic_core", "catalogs", "simulator", "cpic_planner", "tools")
_SCHEMA_VERSION = 1
_GOOD = "passed"


def long_proofs(root: Path) -> list[Path]:
    """Return the files of tests that have a long one."""
    return [path for path in sorted((root / TESTS).rglob("test_*.py")) if _is_long(_tree(path))]


def _is_long(tree: ast.Module) -> bool:
    marks = (node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr == "long")
    return any(isinstance(node.value, ast.Attribute) and node.value.attr == "mark" for node in marks)


def proved(path: Path, root: Path) -> list[Path]:
    """Return the files whose change makes the evidence of a proof old, the proof itself first.

    Parameters
    ----------
    path : Path
        File of tests.
    root : Path
        Top of the repository.

    Raises
    ------
    ValueError
        If it names a module that is not there, or proves none.
    """
    tree, tests = _tree(path), root / TESTS
    folders = [folder for folder in path.parents if folder == tests or tests in folder.parents]
    fixtures = [folder / "conftest.py" for folder in folders if (folder / "conftest.py").is_file()]
    names = _named(tree)
    if names is None:
        mirror = ".".join([*path.relative_to(tests).parts[:-1], path.stem.removeprefix("test_")])
        names = [name for name in (mirror, *_imported(tree, root)) if (file := _file_of(name, root)) and file.is_file()]
        files = [_file_of(name, root) for name in names]
    else:
        files = [file for name in names for file in _files_of(name, root, path)]
    found = sorted(file for file in files if file is not None)
    if not found:
        raise ValueError(f"{path.relative_to(root)} proves no module: it needs PROVES")
    return list(dict.fromkeys([path, *fixtures, *found]))


def _named(tree: ast.Module) -> list[str] | None:
    """Return the modules and packages of ``PROVES``, None if the file has none."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and any(isinstance(to, ast.Name) and to.id == "PROVES" for to in node.targets):
            return list(ast.literal_eval(node.value))
    return None


def _imported(tree: ast.Module, root: Path) -> Iterator[str]:
    """Yield the modules that a file imports, those behind the names of a room too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            homes = _homes(node.module, root)
            yield from (homes.get(alias.name, f"{node.module}.{alias.name}") for alias in node.names)


def _homes(package: str, root: Path) -> dict[str, str]:
    """Return the modules of the names that the stub of a package lists."""
    stub = root.joinpath(*package.split("."), "__init__.pyi")
    if not stub.is_file():
        return {}
    imports = (node for node in _tree(stub).body if isinstance(node, ast.ImportFrom))
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def _file_of(name: str, root: Path) -> Path | None:
    """Return the file of a module or package of ours, None for others."""
    if name.split(".")[0] not in PACKAGES:
        return None
    place = root.joinpath(*name.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def _files_of(name: str, root: Path, path: Path) -> list[Path]:
    """Return the files of a module or of a whole package that a proof names."""
    file = _file_of(name, root)
    if file is None or not file.is_file():
        raise ValueError(f"{path.relative_to(root)} proves {name}, which is no module of {', '.join(PACKAGES)}")
    return sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]


def digest_of(files: Sequence[Path], root: Path) -> str:
    """Return the sha256 of what some files do, their docstrings and comments apart.

    Parameters
    ----------
    files : sequence of Path
        Python files.
    root : Path
        Top of the repository; the places of the files below it count.
    """
    named = ((json.dumps(file.relative_to(root).as_posix()), file.read_text(encoding="utf-8")) for file in files)
    text = "[" + ", ".join(f"[{name}, {_without_words(content)}]" for name, content in named) + "]"
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


@functools.cache
def _without_words(text: str) -> str:
    """Return what a file says to the interpreter, as JSON; many proofs share their modules."""
    return json.dumps(_plain(ast.parse(text)))


def _tree(path: Path) -> ast.Module:
    return _parsed(path.read_text(encoding="utf-8"))


@functools.cache
def _parsed(text: str) -> ast.Module:
    """Return the syntax tree of a file; many proofs import by the same stubs."""
    return ast.parse(text)


def _plain(node: object) -> object:
    """Return a syntax tree as lists; strings that stand alone and fields that are empty are left out."""
    if isinstance(node, list):
        return [_plain(item) for item in node if not _is_words(item)]
    if isinstance(node, ast.AST):
        fields = ((name, _plain(value)) for name, value in ast.iter_fields(node))
        return [type(node).__name__, *([name, value] for name, value in fields if value not in (None, []))]
    return node if node is None or isinstance(node, str) else repr(node)


def _is_words(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def old(root: Path) -> dict[str, str]:
    """Return the proofs whose evidence does not hold, with the reason."""
    kept, found = evidence(root), {}
    for path in long_proofs(root):
        name = path.relative_to(root).as_posix()
        if name not in kept:
            found[name] = "no evidence"
        elif kept[name]["digest"] != digest_of(proved(path, root), root):
            found[name] = "older than the code"
        elif bad := [test for test, item in kept[name]["tests"].items() if item["result"] != _GOOD]:
            found[name] = f"{kept[name]['tests'][bad[0]]['result']}: {bad[0]}"
    return found


def evidence(root: Path) -> dict[str, Any]:
    """Return the evidence that is kept, by file of tests."""
    path = root / EVIDENCE / "proofs.json"
    if not path.is_file():
        return {}
    proofs: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["proofs"]
    return proofs


def prove(root: Path, names: Sequence[str], *, workers: int = 2) -> None:
    """Run proofs and write their evidence beside that of the others; what is no proof any more is dropped.

    Parameters
    ----------
    root : Path
        Top of the repository.
    names : sequence of str
        Files of tests, as `old` names them.
    workers : int
        Processes of pytest.
    """
    digests = {name: digest_of(proved(root / name, root), root) for name in names}  # of the code that is run
    found = _run(root, names, workers)
    kept = evidence(root)
    for name in names:
        files = [file.relative_to(root).as_posix() for file in proved(root / name, root)]
        kept[name] = {"digest": digests[name], "files": files, "tests": found.get(name, {"-": {"result": "not run"}})}
    there = {path.relative_to(root).as_posix() for path in long_proofs(root)}
    kept = {name: kept[name] for name in sorted(there & set(kept))}
    folder = root / EVIDENCE
    folder.mkdir(parents=True, exist_ok=True)
    document = {"schema_version": _SCHEMA_VERSION, "proofs": kept}
    (folder / "proofs.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    (folder / "report.md").write_text(report(kept), encoding="utf-8")


def _run(root: Path, names: Sequence[str], workers: int) -> dict[str, dict[str, Any]]:
    """Return result and figures of each long test by file and name."""
    command = [sys.executable, "-m", "pytest", "-q", "-m", "long"]
    if workers > 1 and importlib.util.find_spec("xdist"):
        command += ["--numprocesses", str(workers), "--dist", "worksteal"]
    with tempfile.TemporaryDirectory() as scratch:
        listing = Path(scratch) / "results.xml"
        kept = [
            f"--junit-xml={listing}",
            "--override-ini",
            "junit_family=xunit1",
        ]
        subprocess.run([*command, *kept, *names], cwd=root, env=os.environ, check=False)
        cases = list(ElementTree.parse(listing).iter("testcase")) if listing.is_file() else []  # noqa: S314 - pytest wrote it
    files = {name.removesuffix(".py").replace("/", "."): name for name in names}
    found: dict[str, dict[str, Any]] = {}
    for case in cases:
        name = files.get(case.get("classname", ""))
        if name is not None:
            verdict = next((kind for kind in ("failure", "error", "skipped") if case.find(kind) is not None), _GOOD)
            figures = {item.get("name", ""): item.get("value", "") for item in case.iter("property")}
            found.setdefault(name, {})[case.get("name", "")] = {"result": verdict, "figures": figures}
    return {name: dict(sorted(tests.items())) for name, tests in found.items()}


def report(kept: Mapping[str, Any]) -> str:
    """Return the page of the evidence.

    Parameters
    ----------
    kept : mapping of str to dict
        Evidence by file of tests.
    """
    lines = [
        "# Long proofs",
        "",
        "Regenerate with `make test-long`; everything below is written by it. What these proofs found holds for the",
        "code of the digest: that of the syntax trees of the proof and of the modules that it proves (listed in",
        "`proofs.json`), without docstrings and comments.",
        "",
        "| proof | result | figures | modules | digest |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, item in kept.items():
        modules = sum(not file.startswith(f"{TESTS}/") for file in item["files"])
        for test, one in item["tests"].items():
            figures = "; ".join(f"{key} {value}" for key, value in one.get("figures", {}).items())
            place = f"`{name.removeprefix(f'{TESTS}/')}`: {test}"
            lines.append(f"| {place} | {one['result']} | {figures} | {modules} | {item['digest'][:12]} |")
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str] | None = None) -> int:
    """Run what is old, or say that there is something old (exit code 1)."""
    parser = argparse.ArgumentParser(prog="python -m tools.proofs", description="Run the long proofs.")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", action="store_true", help="run nothing, fail if evidence is older than the code")
    what.add_argument("--all", action="store_true", help="run every proof")
    parser.add_argument("--only", nargs="+", metavar="FILE", help="files of tests to run")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes of pytest")
    options = parser.parse_args(argv)
    if not options.check:
        names = [path.relative_to(ROOT).as_posix() for path in long_proofs(ROOT)] if options.all else list(old(ROOT))
        names = [name for name in names if not options.only or name in options.only]
        if names:
            prove(ROOT, names, workers=options.workers)
    left = {name: why for name, why in old(ROOT).items() if not options.only or name in options.only}
    for name, why in left.items():
        print(f"{name}: {why}", file=sys.stderr)
    if left and options.check:
        print("run make test-long", file=sys.stderr)
    return 1 if left else 0


if __name__ == "__main__":
    raise SystemExit(main())
