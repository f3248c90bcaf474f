"""Positions of the stars of a table and of their companions at a date.

Proper motion carries the stars. A companion on a known orbit follows it; any other stays where it was last seen, and
may have moved since by as much as on a circular orbit in the plane of the sky.

Where both stars of such an orbit have a row, their centre of mass is carried by proper motion, and they stand around it
as the orbit has them: the mean of two places or motions by mass has no orbital motion in it, whenever they were
measured. So the place of one star from the other is the same by their coordinates and by the columns of the companion.
A star whose companion has no row stands where its own proper motion carries it.
"""

from dataclasses import replace

import numpy as np

from catalogs.binaries import POSITION_ERROR_ARCSEC, binary_orbits, companion_places, companion_share, orbits_by_star
from catalogs.coordinates import offset_place, propagate, tangent_offset
from catalogs.stars import StarTable
from cpic_core import FloatArray, NDArray

POSITION_ERROR = "companion_position_error_arcsec"
"""Column that `stars_at` adds: standard error of the companion's place; nan where its age is not known."""
_PAIR_TO_STAR_MASS = 2.0


def stars_at(table: StarTable, epoch_yr: float, *, orbits: bool = True) -> StarTable:
    """Return a star table with the places of an epoch.

    Parameters
    ----------
    table : StarTable
        Its ``epoch_yr`` is that of its positions, J2000.0 where none is given. Without a proper motion a star stays.
    epoch_yr : float
        Julian epoch.
    orbits : bool
        Whether companions follow the orbits of ``binary_orbits.csv``. Pairs that are never resolved keep the companion
        of the table: their light is that of one star.

    Returns
    -------
    StarTable
        With the column `POSITION_ERROR` beside those of ``table``.
    """
    columns = _moved(table, epoch_yr) | {POSITION_ERROR: _drift_arcsec(table, epoch_yr)}
    if orbits:
        columns |= _on_orbits(table, epoch_yr, columns[POSITION_ERROR])
        columns |= _around_centres(table, epoch_yr, columns["ra_deg"], columns["dec_deg"])
    units = {**table.units, POSITION_ERROR: "arcsec"}
    descriptions = {**table.descriptions, POSITION_ERROR: "standard error of the companion's place"}
    return replace(table, columns={**table.columns, **columns}, units=units, descriptions=descriptions)


def _moved(table: StarTable, epoch_yr: float) -> dict[str, NDArray[np.generic]]:
    """Return the positions and proper motions of the epoch, of the stars that have any."""
    names = ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr")
    now = {name: np.array(table.column(name), float) for name in names}
    placed = np.isfinite(now["ra_deg"]) & np.isfinite(now["dec_deg"])
    begin = _known(table, "epoch_yr", 2000.0)
    parallax = _known(table, "parallax_mas", 1.0)
    rv = _known(table, "rv_km_s", 0.0)
    ra, dec, pm_ra, pm_dec = (np.nan_to_num(now[name][placed]) for name in names)
    there = propagate(ra, dec, pm_ra, pm_dec, parallax[placed], rv[placed], begin[placed], epoch_yr)
    for name in names:
        now[name][placed] = getattr(there, name)
    return {**now, "epoch_yr": np.where(placed, epoch_yr, begin)}


def _known(table: StarTable, name: str, otherwise: float) -> FloatArray:
    values = np.asarray(table.column(name), float)
    return np.where(np.isfinite(values), values, otherwise)


def _drift_arcsec(table: StarTable, epoch_yr: float) -> FloatArray:
    """Return how far companions can have moved since they were seen, on circular orbits around two stellar masses."""
    separation, age = (np.array(table.column(f"companion_{name}"), float) for name in ("sep_arcsec", "epoch_yr"))
    distance = np.asarray(table.column("distance_pc"), float)
    mass = _PAIR_TO_STAR_MASS * _known(table, "mass_msun", 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed_arcsec_yr = 2.0 * np.pi * np.sqrt(mass / (separation * distance)) / distance
        return np.asarray(np.minimum(speed_arcsec_yr * np.abs(epoch_yr - age), 2.0 * separation))


def _on_orbits(table: StarTable, epoch_yr: float, error: NDArray[np.generic]) -> dict[str, NDArray[np.generic]]:
    """Return the columns of the companions, with those that have orbits where these put them."""
    known = orbits_by_star()
    names = table.column("name").tolist()
    rows = [row for row, name in enumerate(names) if name in known and known[name].resolved]
    if not rows:
        return {}
    found = [known[names[row]] for row in rows]
    separation, pa = companion_places(found, epoch_yr)
    place = [f"derived:orbit of {orbit.reference}, grade {orbit.grade}" for orbit in found]
    fainter = np.array([orbit.delta_v_mag for orbit in found])
    listed = np.asarray(table.column("companion_delta_v_mag"), float)[rows]
    measured = np.isfinite(fainter)
    sources = table.column("companion_delta_v_src")[rows]
    values: dict[str, NDArray[np.generic]] = {
        "companion_name": np.array([orbit.companion for orbit in found]),
        "companion_sep_arcsec": separation,
        "companion_pa_deg": pa,
        "companion_epoch_yr": np.full(len(rows), epoch_yr),
        "companion_src": np.array(place),
        "companion_pa_src": np.array(place),
        "companion_delta_v_mag": np.where(measured, fainter, listed),
        "companion_delta_v_src": np.where(measured, "measured:V as listed with the orbit", sources),
    }
    columns = {name: _put(table.column(name), rows, cells) for name, cells in values.items()}
    errors = np.array([POSITION_ERROR_ARCSEC[orbit.grade] for orbit in found])
    return {**columns, POSITION_ERROR: _put(error, rows, errors)}


def _around_centres(
    table: StarTable, epoch_yr: float, ra_deg: NDArray[np.generic], dec_deg: NDArray[np.generic]
) -> dict[str, NDArray[np.generic]]:
    """Return the positions with both stars of each orbit around the centre of mass of the places that are given."""
    rows = {name: row for row, name in enumerate(table.column("name").tolist())}
    pairs = [pair for pair in binary_orbits() if pair.resolved and pair.star in rows and pair.companion in rows]
    places = np.array([ra_deg, dec_deg], float)
    stars, others = (np.array([rows[getattr(pair, name)] for pair in pairs], int) for name in ("star", "companion"))
    placed = np.isfinite(places[:, stars]).all(axis=0) & np.isfinite(places[:, others]).all(axis=0)
    pairs, stars, others = [pair for pair, has in zip(pairs, placed, strict=True) if has], stars[placed], others[placed]
    if not pairs:
        return {}
    separation, pa = companion_places(pairs, epoch_yr)
    angle, share = np.deg2rad(pa), np.array([companion_share(pair) for pair in pairs])
    orbit = separation * np.array([np.sin(angle), np.cos(angle)])
    start = places[:, stars]
    centre = share * np.array(tangent_offset(*places[:, others], *start))
    places[:, stars] = offset_place(*start, *(centre - share * orbit))
    places[:, others] = offset_place(*places[:, stars], *orbit)
    return {"ra_deg": places[0], "dec_deg": places[1]}


def _put(values: NDArray[np.generic], rows: list[int], cells: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return the values with other cells, in a type that holds both."""
    changed = values.astype(np.result_type(values, cells))
    changed[rows] = cells
    return changed
