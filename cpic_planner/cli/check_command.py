"""``cpic check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cpic_planner.cli.options import JsonOption
from cpic_planner.cli.output import console, print_json

__all__ = ["HELP", "check"]

HELP = """Check Level-0 products against the specification: single files, or whole trees of them.

Names, structure, keywords, times, world coordinates, pixel values, checksums; in a tree also numbers used twice, the
folders of parameters, and truth. Exit status: 0 if nothing is against the specification, 1 if something is, 2 for a
path that is not there. Warnings (unusual, but allowed) do not count unless --strict.

Examples:

  cpic check out/simulate

  cpic check out/simulate/SCI/61771/*.fits

  cpic check my_tree --json | python -m json.tool"""


def check(
    paths: Annotated[list[Path], typer.Argument(metavar="FILE|TREE...", help="Level-0 files or folders of them.")],
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 for warnings too.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Check and print."""
    from catalogs.errors import InputError
    from cpic_planner.models import CheckResult, FindingRecord
    from simulator.products import check_level0
    from simulator.products.naming import ProductName

    for path in paths:
        if not path.exists():
            raise InputError("path", str(path), allowed="a file or a folder that exists")
    found = [item for path in paths for item in check_level0(path)]
    files = {
        file.resolve()
        for path in paths
        for file in ([path] if path.is_file() else path.rglob("*.fits"))
        if path.is_file() or ProductName.parse(file.name) is not None
    }
    errors = sum(item.severity == "error" for item in found)
    result = CheckResult(
        paths=[str(path) for path in paths],
        n_files=len(files),
        n_errors=errors,
        n_warnings=len(found) - errors,
        findings=[FindingRecord.of(item, path=str(item.path)) for item in found],
    )
    if as_json:
        print_json(result)
    else:
        from cpic_planner.report.products import print_check

        print_check(result, console())
    if errors or (strict and found):
        raise typer.Exit(1)
