"""All figures of a comparison of survey strategies."""

from __future__ import annotations

from cpic_planner.models.surveyed import WhatIfResult
from cpic_planner.report.drawing import Picture
from cpic_planner.report.whatif_curves import convergence_figure, curves_figure, sweep_figure
from cpic_planner.report.whatif_maps import calendar_figure, stars_figure
from cpic_planner.report.whatif_rows import detections_figure, differences_figure, time_figure, yields_figure

__all__ = ["whatif_figures"]


def whatif_figures(result: WhatIfResult) -> dict[str, Picture]:
    """Draw the figures that the result has something for, in the order of the report.

    Parameters
    ----------
    result : WhatIfResult

    Returns
    -------
    dict of str to Picture
        Any of ``sweep``, ``yields``, ``differences``, ``curves``, ``time``, ``calendar``, ``sky``, ``detections`` and
        ``convergence``.
    """
    drawn = {
        "sweep": sweep_figure(result),
        "yields": yields_figure(result),
        "differences": differences_figure(result),
        "curves": curves_figure(result),
        "time": time_figure(result),
        "calendar": calendar_figure(result),
        "sky": stars_figure(result),
        "detections": detections_figure(result),
        "convergence": convergence_figure(result),
    }
    return {key: picture for key, picture in drawn.items() if picture is not None}
