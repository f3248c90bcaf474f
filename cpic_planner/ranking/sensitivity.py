"""Rankings under changes: other assumptions, an ensemble of instruments that fit what is known, and another ranking.

They show how the ranking depends on what is not known yet, how sure the order is, and why stars move.
"""

import functools
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import ValidationError

from catalogs import TableBytes, astropy_table, star_key
from cpic_core import (
    BoolArray,
    FloatArray,
    InputError,
    IntArray,
    NDArray,
    Record,
    announce,
    fingerprint,
    listed,
    read_file,
    shortened,
)
from cpic_planner.etc import EtcModel, build_model, check_range
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import CONTRAST, OCCURRENCE, Change, Ensemble, EnsembleChoice, ReferencePlanet, changed
from cpic_planner.ranking.completeness import CountedPlanets, KnownChoice
from cpic_planner.ranking.order import RankSetting, rank_targets, ranked
from cpic_planner.registry import DEFAULT_SCORE, SCORES, ScoreName
from cpic_planner.results import (
    FLAG_SEPARATOR,
    ComparedRanking,
    EnsembleBar,
    EnsembleRecord,
    RankAgreement,
    RankComparison,
    RankedTarget,
    RankMove,
    RankResult,
    SensitivityResult,
    SensitivityRow,
    SensitivityStar,
    SettingChange,
    StarInRanking,
    rows_from_csv,
)
from cpic_planner.results.base import Rows
from cpic_planner.results.compared import differing
from cpic_planner.targets import Targets
from simulator.config import Instrument, ParametricAlbedo, at, content_hash, load_instrument
from simulator.imaging import PsfMetrics, at_contrast, measured_states, metrics_key, published_bands
from simulator.passbands import Passbands

TOPS = (10, 50)
"""First stars whose order is compared."""
ENDINGS = (".json", ".csv", ".ecsv")
"""What the names of files with rankings end in."""
_ALWAYS = ("schema_version", "kind", "config_hash", "fingerprint")
_NO_SETTINGS = (*_ALWAYS, "counts", "counts_limited_by", "n_in_catalogue", "targets")
_OF_INSTRUMENT = ("instrument", "drift_nm")
_NAMED = 5
_MOST_BYTES = 100_000_000


class Ranking(Record):
    """A ranking that can be compared with another one.

    Attributes
    ----------
    name : str
        The file or the instrument.
    rows : sequence of RankedTarget
        Best first.
    config_hash : str
        Its own, or that of the file.
    header : mapping or None
        What else the result says of itself; None for a file that does not.
    instrument : Instrument or None
        With what it was made, where that is at hand.
    """

    name: str
    rows: Sequence[RankedTarget]
    config_hash: str
    header: Mapping[str, Any] | None = None
    instrument: Instrument | None = None

    @classmethod
    def of(cls, result: RankResult, name: str = "", instrument: Instrument | None = None) -> Self:
        """Return a result as it is compared."""
        header = {key: getattr(result, key) for key in RankResult.model_fields if key not in _NO_SETTINGS}
        return cls(name or result.instrument or "a ranking", result.targets, result.config_hash, header, instrument)

    @property
    def score_name(self) -> str | None:
        """What it is by; None where the file does not say it."""
        return None if self.header is None else str(self.header["score_name"])

    def record(self) -> ComparedRanking:
        """Return what is written into results."""
        return ComparedRanking.of(
            self,
            n_stars=len(self.rows),
            n_scored=sum(row.score > 0.0 for row in self.rows),
            n_detected=sum(row.status == "ok" for row in self.rows),
        )


def load_ranking(path: str | Path, *, key: str = "other") -> Ranking:
    """Read what ``cpic rank --json`` printed, or ``--out`` wrote; CSV does not say how the ranking was made.

    Parameters
    ----------
    path : str or Path
        Its name ends in one of `ENDINGS`.
    key : str
        What it is asked for as, for messages.

    Raises
    ------
    InputError
        For a file that cannot be read, or is no ranking.
    """
    allowed = "a ranking, as cpic rank --json prints or --out writes it"
    data = read_file(path, key=key, allowed=allowed, max_bytes=_MOST_BYTES)
    file = TableBytes(Path(path).name, data, hashlib.sha256(data).hexdigest())
    try:
        text, ending = data.decode("utf-8-sig"), Path(path).suffix.lower()
        if ending == ".json":
            return Ranking.of(RankResult.model_validate_json(text), file.name)
        rows = rows_from_csv(RankedTarget, text, joined=FLAG_SEPARATOR)
        if not rows:
            raise InputError(key, file.name, allowed=allowed, hint="it has no rows")
        if ending == ".csv":
            return Ranking(file.name, rows, file.sha256)
        told = astropy_table(file, "ecsv")[0].meta
        meta = {name: value for name, value in told.items() if name in RankResult.model_fields}
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(key, file.name, allowed=allowed, hint=f"{where}: {first['msg']}") from None
    except Exception as error:  # astropy refuses a damaged table in many ways
        hint = error.hint if isinstance(error, InputError) and error.key == key else shortened(str(error))
        raise InputError(key, file.name, allowed=allowed, hint=hint) from None
    try:
        return Ranking.of(RankResult.model_validate({**meta, "targets": rows}), file.name)
    except ValidationError:  # of a version that said less of itself
        return Ranking(file.name, rows, file.sha256)


def compare_rankings(before: Ranking, after: Ranking) -> RankComparison:
    """Say what moves from one ranking to another one, and why.

    Parameters
    ----------
    before, after : Ranking
        Stars are the same where their names are, in the spelling of either table.

    Returns
    -------
    RankComparison
        Ranks are those in the whole sample, where a ranking is filtered.

    Raises
    ------
    InputError
        If they have no star in common.
    """
    pairs, only_before, only_after = _paired(before.rows, after.rows)
    if not pairs:
        raise InputError(
            "other", before.name, allowed=f"a ranking with stars of {after.name}", hint="no star in common"
        )
    same_score = None in (before.score_name, after.score_name) or before.score_name == after.score_name
    ranks = np.array([[_rank(row) for row in pair] for pair in pairs])
    moves = [
        RankMove(
            name=new.name,
            hip=new.hip,
            before=StarInRanking.of(old, rank=_rank(old)),
            after=StarInRanking.of(new, rank=_rank(new)),
            places=_rank(old) - _rank(new),
            score_ratio=new.score / old.score if same_score and old.score > 0.0 else None,
            why=_why(old, new, _crossing(ranks, i) if same_score else None),
        )
        for i, (old, new) in enumerate(pairs)
    ]
    scored = [move for move in moves if max(move.before.score, move.after.score) > 0.0]
    first = [move for move in scored if min(move.before.rank, move.after.rank) <= TOPS[-1]]
    mover = max(first or scored or moves, key=lambda move: (abs(move.places), -min(move.before.rank, move.after.rank)))
    settings = _settings(before, after)
    found = {
        "before": before.record(),
        "after": after.record(),
        "settings": settings,
        "only_before": [row.name for row in only_before],
        "only_after": [row.name for row in only_after],
        "n_moved": sum(move.places != 0 for move in scored),
        "detected_more": [row.name for row, old in _new_detections(pairs)],
        "detected_less": [row.name for row, old in _new_detections([(new, old) for old, new in pairs])],
        "agreement": list(_agreement(moves)),
        "largest_mover": mover.name if mover.places else "",
        "largest_mover_places": mover.places,
    }
    return RankComparison(
        config_hash=content_hash({"kind": "comparison", "before": before.config_hash, "after": after.config_hash}),
        **found,
        statement=_comparison_statement(found, moves, scored, mover),
        targets=moves,
    )


def _rank(row: RankedTarget) -> int:
    """Return the rank among all stars; in older results, which had no filters, the rank."""
    return row.rank if row.rank_in_catalogue is None else row.rank_in_catalogue


def _paired(
    before: Sequence[RankedTarget], after: Sequence[RankedTarget]
) -> tuple[list[tuple[RankedTarget, RankedTarget]], list[RankedTarget], list[RankedTarget]]:
    """Return the same stars of both in the order of the second, and what only one of them holds."""
    left = dict(enumerate(before))
    by_name = {row.name: i for i, row in reversed(left.items())}
    by_key = {star_key(row.name): i for i, row in reversed(left.items())}
    pairs, only_after = [], []
    for row in after:
        place = next((i for i in (by_name.get(row.name), by_key.get(star_key(row.name))) if i in left), None)
        if place is None:
            only_after.append(row)
        else:
            pairs.append((left.pop(place), row))
    return pairs, list(left.values()), only_after


def _new_detections(pairs: Sequence[tuple[RankedTarget, RankedTarget]]) -> list[tuple[RankedTarget, RankedTarget]]:
    return [(new, old) for old, new in pairs if new.status == "ok" != old.status]


def _agreement(moves: Sequence[RankMove]) -> Iterator[RankAgreement]:
    """Yield how far the first stars agree, among those that both rankings hold."""
    scores = np.array([[move.before.score, move.after.score] for move in moves])
    place = np.empty(scores.shape, np.int64)
    for side, ranks in enumerate(([move.before.rank for move in moves], [move.after.rank for move in moves])):
        place[np.argsort(ranks, kind="stable"), side] = np.arange(1, len(moves) + 1)
    for top in dict.fromkeys(min(top, len(moves)) for top in TOPS):
        compared = (place.min(axis=1) <= top) & (scores.max(axis=1) > 0.0)
        yield RankAgreement(
            top=top,
            kept=int(np.count_nonzero(place.max(axis=1) <= top)),
            kendall_tau_b=tau_b(*scores[compared].T),
            n_compared=int(np.count_nonzero(compared)),
        )


def _crossing(ranks: np.ndarray[Any, np.dtype[np.int64]], i: int) -> tuple[int, int]:
    """Return how many stars a star passes, and how many pass it."""
    before, after = ranks.T
    passes = (before < before[i]) & (after > after[i])
    passed = (before > before[i]) & (after < after[i])
    return int(np.count_nonzero(passes)), int(np.count_nonzero(passed))


def _limit(row: RankedTarget) -> str:
    return "detected" if row.status == "ok" else f"limited by {(row.limited_by or row.reason).replace('_', ' ')}"


def _percent(share: float) -> str:
    return "0 %" if share == 0.0 else f"{100.0 * share:.3g} %" if share >= 1e-4 else "<0.01 %"


def _excluded(row: RankedTarget) -> str:
    """Return the share of what is detected that is not counted, because it is known not to be there."""
    of_all = row.completeness_unconditional
    return _percent(1.0 - row.completeness / of_all) if of_all else "0 %"


Says = Mapping[str, Callable[[RankedTarget], str]]
_STAR: Says = {
    "completeness": lambda row: _percent(row.completeness),
    "excluded by what is known": _excluded,
    "time": lambda row: "none" if row.completeness_time_s is None else f"{row.completeness_time_s / 3600.0:.3g} h",
    "band": lambda row: row.completeness_band,
    "distance": lambda row: f"{row.distance_pc:.4g} pc",
    "V": lambda row: f"{row.v_mag:.2f} mag",
    "type": lambda row: row.sp_type,
}
_PLANET: Says = {
    "band": lambda row: row.band,
    "visits": lambda row: "none" if row.visits is None else str(row.visits),
    "": _limit,
}
"""What may change of a star and of its reference planet: a change is what is written otherwise."""
_MARGIN: Says = {"margin": lambda row: f"{row.detection_margin:.3g}"}
"""What orders stars without a score."""


def _changes(says: Says, old: RankedTarget, new: RankedTarget) -> dict[str, str]:
    texts = ((name, text(old), text(new)) for name, text in says.items())
    return {name: f"{name} {was} → {now}".strip() for name, was, now in texts if was != now}


def _why(old: RankedTarget, new: RankedTarget, crossing: tuple[int, int] | None) -> str:
    """Return what changes of a star, and how others move past it where that decides its place."""
    star = _changes(_STAR, old, new)
    planet = _changes(_PLANET if max(old.score, new.score) > 0.0 else {**_PLANET, **_MARGIN}, old, new)
    if old.completeness_unconditional != new.completeness_unconditional and "0 %" not in map(_excluded, (old, new)):
        star.pop("excluded by what is known", None)  # it only follows from which planets are detected
    if all(row.band == row.completeness_band for row in (old, new)):  # one observation is the best for both
        planet.pop("band", None)
        star |= {"visits": planet.pop("visits")} if "visits" in planet else {}
    words = list(star.values())
    if planet:
        words.append(f"reference planet: {', '.join(planet.values())}")
    words = words or ["unchanged"]
    if crossing is None:
        return "; ".join(words)
    passes, passed = crossing
    if old.score <= new.score and _rank(new) > _rank(old):
        words.append(f"passed by {_counted(passed)} that gain{'s' * (passed == 1)}{' more' * (new.score > old.score)}")
    elif old.score >= new.score and _rank(new) < _rank(old):
        words.append(f"passes {_counted(passes)} that lose{'s' * (passes == 1)}{' more' * (new.score < old.score)}")
    return "; ".join(words)


def _counted(stars: int) -> str:
    return f"{stars} star{'s' * (stars != 1)}"


def _settings(before: Ranking, after: Ranking) -> list[SettingChange] | None:
    """Return the settings that differ; those of the instruments key by key, where both are at hand."""
    if before.header is None or after.header is None:
        return None
    old, new = dict(before.header), dict(after.header)
    if before.instrument is not None and after.instrument is not None:
        old |= dict.fromkeys(_OF_INSTRUMENT) | {"instrument": before.instrument}
        new |= dict.fromkeys(_OF_INSTRUMENT) | {"instrument": after.instrument}
    return differing(old, new)


def _comparison_statement(
    found: Mapping[str, Any], moves: Sequence[RankMove], scored: Sequence[RankMove], mover: RankMove
) -> str:
    """Return the comparison in words: who moves, which planets are detected, how firm the order is, who moves most."""
    before, after = found["before"], found["after"]
    words = []
    if not scored:
        words.append("No star has a score above zero in either ranking.")
    elif found["n_moved"]:
        moved = found["n_moved"]
        stand = f"stand{'s' * (moved == 1)} at another rank"
        words.append(f"{moved} of {_counted(len(scored))} with a score above zero {stand}.")
    else:
        words.append(f"No star with a score above zero moves ({_counted(len(scored))}).")
    old, new = (sum(getattr(move, side).status == "ok" for move in moves) for side in ("before", "after"))
    earlier = "as before" if not found["detected_more"] + found["detected_less"] else f"before around {old}"
    words.append(f"The reference planet is detected around {new} of {_counted(len(moves))}, {earlier}.")
    if found["detected_more"]:
        words.append(f"It becomes detected around {listed(found['detected_more'], _NAMED)}.")
    if found["detected_less"]:
        words.append(f"It is no longer detected around {listed(found['detected_less'], _NAMED)}.")
    for item in found["agreement"]:
        if item.kendall_tau_b is not None:
            words.append(
                f"Kendall's tau of the scores over the first {item.top} is {item.kendall_tau_b:.2f} "
                f"({item.n_compared} stars)."
            )
    if mover.places:
        way = f"{'up' if mover.places > 0 else 'down'} from rank {mover.before.rank} to {mover.after.rank}"
        words.append(f"{mover.name} moves most, {way}: {mover.why}.")
    if None not in (before.score_name, after.score_name) and before.score_name != after.score_name:
        titles = (SCORES[name].title for name in (before.score_name, after.score_name))
        words.append("The rankings are by different scores, {} and {}: only the order is compared.".format(*titles))
    for ranking, names in ((before, found["only_before"]), (after, found["only_after"])):
        if names:
            words.append(f"Only {ranking.name} holds {listed(names, _NAMED)}.")
    return " ".join(words)


N_TOP, N_FIRST, POOL = 50, 10, 6


class Order(Record):
    """Stars under one assumption, arrays ``(n,)``, or under some instruments, ``(instruments, n)``; and their names.

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
        """Ranks among these stars, 1 for the first: by score, ties by the reference planet's margin, then by name."""
        by_name = np.broadcast_to(np.argsort(np.argsort(self.names, kind="stable"), kind="stable"), self.score.shape)
        order = np.lexsort((by_name, -self.margin, -self.score), axis=-1)
        rank = np.empty(order.shape, np.int64)
        np.put_along_axis(rank, order, np.broadcast_to(np.arange(1, order.shape[-1] + 1), order.shape), axis=-1)
        return rank

    @property
    def total(self) -> FloatArray:
        """Expected planets of one observation of every star, one number for each instrument."""
        return np.asarray(self.planets.sum(axis=-1))

    @property
    def reachable(self) -> IntArray:
        """Stars whose reference planet is detected, for each instrument."""
        return np.asarray(np.count_nonzero(self.detected, axis=-1))

    def matters(self, early: int) -> BoolArray:
        """Tell which stars are detected, add to the expected planets, or have an early rank under any instrument."""
        counts = self.planets > _SMALL * self.total[:, None]
        return np.asarray((self.detected | counts | (self.rank <= early)).any(axis=0))

    def of(self, chosen: BoolArray) -> "Order":
        """Return some of the stars."""
        return Order(*(getattr(self, item.name)[..., chosen] for item in fields(Order)))

    def beside(self, other: "Order") -> "Order":
        """Return these stars and others under the same instruments."""
        parts = ((getattr(self, item.name), getattr(other, item.name)) for item in fields(Order))
        return Order(*(np.concatenate(pair, axis=-1) for pair in parts))


class Assumption(Record):
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


def in_order(
    setting: RankSetting, targets: Targets, counts: CountedPlanets | None = None, occurrence: float = 1.0
) -> Order:
    """Rank stars under one setting.

    Parameters
    ----------
    setting : RankSetting
    targets : Targets
    counts : CountedPlanets, optional
        Those of the setting's population around these stars.
    occurrence : float
        Factor on the population's planets per star.
    """
    found = ranked(setting, targets, brief=True, counts=counts)
    planets = np.stack([part.counted for part in found.counted])[found.picked, np.arange(len(targets))]
    rate = setting.population.record().planets_per_star
    planets = planets if rate is None else planets * rate * occurrence
    return Order(targets.name, found.score, found.best.margin, found.best.detected, planets)


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
    return _earlier(rank, margin) <= POOL * top


def _earlier(rank: IntArray, margin: FloatArray) -> IntArray:
    """Return the rank by score or by the reference planet's margin, whichever comes first."""
    by_margin = np.empty(len(rank), np.int64)
    by_margin[np.argsort(-margin, kind="stable")] = np.arange(1, len(rank) + 1)
    return np.minimum(rank, by_margin)


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
    targets, rank, scores = targets.select(pool), nominal.rank[pool], nominal.score[pool]
    others = list(under_others(setting, targets, assumptions))
    rows = [_compared(assumption, rank, scores, other, n_top, n_first) for assumption, other in others]
    asked = {"kind": "sensitivity", "rank": digest, "top": top, "assumptions": [row.assumption for row in rows]}
    ranks = np.array([rank, *(other.rank for _, other in others)])
    stars = [
        SensitivityStar(
            name=str(targets.name[at]),
            rank=int(rank[at]),
            rank_lowest=int(ranks[:, at].min()),
            rank_highest=int(ranks[:, at].max()),
        )
        for at in np.argsort(rank)[:n_top]
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
    assumption: Assumption, rank: IntArray, scores: FloatArray, other: Order, n_top: int, n_first: int
) -> SensitivityRow:
    """Return what becomes of the first stars by nominal rank, with their scores, under another assumption."""
    first = np.flatnonzero(rank <= n_top)
    scored = (np.minimum(rank, other.rank) <= n_top) & ((scores > 0) | (other.score > 0))
    falls = other.rank[first] - rank[first]
    worst = int(np.argmax(falls))
    return SensitivityRow(
        assumption=assumption.key,
        text=assumption.text,
        n_ok=int(np.count_nonzero(other.detected)),
        kendall_tau_b=tau_b(scores[scored], other.score[scored]),
        n_compared=int(np.count_nonzero(scored)),
        kendall_tau=tau_b(rank[first], other.rank[first]),
        kept=int(np.count_nonzero(other.rank[first] <= n_top)),
        kept_first=int(np.count_nonzero(other.rank[rank <= n_first] <= n_first)),
        largest_fall=str(other.names[first[worst]]) if falls[worst] > 0 else "",
        largest_fall_ranks=max(int(falls[worst]), 0),
        best=str(other.names[int(np.argmin(other.rank))]),
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

    The words are those of an ensemble of instruments (`cpic_planner.ranking.sensitivity`).
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


FIRST = 10
"""Ranks that the probability of standing among the first is of."""
MOST_RANKED, WHOLE = 100, 8
"""Stars that every instrument ranks at first, and instruments that rank all of them."""
_SMALL = 1e-3  # share of the expected planets of all stars below which a star does not matter
ENDS = (0.05, 0.95)
"""Shares of a number's law that are below the two ends of its bar."""


MirrorStates: TypeAlias = dict[str, tuple[PsfMetrics, ...]]
"""Measured states of the mirror, by band."""


def check_modelled(model: EtcModel) -> None:
    """Refuse a coronagraph of a table, which no ensemble is about."""
    if model.of_table:
        hint = "an ensemble says what is not known of modelled optics"
        raise InputError("coronagraph.table", model.instrument.name, allowed="no ensemble of instruments", hint=hint)


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


def standings(
    setting: RankSetting, targets: Targets, choice: EnsembleChoice, draws: Sequence[Mapping[str, float]]
) -> Order:
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
    every = [
        in_order(replace(setting, model=one), targets, counts, drawn.get(OCCURRENCE, 1.0))
        for one, drawn in zip(models, draws, strict=True)
    ]
    names = ("score", "margin", "detected", "planets")
    return Order(targets.name, *(np.stack([getattr(one, name) for one in every]) for name in names))


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
    if instruments is not None:
        check_modelled(model)
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
    All instruments rank the stars that may matter: the first `MOST_RANKED` by nominal score and margin, and those that
    matter under any of `WHOLE` of the instruments, which rank all stars: evenly spaced by the number of expected
    planets, the best and the worst among them. The reference planets of the others are detected under none of these;
    their ranks are those of these few instruments.
    """
    drawn = choice.draws()
    draws = [{key: float(values[i]) for key, values in drawn.items()} for i in range(choice.n_instruments)]
    rows, row_of = Rows.held(result.targets), {name: i for i, name in enumerate(targets.name.tolist())}
    order = np.array([row_of[name] for name in rows.columns["name"].tolist()])
    earlier = _earlier(rows.columns["rank"], rows.columns["detection_margin"])
    first = np.zeros(len(targets), bool)
    first[order[np.argsort(earlier, kind="stable")[:MOST_RANKED]]] = True
    found, whole = _ranked_by_all(setting, targets, choice, draws, first)
    pool = np.array([row_of[name] for name in found.names.tolist()])
    columns = {name: np.array(values)[order] for name, values in _columns(found, whole, pool).items()}
    record = _record(setting, targets.select(pool), choice, found)
    shown = rows.having(**columns)
    asked = {"rank": result.config_hash, "ensemble": choice.ensemble.model_dump(mode="json"), "seed": choice.seed}
    digest = content_hash(asked | {"n_instruments": choice.n_instruments})
    return result.model_copy(update={"targets": shown, "ensemble": record, "config_hash": digest})


def _ranked_by_all(
    setting: RankSetting,
    targets: Targets,
    choice: EnsembleChoice,
    draws: Sequence[Mapping[str, float]],
    pool: BoolArray,
) -> tuple[Order, Order]:
    """Return the pool's stars under every instrument, the pool grown as needed, and all stars under some.

    Most stars that the pool needs besides matter where the drift's cross term with the static field is least or most:
    ranked with it from the start, they cost little.
    """
    crossed = [drawn.get("drift", 1.0) * math.sqrt(drawn.get(CONTRAST, 1.0)) for drawn in draws]
    ends = sorted({int(np.argmin(crossed)), int(np.argmax(crossed))})
    announce(f"ranking all {len(targets)} stars under {len(ends)} of the instruments")
    near = pool | standings(setting, targets, choice, [draws[i] for i in ends]).matters(MOST_RANKED)
    announce(f"ranking {np.count_nonzero(near)} stars under {len(draws)} instruments")
    close = standings(setting, targets.select(near), choice, draws)
    by_total = np.argsort(close.of(pool[near]).total, kind="stable")
    some = by_total[np.unique(np.linspace(0, len(draws) - 1, min(WHOLE, len(draws))).astype(int))]
    announce(f"ranking all {len(targets)} stars under {len(some)} of the instruments")
    whole = standings(setting, targets, choice, [draws[i] for i in some])
    pool = pool | whole.matters(MOST_RANKED // 2)
    found, missed = close.of(pool[near]), pool & ~near
    if missed.any():
        announce(f"ranking {np.count_nonzero(missed)} more stars under {len(draws)} instruments")
        found = found.beside(standings(setting, targets.select(missed), choice, draws))
    return found, whole


def _columns(found: Order, whole: Order, pool: IntArray) -> dict[str, list[float]]:
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


def _record(setting: RankSetting, targets: Targets, choice: EnsembleChoice, found: Order) -> EnsembleRecord:
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
        statement=_ensemble_statement(bars, numbers, often, choice.n_instruments),
        **numbers,
    )


def _least_tau(bar: EnsembleBar) -> float:
    return min(1.0 if tau is None else tau for tau in (bar.tau_low, bar.tau_high))


def _ensemble_statement(
    bars: Sequence[EnsembleBar], numbers: Mapping[str, float], often: int, n_instruments: int
) -> str:
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
