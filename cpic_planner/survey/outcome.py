"""Yields of strategies from tables of universes, how they differ, and the calendar as a table for an observatory."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cpic_core import FloatArray, NDArray, dump_json
from cpic_planner import results
from cpic_planner.etc import QUADRANTS
from cpic_planner.survey.estimates import Estimate, convergence, difference_interval, mean_interval, spread
from cpic_planner.survey.events import HOURS
from cpic_planner.survey.schedule import PlannedVisit, VisitOdds
from cpic_planner.survey.simulate import Survey
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.visibility import utc_of
from simulator.imaging import PsfMetrics

Columns = Mapping[str, NDArray[Any]]
_CURVE_POINTS = 41
_QUANTITIES = ("snr", "contrast", "separation_arcsec", "margin", "day")
_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
_MOST_PAIRS = 6
_N_CHANGES = 8
_SAME = 1e-9
_LEAST_SEEN = 2e-3
_MEANS = ("visits", *HOURS, "new_planets", "new_planets_unconditional", "known_planets", "orbits_known")
_ORBIT_MEDIANS = ("epochs", "arc_periods", "axis_error", "place_error_lambda_d")
VISIT_FILES = ("visits.csv", "visits.ecsv", "visits.json")
_PLACE = ("star", "slot", "ordinal")
_MINUTE_S, _HOUR_S = 60.0, 3600.0
_ROUNDING = 1e-6


def outcome(
    survey: Survey, tables: Mapping[str, Columns], first_utc: Sequence[str], images: results.ImageSample | None
) -> results.StrategyOutcome:
    """Return what one strategy yields.

    Parameters
    ----------
    survey : Survey
    tables : mapping
        Rows of this strategy in every table, sorted by universe.
    first_utc : sequence of str
        Date of the first visit of each star; empty for none.
    images : ImageSample, optional
    """
    universes, detections = tables["universes"], tables["detections"]
    strategy, instrument = survey.strategy, survey.model.instrument
    new, known = (universes[name].astype(float) for name in ("new_planets", "known_planets"))
    hours = _quantity(universes, "hours")
    counted = [name for name in universes if name.endswith(("planet", "planets", "unconditional", "alarms", "known"))]
    counts: dict[str, Any] = {name: estimate_record(universes[name].astype(float)) for name in counted}
    planned = [visit for visit in survey.schedule.visits if not visit.reserve]
    return results.StrategyOutcome.of(
        strategy,
        instrument=results.AssumedInstrument.of(
            instrument.drift,
            instrument.sky,
            visit_drift_nm=instrument.drift.visit_nm,
            throughput={band: instrument.bands[band].t_opt for band in strategy.visit.bands},
        ),
        leading_planet=_leading(survey, detections, len(new)),
        settings=strategy.model_dump(mode="json"),
        schedule=results.ScheduleRecord.of(
            survey.schedule,
            visits=len(planned),
            reserve_visits=len(survey.schedule.visits) - len(planned),
            hours=sum(visit.cost_h for visit in planned),
        ),
        planets=estimate_record(new + known),
        **counts,
        occurrence=_occurrence(strategy, float(new.mean())),
        hours=estimate_record(hours),
        any_planet=float(np.mean(new + known > 0)),
        any_new_planet=float(np.mean(new > 0)),
        time_use=_time_use(survey, universes, tables["stars"]),
        curve=_curve(detections, len(new), float(hours.max())),
        convergence=[_point(float(item.n), item) for item in convergence(new + known)],
        quantiles={q: np.quantile(detections[q], _LEVELS).tolist() for q in _QUANTITIES if len(detections[q])},
        targets=_targets(survey, tables["stars"], tables["orbits"], first_utc),
        images=images,
    )


def _leading(survey: Survey, detections: Columns, n: int) -> results.PlanetShare | None:
    """Return the known planet that is found most often; new planets are others in every universe."""
    rows, times = np.unique(detections["known_row"][detections["known_row"] >= 0], return_counts=True)
    if survey.known is None or not len(rows):
        return None
    most = int(np.argmax(times))
    name = survey.known.text("planet")[int(rows[most])]
    return results.PlanetShare(name=name, share=times[most] / len(detections["known_row"]), planets=times[most] / n)


def _occurrence(strategy: SurveyStrategy, new_planets: float) -> results.OccurrenceRange | None:
    """Return the new planets at the ends of the range that is stated of the population's occurrence rate."""
    population = strategy.population
    stated = None if population is None else population.provenance.get("planets_per_star")
    if population is None or population.planets_per_star is None or stated is None or stated.range is None:
        return None
    low, high = stated.range
    return results.OccurrenceRange(
        planets_per_star=population.planets_per_star,
        planets_per_star_low=low,
        planets_per_star_high=high,
        low=new_planets * low / population.planets_per_star,
        high=new_planets * high / population.planets_per_star,
    )


def change_record(found: Estimate) -> results.ChangeRecord:
    """Return the mean of a paired difference as results have it."""
    return results.ChangeRecord.of(found)


def estimate_record(values: FloatArray) -> results.EstimateRecord:
    """Return the mean of a number over universes, with the range of single surveys.

    Parameters
    ----------
    values : ndarray
        One number a universe.
    """
    found = mean_interval(values)
    low, high = spread(values)
    return results.EstimateRecord.of(found, low=max(found.low, min(0.0, found.mean)), survey_low=low, survey_high=high)


def _point(x: float, found: Any) -> results.CurvePoint:
    return results.CurvePoint.of(found, x=x, low=max(found.low, 0.0))


def _time_use(survey: Survey, universes: Columns, stars: Columns) -> results.TimeUse:
    """Return the means over universes; a visit's parts are those of the planned visits of its star."""
    n = len(universes["visits"])
    exposing = settling = 0.0
    settle_h = survey.strategy.visit.settlings * (survey.model.strategy.visits or 1) * survey.calendar.settle_h
    for i, name in enumerate(survey.targets.name):
        mine = stars["star"] == name
        visits = float(stars["visits"][mine].sum()) / n
        own = _planned(survey, i)
        if own:
            exposing += visits * float(np.mean([survey.options[i][visit.option].time_s for visit in own])) / 3600.0
            settling += visits * settle_h
    search, follow, alarm = (float(universes[name].mean()) for name in HOURS)
    budget_h = survey.strategy.time_budget_h
    return results.TimeUse(
        exposing_h=exposing,
        occulted_h=max(0.0, search - exposing - settling),
        settling_h=settling,
        follow_up_h=follow,
        alarm_h=alarm,
        unused_h=max(0.0, budget_h - search - follow - alarm),
        budget_h=budget_h,
        budget_share=budget_h / float(survey.calendar.slot_h.sum()),
    )


def _planned(survey: Survey, star: int) -> list[PlannedVisit]:
    return [visit for visit in survey.schedule.visits if visit.star == star]


def _curve(detections: Columns, n: int, most_h: float) -> list[results.CurvePoint]:
    """Return the planets found by the time that so many hours were used, up to the longest survey."""
    universe = detections["universe"] - detections["universe"].min(initial=0)
    used = detections["used_h"]
    _, universe = np.unique(universe, return_inverse=True)
    points = []
    for hours in np.linspace(0.0, most_h, _CURVE_POINTS):
        counts = np.zeros(n)
        early = np.bincount(universe[used <= hours + 1e-9])
        counts[: len(early)] = early
        points.append(_point(float(hours), mean_interval(counts)))
    return points


def _targets(survey: Survey, stars: Columns, orbits: Columns, first_utc: Sequence[str]) -> list[results.SurveyTarget]:
    rows = []
    for i, name in enumerate(survey.targets.name):
        own = _planned(survey, i)
        mine = stars["star"] == name
        if not own or not mine.any():
            continue
        mean = {key: float(stars[key][mine].sum()) / float(stars["universes"][mine].sum()) for key in _MEANS}
        hours = sum(mean[name] for name in HOURS)
        known_seen = mean.pop("known_planets")
        known = [] if survey.known is None else survey.known.text("planet")
        ways = [survey.options[i][visit.option] for visit in own]
        rows.append(
            results.SurveyTarget.of(
                survey.targets,
                at=i,
                rank=0,
                known_planets=[known[row] for row in survey.known_rows[i]],
                bands=list(dict.fromkeys(way.band for way in ways)),
                visit_time_s=float(np.mean([way.time_s for way in ways])),
                visit_h=float(np.mean([visit.cost_h for visit in own])),
                planned_visits=sum(not visit.reserve for visit in own),
                slots=[visit.slot for visit in own],
                first_utc=first_utc[i],
                **mean,
                known_seen=known_seen,
                **{f"orbit_{key}": _median(orbits[key][orbits["star"] == name]) for key in _ORBIT_MEDIANS},
                planets_per_100h=100.0 * (mean["new_planets"] + known_seen) / hours if hours > 0 else 0.0,
            )
        )
    rows.sort(key=lambda row: (-row.planets_per_100h, row.name))
    return [row.model_copy(update={"rank": rank}) for rank, row in enumerate(rows, 1)]


def _median(values: FloatArray) -> float | None:
    return float(np.median(values)) if len(values) else None


def differences(names: Sequence[str], universes: Sequence[Columns]) -> list[results.DifferenceRecord]:
    """Return the paired differences: all pairs of a few strategies; of many each with the first one, and the best two.

    Parameters
    ----------
    names : sequence of str
    universes : sequence of mapping
        Rows of each strategy in the table of universes, the same universes in the same order.
    """
    if len(names) <= _MOST_PAIRS:
        pairs = [(b, a) for a in range(len(names)) for b in range(a + 1, len(names))]
    else:
        pairs = [(b, 0) for b in range(1, len(names))]
        means = [float(_quantity(columns, "planets").mean()) for columns in universes]
        best, second = sorted(range(len(names)), key=lambda k: (-means[k], k))[:2]
        if 0 not in (best, second):
            pairs.append((best, second))
    return [
        _difference(names[b], names[a], quantity, *(_quantity(universes[k], quantity) for k in (b, a)))
        for b, a in pairs
        for quantity in ("planets", "new_planets", "characterised_planets", "orbits_known", "hours")
    ]


def _quantity(universes: Columns, name: str) -> FloatArray:
    parts = {"planets": ("new_planets", "known_planets"), "hours": HOURS}.get(name, (name,))
    return np.asarray(sum(universes[part].astype(float) for part in parts))


def _difference(first: str, second: str, quantity: Any, one: FloatArray, other: FloatArray) -> results.DifferenceRecord:
    found = difference_interval(one - other)
    varies = bool(np.ptp(one) > _SAME * np.abs(one).max() and np.ptp(other) > _SAME * np.abs(other).max())
    unit = " h" if quantity == "hours" else ""
    if found.low > 0.0 or found.high < 0.0:
        word = "more" if found.mean > 0 else "fewer"
        verdict = f"{first}: {abs(found.mean):.3g}{unit} {word} than {second}"
    else:
        verdict = f"{first} and {second} do not differ by more than chance"
    correlation = float(np.corrcoef(one, other)[0, 1]) if varies else None
    return results.DifferenceRecord.of(
        found, first=first, second=second, quantity=quantity, verdict=verdict, correlation=correlation
    )


def rank_changes(outcomes: Sequence[results.StrategyOutcome]) -> list[results.RankChange]:
    """Return the stars that other strategies rank elsewhere than the first, the largest changes, with reasons."""
    first = {target.name: target for target in outcomes[0].targets}
    found = []
    for other in outcomes[1:]:
        mine = {target.name: target for target in other.targets}
        behind = max(len(first), len(mine)) + 1
        moved = []
        for name in {*first, *mine}:
            both = first.get(name), mine.get(name)
            old, new = (None if target is None else target.rank for target in both)
            # A star has to show enough planets in one of the two for its rank to be more than chance.
            shown = any(target and target.new_planets + target.known_seen >= _LEAST_SEEN for target in both)
            if old != new and shown:
                change = results.RankChange(strategy=other.name, star=name, first_rank=old, rank=new, why=_why(*both))
                moved.append((-abs((new or behind) - (old or behind)), name, change))
        found += [change for *_, change in sorted(moved)[:_N_CHANGES]]
    return found


def _why(old: results.SurveyTarget | None, new: results.SurveyTarget | None) -> str:
    if old is None and new is not None:
        return f"visited here only: {new.new_planets + new.known_seen:.3f} planets in {new.visits:.1f} visits"
    if new is None or old is None:
        return "not visited: a visit gives less there than the strategy asks, or its other targets more"
    parts = []
    if old.bands != new.bands:
        parts.append(f"{'/'.join(new.bands)} instead of {'/'.join(old.bands)}")
    if abs(old.visit_h - new.visit_h) > 0.05 * old.visit_h:
        parts.append(f"{new.visit_h:.1f} h a visit instead of {old.visit_h:.1f}")
    if abs(old.visits - new.visits) > 0.05 * max(old.visits, 0.1):
        parts.append(f"{new.visits:.1f} visits instead of {old.visits:.1f}")
    gain_old, gain_new = old.new_planets + old.known_seen, new.new_planets + new.known_seen
    parts.append(f"{gain_new:.3f} planets instead of {gain_old:.3f}")
    return ", ".join(parts)


def planned_rows(survey: Survey, every_odds: Sequence[VisitOdds]) -> Iterator[results.PlannedVisitRow]:
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
        yield results.PlannedVisitRow(
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
            arcs=max(1, math.ceil((visit.cost_h - settled_h) * _HOUR_S / calendar.period_s - _ROUNDING)),
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


def _digits(value: float) -> float:
    """Return six digits, which no camera can tell from more."""
    return float(f"{value:.6g}")


def _quadrants(metrics: PsfMetrics) -> str:
    """Return the quadrants of the hole: all, or the names of the two on its side."""
    if metrics.hole_mode != "2q":
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
    table = results.VisitsResult(visits=every, **about)
    rows, meta = table.visits, table.model_dump(mode="json", exclude={"visits"})
    texts = (
        results.csv_text(results.names_of(results.PlannedVisitRow), map(results.values_of, rows)),
        results.ecsv_text(results.taken_of(results.PlannedVisitRow), rows, meta),
        dump_json(table.model_dump(mode="json")),
    )
    return dict(zip(VISIT_FILES, texts, strict=True))
