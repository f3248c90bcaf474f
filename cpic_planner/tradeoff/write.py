"""The files of a tradeoff, and reading the result back."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import ValidationError

from catalogs.errors import InputError
from catalogs.user_files import read_text
from cpic_planner.models.tradeoff import TradeoffResult
from cpic_planner.tradeoff.tables import csv_text, report_text

_MAX_BYTES = 100_000_000
RESULT = "results.json"
FILES = ("results.csv", "report.md", "pareto.png")
"""Names of the files beside the result."""


def products_of(result: TradeoffResult, *, head: str = "") -> dict[str, bytes]:
    """Return the files beside the result by their names; ``head`` stands between title and tables of the report."""
    from cpic_planner.tradeoff.figure import pareto_png

    contents = csv_text(result).encode(), report_text(result, head=head).encode(), pareto_png(result)
    return dict(zip(FILES, contents, strict=True))


def read_result(folder: Path) -> TradeoffResult | None:
    """What an earlier run wrote; None where there is nothing.

    Raises
    ------
    InputError
        If the file there is not such a result.
    """
    path = folder / RESULT
    if not path.exists():
        return None
    try:
        text = read_text(path, key="--out", allowed="a folder of an earlier tradeoff", max_bytes=_MAX_BYTES)
        return TradeoffResult.model_validate(json.loads(text))
    except (ValueError, ValidationError):
        raise InputError(
            "--out",
            str(folder),
            allowed="a folder of an earlier tradeoff, or a new one",
            hint=f"its {RESULT} is something else",
        ) from None
