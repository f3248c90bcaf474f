"""Every measurement of a plan or of a scene as CSV text: prediction beside what the images gave."""

from __future__ import annotations

import csv
import io
from typing import Any

from cpic_planner.models import AuditRecord, BandConfirmation, ConfirmResult, PlanResult

__all__ = ["MEASUREMENT_COLUMNS", "measurements_csv"]

_BAND_COLUMNS = tuple(name for name in BandConfirmation.model_fields if name not in ("audit", "image"))
_AUDIT_COLUMNS = tuple(AuditRecord.model_fields)
MEASUREMENT_COLUMNS: tuple[str, ...] = (
    "target",
    "hip",
    "chosen",
    *_BAND_COLUMNS,
    *(f"audit_{name}" for name in _AUDIT_COLUMNS),
)
"""Columns, in order: those of `BandConfirmation` and, with ``audit_`` before their names, of `AuditRecord`."""


def measurements_csv(result: PlanResult | ConfirmResult) -> str:
    """Return one line for each planet and band; units stand in the names, missing numbers are empty."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(MEASUREMENT_COLUMNS)
    if isinstance(result, ConfirmResult):
        rows = [_row(result.scene, None, "", band) for band in result.bands]
    else:
        rows = [
            _row(target.name, target.hip, int(band.band == target.chosen_band), band)
            for target in result.targets
            for band in target.bands
        ]
    writer.writerows(rows)
    return buffer.getvalue()


def _row(target: str, hip: int | None, chosen: int | str, band: BandConfirmation) -> list[Any]:
    cells: list[Any] = [target, hip, chosen, *(getattr(band, name) for name in _BAND_COLUMNS)]
    cells += [None if band.audit is None else getattr(band.audit, name) for name in _AUDIT_COLUMNS]
    return ["" if cell is None else int(cell) if isinstance(cell, bool) else cell for cell in cells]
