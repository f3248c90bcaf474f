"""A survey simulated in synthetic universes: what is visited, what is found, what it costs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.etc import EtcModel
from cpic_planner.survey.calendar import Calendar, sun_position_angle_deg
from cpic_planner.survey.candidates import albedos_of
from cpic_planner.survey.detection import ExpectedSignals, Setting, detection_chance, expected_signals, reach_au
from cpic_planner.survey.events import ROUNDING_H, Clock, Events, SurveyTables
from cpic_planner.survey.observed import ObservationLog, missed, resampled
from cpic_planner.survey.schedule import PlannedVisit, Schedule
from cpic_planner.survey.strategy import DetectionRule, SurveyStrategy
from cpic_planner.survey.universe import (
    PlanetSample,
    at_known_place,
    chance,
    draw_planet_sample,
    poisson_quantile,
    star_mass_msun,
    uniform_draws,
)
from cpic_planner.targets import Targets


@dataclass(frozen=True, eq=False)
class Survey:
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
    noise_alarms: tuple[tuple[float, ...], ...]
    background_alarms: tuple[tuple[float, ...], ...]
    log: ObservationLog | None = None


@dataclass(eq=False)
class StarHistory:
    """One star in all universes of a block."""

    planets: PlanetSample
    hits: dict[int, BoolArray]
    seen: dict[int, dict[str, FloatArray]]
    alarms: dict[int, tuple[IntArray, IntArray]]
    counts: IntArray
    found: BoolArray
    shown: BoolArray
    tried: IntArray
    stopped: BoolArray
    empty: IntArray
    left_h: float
    visits: int = 0
    hours: float = 0.0
    follow_h: float = 0.0


def simulate_survey(survey: Survey, *, block: int, n: int, seed: int) -> SurveyTables:
    """Simulate a survey in ``n`` universes.

    Parameters
    ----------
    survey : Survey
    block : int
        Number of the block; universes of one block share their random streams, which name star, block and visit.
    n : int
        Universes.
    seed : int

    Returns
    -------
    SurveyTables

    Notes
    -----
    Slot after slot, follow-up comes first, then the planned visits in their order, then reserve ones as far as they
    take nothing from planned ones to come. A visit is made where star and survey have not stopped and slot and budget
    hold it. Whether it detects a planet was decided by the numbers of that star, block and visit, so that another
    strategy that makes the same visit sees the same.
    """
    strategy, stars = survey.strategy, _stars(survey, block, n, seed)
    planned = [visit for visit in survey.schedule.visits if not visit.reserve]
    clock = Clock.of(n, strategy.time_budget_h, sum(visit.cost_h for visit in planned))
    log, total = Events(n), np.zeros(n, np.int64)
    slots: dict[int, list[tuple[int, PlannedVisit]]] = {}
    for k, visit in enumerate(survey.schedule.visits):
        slots.setdefault(visit.slot, []).append((k, visit))
    follows = strategy.follow_up.wanted
    for b in range(survey.calendar.n_slots) if follows else sorted(slots):
        clock.slot[:] = strategy.slot_share * survey.calendar.slot_h[b]
        if follows:
            for i, star in stars.items():
                if star.found.any():
                    _follow(survey, i, star, b, clock, block, seed)
        for k, visit in slots.get(b, ()):
            _search(survey, stars[visit.star], k, visit, clock, log, total)
    return log.outcome(survey, stars, clock, block)


def _systematic(rule: DetectionRule, block: int, n: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Calibration of each universe, and the shift of its detection law in standard errors."""
    from scipy.special import ndtri

    drawn = ndtri(chance(seed, "calibration", block, shape=(2, n)))
    return np.maximum(rule.calibration + rule.calibration_error * drawn[0], 0.0), drawn[1]


def _stars(survey: Survey, block: int, n: int, seed: int) -> dict[int, StarHistory]:
    """Planets of all visited stars, and what every visit would detect of them."""
    by_star: dict[int, list[tuple[int, PlannedVisit]]] = {}
    for k, visit in enumerate(survey.schedule.visits):
        by_star.setdefault(visit.star, []).append((k, visit))
    calibration, shift = _systematic(survey.strategy.detection, block, n, seed)
    mass = star_mass_msun(survey.targets)
    return {
        i: _star(survey, i, visits, float(mass[i]), (calibration, shift), block, n, seed)
        for i, visits in sorted(by_star.items())
    }


def _star(
    survey: Survey,
    i: int,
    visits: Sequence[tuple[int, PlannedVisit]],
    mass: float,
    systematic: tuple[FloatArray, FloatArray],
    block: int,
    n: int,
    seed: int,
) -> StarHistory:
    strategy, target, name = survey.strategy, survey.targets.select([i]), str(survey.targets.name[i])
    planets = draw_planet_sample(
        name,
        mass,
        float(target.luminosity_lsun[0]),
        strategy.population,
        known=survey.known,
        known_rows=survey.known_rows[i],
        epoch_mjd=survey.calendar.start_mjd,
        n=n,
        seed=seed,
        block=block,
    )
    done = () if survey.log is None else survey.log.of(name)
    if done:
        sun = sun_position_angle_deg(target, np.array([[visit.mjd for visit in done]]))[0]
        left = missed(
            survey.model,
            target,
            planets,
            albedos_of(strategy.population),
            done,
            strategy.detection,
            epoch_mjd=survey.calendar.start_mjd,
            sun_pa_deg=sun,
            placed=at_known_place(planets, survey.known),
        )
        planets = resampled(planets, left, uniform_draws(planets, seed, name, block, "log", n))
    planets = planets.select(planets.within(*reach_au(survey.model, float(target.distance_pc[0]))))
    hits: dict[int, BoolArray] = {}
    seen: dict[int, dict[str, FloatArray]] = {}
    alarms: dict[int, tuple[IntArray, IntArray]] = {}
    placed = at_known_place(planets, survey.known)
    for option in sorted({visit.option for _, visit in visits}):
        own = [(k, visit) for k, visit in visits if visit.option == option]
        slots = np.array([visit.slot for _, visit in own])
        ordinals = np.array([visit.ordinal for _, visit in own])
        found, odds, roll = _visited(
            survey, i, survey.options[i][option], planets, (slots, ordinals), placed, systematic
        )
        for row, (k, visit) in enumerate(own):
            hits[k] = uniform_draws(planets, seed, name, block, visit.ordinal, n) < odds[row]
            seen[k] = {key: getattr(found, key)[row] for key in found.__dataclass_fields__}
            seen[k] |= {"chance": odds[row], "roll_deg": np.full(len(planets), roll[row])}
            drawn = chance(seed, "alarm", name, block, visit.ordinal, shape=(2, n))
            alarms[k] = (
                poisson_quantile(survey.noise_alarms[i][option], drawn[0]),
                poisson_quantile(survey.background_alarms[i][option], drawn[1]),
            )
    bands = len(strategy.follow_up.bands)
    return StarHistory(
        planets=planets,
        hits=hits,
        seen=seen,
        alarms=alarms,
        counts=np.zeros(len(planets), np.int64),
        found=np.zeros(len(planets), bool),
        shown=np.zeros((bands, len(planets)), bool),
        tried=np.zeros((bands, n), np.int64),
        stopped=np.zeros(n, bool),
        empty=np.zeros(n, np.int64),
        left_h=sum(visit.cost_h for _, visit in visits if not visit.reserve),
    )


def _visited(
    survey: Survey,
    i: int,
    setting: Setting,
    planets: PlanetSample,
    when: tuple[IntArray, IntArray],
    placed: BoolArray,
    systematic: tuple[FloatArray, FloatArray],
) -> tuple[ExpectedSignals, FloatArray, FloatArray]:
    """Return what visits of a star show of planets, the odds that each detects each, and the rolls.

    ``when`` holds slots and ordinals of the visits, ``placed`` says which planets are searched at a known place,
    ``systematic`` is that of `_systematic`.
    """
    strategy, (calibration, shift) = survey.strategy, systematic
    roll = survey.calendar.roll_deg(strategy.revisits, i, *when)
    found = expected_signals(
        survey.model,
        survey.targets.select([i]),
        setting,
        planets,
        albedos_of(strategy.population),
        planets.places(survey.calendar.day[i, when[0]]),
        roll,
    )
    odds = detection_chance(found, strategy.detection, placed, shift[planets.universe], calibration[planets.universe])
    return found, odds, roll


def _search(
    survey: Survey, star: StarHistory, k: int, visit: PlannedVisit, clock: Clock, log: Events, total: IntArray
) -> None:
    """One planned visit in all universes."""
    strategy, cost = survey.strategy, visit.cost_h
    stop = strategy.stop
    wanted = ~star.stopped
    if stop.after_planets is not None:
        wanted &= total < stop.after_planets
    go = wanted & clock.affords(cost)
    if visit.reserve:
        go &= clock.left - clock.promised >= cost - ROUNDING_H
    else:
        clock.promised[~star.stopped] -= cost
        star.left_h -= cost
    clock.spend(go, cost, clock.search)
    star.visits += int(go.sum())
    star.hours += cost * float(go.sum())
    there = go[star.planets.universe]
    hit = star.hits[k] & there
    star.counts[hit] += 1
    new = hit & (star.counts >= strategy.detection.visits_needed) & ~star.found
    star.found |= new
    if new.any():
        log.detections(star.planets, new, visit, star.seen[k], survey.calendar.day[visit.star, visit.slot], clock.used)
        np.add.at(total, star.planets.universe[new], 1)
    log.alarms(go, *star.alarms[k])
    caught = np.zeros(len(go), bool)
    caught[star.planets.universe[hit]] = True
    star.empty[go & ~caught] += 1
    ends = np.zeros(len(go), bool)
    if stop.after_detection:
        ends[star.planets.universe[new]] = True
    if stop.after_empty is not None:
        ends |= (star.empty >= stop.after_empty) & ~_any(star, len(go))
    ends &= ~star.stopped
    clock.promised[ends] -= star.left_h
    star.stopped |= ends


def _any(star: StarHistory, n: int) -> BoolArray:
    """Universes in which the star has shown a planet in any visit."""
    shown = np.zeros(n, bool)
    shown[star.planets.universe[star.counts > 0]] = True
    return shown


def _follow(survey: Survey, i: int, star: StarHistory, b: int, clock: Clock, block: int, seed: int) -> None:
    """Follow-up of one star in one slot: every band that a found planet still lacks."""
    strategy, n = survey.strategy, len(clock.left)
    for f, setting in enumerate(survey.follow[i]):
        cost = float(survey.calendar.cost_h(survey.model, i, setting, strategy.visit.settlings)[b])
        if not np.isfinite(cost):
            continue
        lacking = star.found & ~star.shown[f]
        need = np.zeros(n, bool)
        need[star.planets.universe[lacking]] = True
        go = need & (star.tried[f] < strategy.follow_up.attempts) & clock.affords(cost)
        if not go.any():
            continue
        clock.spend(go, cost, clock.follow)
        star.follow_h += cost * float(go.sum())
        star.tried[f, go] += 1
        at_place = np.ones(len(star.planets), bool)
        systematic = _systematic(strategy.detection, block, n, seed)
        slot = np.array([b])
        _, odds, _ = _visited(survey, i, setting, star.planets, (slot, slot), at_place, systematic)
        luck = uniform_draws(star.planets, seed, str(survey.targets.name[i]), block, f"follow {setting.band} {b}", n)
        star.shown[f] |= lacking & go[star.planets.universe] & (luck < odds[0])
