"""The calendar of every strategy as a table for an observatory: one line a visit, as CSV, ECSV and JSON."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import FloatArray, dump_json
from cpic_planner.etc.planet import QUADRANTS
from cpic_planner.results import PlannedVisitRow, VisitsResult, csv_text, ecsv_text, names_of, values_of
from cpic_planner.survey.schedule import PlannedVisit, Problem
from cpic_planner.survey.simulate import Survey
from cpic_planner.survey.universe import NEW
from cpic_planner.survey.visibility import utc_of
from simulator.imaging import PsfMetrics

VISIT_FILES = ("visits.csv", "visits.ecsv", "visits.json")
_MINUTE_S, _HOUR_S = 60.0, 3600.0
_ROUNDING = 1e-6


@dataclass(frozen=True)
class VisitOdds:
    """What a planned visit is likely to bring.

    Attributes
    ----------
    probability : float
        That it completes the detection of at least one planet.
    known : bool
        Whether that is more likely of a known planet than of a new one.
    """

    probability: float
    known: bool


def visit_odds(problem: Problem, visits: Iterable[PlannedVisit]) -> tuple[VisitOdds, ...]:
    """Return the odds of visits in the order of time, the star's earlier ones made as planned.

    Parameters
    ----------
    problem : Problem
        With the planets that the schedule was made with.
    visits : iterable of PlannedVisit
        In the order of time; what a reserve visit would show is taken from no later one.

    Notes
    -----
    With ``p`` the chance that the visit detects a planet and ``c`` that earlier visits have brought it to one detection
    less than it needs, each draw of a new planet stands for a Poisson number of mean ``w``, of which the visit
    completes ``mu = sum w p c``; those of a known planet add up to the probability ``q`` that it is completed. The
    probability of at least one is ``1 - exp(-mu) product(1 - q)``.
    """
    strategy, states, found = problem.strategy, {}, []
    for visit in visits:
        star = problem.stars[visit.star]
        counts: FloatArray = states.setdefault(visit.star, np.eye(problem.needed, 1) * np.ones(len(star.weight)))
        chance = star.chance[visit.option, visit.slot].astype(np.float64)
        new = star.known == NEW
        # The scheduler's weights hold what a planet is worth to it; how likely it is does not.
        weight = star.weight / np.where(new, strategy.value_new, strategy.value_known)
        completed = weight * chance * counts[-1]
        each = [min(float(completed[star.known == row].sum()), 1.0) for row in np.unique(star.known[~new])]
        none_new, none_known = math.exp(-float(completed[new].sum())), math.prod(1.0 - item for item in each)
        found.append(VisitOdds(1.0 - none_new * none_known, none_known < none_new))
        if not visit.reserve:
            after = counts * (1.0 - chance)
            after[1:] += counts[:-1] * chance
            states[visit.star] = after
    return tuple(found)


def planned_rows(survey: Survey, every_odds: Sequence[VisitOdds]) -> Iterator[PlannedVisitRow]:
    """Yield the visits of a strategy in the order of its calendar.

    Parameters
    ----------
    survey : Survey
    every_odds : sequence of VisitOdds
        Of the visits of its schedule.
    """
    visits, calendar, reduction = survey.schedule.visits, survey.calendar, survey.model.strategy
    stars, slots, ordinals = (np.array([getattr(item, name) for item in visits], np.int64) for name in _PLACE)
    rolls = [
        float(calendar.roll_deg(survey.strategy.revisits, star, slots[k : k + 1], ordinals[k : k + 1])[0])
        for k, star in enumerate(stars.tolist())
    ]
    opens, closes = (calendar.start_mjd + days[stars, slots] for days in (calendar.opens_day, calendar.closes_day))
    texts = [utc_of(part) if len(visits) else [] for part in (opens, closes)]
    together = reduction.visits or 1
    settled_h = together * survey.strategy.visit.settlings * calendar.settle_h
    for k, (visit, odds) in enumerate(zip(visits, every_odds, strict=True)):
        star, slot = visit.star, visit.slot
        setting, name = survey.options[star][visit.option], str(survey.targets.name[star])
        followed = survey.log is not None and any(item.planets for item in survey.log.of(name))
        yield PlannedVisitRow(
            strategy=survey.strategy.name,
            visit=k + 1,
            star=name,
            hip=int(survey.targets.hip[star]) or None,
            ra_deg=round(float(survey.targets.ra_deg[star]), 6),
            dec_deg=round(float(survey.targets.dec_deg[star]), 6),
            reason="follow_up" if followed else "known_planet" if odds.known else "search",
            reserve=visit.reserve,
            window_start_utc=texts[0][k],
            window_end_utc=texts[1][k],
            window_start_mjd=round(float(opens[k]), 5),
            window_end_mjd=round(float(closes[k]), 5),
            arcs=math.ceil((visit.cost_h - settled_h) * _HOUR_S / calendar.period_s - _ROUNDING),
            arc_usable_min=round(float(calendar.fraction[star, slot]) * calendar.period_s / _MINUTE_S, 2),
            arc_longest_min=round(float(calendar.window_s[star, slot]) / _MINUTE_S, 2),
            roll_deg=round(rolls[k], 2),
            quadrants=_quadrants(survey.model.metrics[setting.band]),
            band=setting.band,
            exposure_s=_digits(setting.exposure_s),
            visits=together,
            frames_per_visit=int(setting.n_frames),
            em_gain=_digits(setting.em_gain),
            reference_library=reduction.library,
            reference_ratio=reduction.reference_ratio,
            time_s=round(setting.time_s, 1),
            telescope_h=round(visit.cost_h, 3),
            probability=round(odds.probability, 6),
        )


_PLACE = ("star", "slot", "ordinal")


def _digits(value: float) -> float:
    """Six digits, which no camera can tell from more."""
    return float(f"{value:.6g}")


def _quadrants(metrics: PsfMetrics) -> str:
    """Quadrants of the hole: all, or the names of the two on its side."""
    if metrics.hole_mode == "4q":
        return "all"
    side = {"top": "upper", "bottom": "lower"}.get(metrics.hole_side, metrics.hole_side)
    return "; ".join(name for name in QUADRANTS if side in name)


def visit_files(
    surveys: Sequence[Survey], odds: Sequence[Sequence[VisitOdds]], about: Mapping[str, Any]
) -> dict[str, str]:
    """Return the texts of `VISIT_FILES`, which are one table.

    Parameters
    ----------
    surveys : sequence of Survey
    odds : sequence of sequence of VisitOdds
        Of the visits of each.
    about : mapping
        The other fields of `cpic_planner.results.VisitsResult`.
    """
    every = [row for survey, own in zip(surveys, odds, strict=True) for row in planned_rows(survey, own)]
    table = VisitsResult(visits=every, **about)
    rows, meta = table.visits, table.model_dump(mode="json", exclude={"visits"})
    texts = (
        csv_text(names_of(PlannedVisitRow), map(values_of, rows)),
        ecsv_text(PlannedVisitRow, rows, meta),
        dump_json(table.model_dump(mode="json")),
    )
    return dict(zip(VISIT_FILES, texts, strict=True))
