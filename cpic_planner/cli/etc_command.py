"""The command ``cpic etc``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_planner.cli.options import Answer, PlotOption, check_plot, note, refuse_together, write_plot
from cpic_planner.cli.progress import progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cpic_planner.etc import EtcModel
    from cpic_planner.queries import EtcQuestion
    from cpic_planner.results import EtcAnswer
    from cpic_planner.targets import Targets


def etc(
    question: EtcQuestion,
    output: Answer,
    budget: Annotated[
        bool, typer.Option("--budget", help="Print the noise budget of every answer [default: of the best].")
    ] = False,
    explain: Annotated[
        bool,
        typer.Option(
            "--explain",
            help="Say more: probabilities, visits and orbits, and the EM gain that each saturation limit allows.",
        ),
    ] = False,
    plot: PlotOption = None,
) -> None:
    """Ask the exposure-time calculator about one star: time for a level, SNR for a time, or the contrast limit.

    --snr, --sigma or --detect ask for the least wall time that reaches it; with --contrast-limit they are the level
    of the limit (--detect if none is given). Without any of these the answer is the SNR in --time-s. Without a
    separation the planet stands where the answer is best in each band: least time, clearest detection, or faintest
    limit. A given time is an upper bound: the walk of the wavefront can make shorter visits better.

    An observation is a programme of visits that are reduced together. Each has a wavefront of its own, so that many
    visits reach below the speckle floor of one, down to what science and references differ by in every visit. The
    best number of visits is chosen, the overhead of each counted, unless --visits or --visit-time-s say it; both
    together set the time.

    Status ok says that there is a number, not that the planet is detected: the verdict says that. Detected: at
    least half of such programmes show the planet to a search that knows no place (verdict_mode blind), or at a known
    place with --search known_place; both probabilities are stated. An answer that is not a detection says what
    limits it (limited_by), the single change that would make it one in the same time: speckles (no drift of the
    wavefront), common_speckles (the same, where no number of visits helps), background (no light and noise but the
    planet's own and the speckles), else photons: the planet is too faint. It also says which number of visits, time,
    drift or contrast alone would do.

    The name of a known planet ("eps Eri b") asks about it: the answer is for the medians of its separation and
    contrast at --date, and range says what the errors of orbit and size leave open: median and 16 to 84 % of their
    draws. It is looked for at its place unless --search says otherwise.

    Under the table stands what its headings mean, and in two sentences what is detected and what is missing;
    --explain says the rest.

    The answers are closed forms, in milliseconds (--fidelity quick). --fidelity standard observes each of them in
    images, drawn as sums of frames until their SNR is known to 5 %, and states measured over true flux and predicted
    over recovered SNR; reference draws every frame with every effect of the camera, in minutes. --tolerance 0.05
    makes images only where the stated error of the closed forms is larger than that, and says so where none of the
    two is that good. Answers stay those of the closed forms: what images say stands beside them.

    Examples:

      cpic etc "tau Cet" --detect --separation-arcsec 0.45

      cpic etc "tau Cet"

      cpic etc "tau Cet" --snr 8

      cpic etc "tau Cet" --detect --budget

      cpic etc "eps Ind" --visits 16 --visit-time-s 2700

      cpic etc "eps Ind" --detect --library archive --search known_place

      cpic etc "alpha Cen B" --time-s 7200 --separation-arcsec 0.65 --band F520 --band F662 --explain

      cpic etc "eps Eri b" --date 2030-01-01 --time 10h

      cpic etc "tau Cet" --detect --separation-au 1.9 --set drift=0.1nm --brief

      cpic etc "tau Cet" --detect --format latex

      cpic etc "HD 10700" --semi-major-axis-au 1.5 --contrast-limit

      cpic etc "eps Eri" --contrast-limit --sigma 5 --separation-arcsec 0.4 --separation-arcsec 0.6 --plot limit.png

      cpic etc "alpha Cen B" --distance-pc 1.35 --separation-arcsec 0.65 --log10-mh 1 --log10-fsed 1 --insolation-au 2

      cpic etc "eps Eri" --contrast 5e-9 --separation-arcsec 0.6 --snr 5 --json

      cpic etc "eps Eri" --library reference_star --reference-v-mag 2.5 --exozodi 3 --mode photon_counting

      cpic etc "my star" --catalog my_stars.csv --snr 10

      cpic etc "tau Cet" --band F520 --time-s 7200 --fidelity standard

      cpic etc "eps Eri" --band F662 --detect --tolerance 0.05
    """
    from cpic_planner.api import answered

    for name, value, held in (
        ("--budget", budget, "JSON holds every budget"),
        ("--explain", explain, "JSON holds all"),
    ):
        refuse_together({name: value, "--json": output.as_json}, held)
        refuse_together({name: value, "--brief": output.brief, "--format": output.form != "table"}, "it has one table")
    check_plot(plot)
    answer = answered(question, check=_checked, tell=note)
    if plot is not None:
        write_plot(plot, answer.figure())
    output.show(answer.result, partial(answer.print, every_budget=budget, explain=explain), answer.found)


def _checked(
    question: EtcQuestion, model: EtcModel, stars: Sequence[Targets], answers: Sequence[EtcAnswer]
) -> Sequence[EtcAnswer]:
    """Return the answers, checked in images, with a bar of progress."""
    from cpic_planner.api import checked
    from cpic_planner.confirm import needs_images

    total = 100 * sum(needs_images(answer, question.dial) for answer in answers)
    with progress("images, per cent", total=total, enabled=total > 0) as advance:
        return checked(question, model, stars, answers, advance=advance)
