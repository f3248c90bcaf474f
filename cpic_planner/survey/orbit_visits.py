"""Visits for the orbits of planets that a survey has found: in which slots, and for which planets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.planets import astrometric_error_arcsec, orbit_information
from cpic_planner.survey.detection import Setting
from cpic_planner.survey.orbits import found_orbits, next_window, positions_of

if TYPE_CHECKING:
    from cpic_planner.survey.history import StarHistory
    from cpic_planner.survey.simulate import Survey

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
    """Return the slots in which visits are expected to make orbits known, the fewest that do, shape (b, n).

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
    Fisher matrices of positions add. Slot after slot is taken in which one more position shrinks the covariance ``C``
    of the elements most: its logarithmic volume falls by ``ln det(1 + w J C J^T)``, with ``J`` the derivatives of the
    position by the elements and ``w`` the odds of a detection over the squared error of the position (the design of
    least volume, one point at a time: Fedorov 1972, Theory of Optimal Experiments; expected information as of Lindley
    1956, Ann. Math. Stat. 27, 986, and Ford 2008, AJ 135, 1008). Slots of one planet keep ``revisits.min_gap_days``.
    The choice ends with the first visit after which the expected matrix meets the rule of the strategy, with as many
    positions as one orbit asks for. A planet that ``orbit.visits`` visits are not expected to bring there has none.
    Elements, odds and SNR are those of the true orbit, as if it were already about known, which it is only roughly
    after the two positions that a confirmed planet has.
    """
    rule, gap = survey.strategy.orbit, survey.strategy.revisits.min_gap_days - _ROUNDING_DAYS
    calendar, planets, n = survey.calendar, star.planets.select(rows), len(rows)
    cost = calendar.cost_h(survey.model, i, setting, survey.strategy.visit.settlings)
    able = np.isfinite(cost) & (cost <= survey.strategy.slot_share * calendar.slot_h)
    slots = slot + np.flatnonzero(able[slot:])
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
    useful = (odds > 0.0) & (snr > 0.0)
    weight[useful] = odds[useful] * astrometric_error_arcsec(snr[useful], width, rule.floor_mas) ** -2.0
    slopes = known.slopes(days)
    last = seen.last_day
    free = useful & (days >= np.maximum(last, star.orbit_day[planets.universe])[:, None] + gap)
    used = np.isfinite(seen.error_arcsec)
    first = np.where(used, seen.day, np.inf).min(axis=1, initial=np.inf)
    epochs = used.sum(axis=1).astype(float)
    left = rule.visits - star.orbit_visits[planets.universe]
    matrix, made, known_then = known.matrix, np.zeros(odds.shape, bool), np.zeros(n, bool)
    every = np.arange(n)
    for step in range(int(left.max(initial=0))):
        spread = np.einsum("nctj,njk,ndtk->ntcd", slopes, np.linalg.inv(matrix), slopes) * weight[:, :, None, None]
        volume = (1.0 + spread[..., 0, 0]) * (1.0 + spread[..., 1, 1]) - spread[..., 0, 1] ** 2
        gain = np.where(free, np.log(volume), 0.0)
        best = gain.argmax(axis=1)
        adds = (gain[every, best] > 0.0) & (step < left) & ~known_then
        if not adds.any():
            break
        own = slopes[every, :, best]
        more = np.einsum("ncj,n,nck->njk", own, weight[every, best] * adds, own)
        matrix = matrix + more
        day = days[every, best]
        free &= ~adds[:, None] | (np.abs(days - day[:, None]) >= gap)
        made[every[adds], best[adds]] = True
        epochs += np.where(adds, odds[every, best], 0.0)
        first, last = np.where(adds, np.minimum(first, day), first), np.where(adds, np.maximum(last, day), last)
        covariance = np.linalg.inv(matrix)
        there = known.slopes(next_window(survey, i, last)[:, None])[:, :, 0]
        place = np.sqrt(np.einsum("ncj,njk,nck->n", there, covariance, there)) / width
        meets = (np.sqrt(covariance[:, 0, 0]) <= rule.axis_error) & (place <= rule.place_error_lambda_d)
        known_then |= adds & meets & seen.enough(np.round(epochs), (last - first) / planets.period_days)
    found[slots] = (made & known_then[:, None]).T
    return found
