"""Explain why a star stands where it stands in the ranking."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_core import InputError
from cpic_planner import etc
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import ReferencePlanet
from cpic_planner.ranking.completeness import CountedPlanets
from cpic_planner.ranking.optimiser import OptimalSetting, best_in_band, setting_columns
from cpic_planner.ranking.order import RankSetting, rank_targets
from cpic_planner.ranking.sensitivity import ASSUMPTIONS, under_others
from cpic_planner.registry import DEFAULT_SCORE, SCORES, ScoreName
from cpic_planner.results import BandStanding, Explanation, RankedTarget, RankResult
from cpic_planner.targets import Targets
from simulator.config import content_hash

_FEW = 10
_ONLY = 0, 0, 0
_REACH, _SPARE = 3.0, 1.5
"""Stars to look among, over the star's own rank, and over the nominal rank of the last that comes before it. For each
of the first 300 stars, by five scores and times, that gives the ranks among all 1077; 2 and 1.25 lose one in 200."""


def explain_star(
    model: etc.EtcModel,
    targets: Targets,
    name: str,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
    population: PopulationChoice | None = None,
    score: ScoreName = DEFAULT_SCORE,
    other_assumptions: bool = False,
    rank: RankResult | None = None,
) -> Explanation:
    """Explain the rank of one star.

    Parameters
    ----------
    model, targets, time_s, planet, bands, population, score
        As `cpic_planner.ranking.order.rank_targets`.
    name : str
        Its name in ``targets``.
    other_assumptions : bool
        Rank the sample under other assumptions too (`cpic_planner.ranking.sensitivity`), which takes as long as the
        ranking.
    rank : RankResult, optional
        The ranking of these stars under the same settings, where it is at hand.

    Returns
    -------
    Explanation

    Raises
    ------
    InputError
        If no target has that name.
    """
    known = {str(star): i for i, star in enumerate(targets.name)}
    if name not in known:
        raise InputError("star", name, allowed="a star of the sample that is ranked")
    index = known[name]
    setting = RankSetting.of(model, time_s=time_s, planet=planet, bands=bands, population=population, score=score)
    if rank is None:
        asked: dict[str, Any] = {"planet": planet, "bands": bands, "population": population, "score": score}
        rank = rank_targets(model, targets, time_s=time_s, **asked)
    place = next(i for i, row in enumerate(rank.targets) if row.name == name)
    star = targets.select([index])
    rows = rank.targets
    counts = CountedPlanets.of(setting.population, star)
    standings = [_standing(setting, star, band, counts) for band in setting.bands]
    ranks = _other_ranks(setting, targets, rows, name) if other_assumptions else {}
    decides = {"kind": "explanation", "rank": rank.config_hash, "star": name, "others": bool(ranks)}
    return Explanation(
        config_hash=content_hash(decides),
        n_ranked=len(rows),
        score_name=score,
        star=rows[place],
        better=rows[place - 1] if place else None,
        worse=rows[place + 1] if place + 1 < len(rows) else None,
        bands=standings,
        ranks=ranks,
        sentences=_sentences(rows[place], standings, ranks, len(rows), score),
    )


def _other_ranks(setting: RankSetting, targets: Targets, rows: Sequence[RankedTarget], name: str) -> dict[str, int]:
    """Return the rank of a star under every other assumption, among the first stars of the nominal ranking.

    They are enough where those that come before it are all well within them; else as many again are added.
    """
    nominal = {row.name: row.rank for row in rows}
    rank = np.array([nominal[str(star)] for star in targets.name])
    own, found, left = nominal[name], dict[str, int](), list(ASSUMPTIONS)
    first = _REACH * max(own, _FEW)
    while left:
        near = rank <= first
        chosen, places = targets.select(near), rank[near]
        index, again = int(np.flatnonzero(places == own)[0]), []
        for item, order in under_others(setting, chosen, left):
            found[item.key] = int(order.rank[index])
            before = places[order.rank <= order.rank[index]]
            if first < len(rows) and _SPARE * before.max() > first:
                again.append(item)
        left, first = again, 2.0 * first
    return found


def _standing(setting: RankSetting, star: Targets, band: str, counts: CountedPlanets) -> BandStanding:
    """Return one band of one star."""
    model, planet = setting.model, setting.planet
    best = best_in_band(model, star, band, setting.time_s, planet)
    counted = counts.completeness(model, band, best)
    own = replace(model, strategy=model.strategy.model_copy(update={"visits": int(best.visits[0])}))
    place = etc.planets_of(float(best.separation_arcsec[0]), planet)
    cases = etc.cases_of(own, star, [band], place)
    choice = _choice(model, best)
    noise = cases.noise(choice)
    told: dict[str, Any] = {"exposure_limited_by": "", "gain_limited_by": "", "gain_caps": {}}
    told |= {"dominant": "", "budget": {}, "remedies": {}}
    if best.n_frames[0] >= 1:
        told = etc.binding_limits(cases.problem("significance"), cases.rates, choice, _ONLY)
        told["dominant"] = etc.largest_term(noise, _ONLY)
        told["budget"] = {name: float(term[_ONLY]) for name, term in noise.terms.items()}
        told["remedies"] = {name: float(term[_ONLY]) for name, term in etc.remedies(cases, choice, noise).items()}
    return BandStanding.of(
        setting_columns(model, best), best, counted, at=0, floor_margin=min(float(best.floor_margin[0]), 1e300), **told
    )


def _choice(model: etc.EtcModel, best: OptimalSetting) -> etc.FrameChoice:
    """Return the frames of a best setting, as the solver gives them."""
    exposure, frames, gain = (
        column[:, None, None] for column in (best.exposure_s, best.frames_per_visit, best.em_gain)
    )
    visit = frames * (exposure + model.camera(str(best.band[0])).readout_s)
    with np.errstate(divide="ignore"):
        return etc.FrameChoice(exposure, frames, gain, visit, 1.0 / best.significance[:, None, None] ** 2)


def _sentences(
    star: RankedTarget, bands: Sequence[BandStanding], ranks: dict[str, int], n_ranked: int, score: ScoreName
) -> list[str]:
    """Return the explanation in words: score, geometry, noise, and how firm the rank is."""
    chosen = next(item for item in bands if item.band == star.band)
    geometry = next(item for item in bands if item.band == star.completeness_band)
    factor, unit = SCORES[score].written
    number = f"{star.score * factor:.3g} {unit}".strip()
    words = [f"Rank {star.rank} of {n_ranked} by {SCORES[score].title}: {number}."]
    words.append(
        f"At {star.distance_pc:.2f} pc, {geometry.in_zone:.1%} of the population lie in the dark quadrants of "
        f"{geometry.band}, {geometry.observable:.1%} with their whole aperture, and "
        f"{star.completeness_unconditional:.1%} are detected by one observation that looks for them blind."
    )
    if star.completeness != star.completeness_unconditional:
        words.append(
            f"What is known of the star leaves {star.completeness:.1%}: the rest would have been found by radial "
            "velocities, has no stable orbit, or stands beside a known giant."
        )
    verdict = {
        "ok": "is detected",
        "speckle_floor": "is not detected by so many visits of any length",
        "common_speckle_floor": "is not detected by any number of visits",
        "insufficient_time": "is not detected in this time",
    }.get(star.reason or star.status, "cannot be observed")
    words.append(
        f"The reference planet at {star.separation_arcsec:.3f} arcsec has a contrast of {star.contrast:.2g} in "
        f"{star.band} and {verdict} ({'blind' if star.verdict_mode == 'blind' else 'at its known place'}): "
        f"significance {star.significance:.2f}, threshold {star.threshold:.2f}."
    )
    if chosen.dominant:
        total = sum(chosen.budget.values())
        share = chosen.budget[chosen.dominant] / total if total > 0 else 0.0
        words.append(
            f"The largest term of the noise is {chosen.dominant.replace('_', ' ')}, {share:.0%} of the variance."
        )
        best = max(chosen.remedies, key=lambda key: chosen.remedies[key])
        words.append(
            f"What helps most: {best.replace('_', ' ')} would multiply the SNR by {chosen.remedies[best]:.2f}."
        )
    if star.visits is not None and star.visit_time_s is not None:
        words.append(f"Observed in {star.visits} visits of {star.visit_time_s / 3600:.2g} h, reduced together.")
    if ranks:
        low, high = min(ranks.values()), max(ranks.values())
        words.append(f"Under the other assumptions it stands between rank {low} and rank {high}.")
    return words
