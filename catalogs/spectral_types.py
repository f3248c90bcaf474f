"""Spectral type -> effective temperature and surface gravity, by published mean sequences."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.errors import InputError
from catalogs.strict_yaml import load_yaml, split_sourced

__all__ = ["SpectralType", "StellarParameters", "parse_spectral_type", "stellar_parameters"]

_FILE = Path(__file__).resolve().parent / "data" / "spectral_types.yaml"
_LETTERS = "OBAFGKM"
_RANKS = {"Ia": 1.0, "Iab": 1.0, "Ib": 1.0, "I": 1.0, "II": 2.0, "III": 3.0, "IV": 4.0, "V": 5.0, "VI": 5.0}
_PREFIX_RANKS = {"sd": 5.0, "d": 5.0, "g": 3.0, "c": 1.0}
_MIDDLE_SUBCLASS = 5.0

_TEMPERATURE = re.compile(
    r"[(k]?(?P<prefix>sd|[dgc])?(?P<letter>[OBAFGKM])(?P<sub>\d(?:\.\d+)?)?"
    r"(?:[-/](?P<letter2>[OBAFGKM])?(?P<sub2>\d(?:\.\d+)?))?(?![A-HJ-UW-Z])"
)
_CLASS = r"(Iab|Ia|Ib|III|II|IV|VI|V|I)(?:ab|a|b)?"
_LUMINOSITY = re.compile(rf"{_CLASS}(?:\s*[-/]\s*{_CLASS})?")


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
        ``subclass_assumed``, ``luminosity_class_assumed`` where the text does not say.
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
    """Read an MK spectral type as SIMBAD writes it: ``K1V``, ``G8.5IV-V``, ``F7/8 V``, ``sdG2``.

    The first component of a composite type counts; peculiarity suffixes are ignored. A missing subclass is
    taken as 5 and a missing luminosity class as V, with a flag.

    Raises
    ------
    InputError
        If no class O, B, A, F, G, K or M is found.
    """
    name = text.strip()
    plain = name.upper() if name.islower() else name
    first = plain.split("+")[0] if plain.find("+") > 1 else plain
    found = _TEMPERATURE.match(re.sub(r"^\([^)]*\)(?=[OBAFGKM])", "", first))
    if not found or (not found["sub"] and found.string[found.end() :][:1].islower()):
        raise InputError("spectral_type", text, allowed="an MK type of class O, B, A, F, G, K or M, such as K1V")
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
    luminosity = _LUMINOSITY.search(found.string, found.end())
    if luminosity:
        ranks = [_RANKS[item] for item in luminosity.groups() if item]
        rank = sum(ranks) / len(ranks)
    elif found["prefix"]:
        rank = _PREFIX_RANKS[found["prefix"]]
    else:
        rank = 5.0
        flags.append("luminosity_class_assumed")
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
        If the type cannot be read or lies outside the tables (B0 to M6 for dwarfs).
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


@functools.cache
def _tables() -> dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]:
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
