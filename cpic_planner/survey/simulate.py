"""A survey simulated in synthetic universes: what is visited, what is found, what it costs.

Visits for orbits come on top of the planned ones. What makes orbits known is above all to look again at stars that have
shown a planet: visits in the first slots that are likely to show it make as many of them known as visits in the best
ones, and take a quarter more time for it (two strategies, 2500 universes each).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from catalogs import KnownPlanetTable, OrbitPlaces
from cpic_core import BoolArray, FloatArray, IntArray, NDArray, Record
from cpic_planner.etc import EtcModel
from cpic_planner.jobs import Runner, Task
from cpic_planner.planets import (
    OrbitQuality,
    PublishedOrbit,
    StarLimits,
    astrometric_error_arcsec,
    orbit_information,
    orbit_quality,
)
from cpic_planner.survey.calendar import Calendar, sun_position_angle_deg
from cpic_planner.survey.detection import (
    ExpectedSignals,
    Setting,
    detection_chance,
    expected_signals,
    faintest_of,
    looks_at_place,
    of_ways,
    on_detector,
    reach_au,
)
from cpic_planner.survey.observed import ObservationLog, missed, resampled
from cpic_planner.survey.orbits import (
    LEAST_EPOCHS,
    LEAST_ODDS,
    ROUNDING_DAYS,
    PublishedOrbits,
    next_window,
    one_orbit,
    told_of,
)
from cpic_planner.survey.schedule import PlannedVisit, Schedule
from cpic_planner.survey.strategy import SurveyStrategy, UniverseConfig
from cpic_planner.survey.tables import DETECTIONS, HOURS, ORBITS, PLANETS, STARS, UNIVERSES
from cpic_planner.survey.universe import (
    BLOCK,
    NEW,
    Block,
    PlanetSample,
    albedos_of,
    allowed_probability,
    at_known_place,
    chance,
    draw_planet_sample,
    dust_of,
    poisson_quantile,
    star_mass_msun,
    uniform_draws,
)
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec

COUNTED = (*PLANETS, "visits", "hours")
"""Numbers of each universe that comparisons are made of."""
TOGETHER = 4
"""Blocks of universes of one task: the same calls of numpy on longer arrays, for as many tasks fewer."""
ROUNDING_H = 1e-9
_MANY = 10_000


class Epoch(NamedTuple):
    """One visit of a star: day after the start, band, SNR of each planet, and which it detects."""

    day: float
    band: str
    snr: FloatArray
    shown: BoolArray


class StarHistory:
    """One star in all universes of a block: what each visit would show, and what visits have shown so far.

    Parameters
    ----------
    planets : PlanetSample
    allowed : ndarray of bool
        Which planets are there. The others are excluded by what is known of the star: nothing stops or follows because
        of them, but ``counts`` has what the same visits would show of them, too.
    bands : int
        Bands of the follow-up.
    n : int
        Universes.
    begins : ndarray of int, shape (k,)
        First universe of every block.
    left_h : float
        Telescope time of the planned visits that are to come.
    last_slot : int
        Of the last planned visit.
    published : dict of int to PublishedOrbit
        What is published of the orbits of known planets, by their row.
    """

    def __init__(
        self,
        planets: PlanetSample,
        allowed: BoolArray,
        bands: int,
        n: int,
        begins: IntArray,
        *,
        left_h: float = 0.0,
        last_slot: int = -1,
        published: dict[int, PublishedOrbit] | None = None,
    ) -> None:
        m = len(planets)
        self.planets, self.allowed, self.listed = planets, allowed, planets.known != NEW
        self.left_h, self.last_slot, self.published = left_h, last_slot, {} if published is None else published
        self.hits: dict[int, BoolArray] = {}
        self.seen: dict[int, dict[str, FloatArray]] = {}
        self.alarms: dict[int, tuple[IntArray, IntArray]] = {}
        self.epochs: list[Epoch] = []
        self.ahead: dict[Setting, FloatArray] = {}
        self.begins, self.visits, self.hours = begins, np.zeros_like(begins), np.zeros((len(HOURS), len(begins)))
        self.counts, self.found = np.zeros(m, np.int64), np.zeros(m, bool)
        self.shown, self.reached = np.zeros((bands, m), bool), np.zeros((bands, m))
        self.tried = np.zeros((bands, m), np.int64)
        self.stopped, self.empty = np.zeros(n, bool), np.zeros(n, np.int64)
        # What candidates wait for: planets to be seen again, false alarms to be refuted, and how the last was seen.
        self.confirmed = np.zeros(m, bool)
        self.doubts, self.checks, self.option = np.zeros((3, n), np.int64)
        self.shown_day, self.place = np.zeros(n), np.zeros((2, m))
        # Visits for orbits: those made and the day of the last one, the way each planet was found, the slots that are
        # to come, and what these were chosen by.
        self.orbit_visits, self.orbit_day = np.zeros(n, np.int64), np.full(n, -np.inf)
        self.way, self.chosen_by = np.full((2, m), -1)
        self.orbit_slots: BoolArray | None = None

    def universes_of(self, some: BoolArray | IntArray) -> BoolArray:
        """Return the universes that have at least one of some planets."""
        found = np.zeros(len(self.stopped), bool)
        found[self.planets.universe[some]] = True
        return found

    def of_blocks(self, some: BoolArray) -> IntArray:
        """Return how many of some universes each block has."""
        return np.asarray(np.add.reduceat(some, self.begins, dtype=np.int64))

    def inside(self, survey: Survey, i: int, some: IntArray, band: str, slot: int) -> BoolArray:
        """Tell which planets a team expects in the dark hole: known ones by their orbit, others where they were.

        Parameters
        ----------
        survey : Survey
        i : int
            Position of the star.
        some : ndarray of int
            Numbers of the planets among those of the star.
        band : str
        slot : int
        """
        now = self.planets.select(some).places(survey.calendar.day[i, [slot]])
        distance_pc, listed = float(survey.targets.distance_pc[i]), self.listed[some]
        separation, pa = self.place[0, some], np.deg2rad(self.place[1, some])
        east = np.where(listed, now.east_au[0] / distance_pc, separation * np.sin(pa))
        north = np.where(listed, now.north_au[0] / distance_pc, separation * np.cos(pa))
        roll = survey.calendar.roll_deg(survey.strategy.revisits, i, np.array([slot]), np.array([slot]))
        return on_detector(survey.model, band, east, north, roll)[2]

    def show(self, day: float, band: str, some: IntArray, snr: FloatArray, shows: BoolArray) -> None:
        """Note positions of some planets, where a visit shows them.

        Parameters
        ----------
        day : float
            After the start of the survey.
        band : str
        some : ndarray of int
            Numbers of planets of the star.
        snr : ndarray
            Of each of them.
        shows : ndarray of bool
            Likewise.
        """
        light, shown = np.zeros(len(self.planets)), np.zeros(len(self.planets), bool)
        light[some], shown[some] = snr, shows
        self.epochs.append(Epoch(day, band, light, shown))


class Clock:
    """Time of ``n`` universes, hours: the whole budget is left, of which planned visits will take what is promised."""

    def __init__(self, n: int, budget_h: float, promised_h: float) -> None:
        self.left, self.promised = np.full(n, budget_h), np.full(n, promised_h)
        self.slot, self.search, self.follow, self.alarm = np.zeros((4, n))
        self.visits = np.zeros(n, np.int64)

    def affords(self, cost_h: float) -> BoolArray:
        """Return the universes whose slot and budget hold a cost."""
        return np.asarray((self.slot >= cost_h - ROUNDING_H) & (self.left >= cost_h - ROUNDING_H))

    def spend(self, go: BoolArray, cost_h: float, on: FloatArray) -> None:
        """Take the cost of one visit in the universes ``go`` from slot and budget, and note what it was spent on."""
        for account in (self.left, self.slot):
            account[go] -= cost_h
        on[go] += cost_h
        self.visits[go] += 1

    @property
    def used(self) -> FloatArray:
        """Time of search, follow-up and false alarms so far."""
        return self.search + self.follow + self.alarm


class SurveyTables(Record, eq=False):
    """The events in ``n`` universes; each field holds the columns of the table of its name."""

    universes: dict[str, NDArray[Any]]
    detections: dict[str, NDArray[Any]]
    stars: dict[str, NDArray[Any]]
    orbits: dict[str, NDArray[Any]]

    def rows(self, strategy: str, first_universe: int) -> dict[str, dict[str, NDArray[Any]]]:
        """Return the columns of all tables with the name of the strategy, universes by their number in the survey."""
        found = {name: dict(own) for name, own in vars(self).items()}
        for own in found.values():
            own["strategy"] = np.full(len(own["star" if "star" in own else "universe"]), strategy, object)
            if "universe" in own:
                own["universe"] = first_universe + own["universe"]
        return found


class Survey(Record, eq=False):
    """A strategy ready to be simulated.

    Attributes
    ----------
    strategy : SurveyStrategy
    model : EtcModel
    targets : Targets
        The candidates, in their order.
    calendar : Calendar
        Of the same stars.
    options : tuple of tuple of Setting
        Ways to visit each star.
    follow : tuple of tuple of Setting
        Follow-up of each star in every band.
    schedule : Schedule
    known : KnownPlanetTable or None
    known_rows : tuple of tuple of int
        Known planets of each star.
    limits : StarLimits
        What is known to exclude planets of the same stars.
    noise_alarms, background_alarms : tuple of tuple of float
        Expected false alarms of one visit by star and option: noise that passes the threshold, and background stars.
    log : ObservationLog or None
        What was done already.
    """

    strategy: SurveyStrategy
    model: EtcModel
    targets: Targets
    calendar: Calendar
    options: tuple[tuple[Setting, ...], ...]
    follow: tuple[tuple[Setting, ...], ...]
    schedule: Schedule
    known: KnownPlanetTable | None
    known_rows: tuple[tuple[int, ...], ...]
    limits: StarLimits
    noise_alarms: tuple[tuple[float, ...], ...]
    background_alarms: tuple[tuple[float, ...], ...]
    log: ObservationLog | None = None

    @cached_property
    def faintest(self) -> tuple[tuple[FloatArray, ...], ...]:
        """Contrast below which a visit shows no planet, by star, option and ring."""
        rule = self.strategy.detection
        return of_ways(self.targets, self.options, lambda stars, ways: faintest_of(self.model, stars, ways, rule))


class FoundOrbits(Record, eq=False):
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

    def columns(self, star: str, planets: PlanetSample) -> dict[str, Any]:
        """Return the columns of the table of orbits for planets of one star."""
        mine = planets.select(self.planet)
        given = vars(self.quality) | vars(self) | {"universe": mine.universe, "planet": mine.number}
        given |= {"star": np.full(len(mine), star, object), "orbit_known": self.known}
        return {name: given[name] for name in ORBITS.empty}


class Positions(Record, eq=False):
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
    rule, gap = survey.strategy.orbit, survey.strategy.revisits.min_gap_days - ROUNDING_DAYS
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


def simulate_survey(survey: Survey, *, block: Block, n: int, seed: int) -> SurveyTables:
    """Simulate a survey in ``n`` universes.

    Parameters
    ----------
    survey : Survey
    block : int or range
        Number of the block, or those of several; universes of one block share their random streams, which name star,
        block and visit.
    n : int
        Universes.
    seed : int

    Returns
    -------
    SurveyTables

    Notes
    -----
    Slot after slot, second looks at candidates, follow-up and visits for orbits come first, then the planned visits in
    their order, then reserve ones as far as they take nothing from planned ones to come. A visit is made where star and
    survey have not stopped and slot and budget hold it. Whether it detects a planet was decided by the numbers of that
    star, block and visit, so that another strategy that makes the same visit sees the same.
    """
    run = _played(survey, block, n, seed)
    return run.tables()


def count_block(
    surveys: tuple[Survey, ...], which: int, block: Block, n: int, seed: int
) -> dict[str, list[int] | list[float]]:
    """Work on one task: planets found, visits made and hours used in each universe of its blocks, and nothing else.

    Parameters
    ----------
    surveys : tuple of Survey
    which : int
        Position of the one that is played.
    block, n, seed : int
        As of `simulate_survey`.
    """
    counts = _played(surveys[which], block, n, seed).counts()
    return {name: values.tolist() for name, values in counts.items()}


def block_tasks(name: str, which: int, universe: UniverseConfig) -> list[Task]:
    """Return the tasks of one survey, each for some blocks of universes.

    Parameters
    ----------
    name : str
        What the tasks are called in the folder of the run, before the number of their first block.
    which : int
        Position of the survey among those that the tasks share.
    universe : UniverseConfig
    """
    n = universe.universes
    blocks = range(-(-n // BLOCK))
    parts = [blocks[first : first + TOGETHER] for first in blocks[::TOGETHER]]
    return [
        Task(
            f"{name} {part.start:06d}",
            (which, part, min(BLOCK * len(part), n - BLOCK * part.start), universe.seed),
            steps=len(part),
        )
        for part in parts
    ]


def survey_counts(
    surveys: Mapping[str, Survey], universe: UniverseConfig, runner: Runner[Any]
) -> dict[str, dict[str, FloatArray]]:
    """Return planets found, visits made and hours used by surveys in every universe, by the names of the surveys.

    Parameters
    ----------
    surveys : mapping of str to Survey
        By what their tasks are called.
    universe : UniverseConfig
    runner : Runner
    """
    tasks = {name: block_tasks(name, which, universe) for which, name in enumerate(surveys)}
    every = itertools.chain.from_iterable(tasks.values())
    bodies = runner.finish(count_block, every, common=(tuple(surveys.values()),))
    return {
        name: {key: np.concatenate([bodies[task.key][key] for task in own]).astype(np.float64) for key in COUNTED}
        for name, own in tasks.items()
    }


def _played(survey: Survey, block: Block, n: int, seed: int) -> _Simulation:
    """Return a survey after its last slot."""
    run = _Simulation(survey, block, n, seed)
    by_slot: dict[int, list[tuple[int, PlannedVisit]]] = {}
    for k, visit in enumerate(survey.schedule.visits):
        by_slot.setdefault(visit.slot, []).append((k, visit))
    strategy = survey.strategy
    checks, follows, orbits = strategy.checks_candidates, strategy.follow_up.wanted, strategy.orbit.visits > 0
    for slot in range(survey.calendar.n_slots) if checks or follows or orbits else sorted(by_slot):
        run.clock.slot[:] = strategy.slot_share * survey.calendar.slot_h[slot]
        for i, star in run.stars.items():
            if checks:
                run.check(i, star, slot)
            if follows and star.found.any():
                run.follow(i, star, slot)
            if orbits:
                run.determine(i, star, slot)
        for k, visit in by_slot.get(slot, ()):
            run.search(k, visit)
    return run


class _Simulation:
    """Some blocks of universes of a survey: their stars, their clock and what has happened."""

    def __init__(self, survey: Survey, block: Block, n: int, seed: int) -> None:
        from scipy.special import ndtri

        self.survey, self.block, self.n, self.seed = survey, block, n, seed
        self.begins = np.arange(0, n, BLOCK) if isinstance(block, range) else np.zeros(1, np.int64)
        # Calibration of each universe, and the shift of its detection law in standard errors.
        rule, drawn = survey.strategy.detection, ndtri(chance(seed, "calibration", block, shape=(2, n)))
        self.calibration = np.maximum(rule.calibration + rule.calibration_error * drawn[0], 0.0)
        self.shift = drawn[1]
        by_star: dict[int, list[tuple[int, PlannedVisit]]] = {}
        for k, visit in enumerate(survey.schedule.visits):
            by_star.setdefault(visit.star, []).append((k, visit))
        mass, self.albedos = star_mass_msun(survey.targets), albedos_of(survey.strategy.population)
        self.stars = {i: self._star(i, visits, float(mass[i])) for i, visits in sorted(by_star.items())}
        promised_h = sum(visit.cost_h for visit in survey.schedule.visits if not visit.reserve)
        self.clock = Clock(n, survey.strategy.time_budget_h, promised_h)
        self.noise_alarms, self.background_alarms, self.planets_found = np.zeros((3, n), np.int64)
        self.detections: list[dict[str, NDArray[Any]]] = []
        self._costs: dict[tuple[int, Setting], FloatArray] = {}

    def _star(self, i: int, visits: Sequence[tuple[int, PlannedVisit]], mass_msun: float) -> StarHistory:
        """Return the planets of a star, and what every visit would detect of them."""
        survey, block, n, seed = self.survey, self.block, self.n, self.seed
        strategy = survey.strategy
        target = survey.targets.select([i])
        name = str(survey.targets.name[i])
        epoch_mjd = survey.calendar.start_mjd
        planets = draw_planet_sample(
            name,
            mass_msun,
            float(target.luminosity_lsun[0]),
            strategy.population,
            known=survey.known,
            known_rows=survey.known_rows[i],
            epoch_mjd=epoch_mjd,
            n=n,
            seed=seed,
            block=block,
        )
        if survey.log is not None and (done := survey.log.of(name)):
            placed = at_known_place(planets, survey.known)
            who, dust = (survey.model, target, planets, self.albedos), self._dust(i, planets)
            left = missed(*who, done, strategy.detection, epoch_mjd=epoch_mjd, placed=placed, zodis=dust)
            luck, home = uniform_draws(planets, seed, name, block, "log", n), self.block_of(planets)
            own = [home == number for number in range(len(self.begins))]
            parts = [resampled(planets.select(mine), left[mine], luck[mine]) for mine in own]
            planets = PlanetSample.joined(parts)
        planets = planets.select(planets.within(*reach_au(survey.model, float(target.distance_pc[0]))))
        probability = allowed_probability(planets, survey.limits, i)
        allowed = uniform_draws(planets, seed, name, block, "allowed", n) < probability
        star = StarHistory(
            planets,
            allowed,
            len(strategy.follow_up.bands),
            n,
            self.begins,
            left_h=sum(visit.cost_h for _, visit in visits if not visit.reserve),
            last_slot=max((visit.slot for _, visit in visits if not visit.reserve), default=-1),
            published=PublishedOrbits(survey.known, epoch_mjd, mass_msun),
        )
        star.confirmed |= (placed := at_known_place(planets, survey.known))
        dust = self._dust(i, planets)
        star.epochs += logged_epochs(survey, i, planets, allowed, self.albedos, dust)
        zodis = np.full(len(planets), survey.model.instrument.sky.exozodi_zodis) if dust is None else dust
        for option in sorted({visit.option for _, visit in visits}):
            own = [(k, visit) for k, visit in visits if visit.option == option]
            when = np.array([(visit.slot, visit.ordinal) for _, visit in own]).T
            way, faint = survey.options[i][option], survey.faintest[i][option]
            found, odds, roll, places = self._visited(i, way, planets, when, placed, faint)
            for row, (k, visit) in enumerate(own):
                star.hits[k] = uniform_draws(planets, seed, name, block, visit.ordinal, n) < odds[row]
                star.seen[k] = {key: values[row] for key, values in vars(found).items()}
                star.seen[k] |= {"distance_au": places.distance_au[row], "phase_deg": places.phase_deg[row]}
                star.seen[k] |= {"chance": odds[row], "roll_deg": np.full(len(planets), roll[row])}
                star.seen[k]["exozodi_zodis"] = zodis
                drawn = chance(seed, "alarm", name, block, visit.ordinal, shape=(2, n))
                rates = survey.noise_alarms[i][option], survey.background_alarms[i][option]
                star.alarms[k] = poisson_quantile(rates[0], drawn[0]), poisson_quantile(rates[1], drawn[1])
        return star

    def _visited(
        self, i: int, way: Setting, planets: PlanetSample, when: IntArray, placed: BoolArray, faint: FloatArray | None
    ) -> tuple[ExpectedSignals, FloatArray, FloatArray, OrbitPlaces]:
        """Return what visits of a star show of planets, the odds that each detects each, the rolls, and the places.

        ``when`` holds slots and ordinals of the visits, ``placed`` says which planets are searched at a known place,
        ``faint`` below which contrast in each ring none is looked at.
        """
        survey, strategy = self.survey, self.survey.strategy
        roll = survey.calendar.roll_deg(strategy.revisits, i, *when)
        places = planets.places(survey.calendar.day[i, when[0]])
        who = survey.model, survey.targets.select([i]), way, planets, self.albedos
        how = self._dust(i, planets), faint, looks_at_place(strategy.detection, placed)
        found = expected_signals(*who, places, roll, *how)
        shift, calibration = self.shift[planets.universe], self.calibration[planets.universe]
        return found, detection_chance(found, strategy.detection, placed, shift, calibration), roll, places

    def block_of(self, planets: PlanetSample) -> IntArray:
        """Return the number, among the blocks, of that of each planet."""
        return np.asarray(np.searchsorted(self.begins, planets.universe, side="right") - 1)

    def _dust(self, i: int, planets: PlanetSample) -> FloatArray | None:
        """Return the dust around a star in the universe of each planet."""
        return dust_of(self.survey.strategy, planets, self.seed, str(self.survey.targets.name[i]), self.block)

    def search(self, k: int, visit: PlannedVisit) -> None:
        """Make one planned visit in all universes."""
        star, clock, strategy = self.stars[visit.star], self.clock, self.survey.strategy
        cost, stop = visit.cost_h, strategy.stop
        wanted = ~star.stopped
        if stop.after_planets is not None:
            wanted &= self.planets_found < stop.after_planets
        go = wanted & clock.affords(cost)
        if visit.reserve:
            go &= clock.left - clock.promised >= cost - ROUNDING_H
        else:
            clock.promised[~star.stopped] -= cost
            star.left_h -= cost
        self._spend(star, go, cost, clock.search)
        star.visits += star.of_blocks(go)
        hit = star.hits[k] & go[star.planets.universe]
        star.counts[hit] += 1
        day = float(self.survey.calendar.day[visit.star, visit.slot])
        band = self.survey.options[visit.star][visit.option].band
        star.epochs.append(Epoch(day, band, star.seen[k]["snr"], hit.copy()))
        hit &= star.allowed
        star.confirmed |= hit & star.found
        new = hit & (star.counts >= strategy.detection.visits_needed) & ~star.found
        star.found |= new
        star.way[new] = visit.option
        if new.any():
            self._note(star, new, visit, {"band": band, "day": day} | star.seen[k])
            star.place[:, new] = [star.seen[k][name][new] for name in ("separation_arcsec", "pa_deg")]
            np.add.at(self.planets_found, star.planets.universe[new], 1)
        for counts, drawn in zip((self.noise_alarms, self.background_alarms), star.alarms[k], strict=True):
            counts[go] += drawn[go]
        if strategy.checks_candidates:
            self._doubt(k, visit, star, go, star.universes_of(new))
        star.empty[go & ~star.universes_of(hit)] += 1
        ends = star.universes_of(new & stop.after_detection)
        if stop.after_orbit and (again := hit & star.found & ~star.stopped[star.planets.universe]).any():
            orbits = found_orbits(self.survey, visit.star, star, again)
            ends[star.planets.universe[orbits.planet[orbits.known]]] = True
        if stop.after_empty is not None:
            ends |= (star.empty >= stop.after_empty) & ~star.universes_of(star.allowed & (star.counts > 0))
        ends &= ~star.stopped
        clock.promised[ends] -= star.left_h
        star.stopped |= ends

    def _note(self, star: StarHistory, new: BoolArray, visit: PlannedVisit, seen: dict[str, Any]) -> None:
        """Note the planets that a visit adds to those found, with what it shows of them."""
        planets, used_h = star.planets, self.clock.used[star.planets.universe]
        given: dict[str, Any] = vars(planets) | vars(visit) | seen
        given |= {"star": str(self.survey.targets.name[visit.star]), "planet": planets.number}
        given |= {"known_row": planets.known, "used_h": used_h}
        self.detections.append({name: np.broadcast_to(given[name], new.shape)[new] for name in DETECTIONS.empty})

    def _spend(self, star: StarHistory, go: BoolArray, cost_h: float, on: FloatArray) -> None:
        """Charge the time of one visit of a star in the universes ``go``, for one account of the clock."""
        self.clock.spend(go, cost_h, on)
        accounts = (self.clock.search, self.clock.follow, self.clock.alarm)
        star.hours[[account is on for account in accounts]] += cost_h * star.of_blocks(go)

    def _doubt(self, k: int, visit: PlannedVisit, star: StarHistory, go: BoolArray, new: BoolArray) -> None:
        """Note candidates of a search visit, which refutes earlier false ones where the gap is long enough."""
        day = self.survey.calendar.day[visit.star, visit.slot]
        star.doubts[go & (day >= star.shown_day + self.survey.strategy.alarms.gap_days)] = 0
        false = np.where(go, sum(star.alarms[k]), 0)
        star.doubts += false
        shows = new | (false > 0)
        star.shown_day[shows], star.option[shows], star.checks[shows] = day, visit.option, 0

    def check(self, i: int, star: StarHistory, slot: int) -> None:
        """Look again at the candidates of a star in one slot, unless a planned search visit is still to come."""
        survey, clock, rule = self.survey, self.clock, self.survey.strategy.alarms
        true = star.found & ~star.confirmed & ~(star.listed & (survey.strategy.orbit.visits > 0))
        if not (true.any() or star.doubts.any()):
            return
        wanted = (star.universes_of(true) | (star.doubts > 0)) & (star.checks < rule.attempts)
        wanted &= star.stopped | (slot > star.last_slot)
        wanted &= survey.calendar.day[i, slot] >= star.shown_day + rule.gap_days
        for option in np.unique(star.option[wanted]).tolist():
            setting = survey.options[i][option]
            cost = self._cost_h(i, setting, slot)
            go = wanted & (star.option == option) & clock.affords(cost)
            if not go.any():
                continue
            some = np.flatnonzero(true & go[star.planets.universe])
            looked = star.universes_of(some[star.inside(survey, i, some, setting.band, slot)])
            false = go & ~star.universes_of(true)
            self._spend(star, looked, cost, clock.follow)
            self._spend(star, false, cost, clock.alarm)
            star.checks[looked | false] += 1
            star.doubts[looked | false] = 0
            mine = some[looked[star.planets.universe[some]]]
            shows, snr = self._visit(i, star, mine, setting, slot, f"check {slot}")
            star.confirmed[mine[shows]] = True
            star.show(survey.calendar.day[i, slot], setting.band, mine, snr, shows)

    def determine(self, i: int, star: StarHistory, slot: int) -> None:
        """Visit one star in one slot for the orbits of its planets, once they are confirmed."""
        survey, clock = self.survey, self.clock
        ready = star.found & (star.confirmed | (not survey.strategy.checks_candidates) | star.listed)
        for option in np.unique(star.way[ready]).tolist():
            setting, mine = survey.options[i][option], np.flatnonzero(ready & (star.way == option))
            if not np.isfinite(cost := self._cost_h(i, setting, slot)):
                continue
            self._ahead(i, star, mine, setting, slot)
            wanted = due(survey, i, star, mine, setting, slot, star.ahead[setting])
            go = star.universes_of(wanted) & clock.affords(cost)
            star.chosen_by[wanted[~go[star.planets.universe[wanted]]]] = -1  # the slot has passed: chosen anew
            if not (seen := np.flatnonzero(star.found & go[star.planets.universe])).size:
                continue
            self._spend(star, go, cost, clock.follow)
            shows, snr = self._visit(i, star, seen, setting, slot, f"orbit {slot}")
            star.confirmed[seen[shows]] = True
            star.orbit_visits[go], star.orbit_day[go] = star.orbit_visits[go] + 1, survey.calendar.day[i, slot]
            star.show(survey.calendar.day[i, slot], setting.band, seen, snr, shows)

    def _cost_h(self, i: int, setting: Setting, slot: int) -> float:
        """Return the telescope time of one more visit of a star; infinite where it is not possible."""
        if (i, setting) not in self._costs:
            calendar, settlings = self.survey.calendar, self.survey.strategy.visit.settlings
            self._costs[i, setting] = calendar.cost_h(self.survey.model, i, setting, settlings)
        return float(self._costs[i, setting][slot])

    def _ahead(self, i: int, star: StarHistory, some: IntArray, setting: Setting, slot: int) -> FloatArray:
        """Return the odds and SNR in a slot of planets at their known place, shape ``(2, len(some))``.

        They are worked out once, for all slots from then on and all planets that any visit can show.
        """
        calendar = self.survey.calendar
        if setting not in star.ahead:
            star.ahead[setting] = table = np.full((2, calendar.n_slots, len(star.planets)), np.nan)
            slots = slot + np.flatnonzero(calendar.fraction[i, slot:] > 0.0)
            able = np.flatnonzero(np.any(list(star.hits.values()), axis=0) & star.allowed)
            when = np.array([slots, slots])
            found, odds, *_ = self._visited(i, setting, star.planets.select(able), when, np.ones(able.size, bool), None)
            snr = found.snr * self.calibration[star.planets.universe[able]]
            table[:, slots[:, None], able] = odds, snr
        return np.asarray(star.ahead[setting][:, slot, some])

    def _visit(
        self, i: int, star: StarHistory, some: IntArray, setting: Setting, slot: int, visit: str
    ) -> tuple[BoolArray, FloatArray]:
        """Return which planets at their known place a visit of that name detects in a slot, and their SNR."""
        odds, snr = self._ahead(i, star, some, setting, slot)
        mine, name = star.planets.select(some), str(self.survey.targets.name[i])
        return uniform_draws(mine, self.seed, name, self.block, visit, self.n) < odds, snr

    def follow(self, i: int, star: StarHistory, slot: int) -> None:
        """Follow up one star in one slot: every band that a found planet still lacks, once it is confirmed."""
        survey, clock, rule = self.survey, self.clock, self.survey.strategy.follow_up
        ready = star.found & (star.confirmed | (not survey.strategy.checks_candidates))
        for f, setting in enumerate(survey.follow[i]):
            cost = self._cost_h(i, setting, slot)
            lacking = ready & ~star.shown[f]
            go = star.universes_of(lacking & (star.tried[f] < rule.attempts)) & clock.affords(cost)
            if not (mine := np.flatnonzero(lacking & go[star.planets.universe])).size:
                continue
            if rule.snr is not None:
                left = np.maximum(rule.attempts - star.tried[f, mine], 0)
                most = np.sqrt(left) * self._ahead(i, star, mine, setting, slot)[1]
                go = star.universes_of(mine[np.hypot(star.reached[f, mine], most) >= rule.snr])
                if not (mine := mine[go[star.planets.universe[mine]]]).size:
                    continue
            shows, snr = self._visit(i, star, mine, setting, slot, f"follow {setting.band} {slot}")
            self._spend(star, go, cost, clock.follow)
            star.tried[f, mine] += 1
            star.reached[f, mine] = np.hypot(star.reached[f, mine], snr)
            enough = shows if rule.snr is None else star.reached[f, mine] >= rule.snr
            star.shown[f, mine[enough]] = True
            star.show(survey.calendar.day[i, slot], setting.band, mine, snr, shows)

    def counts(self) -> dict[str, NDArray[Any]]:
        """Return planets found, visits made and hours used in each universe."""
        found: dict[str, NDArray[Any]] = {name: np.zeros(self.n, np.int64) for name in PLANETS}
        for star in self.stars.values():
            for counts, some in zip(found.values(), (star.found & ~star.listed, star.found & star.listed), strict=True):
                np.add.at(counts, star.planets.universe[some], 1)
        return found | {"visits": self.clock.visits, "hours": self.clock.used}

    def tables(self) -> SurveyTables:
        """Return what each universe has spent and found."""
        survey, clock = self.survey, self.clock
        universes = {name: np.zeros(self.n, empty.dtype) for name, empty in UNIVERSES.empty.items()}
        blocks = self.block if isinstance(self.block, range) else [self.block]
        every = {"block": np.array(blocks), "universes": np.diff(self.begins, append=self.n)}
        rows, orbits = [STARS.empty], [ORBITS.empty]
        for i, star in sorted(self.stars.items()):
            own, name = found_orbits(survey, i, star, star.found), str(survey.targets.name[i])
            shown = star.counts >= survey.strategy.detection.visits_needed
            found = {
                "new_planets": star.found & ~star.listed,
                "new_planets_unconditional": shown & ~star.listed,
                "known_planets": star.found & star.listed,
                "orbits_known": np.isin(np.arange(len(star.planets)), own.planet[own.known]),
            }
            home = self.block_of(star.planets)
            row = every | {"star": np.full(len(self.begins), name, object), "visits": star.visits}
            row |= dict(zip(HOURS, star.hours, strict=True))
            row |= {key: np.bincount(home[some], minlength=len(self.begins)) for key, some in found.items()}
            rows.append({key: np.asarray(row[key]) for key in STARS.empty})
            orbits.append(own.columns(name, star.planets))
            found["confirmed_planets"] = star.found & star.confirmed
            if survey.strategy.follow_up.wanted:
                found["characterised_planets"] = star.found & star.shown.all(axis=0)
            for key, some in found.items():
                np.add.at(universes[key], star.planets.universe[some], 1)
            universes["stars_with_planet"] += star.universes_of(star.found)
        universes |= {"universe": np.arange(self.n), "visits": clock.visits}
        universes |= {"noise_alarms": self.noise_alarms, "background_alarms": self.background_alarms}
        universes |= dict(zip(HOURS, (clock.search, clock.follow, clock.alarm), strict=True))
        detections = _joined([DETECTIONS.empty, *self.detections])
        return SurveyTables(universes, detections, _joined(rows), _joined(orbits))


def _joined(parts: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return columns one part after the other, in the types of the first one, which has no rows."""
    return {
        name: np.concatenate([part[name] for part in parts]).astype(empty.dtype, copy=False)
        for name, empty in parts[0].items()
    }
