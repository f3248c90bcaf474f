"""The commands about the package itself: ``cpic instrument``, ``cache``, ``schema``, ``check`` and ``serve``."""

from __future__ import annotations

import importlib.util
import os
import sys
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

import typer

from cpic_core import InputError, cache_info, clear_cache, dump_json
from cpic_planner import report
from cpic_planner.cli.command import note, place_of, print_json, say, write_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cpic_planner.cli.output import (
        CheckOutput,
        CompareOutput,
        DiffOutput,
        InstrumentOutput,
        JsonOutput,
        KeysOutput,
        Output,
        SchemaOptions,
        ServeOptions,
        TableOptions,
    )

INSTRUMENT_HELP = "Show what an instrument is, which of its values --set can change, and how two instruments differ."
CACHE_HELP = """Show what the disk cache holds, and empty it. Emptying it is always safe. The environment variables
CPIC_CACHE_DIR and CPIC_CACHE_MAX_MB say where it is and how large it may become (2000 MB without the second); what was
not used for longest is removed first."""


def _show_values(output: Output, layout: str, name: str, changes: Sequence[str], key: str, other: str = "") -> None:
    """Show the values of an instrument, or those in which it differs from another."""
    from cpic_planner.queries import changed_instrument, instrument_rows, instrument_title
    from cpic_planner.results import InstrumentResult

    one, two = changed_instrument(name, changes), changed_instrument(other, ()) if other else None
    title = instrument_title(one) if two is None else f"{instrument_title(one)} beside {instrument_title(two)}"
    result = InstrumentResult(title=title, values=instrument_rows(one, key, other=two))
    output.show(result, report.instrument_blocks(result, layout))


def show(output: InstrumentOutput) -> None:
    """Show every value of an instrument, with its source and how sure it is (P published, I inferred, A assumed).

    Examples:

      cpic instrument show

      cpic instrument show as_published --key drift

      cpic instrument show --set drift=0.1nm --key drift --json
    """
    _show_values(output, "key value unit confidence source", output.instrument, output.changes, output.key)


def keys(output: KeysOutput) -> None:
    """List the keys that --set and --simulator-overrides take, with short names and the values of the default.

    Examples:

      cpic instrument keys

      cpic instrument keys drift
    """
    _show_values(output, "key short_name value unit", "cpic_default", (), output.key)


def diff(output: DiffOutput) -> None:
    """List the values in which an instrument differs from another; --set changes the first.

    Examples:

      cpic instrument diff as_published

      cpic instrument diff cpic_default --set throughput=x0.7
    """
    _show_values(output, "key value other unit", output.instrument, output.changes, output.key, output.other)


def compare(output: CompareOutput) -> None:
    """Say what differs between two answers of one kind, in the question and in the answer, and what explains it.

    RUN is the output folder of cpic plan, whatif, confirm, curve or roc, one of its JSON files, or what --json
    printed (cpic etc "tau Cet" --snr 8 --json > a.json). Rows are matched by star, band and strategy. Verdicts, status
    and limits that change come first, then numbers by how much they change. What explains it is a difference of the
    questions, as far as the answers state them and the records of runs have their commands, or of code, presets,
    catalogue or libraries; where there is none, that is said. Rankings are compared star by star, as by cpic rank
    --compare, and may be tables of its --out too.

    Examples:

      cpic compare plan-may plan-june

      cpic compare a.json b.json --out differences.html

      cpic compare ranking.csv new.json --limit 50
    """
    from cpic_planner.api import compare_answers
    from cpic_planner.cli.output import FORM_OF_ENDING
    from cpic_planner.queries import called_as
    from cpic_planner.results import AnswerComparison

    with called_as({"before": "RUN", "after": "RUN", "other": "RUN"}):
        found = compare_answers(output.before, output.after)
    if output.out is not None:
        form = FORM_OF_ENDING.get(output.out.suffix)
        every = len(found.changes if isinstance(found, AnswerComparison) else found.targets)
        if form is None:
            text = partial(report.comparison_page, found)
        elif form == "json":
            text = partial(dump_json, found.model_dump(mode="json"))
        else:
            text = partial(output.text, form, found, report.comparison_blocks(found, max(every, 1)))
        write_out(output.out, text, every, every)
    output.show(found, report.comparison_blocks(found, output.limit))


def table(options: TableOptions) -> None:
    """Write what the coronagraph of an instrument does by separation: a table that coronagraph.table reads.

    Examples:

      cpic instrument table --band F662 --out f662.csv

      cpic instrument table cpic_2q --band F520 --set wavefront.jitter_mas=10 --out f520.csv
    """
    from cpic_planner.queries import called_as, changed_instrument
    from simulator import write_coronagraph_table

    instrument = changed_instrument(options.instrument, options.changes)
    if not options.band:
        raise InputError("--band", "missing", allowed=", ".join(instrument.bands))
    try:
        with called_as({"path": "--out"}):
            write_coronagraph_table(instrument, options.band, options.out)
    except OSError as error:
        raise InputError("--out", str(options.out), allowed="a writable file", hint=error.strerror or "") from None
    note(f"wrote {place_of(options.out)}")


def info(output: JsonOutput) -> None:
    """Show folder, entries, size and its limit (example: cpic cache info)."""
    cache = cache_info()
    if output.as_json:
        print_json(asdict(cache) | {"folder": str(cache.folder)})
        return
    size = f"{cache.n_entries} entries, {cache.size_bytes / 1e6:.1f} of at most {cache.limit_bytes / 1e6:g} MB"
    say(f"{cache.folder}: {size} (CPIC_CACHE_DIR moves it, CPIC_CACHE_MAX_MB limits it)")


def clear() -> None:
    """Remove every entry (example: cpic cache clear)."""
    was = clear_cache()
    say(f"removed {was.n_entries} entries, {was.size_bytes / 1e6:.1f} MB from {was.folder}")


def schema(options: SchemaOptions) -> None:
    """Print the JSON Schema of a result: rank, etc, plan, confirm, run, simulation, check and others; or of a
    question, which is what options, keywords and YAML files of a command can say: etc-question, rank-question and
    so on.

    Examples:

      cpic schema plan > plan.schema.json

      cpic schema etc-question
    """
    from cpic_planner.schemas import schema_text

    sys.stdout.write(schema_text(options.name))


def check(output: CheckOutput) -> None:
    """Check Level-0 products against the specification: single files, or whole trees of them.

    Names, structure, keywords, times, world coordinates, pixel values, checksums; in a tree also numbers used
    twice, the folders of parameters, and truth. In the folder of a run, of any kind, also the chain from its record to
    its list and from there to every file: checksums, files that are gone, and whether one and the same software
    made all of its parts and products. Exit status: 0 if nothing is against the specification, 1 if
    something is, 2 for a path that is not there. Warnings (unusual, but allowed) do not count unless --strict.

    Examples:

      cpic check out/simulate

      cpic check out/simulate/SCI/61771/*.fits

      cpic check my_tree --json | python -m json.tool
    """
    from cpic_planner.cli.output import Output
    from cpic_planner.jobs import check_tree
    from cpic_planner.results import CheckResult, FindingRecord
    from simulator.products import ProductName

    for path in output.paths:
        if not os.path.exists(path):
            raise InputError("path", str(path), allowed="a file or a folder that exists")
    findings = [item for path in output.paths for item in check_tree(path)]
    files = {
        file.resolve()
        for path in output.paths
        for file in ([path] if path.is_file() else path.rglob("*.fits"))
        if path.is_file() or ProductName.parse(file.name) is not None
    }
    errors = sum(item.severity == "error" for item in findings)
    result = CheckResult(
        paths=[str(path) for path in output.paths],
        n_files=len(files),
        n_errors=errors,
        n_warnings=len(findings) - errors,
        findings=[FindingRecord.of(item, path=str(item.path)) for item in findings],
    )
    Output(as_json=output.as_json).show(result, report.check_blocks(result))
    if errors or (output.strict and findings):
        raise typer.Exit(1)


_NEEDED = ("starlette", "uvicorn")


def serve(options: ServeOptions) -> None:
    """Serve the calculator and the priorities to web browsers, until interrupted.

    The address of an answer is its question, with the fields of the question as parameters:
    /etc?target=tau+Cet&snr=5 is cpic etc "tau Cet" --snr 5, and with &format=json it gives the very bytes of --json;
    csv, ecsv, latex and markdown are those of --format. /etc.svg is its figure. /priorities is cpic rank.

    /jobs simulates images of a star, one job after the other in a process of its own; questions and results of jobs
    are kept in --jobs DIR, and what a stopped server leaves undone the next one finishes. /runs shows what cpic plan,
    whatif, confirm and rank wrote beneath --folder DIR, as it was written. /commands has what is not run for visitors,
    with its expected cost. /openapi.json describes all for programs.

    Only this machine is served by default. Behind a proxy say under which name it is asked: --allow-host NAME.
    Requests name no files, have at most 4 kB of address and 20 kB of body, and arrive in 10 s or are refused. Answers
    take a minute or are refused. Of questions that are no jobs nothing is kept but their answers, in memory.

    It needs starlette and uvicorn: pip install "cpic-planner[web]".

    Examples:

      cpic serve

      cpic serve --folder my-plans --jobs my-jobs

      cpic serve --host 0.0.0.0 --port 80 --allow-host cpic.example.org
    """
    if any(importlib.util.find_spec(name) is None for name in _NEEDED):
        raise InputError("cpic serve", "not installed", allowed='after pip install "cpic-planner[web]"')
    from cpic_planner.web import serve as run

    host, port = options.host, options.port
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}/etc"
    ready = partial(note, f"{address} (Ctrl-C ends it)")
    run(host, port, options.allow_host, jobs=options.jobs, folder=options.folder, ready=ready)
