"""The programme of a star in a band that contrast curves and operating characteristics are for, and its images."""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpic_core import BoolArray, FloatArray, special
from cpic_planner import etc, validation
from cpic_planner.jobs import Cost, Runner, Task
from cpic_planner.queries import ReferencePlanet, SearchedQuestion
from cpic_planner.results import EtcAnswer, SearchedProgramme
from cpic_planner.targets import Targets
from cpic_planner.version import __version__

IMAGES_A_TASK = 50
"""Images of one piece of work: its set-up takes as long as so many of them."""
_SEARCH_S = 0.03
"""Processor time of one blind search."""

Planets = Sequence[tuple[float, list[float], list[float]]]
"""Planets that are put into images, in the form of `cpic_planner.validation.SearchTask.planets`."""


@dataclass(frozen=True)
class AskedStar:
    """A star that is asked about: its row, the table that it is from, and remarks on its name and on that table."""

    target: Targets
    catalogue: str
    note: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Observed:
    """The programme of a star in a band.

    Attributes
    ----------
    model : EtcModel
        Whose strategy has the number of visits.
    star : Targets
        One star.
    band : str
    frames : Frames
    answer : EtcAnswer
        That chose it.
    """

    model: etc.EtcModel
    star: Targets
    band: str
    frames: validation.Frames
    answer: EtcAnswer

    @property
    def setting(self) -> tuple[float, int, float]:
        """Exposure (s), frames of a visit, EM gain."""
        return self.frames.exposure_s, self.frames.n_frames, self.frames.em_gain

    @property
    def visit_time_s(self) -> float:
        """Wall time of a visit; a hair more, lest rounding lose a frame."""
        pace_s = (self.frames.exposure_s + self.model.camera(self.band).readout_s) * (1.0 + 1e-12)
        return float(self.model.time_s(self.frames.n_frames * pace_s))

    @property
    def elements(self) -> float:
        """Resolution elements that a blind search goes through."""
        geometry = self.model.metrics[self.band].geometry
        return float(geometry.hole.sum() * (geometry.pixel_scale_arcsec / geometry.lambda_d_arcsec) ** 2)

    @functools.cached_property
    def images(self) -> validation.ConfirmTask:
        """The programme as images of the star without planets."""
        zodis = self.model.instrument.sky.exozodi_zodis
        scene = validation.star_scene(self.star, (), exozodi_zodis=zodis)
        return validation.task_of(self.model, scene, self.band, self.frames, [], seed=0, fidelity="standard")

    def prospect(self, x: FloatArray, y: FloatArray, contrast: FloatArray, **how: Any) -> etc.Prospect:
        """Return what is expected of planets at offsets, arrays of one length; ``how`` as of `etc.prospect_of`."""
        return self._prospect(self.model, x, y, contrast, **how)

    def prospect_in_images(self, x: FloatArray, y: FloatArray, contrast: FloatArray) -> etc.Prospect:
        """Return what is expected of planets in the images, which show them standing still and hit by no particle."""
        sums = etc.build_model(validation.images_of(self.model.instrument), [self.band], self.model.strategy)
        return self._prospect(sums, x, y, contrast, moving=False)

    def _prospect(
        self, model: etc.EtcModel, x: FloatArray, y: FloatArray, contrast: FloatArray, **how: Any
    ) -> etc.Prospect:
        visits = etc.Programme.of(model.strategy, self.frames.visits, validation.gap_s(model, self.band, self.frames))
        planets = [np.asarray(part, float)[None] for part in (x, y, contrast)]
        place, light = (planets[0], planets[1]), planets[2]
        return etc.prospect_of(model, self.star, self.band, *place, light, self.setting, visits, **how)


def clearest_place(
    question: SearchedQuestion,
    model: etc.EtcModel,
    star: Targets,
    band: str,
    grid_arcsec: Sequence[float],
    planet: ReferencePlanet | None = None,
    contrast: float | None = etc.TRIAL_CONTRAST,
) -> float:
    """Return the separation at which a planet comes nearest to a detection in the time, as ``cpic etc`` chooses it.

    Parameters
    ----------
    question : SearchedQuestion
    model : EtcModel
    star : Targets
    band : str
    grid_arcsec : sequence of float
        Separations to look at.
    planet : ReferencePlanet, optional
    contrast : float, optional
        Contrast of the planet instead of a model of it.
    """
    planets = etc.planets_of(grid_arcsec, planet, contrast)
    cases = etc.cases_of(model, star, [band], planets, objective="significance")
    missed = cases.missed_in(etc.Span.of(model, question.wall_s, question.visit_time_s))
    return float(planets.separation_arcsec[np.argmin(missed)])


def observed(model: etc.EtcModel, star: Targets, answer: EtcAnswer) -> Observed | None:
    """Return the programme that an answer is about; None where it has no frame."""
    if answer.exposure_s is None or not answer.frames_per_visit or answer.em_gain is None:
        return None
    visits = answer.visits or 1
    fixed = replace(model, strategy=model.strategy.model_copy(update={"visits": visits}))
    frames = validation.Frames(answer.exposure_s, answer.frames_per_visit, answer.em_gain, visits)
    return Observed(fixed, star, answer.band, frames, answer)


def programme_row(kind: type[SearchedProgramme], answer: EtcAnswer, seen: Observed | None, **given: Any) -> Any:
    """Return the row of a programme."""
    elements = None if seen is None else seen.elements
    status: dict[str, Any] = {"status": answer.status.value, "reason": answer.reason.value, "message": answer.message}
    return kind.of(answer, **status, resolution_elements=elements, **given)


def header(question: SearchedQuestion, model: etc.EtcModel, asked: AskedStar, digest: str) -> dict[str, Any]:
    """Return what a result says of the star, the instrument and the images."""
    star, strategy = asked.target, model.strategy
    time_s = etc.Span.of(model, question.wall_s, question.visit_time_s).time_s
    return {
        "version": __version__,
        "config_hash": digest,
        "target": str(star.name[0]),
        "hip": int(star.hip[0]) if star.hip[0] else None,
        "v_mag": float(star.v_mag[0]),
        "distance_pc": float(star.distance_pc[0]),
        "catalogue": asked.catalogue,
        "date_utc": star.date_utc,
        "note": asked.note,
        "notes": list(asked.notes),
        "instrument": model.instrument.name,
        "time_s": time_s,
        "sigma": strategy.sigma,
        "search": strategy.search,
        "reference_library": strategy.library,
        "n_modes": strategy.n_modes,
        "images": question.images,
        "seed": question.seed,
    }


def decided_by(question: SearchedQuestion, asked: AskedStar) -> dict[str, Any]:
    """Return everything that decides the result: a star counts by what is known of it, not by its name."""
    return {"config": question.hashed() | {"target": None}, "star": asked.target.content()}


def search_tasks(
    question: SearchedQuestion, seen: Observed, places_arcsec: Sequence[float], planets: Planets, until: int
) -> list[validation.SearchTask]:
    """Return the images of a programme as pieces of work.

    Parameters
    ----------
    question : SearchedQuestion
    seen : Observed
    places_arcsec : sequence of float
        Separations at which the noise is measured.
    planets : sequence
        Planets that are put into the first images.
    until : int
        Number of these images.
    """
    images = replace(seen.images, seed=question.seed).to_dict()
    return [
        validation.SearchTask(
            images, first, min(IMAGES_A_TASK, question.images - first), [*places_arcsec], [*planets], until
        )
        for first in range(0, question.images, IMAGES_A_TASK)
    ]


def search_cost(tasks: Sequence[validation.SearchTask]) -> Cost:
    """Return the expected cost of images and their searches."""
    times, memory_mb, searches = [], 0.0, 0
    for task in tasks:
        cost = validation.task_cost(replace(validation.ConfirmTask(**task.images), realisations=task.count))
        planets = sum(len(contrasts) for _, contrasts, _ in task.planets)
        own = task.count + planets * min(max(task.planets_until - task.first, 0), task.count)
        times.append(cost.work_s + _SEARCH_S * own)
        memory_mb, searches = max(memory_mb, cost.memory_mb), searches + own
    counts = {"n_tasks": len(tasks), "n_realisations": sum(task.count for task in tasks), "n_searches": searches}
    return Cost(counts=counts, times_s=times, start_s=4.0, memory_mb=memory_mb or 200.0, disk_mb=0.5)


@dataclass(frozen=True, eq=False)
class Searched:
    """The findings in the images of a programme.

    Attributes
    ----------
    images : int
        Programmes that were drawn.
    refused : str
        Why there are none; empty where there are.
    sigma : ndarray, shape (images, places)
        Contrast of 1 sigma, NaN where it is not known.
    throughput : ndarray, shape (images, places)
        What the subtraction leaves of a planet.
    alarms : list of ndarray
        Of each image, the number as of `cpic_planner.validation.Candidate.false_alarms` of every peak of noise.
    elements : ndarray, shape (images,)
        Resolution elements that were searched.
    planets : list
        By planet: offsets, shape (n, 2), and numbers as of ``alarms``, shape (n, contrasts), ``inf`` without a peak.
    """

    images: int
    refused: str
    sigma: FloatArray
    throughput: FloatArray
    alarms: list[FloatArray]
    elements: FloatArray
    planets: list[tuple[FloatArray, FloatArray]]

    @classmethod
    def of(cls, bodies: Iterable[Mapping[str, Any]], n_planets: int) -> "Searched":
        """Return what the bodies of `search_task` say, in the order of their images."""
        every = list(bodies)
        refused = next((body["refused"] for body in every if body["refused"]), "")
        drawn = [] if refused else every
        noise = np.array([image for body in drawn for image in body["limits"]], float)
        noise = noise if noise.size else np.zeros((len(noise), 0, 2))
        alarms = [np.array(image, float) for body in drawn for image in body["alarms"]]
        elements = np.array([one for body in drawn for one in body["elements"]], float)
        with_planets = [image for body in drawn for image in body["planets"] if image]
        planets = []
        for index in range(n_planets):
            mine = [image[index] for image in with_planets if image[index]["place"] is not None]
            places = np.array([one["place"] for one in mine], float).reshape(-1, 2)
            peaks = np.array([one["alarms"] for one in mine], float)
            planets.append((places, np.where(np.isnan(peaks), np.inf, peaks)))
        return cls(len(alarms), refused, noise[..., 0], noise[..., 1], alarms, elements, planets)

    def detected(self, alarms: FloatArray, sigma: float) -> BoolArray:
        """Return which peaks are detections at a level, from their numbers as of ``alarms``."""
        return np.asarray(alarms <= self.elements.mean() * special().ndtr(-sigma))


def searched(runner: Runner, tasks: Sequence[validation.SearchTask], n_planets: int) -> Searched:
    """Draw the images of a programme and search them."""
    bodies = runner.finish(
        validation.search_task, [Task(task.key, (task.to_dict(),), steps=task.count) for task in tasks]
    )
    return Searched.of(bodies.values(), n_planets)
