"""Rankings by plain numbers: the order of the stars, how it depends on assumptions, and why a star stands where.

Plans, confirmations and simulated products, by star names and plain numbers.

Visibility, survey what-ifs, contrast curves and operating characteristics, by star names and plain numbers.
"""

import contextlib
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from catalogs import Catalogue
from cpic_core import InputError, Record
from cpic_planner import queries, results
from cpic_planner.api.functions import model_of, stars_named, takes
from cpic_planner.confirm import AskedStar, curve_job, roc_job
from cpic_planner.etc import EtcModel
from cpic_planner.jobs import Job, run
from cpic_planner.ranking import AskedStars, asked_stars, timed_model
from cpic_planner.targets import Targets, as_catalogue, find_target
from simulator.config import checked_utc

if TYPE_CHECKING:
    from cpic_planner.survey import StrategiesConfig

_QUIET = {"out": None, "images": 0, "workers": 1}


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


@takes(queries.RankQuestion)
def rank_targets(question: queries.RankQuestion) -> results.RankResult:
    """Rank the catalogue by closed forms; see `cpic_planner.ranking.rank_targets` and `cpic_planner.load_targets`.

    Returns
    -------
    RankResult
        One row per star that passes the filters, best first; ``rank_in_catalogue`` is its rank among all.

    Raises
    ------
    InputError
        For bad input, naming key, value, unit and range.
    """
    return prepared(question).ranked()


@takes(queries.RankQuestion)
def rank_sensitivity(question: queries.RankQuestion) -> results.SensitivityResult:
    """Say how the ranking changes under other assumptions; see `cpic_planner.ranking.sensitivity`.

    Returns
    -------
    SensitivityResult
    """
    from cpic_planner.ranking.sensitivity import sensitivity

    ready = prepared(question)
    return ready.noted(sensitivity(ready.model, ready.stars.answered, **ready.asked))


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


class CompareQuestion(queries.RankQuestion):
    """Compare another ranking with this one, star by star."""

    other: Any = queries.asked(
        ...,
        "An earlier ranking (a RankResult, or a file that cpic rank --out or --json wrote), or another instrument with "
        "which the same question is asked. It stands before, the ranking of the question after.",
        argument=True,
        accepts="RankResult, Instrument, mapping, str or Path",
    )


@takes(CompareQuestion, first=("other",))
def compare_ranks(question: CompareQuestion) -> results.RankComparison:
    """Say what moves from another ranking, or another instrument, to this ranking, and why.

    Returns
    -------
    RankComparison

    Raises
    ------
    InputError
        For bad input, naming key, value, unit and range.
    """
    return compared(question, question.other)


class ExplainQuestion(queries.RankQuestion):
    """The question why one star stands where it stands."""

    target: str = queries.asked(..., "Star name.", argument=True)
    other_assumptions: bool = queries.asked(
        False, "Rank the stars under other assumptions too, which takes as long as the ranking.", physics=False
    )


@takes(ExplainQuestion, first=("target",), without=queries.FILTERS)
def explain_rank(question: ExplainQuestion) -> results.Explanation:
    """Say why one star stands where it stands in the ranking.

    Returns
    -------
    Explanation

    Raises
    ------
    InputError
        For an unknown star, or one that the cuts leave out.
    """
    from cpic_planner.ranking import explain_star

    ready = prepared(question)
    name = str(find_target(question.target, catalog=ready.catalogue)[0].name[0])
    asked = ready.asked | {"other_assumptions": question.other_assumptions}
    return ready.noted(explain_star(ready.model, ready.stars.targets, name, **asked))


@takes(queries.PlanQuestion, first=("out",), needs=("out",))
def make_plan(question: queries.PlanQuestion) -> results.PlanResult:
    """Run the main job and write its products into ``out``; an interrupted run continues there.

    Returns
    -------
    PlanResult

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.confirm import make_plan as run

    return run(question, question.out, catalog=question.catalog, **question.how).result


@takes(queries.StarImagesQuestion, first=("target",), without=("force", "scheduler"))
def confirm_targets(question: queries.StarImagesQuestion) -> list[results.ConfirmedTarget]:
    """Simulate and measure the named stars, each with its reference planet at the best separation.

    Returns
    -------
    list of ConfirmedTarget
        In the given order.

    Raises
    ------
    InputError
        For an unknown star or band, or a value out of range.
    """
    from cpic_planner.confirm import confirm_stars

    return confirm_stars(question, model_of(question), stars_named(question))


@takes(queries.ConfirmQuestion, first=("scene",))
def confirm_scene(question: queries.ConfirmQuestion) -> results.ConfirmResult:
    """Observe one scene in simulated images and measure it blind, beside what the ETC expects, as ``cpic confirm``.

    Returns
    -------
    ConfirmResult

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.confirm import confirm_scene as run

    return run(question, question.out, **question.how).result


@takes(queries.SimulateQuestion, first=("what", "out"))
def simulate_products(question: queries.SimulateQuestion) -> results.SimulationResult:
    """Make Level-0 products with truth, as ``cpic simulate`` does.

    Returns
    -------
    SimulationResult
        ``sequences[i].file`` is the Level-0 file below ``out``.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.simulation import simulate, simulation_from

    simulation, notes = simulation_from(question.what, **question.given)
    return simulate(simulation, question.out, truth=question.truth, notes=notes, **question.how).result


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


@takes(queries.VisibilityQuestion, first=("target",))
def star_visibility(question: queries.VisibilityQuestion) -> results.VisibilityResult:
    """Say when stars can be seen from the orbit, for how long, and at which roll.

    One orbit in the middle of each step stands for it.

    Returns
    -------
    VisibilityResult

    Raises
    ------
    InputError
        For an unknown star, one without coordinates, or a time out of range.
    """
    return visibility_of(question)


def strategies_of(question: queries.WhatIfQuestion) -> "StrategiesConfig":
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


@takes(queries.WhatIfQuestion, first=("strategies",), without=("strategy",), defaults=_QUIET)
def compare_strategies(question: queries.WhatIfQuestion) -> results.WhatIfResult:
    """Compare survey strategies over the same synthetic universes.

    Without ``out`` nothing is kept. Values of ``vary`` carry a unit or an x, see `cpic_planner.survey.strategy.varied`.

    Returns
    -------
    WhatIfResult

    Raises
    ------
    InputError
        For bad input, naming key, value and range.

    Examples
    --------
    >>> import cpic_planner as cp
    >>> result = cp.compare_strategies(
    ...     {"strategies": [{"name": "once", "targets": {"names": ["eps Eri"]}, "visit": {"bands": ["F520"]}}]},
    ...     universes=20, duration_days=365.0)
    >>> result.strategies[0].schedule.visits
    1
    """
    from cpic_planner.survey import run_whatif

    config = strategies_of(question)
    with contextlib.ExitStack() as stack:
        folder = question.out or stack.enter_context(tempfile.TemporaryDirectory())
        pages = question.out is not None
        return run_whatif(config, folder, n_images=question.images, pages=pages, **question.how).result


def _asked(question: queries.SearchedQuestion) -> AskedStar:
    """Return the star that a question names."""
    table = as_catalogue(question.catalog)
    about: dict[str, Any] = {"companions": question.companions, "date_utc": queries.observed_utc(question)}
    star, remark = find_target(question.target, catalog=table, **about)
    return AskedStar(star, table.provenance, remark, table.notes)


def curve_job_of(question: queries.CurveQuestion) -> Job[results.CurveResult]:
    """Return the job of a contrast curve.

    Raises
    ------
    InputError
        For an unknown star or band.
    """
    return curve_job(question, model_of(question), _asked(question))


def roc_job_of(question: queries.RocQuestion) -> Job[results.RocResult]:
    """Return the job of an operating characteristic.

    Raises
    ------
    InputError
        For an unknown star or band.
    """
    return roc_job(question, model_of(question), _asked(question))


@takes(queries.CurveQuestion, first=("target",))
def contrast_curve(question: queries.CurveQuestion) -> results.CurveResult:
    """Return contrast limits of a star against separation, its completeness, and planets recovered from images.

    Each band has one programme, that which sees faintest, and every number of the band is about its frames. Limits are
    those of `contrast_limit` for them: contrasts of planets of which half are found blind and at a known place, and
    that whose significance reaches the threshold of small samples (Mawet et al. 2014, ApJ 792, 97). With ``images`` the
    last is measured too, in that many simulated programmes without planets, each reduced as `confirm_scene` reduces
    its images; with ``injections`` planets are put into them and searched for blind.

    Returns
    -------
    CurveResult
        ``points`` one a band and separation, ``maps`` of completeness one a band, ``recovered`` one a band, separation
        and contrast of injected planets.

    Raises
    ------
    InputError
        For an unknown star or band, a value out of range, or if ``out`` is in use or holds another configuration.

    Examples
    --------
    >>> from cpic_planner import contrast_curve
    >>> curve = contrast_curve("tau Cet", bands=["F662"], separation_arcsec=[0.5, 0.7])
    >>> [row.separation_arcsec for row in curve.points]
    [0.5, 0.7]
    """
    return run(curve_job_of(question), question.out, **question.how).result


@takes(queries.RocQuestion, first=("target",))
def roc_curve(question: queries.RocQuestion) -> results.RocResult:
    """Return how likely a planet is found against the false alarms of a search: its operating characteristic.

    Levels of a detection move; false alarms of a search are its resolution elements times the tail of a normal law
    beyond the level; the probability of a detection is that of `signal_to_noise` at that level. With ``images`` both
    are counted in that many simulated programmes without and with the planet.

    Returns
    -------
    RocResult
        ``levels`` one a band and level, ascending.

    Raises
    ------
    InputError
        As `contrast_curve`.

    Examples
    --------
    >>> from cpic_planner import roc_curve
    >>> roc = roc_curve("tau Cet", bands=["F662"], contrast=3e-9, separation_arcsec=0.6)
    >>> chances = [row.detection_probability for row in roc.levels]
    >>> chances == sorted(chances, reverse=True)
    True
    """
    return run(roc_job_of(question), question.out, **question.how).result
