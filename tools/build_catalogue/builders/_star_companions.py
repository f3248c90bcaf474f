"""The one companion of each row that puts most light near it, with its position where one is known.

Candidates are the other catalogue rows, all other entries of the SIMBAD extract (any type) with a consistent
parallax, and the WDS separation that ExoCat-1 lists; the one with the largest flux over squared separation wins.
Two Hipparcos entries give a measured relative position at 1991.25; other entries give theirs at 2000.0, good to about
an arcsecond. ExoCat-1 lists neither position angle nor epoch. Orbital motion is not modelled.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catalogs import position_angle, separation_arcsec, tangent_offset
from catalogs.simbad import is_blend_id
from tools.build_catalogue.builders._star_identity import Identity
from tools.build_catalogue.builders._star_select import Removed
from tools.build_catalogue.builders._star_sources import SimbadStar

_LIMIT_ARCSEC = 60.0
_MIN_SEPARATION_ARCSEC = 0.1
_PARALLAX_TOLERANCE = 0.2
_EXACT_ARCSEC = 0.2
_UNKNOWN_DELTA_V_MAG = 3.0
_NAN = float("nan")


@dataclass(frozen=True)
class _Candidate:
    name: str
    sep_arcsec: float
    pa_deg: float
    epoch_yr: float
    delta_v_mag: float
    src: str

    @property
    def weight(self) -> float:
        delta = self.delta_v_mag if np.isfinite(self.delta_v_mag) else _UNKNOWN_DELTA_V_MAG
        return float(10.0 ** (-0.4 * delta) / self.sep_arcsec**2)


def fill_companions(people: Sequence[Identity], stars: Sequence[SimbadStar], removed: Sequence[Removed]) -> None:
    """Fill the companion columns of every row, in place."""
    gone = {item.star.simbad_id for item in removed}
    pool = [
        star
        for star in stars
        if star.simbad_id not in gone and not is_blend_id(star.simbad_id) and np.isfinite(star.ra_deg + star.dec_deg)
    ]
    ra = np.array([star.ra_deg for star in pool])
    dec = np.array([star.dec_deg for star in pool])
    by_id = {person.row.star.simbad_id: person for person in people}
    for person in people:
        own = person.row.star
        near = np.flatnonzero(separation_arcsec(own.ra_deg, own.dec_deg, ra, dec) < _LIMIT_ARCSEC)
        others = [pool[int(i)] for i in near if pool[int(i)].simbad_id != own.simbad_id]
        found = [_from_entry(person, star, by_id) for star in others if _consistent(person, star)]
        candidates = [candidate for candidate in found if candidate.sep_arcsec > _MIN_SEPARATION_ARCSEC]
        listed = _from_exocat(person)
        if listed and not any(_same(listed, candidate) for candidate in candidates):
            candidates.append(listed)
        _write(person, max(candidates, key=lambda c: (c.weight, c.name)) if candidates else None)


def _consistent(person: Identity, star: SimbadStar) -> bool:
    own = person.row.sample_parallax_mas  # of the same time as that of the entry
    return abs(star.parallax_mas - own) < _PARALLAX_TOLERANCE * own


def _from_entry(person: Identity, star: SimbadStar, by_id: dict[str, Identity]) -> _Candidate:
    own = person.row
    mate = by_id.get(star.simbad_id)
    exact = (
        mate is not None
        and mate.row.hip != own.hip
        and own.hip_sep_arcsec < _EXACT_ARCSEC
        and mate.row.hip_sep_arcsec < _EXACT_ARCSEC
    )
    if mate is not None and exact:
        here, there, epoch = own.place_1991_deg, mate.row.place_1991_deg, 1991.25
        src = "measured:Hipparcos-2 positions"
    else:
        here, there, epoch = (own.star.ra_deg, own.star.dec_deg), (star.ra_deg, star.dec_deg), 2000.0
        src = "derived:positions of the entries"
    east, north = tangent_offset(*there, *here)
    return _Candidate(
        name=mate.name if mate else star.simbad_id,
        sep_arcsec=float(np.hypot(east, north)),
        pa_deg=float(position_angle(east, north)),
        epoch_yr=epoch,
        delta_v_mag=star.v_mag - own.star.v_mag,
        src=src,
    )


def _from_exocat(person: Identity) -> _Candidate | None:
    if person.exocat is None or not person.exocat.number("wds_sep") > 0.0:
        return None
    return _Candidate(
        name=f"WDS J{person.exocat.values['wds_designation']}",
        sep_arcsec=person.exocat.number("wds_sep"),
        pa_deg=_NAN,
        epoch_yr=_NAN,
        delta_v_mag=person.exocat.number("wds_deltamag"),
        src="measured:WDS (ExoCat-1)",
    )


def _same(listed: _Candidate, entry: _Candidate) -> bool:
    """Take a WDS line and an entry for one star, allowing for orbital motion between their epochs.

    Either the separations agree within a factor 3 and the brightness within 2 mag, or within a factor 6 and 0.5 mag.
    """
    ratio = max(listed.sep_arcsec / entry.sep_arcsec, entry.sep_arcsec / listed.sep_arcsec)
    if not np.isfinite(listed.delta_v_mag - entry.delta_v_mag):
        return ratio < 3.0
    difference = abs(abs(listed.delta_v_mag) - abs(entry.delta_v_mag))
    return (ratio < 3.0 and difference < 2.0) or (ratio < 6.0 and difference < 0.5)


def _write(person: Identity, best: _Candidate | None) -> None:
    values = person.row.values
    values["close_companion"] = person.row.star.binary_cut
    values["companion_name"] = best.name if best else ""
    values["companion_src"] = best.src if best else "missing"
    values["companion_sep_arcsec"] = best.sep_arcsec if best else _NAN
    values["companion_pa_deg"] = best.pa_deg if best else _NAN
    values["companion_epoch_yr"] = best.epoch_yr if best else _NAN
    values["companion_pa_src"] = best.src if best and np.isfinite(best.pa_deg) else "missing"
    values["companion_delta_v_mag"] = best.delta_v_mag if best else _NAN
    values["companion_delta_v_src"] = "missing"
    if best and np.isfinite(best.delta_v_mag):
        values["companion_delta_v_src"] = (
            "measured:WDS (ExoCat-1)" if "WDS" in best.src else "derived:V of both entries"
        )
