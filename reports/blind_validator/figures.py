"""Figures of the report."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cpic_planner.report import new_figure
from cpic_planner.report.drawing import BAND_STYLE
from cpic_planner.report.numbers import pretty_name

__all__ = ["chain_figure", "loop_figure", "null_figure", "png", "pull_figure"]

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


def chain_figure(rows: list[Row]) -> Figure:
    """Predicted over recovered SNR with its interval."""
    figure = new_figure(4.6)
    panel = figure.subplots()
    panel.axhspan(0.9, 1.1, color="#EEEEEE", zorder=0)
    panel.axhline(1.0, color=GREY, lw=0.8)
    stars = list(dict.fromkeys(row["star"] for row in rows))
    bands = list(dict.fromkeys(row["band"] for row in rows))
    shown = set()
    for row in rows:
        full = row["chain"].startswith("every")
        colour, marker = BAND_STYLE[bands.index(row["band"])]
        place = stars.index(row["star"]) + 0.15 * (bands.index(row["band"]) - 1.5) + (0.07 if full else 0.0)
        label = "every frame, every effect" if full else row["band"]
        panel.errorbar(
            [place],
            [row["ratio"]],
            [[row["ratio"] - row["low"]], [row["high"] - row["ratio"]]],
            fmt=marker,
            ms=5,
            color=GREY if full else colour,
            mfc="white" if full else None,
            label=None if label in shown else label,
        )
        shown.add(label)
    panel.set_xticks(range(len(stars)), [pretty_name(star) for star in stars])
    panel.set_ylabel("predicted over recovered SNR (95 %)")
    panel.grid(axis="y")
    panel.legend(ncols=5, fontsize=7.5)
    return figure


def loop_figure(rows: list[Row]) -> Figure:
    """Found against known factors, band by band."""
    figure = new_figure(4.8)
    panel = figure.subplots()
    line = np.array([0.9, 7.0])
    panel.plot(line, line, color=GREY, lw=0.8)
    for k, row in enumerate(rows):
        own = [one for one in row["each"] if one["found"] is not None]
        colour, marker = BAND_STYLE[k]
        panel.errorbar(
            [one["known"] for one in own],
            [one["found"] for one in own],
            [one["error"] for one in own],
            fmt=marker,
            ms=4,
            lw=0.7,
            color=colour,
            alpha=0.55,
        )
        panel.errorbar(
            [row["known"]],
            [row["found"]],
            [row["error"]],
            fmt=marker,
            ms=9,
            lw=1.6,
            color=colour,
            mec="black",
            label=row["override"],
        )
    panel.set_xscale("log")
    panel.set_yscale("log")
    ticks = [1, 1.2, 1.5, 2, 3, 4, 6]
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_ticks([], minor=True)
    panel.set_xlabel("known factor: ETC of the nominal over ETC of the altered instrument")
    panel.set_ylabel("found: predicted over recovered SNR")
    panel.grid()
    panel.legend(title="small: one star and band; large: all of them")
    return figure


def png(figure: Figure) -> bytes:
    """Bytes of a picture."""
    with io.BytesIO() as buffer:
        figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
        return buffer.getvalue()
