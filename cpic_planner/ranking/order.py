"""The analytic ranking of the whole sample, and what the answer about selected stars alone says otherwise."""

import functools
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from catalogs import StarTable, amplitude_m_s, snapshot_vintage
from cpic_core import BoolArray, FloatArray, InputError, IntArray, Record, announce, fingerprint, visible
from cpic_planner import etc
from cpic_planner.planets import PopulationChoice, StarLimits, excluded_by_rv, least_mass
from cpic_planner.queries import DEFAULT_TIME_S, OptimiseQuestion, RankedQuestion, ReferencePlanet
from cpic_planner.ranking.completeness import BandCompleteness, CountedPlanets, KnownChoice
from cpic_planner.ranking.optimiser import OptimalSetting, Search, best_of, objects, quickest, setting_columns, tiers_of
from cpic_planner.registry import DEFAULT_SCORE, SCORES, ScoreName, StarNumbers
from cpic_planner.results import RankedTarget, RankResult, ReferencePlanetRecord
from cpic_planner.results.base import DetectionMode, OwnCells, Rows, gathered
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import content_hash


def selected(whole: RankResult, targets: Targets, chosen: BoolArray, sample: str) -> RankResult:
    """Return the ranking of some stars from that of all, equal to the one that `rank_targets` gives.

    Parameters
    ----------
    whole : RankResult
        Of all ``targets``.
    targets : Targets
        ``n`` stars.
    chosen : ndarray of bool, shape (n,)
        Those that the rows are about.
    sample : str
        Which these are, in words.
    """
    if chosen.all():
        return whole.model_copy(update={"sample": sample})
    names = set(targets.name[chosen].tolist())
    kept = [row for row in whole.targets if row.name in names]
    rows = [row.model_copy(update={"rank": rank}) for rank, row in enumerate(kept, start=1)]
    said = {"config_hash": digest_of(whole.config_hash, chosen), "sample": sample, "targets": rows}
    told = ([getattr(row, name) for row in rows] for name in ("status", "reason", "limited_by"))
    return whole.model_copy(update=said | counts_of(*told))


def digest_of(whole: str, chosen: BoolArray) -> str:
    """Return the hash of a ranking of some stars, from that of all."""
    return content_hash({"kind": "rank", "rank": whole, "stars": np.flatnonzero(chosen).tolist()})


def counts_of(status: Iterable[str], reason: Iterable[str], limited_by: Iterable[str | None]) -> dict[str, Any]:
    """Return how many rows have which outcome, and how many are limited by what, by the names of the fields."""
    outcomes = (why or what for what, why in zip(status, reason, strict=True))
    return {"counts": _counts(outcomes), "counts_limited_by": _counts(what or "none" for what in limited_by)}


def _counts(words: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(words).items()))


MOST_OWN = 40
"""Columns of a user's table that travel to the output without being asked for by name."""
OWN_PREFIX = "own_"
"""Stands before the heading of such a column where it is that of a column of the ranking."""


def with_own(rank: RankResult, table: StarTable, names: Collection[str] = ()) -> RankResult:
    """Return a ranking whose rows carry the columns of a user's table that are not used.

    Parameters
    ----------
    rank : RankResult
    table : StarTable
        Of its stars.
    names : collection of str
        Columns that are asked for beside the first ones, by the names that they have in the output; ``help``: all.
    """
    if not table.own:
        return rank
    headings = {f"{OWN_PREFIX * (text in RankedTarget.model_fields)}{visible(text)}": text for text in table.own}
    taken = {
        name: table.own[text]
        for number, (name, text) in enumerate(headings.items())
        if number < MOST_OWN or name in names or "help" in names
    }
    rows, row_of = Rows.held(rank.targets), {name: row for row, name in enumerate(table.column("name").tolist())}
    own = OwnCells(taken)[[row_of[name] for name in rows.columns["name"].tolist()]]
    return rank.model_copy(update={"targets": rows.having(own=own)})


_TOGETHER = 1200  # stars that are ranked at once
_SLACK = 1.2  # by how much a finer grid of separations may beat the coarse one of floors


def timed_model(model: etc.EtcModel, question: RankedQuestion | OptimiseQuestion) -> tuple[etc.EtcModel, float]:
    """Return the model and the wall time of a question; a given length of the visits sets their number or the time.

    Raises
    ------
    InputError
        If time, number and length of the visits contradict each other.
    """
    time_s = DEFAULT_TIME_S if question.time_s is None else question.time_s
    if question.visit_time_s is None:
        return model, time_s
    strategy = model.strategy
    given = strategy.visits is None or (question.time_s is not None and "time_s" in question.model_fields_set)
    span = etc.Span.of(model, time_s if given else None, question.visit_time_s)
    assert span.time_s is not None
    return replace(model, strategy=strategy.model_copy(update={"visits": span.visits})), span.time_s


class RankSetting(Record):
    """The settings that a ranking is made with; made by `of`.

    ``time_s`` is the wall time per target and band, ``planet`` the reference planet, ``bands`` names of bands of the
    model, ``population`` what completeness counts, and ``score`` what the stars are ordered by.
    """

    model: etc.EtcModel
    time_s: float
    planet: ReferencePlanet
    bands: tuple[str, ...]
    population: PopulationChoice | KnownChoice
    score: ScoreName

    @classmethod
    def of(
        cls,
        model: etc.EtcModel,
        *,
        time_s: float,
        planet: ReferencePlanet | None = None,
        bands: Sequence[str] | None = None,
        population: PopulationChoice | KnownChoice | None = None,
        score: ScoreName = DEFAULT_SCORE,
    ) -> Self:
        """Return what a ranking is asked for, checked and complete; parameters are those of `rank_targets`."""
        return cls(
            model=model,
            time_s=etc.check_range("time_s", time_s, 1e-3, 1e9, "s"),
            planet=planet or ReferencePlanet(),
            bands=model.named(bands),
            population=population or PopulationChoice.default(),
            score=score,
        )

    @property
    def search(self) -> DetectionMode:
        """Return how the planets that completeness counts are looked for."""
        return "known_place" if isinstance(self.population, KnownChoice) else self.model.strategy.search

    def limits(self, targets: Targets) -> StarLimits | None:
        """Return what is known of the stars and excludes planets; None where the planets are the known ones."""
        return None if isinstance(self.population, KnownChoice) else self.population.limits(targets.name.tolist())

    def digest(self, targets: Targets) -> str:
        """Return the hash of everything that decides a ranking."""
        limits = self.limits(targets)
        decides = {
            "kind": "rank",
            "version": __version__,
            "model": self.model.content(),
            "targets": targets.content(),
            "bands": list(self.bands),
            "time_s": self.time_s,
            "score": self.score,
            "planet": self.planet.content(),
            "population": self.population.content(),
            "limits": None if limits is None else limits.digest(),
        }
        return content_hash(decides)


MEDIAN_INCLINATION_DEG = 60.0
"""Half of all orbits, whose poles are isotropic, are inclined by more."""


def reference_velocities(
    targets: Targets, separation_arcsec: FloatArray, planet: ReferencePlanet
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return what velocities say of the reference planet where it stands, arrays of ``n`` stars.

    Parameters
    ----------
    targets : Targets
        ``n`` stars.
    separation_arcsec : ndarray, shape (n,)
        Projected, where the planet stands.
    planet : ReferencePlanet

    Returns
    -------
    distance_au : ndarray
        From its star: the radius of its orbit.
    amplitude_m_s : ndarray
        Of the star's velocity, where the planet has the least mass of its radius and the median inclination.
    excluded : ndarray of bool
        Whether velocities would have shown it.
    """
    names: list[str] = targets.name.tolist()
    distance = etc.reference_distance_au(targets, separation_arcsec[:, None], planet)[:, 0]
    msini = least_mass(planet.radius_rjup) * math.sin(math.radians(MEDIAN_INCLINATION_DEG))
    amplitude = amplitude_m_s(msini, distance, StarLimits.of(names, ()).star_mass_msun)
    return distance, amplitude, excluded_by_rv(names, distance, planet.radius_rjup)


class Ranked(Record):
    """Numbers of a ranking before they become rows; arrays of ``n`` stars.

    ``best`` is the reference planet's best band, ``by_band`` the same in each band, ``quickest_s`` its least time to a
    detection and ``quickest_visits`` the visits of that (NaN for none, or where it was not asked for); ``counted`` the
    completeness in each band, ``picked`` the index of the band where it is largest per hour (or largest, where that is
    the score).
    """

    setting: RankSetting
    best: OptimalSetting
    by_band: tuple[OptimalSetting, ...]
    quickest_s: FloatArray
    quickest_visits: FloatArray
    counted: tuple[BandCompleteness, ...]
    picked: IntArray
    score: FloatArray

    @functools.cached_property
    def completeness_time_s(self) -> FloatArray:
        """Wall time of the observation that the completeness refers to; 0 for none."""
        return np.stack([item.time_s for item in self.by_band])[self.picked, np.arange(len(self.picked))]


def ranked(
    setting: RankSetting, targets: Targets, *, brief: bool = False, counts: CountedPlanets | None = None
) -> Ranked:
    """Return the best settings, completeness and score of every star.

    ``brief``: neither least times nor what limits them, and of a blind search nothing at known places. ``counts``: the
    setting's planets around these stars.
    """
    model, planet, bands = setting.model, setting.planet, setting.bands
    counts = counts or CountedPlanets.of(setting.population, targets)
    chosen = SCORES[setting.score]
    if len(targets) < 1:
        raise InputError("targets", len(targets), allowed="at least one star")
    searches = [Search(model, targets, band, planet) for band in bands]
    by_band = tuple(search.in_time(setting.time_s, brief=brief) for search in searches)
    best = best_of(by_band)
    least = np.full((2, len(targets)), np.nan)
    if not brief or chosen.timed:
        floors = np.stack([item.floor_margin / item.needed_margin for item in by_band])
        near = np.nan_to_num(floors).max(axis=0) * _SLACK > 1.0
        least[:, near] = quickest(searches, np.flatnonzero(near)) if near.any() else np.nan
        # Whether any programme detects the planet is known now: the bound was from a coarse grid of places.
        found = np.isfinite(least[0])
        moves = ~found & (floors.max(axis=0) > 1.0) & np.isfinite(best.orbits_searched)
        best = replace(best, floor_margin=np.where(found, np.inf, 0.0), moves=moves)
    pairs = zip(bands, by_band, strict=True)
    counted = tuple(counts.completeness(model, band, item, brief=brief) for band, item in pairs)
    numbers = _numbers(best, by_band, least[0], counted)
    picked = np.argmax(chosen.by_band(numbers), axis=0)
    return Ranked(setting, best, by_band, least[0], least[1], counted, picked, np.asarray(chosen.value(numbers), float))


def _numbers(
    best: OptimalSetting, by_band: Sequence[OptimalSetting], quickest_s: FloatArray, counted: Sequence[BandCompleteness]
) -> StarNumbers:
    """Return what scores are made of; completeness is -1 for extrapolated albedos if another band has it."""
    shares = np.stack([part.counted for part in counted])
    times = np.stack([item.time_s for item in by_band])
    known = np.array(["extrapolated" not in part.flags for part in counted])
    counts = known[:, None] | ~known.any()
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.where(times > 0, shares / times * 3600.0, 0.0)
    same = ("margin", "snr", "significance", "contrast", "deepest_limit", "time_s")
    return StarNumbers(
        completeness=np.where(counts, shares, -1.0),
        completeness_per_hour=np.where(counts, rates, -1.0),
        detections_per_hour=np.nan_to_num(3600.0 / quickest_s),
        **{name: getattr(best, name) for name in same},
    )


def rank_targets(
    model: etc.EtcModel,
    targets: Targets,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
    population: PopulationChoice | KnownChoice | None = None,
    score: ScoreName = DEFAULT_SCORE,
    chosen: BoolArray | None = None,
    sample: str = "",
    catalogue: str | None = None,
) -> RankResult:
    """Rank targets.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    time_s : float
        Wall time per target and band, overheads and reference frames included.
    planet : ReferencePlanet, optional
    bands : sequence of str, optional
        All of the model by default.
    population : PopulationChoice or KnownChoice, optional
        What completeness refers to; giant planets by default. With known planets it is the probability that the
        observation detects at least one of the star's own at the given date; stars without any have 0.
    score : str
        Score that orders the stars, a name of `cpic_planner.registry.SCORES`.
    chosen : ndarray of bool, shape (n,), optional
        Stars that the rows are about, all by default; the others count for ``rank_in_catalogue`` alone.
    sample : str
        Which stars the rows are about, in words.
    catalogue : str, optional
        Which table they are from (`catalogs.catalogue.Catalogue.provenance`); the snapshot by default.

    Returns
    -------
    RankResult
        One row per chosen star, best first: descending score, ties by ``detection_margin``, then name.

    Raises
    ------
    InputError
    """
    setting = RankSetting.of(model, time_s=time_s, planet=planet, bands=bands, population=population, score=score)
    digest = setting.digest(targets)
    parts = [_columns(setting, targets.select(some)) for some in parts_of(len(targets), "ranking {} stars")]
    scores, margins = (np.concatenate([part[name] for part in parts]) for name in ("score", "detection_margin"))
    order = np.lexsort((targets.name, -margins, -scores))
    place = np.arange(1, len(order) + 1)
    if chosen is not None and not chosen.all():
        digest = digest_of(digest, chosen)
        order, place = order[chosen[order]], place[chosen[order]]
    columns = {name: np.concatenate([part.pop(name) for part in parts])[order] for name in list(parts[0])}
    ranks = {"rank": np.arange(1, len(order) + 1), "rank_in_catalogue": place}
    rows = Rows(RankedTarget, {**columns, **ranks})
    told = (rows.columns[name].tolist() for name in ("status", "reason", "limited_by"))
    return RankResult(
        fingerprint=str(fingerprint()),
        config_hash=digest,
        instrument=model.instrument.name,
        catalogue=snapshot_vintage() if catalogue is None else catalogue,
        sample=sample,
        date_utc=targets.date_utc,
        time_s=setting.time_s,
        sigma=model.strategy.sigma,
        reference_library=model.strategy.library,
        annulus_lambda_d=model.strategy.annulus_lambda_d,
        search=setting.search,
        visits=model.strategy.visits,
        drift_nm=model.instrument.drift.visit_nm,
        reference_planet=ReferencePlanetRecord.of(setting.planet, albedo=setting.planet.albedo.label),
        population=setting.population.record(),
        score_name=score,
        **counts_of(*told),
        n_in_catalogue=len(targets),
        targets=rows.listed,
    )


def parts_of(n_stars: int, text: str) -> Iterator[IntArray]:
    """Yield the numbers of stars that are ranked together, as few as memory holds, and announce each with the text."""
    for start in range(0, max(n_stars, 1), _TOGETHER):
        announce(text.format(n_stars if n_stars <= _TOGETHER else f"{start} of {n_stars}"))
        yield np.arange(start, min(start + _TOGETHER, n_stars))


def _columns(setting: RankSetting, targets: Targets) -> dict[str, Any]:
    """Return the columns of rows of stars in their own order, without ranks."""
    found, model, planet = ranked(setting, targets), setting.model, setting.planet
    best, counted, every = found.best, found.counted, np.arange(len(targets))
    said, quickest_s, luminosity = setting_columns(model, best), found.quickest_s, targets.luminosity_lsun
    distance, amplitude, excluded = reference_velocities(targets, best.separation_arcsec, planet)
    time_s = np.where(found.completeness_time_s > 0.0, found.completeness_time_s, np.nan)
    of_band = {
        name: np.stack([getattr(part, name) for part in counted])[found.picked, every]
        for name, column in vars(counted[0]).items()
        if isinstance(column, np.ndarray)
    }
    further = {name: getattr(targets, name) for name in ("hip", "hd", "gj")}
    names = {
        name: objects([cell or None for cell in part.tolist()]) for name, part in further.items() if part is not None
    }
    share = np.stack([part.counted for part in counted])[found.picked, every]
    with np.errstate(divide="ignore", invalid="ignore"):
        insolation_au = np.where(luminosity > 0.0, distance / np.sqrt(luminosity), np.nan)
    return gathered(
        RankedTarget,
        said,
        SimpleNamespace(**of_band),
        best,
        targets,
        tier=tiers_of(said, best, quickest_s, setting.time_s),
        score=found.score,
        **names,
        detection_time_s=quickest_s,
        detection_visits=found.quickest_visits,
        required_time_s=np.where(said.verdict == "detected", np.nan, quickest_s),
        completeness_error=of_band["standard_error"],
        completeness_band=np.array(setting.bands)[found.picked],
        completeness_time_s=time_s,
        completeness_per_hour=np.nan_to_num(share / time_s * 3600.0),
        ref_planet_distance_au=distance,
        rv_amplitude_m_s=amplitude,
        ref_planet_insolation_au=insolation_au,
        flags=objects(_flags(model, targets, best, planet, excluded)),
    )


def _flags(
    model: etc.EtcModel, targets: Targets, best: OptimalSetting, planet: ReferencePlanet, excluded: BoolArray
) -> list[tuple[str, ...]]:
    """Return the caveats of each star; equal ones are one object."""
    bloom_in = {band: etc.companion_saturates(model, targets, band, best.exposure_s) for band in model.bands}
    clamped = model.passbands.grid_flags(targets.teff_k, targets.log_g, targets.metallicity).any
    of_all = (*model.library_flags, *([etc.MODES_NOT_COUNTED] if model.strategy.n_modes else []))
    of_band = {band: etc.hole_notes(model, band) for band in model.bands}
    found, known = [], dict[tuple[str, ...], tuple[str, ...]]()
    columns = best.band.tolist(), best.separation_arcsec.tolist(), best.inherited.tolist(), clamped, excluded
    for i, (band, separation, inherited, beyond, shown) in enumerate(zip(*columns, strict=True)):
        flags = [*targets.flags[i], *of_all, *etc.reference_notes(model, targets, band, separation, planet, i)]
        flags += of_band[band]
        if beyond and "stellar_grid_clamped" not in flags:
            flags.append("stellar_grid_clamped")
        flags += filter(None, [inherited])
        if bloom_in[band][i]:
            flags.append("companion_saturates")
        if shown:
            flags.append("excluded_by_rv")
        found.append(known.setdefault(tuple(flags), tuple(flags)))
    return found
