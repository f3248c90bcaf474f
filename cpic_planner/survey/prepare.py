"""From strategies to surveys that can be simulated: stars, calendar, frames, schedule."""

from dataclasses import dataclass, replace

import numpy as np

from catalogs import Catalogue, KnownPlanetTable, load_known_planets
from cpic_core import Advance, InputError, untold
from cpic_planner.etc import EtcModel
from cpic_planner.survey.allocation import make_schedule
from cpic_planner.survey.assumed import assumed_model
from cpic_planner.survey.calendar import Calendar, make_calendar
from cpic_planner.survey.candidates import Candidate, PlanningSky, Screened, candidates, screen, settings_of
from cpic_planner.survey.detection import background_alarms, noise_alarms, reach_au
from cpic_planner.survey.observed import ObservationLog, read_log
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
    the first visit of each survey's stars, in their order.
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


@dataclass(frozen=True, eq=False)
class _Looked:
    strategy: SurveyStrategy
    model: EtcModel
    screened: Screened


def prepare(config: StrategiesConfig, *, advance: Advance = untold) -> Prepared:
    """Screen the catalogue, make the calendar, and schedule every strategy.

    Parameters
    ----------
    config : StrategiesConfig
    advance : Advance
        Told about every finished step: one for each strategy's screening and schedule, one for the calendar.

    Raises
    ------
    InputError
        For a preset, file, band or star that does not exist, or a population without an occurrence rate.
    """
    universe, limits = config.universe, load_visibility(config.universe.visibility)
    _check_rolls(config, limits)
    catalogue, instrument = as_catalogue(universe.catalog), load_instrument(universe.instrument)
    known = known_table(universe)
    log = _checked(read_log(universe.observed), catalogue, instrument) if universe.observed else None
    looked = []
    for strategy in config.strategies:
        bands = tuple(dict.fromkeys((*strategy.visit.bands, *strategy.follow_up.bands, *_logged_bands(log))))
        model = assumed_model(instrument, strategy, bands)
        cuts = strategy.targets
        targets = rank_sample(
            catalog=catalogue, v_mag_max=cuts.v_mag_max, dwarfs_only=cuts.dwarfs_only, singles_only=cuts.singles_only
        )
        looked.append(_Looked(strategy, model, screen(strategy, model, targets, known, universe.seed)))
        advance(f"{strategy.name}: stars")
    stars = _every_star(looked)
    calendar = make_calendar(universe, instrument, limits, stars)
    if log is not None:
        calendar = calendar.closed_before(log.until_mjd)
        if not calendar.allowed_h.any():
            raise InputError(
                "universe.observed",
                log.provenance,
                allowed="visits that leave a part of the survey",
                hint=f"none of its {universe.duration_days:g} days is left",
            )
        looked = [_without(item, log.hours) for item in looked]
    advance("calendar")
    place = {str(name): i for i, name in enumerate(stars.name)}
    reach = [reach_au(item.model, 1.0) for item in looked]
    sky = PlanningSky(universe.seed, (min(low for low, _ in reach), max(high for _, high in reach)))
    surveys, worth = [], []
    for item in looked:
        chosen = item.screened.targets.select(item.screened.rows)
        own = calendar.select(np.array([place[str(name)] for name in chosen.name], np.int64))
        found = candidates(item.strategy, item.model, item.screened, own, known, sky, log)
        surveys.append(_survey(universe, item, found, own, known, log))
        worth.append(tuple(star.worth for star in found))
        advance(f"{item.strategy.name}: schedule")
    return Prepared(config, catalogue, instrument, known, log, stars, calendar, tuple(surveys), tuple(worth))


def known_table(universe: UniverseConfig) -> KnownPlanetTable | None:
    """Return the table of known planets of a survey; None where they are left out.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    return None if universe.known_planets == "off" else load_known_planets(universe.known_planets)


def _check_rolls(config: StrategiesConfig, limits: VisibilityConfig) -> None:
    """Refuse rolls that the telescope cannot take."""
    for strategy in config.strategies:
        half = strategy.reduction.rolls_deg[-1]
        reach = strategy.revisits.roll_dither_deg + half
        if reach > limits.roll_deg:
            what = "revisits.roll_dither_deg" if strategy.revisits.roll_dither_deg else "reduction.roll_deg"
            given = strategy.revisits.roll_dither_deg or strategy.reduction.roll_deg
            raise InputError(
                what,
                given,
                unit="deg",
                hint=f"strategy {strategy.name}",
                allowed=f"rolls within {limits.roll_deg:g} deg of the best one",
            )


def _logged_bands(log: ObservationLog | None) -> tuple[str, ...]:
    return () if log is None else tuple(dict.fromkeys(visit.setting.band for visit in log.visits))


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
                raise InputError(
                    f"{visit.where} column star", visit.star, allowed=error.allowed, hint=error.hint
                ) from None
    return replace(log, visits=tuple(replace(visit, star=names[visit.star]) for visit in log.visits))


def _without(item: _Looked, hours: float) -> _Looked:
    """The strategy with the time that is left of its budget."""
    left = item.strategy.time_budget_h - hours
    if left <= 0.0:
        raise InputError(
            "time_budget_h",
            item.strategy.time_budget_h,
            unit="h",
            allowed=f"more than the {hours:g} h of the observation log",
            hint=f"strategy {item.strategy.name}",
        )
    return replace(item, strategy=item.strategy.model_copy(update={"time_budget_h": left}))


def _every_star(looked: list[_Looked]) -> Targets:
    """Stars that any strategy looks at closely, each once; the first of the catalogue if there is none."""
    parts = [item.screened.targets.select(item.screened.rows) for item in looked]
    joined = Targets.joined(parts)
    if not len(joined):
        return looked[0].screened.targets.select([0])
    _, first = np.unique(joined.name, return_index=True)
    return joined.select(np.sort(first))


def _survey(
    universe: UniverseConfig,
    item: _Looked,
    found: list[Candidate],
    calendar: Calendar,
    known: KnownPlanetTable | None,
    log: ObservationLog | None,
) -> Survey:
    strategy, model = item.strategy, item.model
    rows = np.array([star.index for star in found], np.int64)
    targets = item.screened.targets.select(rows)
    places = np.array([int(np.flatnonzero(item.screened.rows == row)[0]) for row in rows], np.int64)
    own = calendar.select(places)
    problem = Problem(strategy, tuple(found), calendar.slot_h)
    follow = _follow_ups(strategy, model, targets)
    options = tuple(star.options for star in found)
    background = universe.background == "on"
    return Survey(
        strategy=strategy,
        model=model,
        targets=targets,
        calendar=own,
        options=options,
        follow=follow,
        schedule=make_schedule(problem),
        known=known,
        known_rows=tuple(star.known_rows for star in found),
        noise_alarms=tuple(tuple(noise_alarms(model, option.band) for option in ways) for ways in options),
        background_alarms=tuple(
            tuple(
                background_alarms(model, targets.select([i]), option, strategy.detection) if background else 0.0
                for option in ways
            )
            for i, ways in enumerate(options)
        ),
        log=log,
    )


def _follow_ups(strategy: SurveyStrategy, model: EtcModel, targets: Targets) -> tuple:  # type: ignore[type-arg]
    """Follow-up settings of each star, one a band."""
    rule = strategy.follow_up
    if not rule.wanted or not len(targets):
        return tuple(() for _ in range(len(targets)))
    visit = VisitRule(bands=rule.bands, time_s=(rule.time_s,))
    by_band = [settings_of(model, targets, band, visit, rule.time_s) for band in rule.bands]
    return tuple(zip(*by_band, strict=True))
