"""Make surveys that can be simulated from strategies: assumptions, stars, calendar, frames, schedule."""

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from catalogs import Catalogue, KnownPlanetTable, load_known_planets
from cpic_core import Advance, FloatArray, InputError, Record, announce, compute_once, untold
from cpic_planner.etc import EtcModel, build_model
from cpic_planner.jobs import Runner, Task, in_this_process
from cpic_planner.planets import StarLimits
from cpic_planner.queries import Change, Strategy, changed
from cpic_planner.survey.calendar import Calendar, make_calendar
from cpic_planner.survey.candidates import (
    Case,
    Outlook,
    PlanningSky,
    Screened,
    Ways,
    candidates,
    chosen_stars,
    outlooks,
    screen,
)
from cpic_planner.survey.detection import Setting, alarms, reach_au
from cpic_planner.survey.observed import ObservationLog, read_log
from cpic_planner.survey.schedule import Problem, make_schedule, with_odds
from cpic_planner.survey.simulate import Survey
from cpic_planner.survey.strategy import Assumptions, StrategiesConfig, SurveyStrategy, UniverseConfig, VisitRule
from cpic_planner.survey.universe import occurrence
from cpic_planner.survey.visibility import VisibilityConfig, load_visibility
from cpic_planner.targets import Targets, as_catalogue, find_target, rank_sample
from simulator.config import Instrument, content_hash
from simulator.imaging import PsfMetrics, build_imager, centred_axis, metrics_key, psf_metrics
from simulator.passbands import Passbands
from simulator.products import mjd_of

_TOGETHER = 8
_FIRST_NM, _MOST_NM, _RTOL, _ROUNDING = 0.01, 100.0, 1e-7, 1e-9


def assumed_model(instrument: Instrument, strategy: SurveyStrategy, bands: Sequence[str]) -> EtcModel:
    """Return the ETC's model under the assumptions of a strategy; observations have one visit unless it says more.

    Throughput and drift change the rates alone and dust the sky: optics are those of the instrument. A dark hole that
    is brighter than the instrument's is that of a less steady mirror, band by band (`mirror_noise_nm`); a darker one
    has less of the same light (`with_contrast`).

    Parameters
    ----------
    instrument : Instrument
    strategy : SurveyStrategy
    bands : sequence of str
        Names of bands of the instrument.

    Raises
    ------
    InputError
        If a band is unknown, or a number becomes impossible.
    """
    assumed = strategy.assumptions
    own = {"sigma": strategy.detection.sigma, "visits": strategy.reduction.visits or 1}
    reduction = Strategy.model_validate(strategy.reduction.model_dump() | own)
    nominal = build_model(instrument, bands, reduction)
    changes = _changes(assumed, nominal.bands)
    metrics, contrast = nominal.metrics, assumed.contrast
    if contrast is not None:
        metrics = {band: _assumed_metrics(instrument, band, item, contrast) for band, item in metrics.items()}
    if not changes and metrics is nominal.metrics:
        return nominal
    other = changed(instrument, changes)
    return EtcModel(other, Passbands.from_instrument(other), metrics, reduction)


def _changes(assumed: Assumptions, bands: Sequence[str]) -> list[Change]:
    """Return what a strategy takes of the instrument instead of what its file says."""
    changes = []
    if assumed.drift != 1.0:
        changes.append(Change.scaling("drift", assumed.drift))
    if assumed.throughput != 1.0:
        changes += [Change.scaling(f"bands.{band}.t_opt", assumed.throughput) for band in bands]
    zodis = assumed.exozodi if assumed.dust is None else assumed.dust.median
    if zodis is not None:
        changes.append(Change(key="sky.exozodi_zodis", value=zodis))
    return changes


def imaged_model(model: EtcModel, strategy: SurveyStrategy, band: str) -> EtcModel | None:
    """Return an assumed model whose instrument makes images of the same light; None where no instrument does.

    Parameters
    ----------
    model : EtcModel
    strategy : SurveyStrategy
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    contrast = strategy.assumptions.contrast
    if contrast is None:
        return model
    noise = None if model.of_table else mirror_noise_nm(model.instrument, band, contrast)
    return None if noise is None else replace(model, instrument=_noisier(model.instrument, noise))


def _assumed_metrics(instrument: Instrument, band: str, nominal: PsfMetrics, contrast: float) -> PsfMetrics:
    noise = mirror_noise_nm(instrument, band, contrast)
    return with_contrast(nominal, contrast) if noise is None else psf_metrics(_noisier(instrument, noise), band)


def _noisier(instrument: Instrument, noise_nm: float) -> Instrument:
    return instrument.changed({"mirror": {"noise_nm": noise_nm}})


def mirror_noise_nm(instrument: Instrument, band: str, contrast: float) -> float | None:
    """Return the random error of the mirror's actuators at which the dark hole of a band has a median raw contrast.

    Parameters
    ----------
    instrument : Instrument
    band : str
    contrast : float
        At least 0.

    Returns
    -------
    float or None
        rms in nm of surface; None where the hole is as bright without, or no error of the mirror changes it, and where
        the coronagraph is a table.

    Notes
    -----
    Of what can brighten a dark hole this is the plainest: static and everywhere in it. It does more harm than as much
    light of the instrument's own hole (report ``whatif``), whose field differs across the band, so that its products
    with the drift partly cancel; an error of the mirror leaves nearly the same field at all wavelengths of a band.
    """
    if instrument.coronagraph.table is not None:
        return None
    key = content_hash({"optics": metrics_key(instrument, band), "contrast": repr(contrast)})

    def computed() -> dict[str, FloatArray]:
        return {"noise_nm": np.asarray(_solved(instrument, band, contrast))}

    noise = compute_once(f"mirror-noise-{key}", computed, lambda found: float(found["noise_nm"]))
    return None if math.isnan(noise) else noise


def _solved(instrument: Instrument, band: str, contrast: float) -> float:
    """Return the noise of the mirror; nan without any."""
    announce(f"brightening the dark hole of {band} to {contrast:g}, once: about 10 s")
    least = instrument.mirror.noise_nm
    bright = functools.partial(_median_of, instrument, band)
    if contrast <= (1.0 + _ROUNDING) * bright(least):
        return math.nan
    high = max(least, _FIRST_NM)
    while bright(high) < contrast:
        high *= 2.0
        if high > _MOST_NM:
            return math.nan
    return float(brentq(lambda noise: bright(noise) - contrast, least, high, rtol=_RTOL, xtol=_RTOL * _FIRST_NM))


def _median_of(instrument: Instrument, band: str, noise_nm: float) -> float:
    """Return the same as `PsfMetrics.median_contrast`, of the two images that it needs alone."""
    imager = build_imager(_noisier(instrument, noise_nm), band)
    masked, clear = (imager.stamp_axis(masked=state) for state in (True, False))
    light = imager.image(masked, masked)
    offset = centred_axis(len(light), imager.pixel_scale_arcsec)
    return float(np.median(light[imager.zone.covers(offset, offset)]) / imager.image(clear, clear).max())


@functools.lru_cache(maxsize=64)
def with_contrast(metrics: PsfMetrics, contrast: float) -> PsfMetrics:
    """Return the figures of a band whose dark hole has another median raw contrast: see `PsfMetrics.brightened`.

    Parameters
    ----------
    metrics : PsfMetrics
    contrast : float
        At least 0.
    """
    return metrics.brightened(contrast / metrics.median_contrast)


class Ground(Record, eq=False):
    """The inputs of planning, read from presets and files: whoever has them can plan strategies anywhere.

    ``reach_arcsec`` are the separations between which any band of any strategy shows a planet.
    """

    universe: UniverseConfig
    catalogue: Catalogue
    instrument: Instrument
    pointing: VisibilityConfig
    known: KnownPlanetTable | None
    log: ObservationLog | None
    cases: tuple[Case, ...]
    reach_arcsec: tuple[float, float]

    def content(self) -> dict[str, Any]:
        """Return what decides the plans beside the strategies, for content hashes; files by what is in them."""
        joined = Targets.joined([case.targets for case in self.cases])
        _, first = np.unique(joined.name, return_index=True)
        stars = joined.select(np.sort(first))
        return {
            "models": [case.model.content() for case in self.cases],
            "stars": stars.content(),
            "of_strategies": [case.targets.name.tolist() for case in self.cases],
            "catalogue": self.catalogue.provenance,
            "known": "" if self.known is None else self.known.provenance,
            "limits": StarLimits.of(stars.name.tolist(), self.universe.exclusions, self.known).digest(),
            "observed": "" if self.log is None else self.log.provenance,
            "visibility": self.pointing.content(),
        }


class Prepared(Record, eq=False):
    """Surveys of all strategies, and what they were made of."""

    config: StrategiesConfig
    ground: Ground
    surveys: tuple[Survey, ...]

    @classmethod
    def of(cls, config: StrategiesConfig, ground: Ground, surveys: Sequence[Survey]) -> "Prepared":
        """Return surveys wherever they were planned: what they share is one thing again, after its way to and fro."""
        shared: dict[str, Any] = {"known": ground.known, "log": ground.log}
        own = (replace(item, model=case.model, **shared) for case, item in zip(ground.cases, surveys, strict=True))
        return cls(config, ground, tuple(own))


def read_ground(config: StrategiesConfig, like: Ground | None = None) -> Ground:
    """Read what strategies are planned with.

    Parameters
    ----------
    config : StrategiesConfig
    like : Ground, optional
        That of the same strategies and the same instrument: their models are taken from there.

    Raises
    ------
    InputError
        For a preset, file, band or star that does not exist, a population without an occurrence rate, or if the visits
        made so far leave no time at all.
    """
    universe = config.universe
    pointing = load_visibility(universe.visibility)
    _check_rolls(config, pointing)
    catalogue = as_catalogue(universe.catalog)
    instrument = universe.made_instrument() if like is None else like.instrument
    known = known_table(universe)
    strategies = [item.name for item in config.strategies]
    log = _checked(read_log(universe.observed, strategies), catalogue, instrument) if universe.observed else None
    if log is not None and log.until_mjd > mjd_of(universe.start_utc) + universe.slot_days * (universe.n_slots - 1):
        hint = f"none of its {universe.duration_days:g} days is left"
        allowed = "visits that leave a part of the survey"
        raise InputError("universe.observed", log.provenance, allowed=allowed, hint=hint)
    cases = []
    for number, strategy in enumerate(config.strategies):
        if strategy.population is not None:
            occurrence(strategy.population)
        if like is None:
            logged = () if log is None else [visit.setting.band for visit in log.visits]
            bands = tuple(dict.fromkeys((*strategy.visit.bands, *strategy.follow_up.bands, *logged)))
            model = assumed_model(instrument, strategy, bands)
        else:
            model = like.cases[number].model
        cuts = strategy.targets
        targets = rank_sample(
            catalog=catalogue,
            v_mag_max=cuts.v_mag_max,
            dwarfs_only=cuts.dwarfs_only,
            singles_only=cuts.singles_only,
            date_utc=universe.date_utc or universe.start_utc,
        )
        left = strategy if log is None else _without(strategy, log.hours)
        cases.append(Case(left, model, *chosen_stars(strategy, targets, known)))
    reach = [reach_au(case.model, 1.0) for case in cases]
    edges = min(low for low, _ in reach), max(high for _, high in reach)
    return Ground(universe, catalogue, instrument, pointing, known, log, tuple(cases), edges)


def prepare(config: StrategiesConfig, *, advance: Advance = untold) -> Prepared:
    """Screen the catalogue, make the calendar, and schedule every strategy.

    Parameters
    ----------
    config : StrategiesConfig
    advance : Advance
        Told about every strategy that is planned.

    Raises
    ------
    InputError
        For a preset, file, band or star that does not exist, or a population without an occurrence rate.
    """
    ground = read_ground(config)
    plans = plan_states((ground,), tuple(range(len(config.strategies))), progress=advance)
    return Prepared.of(config, ground, [survey for (survey,) in plans])


def plan_states(
    grounds: tuple[Ground, ...], which: tuple[int, ...], *, progress: Advance = untold
) -> list[list[Survey]]:
    """Work on one task: plan strategies in several states of what is known, the first with bounds on its schedules.

    What a change of the facts leaves as it was is worked out once: screening, calendar, and what visits show. That is
    worked out star after star for all strategies and states, so that where planets stand is held for one star alone.

    Parameters
    ----------
    grounds : tuple of Ground
        Of the same survey, its calendar and its seed.
    which : tuple of int
        Positions of the strategies.
    progress : Advance
        Told about every strategy that is planned.
    """
    first = grounds[0]
    universe, sky = first.universe, PlanningSky(first.universe.seed, first.reach_arcsec)
    every = [_screened([ground.cases[number] for ground in grounds], universe.seed, sky) for number in which]
    stars, rows = Targets.distinct([item.targets.select(item.rows) for states in every for item in states])
    stars = stars if len(stars) else first.cases[0].targets.select([0])  # of which no slot is used
    calendar, close = make_calendar(universe, first.instrument, first.pointing, stars), iter(rows)
    plans = [
        [_Looked.of(ground, item, calendar.select(next(close))) for ground, item in zip(grounds, states, strict=True)]
        for states in every
    ]
    by_star: dict[str, list[tuple[_Looked, Outlook]]] = {}
    for plan in itertools.chain.from_iterable(plans):
        for star in plan.stars:
            by_star.setdefault(str(star.host.star.name[0]), []).append((plan, star))
    for name, each in by_star.items():
        announce(f"where planets of {name} stand, and what visits show of them")
        for plan, star in each:
            who = plan.screened.strategy, plan.screened.model, star.host, star.looks
            plan.ways[star.index] = sky.ways(*who, plan.calendar.start_mjd)
    found = []
    for states in plans:
        found.append([_scheduled(plan, sky, bounded=plan.ground is first) for plan in states])
        progress(f"{states[0].screened.strategy.name}: plan", len(states))
    return found


class _Looked(NamedTuple):
    """A strategy in a state of what is known, with the stars that it may visit; ``calendar`` is that of close looks."""

    ground: Ground
    screened: Screened
    calendar: Calendar
    stars: list[Outlook]
    ways: dict[int, Ways]

    @classmethod
    def of(cls, ground: Ground, screened: Screened, calendar: Calendar) -> "_Looked":
        """Return the same with the stars of a close look, whose whole calendar is given."""
        if ground.log is not None:
            calendar = calendar.closed_before(ground.log.until_mjd)
        return cls(ground, screened, calendar, outlooks(screened, calendar, ground.known, ground.log), {})


def _screened(cases: Sequence[Case], seed: int, sky: PlanningSky) -> list[Screened]:
    """Return one strategy in several states of what is known, each star screened once."""
    targets, rows = Targets.distinct([item.targets for item in cases])
    every_star = screen(cases[0].strategy, cases[0].model, targets, ((),) * len(targets), seed, sky)
    return [every_star.select(own, item.known_rows) for own, item in zip(rows, cases, strict=True)]


def planned(configs: Sequence[StrategiesConfig], grounds: tuple[Ground, ...], runner: Runner[Any]) -> list[Prepared]:
    """Return surveys in several states of what is known: a task for each strategy, in all of them.

    Parameters
    ----------
    configs : sequence of StrategiesConfig
        The same strategies in each state.
    grounds : tuple of Ground
        What each is planned with.
    runner : Runner

    Notes
    -----
    Plans are kept in no folder: they are made again in less time than it takes to write them down in a form of its own.
    """
    strategies, every = configs[0].strategies, range(len(configs[0].strategies))
    # The longest first, so that no worker is left with one at the end; some together where there is one process.
    order = sorted(every, key=lambda which: _size(strategies[which]), reverse=True)
    step = _TOGETHER if in_this_process(len(order), runner.workers, runner.scheduler) else 1
    parts = [tuple(order[first : first + step]) for first in every[::step]]
    named = [", ".join(strategies[which].name for which in part) for part in parts]
    tasks = [
        Task(f"plan {name}", (part,), f"{name}: plan", len(grounds) * len(part))
        for part, name in zip(parts, named, strict=True)
    ]
    bodies = runner.finish(plan_states, tasks, common=(grounds,), kept=False, tells=True)
    plans = dict(zip(itertools.chain(*parts), itertools.chain(*bodies.values()), strict=True))
    of_states = zip(*(plans[which] for which in every), strict=True)
    return [Prepared.of(*state) for state in zip(configs, grounds, of_states, strict=True)]


def _size(strategy: SurveyStrategy) -> tuple[int, int]:
    """Return how much there is to plan: ways to visit a star, and visits of it."""
    return len(strategy.visit.bands) * len(strategy.visit.time_s), strategy.revisits.max_visits


def _scheduled(plan: _Looked, sky: PlanningSky, *, bounded: bool) -> Survey:
    """Return a strategy planned; ``bounded`` if the bound on its schedule is told."""
    ground, item, calendar = plan.ground, plan.screened, plan.calendar
    strategy, model, names = item.strategy, item.model, item.targets.name
    limits = StarLimits.of(names.tolist(), ground.universe.exclusions, ground.known)
    found = candidates(item, calendar, sky, limits, plan.stars, plan.ways)
    problem = Problem(strategy, tuple(found), calendar.slot_h)
    schedule = make_schedule(problem, bounded=bounded)
    rows = np.array([star.index for star in found], np.int64)
    targets, options = item.targets.select(rows), tuple(star.options for star in found)
    noise, background = alarms(ground.universe, strategy, model, targets, options)
    return Survey(
        strategy=strategy,
        model=model,
        targets=targets,
        calendar=calendar.select(np.searchsorted(item.rows, rows)),
        options=options,
        follow=_follow_ups(strategy, model, targets, sky),
        schedule=replace(schedule, visits=with_odds(problem, schedule.visits)),
        known=ground.known,
        known_rows=tuple(star.known_rows for star in found),
        limits=StarLimits.of(targets.name.tolist(), ground.universe.exclusions, ground.known),
        noise_alarms=noise,
        background_alarms=background,
        log=ground.log,
    )


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
    """Return the log with the catalogue's names of its stars; refuse by row without such a star or band."""
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


def _without(strategy: SurveyStrategy, hours: float) -> SurveyStrategy:
    """Return the strategy with the time that is left of its budget."""
    budget_h = strategy.time_budget_h
    if budget_h <= hours:
        raise InputError(
            "time_budget_h",
            budget_h,
            unit="h",
            allowed=f"more than the {hours:g} h of the observation log",
            hint=f"strategy {strategy.name}",
        )
    return strategy.model_copy(update={"time_budget_h": budget_h - hours})


def _follow_ups(
    strategy: SurveyStrategy, model: EtcModel, targets: Targets, sky: PlanningSky
) -> tuple[tuple[Setting, ...], ...]:
    """Return the follow-up settings of each star, one a band."""
    rule = strategy.follow_up
    if not rule.wanted or not len(targets):
        return ((),) * len(targets)
    visit = VisitRule(bands=rule.bands, time_s=(rule.time_s,))
    by_band = [sky.settings(model, targets, band, visit, rule.time_s) for band in rule.bands]
    return tuple(zip(*by_band, strict=True))
