"""``aliases.csv`` (names of catalogue rows) and ``known_stars.csv`` (well-named stars that are not in the catalogue).

Key forms come from :func:`catalogs.nomenclature.designation_key`, the same function that reads the user's query.
"""

import re
from collections.abc import Iterable, Sequence

from catalogs import separation_arcsec
from catalogs.nomenclature import designation_key, split_component
from tools.build_catalogue.builders._star_identity import Identity
from tools.build_catalogue.builders._star_select import MIN_PARALLAX_MAS, Removed, in_base_cut
from tools.build_catalogue.builders._star_sources import CrossName, Hipparcos2, SimbadStar

#: Of the archive's aliases of stars outside the catalogue: HIP, HD and GJ numbers, and names that start with a letter.
_SPOKEN = re.compile(
    r"(?:HIP|HD|GJ) \d|(?!(?:TYC|TIC|WDS|IRAS|WISE|SAO|LTT|EPIC|TOI|KIC|LSPM|HR) )[A-Za-z' ]+(?: \d+)?$"
)


def alias_rows(people: Sequence[Identity]) -> list[tuple[str, str, int]]:
    """Return (key, row name, kind) for every alias, sorted by key.

    Kind 0 is a name of that row alone. Kind 1 is a name of the system, given to its brightest row.
    """
    own: dict[str, Identity] = {}
    shared: dict[str, Identity] = {}
    for keys_of in (_column_keys, _alias_keys):  # what stands in the table's columns goes before loose aliases
        for person in people:
            for key in sorted(keys_of(person)):
                holder = own.get(key) or shared.get(key)
                if holder is None:
                    own[key] = person
                elif holder is not person and holder.row.system == person.row.system and keys_of is _column_keys:
                    own.pop(key, None)  # two rows of one system have it: it is the system's name
                    shared[key] = holder
                # otherwise the first, that is the brighter star, keeps the name
    for person in people:
        mates = [other for other in people if other.row.system == person.row.system]
        for key in sorted(_own_keys(person)):
            base, letter = split_component(key)
            if letter and len(mates) > 1 and base not in own:
                shared.setdefault(base, mates[0])
    rows = [(key, person.name, 0) for key, person in own.items()]
    rows += [(key, person.name, 1) for key, person in shared.items()]
    return sorted(rows)


def _column_keys(person: Identity) -> set[str]:
    row = person.row
    designations = {person.bayer, person.flamsteed, person.variable} - {""}
    names = {person.name, person.hd, person.gj, person.common_name, row.star.simbad_id} | designations
    if row.hip:
        designations.add(f"HIP {row.hip}")
        names.add(f"HIP {row.hip}")
    if person.component:
        names |= {f"{name} {person.component}" for name in designations}
    return _spelled({designation_key(name) for name in names if name})


def _alias_keys(person: Identity) -> set[str]:
    return _spelled({designation_key(name) for name in person.aliases})


def _own_keys(person: Identity) -> set[str]:
    return _column_keys(person) | _alias_keys(person)


def _spelled(keys: set[str]) -> set[str]:
    """Add the forms that people use beside the canonical ones."""
    keys = keys | {re.sub(r"^omi(?=\d)", "o", key) for key in keys}  # o2 Eri is how people write omicron 2
    return (keys | {key.removesuffix(" ab") for key in keys}) - {""}


def known_star_rows(
    people: Sequence[Identity],
    removed: Sequence[Removed],
    stars: Sequence[SimbadStar],
    hip2: Hipparcos2,
    cross_names: dict[int, CrossName],
    alias_sets: Sequence[tuple[str, ...]],
) -> list[tuple[str, str]]:
    """Return (keys joined by '|', reason) of named stars outside the catalogue, sorted."""
    inside = {person.row.hip for person in people}
    taken = {key for person in people for key in _own_keys(person)}
    index = {int(hip): i for i, hip in enumerate(hip2.hip)}
    rows = []
    used: set[str] = set()
    for item in removed:
        keys = {designation_key(item.star.simbad_id)} - taken
        rows.append((keys, f"removed={item.reason}"))
    near = [star for star in stars if star.parallax_mas >= MIN_PARALLAX_MAS]
    texts: dict[int, set[str]] = {}
    for hip, names in cross_names.items():
        texts[hip] = {names.bayer, names.flamsteed, names.gj, names.hd, names.common_name, f"HIP {hip}"} - {""}
    for aliases in alias_sets:
        for hip in {int(name[4:]) for name in aliases if re.fullmatch(r"HIP \d+", name)}:
            texts.setdefault(hip, set()).update(filter(_SPOKEN.match, aliases))
    for hip in sorted(texts):
        if hip not in inside and hip in index:
            rows.append(({designation_key(text) for text in texts[hip]} - taken, _reason(index[hip], near, hip2)))
    lines = []
    for keys, reason in rows:
        fresh = sorted(keys - used)
        used |= keys
        if fresh:
            lines.append(("|".join(fresh), reason))
    return sorted(lines)


def _reason(i: int, near: Iterable[SimbadStar], hip2: Hipparcos2) -> str:
    """Return the reason as ``word=value``; :mod:`catalogs.names` turns it into a sentence."""
    if hip2.parallax_mas[i] < MIN_PARALLAX_MAS:
        return f"parallax={hip2.parallax_mas[i]:.2f}"
    for star in near:
        if abs(star.dec_deg - hip2.dec_deg[i]) < 0.01:
            sep = separation_arcsec(star.ra_deg, star.dec_deg, hip2.ra_deg[i], hip2.dec_deg[i])
            if sep < 5.0 and not in_base_cut(star):
                if star.sp_type[:1] not in ("F", "G", "K"):
                    return f"type={star.sp_type}"
                return f"v={star.v_mag:.2f}"
    return "type="
