"""All figures of a comparison of survey strategies."""

from __future__ import annotations

from collections.abc import Callable

from cpic_planner.models.surveyed import WhatIfResult
from cpic_planner.report.drawing import Picture
from cpic_planner.report.whatif_curves import convergence_figure, curves_figure, sweep_figure
from cpic_planner.report.whatif_maps import calendar_figure, stars_figure
from cpic_planner.report.whatif_rows import detections_figure, differences_figure, time_figure, yields_figure

WHATIF_FIGURES: dict[str, tuple[str, Callable[[WhatIfResult], Picture | None]]] = {
    "sweep": ("What the varied setting does", sweep_figure),
    "yields": ("What each strategy yields", yields_figure),
    "differences": ("Is the difference real?", differences_figure),
    "curves": ("Yield against telescope time", curves_figure),
    "time": ("Where the time goes", time_figure),
    "calendar": ("Who is visited when", calendar_figure),
    "sky": ("Where the stars are", stars_figure),
    "detections": ("What is detected", detections_figure),
    "convergence": ("Are there enough universes?", convergence_figure),
}
"""Title of each figure, and what draws it where the result has something for it."""


def whatif_figures(result: WhatIfResult) -> dict[str, Picture]:
    """Draw the figures that the result has something for, by the keys of `WHATIF_FIGURES`."""
    drawn = {key: draw(result) for key, (_, draw) in WHATIF_FIGURES.items()}
    return {key: picture for key, picture in drawn.items() if picture is not None}
