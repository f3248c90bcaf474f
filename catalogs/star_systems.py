"""Bound systems of a star table, the one parallax that their members share, and entries of blended light.

Rows close on the sky with consistent parallax and proper motion are one system, and all its members take the parallax
of the member with the best parallax over error: the components' own values can differ by more than their distance does.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from catalogs.coordinates import neighbours

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

    ra, dec, hip, parallax, error, *motion = np.array(members, float).reshape(-1, len(Member._fields)).T
    near = neighbours(ra, dec, _GROUP_ARCSEC)
    if not any(near):
        return list(range(len(members)))
    pairs = [(i, j, sep) for i, others in enumerate(near) for j, sep in others.items() if j > i]
    first, second, sep = (np.array(part) for part in zip(*pairs, strict=True))
    one, other = (np.array([hip, parallax, error, *motion])[:, rows] for rows in (first, second))
    tolerance = np.maximum(0.1 * np.maximum(one[1], other[1]), 3.0 * np.nan_to_num(np.hypot(one[2], other[2])))
    differ = np.hypot(*(one[3:] - other[3:])) >= 0.3 * np.hypot(*one[3:]) + 20.0  # not where a motion is unknown
    bound = (np.abs(one[1] - other[1]) <= tolerance) & ((sep < CLOSE_ARCSEC) | ~differ)
    bound |= (one[0] > 0) & (one[0] == other[0])
    links = coo_array((np.ones(bound.sum()), (first[bound], second[bound])), shape=(len(members),) * 2)
    _, label = connected_components(links, directed=False)
    _, begin, system = np.unique(label, return_index=True, return_inverse=True)
    return [int(row) for row in begin[system]]


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
