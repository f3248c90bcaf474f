"""Write the products of a plan into its folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.questions import contrast_limit
from cpic_planner.jobs.folder import RunFolder
from cpic_planner.models import PlanResult, RankResult, SensitivityResult
from cpic_planner.report.contrast_figure import HoleEdges, LimitCurve
from cpic_planner.report.names import pretty_name
from cpic_planner.report.panels import Mark, Panels
from cpic_planner.report.tables import measurements_csv, ranking_csv, ranking_ecsv
from cpic_planner.targets import Targets, find_target
from cpic_planner.validation.confirm import decode_arrays
from simulator.config import Scene
from simulator.target.sources import scene_sources

PRODUCTS = ("ranking.csv", "ranking.ecsv", "measurements.csv", "report.html")
"""Names of the files of a report."""

N_LIMIT_POINTS = 24
MAX_LIMITS = 3


def limit_curves(plan: PlanResult, model: EtcModel, targets: Targets | None = None) -> list[LimitCurve]:
    """Contrast limit against separation for the first confirmed targets, each in its ranked band and time.

    `targets` are the ranked stars; without them the stars are those of the snapshot.
    """
    curves = []
    for target in plan.targets[:MAX_LIMITS]:
        row = target.ranked
        if targets is None:
            star, _ = find_target(target.name, companions=plan.companions)
        else:
            star = targets.select(targets.name == target.name)
        inner = model.metrics[row.band].hole_inner_corner_arcsec
        separations = np.geomspace(inner * 1.001, model.metrics[row.band].owa_arcsec * 0.999, N_LIMIT_POINTS)
        found = contrast_limit(
            model, star, time_s=row.time_s or plan.time_s, separation_arcsec=separations.tolist(), bands=[row.band]
        )
        good = [(answer.separation_arcsec, answer.value) for answer in found if answer.value is not None]
        if good:
            label = f"{pretty_name(target.name)}, {row.band}"
            curves.append(LimitCurve(label, np.array([s for s, _ in good]), np.array([v for _, v in good])))
    return curves


def hole_edges(model: EtcModel) -> list[HoleEdges]:
    """Corners of each band's zone on the diagonal."""
    return [
        HoleEdges(band, metrics.hole_inner_corner_arcsec, metrics.owa_arcsec) for band, metrics in model.metrics.items()
    ]


def panels_of(model: EtcModel, band: str, body: Mapping[str, Any], *, scene: Scene | None = None) -> Panels:
    """Images of one finished piece of work, with marks.

    Parameters
    ----------
    model : EtcModel
    band : str
    body : mapping
        What `cpic_planner.validation.confirm.confirm_task` returned.
    scene : Scene, optional
        What the images show: its planets, by name where there are several, and its other stars are marked. Without it
        the one planet that was measured is.
    """
    instrument, metrics = model.instrument, model.metrics[band]
    images = decode_arrays(body["panels"])
    nowhere = (images["science"] == 0) & (images["reference"] == 0)  # sums are drawn over the hole alone
    offsets: list[tuple[float | None, float | None]] = [(x, y) for x, y in body["planet_offsets_arcsec"]]
    roll_deg = model.strategy.rolls_deg[0]
    marks = [
        Mark(item["x_arcsec"], item["y_arcsec"], "candidate")
        for item in (body["search"] or {"candidates": ()})["candidates"]
        if item["detected"]
    ]
    if scene is not None:
        sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)[1:]
        several = sum(source.kind == "planet" for source in sources) > 1
        marks += [
            Mark(
                source.x_arcsec,
                source.y_arcsec,
                "planet" if source.kind == "planet" else "star",
                source.name if several or source.kind == "star" else "",
            )
            for source in sources
        ]
        offsets = []
    x, y = offsets[0] if offsets else (None, None)
    return Panels(
        band=band,
        science=np.where(nowhere, np.nan, images["science"]),
        reference=np.where(nowhere, np.nan, images["reference"]),
        residual=images["residual"],
        pixel_scale_arcsec=metrics.pixel_scale_arcsec,
        planet_x_arcsec=x,
        planet_y_arcsec=y,
        aperture_radius_arcsec=metrics.aperture_radius_arcsec,
        hole_inner_arcsec=metrics.hole_inner_arcsec,
        hole_outer_arcsec=metrics.hole_outer_arcsec,
        mask_half_width_arcsec=metrics.mask_half_width_arcsec,
        hole_mode=metrics.hole_mode,
        hole_side=metrics.hole_side,
        parity=instrument.detector.parity,
        roll_deg=roll_deg,
        marks=tuple(marks),
    )


def write_report(
    folder: RunFolder,
    plan: PlanResult,
    rank: RankResult,
    model: EtcModel,
    bodies: Mapping[tuple[str, str], Mapping[str, Any]],
    targets: Targets,
    sensitivity: SensitivityResult | None = None,
) -> None:
    """Write ``ranking.csv``, ``ranking.ecsv``, ``measurements.csv`` and ``report.html``, each whole.

    `targets` are the ranked stars, `sensitivity` how their order depends on assumptions.
    """
    from cpic_planner.report.html import plan_html

    folder.write("ranking.csv", ranking_csv(rank))
    folder.write("ranking.ecsv", ranking_ecsv(rank))
    folder.write("measurements.csv", measurements_csv(plan))
    panels = {f"{name} {band}": panels_of(model, band, body) for (name, band), body in bodies.items()}
    limits = limit_curves(plan, model, targets)
    page = plan_html(plan, rank, panels=panels, limits=limits, holes=hole_edges(model), sensitivity=sensitivity)
    folder.write("report.html", page)
