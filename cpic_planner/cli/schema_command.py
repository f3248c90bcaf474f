"""``cpic schema``."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

__all__ = ["HELP", "schema"]

HELP = """Print the JSON Schema of a result: rank, etc, plan, confirm, run, simulation or check.

Example:

  cpic schema plan > plan.schema.json"""


def schema(name: Annotated[str, typer.Argument(help="rank, etc, plan, confirm, run, simulation or check")]) -> None:
    """Print one schema."""
    from cpic_planner.schemas import schema_text

    sys.stdout.write(schema_text(name))
