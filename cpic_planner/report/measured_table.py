"""Every measurement of a plan or of a scene as CSV text: prediction beside what the images gave."""

from __future__ import annotations

import csv
import io
from typing import Any

from cpic_planner.models import AuditRecord, BandConfirmation, ConfirmResult, PlanResult
from simulator.knobs import Quantity

__all__ = ["MEASUREMENT_COLUMNS", "measurements_csv"]

_BAND_COLUMNS = tuple(name for name in BandConfirmation.model_fields if name not in ("audit", "modelled", "image"))
_AUDIT_COLUMNS = tuple(AuditRecord.model_fields)
_MODEL_COLUMNS = ("fidelity", "region", "epochs")
_KNOB_COLUMNS = ("pupil_samples", "wavelength_nodes", "pixel_nodes", "precision")
_ERROR_COLUMNS: tuple[Quantity, ...] = ("planet_flux", "snr")
MEASUREMENT_COLUMNS: tuple[str, ...] = (
    "target",
    "hip",
    "chosen",
    *_BAND_COLUMNS,
    *_MODEL_COLUMNS,
    *_KNOB_COLUMNS,
    *(f"predicted_error_{name}" for name in _ERROR_COLUMNS),
    *(f"audit_{name}" for name in _AUDIT_COLUMNS),
)
"""Columns, in order: those of `BandConfirmation`, of its `ModellingRecord`, and, with ``audit_`` before their names, of
`AuditRecord`."""


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
    made = band.modelled
    cells += [None if made is None else getattr(made, name) for name in _MODEL_COLUMNS]
    cells += [None if made is None else getattr(made.knobs, name) for name in _KNOB_COLUMNS]
    cells += [None if made is None else made.predicted_error.get(name) for name in _ERROR_COLUMNS]
    cells += [None if band.audit is None else getattr(band.audit, name) for name in _AUDIT_COLUMNS]
    return ["" if cell is None else int(cell) if isinstance(cell, bool) else cell for cell in cells]
