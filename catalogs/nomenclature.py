"""Spellings of star names: one canonical key stands for every spelling of a designation.

``designation_key("α Cen B")``, ``("Alpha Centauri B")`` and ``("* alf Cen B")`` all give ``"alf cen b"``.
The key is lower case with one exception: a Latin Bayer letter keeps its case, because ``e Eri`` and ``E Eri``
would be different stars. Greek letters take SIMBAD's three-letter forms (``alf``, ``tet``, ``ksi``), constellations
the IAU abbreviations.
"""

import functools
import re
import unicodedata
from collections.abc import Mapping
from typing import Any

from catalogs.shipped import shipped_rows

_ROWS = [(row["kind"], row["key"], tuple(row["forms"].split("|"))) for row in shipped_rows("designations.csv")]
GREEK: dict[str, tuple[str, tuple[str, ...]]] = {
    key: (forms[0], forms[1:]) for kind, key, forms in _ROWS if kind == "letter"
}
"""SIMBAD's abbreviation of each Greek letter -> (letter, other spellings)."""
CONSTELLATIONS: dict[str, str] = {key: forms[0] for kind, key, forms in _ROWS if kind == "constellation"}
"""Latin genitive of each constellation by its IAU abbreviation."""


def _keys(kind: str) -> dict[str, str]:
    """Return the key that each spelling of a kind stands for, both in lower case."""
    return {form.lower(): key.lower() for own, key, forms in _ROWS if own == kind for form in (key, *forms) if form}


_GREEK_FORMS, _SKY, _LISTS = _keys("letter"), _keys("constellation"), _keys("list")
_LONGEST_SKY = max(map(len, _SKY))
_CATALOGUE = re.compile(
    rf"({'|'.join(sorted(map(re.escape, _LISTS), key=len, reverse=True))})"
    r"\s*[-_]?\s*0*(\d+(?:\.\d+)?)\s*([a-e]{0,3})",
    re.IGNORECASE,
)
_ZONE = re.compile(r"(bd|cd|cpd) ?([-+]) ?(\d{1,2}) ?[°d ] ?0*(\d+[a-e]?)(?: ([a-e]))?", re.IGNORECASE)
_BRACKETED = re.compile(r"(?<=.) ?\(([A-E]{1,3})\)$")
_COMPONENT = re.compile(r"[A-Ea-e]{1,3}")
_LETTER_INDEX = re.compile(r"([^\W\d]+)\.?[\s-]*0*(\d{0,2})")
_NUMBER = re.compile(r"0*(\d{1,3})")
_VARIABLE = re.compile(r"v\s*0*(\d{3,4})|([a-z]{2})", re.IGNORECASE)
_LONGEST = 200
#: Lists of stars by the column of a table that holds their numbers, the likeliest to be known elsewhere first.
_NUMBERS = {"hip": "HIP", "hd": "HD", "gj": "GJ", "hr": "HR", "tic": "TIC", "gaia": "Gaia DR3"}
_WHOLE_FLOAT = 2.0**53
_PLANET = re.compile(
    r"(.*\S) ([b-z])|(.*\d(?:[A-E]|\([A-E]{1,3}\))?)([b-z])|(.*[\d )][A-E])([b-z])"
    r"|((?:C?TOI|TIC|KOI|KIC|EPIC)[- ]?\d+|K\d{5}|(?:HD|HIP|GJ|Gl|Gliese) ?\d+(?=\.0))\.(\d\d)"
)
_LEAD = re.compile(r"(?:\*\*|\*|V\*|NAME)\s+", re.IGNORECASE)


def _plain(text: str) -> str:
    """Fold compatibility forms (superscripts, thin spaces) and accents; keep Greek letters."""
    if not text.isascii():
        folded = unicodedata.normalize("NFD", unicodedata.normalize("NFKC", text.replace("µ", "μ").replace("−", "-")))
        text = "".join(letter for letter in folded if unicodedata.category(letter) not in ("Mn", "Cf"))
    return " ".join(text.replace("_", " ").split())


def _head_key(head: str) -> str:
    """Return the key of what stands before the constellation; ``""`` if it is no designation."""
    if found := _LETTER_INDEX.fullmatch(head):
        word, index = found.groups()
        if word.lower() in _GREEK_FORMS:
            return _GREEK_FORMS[word.lower()] + index
        if len(word) == 1 and word.isascii():
            return word + index
    if found := _NUMBER.fullmatch(head):
        return found[1]
    if found := _VARIABLE.fullmatch(head):
        return f"v{found[1]}" if found[1] else head.lower()
    return ""


def _split_sky(words: list[str]) -> tuple[str, str]:
    """Split words into head and constellation abbreviation; ``("", "")`` if they end in no constellation."""
    for count in (2, 1):
        tail = " ".join(words[-count:]).lower()
        if len(words) > count and tail in _SKY:
            return " ".join(words[:-count]), _SKY[tail]
    if len(words) == 1:  # written without a space: tauCeti, 61Cyg
        for cut in range(max(1, len(words[0]) - _LONGEST_SKY), len(words[0]) - 2):
            tail = words[0][cut:].lower()
            head = words[0][:cut]
            if tail in _SKY and (head.isdigit() or head.rstrip("0123456789").lower() in _GREEK_FORMS):
                return head, _SKY[tail]
    return "", ""


@functools.lru_cache(maxsize=100_000)
def designation_key(text: str) -> str:
    """Return the canonical key of a star name.

    Parameters
    ----------
    text : str
        A designation or proper name, as people type it.

    Returns
    -------
    str
        Canonical key; ``""`` for blank text. Names of unknown form come back in lower case with single spaces, and so
        do texts of more than 200 characters, which name no star.
    """
    if len(text) > _LONGEST:  # folding its accents and trying its forms would take the square of its length
        return " ".join(text.split()).lower()
    name = _plain(text)
    lead = _LEAD.match(name)
    if lead:
        name = name[lead.end() :]
    if name.endswith(")"):
        name = _BRACKETED.sub(r" \1", name)
    if found := _CATALOGUE.fullmatch(name):
        return " ".join(filter(None, (_LISTS[found[1].lower()], found[2], found[3].lower())))
    if found := _ZONE.fullmatch(name):
        return " ".join(filter(None, (f"{found[1]}{found[2]}{found[3]:>02} {found[4]}", found[5]))).lower()
    words = name.split()
    component = ""
    head, sky = _split_sky(words)
    if not sky and len(words) > 1 and _COMPONENT.fullmatch(words[-1]):
        component = words[-1].lower()
        head, sky = _split_sky(words[:-1])
    if sky and (key := _head_key(head)):
        return " ".join(filter(None, (key, sky, component)))
    return re.sub(r"['`’]", "", name).lower()


def split_component(key: str) -> tuple[str, str]:
    """Split a canonical key into system and component letters (``"alf cen b"`` -> ``("alf cen", "b")``).

    The second part is ``""`` when the key names no component.
    """
    base, _, last = key.rpartition(" ")
    if base and last != "cae" and _COMPONENT.fullmatch(last):  # "cae" is Caelum
        return base, last
    return key, ""


def star_name_of(row: Mapping[str, Any]) -> str | None:
    """Return the name of a star that has numbers in lists of stars and no name.

    Parameters
    ----------
    row : mapping of str to object
        Cells by column: ``hip``, ``hd``, ``gj``, ``hr``, ``tic``, ``gaia`` as numbers or text, with the letters of the
        list or without (``1475``, ``1475.0``, ``HIP1475``, ``1475B``, ``Gl 15A``), ``component`` as a letter.

    Returns
    -------
    str or None
        ``HIP 1475``, ``HD 1326 A``, ``TIC 440109725``, ``Gaia DR3 385334230892516480``; None without a number. HIP goes
        first, since the catalogue knows nearly all of its stars by it; then the lists of bright and near stars, last
        those of faint ones. The letter of a component is that of the number, else of another number, else of the
        column, so that two stars of one number have two names.

    Examples
    --------
    >>> from catalogs.nomenclature import star_name_of
    >>> star_name_of({"hip": 1475.0, "gj": "15B"}), star_name_of({"hd": "HD1326A"}), star_name_of({"hip": None})
    ('HIP 1475 B', 'HD 1326 A', None)
    """
    found = [split for column in _NUMBERS if (split := numbered_star(row.get(column), column))[0]]
    if not found:
        return None
    letters = [letter for _, letter in found] + [str(row.get("component") or "").strip()]
    return " ".join(filter(None, (found[0][0], next(filter(_COMPONENT.fullmatch, letters), "").upper())))


def numbered_star(cell: Any, column: str) -> tuple[str, str]:
    """Return the star of a number in a list, and the letter of its component.

    Parameters
    ----------
    cell : object
        Number or text, as of :func:`star_name_of`; a number without its list is of Gaia's third release.
    column : {"hip", "hd", "gj", "hr", "tic", "gaia"}
        The list.

    Returns
    -------
    tuple of str
        ``("HIP 1475", "B")``; the letter is ``""`` if there is none; both are ``""`` without such a number.
        A Gaia number that was read as a float is none: its last digits are lost.
    """
    prefix, text = _NUMBERS[column], re.sub(r"(\d)\.0*$", r"\1", str(cell).strip())
    base, letter = split_component(designation_key(f"{prefix} {text}" if text[:1].isdigit() else text))
    own, _, number = base.rpartition(" ")
    known = own == prefix.lower() or (own, column) == ("gaia dr2", "gaia")
    whole = number.isdigit() or (column == "gj" and number.replace(".", "", 1).isdigit())
    if not (known and whole and number.strip("0.")) or (isinstance(cell, float) and cell >= _WHOLE_FLOAT):
        return "", ""
    return f"{prefix.replace('DR3', own[-3:].upper())} {number}", letter.upper()


def host_of_planet(name: str) -> tuple[str, str] | None:
    """Split the name of a planet into its star and its letter or number.

    Parameters
    ----------
    name : str
        ``HD 154857 b``, ``HD 10647b``, ``GJ 15 A b``, ``Kepler-16 (AB) b``, ``TOI-700.01``. A planet around two stars
        (``(AB)``, ``AB``) is of the system; one around ``(A)`` or ``(B)`` of that component.

    Returns
    -------
    tuple of str, or None
        The star as it is written and the letter (``b``) or number (``01``); None if the name ends in none of the two. A
        letter that is written to a name without a number (``51 Pegb``) is not seen.

    Examples
    --------
    >>> from catalogs.nomenclature import host_of_planet
    >>> host_of_planet("Kepler-16 (AB) b"), host_of_planet("TOI-700.01"), host_of_planet("Dimidium")
    (('Kepler-16', 'b'), ('TOI-700', '01'), None)
    """
    found = _PLANET.fullmatch(" ".join(name.split()))
    if not found:
        return None
    star, part = filter(None, found.groups())
    star = re.sub(r"^K0*(?=\d+$)", "KOI-", star)
    star = _BRACKETED.sub(r" \1", star)
    return re.sub(r" [A-E]{2,}$", "", star), part
