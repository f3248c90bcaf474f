"""What codes mean, in words: statuses, reasons, flags, reference libraries, glossary, credits."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from importlib import resources
from typing import Any

from catalogs.star_flags import ADDED_FLAGS
from cpic_planner.overrides import SimulatorOverrides
from cpic_planner.registry.libraries import LIBRARIES

__all__ = [
    "ALBEDO_STATUS",
    "DRAWN_AS",
    "FLAGS",
    "GLOSSARY",
    "LIMITED_BY",
    "METHOD_CREDITS",
    "STAR_FLUX",
    "STATUS_SYMBOLS",
    "STATUS_WORDS",
    "VERDICTS",
    "flag_text",
    "overrides_text",
    "plus_minus",
    "reason_text",
    "sentence",
    "status_text",
    "tau_text",
    "verdict_text",
]

#: Symbol of each status, so that badges do not rely on colour.
STATUS_SYMBOLS: dict[str, str] = {
    "ok": "✓",
    "unreachable": "○",
    "saturated": "▲",
    "outside_field": "□",
    "invalid": "✕",
}

STATUS_WORDS: dict[str, str] = {
    "ok": "ok",
    "unreachable": "unreachable",
    "saturated": "saturated",
    "outside_field": "outside field",
    "invalid": "invalid",
}

#: Whether a planet is detected; only the first has a mark, which is green.
VERDICTS: dict[str, str] = {
    "detected": "detected",
    "measured_not_detected": "measured, not detected",
    "unreachable": "unreachable",
}

#: What limits an answer: in one or two words, and as the end of a sentence about stars or bands.
LIMITED_BY: dict[str, tuple[str, str]] = {
    "none": ("detected", "nothing"),
    "speckles": ("speckles", "speckles (detected if the wavefront did not drift)"),
    "background": ("background", "background (detected if there were no noise but the planet's own and the speckles)"),
    "photons": ("too faint", "photons (too faint even if the wavefront did not drift, or if there were no background)"),
    "geometry": ("outside", "geometry (outside the dark hole)"),
    "saturation": ("saturated", "saturation (no frame is possible)"),
}

_REASONS: dict[str, str] = {
    "": "",
    "speckle_floor": "no length of visit is enough",
    "insufficient_time": "not enough time",
    "pixel_full_well": "shortest frame overfills a pixel",
    "register_full_well": "gain register overfills",
    "adc_range": "beyond the converter's range",
    "inside_inner_edge": "inside the inner edge of the dark hole",
    "outside_outer_edge": "beyond the outer edge of the dark hole",
    "too_many_frames": "too many frames for one sequence",
    "too_few_resolution_elements": "fewer than three resolution elements: no threshold",
    "time_below_overheads": "time shorter than the overheads",
    "no_planet_light": "the planet sends no light",
    "roll_too_small": "the roll moves the planet by less than its aperture",
    "too_bright_to_count": "too bright for photon counting",
    "not_measured_in_images": "images of this kind are not measured yet",
    "tolerance_not_met": "not as accurate as asked for",
    "tier_too_coarse": "the named fidelity is too coarse for this scene",
}

#: What contrasts refer to.
STAR_FLUX: dict[str, str] = {
    "off_mask": "series of the star off the mask",
    "field_star": "star of the field",
    "known": "the scene's own rate: the shortest exposure off the mask saturates",
}

#: How firm a fit of metallicity and clouds is.
ALBEDO_STATUS: dict[str, str] = {
    "constrained": "constrained",
    "not_constrained": "not constrained: the 95 % region reaches the edge of the allowed range",
    "degenerate": "degenerate: fewer bands than parameters",
}

#: How realisations are made.
DRAWN_AS: dict[str, str] = {"sums": "as sums of frames", "frames": "frame by frame"}

#: Flags that the planner adds; those of the catalogue are described beside its data.
FLAGS: dict[str, str] = {
    "companion_light_on": "light of the nearest companion is included",
    "companion_light_off": "light of a known companion is left out on request",
    "companion_light_unknown": "a close companion is known but cannot be placed: its light is not included",
    "companion_colour_assumed": "companion given the star's own colour",
    "hole_not_reached": "the dark hole of the band is brighter than asked of the instrument",
    "shorter_visit_is_better": "less than the given time is used: the walk of the wavefront makes a longer visit worse",
    "companion_saturates": "a companion on the frame overflows its pixels: its blooming is not followed",
    "companion_pa_assumed": "the sources give no position angle for the companion: 30 deg assumed",
    "stellar_grid_clamped": "temperature, gravity or metallicity clamped to the edge of the spectral grid",
    "fsed_clamped": "f_sed above 6 is taken as 6, the largest with models behind it",
    "insolation_clamped": "the planet's insolation is outside the models' 0.5-5 au: the nearer end is used",
    "extrapolated": "beyond the range of its input data",
    "clamped": "an input was clamped to the range of its model",
    "speckle_error_extrapolated": "the error of the speckles is that of the nearest separation where it was measured",
    "exposure_beyond_max": "the exposure asked for is longer than the camera's longest",
}

GLOSSARY: tuple[tuple[str, str], ...] = (
    (
        "contrast",
        "Planet-to-star ratio of detected photon rates in the band, before mask and aperture: a property of the planet "
        "and the band.",
    ),
    (
        "contrast limit",
        "The planet-to-star ratio that would just be detected at a stated n-sigma level: a property of the "
        "observation. It is never raw contrast, which is the brightness of starlight in the dark hole relative "
        "to the unmasked peak.",
    ),
    (
        "SNR",
        "Planet signal over its photometric error, the planet's own noise included: how well the flux is measured.",
    ),
    (
        "significance",
        "Planet signal over the noise that would be there without a planet: how sure one is that there is one.",
    ),
    (
        "threshold",
        "The significance that keeps the false-alarm probability of the stated n sigma although the noise is estimated "
        "from few resolution elements (small-sample statistics). It rises where there are few.",
    ),
    (
        "margin",
        "Significance divided by threshold. Somewhat more than half of the visits show a planet of margin 1 if its "
        "place is known.",
    ),
    (
        "detected",
        "At least half of the visits show the planet at its known place, as simulated images have it. A blind search, "
        "which does not know the place, finds it less often where speckles rule: its probability is stated beside.",
    ),
    (
        "limited by",
        "The single change that would make the planet detected in the given time. Speckles: a wavefront that does not "
        "drift; background: no noise but the planet's own and the speckles; photons: neither of them is enough, the "
        "planet is too faint.",
    ),
    (
        "completeness",
        "Fraction of the planets of a stated population, drawn the same for every star, that one observation detects. "
        "Planets outside the dark quadrants or fainter than the limit at their place are missed.",
    ),
    ("score", "What the ranking is by; more is better. Its name stands above the ranking."),
    (
        "Kendall tau",
        "Agreement of two orders: 1 where all pairs of stars stand in the same order, 0 for unrelated orders, −1 for "
        "reversed ones. Equal scores are no order (tau-b).",
    ),
    (
        "speckle floor",
        "Scatter of the starlight that the subtraction leaves because the wavefront has drifted. It grows with the "
        "signal and does not average away with more frames: no length of visit detects a planet below it.",
    ),
    (
        "predicted, recovered",
        "Predicted numbers come from the analytic model; recovered ones from simulated images after the star was "
        "subtracted. A blind search decides whether the planet is found; aperture photometry at its true place gives "
        "the flux, found or not. Recovered numbers are those of one observation, averaged over the realisations.",
    ),
    (
        "realisation",
        "One made-up observation: a drift of the wavefront between and during the visits, and every noise, drawn "
        "anew. Most are drawn as sums of frames over the dark hole; the audited one is run frame by frame with every "
        "effect of the camera, calibrated, and cleaned of particles.",
    ),
    (
        "blind search",
        "A matched filter over the whole dark hole that does not know where the planet is. Its threshold holds the "
        "false-alarm probability per resolution element of the stated n sigma, and allows for the places between them.",
    ),
    (
        "optimistic, pessimistic",
        "The ETC is optimistic by predicted over recovered SNR if that is above 1, pessimistic if below, each by more "
        "than two standard errors; closer to 1 it agrees.",
    ),
    ("separation", "Angle between planet and star on the sky, projected."),
    (
        "dark hole",
        "The four square zones around the star in which starlight is suppressed; the mask's cross lies between them.",
    ),
    ("core throughput", "Light in the photometric aperture over light on the clear 2 m pupil."),
    (
        "RDI",
        "Reference differential imaging: modes of reference frames (singular vectors) are fitted to the science "
        "frames and subtracted.",
    ),
    (
        "integration, wall time",
        "Integration is frames × exposure on the planet. Wall time adds readouts, reference frames and "
        "overhead; orbit and calendar are not in it.",
    ),
    (
        "EM gain",
        "Mean amplification of the electron-multiplying register. It lowers the effective read noise and nearly "
        "doubles the photon-noise variance.",
    ),
)

#: What to cite besides the data.
METHOD_CREDITS: tuple[str, ...] = (
    "Instrument concept: CPI-C on CSST, as published by Zhu et al. (2025, RAA, arXiv:2511.09862).",
    "Small-sample detection thresholds: Mawet et al. (2014, ApJ 792, 97).",
)


@functools.cache
def _catalogue_flags() -> dict[str, str]:
    text = resources.files("catalogs").joinpath("data/stars_columns.json").read_text(encoding="utf-8")
    return dict(json.loads(text)["quality_flags"])


def status_text(status: str) -> str:
    """Return a status as words."""
    return STATUS_WORDS.get(status, status.replace("_", " "))


def verdict_text(verdict: str | None, status: str) -> str:
    """Return a verdict as words; the status where there is none."""
    return status_text(status) if verdict is None else VERDICTS.get(verdict, verdict.replace("_", " "))


def reason_text(reason: str) -> str:
    """Return a reason code as words; unknown codes with spaces for underscores."""
    return _REASONS.get(reason, reason.replace("_", " "))


def flag_text(flag: str) -> str:
    """Return a flag as words; unknown flags with spaces for underscores."""
    of_library = next((item.caveats[flag] for item in LIBRARIES.values() if flag in item.caveats), "")
    return (
        of_library or FLAGS.get(flag) or ADDED_FLAGS.get(flag) or _catalogue_flags().get(flag, flag.replace("_", " "))
    )


def plus_minus(text: str) -> str:
    """Return a text with ± for the two characters that plain results have."""
    return text.replace("+-", "±")


def sentence(text: str) -> str:
    """Return a text as a sentence: capital, ±, full stop; empty for none."""
    return f"{plus_minus(text[:1].upper() + text[1:])}." if text else ""


def tau_text(top: int) -> str:
    """Say what Kendall's tau of a ranking under another assumption compares; ``top`` are the stars looked at."""
    return (
        f"Kendall's tau-b of the scores, of the stars among the first {top} whose score is above zero, nominally or "
        "under the assumption (1: the same order; 0: an unrelated one; equal scores are no order)"
    )


def overrides_text(overrides: Mapping[str, Any]) -> str:
    """Return what is altered in the images, as people write it; empty if nothing is.

    Parameters
    ----------
    overrides : mapping
        ``simulator_overrides`` of a result.
    """
    return SimulatorOverrides.of(overrides).text().replace(" x", " ×") if overrides else ""
