"""Rankings, visibility, what-ifs and searches as questions ask for them: stars, models and jobs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from catalogs import Catalogue
from cpic_core import InputError, Record
from cpic_planner import confirm, queries, results
from cpic_planner.api.functions import model_of
from cpic_planner.etc import EtcModel
from cpic_planner.ranking import AskedStars, asked_stars, timed_model
from cpic_planner.targets import Targets, as_catalogue, find_target
from simulator.config import checked_utc

if TYPE_CHECKING:
    from cpic_planner.jobs import Job
    from cpic_planner.survey import StrategiesConfig


N = TypeVar("N", bound=results.OfTables)


class Prepared(Record):
    """The model, the stars and the order that a ranking is made of."""

    model: EtcModel
    stars: AskedStars
    catalogue: Catalogue
    instruments: queries.EnsembleChoice | None
    asked: dict[str, Any]

    def ranked(self, columns: Sequence[str] = ()) -> results.RankResult:
        """Return the ranking.

        Parameters
        ----------
        columns : sequence of str
            Columns of a user's table that its rows carry beside the first ones; see `cpic_planner.ranking.with_own`.
        """
        from cpic_planner.ranking import rank_under, with_own

        stars = self.stars
        named = {"sample": stars.text, "catalogue": self.catalogue.provenance}
        made = rank_under(self.model, stars.targets, self.instruments, chosen=stars.chosen, **named, **self.asked)
        return self.noted(with_own(made, self.catalogue.table, columns))

    def noted(self, result: N) -> N:
        """Return a result with the remarks on the tables."""
        return result.model_copy(update={"notes": list(self.stars.notes)})

    def of_all(self, whole: results.RankResult) -> results.RankResult:
        """Return the same ranking from that of all stars, those that no filter chooses too."""
        from cpic_planner.ranking import selected

        stars = self.stars
        assert stars.chosen is not None, "a question without filters asks for all stars"
        assert self.instruments is None, "ranks under an ensemble are those among the chosen stars"
        return selected(whole, stars.targets, stars.chosen, stars.text)


def prepared(question: queries.RankQuestion) -> Prepared:
    """Return the stars of a ranking and how they are ranked.

    Raises
    ------
    InputError
        For tables that cannot be read, unknown bands, or no star that is left.
    """
    table = as_catalogue(question.catalog)
    stars = asked_stars(question, table)
    model, time_s = timed_model(model_of(question), question)
    asked_for = {"time_s": time_s, "planet": question.planet, "population": stars.counted, "score": question.score}
    return Prepared(model, stars, table, question.drawn_instruments, asked_for)


def compared(question: queries.RankQuestion, other: Any, *, key: str = "other") -> results.RankComparison:
    """Return what moves from another ranking, or from the same one with another instrument, to that of a question.

    Parameters
    ----------
    question : RankQuestion
    other : RankResult, Instrument, mapping, str or Path
        A name that ends in .json, .csv or .ecsv is the file of an earlier ranking, any other one an instrument.
    key : str
        What it is asked for as, for messages.

    Raises
    ------
    InputError
        For what is neither, or has no star in common.
    """
    from cpic_planner.ranking.sensitivity import ENDINGS, Ranking, compare_rankings, load_ranking

    if isinstance(other, results.RankResult):
        before = Ranking.of(other)
    elif isinstance(other, str | Path) and str(other).lower().endswith(ENDINGS):
        before = load_ranking(other, key=key)
    else:
        try:
            instrument = queries.read_instrument(other)
        except InputError as error:
            if error.key not in ("instrument", "file"):
                raise
            allowed = f"{error.allowed}; or an earlier ranking, whose name ends in {', '.join(ENDINGS)}"
            raise InputError(key, other, allowed=allowed, hint=error.hint) from None
        same = question.model_copy(update={"instrument": instrument})
        before = Ranking.of(prepared(same).ranked(), instrument=instrument)
    ready = prepared(question)
    after = Ranking.of(ready.ranked(), instrument=question.instrument)
    return ready.noted(compare_rankings(before, after))


def visibility_of(
    question: queries.VisibilityQuestion, tell: Callable[[str], None] = lambda text: None
) -> results.VisibilityResult:
    """Return when stars can be seen, each star once.

    Parameters
    ----------
    question : VisibilityQuestion
    tell : callable
        Gets remarks on what was read.

    Raises
    ------
    InputError
        For an unknown star, one without coordinates, or a time out of range.
    """
    from cpic_planner.survey.visibility import load_visibility, visibility_result

    config, mission = load_visibility(question.limits), question.instrument.mission
    start_utc = checked_utc("start_utc", question.start_utc or queries.observed_utc(question))
    table = as_catalogue(question.catalog)
    stars: dict[str, Targets] = {}
    remarks: list[str] = []
    for name in question.target:
        star, remark = find_target(name, catalog=table, date_utc=question.date_utc or start_utc)
        stars.setdefault(str(star.name[0]), star)
        remarks += [remark] if remark else []
    for remark in remarks:
        tell(remark)
    found = visibility_result(
        Targets.joined(list(stars.values())),
        config,
        mission.orbit,
        start_utc=start_utc,
        n_days=question.n_days,
        step_days=question.step_days,
        catalogue=table.provenance,
    )
    return found.model_copy(update={"notes": list(table.notes)})


def strategies_of(question: queries.WhatIfQuestion) -> StrategiesConfig:
    """Return the strategies that a question compares: those of its file that it names, with what it changes of them.

    Raises
    ------
    InputError
        For bad input, naming key, value and range.
    """
    from cpic_planner import survey

    config, names = survey.load_strategies(question.strategies), question.strategy
    known = [item.name for item in config.strategies]
    for name in names:
        if name not in known:
            raise InputError("strategy", name, allowed=", ".join(known))
    if names:
        chosen = tuple(item for item in config.strategies if item.name in names)
        config = config.model_copy(update={"strategies": chosen})
    config = survey.with_universe(config, question.universe(), question.share_of_time)
    config = survey.varied(config, question.vary, facts=bool(question.facts)) if question.vary else config
    config = survey.with_exact_calendars(config) if question.exact else config
    return survey.with_doubt(config, question.doubt)


def _asked(question: queries.SearchedQuestion) -> confirm.AskedStar:
    """Return the star that a question names."""
    table = as_catalogue(question.catalog)
    about: dict[str, Any] = {"companions": question.companions, "date_utc": queries.observed_utc(question)}
    star, remark = find_target(question.target, catalog=table, **about)
    return confirm.AskedStar(star, table.provenance, remark, table.notes)


def curve_job_of(question: queries.CurveQuestion) -> Job[results.CurveResult]:
    """Return the job of a contrast curve.

    Raises
    ------
    InputError
        For an unknown star or band.
    """
    return confirm.curve_job(question, model_of(question), _asked(question))


def roc_job_of(question: queries.RocQuestion) -> Job[results.RocResult]:
    """Return the job of an operating characteristic.

    Raises
    ------
    InputError
        For an unknown star or band.
    """
    return confirm.roc_job(question, model_of(question), _asked(question))
