"""From tables of universes to what strategies yield, how they differ, and which stars changed their rank."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cpic_core import FloatArray
from cpic_planner.results import (
    AssumedInstrument,
    CurvePoint,
    DifferenceRecord,
    EstimateRecord,
    ImageSample,
    PlanetShare,
    RankChange,
    ScheduleRecord,
    StrategyOutcome,
    SurveyTarget,
    TimeUse,
)
from cpic_planner.survey.estimates import convergence, difference_interval, mean_interval, spread
from cpic_planner.survey.schedule import PlannedVisit
from cpic_planner.survey.simulate import Survey

Columns = Mapping[str, NDArray[Any]]
_CURVE_POINTS = 41
_QUANTITIES = ("snr", "contrast", "separation_arcsec", "margin", "day")
_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
_MOST_PAIRS = 6
_N_CHANGES = 8
_SAME = 1e-9
_LEAST_SEEN = 2e-3


def outcome(
    survey: Survey, tables: Mapping[str, Columns], first_utc: Sequence[str], images: ImageSample | None
) -> StrategyOutcome:
    """What one strategy yields.

    Parameters
    ----------
    survey : Survey
    tables : mapping
        Rows of this strategy in every table, sorted by universe.
    first_utc : sequence of str
        Date of the first visit of each star; empty for none.
    images : ImageSample, optional
    """
    universes, strategy = tables["universes"], survey.strategy
    new, known = (universes[name].astype(float) for name in ("new_planets", "known_planets"))
    hours = universes["search_h"] + universes["follow_up_h"]
    names = (
        "new_planets",
        "known_planets",
        "stars_with_planet",
        "characterised_planets",
        "noise_alarms",
        "background_alarms",
    )
    return StrategyOutcome(
        name=strategy.name,
        description=strategy.description,
        varied=list(strategy.varied),
        instrument=_instrument(survey),
        leading_planet=_leading(survey, tables["detections"], len(new)),
        settings=strategy.model_dump(mode="json"),
        schedule=_schedule(survey),
        planets=_estimate(new + known),
        **{name: _estimate(universes[name].astype(float)) for name in names},
        hours=_estimate(hours),
        any_planet=float(np.mean(new + known > 0)),
        any_new_planet=float(np.mean(new > 0)),
        time_use=_time_use(survey, universes, tables["stars"]),
        curve=_curve(tables["detections"], len(new), float(hours.max())),
        convergence=[_point(float(item.n), item) for item in convergence(new + known)],
        quantiles={
            name: np.quantile(tables["detections"][name], _LEVELS).tolist()
            for name in _QUANTITIES
            if len(tables["detections"][name])
        },
        targets=_targets(survey, tables["stars"], first_utc),
        images=images,
    )


def _instrument(survey: Survey) -> AssumedInstrument:
    instrument = survey.model.instrument
    return AssumedInstrument(
        visit_drift_nm=instrument.drift.visit_nm,
        walk_nm_per_sqrt_hour=instrument.drift.walk_nm_per_sqrt_hour,
        exozodi_zodis=instrument.sky.exozodi_zodis,
        throughput={band: instrument.bands[band].t_opt for band in survey.strategy.visit.bands},
    )


def _leading(survey: Survey, detections: Columns, n: int) -> PlanetShare | None:
    """The known planet that is found most often; new planets are others in every universe."""
    rows, times = np.unique(detections["known_row"][detections["known_row"] >= 0], return_counts=True)
    if survey.known is None or not len(rows):
        return None
    most = int(np.argmax(times))
    name = survey.known.text("planet")[int(rows[most])]
    return PlanetShare(name=name, share=times[most] / len(detections["known_row"]), planets=times[most] / n)


def _estimate(values: FloatArray) -> EstimateRecord:
    found, (low, high) = mean_interval(values), spread(values)
    return EstimateRecord.of(found, low=max(found.low, min(0.0, found.mean)), survey_low=low, survey_high=high)


def _point(x: float, found: Any) -> CurvePoint:
    return CurvePoint.of(found, x=x, low=max(found.low, 0.0))


def _schedule(survey: Survey) -> ScheduleRecord:
    schedule = survey.schedule
    planned = [visit for visit in schedule.visits if not visit.reserve]
    return ScheduleRecord.of(
        schedule,
        visits=len(planned),
        reserve_visits=len(schedule.visits) - len(planned),
        hours=sum(visit.cost_h for visit in planned),
    )


def _time_use(survey: Survey, universes: Columns, stars: Columns) -> TimeUse:
    """Means over universes; a visit's parts are those of the planned visits of its star."""
    n = len(universes["visits"])
    exposing = settling = 0.0
    for i, name in enumerate(survey.targets.name):
        mine = stars["star"] == name
        visits = float(stars["visits"][mine].sum()) / n
        own = _planned(survey, i)
        if own:
            exposing += visits * float(np.mean([survey.options[i][visit.option].time_s for visit in own])) / 3600.0
            settling += visits * survey.strategy.visit.settlings * survey.calendar.settle_h
    search, follow = (float(universes[name].mean()) for name in ("search_h", "follow_up_h"))
    return TimeUse(
        exposing_h=exposing,
        occulted_h=max(0.0, search - exposing - settling),
        settling_h=settling,
        follow_up_h=follow,
        unused_h=max(0.0, survey.strategy.time_budget_h - search - follow),
    )


def _planned(survey: Survey, star: int) -> list[PlannedVisit]:
    return [visit for visit in survey.schedule.visits if visit.star == star]


def _curve(detections: Columns, n: int, most_h: float) -> list[CurvePoint]:
    """Planets found by the time that so many hours were used, up to the longest survey."""
    universe, used = detections["universe"] - detections["universe"].min(initial=0), detections["used_h"]
    _, universe = np.unique(universe, return_inverse=True)
    points = []
    for hours in np.linspace(0.0, most_h, _CURVE_POINTS):
        counts = np.zeros(n)
        early = np.bincount(universe[used <= hours + 1e-9])
        counts[: len(early)] = early
        points.append(_point(float(hours), mean_interval(counts)))
    return points


def _targets(survey: Survey, stars: Columns, first_utc: Sequence[str]) -> list[SurveyTarget]:
    rows = []
    for i, name in enumerate(survey.targets.name):
        own, mine = _planned(survey, i), stars["star"] == name
        if not own or not mine.any():
            continue
        n = float(stars["universes"][mine].sum())
        sums = {
            key: float(stars[key][mine].sum()) / n
            for key in ("visits", "search_h", "follow_up_h", "new_planets", "known_planets")
        }
        hours = sums["search_h"] + sums["follow_up_h"]
        found = sums["new_planets"] + sums["known_planets"]
        known = [] if survey.known is None else survey.known.text("planet")
        ways = [survey.options[i][visit.option] for visit in own]
        rows.append(
            {
                "name": str(name),
                "v_mag": float(survey.targets.v_mag[i]),
                "distance_pc": float(survey.targets.distance_pc[i]),
                "ra_deg": float(survey.targets.ra_deg[i]),
                "dec_deg": float(survey.targets.dec_deg[i]),
                "known_planets": [known[row] for row in survey.known_rows[i]],
                "bands": list(dict.fromkeys(way.band for way in ways)),
                "visit_time_s": float(np.mean([way.time_s for way in ways])),
                "visit_h": float(np.mean([visit.cost_h for visit in own])),
                "planned_visits": sum(not visit.reserve for visit in own),
                "slots": [visit.slot for visit in own],
                "first_utc": first_utc[i],
                "visits": sums["visits"],
                "search_h": sums["search_h"],
                "follow_up_h": sums["follow_up_h"],
                "new_planets": sums["new_planets"],
                "known_seen": sums["known_planets"],
                "planets_per_100h": 100.0 * found / hours if hours > 0 else 0.0,
            }
        )
    rows.sort(key=lambda row: (-float(row["planets_per_100h"]), str(row["name"])))  # type: ignore[arg-type]
    return [SurveyTarget(rank=rank, **row) for rank, row in enumerate(rows, 1)]


def differences(names: Sequence[str], universes: Sequence[Columns]) -> list[DifferenceRecord]:
    """Paired differences: all pairs of a few strategies; of many each with the first one, and the best two.

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
    quantities: tuple[Literal["planets", "new_planets", "characterised_planets", "hours"], ...] = (
        "planets",
        "new_planets",
        "characterised_planets",
        "hours",
    )
    return [
        _difference(names[b], names[a], quantity, *(_quantity(universes[k], quantity) for k in (b, a)))
        for b, a in pairs
        for quantity in quantities
    ]


def _quantity(universes: Columns, name: str) -> FloatArray:
    parts = {"planets": ("new_planets", "known_planets"), "hours": ("search_h", "follow_up_h")}.get(name, (name,))
    return np.asarray(sum(universes[part].astype(float) for part in parts))


def _difference(first: str, second: str, quantity: Any, one: FloatArray, other: FloatArray) -> DifferenceRecord:
    found = difference_interval(one - other)
    varies = bool(np.ptp(one) > _SAME * np.abs(one).max() and np.ptp(other) > _SAME * np.abs(other).max())
    unit = " h" if quantity == "hours" else ""
    if found.low > 0.0 or found.high < 0.0:
        word = "more" if found.mean > 0 else "fewer"
        verdict = f"{first}: {abs(found.mean):.3g}{unit} {word} than {second}"
    else:
        verdict = f"{first} and {second} do not differ by more than chance"
    return DifferenceRecord.of(
        found,
        first=first,
        second=second,
        quantity=quantity,
        correlation=float(np.corrcoef(one, other)[0, 1]) if varies else None,
        verdict=verdict,
    )


def rank_changes(outcomes: Sequence[StrategyOutcome]) -> list[RankChange]:
    """Stars that other strategies rank elsewhere than the first, the largest changes of each, with the reason."""
    first = {target.name: target for target in outcomes[0].targets}
    found = []
    for other in outcomes[1:]:
        mine = {target.name: target for target in other.targets}
        behind = max(len(first), len(mine)) + 1

        def moved(name: str, mine: Mapping[str, SurveyTarget] = mine, behind: int = behind) -> int:
            old, new = (ranks[name].rank if name in ranks else behind for ranks in (first, mine))
            return abs(new - old)

        names = sorted({*first, *mine}, key=lambda name: (-moved(name), name))
        for name in [name for name in names if moved(name) > 0 and _seen(first, mine, name)][:_N_CHANGES]:
            found.append(
                RankChange(
                    strategy=other.name,
                    star=name,
                    first_rank=first[name].rank if name in first else None,
                    rank=mine[name].rank if name in mine else None,
                    why=_why(first.get(name), mine.get(name)),
                )
            )
    return found


def _seen(first: Mapping[str, SurveyTarget], mine: Mapping[str, SurveyTarget], name: str) -> bool:
    """Whether a star shows enough planets in one of the two for its rank to be more than chance."""
    return any(
        ranks[name].new_planets + ranks[name].known_seen >= _LEAST_SEEN for ranks in (first, mine) if name in ranks
    )


def _why(old: SurveyTarget | None, new: SurveyTarget | None) -> str:
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
