"""The report of a confirmed scene: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping

from cpic_planner.models import ConfirmResult
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.report.drawing import Picture
from cpic_planner.report.html import page_environment
from cpic_planner.report.modelled import dial_text, modelled_groups
from cpic_planner.report.panel_figure import PANEL_NOTE
from cpic_planner.report.summary import calibration_sentence, confirm_sentences, overrides_sentence
from cpic_planner.report.words import ALBEDO_STATUS, GLOSSARY, METHOD_CREDITS

__all__ = ["CONFIRM_FIGURES", "render_confirm"]

CONFIRM_FIGURES = {
    "spectrum": "Recovered contrasts on the spectrum of the scene",
    "calibration": "Does the prediction hold?",
}
"""Figures that have a title of their own; others are shown under their keys."""
_WORDS = frozenset(
    {
        "contrast",
        "SNR",
        "significance",
        "threshold",
        "speckle floor",
        "predicted, recovered",
        "realisation",
        "blind search",
        "optimistic, pessimistic",
        "separation",
        "dark hole",
        "core throughput",
        "RDI",
        "integration, wall time",
        "EM gain",
    }
)


def render_confirm(result: ConfirmResult, figures: Mapping[str, Picture], images: Mapping[str, Picture]) -> str:
    """Render the report from finished pictures.

    Parameters
    ----------
    result : ConfirmResult
    figures : mapping of str to Picture
        By the keys of `CONFIRM_FIGURES`, or by a title.
    images : mapping of str to Picture
        Image panels by band.

    Returns
    -------
    str
        HTML with inline style and data-URI images: no script, nothing fetched.
    """
    planets = list(dict.fromkeys(item.planet for item in result.bands))
    return (
        page_environment()
        .get_template("confirm.html.j2")
        .render(
            result=result,
            planets=[(name, [item for item in result.bands if item.planet == name]) for name in planets],
            figures=[(key, CONFIRM_FIGURES.get(key, key), picture) for key, picture in figures.items()],
            images=images,
            bands=list(images),
            overrides=overrides_sentence(result),
            dial=dial_text(result),
            modelled=modelled_groups([(band.band, band.modelled) for band in result.bands if band.modelled]),
            summary=" ".join(confirm_sentences(result)),
            calibration=calibration_sentence(result) if planets else "",
            found=LIBRARIES[result.reference_library].found,
            searched=LIBRARIES[result.reference_library].searched,
            panel_note=PANEL_NOTE,
            albedo_status=ALBEDO_STATUS,
            glossary=[(word, text) for word, text in GLOSSARY if word in _WORDS],
            credits=METHOD_CREDITS,
        )
    )
