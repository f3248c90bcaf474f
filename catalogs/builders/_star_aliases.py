"""``aliases.csv`` (names of catalogue rows) and ``known_stars.csv`` (well-named stars that are not in the catalogue).

Key forms come from :func:`catalogs.nomenclature.designation_key`, the same function that reads the user's query.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from catalogs.builders._star_identity import Identity
from catalogs.builders._star_select import MIN_PARALLAX_MAS, Removed, in_base_cut
from catalogs.builders._star_sources import CrossName, Hipparcos2, SimbadStar
from catalogs.coordinates import separation_arcsec
from catalogs.nomenclature import designation_key, split_component

__all__ = ["alias_rows", "known_star_rows"]


def alias_rows(people: Sequence[Identity]) -> list[tuple[str, str, int]]:
    """Return (key, row name, kind) for every alias, sorted by key.

    Kind 0 is a name of that row alone. Kind 1 is a name of the system, given to its brightest row.
    """
    own: dict[str, Identity] = {}
    shared: dict[str, Identity] = {}
    for person in people:
        for key in sorted(_own_keys(person)):
            holder = own.get(key) or shared.get(key)
            if holder is None:
                own[key] = person
            elif holder.row.system == person.row.system or holder.row.hip == person.row.hip:
                own.pop(key, None)  # two rows of one system have it: it is the system's name
                shared[key] = holder
            # otherwise the brighter star keeps the name
    for person in people:
        for key in sorted(_own_keys(person)):
            base, letter = split_component(key)
            holder = own.get(base)
            mates = [other for other in people if other.row.system == person.row.system]
            if not letter or base in shared or len(mates) < 2:
                continue
            if holder is None:
                shared[base] = mates[0]
            elif holder.row.system == person.row.system and holder is not mates[0]:
                shared[base] = mates[0]  # "alf Cen" among the aliases of alf Cen B alone
                del own[base]
    rows = [(key, person.name, 0) for key, person in own.items()]
    rows += [(key, person.name, 1) for key, person in shared.items()]
    return sorted(rows)


def _own_keys(person: Identity) -> set[str]:
    row = person.row
    names = {person.name, person.hd, person.gj, person.common_name, *person.aliases}
    designations = {person.bayer, person.flamsteed, person.variable} - {""}
    names |= designations
    if row.hip:
        designations.add(f"HIP {row.hip}")
        names.add(f"HIP {row.hip}")
    if person.component:
        names |= {f"{name} {person.component}" for name in designations}
    keys = {designation_key(name) for name in names if name}
    keys |= {re.sub(r"^omi(?=\d)", "o", key) for key in keys}  # o2 Eri is how people write omicron 2
    keys |= {key.removesuffix(" ab") for key in keys}
    return keys - {""}


def known_star_rows(
    people: Sequence[Identity],
    removed: Sequence[Removed],
    stars: Sequence[SimbadStar],
    hip2: Hipparcos2,
    cross_names: dict[int, CrossName],
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
    for hip in sorted(cross_names):
        names = cross_names[hip]
        if hip in inside or hip not in index:
            continue
        reason = _reason(index[hip], near, hip2)
        texts = (names.bayer, names.flamsteed, names.gj, names.hd, names.common_name, f"HIP {hip}")
        rows.append(({designation_key(text) for text in texts if text} - taken, reason))
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
