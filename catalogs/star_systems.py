"""Bound systems of a star table, the one parallax that their members share, and entries of blended light.

Rows close on the sky with consistent parallax and proper motion are one system, and all its members take the parallax
of the member with the best parallax over error: the components' own values can differ by more than their distance does.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from catalogs.coordinates import neighbours, separation_arcsec

CLOSE_ARCSEC = 30.0
"""Rows of consistent parallax this close are one system whatever their proper motions say."""
CLOSE_COMPANION_ARCSEC = 10.0
"""A companion nearer than this is a close one."""
_GROUP_ARCSEC = 600.0
#: Identifiers of blended light end in two or more component letters.
_COMPOSITE_ID = re.compile(r"(?:CCDM|\*\*|ADS|IDS|WDS) .*\d ?[A-Z]{2,}")


class Member(NamedTuple):
    """The columns that decide whether two rows are bound; nan where unknown, `hip` 0 if none."""

    ra_deg: float
    dec_deg: float
    hip: int
    parallax_mas: float
    parallax_err_mas: float
    pm_ra_mas_yr: float
    pm_dec_mas_yr: float


class Adopted(NamedTuple):
    """The parallax that one row takes; `lender` is the row that it comes from, -1 if its own or a mean."""

    parallax_mas: float
    parallax_err_mas: float
    src: str
    err_src: str
    lender: int
    shared: bool


def is_blend_id(simbad_id: str) -> bool:
    """Tell whether an identifier names the blended light of several components."""
    return _COMPOSITE_ID.fullmatch(simbad_id) is not None


def group_systems(members: Sequence[Member]) -> list[int]:
    """Return the system number of each row: that of its first member, a single star is a system of its own."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    near = neighbours([item.ra_deg for item in members], [item.dec_deg for item in members], _GROUP_ARCSEC)
    bound = [(i, j) for i, others in enumerate(near) for j in others if j > i and _bound(members[i], members[j])]
    if not bound:
        return list(range(len(members)))
    links = coo_array((np.ones(len(bound)), tuple(zip(*bound, strict=True))), shape=(len(members),) * 2)
    _, label = connected_components(links, directed=False)
    _, first, system = np.unique(label, return_index=True, return_inverse=True)
    return [int(row) for row in first[system]]


def _bound(a: Member, b: Member) -> bool:
    sep = float(separation_arcsec(a.ra_deg, a.dec_deg, b.ra_deg, b.dec_deg))
    if sep > _GROUP_ARCSEC:
        return False
    if a.hip and a.hip == b.hip:
        return True
    errors = float(np.nan_to_num(np.hypot(a.parallax_err_mas, b.parallax_err_mas)))
    tolerance = max(0.1 * max(a.parallax_mas, b.parallax_mas), 3.0 * errors)
    if abs(a.parallax_mas - b.parallax_mas) > tolerance:
        return False
    if sep < CLOSE_ARCSEC:
        return True
    move_a = np.array([a.pm_ra_mas_yr, a.pm_dec_mas_yr])
    move_b = np.array([b.pm_ra_mas_yr, b.pm_dec_mas_yr])
    if not (np.isfinite(move_a).all() and np.isfinite(move_b).all()):
        return True
    return float(np.hypot(*(move_a - move_b))) < 0.3 * float(np.hypot(*move_a)) + 20.0


def adopt_parallaxes(members: Sequence[Member], systems: Sequence[int]) -> list[Adopted]:
    """Return the parallax of each row: that of its system's best member, or the mean where none has an error.

    Parameters
    ----------
    members : sequence of Member
        The rows of a table.
    systems : sequence of int
        System of each, as `group_systems` numbers them.
    """
    rows_of: dict[int, list[int]] = {}
    for row, system in enumerate(systems):
        rows_of.setdefault(system, []).append(row)
    adopted: dict[int, Adopted] = {}
    for rows in rows_of.values():
        measured = [row for row in rows if np.isfinite(members[row].parallax_err_mas)]
        if measured:
            best = max(measured, key=lambda row: members[row].parallax_mas / members[row].parallax_err_mas)
            value, error = members[best].parallax_mas, members[best].parallax_err_mas
            for row in rows:
                own = (members[row].parallax_mas, members[row].parallax_err_mas) == (value, error)
                lender = -1 if own else best
                adopted[row] = Adopted(value, error, "measured" if own else "", "measured", lender, shared=not own)
            continue
        values = [members[row].parallax_mas for row in rows]
        taken = Adopted(values[0], float("nan"), "measured", "missing", -1, shared=False)
        if len(rows) > 1:
            src, err_src = (
                "derived:mean of the components' values",
                "derived:half the difference of the components' values",
            )
            spread = float(max(values) - min(values))
            taken = Adopted(float(np.mean(values)), spread / 2.0, src, err_src, -1, shared=True)
        adopted |= dict.fromkeys(rows, taken)
    return [adopted[row] for row in range(len(members))]
