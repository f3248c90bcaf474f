"""Rank, confirm the best targets with images, and write the products: the job of ``cpic plan``.

Targets are the first of the ranking that are seen in the period of the plan, or those of a schedule. What the period
takes of the telescope's time is said beside them.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from catalogs import Catalogue
from cpic_core import InputError, Record, announce, dump_json
from cpic_planner import results
from cpic_planner.confirm import scene
from cpic_planner.etc import EtcModel, build_model
from cpic_planner.jobs import Cost, Job, RunFolder, Runner, RunSettings, run
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import DEFAULT_YEARS, MAX_VISITS, PlanQuestion, observed_utc
from cpic_planner.ranking import KnownChoice, asked_stars, rank_targets, rank_under, timed_model, with_own
from cpic_planner.ranking.known_answer import known_answer
from cpic_planner.ranking.sensitivity import sensitivity
from cpic_planner.results import ConfirmedTarget, LeftOutRow, PeriodRecord, RankedTarget, RankResult, SeenRow
from cpic_planner.survey import ScheduledVisit, Sight, VisitRule, read_schedule
from cpic_planner.survey.visibility import BLOCKS, Visibility, load_visibility, seasons_of, visibility
from cpic_planner.targets import CatalogSource, Targets, as_catalogue, find_target
from cpic_planner.validation import ConfirmTask, confirm_task

_SHOWN, _KNOWN_DRAWS = 50, 500
"""Stars of the ranking whose known planets are shown, and draws of each planet."""
_OF_RANKING = ("catalogue", "sample", "notes", "date_utc", "n_in_catalogue", "counts", "counts_limited_by")
"""Fields of a plan that its ranking has."""
_RANK_S, _REPORT_S = 2.8e-3, 8.0  # of a star in a band, other assumptions included
_NEAR, _ROUGH, _STAND_INS = 40, 200, 4


class _Prepared(Record):
    """Ranking and the work that is left to do; either the period or the schedule says which targets there are."""

    model: EtcModel
    catalogue: Catalogue
    targets: Targets
    drawn: PopulationChoice | KnownChoice
    rank: results.RankResult
    chosen: list[results.RankedTarget]
    tasks: list[ConfirmTask]
    refused: dict[str, results.BandConfirmation]
    period: results.PeriodRecord | None
    schedule: results.ScheduleImages | None
    rolls_deg: dict[str, float]
    sights: dict[str, Sight]


def prepare_plan(config: PlanQuestion, catalog: CatalogSource) -> _Prepared:
    """Return the ranking and the work that is left to do, without any image.

    Parameters
    ----------
    config : PlanQuestion
    catalog : CatalogSource
        Star table: ``snapshot``, ``latest``, ``simbad_2012``, or a file.
    """
    listed, source = ((), "") if config.schedule is None else read_schedule(config.schedule, config.schedule_strategy)
    bands = config.bands if config.schedule is None else _bands(config, listed)
    model, time_s = timed_model(build_model(config.instrument, bands, config.strategy), config)
    catalogue = as_catalogue(catalog)
    stars = asked_stars(config, catalogue)
    rank = rank_under(
        model,
        stars.targets,
        config.drawn_instruments,
        time_s=time_s,
        planet=config.planet,
        population=stars.counted,
        score=config.score,
        chosen=stars.chosen,
        sample=stars.text,
        catalogue=catalogue.provenance,
    ).model_copy(update={"notes": list(stars.notes)})
    rank = with_own(rank, catalogue.table)
    ready = _Prepared(model, catalogue, stars.answered, stars.counted, rank, [], [], {}, None, None, {}, {})
    if config.schedule is not None:
        return _of_schedule(config, ready, listed, source)
    chosen, period, sights = seen_stars(config, rank, model)
    each = [_star(ready, row) for row in chosen]
    tasks, refused = scene.plan_tasks(model, each, chosen, time_s=time_s, planet=config.planet, **config.image_settings)
    return replace(ready, chosen=chosen, tasks=tasks, refused=refused, period=period, sights=sights)


def _star(ready: _Prepared, row: results.RankedTarget, roll_deg: float = 0.0) -> Targets:
    index = int(np.flatnonzero(ready.targets.name == row.name)[0])
    return replace(ready.targets.select([index]), roll_deg=roll_deg)


def _bands(config: PlanQuestion, listed: Sequence[ScheduledVisit]) -> tuple[str, ...]:
    """Return the bands of the instrument that a schedule names."""
    known = tuple(config.instrument.bands)
    found = tuple(band for band in known if any(visit.setting.band == band for visit in listed))
    if not found:
        bands = ", ".join(dict.fromkeys(visit.setting.band for visit in listed))
        raise InputError("schedule", bands, allowed=f"visits in {', '.join(known)}")
    return found


def _of_schedule(config: PlanQuestion, ready: _Prepared, listed: Sequence[ScheduledVisit], source: str) -> _Prepared:
    """Return the visits of a schedule: those of one star and band are one programme, in the frames of the first."""
    programmes: dict[str, dict[str, list[ScheduledVisit]]] = {}
    refused_rows: list[results.NotImagedRow] = []
    rows = {row.name: row for row in ready.rank.targets}

    def refuse(visit: ScheduledVisit, message: str) -> None:
        band = visit.setting.band
        refused_rows.append(results.NotImagedRow(row=visit.row, star=visit.star, band=band, message=message))

    for visit in listed:
        try:
            name = str(find_target(visit.star, catalog=ready.catalogue)[0].name[0])
        except InputError:
            refuse(visit, "no star of the catalogue has this name")
            continue
        message = scene.why_not_imaged(config, visit)
        if message or name not in rows:
            refuse(visit, message or "the star is not among those that are ranked")
            continue
        mine = programmes.setdefault(name, {}).setdefault(visit.setting.band, [])
        first = mine[0] if mine else visit
        if visit.setting.frames != first.setting.frames:
            refuse(visit, f"its frames are not those of row {first.row}, with which it would be reduced")
        elif sum(item.visits for item in mine) + visit.visits > MAX_VISITS:
            refuse(visit, f"more than {MAX_VISITS} visits of one star and band")
        else:
            mine.append(visit)
    if not programmes:
        hint = f"row {refused_rows[0].row}: {refused_rows[0].message}"
        raise InputError("schedule", source, allowed="visits that can be imaged", hint=hint)
    names = list(programmes)[: config.top]
    chosen = [rows[name] for name in names]
    rolls = {name: scene.first_roll_deg(programmes[name]) for name in names}
    stars = {name: _star(ready, rows[name], rolls[name]) for name in names}
    prepared = [
        [
            scene.programme_task(ready.model, star, band, own, planet=config.planet, **config.image_settings)
            for band, own in programmes[name].items()
        ]
        for name, star in stars.items()
    ]
    tasks, refused = scene.tasks_of(chosen, prepared)
    for name in names:
        for band, own in programmes[name].items():
            if answer := refused.get(f"{name} {band}"):
                for visit in own:
                    refuse(visit, answer.message)
    imaged = [own for name in names for band, own in programmes[name].items() if f"{name} {band}" not in refused]
    record = results.ScheduleImages(
        source=source,
        n_visits=len(listed),
        n_imaged=sum(map(len, imaged)),
        n_stars=len(programmes),
        not_imaged=sorted(refused_rows, key=lambda row: row.row),
    )
    return replace(ready, chosen=chosen, tasks=tasks, refused=refused, schedule=record, rolls_deg=rolls)


def plan_job(config: PlanQuestion, catalog: CatalogSource = "snapshot") -> Job[results.PlanResult]:
    """Return the job that ranks, confirms and reports.

    Parameters
    ----------
    config : PlanQuestion
    catalog : Catalogue, str or Path
        Star table: ``"snapshot"``, ``"latest"``, ``"simbad_2012"``, or a file; see `catalogs.catalogue.open_catalogue`.
    """
    from cpic_planner.report import plan_products, write_report

    prepared = functools.cache(lambda: prepare_plan(config, catalog))

    def prepared_cost() -> Cost:
        ready = prepared()
        return _cost(ready.tasks, len(ready.chosen), len(ready.targets), len(ready.model.bands))

    @functools.cache
    def firmness() -> results.SensitivityResult:
        ready = prepared()
        asked: dict[str, Any] = {"time_s": config.time_s, "planet": config.planet, "score": config.score}
        return sensitivity(ready.model, ready.targets, population=ready.drawn, first=config.top, **asked)

    def work(runner: Runner[Any]) -> results.PlanResult:
        bodies = runner.finish(confirm_task, scene.image_tasks(prepared().tasks))
        return _result(config, prepared(), runner.digest, bodies, firmness())

    def write(folder: RunFolder, plan: results.PlanResult, bodies: Mapping[str, Any]) -> None:
        ready = prepared()
        firm = firmness()
        known = _known(config, ready)
        announce("writing the report")
        folder.write("sensitivity.json", dump_json(firm.model_dump(mode="json")))
        if known is not None:
            folder.write("known.json", dump_json(known.model_dump(mode="json")))
        images = {(task.name, task.band): bodies[task.key] for task in ready.tasks}
        write_report(folder, plan, ready.rank, ready.model, images, ready.targets, firm, known)

    return Job(
        kind="plan",
        results=scene.RESULT_VERSION,
        decides=lambda: _decides(config, prepared()),
        decides_parts=lambda: _decides_images(config, prepared()),
        work=work,
        write=write,
        products=("sensitivity.json", "known.json", *plan_products(config.instrument.bands)),
        cost=lambda: _expected_cost(config, catalog) if config.schedule is None else prepared_cost(),
    )


def make_plan(
    config: PlanQuestion, out: str | Path, *, catalog: CatalogSource = "snapshot", **how: Unpack[RunSettings]
) -> Runner[results.PlanResult]:
    """Rank, confirm and report.

    Parameters
    ----------
    config, catalog
        As of `plan_job`.
    out : str or Path
        Output folder; resumed when it holds work of the same configuration, for more or fewer targets too.
    **how
        As of `cpic_planner.jobs.job.run`.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    return run(plan_job(config, catalog), out, **how)


def _known(config: PlanQuestion, ready: _Prepared) -> results.KnownResult | None:
    """Return the known planets of the first stars of the ranking and their next windows; None where these have none."""
    choice, first = ready.drawn, {row.name for row in ready.rank.targets[:_SHOWN]}
    if not isinstance(choice, KnownChoice):
        where = "snapshot", config.date_utc, config.planet.albedo, config.instrument
        choice = KnownChoice.at(*where, n_draws=_KNOWN_DRAWS, seed=config.seed)
    hosts = [i for i, name in enumerate(ready.targets.name.tolist()) if name in first and choice.table.rows_of(name)]
    if not hosts:
        return None
    stars, catalogue = ready.targets.select(hosts), ready.rank.catalogue
    found = known_answer(ready.model, stars, choice, years=DEFAULT_YEARS, catalogue=catalogue)
    return found.model_copy(update={"planets": [row.model_copy(update={"track": None}) for row in found.planets]})


def _decides(config: PlanQuestion, prepared: _Prepared) -> dict[str, Any]:
    """Return what decides the plan: configuration, ranking, catalogue.

    A table from a file counts by its content, which is in the hash of the ranking, not by its name.
    """
    rank, catalogue = prepared.rank, prepared.catalogue
    limit = catalogue.ranked_v_mag if config.v_mag_max is None else config.v_mag_max
    return {
        "config": config.hashed() | {"v_mag_max": limit},
        "rank": rank.config_hash,
        "catalogue": rank.catalogue if catalogue.kind == "snapshot" else catalogue.kind,
        "period": None if prepared.period is None else prepared.period.model_dump(mode="json"),
        "schedule": None if prepared.schedule is None else prepared.schedule.model_dump(mode="json"),
    }


def _decides_images(config: PlanQuestion, prepared: _Prepared) -> dict[str, Any]:
    """Return what decides the images of every target, however many targets there are: `_decides` without that."""
    decides, schedule = _decides(config, prepared), prepared.schedule
    seen = {"n_days": config.n_days, "pointing": load_visibility(config.limits).content()} if schedule is None else None
    return decides | {
        "config": {name: value for name, value in decides["config"].items() if name != "top"},
        "period": seen,
        "schedule": None if schedule is None else schedule.source,
    }


def _result(
    config: PlanQuestion, prepared: _Prepared, digest: str, bodies: Mapping[str, Any], firm: results.SensitivityResult
) -> results.PlanResult:
    rank, model, reference = prepared.rank, prepared.model, config.strategy.reference_star
    extremes = {star.name: star.model_dump(include={"rank_lowest", "rank_highest"}) for star in firm.stars}
    targets = []
    for row in prepared.chosen:
        target = scene.confirmed_target(model, row, prepared.refused, bodies, roll_deg=prepared.rolls_deg.get(row.name))
        target = with_telescope_time(target, model, prepared.sights)
        targets.append(target.model_copy(update=extremes.get(row.name)))
    return results.PlanResult(
        **scene.result_header(config, digest, [band for target in targets for band in target.bands]),
        time_s=config.time_s,
        companions=config.companions,
        reference_planet=results.ReferencePlanetRecord.of(config.planet, albedo=config.planet.albedo.label),
        reference_star_v_mag=None if reference is None else reference.v_mag,
        reference_star_teff_k=None if reference is None else reference.teff_k,
        n_ranked=len(rank.targets),
        **{name: getattr(rank, name) for name in _OF_RANKING},
        period=prepared.period,
        schedule=prepared.schedule,
        targets=targets,
    )


def _cost(tasks: Sequence[ConfirmTask], n_targets: int, n_ranked: int, n_bands: int) -> Cost:
    """Return the cost of images, and of ranking the stars, under other assumptions too, and of the report."""
    cost = scene.images_cost(tasks, n_targets=n_targets)
    return replace(cost, start_s=cost.start_s + _RANK_S * n_ranked * n_bands + _REPORT_S)


def _expected_cost(config: PlanQuestion, catalog: CatalogSource) -> Cost:
    """Return the cost of the targets that a rough ranking of the nearest stars has first, some standing for others."""
    model, time_s = timed_model(build_model(config.instrument, config.bands, config.strategy), config)
    stars = asked_stars(config, as_catalogue(catalog)).answered
    n_targets = min(config.top, len(stars))
    near = stars.select(np.argsort(stars.distance_pc, kind="stable")[: _NEAR + 3 * n_targets])
    rough = PopulationChoice(config.population, _ROUGH)
    ranked = rank_targets(model, near, time_s=time_s, planet=config.planet, population=rough).targets[:n_targets]
    rows = ranked[:: max(-(-len(ranked) // _STAND_INS), 1)]
    alone = [near.select(near.name == row.name) for row in rows]
    settings: dict[str, Any] = config.image_settings
    tasks, _ = scene.plan_tasks(model, alone, rows, time_s=time_s, planet=config.planet, **settings)
    own = [[task for task in tasks if task.name == row.name] for row in rows]
    every = [task for i in range(n_targets) for task in own[i * len(own) // n_targets]]
    return _cost(every, n_targets, len(stars), len(model.bands))


_CHUNK = 20
_BLOCKED = {
    "sun": "too near to the Sun",
    "moon": "too near to the Moon",
    "panel": "the solar panels get no light",
    "limb": "behind the limb of the Earth",
}


def seen_stars(
    config: PlanQuestion, rank: RankResult, model: EtcModel
) -> tuple[list[RankedTarget], PeriodRecord, dict[str, Sight]]:
    """Return the first stars of the ranking that can be observed in the period, those left out, how each is seen."""
    pointing, orbit = load_visibility(config.limits), config.instrument.mission.orbit
    when: dict[str, Any] = {"start_utc": observed_utc(config), "n_days": config.n_days}
    chosen: list[RankedTarget] = []
    left_out: list[LeftOutRow] = []
    not_checked: list[str] = []
    seen: list[SeenRow] = []
    sights: dict[str, Sight] = {}
    waiting = [row for row in rank.targets if row.status != "saturated"]
    while waiting and len(chosen) < config.top:
        some, waiting = waiting[:_CHUNK], waiting[_CHUNK:]
        placed = [row for row in some if row.ra_deg is not None and row.dec_deg is not None]
        ra, dec = (np.array([getattr(row, name) for row in placed], float) for name in ("ra_deg", "dec_deg"))
        found = visibility(ra, dec, pointing, orbit, **when) if placed else None
        for row in some:
            if len(chosen) >= config.top:
                break
            if found is None or row not in placed:
                not_checked.append(row.name)
                chosen.append(row)
                continue
            at = placed.index(row)
            reason = _unseen(found, at, row, model)
            if reason is None:
                chosen.append(row)
                seen.append(SeenRow(name=row.name, usable_h=_usable_h(found, at), seasons=seasons_of(found, at)))
                sights[row.name] = Sight.of(found, at, pointing)
            else:
                left_out.append(reason)
    found_as: dict[str, Any] = {"seen": seen, "left_out": left_out, "not_checked": not_checked}
    return chosen, PeriodRecord(**when, pointing=pointing.name, **found_as), sights


def with_telescope_time(target: ConfirmedTarget, model: EtcModel, sights: Mapping[str, Sight]) -> ConfirmedTarget:
    """Return a target with the telescope time of its observation in each band, and of the least one that detects.

    A visit has as many slews as one of a survey that says nothing else. Without a sight of the star nothing is known.

    Parameters
    ----------
    target : ConfirmedTarget
    model : EtcModel
    sights : mapping of str to Sight
        Of `seen_stars`, by the names of stars.
    """
    sight = sights.get(target.name)

    def hours(time_s: float | None, exposure_s: float | None, visits: int | None, band: str) -> float | None:
        if sight is None or time_s is None or exposure_s is None:
            return None
        frame_s = exposure_s + model.camera(band).readout_s
        found = float(sight.telescope_h(time_s, frame_s, (visits or 1) * VisitRule().settlings))
        return found if np.isfinite(found) else None

    bands = [
        band.model_copy(update={"telescope_h": hours(band.time_s, band.exposure_s, band.visits, band.band)})
        for band in target.bands
    ]
    star = target.ranked
    least_h = hours(star.detection_time_s, star.exposure_s, star.detection_visits, star.band)
    return target.model_copy(update={"bands": bands, "detection_telescope_h": least_h})


def _usable_h(found: Visibility, at: int) -> float:
    return float(found.visible_fraction[at].sum()) * 24.0 * found.step_days


def _unseen(found: Visibility, at: int, row: RankedTarget, model: EtcModel) -> LeftOutRow | None:
    """Return why a star cannot have its best observation in the period; None where it can."""
    n_days = len(found.mjd) * found.step_days
    usable_h = _usable_h(found, at)
    needed_h = None if row.time_s is None else row.time_s / 3600.0
    frame_s = (row.exposure_s or 0.0) + model.camera(row.band).readout_s
    longest_s = float(found.window_s[at].max())
    if usable_h <= 0.0:
        days = found.days(at)
        why = ", ".join(f"{_BLOCKED[name]} for {days[name]:g} d" for name in BLOCKS if name and days[name])
        message = f"not seen in {n_days:g} d: {why}"
    elif needed_h is not None and usable_h < needed_h:
        message = f"seen for {usable_h:.1f} h in {n_days:g} d, and its observation takes {needed_h:.1f} h"
    elif longest_s < frame_s:
        message = f"never seen for the {frame_s:.0f} s of a frame without a break: {longest_s:.0f} s at most"
    else:
        return None
    return LeftOutRow(name=row.name, rank=row.rank, usable_h=usable_h, needed_h=needed_h, message=message)
