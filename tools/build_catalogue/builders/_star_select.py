"""Select the rows of the SIMBAD extract that enter the catalogue, and the parallax that each one takes.

1. Cut: spectral type starting with F, G or K, parallax >= 25 mas, V <= 7.5 (no lower limit).
2. Match to Hipparcos-2 by position at J2000.
3. Composites (one entry for the blended light of several stars) leave when a component has its own entry.
4. The members of a bound system take one parallax (:mod:`catalogs.simbad`). A row whose adopted parallax is
   below 25 mas leaves.
5. What remains is the sample, which the paper cut by the parallaxes of its time. Its distances are then those of newer
   parallaxes where these are better (`is_better`), shared anew: some 50 stars turn out to be farther than 40 pc.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from catalogs import separation_arcsec
from catalogs.simbad import CLOSE_ARCSEC, Member, adopt_parallaxes, group_systems, is_blend_id
from tools.build_catalogue.builders._star_sources import Hipparcos2, Parallax, SimbadStar

MIN_PARALLAX_MAS = 25.0
MAX_V_MAG = 7.5

_MATCH_ARCSEC = 12.0
_MATCH_SAME_PARALLAX_ARCSEC = 40.0
_COMPOSITE_ARCSEC = 30.0
_SAME_STAR_ARCSEC = 0.05
_SHARP_MAS = 0.1
_AGREEING_ERRORS = 5.0


@dataclass
class Row:
    """A catalogue row while it is being built."""

    star: SimbadStar
    hip: int = 0
    hip_sep_arcsec: float = float("nan")
    place_1991_deg: tuple[float, float] = (float("nan"), float("nan"))
    own_parallax: tuple[float, float] = (float("nan"), float("nan"))
    own_parallax_src: str = "measured:SIMBAD"
    sample_parallax_mas: float = float("nan")
    parallax_mas: float = float("nan")
    parallax_err_mas: float = float("nan")
    parallax_src: str = ""
    parallax_err_src: str = ""
    lender: "Row | None" = None
    system: int = -1
    flags: set[str] = field(default_factory=set)
    values: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Removed:
    """A row of the cut that is not in the catalogue, and why."""

    star: SimbadStar
    hip: int
    reason: str


def in_base_cut(star: SimbadStar) -> bool:
    """Tell whether a row passes the spectral-type, parallax and magnitude cuts."""
    return star.sp_type[:1] in ("F", "G", "K") and star.parallax_mas >= MIN_PARALLAX_MAS and star.v_mag <= MAX_V_MAG


def select(
    stars: Sequence[SimbadStar], hip2: Hipparcos2, bright: dict[int, tuple[float, float]], newer: Mapping[str, Parallax]
) -> tuple[list[Row], list[Removed]]:
    """Return the catalogue rows in order of V (then identifier), and the removed rows."""
    rows = [Row(star) for star in stars if in_base_cut(star)]
    rows.sort(key=lambda row: (row.star.v_mag, row.star.simbad_id))
    solved = set(hip2.hip.tolist())
    unsolved = {hip: place for hip, place in bright.items() if hip not in solved}
    for row in rows:
        _match(row, hip2, unsolved)
    rows, removed = _without_composites(rows)
    _share_parallaxes(rows)
    for row in rows:
        if row.parallax_mas < MIN_PARALLAX_MAS:
            reason = (
                f"adopted parallax {row.parallax_mas:.2f} mas is below 25 mas (extract: {row.star.parallax_mas:.2f})"
            )
            removed.append(Removed(row.star, row.hip, reason))
    kept = [row for row in rows if row.parallax_mas >= MIN_PARALLAX_MAS]
    for row in kept:
        row.sample_parallax_mas = row.parallax_mas
        found = newer.get(row.star.simbad_id)
        if found and is_better(found, *row.own_parallax):
            row.own_parallax = (found.parallax_mas, found.parallax_err_mas)
            row.own_parallax_src = f"measured:{found.reference}"
    _share_parallaxes(kept)
    return kept, removed


def is_better(found: Parallax, parallax_mas: float, parallax_err_mas: float) -> bool:
    """Tell whether a newer parallax replaces the one of Hipparcos, mas, whose error is nan if it has none.

    Its error must be the smaller one. Above 0.1 mas it tells of a star that Gaia sees saturated, or moved by a
    companion that five parameters leave out (HD 10307, HD 122742): then the two must agree within five errors.
    """
    error, other = found.parallax_err_mas, parallax_err_mas
    if not np.isfinite(other):
        return True
    apart = abs(found.parallax_mas - parallax_mas)
    return error < other and (error <= _SHARP_MAS or apart <= _AGREEING_ERRORS * float(np.hypot(error, other)))


def _match(row: Row, hip2: Hipparcos2, unsolved: dict[int, tuple[float, float]]) -> None:
    star = row.star
    sep = separation_arcsec(star.ra_deg, star.dec_deg, hip2.ra_deg, hip2.dec_deg)
    best = int(np.argmin(sep))
    same_parallax = abs(hip2.parallax_mas[best] - star.parallax_mas) < 0.02
    if sep[best] < (_MATCH_SAME_PARALLAX_ARCSEC if same_parallax else _MATCH_ARCSEC):
        row.hip = int(hip2.hip[best])
        row.hip_sep_arcsec = float(sep[best])
        row.place_1991_deg = (float(hip2.ra_1991_deg[best]), float(hip2.dec_1991_deg[best]))
        row.own_parallax = (float(hip2.parallax_mas[best]), float(hip2.parallax_err_mas[best]))
        row.own_parallax_src = "measured:Hipparcos-2"
        return
    row.own_parallax = (star.parallax_mas, float("nan"))
    numbers = list(unsolved)
    places = np.array([unsolved[hip] for hip in numbers])
    sep = separation_arcsec(star.ra_deg, star.dec_deg, places[:, 0], places[:, 1])
    if sep.min() < CLOSE_ARCSEC:  # in the Hipparcos catalogue, but without a solution in the new reduction
        row.hip = numbers[int(np.argmin(sep))]


def _without_composites(rows: list[Row]) -> tuple[list[Row], list[Removed]]:
    removed: list[Removed] = []
    named = [row for row in rows if is_blend_id(row.star.simbad_id)]
    others = [row for row in rows if row not in named]
    kept = list(others)
    for row in named:
        parts = [other for other in others if _sep(row, other) < _COMPOSITE_ARCSEC]
        if parts:
            listed = ", ".join(other.star.simbad_id for other in parts)
            removed.append(Removed(row.star, row.hip, f"blend of components that are listed: {listed}"))
        else:
            row.flags.add("composite")
            kept.append(row)
    # A plain identifier is a blend too when it sits on the Hipparcos position that fainter entries share.
    by_hip: dict[int, list[Row]] = {}
    for row in kept:
        if row.hip and row.hip_sep_arcsec < _MATCH_ARCSEC:
            by_hip.setdefault(row.hip, []).append(row)
    for members in by_hip.values():
        first = min(members, key=lambda row: row.star.v_mag)
        rest = [row for row in members if row is not first]
        if rest and first.hip_sep_arcsec < _SAME_STAR_ARCSEC and first.star.v_mag < min(r.star.v_mag for r in rest):
            listed = ", ".join(other.star.simbad_id for other in rest)
            removed.append(Removed(first.star, first.hip, f"blend of components that are listed: {listed}"))
            kept.remove(first)
    kept.sort(key=lambda row: (row.star.v_mag, row.star.simbad_id))
    return kept, removed


def _sep(a: Row, b: Row) -> float:
    return float(separation_arcsec(a.star.ra_deg, a.star.dec_deg, b.star.ra_deg, b.star.dec_deg))


def _share_parallaxes(rows: list[Row]) -> None:
    """Give numbers to the bound systems, and give every member the parallax of the best."""
    members = [_member(row) for row in rows]
    systems = group_systems(members)
    for row, system, taken in zip(rows, systems, adopt_parallaxes(members, systems), strict=True):
        row.system = system
        row.parallax_mas, row.parallax_err_mas = taken.parallax_mas, taken.parallax_err_mas
        row.parallax_src = row.own_parallax_src if taken.src == "measured" else taken.src
        row.parallax_err_src = taken.err_src
        row.lender = rows[taken.lender] if taken.lender >= 0 else None
        row.flags.discard("shared_parallax")
        if taken.shared:
            row.flags.add("shared_parallax")


def _member(row: Row) -> Member:
    star = row.star
    return Member(star.ra_deg, star.dec_deg, row.hip, *row.own_parallax, star.pm_ra_mas_yr, star.pm_dec_mas_yr)
