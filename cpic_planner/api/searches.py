"""Contrast curves and operating characteristics of a star, by its name and plain numbers."""

from typing import Any

from cpic_planner import queries, results
from cpic_planner.api.keywords import model_of, takes
from cpic_planner.confirm import AskedStar, curve_job, roc_job
from cpic_planner.jobs import Job, run
from cpic_planner.targets import as_catalogue, find_target


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
