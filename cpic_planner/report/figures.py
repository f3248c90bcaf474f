"""All figures of the report, each drawn by a module of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from cpic_planner.models import PlanResult, RankResult
from cpic_planner.report.contrast_figure import HoleEdges, LimitCurve, contrast_diagram
from cpic_planner.report.drawing import Picture
from cpic_planner.report.margin_figure import margin_figure
from cpic_planner.report.panel_figure import PanelSheet
from cpic_planner.report.panels import Panels
from cpic_planner.report.sky_map import sky_map
from cpic_planner.report.snr_figure import snr_figure


@dataclass(frozen=True)
class PlanFigureData:
    """What the figures of a plan are drawn from; see `plan_figures`."""

    plan: PlanResult
    rank: RankResult
    limits: Sequence[LimitCurve] = ()
    holes: Sequence[HoleEdges] = ()

    @property
    def confirmed(self) -> tuple[str, ...]:
        """Names of the confirmed targets."""
        return tuple(target.name for target in self.plan.targets)


PLAN_FIGURES: dict[str, tuple[str, Callable[[PlanFigureData], Picture]]] = {
    "sky": ("Ranked stars on the sky", lambda data: sky_map(data.rank, confirmed=data.confirmed)),
    "contrast": (
        "Reference planets and contrast limits",
        lambda data: contrast_diagram(data.rank, limits=data.limits, holes=data.holes, confirmed=data.confirmed),
    ),
    "calibration": ("Does the prediction hold?", lambda data: snr_figure(data.plan)),
    "margin": ("The sample at a glance", lambda data: margin_figure(data.rank)),
}
"""Title of each figure, and what draws it."""


def plan_figures(
    plan: PlanResult, rank: RankResult, *, limits: Sequence[LimitCurve] = (), holes: Sequence[HoleEdges] = ()
) -> dict[str, Picture]:
    """Draw the figures of a plan, by the keys of `PLAN_FIGURES`.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    limits : sequence of LimitCurve
        Contrast limits to draw; labels name target and band.
    holes : sequence of HoleEdges
        Corners of each band's dark hole on the diagonal.
    """
    data = PlanFigureData(plan, rank, limits, holes)
    return {key: draw(data) for key, (_, draw) in PLAN_FIGURES.items()}


def panel_pictures(plan: PlanResult, panels: Mapping[str, Panels]) -> dict[str, Picture]:
    """Draw the images of every confirmed band that has them; keys are those of ``BandConfirmation.image``."""
    sheet = PanelSheet()
    return {
        band.image: sheet.picture(panels[band.image], target.name)
        for target in plan.targets
        for band in target.bands
        if band.image is not None and band.image in panels
    }
