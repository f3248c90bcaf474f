"""The four files of a tradeoff, and reading them back."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import ValidationError

from catalogs.errors import InputError
from catalogs.user_files import read_text
from cpic_planner.models.tradeoff import TradeoffResult
from cpic_planner.tradeoff.tables import csv_text, report_text
from simulator.files import dump_json, write_bytes, write_text

__all__ = ["FILES", "read_result", "write_numbers", "write_result"]

_MAX_BYTES = 100_000_000
FILES = ("results.csv", "results.json", "report.md", "pareto.png")


def write_numbers(result: TradeoffResult, folder: Path) -> None:
    """The numbers alone: results.json and results.csv."""
    write_text(folder / "results.json", dump_json(result.model_dump(mode="json")))
    write_text(folder / "results.csv", csv_text(result))


def write_result(result: TradeoffResult, folder: Path, *, head: str = "") -> list[Path]:
    """Write numbers, report and figure; returns their paths."""
    from cpic_planner.tradeoff.figure import pareto_png

    write_numbers(result, folder)
    write_text(folder / "report.md", report_text(result, head=head))
    write_bytes(folder / "pareto.png", pareto_png(result))
    return [folder / name for name in FILES]


def read_result(folder: Path) -> TradeoffResult | None:
    """What an earlier run wrote; None where there is nothing.

    Raises
    ------
    InputError
        If the file there is not such a result.
    """
    path = folder / "results.json"
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
            hint="its results.json is something else",
        ) from None
