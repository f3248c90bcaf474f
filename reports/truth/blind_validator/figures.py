"""Figures of the report."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cpic_planner.report import new_figure
from cpic_planner.report.drawing import BAND_STYLE
from cpic_planner.report.words import pretty_name

__all__ = ["null_figure", "pull_figure"]

Row = dict[str, Any]
GREY = "#444444"


def pull_figure(rows: list[Row], bands: tuple[str, ...]) -> Figure:
    """Histograms of deviations over errors."""
    figure = new_figure(3.4)
    panels = figure.subplots(1, 3, sharey=True)
    edges = np.linspace(-4.5, 4.5, 37)
    middle = 0.5 * (edges[1:] + edges[:-1])
    for panel, name in zip(panels, ("flux", "separation", "position angle"), strict=True):
        for k, band in enumerate(bands):
            own = [row for row in rows if row["band"] == band]
            if name == "flux":
                pull = [(row["relative_flux"] - 1.0) / row["relative_error"] for row in own]
            else:
                pull = [row["radial_pull" if name == "separation" else "tangential_pull"] for row in own]
            density, _ = np.histogram(pull, edges, density=True)
            panel.step(middle, density, where="mid", color=BAND_STYLE[k][0], lw=1.2, label=band)
        panel.plot(
            middle, np.exp(-(middle**2) / 2) / np.sqrt(2 * np.pi), color=GREY, ls="--", lw=1.0, label="normal law"
        )
        panel.set_xlabel(f"{name}: deviation / error")
        panel.grid(axis="y")
    panels[0].set_ylabel("density")
    panels[2].legend(fontsize=7.5)
    return figure


def null_figure(rows: list[Row]) -> Figure:
    """False alarms per element against the level."""
    figure = new_figure(4.2)
    panel = figure.subplots()
    levels = sorted({row["level"] for row in rows})
    for k, (star, band) in enumerate(dict.fromkeys((row["star"], row["band"]) for row in rows)):
        own = [row for row in rows if (row["star"], row["band"]) == (star, band)]
        place = np.array([row["level"] for row in own]) + 0.03 * (k - 1.5)
        found, elements = (np.array([row[name] for row in own], float) for name in ("found", "elements"))
        rate, error = np.maximum(found, 1e-9) / elements, np.sqrt(found) / elements
        colour, marker = BAND_STYLE[k]
        seen = found > 0
        panel.errorbar(
            place[seen],
            rate[seen],
            np.minimum(error, 0.9 * rate)[seen],
            fmt=marker,
            color=colour,
            ms=5,
            label=f"{pretty_name(star)}, {band}",
        )
        none = 3.0 / elements[~seen]
        panel.errorbar(place[~seen], none, 0.5 * none, uplims=True, fmt="none", color=colour)
    from scipy.stats import norm

    fine = np.linspace(levels[0] - 0.2, levels[-1] + 0.2, 60)
    panel.plot(fine, norm.sf(fine), color=GREY, ls="--", lw=1.0, label="normal law")
    panel.set_yscale("log")
    panel.set_ylim(1e-7, 1e-2)
    panel.set_xlabel("level of the search (sigma-equivalent)")
    panel.set_ylabel("false alarms per resolution element")
    panel.grid()
    panel.legend(title="arrows: none found, 95 % limit")
    return figure
