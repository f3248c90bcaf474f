"""Stars that a strategy may visit: their frames, the cost of a visit in every slot, and the chance of each draw.

Schedules are made with planets drawn for planning alone; what visits show of them is worked out once for all strategies
and states of what is known that share it (`PlanningSky`).
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from catalogs import ORBIT, KnownPlanetTable, star_key
from cpic_core import BoolArray, FloatArray, InputError, IntArray, NDArray, Record
from cpic_planner.etc import (
    LEAST_PROBABILITY,
    EtcModel,
    Programme,
    aperture_rates,
    best_in_visit,
    frame_problem,
    planet_offsets,
)
from cpic_planner.planets import PopulationConfig, StarLimits, draw_population
from cpic_planner.queries import ReferencePlanet
from cpic_planner.ranking import OptimalSetting, best_in_band, optimise
from cpic_planner.ranking.completeness import completeness
from cpic_planner.survey.calendar import Calendar
from cpic_planner.survey.detection import (
    Pairs,
    Setting,
    detection_chance,
    faintest_of,
    least_factor,
    looks_at_place,
    pair_signals,
)
from cpic_planner.survey.observed import ObservationLog, ObservedVisit, missed
from cpic_planner.survey.orbits import orbit_chance
from cpic_planner.survey.strategy import DetectionRule, DustLaw, SurveyStrategy, VisitRule
from cpic_planner.survey.universe import (
    NEW,
    PlanetSample,
    albedos_of,
    allowed_probability,
    at_known_place,
    draw_planet_sample,
    dust_of,
    occurrence,
    star_mass_msun,
)
from cpic_planner.targets import Targets
from simulator.config import content_hash

N_DRAWS, N_KNOWN = 2000, 1000
"""Planets of each star, and draws of each known one, with which a schedule is made; its yield is that of others."""


class Host(Record, eq=False):
    """A star with what may be found there: new planets of a population, and known ones.

    Attributes
    ----------
    star : Targets
        One star.
    population : PopulationConfig or None
        None: known planets alone.
    known : KnownPlanetTable or None
    known_rows : tuple of int
        Rows of the star's planets in that table.
    """

    star: Targets
    population: PopulationConfig | None
    known: KnownPlanetTable | None
    known_rows: tuple[int, ...]

    @functools.cached_property
    def parts(self) -> list[Host]:
        """The star with each of its known planets alone, then with its population alone."""
        known = [replace(self, population=None, known_rows=(row,)) for row in self.known_rows if self.known is not None]
        return known if self.population is None else [*known, replace(self, known=None, known_rows=())]

    @functools.cached_property
    def content(self) -> str:
        """Words that decide the planets and their light; known planets by what their published orbits say."""
        orbits = [] if self.known is None else [self.known.orbits_of(row).columns for row in self.known_rows]
        known = [{name: cells.astype(str).tolist() for name, cells in rows.items()} for rows in orbits]
        return repr((self.star.content(), _digest(self.population), known))


@functools.lru_cache(maxsize=16)
def _digest(population: PopulationConfig | None) -> str:
    """Return the digest of a population; empty for none."""
    return "" if population is None else content_hash(population.content())


class Looks(Record, eq=False):
    """Visits that a star can have.

    Attributes
    ----------
    options : tuple of Setting
        Ways to make a visit: band and time.
    open : ndarray of bool, shape (o, b)
        Slots in which each is possible.
    day, roll_deg : ndarray, shape (b,)
        When a visit in each slot takes place, after the start, and the roll of the first one there.
    """

    options: tuple[Setting, ...]
    open: BoolArray
    day: FloatArray
    roll_deg: FloatArray


class Shown(Record, eq=False):
    """The planets that visits of a star are likely to show.

    Attributes
    ----------
    planets : PlanetSample
        All planets drawn that any date can show.
    seen : ndarray of int, shape (m,)
        Those of them that a visit can show.
    chance : ndarray, shape (o, b, m)
        Probability that a visit in a slot detects each of these.
    """

    planets: PlanetSample
    seen: IntArray
    chance: NDArray[np.float32]


_T = TypeVar("_T")
_Seen = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]
"""Slots of visits of one kind, planets that these can show, by their number among those drawn, and the chances."""
Ways = list[list[_Seen]]
"""Lists of `_Seen` by part of a star and way to visit it."""


class PlanningSky:
    """Planets with which schedules are made, and what visits show of them.

    What the same visits show of the same planets is worked out once, for all strategies and for all states of what is
    known (`cpic_planner.survey.outcome`); where planets stand is kept for the star that was asked for last.

    Parameters
    ----------
    seed : int
    reach_arcsec : tuple of float
        Separations between which any band shows a planet; others are left out.
    """

    def __init__(self, seed: int, reach_arcsec: tuple[float, float]) -> None:
        self.seed = seed
        self._reach = reach_arcsec
        self._once: dict[Hashable, Any] = {}
        self._star, self._pairs = "", dict[Hashable, Pairs]()

    def once(self, key: Hashable, make: Callable[[], _T]) -> _T:
        """Return what was made under a key, made when first asked for."""
        if key not in self._once:
            self._once[key] = make()
        found: _T = self._once[key]
        return found

    def settings(
        self, model: EtcModel, targets: Targets, band: str, visit: VisitRule, time_s: float
    ) -> tuple[Setting, ...]:
        """Return what `settings_of` does, worked out once for equal stars, light and visits."""
        rule = visit.goal, visit.snr, visit.exposure_s, visit.em_gain
        key = self._rules_of(model)[band], content_hash(targets.content()), *rule, time_s
        return self.once(key, lambda: tuple(settings_of(model, targets, band, visit, time_s)))

    def planets(self, host: Host, epoch_mjd: float) -> PlanetSample:
        """Return a star's planets that any date shows, of `N_KNOWN` draws of each known one and `N_DRAWS` new ones.

        Parameters
        ----------
        host : Host
        epoch_mjd : float
            Start of the survey.
        """
        kind = 0 if host.population is None else len(host.population.mixture)
        found = []
        for part in host.parts:
            planets = self._of_part(part, epoch_mjd)
            n = len(planets)
            if part.known_rows:
                planets = replace(planets, known=np.full(n, part.known_rows[0]), kind=np.full(n, kind))
            found.append(planets)
        return PlanetSample.joined(found)

    def ways(self, strategy: SurveyStrategy, model: EtcModel, host: Host, looks: Looks, epoch_mjd: float) -> Ways:
        """Return what the visits that a star can have by a strategy are likely to show, each way by itself.

        Parameters
        ----------
        strategy : SurveyStrategy
        model : EtcModel
            That of the strategy.
        host : Host
        looks : Looks
        epoch_mjd : float
            Start of the survey.
        """
        if (name := str(host.star.name[0])) != self._star:
            self._star = name
            self._pairs.clear()
        rule = strategy.detection
        faintest = [
            functools.cache(functools.partial(faintest_of, model, host.star, [option], rule, errors=False))
            for option in looks.options
        ]
        rules = self._rules_of(model, rule, strategy.assumptions.dust)
        when = looks.day.tobytes(), looks.roll_deg.tobytes()
        keys = [(rules[option.band], option, epoch_mjd, *when) for option in looks.options]
        return [
            [
                self.once(
                    (*key, part.content, looks.open[o].tobytes()),
                    functools.partial(self._of_way, strategy, model, part, looks, o, epoch_mjd, faintest[o]),
                )
                for o, key in enumerate(keys)
            ]
            for part in host.parts
        ]

    def shown(
        self,
        strategy: SurveyStrategy,
        model: EtcModel,
        host: Host,
        looks: Looks,
        epoch_mjd: float,
        ways: Ways | None = None,
    ) -> Shown:
        """Return the same of all ways together; ``ways`` are those, where they are known."""
        columns, seen, before = [], [], 0
        each = self.ways(strategy, model, host, looks, epoch_mjd) if ways is None else ways
        for part, of_options in zip(host.parts, each, strict=True):
            some = np.unique(np.concatenate([planet for _, planet, _ in of_options]))
            chance = np.zeros((*looks.open.shape, some.size), np.float32)
            for o, (slot, planet, odds) in enumerate(of_options):
                chance[o, slot, np.searchsorted(some, planet)] = odds
            columns.append(chance)
            seen.append(before + some)
            before += len(self._of_part(part, epoch_mjd))
        return Shown(self.planets(host, epoch_mjd), np.concatenate(seen), np.concatenate(columns, axis=2))

    def _of_way(
        self,
        strategy: SurveyStrategy,
        model: EtcModel,
        part: Host,
        looks: Looks,
        o: int,
        epoch_mjd: float,
        faintest: Callable[[], FloatArray],
    ) -> _Seen:
        """Return what visits in one way show of the planets of a part of a star."""
        option, open_ = looks.options[o], looks.open[o]
        planets, days, slots = self._of_part(part, epoch_mjd), looks.day[open_], np.flatnonzero(open_)
        if not (days.size and len(planets)):
            return np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.float32)
        pairs = self._pairs_of(planets, days, float(part.star.distance_pc[0]))
        zodis = dust_of(strategy, planets, self.seed, str(part.star.name[0]), "planning")
        rule, placed = strategy.detection, at_known_place(planets, part.known)[pairs.planet]
        who = model, part.star, option, planets, albedos_of(part.population), pairs, looks.roll_deg[open_]
        how = zodis, faintest()[0], looks_at_place(rule, placed)
        least = least_factor(rule, errors=False)
        some, signals = pair_signals(*who, *how, least=least, margins=rule.rule == "expected")
        odds = detection_chance(signals, rule, placed[some], calibration=rule.calibration)
        likely = odds >= LEAST_PROBABILITY
        slot = slots[pairs.visit[some][likely]].astype(np.int32)
        return slot, pairs.planet[some][likely], odds[likely].astype(np.float32)

    def _rules_of(self, model: EtcModel, *rules: DetectionRule | DustLaw | None) -> dict[str, str]:
        """Return digests of all that decides what a visit in each band shows of planets."""

        def made() -> dict[str, str]:
            content = model.content() | {"rules": [repr(item) for item in rules]}
            return {band: content_hash(content | {"optics": key}) for band, key in content["optics"].items()}

        return self.once((model, rules), made)

    def _pairs_of(self, planets: PlanetSample, days: FloatArray, distance_pc: float) -> Pairs:
        """Return the planets of a star at the dates, days after the start, on which any band may show them."""
        orbits = hashlib.sha256(b"".join(getattr(planets, name).tobytes() for name in (*ORBIT, "period_days")))
        reach = [edge * distance_pc for edge in self._reach]
        key = orbits.hexdigest(), days.tobytes(), *reach
        if key not in self._pairs:
            self._pairs[key] = Pairs.between(planets.places(days), *reach)
        return self._pairs[key]

    def _of_part(self, part: Host, epoch_mjd: float) -> PlanetSample:
        """Return the planets of one of the parts of a star."""

        def drawn() -> PlanetSample:
            star = part.star
            who = str(star.name[0]), float(star_mass_msun(star)[0]), float(star.luminosity_lsun[0])
            planets = draw_planet_sample(
                *who,
                part.population,
                known=part.known,
                known_rows=part.known_rows,
                epoch_mjd=epoch_mjd,
                n=N_KNOWN if part.population is None else N_DRAWS,
                seed=self.seed,
                stage="planning",
                one_each=True,
            )
            distance = float(star.distance_pc[0])
            return planets.select(planets.within(*(edge * distance for edge in self._reach)))

        return self.once((part.content, epoch_mjd), drawn)


N_SCREEN, _FRAMES = 2000, ("exposure_s", "n_frames", "em_gain")


class Candidate(Record, eq=False):
    """A star with the visits that can be made of it.

    Attributes
    ----------
    index : int
        Row in the targets of the strategy.
    options : tuple of Setting
        Ways to make a visit: band and time.
    cost_h : ndarray, shape (o, b)
        Telescope time in every slot; infinite where it is not possible.
    chance : ndarray, shape (o, b, m)
        Probability that the visit detects each of the planets drawn for planning.
    weight : ndarray, shape (m,)
        What each of them stands for: expected planets, times what they are worth.
    known_rows : tuple of int
        Known planets.
    visits_left : int
        Visits that the strategy still allows.
    day : ndarray, shape (b,)
        When a visit in each slot takes place, after the start.
    known : ndarray of int, shape (m,)
        Row of each planet in the table of known planets; ``NEW`` for those of the population.
    orbits : int
        How many of the planets, the last ones, stand for orbits of the others
        (`cpic_planner.survey.orbits.orbit_chance`).
    """

    index: int
    options: tuple[Setting, ...]
    cost_h: FloatArray
    chance: FloatArray
    weight: FloatArray
    known_rows: tuple[int, ...]
    visits_left: int
    day: FloatArray
    known: IntArray
    orbits: int = 0

    @property
    def detections(self) -> Candidate:
        """The star with what detections alone are worth."""
        if not self.orbits:
            return self
        own = slice(0, len(self.weight) - self.orbits)
        return replace(self, chance=self.chance[:, :, own], weight=self.weight[own], known=self.known[own], orbits=0)

    @property
    def worth(self) -> float:
        """Largest value per hour of one visit."""
        return float((self.chance @ self.weight / self.cost_h).max(initial=0.0))


def chosen_stars(
    strategy: SurveyStrategy, targets: Targets, known: KnownPlanetTable | None
) -> tuple[Targets, tuple[tuple[int, ...], ...]]:
    """Return the stars that the cuts of a strategy leave, and the known planets of each.

    Parameters
    ----------
    strategy : SurveyStrategy
    targets : Targets
        Stars of the catalogue; the cuts by name, distance and known planets are made here.
    known : KnownPlanetTable or None

    Raises
    ------
    InputError
        For a name that no star has, or if no star is left.
    """
    every = [() if known is None else known.by_star.get(star_key(str(name)), ()) for name in targets.name]
    with_known = np.array([bool(item) for item in every], bool)
    cuts = strategy.targets
    keep = with_known if cuts.known_planets == "only" else np.ones(len(targets), bool)
    for values, most in ((targets.v_mag, cuts.v_mag_max), (targets.distance_pc, cuts.distance_max_pc)):
        keep = keep & (True if most is None else values <= most)
    keys = np.array([star_key(str(name)) for name in targets.name])
    named = {"names": [star_key(name) for name in cuts.names], "exclude": [star_key(name) for name in cuts.exclude]}
    for part, found in named.items():
        for name, key in zip(getattr(cuts, part), found, strict=True):
            if key not in keys:
                allowed = "stars of the catalogue within v_mag_max, by any name"
                raise InputError(f"targets.{part}", name, allowed=allowed, hint="see cpic rank")
    if cuts.names:
        keep &= np.isin(keys, named["names"])
    keep &= ~np.isin(keys, named["exclude"])
    if not keep.any():
        raise InputError("targets", strategy.name, allowed="cuts that leave a star")
    rows = np.flatnonzero(keep)
    return targets.select(rows), tuple(tuple(every[row]) for row in rows)


def settings_of(model: EtcModel, targets: Targets, band: str, visit: VisitRule, time_s: float) -> list[Setting]:
    """Return each star's frames in one band: the best ones for the reference planet in a wall time, or given ones.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    visit : VisitRule
    time_s : float
        Wall time, s, overheads and reference frames included.
    """
    planet = ReferencePlanet()
    best = best_in_band(model, targets, band, time_s, planet)
    if visit.goal != "time":
        quick = optimise(model, targets, snr=visit.snr, detect=visit.goal == "detect", planet=planet, bands=[band])
        ends = (quick.n_frames >= 1) & (quick.time_s <= time_s)
        taken = ("exposure_s", "frames_per_visit", "em_gain", "time_s", "separation_arcsec", "contrast")
        best = replace(best, **{name: np.where(ends, getattr(quick, name), getattr(best, name)) for name in taken})
    columns = [best.exposure_s, best.frames_per_visit, best.em_gain, best.time_s]
    if visit.exposure_s is not None or visit.em_gain is not None:
        columns = _fixed(model, targets, visit, best)
    return [Setting(band, *(float(value) for value in row)) for row in zip(*columns, strict=True)]


def _fixed(model: EtcModel, targets: Targets, visit: VisitRule, best: OptimalSetting) -> list[FloatArray]:
    """Return the frames of a given exposure or gain in the same band and wall time."""
    band = str(best.band[0])
    camera = model.camera(band)
    if visit.exposure_s is not None:
        camera = replace(camera, exposure_min_s=visit.exposure_s, exposure_max_s=visit.exposure_s)
    x, y = planet_offsets(model, targets, band, best.separation_arcsec[:, None])
    rates = aperture_rates(model, targets, band, x, y, best.contrast[:, None])
    visits = best.visits[:, None]
    each_s = best.time_s[:, None] / visits
    programme = Programme.of(model.strategy, visits, each_s)
    problem = frame_problem(
        rates, camera, model.strategy, objective="significance", em_gain=visit.em_gain, programme=programme
    )
    choice = best_in_visit(problem, model.visit_s(each_s))
    time_s = visits * model.time_s(choice.visit_s)
    return [part[:, 0] for part in (choice.exposure_s, choice.n_frames, choice.em_gain, time_s)]


class Case(Record, eq=False):
    """A strategy with its model, the stars that its cuts leave, and the known planets of each."""

    strategy: SurveyStrategy
    model: EtcModel
    targets: Targets
    known_rows: tuple[tuple[int, ...], ...]


class Screened(Case, eq=False):
    """A strategy with its model and its stars at a first look.

    ``settings`` are the frames of every star for each option (band and time), ``promising`` says which stars can show
    any planet of the population in one observation, ``rows`` which are worth a close look.
    """

    settings: tuple[tuple[Setting, ...], ...]
    promising: BoolArray

    @property
    def rows(self) -> IntArray:
        """Stars that can show a planet of the population, or have a known one."""
        return np.flatnonzero(self.promising | np.array([bool(rows) for rows in self.known_rows], bool))

    def select(self, rows: IntArray, known_rows: tuple[tuple[int, ...], ...]) -> Screened:
        """Return some of the stars, with their known planets."""
        settings = tuple(tuple(own[row] for row in rows) for own in self.settings)
        chosen = self.targets.select(rows), known_rows, settings, self.promising[rows]
        return Screened(self.strategy, self.model, *chosen)


def screen(
    strategy: SurveyStrategy,
    model: EtcModel,
    targets: Targets,
    known_rows: tuple[tuple[int, ...], ...],
    seed: int,
    sky: PlanningSky,
) -> Screened:
    """Return the frames of every star, and which stars can show a planet at all.

    Parameters
    ----------
    strategy : SurveyStrategy
    model : EtcModel
        That of the strategy.
    targets : Targets
        Stars that its cuts leave.
    known_rows : tuple of tuple of int
        Known planets of each.
    seed : int
    sky : PlanningSky
        Keeps what strategies of equal visits share.
    """
    settings, promising = [], np.zeros(len(targets), bool)
    population = strategy.population
    for band in strategy.visit.bands:
        for time_s in strategy.visit.time_s:
            own = sky.settings(model, targets, band, strategy.visit, time_s)
            settings.append(own)
            if population is not None:
                frames = dict(zip(_FRAMES, np.array([item.frames for item in own]).T, strict=True))
                drawn = draw_population(population, N_SCREEN, seed)
                counted = completeness(model, targets, band, drawn, **frames, visits=float(model.strategy.visits or 1))
                # Half a planet of those drawn, at its known place: a probability is nowhere exactly zero.
                promising |= counted.completeness_known_place > 0.5 / N_SCREEN
    return Screened(strategy, model, targets, known_rows, tuple(settings), promising)


class Outlook(Record, eq=False):
    """A star that a strategy may visit, before it is known what visits show.

    Attributes
    ----------
    index, place : int
        Row in the targets of the strategy, and in its calendar.
    host : Host
    looks : Looks
    cost_h : ndarray, shape (o, b)
        Telescope time in every slot; infinite where it is not possible.
    done : tuple of ObservedVisit
    visits_left : int
    """

    index: int
    place: int
    host: Host
    looks: Looks
    cost_h: FloatArray
    done: tuple[ObservedVisit, ...]
    visits_left: int


def outlooks(
    screened: Screened, calendar: Calendar, known: KnownPlanetTable | None, log: ObservationLog | None = None
) -> list[Outlook]:
    """Return the stars that a strategy may visit.

    Parameters
    ----------
    screened : Screened
    calendar : Calendar
        Of the stars ``screened.rows``, in that order.
    known : KnownPlanetTable or None
    log : ObservationLog, optional
        What was done already: a star that showed a planet is left alone where the strategy says so, and planets that
        would have been seen count for less.
    """
    strategy, model, targets = screened.strategy, screened.model, screened.targets
    found, every_slot = [], np.arange(calendar.n_slots)
    for place, i in enumerate(screened.rows):
        options = tuple(by_star[i] for by_star in screened.settings if by_star[i].possible)
        costs = [calendar.cost_h(model, place, option, strategy.visit.settlings) for option in options]
        cost = np.stack(costs) if options else np.zeros((0, 0))
        done = () if log is None else log.of(str(targets.name[i]))
        visits_left = strategy.revisits.max_visits - len(done)
        if any(visit.planets for visit in done):
            closed = strategy.stop.after_detection
        else:
            most_empty = strategy.stop.after_empty
            closed = most_empty is not None and len(done) >= most_empty
        for visit in done:
            since = np.abs(calendar.day[place] + calendar.start_mjd - visit.mjd)
            cost[:, since < strategy.revisits.min_gap_days] = np.inf
        if not np.isfinite(cost).any() or visits_left < 1 or closed:
            continue
        host = Host(
            targets.select([i]), strategy.population if screened.promising[i] else None, known, screened.known_rows[i]
        )
        first = calendar.roll_deg(strategy.revisits, place, every_slot, np.zeros_like(every_slot))
        looks = Looks(options, np.isfinite(cost), calendar.day[place], first)
        found.append(Outlook(int(i), place, host, looks, cost, done, visits_left))
    return found


def candidates(
    screened: Screened,
    calendar: Calendar,
    sky: PlanningSky,
    limits: StarLimits,
    stars: Sequence[Outlook],
    ways: Mapping[int, Ways] = MappingProxyType({}),
) -> list[Candidate]:
    """Return the stars worth a visit, best first, at most as many as the strategy wants.

    The value of a star is that of planets drawn for it alone, at the dates and rolls of the calendar.

    Parameters
    ----------
    screened : Screened
        The strategy, its model and its stars.
    calendar : Calendar
        Of the stars ``screened.rows``, in that order.
    sky : PlanningSky
        Planets that schedules are made with.
    limits : StarLimits
        Of all stars of ``screened``: planets that they exclude count for less.
    stars : sequence of Outlook
    ways : mapping of int to Ways
        What `PlanningSky.ways` returned of these, where it was asked already, by their index.
    """
    strategy, model, targets = screened.strategy, screened.model, screened.targets
    found = []
    for star in stars:
        i, host, done = star.index, star.host, star.done
        shown = sky.shown(strategy, model, host, star.looks, calendar.start_mjd, ways.get(i))
        planets = shown.planets
        new = planets.known == NEW
        rate = 0.0 if strategy.population is None else occurrence(strategy.population) * strategy.value_new
        weight = np.where(new, rate / N_DRAWS, strategy.value_known / N_KNOWN)
        if done:
            zodis = dust_of(strategy, planets, sky.seed, str(targets.name[i]), "planning")
            weight = weight * _left(strategy, model, host, planets, done, calendar, zodis)
        weight = (weight * allowed_probability(planets, limits, i))[shown.seen]
        counts = weight > 0.0
        if counts.any():  # the others are never seen
            candidate = Candidate(
                index=i,
                options=star.looks.options,
                cost_h=star.cost_h,
                chance=shown.chance[:, :, counts].astype(np.float64),  # as sums are, so that none converts it again
                weight=weight[counts],
                known_rows=host.known_rows,
                visits_left=star.visits_left,
                day=star.looks.day,
                known=planets.known[shown.seen][counts],
            )
            if strategy.orbit.value > 0.0:
                chosen = planets.select(shown.seen[counts])
                candidate = _with_orbits(strategy, model, host, candidate, chosen, calendar, star.place, sky)
            found.append(candidate)
    found.sort(key=lambda item: (_class(strategy, item), -item.worth, item.index))
    return found[: strategy.targets.max_targets]


def _with_orbits(
    strategy: SurveyStrategy,
    model: EtcModel,
    host: Host,
    item: Candidate,
    planets: PlanetSample,
    calendar: Calendar,
    place: int,
    sky: PlanningSky,
) -> Candidate:
    """Return the star with what its planets' orbits are worth: each once more, in slots early enough for its orbit."""
    albedos = albedos_of(host.population)
    zodis = dust_of(strategy, planets, sky.seed, str(host.star.name[0]), "planning")
    about = strategy, model, host.star, calendar, place
    early = [
        orbit_chance(*about, option, chance, planets, host.known, albedos=albedos, zodis=zodis)
        for option, chance in zip(item.options, item.chance, strict=True)
    ]
    chance = np.stack(early)
    some = (chance > 0.0).any(axis=(0, 1))
    return replace(
        item,
        chance=np.concatenate([item.chance, chance[:, :, some]], axis=2),
        weight=np.concatenate([item.weight, strategy.orbit.value * item.weight[some]]),
        known=np.concatenate([item.known, item.known[some]]),
        orbits=int(some.sum()),
    )


def _left(
    strategy: SurveyStrategy,
    model: EtcModel,
    host: Host,
    planets: PlanetSample,
    done: tuple[ObservedVisit, ...],
    calendar: Calendar,
    zodis: FloatArray | None = None,
) -> FloatArray:
    """Return what earlier visits leave of the weight of each planet: a known one is there all the same."""
    albedos = albedos_of(host.population)
    placed = at_known_place(planets, host.known)
    epoch_mjd = calendar.start_mjd
    who = model, host.star, planets, albedos
    left = missed(*who, done, strategy.detection, epoch_mjd=epoch_mjd, placed=placed, zodis=zodis)
    for row in np.unique(planets.known[planets.known != NEW]):
        mine = planets.known == row
        # Draws that no date shows are not among the planets, and no visit rules them out.
        mean = 1.0 - (1.0 - left[mine]).sum() / N_KNOWN
        left[mine] = left[mine] / mean if mean > 0.0 else 1.0
    return left


def _class(strategy: SurveyStrategy, item: Candidate) -> int:
    """Return 0 for stars that come before all others."""
    return int(not (strategy.targets.known_planets == "first" and item.known_rows))
