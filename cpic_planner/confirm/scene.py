"""``cpic confirm``: one scene, observed and measured in some bands, beside what the ETC expects of it."""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from cpic_core import Reason, Status
from cpic_planner import validation
from cpic_planner.confirm.stars import RESULT_VERSION, image_tasks, images_cost, result_header
from cpic_planner.etc import EtcModel, build_model, signal_to_noise, times_of
from cpic_planner.jobs import Finished, Job, RunFolder, Runner, RunSettings, run
from cpic_planner.queries import MAX_FRAMES, ConfirmQuestion, audited
from cpic_planner.results import BandConfirmation, ConfirmResult
from cpic_planner.targets import Targets
from simulator.config import Scene
from simulator.imaging import PsfMetrics
from simulator.target import LitStar, Source, detector_to_sky, scene_sources

_NO_PLANET, _FAINTEST = 1e-8, 1e-30
"""Contrast of the planet that frames are chosen for where a scene has none in the hole, and of one without light."""


@dataclass(frozen=True)
class _Work:
    """Prediction, tasks of the bands, and what needs no images."""

    model: EtcModel
    tasks: list[validation.ConfirmTask]
    refused: list[BandConfirmation]


@dataclass(frozen=True)
class _Programme:
    """Visits and frames of a band, or why there are none; for which planet they were chosen, and time left unused."""

    frames: validation.Frames | None
    chosen_for: str = ""
    unused_s: float | None = None
    refusal: tuple[Status, Reason, str] = Status.OK, Reason.NONE, ""


def confirm_job(config: ConfirmQuestion) -> Job[ConfirmResult]:
    """Return the job that simulates a scene and measures it blind."""
    from cpic_planner.report import products_of

    prepared = functools.cache(lambda: _work(config))

    def work(runner: Runner) -> ConfirmResult:
        bodies = runner.finish(validation.confirm_task, image_tasks(prepared().tasks))
        return _result(config, prepared(), runner.digest, list(bodies.values()))

    def write(folder: RunFolder, result: ConfirmResult, bodies: Mapping[str, Any]) -> None:
        from cpic_planner.report import write_confirm_report

        images = {task.band: bodies[task.key] for task in prepared().tasks}
        shown = config.simulator_overrides.scene(config.scene)
        write_confirm_report(folder, result, prepared().model, shown, images)

    return Job(
        kind="confirm",
        results=RESULT_VERSION,
        decides=lambda: {"config": config.hashed() | {"audit": audited(config.dial, config.audit)}},
        work=work,
        write=write,
        products=products_of(config.bands or config.instrument.visible_bands()),
        cost=lambda: images_cost(prepared().tasks, n_refused=len(prepared().refused)),
    )


def confirm_scene(
    config: ConfirmQuestion, out: str | Path | None = None, **how: Unpack[RunSettings]
) -> Finished[ConfirmResult]:
    """Confirm a scene.

    Parameters
    ----------
    config : ConfirmQuestion
    out : str or Path, optional
        Output folder of ``confirm.json``, ``measurements.csv``, ``report.html``, panels and ``run.json``; nothing is
        written without.
    **how
        As of `cpic_planner.jobs.job.run`.

    Raises
    ------
    InputError
        For anything out of range, or a folder that cannot be used.
    """
    return run(confirm_job(config), out, **how)


def _result(config: ConfirmQuestion, work: _Work, digest: str, bodies: Sequence[Mapping[str, Any]]) -> ConfirmResult:
    order = {name: i for i, name in enumerate(work.model.bands)}
    seen = [BandConfirmation.model_validate(item) for body in bodies for item in body["confirmations"]]
    bands = sorted([*seen, *work.refused], key=lambda item: order[item.band])
    header = result_header(config, digest, seen)
    if config.scene.extended and seen:
        header["calibration_text"] += "; predictions leave out the light of extended sources"
    return ConfirmResult(
        **header,
        scene=config.scene.name,
        bands=bands,
        searches=[body["search"] for body in bodies if body["search"] is not None],
        positions=validation.position_records(config.scene, bands),
        albedos=validation.albedo_records(validation.albedo_fits(config.scene, config.instrument, bands)),
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


def _work(config: ConfirmQuestion) -> _Work:
    model = build_model(config.instrument, config.bands, config.strategy)
    target = scene_target(config.scene)
    tasks: list[validation.ConfirmTask] = []
    refused: list[BandConfirmation] = []
    for band in model.bands:
        every = scene_sources(config.scene, config.instrument, band)
        planets = [source for source in every if source.kind == "planet"]
        shown = [planet for planet in planets if _inside(model.metrics[band], planet)]
        refused += [_outside(model, band, planet) for planet in planets if planet not in shown]
        if planets and not shown:
            continue
        programme = _programme(config, model, target, band, shown)
        frames = programme.frames
        if frames is None:
            refused += [_refusal(model, band, planet, *programme.refusal) for planet in shown]
            continue
        predictions = [
            validation.expected_of(
                model, target, band, (planet.x_arcsec, planet.y_arcsec), planet.contrast or 0.0, frames
            )
            for planet in shown
        ]
        task = validation.task_of(
            model,
            config.scene,
            band,
            frames,
            predictions,
            planets=[planet.name for planet in shown],
            audit=audited(config.dial, config.audit),
            **config.image_settings,
        )
        task = replace(task, unused_s=programme.unused_s, chosen_for=programme.chosen_for)
        answers = validation.refusals_of(task)
        refused += answers
        hidden = {answer.planet for answer in answers}
        left = [number for number, name in enumerate(task.planets) if name not in hidden]
        if left or not answers:
            predictions = [task.predictions[number] for number in left]
            tasks.append(replace(task, planets=[task.planets[number] for number in left], predictions=predictions))
    return _Work(model, tasks, refused)


def _programme(
    config: ConfirmQuestion, model: EtcModel, target: Targets, band: str, planets: list[Source]
) -> _Programme:
    """Return the visits and frames that are given, or those that the calculator chooses for the first planet."""
    if config.exposure_s is not None and config.n_frames is not None and config.em_gain is not None:
        return _Programme(
            validation.Frames(config.exposure_s, config.n_frames, config.em_gain, config.strategy.visits or 1)
        )
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
    if answer.exposure_s is None or answer.frames_per_visit is None or answer.em_gain is None:
        return _Programme(None, name, refusal=(answer.status, answer.reason, answer.message))
    if answer.frames_per_visit > MAX_FRAMES:
        return _Programme(None, name, refusal=(Status.INVALID, Reason.TOO_MANY_FRAMES, validation.TOO_MANY))
    frames = validation.Frames(answer.exposure_s, answer.frames_per_visit, answer.em_gain, answer.visits or 1)
    return _Programme(frames, name, None if config.n_frames is not None else answer.unused_s)


def _inside(metrics: PsfMetrics, planet: Source) -> bool:
    """Return whether the aperture lies in the dark hole."""
    place = np.array(planet.x_arcsec), np.array(planet.y_arcsec)
    return bool(metrics.zone.contains(*place, metrics.aperture_radius_arcsec))


def _outside(model: EtcModel, band: str, planet: Source) -> BandConfirmation:
    metrics = model.metrics[band]
    reason = validation.edge_crossed(metrics.zone, planet.x_arcsec, planet.y_arcsec, metrics.aperture_radius_arcsec)
    return _refusal(model, band, planet, Status.OUTSIDE_FIELD, reason, f"its aperture leaves the dark hole of {band}")


def _refusal(
    model: EtcModel, band: str, planet: Source, status: Status, reason: Reason, message: str
) -> BandConfirmation:
    separation, pa_deg = detector_to_sky(planet.x_arcsec, planet.y_arcsec, parity=model.instrument.detector.parity)
    where = {"separation_arcsec": float(separation), "pa_deg": float(pa_deg), "true_contrast": planet.contrast}
    return validation.not_observed(status, reason, message, band=band, planet=planet.name, **where)
