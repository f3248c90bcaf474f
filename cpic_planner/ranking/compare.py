"""Compare two rankings and say why stars move: an earlier ranking in a file, or another instrument, and this one."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import ValidationError

from catalogs import TableBytes, astropy_table, star_key
from cpic_core import InputError, listed, read_file, shortened
from cpic_planner.ranking.sensitivity import tau_b
from cpic_planner.registry import SCORES
from cpic_planner.results import (
    FLAG_SEPARATOR,
    ComparedRanking,
    RankAgreement,
    RankComparison,
    RankedTarget,
    RankMove,
    RankResult,
    SettingChange,
    StarInRanking,
    rows_from_csv,
)
from simulator.config import Instrument, content_hash

TOPS = (10, 50)
"""First stars whose order is compared."""
ENDINGS = (".json", ".csv", ".ecsv")
"""What the names of files with rankings end in."""
_ALWAYS = ("schema_version", "kind", "config_hash", "fingerprint")
_NO_SETTINGS = (*_ALWAYS, "counts", "counts_limited_by", "n_in_catalogue", "targets")
_OF_INSTRUMENT = ("instrument", "drift_nm")
_NAMED = 5
_MOST_BYTES = 100_000_000


@dataclass(frozen=True)
class Ranking:
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
        statement=_statement(found, moves, scored, mover),
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


def _hours(value: float | None) -> str:
    return "none" if value is None else f"{value / 3600.0:.3g} h"


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
    "time": lambda row: _hours(row.completeness_time_s),
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
    flat, other = dict(_leaves(old)), dict(_leaves(new))
    return [
        SettingChange(key=key, before=flat.get(key, "none"), after=other.get(key, "none"))
        for key in flat | other
        if flat.get(key, "none") != other.get(key, "none")
    ]


def _leaves(tree: Any, above: str = "") -> Iterator[tuple[str, str]]:
    """Yield the dotted keys of a tree, and what is there as text."""
    if hasattr(tree, "model_dump"):
        tree = {name: getattr(tree, name) for name in type(tree).model_fields}
    if isinstance(tree, Mapping):
        for name, below in tree.items():
            yield from _leaves(below, f"{above}.{name}" if above else str(name))
    elif isinstance(tree, float):
        yield above, f"{tree:.6g}"
    elif isinstance(tree, list | tuple):
        yield above, ", ".join(text for item in tree for _, text in _leaves(item, above)) or "none"
    else:
        yield above, "none" if tree is None else str(tree)


def _statement(found: Mapping[str, Any], moves: Sequence[RankMove], scored: Sequence[RankMove], mover: RankMove) -> str:
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
