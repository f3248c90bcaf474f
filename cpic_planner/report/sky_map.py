"""Where the ranked stars are on the sky."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.models import RankedTarget, RankResult
from cpic_planner.report.drawing import (
    SCREEN_DPI,
    STATUS_STYLE,
    Picture,
    literal,
    new_figure,
    place_labels,
    save,
    style,
)
from cpic_planner.report.names import pretty_name
from cpic_planner.report.words import status_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RING_AREA = 70.0
OBLIQUITY_DEG = 23.4392911
"""Mean obliquity of the ecliptic at J2000.0 (IAU 1976), drawn line only."""


def map_longitude(ra_deg: ArrayLike) -> NDArray[np.float64]:
    """Return the map longitude (rad) of right ascensions: 12 h at the left and right edge, increasing to the left."""
    return -np.deg2rad((np.asarray(ra_deg, float) + 180.0) % 360.0 - 180.0)


def marker_area(v_mag: ArrayLike) -> NDArray[np.float64]:
    """Return the marker area (square points): brighter stars are larger."""
    return np.clip(8.0 * 10.0 ** (0.15 * (7.0 - np.asarray(v_mag, float))), 7.0, 110.0)


def _places(rows: Sequence[RankedTarget]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Map longitudes and latitudes (rad) of stars that have a position."""
    latitude = np.deg2rad(np.array([row.dec_deg for row in rows], np.float64))
    return map_longitude(np.array([row.ra_deg for row in rows], np.float64)), latitude


def _radius_px(v_mag: float, ringed: bool) -> float:
    """Radius of a star's marker on the screen."""
    area = float(marker_area(v_mag)) + (RING_AREA if ringed else 0.0)
    return float(np.sqrt(area / np.pi)) * SCREEN_DPI / 72.0


def sky_axes(figure: Figure) -> Axes:
    """Add an empty map of the whole sky in equatorial coordinates (Mollweide), with the ecliptic."""
    from matplotlib.patheffects import withStroke

    axes = figure.add_subplot(projection="mollweide")
    axes.grid(visible=True)
    axes.set_xticks(map_longitude(np.array([150.0, 120, 90, 60, 30, 0, 330, 300, 270, 240, 210])))
    axes.set_xticklabels(
        [f"{hour} h" for hour in (10, 8, 6, 4, 2, 0, 22, 20, 18, 16, 14)], color="#666666", fontsize=8.5
    )
    for hour_label in axes.get_xticklabels():
        hour_label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        hour_label.set_zorder(6)
    axes.set_yticks(np.deg2rad([-60, -30, 0, 30, 60]))
    axes.set_yticklabels(["−60°", "−30°", "0°", "+30°", "+60°"])
    axes.set_xlabel("right ascension (ICRS, increasing to the left)")
    axes.set_ylabel("declination (ICRS)")
    ra = np.linspace(-180.0, 180.0, 361)
    ecliptic = np.arctan(np.tan(np.deg2rad(OBLIQUITY_DEG)) * np.sin(np.deg2rad(ra)))
    axes.plot(-np.deg2rad(ra), ecliptic, color="#B58900", lw=1.1, ls="--", zorder=1, label="ecliptic")
    return axes


def sky_map(rank: RankResult, *, confirmed: tuple[str, ...] = (), labelled: int = 12) -> Picture:
    """Draw all ranked stars in equatorial coordinates (Mollweide).

    Parameters
    ----------
    rank : RankResult
    confirmed : tuple of str
        SIMBAD identifiers of targets that were simulated: ringed, and labelled first.
    labelled : int
        How many of the highest-ranked stars to label.
    """
    rows = [row for row in rank.targets if row.ra_deg is not None and row.dec_deg is not None]
    hidden = len(rank.targets) - len(rows)
    with style():
        figure = new_figure(5.3)
        axes = sky_axes(figure)
        for status in reversed(STATUS_STYLE):
            chosen = [row for row in rows if row.status == status]
            if not chosen:
                continue
            colour, marker = STATUS_STYLE[status]
            label = f"{status_text(status)} ({len(chosen)})"
            # One call per half magnitude: markers of one size share one definition, which keeps the file small.
            for step in sorted({round(2.0 * row.v_mag) for row in chosen}, key=lambda step: abs(step - 8)):
                group = [row for row in chosen if round(2.0 * row.v_mag) == step]
                axes.scatter(
                    *_places(group),
                    s=float(marker_area(step / 2.0)),
                    c=colour,
                    marker=marker,
                    alpha=0.5 if status == "unreachable" else 0.85,
                    linewidths=0 if marker != "x" else 1,
                    zorder=2 if status == "unreachable" else 4,
                    label=label,
                )
                label = "_nolegend_"
        ringed = [row for row in rows if row.name in confirmed]
        if ringed:
            axes.scatter(
                *_places(ringed),
                s=marker_area([row.v_mag for row in ringed]) + RING_AREA,
                facecolors="none",
                edgecolors="#111111",
                linewidths=1.2,
                zorder=5,
                label=f"simulated as images ({len(ringed)})",
            )
        handles, texts = axes.get_legend_handles_labels()
        for v_mag in (1, 4, 7):
            handles.append(axes.scatter([], [], s=marker_area(v_mag), c="#555555", linewidths=0))
            texts.append(f"V = {v_mag}")
        figure.legend(handles, texts, loc="outside lower center", ncols=4, handletextpad=0.4, columnspacing=1.6)
        chosen = ringed + [row for row in rows[:labelled] if row.name not in confirmed]
        longitude, latitude = _places(chosen)
        place_labels(
            axes,
            longitude.tolist(),
            latitude.tolist(),
            [literal(pretty_name(row.name)) for row in chosen],
            fontsize=9,
            avoid=axes.get_xticklabels(),
            reach_px=[_radius_px(row.v_mag, row.name in confirmed) for row in chosen],
        )
        best = ", ".join(pretty_name(row.name) for row in rows[:5]) or "none"
        return save(
            figure,
            "svg",
            alt=f"Map of the whole sky with {len(rows)} ranked stars, coloured by status; highest ranked: {best}.",
            caption="Ranked stars on the sky. Marker area grows with brightness (V); colour and shape give the status "
            "of the reference planet; rings mark targets whose images were simulated."
            + (f" Stars without a listed position, not shown: {hidden}." if hidden else ""),
        )
