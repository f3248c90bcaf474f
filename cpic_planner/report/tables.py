"""Results as files: the ranking, every measurement of images, and the targets of survey strategies."""

from __future__ import annotations

from typing import Any

from cpic_planner.models import AuditRecord, BandConfirmation, ConfirmResult, PlanResult, RankedTarget, RankResult
from cpic_planner.models.surveyed import SurveyTarget, WhatIfResult
from cpic_planner.models.table import csv_text, ecsv_text, names_of, values_of
from simulator.knobs import Quantity

FLAG_SEPARATOR = "|"
_MODEL_COLUMNS = ("fidelity", "region", "epochs")
_KNOB_COLUMNS = ("pupil_samples", "wavelength_nodes", "pixel_nodes", "precision")
_ERROR_COLUMNS: tuple[Quantity, ...] = ("planet_flux", "snr")
MEASUREMENT_COLUMNS: tuple[str, ...] = (
    "target",
    "hip",
    "chosen",
    *(name for name in names_of(BandConfirmation) if name != "image"),
    *_MODEL_COLUMNS,
    *_KNOB_COLUMNS,
    *(f"predicted_error_{name}" for name in _ERROR_COLUMNS),
    *names_of(AuditRecord, before="audit_"),
)
"""Columns, in order: those of `BandConfirmation`, of its `ModellingRecord`, and, with ``audit_`` before their names, of
`AuditRecord`."""


def ranking_csv(rank: RankResult) -> str:
    """Return the ranking as CSV: one line a target, header with units in the names, empty cells for null.

    Numbers keep full precision (shortest text that reads back to the same double); flags are joined with ``|``.
    """
    return csv_text(names_of(RankedTarget), map(values_of, rank.targets), joined=FLAG_SEPARATOR)


def ranking_ecsv(rank: RankResult) -> str:
    """Return the ranking as ECSV 1.0: units and descriptions of every column, and what the ranking is, in the header.

    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked.
    """
    meta = {
        "schema_version": rank.schema_version,
        "config_hash": rank.config_hash,
        "catalogue": rank.catalogue,
        "sample": rank.sample,
        "wall_time_s": rank.time_s,
        "sigma": rank.sigma,
        "reference_library": rank.reference_library,
        "reference_planet": rank.reference_planet.model_dump(mode="json"),
        "population": rank.population.model_dump(mode="json"),
        "score_name": rank.score_name,
        "flag_separator": FLAG_SEPARATOR,
    }
    return ecsv_text(RankedTarget, rank.targets, meta, joined=FLAG_SEPARATOR)


def measurements_csv(result: PlanResult | ConfirmResult) -> str:
    """Return one line for each planet and band; units stand in the names, missing numbers are empty."""
    if isinstance(result, ConfirmResult):
        rows = [_measured(band) | {"target": result.scene} for band in result.bands]
    else:
        rows = [
            _measured(band) | {"target": target.name, "hip": target.hip, "chosen": band.band == target.chosen_band}
            for target in result.targets
            for band in target.bands
        ]
    return csv_text(MEASUREMENT_COLUMNS, rows)


def _measured(band: BandConfirmation) -> dict[str, Any]:
    cells = values_of(band)
    if (made := band.modelled) is not None:
        cells |= {name: getattr(made, name) for name in _MODEL_COLUMNS}
        cells |= {name: getattr(made.knobs, name) for name in _KNOB_COLUMNS}
        cells |= {f"predicted_error_{name}": made.predicted_error.get(name) for name in _ERROR_COLUMNS}
    return cells | ({} if band.audit is None else values_of(band.audit, before="audit_"))


def targets_csv(result: WhatIfResult) -> str:
    """Return one line for each strategy and star; units stand in the names, lists are joined with semicolons."""
    rows = ({"strategy": item.name} | values_of(target) for item in result.strategies for target in item.targets)
    return csv_text(("strategy", *names_of(SurveyTarget)), rows)
