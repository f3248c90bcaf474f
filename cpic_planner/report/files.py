"""Files of results: tables, image panels and HTML reports, each written whole."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cpic_planner import results
from cpic_planner.etc import EtcModel, contrast_limit
from cpic_planner.jobs import RunFolder
from cpic_planner.report.confirm import ConfirmReport, confirm_document, measurements_csv
from cpic_planner.report.drawing import Picture
from cpic_planner.report.export import EXPORT_PRODUCTS, export_products, write_export
from cpic_planner.report.image_figures import Mark, MarkKind, Panels
from cpic_planner.report.plan import PlanReport, plan_document
from cpic_planner.report.ranking import ranking_csv, ranking_ecsv
from cpic_planner.report.ranking_figures import HoleEdges, LimitCurve
from cpic_planner.report.whatif import WhatIfReport, targets_csv, whatif_document
from cpic_planner.report.words import pretty_name
from cpic_planner.report.writing import page_html
from cpic_planner.targets import Targets, find_target
from cpic_planner.validation import FittedAlbedo, albedo_fits, decode_arrays
from simulator.config import ParametricAlbedo, Scene
from simulator.target import scene_sources

PRODUCTS = ("ranking.csv", "ranking.ecsv", "measurements.csv", *EXPORT_PRODUCTS, "report.html")
"""Names of the files of a report of a plan."""


WHATIF_PRODUCTS = ("targets.csv", "report.html")
"""Names of the files of a report of survey strategies."""


PANELS = "panels-{band}.png"
"""Name of the images of a band."""


def plan_products(bands: Iterable[str]) -> list[str]:
    """Return the names of the files of a report of a plan in these bands."""
    return list(dict.fromkeys([*PRODUCTS, *export_products(bands, 0)]))


def products_of(bands: Sequence[str], planets: int = 0) -> list[str]:
    """Return the names of the files of a report of images in these bands; ``planets`` is the number of a scene's."""
    panels = (PANELS.format(band=band) for band in bands)
    return ["measurements.csv", *export_products(bands, planets), "report.html", *panels]


SOURCES_FILES = ("sources.csv", "sources.ecsv")
"""Names of the tables of sources that were detected in files."""


N_LIMIT_POINTS = 24


MAX_LIMITS = 3


def limit_curves(plan: results.PlanResult, model: EtcModel, targets: Targets | None = None) -> list[LimitCurve]:
    """Return the contrast limit against separation for the first confirmed targets, each in its ranked band and time.

    `targets` are the ranked stars; without them the stars are those of the snapshot.
    """
    curves = []
    for target in plan.targets[:MAX_LIMITS]:
        row = target.ranked
        if targets is None:
            star, _ = find_target(target.name, companions=plan.companions, date_utc=plan.date_utc or None)
        else:
            star = targets.select(targets.name == target.name)
        zone = model.metrics[row.band]
        separations = np.geomspace(zone.hole_inner_corner_arcsec * 1.001, zone.owa_arcsec * 0.999, N_LIMIT_POINTS)
        time_s, places = row.time_s or plan.time_s, separations.tolist()
        answers = contrast_limit(model, star, time_s=time_s, separation_arcsec=places, bands=[row.band])
        good = [(answer.separation_arcsec, answer.value) for answer in answers if answer.value is not None]
        if good:
            curves.append(LimitCurve(f"{pretty_name(target.name)}, {row.band}", *np.array(good).T))
    return curves


def panels_of(model: EtcModel, band: str, body: Mapping[str, Any], *, scene: Scene | None = None) -> Panels:
    """Return the images of one finished piece of work, with marks.

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
    roll_deg = body.get("roll_deg", model.strategy.rolls_deg[0])
    candidates = body["search"]["candidates"] if body["search"] else ()
    marks = [] if scene is not None else [Mark(x, y) for x, y in body["planet_offsets_arcsec"][:1]]
    marks += [Mark(item["x_arcsec"], item["y_arcsec"], "candidate") for item in candidates if item["detected"]]
    if scene is not None:
        sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)[1:]
        several = sum(source.kind == "planet" for source in sources) > 1
        for source in sources:
            label = source.name if several or source.kind == "star" else ""
            kind: MarkKind = "planet" if source.kind == "planet" else "star"
            marks.append(Mark(source.x_arcsec, source.y_arcsec, kind, label))
    return Panels(
        band=band,
        science=np.where(nowhere, np.nan, images["science"]),
        reference=np.where(nowhere, np.nan, images["reference"]),
        residual=images["residual"],
        pixel_scale_arcsec=metrics.pixel_scale_arcsec,
        aperture_radius_arcsec=metrics.aperture_radius_arcsec,
        zone=metrics.zone,
        parity=instrument.detector.parity,
        roll_deg=roll_deg,
        marks=tuple(marks),
    )


def write_report(
    folder: RunFolder,
    plan: results.PlanResult,
    rank: results.RankResult,
    model: EtcModel,
    bodies: Mapping[tuple[str, str], Mapping[str, Any]],
    targets: Targets,
    sensitivity: results.SensitivityResult | None = None,
    known: results.KnownResult | None = None,
) -> None:
    """Write ``ranking.csv``, ``ranking.ecsv``, ``measurements.csv``, those of `EXPORT_PRODUCTS` and ``report.html``.

    `targets` are the ranked stars, `sensitivity` how their order depends on assumptions, `known` the known planets of
    the first of them.
    """
    from cpic_planner.report.plan import panel_pictures, plan_figures

    folder.write("ranking.csv", ranking_csv(rank))
    folder.write("ranking.ecsv", ranking_ecsv(rank))
    folder.write("measurements.csv", measurements_csv(plan))
    write_export(folder, plan, model.instrument, ((name, body) for (name, _), body in bodies.items()))
    panels = {f"{name} {band}": panels_of(model, band, body) for (name, band), body in bodies.items()}
    holes = [HoleEdges(band, zone.hole_inner_corner_arcsec, zone.owa_arcsec) for band, zone in model.metrics.items()]
    figures = plan_figures(plan, rank, limits=limit_curves(plan, model, targets), holes=holes)
    report = PlanReport(plan, rank, figures, panel_pictures(plan, panels), sensitivity, known)
    folder.write("report.html", page_html(plan_document(report)))


def write_star_images(
    folder: RunFolder, result: results.StarImagesResult, model: EtcModel, bodies: Mapping[str, Mapping[str, Any]]
) -> None:
    """Write ``measurements.csv``, those of `EXPORT_PRODUCTS` and the images of each band as PNG, each whole.

    Parameters
    ----------
    folder : RunFolder
    result : StarImagesResult
        Of one star.
    model : EtcModel
        Of the prediction.
    bodies : mapping
        What `cpic_planner.validation.confirm.confirm_task` returned, by star and band.
    """
    from cpic_planner.report.image_figures import PanelSheet

    folder.write("measurements.csv", measurements_csv(result))
    write_export(folder, result, model.instrument, ((key.rpartition(" ")[0], body) for key, body in bodies.items()))
    sheet = PanelSheet()
    for target in result.targets:
        for band in (item.band for item in target.bands if f"{target.name} {item.band}" in bodies):
            picture = sheet.picture(panels_of(model, band, bodies[f"{target.name} {band}"]), target.name)
            folder.write_bytes(PANELS.format(band=band), _png(picture))


def _png(picture: Picture) -> bytes:
    return base64.b64decode(picture.uri.split(",", 1)[1])


def write_confirm_report(
    folder: RunFolder,
    result: results.ConfirmResult,
    model: EtcModel,
    scene: Scene,
    bodies: Mapping[str, Mapping[str, Any]],
) -> None:
    """Write ``measurements.csv``, those of `EXPORT_PRODUCTS`, images as PNG, and ``report.html``, each whole.

    Parameters
    ----------
    folder : RunFolder
    result : ConfirmResult
    model : EtcModel
        Of the prediction.
    scene : Scene
        What the images show.
    bodies : mapping
        What `cpic_planner.confirm.scene.confirm_scene` returned beside the result, by band.
    """
    from cpic_planner.report.image_figures import PanelSheet, snr_figure, spectrum_figure

    folder.write("measurements.csv", measurements_csv(result))
    write_export(folder, result, model.instrument, ((result.scene, body) for body in bodies.values()))
    if result.visits:
        columns = results.taken_of(results.SourceRecord)
        rows = map(results.values_of, result.sources)
        folder.write(SOURCES_FILES[0], results.csv_text(results.names_of(results.SourceRecord), rows))
        about = {"fingerprint", "version", "config_hash", "scene", "instrument", "sigma", "reference_library"}
        meta = result.model_dump(mode="json", include=about)
        folder.write(SOURCES_FILES[1], results.ecsv_text(columns, result.sources, meta))
    sheet, images = PanelSheet(), {}
    for band, body in bodies.items():
        marked = None if result.bare else scene
        images[band] = picture = sheet.picture(panels_of(model, band, body, scene=marked), result.scene)
        folder.write_bytes(PANELS.format(band=band), _png(picture))
    figures = {}
    spectrum = spectrum_figure(scene, model.instrument, result.bands)
    if spectrum is not None:
        figures = {"spectrum": spectrum, "calibration": snr_figure(result)}
    for fitted in albedo_fits(scene, model.instrument, result.bands):
        figures[f"Metallicity and clouds of {fitted.light.name}"] = _albedo_picture(fitted)
    folder.write("report.html", page_html(confirm_document(ConfirmReport(result, figures, images))))


def _albedo_picture(fitted: FittedAlbedo) -> Picture:
    """Return the posterior, with the planet of the scene where it is one of the model's."""
    from cpic_planner.report.image_figures import albedo_picture

    light, truth = fitted.light, None
    albedo = light.planet.albedo
    if isinstance(albedo, ParametricAlbedo) and albedo.clamped_log10_fsed is not None:
        truth = albedo.log10_mh, albedo.clamped_log10_fsed
    return albedo_picture(fitted.fit, fitted.model, spectrum=(light.wavelength_nm, light.contrast), truth=truth)


def write_whatif(folder: RunFolder, result: results.WhatIfResult) -> None:
    """Write ``targets.csv`` and ``report.html``, each whole; the same bytes for the same result."""
    from cpic_planner.report.whatif_figures import whatif_figures

    folder.write("targets.csv", targets_csv(result))
    folder.write("report.html", page_html(whatif_document(WhatIfReport(result, whatif_figures(result)))))
