"""Rewrite the shipped JSON Schemas: ``python -m tools.schemas``."""

from cpic_core import write_text
from cpic_planner.schemas import FOLDER, RESULTS, generated

if __name__ == "__main__":
    for name in RESULTS:
        print(write_text(FOLDER / f"{name}.schema.json", generated(name)))
