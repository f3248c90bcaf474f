"""Rankings by plain numbers: the order of the stars, how it depends on assumptions, and why a star stands where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from catalogs.catalogue import Catalogue
from cpic_planner.api.inputs import model_of
from cpic_planner.api.keywords import takes
from cpic_planner.etc.model import EtcModel
from cpic_planner.known_completeness import KNOWN_ONLY, KnownChoice, counted_planets
from cpic_planner.models import Explanation, RankResult, SensitivityResult
from cpic_planner.queries.fields import asked
from cpic_planner.queries.rank import RankQuestion
from cpic_planner.targets import Targets, as_catalogue, find_target, rank_sample, sample_text


@dataclass(frozen=True)
class Prepared:
    """The model, the stars and the order that a ranking is made of, with remarks for the person who asked."""

    model: EtcModel
    targets: Targets
    catalogue: Catalogue
    sample: str
    asked: dict[str, Any]
    notes: tuple[str, ...]


def prepared(question: RankQuestion) -> Prepared:
    """Return the stars of a ranking and how they are ranked.

    Raises
    ------
    InputError
        For tables that cannot be read, unknown bands, or no star that is left.
    """
    table = as_catalogue(question.catalog)
    targets = rank_sample(
        catalog=table,
        v_mag_max=question.v_mag_max,
        dwarfs_only=question.dwarfs_only,
        singles_only=question.singles_only,
        companions=question.companions,
    )
    sample = sample_text(table, question.v_mag_max, question.dwarfs_only, question.singles_only)
    counted, notes = counted_planets(question), table.notes
    if isinstance(counted, KnownChoice):
        targets, sample = counted.stars(targets), f"{sample}; {KNOWN_ONLY}"
        notes = (*notes, *counted.table.notes)
    asked_for = {
        "time_s": question.time_s,
        "planet": question.planet,
        "population": counted,
        "score": question.score,
    }
    return Prepared(model_of(question), targets, table, sample, asked_for, tuple(notes))


@takes(RankQuestion)
def rank_targets(question: RankQuestion) -> RankResult:
    """Rank the catalogue by closed forms; see `cpic_planner.ranking.rank_targets` and `cpic_planner.load_targets`.

    Returns
    -------
    RankResult
        One row per star, best first.

    Raises
    ------
    InputError
        For bad input, naming key, value, unit and range.
    """
    from cpic_planner.ranking import rank_targets as rank

    ready = prepared(question)
    return rank(ready.model, ready.targets, sample=ready.sample, catalogue=ready.catalogue.provenance, **ready.asked)


@takes(RankQuestion)
def rank_sensitivity(question: RankQuestion) -> SensitivityResult:
    """Say how the ranking changes under other assumptions; see `cpic_planner.sensitivity`.

    Returns
    -------
    SensitivityResult
    """
    from cpic_planner.sensitivity import sensitivity

    ready = prepared(question)
    return sensitivity(ready.model, ready.targets, **ready.asked)


class ExplainQuestion(RankQuestion):
    """Why one star stands where it stands."""

    target: str = asked(..., "Star name.", argument=True)


@takes(ExplainQuestion, first=("target",))
def explain_rank(question: ExplainQuestion) -> Explanation:
    """Say why one star stands where it stands in the ranking.

    Returns
    -------
    Explanation

    Raises
    ------
    InputError
        For an unknown star, or one that the cuts leave out.
    """
    from cpic_planner.explain import explain_star

    ready = prepared(question)
    name = str(find_target(question.target, catalog=ready.catalogue)[0].name[0])
    return explain_star(ready.model, ready.targets, name, **ready.asked)
