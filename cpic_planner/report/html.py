"""The prioritisation report: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from catalogs.catalogue import data_credits
from cpic_planner.models import PlanResult, RankResult, SensitivityResult
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.registry.scores import SCORES
from cpic_planner.report.contrast_figure import HoleEdges, LimitCurve
from cpic_planner.report.drawing import Picture
from cpic_planner.report.etc_words import score_number
from cpic_planner.report.modelled import dial_text, error_text, modelled_groups
from cpic_planner.report.names import full_name, pretty_name
from cpic_planner.report.numbers import (
    MISSING,
    contrast_text,
    count_text,
    decimals,
    duration_text,
    percent_text,
    share_text,
    significant,
)
from cpic_planner.report.panel_figure import PANEL_NOTE
from cpic_planner.report.panels import Panels
from cpic_planner.report.summary import (
    calibration_sentence,
    chosen,
    overrides_sentence,
    planet_text,
    population_text,
    summary_sentences,
)
from cpic_planner.report.words import (
    DRAWN_AS,
    GLOSSARY,
    LIMITED_BY,
    METHOD_CREDITS,
    STAR_FLUX,
    STATUS_SYMBOLS,
    flag_text,
    plus_minus,
    reason_text,
    sentence,
    status_text,
    tau_text,
    verdict_text,
)

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["page_environment", "plan_html", "render_plan"]

_FIGURES = (
    ("sky", "Ranked stars on the sky"),
    ("contrast", "Reference planets and contrast limits"),
    ("calibration", "Does the prediction hold?"),
    ("margin", "The sample at a glance"),
)


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

    return render_plan(
        plan,
        rank,
        plan_figures(plan, rank, limits=limits, holes=holes),
        panel_pictures(plan, panels),
        sensitivity=sensitivity,
        top_rows=top_rows,
    )


def render_plan(
    plan: PlanResult,
    rank: RankResult,
    figures: Mapping[str, Picture],
    images: Mapping[str, Picture],
    *,
    sensitivity: SensitivityResult | None = None,
    top_rows: int = 50,
) -> str:
    """Render the report from finished pictures.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    figures : mapping of str to Picture
        Any of ``sky``, ``contrast``, ``calibration``, ``margin``.
    images : mapping of str to Picture
        Image panels by ``BandConfirmation.image``.
    sensitivity : SensitivityResult, optional
    top_rows : int
        Rows of the ranking to print.

    Returns
    -------
    str
        HTML with inline style and data-URI images: no script, nothing fetched.
    """
    rows = rank.targets[:top_rows]
    flags = sorted({flag for row in [*rows, *(target.ranked for target in plan.targets)] for flag in row.flags})
    return (
        page_environment()
        .get_template("plan.html.j2")
        .render(
            plan=plan,
            rank=rank,
            rows=rows,
            flags=flags,
            reasons=sorted({row.reason for row in rows if row.reason}),
            images=images,
            sensitivity=sensitivity,
            found=LIBRARIES[plan.reference_library].found,
            audited=any(band.audit for target in plan.targets for band in target.bands),
            tau=tau_text(sensitivity.top) if sensitivity else "",
            score=SCORES[rank.score_name].meaning,
            population=population_text(rank.population),
            summary=" ".join(summary_sentences(plan, rank)),
            calibration=calibration_sentence(plan),
            overrides=overrides_sentence(plan),
            dial=dial_text(plan),
            modelled=modelled_groups(
                [
                    (f"{pretty_name(target.name)} {band.band}", band.modelled)
                    for target in plan.targets
                    for band in target.bands
                    if band.modelled is not None
                ]
            ),
            planet=planet_text(plan),
            figures=[(key, title, figures[key]) for key, title in _FIGURES if key in figures],
            panel_note=PANEL_NOTE,
            glossary=GLOSSARY,
            credits=(*data_credits(plan.catalogue), *METHOD_CREDITS),
        )
    )


def page_environment() -> Environment:
    """Templates of the pages, with the filters that they use."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("cpic_planner.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = {
        "pretty": pretty_name,
        "contrast": contrast_text,
        "duration": duration_text,
        "sig": significant,
        "dec": decimals,
        "percent": percent_text,
        "share": share_text,
        "score": score_number,
        "count": count_text,
        "reason": reason_text,
        "status": status_text,
        "verdict": verdict_text,
        "limited": lambda limit, reason: LIMITED_BY[limit][0] if limit else reason.replace("_", " "),
        "flag": flag_text,
        "library": lambda name: LIBRARIES[name].meaning,
        "pm": plus_minus,
        "sentence": sentence,
        "star_flux": lambda method: STAR_FLUX.get(method, method),
        "errors": error_text,
        "drawn": lambda way: DRAWN_AS.get(way, way),
        "symbol": lambda status: STATUS_SYMBOLS.get(status, ""),
        "ra": ra_text,
        "decl": dec_text,
    }
    environment.filters.update(filters)
    environment.globals.update(chosen=chosen, full_name=full_name, MISSING=MISSING)
    return environment


def ra_text(ra_deg: float | None) -> str:
    """Return a right ascension as hours, minutes and seconds."""
    if ra_deg is None:
        return MISSING
    total = round(ra_deg / 15.0 * 3600.0) % 86400
    return f"{total // 3600:02d} h {total // 60 % 60:02d} m {total % 60:02d} s"


def dec_text(dec_deg: float | None) -> str:
    """Return a declination as degrees and minutes."""
    if dec_deg is None:
        return MISSING
    total = round(abs(dec_deg) * 60.0)
    return f"{'−' if dec_deg < 0 else '+'}{total // 60:02d}° {total % 60:02d}′"
