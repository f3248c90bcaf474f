"""``cpic roc``: how likely a planet is found, against the false alarms of a search."""

import functools
from typing import Any

import numpy as np

from cpic_core import special
from cpic_planner import etc
from cpic_planner.confirm import searched
from cpic_planner.jobs import Job, Runner
from cpic_planner.queries import RocQuestion
from cpic_planner.ranking import separation_grid
from cpic_planner.results import EtcAnswer, ReferencePlanetRecord, RocProgramme, RocResult, RocRow
from cpic_planner.validation import fraction_interval

RESULT_VERSION = 5
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""
LEVELS = tuple(np.arange(3.0, 7.01, 0.25).tolist())
"""Levels of a detection beside that of the strategy."""


def roc_job(question: RocQuestion, model: etc.EtcModel, asked: searched.AskedStar) -> Job[RocResult]:
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

    chosen = functools.cache(lambda: [_programme(question, model, asked, band) for band in model.bands])

    def tasks(number: int) -> list[Any]:
        answer, seen = chosen()[number]
        if seen is None or not question.images or answer.contrast is None:
            return []
        place = [float(part) for part in etc.planet_offsets(seen.model, seen.star, seen.band, answer.separation_arcsec)]
        planets = [(answer.separation_arcsec, [answer.contrast], place)]
        return searched.search_tasks(question, seen, [], planets, question.images)

    def work(runner: Runner) -> RocResult:
        bands, levels = [], []
        for number, (answer, seen) in enumerate(chosen()):
            images = searched.searched(runner, tasks(number), 1) if question.images and seen is not None else None
            if seen is not None:
                levels += _levels(seen, images)
            about = {} if images is None else {"images": images.images, "images_message": images.refused}
            bands.append(searched.programme_row(RocProgramme, answer, seen, **about))
        planet = question.planet
        record = ReferencePlanetRecord.of(planet, albedo=planet.albedo.label)
        return RocResult(
            **searched.header(question, model, asked, runner.digest),
            reference_planet=record if question.contrast is None else None,
            bands=bands,
            levels=levels,
        )

    return Job(
        kind="roc",
        results=RESULT_VERSION,
        decides=lambda: searched.decided_by(question, asked) | {"planet": question.planet.content()},
        work=work,
        write=lambda folder, result, bodies: write_roc(folder, result),
        products=ROC_PRODUCTS,
        cost=lambda: searched.search_cost([task for number in range(len(model.bands)) for task in tasks(number)]),
    )


def _programme(
    question: RocQuestion, model: etc.EtcModel, asked: searched.AskedStar, band: str
) -> tuple[EtcAnswer, searched.Observed | None]:
    """Return the programme that shows the planet clearest, at its separation or the best, and the answer for it."""
    place, times = question.separation_arcsec, (question.wall_s, question.visit_time_s)
    if place is None:
        grid = separation_grid(model, band).tolist()
        place = searched.clearest_place(question, model, asked.target, band, grid, question.planet, question.contrast)
    light: dict[str, Any] = {"planet": question.planet, "contrast": question.contrast}
    light |= {"time_s": times[0], "visit_time_s": times[1]}
    (best,) = etc.signal_to_noise(model, asked.target, separation_arcsec=place, bands=[band], **light)
    return best, searched.observed(model, asked.target, best)


def _levels(seen: searched.Observed, images: searched.Searched | None) -> list[RocRow]:
    """Return the levels of a search with what is expected of them, and with what the images showed."""
    answer, tail = seen.answer, special().ndtr
    assert answer.contrast is not None  # as every answer about a planet has it
    sigma = np.unique([*LEVELS, seen.model.strategy.sigma])
    x, y = etc.planet_offsets(seen.model, seen.star, seen.band, answer.separation_arcsec)
    rows, expected = [], seen.prospect(*(np.full(1, part) for part in (x, y, answer.contrast)))
    for level in sigma.tolist():
        chances = expected.at_level(level).chances
        blind, known = (float(chance[0, 0]) for chance in (chances.blind, chances.known_place))
        row = RocRow(
            band=seen.band,
            sigma=level,
            false_alarms=float(seen.elements * tail(-level)),
            detection_probability=blind,
            false_alarms_known_place=float(tail(-level)),
            detection_probability_known_place=known,
        )
        rows.append(row if images is None or not images.images else _counted(row, images))
    return rows


def _counted(row: RocRow, images: searched.Searched) -> RocRow:
    """Return a level with the detections of images."""
    false = sum(int(images.detected(peaks, row.sigma).sum()) for peaks in images.alarms)
    peaks = images.planets[0][1][:, 0]
    hits, n = int(images.detected(peaks, row.sigma).sum()), len(peaks)
    counted: dict[str, Any] = {"n_searches": images.images, "n_false": false, "n_planets": n, "n_detected": hits}
    low, high = fraction_interval(hits, n)
    counted |= {"recovered": hits / n, "recovered_low": float(low), "recovered_high": float(high)}
    return row.model_copy(update=counted)
