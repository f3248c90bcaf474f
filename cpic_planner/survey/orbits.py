"""Orbits of the planets that a survey finds: how well the positions in its images determine them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.planets import OrbitQuality, astrometric_error_arcsec, orbit_quality

if TYPE_CHECKING:
    from cpic_planner.survey.history import StarHistory
    from cpic_planner.survey.simulate import Survey

LEAST_EPOCHS = 2
"""Positions without which nothing is said of an orbit."""
UNIQUE_EPOCHS = 4
"""Positions without which an orbit is not known whose arc is a period or longer, since the planet may have gone round
once more: of three such positions four in ten fit a second period (25 campaigns), of four one in twenty-five."""
_YEAR_DAYS = 365.25


class Epoch(NamedTuple):
    """What one visit of a star shows: day after the start, band, SNR of each planet, and which it detects."""

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


def found_orbits(survey: Survey, i: int, star: StarHistory, some: BoolArray) -> FoundOrbits:
    """Return the orbits of planets of a star that several visits have shown.

    Parameters
    ----------
    survey : Survey
    i : int
        Position of the star.
    star : StarHistory
    some : ndarray of bool
        Planets that are asked for; those with one position or none are left out.

    Notes
    -----
    Positions are those of the visits that detect the planet, follow-up included, with errors of
    `cpic_planner.planets.astrometric_error_arcsec`. The next window is the first slot in which the star is seen, at
    least ``revisits.min_gap_days`` after the last position, or a year after that where the calendar has none.
    """
    rule, calendar = survey.strategy.orbit, survey.calendar
    shape = len(star.epochs), len(star.planets)
    shown = np.array([epoch.shown for epoch in star.epochs], bool).reshape(shape).T
    rows = np.flatnonzero(some & (shown.sum(axis=1) >= LEAST_EPOCHS))
    shown, snr = shown[rows], np.array([epoch.snr for epoch in star.epochs], float).reshape(shape).T[rows]
    day = np.array([epoch.day for epoch in star.epochs], float)
    widths = np.array([survey.model.metrics[epoch.band].lambda_d_arcsec for epoch in star.epochs], float)
    errors = np.full(shown.shape, np.inf)
    errors[shown] = astrometric_error_arcsec(snr[shown], np.broadcast_to(widths, shown.shape)[shown], rule.floor_mas)
    # Epochs are in the order of time.
    last = np.array([np.flatnonzero(mine)[-1] for mine in shown], np.int64)
    windows = np.append(calendar.day[i, calendar.fraction[i] > 0.0], np.inf)
    window = windows[np.searchsorted(windows, day[last] + survey.strategy.revisits.min_gap_days)]
    later = np.where(np.isfinite(window), window, day[last] + _YEAR_DAYS)
    planets = star.planets.select(rows)
    quality = orbit_quality(
        planets,
        planets.period_days,
        float(survey.targets.distance_pc[i]),
        np.broadcast_to(day, shown.shape),
        errors,
        later,
        star_mass_error=rule.star_mass_error,
    )
    place = quality.place_error_arcsec / widths[last]
    known = (quality.axis_error <= rule.axis_error) & (place <= rule.place_error_lambda_d)
    known &= (quality.epochs >= UNIQUE_EPOCHS) | (quality.arc_periods < 1.0)
    return FoundOrbits(rows, quality, later, place, known)
