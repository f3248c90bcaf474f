"""Find a catalogue star by any of the names people type.

Accepted are HIP, HD, HR, GJ/Gl, LHS, LTT, BD and SAO numbers, Bayer and Flamsteed designations (Greek letters, English
or SIMBAD spelling, genitives, superscripts), variable-star and proper names, and SIMBAD's main identifiers, with or
without component letters; in a table of a user's own, TIC, TOI and Gaia numbers and names of surveys too. Case matters
only for Latin Bayer letters (``e Eri``).

A name of a whole system (``61 Cyg``, ``alpha Cen``) gives its brightest catalogue star and a note. A well-known star
that is not in the catalogue is refused with the reason.
"""

import difflib
import functools
import re
from collections.abc import Iterable, Sequence

import numpy as np

from catalogs.nomenclature import GREEK, designation_key, split_component
from catalogs.shipped import shipped_lines
from catalogs.stars import StarTable, load_stars
from cpic_core import InputError, Record

_ALLOWED = "HIP, HD, HR or GJ number, Bayer or Flamsteed designation, proper name or SIMBAD identifier"
_SUGGESTIONS = 4
_LATIN_BAYER = re.compile(r"[A-Za-z]\d* [a-z]{3}(?: [a-e])?")
_INDEXED_BAYER = re.compile(rf"({'|'.join(GREEK)})(\d+) ([a-z]{{3}})")
_NUMBERED = re.compile(r"(?:hip|hd|hr|gj|sao|lhs|ltt|nltt) (?=\d)")
_PLAIN_BAYER = re.compile(rf"({'|'.join(GREEK)}) ([a-z]{{3}})")


class StarMatch(Record):
    """A resolved name.

    Parameters
    ----------
    index : int
        Row in the table.
    name : str
        The catalogue's name of the star.
    note : str
        What was assumed in choosing, ``""`` if nothing.
    others : tuple of str
        Other stars of the table that the name may mean.
    """

    index: int
    name: str
    note: str = ""
    others: tuple[str, ...] = ()


@functools.cache
def snapshot_aliases() -> dict[str, tuple[str, int]]:
    """Return key -> (star name, kind); kind 1 is a name of the whole system."""
    return {key: (name, int(kind)) for key, name, kind in shipped_lines("aliases.csv")[1:]}


_WAY_OUT = "cpic etc answers with --v-mag, --sp-type or --teff-k, and --distance-pc; rankings, with a table of yours"


@functools.cache
def _outsiders() -> dict[str, str]:
    """Return key -> coded reason of well-known stars outside the catalogue."""
    return {key: reason for keys, reason in shipped_lines("known_stars.csv")[1:] for key in keys.split("|")}


def resolve_star(name: str, table: StarTable | None = None) -> StarMatch:
    """Return the catalogue star that a name means.

    Parameters
    ----------
    name : str
        Any usual designation; see the module's first lines.
    table : StarTable, optional
        Table to look in (a selection, a refreshed table or a user's own); the embedded catalogue by default. In a
        table that is not the embedded one its own names go first; then every alias that the embedded catalogue knows
        of a star, by whatever name that star stands in the table.

    Returns
    -------
    StarMatch
        Row index in ``table``, the star's name, and a note if something was assumed.

    Raises
    ------
    InputError
        If the name is unknown (with the nearest names), or known but outside ``table`` (with the reason).
    """
    stars = load_stars() if table is None else table
    key = designation_key(name) if isinstance(name, str) else ""
    if not key:
        raise InputError("star", name, allowed=_ALLOWED)
    if stars.label:
        return _resolve_in(name, key, stars)
    found = _find(key)
    if found is None:
        raise _refusal(name, key)
    star, note, others = found
    names = stars.column("name")
    rows = np.flatnonzero(names == star).tolist()
    if not rows:
        hint = f"{star} is in the catalogue, but not selected"
        raise InputError("star", name, allowed="a star of this selection", hint=hint)
    return StarMatch(rows[0], star, note, tuple(other for other in others if other in names))


def _resolve_in(name: str, key: str, stars: StarTable) -> StarMatch:
    """Find a star of a table that is not the embedded catalogue."""
    for form, remark in _forms(key):
        rows = stars.name_keys.get(form, ())
        if split_component(key)[1] and not split_component(form)[1]:
            rows = tuple(row for row in rows if _letter_of(stars, row) in ("", "a"))
        if rows:
            exact = [row for row in rows if designation_key(str(stars.column("name")[row])) == form]
            return _brightest(stars, exact or rows, remark)
    known, aliases = _find(key), snapshot_aliases()
    if known is not None:  # the embedded catalogue knows the star: look for it under any of its names
        star, note, _ = known
        held = [rows for own, rows in stars.name_keys.items() if aliases.get(own) == (star, 0)]
        if held:
            return _brightest(stars, [row for rows in held for row in rows], note)
    if not split_component(key)[1]:
        held = [rows for own, rows in stars.name_keys.items() if split_component(own)[0] == key]
        if held:
            return _brightest(stars, [row for rows in held for row in rows], "name of a system: {star} taken")
    raise _not_in(name, key, stars, known[0] if known else "")


def _letter_of(stars: StarTable, row: int) -> str:
    letter = str(stars.column("component")[row]).lower()
    return letter or split_component(designation_key(str(stars.column("name")[row])))[1]


def _brightest(stars: StarTable, rows: Iterable[int], remark: str) -> StarMatch:
    """Return the brightest of the rows, and say so where there are several."""
    chosen = sorted(set(rows), key=lambda row: (float(stars.column("v_mag")[row]), row))
    names = [str(stars.column("name")[row]) for row in chosen]
    notes = [remark.format(star=names[0])] if remark else []
    if names[1:]:
        notes.append(f"the brightest of several rows, {names[0]}, taken; also in the table: {', '.join(names[1:])}")
    return StarMatch(chosen[0], names[0], "; ".join(notes), tuple(names[1:]))


def _not_in(name: str, key: str, stars: StarTable, known: str) -> InputError:
    pool = difflib.get_close_matches(key, list(stars.name_keys), n=3 * _SUGGESTIONS, cutoff=0.6)
    near = list(dict.fromkeys(str(stars.column("name")[stars.name_keys[own][0]]) for own in pool))[:_SUGGESTIONS]
    hint = f"nearest: {', '.join(near)}" if near else "nothing similar in it"
    if known:
        hint = f"{known} is in the embedded catalogue, but not in this table; {hint}"
    return InputError("star", name, allowed=f"a star of {stars.label}", hint=hint)


def _find(key: str) -> tuple[str, str, Sequence[str]] | None:
    """Return (star name, note, other stars of that name), or None."""
    aliases = snapshot_aliases()
    for form, remark in _forms(key):
        if form in aliases:
            star, kind = aliases[form]
            if split_component(key)[1] and not split_component(form)[1] and _component(star) not in ("", "A"):
                continue  # "p Eri A", when the catalogue lists component B alone
            note, others = remark.format(star=star), []
            if kind and not split_component(key)[1]:
                others = _system_others(form, star)
                system = f"name of a system: its brightest star {star} taken{_also(others)}"
                note = "; ".join(filter(None, (note, system)))
            return star, note, others
    return _unnumbered(key)


def _component(star: str) -> str:
    """Return the component letter of a catalogue star."""
    stars = load_stars()
    return str(stars.column("component")[stars.column("name").tolist().index(star)])


def _forms(key: str) -> list[tuple[str, str]]:
    """Return the key and its fallbacks, each with the remark that using it deserves."""
    forms = [(key, "")]
    base, letter = split_component(key)
    if letter == "a":
        forms.append((base, "taken as {star}, listed without a component letter"))
    elif not letter:
        forms.append((f"{key} a", "taken as {star}"))
    if _LATIN_BAYER.fullmatch(key):
        forms.append((key[0].swapcase() + key[1:], "taken as {star}, letter in the other case"))
    if indexed := _INDEXED_BAYER.fullmatch(base):
        plain = " ".join(filter(None, (indexed[1], indexed[3], letter)))
        forms.append((plain, "taken as {star}, listed without a number"))
    return forms


def _unnumbered(key: str) -> tuple[str, str, Sequence[str]] | None:
    """Find ``zet Ret`` as the brightest of ``zet1 Ret`` and ``zet2 Ret``."""
    found = _PLAIN_BAYER.fullmatch(key)
    if not found:
        return None
    aliases = snapshot_aliases()
    forms = [form for i in range(1, 10) if (form := f"{found[1]}{i} {found[2]}") in aliases]
    if not forms:
        return None
    order = load_stars().column("name").tolist()
    forms.sort(key=lambda form: order.index(aliases[form][0]))
    star = aliases[forms[0]][0]
    others = [aliases[form][0] for form in forms[1:] if aliases[form][0] != star]
    note = f"several stars share this letter: the brightest, {star}, taken{_also(others)}"
    return star, note, others


def _also(others: Sequence[str]) -> str:
    return f"; also in the catalogue: {', '.join(others)}" if others else ""


def _system_others(key: str, star: str) -> list[str]:
    """Return the other stars of a system."""
    aliases = snapshot_aliases()
    others = sorted({name for other, (name, _) in aliases.items() if split_component(other)[0] == key and name != star})
    if not others:
        system = star.rpartition(" ")[0]
        members = {name for name, _ in aliases.values() if name != star and name.rpartition(" ")[0] == system}
        others = sorted(members) if " " in system else []
    return others


def _refusal(name: str, key: str) -> InputError:
    outsiders, (base, letter) = _outsiders(), split_component(key)
    known = [form for form in ((key, base, f"{key} a") if letter in ("", "a") else (key,)) if form in outsiders]
    allowed, hint = _ALLOWED, f"component {letter.upper()} is not in the catalogue"
    if known:
        allowed, hint = "F, G or K within 40 pc and V <= 7.5", f"{_reason(outsiders[known[0]])}; {_WAY_OUT}"
    elif letter and base in outsiders:
        hint += f", nor is {name.strip()[:-1].strip()}; {_WAY_OUT}"
    elif letter and (star := _find(base)):
        listed = _component(star[0])
        hint += f"; {star[0]}{f' (component {listed})' * bool(listed)} is"
    else:
        hint = _nearest(key)
    return InputError("star", name, allowed=allowed, hint=hint)


def _nearest(key: str) -> str:
    """Return the nearest names in words."""
    aliases = snapshot_aliases()
    number = _NUMBERED.match(key)
    if number:  # a slip in a number: compare with numbers of the same catalogue only
        pool = [alias for alias in aliases if alias.startswith(number[0]) and len(alias) == len(key)]
        near = difflib.get_close_matches(key, pool, n=_SUGGESTIONS, cutoff=0.8)
        shown = [f"{alias.upper()} ({aliases[alias][0]})" for alias in near]
    else:
        pool = [alias for alias in aliases if abs(len(alias) - len(key)) <= 3 and not _NUMBERED.match(alias)]
        near = difflib.get_close_matches(key, pool, n=3 * _SUGGESTIONS, cutoff=0.6)
        shown = list(dict.fromkeys(aliases[alias][0] for alias in near))[:_SUGGESTIONS]
    return f"unknown; nearest: {', '.join(shown)}" if shown else "unknown, and nothing similar"


def _reason(code: str) -> str:
    """Turn the coded reason of ``known_stars.csv`` into words."""
    word, _, value = code.partition("=")
    if word == "parallax":
        far = f", {1000.0 / float(value):.0f} pc" if float(value) > 1.0 else ""
        return f"beyond 40 pc: parallax {value} mas{far}"
    kind = f"an F, G or K star: spectral type {value}" if value else "among the F, G and K stars of the source"
    return {"v": f"too faint: V = {value}", "type": f"not {kind}"}.get(word, f"left out: {value}")
