"""All figures of the report, each drawn by a module of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cpic_planner.models import PlanResult, RankResult
from cpic_planner.report.contrast_figure import HoleEdges, LimitCurve, contrast_diagram
from cpic_planner.report.drawing import Picture
from cpic_planner.report.margin_figure import margin_figure
from cpic_planner.report.panel_figure import PanelSheet, panel_picture
from cpic_planner.report.panels import Panels
from cpic_planner.report.sky_map import sky_map
from cpic_planner.report.snr_figure import snr_figure

__all__ = [
    "HoleEdges",
    "LimitCurve",
    "Picture",
    "contrast_diagram",
    "margin_figure",
    "panel_picture",
    "panel_pictures",
    "plan_figures",
    "sky_map",
    "snr_figure",
]


def plan_figures(
    plan: PlanResult, rank: RankResult, *, limits: Sequence[LimitCurve] = (), holes: Sequence[HoleEdges] = ()
) -> dict[str, Picture]:
    """Draw the four figures of a plan: ``sky``, ``contrast``, ``calibration`` and ``margin``.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    limits : sequence of LimitCurve
        Contrast limits to draw; labels name target and band.
    holes : sequence of HoleEdges
        Corners of each band's dark hole on the diagonal.
    """
    confirmed = tuple(target.name for target in plan.targets)
    return {
        "sky": sky_map(rank, confirmed=confirmed),
        "contrast": contrast_diagram(rank, limits=limits, holes=holes, confirmed=confirmed),
        "calibration": snr_figure(plan),
        "margin": margin_figure(rank),
    }


def panel_pictures(plan: PlanResult, panels: Mapping[str, Panels]) -> dict[str, Picture]:
    """Draw the images of every confirmed band that has them; keys are those of ``BandConfirmation.image``."""
    sheet = PanelSheet()
    return {
        band.image: sheet.picture(panels[band.image], target.name)
        for target in plan.targets
        for band in target.bands
        if band.image is not None and band.image in panels
    }
