"""Compare our numbers with those of other people, and write ``report.md``.

``python -m tools.reports external`` works our numbers out anew beside the recorded ones of the others;
``--install`` first makes an environment for each package of the others, runs it there and records what it answers
(``--only NAME`` for one of them; needs a network).
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from reports.external import comparison  # noqa: E402 (found by the line before)

HEADER = """# Other people's numbers

Every number of "theirs" was made outside this project; every number of "ours" is worked out anew by
`python -m tools.reports external`, which writes this page; with `-- --install` it runs the other codes too, each in an
environment of its own. A tolerance is what the two may differ by for the reason given; a row that is known to disagree
says why.
"""


def record(name: str) -> None:
    """Run the other code of a comparison in an environment of its own, and keep what it answers."""
    module = dict(comparison.comparisons())[name]
    print(f"{name}: installing {' '.join(module.REFERENCE.packages)}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        python = Path(folder) / "bin/python"
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", *module.REFERENCE.packages], check=True)
        if hasattr(module, "given"):
            np.savez(Path(folder) / comparison.GIVEN, **module.given())
        dropped = ("PYTHONPATH", "PYTHONHOME")
        kept = {key: value for key, value in os.environ.items() if key not in dropped} | {"OMP_NUM_THREADS": "1"}
        print(f"{name}: asking", flush=True)
        command = [str(python), str(Path(__file__).resolve()), "--peer", name]
        found = subprocess.run(command, env=kept, check=True, stdout=subprocess.PIPE, text=True, cwd=folder).stdout
    (HERE / f"recorded/{name}.json").write_text(json.dumps(json.loads(found), indent=1) + "\n", encoding="utf-8")


def answer(name: str) -> None:
    """Print what the other code answers; this process runs in its environment."""
    out, sys.stdout = sys.stdout, sys.stderr  # packages may print
    module = dict(comparison.comparisons())[name]
    found = module.peer()
    installed = {item.name for item in metadata.distributions()}
    versions = {item: metadata.version(item) for item in ("numpy", "scipy", "pandas") if item in installed}
    about = {"date": datetime.datetime.now(datetime.UTC).date().isoformat(), "versions": versions}
    print(json.dumps(about | found), file=out)


def summary(counted: list[tuple[str, str, int, int, int]]) -> str:
    """Return the table at the head of the report."""
    lines = ["| compared | with | numbers | agree | known to disagree | disagree |", "|---|---|---|---|---|---|"]
    for title, reference, agree, known, wrong in counted:
        link = f"[{title}](#{comparison.anchor(title)})"
        lines.append(f"| {link} | {reference} | {agree + known + wrong} | {agree} | {known} | {wrong} |")
    return "\n".join(lines)


def report() -> str:
    """Write the pages of all numbers, and return the text of the report."""
    (HERE / "rows").mkdir(exist_ok=True)
    sections, counted = [], []
    for name, module in comparison.comparisons():
        rows = module.rows(comparison.recorded(name))
        sections.append(comparison.section(name, module, rows))
        (HERE / f"rows/{name}.md").write_text(comparison.page(module, rows), encoding="utf-8")
        agree = sum(row.agrees for row in rows)
        known = sum(not row.agrees and not row.expected for row in rows)
        about = f"{module.REFERENCE.name} {module.REFERENCE.version}"
        counted.append((module.TITLE, about, agree, known, len(rows) - agree - known))
    return "\n".join([HEADER, summary(counted), "", "\n\n".join(sections), ""])


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--install", action="store_true", help="run the other codes anew")
    parser.add_argument("--only", choices=comparison.ORDER, help="with --install: run this one alone")
    parser.add_argument("--peer", choices=comparison.ORDER, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.peer:
        answer(asked.peer)
        return
    if asked.install:
        for name, module in comparison.comparisons():
            if hasattr(module, "peer") and asked.only in (None, name):
                record(name)
    (HERE / "report.md").write_text(report(), encoding="utf-8")


if __name__ == "__main__":
    main()
