"""Write the products of a confirmed scene into its folder."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from cpic_planner.etc.model import EtcModel
from cpic_planner.jobs.folder import RunFolder
from cpic_planner.models import ConfirmResult
from cpic_planner.report.tables import measurements_csv
from cpic_planner.report.write import panels_of
from cpic_planner.validation.findings import FittedAlbedo, albedo_fits
from simulator.config import Scene
from simulator.config.albedo import ParametricAlbedo

if TYPE_CHECKING:
    from cpic_planner.report.drawing import Picture

PANELS = "panels-{band}.png"
"""Name of the images of a band."""


def products_of(bands: Iterable[str]) -> list[str]:
    """Names of the files of a report of images in these bands."""
    return ["measurements.csv", "report.html", *(PANELS.format(band=band) for band in bands)]


def write_confirm_report(
    folder: RunFolder, result: ConfirmResult, model: EtcModel, scene: Scene, bodies: Mapping[str, Mapping[str, Any]]
) -> None:
    """Write ``measurements.csv``, the images of each band as PNG, and ``report.html``, each whole.

    Parameters
    ----------
    folder : RunFolder
    result : ConfirmResult
    model : EtcModel
        Of the prediction.
    scene : Scene
        What the images show.
    bodies : mapping
        What `cpic_planner.scene_confirmation.confirm_scene` returned beside the result, by band.
    """
    from cpic_planner.report.html import render_confirm
    from cpic_planner.report.panel_figure import PanelSheet
    from cpic_planner.report.snr_figure import snr_figure
    from cpic_planner.report.spectrum_figure import spectrum_figure

    folder.write("measurements.csv", measurements_csv(result))
    sheet = PanelSheet()
    images = {
        band: sheet.picture(panels_of(model, band, body, scene=scene), result.scene) for band, body in bodies.items()
    }
    for band, picture in images.items():
        folder.write_bytes(PANELS.format(band=band), base64.b64decode(picture.uri.split(",", 1)[1]))
    figures = {}
    spectrum = spectrum_figure(scene, model.instrument, result.bands)
    if spectrum is not None:
        figures = {"spectrum": spectrum, "calibration": snr_figure(result)}
    for fitted in albedo_fits(scene, model.instrument, result.bands):
        figures[f"Metallicity and clouds of {fitted.light.name}"] = _albedo_picture(fitted)
    folder.write("report.html", render_confirm(result, figures, images))


def _albedo_picture(fitted: FittedAlbedo) -> Picture:
    """The posterior, with the planet of the scene where it is one of the model's."""
    from cpic_planner.report.albedo_figure import albedo_picture

    light, truth = fitted.light, None
    albedo = light.planet.albedo
    if isinstance(albedo, ParametricAlbedo) and albedo.clamped_log10_fsed is not None:
        truth = albedo.log10_mh, albedo.clamped_log10_fsed
    return albedo_picture(fitted.fit, fitted.model, spectrum=(light.wavelength_nm, light.contrast), truth=truth)
