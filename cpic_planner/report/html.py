"""Reports as HTML: each one file that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cpic_planner.models import ConfirmResult, PlanResult, RankResult, SensitivityResult, WhatIfResult
from cpic_planner.report.confirm_sections import ConfirmReport, confirm_document
from cpic_planner.report.contrast_figure import HoleEdges, LimitCurve
from cpic_planner.report.document import Document
from cpic_planner.report.drawing import Picture
from cpic_planner.report.panels import Panels
from cpic_planner.report.plan_sections import PlanReport, plan_document
from cpic_planner.report.whatif_sections import WhatIfReport, whatif_document


def plan_html(
    plan: PlanResult,
    rank: RankResult,
    *,
    panels: Mapping[str, Panels],
    limits: Sequence[LimitCurve] = (),
    holes: Sequence[HoleEdges] = (),
    sensitivity: SensitivityResult | None = None,
    top_rows: int = 50,
) -> str:
    """Draw the figures of a plan and render its report.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    panels : mapping of str to Panels
        Images by ``BandConfirmation.image``; bands without are shown without.
    limits : sequence of LimitCurve
        Contrast limits for the diagram.
    holes : sequence of HoleEdges
        Corners of each band's dark hole on the diagonal.
    sensitivity : SensitivityResult, optional
        How the ranking depends on assumptions; shown on the first page.
    top_rows : int
        Rows of the ranking to print.

    Returns
    -------
    str
        The whole file; the same bytes for the same input.
    """
    from cpic_planner.report.figures import panel_pictures, plan_figures

    figures = plan_figures(plan, rank, limits=limits, holes=holes)
    return render_plan(plan, rank, figures, panel_pictures(plan, panels), sensitivity=sensitivity, top_rows=top_rows)


def render_plan(
    plan: PlanResult,
    rank: RankResult,
    figures: Mapping[str, Picture],
    images: Mapping[str, Picture],
    *,
    sensitivity: SensitivityResult | None = None,
    top_rows: int = 50,
) -> str:
    """Return the report of a plan from finished pictures.

    Parameters
    ----------
    plan, rank, figures, images, sensitivity, top_rows
        As `cpic_planner.report.plan_sections.PlanReport`.
    """
    return page_html(plan_document(PlanReport(plan, rank, figures, images, sensitivity, top_rows)))


def render_confirm(result: ConfirmResult, figures: Mapping[str, Picture], images: Mapping[str, Picture]) -> str:
    """Return the report of a confirmed scene from finished pictures.

    Parameters
    ----------
    result, figures, images
        As `cpic_planner.report.confirm_sections.ConfirmReport`.
    """
    return page_html(confirm_document(ConfirmReport(result, figures, images)))


def render_whatif(result: WhatIfResult, figures: Mapping[str, Picture]) -> str:
    """Return the report of a comparison of survey strategies from finished pictures.

    Parameters
    ----------
    result, figures
        As `cpic_planner.report.whatif_sections.WhatIfReport`.
    """
    return page_html(whatif_document(WhatIfReport(result, figures)))


def page_html(document: Document) -> str:
    """Return a document as one HTML file with inline style and data-URI images: no script, nothing fetched."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("cpic_planner.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(document=document)
