"""The main job: rank, confirm the best targets with images, write the products."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from catalogs.catalogue import Catalogue
from catalogs.errors import InputError
from cpic_planner.confirmed import (
    RESULT_VERSION,
    ImageConfig,
    confirmed_target,
    images_cost,
    plan_tasks,
    refuse_infrared,
)
from cpic_planner.engine import run_tasks
from cpic_planner.environment import RunClock
from cpic_planner.etc.model import EtcModel, build_model
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.known_completeness import KNOWN_ONLY, KnownChoice
from cpic_planner.models import (
    BandConfirmation,
    PlanResult,
    RankedTarget,
    RankResult,
    ScoreName,
    SensitivityResult,
)
from cpic_planner.population import N_PLANETS, PopulationChoice
from cpic_planner.population_config import PopulationConfig, load_population
from cpic_planner.ranking import planet_record, rank_targets
from cpic_planner.registry.scores import DEFAULT_SCORE
from cpic_planner.runfolder import RunFolder, open_run_folder
from cpic_planner.sensitivity import sensitivity
from cpic_planner.targets import CatalogSource, Targets, as_catalogue, rank_sample, sample_text
from cpic_planner.validation.calibration import calibrate
from cpic_planner.validation.confirm import confirm_task
from cpic_planner.validation.task import ConfirmTask, images_of
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.config.mission import Utc
from simulator.files import dump_json
from simulator.ledger import not_modelled
from simulator.work import announce

__all__ = ["FinishedPlan", "PlanConfig", "estimate_cost", "make_plan"]


class PlanConfig(ImageConfig):
    """Everything that decides a plan, but for the star table.

    ``v_mag_max`` None: 7, or all of a table of one's own. ``known_planets``
    (`catalogs.known_planets.load_known_planets`) stands instead of ``population``, with ``n_planets`` draws of each at
    ``date_utc``, the start of the mission by default.
    """

    top: Annotated[int, Field(ge=1, le=1000)] = 5
    time_s: Annotated[float, Field(ge=1e-3, le=1e9)] = 36000.0
    dwarfs_only: bool = False
    singles_only: bool = False
    v_mag_max: float | None = None
    companions: Literal["on", "off"] = "on"
    planet: ReferencePlanet = ReferencePlanet()
    population: PopulationConfig = Field(default_factory=load_population)
    n_planets: Annotated[int, Field(ge=1, le=1_000_000)] = N_PLANETS
    score: ScoreName = DEFAULT_SCORE
    known_planets: str | None = None
    date_utc: Utc | None = None

    @model_validator(mode="after")
    def _one_kind_of_planets(self) -> PlanConfig:
        if self.known_planets is not None and "population" in self.model_fields_set:
            raise InputError(
                "population",
                self.population.name,
                allowed="without known_planets",
                hint="known planets stand instead of a population",
            )
        if self.known_planets is None and self.date_utc is not None:
            raise InputError(
                "date_utc", self.date_utc, allowed="only with known_planets", hint="nothing else depends on a date"
            )
        return self

    def drawn(self) -> PopulationChoice | KnownChoice:
        """Return the population, or the known planets, that completeness refers to.

        Raises
        ------
        InputError
            If there is no such table of known planets, or it cannot be used.
        """
        if self.known_planets is None:
            return PopulationChoice(self.population, self.n_planets, self.seed)
        return KnownChoice.at(
            self.known_planets,
            self.date_utc,
            self.planet.albedo,
            self.instrument,
            n_draws=self.n_planets,
            seed=self.seed,
        )

    def band_names(self) -> tuple[str, ...]:
        """Bands of the plan."""
        return self.bands or self.instrument.visible_bands()


@dataclass(frozen=True)
class FinishedPlan:
    """A plan, its ranking, and how much of it was already there."""

    plan: PlanResult
    rank: RankResult
    resumed_parts: int
    computed_parts: int


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
    refused: dict[tuple[str, str], BandConfirmation]


def _prepare(config: PlanConfig, catalog: CatalogSource) -> _Prepared:
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
    drawn, sample = config.drawn(), sample_text(catalogue, config.v_mag_max, config.dwarfs_only, config.singles_only)
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


def plan_hash(config: PlanConfig, rank: RankResult, catalogue: Catalogue) -> str:
    """Hash of everything that decides the plan: configuration, catalogue, results version.

    A table from a file counts by its content, which is in the hash of the ranking, not by its name.
    """
    own = {key: value for key, value in config.hashed().items() if key not in ("known_planets", "date_utc")}
    limit = catalogue.ranked_v_mag if config.v_mag_max is None else config.v_mag_max
    tree = {
        "kind": "plan",
        "results": RESULT_VERSION,
        "version": __version__,
        "config": own | {"v_mag_max": limit},
        "rank": rank.config_hash,
        "catalogue": rank.catalogue if catalogue.kind == "snapshot" else catalogue.kind,
    }
    return content_hash(tree)


def estimate_cost(config: PlanConfig, *, workers: int = 1, catalog: CatalogSource = "snapshot") -> dict[str, float]:
    """Expected wall time, memory and disk of a plan, see `cpic_planner.confirmed.images_cost`."""
    prepared = _prepare(config, catalog)
    cost = images_cost(prepared.tasks, workers)
    return {"n_targets": len(prepared.chosen)} | cost


def make_plan(
    config: PlanConfig,
    out: str | Path,
    *,
    catalog: CatalogSource = "snapshot",
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    advance: Callable[[str], None] = lambda text: None,
    command: list[str] | None = None,
) -> FinishedPlan:
    """Rank, confirm and report.

    Parameters
    ----------
    config : PlanConfig
    out : str or Path
        Output folder; resumed when it holds work of the same configuration.
    catalog : Catalogue, str or Path
        Star table: ``"snapshot"``, ``"latest"``, ``"simbad_2012"``, or a file; see `catalogs.catalogue.open_catalogue`.
    workers : int
        Local worker processes; the result does not depend on it.
    scheduler : str, optional
        Dask scheduler to use instead.
    force : bool
        Remove what a run of another configuration wrote into ``out``, and nothing else.
    advance : callable
        Called with a text after each finished piece of work.
    command : list of str, optional
        Command line, kept in ``run.json``.

    Returns
    -------
    FinishedPlan

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.report.write import PRODUCTS

    clock = RunClock()
    prepared = _prepare(config, catalog)
    digest = plan_hash(config, prepared.rank, prepared.catalogue)
    products = ("plan.json", "sensitivity.json", "run.json", *PRODUCTS)
    with open_run_folder(out, kind="plan", config_hash=digest, products=products, force=force) as folder:
        bodies, resumed = _confirm_all(prepared, folder, workers, scheduler, advance)
        plan = _assemble(config, prepared, digest, bodies)
        firm = sensitivity(
            prepared.model,
            prepared.targets,
            time_s=config.time_s,
            planet=config.planet,
            population=prepared.drawn,
            score=config.score,
        )
        announce("writing the report")
        _write(folder, plan, prepared, bodies, firm)
        record = clock.record(
            command=command,
            config_hash=digest,
            workers=workers,
            scheduler=scheduler,
            resumed_parts=resumed,
            computed_parts=len(prepared.tasks) - resumed,
        )
        folder.write("run.json", dump_json(record.model_dump(mode="json")))
    return FinishedPlan(plan, prepared.rank, resumed, len(prepared.tasks) - resumed)


def _confirm_all(
    prepared: _Prepared,
    folder: RunFolder,
    workers: int,
    scheduler: str | None,
    advance: Callable[[str], None],
) -> tuple[dict[tuple[str, str], dict[str, Any]], int]:
    """Run what is not there yet; every finished piece is on disk before the next is counted."""
    bodies: dict[tuple[str, str], dict[str, Any]] = {}
    waiting = []
    for task in prepared.tasks:
        stored = folder.part(task.key)
        if stored is None:
            waiting.append(task)
        else:
            bodies[(task.name, task.band)] = stored
            advance(f"{task.name} {task.band} (kept)")
    resumed = len(bodies)
    arguments = [(task.to_dict(),) for task in waiting]
    for position, body in run_tasks(confirm_task, arguments, workers=workers, scheduler=scheduler):
        task = waiting[position]
        bodies[(task.name, task.band)] = folder.save_part(task.key, body)
        advance(f"{task.name} {task.band}")
    return bodies, resumed


def _assemble(
    config: PlanConfig, prepared: _Prepared, digest: str, bodies: dict[tuple[str, str], dict[str, Any]]
) -> PlanResult:
    confirmed = [confirmed_target(prepared.model, row, prepared.refused, bodies) for row in prepared.chosen]
    strategy = prepared.model.strategy
    mean = calibrate([band for target in confirmed for band in target.bands])
    return PlanResult(
        version=__version__,
        config_hash=digest,
        seed=config.seed,
        fidelity=config.dial.fidelity,
        tolerance=config.dial.tolerance,
        instrument=config.instrument.name,
        time_s=config.time_s,
        sigma=strategy.sigma,
        reference_library=strategy.library,
        rdi_modes=strategy.n_modes,
        realisations=config.realisations,
        simulator_overrides=config.simulator_overrides.as_mapping(),
        companions=config.companions,
        reference_planet=planet_record(config.planet),
        catalogue=prepared.rank.catalogue,
        sample=prepared.rank.sample,
        n_ranked=len(prepared.rank.targets),
        counts=prepared.rank.counts,
        counts_limited_by=prepared.rank.counts_limited_by,
        calibration={"ratio": mean.ratio, "error": mean.error, "n_bands": mean.n_bands},
        calibration_text=mean.text,
        not_modelled=not_modelled(images_of(config.instrument)),
        targets=confirmed,
    )


def _write(
    folder: RunFolder,
    plan: PlanResult,
    prepared: _Prepared,
    bodies: dict[tuple[str, str], dict[str, Any]],
    firm: SensitivityResult,
) -> None:
    from cpic_planner.report.write import write_report

    folder.write("plan.json", dump_json(plan.model_dump(mode="json")))
    folder.write("sensitivity.json", dump_json(firm.model_dump(mode="json")))
    write_report(folder, plan, prepared.rank, prepared.model, bodies, prepared.targets, sensitivity=firm)
