"""Yields of strategies from tables of universes: means with intervals, how strategies differ, what each fact moves.

The calendar of each is also a table for an observatory.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from catalogs import split_source
from cpic_core import ArrayLike, FloatArray, InputError, IntArray, NDArray, dump_json
from cpic_planner import results
from cpic_planner.etc import QUADRANTS
from cpic_planner.results import FactRow, FactsRecord, StrategyOutcome, TakenBack
from cpic_planner.survey.schedule import PlannedVisit
from cpic_planner.survey.simulate import Survey
from cpic_planner.survey.strategy import StrategiesConfig, SurveyStrategy, UniverseConfig
from cpic_planner.survey.tables import HOURS, PLANETS
from cpic_planner.survey.visibility import utc_of
from simulator.imaging import PsfMetrics

LEVEL = 0.90
_SAME, _NEXT = 1e-12, 1e-9
_UNMET = 0.15


def mean_interval(values: ArrayLike, level: float = LEVEL) -> results.ChangeRecord:
    """Return the mean of a sample and an interval for that of its law, also where few values differ from the others.

    Parameters
    ----------
    values : array_like, shape (n,)
        One number a universe, at least 2.
    level : float
        Probability of the interval, 0.5 to 0.999.

    Returns
    -------
    ChangeRecord
        ``low`` and ``high`` hold the true mean with the stated probability; ``error`` is the standard error.

    Notes
    -----
    Yields are small counts, so the mean is skewed where Student's interval takes it
    to be symmetric. Empirical likelihood (Owen 1988, Biometrika 75, 237) follows the skewness and stays within what was
    met: the interval holds the means for which ``-2 log`` of the largest likelihood of any law on the observed values
    is at most the square of Student's quantile. A sample without any scatter leaves the interval that Poisson events
    allow that were not met: ``-ln(1 - level) / n`` above and below the mean.
    """
    return _interval(values, level, unmet=0.0)


def difference_interval(values: ArrayLike, level: float = LEVEL) -> results.ChangeRecord:
    """Return the same as `mean_interval`, of differences: the other sign is possible where none was met.

    Parameters
    ----------
    values : array_like
        Differences, one for each universe, shape (n,).
    level : float, optional
        Probability that the interval holds the true value, 0 to 1.

    Notes
    -----
    Two strategies that find one or two planets each that the other misses often show differences of one sign alone,
    which empirical likelihood takes for all there is: 55 to 73 % of nominal 90 % intervals then hold 0. Therefore 0.15
    of an event, as large as the largest, is added on both sides of the median: from two events in all upwards 88 to
    94 % hold.
    """
    return _interval(values, level, unmet=_UNMET)


def _interval(values: ArrayLike, level: float, *, unmet: float) -> results.ChangeRecord:
    x = np.asarray(values, float)
    if x.ndim != 1 or x.size < 2 or not np.isfinite(x).all():
        raise InputError("values", x.shape, allowed="at least two finite numbers, one a universe")
    if not 0.5 <= level <= 0.999:
        raise InputError("level", level, allowed="0.5 to 0.999")
    n, mean = x.size, float(x.mean())
    size = float(np.ptp(x))
    if size <= _SAME * float(np.abs(x).max()):
        reach = -math.log1p(-level) / n
        return results.ChangeRecord(mean=mean, error=0.0, low=mean - reach, high=mean + reach)
    from scipy.special import stdtrit

    aim = float(stdtrit(n - 1, 0.5 + 0.5 * level)) ** 2
    met, weight = x, np.ones(n)
    if unmet:
        middle = float(np.median(x))
        reach = float(np.abs(x - middle).max())
        met, weight = np.append(x, [middle - reach, middle + reach]), np.append(weight, [unmet, unmet])
    unique, place = np.unique(met, return_inverse=True)
    counts = np.bincount(place, weight).astype(np.float64)
    centre, size = float(counts @ unique / counts.sum()), float(np.ptp(unique))
    apart = (unique - centre) / size
    low, high = (centre + size * _end(apart, counts, edge, aim) for edge in (apart[0], apart[-1]))
    return results.ChangeRecord(mean=mean, error=float(x.std(ddof=1)) / math.sqrt(n), low=low, high=high)


def _end(values: FloatArray, counts: FloatArray, edge: float, aim: float) -> float:
    """Return the mean between 0, that of the sample, and an edge of it at which the likelihood ratio reaches ``aim``.

    The likeliest law of a mean has weights ``counts / (1 + tilt values)``. Each tilt gives its mean and its ratio, so
    that the tilt is all that is sought; at ``-1 / edge`` the law stands on the edge alone.
    """
    from scipy.optimize import brentq

    def law(gap: float) -> tuple[FloatArray, float]:
        leant = 1.0 - (1.0 - gap) / edge * values
        return leant, float((counts / leant).sum() / counts.sum())

    def excess(log_gap: float) -> float:
        leant, norm = law(math.exp(log_gap))
        return 2.0 * float((counts * np.log(leant * norm)).sum()) - aim

    almost = math.log(_NEXT)
    if excess(almost) < 0.0:
        return float(edge)
    leant, norm = law(math.exp(float(brentq(excess, almost, 0.0, xtol=1e-13, rtol=1e-14))))
    return float((counts / leant * values).sum() / (counts.sum() * norm))


def spread(values: ArrayLike, level: float = LEVEL) -> tuple[float, float]:
    """Return the quantiles between which that part of the universes lies: what one survey may turn out to be.

    Parameters
    ----------
    values : array_like
        One value for each universe, shape (n,).
    level : float, optional
        Part of the universes that lies between them, 0 to 1.
    """
    x = np.asarray(values, float)
    low, high = np.quantile(x, [0.5 - 0.5 * level, 0.5 + 0.5 * level], method="inverted_cdf")
    return float(low), float(high)


def convergence(values: ArrayLike) -> list[results.CurvePoint]:
    """Return the means from the first few universes to all of them, at numbers evenly spaced in logarithm.

    Parameters
    ----------
    values : array_like
        One value for each universe, shape (n,).
    """
    x = np.asarray(values, float)
    sizes = np.unique(np.geomspace(min(10, x.size), x.size, 12).round().astype(int))
    return [_point(float(size), x[:size]) for size in sizes if size >= 2]


Columns = Mapping[str, NDArray[Any]]
_CURVE_POINTS = 41
_QUANTITIES = ("snr", "contrast", "separation_arcsec", "margin", "day")
_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
_MOST_PAIRS = 6
_N_CHANGES = 8
_VARIES = 1e-9
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
        convergence=convergence(new + known),
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


def _point(x: float, values: FloatArray) -> results.CurvePoint:
    found = mean_interval(values)
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
        points.append(_point(float(hours), counts))
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
    varies = bool(np.ptp(one) > _VARIES * np.abs(one).max() and np.ptp(other) > _SAME * np.abs(other).max())
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


def planned_rows(survey: Survey) -> Iterator[results.PlannedVisitRow]:
    """Yield the visits of a strategy in the order of its calendar."""
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
    for k, visit in enumerate(visits):
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
            reason="follow_up" if followed else "known_planet" if visit.known else "search",
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
            probability=round(visit.probability, 6),
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


def visit_files(surveys: Sequence[Survey], about: Mapping[str, Any]) -> dict[str, str]:
    """Return the texts of `VISIT_FILES`, which are one table.

    Parameters
    ----------
    surveys : sequence of Survey
    about : mapping
        The other fields of `cpic_planner.results.VisitsResult`.
    """
    every = [row for survey in surveys for row in planned_rows(survey)]
    table = results.VisitsResult(visits=every, **about)
    rows, meta = table.visits, table.model_dump(mode="json", exclude={"visits"})
    texts = (
        results.csv_text(results.names_of(results.PlannedVisitRow), map(results.values_of, rows)),
        results.ecsv_text(results.taken_of(results.PlannedVisitRow), rows, meta),
        dump_json(table.model_dump(mode="json")),
    )
    return dict(zip(VISIT_FILES, texts, strict=True))


ALL = "all"
QUANTITIES = ("planets", *PLANETS)
Counts = Mapping[str, IntArray]
"""Planets found in each universe, by the names of `QUANTITIES`."""


class Fact(NamedTuple):
    """Something that is known today: its name, what it is as a noun, and what a survey is called without it."""

    name: str
    words: str
    heading: str


FACTS = (
    Fact("known_planets", "what was published on known planets since 2019", "Known planets as of 2019"),
    Fact("rv", "what radial velocities exclude", "Without radial velocities"),
    Fact("stability", "the orbits that companion stars make unstable", "Without stability limits"),
    Fact("known_giants", "the room that known giants take", "Without known giants"),
    Fact("companions", "where companion stars stand today", "Companions as first listed"),
)
"""Facts that can be taken back, in the order of the table."""


def _before(universe: UniverseConfig, fact: str) -> dict[str, Any]:
    """Return what of a universe was otherwise before a fact was known; nothing where the survey does not use it."""
    base, file = split_source(universe.known_planets)
    if fact == "known_planets":
        used = base == "snapshot" and universe.known_planets != "off"
        return {fact: "+".join(filter(None, ("archive_2019", file)))} if used else {}
    if fact == "companions":
        return {"catalog": "simbad_2012"} if universe.catalog == "snapshot" else {}
    left = tuple(word for word in universe.exclusions if word != fact)
    return {"exclusions": left} if left != universe.exclusions else {}


def taken_back(config: StrategiesConfig) -> dict[str, StrategiesConfig]:
    """Return the strategies as if a fact were not known, by its name; last without any of them, as ``all``.

    Parameters
    ----------
    config : StrategiesConfig
        Facts that its universe does not use are left out; nothing where it does not ask for the comparison.
    """
    found, nothing = {}, config.universe
    for fact in FACTS if config.universe.facts else ():
        if before := _before(config.universe, fact.name):
            found[fact.name] = config.universe.model_copy(update=before)
            nothing = nothing.model_copy(update=_before(nothing, fact.name))
    if len(found) > 1:
        found[ALL] = nothing
    return {name: config.model_copy(update={"universe": state}) for name, state in found.items()}


def counts_of(columns: Mapping[str, NDArray[Any]]) -> Counts:
    """Return the planets found in each universe, from columns of the table of universes or counts of their names."""
    found = {name: np.asarray(columns[name], np.int64) for name in PLANETS}
    return found | {"planets": found["new_planets"] + found["known_planets"]}


def facts_record(
    states: Mapping[str, StrategiesConfig],
    outcomes: Sequence[StrategyOutcome],
    known: Sequence[Counts],
    without: Mapping[str, Sequence[Counts]],
) -> FactsRecord:
    """Return the table of what each fact moves.

    Parameters
    ----------
    states : mapping
        As of `taken_back`.
    outcomes : sequence of StrategyOutcome
        With all facts.
    known : sequence of Counts
        With all facts, by strategy.
    without : mapping of str to sequence of Counts
        By fact, and by strategy.
    """
    words = {fact.name: fact for fact in (*FACTS, Fact(ALL, "all of these", "Without all of these"))}
    rows = []
    for fact, of_strategies in without.items():
        for outcome, before, now in zip(outcomes, of_strategies, known, strict=True):
            numbers: dict[str, Any] = {name: estimate_record(before[name].astype(float)) for name in QUANTITIES}
            for name in QUANTITIES:
                numbers[f"{name}_change"] = difference_interval(before[name] - now[name])
            rows.append(FactRow(strategy=outcome.name, fact=fact, **numbers))
    named = [TakenBack.of(state.universe, **words[name]._asdict()) for name, state in states.items()]
    return FactsRecord(facts=named, rows=rows, statement=_statement(named, rows, outcomes))


def _statement(named: Sequence[TakenBack], rows: Sequence[FactRow], outcomes: Sequence[StrategyOutcome]) -> str:
    """Return which fact moves most planets, and which most new ones where that is another."""
    said: dict[str, str] = {}
    for quantity, words in (("planets", "planets"), ("new_planets", "new planets")):
        changes = [(row, getattr(row, f"{quantity}_change")) for row in rows if row.fact != ALL]
        sure = [(row, change) for row, change in changes if change.low > 0.0 or change.high < 0.0]
        if not sure:
            continue
        row, change = max(sure, key=lambda item: abs(item[1].mean))
        fact = next(item.words for item in named if item.name == row.fact)
        now = next(getattr(item, quantity).mean for item in outcomes if item.name == row.strategy)
        text = (
            f"The fact that moves most {words} is {fact}: {row.strategy} finds {now:.2f} with it and "
            f"{getattr(row, quantity).mean:.2f} without (90 % interval of the difference {change.low:+.2f} to "
            f"{change.high:+.2f})."
        )
        said.setdefault(row.fact, text)
    return " ".join(said.values()) or "No single fact changes the planets found by more than chance."
