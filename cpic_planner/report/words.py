"""Numbers, names of stars and codes as text, and the prose of reports."""

from __future__ import annotations

import functools
import json
import math
import re
import string
from collections.abc import Callable, Iterable, Mapping
from importlib import resources
from typing import Any

from catalogs import ADDED_FLAGS, CONSTELLATIONS, GREEK, SHIPPED_FLAGS
from cpic_planner import queries, results
from cpic_planner.registry import SCORES
from simulator.detectors import noise_terms
from simulator.knobs import Quantity

_NAME_LENGTH = 18


_LEAD = re.compile(r"^(?:\*\*|\*|V\*|NAME|Cl\*|EM\*)\s+")


_BAYER = re.compile(r"^([A-Za-z]{1,3})\.?(\d{0,2})\s+([A-Z][A-Za-z]{2})((?:\s+\S+)?)$")


def pretty_name(identifier: str) -> str:
    """Return a SIMBAD identifier as people write it.

    Parameters
    ----------
    identifier : str
        SIMBAD main identifier, for example ``* alf Cen B``, ``V* AK Lep``, ``NAME Proxima Centauri``, ``HD  10700``.

    Returns
    -------
    str
        For example ``α Cen B``, ``AK Lep``, ``Proxima Centauri``, ``HD 10700``. A text that follows no known rule
        comes back with single spaces, otherwise untouched: it may hold any character, so escape it for the medium.
    """
    name = _LEAD.sub("", " ".join(identifier.split()))
    match = _BAYER.match(name)
    if match is None or match[3] not in CONSTELLATIONS:
        return name
    letter, index, sky, component = match.groups()
    symbol = GREEK[letter][0] if letter in GREEK else letter
    if letter not in GREEK and len(letter) > 1:  # a variable-star name such as AK Lep
        return name
    return f"{symbol}{str(int(index)).translate(_SUPERSCRIPT) if index else ''} {sky}{component}"


def full_name(identifier: str, hip: int | None) -> str:
    """Return the readable name with the Hipparcos number, where there is one and the name is not that number."""
    name = pretty_name(identifier)
    return name if hip is None or name == f"HIP {hip}" else f"{name} (HIP {hip})"


def star_text(result: Any) -> str:
    """Return name, brightness and distance of the star that a result is about."""
    return f"{full_name(result.target, result.hip)}: V {result.v_mag:.2f} mag, {significant(result.distance_pc, 4)} pc"


def short_name(identifier: str) -> str:
    """Return the readable name of a star, cut to the width of a column."""
    return shortened(pretty_name(identifier))


def shortened(name: str) -> str:
    """Return a name cut to the width of a column."""
    return name if len(name) <= _NAME_LENGTH else f"{name[: _NAME_LENGTH - 1]}…"


_LEAST_UNUSED, _MOST_UNUSED = 0.01, 6
"""Share of the given time from which on it is said that it is left unused, and most programmes that are named."""


def unused_text(rows: Iterable[Any]) -> str:
    """Return what programmes leave unused of the given time, in words; empty where each leaves less than 1 %.

    Parameters
    ----------
    rows : iterable
        With ``unused_s``, ``time_s`` and ``band``.
    """
    told = [(row.unused_s, row.unused_s + row.time_s, row.band) for row in rows if row.unused_s is not None]
    told = [(left, given, band) for left, given, band in told if left > _LEAST_UNUSED * given]
    if not told:
        return ""
    if len(told) > _MOST_UNUSED:
        left, given, _ = max(told)
        return f"Left unused: up to {duration_text(left)} of {duration_text(given)}, in {len(told)} programmes"
    bands: dict[str, dict[str, None]] = {}
    for left, given, band in told:
        bands.setdefault(f"{duration_text(left)} of {duration_text(given)}", {})[band] = None
    parts = (f"{text} in {', '.join(names)}" for text, names in bands.items())
    return f"Left unused: {'; '.join(parts)}"


MISSING = "–"


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


_MINUTE_S, _HOUR_S = 60.0, 3600.0


def decimals(value: float | None, places: int) -> str:
    """Return ``value`` with fixed decimals; a dash if there is none."""
    return MISSING if value is None or not math.isfinite(value) else f"{value:.{places}f}".replace("-", "−")


def significant(value: float | None, digits: int = 3) -> str:
    """Return ``value`` to significant digits without exponent (for numbers of everyday size)."""
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0.0:
        return "0"
    places = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{places}f}".replace("-", "−")


def contrast_text(value: float | None, digits: int = 3) -> str:
    """Return a flux ratio as ``5.16 × 10⁻⁸``."""
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa} × {power_of_ten(int(exponent))}".replace("-", "−")


def power_of_ten(exponent: int) -> str:
    """Return ``10⁻⁸`` for -8."""
    return "10" + str(exponent).translate(_SUPERSCRIPT)


def duration_text(value_s: float | None) -> str:
    """Return a time in the unit that people would use: s, min or h."""
    if value_s is None or not math.isfinite(value_s):
        return MISSING
    if value_s < 10 * _MINUTE_S:
        return f"{significant(value_s)} s"
    if value_s < _HOUR_S:
        return f"{significant(value_s / _MINUTE_S)} min"
    return f"{significant(value_s / _HOUR_S)} h"


def count_text(value: int | None) -> str:
    """Return an integer with thin spaces between thousands."""
    return MISSING if value is None else f"{value:,}".replace(",", "\u202f")


def chosen_text(count: int, whole: int | None, noun: str = "star") -> str:
    """Return the number of stars of a ranking, and of how many they were chosen: 2 chosen stars of 1077."""
    chosen = whole is not None and whole > count
    text = f"{count_text(count)} {'chosen ' * chosen}{noun}{'s' * (count != 1)}"
    return f"{text} of {count_text(whole)}" if chosen else text


def interval_text(low: float, high: float, digits: int = 2) -> str:
    """Return the ends of an interval."""
    return f"{decimals(low, digits)} to {decimals(high, digits)}"


def percent_text(value: float | None) -> str:
    """Return a fraction as per cent."""
    return MISSING if value is None or not math.isfinite(value) else f"{significant(100.0 * value, 2)} %"


def share_text(value: float) -> str:
    """Return a fraction in per cent without the sign, for columns that name the unit."""
    if 0.9995 <= value < 1.0:
        return ">99.9"
    return "0" if value == 0.0 else significant(100.0 * value) if value >= 1e-4 else "<0.01"


def ratio_text(value: float | None) -> str:
    """Return a flux ratio in the compact form of terminals: ``5.16e-08``."""
    return formatted(value, ".2e")


def size_text(size_bytes: float) -> str:
    """Return a size in the unit that people would use: kB, MB or GB."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6)):
        if size_bytes >= scale:
            return f"{significant(size_bytes / scale)} {unit}"
    return f"{significant(size_bytes / 1e3)} kB"


_TEXTS: dict[str, Callable[[Any], str]] = {
    "d": count_text,
    "%": share_text,
    "time": duration_text,
    "min": lambda value: decimals(value / _MINUTE_S, 1),
    "bytes": size_text,
    "power": contrast_text,
    "star": short_name,
    "name": pretty_name,
}


def formatted(value: Any, form: str = "") -> str:
    """Return one value as a table shows it.

    Parameters
    ----------
    value : number, str, bool, list or None
        A dash where there is none, and for an empty list. Of `cpic_planner.results.Quantiles` the median is shown.
    form : str
        ``.3f`` (decimals), ``+.3f`` (with a sign), ``±.3f`` (of quantiles also half of the width that holds 68 %),
        ``.3g`` (significant digits, no exponent), ``.2e``, ``power`` (of ten), ``g``, ``d`` (thin spaces between
        thousands), ``%`` (per cent without the sign), ``time`` (s, min or h), ``min`` (minutes of a time in s),
        ``bytes``, ``name`` (of a star, as people write it), ``star`` (the same, cut to the width of a column); empty:
        three significant digits of numbers, everything else as it is.

    Returns
    -------
    str
    """
    if form.startswith("±"):
        spread = ".0e" if form.endswith("e") else form[1:]
        return f"{formatted(value, form[1:])} ± {formatted(0.5 * (value.high - value.low), spread)}"
    value = getattr(value, "median", value)
    if value is None or value == []:
        return MISSING
    if form in _TEXTS:
        return _TEXTS[form](value)
    if form.startswith("+"):
        return f"{'+' if value > 0 else ''}{formatted(value, form[1:])}"
    if form.startswith(".") and form[-1] in "fg":
        return (decimals if form[-1] == "f" else significant)(value, int(form[1:-1]))
    if form:
        return f"{value:{form}}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value))
    return significant(value) if isinstance(value, float) else str(value)


def level_text(snr: float | None, sigma: float | None) -> str:
    """Return the level that is asked for, in words; a detection where neither is given."""
    if snr is not None:
        return f"SNR {snr:g}"
    return "a detection" if sigma is None else f"{sigma:g} sigma"


WORDS = json.loads(resources.files("cpic_planner.report").joinpath("templates/words.json").read_text(encoding="utf-8"))
"""Words for codes, by what the codes are of."""


#: Symbol of each status, so that badges do not rely on colour.
STATUS_SYMBOLS: dict[str, str] = WORDS["status_symbols"]


#: Whether a planet is detected; only the first has a mark, which is green.
VERDICTS: dict[str, str] = WORDS["verdicts"]


#: What limits an answer: in one or two words, and as the end of a sentence about stars or bands.
LIMITED_BY: dict[str, tuple[str, str]] = {code: (short, long) for code, (short, long) in WORDS["limited_by"].items()}


SEARCHES: dict[str, str] = WORDS["searches"]
"""How planets are looked for, for the middle of a sentence."""


_REASONS: dict[str, str] = WORDS["reasons"]


#: What contrasts refer to.
STAR_FLUX: dict[str, str] = WORDS["star_flux"]


#: How firm a fit of metallicity and clouds is.
ALBEDO_STATUS: dict[str, str] = WORDS["albedo_status"]


#: How realisations are made.
DRAWN_AS: dict[str, str] = WORDS["drawn_as"]


#: Terms of the variance.
TERMS: dict[str, str] = WORDS["terms"] | {
    term: effect.term_label or effect.label for term, effect in noise_terms().items()
}


#: Limits of exposure and gain: in one or two words, and in a sentence after "is held by".
LIMITS: dict[str, tuple[str, str]] = {code: (short, long) for code, (short, long) in WORDS["limits"].items()}


REMEDIES: dict[str, str] = WORDS["remedies"]


#: What keeps a star from being seen.
BLOCK_WORDS: dict[str, str] = WORDS["blocks"]


#: What excludes planets of a population.
EXCLUSIONS: dict[str, str] = WORDS["exclusions"]


#: Flags that the planner adds; those of the catalogue are described beside its data.
FLAGS: dict[str, str] = WORDS["flags"]


_SMALLEST_GAIN = 1.005


_CAPS: dict[str, str] = WORDS["gain_caps"]


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


def found_text(verdict: str) -> str:
    """Return what images showed of a target as people read it: its reason codes as words, ± for +-."""
    return plus_minus(re.sub(r"\b[a-z]+(?:_[a-z]+)+\b", lambda code: reason_text(code[0]), verdict))


def term_text(term: str) -> str:
    """Return a term of the noise as words."""
    return _spelled(TERMS, term)


def remedy_text(remedy: str) -> str:
    """Return a remedy as words."""
    return _spelled(REMEDIES, remedy)


def held_texts(row: results.EtcAnswer | results.BandStanding) -> list[str]:
    """Return what the exposure and the gain of frames are held by, in words."""
    limits = {"exposure": row.exposure_limited_by, "EM gain": row.gain_limited_by}
    return [f"the {name} is held by {limit_text(limit)}" for name, limit in limits.items() if limit]


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
    of_library = next((item.caveats[flag] for item in queries.LIBRARIES.values() if flag in item.caveats), "")
    return of_library or FLAGS.get(flag) or _spelled(ADDED_FLAGS | SHIPPED_FLAGS, flag)


def plus_minus(text: str) -> str:
    """Return a text with ± for the two characters that plain results have."""
    return text.replace("+-", "±")


def sentence(text: str) -> str:
    """Return a text as a sentence: capital, ±, full stop; empty for none."""
    return f"{plus_minus(text[:1].upper() + text[1:])}." if text else ""


def tau_text(top: int) -> str:
    """Say what Kendall's tau of a ranking under another assumption compares; ``top`` are the stars looked at."""
    return text("texts.tau", top=top)


def overrides_text(overrides: Mapping[str, Any]) -> str:
    """Return what is altered in the images, as people write it; empty if nothing is.

    Parameters
    ----------
    overrides : mapping
        ``simulator_overrides`` of a result.
    """
    return queries.SimulatorOverrides.of(overrides).text().replace(" x", " ×") if overrides else ""


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


def orbits_text(rows: Iterable[results.ProgrammeColumns]) -> str:
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
    import yaml

    text = resources.files("cpic_planner.report").joinpath("templates/prose.yaml").read_text(encoding="utf-8")
    # Forty times as fast as the strict reader of users' files, of which our own needs nothing.
    return dict(yaml.load(text, Loader=yaml.CSafeLoader) if yaml.__with_libyaml__ else yaml.safe_load(text))


def text(name: str, /, **values: Any) -> str:
    """Return a text of ``prose.yaml`` with values in its braces.

    They are written as `formatted` says; ``#``: how many there are.

    Parameters
    ----------
    name : str
        Of the text, with those of the mappings that it stands in: ``pictures.yields.alt``.
    **values
        What the braces name.
    """
    found: Any = prose()
    for part in name.split("."):
        found = found[part]
    return _Prose().format(found, **values)


def hidden_sentence(what: str, count: int) -> str:
    """Return the sentence that says of how many things a picture shows nothing; empty for none."""
    return f" {what}, not shown: {count}." if count else ""


class _Prose(string.Formatter):
    def format_field(self, value: Any, form: str) -> str:
        return str(len(value)) if form == "#" else formatted(value, form) if form else str(value)


def terms(words: str = "") -> list[tuple[str, str]]:
    """Return terms and their meanings in the order of the glossary: all, or those named, with ``; `` between them."""
    named = words.split("; ") if words else prose()["terms"]
    return [(word, text) for word, text in prose()["terms"].items() if word in named]


def counted(count: float, noun: str) -> str:
    """Return a number with its noun: 1 visit, 2 visits."""
    return f"{count_text(int(count))} {noun}{'' if count == 1 else 's'}"


def mode_of(rank: results.RankResult) -> results.DetectionMode:
    """Return how the reference planets of a ranking are looked for; at their known place in older results."""
    return next((row.verdict_mode for row in rank.targets if row.verdict_mode), "known_place")


QUANTITIES: dict[Quantity, str] = {"planet_flux": "planet flux", "snr": "SNR", "pixel_map": "pixels of a frame"}
"""Names of the quantities that errors refer to."""


LEAST_SIZE = 1e-6


def dial_text(result: results.ImagedResult) -> str:
    """Return the setting of the dial in words: ``fidelity standard``, ``tolerance 2 %``."""
    if result.fidelity == "custom" and result.tolerance:
        return f"tolerance {error_percent(max(result.tolerance.values()))}"
    return f"fidelity {result.fidelity}"


def error_text(errors: Mapping[Quantity, float | None]) -> str:
    """Return errors of quantities in words."""
    return ", ".join(f"{QUANTITIES[name]} {error_percent(value)}" for name, value in errors.items())


def error_percent(value: float | None) -> str:
    """Return an error as per cent, which may have no bound, or be too small to matter."""
    if value is None:
        return "without a bound"
    if 0 < value < LEAST_SIZE:
        return f"below {100 * LEAST_SIZE:g} %"
    return f"{significant(100.0 * value, 2)} %"
