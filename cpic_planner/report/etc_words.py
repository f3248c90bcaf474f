"""Words of the exposure-time calculator: terms of the noise, limits that bind, remedies, scores."""

from __future__ import annotations

from cpic_planner.report.numbers import decimals, significant
from simulator.detectors.chains import noise_terms

__all__ = [
    "LIMITS",
    "REMEDIES",
    "SCORES",
    "TERMS",
    "cap_sentence",
    "limit_text",
    "remedy_text",
    "score_number",
    "score_text",
    "short_limit",
    "term_text",
]

#: Terms of the variance.
TERMS: dict[str, str] = {
    "planet": "planet's own light",
    "halo": "starlight in the hole",
    "companion": "companion's light",
    "sky": "sky and zodiacal light",
    "exozodi": "dust around the star",
    "smear": "smear of the frame transfer",
    "counting": "counted photons and false counts",
    "reference": "all noise of the reference frames",
    "background_mean": "error of the mean background",
    "speckle": "speckles that the subtraction leaves",
    "companion_wings": "companion's light that the subtraction leaves",
} | {term: effect.term_label or effect.label for term, effect in noise_terms().items()}

#: Limits of exposure and gain: in one or two words, and in a sentence after "is held by".
LIMITS: dict[str, tuple[str, str]] = {
    "exposure_max": ("longest", "the longest frame of the camera"),
    "exposure_min": ("shortest", "the shortest frame of the camera"),
    "em_gain_max": ("largest", "the largest gain of the register"),
    "pixel_full_well": ("pixel well", "the pixel's full well: a longer frame would overflow into the hole"),
    "register_full_well": ("register", "the gain register's full well: more charge would trail into the hole"),
    "adc_range": ("converter", "the converter's range"),
}

REMEDIES: dict[str, str] = {
    "twice_the_time": "twice the time in one visit",
    "half_the_drift": "half the drift of the wavefront",
    "half_the_read_noise": "half the read noise",
    "half_the_clock_charge": "half the clock-induced charge",
    "half_the_star_light": "half the starlight in the hole",
    "four_times_the_reference": "four times the reference frames (their time not counted)",
}

#: What a ranking is by: name of its column, and meaning.
SCORES: dict[str, tuple[str, str]] = {
    "completeness_per_hour": (
        "compl/h",
        "fraction of the population that one observation detects, per hour of it, in the band where that is most",
    ),
    "completeness": (
        "compl",
        "fraction of the population that one observation detects, in the band where that is most",
    ),
    "detection_margin": ("margin", "significance of the reference planet over the detection threshold"),
    "detection_time": ("1/time", "reference planets detected per hour: one over the least wall time that does"),
    "contrast_limit": ("−log C", "minus log10 of the faintest contrast detected anywhere in the dark hole"),
}

_CAPS = {
    "hole": "keeps the pixels inside the dark hole unsaturated",
    "register_tail": "keeps bright starlight beside the hole from trailing into it through the register",
    "frame": "leaves every pixel of the whole frame unsaturated",
}


def term_text(term: str) -> str:
    """Return a term of the noise as words."""
    return TERMS.get(term, term.replace("_", " "))


def short_limit(limit: str) -> str:
    """Return a limit in one or two words; empty for none."""
    return LIMITS.get(limit, (limit.replace("_", " "),))[0]


def limit_text(limit: str) -> str:
    """Return a limit as words that follow "is held by"."""
    return LIMITS[limit][1] if limit in LIMITS else limit.replace("_", " ")


def remedy_text(remedy: str) -> str:
    """Return a remedy as words."""
    return REMEDIES.get(remedy, remedy.replace("_", " "))


def score_text(score: str) -> str:
    """Return what a score means."""
    return SCORES[score][1] if score in SCORES else score.replace("_", " ")


def score_number(value: float, score: str) -> str:
    """Return a score as text with sensible digits."""
    if score == "contrast_limit":
        return decimals(value, 2)
    return "0" if value == 0.0 else significant(value) if value >= 1e-3 else f"{value:.1e}"


def cap_sentence(name: str, gain: float) -> str:
    """Return what a gain spares; 0 means that not even gain 1 does."""
    what = _CAPS.get(name, name.replace("_", " "))
    return f"EM gain up to {significant(gain)} {what}" if gain >= 1.0 else f"no EM gain {what}"
