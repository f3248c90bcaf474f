"""Test the law of detection on images of random scenes: ``python -m tools.detection_law``.

Each cell is a star, band, drift and number of visits drawn at random, some with a companion or a star behind them.
Planets at random places are put one at a time into its stacks, which are searched blind and judged at the known place.

Writes ``reports/truth/detection_law/law.json``, ``report.md`` and ``map.png``. ``--write`` predicts anew and writes the
report of what was measured, ``--resume`` measures the cells that are missing first.
"""

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from cpic_core import write_text
from tools.detection_law.cells import measured
from tools.detection_law.report import predicted, text, write_map

FOLDER = Path(__file__).resolve().parents[2] / "reports" / "detection_law"
CELLS, STACKS, PLANETS = 120, 50, 8


def _measure(known: dict[str, Any], count: int) -> dict[str, Any]:
    """Return all cells, those that are known as they are."""
    began = time.perf_counter()
    missing = [number for number in range(count) if str(number) not in known["cells"]]
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        jobs = {number: pool.submit(measured, number, STACKS, PLANETS) for number in missing}
        for number, job in jobs.items():
            known["cells"][str(number)] = job.result()
    known["stacks"] = STACKS
    known["minutes"] = known.get("minutes", 0.0) + (time.perf_counter() - began) / 60.0
    return known


def main() -> None:
    """Measure, or write the report of what was measured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--resume", action="store_true", help="measure what law.json does not hold yet")
    parser.add_argument("--write", action="store_true", help="write the report of what law.json holds")
    parser.add_argument("--cells", type=int, default=CELLS, help="number of random scenes")
    asked = parser.parse_args()
    file = FOLDER / "law.json"
    known = json.loads(file.read_text(encoding="utf-8")) if asked.resume or asked.write else {"cells": {}}
    if not asked.write:
        known = _measure(known, asked.cells)
        lines = (f"{json.dumps(number)}: {json.dumps(cell)}" for number, cell in known["cells"].items())
        head = f'{{"minutes": {known["minutes"]:.1f}, "stacks": {STACKS}, "cells": {{\n'
        write_text(file, head + ",\n".join(lines) + "\n}}\n")
    rows = predicted(known["cells"].values())
    write_map(rows, FOLDER / "map.png")
    write_text(FOLDER / "report.md", text(rows, known))


if __name__ == "__main__":
    main()
