"""The commands ``cpic cache``, ``cpic schema`` and ``cpic check``."""

import os
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from cpic_core import InputError, cache_info, clear_cache
from cpic_planner import report
from cpic_planner.cli.asking import Commands
from cpic_planner.cli.options import JsonOption, Output, help_alone, print_json, say
from cpic_planner.cli.progress import heard

app = Commands(
    help="Show what the disk cache holds, and empty it. Emptying it is always safe. The environment variables "
    "CPIC_CACHE_DIR and CPIC_CACHE_MAX_MB say where it is and how large it may become (2000 MB without the second); "
    "what was not used for longest is removed first.",
    invoke_without_command=True,
)
app.callback(invoke_without_command=True)(help_alone)


@app.command("info")
@heard
def info(as_json: JsonOption = False) -> None:
    """Show folder, entries, size and its limit (example: cpic cache info)."""
    cache = cache_info()
    if as_json:
        print_json(asdict(cache) | {"folder": str(cache.folder)})
        return
    size = f"{cache.n_entries} entries, {cache.size_bytes / 1e6:.1f} of at most {cache.limit_bytes / 1e6:g} MB"
    say(f"{cache.folder}: {size} (CPIC_CACHE_DIR moves it, CPIC_CACHE_MAX_MB limits it)")


@app.command("clear")
@heard
def clear() -> None:
    """Remove every entry (example: cpic cache clear)."""
    was = clear_cache()
    say(f"removed {was.n_entries} entries, {was.size_bytes / 1e6:.1f} MB from {was.folder}")


def schema(
    name: Annotated[
        str, typer.Argument(help="rank, etc, plan, confirm, run, simulation or check; or etc-question ...")
    ],
) -> None:
    """Print the JSON Schema of a result: rank, etc, plan, confirm, run, simulation, check and others; or of a
    question, which is what options, keywords and YAML files of a command can say: etc-question, rank-question and
    so on.

    Examples:

      cpic schema plan > plan.schema.json

      cpic schema etc-question
    """
    from cpic_planner.schemas import schema_text

    sys.stdout.write(schema_text(name))


def check(
    paths: Annotated[list[Path], typer.Argument(metavar="FILE|TREE...", help="Level-0 files or folders of them.")],
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 for warnings too.")] = False,
    as_json: JsonOption = False,
) -> None:
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
    from cpic_planner.jobs import check_tree
    from cpic_planner.results import CheckResult, FindingRecord
    from simulator.products import ProductName

    for path in paths:
        if not os.path.exists(path):
            raise InputError("path", str(path), allowed="a file or a folder that exists")
    findings = [item for path in paths for item in check_tree(path)]
    files = {
        file.resolve()
        for path in paths
        for file in ([path] if path.is_file() else path.rglob("*.fits"))
        if path.is_file() or ProductName.parse(file.name) is not None
    }
    errors = sum(item.severity == "error" for item in findings)
    result = CheckResult(
        paths=[str(path) for path in paths],
        n_files=len(files),
        n_errors=errors,
        n_warnings=len(findings) - errors,
        findings=[FindingRecord.of(item, path=str(item.path)) for item in findings],
    )
    Output("json" if as_json else "table").show(result, partial(report.print_check, result))
    if errors or (strict and findings):
        raise typer.Exit(1)
