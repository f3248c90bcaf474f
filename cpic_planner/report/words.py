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

_WORDS = json.loads(resources.files("cpic_planner.report").joinpath("templates/words.json").read_text(encoding="utf-8"))

#: Symbol of each status, so that badges do not rely on colour.
STATUS_SYMBOLS: dict[str, str] = _WORDS["status_symbols"]


#: Whether a planet is detected; only the first has a mark, which is green.
VERDICTS: dict[str, str] = _WORDS["verdicts"]

#: What limits an answer: in one or two words, and as the end of a sentence about stars or bands.
LIMITED_BY: dict[str, tuple[str, str]] = {code: (short, long) for code, (short, long) in _WORDS["limited_by"].items()}

SEARCHES: dict[str, str] = _WORDS["searches"]
"""How planets are looked for, for the middle of a sentence."""

_REASONS: dict[str, str] = _WORDS["reasons"]

#: What contrasts refer to.
STAR_FLUX: dict[str, str] = _WORDS["star_flux"]

#: How firm a fit of metallicity and clouds is.
ALBEDO_STATUS: dict[str, str] = _WORDS["albedo_status"]

#: How realisations are made.
DRAWN_AS: dict[str, str] = _WORDS["drawn_as"]

#: Terms of the variance.
TERMS: dict[str, str] = _WORDS["terms"] | {
    term: effect.term_label or effect.label for term, effect in noise_terms().items()
}

#: Limits of exposure and gain: in one or two words, and in a sentence after "is held by".
LIMITS: dict[str, tuple[str, str]] = {code: (short, long) for code, (short, long) in _WORDS["limits"].items()}

REMEDIES: dict[str, str] = _WORDS["remedies"]

#: What keeps a star from being seen.
BLOCK_WORDS: dict[str, str] = _WORDS["blocks"]

#: What excludes planets of a population.
EXCLUSIONS: dict[str, str] = _WORDS["exclusions"]

#: Flags that the planner adds; those of the catalogue are described beside its data.
FLAGS: dict[str, str] = _WORDS["flags"]

_SMALLEST_GAIN = 1.005
_CAPS: dict[str, str] = _WORDS["gain_caps"]


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
