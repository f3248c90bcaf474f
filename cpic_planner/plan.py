"""The main job: rank, confirm the best targets with images, write the products."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

from catalogs.catalogue import Catalogue
from cpic_planner.confirmed import (
    RESULT_VERSION,
    confirmed_target,
    image_tasks,
    images_cost,
    plan_tasks,
    refuse_infrared,
    told,
)
from cpic_planner.etc.model import EtcModel, build_model
from cpic_planner.jobs.folder import RunFolder
from cpic_planner.jobs.job import Finished, Job, Runner, RunSettings, run
from cpic_planner.known_completeness import KNOWN_ONLY, KnownChoice, counted_planets
from cpic_planner.models import BandConfirmation, PlanResult, RankedTarget, RankResult
from cpic_planner.population import PopulationChoice
from cpic_planner.queries.plan import PlanQuestion
from cpic_planner.ranking import planet_record, rank_targets
from cpic_planner.sensitivity import sensitivity
from cpic_planner.targets import CatalogSource, Targets, as_catalogue, rank_sample, sample_text
from cpic_planner.validation.confirm import confirm_task
from cpic_planner.validation.task import ConfirmTask
from simulator.files import dump_json
from simulator.work import announce


@dataclass(frozen=True)
class _Prepared:
    """Ranking and the work that is left to do."""

    model: EtcModel
    catalogue: Catalogue
    targets: Targets
    drawn: PopulationChoice | KnownChoice
    rank: RankResult
    chosen: list[RankedTarget]
    tasks: list[ConfirmTask]
    refused: dict[str, BandConfirmation]


def prepare_plan(config: PlanQuestion, catalog: CatalogSource) -> _Prepared:
    """Return the ranking and the work that is left to do, without any image.

    Parameters
    ----------
    config : PlanQuestion
    catalog : CatalogSource
        Star table: ``snapshot``, ``latest``, ``simbad_2012``, or a file.
    """
    refuse_infrared(config.instrument, config.bands)
    model = build_model(config.instrument, config.bands, config.strategy)
    catalogue = as_catalogue(catalog)
    targets = rank_sample(
        catalog=catalogue,
        v_mag_max=config.v_mag_max,
        dwarfs_only=config.dwarfs_only,
        singles_only=config.singles_only,
        companions=config.companions,
    )
    drawn = counted_planets(config)
    sample = sample_text(catalogue, config.v_mag_max, config.dwarfs_only, config.singles_only)
    if isinstance(drawn, KnownChoice):
        targets, sample = drawn.stars(targets), f"{sample}; {KNOWN_ONLY}"
    rank = rank_targets(
        model,
        targets,
        time_s=config.time_s,
        planet=config.planet,
        population=drawn,
        score=config.score,
        sample=sample,
        catalogue=catalogue.provenance,
    )
    chosen = [row for row in rank.targets if row.status != "saturated"][: config.top]
    index = {str(name): i for i, name in enumerate(targets.name)}
    stars = [targets.select([index[row.name]]) for row in chosen]
    tasks, refused = plan_tasks(
        model, stars, chosen, time_s=config.time_s, planet=config.planet, **config.image_settings
    )
    return _Prepared(model, catalogue, targets, drawn, rank, chosen, tasks, refused)


def plan_job(config: PlanQuestion, catalog: CatalogSource = "snapshot") -> Job[PlanResult]:
    """Return the job that ranks, confirms and reports.

    Parameters
    ----------
    config : PlanQuestion
    catalog : Catalogue, str or Path
        Star table: ``"snapshot"``, ``"latest"``, ``"simbad_2012"``, or a file; see `catalogs.catalogue.open_catalogue`.
    """
    from cpic_planner.report.write import PRODUCTS, write_report

    prepared = functools.cache(lambda: prepare_plan(config, catalog))

    def work(runner: Runner) -> PlanResult:
        bodies = runner.finish(confirm_task, image_tasks(prepared().tasks))
        return _result(config, prepared(), runner.digest, bodies)

    def write(folder: RunFolder, plan: PlanResult, bodies: Mapping[str, Any]) -> None:
        ready = prepared()
        firm = sensitivity(
            ready.model,
            ready.targets,
            time_s=config.time_s,
            planet=config.planet,
            population=ready.drawn,
            score=config.score,
        )
        announce("writing the report")
        folder.write("sensitivity.json", dump_json(firm.model_dump(mode="json")))
        images = {(task.name, task.band): bodies[task.key] for task in ready.tasks}
        write_report(folder, plan, ready.rank, ready.model, images, ready.targets, sensitivity=firm)

    return Job(
        kind="plan",
        results=RESULT_VERSION,
        decides=lambda: _decides(config, prepared()),
        work=work,
        write=write,
        products=("sensitivity.json", *PRODUCTS),
        cost=lambda: images_cost(prepared().tasks, n_targets=len(prepared().chosen)),
    )


def make_plan(
    config: PlanQuestion, out: str | Path, *, catalog: CatalogSource = "snapshot", **how: Unpack[RunSettings]
) -> Finished[PlanResult]:
    """Rank, confirm and report.

    Parameters
    ----------
    config, catalog
        As of `plan_job`.
    out : str or Path
        Output folder; resumed when it holds work of the same configuration.
    **how
        As of `cpic_planner.jobs.job.run`.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    return run(plan_job(config, catalog), out, **how)


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
    }


def _result(config: PlanQuestion, prepared: _Prepared, digest: str, bodies: Mapping[str, Any]) -> PlanResult:
    rank = prepared.rank
    targets = [confirmed_target(prepared.model, row, prepared.refused, bodies) for row in prepared.chosen]
    return PlanResult(
        **told(config, digest, [band for target in targets for band in target.bands]),
        time_s=config.time_s,
        companions=config.companions,
        reference_planet=planet_record(config.planet),
        catalogue=rank.catalogue,
        sample=rank.sample,
        n_ranked=len(rank.targets),
        counts=rank.counts,
        counts_limited_by=rank.counts_limited_by,
        targets=targets,
    )
