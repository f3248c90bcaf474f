"""``cpic curve``: contrast limits against separation, completeness, and planets that are recovered from images."""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_core import FloatArray
from cpic_planner import etc
from cpic_planner.confirm import searched
from cpic_planner.jobs import Job, Runner
from cpic_planner.queries import CurveQuestion
from cpic_planner.ranking import separation_grid
from cpic_planner.results import CompletenessMap, CurveResult, CurveRow, EtcAnswer, RecoveredRow, SearchedProgramme
from cpic_planner.validation import azimuth_share, azimuths_inside, fraction_interval

RESULT_VERSION = 4
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


def curve_job(question: CurveQuestion, model: etc.EtcModel, asked: searched.AskedStar) -> Job[CurveResult]:
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

    chosen = functools.cache(lambda: [_programme(question, model, asked, band) for band in model.bands])
    curves = functools.cache(lambda: [_curve(question, *one) for one in chosen()])

    def tasks(number: int) -> list[Any]:
        seen, rows = chosen()[number][1], curves()[number]
        if seen is None or not question.images:
            return []
        places = [row.separation_arcsec for row in rows]
        return searched.search_tasks(question, seen, places, _injected(question, rows), question.injections)

    def work(runner: Runner) -> CurveResult:
        bands, points, maps, recovered = [], [], [], []
        for number, (answer, seen) in enumerate(chosen()):
            rows = curves()[number]
            images = (
                searched.searched(runner, tasks(number), len(_injected(question, rows))) if question.images else None
            )
            if seen is not None:
                maps += _map(seen, rows)
            if seen is not None and images is not None and images.images:
                rows = _measured(rows, images)
                recovered += _recovered(seen, _injected(question, rows), images)
            about = {} if images is None else {"images": images.images, "images_message": images.refused}
            bands.append(searched.programme_row(SearchedProgramme, answer, seen, **about))
            points += rows
        return CurveResult(
            **searched.header(question, model, asked, runner.digest),
            injections=question.injections,
            bands=bands,
            points=points,
            maps=maps,
            recovered=recovered,
        )

    return Job(
        kind="curve",
        results=RESULT_VERSION,
        decides=lambda: searched.decided_by(question, asked),
        work=work,
        write=lambda folder, result, bodies: write_curve(folder, result),
        products=CURVE_PRODUCTS,
        cost=lambda: searched.search_cost([task for number in range(len(model.bands)) for task in tasks(number)]),
    )


def _programme(
    question: CurveQuestion, model: etc.EtcModel, asked: searched.AskedStar, band: str
) -> tuple[EtcAnswer, searched.Observed | None]:
    """Return the programme of faintest limit, at the best separation, and the answer that chose it."""
    grid = question.separation_arcsec or separation_grid(model, band).tolist()
    place = searched.clearest_place(question, model, asked.target, band, grid)
    times: dict[str, Any] = {"time_s": question.wall_s, "visit_time_s": question.visit_time_s}
    (best,) = etc.contrast_limit(model, asked.target, separation_arcsec=place, bands=[band], **times)
    return best, searched.observed(model, asked.target, best)


def _curve(question: CurveQuestion, answer: EtcAnswer, seen: searched.Observed | None) -> list[CurveRow]:
    """Return the limits of a programme by closed forms."""
    if seen is None:
        return []
    inner, *_, outer = separation_grid(seen.model, seen.band).tolist()
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
        row = CurveRow.of(
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


def _limits(rows: Sequence[CurveRow]) -> FloatArray:
    """Return the blind limits of a curve, those that there are."""
    return np.array([row.contrast_limit_blind for row in rows if row.contrast_limit_blind is not None], float)


def _map(seen: searched.Observed, rows: Sequence[CurveRow]) -> list[CompletenessMap]:
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
        CompletenessMap(
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


def _injected(question: CurveQuestion, rows: Sequence[CurveRow]) -> searched.Planets:
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


def _measured(rows: Sequence[CurveRow], images: searched.Searched) -> list[CurveRow]:
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


def _recovered(seen: searched.Observed, planets: searched.Planets, images: searched.Searched) -> list[RecoveredRow]:
    """Return the fractions of injected planets that were found, beside those that the law expects."""
    rows = []
    for (place, contrasts, _), (offsets, alarms) in zip(planets, images.planets, strict=True):
        n = len(offsets)
        for number, contrast in enumerate(contrasts if n else []):
            hits = int(images.detected(alarms[:, number], seen.model.strategy.sigma).sum())
            low, high = fraction_interval(hits, n)
            expected = seen.prospect_in_images(offsets[:, 0], offsets[:, 1], np.full(n, contrast)).chances.blind
            row = RecoveredRow(
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
