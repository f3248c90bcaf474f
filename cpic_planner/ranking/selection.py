"""Select stars of a ranking, and say what the answer about them alone says otherwise."""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from cpic_core import BoolArray
from cpic_planner.results import RankedTarget, RankResult
from cpic_planner.targets import Targets
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
    return whole.model_copy(update=said | counts_of(rows))


def digest_of(whole: str, chosen: BoolArray) -> str:
    """Return the hash of a ranking of some stars, from that of all."""
    return content_hash({"kind": "rank", "rank": whole, "stars": np.flatnonzero(chosen).tolist()})


def counts_of(rows: Iterable[RankedTarget]) -> dict[str, dict[str, int]]:
    """Return how many rows have which outcome, and how many are limited by what, by the names of the fields."""
    listed = list(rows)
    return {
        "counts": _counts(row.reason or row.status for row in listed),
        "counts_limited_by": _counts(row.limited_by or "none" for row in listed),
    }


def _counts(words: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(words).items()))
