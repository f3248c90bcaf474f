"""Visits for the orbits of planets that a survey has found: in which slots, for which planets, and what they are worth.

What makes orbits known is above all to look again at stars that have shown a planet: visits in the first slots that are
likely to show it make as many of them known as visits in the best ones, and take a quarter more time for it (two
strategies, 2500 universes each).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.etc import EtcModel
from cpic_planner.planets import astrometric_error_arcsec, orbit_information
from cpic_planner.survey.calendar import Calendar
from cpic_planner.survey.detection import Setting, detection_chance, expected_signals
from cpic_planner.survey.orbits import PublishedOrbits, found_orbits, next_window, one_orbit, positions_of, told_of
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import PlanetSample, at_known_place, star_mass_msun
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec

if TYPE_CHECKING:
    from cpic_planner.survey.history import StarHistory
    from cpic_planner.survey.simulate import Survey

LEAST_ODDS = 0.5
"""A visit for an orbit is planned where it is at least as likely as not to show the planet."""
_LEAST_CHANCE = 1e-3
_ROUNDING_DAYS, _MANY = 1e-9, 10_000


def due(
    survey: Survey, i: int, star: StarHistory, mine: IntArray, setting: Setting, slot: int, ahead: FloatArray
) -> IntArray:
    """Return the planets of a star whose orbits ask for a visit in a slot.

    Parameters
    ----------
    survey : Survey
    i : int
        Position of the star.
    star : StarHistory
    mine : ndarray of int
        Planets that were found with the setting, and confirmed where the strategy asks for it.
    setting : Setting
    slot : int
    ahead : ndarray, shape (2, b, n)
        Odds and SNR of a visit in every slot for all planets of the star.

    Notes
    -----
    The slots of a planet are chosen (`best_slots`) when it is first asked for, and again whenever it has another
    position or another visit was made for it.
    """
    if star.orbit_slots is None:
        star.orbit_slots = np.zeros((survey.calendar.n_slots, len(star.planets)), bool)
    shown = np.sum([epoch.shown for epoch in star.epochs], axis=0, dtype=np.int64)
    state = shown + _MANY * star.orbit_visits[star.planets.universe]
    stale = mine[star.chosen_by[mine] != state[mine]]
    if stale.size:
        star.chosen_by[stale] = state[stale]
        star.orbit_slots[:, stale] = False
        asked = np.isin(np.arange(len(state)), stale)
        orbits = found_orbits(survey, i, star, asked)
        asked[orbits.planet[orbits.known]] = False
        asked &= star.orbit_visits[star.planets.universe] < survey.strategy.orbit.visits
        if (open_ := np.flatnonzero(asked)).size:
            star.orbit_slots[:, open_] = best_slots(survey, i, star, open_, setting, slot, ahead[:, :, open_])
    return np.asarray(mine[star.orbit_slots[slot, mine]])


def best_slots(
    survey: Survey, i: int, star: StarHistory, rows: IntArray, setting: Setting, slot: int, ahead: FloatArray
) -> BoolArray:
    """Return the slots in which visits are expected to make orbits known, one after the other, shape (b, n).

    Parameters
    ----------
    survey : Survey
    i : int
        Position of the star.
    star : StarHistory
    rows : ndarray of int
        ``n`` planets.
    setting : Setting
    slot : int
        First slot in which a visit may be.
    ahead : ndarray, shape (2, b, n)
        Odds and SNR of a visit in every slot.

    Notes
    -----
    Fisher matrices of positions add. Slot after slot is taken in which one more position is expected to shrink the
    covariance ``C`` of the elements most: its logarithmic volume falls by ``ln det(1 + J C J^T / s^2)`` with the odds
    of a detection, with ``J`` the derivatives of the position by the elements and ``s`` its error (the design of least
    volume, one point at a time: Fedorov 1972, Theory of Optimal Experiments; expected information as of Lindley 1956,
    Ann. Math. Stat. 27, 986, and Ford 2008, AJ 135, 1008). Where slots meet the rule of the strategy after that
    position, with as many positions as one orbit asks for, the choice is among these, and ends. Only slots with odds of
    at least `LEAST_ODDS` are taken; those of one planet keep ``revisits.min_gap_days``. A planet that ``orbit.visits``
    visits do not bring there even if each shows it has none. Elements, odds and SNR are those of the true orbit, as if
    it were already about known, which it is only roughly after the two positions that a confirmed planet has.
    """
    rule, gap = survey.strategy.orbit, survey.strategy.revisits.min_gap_days - _ROUNDING_DAYS
    calendar, planets, n = survey.calendar, star.planets.select(rows), len(rows)
    cost = calendar.cost_h(survey.model, i, setting, survey.strategy.visit.settlings)
    slots = slot + np.flatnonzero((cost <= survey.strategy.slot_share * calendar.slot_h)[slot:])
    found = np.zeros((calendar.n_slots, n), bool)
    if not slots.size:
        return found
    odds, snr = ahead[:, slots].transpose(0, 2, 1)
    seen = positions_of(survey, star, rows)
    distance = float(survey.targets.distance_pc[i])
    known = orbit_information(
        planets,
        planets.period_days,
        distance,
        seen.day,
        seen.error_arcsec,
        star_mass_error=rule.star_mass_error,
        published=seen.published,
    )
    days = np.broadcast_to(calendar.day[i, slots], odds.shape)
    width = survey.model.metrics[setting.band].lambda_d_arcsec
    weight = np.zeros(odds.shape)
    likely = (odds >= LEAST_ODDS) & (snr > 0.0)
    weight[likely] = astrometric_error_arcsec(snr[likely], width, rule.floor_mas) ** -2.0
    slopes = known.slopes(days)
    first, last = seen.first_day, seen.last_day
    free = likely & (days >= np.maximum(last, star.orbit_day[planets.universe])[:, None] + gap)
    epochs, every = np.isfinite(seen.error_arcsec).sum(axis=1), np.arange(n)
    left = rule.visits - star.orbit_visits[planets.universe]
    matrix, made, done = known.matrix, np.zeros(odds.shape, bool), np.zeros(n, bool)
    for step in range(int(left.max(initial=0))):
        spread = np.asarray(np.linalg.inv(matrix), np.float64)
        ends = np.maximum(days, last[:, None])
        ahead_of = known.slopes(next_window(calendar, i, ends, survey.strategy.revisits.min_gap_days))
        volume, axis, place = _after(spread, slopes, weight, ahead_of)
        arcs = (ends - np.minimum(days, first[:, None])) / planets.period_days[:, None]
        meets = (axis <= rule.axis_error) & (place <= rule.place_error_lambda_d * width) & free
        meets &= seen.enough(epochs + 1, arcs)
        gain = np.where(free & (meets | ~meets.any(axis=1, keepdims=True)), odds * volume, 0.0)
        best = gain.argmax(axis=1)
        adds = (gain[every, best] > 0.0) & (step < left) & ~done
        if not adds.any():
            break
        own, day = slopes[every, :, best], days[every, best]
        matrix = matrix + np.einsum("ncj,n,nck->njk", own, weight[every, best] * adds, own)
        free &= ~adds[:, None] | (np.abs(days - day[:, None]) >= gap)
        made[every[adds], best[adds]] = True
        epochs = epochs + adds
        first, last = np.where(adds, np.minimum(first, day), first), np.where(adds, np.maximum(last, day), last)
        done |= adds & meets[every, best]
    found[slots] = (made & done[:, None]).T
    return found


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
    beyond = np.searchsorted(day, day + gap - _ROUNDING_DAYS)
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


def _after(
    covariance: FloatArray, slopes: FloatArray, weight: FloatArray, later: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what one more position at each of some epochs does to orbits, each of shape (n, t).

    Returns the fall of the logarithmic volume of the elements' errors, the relative error of the axis, and that of the
    place at a later date, arcsec; ``slopes`` and ``later`` are derivatives of both, shape (n, 2, t, 7).
    """
    toward = np.einsum("nctj,njk->ntck", slopes, covariance)
    inner = np.eye(2) + weight[:, :, None, None] * np.einsum("ntck,ndtk->ntcd", toward, slopes)
    shrink = weight[:, :, None, None] * np.linalg.inv(inner)
    axis = covariance[:, None, 0, 0] - np.einsum("ntc,ntcd,ntd->nt", toward[..., 0], shrink, toward[..., 0])
    cross = np.einsum("netk,ntck->ntec", later, toward)
    place = np.einsum("netj,njk,netk->nt", later, covariance, later)
    place = place - np.einsum("ntec,ntcd,nted->nt", cross, shrink, cross)
    return np.log(np.linalg.det(inner)), np.sqrt(np.maximum(axis, 0.0)), np.sqrt(np.maximum(place, 0.0))
