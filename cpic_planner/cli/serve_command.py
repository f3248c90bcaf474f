"""The command ``cpic serve``."""

from __future__ import annotations

import importlib.util
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from cpic_core import InputError
from cpic_planner.cli.options import note

_NEEDED = ("starlette", "uvicorn")


def serve(
    host: Annotated[
        str, typer.Option("--host", help="Address that the server is bound to: this machine alone, unless said.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Port.")] = 8765,
    allow_host: Annotated[
        list[str] | None,
        typer.Option("--allow-host", metavar="NAME", help="Answer under this name too; repeat for several."),
    ] = None,
    jobs: Annotated[
        Path | None,
        typer.Option(
            "--jobs", metavar="DIR", help="Folder of jobs and their results. [default: one in the cache folder]"
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--folder", metavar="DIR", help="Show the plans, what-ifs and rankings beneath this folder."),
    ] = None,
) -> None:
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

    address = f"http://{f'[{host}]' if ':' in host else host}:{port}/etc"
    run(host, port, allow_host or (), jobs=jobs, folder=folder, ready=partial(note, f"{address} (Ctrl-C ends it)"))
