"""Confirm a prediction: simulate science and reference visits, subtract, search blind, measure, compare."""

import base64
import io
import math
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cpic_core import Status, announce
from cpic_planner.results import AuditRecord, SearchRecord
from cpic_planner.validation.detection import BlindSearch
from cpic_planner.validation.findings import search_record
from cpic_planner.validation.measure import MATCH_LAMBDA_D, Measurement, Subject, measure, positions_of, subjects_of
from cpic_planner.validation.modelling import Modelling, modelling_of
from cpic_planner.validation.realise import FrameStory, Realised, Visits, realised_frames, visits_of
from cpic_planner.validation.star_flux import StarFlux, observe_off_mask, star_flux_off_mask
from cpic_planner.validation.task import ConfirmTask
from cpic_planner.validation.verdict import audit_of, confirmation_of, cut_off

AUDIT_REALISATION = 1_000_000
"""Number of the realisation that runs frame by frame: far from those of the sums."""


def confirm_task(tree: dict[str, Any]) -> dict[str, Any]:
    """Simulate and measure one scene in one band.

    Parameters
    ----------
    tree : dict
        `ConfirmTask.to_dict`.

    Returns
    -------
    dict
        ``confirmations`` (a `BandConfirmation` as plain data for each planet), ``panels`` (images of the first
        realisation, encoded), ``planet_offsets_arcsec``, and ``search`` (a `SearchRecord` of the first realisation;
        None for two rolls).
    """
    task = ConfirmTask(**tree)
    announce(f"images of {task.name} in {task.band}")
    modelling = modelling_of(task)
    visits = visits_of(task, modelling=modelling)
    sums = modelling.draw == "sums" and visits.stackable.status is Status.OK
    if not sums:
        modelling = modelling_of(task, by_frames=True)
    runs = _sums(task, visits) if sums else _by_frames(task, modelling)
    subjects: tuple[Subject, ...] = ()
    every: list[list[Measurement | None]] = []
    position: list[Any] = []
    stories: list[FrameStory] = []
    false, first, found_blind = 0, None, None
    for at, realised, told in runs:
        if first is None:
            first, subjects = realised, subjects_of(at)
            star, known = _star(at)
            position = [None] * len(subjects)
        measured, blind = measure(at, realised, subjects, star)
        every.append(measured)
        announce(f"images of {task.name} in {task.band}, {len(every)} of {task.realisations} realisations")
        stories += [] if told is None else [told]
        if blind is not None:
            false += _false(blind, at)
            found_blind = found_blind or _search(at, subjects, blind)
            for index, subject in enumerate(subjects):
                if position[index] is None and _seen(measured[index]):
                    position[index] = positions_of(at, realised, blind, subject)
    assert first is not None  # a task has at least one realisation
    story = None if sums else _joined(stories)
    audited = task.audit and sums and subjects
    audits = _audits(task, modelling, subjects, star) if audited else [None] * len(subjects)
    confirmations = []
    for index, subject in enumerate(subjects):
        measured_here = [measured[index] for measured in every]
        if story is not None and any(item is None for item in measured_here):
            confirmations.append(cut_off(task, modelling, index, story))
            continue
        confirmations.append(
            confirmation_of(
                task,
                modelling,
                index,
                [item for item in measured_here if item is not None],
                star=None if known else star,
                core=subject.core,
                false_detections=false,
                story=story,
                position=position[index],
                audit=audits[index],
            )
        )
    if found_blind is not None:
        found_blind = found_blind.model_copy(update={"realisations": len(every), "false_detections": false})
    panels = {
        "science": first.science_e,
        "reference": first.reference_e,
        "residual": np.where(first.reduced.region, first.reduced.image_e, np.nan),
    }
    return {
        "confirmations": [item.model_dump(mode="json") for item in confirmations],
        "panels": encode_arrays({name: image.astype(np.float32) for name, image in panels.items()}),
        "planet_offsets_arcsec": [list(subject.places_arcsec[0]) for subject in subjects],
        "search": None if found_blind is None else found_blind.model_dump(mode="json"),
    }


def _search(visits: Visits, subjects: tuple[Subject, ...], blind: BlindSearch) -> SearchRecord:
    return search_record(
        blind,
        visits.task,
        {subject.name: subject.places_arcsec[0] for subject in subjects},
        reach_arcsec=MATCH_LAMBDA_D * visits.geometry.lambda_d_arcsec,
        roll_deg=visits.plan.science["roll_deg"],
        parity=visits.instrument.detector.parity,
    )


_Run: TypeAlias = tuple[Visits, Realised, FrameStory | None]


def _sums(task: ConfirmTask, visits: Visits) -> Iterator[_Run]:
    """Every realisation from sums of frames."""
    for number in range(task.realisations):
        yield visits, visits.draw(number), None


def _by_frames(task: ConfirmTask, modelling: Modelling) -> Iterator[_Run]:
    """Realisations frame by frame, one in memory at a time."""
    for number in range(modelling.runs_by_frames(task.realisations)):
        visits = visits_of(task, realisation=number, modelling=modelling)
        yield visits, *realised_frames(visits)


def _audits(
    task: ConfirmTask, modelling: Modelling, subjects: tuple[Subject, ...], star: StarFlux
) -> list[AuditRecord | None]:
    """One realisation with every effect on, measured as the others are."""
    visits = visits_of(task, full=True, realisation=AUDIT_REALISATION, modelling=modelling)
    realised, story = realised_frames(visits)
    measured, blind = measure(visits, realised, subjects, star)
    false = 0 if blind is None else _false(blind, visits)
    return [None if item is None else audit_of(task, index, item, story, false) for index, item in enumerate(measured)]


def _false(blind: BlindSearch, visits: Visits) -> int:
    """Detections where the scene has no planet and no star."""
    reach = MATCH_LAMBDA_D * visits.geometry.lambda_d_arcsec
    sources = visits.science.truth.sources[1:]
    return sum(
        not any(math.hypot(item.x_arcsec - one.x_arcsec, item.y_arcsec - one.y_arcsec) <= reach for one in sources)
        for item in blind.detections
    )


def _seen(item: Measurement | None) -> bool:
    return item is not None and item.found


def _joined(stories: list[FrameStory]) -> FrameStory:
    return FrameStory(
        lost_in=sum(story.lost_in for story in stories),
        lost_outside=sum(story.lost_outside for story in stories),
        rejected_fraction=float(np.mean([story.rejected_fraction for story in stories])),
        hits=sum(story.hits for story in stories),
    )


def _star(visits: Visits) -> tuple[StarFlux, bool]:
    """Rate of the star from a series off the mask; where even its shortest exposure saturates, that of the scene."""
    task = visits.task
    series = observe_off_mask(
        visits.plan.science_scene,
        task.band,
        instrument=visits.instrument,
        seed=task.seed,
        fidelity=visits.modelling.knobs,
    )
    if series.value is not None:
        measured = star_flux_off_mask(series.value)
        if measured.value is not None:
            return measured.value, False
    rate = visits.science.truth.sources[0].rate_e_s
    return StarFlux(rate, 0.0, "off_mask", rate, 1.0, 1.0), True


def encode_arrays(arrays: dict[str, NDArray[Any]]) -> str:
    """Arrays as base64 text of a compressed npz."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def decode_arrays(text: str) -> dict[str, NDArray[Any]]:
    """Inverse of `encode_arrays`."""
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}
