"""Targets of all strategies as CSV text."""

from __future__ import annotations

import csv
import io
from typing import Any

from cpic_planner.models.surveyed import SurveyTarget, WhatIfResult

__all__ = ["TARGET_COLUMNS", "targets_csv"]

TARGET_COLUMNS: tuple[str, ...] = ("strategy", *SurveyTarget.model_fields)
"""Columns, in order: the strategy, and those of `SurveyTarget`; lists are joined with semicolons."""


def targets_csv(result: WhatIfResult) -> str:
    """Return one line for each strategy and star; units stand in the names."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(TARGET_COLUMNS)
    for strategy in result.strategies:
        for target in strategy.targets:
            writer.writerow([strategy.name, *(_cell(getattr(target, name)) for name in TARGET_COLUMNS[1:])])
    return buffer.getvalue()


def _cell(value: Any) -> Any:
    return ";".join(str(item) for item in value) if isinstance(value, list) else value
