"""Make the committed reports anew and say which are older than the code: ``python -m tools.reports``.

Without arguments all reports are made, two at a time; ``make reports`` does this. ``python -m tools.reports reach
spectra`` makes some, ``--older`` those that are older than the code. What stands behind ``--`` goes to the scripts.
Reports lie in five folders: how true the answers are, how fast, the figures of the paper that the project follows,
the numbers of other people, and examples of what the commands give.

Each report has a file ``made.json`` with the digest of every file of the project that the script and its processes
read: modules, presets, tables, but not what they wrote. The digest of a module leaves out comments, docstrings and its
layout. ``--check``, part of ``make lint``, compares them with the files that are there: it names what is older, and
fails only where a report has no digests or a page quotes a file of a report that is missing.
"""

import argparse
import ast
import functools
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REPORTS = ROOT / "reports"
MADE, REPORT = "made.json", "report.md"
LANES = 2
_FOLDERS = ("cpic_core", "catalogs", "simulator", "cpic_planner", "tools", "tests", "reports")
_OWN = ("tools/reports.py", "tools/report_parts.py", "tools/recorder/")  # they decide no figure
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_QUOTED = re.compile(r"\breports/((?:\w+/)*)(\w+)\.(\w+)")
_LINKED = re.compile(r"\]\((?!https?:|#)([^)#\s]+)\)")
_MADE_PAGES = {"_made", "_build", "notebooks", "reports"}


@dataclass(frozen=True)
class Made:
    """Record of how a report was made.

    Attributes
    ----------
    seconds : float
        Processor time, all processes together.
    report : str
        Digest of ``report.md``.
    files : dict of str to str
        Digest of each file that was read, by its path in the project.
    """

    seconds: float
    report: str
    files: dict[str, str]


def digest(path: Path) -> str:
    """Return eight hexadecimal digits for the content of a file.

    Parameters
    ----------
    path : Path
        Of a module the code counts, not comments, docstrings and layout.
    """
    content = path.read_bytes()
    if path.suffix == ".py":
        content = "\0".join(_tokens(ast.parse(content))).encode(errors="surrogatepass")
    return hashlib.sha256(content).hexdigest()[:8]


def _tokens(node: object) -> Iterator[str]:
    """Yield the words of a syntax tree; a string that stands alone, as docstrings do, is left out."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return
    if isinstance(node, ast.AST):
        yield type(node).__name__
        for name, value in ast.iter_fields(node):
            if value is not None and value != []:  # newer versions of Python have more fields
                yield name
                yield from _tokens(value)
    elif isinstance(node, list):
        yield "["
        for item in node:
            yield from _tokens(item)
        yield "]"
    else:
        yield repr(node)


_digest = functools.cache(digest)


def _digest_since(path: Path, began: float) -> str:
    """Return the digest of a file that was read; of one that was changed since, nobody knows what was read."""
    return digest(path) if path.stat().st_mtime <= began else "changed while the report was made"


def folders() -> dict[str, Path]:
    """Return the folder of each committed report by its name."""
    return {path.parent.name: path.parent for path in sorted(REPORTS.rglob(REPORT))}


def names() -> list[str]:
    """Return the committed reports."""
    return sorted(folders())


def command(name: str) -> list[str]:
    """Return the arguments of Python that make a report: its script, or the tool of its name."""
    script = folders()[name] / "make.py"
    return [str(script)] if script.exists() else ["-m", f"tools.{name}"]


def read(name: str) -> Made:
    """Return how a report was made.

    Raises
    ------
    ValueError
        If nothing readable says it.
    """
    try:
        return Made(**json.loads((folders()[name] / MADE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(f"{_path(name)}/{MADE}: {error}; python -m tools.reports {name} makes it") from None


def _path(name: str) -> str:
    """Return the path of a report's folder in the project."""
    return folders()[name].relative_to(ROOT).as_posix()


def files_read(record: Iterable[str]) -> list[str]:
    """Return the paths of what was read and not written, from the lines of the recorder.

    Parameters
    ----------
    record : iterable of str
        Lines ``r path`` and ``w path``.
    """
    lines = {line.strip() for line in record}
    paths = {line[2:] for line in lines if line[:2] == "r " and f"w {line[2:]}" not in lines}
    return sorted(
        path
        for path in paths
        if path.split("/")[0] in _FOLDERS
        and not path.startswith(_OWN)
        and not path.endswith(".pyi")  # which names a package offers
        and (ROOT / path).is_file()
    )


def make(name: str, more: Sequence[str] = ()) -> tuple[float, str]:
    """Make a report and record what it was made from.

    Parameters
    ----------
    name : str
    more : sequence of str
        Arguments of its script. Where they ask for a part (``--only``), nothing is recorded.

    Returns
    -------
    tuple of float and str
        Processor time in seconds, and the end of what the script printed if it failed.
    """
    with tempfile.TemporaryDirectory() as scratch:
        record, told = Path(scratch, "files"), Path(scratch, "told")
        paths = [str(ROOT / "tools" / "recorder"), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = os.environ | dict.fromkeys(_THREADS, "1")
        environment |= {"PYTHONPATH": os.pathsep.join(paths), "CPIC_RECORDED_FILES": str(record)}
        began = time.time()
        with told.open("wb") as stream:
            process = subprocess.Popen(
                [sys.executable, *command(name), *more], cwd=ROOT, env=environment, stdout=stream, stderr=stream
            )
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = round(usage.ru_utime + usage.ru_stime, 3)
        lines = record.read_text().splitlines()
        complaint = f"exit status {process.returncode}" if process.returncode else ""
        if f"w {_path(name)}/{REPORT}" not in lines:
            complaint = complaint or f"wrote no {REPORT}"
        elif not any(word.startswith("--only") for word in more):
            files = {path: _digest_since(ROOT / path, began) for path in files_read(lines)}
            made = Made(seconds, digest(folders()[name] / REPORT), files)
            text = json.dumps(asdict(made), indent=0, sort_keys=True)
            (folders()[name] / MADE).write_text(f"{text}\n", encoding="utf-8")
        return seconds, f"{complaint}\n{told.read_text(errors='replace')[-2000:]}" if complaint else ""


def make_all(chosen: Sequence[str], more: Sequence[str] = ()) -> list[str]:
    """Make reports side by side, the longest first, and say how long each took.

    Parameters
    ----------
    chosen : sequence of str
        Names of reports.
    more : sequence of str
        Arguments of their scripts.

    Returns
    -------
    list of str
        Names of those that failed.
    """
    failed: list[str] = []
    speaking = threading.Lock()

    def one(name: str) -> None:
        began = time.monotonic()
        seconds, complaint = make(name, more)
        with speaking:
            print(f"{name:18} {time.monotonic() - began:6.0f} s, {seconds:6.0f} s of processor", flush=True)
            if complaint:
                failed.append(name)
                print(complaint, file=sys.stderr, flush=True)

    with ThreadPoolExecutor(LANES) as lanes:
        list(lanes.map(one, sorted(chosen, key=_seconds, reverse=True)))
    return failed


def _seconds(name: str) -> float:
    """Return the processor time that a report took; one that was never made comes first."""
    try:
        return read(name).seconds
    except ValueError:
        return float("inf")


def changed(name: str) -> list[str]:
    """Return the files that are other ones than when a report was made.

    Raises
    ------
    ValueError
        If nothing readable says how it was made.
    """
    made = read(name)
    files = {f"{_path(name)}/{REPORT}": made.report} | made.files
    return [path for path, was in files.items() if not (ROOT / path).is_file() or _digest(ROOT / path) != was]


def missing_quotes() -> list[str]:
    """Return what pages and reports quote and is not there, each with the page."""
    pages = [ROOT / name for name in ("README.template.md", "ARCHITECTURE.md", "CONTRIBUTING.md")]
    every = (ROOT / "docs").rglob("*.md")
    pages += [page for page in every if not _MADE_PAGES & set(page.relative_to(ROOT).parts[:-1])]
    found = []
    for page in pages:
        for folder, stem, kind in _QUOTED.findall(page.read_text(encoding="utf-8")):
            of_site = not folder and kind == "md"  # the site has all reports in one folder
            if stem not in names() if of_site else not (REPORTS / folder / f"{stem}.{kind}").exists():
                found.append(f"{page.relative_to(ROOT)} quotes reports/{folder}{stem}.{kind}, which is missing")
    for name, place in folders().items():
        for file in _LINKED.findall((place / REPORT).read_text(encoding="utf-8")):
            if not (place / file).exists():
                found.append(f"{_path(name)}/{REPORT} quotes {file}, which is missing")
    return found


def check() -> int:
    """Name the reports that are older than the code; return 1 where one cannot be followed."""
    faults, older = missing_quotes(), {}
    for name in names():
        try:
            if files := changed(name):
                older[name] = files
        except ValueError as error:
            faults.append(str(error))
    for name, files in older.items():
        more = f" and {len(files) - 3} more" if len(files) > 3 else ""
        print(f"{_path(name)} is older than {', '.join(files[:3])}{more}")
    if older:
        print(f"{len(older)} of {len(names())} reports are older than the code; make reports ONLY=--older makes them")
    print(*faults, sep="\n", end="\n" * bool(faults), file=sys.stderr)
    return int(bool(faults))


def main(argv: Sequence[str] | None = None) -> int:
    """Make reports, or say which are older than the code."""
    parser = argparse.ArgumentParser(prog="python -m tools.reports", description="Make the committed reports anew.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a report (all)")
    parser.add_argument("--older", action="store_true", help="only reports that are older than the code")
    parser.add_argument("--check", action="store_true", help="name the reports that are older than the code")
    given = list(sys.argv[1:] if argv is None else argv)
    own, more = (given[: given.index("--")], given[given.index("--") + 1 :]) if "--" in given else (given, [])
    options = parser.parse_args(own)
    if options.check:
        return check()
    if unknown := sorted(set(options.names) - set(names())):
        parser.error(f"no report is called {', '.join(unknown)}; there are {', '.join(names())}")
    chosen = options.names or names()
    if options.older:
        chosen = [name for name in chosen if not (folders()[name] / MADE).exists() or changed(name)]
    began = time.monotonic()
    failed = make_all(chosen, more)
    print(f"{len(chosen)} reports in {(time.monotonic() - began) / 60:.1f} min")
    if failed:
        print(f"failed: {', '.join(sorted(failed))}", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    raise SystemExit(main())
