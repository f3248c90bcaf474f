"""Rewrite the shipped JSON Schemas: ``python -m cpic_planner.schemas``."""

from cpic_planner.schemas import write_all

for path in write_all():
    print(path)
