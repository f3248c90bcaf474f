"""Measure the law of detection on stacks of visits: ``python -m tools.detection_law``.

Stacks of V science and V reference visits are searched blind, without planets for false alarms and with four planets
each, which are also measured at their place, for the probability of a detection. A visit is the star behind the mask to
second order in its own wavefront offset, drawn from a pool, plus white noise of the camera; science and reference have
nothing in common.

Writes ``reports/detection_law/law.json`` and ``report.md``; the fitted numbers go by hand to the preset strategy
``default``. ``--resume`` measures what ``law.json`` does not hold yet, and ``--write`` nothing.
"""

import argparse
import json

from cpic_core import write_text
from tools.detection_law.fit import MODES, fitted, table_of
from tools.detection_law.measure import FILE, empty, kept, measure
from tools.detection_law.report import text


def main() -> None:
    """Measure, or write the report of what was measured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--resume", action="store_true", help="measure what law.json does not hold yet")
    only.add_argument("--write", action="store_true", help="fit and write the report of what law.json holds")
    asked = parser.parse_args()
    found = json.loads(FILE.read_text(encoding="utf-8")) if asked.resume or asked.write else empty()
    if not asked.write:
        measure(found)
    rows = table_of(found, ("fit",))
    found["law"] = {name: value for mode in MODES for name, value in fitted(rows, mode).items()}
    kept(found)
    write_text(FILE.with_name("report.md"), text(found))


if __name__ == "__main__":
    main()
