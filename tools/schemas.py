"""Rewrite the shipped JSON Schemas and the OpenAPI document: ``python -m tools.schemas``."""

from cpic_core import dump_json, write_text
from cpic_planner.schemas import FOLDER, OPENAPI, RESULTS, generated
from tools.openapi import described

if __name__ == "__main__":
    for name in RESULTS:
        print(write_text(FOLDER / f"{name}.schema.json", generated(name)))
    print(write_text(OPENAPI, dump_json(described())))
