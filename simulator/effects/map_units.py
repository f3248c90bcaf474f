"""Units of maps in FITS files: one reading of ``BUNIT`` for calibration maps and for stray light."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from typing import Any

from catalogs.errors import InputError

_WORDS = {
    "electrons": "electron",
    "pixel": "pix",
    "pixels": "pix",
    "px": "pix",
    "dn": "adu",
    "relative": "",
    "dimensionless": "",
}
_PER_FRAME = re.compile(r"/\s*(?:frame|exposure)s?\b|\b(?:frame|exposure)s?\s*\^?(?:\*\*)?\s*-1")
# e- or e, not part of a word; the minus of e-1 is that of a power.
_CHARGE = re.compile(r"(?<![a-z])e(?:-(?!\d))?(?![a-z])")


def unit_factor(key: str, path: str, header: Mapping[str, Any], unit: str, *, required: bool = True) -> float:
    """Factor from the unit that a map's header states to the one wanted.

    Parameters
    ----------
    key : str
        What the map is, for the refusal.
    path : str
        The file, for the refusal.
    header : mapping
        Cards of the image; ``BUNIT`` counts. Whatever `astropy.units` reads is understood, in capitals or not, and
        ``e-``, ``px`` and ``DN`` besides; per pixel or per frame may stand in it or not.
    unit : str
        What is wanted, as ``electron/s``; empty for a pure number.
    required : bool
        Whether a map without ``BUNIT`` is refused.

    Raises
    ------
    InputError
        If the unit is missing, cannot be read, or is of another kind; the one found and those accepted are named.
    """
    allowed = f"{unit} or {_per_pixel(unit)}" if unit else "none: the map has no unit"
    if "BUNIT" not in header:
        if required:
            raise InputError(f"{key} BUNIT", "missing", allowed=allowed, hint=path)
        return 1.0
    text = str(header["BUNIT"])
    from astropy import units

    wanted = units.Unit(unit)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", units.UnitsWarning)
            given = units.Unit(_plain(text))
        for target in (wanted, wanted / units.pixel) if unit else (wanted,):
            if given.is_equivalent(target):
                return float(given.to(target))
    except ValueError:
        pass
    raise InputError(f"{key} BUNIT", text, allowed=allowed, hint=path)


def _per_pixel(unit: str) -> str:
    above, _, below = unit.partition("/")
    return f"{above}/({below} pix)" if below else f"{unit}/pix"


def _plain(text: str) -> str:
    """Text of a unit in the words of astropy, with one fraction line at most."""
    text = _PER_FRAME.sub("", text.strip().lower())
    text = _CHARGE.sub("electron", text)
    text = re.sub(r"[a-z]+", lambda word: _WORDS.get(word[0], word[0]), text)
    above, *below = text.split("/")
    if len(below) < 2:
        return text
    return f"{above}/({' '.join(part.strip(' ()') for part in below)})"
