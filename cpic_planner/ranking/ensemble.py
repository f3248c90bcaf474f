"""Rank the stars under many instruments that fit what is known, and tell how sure the order is."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, IntArray, NDArray, announce
from cpic_planner.etc import EtcModel
from cpic_planner.queries import CONTRAST, OCCURRENCE, Change, Ensemble, EnsembleChoice, changed
from cpic_planner.ranking.known_completeness import CountedPlanets
from cpic_planner.ranking.order import RankSetting, rank_targets, ranked
from cpic_planner.ranking.sensitivity import tau_b
from cpic_planner.results import EnsembleBar, EnsembleRecord, RankedTarget, RankResult
from cpic_planner.targets import Targets
from simulator.config import at, content_hash
from simulator.imaging import PsfMetrics, at_contrast, measured_states, published_bands
from simulator.passbands import Passbands

FIRST = 10
"""Ranks that the probability of standing among the first is of."""
POOL, WHOLE = 100, 8
"""Stars that every instrument ranks at first, and instruments that rank all of them."""
_SMALL = 1e-3  # share of the expected planets of all stars below which a star does not matter
ENDS = (0.05, 0.95)
"""Shares of a number's law that are below the two ends of its bar."""


MirrorStates: TypeAlias = dict[str, tuple[PsfMetrics, ...]]
"""Measured states of the mirror, by band."""


def states_of(model: EtcModel, ensemble: Ensemble) -> MirrorStates:
    """Return the states of the mirror that the contrast is drawn on; none where it is not drawn.

    Bands of which no contrast is published keep the dark hole of the instrument.
    """
    bands = [band for band in model.bands if band in published_bands()] if CONTRAST in ensemble.drawn else []
    return {band: measured_states(model.instrument, band) for band in bands}


def instrument_of(model: EtcModel, ensemble: Ensemble, states: MirrorStates, drawn: Mapping[str, float]) -> EtcModel:
    """Return the model of a drawn instrument.

    Parameters
    ----------
    model : EtcModel
        Of the instrument that is asked.
    ensemble : Ensemble
    states : dict
        Of `states_of`.
    drawn : mapping of str to float
        Value or factor of some of the ensemble's numbers; the others are the instrument's own.

    Raises
    ------
    InputError
        For a number that the instrument cannot have.
    """
    nominal = model.instrument
    changes = []
    for key, value in drawn.items():
        if key in (CONTRAST, OCCURRENCE):
            continue
        action: Literal["set", "scale"] = "set" if ensemble.numbers[key].factor is None else "scale"
        changes.append(Change(key=key, action=action, value=float(value)))
    instrument = changed(nominal, changes)
    metrics = model.metrics
    if CONTRAST in drawn:
        try:
            metrics = metrics | {band: at_contrast(own, float(drawn[CONTRAST])) for band, own in states.items()}
        except InputError as error:
            raise at("ensemble", error) from None
    return EtcModel(instrument, Passbands.from_instrument(instrument), metrics, model.strategy)


@dataclass(frozen=True)
class Standings:
    """Stars under some instruments, arrays ``(instruments, stars)``, and their names.

    ``planets`` are the expected planets of one observation of each star (completeness where the population has no rate
    of occurrence); ``detected`` says whether the reference planet, whose margin is ``margin``, is detected in the given
    time.
    """

    names: NDArray[np.str_]
    score: FloatArray
    margin: FloatArray
    detected: BoolArray
    planets: FloatArray

    @functools.cached_property
    def rank(self) -> IntArray:
        """Ranks among these stars under each instrument, in the order of `ranked_order`."""
        by_name = np.broadcast_to(np.argsort(np.argsort(self.names, kind="stable"), kind="stable"), self.score.shape)
        order = np.lexsort((by_name, -self.margin, -self.score), axis=1)
        rank = np.empty(order.shape, np.int64)
        np.put_along_axis(rank, order, np.broadcast_to(np.arange(1, order.shape[1] + 1), order.shape), axis=1)
        return rank

    @property
    def total(self) -> FloatArray:
        """Expected planets of one observation of every star, one number for each instrument."""
        return np.asarray(self.planets.sum(axis=1))

    @property
    def reachable(self) -> IntArray:
        """Stars whose reference planet is detected, for each instrument."""
        return np.asarray(np.count_nonzero(self.detected, axis=1))

    def beside(self, other: "Standings") -> "Standings":
        """Return these stars and others under the same instruments."""
        parts = ((getattr(self, item.name), getattr(other, item.name)) for item in fields(Standings))
        return Standings(*(np.concatenate(pair, axis=-1) for pair in parts))


def standings(
    setting: RankSetting, targets: Targets, choice: EnsembleChoice, draws: Sequence[Mapping[str, float]]
) -> Standings:
    """Rank stars under some instruments.

    Parameters
    ----------
    setting : RankSetting
        Of the instrument that is asked.
    targets : Targets
        ``n`` stars.
    choice : EnsembleChoice
        Whose numbers are drawn.
    draws : sequence of mapping
        Of each instrument, the values of the numbers that are not the nominal ones.
    """
    states = states_of(setting.model, choice.ensemble)
    counts = CountedPlanets.of(setting.population, targets, keep=True)
    models = (instrument_of(setting.model, choice.ensemble, states, drawn) for drawn in draws)
    rows = [_standing(replace(setting, model=one), counts, drawn) for one, drawn in zip(models, draws, strict=True)]
    return Standings(targets.name, *(np.stack(part) for part in zip(*rows, strict=True)))


def _standing(setting: RankSetting, counts: CountedPlanets, drawn: Mapping[str, float]) -> tuple[NDArray[Any], ...]:
    """Return the scores, margins, detections and expected planets of the stars under one instrument."""
    found = ranked(setting, counts.targets, brief=True, counts=counts)
    counted = np.stack([part.counted for part in found.counted])[found.picked, np.arange(len(counts.targets))]
    rate = setting.population.record().planets_per_star
    planets = counted if rate is None else counted * rate * drawn.get(OCCURRENCE, 1.0)
    return found.score, found.best.margin, found.best.detected, planets


def rank_under(
    model: EtcModel,
    targets: Targets,
    instruments: EnsembleChoice | None,
    *,
    chosen: BoolArray | None = None,
    sample: str = "",
    catalogue: str | None = None,
    **asked: Any,
) -> RankResult:
    """Rank targets, and again under an ensemble of instruments where one is asked: those that the rows are about.

    Parameters
    ----------
    model, targets, chosen, sample, catalogue, asked
        As of `cpic_planner.ranking.order.rank_targets`.
    instruments : EnsembleChoice or None
    """
    if instruments is not None and model.of_table:
        hint = "an ensemble says what is not known of modelled optics"
        raise InputError("coronagraph.table", model.instrument.name, allowed="no ensemble of instruments", hint=hint)
    result = rank_targets(model, targets, chosen=chosen, sample=sample, catalogue=catalogue, **asked)
    if instruments is None:
        return result
    shown = targets if chosen is None else targets.select(chosen)
    return with_ensemble(result, RankSetting.of(model, **asked), shown, instruments)


def with_ensemble(result: RankResult, setting: RankSetting, targets: Targets, choice: EnsembleChoice) -> RankResult:
    """Return a ranking with what becomes of it under an ensemble of instruments.

    Parameters
    ----------
    result : RankResult
        Ranking of the stars by the setting.
    setting : RankSetting
    targets : Targets
    choice : EnsembleChoice

    Notes
    -----
    All instruments rank the stars that may matter: the first `POOL` by nominal score and margin, and those that matter
    under any of `WHOLE` of the instruments, which rank all stars: evenly spaced by the number of expected planets, the
    best and the worst among them. The reference planets of the others are detected under none of these; their ranks
    are those of these few instruments.
    """
    drawn = choice.draws()
    draws = [{key: float(values[i]) for key, values in drawn.items()} for i in range(choice.n_instruments)]
    row_of = {row.name: row for row in result.targets}
    rows = [row_of[str(name)] for name in targets.name]
    found, whole = _ranked_by_all(setting, targets, choice, draws, _first(rows, POOL))
    index = {str(name): i for i, name in enumerate(targets.name)}
    pool = np.array([index[str(name)] for name in found.names])
    columns = _columns(found, whole, pool)
    named = {row.name: {name: values[i] for name, values in columns.items()} for i, row in enumerate(rows)}
    record = _record(setting, targets.select(pool), choice, found)
    shown = [row.model_copy(update=named[row.name]) for row in result.targets]
    asked = {"rank": result.config_hash, "ensemble": choice.ensemble.model_dump(mode="json"), "seed": choice.seed}
    digest = content_hash(asked | {"n_instruments": choice.n_instruments})
    return result.model_copy(update={"targets": shown, "ensemble": record, "config_hash": digest})


def _first(rows: Sequence[RankedTarget], most: int) -> BoolArray:
    """Return the stars that come first by nominal rank or by the reference planet's margin."""
    by_margin = np.empty(len(rows), np.int64)
    by_margin[np.argsort([-row.detection_margin for row in rows], kind="stable")] = np.arange(1, len(rows) + 1)
    nearest = np.minimum(by_margin, [row.rank for row in rows])
    order = np.argsort(nearest, kind="stable")[:most]
    chosen = np.zeros(len(rows), bool)
    chosen[order] = True
    return chosen


def _ranked_by_all(
    setting: RankSetting,
    targets: Targets,
    choice: EnsembleChoice,
    draws: Sequence[Mapping[str, float]],
    pool: BoolArray,
) -> tuple[Standings, Standings]:
    """Return the pool's stars under every instrument, the pool grown as needed, and all stars under some."""
    announce(f"ranking {np.count_nonzero(pool)} stars under {len(draws)} instruments")
    found = standings(setting, targets.select(pool), choice, draws)
    if pool.all():
        return found, found
    by_total = np.argsort(found.total, kind="stable")
    some = by_total[np.unique(np.linspace(0, len(draws) - 1, min(WHOLE, len(draws))).astype(int))]
    announce(f"ranking all {len(targets)} stars under {len(some)} of the instruments")
    whole = standings(setting, targets, choice, [draws[i] for i in some])
    counts = whole.planets > _SMALL * whole.total[:, None]
    missed = ~pool & (whole.detected | counts | (whole.rank <= POOL // 2)).any(axis=0)
    if missed.any():
        announce(f"ranking {np.count_nonzero(missed)} more stars under {len(draws)} instruments")
        found = found.beside(standings(setting, targets.select(missed), choice, draws))
    return found, whole


def _columns(found: Standings, whole: Standings, pool: IntArray) -> dict[str, list[float]]:
    """Return what rows of all stars say, by the names of their columns."""
    ranks: list[IntArray] = [whole.rank[:, i] for i in range(whole.rank.shape[1])]
    reached = np.zeros(len(ranks))
    for column, star in enumerate(pool.tolist()):
        scored = (found.score[:, column] > 0.0).any()
        ranks[star] = found.rank[:, column] if scored else ranks[star]
        reached[star] = found.detected[:, column].mean()
    low, middle, high = (
        [float(np.quantile(rank, share, method="inverted_cdf")) for rank in ranks] for share in (ENDS[0], 0.5, ENDS[1])
    )
    return {
        "p_reachable": reached.tolist(),
        "rank_median": middle,
        "rank_p05": low,
        "rank_p95": high,
        "p_rank_le_10": [float((rank <= FIRST).mean()) for rank in ranks],
    }


def _record(setting: RankSetting, targets: Targets, choice: EnsembleChoice, found: Standings) -> EnsembleRecord:
    """Return the numbers of the whole ensemble, and the bars of what it hangs on."""
    keys = list(choice.ensemble.drawn)
    announce(f"ranking {len(targets)} stars with each of {len(keys)} numbers at the ends of what it may be")
    ends = {key: choice.ensemble.numbers[key].law.quantile(np.array(ENDS)).tolist() for key in keys}
    tried = standings(setting, targets, choice, [{}, *({key: end} for key in keys for end in ends[key])])
    nominal = tried.score[0]
    first = tried.rank[0] <= FIRST
    bars = []
    for number, key in enumerate(keys):
        doubt, at = choice.ensemble.numbers[key], (1 + 2 * number, 2 + 2 * number)
        compared = [(tried.rank[i] <= FIRST) | first for i in at]
        tau = [tau_b(nominal[here], tried.score[i][here]) for i, here in zip(at, compared, strict=True)]
        bars.append(
            EnsembleBar(
                key=key,
                label=doubt.label,
                low=doubt.text(key, ends[key][0]),
                high=doubt.text(key, ends[key][1]),
                planets_low=float(tried.total[at[0]]),
                planets_high=float(tried.total[at[1]]),
                n_reachable_low=int(tried.reachable[at[0]]),
                n_reachable_high=int(tried.reachable[at[1]]),
                tau_low=tau[0],
                tau_high=tau[1],
                source=doubt.source,
            )
        )
    bars.sort(key=lambda bar: -abs(bar.planets_high - bar.planets_low))
    low, middle, high = np.quantile(found.total, (ENDS[0], 0.5, ENDS[1])).tolist()
    reached = [int(value) for value in np.quantile(found.reachable, (ENDS[0], 0.5, ENDS[1]), method="inverted_cdf")]
    numbers = {
        "planets_nominal": float(tried.total[0]),
        "planets_p05": low,
        "planets_median": middle,
        "planets_p95": high,
        "n_reachable_nominal": int(tried.reachable[0]),
        "n_reachable_p05": reached[0],
        "n_reachable_median": reached[1],
        "n_reachable_p95": reached[2],
    }
    often = int(np.count_nonzero(found.detected.mean(axis=0) >= 0.5))
    return EnsembleRecord(
        name=choice.ensemble.name,
        n_instruments=choice.n_instruments,
        seed=choice.seed,
        n_stars=len(targets),
        bars=bars,
        decides=bars[0].key,
        decides_order=min(bars, key=_least_tau).key,
        statement=_statement(bars, numbers, often, choice.n_instruments),
        **numbers,
    )


def _least_tau(bar: EnsembleBar) -> float:
    return min(1.0 if tau is None else tau for tau in (bar.tau_low, bar.tau_high))


def _statement(bars: Sequence[EnsembleBar], numbers: Mapping[str, float], often: int, n_instruments: int) -> str:
    """Say how many planets and stars the ensemble has, and which assumption decides."""
    most, turned = bars[0], min(bars, key=_least_tau)
    said = [
        f"Under {n_instruments} instruments that fit what is published, one observation of every star finds "
        f"{numbers['planets_p05']:.2g} to {numbers['planets_p95']:.2g} planets (5 to 95 %; "
        f"{numbers['planets_nominal']:.2g} with the instrument asked), and the reference planet is detected around "
        f"{numbers['n_reachable_p05']:g} to {numbers['n_reachable_p95']:g} stars ({numbers['n_reachable_nominal']:g}); "
        f"around {often} it is in at least half of them.",
        f"The number of planets depends most on {most.label}: {most.planets_low:.2g} for {most.low}, "
        f"{most.planets_high:.2g} for {most.high}.",
    ]
    least = _least_tau(turned)
    if least < 1.0:
        said.append(
            f"The order of the first {FIRST} depends most on {turned.label}: Kendall's tau falls to {least:.2f}."
        )
    else:
        said.append(f"No number alone changes the order of the first {FIRST}.")
    return " ".join(said)
