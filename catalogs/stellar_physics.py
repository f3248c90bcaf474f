"""Spectral types; temperature, luminosity, radius, mass and gravity where a star table has none, each with its origin.

The shipped table is built with these relations, a refreshed one and a user's own table are filled with them.

- Teff and log g from the spectral type: published mean sequences (Pecaut & Mamajek 2013; Cox 2000).
- Teff from B-V and [Fe/H] (in the shipped table from V-Ks too): Casagrande et al. 2010, A&A 512, A54, table 4, for
  0.18 < B-V < 1.29 (used to 1.40, where stars with known temperatures still agree); at other B-V the black-body
  relation of Ballesteros 2012, EPL 97, 34008. Made for dwarfs and subgiants; that from B-V is used for giants too.
- Bolometric correction from Teff: Flower 1996, ApJ 469, 355, coefficients as corrected by Torres 2010, AJ 140, 1158,
  with M_bol,sun = 4.73, the value that belongs to them; what it leaves out, metallicity and gravity, is a small table
  from the spectra of the stellar grid (``bolometric_corrections.csv``): mag by gravity, metallicity and temperature,
  the correction of the grid (sigma T^4 over V, 1 Lsun for the Sun at V = -26.76) less Flower's. Cool dwarfs keep
  Flower's: the grid is too bright in V.
- Mass of dwarfs and subgiants from luminosity: Eker et al. 2018, MNRAS 479, 5491. Giants: 1.5 Msun assumed.
- log g = 4.438 + log M - 2 log R (solar units), R from L and Teff with Teff,sun = 5772 K (IAU 2015 resolution B3).
"""

import functools
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from catalogs.coordinates import ecliptic
from catalogs.shipped import shipped_rows
from cpic_core import InputError, NDArray, Record, in_unit

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


class SpectralType(Record):
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


class StellarParameters(Record):
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

    values, _ = split_sourced(load_yaml(_FILE))
    teff = {name: _columns(table) for name, table in values["teff_k"].items()}
    log_g = {}
    for name, table in values["log_g_minus_sun"].items():
        position, offset = _columns(table)
        log_g[name] = (position, offset + values["log_g_sun"])
    return {"teff_k": teff, "log_g": log_g}


def _columns(table: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    position = np.array([10.0 * _LETTERS.index(key[0]) + float(key[1:]) for key in table])
    return position, np.array(list(table.values()), dtype=np.float64)


DWARF_LOG_G = 4.5
GIANT_LOG_G = 2.5
GIANT_MASS_MSUN = 1.5
"""Mass given to every giant, solar masses (assumed)."""
TEFF_TOLERANCE_K = 600.0
"""A listed temperature farther than this from the median of its spectral subtype is not used."""
TEFF_DISAGREEMENT_K = 200.0
"""Estimates of a temperature that are farther than this from the adopted one disagree with it."""
INFRARED_SOURCE = "derived:V-Ks (Casagrande et al. 2010)"
LUMINOSITY_SOURCE = "derived:V, BC (Flower 1996; Torres 2010; own spectra)"
RADIUS_SOURCE = "derived:luminosity and Teff (Stefan-Boltzmann)"
MASS_SOURCE = "derived:luminosity (Eker et al. 2018)"
GRAVITY_SOURCE = "derived:mass and radius"

COOLEST_BC_K = 3500.0
"""Below this temperature the bolometric correction runs away: 1.6 and 3.6 times too bright for Lalande 21185 (3560 K)
and Barnard's star (3200 K), and more than a hundred times at 2400 K."""
_M_BOL_SUN = 4.73
_ARCSEC_AU_RSUN = 149597870.7 / 695700.0
"""Radii of the Sun (IAU 2015 resolution B3) that an angle of one arcsec spans at one parsec."""
_TEFF_SUN_K = 5772.0
_LOG_G_SUN = 4.438
_NEAR_SUBTYPES = 2.0
_LEAST_IN_SUBTYPE = 3
_GIANTS = ("III", "II", "I", "III-IV", "II-III", "I-II")
# Coefficients of Flower 1996 as corrected by Torres 2010.
_COOL = (-19053.7291496456, 15514.4866764412, -4212.78819301717, 381.476328422343)
_WARM = (-37051.0203809015, 38567.2629965804, -15065.1486316025, 2617.24637119416, -170.623810323864)
_HOT = (-118115.450538963, 137145.973583929, -63623.3812100225, 14741.2923562646, -1705.87278406872, 78.873172180499)


def spectral_letter(sp_type: str) -> str:
    """Return the letter O, B, A, F, G, K or M of a type's first component, ``""`` if it cannot be read.

    Prefixes and marks are read through (``sdF8``, ``(G2)V``, ``dK5``); a range counts by its middle (F9/G0 is F), a
    metallic-line type by its hydrogen lines (``kA5hF0mF2`` is F).
    """
    found = readable_type(sp_type)
    return "OBAFGKM"[int(found.position // 10.0)] if found else ""


def is_giant(sp_type: str) -> bool:
    """Tell whether the luminosity class is III-IV or brighter."""
    return luminosity_class(sp_type) in _GIANTS


def usual_gravity(sp_type: str) -> float:
    """Return the log g (cm/s2) by which the luminosity of a star of this type is found where none is measured."""
    return GIANT_LOG_G if is_giant(sp_type) else DWARF_LOG_G


def has_giant_scale(sp_type: str) -> bool:
    """Tell whether the type follows the giants' temperature scale; F giants share the dwarfs'."""
    return is_giant(sp_type) and spectral_letter(sp_type) != "F"


def spectral_subtype(sp_type: str) -> float:
    """Return the position in the sequence F0 = 0, G0 = 10, K0 = 20, nan without a digit."""
    found = re.match(r"([FGK])(\d(?:\.\d)?)", sp_type)
    return 10.0 * "FGK".index(found[1]) + float(found[2]) if found else float("nan")


def subtype_medians(stars: Iterable[tuple[str, float, float]]) -> dict[tuple[bool, int], tuple[float, float]]:
    """Return median (Teff, B-V) by (giant scale, whole subtype); subtypes of fewer than three stars are left out.

    Parameters
    ----------
    stars : iterable of (str, float, float)
        Spectral type, temperature (K; nan rows are skipped) and B-V (mag) of each star.
    """
    samples: dict[tuple[bool, int], list[tuple[float, float]]] = {}
    for sp_type, teff_k, b_v_mag in stars:
        subtype = spectral_subtype(sp_type)
        if np.isfinite(subtype) and np.isfinite(teff_k):
            samples.setdefault((has_giant_scale(sp_type), int(subtype)), []).append((teff_k, b_v_mag))
    return {
        key: (median(t for t, _ in pairs), median(c for _, c in pairs))
        for key, pairs in samples.items()
        if len(pairs) >= _LEAST_IN_SUBTYPE
    }


def measured_medians(columns: Mapping[str, NDArray[np.generic]]) -> dict[tuple[bool, int], tuple[float, float]]:
    """Return the :func:`subtype_medians` of those stars of a table whose temperatures are measured.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of a star table by name.
    """
    names = ("sp_type", "teff_k", "b_v_mag", "teff_k_src")
    cells = zip(*(columns[name].tolist() for name in names), strict=True)
    return subtype_medians((sp_type, teff, b_v) for sp_type, teff, b_v, src in cells if src.startswith("measured"))


def nearest_subtype(sp_type: str, table: dict[tuple[bool, int], tuple[float, float]]) -> tuple[float, float]:
    """Return the entry of the nearest tabulated subtype of the same kind, nan if none is within two subtypes.

    Parameters
    ----------
    sp_type : str
        Spectral type.
    table : dict
        (giant scale, whole subtype) -> median (Teff in K, B-V in mag).
    """
    subtype, giant = spectral_subtype(sp_type), has_giant_scale(sp_type)
    keys = [key for key in table if key[0] == giant and abs(key[1] - subtype) <= _NEAR_SUBTYPES]
    return table[min(keys, key=lambda key: (abs(key[1] - subtype), key[1]))] if keys else (float("nan"), float("nan"))


def colour_temperature(b_v_mag: float, metallicity: float) -> tuple[float, str]:
    """Return effective temperature from B-V and [Fe/H], and the name of the relation used.

    Parameters
    ----------
    b_v_mag : float
        Johnson B-V, mag.
    metallicity : float
        [Fe/H], dex.
    """
    x, z = b_v_mag, metallicity
    if 0.18 < x < 1.40:
        theta = 0.5665 + 0.4809 * x - 0.0060 * x**2 - 0.0613 * x * z - 0.0042 * z - 0.0055 * z**2
        return 5040.0 / theta, "derived:B-V (Casagrande et al. 2010)"
    teff = 4600.0 * (1.0 / (0.92 * x + 1.7) + 1.0 / (0.92 * x + 0.62))
    return teff, "derived:B-V (Ballesteros 2012)"


def temperatures_disagree(adopted_k: float, others_k: Iterable[float]) -> bool:
    """Tell whether an estimate (nan is skipped) is farther than :data:`TEFF_DISAGREEMENT_K` from the adopted one."""
    return any(abs(other - adopted_k) > TEFF_DISAGREEMENT_K for other in others_k)


def bolometric_correction(teff_k: float, metallicity: float = 0.0, log_g: float = DWARF_LOG_G) -> float:
    """Return BC_V (mag): Flower 1996 as corrected by Torres 2010, and what metallicity and gravity add to it.

    Luminosities of 104 dwarfs with measured bolometric magnitudes (Casagrande et al. 2006) are right to 0.1 % in the
    median, scatter 1.0 %; without the addition those of the poor in metals are 4 % low, above 6200 K 12 %.

    Parameters
    ----------
    teff_k : float
        Effective temperature, K, above 0.
    metallicity, log_g : float
        [Fe/H] and log10 of the surface gravity (cm/s2), dex; beyond the table of the addition its edge is taken.
    """
    x = float(np.log10(_positive("teff_k", teff_k, "K")))
    series, middle = (_COOL, 3.6) if x < 3.70 else (_WARM, 3.8) if x < 3.90 else (_HOT, 4.3)
    total = 0.0
    for coefficient in reversed(_about(series, middle)):
        total = total * (x - middle) + coefficient
    temperatures, tables = _besides()
    by_gravity = [
        np.interp(metallicity, list(table), [np.interp(teff_k, temperatures, values) for values in table.values()])
        for table in tables.values()
    ]
    return total + float(np.interp(log_g, list(tables), by_gravity))


@functools.cache
def _besides() -> tuple[list[float], dict[float, dict[float, list[float]]]]:
    """Return temperatures (K), and gravity -> metallicity -> what is added at each temperature, mag."""
    rows = shipped_rows("bolometric_corrections.csv")
    tables: dict[float, dict[float, list[float]]] = {}
    for row in rows:
        log_g, metallicity, *values = map(float, row.values())
        tables.setdefault(log_g, {})[metallicity] = values
    return [float(name) for name in [*rows[0]][2:]], tables


@functools.cache
def _about(series: tuple[float, ...], middle: float) -> tuple[float, ...]:
    """Return the coefficients of a polynomial in powers of ``x - middle``, shifted exactly.

    The printed terms are a hundred thousand times their sum: ten digits would cancel.
    """
    exact, place = [Fraction(c) for c in series], Fraction(middle)
    return tuple(
        float(sum(exact[n] * math.comb(n, k) * place ** (n - k) for n in range(k, len(exact))))
        for k in range(len(exact))
    )


def luminosity_from_v(
    v_mag: float, distance_pc: float, teff_k: float, metallicity: float = 0.0, log_g: float = DWARF_LOG_G
) -> float:
    """Return the bolometric luminosity (Lsun) of a star of apparent V (mag), distance (pc) and temperature (K).

    Parameters
    ----------
    v_mag : float
        Apparent Johnson V, mag.
    distance_pc : float
        Distance, pc, above 0.
    teff_k : float
        Effective temperature, K, above 0.
    metallicity, log_g : float
        [Fe/H] and log10 of the surface gravity (cm/s2), dex, for the bolometric correction.
    """
    modulus = 5.0 * np.log10(_positive("distance_pc", distance_pc, "pc") / 10.0)
    correction = bolometric_correction(_positive("teff_k", teff_k, "K"), metallicity, log_g)
    m_bol = in_unit("v_mag", v_mag, "mag") - modulus + correction
    return float(10.0 ** (-0.4 * (m_bol - _M_BOL_SUN)))


def luminosity_from_diameter(angular_diameter_mas: float, distance_pc: float, teff_k: float) -> float:
    """Return the bolometric luminosity (Lsun) of a star of measured diameter by Stefan-Boltzmann.

    With the temperature that was found with this diameter it is the bolometric flux of that source, whatever the two
    are worth by themselves.

    Parameters
    ----------
    angular_diameter_mas : float
        Limb-darkened angular diameter, mas.
    distance_pc : float
        Distance, pc.
    teff_k : float
        Effective temperature, K.
    """
    radius_rsun = 0.5e-3 * angular_diameter_mas * distance_pc * _ARCSEC_AU_RSUN
    return float(radius_rsun**2 * (teff_k / _TEFF_SUN_K) ** 4)


def radius_from_luminosity(luminosity_lsun: float, teff_k: float) -> float:
    """Return the radius (Rsun) by Stefan-Boltzmann.

    Parameters
    ----------
    luminosity_lsun : float
        Bolometric luminosity, above 0.
    teff_k : float
        Effective temperature, K.
    """
    return float(
        np.sqrt(_positive("luminosity_lsun", luminosity_lsun, "L_sun"))
        * (_TEFF_SUN_K / _positive("teff_k", teff_k, "K")) ** 2
    )


def mass_from_luminosity(luminosity_lsun: float) -> float:
    """Return main-sequence mass (Msun), Eker et al. 2018, from 0.45 to 2.4 Msun."""
    x = float(np.log10(_positive("luminosity_lsun", luminosity_lsun, "L_sun")))
    if x < 4.572 * np.log10(0.72) - 0.102:
        return float(10.0 ** ((x + 0.102) / 4.572))
    if x < 5.743 * np.log10(1.05) - 0.007:
        return float(10.0 ** ((x + 0.007) / 5.743))
    return float(10.0 ** ((x - 0.010) / 4.329))


def mass_of(sp_type: str, luminosity_lsun: float) -> tuple[float, str]:
    """Return the mass (Msun) that luminosity and class suggest, and how it was found.

    Parameters
    ----------
    sp_type : str
        Spectral type.
    luminosity_lsun : float
        Bolometric luminosity, above 0.
    """
    if is_giant(sp_type):
        return GIANT_MASS_MSUN, f"assumed:{GIANT_MASS_MSUN} Msun, giant"
    return mass_from_luminosity(luminosity_lsun), MASS_SOURCE


def gravity(mass_msun: float, radius_rsun: float) -> float:
    """Return log10 of the surface gravity (cm/s2) of mass and radius in solar units.

    Parameters
    ----------
    mass_msun, radius_rsun : float
        Mass and radius, above 0.
    """
    mass, radius = _positive("mass_msun", mass_msun, "M_sun"), _positive("radius_rsun", radius_rsun, "R_sun")
    return float(_LOG_G_SUN + np.log10(mass) - 2.0 * np.log10(radius))


def bulk_columns(row: Mapping[str, Any], known: Mapping[str, tuple[float, str] | None]) -> dict[str, Any]:
    """Return the columns of luminosity, radius, mass and gravity: each as it is known, else by the relations above.

    Parameters
    ----------
    row : mapping
        The columns ``v_mag``, ``distance_pc``, ``teff_k``, ``metallicity`` and ``sp_type`` of a star.
    known : mapping of str to (float, str)
        Value and source of ``luminosity_lsun``, ``mass_msun`` and ``log_g``; None or left out where it is not known.
    """
    teff_k, log_g, luminosity = row["teff_k"], known.get("log_g"), known.get("luminosity_lsun")
    if luminosity is None:
        light = (row["v_mag"], row["distance_pc"], teff_k, row["metallicity"])
        usual = log_g[0] if log_g else usual_gravity(row["sp_type"])
        luminosity = luminosity_from_v(*light, usual), LUMINOSITY_SOURCE
    radius = radius_from_luminosity(luminosity[0], teff_k)
    mass = known.get("mass_msun") or mass_of(row["sp_type"], luminosity[0])
    log_g = log_g or (gravity(mass[0], radius), GRAVITY_SOURCE)
    found = {"luminosity_lsun": luminosity, "radius_rsun": (radius, RADIUS_SOURCE), "mass_msun": mass, "log_g": log_g}
    values = {name: value for name, (value, _) in found.items()}
    return values | {f"{name}_src": src for name, (_, src) in found.items()}


def _positive(name: str, value: float, unit: str) -> float:
    """Refuse numbers of 0 and below; nan, a number that is missing, passes."""
    if (plain := in_unit(name, value, unit)) <= 0.0:
        raise InputError(name, plain, unit=unit, allowed="above 0")
    return float(plain)


def place_columns(
    ra_deg: float,
    dec_deg: float,
    motion_mas_yr: tuple[float, float],
    rv_km_s: float,
    src: str,
    lon_lat_deg: tuple[float, float] | None = None,
) -> dict[str, object]:
    """Return the columns of place and motion.

    Parameters
    ----------
    ra_deg, dec_deg : float
        ICRS position at J2000.0, degrees; both nan if unknown.
    motion_mas_yr : (float, float)
        Proper motion in right ascension (with cos(dec)) and declination; 0 is assumed where one of them is nan.
    rv_km_s : float
        Radial velocity, positive when receding; 0 is assumed where it is nan.
    src : str
        Where the numbers come from.
    lon_lat_deg : (float, float), optional
        Ecliptic coordinates, where they are known already.
    """
    placed, moves, rv_known = (math.isfinite(value) for value in (ra_deg + dec_deg, sum(motion_mas_yr), rv_km_s))
    lon, lat = (lon_lat_deg or ecliptic(ra_deg, dec_deg)) if placed else (math.nan, math.nan)
    return {
        "ra_deg": float(ra_deg) % 360.0,
        "dec_deg": float(dec_deg),
        "epoch_yr": 2000.0,
        "pm_ra_mas_yr": motion_mas_yr[0] if moves else 0.0,
        "pm_dec_mas_yr": motion_mas_yr[1] if moves else 0.0,
        "pm_src": src if moves else "assumed:0",
        "rv_km_s": rv_km_s if rv_known else 0.0,
        "rv_km_s_src": src if rv_known else "assumed:0",
        "ecliptic_lon_deg": float(lon),
        "ecliptic_lat_deg": float(lat),
        "ecliptic_src": "derived:position" if placed else "missing",
    }


GAIA_V_SOURCE = "derived:Gaia G and BP-RP (Riello et al. 2021)"
"""Origin of a V magnitude that `v_of_gaia` gives."""


def v_of_gaia(g_mag: float, bp_rp_mag: float) -> float:
    """Return Johnson V from Gaia's magnitudes, with a scatter of 0.03 mag.

    Riello et al. 2021, A&A 649, A3, table C.2: ``G - V = -0.02704 + 0.01424 x - 0.2156 x^2 + 0.01426 x^3``.

    Parameters
    ----------
    g_mag, bp_rp_mag : float
        Gaia EDR3 (DR3) G, and x = BP - RP, -0.5 to 5 mag.
    """
    x = bp_rp_mag
    return g_mag + 0.02704 - x * (0.01424 - x * (0.2156 - x * 0.01426))


def light_columns(v_mag: float, b_v_mag: float, sp_type: str, src: str) -> dict[str, object]:
    """Return the columns of magnitude, colour and type.

    Parameters
    ----------
    v_mag, b_v_mag : float
        Johnson V and B-V, mag; B-V is nan if unknown.
    sp_type : str
        Spectral type, ``""`` if unknown.
    src : str
        Where the numbers come from.
    """
    return {
        "v_mag": v_mag,
        "v_mag_src": src,
        "b_v_mag": b_v_mag,
        "b_v_mag_src": src if math.isfinite(b_v_mag) else "missing",
        "sp_type": sp_type,
        "spectral_class": spectral_letter(sp_type),
        "luminosity_class": luminosity_class(sp_type),
    }
