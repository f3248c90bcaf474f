"""Names of the catalogue rows: which identifiers belong to which row, component letters, the name to show."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from catalogs import CONSTELLATIONS, GREEK
from catalogs.nomenclature import designation_key, split_component
from tools.build_catalogue.builders._star_select import Row
from tools.build_catalogue.builders._star_sources import CrossName, ExoCatStar

_SPOKEN_PREFIXES = ("GJ", "HR", "HD", "LHS", "LTT", "BD", "CD", "CPD", "SAO", "HIP")
_GREEK_BAYER = re.compile(rf"(?:{'|'.join(GREEK)})\d* ")
_SKY_KEYS = frozenset(short.lower() for short in CONSTELLATIONS)


@dataclass
class Identity:
    """All that names one row. `aliases` are designations as written in the sources."""

    row: Row
    exocat: ExoCatStar | None = None
    hd: str = ""
    gj: str = ""
    bayer: str = ""
    flamsteed: str = ""
    variable: str = ""
    common_name: str = ""
    component: str = ""
    component_src: str = "missing"
    name: str = ""
    aliases: set[str] = field(default_factory=set)


def identify(
    rows: Sequence[Row],
    exocat: Sequence[ExoCatStar],
    alias_sets: Sequence[tuple[str, ...]],
    cross_names: dict[int, CrossName],
) -> list[Identity]:
    """Return one identity per row, in the order of `rows` (brightest first)."""
    people = [Identity(row) for row in rows]
    ranks = _ranks_on_hip(people)
    index: _Index = {}
    for names in alias_sets:
        for key in sorted({designation_key(name) for name in names}):
            index.setdefault(key, []).append(names)
    for person in people:
        _take_own_id(person)
    by_hip: dict[int, list[Identity]] = {}
    for person in people:
        by_hip.setdefault(person.row.hip, []).append(person)
    used: set[tuple[str, ...]] = set()
    for person in people:
        mates = by_hip[person.row.hip] if person.row.hip else [person]
        _take_exocat(person, ranks[id(person)], mates, exocat)
        _take_alias_set(person, _set_by_name(person, index), used)
    for person in people:
        mates = by_hip[person.row.hip] if person.row.hip else [person]
        _take_alias_set(person, _set_by_hip(person, ranks[id(person)], mates, index, used), used)
        _take_cross_names(person, ranks[id(person)], mates, cross_names)
    _take_exocat_gj(people)
    _letter_components(people)
    _name(people)
    return people


def _ranks_on_hip(people: Sequence[Identity]) -> dict[int, int]:
    """Return 0 for the brightest row on a HIP number, 1 for the next, and so on."""
    count: dict[int, int] = {}
    ranks = {}
    for person in people:
        hip = person.row.hip
        ranks[id(person)] = count.get(hip, 0) if hip else 0
        count[hip] = ranks[id(person)] + 1
    return ranks


def _take_exocat(person: Identity, rank: int, mates: Sequence[Identity], exocat: Sequence[ExoCatStar]) -> None:
    """Take the ExoCat row of the same HIP number: by HD or GJ identifier, else by component letter."""
    for star in exocat:
        if not star.hip or star.hip != person.row.hip:
            continue
        names = {star.values["hd_name"], star.values["gj_name"]} - {""}
        if person.hd and star.values["hd_name"] and _hd_number(person.hd) != _hd_number(star.values["hd_name"]):
            continue  # the row is another component than the one that ExoCat-1 lists
        owner = next((other for other in mates if names & other.aliases), None)
        by_letter = len(mates) == 1 or star.component == "ABCDE"[rank] or (rank == 0 and not star.component)
        if owner is person or (owner is None and by_letter):
            person.exocat = star
            person.hd = person.hd or star.values["hd_name"]
            return


def _take_exocat_gj(people: Sequence[Identity]) -> None:
    """Take ExoCat-1's GJ numbers where no other source has one; a few of them belong to another star."""
    taken = {designation_key(person.gj) for person in people if person.gj}
    for person in people:
        listed = person.exocat.values["gj_name"] if person.exocat else ""
        if listed and not person.gj and designation_key(listed) not in taken:
            person.gj = listed
            taken.add(designation_key(listed))


def _hd_number(name: str) -> str:
    return split_component(designation_key(name))[0]


def _take_own_id(person: Identity) -> None:
    name = re.sub(r"^(?:V\*|NAME|\*\*|\*)\s+", "", person.row.star.simbad_id)
    person.aliases.update((person.row.star.simbad_id, name))
    if name.startswith("HD ") and not person.hd:
        person.hd = name
    if name.startswith("GJ "):
        person.gj = name
    if person.row.star.simbad_id.startswith("* "):
        kind = "flamsteed" if name[0].isdigit() else "bayer"
        setattr(person, kind, name)
    if found := re.fullmatch(r"(?:CCDM J\S+?|GJ \S+?|BD\S+ )\d ?([A-E])", name):
        person.component, person.component_src = found[1], "measured"


_Index = dict[str, list[tuple[str, ...]]]


def _set_by_name(person: Identity, index: _Index) -> tuple[str, ...]:
    """Return the archive's alias set that shares a designation with this row, ``()`` if none does."""
    own = {*person.aliases, person.hd, person.gj} - {""}
    keys = sorted(designation_key(alias) for alias in own)
    return next((index[key][0] for key in keys if key in index), ())


def _set_by_hip(
    person: Identity, rank: int, mates: Sequence[Identity], index: _Index, used: set[tuple[str, ...]]
) -> tuple[str, ...]:
    """Return the unused alias set with this row's HIP number and, where rows share it, component letter."""
    if not person.row.hip:
        return ()
    number = f"hip {person.row.hip}"
    letters = "abcde" if len(mates) == 1 else "abcde"[rank]
    found = [names for key in (number, *(f"{number} {x}" for x in letters)) for names in index.get(key, ())]
    found = [names for names in found if names not in used and not _other_hd(person, names)]
    return next((names for names in found if len(mates) == 1 or _letter(names) in ("", letters)), ())


def _other_hd(person: Identity, names: Sequence[str]) -> bool:
    """Tell whether an alias set has an HD number, but not the one this row has."""
    numbers = {_hd_number(name) for name in names if name.startswith("HD ")}
    return bool(person.hd and numbers) and _hd_number(person.hd) not in numbers


def _take_alias_set(person: Identity, chosen: tuple[str, ...], used: set[tuple[str, ...]]) -> None:
    if not chosen:
        return
    used.add(chosen)
    for name in chosen:
        if name.startswith("HIP "):
            continue  # the match by position knows the number
        key = designation_key(name)
        base, _ = split_component(key)
        if (
            re.match(rf"(?:{'|'.join(_SPOKEN_PREFIXES)})[ +-]", name)
            or key.split()[-1] in _SKY_KEYS
            or base.split()[-1] in _SKY_KEYS
            or not re.search(r"\d", name)
        ):
            person.aliases.add(name)
        if name.startswith("HD ") and not person.hd:
            person.hd = name
        if name.startswith("GJ ") and not person.gj:
            person.gj = name
    if _letter(chosen) and not person.component:
        person.component, person.component_src = _letter(chosen).upper(), "measured"


def _letter(names: Sequence[str]) -> str:
    """Return the one component letter that an alias set uses, ``""`` if it uses none or several."""
    letters = {split_component(designation_key(name))[1] for name in names if name[-1:].isupper()}
    letters = {letter for letter in letters if len(letter) == 1}
    return letters.pop() if len(letters) == 1 else ""


def _take_cross_names(
    person: Identity, rank: int, mates: Sequence[Identity], cross_names: dict[int, CrossName]
) -> None:
    names = cross_names.get(person.row.hip)
    if names is None:
        return
    if names.bayer:  # the index knows the superscripts, the identifiers of the extract do not
        person.bayer = names.bayer
    person.flamsteed = names.flamsteed or person.flamsteed
    person.variable = names.variable
    if rank == 0:
        person.common_name = names.common_name
    letter = names.gj[-1:] if names.gj[-1:].isalpha() else "A"
    fits = rank == "ABCDE".index(letter) and person.component in ("", letter)
    other = bool(person.hd and names.hd) and _hd_number(person.hd) != _hd_number(names.hd)
    if (len(mates) == 1 and not other) or (fits and not other and not any(mate.hd == names.hd for mate in mates)):
        person.hd = person.hd or names.hd
        person.gj = person.gj or names.gj


def _letter_components(people: Sequence[Identity]) -> None:
    """Give letters by brightness where two rows would have the same designation, and agree with the GJ letters."""
    for person in people:
        found = re.search(r"\d ?([A-E])$", person.gj)
        if found and not person.component:
            person.component, person.component_src = found[1], "measured"
    systems: dict[int, list[Identity]] = {}
    for person in people:
        systems.setdefault(person.row.system, []).append(person)
    for members in systems.values():
        for person in members:
            same = [other for other in members if _shared_designation(person, other)]
            taken = {other.component for other in same if other is not person}
            if len(same) > 1 and (not person.component or person.component in taken):
                free = [letter for letter in "ABCDE" if letter not in taken]
                person.component, person.component_src = free[0], "derived:order of brightness"

    for person in people:
        _drop_contradictions(person, systems[person.row.system])


def _drop_contradictions(person: Identity, members: Sequence[Identity]) -> None:
    """Drop what names another letter than the row's own (the sources differ on 36 Oph), in systems of several rows."""
    if len(members) < 2 or not person.component:
        return
    letter = person.component.lower()
    person.aliases = {alias for alias in person.aliases if split_component(designation_key(alias))[1] in ("", letter)}
    if any(other.gj == person.gj for other in members if other is not person) and person.gj[-1:].isalpha():
        person.gj = person.gj[:-1] + person.component


def _shared_designation(a: Identity, b: Identity) -> bool:
    if a.row.hip and a.row.hip == b.row.hip:
        return True
    return any(getattr(a, kind) and getattr(a, kind) == getattr(b, kind) for kind in ("bayer", "flamsteed"))


def _name(people: Sequence[Identity]) -> None:
    """Choose the name to show: Bayer, Flamsteed, HD, HIP, SIMBAD identifier; with letter where it is needed."""
    for person in people:
        _unindex(person)
    choices = [_choices(person) for person in people]
    taken: set[str] = set()
    bases = [options[0] for options in choices]
    for person, options in zip(people, choices, strict=True):
        needs_letter = bases.count(options[0]) > 1 and person.component
        first = f"{options[0]} {person.component}" if needs_letter else options[0]
        name = next(option for option in (first, *options[1:]) if option not in taken)
        taken.add(name)
        person.name = name


def _unindex(person: Identity) -> None:
    """Prefer ``alf Cen B`` to ``alf2 Cen`` where the archive itself uses the letter form."""
    if not re.search(r"\d ", person.bayer) or not person.component:
        return
    plain = re.sub(r"\d+ ", " ", person.bayer)
    if designation_key(f"{plain} {person.component}") in {designation_key(alias) for alias in person.aliases}:
        person.aliases.add(person.bayer)
        person.bayer = plain


def _choices(person: Identity) -> list[str]:
    greek = person.bayer if _GREEK_BAYER.match(person.bayer) else ""
    hip = f"HIP {person.row.hip}" if person.row.hip else ""
    options = (greek, person.flamsteed, person.bayer, person.hd, hip, person.row.star.simbad_id)
    return [option for option in options if option]
