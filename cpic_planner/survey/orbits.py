"""Orbits of the planets that a survey finds: how well the positions in its images determine them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.planets import OrbitQuality, PublishedOrbit, astrometric_error_arcsec, orbit_quality, published_orbit
from cpic_planner.survey.calendar import Calendar, sun_position_angle_deg
from cpic_planner.survey.detection import detection_chance, expected_signals
from cpic_planner.survey.universe import NEW, PlanetSample, at_known_place
from simulator.config import AlbedoSpec

if TYPE_CHECKING:
    from cpic_planner.survey.history import StarHistory
    from cpic_planner.survey.simulate import Survey

LEAST_EPOCHS = 2
"""Positions without which nothing is said of an orbit. One is enough of a planet whose published orbit has its node and
inclination: where these are open, a second orbit, turned the other way, passes through the same place."""
UNIQUE_EPOCHS = 4
"""Positions without which an orbit is not known whose arc is a period or longer, since the planet may have gone round
once more: of three such positions four in ten fit a second period (25 campaigns), of four one in twenty-five."""
COUNTED_PERIODS = 0.1
"""Error, in periods, within which a published period says how often a planet has gone round in the arc."""
_YEAR_DAYS = 365.25


class Epoch(NamedTuple):
    """One visit of a star: day after the start, band, SNR of each planet, and which it detects."""

    day: float
    band: str
    snr: FloatArray
    shown: BoolArray


@dataclass(frozen=True, eq=False)
class FoundOrbits:
    """Orbits of some planets of a star, arrays of one length.

    Attributes
    ----------
    planet : ndarray of int
        Position of the planet among those of the star.
    quality : OrbitQuality
        From its positions so far.
    next_day : ndarray
        Of the next window of the star, after the start of the survey.
    place_error_lambda_d : ndarray
        Error of the place there, in lambda/D of the last band that showed the planet.
    known : ndarray of bool
        Whether the orbit is known by the rule of the strategy (`cpic_planner.survey.strategy.OrbitRule`).
    """

    planet: IntArray
    quality: OrbitQuality
    next_day: FloatArray
    place_error_lambda_d: FloatArray
    known: BoolArray


class PublishedOrbits(dict[int, PublishedOrbit]):
    """The published orbits of a star's known planets, by their row; made when first asked for.

    Parameters
    ----------
    table : KnownPlanetTable or None
        None: no planet of the star is known.
    epoch_mjd : float
        Of the planets' places.
    star_mass_msun : float
        Where the table has none.
    """

    def __init__(self, table: KnownPlanetTable | None, epoch_mjd: float, star_mass_msun: float) -> None:
        super().__init__()
        self._table, self._epoch_mjd, self._mass_msun = table, epoch_mjd, star_mass_msun

    def __missing__(self, row: int) -> PublishedOrbit:
        """Make what is published of a planet."""
        if self._table is None:
            raise KeyError(row)
        self[row] = published_orbit(self._table, row, epoch_mjd=self._epoch_mjd, star_mass_msun=self._mass_msun)
        return self[row]


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of planets of a star and what was published of their orbits; arrays over ``n`` planets.

    Attributes
    ----------
    day : ndarray, shape (n, t)
        After the start of the survey, in the order of time.
    error_arcsec : ndarray, shape (n, t)
        On each axis; inf where there is no position.
    width_arcsec : ndarray, shape (n,)
        lambda/D of the last band that showed the planet.
    published : ndarray, shape (n, 7, 7)
        As of `cpic_planner.planets.orbit_quality`.
    period_error : ndarray, shape (n,)
        Relative, as published; inf where it is not.
    placed : ndarray of bool, shape (n,)
        Planets whose published orbit has node and inclination.
    """

    day: FloatArray
    error_arcsec: FloatArray
    width_arcsec: FloatArray
    published: FloatArray
    period_error: FloatArray
    placed: BoolArray

    @property
    def last_day(self) -> FloatArray:
        """Day of the last position; -inf where there is none."""
        return np.asarray(np.where(np.isfinite(self.error_arcsec), self.day, -np.inf).max(axis=1, initial=-np.inf))

    @property
    def first_day(self) -> FloatArray:
        """Day of the first position; inf where there is none."""
        return np.asarray(np.where(np.isfinite(self.error_arcsec), self.day, np.inf).min(axis=1, initial=np.inf))

    def enough(self, epochs: IntArray, arc_periods: FloatArray) -> BoolArray:
        """Tell whether so many positions over such an arc, shape (n,) or (n, t), allow one orbit only.

        Parameters
        ----------
        epochs : ndarray of int, shape (n,)
        arc_periods : ndarray
        """
        shape = (-1,) + (1,) * (arc_periods.ndim - 1)
        told = self.placed.reshape(shape), self.period_error.reshape(shape)
        return one_orbit(epochs.reshape(shape), arc_periods, *told)


def one_orbit(
    epochs: IntArray | int, arc_periods: FloatArray, placed: BoolArray, period_error: FloatArray
) -> BoolArray:
    """Tell whether so many positions over an arc allow one orbit only; arrays broadcast.

    Parameters
    ----------
    epochs : int or ndarray of int
    arc_periods : ndarray
    placed, period_error : ndarray
        As of `Positions`.
    """
    number = np.asarray(epochs)
    counted = arc_periods < COUNTED_PERIODS / period_error
    return np.asarray(
        (number >= np.where(placed, 1, LEAST_EPOCHS)) & ((number >= UNIQUE_EPOCHS) | (arc_periods < 1.0) | counted)
    )


def positions_of(survey: Survey, star: StarHistory, rows: IntArray) -> Positions:
    """Return the positions of some planets of a star.

    Parameters
    ----------
    survey : Survey
    star : StarHistory
    rows : ndarray of int
        Numbers of the planets among those of the star.

    Notes
    -----
    Positions are those of the visits that detect the planet, follow-up and the observation log included, with errors of
    `cpic_planner.planets.astrometric_error_arcsec` for the SNR there.
    """
    rule, planets = survey.strategy.orbit, star.planets.select(rows)
    shape = len(star.epochs), len(star.planets)
    shown = np.array([epoch.shown for epoch in star.epochs], bool).reshape(shape).T[rows]
    snr = np.array([epoch.snr for epoch in star.epochs], float).reshape(shape).T[rows]
    day = np.broadcast_to(np.array([epoch.day for epoch in star.epochs], float), shown.shape)
    widths = np.array([survey.model.metrics[epoch.band].lambda_d_arcsec for epoch in star.epochs], float)
    errors = np.full(shown.shape, np.inf)
    errors[shown] = astrometric_error_arcsec(snr[shown], np.broadcast_to(widths, shown.shape)[shown], rule.floor_mas)
    last = [np.flatnonzero(mine)[-1] if mine.any() else -1 for mine in shown]
    width = np.array([widths[k] if k >= 0 else np.nan for k in last], float)
    told = told_of(planets, star.published, rule.star_mass_error)
    return Positions(day, errors, width, *told, at_known_place(planets, survey.known))


def told_of(
    planets: PlanetSample, published: dict[int, PublishedOrbit], star_mass_error: float
) -> tuple[FloatArray, FloatArray]:
    """Return what is published of planets, as of `Positions`: covariances, and errors of the period.

    Parameters
    ----------
    planets : PlanetSample
    published : dict of int to PublishedOrbit
        By the row of known planets.
    star_mass_error : float
        Relative error of the mass of the star, above 0.
    """
    covariance, period_error = np.full((len(planets), 7, 7), np.nan), np.full(len(planets), np.inf)
    for row in np.unique(planets.known[planets.known != NEW]).tolist():
        mine, orbit = planets.known == row, published[row]
        own = planets.select(mine)
        covariance[mine] = orbit.covariance(own, own.period_days, star_mass_error)
        period_error[mine] = orbit.period_error(star_mass_error)
    return covariance, period_error


def next_window(calendar: Calendar, i: int, day: FloatArray, gap_days: float) -> FloatArray:
    """Return the next window of a star after positions on some days.

    Parameters
    ----------
    calendar : Calendar
    i : int
        Position of the star.
    day : ndarray
    gap_days : float
        At least so much later.

    Notes
    -----
    It is the first slot in which the star is seen, or a year later where the calendar has none.
    """
    windows = np.append(calendar.day[i, calendar.fraction[i] > 0.0], np.inf)
    window = windows[np.searchsorted(windows, day + gap_days)]
    return np.where(np.isfinite(window), window, day + _YEAR_DAYS)


def found_orbits(survey: Survey, i: int, star: StarHistory, some: BoolArray) -> FoundOrbits:
    """Return the orbits of planets of a star that several visits have shown.

    Parameters
    ----------
    survey : Survey
    i : int
        Position of the star.
    star : StarHistory
    some : ndarray of bool
        Planets that are asked for; those with fewer positions than `LEAST_EPOCHS` are left out.

    Notes
    -----
    Positions are those of `positions_of`, the next window is that of `next_window`. A planet of the table of known
    planets begins with what was published of its orbit.
    """
    rule = survey.strategy.orbit
    epochs = np.sum([epoch.shown for epoch in star.epochs], axis=0, dtype=np.int64) * np.ones(len(some), np.int64)
    placed = at_known_place(star.planets, survey.known)
    rows = np.flatnonzero(some & (epochs >= np.where(placed, 1, LEAST_EPOCHS)))
    planets, seen = star.planets.select(rows), positions_of(survey, star, rows)
    later = next_window(survey.calendar, i, seen.last_day, survey.strategy.revisits.min_gap_days)
    quality = orbit_quality(
        planets,
        planets.period_days,
        float(survey.targets.distance_pc[i]),
        seen.day,
        seen.error_arcsec,
        later,
        star_mass_error=rule.star_mass_error,
        published=seen.published,
    )
    place = quality.place_error_arcsec / seen.width_arcsec
    known = (quality.axis_error <= rule.axis_error) & (place <= rule.place_error_lambda_d)
    return FoundOrbits(rows, quality, later, place, known & seen.enough(quality.epochs, quality.arc_periods))


def logged_epochs(
    survey: Survey,
    i: int,
    planets: PlanetSample,
    some: BoolArray,
    albedos: tuple[AlbedoSpec, ...],
    zodis: FloatArray | None,
) -> list[Epoch]:
    """Return what the visits of the observation log have shown of planets of a star.

    Parameters
    ----------
    survey : Survey
    i : int
        Position of the star.
    planets : PlanetSample
    some : ndarray of bool
        Planets that are there.
    albedos, zodis
        As of `cpic_planner.survey.detection.expected_signals`.

    Notes
    -----
    The log says how many planets a visit showed, not which. They are taken as those of the universe that it most likely
    detected, where that was at least as likely as not; the others of the visit are planets that the universe does not
    have. What one visit shows of a new planet is in the log, and no planet of the universe, unless a detection takes
    several visits (`cpic_planner.survey.observed.missed`): then new planets of the universe have positions, too.
    """
    log, rule, star = survey.log, survey.strategy.detection, survey.targets.select([i])
    done = () if log is None else log.of(str(star.name[0]))
    able = some & ((planets.known != NEW) | (rule.visits_needed > 1))
    found = []
    for visit in done:
        if not (visit.planets and able.any()):
            continue
        day = visit.mjd - survey.calendar.start_mjd
        roll = visit.roll_deg
        if math.isnan(roll):
            roll = float(sun_position_angle_deg(star, np.array([[visit.mjd]]))[0, 0])
        seen = expected_signals(
            survey.model, star, visit.setting, planets, albedos, planets.places([day]), [roll], zodis
        )
        placed = at_known_place(planets, survey.known)
        odds = np.where(able, detection_chance(seen, rule, placed, calibration=rule.calibration)[0], 0.0)
        # Number of each planet among those of its universe, the surest first.
        order = np.lexsort((-odds, planets.universe))
        _, begins, counts = np.unique(planets.universe[order], return_index=True, return_counts=True)
        place = np.empty(len(planets), np.int64)
        place[order] = np.arange(len(planets)) - np.repeat(begins, counts)
        found.append(Epoch(day, visit.setting.band, seen.snr[0], (odds >= 0.5) & (place < visit.planets)))
    return found
