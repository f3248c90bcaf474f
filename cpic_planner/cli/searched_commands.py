"""The commands ``cpic curve`` and ``cpic roc``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from cpic_planner import report
from cpic_planner.cli import options
from cpic_planner.cli.progress import is_verbose

if TYPE_CHECKING:
    from cpic_planner.jobs import Job
    from cpic_planner.queries import CurveQuestion, RocQuestion, SearchedQuestion
    from cpic_planner.results import SearchedResult

R = TypeVar("R", bound="SearchedResult")


def curve(
    question: CurveQuestion,
    output: options.Answer,
    plot: options.PlotOption = None,
    dry_run: options.DryRunOption = False,
) -> None:
    """Draw contrast curves of a star: how faint a planet one programme shows, against separation, in every band.

    Each band has one programme of visits, the one that sees faintest, and all numbers of the band are about its
    frames. Three limits stand beside each other: the contrast of which half of the planets are found by a search that
    does not know their place (blind), by a look at their known place, and the one whose significance is the threshold
    of small samples at a place that is tested alone. The last is what other instruments' curves state, mostly at 5
    sigma; --threshold-sigma sets the level of all three.

    --images N simulates N such programmes without planets in every band, reduces them, and measures the limit at the
    threshold in each: scatter of sums in the annulus, over what mask, aperture and subtraction leave of a planet.
    --injections M puts planets of several separations and contrasts into M of the images, one at a time and at drawn
    azimuths, and searches for them blind: the fraction recovered stands beside the one that the law of detection
    expects.

    --plot draws the curves, and for each band the map of completeness: the probability that the programme finds a
    planet of a separation and contrast, at any position angle. --out writes report.html, curve.json, curve.csv,
    completeness.csv, recovered.csv and run.json; stopped half way, it continues when started again on the same folder.
    The result is the same for any number of workers.

    Examples:

      cpic curve "tau Cet"

      cpic curve "eps Eri" --band F662 --time 20h --plot curve.png

      cpic curve "tau Cet" --band F520 --separation-arcsec 0.4 --separation-arcsec 0.6

      cpic curve "tau Cet" --band F662 --images 20 --out curve

      cpic curve "tau Cet" --band F662 --images 40 --injections 40 --workers 4 --out curve

      cpic curve "alpha Cen B" --library archive --n-modes 12 --json

      cpic curve "eps Ind" --set drift=0.1nm --format csv
    """
    from cpic_planner.api import curve_job_of

    done = _run(question, curve_job_of(question), "contrast curve", plot, dry_run, output)
    if done is None:
        return
    if plot is not None:
        options.write_plot(plot, report.curve_figure(done))
    found = any(row.contrast_limit_blind is not None for row in done.points)
    output.show(done, partial(report.print_curve, done, full=is_verbose()), found)
    _tell_report(question, output)


def roc(
    question: RocQuestion,
    output: options.Answer,
    plot: options.PlotOption = None,
    dry_run: options.DryRunOption = False,
) -> None:
    """Show how likely a planet is detected, against the false alarms of a search.

    The level of a detection moves. A blind search of the dark hole expects as many false alarms as it has resolution
    elements times the tail of a normal law beyond the level; a look at a known place expects the tail alone. Beside
    both stands the probability that the planet is found, by the law that simulated images follow.

    The planet is a model (--planet-radius-rjup, --albedo ...) or has a --contrast; without --separation-arcsec it
    stands where it is clearest. Each band has the programme that shows it best.

    --images N simulates N such programmes in every band, counts the false alarms of blind searches of them, puts the
    planet into each, and counts how often it is found.

    Examples:

      cpic roc "tau Cet"

      cpic roc "tau Cet" --band F662 --contrast 3e-9 --separation-arcsec 0.6 --plot roc.png

      cpic roc "eps Eri" --band F520 --planet-radius-rjup 0.8 --time 40h

      cpic roc "tau Cet" --band F662 --contrast 3e-9 --separation-arcsec 0.6 --images 100 --workers 4 --out roc

      cpic roc "tau Cet" --band F662 --format csv
    """
    from cpic_planner.api import roc_job_of

    done = _run(question, roc_job_of(question), "detection statistics", plot, dry_run, output)
    if done is None:
        return
    if plot is not None:
        options.write_plot(plot, report.roc_figure(done))
    output.show(done, partial(report.print_roc, done, full=is_verbose()), bool(done.levels))
    _tell_report(question, output)


def _run(
    question: SearchedQuestion, job: Job[R], title: str, plot: Path | None, dry_run: bool, output: options.Answer
) -> R | None:
    """Return the result of a job; None where only its cost was asked for, which is printed."""
    from cpic_planner.jobs import estimate, run

    options.check_plot(plot)
    if dry_run or question.images:
        cost = estimate(job, workers=question.workers)
        if dry_run:
            line = (
                f"{cost['n_realisations']:.0f} images, {cost['n_searches']:.0f} searches, about "
                f"{options.time_text(cost, question.workers)}, {cost['memory_mb']:.0f} MB memory a worker"
            )
            options.print_line_or_json(line, cost, output.as_json)
            return None
        start = partial(run, job, question.out, **question.how)
        return options.with_progress(title, int(cost["n_realisations"]), start, "set of images").result
    return run(job, question.out, **question.how).result


def _tell_report(question: SearchedQuestion, output: options.Answer) -> None:
    if output.plain and question.out is not None:
        options.say(f"report: {question.out / 'report.html'}")
