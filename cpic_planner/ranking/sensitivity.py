"""Rank the same stars under other assumptions, to show how the ranking depends on what is not known yet."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray, NDArray, announce, fingerprint
from cpic_planner.etc import EtcModel, build_model, check_range
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import Change, ReferencePlanet, changed
from cpic_planner.ranking.known_completeness import CountedPlanets, KnownChoice
from cpic_planner.ranking.order import RankSetting, ranked, ranked_order
from cpic_planner.registry import DEFAULT_SCORE, ScoreName
from cpic_planner.results import SensitivityResult, SensitivityRow, SensitivityStar
from cpic_planner.targets import Targets
from simulator.config import ParametricAlbedo, content_hash, load_instrument
from simulator.imaging import metrics_key
from simulator.passbands import Passbands

N_TOP, N_FIRST, POOL = 50, 10, 6


@dataclass(frozen=True)
class Order:
    """Stars under one assumption: rank (1 for the first), score, margin of the reference planet, and its detection."""

    rank: IntArray
    score: FloatArray
    margin: FloatArray
    detected: BoolArray

    def select(self, stars: BoolArray) -> "Order":
        """Return some of the stars, with the ranks that they have among all."""
        return Order(self.rank[stars], self.score[stars], self.margin[stars], self.detected[stars])


@dataclass(frozen=True)
class Assumption:
    """Another assumption: its key, what it says, how it changes a setting, and the settings that it can change."""

    key: str
    text: str
    change: Callable[[RankSetting], RankSetting]
    applies: Callable[[RankSetting], bool] = lambda setting: True


def _with(one: Change) -> Callable[[RankSetting], RankSetting]:
    """Return an assumption that changes numbers of the instrument, but not its optics: only rates of light and drift.

    A ``*`` in the key stands for the bands of the ranking.
    """

    def change(setting: RankSetting) -> RankSetting:
        model = setting.model
        keys = {one.key.replace("*", band): None for band in model.bands}
        instrument = changed(model.instrument, (one.model_copy(update={"key": key}) for key in keys))
        other = EtcModel(instrument, Passbands.from_instrument(instrument), model.metrics, model.strategy)
        return replace(setting, model=other)

    return change


def _at_two_au(setting: RankSetting) -> RankSetting:
    """Return all planets, reference and population, with the albedo of the models' slice at 2 au from the Sun."""
    albedo = ParametricAlbedo(insolation_au=2.0)
    planet = setting.planet.model_copy(update={"albedo": albedo})
    if isinstance(setting.population, KnownChoice):
        return replace(setting, planet=planet, population=replace(setting.population, albedo=albedo))
    config = setting.population.config
    kinds = tuple(kind.model_copy(update={"albedo": albedo}) for kind in config.kinds)
    population = replace(setting.population, config=config.model_copy(update={"albedo": albedo, "kinds": kinds}))
    return replace(setting, planet=planet, population=population)


def _with_published_hole(setting: RankSetting) -> RankSetting:
    """Give the instrument the dark hole `as_published`: the mirror is set from a field sensed with errors."""
    model, hole = setting.model, load_instrument(_PUBLISHED).dark_hole.model_dump(mode="json")
    return replace(
        setting, model=build_model(model.instrument.changed({"dark_hole": hole}), model.bands, model.strategy)
    )


def _has_default_optics(setting: RankSetting) -> bool:
    """Return whether the optics of all bands are the default instrument's: their published holes are shipped."""
    instrument, default = setting.model.instrument, load_instrument()
    return all(
        band in default.bands and metrics_key(instrument, band) == metrics_key(default, band)
        for band in setting.model.bands
    )


_PUBLISHED = "as_published"
_WIDER, _NARROWER = (_with(Change.scaling("bands.*.width_nm", factor)) for factor in (1.5, 0.5))
ASSUMPTIONS: tuple[Assumption, ...] = (
    Assumption("drift_x2", "wavefront drift twice as large", _with(Change.scaling("drift", 2.0))),
    Assumption("drift_x0.5", "wavefront drift half as large", _with(Change.scaling("drift", 0.5))),
    Assumption("drift_x0.1", "wavefront drift a tenth as large", _with(Change.scaling("drift", 0.1))),
    Assumption(
        "hole_1e-8", "a dark hole of the published mean contrast, 1e-8", _with_published_hole, _has_default_optics
    ),
    Assumption("albedo_2au", "albedo of cloudy giants at 2 au from the Sun, whatever the insolation", _at_two_au),
    Assumption("t_opt_0.46", "optical throughput 0.46 in every band", _with(Change(key="bands.*.t_opt", value=0.46))),
    Assumption("width_+50%", "bands half as wide again, with the optics of the nominal width", _WIDER),
    Assumption("width_-50%", "bands half as wide, with the optics of the nominal width", _NARROWER),
)


def in_turn(setting: RankSetting, assumptions: Sequence[Assumption] = ASSUMPTIONS) -> Iterator[Assumption]:
    """Yield the assumptions that apply to a setting, each announced before the work under it begins."""
    assumptions = [item for item in assumptions if item.applies(setting)]
    for done, assumption in enumerate(assumptions, 1):
        announce(f"ranking under other assumptions, {done} of {len(assumptions)}: {assumption.text}")
        yield assumption


def under_others(
    setting: RankSetting, targets: Targets, assumptions: Sequence[Assumption] = ASSUMPTIONS
) -> Iterator[tuple[Assumption, Order]]:
    """Yield the assumptions that apply to a setting, each with the order of stars under it."""
    counts = CountedPlanets.of(setting.population, targets, keep=True)
    for assumption in in_turn(setting, assumptions):
        other = assumption.change(setting)
        yield assumption, in_order(other, targets, counts if other.population is setting.population else None)


def in_order(setting: RankSetting, targets: Targets, counts: CountedPlanets | None = None) -> Order:
    """Rank stars under one setting.

    Parameters
    ----------
    setting : RankSetting
    targets : Targets
    counts : CountedPlanets, optional
        Those of the setting's population around these stars.
    """
    found = ranked(setting, targets, brief=True, counts=counts)
    rank = np.empty(len(targets), np.int64)
    rank[ranked_order(found, targets)] = np.arange(1, len(targets) + 1)
    margin = found.best.margin
    return Order(rank, found.score, margin, (margin >= found.best.needed_margin) & (found.best.n_frames >= 1))


def near_top(rank: IntArray, margin: FloatArray, top: int) -> BoolArray:
    """Return the stars that may be among the first ``top``, or detected, under another assumption; others stay far.

    They are the first ``POOL * top`` by nominal rank and by margin of the reference planet.

    Parameters
    ----------
    rank : ndarray of int
        Rank of each star.
    margin : ndarray
        Detection margin of each star.
    top : int
        Ranks that count.
    """
    by_margin = np.empty(len(rank), np.int64)
    by_margin[np.argsort(-margin, kind="stable")] = np.arange(1, len(rank) + 1)
    return np.minimum(rank, by_margin) <= POOL * top


def sensitivity(
    model: EtcModel,
    targets: Targets,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
    population: PopulationChoice | KnownChoice | None = None,
    score: ScoreName = DEFAULT_SCORE,
    top: int = N_TOP,
    first: int = N_FIRST,
    assumptions: Sequence[Assumption] = ASSUMPTIONS,
) -> SensitivityResult:
    """Rank the sample again under other assumptions and compare.

    Parameters
    ----------
    model, targets, time_s, planet, bands, population, score
        As `cpic_planner.ranking.order.rank_targets`.
    top : int
        Stars of the nominal ranking that are compared (all, if there are fewer); those that may come near them are
        ranked again (`near_top`).
    first : int
        Stars at the head of them of which it is told how many stay there.
    assumptions : sequence of Assumption
        One at a time, those that apply to the model; `ASSUMPTIONS` by default.

    Returns
    -------
    SensitivityResult
        For each assumption the number of stars whose reference planet is detected, and Kendall's tau-b of the scores
        of the stars that are among the first ``top`` and have a score above zero, nominally or under the assumption:
        1 where no pair changes its order, 0 where as many do as do not. Stars of equal score have no order, so that
        the rule which lists them (by margin, then by name) does not count.
    """
    setting = RankSetting.of(model, time_s=time_s, planet=planet, bands=bands, population=population, score=score)
    check_range("top", top, 1, math.inf, "stars")
    digest = setting.digest(targets)
    nominal = in_order(setting, targets)
    n_ranked = len(targets)
    n_ok = int(np.count_nonzero(nominal.detected))
    n_top, n_first = min(top, n_ranked), min(first, top, n_ranked)
    pool = near_top(nominal.rank, nominal.margin, top)
    targets, nominal = targets.select(pool), nominal.select(pool)
    others = list(under_others(setting, targets, assumptions))
    rows = [_compared(assumption, nominal, other, targets.name, n_top, n_first) for assumption, other in others]
    asked = {"kind": "sensitivity", "rank": digest, "top": top, "assumptions": [row.assumption for row in rows]}
    ranks = np.array([nominal.rank, *(other.rank for _, other in others)])
    stars = [
        SensitivityStar(
            name=str(targets.name[at]),
            rank=int(nominal.rank[at]),
            rank_lowest=int(ranks[:, at].min()),
            rank_highest=int(ranks[:, at].max()),
        )
        for at in np.argsort(nominal.rank)[:n_top]
    ]
    return SensitivityResult(
        fingerprint=str(fingerprint()),
        config_hash=content_hash(asked | {"first": first}),
        top=n_top,
        first=n_first,
        score_name=score,
        n_ranked=n_ranked,
        n_ok=n_ok,
        rows=rows,
        stars=stars,
        statement=_statement(rows, stars, n_ok, n_ranked, n_first),
    )


def _compared(
    assumption: Assumption, nominal: Order, other: Order, names: NDArray[np.str_], n_top: int, n_first: int
) -> SensitivityRow:
    """Return what becomes of the nominal first stars under another assumption."""
    first = np.flatnonzero(nominal.rank <= n_top)
    scored = (np.minimum(nominal.rank, other.rank) <= n_top) & ((nominal.score > 0) | (other.score > 0))
    falls = other.rank[first] - nominal.rank[first]
    worst = int(np.argmax(falls))
    return SensitivityRow(
        assumption=assumption.key,
        text=assumption.text,
        n_ok=int(np.count_nonzero(other.detected)),
        kendall_tau_b=tau_b(nominal.score[scored], other.score[scored]),
        n_compared=int(np.count_nonzero(scored)),
        kendall_tau=tau_b(nominal.rank[first], other.rank[first]),
        kept=int(np.count_nonzero(other.rank[first] <= n_top)),
        kept_first=int(np.count_nonzero(other.rank[nominal.rank <= n_first] <= n_first)),
        largest_fall=str(names[first[worst]]) if falls[worst] > 0 else "",
        largest_fall_ranks=max(int(falls[worst]), 0),
        best=str(names[int(np.argmin(other.rank))]),
    )


def tau_b(x: NDArray[Any], y: NDArray[Any]) -> float | None:
    """Return Kendall's tau-b (Kendall 1945): pairs tied in both have no weight, those tied in one lower it."""
    i, j = np.triu_indices(len(x), 1)
    a, b = np.sign(x[i] - x[j]), np.sign(y[i] - y[j])
    ordered = math.sqrt(np.count_nonzero(a) * np.count_nonzero(b))
    return float(np.sum(a * b)) / ordered if ordered else None


def _statement(
    rows: Sequence[SensitivityRow], stars: Sequence[SensitivityStar], n_ok: int, n_ranked: int, n_first: int
) -> str:
    """Say around how many stars the planet stays detected, how many of the first stars stay, and how firm the order is.

    The words are those of an ensemble of instruments (`cpic_planner.ranking.ensemble`).
    """
    said = [f"The reference planet is detected around {n_ok} of {n_ranked} stars."]
    if not rows:
        return said[0]
    fewest, most = (choose(rows, key=lambda row: row.n_ok) for choose in (min, max))
    each = f"Under {len(rows)} other assumptions, one at a time, " if len(rows) > 1 else f"With {rows[0].text} "
    if fewest.n_ok == most.n_ok:
        said.append(f"{each}it is detected around {'as many' if most.n_ok == n_ok else most.n_ok}.")
    else:
        said.append(f"{each}it is detected around {fewest.n_ok} ({fewest.text}) to {most.n_ok} ({most.text}).")
    least = min(rows, key=lambda row: row.kept_first)
    if n_first > 1 and least.kept_first == n_first:
        said.append(f"All of the first {n_first} stars stay among the first {n_first}.")
    elif n_first > 1:
        kept = f"{least.kept_first} ({least.text})" if len(rows) > 1 else f"{least.kept_first}"
        highest = max(row.kept_first for row in rows)
        to = f" to {highest}" * (highest > least.kept_first)
        said.append(f"Of the first {n_first} stars, {kept}{to} stay among the first {n_first}.")
    stays = sum(row.best == stars[0].name for row in rows)
    under = "" if len(rows) == 1 else " under every one" if stays == len(rows) else f" under {stays} of {len(rows)}"
    said.append(f"The first star stays first{under}." if stays else "Another star is first instead.")
    known = [(row.kendall_tau_b, row) for row in rows if row.kendall_tau_b is not None]
    if known:
        tau, turned = min(known, key=lambda item: item[0])
        said.append(
            f"The order of the stars that have a score changes most for {turned.text}: Kendall's tau is "
            f"{tau:.2f} over {turned.n_compared} stars."
        )
    else:
        said.append("Too few stars have a score to compare their order.")
    return " ".join(said)
