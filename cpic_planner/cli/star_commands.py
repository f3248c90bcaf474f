"""The commands about stars: ``cpic etc``, ``curve``, ``roc``, ``rank``, ``known`` and ``visibility``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from cpic_core import InputError, dump_json
from cpic_planner import ranking, report
from cpic_planner.cli import command
from cpic_planner.cli.progress import is_verbose, progress

if TYPE_CHECKING:
    from collections.abc import Mapping

    from catalogs import Catalogue
    from cpic_planner import queries
    from cpic_planner.cli.output import EtcOutput, KnownOutput, RankOutput, SearchOutput, VisibilityOutput
    from cpic_planner.jobs import Job
    from cpic_planner.ranking import KnownChoice
    from cpic_planner.results import RankResult, SearchedResult


def etc(question: queries.EtcQuestion, output: EtcOutput) -> None:
    """Ask the exposure-time calculator about stars: time for a level, SNR for a time, or the contrast limit.

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

    Several names are answered as each alone, in one table. --instruments 20 says what is not known of the instrument
    leaves open: median and 16 to 84 % of the answers with as many instruments, drawn from the assumed numbers.

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

      cpic etc "tau Cet" "eps Ind" "eps Eri" --detect

      cpic etc "tau Cet" --detect --budget

      cpic etc "eps Ind" --visits 16 --visit-time-s 2700

      cpic etc "eps Ind" --detect --library archive --search known_place

      cpic etc "alpha Cen B" --time-s 7200 --separation-arcsec 0.65 --band F520 --band F662 --explain

      cpic etc "eps Eri b" --date 2030-01-01 --time 10h

      cpic etc "tau Cet" --detect --instruments 20

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
    from cpic_planner.api import answered, answered_stars

    if len(question.target) > 1:
        for name, value in (("--plot", output.plot), ("--budget", output.budget), ("--explain", output.explain)):
            if value:
                raise InputError(name, f"given with {len(question.target)} targets", allowed="with one")
        result, found = answered_stars(question, working=progress)
        output.show(result, report.etc_stars_blocks(result, asked=report.question_text(question)), found)
        return
    answer = answered(question, working=progress)
    output.draw(answer.figure)
    output.show(answer.result, answer.blocks(every_budget=output.budget, explain=output.explain), answer.found)


R = TypeVar("R", bound="SearchedResult")


def curve(question: queries.CurveQuestion, output: SearchOutput) -> None:
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

    done = _searched(question, curve_job_of(question), "contrast curve", output)
    if done is None:
        return
    output.draw(partial(report.curve_figure, done))
    found = any(row.contrast_limit_blind is not None for row in done.points)
    output.show(done, report.search_blocks(done, full=is_verbose()), found)
    command.tell_report(output, question.out)


def roc(question: queries.RocQuestion, output: SearchOutput) -> None:
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

    done = _searched(question, roc_job_of(question), "detection statistics", output)
    if done is None:
        return
    output.draw(partial(report.roc_figure, done))
    output.show(done, report.search_blocks(done, full=is_verbose()), bool(done.levels))
    command.tell_report(output, question.out)


def _searched(question: queries.SearchedQuestion, job: Job[R], title: str, output: SearchOutput) -> R | None:
    def line(cost: Mapping[str, float]) -> str:
        return (
            f"{cost['n_realisations']:.0f} images, {cost['n_searches']:.0f} searches, about "
            f"{command.time_text(cost, question.workers)}, {cost['memory_mb']:.0f} MB memory a worker"
        )

    how: dict[str, Any] = {"steps": "n_realisations" if question.images else 0, "piece": "set of images"}
    return command.result_of(question, job, output, title, line, out=question.out, dry_run=output.dry_run, **how)


def rank(question: queries.RankQuestion, output: RankOutput) -> None:
    """Rank the whole catalogue (analytic, a few seconds; --sensitivity and --compare rank more than once).

    The ranking is by completeness per hour: the fraction of a population of planets that one observation of the star
    detects, over its wall time. The fraction leaves out planets that radial velocities would have shown, that a
    companion star would have driven off, or that would stand beside a known giant (--exclusions); a second fraction
    counts all planets. Stars with a score of zero follow in the order of their detection margin.
    The search does not know where a planet stands; a further column says what would be detected at known places, which
    --search known_place counts instead.
    An observation has the number of visits that is best in the given time. Each visit has an overhead and a wavefront
    of its own, and all are reduced together; --visits and --visit-time-s fix them.
    --score chooses another order; the other columns are about a stated reference planet: whether it is detected, how
    likely a search finds it blind and at its place, and what limits it (limited_by: the single change that would make
    it detected in the given time; see cpic etc --help). In --json and --out: the visits, the time, the drift and the
    contrast that would detect it, each changed alone.

    --stars, --sp-type, --distance-max-pc, --dec-min, --dec-max and --known-hosts choose the ranked stars that pass all
    of them. Scores and seeds stay those of the whole ranking; rank_in_catalogue is the rank in it.
    --compare says which stars move from another ranking to this one, by how much their scores change, and why.

    Under the table stands what its headings mean, and what is detected; with -v all that its numbers refer to.

    Examples:

      cpic rank

      cpic rank --score detection_margin --band F662 --time-s 7200 --dwarfs --singles --limit 50

      cpic rank --visits 4 --time-s 36000

      cpic rank --population solar_system --planets 1000 --plot ranking.png

      cpic rank --explain "tau Cet"

      cpic rank --explain "tau Cet" --sensitivity

      cpic rank --sensitivity

      cpic rank --instruments 200

      cpic rank --stars "tau Cet, eps Eri"

      cpic rank --sp-type G,K --distance-max-pc 30 --limit 30

      cpic rank --compare as_published

      cpic rank --exclusions none

      cpic rank --json | python -m json.tool | head -40

      cpic rank --out ranking.csv

      cpic rank --drift-nm 0.1 --compare ranking.csv

      cpic rank --catalog my_stars.csv

      cpic rank --known-planets snapshot --date 2030-06-01

    --catalog takes a table with the columns name, distance_pc or parallax_mas, v_mag, and sp_type or teff_k (or the
    usual other names of these); cpic catalog columns lists all that are read, and cpic catalog columns FILE says what
    those of a file are taken for. Its other columns come back in --json, --out and --format csv or ecsv, as they are
    there and under their own headings (own_ stands before one that a column of the ranking has): the first 40, and
    those that --columns names. Rows that cannot be used are left out with a remark; --rejects lists them, --strict
    refuses the table.

    --known-planets ranks the stars that have known planets by the probability that one observation at --date
    detects at least one of them, the errors of their orbits included; --planets is then the number of draws of each
    planet.
    """
    from cpic_planner.api import compared, prepared
    from cpic_planner.queries import called, called_as
    from cpic_planner.targets import find_target

    explain, sensitivity, compare = output.explain, output.sensitivity, output.compare
    shown = 20 if output.limit is None else output.limit
    answers: dict[str, object] = {"--explain": explain, "--sensitivity": sensitivity, "--compare": compare}
    for name in ("--explain", "--sensitivity"):
        command.refuse_together({name: answers[name], "--compare": compare}, "two answers")
    for name, value in answers.items():
        command.refuse_together({name: value, "--out": output.out}, "it holds no ranking")
        command.refuse_together({name: value, "--plot": output.plot}, "it has no figure")
        known = None if name == "--compare" else question.known_planets
        command.refuse_together({name: value, "--known-planets": known}, "it is about a hypothetical population")
    if explain is not None and question.filters:
        hint = "its rank is that among all stars of the sample"
        raise InputError("--explain", explain, allowed=f"without {called(question.filters[0])}", hint=hint)
    if compare is not None:
        moved = compared(question, compare, key="--compare")
        output.show(moved, report.move_blocks(moved, limit=shown))
        return
    ready = prepared(question)
    if explain is not None:
        with called_as({"star": "--explain"}):
            star, remark = find_target(explain, catalog=ready.catalogue)
        command.note(*filter(None, [remark]))
        name = str(star.name[0])
        if name not in set(ready.stars.targets.name.tolist()):
            hint = "it is in the catalogue, but a cut leaves it out"
            raise InputError("--explain", explain, allowed="a star of the sample that is ranked", hint=hint)
        asked: dict[str, Any] = ready.asked | {"other_assumptions": sensitivity}
        reasons = ready.noted(ranking.explain_star(ready.model, ready.stars.targets, name, **asked))
        output.show(reasons, report.explanation_blocks(reasons))
        return
    if sensitivity:
        from cpic_planner.ranking.sensitivity import sensitivity as sensitivity_of

        firm = ready.noted(sensitivity_of(ready.model, ready.stars.answered, **ready.asked))
        output.show(firm, report.sensitivity_blocks(firm))
        return
    result = ready.ranked(output.names)
    if output.out is not None:
        _write(output.out, result, output)
    drawn = min(shown, len(result.targets))
    few = f" with the first {report.MOST_STARS} stars only: names of {drawn} could not be read"
    draw = report.rank_figure if result.ensemble is None else report.ensemble_figure
    output.draw(partial(draw, result, shown), few * (drawn > report.MOST_STARS))
    output.tell_rows(shown, len(result.targets))
    detected = any(row.verdict == "detected" for row in result.targets)
    output.show(result, report.rank_blocks(result, limit=shown, full=is_verbose()), detected)


def _write(out: Path, result: RankResult, output: RankOutput) -> None:
    """Write the ranking, or its first stars, in the form that the ending of the name asks for."""
    from cpic_planner.cli.output import FORM_OF_ENDING

    form, every = FORM_OF_ENDING[out.suffix], len(result.targets)
    rows = every if output.limit is None or form == "json" else min(output.limit, every)
    own = {"csv": report.ranking_csv, "ecsv": report.ranking_ecsv}.get(form)
    if form == "json":
        text = partial(dump_json, result.model_dump(mode="json"))
    elif own is not None and not output.names:
        text = partial(own, result, rows)
    else:
        text = partial(output.text, form, result, report.rank_blocks(result, limit=rows))
    command.write_out(out, text, rows, every)


def known(question: queries.KnownQuestion, output: KnownOutput) -> None:
    """Say where the known planets are at a date, how bright, and when the dark hole covers them.

    Published orbits are drawn within their errors: with time the place of a planet gets less certain, and where no
    time of periastron or conjunction is published its phase is unknown. Without a star all stars with known planets
    are listed, with one also the days of the next years on which it stands in a dark hole. With -v: also why some
    planets are not counted, every window, and where orbits and status are from.

    Examples:

      cpic known

      cpic known "eps Eri"

      cpic known "pi Men" --date 2031-05-01 --years 8 --plot separation.png

      cpic known "47 UMa" --band F520 --json

      cpic known "eps Eri" --date 2034-03-01 --scene eps_eri.yaml

      cpic known --known-planets my_planets.csv

      cpic known "alpha Cen A" --candidates

    Every planet has a status. Confirmed and controversial planets are counted by cpic rank, plan and whatif;
    candidates and refuted planets are listed here with the reference. --candidates, an option of those commands
    too, counts candidates as well; refuted planets are never counted.

    Where publications disagree on an orbit, each draw takes one of them by its weight, and the answer says which.
    An orbit that a later publication contradicts is flagged orbit_superseded.

    The shipped table is that of the NASA Exoplanet Archive of 2019 with the updates since that change what can be
    seen. A table of your own (cpic catalog columns lists its columns) is laid over it: a planet of the same name is
    replaced, the others stay. It may be one of the archive (default solutions, CSV). A row with a star, a planet
    and a status changes the status alone. --known-planets none+my_planets.csv takes the file alone, archive_2019
    the table without updates, latest the newest of the archive (cpic catalog refresh --planets).
    """
    from catalogs import open_catalogue
    from cpic_core import InputError
    from cpic_planner.api.one_star import planet_of_name
    from cpic_planner.etc import build_model
    from cpic_planner.queries import DEFAULT_YEARS
    from cpic_planner.ranking import KnownChoice
    from cpic_planner.ranking.known_answer import known_answer
    from cpic_planner.targets import find_target, rank_sample

    star, plot, scene = question.star, output.plot, output.scene
    for name, value in (("--plot", plot), ("--scene", scene)):
        if star is None and value is not None:
            raise InputError(name, str(value), allowed="only with a STAR")
    table = open_catalogue(question.catalog)
    model = build_model(question.instrument, question.bands)
    choice = KnownChoice.at(
        question.known_planets or "snapshot",
        question.date_utc,
        question.albedo,
        question.instrument,
        n_draws=question.n_draws,
        seed=question.seed,
        candidates=question.candidates,
    )
    planet = None
    if star is None:
        targets = rank_sample(catalog=table, v_mag_max=question.v_mag_max, date_utc=choice.date_utc)
    else:
        try:
            targets, remark = find_target(star, catalog=table, date_utc=choice.date_utc)
        except InputError as error:
            only = planet_of_name(choice, star, error)
            planet = only.name
            targets, remark = find_target(only.star, catalog=table, date_utc=choice.date_utc)
        command.note(*filter(None, [remark]))
        name = str(targets.name[0])
        if not choice.table.listed_rows_of(name):
            raise InputError("star", star, allowed="a star with known planets", hint=choice.table.provenance)
        if (plot is not None or scene is not None) and not choice.table.rows_of(name):
            allowed, hint = "a star with a confirmed or controversial planet", "its planets are only listed"
            raise InputError("--plot" if scene is None else "--scene", star, hint=hint, allowed=allowed)
    span = None if star is None else DEFAULT_YEARS if question.years is None else question.years
    told: dict[str, Any] = {"years": span, "bands": question.bands, "catalogue": table.provenance}
    result = known_answer(model, targets, choice, planet=planet, notes=table.notes, **told)
    output.draw(partial(report.known_figure, result))
    if scene is not None:
        _write_scene(scene, str(targets.name[0]), choice, table)
    output.tell_rows(output.limit, len(result.planets))
    output.show(result, report.known_blocks(result, limit=output.limit, full=is_verbose()))


def _write_scene(path: Path, star: str, choice: KnownChoice, table: Catalogue) -> None:
    """Write the first draw of a star's planets as a scene file."""
    from cpic_core import dump_json, one_line, write_named
    from cpic_planner.ranking import known_scene

    about = f"# {star} with its known planets on {choice.date_utc}, one draw with seed {choice.seed}."
    source = f"# Orbits: {choice.table.provenance}. Node, and what else is unknown, is as likely as any other."
    body = dump_json(known_scene(star, choice, catalog=table))  # JSON is YAML
    write_named(path, f"{one_line(about)}\n{one_line(source)}\n{body}", key="--scene")
    command.note(f"wrote {command.place_of(path)}")


def visibility(question: queries.VisibilityQuestion, output: VisibilityOutput) -> None:
    """Say when stars can be seen from the orbit of the telescope, and for how long per orbit.

    Counts the angles from Sun and Moon, the dark and the sunlit limb of the Earth, the solar panels (which also
    limit the roll) and, as a fraction of all time, the South Atlantic Anomaly. All limits can be changed:
    --visibility takes a YAML file with what differs from the preset, for example moon_deg: 40. The orbit is that of
    the instrument (mission.orbit), a model whose node is assumed: seasons hold, but which weeks have the longest
    windows depends on it.

    Examples:

      cpic visibility "tau Cet"

      cpic visibility "alpha Cen B" --start 2029-06-01 --days 730 --plot visibility.png

      cpic visibility "tau Cet" "eps Eri" "61 Cyg A" "eps Ind" --plot calendar.png

      cpic visibility "tau Cet" --visibility my_limits.yaml --out days.csv

      cpic visibility "tau Cet" --step-days 0.25 --days 30 --json

      cpic visibility "my star" --catalog my_stars.csv
    """
    from cpic_planner.api import visibility_of

    result = visibility_of(question, command.note)
    if output.out is not None:
        rows = len(result.targets) * len(result.mjd)
        command.write_out(output.out, lambda: report.visibility_csv(result), rows, rows)
    output.draw(partial(report.visibility_figure, result))
    seen = any(target.observable_days for target in result.targets)
    output.show(result, report.visibility_blocks(result, full=is_verbose()), seen)
