"""Functions whose keywords are the fields of a question, by star names and plain numbers: what Python offers.

Commands ask `cpic_planner.api.one_star` and `cpic_planner.api.runs`, which know nothing of keywords, and load faster.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import tempfile
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin

from pydantic.fields import FieldInfo

from catalogs import tables_read
from cpic_core import InputError, numeric_context
from cpic_planner import queries
from cpic_planner.api.functions import model_of, stars_named
from cpic_planner.api.one_star import answers_of
from cpic_planner.api.runs import compared, curve_job_of, prepared, roc_job_of, strategies_of, visibility_of
from cpic_planner.jobs import run
from cpic_planner.queries import EtcQuestion, OptimiseQuestion
from cpic_planner.targets import Targets, find_target
from simulator.config import FrozenModel, limits_of, nearest, unit_of

if TYPE_CHECKING:
    import pandas as pd

    from cpic_planner import results
    from cpic_planner.results import EtcAnswer

R = TypeVar("R")


Q = TypeVar("Q", bound=queries.Question)


def takes(
    model: type[Q],
    *,
    first: Sequence[str] = (),
    needs: Sequence[str] = (),
    without: Sequence[str] = (),
    defaults: Mapping[str, Any] | None = None,
    of_strategy: Sequence[str] = (),
) -> Callable[[Callable[[Q], R]], Callable[..., R]]:
    """Give a function of a question the fields of the question as its keywords, and document them.

    Parameters
    ----------
    model : type of Question
    first : sequence of str
        Fields that may also be given by position, in this order.
    needs : sequence of str
        Fields that have to be given although the question has a default.
    without : sequence of str
        Fields that the function does not take.
    defaults : mapping, optional
        Values of fields that the function does not take, or other defaults of those that it takes.
    of_strategy : sequence of str
        Fields of the question's strategy that are keywords as well.
    """
    fixed = dict(defaults or {})
    names = [*first, *(name for name in model.model_fields if name not in (*first, *without))]

    def made(function: Callable[[Q], R]) -> Callable[..., R]:
        parameters = [_parameter(model, name, name in first, name in needs, fixed) for name in names]
        parameters += [_parameter(queries.Strategy, name, False, False, {}) for name in of_strategy]
        parameters.sort(key=lambda item: (item.kind, item.kind is item.POSITIONAL_OR_KEYWORD and item.default is None))
        signature = inspect.Signature(parameters, return_annotation=function.__annotations__.get("return"))

        @functools.wraps(function)
        @numeric_context()
        def wrapped(*args: Any, **keywords: Any) -> R:
            named = _by_field(model, function.__name__, signature, keywords)
            given = dict(signature.bind(*args, **named).arguments)
            own = {name: given.pop(name) for name in of_strategy if given.get(name) is not None}
            if own:
                base = given.get("strategy") or {}
                tree = base.model_dump(exclude_unset=True) if isinstance(base, queries.Strategy) else base
                if not isinstance(tree, Mapping):
                    raise InputError("strategy", base, allowed="a Strategy or a mapping")
                for name in own.keys() & tree.keys():
                    raise InputError(name, "given twice", allowed="once: as a keyword or in strategy")
                given["strategy"] = dict(tree) | own
            question = model.of(fixed | given)
            with tables_read(strict=getattr(question, "strict", False)):
                return function(question)

        wrapped.__signature__ = signature  # type: ignore[attr-defined]
        wrapped.__doc__ = _documented(function.__doc__ or "", model, parameters)
        return wrapped

    return made


_SHOWN = ("limit", "format", "form", "brief", "json", "as_json", "plot", "out", "explain", "dry_run", "strict")
"""Options that decide what a command shows, not what it answers."""


def _by_field(
    model: type[queries.Question], function: str, signature: inspect.Signature, keywords: Mapping[str, Any]
) -> dict[str, Any]:
    """Return keywords with the names of options (``band``, ``planet_radius_rjup``) by the fields that these set.

    Raises
    ------
    TypeError
        For a keyword that the function does not have, naming the nearest ones.
    """
    named = model.by_field(keywords)
    others = {name: named.pop(name) for name in tuple(named) if name not in signature.parameters}
    if not others:
        return named
    options = {option.flag.removeprefix("--").replace("-", "_"): option for option in queries.options_of(model)}
    options = {word: option for word, option in options.items() if option.path[0] in signature.parameters}
    for name in others:
        if name not in options:
            shown = "it decides what the command line shows; the result has everything" if name in _SHOWN else ""
            hint = (
                shown or nearest(name, (*signature.parameters, *options)) or f"known: {', '.join(signature.parameters)}"
            )
            raise TypeError(f"{function}() has no keyword {name!r} ({hint})")
        field = options[name].path[0]
        if field in named and not (len(options[name].path) > 1 and isinstance(named[field], Mapping)):
            raise InputError(name, f"given with {field}", allowed="one of the two")
    values = {option.name: others.get(word) for word, option in options.items()}
    return queries.tree_of(tuple(options.values()), values, named, queries.option_names(model))


def _parameter(
    model: type[FrozenModel], name: str, first: bool, needed: bool, fixed: Mapping[str, Any]
) -> inspect.Parameter:
    info = model.model_fields[name]
    default: Any = inspect.Parameter.empty
    if name in fixed:
        default = fixed[name]
    elif not needed and not info.is_required():
        own = queries.asked_of(info)
        plain = isinstance(info.default, str | int | float) and not (own is not None and own.unset)
        default = info.default if plain else None
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD if first else inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=_words(info))


def _words(info: FieldInfo) -> str:
    """Return the type of a keyword in words, as numpydoc has it."""
    own = queries.asked_of(info)
    kind, several = queries.kind_of(info)
    if own is not None and own.accepts:
        word = own.accepts
    elif get_origin(kind) is Literal:
        word = f"{{{', '.join(repr(item) for item in get_args(kind))}}}"
    else:
        word = f"sequence of {kind.__name__}" if several else kind.__name__
    return word if info.is_required() else f"{word}, optional"


def _documented(text: str, model: type[queries.Question], parameters: Sequence[inspect.Parameter]) -> str:
    """Return the docstring with a section on the keywords behind its first paragraphs."""
    lines = ["Parameters", "----------"]
    for parameter in parameters:
        info = (model if parameter.name in model.model_fields else queries.Strategy).model_fields[parameter.name]
        own = queries.asked_of(info)
        said = [queries.spelled(info.description or "")]
        limits, unit = limits_of(info), (own.unit if own else "") or unit_of(parameter.name)
        if limits or unit:
            said.append(f"{limits} {unit}".strip() + ("" if limits else ", as its unit"))
        if own is not None and own.unset:
            said.append(f"default: {queries.spelled(own.unset)}")
        lines.append(f"{parameter.name} : {parameter.annotation}")
        text_of = f"{said[0].rstrip('.')} ({'; '.join(said[1:])})." if said[1:] else said[0]
        lines += textwrap.wrap(text_of, 110, initial_indent="    ", subsequent_indent="    ")
    body = inspect.cleandoc(text)
    head, sign, rest = body.partition("\n\nReturns\n")
    return "\n".join([head, "", *lines]) + sign + rest + "\n"


_VISITS = ("visits", "reference_visits")


def _timed(question: EtcQuestion) -> EtcQuestion:
    """Return the question; it is refused where it gives no time."""
    if question.time_s is None and None in (question.strategy.visits, question.visit_time_s):
        raise InputError("time_s", "missing", allowed="a wall time, or visits and visit_time_s")
    return question


@takes(
    EtcQuestion,
    first=("target",),
    needs=("target",),
    without=("snr", "sigma", "detect", "contrast_limit", "n_frames"),
    of_strategy=_VISITS,
)
def signal_to_noise(question: EtcQuestion) -> list[EtcAnswer]:
    """Return the SNR of a planet in a given wall time, which ``visits`` of ``visit_time_s`` give as well.

    Without a number of visits the best one is chosen. How firm the answers have to be is said by ``fidelity``:
    ``quick`` closed forms alone (the default), ``standard`` each checked in sums of simulated frames, ``reference``
    frame by frame; or by ``tolerance``, the largest error of planet flux and SNR, for which images are made only where
    the stated error of the closed forms is larger. ``answer.fidelity`` then holds errors and checks; values stay those
    of the closed forms.

    Returns
    -------
    list of EtcAnswer
        Targets in the given order, bands in theirs within each (by wavelength if none are given), then planets.

    Raises
    ------
    InputError
        For an unknown star, band or a value out of range.

    Examples
    --------
    >>> from cpic_planner import signal_to_noise
    >>> answer = signal_to_noise("tau Cet", time_s=36000, separation_arcsec=0.5, bands=["F520"])[0]
    >>> answer.status.value
    'ok'
    """
    return answers_of(_timed(question))


@takes(
    EtcQuestion,
    first=("target",),
    needs=("target",),
    without=("time_s", "contrast_limit", "n_frames", "exact"),
    of_strategy=_VISITS,
)
def exposure_time(question: EtcQuestion) -> list[EtcAnswer]:
    """Return the least wall time of a programme that reaches a level: an SNR, a plain significance, or a detection.

    Returns
    -------
    list of EtcAnswer
        As `signal_to_noise`.

    Raises
    ------
    InputError
        As `signal_to_noise`; and where no level is given.
    """
    if not question.asks_time:
        raise InputError("snr", "missing", allowed="one of snr, sigma, detect")
    return answers_of(question)


@takes(
    EtcQuestion,
    first=("target",),
    needs=("target",),
    without=("detect", "contrast", "contrast_limit", "planet", "n_frames"),
    defaults={"contrast_limit": True},
    of_strategy=_VISITS,
)
def contrast_limit(question: EtcQuestion) -> list[EtcAnswer]:
    """Return the faintest contrast detected in a given wall time, or of a plain significance or a photometric SNR.

    Returns
    -------
    list of EtcAnswer
        As `signal_to_noise`.

    Raises
    ------
    InputError
        As `signal_to_noise`.
    """
    return answers_of(_timed(question))


@takes(OptimiseQuestion, first=("target",), of_strategy=_VISITS)
def optimise(question: OptimiseQuestion) -> pd.DataFrame:
    """Return the best band, separation, exposure, number of frames and EM gain per target.

    Returns
    -------
    pandas.DataFrame
        One row per target; columns of `cpic_planner.ranking.optimiser.OptimalSetting`, units in their names, and
        ``verdict`` of the planet (``detected``, ``measured_not_detected``, ``unreachable``); with
        ``time_s`` also ``limited_by`` (`cpic_planner.etc.budget`), and with ``n_modes`` the flag ``modes_not_counted``
        in ``flags``.

    Raises
    ------
    InputError
        For an unknown star or band, a value out of range, or more than one goal.
    """
    import pandas as pd

    from cpic_core import Status
    from cpic_planner.etc import MODES_NOT_COUNTED, programme_days, verdict_of
    from cpic_planner.ranking import detection_statuses, limits_of, optimise as best_of, timed_model

    model, time_s = model_of(question), None
    if question.snr is None and not question.detect:
        model, time_s = timed_model(model, question)
    stars = Targets.joined(stars_named(question))
    names = ("snr", "detect", "separation_arcsec", "planet")
    goal: dict[str, Any] = {name: getattr(question, name) for name in names}
    best = best_of(model, stars, time_s=time_s, **goal)
    standings = detection_statuses(best, model)
    statuses = [Status.OK if n >= 1 else status for (status, _), n in zip(standings, best.n_frames, strict=True)]
    verdicts = [verdict_of(*pair) for pair in zip(statuses, best.detected.tolist(), strict=True)]
    said: dict[str, Any] = {"verdict": verdicts}
    if time_s is not None:
        said["limited_by"] = limits_of(standings, best)
    if model.strategy.n_modes:
        said["flags"] = MODES_NOT_COUNTED
    shown = [item.name for item in fields(best) if not item.name.startswith(("without_", "moves"))]
    columns = {name: getattr(best, name) for name in shown}
    columns["span_days"] = programme_days(model, best.visits, best.time_s)
    return pd.DataFrame({"name": stars.name} | columns | said)


_QUIET = {"out": None, "images": 0, "workers": 1}


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
    own = functools.partial(simulate, truth=question.truth, notes=notes, cubes=question.cubes)
    return own(simulation, question.out, **question.how).result


@takes(queries.ReduceQuestion, first=("what", "out"))
def reduce_products(question: queries.ReduceQuestion) -> results.ReductionResult:
    """Reduce Level-0 frames to Level 1, as ``cpic reduce`` does.

    Returns
    -------
    ReductionResult
        ``sequences[i].file`` is the Level-1 file below ``out``; `read_level1` reads its frames.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.reduction import reduction_job

    return run(reduction_job(question), question.out, **question.how).result


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
