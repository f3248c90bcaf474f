"""Words for codes: statuses, reasons, flags, terms of the noise, limits, remedies; and the glossary of reports."""

import functools
import json
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any

from catalogs import ADDED_FLAGS
from cpic_core import parse_yaml
from cpic_planner.queries import SimulatorOverrides
from cpic_planner.registry import LIBRARIES, SCORES
from cpic_planner.report.numbers import MISSING, count_text, decimals, pretty_name, significant
from cpic_planner.results import PlanResult, ProgrammeColumns
from simulator.detectors import noise_terms

#: Symbol of each status, so that badges do not rely on colour.
STATUS_SYMBOLS: dict[str, str] = {"ok": "✓", "unreachable": "○", "saturated": "▲", "outside_field": "□", "invalid": "✕"}


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
    "common_speckles": (
        "common speckles",
        "what science and references differ by in every visit (detected if the wavefront did not drift, but by no "
        "number of visits)",
    ),
    "background": ("background", "background (detected if there were no noise but the planet's own and the speckles)"),
    "photons": ("too faint", "photons (too faint even if the wavefront did not drift, or if there were no background)"),
    "geometry": ("outside", "geometry (outside the dark hole)"),
    "saturation": ("saturated", "saturation (no frame is possible)"),
    "motion": ("motion", "motion (detected if the planet stood still, but not by a search that goes through orbits)"),
    "visibility": ("not seen", "visibility (the star is not seen for so long)"),
}

SEARCHES: dict[str, str] = {"blind": "by a search that does not know the place", "known_place": "at its known place"}
"""How planets are looked for, for the middle of a sentence."""

_REASONS: dict[str, str] = {
    "": "",
    "speckle_floor": "no length of visit is enough",
    "common_speckle_floor": "no number of visits is enough",
    "planet_moves": "the planet moves too far",
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
    "no_noise": "nothing makes noise: there is no ratio",
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
    "common_speckle": "speckles that references never show",
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
    "twice_the_time": "visits twice as long",
    "twice_the_visits": "twice the visits",
    "half_the_drift": "half the drift of the wavefront",
    "half_the_read_noise": "half the read noise",
    "half_the_clock_charge": "half the clock-induced charge",
    "half_the_star_light": "half the starlight in the hole",
    "four_times_the_reference": "four times the reference frames (their time not counted)",
}

#: What keeps a star from being seen.
BLOCK_WORDS: dict[str, str] = {
    "sun": "too near the Sun",
    "moon": "too near the Moon",
    "panel": "panels out of the Sun",
    "limb": "behind the Earth",
}

#: What excludes planets of a population.
EXCLUSIONS: dict[str, str] = {
    "rv": "radial velocities",
    "stability": "companion stars",
    "known_giants": "known giants",
}

#: Flags that the planner adds; those of the catalogue are described beside its data.
FLAGS: dict[str, str] = {
    "companion_light_on": "light of the nearest companion is included",
    "companion_light_off": "light of a known companion is left out on request",
    "companion_light_unknown": "a close companion is known but cannot be placed: its light is not included",
    "companion_colour_assumed": "companion given the star's own colour",
    "hole_not_reached": "the dark hole of the band is brighter than asked of the instrument",
    "shorter_visit_is_better": "less than the given time is used: the walk of the wavefront makes a longer visit worse",
    "modes_limited": "fewer modes than asked for: a library has fewer than reference visits, an idealised one has none",
    "modes_not_modelled": "the prediction is for the mean of the references: modes are not modelled in this band",
    "modes_not_counted": "rankings predict for the mean of the references, not for modes",
    "converter_assumed": "no detector.gain_e_adu is given: the converter spans the full well of a pixel",
    "inherited_rounding": "the largest noise is rounding, by detector.gain_e_adu of the preset: give your own",
    "inherited_read_noise": "the largest noise is read noise, by detector.read_noise_e of the preset: give your own",
    "inherited_cic": "the largest noise is clock-induced charge, by detector.cic_e of the preset: give your own",
    "inherited_dark": "the largest noise is dark current, by detector.dark_e_s of the preset: give your own",
    "visits_at_limit": "the best number of visits is the largest that there can be: 1000, or one frame each",
    "blind_law_not_measured": "no search without a known place was measured here: detection is that at a known place",
    "companion_saturates": "a companion on the frame overflows its pixels: its blooming is not followed",
    "sky_place_unknown": "the star has no coordinates: the zodiacal light is its median over the whole sky",
    "companion_pa_unknown": "the sources give no position angle for the companion: its light is that of all angles",
    "companion_position_old": "the companion has no known orbit, and was seen over 10 years before or nobody says when",
    "stability_extrapolated": "the binary lies outside the range of the fit that says where its planets are stable",
    "stellar_grid_clamped": "temperature, gravity or metallicity clamped to the edge of the spectral grid",
    "reference_star_clamped": "the reference star has the colours of the nearest edge of the spectral grid",
    "fsed_clamped": "f_sed above 6 is taken as 6, the largest with models behind it",
    "insolation_clamped": "the planet's insolation is outside the models' 0.5-5 au: the nearer end is used",
    "excluded_by_rv": "radial velocities would have shown the reference planet, with the least mass that its radius "
    "allows, in at least 90 % of all orientations",
    "extrapolated": "beyond the range of its input data",
    "clamped": "an input was clamped to the range of its model",
    "speckle_error_extrapolated": "the error of the speckles is that of the nearest separation where it was measured",
    "exposure_beyond_max": "the exposure asked for is longer than the camera's longest",
}

_SMALLEST_GAIN = 1.005
_CAPS = {
    "hole": "keeps the pixels inside the dark hole unsaturated",
    "register_tail": "keeps bright starlight beside the hole from trailing into it through the register",
    "frame": "leaves every pixel of the whole frame unsaturated",
}


@functools.cache
def _catalogue_flags() -> dict[str, str]:
    text = resources.files("catalogs").joinpath("data/stars_columns.json").read_text(encoding="utf-8")
    return dict(json.loads(text)["quality_flags"])


def _spelled(words: Mapping[str, str], code: str) -> str:
    """Return what a code means; an unknown one with spaces for underscores."""
    return words.get(code, code.replace("_", " "))


def status_text(status: str) -> str:
    """Return a status as words."""
    return _spelled({}, status)


def verdict_text(verdict: str | None, status: str = "") -> str:
    """Return a verdict, or the status where there is none, as words."""
    return _spelled(VERDICTS, status if verdict is None else verdict)


def reason_text(reason: str) -> str:
    """Return a reason code as words."""
    return _spelled(_REASONS, reason)


def term_text(term: str) -> str:
    """Return a term of the noise as words."""
    return _spelled(TERMS, term)


def remedy_text(remedy: str) -> str:
    """Return a remedy as words."""
    return _spelled(REMEDIES, remedy)


def remedies_text(remedies: Mapping[str, float]) -> str:
    """Return what would raise the SNR, the most helpful first and by which factor; empty if nothing would."""
    helpful = sorted(remedies.items(), key=lambda item: -item[1])
    return "; ".join(f"×{factor:.2f} {remedy_text(name)}" for name, factor in helpful if factor >= _SMALLEST_GAIN)


def short_limit(limit: str) -> str:
    """Return a limit in one or two words; empty for none."""
    return LIMITS[limit][0] if limit in LIMITS else _spelled({}, limit)


def limit_text(limit: str) -> str:
    """Return a limit as words that follow "is held by"."""
    return LIMITS[limit][1] if limit in LIMITS else _spelled({}, limit)


def flag_text(flag: str) -> str:
    """Return a flag as words; unknown flags with spaces for underscores."""
    of_library = next((item.caveats[flag] for item in LIBRARIES.values() if flag in item.caveats), "")
    return of_library or FLAGS.get(flag) or ADDED_FLAGS.get(flag) or _spelled(_catalogue_flags(), flag)


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


def score_number(value: float, score: str) -> str:
    """Return a score as text with sensible digits, in the unit that people read."""
    places, value = SCORES[score].decimals, value * SCORES[score].written[0]
    if places is not None:
        return decimals(value, places)
    return "0" if value == 0.0 else significant(value) if value >= 1e-3 else f"{value:.1e}"


def cap_sentence(name: str, gain: float) -> str:
    """Return what a gain spares; 0 means that not even gain 1 does."""
    what = _CAPS.get(name, name.replace("_", " "))
    return f"EM gain up to {significant(gain)} {what}" if gain >= 1.0 else f"no EM gain {what}"


def orbits_text(rows: Iterable[ProgrammeColumns]) -> str:
    """Return how many orbits blind searches go through and what their threshold pays for them, for a sentence.

    Parameters
    ----------
    rows : iterable of ProgrammeColumns
        Answers or ranked stars.

    Returns
    -------
    str
        Empty where orbits are followed, and in older results.
    """
    seen = [(row.orbits_searched, row.motion_factor or 1.0) for row in rows if row.orbits_searched is not None]
    if not seen:
        return ""
    few, many = min(seen)[0], max(seen)[0]
    if many == 1:
        return "no planet leaves its place meanwhile, so that one orbit is searched"
    extra = 100.0 * (max(factor for _, factor in seen) - 1.0)
    numbers = f"{many}" if few == many else f"{few} to {many}"
    return f"{numbers} orbits are searched, which raises the threshold by up to {extra:.2g} %"


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


@functools.cache
def prose() -> Mapping[str, Any]:
    """Return paragraphs, lists and terms of reports by their names in ``prose.yaml``, which says what each is."""
    text = resources.files("cpic_planner.report").joinpath("templates/prose.yaml").read_text(encoding="utf-8")
    return dict(parse_yaml(text, where="prose.yaml"))


def terms(words: str = "") -> list[tuple[str, str]]:
    """Return terms and their meanings in the order of the glossary: all, or those named, with ``; `` between them."""
    named = words.split("; ") if words else prose()["terms"]
    return [(word, text) for word, text in prose()["terms"].items() if word in named]


def counted(count: float, noun: str) -> str:
    """Return a number with its noun: 1 visit, 2 visits."""
    return f"{count_text(int(count))} {noun}{'' if count == 1 else 's'}"


_MOST_NAMED = 10


def targets_sentences(plan: PlanResult) -> list[str]:
    """Return where the targets come from: stars that are seen in a period, or the visits of a schedule."""
    found = []
    if plan.schedule is not None:
        made = plan.schedule
        left = made.n_stars - len(plan.targets)
        found.append(
            f"Targets, frames and numbers of visits are those of a schedule, {made.source}: the images stand for "
            f"{made.n_imaged} of {counted(made.n_visits, 'visit')}"
            + (f"; {counted(left, 'more star')} can be imaged (a larger --top)." if left else ".")
        )
        found.append(
            "All visits of a star and band are reduced together, in images with the planet at one place: of months "
            "between visits they know that the wavefront has changed, not that the planet moves."
        )
    if plan.period is not None:
        period = plan.period
        found.append(
            f"Targets are seen for as long as their best observation takes in the {counted(period.n_days, 'day')} from "
            f"{period.start_utc[:10]} on (limits of pointing: {period.pointing})."
        )
        if period.not_checked:
            names = ", ".join(map(pretty_name, period.not_checked))
            found.append(f"Visibility is not known of {names}: the star table has no coordinates.")
        if period.left_out:
            named = [
                f"{pretty_name(row.name)}, rank {row.rank} ({row.message})" for row in period.left_out[:_MOST_NAMED]
            ]
            rest = len(period.left_out) - len(named)
            more = f"; and {counted(rest, 'more star')}, which plan.json names" if rest else ""
            found.append(f"Left out, limited by visibility: {'; '.join(named)}{more}.")
    return found


def not_imaged_lines(plan: PlanResult) -> list[str]:
    """Return the lines of a schedule that have no images, one text for each reason."""
    rows: dict[str, list[str]] = {}
    for row in () if plan.schedule is None else plan.schedule.not_imaged:
        rows.setdefault(row.message, []).append(f"{row.row} ({pretty_name(row.star)}, {row.band})")
    return [f"No images of row{'s' * (len(named) > 1)} {', '.join(named)}: {why}." for why, named in rows.items()]
