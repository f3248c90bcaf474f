"""Spectral type -> effective temperature and surface gravity, by published mean sequences."""

import functools
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import InputError

PARAMETERS_SOURCE = "derived:spectral type (Pecaut & Mamajek 2013; Cox 2000)"
_FILE = Path(__file__).resolve().parent / "data" / "spectral_types.yaml"
_LETTERS = "OBAFGKM"
_RANKS = {"I": 1.0, "II": 2.0, "III": 3.0, "IV": 4.0, "V": 5.0, "VI": 5.0}
_NAMES = ("I", "I-II", "II", "II-III", "III", "III-IV", "IV", "IV-V", "V")
_PREFIX_RANKS = {"usd": 5.0, "esd": 5.0, "sd": 5.0, "d": 5.0, "g": 3.0, "c": 1.0}
_MIDDLE_SUBCLASS = 5.0
_LONGEST = 200

_MARKS = r"[:?~()]*"
# "F5", "F5:", "(G8)", "G2-3", "F7/8", "G8/K0", "G8+": one class, perhaps to a second one.
_TEMPERATURE = re.compile(
    rf"{_MARKS}(?P<prefix>(?:usd|esd|sd|d|g|c)(?=:?{_MARKS}[OBAFGKM]))?{_MARKS}"
    rf"(?P<letter>[OBAFGKM]){_MARKS}(?:\s?(?P<sub>\d(?:\.\d+)?))?{_MARKS}"
    rf"(?:\s?[-/]\s?(?P<letter2>[OBAFGKM](?=\d))?(?P<sub2>\d(?:\.\d+)?){_MARKS})?"
)
_HYDROGEN = re.compile(r"^k[OBAFGKM]\d.*?(?=h[OBAFGKM]\d)")
_CLASS = r"(III|II|IV|I|VI|V)(?![IVX])(?:a0|a\+|ab|a|b|0)?"
_LUMINOSITY = re.compile(rf"(?<![A-RT-Z]){_CLASS}(?:{_MARKS}\s?[-/,]\s?\(?{_CLASS})?")
_LOWER_CLASS = re.compile(r"^(\s?)((?:iii|ii|iv|i|vi|v)(?:[-/](?:iii|ii|iv|i|vi|v))?)(?![a-df-z])")
# A plus before the luminosity class is a subtype a little later (G8+V), one before an index an abundance (V+CN+1).
_SECOND_STAR = re.compile(
    r"\+\s?(?:\.\.|\(?(?:[sdgck]|sd)?:?(?!C[NH])[OBAFGKMDWLTSCN](?![a-z])|[obafgkm]\d|(?<!C[NH]\+)(?<!Fe\+|Ba\+)(?P<end>[\s?:]*$))"
)
# Am, Fp, Be: a peculiarity right after the letter, where the subclass is missing.
_BARE_LETTER = re.compile(r"(?:[empnswv]+(?![a-z])|(?![a-z]))(?![A-HJ-UW-Z])")

_OTHER_KINDS = (
    (r"|~|-+|\?|n/?a|nan|none|null|unknown", "the type is not known"),
    (r"d[aboqz].*", "write dA2 for a dwarf of class A, DA2 for a white dwarf"),
    (r"sd:?[OB].*", "a hot subdwarf"),
    (r"D([ABCOQXZ].*|\d.*)?|WD.*", "a white dwarf"),
    (r"[LTY]\d.*", "a brown dwarf"),
    (r"W([NCOR].*|\d.*)?", "a Wolf-Rayet star"),
    (r"(C|C-[A-Z]|CH|MS|N|R|S|SC)([\d:.,/ (v-].*)?", "a carbon or S star"),
)


@dataclass(frozen=True)
class SpectralType:
    """A parsed MK type.

    Attributes
    ----------
    position : float
        Place on the temperature sequence: 10 x letter number (O = 0 ... M = 6) + subclass.
    luminosity_rank : float
        1 supergiant, 3 giant, 4 subgiant, 5 dwarf; the mean for a range such as ``IV-V``.
    flags : tuple of str
        ``subclass_assumed``, ``luminosity_class_assumed`` where the text does not say; ``type_uncertain`` for a
        colon or question mark; ``composite_first_used`` for two stars in one type; ``subdwarf_as_dwarf`` for
        sd and VI, whose temperature and gravity are taken from the dwarfs.
    """

    position: float
    luminosity_rank: float
    flags: tuple[str, ...]


@dataclass(frozen=True)
class StellarParameters:
    """Mean parameters of a spectral type: temperature (K), log10 of gravity (cm/s2), and flags."""

    teff_k: float
    log_g: float
    flags: tuple[str, ...]


def parse_spectral_type(text: str) -> SpectralType:
    """Read an MK spectral type as people write it: ``K1V``, ``g2 v``, ``G8.5IV-V``, ``F7/8 V``, ``sdF8``, ``K0III+G``.

    Of a range the mean counts, of a composite type the first component, of a metallic-line type (``kA5hF0mF2``) the
    hydrogen lines; other peculiarities are ignored. A missing subclass is taken as 5 and a missing luminosity class
    as V, with a flag. Lower case is read too, except where it would mix up dwarfs with white dwarfs (``da2``).

    Raises
    ------
    InputError
        If the text is not a type of class O, B, A, F, G, K or M.
    """
    if not isinstance(text, str):
        raise InputError("spectral_type", text, allowed="text such as K1V")
    return _parsed(_plain(text))


@functools.lru_cache(maxsize=10_000)
def _parsed(name: str) -> SpectralType:
    """Return what a type without blanks means; tables have few types and many stars."""
    second_star = _SECOND_STAR.search(name, 1)
    first = name[: second_star.start()] if second_star else name
    body = re.sub(r"^\([^)]*\)(?=[OBAFGKM])", "", _HYDROGEN.sub("", first)).removeprefix("h")
    if re.match(r"k[OBAFGKM]\d", body):
        body = body[1:]
    found = _TEMPERATURE.match(body)
    rest = body[found.end() :] if found else ""
    if not found or (not found["sub"] and not _BARE_LETTER.match(rest)):
        raise _refusal(name)
    if "sd" in (found["prefix"] or "") and found["letter"] in "OB":
        raise _refusal(name)
    rest = _LOWER_CLASS.sub(lambda item: item[1] + item[2].upper(), rest)
    flags = []
    subclass = _MIDDLE_SUBCLASS
    if found["sub"]:
        subclass = float(found["sub"])
    else:
        flags.append("subclass_assumed")
    position = 10.0 * _LETTERS.index(found["letter"]) + subclass
    if found["sub2"]:
        other = 10.0 * _LETTERS.index(found["letter2"] or found["letter"]) + float(found["sub2"])
        position = 0.5 * (position + other)
    rank, subdwarf = _luminosity(rest, found["prefix"] or ("d" if rest.startswith("d") else ""))
    if rank is None and second_star:  # F8+G0V: one class for both
        rank = _luminosity(name[len(first) :], "")[0]
    if rank is None:
        rank = 5.0
        flags.append("luminosity_class_assumed")
    if subdwarf:
        flags.append("subdwarf_as_dwarf")
    if re.search(r"[:?]", first):
        flags.append("type_uncertain")
    if second_star and (second_star["end"] is None or _class_ends(first, name)):
        flags.append("composite_first_used")
    return SpectralType(position, rank, tuple(flags))


def stellar_parameters(text: str) -> StellarParameters:
    """Return mean effective temperature and surface gravity of a spectral type.

    Dwarfs follow Pecaut & Mamajek 2013 (version 2022.04.16), giants, supergiants and all gravities Cox 2000.
    Classes IV and II are the means of their neighbours.

    Parameters
    ----------
    text : str
        Spectral type, see `parse_spectral_type`.

    Raises
    ------
    InputError
        If the type cannot be read or lies outside the tables (B0 to M6, supergiants to M4).
    """
    spectral_type = parse_spectral_type(text)
    upper = "V" if spectral_type.luminosity_rank > 3.0 else "III"
    lower = "III" if upper == "V" else "I"
    top = 5.0 if upper == "V" else 3.0
    share = (top - spectral_type.luminosity_rank) / 2.0
    tables = _tables()
    ends = [(upper, 1.0 - share)] + ([(lower, share)] if share > 0.0 else [])
    teff_k = log_g = 0.0
    for name, weight in ends:
        position, values = tables["teff_k"][name]
        if not position[0] <= spectral_type.position <= position[-1]:
            raise InputError("spectral_type", text, allowed="B0 to M6 (supergiants to M4)")
        teff_k += weight * float(np.interp(spectral_type.position, position, values))
        # Beyond its last entry gravity stays at that entry; the temperature table sets the range.
        log_g += weight * float(np.interp(spectral_type.position, *tables["log_g"][name]))
    return StellarParameters(teff_k, log_g, spectral_type.flags)


@functools.lru_cache(maxsize=10_000)
def _plain(text: str) -> str:
    """Return the text with plain dashes, single blanks and, if it is all lower case, capital classes."""
    if len(text) > _LONGEST:
        raise InputError("spectral_type", f"{len(text)} characters", allowed=f"at most {_LONGEST} characters")
    name = unicodedata.normalize("NFKC", text)
    name = re.sub(r"[\u2010-\u2015\u2212]", "-", name).replace("\u2026", "...")
    name = re.sub(r"(?<=\d),(?=\d)", ".", " ".join(name.split()))
    if name != name.lower() or re.match(r"d[aboqz]", name):
        return name
    prefix = re.match(r"(?:usd|esd|sd|[dgc])(?=:?[obafgkm]\d)", name)
    start = prefix.end() if prefix else 0
    letter = r"^(:?)([obafgkm])(?!\s?[a-z]*[a-hj-uw-z]{2})"
    return name[:start] + re.sub(letter, lambda m: m[1] + m[2].upper(), name[start:])


def _luminosity(rest: str, prefix: str) -> tuple[float | None, bool]:
    """Return the rank of the luminosity class and whether the star is a subdwarf; rank None if not said."""
    found = _LUMINOSITY.search(rest)
    if found:
        classes = [item for item in found.groups() if item]
        return sum(_RANKS[item] for item in classes) / len(classes), "VI" in classes or "sd" in prefix
    return _PREFIX_RANKS.get(prefix), "sd" in prefix


def readable_type(sp_type: str) -> SpectralType | None:
    """Return what `parse_spectral_type` does, None of a type that cannot be read."""
    try:
        return parse_spectral_type(sp_type)
    except InputError:
        return None


def is_composite(sp_type: str) -> bool:
    """Tell whether a spectral type names more than one star; a plus may also be a mark (``G8+V``, ``G8V+CN+1``)."""
    found = readable_type(sp_type)
    return "composite_first_used" in found.flags if found else "+" in sp_type[1:]


def _class_ends(first: str, name: str) -> bool:
    """Tell whether a luminosity class has ended before a plus at the end of a type (F5V+, not G8+ and not A0Va+)."""
    found = _LUMINOSITY.search(name, 1)
    return found is not None and found.end() <= len(first)


def luminosity_class(sp_type: str) -> str:
    """Return the luminosity class of the first component of a spectral type, ``""`` if it has none.

    Prefixes count as classes: that of a giant (``gG8``) as III, those of dwarfs and subdwarfs (``dG2``, ``sdF8``) as V.
    """
    found = readable_type(sp_type)
    if found is None or "luminosity_class_assumed" in found.flags:
        return ""
    return _NAMES[round(2.0 * found.luminosity_rank) - 2]


def _refusal(name: str) -> InputError:
    hint = next((why for pattern, why in _OTHER_KINDS if re.fullmatch(pattern, name)), "")
    allowed = "an MK type of class O, B, A, F, G, K or M, such as K1V"
    return InputError("spectral_type", name or "empty", allowed=allowed, hint=hint)


@functools.cache
def _tables() -> dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]:
    from cpic_core import load_yaml, split_sourced

    values, _ = split_sourced(load_yaml(_FILE, shipped=True))
    teff = {name: _columns(table) for name, table in values["teff_k"].items()}
    log_g = {}
    for name, table in values["log_g_minus_sun"].items():
        position, offset = _columns(table)
        log_g[name] = (position, offset + values["log_g_sun"])
    return {"teff_k": teff, "log_g": log_g}


def _columns(table: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    position = np.array([10.0 * _LETTERS.index(key[0]) + float(key[1:]) for key in table])
    return position, np.array(list(table.values()), dtype=np.float64)
