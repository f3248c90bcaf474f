"""From strategies to surveys that can be simulated: stars, calendar, frames, schedule."""

from dataclasses import dataclass, replace

import numpy as np

from catalogs import Catalogue, KnownPlanetTable, load_known_planets
from cpic_core import Advance, InputError, untold
from cpic_planner.etc import EtcModel
from cpic_planner.planets import StarLimits
from cpic_planner.survey.alarms import background_alarms, noise_alarms
from cpic_planner.survey.allocation import make_schedule
from cpic_planner.survey.assumed import assumed_model
from cpic_planner.survey.calendar import Calendar, make_calendar
from cpic_planner.survey.candidates import Candidate, Screened, candidates, screen, settings_of
from cpic_planner.survey.detection import Setting, reach_au
from cpic_planner.survey.observed import ObservationLog, read_log
from cpic_planner.survey.planning import PlanningSky, VisitOdds, visit_odds
from cpic_planner.survey.schedule import Problem
from cpic_planner.survey.simulate import Survey
from cpic_planner.survey.strategy import SurveyStrategy, VisitRule
from cpic_planner.survey.strategy_file import StrategiesConfig, UniverseConfig
from cpic_planner.survey.visibility import VisibilityConfig, load_visibility
from cpic_planner.targets import Targets, as_catalogue, find_target, rank_sample
from simulator.config import Instrument, load_instrument


@dataclass(frozen=True, eq=False)
class Prepared:
    """Surveys of all strategies, with what they were made of.

    ``calendar`` is that of ``stars``, all stars that any strategy looks at closely; ``worth`` is the value per hour of
    the first visit of each survey's stars, in their order, ``odds`` what each visit of its schedule is likely to bring;
    ``sky`` is kept where the strategies are planned again without some facts.
    """

    config: StrategiesConfig
    catalogue: Catalogue
    instrument: Instrument
    known: KnownPlanetTable | None
    log: ObservationLog | None
    stars: Targets
    calendar: Calendar
    surveys: tuple[Survey, ...]
    worth: tuple[tuple[float, ...], ...]
    odds: tuple[tuple[VisitOdds, ...], ...]
    sky: PlanningSky | None


def prepare(config: StrategiesConfig, *, sky: PlanningSky | None = None, advance: Advance = untold) -> Prepared:
    """Screen the catalogue, make the calendar, and schedule every strategy.

    Parameters
    ----------
    config : StrategiesConfig
    sky : PlanningSky, optional
        That of the same strategies with other stars, known planets or exclusions: what has not changed is taken from
        there.
    advance : Advance
        Told about every finished step: one for each strategy's screening and schedule, one for the calendar.

    Raises
    ------
    InputError
        For a preset, file, band or star that does not exist, or a population without an occurrence rate.
    """
    universe = config.universe
    pointing = load_visibility(universe.visibility)
    _check_rolls(config, pointing)
    catalogue = as_catalogue(universe.catalog)
    instrument = load_instrument(universe.instrument)
    known = known_table(universe)
    strategies = [item.name for item in config.strategies]
    log = _checked(read_log(universe.observed, strategies), catalogue, instrument) if universe.observed else None
    looked = []
    for strategy in config.strategies:
        logged = () if log is None else [visit.setting.band for visit in log.visits]
        bands = tuple(dict.fromkeys((*strategy.visit.bands, *strategy.follow_up.bands, *logged)))
        model = assumed_model(instrument, strategy, bands)
        cuts = strategy.targets
        targets = rank_sample(
            catalog=catalogue,
            v_mag_max=cuts.v_mag_max,
            dwarfs_only=cuts.dwarfs_only,
            singles_only=cuts.singles_only,
            date_utc=universe.date_utc or universe.start_utc,
        )
        looked.append(screen(strategy, model, targets, known, universe.seed))
        advance(f"{strategy.name}: stars")
    stars = _every_star(looked)
    calendar = make_calendar(universe, instrument, pointing, stars)
    if log is not None:
        calendar = calendar.closed_before(log.until_mjd)
        if not calendar.allowed_h.any():
            none_left = f"none of its {universe.duration_days:g} days is left"
            allowed = "visits that leave a part of the survey"
            raise InputError("universe.observed", log.provenance, allowed=allowed, hint=none_left)
        looked = [_without(item, log.hours) for item in looked]
    advance("calendar")
    place = {str(name): i for i, name in enumerate(stars.name)}
    if sky is None:
        reach = [reach_au(item.model, 1.0) for item in looked]
        sky = PlanningSky(universe.seed, (min(low for low, _ in reach), max(high for _, high in reach)))
    surveys, worth, odds = [], [], []
    for item in looked:
        names = item.targets.name[item.rows]
        own = calendar.select(np.array([place[str(name)] for name in names], np.int64))
        limits = StarLimits.of(item.targets.name.tolist(), universe.exclusions, known)
        found = candidates(item, own, known, sky, limits, log)
        surveys.append(_survey(universe, item, found, own, known, log))
        worth.append(tuple(star.worth for star in found))
        odds.append(visit_odds(Problem(item.strategy, tuple(found), own.slot_h), surveys[-1].schedule.visits))
        advance(f"{item.strategy.name}: schedule")
    kept = sky if universe.facts else None
    plans = tuple(surveys), tuple(worth), tuple(odds)
    return Prepared(config, catalogue, instrument, known, log, stars, calendar, *plans, kept)


def known_table(universe: UniverseConfig) -> KnownPlanetTable | None:
    """Return the table of known planets of a survey; None where they are left out.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    if universe.known_planets == "off":
        return None
    return load_known_planets(universe.known_planets, candidates=universe.candidates)


def _check_rolls(config: StrategiesConfig, limits: VisibilityConfig) -> None:
    """Refuse rolls that the telescope cannot take."""
    for strategy in config.strategies:
        half = strategy.reduction.rolls_deg[-1]
        reach = strategy.revisits.roll_dither_deg + half
        if reach > limits.roll_deg:
            dither = strategy.revisits.roll_dither_deg
            raise InputError(
                "revisits.roll_dither_deg" if dither else "reduction.roll_deg",
                dither or strategy.reduction.roll_deg,
                unit="deg",
                allowed=f"rolls within {limits.roll_deg:g} deg of the best one",
                hint=f"strategy {strategy.name}",
            )


def _checked(log: ObservationLog, catalogue: Catalogue, instrument: Instrument) -> ObservationLog:
    """The log with the names that the catalogue has for its stars; refused by row without such a star or band."""
    names: dict[str, str] = {}
    for visit in log.visits:
        if visit.setting.band not in instrument.bands:
            raise InputError(f"{visit.where} column band", visit.setting.band, allowed=", ".join(instrument.bands))
        if visit.star not in names:
            try:
                names[visit.star] = str(find_target(visit.star, catalog=catalogue)[0].name[0])
            except InputError as error:
                where = f"{visit.where} column star"
                raise InputError(where, visit.star, allowed=error.allowed, hint=error.hint) from None
    return replace(log, visits=tuple(replace(visit, star=names[visit.star]) for visit in log.visits))


def _without(item: Screened, hours: float) -> Screened:
    """The strategy with the time that is left of its budget."""
    budget_h = item.strategy.time_budget_h
    if budget_h <= hours:
        raise InputError(
            "time_budget_h",
            budget_h,
            unit="h",
            allowed=f"more than the {hours:g} h of the observation log",
            hint=f"strategy {item.strategy.name}",
        )
    return replace(item, strategy=item.strategy.model_copy(update={"time_budget_h": budget_h - hours}))


def _every_star(looked: list[Screened]) -> Targets:
    """Stars that any strategy looks at closely, each once; the first of the catalogue if there is none."""
    joined = Targets.joined([item.targets.select(item.rows) for item in looked])
    if not len(joined):
        return looked[0].targets.select([0])
    _, first = np.unique(joined.name, return_index=True)
    return joined.select(np.sort(first))


def _survey(
    universe: UniverseConfig,
    item: Screened,
    found: list[Candidate],
    calendar: Calendar,
    known: KnownPlanetTable | None,
    log: ObservationLog | None,
) -> Survey:
    strategy, model = item.strategy, item.model
    rows = np.array([star.index for star in found], np.int64)
    targets = item.targets.select(rows)

    def background(i: int, option: Setting) -> float:
        """Background stars that a visit of a star takes for planets."""
        if universe.background == "off":
            return 0.0
        return background_alarms(model, targets.select([i]), option, strategy.detection)

    return Survey(
        strategy=strategy,
        model=model,
        targets=targets,
        calendar=calendar.select(np.searchsorted(item.rows, rows)),
        options=tuple(star.options for star in found),
        follow=_follow_ups(strategy, model, targets),
        schedule=make_schedule(Problem(strategy, tuple(found), calendar.slot_h)),
        known=known,
        known_rows=tuple(star.known_rows for star in found),
        limits=StarLimits.of(targets.name.tolist(), universe.exclusions, known),
        noise_alarms=tuple(tuple(noise_alarms(model, way.band) for way in star.options) for star in found),
        background_alarms=tuple(tuple(background(i, way) for way in star.options) for i, star in enumerate(found)),
        log=log,
    )


def _follow_ups(strategy: SurveyStrategy, model: EtcModel, targets: Targets) -> tuple[tuple[Setting, ...], ...]:
    """Follow-up settings of each star, one a band."""
    rule = strategy.follow_up
    if not rule.wanted or not len(targets):
        return ((),) * len(targets)
    visit = VisitRule(bands=rule.bands, time_s=(rule.time_s,))
    by_band = [settings_of(model, targets, band, visit, rule.time_s) for band in rule.bands]
    return tuple(zip(*by_band, strict=True))
