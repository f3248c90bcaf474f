"""Figures of the report."""

from __future__ import annotations

from typing import Any

import numpy as np
from limits import Curve
from matplotlib.figure import Figure
from regimes import GAINS, REGIMES

from cpic_planner.report import new_figure
from cpic_planner.report.drawing import BAND_STYLE


def monte_carlo_figure(rows: list[dict[str, Any]], tolerance: float) -> Figure:
    """SNR of the ETC over that of the trials, regime by regime."""
    figure = new_figure(4.6)
    panel = figure.subplots()
    plain = [row for row in rows if row["reference_ratio"] == 1.0]
    panel.axhspan(1.0 - tolerance, 1.0 + tolerance, color="#EEEEEE", zorder=0)
    panel.axhline(1.0, color="#444444", lw=0.8)
    for k, gain in enumerate(GAINS):
        own = [row for row in plain if row["em_gain"] == gain]
        colour, marker = BAND_STYLE[k]
        place = np.array([REGIMES.index(row["case"]) for row in own]) + 0.13 * (k - 2)
        ratio, error = ([row[name] for row in own] for name in ("snr_etc_over_mc", "standard_error"))
        panel.errorbar(place, ratio, error, fmt=marker, color=colour, ms=4.5, lw=1.0, label=f"gain {gain:g}")
    panel.set_xticks(range(len(REGIMES)), REGIMES, rotation=30, ha="right")
    panel.set_ylabel("SNR, ETC / Monte Carlo")
    panel.set_ylim(0.955, 1.045)
    panel.grid(axis="y")
    panel.legend(ncols=5, loc="upper center")
    return figure


def limit_figure(curves: list[Curve]) -> Figure:
    """Contrast limit against the number of frames, and what the images leave."""
    figure = new_figure(5.4)
    panel = figure.subplots()
    for k, curve in enumerate(curves):
        colour, marker = BAND_STYLE[k]
        panel.loglog(
            curve.n_frames, curve.limit, color=colour, marker=marker, ms=4.5, lw=1.4, label=f"{curve.visit_nm:g} nm"
        )
        if curve.model_limit is not None and curve.model_error is not None:
            low, high = (curve.model_limit + sign * 2 * curve.model_error for sign in (-1, 1))
            panel.axhspan(low, high, color=colour, alpha=0.3, lw=0)
            panel.axhline(curve.model_limit, color=colour, ls="--", lw=1.0)
    first = curves[0]
    falling = 2.0 * first.limit[0] * (first.n_frames / first.n_frames[0]) ** -0.5
    panel.loglog(first.n_frames, falling, color="#444444", ls=":", lw=1.2, label="1 / square root of frames")
    panel.set_xlabel(f"science frames of {first.exposure_s:g} s")
    panel.set_ylabel("5 sigma contrast limit")
    panel.grid(which="major")
    panel.legend(
        title="visit offset, rms; dashed: what the images leave, ± 2 standard errors", ncols=3, loc="lower left"
    )
    return figure
