"""``cpic curve`` and ``cpic roc``: one programme of a star in each band, by closed forms and in searched images.

A curve is contrast limits against separation, completeness, and planets that are recovered from images. An operating
characteristic is how likely a planet is found, against the false alarms of a search.
"""

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_core import BoolArray, FloatArray, Record, special
from cpic_planner import etc, results, validation
from cpic_planner.jobs import Cost, Job, Runner, Task
from cpic_planner.queries import CurveQuestion, ReferencePlanet, RocQuestion, SearchedQuestion
from cpic_planner.targets import Targets
from cpic_planner.validation import azimuth_share, azimuths_inside, fraction_interval
from cpic_planner.version import __version__

IMAGES_A_TASK = 50
"""Images of one piece of work: its set-up takes as long as so many of them."""
_SEARCH_S = 0.03
"""Processor time of one blind search."""

Planets = Sequence[tuple[float, list[float], list[float]]]
"""Planets that are put into images, in the form of `cpic_planner.validation.SearchTask.planets`."""


class AskedStar(Record):
    """A star that is asked about: its row, the table that it is from, and remarks on its name and on that table."""

    target: Targets
    catalogue: str
    note: str
    notes: tuple[str, ...] = ()


class Observed(Record, eq=False):
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
    answer: results.EtcAnswer

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


def observed(model: etc.EtcModel, star: Targets, answer: results.EtcAnswer) -> Observed | None:
    """Return the programme that an answer is about; None where it has no frame."""
    frames = validation.Frames.of(answer)
    if frames is None:
        return None
    fixed = replace(model, strategy=model.strategy.model_copy(update={"visits": frames.visits}))
    return Observed(fixed, star, answer.band, frames, answer)


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


class Searched(Record, eq=False):
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


def searched(runner: Runner[Any], tasks: Sequence[validation.SearchTask]) -> Searched:
    """Draw the images of a programme and search them."""
    work = [Task(task.key, (task.to_dict(),), steps=task.count) for task in tasks]
    return Searched.of(runner.finish(validation.search_task, work).values(), len(tasks[0].planets))


def _job(
    question: SearchedQuestion,
    model: etc.EtcModel,
    asked: AskedStar,
    *,
    programme: Callable[[str], tuple[results.EtcAnswer, Observed | None]],
    tasks: Callable[[Observed], list[validation.SearchTask]],
    row: type[results.SearchedProgramme],
    answered: Callable[[dict[str, Any], Sequence[tuple[Observed, Searched | None]]], Any],
    **how: Any,
) -> Job[Any]:
    """Return the job of one programme a band, drawn as images and searched where images are asked for.

    Parameters
    ----------
    question : SearchedQuestion
    model : EtcModel
    asked : AskedStar
    programme : callable
        The programme of a band, None without a frame, and the answer that chose it.
    tasks : callable
        Images of a programme.
    row : type of SearchedProgramme
    answered : callable
        The result, from what it says of star, instrument and bands, and the programmes with the findings in images.
    **how
        Of the `Job`.
    """
    chosen = functools.cache(lambda: [programme(band) for band in model.bands])
    every = functools.cache(lambda: [tasks(seen) if seen and question.images else [] for _, seen in chosen()])

    def work(runner: Runner[Any]) -> Any:
        bands, found = [], []
        for (answer, seen), own in zip(chosen(), every(), strict=True):
            images = searched(runner, own) if own else None
            about: dict[str, Any] = {name: getattr(answer, name).value for name in ("status", "reason")}
            if images is not None:
                about |= {"images": images.images, "images_message": images.refused}
            bands.append(row.of(answer, **about, resolution_elements=seen and seen.elements))
            if seen is not None:
                found.append((seen, images))
        return answered(header(question, model, asked, runner.digest) | {"bands": bands}, found)

    return Job(work=work, cost=lambda: search_cost([task for own in every() for task in own]), **how)


CURVE_VERSION = 4
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""
N_PLACES = 25
"""Separations of a curve: straight lines between them miss at most 0.5 % of a limit."""
N_CONTRASTS = 33
FAINTEST, BRIGHTEST = 0.25, 25.0
"""Contrasts of a map, over the faintest limit."""
N_AZIMUTHS = 24
"""Azimuths whose mean stands for a circle."""
N_INJECTED = 5, 6
"""Separations and contrasts of injected planets."""
FAINTEST_INJECTED, BRIGHTEST_INJECTED = 0.5, 3.0
"""Their contrasts, over the faintest limit."""
_TRIAL = 1e-9


def curve_job(question: CurveQuestion, model: etc.EtcModel, asked: AskedStar) -> Job[results.CurveResult]:
    """Return the job that makes the contrast curves of a star, its maps of completeness, and recovers planets.

    Parameters
    ----------
    question : CurveQuestion
    model : EtcModel
        Of the instrument, bands and strategy of the question.
    asked : AskedStar

    Notes
    -----
    One programme a band, that which sees faintest at the best of the separations: every limit of a band is about the
    same frames, which images can show. The limit of `cpic_planner.contrast_limit` is that of the best frames at each
    separation; where the programme is the best one it is the same.
    """
    from cpic_planner.report import CURVE_PRODUCTS, write_curve

    curve = functools.cache(lambda seen: _curve(question, seen))

    def tasks(seen: Observed) -> list[validation.SearchTask]:
        rows = curve(seen)
        places = [row.separation_arcsec for row in rows]
        return search_tasks(question, seen, places, _injected(question, rows), question.injections)

    def answered(about: dict[str, Any], found: Sequence[tuple[Observed, Searched | None]]) -> results.CurveResult:
        points, maps, recovered = [], [], []
        for seen, images in found:
            rows = curve(seen)
            maps += _map(seen, rows)
            if images is not None and images.images:
                rows = _measured(rows, images)
                recovered += _recovered(seen, _injected(question, rows), images)
            points += rows
        return results.CurveResult(
            **about, injections=question.injections, points=points, maps=maps, recovered=recovered
        )

    return _job(
        question,
        model,
        asked,
        programme=lambda band: _curve_programme(question, model, asked, band),
        tasks=tasks,
        row=results.SearchedProgramme,
        answered=answered,
        kind="curve",
        results=CURVE_VERSION,
        decides=lambda: decided_by(question, asked),
        write=lambda folder, result, bodies: write_curve(folder, result),
        products=CURVE_PRODUCTS,
    )


def _curve_programme(
    question: CurveQuestion, model: etc.EtcModel, asked: AskedStar, band: str
) -> tuple[results.EtcAnswer, Observed | None]:
    """Return the programme of faintest limit, at the best separation, and the answer that chose it."""
    grid = question.separation_arcsec or etc.separation_grid(model, band).tolist()
    place = clearest_place(question, model, asked.target, band, grid)
    times: dict[str, Any] = {"time_s": question.wall_s, "visit_time_s": question.visit_time_s}
    (best,) = etc.contrast_limit(model, asked.target, separation_arcsec=place, bands=[band], **times)
    return best, observed(model, asked.target, best)


def _curve(question: CurveQuestion, seen: Observed) -> list[results.CurveRow]:
    """Return the limits of a programme by closed forms."""
    inner, *_, outer = etc.separation_grid(seen.model, seen.band).tolist()
    places = [*(question.separation_arcsec or np.geomspace(inner, outer, N_PLACES).tolist())]
    fixed: dict[str, Any] = {"visit_time_s": seen.visit_time_s, "exact": True}
    fixed |= {"exposure_s": seen.frames.exposure_s, "em_gain": seen.frames.em_gain}
    limits = []
    for search in ("blind", "known_place"):
        strategy = seen.model.strategy.model_copy(update={"search": search})
        looked = replace(seen.model, strategy=strategy)
        found = etc.contrast_limit(looked, seen.star, separation_arcsec=places, bands=[seen.band], **fixed)
        limits.append(found)
    offsets = [etc.planet_offsets(seen.model, seen.star, seen.band, place) for place in places]
    x, y = np.array(offsets, float).T
    margin = seen.prospect(x, y, np.full(len(places), _TRIAL)).margin[0]
    geometry = seen.model.metrics[seen.band].geometry
    rows = []
    for blind, known, of_trial in zip(*limits, margin.tolist(), strict=True):
        reached = blind.value is not None or known.value is not None
        row = results.CurveRow.of(
            blind,
            contrast_limit_blind=blind.value,
            contrast_limit_known_place=known.value,
            contrast_limit_threshold=_TRIAL / of_trial if reached and of_trial > 0.0 else None,
            threshold=blind.threshold or known.threshold,
            azimuth_share=azimuth_share(geometry, blind.separation_arcsec),
            status=blind.status.value,
            reason=blind.reason.value,
        )
        rows.append(row)
    return rows


def _limits(rows: Sequence[results.CurveRow]) -> FloatArray:
    """Return the blind limits of a curve, those that there are."""
    return np.array([row.contrast_limit_blind for row in rows if row.contrast_limit_blind is not None], float)


def _map(seen: Observed, rows: Sequence[results.CurveRow]) -> list[results.CompletenessMap]:
    """Return the map of the places of a curve that are in the dark hole; none where nothing can be found."""
    limits = _limits(rows)
    inside = [row for row in rows if row.azimuth_share > 0.0 and row.threshold is not None]
    if not limits.size or not inside:
        return []
    geometry = seen.model.metrics[seen.band].geometry
    contrast = np.geomspace(FAINTEST, BRIGHTEST, N_CONTRASTS) * limits.min()
    places = [row.separation_arcsec for row in inside]
    angle = np.stack([_spread(azimuths_inside(geometry, place)) for place in places])
    separation = np.array(places)[:, None]
    x, y = (np.repeat((separation * turn(angle)).ravel(), N_CONTRASTS) for turn in (np.cos, np.sin))
    expected = seen.prospect(x, y, np.tile(contrast, angle.size))
    blind, known = (
        chance.reshape(len(places), N_AZIMUTHS, N_CONTRASTS).mean(axis=1).tolist()
        for chance in (expected.chances.blind, expected.chances.known_place)
    )
    return [
        results.CompletenessMap(
            band=seen.band,
            separation_arcsec=places,
            contrast=contrast.tolist(),
            azimuth_share=[row.azimuth_share for row in inside],
            chance=blind,
            chance_known_place=known,
        )
    ]


def _spread(angle: FloatArray) -> FloatArray:
    """Return the azimuths that stand for all of them, in the middles of equal parts."""
    middles = (np.arange(N_AZIMUTHS) + 0.5) / N_AZIMUTHS
    return np.asarray(angle[(middles * len(angle)).astype(int)])


def _injected(question: CurveQuestion, rows: Sequence[results.CurveRow]) -> Planets:
    """Return the planets that are put into the images of a curve."""
    limits, inside = _limits(rows), [row.separation_arcsec for row in rows if row.azimuth_share > 0.0]
    if not question.injections or not limits.size or not inside:
        return []
    n_places, n_contrasts = N_INJECTED
    contrasts = (np.geomspace(FAINTEST_INJECTED, BRIGHTEST_INJECTED, n_contrasts) * limits.min()).tolist()
    # The ends of a whole curve are corners of the hole, where a circle holds next to no aperture.
    middle = (np.arange(n_places) + 0.5) / n_places * len(inside)
    chosen = sorted({inside[int(place)] for place in middle})
    return [(place, contrasts, []) for place in chosen]


def _measured(rows: Sequence[results.CurveRow], images: Searched) -> list[results.CurveRow]:
    """Return the rows of a curve with the limits that images showed beside the predicted ones."""
    told = []
    for row, sigma, left in zip(rows, images.sigma.T, images.throughput.T, strict=True):
        if row.threshold is None or not np.isfinite(sigma).all():
            told.append(row)
            continue
        variance = sigma**2
        mean = math.sqrt(float(variance.mean()))
        error = None
        if len(sigma) > 1:
            error = row.threshold * float(variance.std(ddof=1)) / (2.0 * mean * math.sqrt(len(sigma)))
        update = {"measured_limit": row.threshold * mean, "measured_limit_error": error}
        told.append(row.model_copy(update=update | {"measured_throughput": float(left.mean())}))
    return told


def _recovered(seen: Observed, planets: Planets, images: Searched) -> list[results.RecoveredRow]:
    """Return the fractions of injected planets that were found, beside those that the law expects."""
    rows = []
    for (place, contrasts, _), (offsets, alarms) in zip(planets, images.planets, strict=True):
        n = len(offsets)
        for number, contrast in enumerate(contrasts if n else []):
            hits = int(images.detected(alarms[:, number], seen.model.strategy.sigma).sum())
            low, high = fraction_interval(hits, n)
            expected = seen.prospect_in_images(offsets[:, 0], offsets[:, 1], np.full(n, contrast)).chances.blind
            row = results.RecoveredRow(
                band=seen.band,
                separation_arcsec=place,
                contrast=contrast,
                n_injected=n,
                n_recovered=hits,
                recovered=hits / n,
                recovered_low=float(low),
                recovered_high=float(high),
                predicted=float(expected.mean()),
            )
            rows.append(row)
    return rows


ROC_VERSION = 5
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""
LEVELS = tuple(np.arange(3.0, 7.01, 0.25).tolist())
"""Levels of a detection beside that of the strategy."""


def roc_job(question: RocQuestion, model: etc.EtcModel, asked: AskedStar) -> Job[results.RocResult]:
    """Return the job that makes the operating characteristics of a search for a planet.

    Parameters
    ----------
    question : RocQuestion
    model : EtcModel
        Of the instrument, bands and strategy of the question.
    asked : AskedStar

    Notes
    -----
    One programme a band, that which shows the planet clearest. Images have the planet at one place, and the search does
    not know it. The prediction takes a companion's light as the mean over the annulus that measures the noise, the
    search takes it place by place: beside a bright companion, in the darkest quadrant, images find more than predicted.
    """
    from cpic_planner.report import ROC_PRODUCTS, write_roc

    def tasks(seen: Observed) -> list[validation.SearchTask]:
        separation, contrast = seen.answer.separation_arcsec, seen.answer.contrast
        if contrast is None:
            return []
        place = [float(part) for part in etc.planet_offsets(seen.model, seen.star, seen.band, separation)]
        return search_tasks(question, seen, [], [(separation, [contrast], place)], question.images)

    def answered(about: dict[str, Any], found: Sequence[tuple[Observed, Searched | None]]) -> results.RocResult:
        planet = question.planet
        record = (
            results.ReferencePlanetRecord.of(planet, albedo=planet.albedo.label) if question.contrast is None else None
        )
        levels = [row for seen, images in found for row in _levels(seen, images)]
        return results.RocResult(**about, reference_planet=record, levels=levels)

    return _job(
        question,
        model,
        asked,
        programme=lambda band: _roc_programme(question, model, asked, band),
        tasks=tasks,
        row=results.RocProgramme,
        answered=answered,
        kind="roc",
        results=ROC_VERSION,
        decides=lambda: decided_by(question, asked) | {"planet": question.planet.content()},
        write=lambda folder, result, bodies: write_roc(folder, result),
        products=ROC_PRODUCTS,
    )


def _roc_programme(
    question: RocQuestion, model: etc.EtcModel, asked: AskedStar, band: str
) -> tuple[results.EtcAnswer, Observed | None]:
    """Return the programme that shows the planet clearest, at its separation or the best, and the answer for it."""
    place, times = question.separation_arcsec, (question.wall_s, question.visit_time_s)
    if place is None:
        grid = etc.separation_grid(model, band).tolist()
        place = clearest_place(question, model, asked.target, band, grid, question.planet, question.contrast)
    light: dict[str, Any] = {"planet": question.planet, "contrast": question.contrast}
    light |= {"time_s": times[0], "visit_time_s": times[1]}
    (best,) = etc.signal_to_noise(model, asked.target, separation_arcsec=place, bands=[band], **light)
    return best, observed(model, asked.target, best)


def _levels(seen: Observed, images: Searched | None) -> list[results.RocRow]:
    """Return the levels of a search with what is expected of them, and with what the images showed."""
    answer, tail = seen.answer, special().ndtr
    assert answer.contrast is not None  # as every answer about a planet has it
    sigma = np.unique([*LEVELS, seen.model.strategy.sigma])
    x, y = etc.planet_offsets(seen.model, seen.star, seen.band, answer.separation_arcsec)
    rows, expected = [], seen.prospect(*(np.full(1, part) for part in (x, y, answer.contrast)))
    for level in sigma.tolist():
        chances = expected.at_level(level).chances
        blind, known = (float(chance[0, 0]) for chance in (chances.blind, chances.known_place))
        row = results.RocRow(
            band=seen.band,
            sigma=level,
            false_alarms=float(seen.elements * tail(-level)),
            detection_probability=blind,
            false_alarms_known_place=float(tail(-level)),
            detection_probability_known_place=known,
        )
        rows.append(row if images is None or not images.images else _counted(row, images))
    return rows


def _counted(row: results.RocRow, images: Searched) -> results.RocRow:
    """Return a level with the detections of images."""
    false = sum(int(images.detected(peaks, row.sigma).sum()) for peaks in images.alarms)
    peaks = images.planets[0][1][:, 0]
    hits, n = int(images.detected(peaks, row.sigma).sum()), len(peaks)
    counted: dict[str, Any] = {"n_searches": images.images, "n_false": false, "n_planets": n, "n_detected": hits}
    low, high = fraction_interval(hits, n)
    counted |= {"recovered": hits / n, "recovered_low": float(low), "recovered_high": float(high)}
    return row.model_copy(update=counted)
