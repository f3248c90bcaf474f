"""Numbers and star names as text: sensible digits, units beside them, a dash where there is no value."""

import math
import re
from collections.abc import Callable, Iterable
from typing import Any

from catalogs import CONSTELLATIONS, GREEK

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
    "star": short_name,
}


def formatted(value: Any, form: str = "") -> str:
    """Return one value as a table shows it.

    Parameters
    ----------
    value : number, str, bool, list or None
        A dash where there is none, and for an empty list. Of `cpic_planner.results.Quantiles` the median is shown.
    form : str
        ``.3f`` (decimals), ``.3g`` (significant digits, no exponent), ``.2e``, ``g``, ``d`` (thin spaces between
        thousands), ``%`` (per cent without the sign), ``time`` (s, min or h), ``min`` (minutes of a time in s),
        ``bytes``, ``star`` (readable name, cut to the width of a column); empty: three significant digits of numbers,
        everything else as it is.

    Returns
    -------
    str
    """
    value = getattr(value, "median", value)
    if value is None or value == []:
        return MISSING
    if form in _TEXTS:
        return _TEXTS[form](value)
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
