"""Orbits of visual binaries: where companions stand at a date, and where they leave room for planets.

``data/binary_orbits.csv`` is kept by hand: the relative orbit of one pair a row, with its reference and the date at
which its source was read. Both stars of a pair get each other, the second with the position angle turned by 180 deg.
ORB6 is the Sixth Catalog of Orbits of Visual Binary Stars (US Naval Observatory, public). Left out are orbits of a
photocentre (grade 9), incomplete ones (grade 7), pairs that are arcminutes apart, two orbits that no stars of such
colours can follow (104 Tau, HD 90508), and one that puts its pair 15 arcsec from where Hipparcos saw it (HD 72945). Of
several companions of a star the one with the largest flux over squared separation has the row.

At a date, proper motion carries the stars. A companion on a known orbit follows it; any other stays where it was last
seen, and may have moved since by as much as on a circular orbit in the plane of the sky.

Where both stars of such an orbit have a row, their centre of mass is carried by proper motion, and they stand around it
as the orbit has them: the mean of two places or motions by mass has no orbital motion in it, whenever they were
measured. So the place of one star from the other is the same by their coordinates and by the columns of the companion.
A star whose companion has no row stands where its own proper motion carries it.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Self

import numpy as np

from catalogs.coordinates import offset_place, propagate, tangent_offset
from catalogs.orbits import orbit_places
from catalogs.shipped import shipped_digest, shipped_objects
from catalogs.stars import StarTable, load_stars
from cpic_core import ArrayLike, BoolArray, FloatArray, NDArray, Record

_FILE = "binary_orbits.csv"
POSITION_ERROR_ARCSEC: Mapping[int, float] = MappingProxyType({1: 0.02, 2: 0.04, 3: 0.08, 4: 0.11, 5: 0.20, 8: 0.02})
"""Standard error of a predicted place by the grade of the orbit, arcsec.

ORB6 grades orbits from 1 (definitive) to 5 (indeterminate), and 8 where only visibilities were measured ("usually of
quite high quality"); it states no errors of places. These numbers compare its issues of 2008 and 2025: of pairs wider
than 1 arcsec whose orbit was replaced by one of the same or a better grade, 68 % of the places in 2010 and 2015 by the
older orbit lie as close to those by the newer one (12, 36, 36, 107 and 182 places of grades 1 to 5). Pairs of 0.2 to 1
arcsec agree with this to 0.03 arcsec.
"""
UNRESOLVED_ARCSEC = 0.1
"""A pair that is never wider than this is one source of light, whose V the star's row has."""
_ELEMENTS: tuple[str, ...] = ("period_yr", "periastron_yr", "semi_major_axis_arcsec")
_ELEMENTS += ("eccentricity", "inclination_deg", "omega_deg", "node_deg")
_DYNAMICAL_GRADES = (1, 2, 3, 8)
_FIT_MASS_RATIO = (0.1, 0.9)
_FIT_ECCENTRICITY_MAX = 0.8


class BinaryOrbit(Record):
    """The orbit of a companion around a star.

    Parameters
    ----------
    star, companion : str
        Names as in the star table; the companion need not have a row there.
    designation, wds : str
        Discoverer's designation, and designation in the Washington Double Star Catalog.
    period_yr : float
        Julian years.
    periastron_yr : float
        Julian epoch of a passage of the periastron.
    semi_major_axis_arcsec, eccentricity, inclination_deg, node_deg, omega_deg : float
        Of the relative orbit; the node east of north, the argument of the periastron from it along the motion.
    grade : int
        That of ORB6, see `POSITION_ERROR_ARCSEC`.
    delta_v_mag : float
        Companion's V less that of the star's row; nan where the star table's value stays, or none is known.
    star_mass_msun, companion_mass_msun : float
        Published masses; nan where there are none.
    reference, date, note : str
        Publication or its code in ORB6, when its source was read, remarks.
    """

    star: str
    companion: str
    designation: str
    wds: str
    period_yr: float
    periastron_yr: float
    semi_major_axis_arcsec: float
    eccentricity: float
    inclination_deg: float
    node_deg: float
    omega_deg: float
    grade: int
    delta_v_mag: float
    star_mass_msun: float
    companion_mass_msun: float
    reference: str
    date: str
    note: str

    @property
    def reversed(self) -> Self:
        """Return the same orbit as seen from the companion."""
        return replace(
            self,
            star=self.companion,
            companion=self.star,
            node_deg=(self.node_deg + 180.0) % 360.0,
            delta_v_mag=-self.delta_v_mag,
            star_mass_msun=self.companion_mass_msun,
            companion_mass_msun=self.star_mass_msun,
        )

    @property
    def resolved(self) -> bool:
        """Tell whether the two are ever wider apart than `UNRESOLVED_ARCSEC`."""
        return self.semi_major_axis_arcsec * (1.0 + self.eccentricity) > UNRESOLVED_ARCSEC


@functools.cache
def binary_orbits() -> tuple[BinaryOrbit, ...]:
    """Return the rows of ``binary_orbits.csv``, one for each pair. It is read once per process."""
    return shipped_objects(_FILE, BinaryOrbit)


@functools.cache
def orbits_by_star() -> Mapping[str, BinaryOrbit]:
    """Return the orbit of the companion of each star, as seen from it."""
    pairs = binary_orbits()
    seen = {pair.companion: pair.reversed for pair in pairs} | {pair.star: pair for pair in pairs}
    return MappingProxyType(seen)


@functools.cache
def orbits_vintage() -> str:
    """Return in one line what the orbits are: how many, how new, file, and the first digits of its checksum."""
    newest = max(orbit.date for orbit in binary_orbits())
    return f"companions on {len(binary_orbits())} orbits read until {newest} ({_FILE} {shipped_digest(_FILE)})"


def companion_places(orbits: Sequence[BinaryOrbit], epoch_yr: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return where companions stand.

    Parameters
    ----------
    orbits : sequence of BinaryOrbit
    epoch_yr : array_like
        Julian epochs; broadcasts against the orbits.

    Returns
    -------
    separation_arcsec, pa_deg : ndarray
        Separation, and position angle east of north from 0 to 360.
    """
    period, periastron, axis, e, tilt, omega, node = (
        np.array([getattr(orbit, name) for orbit in orbits], float) for name in _ELEMENTS
    )
    # From a parsec away, one au is one arcsec.
    places = orbit_places(axis, e, tilt, omega, node, 360.0 * (np.asarray(epoch_yr, float) - periastron) / period)
    pa = np.rad2deg(np.arctan2(places.east_au, places.north_au)) % 360.0
    return np.hypot(places.east_au, places.north_au), pa


def companion_share(orbit: BinaryOrbit) -> float:
    """Return the mass of the companion over that of both; half where neither masses nor orbit tell it.

    Published masses count first, then what Kepler's third law leaves for the companion, then the star table.

    Parameters
    ----------
    orbit : BinaryOrbit
    """
    limit = stability_limit(orbit.star)
    return 0.5 if limit is None else limit.mass_ratio


class StabilityLimit(Record):
    """Limits of the orbits that stay stable beside a companion star.

    Parameters
    ----------
    critical_au : float
        Largest semi-major axis of a stable orbit around the star itself; 0 where none is stable.
    circumbinary_au : float
        Smallest one of a stable orbit around both stars.
    within_fit : bool
        Whether the pair lies in the range of the fit, mass ratio 0.1 to 0.9 and eccentricity to 0.8; else the limits
        are extrapolated, and no more than an indication.
    mass_ratio : float
        Mass of the companion over that of both.
    semi_major_axis_au, eccentricity : float
        Of the binary.
    source : str
        Orbit, and where the masses come from.
    """

    critical_au: float
    circumbinary_au: float
    within_fit: bool
    mass_ratio: float
    semi_major_axis_au: float
    eccentricity: float
    source: str

    def stable(self, semi_major_axis_au: ArrayLike) -> BoolArray:
        """Tell for planets of these semi-major axes whether the binary leaves them on their orbits."""
        axis = np.asarray(semi_major_axis_au, float)
        return np.asarray((axis < self.critical_au) | (axis > self.circumbinary_au))


@functools.cache
def stability_limit(star_name: str) -> StabilityLimit | None:
    """Return the limits of Holman and Wiegert 1999 (AJ 117, 621, equations 1 and 3) for planets of a star.

    They are for planets that begin on circular orbits in the plane of the binary, over 10 000 of its periods: ``a/a_b =
    0.464 - 0.380 mu - 0.631 e + 0.586 mu e + 0.150 e^2 - 0.198 mu e^2`` around one star, ``1.60 + 5.10 e - 2.22 e^2 +
    4.12 mu - 4.27 e mu - 5.09 mu^2 + 4.61 e^2 mu^2`` around both. Retrograde planets are stable to 1.25 times the
    first, steeply inclined ones to half of it (Quarles et al. 2020, AJ 159, 80).

    Parameters
    ----------
    star_name : str
        As in the star table.

    Returns
    -------
    StabilityLimit or None
        None where no orbit of a companion is known, or one that asks for more than ten times the star's mass.
    """
    orbit = orbits_by_star().get(star_name)
    distance_pc, mass_msun = _of_row(star_name, "distance_pc"), _of_row(star_name, "mass_msun")
    if orbit is None or distance_pc is None or mass_msun is None:
        return None
    axis_au = orbit.semi_major_axis_arcsec * distance_pc
    own = mass_msun if math.isnan(orbit.star_mass_msun) else orbit.star_mass_msun
    total = axis_au**3 / orbit.period_yr**2
    if total > 10.0 * own:
        return None
    mu, masses = _mass_ratio(orbit, own, total)
    e = orbit.eccentricity
    around_one = 0.464 - 0.380 * mu - 0.631 * e + 0.586 * mu * e + 0.150 * e**2 - 0.198 * mu * e**2
    less = min(mu, 1.0 - mu)
    around_both = 1.60 + 5.10 * e - 2.22 * e**2 + 4.12 * less - 4.27 * e * less - 5.09 * less**2 + 4.61 * e**2 * less**2
    return StabilityLimit(
        critical_au=max(0.0, around_one * axis_au),
        circumbinary_au=around_both * axis_au,
        within_fit=_FIT_MASS_RATIO[0] <= mu <= _FIT_MASS_RATIO[1] and e <= _FIT_ECCENTRICITY_MAX,
        mass_ratio=mu,
        semi_major_axis_au=axis_au,
        eccentricity=e,
        source=f"orbit of {orbit.reference}, grade {orbit.grade}; {masses}",
    )


@functools.cache
def _rows() -> Mapping[str, int]:
    return {name: row for row, name in enumerate(load_stars().column("name").tolist())}


def _of_row(name: str, column: str) -> float | None:
    return float(load_stars().columns[column][_rows()[name]]) if name in _rows() else None


def _mass_ratio(orbit: BinaryOrbit, own: float, total: float) -> tuple[float, str]:
    """Return the companion's share of the mass of both, and where it comes from, by the star's mass and the orbit's."""
    if math.isfinite(orbit.companion_mass_msun):
        return orbit.companion_mass_msun / (own + orbit.companion_mass_msun), "published masses"
    dynamical = 1.0 - own / total
    if orbit.grade in _DYNAMICAL_GRADES and dynamical > 0.0:
        return dynamical, "mass of both by Kepler's third law, the star's as in the star table"
    mass = _of_row(orbit.companion, "mass_msun")
    if mass is not None:
        return mass / (own + mass), "masses as in the star table"
    # A poor orbit can ask for a companion of no mass, or for one that outweighs the brighter star.
    if 0.0 < dynamical <= 0.5:
        return dynamical, "mass of both by Kepler's third law, the star's as in the star table"
    return 0.5, "equal masses assumed, as the orbit gives none"


POSITION_ERROR = "companion_position_error_arcsec"
"""Column that `stars_at` adds: standard error of the companion's place; nan where its age is not known."""
_PAIR_TO_STAR_MASS = 2.0


def stars_at(table: StarTable, epoch_yr: float, *, orbits: bool = True, apart: bool = False) -> StarTable:
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
    apart : bool
        Whether each row is asked about alone, so that no star stands around the centre of its pair, of which a table of
        both knows the other's place too.

    Returns
    -------
    StarTable
        With the column `POSITION_ERROR` beside those of ``table``.
    """
    columns = _moved(table, epoch_yr) | {POSITION_ERROR: _drift_arcsec(table, epoch_yr)}
    if orbits:
        columns |= _on_orbits(table, epoch_yr, columns[POSITION_ERROR])
        if not apart:
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
