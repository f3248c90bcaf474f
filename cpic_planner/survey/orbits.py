"""Orbits from positions: when these are enough, how well they determine one, and what early detections are worth."""

from __future__ import annotations

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.etc import EtcModel
from cpic_planner.planets import PublishedOrbit, astrometric_error_arcsec, orbit_information, published_orbit
from cpic_planner.survey.calendar import Calendar
from cpic_planner.survey.detection import Setting, detection_chance, expected_signals
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import NEW, PlanetSample, at_known_place, star_mass_msun
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec

LEAST_EPOCHS = 2
"""Positions without which nothing is said of an orbit. One is enough of a planet whose published orbit has its node and
inclination: where these are open, a second orbit, turned the other way, passes through the same place."""
UNIQUE_EPOCHS = 4
"""Positions without which an orbit is not known whose arc is a period or longer, since the planet may have gone round
once more: of three such positions four in ten fit a second period (25 campaigns), of four one in twenty-five."""
COUNTED_PERIODS = 0.1
"""Error, in periods, within which a published period says how often a planet has gone round in the arc."""
_YEAR_DAYS = 365.25


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


LEAST_ODDS = 0.5
"""A visit for an orbit is planned where it is at least as likely as not to show the planet."""
_LEAST_CHANCE = 1e-3
ROUNDING_DAYS = 1e-9


def orbit_chance(
    strategy: SurveyStrategy,
    model: EtcModel,
    star: Targets,
    calendar: Calendar,
    i: int,
    option: Setting,
    chance: FloatArray,
    planets: PlanetSample,
    known: KnownPlanetTable | None,
    *,
    albedos: tuple[AlbedoSpec, ...],
    zodis: FloatArray | None,
) -> FloatArray:
    """Return the probability that visits detect planets early enough for their orbits, shape (b, m).

    Parameters
    ----------
    strategy : SurveyStrategy
    model : EtcModel
        That of the strategy.
    star : Targets
        One star.
    calendar : Calendar
    i : int
        Position of the star in the calendar.
    option : Setting
        Frames of the visits.
    chance : ndarray, shape (b, m)
        Probability that a visit in each slot detects each planet.
    planets : PlanetSample
        ``m`` planets.
    known : KnownPlanetTable or None
    albedos, zodis
        As of `cpic_planner.survey.detection.expected_signals`.

    Notes
    -----
    It is ``chance`` in the slots from which the orbit can be had, and 0 in the others: where a position there, and one
    in each of the next slots in which a visit at the known place is at least as likely as not to show the planet (with
    their gaps, at most ``orbit.visits`` of them), have an expected covariance that meets the rule of the strategy. A
    schedule is worth ``orbit.value`` for each planet that it detects in such a slot, beside what the detection is
    worth: another planet, for the scheduler, that only these slots show, so that values and bounds are those of
    detections. The earliest of several detections is the one with most slots to come.
    """
    rule, gap = strategy.orbit, strategy.revisits.min_gap_days
    cost = calendar.cost_h(model, i, option, strategy.visit.settlings)
    slots = np.flatnonzero(cost <= strategy.slot_share * calendar.slot_h)
    slot, planet = np.nonzero(chance[slots] >= _LEAST_CHANCE)
    found = np.zeros(chance.shape)
    if not slot.size:
        return found
    day, n = calendar.day[i, slots], len(planets)
    roll = calendar.roll_deg(strategy.revisits, i, slots, np.zeros_like(slots))
    seen = expected_signals(model, star, option, planets, albedos, planets.places(day), roll, zodis)
    law = strategy.detection
    odds = detection_chance(seen, law, np.ones(n, bool), calibration=law.calibration)
    width = model.metrics[option.band].lambda_d_arcsec
    errors = astrometric_error_arcsec(np.where(seen.snr > 0.0, seen.snr, 1.0), width, rule.floor_mas)
    published = PublishedOrbits(known, calendar.start_mjd, float(star_mass_msun(star)[0]))
    covariance, period_error = told_of(planets, published, rule.star_mass_error)
    before = orbit_information(
        planets,
        planets.period_days,
        float(star.distance_pc[0]),
        np.zeros((n, 1)),
        np.full((n, 1), np.inf),
        star_mass_error=rule.star_mass_error,
        published=covariance,
    )
    slopes = before.slopes(np.broadcast_to(day, (n, day.size)))
    later = before.slopes(np.broadcast_to(next_window(calendar, i, day, gap), (n, day.size)))
    # The next slot from each one on that is likely to show each planet; behind the last one there is none.
    following = np.full((day.size + 1, n), day.size)
    for k in range(day.size - 1, -1, -1):
        following[k] = np.where((odds[k] >= LEAST_ODDS) & (seen.snr[k] > 0.0), k, following[k + 1])
    beyond = np.searchsorted(day, day + gap - ROUNDING_DAYS)
    placed, now = at_known_place(planets, known), slot.copy()
    matrix, open_ = before.matrix[planet], seen.snr[slot, planet] > 0.0
    for number in range(1, rule.visits + 2):
        at, who = now[open_], planet[open_]
        own = slopes[who, :, at] / errors[at, who][:, None, None]
        matrix[open_] += own.transpose(0, 2, 1) @ own
        spread = np.linalg.inv(matrix[open_])
        place = np.sqrt(np.einsum("ncj,njk,nck->n", later[who, :, at], spread, later[who, :, at]))
        meets = (np.sqrt(spread[:, 0, 0]) <= rule.axis_error) & (place <= rule.place_error_lambda_d * width)
        arc = (day[at] - day[slot[open_]]) / planets.period_days[who]
        meets &= one_orbit(number, arc, placed[who], period_error[who])
        done = np.flatnonzero(open_)[meets]
        found[slots[slot[done]], planet[done]] = chance[slots[slot[done]], planet[done]]
        open_[done] = False
        now[open_] = following[beyond[now[open_]], planet[open_]]
        open_ &= now < day.size
    return found
