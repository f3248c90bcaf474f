"""``cpic schema``."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

HELP = """Print the JSON Schema of a result: rank, etc, plan, confirm, run, simulation, check and others; or of a
question, which is what options, keywords and YAML files of a command can say: etc-question, rank-question and so on.

Examples:

  cpic schema plan > plan.schema.json

  cpic schema etc-question"""


def schema(
    name: Annotated[
        str, typer.Argument(help="rank, etc, plan, confirm, run, simulation or check; or etc-question ...")
    ],
) -> None:
    """Print one schema."""
    from cpic_planner.queries import question_schema
    from cpic_planner.schemas import schema_text

    sys.stdout.write(question_schema(name) if name.endswith("-question") else schema_text(name))
