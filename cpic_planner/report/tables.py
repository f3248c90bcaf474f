"""The ranking as CSV and ECSV text."""

from __future__ import annotations

import csv
import io
from typing import Any

from cpic_planner.models import RankedTarget, RankResult

__all__ = ["COLUMN_UNITS", "ranking_csv", "ranking_ecsv"]

#: Unit of every column (VOUnit spelling; empty: none). The one place where the ranking's units are listed.
COLUMN_UNITS: dict[str, str] = {
    "rank": "",
    "score": "",
    "name": "",
    "hip": "",
    "v_mag": "mag",
    "sp_type": "",
    "distance_pc": "pc",
    "ra_deg": "deg",
    "dec_deg": "deg",
    "separation_arcsec": "arcsec",
    "contrast": "",
    "band": "",
    "snr": "",
    "significance": "",
    "threshold": "",
    "detection_margin": "",
    "status": "",
    "reason": "",
    "verdict": "",
    "verdict_mode": "",
    "detection_probability": "",
    "detection_probability_known_place": "",
    "limited_by": "",
    "contrast_limit": "",
    "deepest_limit": "",
    "deepest_separation_arcsec": "arcsec",
    "detection_time_s": "s",
    "completeness": "",
    "completeness_error": "",
    "completeness_band": "",
    "completeness_time_s": "s",
    "completeness_per_hour": "1/h",
    "expected_detections": "",
    "exposure_s": "s",
    "n_frames": "",
    "em_gain": "",
    "integration_s": "s",
    "time_s": "s",
    "ref_planet_distance_au": "AU",
    "ref_planet_insolation_au": "AU",
    "luminosity_lsun": "solLum",
    "companion_separation_arcsec": "arcsec",
    "flags": "",
}
FLAG_SEPARATOR = "|"
_INTEGERS = frozenset({"rank", "hip", "n_frames"})
_TEXTS = frozenset(
    {
        "name",
        "sp_type",
        "band",
        "completeness_band",
        "status",
        "reason",
        "verdict",
        "verdict_mode",
        "limited_by",
        "flags",
    }
)


def _cell(row: RankedTarget, column: str) -> Any:
    value = getattr(row, column)
    if value is None and column in _TEXTS:
        return ""
    return FLAG_SEPARATOR.join(value) if column == "flags" else value


def ranking_csv(rank: RankResult) -> str:
    """Return the ranking as CSV: one line a target, header with units in the names, empty cells for null.

    Numbers keep full precision (shortest text that reads back to the same double); flags are joined with ``|``.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMN_UNITS)
    for row in rank.targets:
        cells = (_cell(row, column) for column in COLUMN_UNITS)
        writer.writerow(["" if cell is None else cell for cell in cells])
    return buffer.getvalue()


def ranking_ecsv(rank: RankResult) -> str:
    """Return the ranking as ECSV 1.0: units and descriptions of every column, and what the ranking is, in the header.

    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked.
    """
    import numpy as np
    from astropy.table import Column, MaskedColumn, Table

    table = Table()
    for name, unit in COLUMN_UNITS.items():
        cells = [_cell(row, name) for row in rank.targets]
        described = {"name": name, "unit": unit or None, "description": RankedTarget.model_fields[name].description}
        if name in _TEXTS:
            table[name] = Column(np.array(cells, dtype=str), **described)
            continue
        missing = [cell is None for cell in cells]
        filled = np.array(
            [0 if cell is None else cell for cell in cells], dtype=np.int64 if name in _INTEGERS else np.float64
        )
        table[name] = MaskedColumn(filled, mask=missing, **described) if any(missing) else Column(filled, **described)
    table.meta.update(_meta(rank))
    buffer = io.StringIO()
    table.write(buffer, format="ascii.ecsv", delimiter=",")
    return buffer.getvalue()


def _meta(rank: RankResult) -> dict[str, Any]:
    """What the numbers refer to; plain values only."""
    return {
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
