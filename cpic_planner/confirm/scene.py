"""Confirmation of targets and scenes: which images to make, and what they say together; ``cpic confirm``."""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from cpic_core import Reason, Record, Status
from cpic_planner import queries, results, validation
from cpic_planner.confirm.files import MeasuredFiles, measured_files
from cpic_planner.etc import EtcModel, build_model, signal_to_noise, times_of
from cpic_planner.jobs import Cost, Job, RunFolder, Runner, RunSettings, Task, run
from cpic_planner.queries import MAX_FRAMES, ConfirmQuestion, audited
from cpic_planner.results import BandConfirmation, ConfirmResult
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import Scene
from simulator.imaging import PsfMetrics
from simulator.ledger import not_modelled
from simulator.target import LitStar, Source, detector_to_sky, scene_sources

if TYPE_CHECKING:
    from cpic_planner.survey import ScheduledVisit


RESULT_VERSION = 10
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""


def result_header(
    config: queries.ImageQuestion, digest: str, measured: Sequence[results.BandConfirmation]
) -> dict[str, Any]:
    """Return what every result of images says of itself.

    Parameters
    ----------
    config : ImageQuestion
    digest : str
        Hash of everything that decides the result.
    measured : sequence of BandConfirmation
        What predicted over recovered SNR is taken over.
    """
    mean, reduction = validation.calibrate(measured), config.strategy.reduction
    unpredicted = f"no closed form predicts a reduction that subtracts {reduction.meaning}"
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
        "calibration_text": mean.text if reduction.predicted else unpredicted,
        "not_modelled": not_modelled(validation.images_of(config.instrument)),
    }


def plan_tasks(
    model: EtcModel, stars: Sequence[Targets], rows: Sequence[results.RankedTarget], **asked: Any
) -> tuple[list[validation.ConfirmTask], dict[str, results.BandConfirmation]]:
    """Return work to do, and the bands that need none because the answer is already a refusal, by their keys.

    Where the dial has audits, the band of each target that promises most gets one: a realisation with every effect of
    single frames.

    Parameters
    ----------
    model : EtcModel
    stars : sequence of Targets
    rows : sequence of RankedTarget
        The row of each star in the ranking.
    **asked
        As of `cpic_planner.validation.task.prepare_task`.
    """
    ready = [[validation.prepare_task(model, star, band, **asked) for band in model.bands] for star in stars]
    return tasks_of(rows, ready)


def tasks_of(
    rows: Sequence[results.RankedTarget], ready: Sequence[Sequence[validation.ConfirmTask | results.BandConfirmation]]
) -> tuple[list[validation.ConfirmTask], dict[str, results.BandConfirmation]]:
    """Return prepared work as `plan_tasks` does.

    Parameters
    ----------
    rows : sequence of RankedTarget
    ready : sequence of sequence of ConfirmTask or BandConfirmation
        The bands of each star.
    """
    tasks: list[validation.ConfirmTask] = []
    refused: dict[str, results.BandConfirmation] = {}
    for row, prepared in zip(rows, ready, strict=True):
        own = []
        for item in prepared:
            answers = [item] if isinstance(item, results.BandConfirmation) else validation.refusals_of(item)
            if isinstance(item, validation.ConfirmTask) and not answers:
                own.append(item)
            else:
                refused[f"{row.name} {item.band}"] = answers[0]
        margins = [task.predictions[0]["significance"] / task.predictions[0]["threshold"] for task in own]
        best = margins.index(max(margins)) if own else None
        tasks.extend(replace(task, audit=i == best and queries.audited(task.dial)) for i, task in enumerate(own))
    return tasks, refused


def why_not_imaged(config: queries.ImageQuestion, visit: "ScheduledVisit") -> str:
    """Return why a visit of a schedule has no images, whatever its star is; empty where it can have some."""
    library = config.strategy.library
    if visit.reserve:
        return "a reserve visit, made only where others have freed the time for it"
    if visit.setting.band not in config.instrument.bands:
        return f"the instrument has no such band: {', '.join(config.instrument.bands)}"
    if visit.reference_library not in ("", library):
        return f"its references are those of {visit.reference_library}, the plan's of {library}: give --library"
    if visit.setting.n_frames > queries.MAX_FRAMES:
        return f"more than {queries.MAX_FRAMES} frames a visit"
    return ""


def first_roll_deg(bands: "Mapping[str, Sequence[ScheduledVisit]]") -> float:
    """Return the roll of a star's images, degrees: that of the first of its visits, by band, with one; else 0."""
    stated = (visit.roll_deg for own in bands.values() for visit in own if not math.isnan(visit.roll_deg))
    return next(stated, 0.0)


def programme_task(
    model: EtcModel,
    star: Targets,
    band: str,
    visits: "Sequence[ScheduledVisit]",
    *,
    planet: queries.ReferencePlanet,
    **settings: Any,
) -> validation.ConfirmTask | results.BandConfirmation:
    """Return the work of visits of one star and band that are reduced together, in the frames of the first.

    Parameters
    ----------
    model : EtcModel
    star : Targets
        One star, at the roll of the visits.
    band : str
    visits : sequence of ScheduledVisit
        The time between them is the mean of that between their windows.
    planet : ReferencePlanet
    **settings
        As of `plan_tasks`.

    Notes
    -----
    The planet stands at one place in all of them, that where the calculator sees it best in as much time without
    pauses: what months between visits do is that their wavefronts have forgotten each other.
    """
    exposure_s, n_frames, em_gain = visits[0].setting.frames
    frames = validation.Frames(exposure_s, int(n_frames), em_gain, sum(visit.visits for visit in visits))
    days = sorted(visit.mjd for visit in visits if not math.isnan(visit.mjd))
    gap_h = 24.0 * (days[-1] - days[0]) / (len(days) - 1) if len(days) > 1 else model.strategy.visit_gap_h
    strategy = model.strategy.model_copy(update={"visits": frames.visits, "visit_gap_h": min(gap_h, 1e5)})
    visit_s = n_frames * (exposure_s + model.camera(band).readout_s)
    time_s = frames.visits * float(model.time_s(visit_s))
    made = validation.prepare_task(
        replace(model, strategy=strategy), star, band, time_s=time_s, planet=planet, frames=frames, **settings
    )
    if not days or isinstance(made, results.BandConfirmation):
        return made
    return replace(made, epoch_mjd=0.5 * (days[0] + days[-1]))


def image_tasks(tasks: Sequence[validation.ConfirmTask]) -> list[Task]:
    """Return tasks of `cpic_planner.validation.confirm.confirm_task`."""
    return [Task(task.key, (task.to_dict(),)) for task in tasks]


def images_cost(tasks: Sequence[validation.ConfirmTask], **counts: float) -> Cost:
    """Return the expected cost of simulating and measuring tasks, see `cpic_planner.validation.task`."""
    known = {id(task): validation.task_cost(task) for task in {id(task): task for task in tasks}.values()}
    costs = [known[id(task)] for task in tasks]  # a task may stand for others, and is then asked about once
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


_StarWork = tuple[list[results.RankedTarget], list[validation.ConfirmTask], dict[str, results.BandConfirmation]]
"""Rows of stars in a ranking, work to do, and the bands that need none."""


def _star_work(
    question: queries.StarImagesQuestion, model: EtcModel, stars: Sequence[Targets], **how: Any
) -> _StarWork:
    """Return the work of single stars; ``how`` as of `rank_targets`."""
    from cpic_planner.ranking import rank_targets

    asked: dict[str, Any] = {"time_s": question.time_s, "planet": question.planet}
    rows = [rank_targets(model, star, **asked, **how).targets[0] for star in stars]
    return rows, *plan_tasks(model, stars, rows, **asked, **question.image_settings)


def confirm_stars(
    question: queries.StarImagesQuestion, model: EtcModel, stars: Sequence[Targets]
) -> list[results.ConfirmedTarget]:
    """Confirm single stars without an output folder; see `cpic_planner.confirm_targets`.

    Parameters
    ----------
    question : StarImagesQuestion
    model : EtcModel
        Of the instrument, bands and strategy of the question.
    stars : sequence of Targets
        Those that it names.
    """
    queries.refuse_counting(model.strategy, question.dial)
    rows, tasks, refused = _star_work(question, model, stars)
    bodies = Runner(workers=question.workers).finish(validation.confirm_task, image_tasks(tasks))
    return [confirmed_target(model, row, refused, bodies) for row in rows]


def star_images_job(
    question: queries.StarImagesQuestion, model: EtcModel, star: Targets, catalogue: str
) -> Job[results.StarImagesResult]:
    """Return the job that simulates one star with its reference planet and measures it, as `confirm_stars` does.

    Parameters
    ----------
    question : StarImagesQuestion
    model : EtcModel
        Of the instrument, bands and strategy of the question.
    star : Targets
        The star that it names.
    catalogue : str
        Which table the star is from.
    """
    from cpic_planner.report import products_of, write_star_images

    prepared = functools.cache(lambda: _star_work(question, model, [star], catalogue=catalogue))

    def work(runner: Runner[Any]) -> results.StarImagesResult:
        (row,), tasks, refused = prepared()
        target = confirmed_target(model, row, refused, runner.finish(validation.confirm_task, image_tasks(tasks)))
        return results.StarImagesResult(
            **result_header(question, runner.digest, target.bands),
            time_s=question.time_s,
            reference_planet=results.ReferencePlanetRecord.of(question.planet, albedo=question.planet.albedo.label),
            catalogue=catalogue,
            date_utc=star.date_utc,
            targets=[target],
        )

    return Job(
        kind="star_images",
        results=RESULT_VERSION,
        # A star counts by what is known of it, not by the name under which it is asked for.
        decides=lambda: {"config": question.hashed() | {"target": None}, "star": star.content()},
        work=work,
        write=lambda folder, result, bodies: write_star_images(folder, result, model, bodies),
        products=[name for name in products_of(model.bands) if name != "report.html"],
        cost=lambda: images_cost(prepared()[1]),
    )


def confirmed_target(
    model: EtcModel,
    row: results.RankedTarget,
    refused: Mapping[str, results.BandConfirmation],
    bodies: Mapping[str, Mapping[str, Any]],
    *,
    roll_deg: float | None = None,
) -> results.ConfirmedTarget:
    """Return one target's bands in order, and the best of them, from refusals and bodies by the keys of tasks.

    Parameters
    ----------
    model : EtcModel
    row : RankedTarget
    refused : mapping of str to BandConfirmation
        Bands that need no images, by star and band.
    bodies : mapping of str to mapping
        Results of the images, by star and band.
    roll_deg : float, optional
        That of a schedule.
    """
    bands = [
        results.BandConfirmation.model_validate(bodies[key]["confirmations"][0]) if key in bodies else refused[key]
        for key in (f"{row.name} {band}" for band in model.bands)
        if key in bodies or key in refused
    ]

    def margin(band: results.BandConfirmation) -> float:
        return (band.predicted_significance or 0.0) / (band.threshold or np.inf)

    # A few realisations rank bands by chance where they are close: the images veto, the prediction orders.
    blind = [band for band in bands if band.detected]
    best = max(blind or [band for band in bands if validation.significant_at_place(band)], key=margin, default=None)
    verdict, factor, error = validation.target_verdict(bands)
    return results.ConfirmedTarget.of(
        row,
        ranked=row,
        planet_distance_au=row.ref_planet_distance_au,
        roll_deg=roll_deg,
        chosen_band=best.band if best else None,
        verdict=verdict,
        etc_ratio=factor,
        etc_ratio_error=error,
        bands=bands,
    )


_NO_PLANET, _FAINTEST = 1e-8, 1e-30
"""Contrast of the planet that frames are chosen for where a scene has none in the hole, and of one without light."""


class _Work(Record):
    """Prediction, tasks of the bands, and what needs no images."""

    model: EtcModel
    tasks: list[validation.ConfirmTask]
    refused: list[BandConfirmation]


def confirm_job(asked: ConfirmQuestion) -> Job[ConfirmResult]:
    """Return the job that simulates a scene, or takes files of one, and measures it blind."""
    from cpic_planner.report import SOURCES_FILES, products_of

    files = None if asked.from_products is None else measured_files(asked, asked.from_products)
    config = asked if files is None else files.question
    prepared = functools.cache(lambda: _work(config) if files is None else _files_work(files))

    def work(runner: Runner[Any]) -> ConfirmResult:
        bodies = runner.finish(validation.confirm_task, image_tasks(prepared().tasks))
        return _result(config, prepared(), runner.digest, list(bodies.values()), bare=files is not None and files.bare)

    def write(folder: RunFolder, result: ConfirmResult, bodies: Mapping[str, Any]) -> None:
        from cpic_planner.report import write_confirm_report

        images = {task.band: bodies[task.key] for task in prepared().tasks}
        shown = config.simulator_overrides.scene(config.looked_at)
        write_confirm_report(folder, result, prepared().model, shown, images)

    products = products_of(config.bands or config.instrument.visible_bands(), len(config.looked_at.planets))
    taken = {} if files is None else {"files": files.sums, "bare": files.bare}
    audit = audited(config.dial, config.audit) and files is None
    return Job(
        kind="confirm",
        results=RESULT_VERSION,
        decides=lambda: {"config": config.hashed() | {"audit": audit} | taken},
        work=work,
        write=write,
        products=products if files is None else [*products, *SOURCES_FILES],
        cost=lambda: images_cost(prepared().tasks, n_refused=len(prepared().refused)),
    )


def confirm_scene(
    config: ConfirmQuestion, out: str | Path | None = None, **how: Unpack[RunSettings]
) -> Runner[ConfirmResult]:
    """Confirm a scene.

    Parameters
    ----------
    config : ConfirmQuestion
    out : str or Path, optional
        Output folder of ``confirm.json``, ``measurements.csv``, tables for fits of orbits, ``report.html``, panels and
        ``run.json``; nothing is written without.
    **how
        As of `cpic_planner.jobs.job.run`.

    Raises
    ------
    InputError
        For anything out of range, or a folder that cannot be used.
    """
    return run(confirm_job(config), out, **how)


def _result(
    config: ConfirmQuestion, work: _Work, digest: str, bodies: Sequence[Mapping[str, Any]], *, bare: bool
) -> ConfirmResult:
    scene = config.looked_at
    order = {name: i for i, name in enumerate(work.model.bands)}
    seen = [BandConfirmation.model_validate(item) for body in bodies for item in body["confirmations"]]
    bands = sorted([*seen, *work.refused], key=lambda item: order[item.band])
    header = result_header(config, digest, seen)
    if scene.extended and seen:
        header["calibration_text"] += "; predictions leave out the light of extended sources"
    if bare:
        header["calibration_text"] = "the files come without a scene: there is nothing to compare with"
        header["not_modelled"] = []
    return ConfirmResult(
        **header,
        scene=scene.name,
        bands=bands,
        searches=[body["search"] for body in bodies if body["search"] is not None],
        positions=validation.position_records(scene, bands),
        albedos=validation.albedo_records(validation.albedo_fits(scene, config.instrument, bands)),
        visits=[row for body in bodies for row in body.get("visits", ())],
        sources=[row for body in bodies for row in body.get("sources", ())],
    )


def scene_target(scene: Scene) -> Targets:
    """Return the central star of a scene as a target, with the light of all stars of the scene.

    Notes
    -----
    Temperature, gravity and metallicity are those of the images; where its spectrum is a file or a table that states
    none, the Sun's.
    """
    star = scene.cstar
    parameters = LitStar(star, "scene.cstar").spectrum

    def number(value: float | None, default: float = math.nan) -> Any:
        return np.array([default if value is None else value])

    columns = ("ra_deg", "dec_deg", "distance_pc", "v_mag", "luminosity_lsun")
    companion = ("separation_arcsec", "pa_deg", "position_error_arcsec", "v_mag", "teff_k")
    return Targets(
        name=np.array([scene.name]),
        hip=np.array([0]),
        sp_type=np.array([star.spectral_type or ""]),
        teff_k=number(parameters.teff_k, 5772.0),
        log_g=number(parameters.log_g, 4.4),
        metallicity=number(parameters.metallicity, 0.0),
        **{name: number(getattr(star, name)) for name in columns},
        **{f"companion_{name}": number(None) for name in companion},
        flags=((),),
        companions=scene.companions,
        scene=scene,
    )


def _files_work(files: MeasuredFiles) -> _Work:
    """Return the work on files: each band in the visits and frames that are there."""
    parts = []
    for programme in files.programmes:
        given, roll_deg = files.programme_question(programme)
        taken: dict[str, Any] = {"files": programme.files(), "bare": files.bare, "audit": False}
        parts.append(_work(given, roll_deg=roll_deg, **taken))
    model = build_model(files.question.instrument, [one.band for one in files.programmes], parts[0].model.strategy)
    return _Work(model, [task for part in parts for task in part.tasks], [no for part in parts for no in part.refused])


def _work(config: ConfirmQuestion, *, roll_deg: float = 0.0, **taken: Any) -> _Work:
    """Return the work on a scene at a roll; ``taken`` stands for other fields of the tasks."""
    model, scene = build_model(config.instrument, config.bands, config.strategy), config.looked_at
    target = scene_target(scene)
    tasks: list[validation.ConfirmTask] = []
    refused: list[BandConfirmation] = []
    for band in model.bands:
        every = scene_sources(scene, config.instrument, band, roll_deg=roll_deg)
        planets = [source for source in every if source.kind == "planet"]
        shown = [planet for planet in planets if _inside(model.metrics[band], planet)]
        refused += [_outside(model, band, planet, roll_deg) for planet in planets if planet not in shown]
        if planets and not shown and not taken:
            continue
        frames, about = _programme(config, model, target, band, shown)
        if frames is None:
            refused += [_refusal(model, band, planet, roll_deg=roll_deg, **about) for planet in shown]
            continue
        predictions = [
            validation.expected_of(
                model, target, band, (planet.x_arcsec, planet.y_arcsec), planet.contrast or 0.0, frames, roll_deg
            )
            for planet in shown
        ]
        task = validation.task_of(
            model,
            scene,
            band,
            frames,
            predictions,
            planets=[planet.name for planet in shown],
            audit=audited(config.dial, config.audit),
            **config.image_settings,
        )
        task = replace(task, roll_deg=roll_deg, **about, **taken)
        answers = validation.refusals_of(task)
        refused += answers
        hidden = {answer.planet for answer in answers}
        left = [number for number, name in enumerate(task.planets) if name not in hidden]
        if left or not answers or taken:
            predictions = [task.predictions[number] for number in left]
            tasks.append(replace(task, planets=[task.planets[number] for number in left], predictions=predictions))
    return _Work(model, tasks, refused)


def _programme(
    config: ConfirmQuestion, model: EtcModel, target: Targets, band: str, planets: list[Source]
) -> tuple[validation.Frames | None, dict[str, Any]]:
    """Return the visits and frames that are given, or those that the calculator chooses for the first planet.

    Beside them for which planet they were chosen and how much time is left unused; status, reason and message where
    there are no frames.
    """
    if config.exposure_s is not None and config.n_frames is not None and config.em_gain is not None:
        return validation.Frames(config.exposure_s, config.n_frames, config.em_gain, config.strategy.visits or 1), {}
    place, contrast, name = model.metrics[band].zone.middle, _NO_PLANET, f"a planet of {_NO_PLANET:g} in mid-hole"
    if planets:
        first = planets[0]
        place, contrast, name = (first.x_arcsec, first.y_arcsec), max(first.contrast or 0.0, _FAINTEST), first.name
    (answer,) = signal_to_noise(
        model,
        target,
        **times_of(config, model, band),
        separation_arcsec=math.hypot(*place),
        bands=[band],
        contrast=contrast,
        exposure_s=config.exposure_s,
        em_gain=config.em_gain,
        offsets_arcsec=place,
    )
    frames = validation.Frames.of(answer)
    if frames is None:
        return None, {"status": answer.status, "reason": answer.reason, "message": answer.message}
    if frames.n_frames > MAX_FRAMES:
        many = Reason.TOO_MANY_FRAMES
        return None, {"status": Status.INVALID, "reason": many, "message": validation.TOO_MANY}
    return frames, {"chosen_for": name, "unused_s": None if config.n_frames is not None else answer.unused_s}


def _inside(metrics: PsfMetrics, planet: Source) -> bool:
    """Return whether the aperture lies in the dark hole."""
    place = np.array(planet.x_arcsec), np.array(planet.y_arcsec)
    return bool(metrics.zone.contains(*place, metrics.aperture_radius_arcsec))


def _outside(model: EtcModel, band: str, planet: Source, roll_deg: float) -> BandConfirmation:
    metrics = model.metrics[band]
    reason = validation.edge_crossed(metrics.zone, planet.x_arcsec, planet.y_arcsec, metrics.aperture_radius_arcsec)
    text = f"its aperture leaves the dark hole of {band}"
    return _refusal(model, band, planet, Status.OUTSIDE_FIELD, reason, text, roll_deg=roll_deg)


def _refusal(
    model: EtcModel, band: str, planet: Source, status: Status, reason: Reason, message: str, *, roll_deg: float
) -> BandConfirmation:
    parity = model.instrument.detector.parity
    separation, pa_deg = detector_to_sky(planet.x_arcsec, planet.y_arcsec, roll_deg=roll_deg, parity=parity)
    where = {"separation_arcsec": float(separation), "pa_deg": float(pa_deg), "true_contrast": planet.contrast}
    return validation.not_observed(status, reason, message, band=band, planet=planet.name, **where)
