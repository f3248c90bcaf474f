"""Star names for people: SIMBAD identifiers in readable form."""

from __future__ import annotations

import re

from catalogs.nomenclature import CONSTELLATIONS, GREEK

_SUPERSCRIPT = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
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
    found = _BAYER.match(name)
    if found is None or found[3] not in CONSTELLATIONS:
        return name
    letter, index, sky, component = found.groups()
    symbol = GREEK[letter][0] if letter in GREEK else letter
    if letter not in GREEK and len(letter) > 1:  # a variable-star name such as AK Lep
        return name
    return f"{symbol}{str(int(index)).translate(_SUPERSCRIPT) if index else ''} {sky}{component}"


def full_name(identifier: str, hip: int | None) -> str:
    """Return the readable name with the Hipparcos number, where there is one and the name is not that number."""
    name = pretty_name(identifier)
    return name if hip is None or name == f"HIP {hip}" else f"{name} (HIP {hip})"


def short_name(identifier: str) -> str:
    """Return the readable name of a star, cut to the width of a column."""
    return shortened(pretty_name(identifier))


def shortened(name: str) -> str:
    """Return a name cut to the width of a column."""
    return name if len(name) <= _NAME_LENGTH else f"{name[: _NAME_LENGTH - 1]}…"
