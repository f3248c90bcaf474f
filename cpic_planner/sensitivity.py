"""How the ranking depends on what nobody knows yet: the same stars ranked under other assumptions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.place import check_range
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import ScoreName, SensitivityResult, SensitivityRow
from cpic_planner.ranking import DEFAULT_SCORE, PopulationChoice, order_of, rank_hash, ranked
from cpic_planner.targets import Targets
from simulator.config import content_hash
from simulator.config.albedo import ParametricAlbedo
from simulator.passbands import Passbands
from simulator.work import announce

__all__ = ["ASSUMPTIONS", "DECIDES_BELOW", "N_TOP", "Assumption", "Setting", "positions", "sensitivity"]

N_TOP = 50
POOL = 6
DECIDES_BELOW = 0.5
"""Kendall's tau below which an assumption is said to decide the ranking: one pair in four changes its order."""


@dataclass(frozen=True)
class Setting:
    """What a ranking is made with."""

    model: EtcModel
    planet: ReferencePlanet
    population: PopulationChoice


@dataclass(frozen=True)
class Assumption:
    """Another assumption: its key, what it says, and how it changes a setting."""

    key: str
    text: str
    change: Callable[[Setting], Setting]


def _with_drift(factor: float) -> Callable[[Setting], Setting]:
    def change(setting: Setting) -> Setting:
        drift = setting.model.instrument.drift
        size = {"visit_nm": drift.visit_nm * factor, "walk_nm_per_sqrt_hour": drift.walk_nm_per_sqrt_hour * factor}
        return replace(setting, model=_changed(setting.model, {"drift": size}))

    return change


def _with_bands(key: str, value: Callable[[float], float]) -> Callable[[Setting], Setting]:
    def change(setting: Setting) -> Setting:
        bands = setting.model.instrument.bands
        other = {name: {key: value(getattr(bands[name], key))} for name in setting.model.bands}
        return replace(setting, model=_changed(setting.model, {"bands": other}))

    return change


def _changed(model: EtcModel, own: Mapping[str, Any]) -> EtcModel:
    """The model with another instrument but the optics of the nominal one: only rates of light and drift change."""
    instrument = model.instrument.changed(own)
    return EtcModel(instrument, Passbands.from_instrument(instrument), model.metrics, model.strategy)


def _at_two_au(setting: Setting) -> Setting:
    """All planets, reference and population, with the albedo of the models' slice at 2 au from the Sun."""
    albedo = ParametricAlbedo(insolation_au=2.0)
    config = setting.population.config
    kinds = tuple(kind.model_copy(update={"albedo": albedo}) for kind in config.kinds)
    population = replace(setting.population, config=config.model_copy(update={"albedo": albedo, "kinds": kinds}))
    return replace(setting, planet=setting.planet.model_copy(update={"albedo": albedo}), population=population)


ASSUMPTIONS: tuple[Assumption, ...] = (
    Assumption("drift_x2", "wavefront drift twice as large (visit offset and walk)", _with_drift(2.0)),
    Assumption("albedo_2au", "albedo of cloudy giants at 2 au from the Sun, whatever the insolation", _at_two_au),
    Assumption("t_opt_0.46", "optical throughput 0.46 in every band", _with_bands("t_opt", lambda value: 0.46)),
    Assumption("width_+50%", "bands half as wide again (optics of the nominal width)",
               _with_bands("width_nm", lambda value: 1.5 * value)),
    Assumption("width_-50%", "bands half as wide (optics of the nominal width)",
               _with_bands("width_nm", lambda value: 0.5 * value)),
)  # fmt: skip


def positions(
    setting: Setting, targets: Targets, *, time_s: float, bands: Sequence[str], score: ScoreName
) -> tuple[np.ndarray[Any, np.dtype[np.int64]], int]:
    """Rank of every star, 1 for the first, and the number whose reference planet is detected."""
    found = ranked(setting.model, targets, time_s=time_s, planet=setting.planet, bands=bands,
                   planets=setting.population.draw(), score=score, with_times=False)  # fmt: skip
    place = np.empty(len(targets), np.int64)
    place[order_of(found, targets)] = np.arange(1, len(targets) + 1)
    detected = (found.best.margin >= 1.0) & (found.best.n_frames >= 1)
    return place, int(np.count_nonzero(detected))


def sensitivity(
    model: EtcModel,
    targets: Targets,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
    population: PopulationChoice | None = None,
    score: ScoreName = DEFAULT_SCORE,
    top: int = N_TOP,
    assumptions: Sequence[Assumption] = ASSUMPTIONS,
) -> SensitivityResult:
    """Rank the sample again under other assumptions and compare.

    Parameters
    ----------
    model, targets, time_s, planet, bands, population, score
        As `cpic_planner.ranking.rank_targets`.
    top : int
        Stars of the nominal ranking that are compared (all, if there are fewer); six times as many are ranked again.
    assumptions : sequence of Assumption
        One at a time; `ASSUMPTIONS` by default.

    Returns
    -------
    SensitivityResult
        Kendall's tau of the ranks of the nominal top stars: 1 where no pair changes its order, 0 where as many do as
        do not. Ranks have no ties, so that it is that of all stars, with or without a score.
    """
    from scipy.stats import kendalltau

    names, time_s = model.named(bands), check_range("time_s", time_s, 1e-3, 1e9, "s")
    check_range("top", top, 1, math.inf, "stars")
    setting = Setting(model, planet or ReferencePlanet(), population or PopulationChoice.default())
    digest = rank_hash(model, targets, time_s=time_s, planet=setting.planet, bands=bands, population=setting.population,
                       score=score)  # fmt: skip
    nominal, n_ok = positions(setting, targets, time_s=time_s, bands=names, score=score)
    n_top = min(top, len(targets))
    # Stars far down stay far down: only those that may come near the top are ranked again.
    pool = nominal <= POOL * top
    targets, nominal = targets.select(pool), nominal[pool]
    first = np.flatnonzero(nominal <= n_top)
    rows = []
    for done, assumption in enumerate(assumptions, 1):
        announce(f"ranking under other assumptions, {done} of {len(assumptions)}: {assumption.text}")
        place, detected = positions(assumption.change(setting), targets, time_s=time_s, bands=names, score=score)
        tau = float(kendalltau(nominal[first], place[first]).statistic) if n_top > 1 else None
        falls = place[first] - nominal[first]
        worst = int(np.argmax(falls))
        rows.append(
            SensitivityRow(
                assumption=assumption.key,
                text=assumption.text,
                kendall_tau=tau,
                kept=int(np.count_nonzero(place[first] <= n_top)),
                n_ok=detected,
                largest_fall=str(targets.name[first[worst]]) if falls[worst] > 0 else "",
                largest_fall_ranks=max(int(falls[worst]), 0),
                best=str(targets.name[int(np.argmin(place))]),
            )
        )
    decides = [row.assumption for row in rows if row.kendall_tau is not None and row.kendall_tau < DECIDES_BELOW]
    return SensitivityResult(
        config_hash=content_hash({"kind": "sensitivity", "rank": digest, "top": top,
                                  "assumptions": [item.key for item in assumptions]}),
        top=n_top,
        score_name=score,
        n_ok=n_ok,
        rows=rows,
        decides=decides,
        statement=_statement(rows, decides, n_top),
    )  # fmt: skip


def _statement(rows: Sequence[SensitivityRow], decides: Sequence[str], n_top: int) -> str:
    """Which assumption decides the ranking, in a sentence."""
    known = [row for row in rows if row.kendall_tau is not None]
    if not known:
        return "There are too few stars to compare rankings."
    least = min(known, key=lambda row: row.kendall_tau if row.kendall_tau is not None else 1.0)
    if not decides:
        return (f"No assumption decides the order of the first {n_top}: the least Kendall tau is "
                f"{least.kendall_tau:.2f}, for {least.text}.")  # fmt: skip
    listed = "; ".join(f"{row.text} (tau {row.kendall_tau:.2f})" for row in known if row.assumption in decides)
    return f"The order of the first {n_top} is decided by what is assumed here: {listed}."
