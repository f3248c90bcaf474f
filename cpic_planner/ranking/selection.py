"""Select stars of a ranking, and say what the answer about them alone says otherwise."""

from collections import Counter
from collections.abc import Collection, Iterable

import numpy as np

from catalogs import StarTable
from cpic_core import BoolArray, visible
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
        name: table.own[text].tolist()
        for number, (name, text) in enumerate(headings.items())
        if number < MOST_OWN or name in names or "help" in names
    }
    row_of = {name: row for row, name in enumerate(table.column("name").tolist())}
    rows = [
        row.model_copy(update={"own": {name: cells[row_of[row.name]] for name, cells in taken.items()}})
        for row in rank.targets
    ]
    return rank.model_copy(update={"targets": rows})
