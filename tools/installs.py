"""Install the built package into fresh environments and ask it three questions in each: ``python -m tools.installs``.

It builds wheel and source distribution and tries every interpreter from 3.11 that is found on the path and among
pyenv's, with the wheel, the source distribution, and the wheel on the lowest versions that the project states. It needs
a network or a cache of packages, and some minutes an environment; ``--python PATH`` and ``--kind KIND`` try one.
Questions are asked without a network, in a folder that is empty. The table that is printed has wall times, and as
answer the time for SNR 5 that the first question gave, the same in every environment.
"""

import argparse
import itertools
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tools.report_parts import table

ROOT = Path(__file__).resolve().parents[1]
LEAST = (3, 11)
STATED = re.compile(r"Python :: 3\.(\d+)")
KINDS = ("wheel", "sdist", "lowest")
QUESTIONS = {
    "etc": ("etc", "tau Cet", "--snr", "5", "--json"),
    "rank": ("rank", "--limit", "5"),
    "plan": ("plan", "--top", "1", "--out", "plan"),
}
# A proxy where nobody listens: a question that opened a connection would fail.
NO_NETWORK = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
DROPPED = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "PYTHONDONTWRITEBYTECODE", "CPIC_CACHE_DIR", "NUMBA_CACHE_DIR")


def run(command: list[str], **about: Any) -> subprocess.CompletedProcess[str]:
    """Run a command and keep what it says; it may fail."""
    return subprocess.run(command, check=False, capture_output=True, text=True, **about)


def interpreters() -> dict[tuple[int, ...], Path]:
    """Return one interpreter of each version that is found on the path and among pyenv's, ascending."""
    folders = [Path(part) for part in os.environ.get("PATH", "").split(os.pathsep)]
    folders += sorted(Path.home().glob(".pyenv/versions/*/bin"))
    found: dict[tuple[int, ...], Path] = {}
    for minor in range(30):
        for path in (folder / f"python3.{minor}" for folder in folders):
            code = "import sys, ensurepip; print(*sys.version_info[:2])"
            if not path.exists():
                continue
            answer = run([str(path), "-c", code])
            if answer.returncode == 0:
                found.setdefault(tuple(int(part) for part in answer.stdout.split()), path)
    return dict(sorted(found.items()))


def not_tried(rows: list[dict[str, Any]], found: Iterable[tuple[int, ...]]) -> str:
    """Return which interpreters were not tried and why, as a sentence; empty where all that the package states were.

    Parameters
    ----------
    rows : list of dict
        What was seen.
    found : iterable of tuple of int
        Versions of the interpreters of this machine.
    """
    versions = set(found)
    tried_ones = {(tuple(int(part) for part in str(row["python"]).split(".")[:2]), row["kind"]) for row in rows}
    seen = {version for version, _ in tried_ones}
    stated = {LEAST, *((3, int(minor)) for minor in STATED.findall((ROOT / "pyproject.toml").read_text()))}
    parts: dict[str, list[tuple[int, ...]]] = {
        "older than 3.11": sorted(version for version in versions if version < LEAST),
        "not asked for": sorted(version for version in versions - seen if version >= LEAST),
        "not on this machine": sorted(stated - versions - seen),
    }
    for kind in KINDS:
        parts[f"{kind} not asked for"] = sorted(version for version in seen if (version, kind) not in tried_ones)
    named = [f"{', '.join('.'.join(map(str, v)) for v in ones)} ({why})" for why, ones in parts.items() if ones]
    return f"Not tried: {'; '.join(named)}; other systems than {platform.system()}." if named else ""


def built(folder: Path) -> dict[str, Path]:
    """Build both distributions into a folder and return where they are."""
    subprocess.run([sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)], check=True, capture_output=True)
    return {"wheel": next(folder.glob("*.whl")), "sdist": next(folder.glob("*.tar.gz"))}


def tried(python: Path, kind: str, files: dict[str, Path], folder: Path) -> dict[str, Any]:
    """Install one kind with one interpreter, ask the questions, and return what was seen."""
    clean = {key: value for key, value in os.environ.items() if key not in DROPPED}
    clean |= {"XDG_CACHE_HOME": str(folder / "cache"), "OMP_NUM_THREADS": "1"}
    version = subprocess.run([str(python), "--version"], check=True, capture_output=True, text=True).stdout.split()[1]
    row: dict[str, Any] = {"python": version, "kind": kind}
    environment = folder / "environment"
    subprocess.run([str(python), "-m", "venv", str(environment)], check=True, env=clean)
    own = environment / "bin"
    bare = size_mb(environment)
    limits = ("--constraint", str(ROOT / "constraints-lowest.txt")) if kind == "lowest" else ()
    began = time.monotonic()
    command = [str(own / "python"), "-m", "pip", "install", "--quiet", *limits]
    command.append(str(files["sdist" if kind == "sdist" else "wheel"]))
    done = run(command, env=clean)
    row["install_s"] = round(time.monotonic() - began)
    if done.returncode:
        return row | {"failed": "install", "says": done.stderr.strip().splitlines()[-1:]}
    row["installed_mb"] = round(size_mb(environment) - bare)
    empty = folder / "asked"
    empty.mkdir()
    for name, words in QUESTIONS.items():
        began = time.monotonic()
        done = run([str(own / "cpic"), *words], env=clean | NO_NETWORK, cwd=empty)
        row[f"{name}_s"] = round(time.monotonic() - began, 1)
        if done.returncode:
            return row | {"failed": name, "says": done.stderr.strip().splitlines()[-1:]}
        if name == "etc":
            found = json.loads(done.stdout)
            best = next(answer for answer in found["answers"] if answer["band"] == found["best_band"])
            row["answer_s"] = f"{best['value']:.10g}"
    return row


def size_mb(folder: Path) -> float:
    """Return the size of all files of a folder in megabytes."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


HEADS = {
    "python": "Python",
    "kind": "kind",
    "install_s": "install (s)",
    "installed_mb": "installed (MB)",
    "etc_s": "etc (s)",
    "rank_s": "rank (s)",
    "plan_s": "plan (s)",
    "answer_s": "answer (s)",
    "failed": "failed",
}


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.installs", description="Try the package where it is installed."
    )
    parser.add_argument("--python", type=Path, action="append", help="an interpreter (all that are found)")
    parser.add_argument("--kind", choices=KINDS, action="append", help="what is installed (all)")
    asked = parser.parse_args()
    rows: list[dict[str, Any]] = []
    found = interpreters()
    pythons = asked.python or [path for version, path in found.items() if version >= LEAST]
    with tempfile.TemporaryDirectory() as name:
        files = built(Path(name))
        for python, kind in itertools.product(pythons, asked.kind or KINDS):
            with tempfile.TemporaryDirectory() as folder:
                rows.append(tried(python, kind, files, Path(folder)))
            print(json.dumps(rows[-1]), flush=True)
    print(table(list(HEADS.values()), [[row.get(name, "") for name in HEADS] for row in rows]))
    print(not_tried(rows, found))
    if any("failed" in row for row in rows):
        sys.exit("an environment does not answer: see the table")


if __name__ == "__main__":
    main()
