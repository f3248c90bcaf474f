"""How near a coronagraph of tables comes to the modelled one that the tables were written from, and what it costs.

Part of ``decisions.py``: ``python reports/speed_accuracy/decisions.py --only tables`` (a minute of one core).
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cpic_planner import contrast_limit, exposure_time, signal_to_noise
from cpic_planner.results import EtcAnswer
from simulator import load_instrument, write_coronagraph_table
from simulator.imaging import psf_metrics

ASKED = 5e-3
STARS = ("Procyon A", "tau Cet", "47 UMa", "HD 38529")
SEPARATIONS_ARCSEC = (0.42, 0.5, 0.65, 0.8, 0.9)
QUESTIONS: dict[str, tuple[Callable[..., list[EtcAnswer]], dict[str, Any]]] = {
    "time for SNR 5": (exposure_time, {"snr": 5, "contrast": [3e-8]}),
    "time for a detection": (exposure_time, {"detect": True, "contrast": [3e-8]}),
    "SNR in 10 h": (signal_to_noise, {"time_s": 36000, "contrast": [1e-8]}),
    "SNR in three visits of 10 h": (signal_to_noise, {"time_s": 36000, "contrast": [1e-8], "visits": 3}),
    "contrast limit in 2 h": (contrast_limit, {"time_s": 7200}),
}


def measured() -> dict[str, Any]:
    """Largest deviations of every question over bands, stars and separations, and processor times."""
    default = load_instrument()
    bands = default.visible_bands()
    with tempfile.TemporaryDirectory() as folder:
        files = {band: str(write_coronagraph_table(default, band, Path(folder) / f"{band}.csv")) for band in bands}
        tables = load_instrument({"coronagraph": {"table": files, "zone": "quadrants"}})
        began = time.process_time()
        for band in bands:
            psf_metrics(tables, band)
        made_s = (time.process_time() - began) / len(bands)
        rows = [_row(words, default, tables) for words in QUESTIONS]
    return {"rows": rows, "made_s": made_s, "bands": len(bands)}


def _row(words: str, default: Any, tables: Any) -> dict[str, Any]:
    ask, asked = QUESTIONS[words]
    worst, compared, spent, statuses = 0.0, 0, [0.0, 0.0], 0
    for star in STARS:
        for place in SEPARATIONS_ARCSEC:
            found = []
            for k, instrument in enumerate((default, tables)):
                began = time.process_time()
                shared = {"instrument": instrument, "companions": "off", "separation_arcsec": place}
                found.append(ask(star, **shared, **asked))
                spent[k] += time.process_time() - began
            for ours, theirs in zip(*found, strict=True):
                statuses += (ours.status, ours.reason, ours.verdict) != (theirs.status, theirs.reason, theirs.verdict)
                if ours.value is not None and theirs.value is not None:
                    compared += 1
                    worst = max(worst, abs(theirs.value / ours.value - 1.0))
    calls = len(STARS) * len(SEPARATIONS_ARCSEC)
    return {
        "question": words,
        "compared": compared,
        "worst": worst,
        "other_statuses": statuses,
        "modelled_ms": 1e3 * spent[0] / calls,
        "tables_ms": 1e3 * spent[1] / calls,
    }


def text(found: dict[str, Any], table: Callable[[list[str], list[list[str]]], str]) -> str:
    """Section of the report.

    Parameters
    ----------
    found : dict
        Of `measured`.
    table : callable
        Makes the lines of a table.
    """
    rows = [
        [
            row["question"],
            str(row["compared"]),
            f"{row['worst']:.1e}",
            "yes" if row["worst"] <= ASKED and not row["other_statuses"] else "**no**",
            f"{row['modelled_ms']:.0f} ms",
            f"{row['tables_ms']:.0f} ms",
        ]
        for row in found["rows"]
    ]
    head = ["question", "answers", "largest deviation", f"within {ASKED:.1%}, same verdicts"]
    head += ["processor time, modelled", "of tables"]
    return f"""
## Coronagraphs of tables

The default instrument with its coronagraph written as tables (`write_coronagraph_table`) beside itself, in its closed
forms: {found["bands"]} bands, stars of V 0.4 to 5.9, separations of {min(SEPARATIONS_ARCSEC)} to
{max(SEPARATIONS_ARCSEC)} arcsec. A call answers in all bands. The figures of a band are made of its table in
{1e3 * found["made_s"]:.0f} ms, once in a process; images have no tier: they are refused.

{table(head, rows)}
"""
