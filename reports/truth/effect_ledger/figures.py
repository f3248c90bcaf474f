"""Figure of the report."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from cpic_planner.report import new_figure
from cpic_planner.report.drawing import BAND_STYLE

__all__ = ["size_figure"]

GROUPS = {
    "flaws of pixels": ("flat", "dark", "dark_structure", "bad_pixels", "bad_columns"),
    "charge and limits": ("smear", "cosmic_rays", "nonlinearity", "blooming", "register_full_well", "clock_charge"),
    "transfer losses": ("parallel_cti", "serial_cti"),
    "noise and bias": ("photon_noise", "em_register", "read_noise", "stripes", "interference", "bias_drift"),
    "sources": ("star", "planet"),
    "settings of the optics": ("wavelength_nodes", "pixel_nodes", "precision", "drift_epochs"),
}
LEAST = 1e-9


def size_figure(rows: list[dict[str, Any]]) -> Figure:
    """Predicted against true size of what was left out."""
    figure = new_figure(5.6)
    panel = figure.subplots()
    for (name, keys), (colour, marker) in zip(GROUPS.items(), BAND_STYLE, strict=False):
        own = [row for row in rows if row["key"] in keys and row["predicted"] > LEAST]
        panel.loglog(
            [max(row["true"], LEAST) for row in own],
            [row["predicted"] for row in own],
            ls="none",
            ms=4.5,
            marker=marker,
            color=colour,
            alpha=0.75,
            label=name,
        )
    panel.axline((1e-6, 1e-6), (1e-2, 1e-2), color="#444444", lw=1.0, label="equal")
    panel.axline((1e-6, 1e-5), (1e-2, 1e-1), color="#444444", lw=0.8, ls=":", label="ten times too large")
    panel.set_xlim(LEAST * 0.6, 1.0)
    panel.set_ylim(LEAST * 0.6, 1.0)
    panel.set_xlabel("true size, alone, in noiseless images (left edge: smaller)")
    panel.set_ylabel("predicted size")
    panel.grid(which="major")
    panel.legend(loc="lower right", title="left out or lowered")
    return figure
