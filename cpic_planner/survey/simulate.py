"""A survey simulated in synthetic universes: what is visited, what is found, what it costs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.etc import EtcModel
from cpic_planner.planets import StarLimits
from cpic_planner.survey.alarms import faintest_by_way
from cpic_planner.survey.calendar import Calendar
from cpic_planner.survey.detection import ExpectedSignals, Setting, detection_chance, expected_signals, reach_au
from cpic_planner.survey.events import ROUNDING_H, Clock, Events, SurveyTables
from cpic_planner.survey.history import StarHistory
from cpic_planner.survey.observed import ObservationLog, missed, resampled
from cpic_planner.survey.orbit_visits import due
from cpic_planner.survey.orbits import Epoch, PublishedOrbits, found_orbits, logged_epochs
from cpic_planner.survey.planning import albedos_of, dust_of
from cpic_planner.survey.schedule import PlannedVisit, Schedule
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import (
    PlanetSample,
    allowed_probability,
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
        return faintest_by_way(self.strategy, self.model, self.targets, self.options)


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
    Slot after slot, second looks at candidates, follow-up and visits for orbits come first, then the planned visits in
    their order, then reserve ones as far as they take nothing from planned ones to come. A visit is made where star and
    survey have not stopped and slot and budget hold it. Whether it detects a planet was decided by the numbers of that
    star, block and visit, so that another strategy that makes the same visit sees the same.
    """
    run = _played(survey, block, n, seed)
    return run.log.outcome(survey, run.stars, run.clock, block)


def count_block(
    surveys: tuple[Survey, ...], which: int, block: int, n: int, seed: int
) -> dict[str, list[int] | list[float]]:
    """Work on one task: planets found, visits made and hours used in each universe of one block, and nothing else.

    Parameters
    ----------
    surveys : tuple of Survey
    which : int
        Position of the one that is played.
    block, n, seed : int
        As of `simulate_survey`.
    """
    run = _played(surveys[which], block, n, seed)
    return {name: values.tolist() for name, values in run.log.counts(run.stars, run.clock).items()}


def _played(survey: Survey, block: int, n: int, seed: int) -> "_Simulation":
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
    """One block of universes of a survey: its stars, its clock and what has happened."""

    def __init__(self, survey: Survey, block: int, n: int, seed: int) -> None:
        from scipy.special import ndtri

        self.survey, self.block, self.n, self.seed = survey, block, n, seed
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
        self.clock = Clock.of(n, survey.strategy.time_budget_h, promised_h)
        self.log = Events(n)
        self.planets_found = np.zeros(n, np.int64)

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
            planets = resampled(planets, left, uniform_draws(planets, seed, name, block, "log", n))
        planets = planets.select(planets.within(*reach_au(survey.model, float(target.distance_pc[0]))))
        probability = allowed_probability(planets, survey.limits, i)
        allowed = uniform_draws(planets, seed, name, block, "allowed", n) < probability
        left_h = sum(visit.cost_h for _, visit in visits if not visit.reserve)
        last = max((visit.slot for _, visit in visits if not visit.reserve), default=-1)
        star = StarHistory(planets, allowed, (len(strategy.follow_up.bands), n), left_h, last_slot=last)
        star.confirmed |= (placed := at_known_place(planets, survey.known))
        star.published = PublishedOrbits(survey.known, epoch_mjd, mass_msun)
        dust = self._dust(i, planets)
        star.epochs += logged_epochs(survey, i, planets, allowed, self.albedos, dust)
        zodis = np.full(len(planets), survey.model.instrument.sky.exozodi_zodis) if dust is None else dust
        for option in sorted({visit.option for _, visit in visits}):
            own = [(k, visit) for k, visit in visits if visit.option == option]
            when = np.array([(visit.slot, visit.ordinal) for _, visit in own]).T
            way, faint = survey.options[i][option], survey.faintest[i][option]
            found, odds, roll = self._visited(i, way, planets, when, placed, faint)
            for row, (k, visit) in enumerate(own):
                star.hits[k] = uniform_draws(planets, seed, name, block, visit.ordinal, n) < odds[row]
                star.seen[k] = {key: values[row] for key, values in vars(found).items()}
                star.seen[k] |= {"chance": odds[row], "roll_deg": np.full(len(planets), roll[row])}
                star.seen[k]["exozodi_zodis"] = zodis
                drawn = chance(seed, "alarm", name, block, visit.ordinal, shape=(2, n))
                rates = survey.noise_alarms[i][option], survey.background_alarms[i][option]
                star.alarms[k] = poisson_quantile(rates[0], drawn[0]), poisson_quantile(rates[1], drawn[1])
        return star

    def _visited(
        self, i: int, way: Setting, planets: PlanetSample, when: IntArray, placed: BoolArray, faint: FloatArray | None
    ) -> tuple[ExpectedSignals, FloatArray, FloatArray]:
        """Return what visits of a star show of planets, the odds that each detects each, and the rolls.

        ``when`` holds slots and ordinals of the visits, ``placed`` says which planets are searched at a known place,
        ``faint`` below which contrast in each ring none is looked at.
        """
        survey, strategy = self.survey, self.survey.strategy
        roll = survey.calendar.roll_deg(strategy.revisits, i, *when)
        places = planets.places(survey.calendar.day[i, when[0]])
        who = survey.model, survey.targets.select([i]), way, planets, self.albedos
        found = expected_signals(*who, places, roll, self._dust(i, planets), faint)
        shift, calibration = self.shift[planets.universe], self.calibration[planets.universe]
        return found, detection_chance(found, strategy.detection, placed, shift, calibration), roll

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
        star.visits += int(go.sum())
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
            self.log.detections(star.planets, new, visit, star.seen[k], day, clock.used)
            star.place[:, new] = [star.seen[k][name][new] for name in ("separation_arcsec", "pa_deg")]
            np.add.at(self.planets_found, star.planets.universe[new], 1)
        self.log.alarms(go, *star.alarms[k])
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

    def _spend(self, star: StarHistory, go: BoolArray, cost_h: float, on: FloatArray) -> None:
        """Charge the time of one visit of a star in the universes ``go``, for one account of the clock."""
        self.clock.spend(go, cost_h, on)
        accounts = (self.clock.search, self.clock.follow, self.clock.alarm)
        star.hours[[account is on for account in accounts]] += cost_h * float(go.sum())

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
        wanted = (star.universes_of(true) | (star.doubts > 0)) & (star.checks < rule.attempts)
        wanted &= star.stopped | (slot > star.last_slot)
        wanted &= survey.calendar.day[i, slot] >= star.shown_day + rule.gap_days
        for option in np.unique(star.option[wanted]).tolist():
            setting = survey.options[i][option]
            cost = self._cost_h(i, setting, slot)
            go = wanted & (star.option == option) & clock.affords(cost)
            if not go.any():
                continue
            looked = star.universes_of(true & star.inside(survey, i, setting.band, slot)) & go
            false = go & ~star.universes_of(true)
            self._spend(star, looked, cost, clock.follow)
            self._spend(star, false, cost, clock.alarm)
            star.checks[looked | false] += 1
            star.doubts[looked | false] = 0
            mine = np.flatnonzero(true & looked[star.planets.universe])
            odds, snr = self._ahead(i, star, mine, setting, slot)
            shows = self._luck(i, star, mine, f"check {slot}") < odds
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
            odds, snr = self._ahead(i, star, seen, setting, slot)
            shows = self._luck(i, star, seen, f"orbit {slot}") < odds
            star.confirmed[seen[shows]] = True
            star.orbit_visits[go], star.orbit_day[go] = star.orbit_visits[go] + 1, survey.calendar.day[i, slot]
            star.show(survey.calendar.day[i, slot], setting.band, seen, snr, shows)

    def _cost_h(self, i: int, setting: Setting, slot: int) -> float:
        """Return the telescope time of one more visit of a star; infinite where it is not possible."""
        calendar, settlings = self.survey.calendar, self.survey.strategy.visit.settlings
        return float(calendar.cost_h(self.survey.model, i, setting, settlings)[slot])

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
            found, odds, _ = self._visited(i, setting, star.planets.select(able), when, np.ones(able.size, bool), None)
            snr = found.snr * self.calibration[star.planets.universe[able]]
            table[:, slots[:, None], able] = odds, snr
        return np.asarray(star.ahead[setting][:, slot, some])

    def _luck(self, i: int, star: StarHistory, some: IntArray, visit: str) -> FloatArray:
        """Return the uniform numbers of some planets of a star in a visit of that name."""
        name, mine = str(self.survey.targets.name[i]), star.planets.select(some)
        return uniform_draws(mine, self.seed, name, self.block, visit, self.n)

    def follow(self, i: int, star: StarHistory, slot: int) -> None:
        """Follow up one star in one slot: every band that a found planet still lacks, once it is confirmed."""
        survey, clock, rule = self.survey, self.clock, self.survey.strategy.follow_up
        ready = star.found & (star.confirmed | (not survey.strategy.checks_candidates))
        for f, setting in enumerate(survey.follow[i]):
            cost = self._cost_h(i, setting, slot)
            lacking = ready & ~star.shown[f]
            go = star.universes_of(lacking & (star.tried[f] < rule.attempts)) & clock.affords(cost)
            mine = np.flatnonzero(lacking & go[star.planets.universe])
            if not mine.size:
                continue
            odds, snr = self._ahead(i, star, mine, setting, slot)
            if rule.snr is not None:
                left = np.maximum(rule.attempts - star.tried[f, mine], 0)
                go = star.universes_of(mine[np.hypot(star.reached[f, mine], np.sqrt(left) * snr) >= rule.snr])
            made = go[star.planets.universe[mine]]
            self._spend(star, go, cost, clock.follow)
            star.tried[f, mine[made]] += 1
            star.reached[f, mine] = np.hypot(star.reached[f, mine], snr * made)
            shows = made & (self._luck(i, star, mine, f"follow {setting.band} {slot}") < odds)
            enough = shows if rule.snr is None else made & (star.reached[f, mine] >= rule.snr)
            star.shown[f, mine[enough]] = True
            star.show(survey.calendar.day[i, slot], setting.band, mine, snr, shows)
