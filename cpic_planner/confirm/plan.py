"""Confirmation of whole targets: which images to make of a star, and what they say together.

The main job: rank, confirm the best targets with images, write the products.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from catalogs import Catalogue
from cpic_core import InputError, announce, dump_json
from cpic_planner.etc import EtcModel, build_model
from cpic_planner.jobs import Cost, Finished, Job, RunFolder, Runner, RunSettings, Task, run
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import (
    ImageQuestion,
    PlanQuestion,
    ReferencePlanet,
    SimulatorOverrides,
    audited,
    observed_utc,
    refuse_counting,
)
from cpic_planner.ranking import (
    KNOWN_ONLY,
    KnownChoice,
    counted_planets,
    planet_record,
    rank_targets,
    rank_under,
    timed_model,
)
from cpic_planner.ranking.sensitivity import sensitivity
from cpic_planner.results import BandConfirmation, ConfirmedTarget, PlanResult, RankedTarget, RankResult
from cpic_planner.targets import CatalogSource, Targets, as_catalogue, rank_sample, sample_text
from cpic_planner.validation import (
    ConfirmTask,
    ImageSettings,
    calibrate,
    confirm_task,
    images_of,
    prepare_task,
    refusals_of,
    significant_at_place,
    target_verdict,
    task_cost,
)
from cpic_planner.version import __version__
from simulator.config import Instrument
from simulator.ledger import not_modelled

RESULT_VERSION = 5
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""


def result_header(config: ImageQuestion, digest: str, measured: Sequence[BandConfirmation]) -> dict[str, Any]:
    """Return what every result of images says of itself.

    Parameters
    ----------
    config : ImageQuestion
    digest : str
        Hash of everything that decides the result.
    measured : sequence of BandConfirmation
        What the ratio of recovered and predicted SNR is taken over.
    """
    mean = calibrate(measured)
    return {
        "version": __version__,
        "config_hash": digest,
        "seed": config.seed,
        "fidelity": config.dial.fidelity,
        "tolerance": config.dial.tolerance,
        "instrument": config.instrument.name,
        "sigma": config.strategy.sigma,
        "reference_library": config.strategy.library,
        "rdi_modes": config.strategy.n_modes,
        "realisations": config.realisations,
        "simulator_overrides": config.simulator_overrides.as_mapping(),
        "calibration": vars(mean),
        "calibration_text": mean.text,
        "not_modelled": not_modelled(images_of(config.instrument)),
    }


def refuse_infrared(instrument: Instrument, bands: Sequence[str] | None) -> None:
    """Refuse unknown bands, and those of the near-infrared camera, whose images are not measured.

    Parameters
    ----------
    instrument : Instrument
    bands : sequence of str or None
        Names of bands of the instrument.
    """
    visible = instrument.visible_bands()
    for band in bands or ():
        instrument.band(band)
        if band not in visible:
            hint = "images of the near-infrared camera are simulated, not yet measured"
            raise InputError("band", band, allowed=", ".join(visible), hint=hint)


def plan_tasks(
    model: EtcModel,
    stars: Sequence[Targets],
    rows: Sequence[RankedTarget],
    *,
    time_s: float,
    planet: ReferencePlanet,
    overrides: SimulatorOverrides | None = None,
    **settings: Unpack[ImageSettings],
) -> tuple[list[ConfirmTask], dict[str, BandConfirmation]]:
    """Return work to do, and the bands that need none because the answer is already a refusal, by their keys.

    Where the dial has audits, the band of each target that promises most gets one: a realisation frame by frame.

    Parameters
    ----------
    model : EtcModel
    stars : sequence of Targets
    rows : sequence of RankedTarget
        The row of each star in the ranking.
    time_s : float
        Wall time, s, overheads and reference frames included.
    planet : ReferencePlanet
    overrides : SimulatorOverrides, optional
        What the images have otherwise.
    **settings
        `cpic_planner.validation.task.ImageSettings`; at least the seed.
    """
    tasks: list[ConfirmTask] = []
    refused: dict[str, BandConfirmation] = {}
    for star, row in zip(stars, rows, strict=True):
        own = []
        for band in model.bands:
            ready = prepare_task(model, star, band, time_s=time_s, planet=planet, overrides=overrides, **settings)
            answers = [ready] if isinstance(ready, BandConfirmation) else refusals_of(ready)
            if isinstance(ready, ConfirmTask) and not answers:
                own.append(ready)
            else:
                refused[f"{row.name} {band}"] = answers[0]
        margins = [task.predictions[0]["significance"] / task.predictions[0]["threshold"] for task in own]
        best = margins.index(max(margins)) if own else None
        tasks.extend(replace(task, audit=i == best and audited(task.dial)) for i, task in enumerate(own))
    return tasks, refused


def image_tasks(tasks: Sequence[ConfirmTask]) -> list[Task]:
    """Return tasks of `cpic_planner.validation.confirm.confirm_task`."""
    return [Task(task.key, (task.to_dict(),)) for task in tasks]


def images_cost(tasks: Sequence[ConfirmTask], **counts: float) -> Cost:
    """Return the expected cost of simulating and measuring tasks, see `cpic_planner.validation.modelling`."""
    costs = [task_cost(task) for task in tasks]
    images = {
        "n_tasks": len(tasks),
        "n_realisations": sum(cost.realisations for cost in costs),
        "n_frames": sum(cost.frames for cost in costs),
    }
    return Cost(
        counts=counts | images,
        times_s=[cost.work_s for cost in costs],
        start_s=4.0,
        memory_mb=max((cost.memory_mb for cost in costs), default=0.0),
        disk_mb=1.0 + 0.35 * len(tasks),
    )


def confirm_stars(
    model: EtcModel,
    stars: Sequence[Targets],
    *,
    time_s: float,
    planet: ReferencePlanet,
    workers: int = 1,
    overrides: SimulatorOverrides | None = None,
    **settings: Unpack[ImageSettings],
) -> list[ConfirmedTarget]:
    """Confirm single stars without an output folder; see `cpic_planner.confirm_targets`.

    Parameters
    ----------
    model : EtcModel
    stars : sequence of Targets
    time_s : float
        Wall time, s, overheads and reference frames included.
    planet : ReferencePlanet
    workers : int, optional
        Local worker processes; the result does not depend on it.
    overrides : SimulatorOverrides, optional
        What the images have otherwise.
    **settings
        `cpic_planner.validation.task.ImageSettings`; at least the seed.
    """
    refuse_counting(model.strategy)
    refuse_infrared(model.instrument, model.bands)
    rows = [rank_targets(model, star, time_s=time_s, planet=planet).targets[0] for star in stars]
    tasks, refused = plan_tasks(model, stars, rows, time_s=time_s, planet=planet, overrides=overrides, **settings)
    bodies = Runner(workers=workers).finish(confirm_task, image_tasks(tasks))
    return [confirmed_target(model, row, refused, bodies) for row in rows]


def confirmed_target(
    model: EtcModel, row: RankedTarget, refused: Mapping[str, BandConfirmation], bodies: Mapping[str, Mapping[str, Any]]
) -> ConfirmedTarget:
    """Return one target's bands in order, and the best of them, from refusals and bodies by the keys of tasks.

    Parameters
    ----------
    model : EtcModel
    row : RankedTarget
    refused : mapping of str to BandConfirmation
        Bands that need no images, by star and band.
    bodies : mapping of str to mapping
        Results of the images, by star and band.
    """
    bands = [
        BandConfirmation.model_validate(bodies[key]["confirmations"][0]) if key in bodies else refused[key]
        for key in (f"{row.name} {band}" for band in model.bands)
    ]

    def margin(band: BandConfirmation) -> float:
        return (band.predicted_significance or 0.0) / (band.threshold or np.inf)

    # A few realisations rank bands by chance where they are close: the images veto, the prediction orders.
    blind = [band for band in bands if band.detected]
    best = max(blind or [band for band in bands if significant_at_place(band)], key=margin, default=None)
    verdict, factor, error = target_verdict(bands)
    return ConfirmedTarget.of(
        row,
        ranked=row,
        planet_distance_au=row.ref_planet_distance_au,
        chosen_band=best.band if best else None,
        verdict=verdict,
        etc_ratio=factor,
        etc_ratio_error=error,
        bands=bands,
    )


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
    model, time_s = timed_model(build_model(config.instrument, config.bands, config.strategy), config)
    catalogue = as_catalogue(catalog)
    targets = rank_sample(
        catalog=catalogue,
        companions=config.companions,
        date_utc=observed_utc(config),
        v_mag_max=config.v_mag_max,
        dwarfs_only=config.dwarfs_only,
        singles_only=config.singles_only,
    )
    drawn = counted_planets(config)
    sample = sample_text(
        catalogue,
        v_mag_max=config.v_mag_max,
        dwarfs_only=config.dwarfs_only,
        singles_only=config.singles_only,
    )
    if isinstance(drawn, KnownChoice):
        targets = drawn.stars(targets)
        sample = f"{sample}; {KNOWN_ONLY}"
    rank = rank_under(
        model,
        targets,
        config.drawn_instruments,
        time_s=time_s,
        planet=config.planet,
        population=drawn,
        score=config.score,
        sample=sample,
        catalogue=catalogue.provenance,
    )
    chosen = [row for row in rank.targets if row.status != "saturated"][: config.top]
    index = {str(name): i for i, name in enumerate(targets.name)}
    stars = [targets.select([index[row.name]]) for row in chosen]
    tasks, refused = plan_tasks(model, stars, chosen, time_s=time_s, planet=config.planet, **config.image_settings)
    return _Prepared(model, catalogue, targets, drawn, rank, chosen, tasks, refused)


def plan_job(config: PlanQuestion, catalog: CatalogSource = "snapshot") -> Job[PlanResult]:
    """Return the job that ranks, confirms and reports.

    Parameters
    ----------
    config : PlanQuestion
    catalog : Catalogue, str or Path
        Star table: ``"snapshot"``, ``"latest"``, ``"simbad_2012"``, or a file; see `catalogs.catalogue.open_catalogue`.
    """
    from cpic_planner.report import PRODUCTS, write_report

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
        **result_header(config, digest, [band for target in targets for band in target.bands]),
        time_s=config.time_s,
        companions=config.companions,
        reference_planet=planet_record(config.planet),
        catalogue=rank.catalogue,
        sample=rank.sample,
        date_utc=rank.date_utc,
        n_ranked=len(rank.targets),
        counts=rank.counts,
        counts_limited_by=rank.counts_limited_by,
        targets=targets,
    )
