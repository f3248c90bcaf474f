"""All pages as one application, and how it is run."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from cpic_core import cache_dir, parse_json
from cpic_planner.schemas import openapi_text
from cpic_planner.version import __version__
from cpic_planner.web import pages
from cpic_planner.web.answers import etc_figure
from cpic_planner.web.commands import Commands
from cpic_planner.web.guard import Guard
from cpic_planner.web.job_pages import JobPages
from cpic_planner.web.job_queue import JobQueue
from cpic_planner.web.runs import RunPages
from cpic_planner.web.server import HANDLERS, Site
from cpic_planner.web.work import Workers

UVICORN: dict[str, Any] = {
    "log_level": "warning",
    "access_log": False,
    "server_header": False,
    "ws": "none",
    "lifespan": "off",
    "proxy_headers": False,
    "timeout_keep_alive": 5,
    "limit_concurrency": 100,
    "h11_max_incomplete_event_size": 16_384,
}
"""How the server is run."""


@functools.cache
def described() -> dict[str, Any]:
    """Return the OpenAPI document of all addresses as shipped, with the version of the package."""
    tree: dict[str, Any] = parse_json(openapi_text())
    return tree | {"info": tree["info"] | {"version": __version__}}


async def openapi(request: Request) -> Response:
    """Send the document."""
    return JSONResponse(described(), headers={"Cache-Control": "private, max-age=3600"})


def application(
    hosts: Sequence[str] = ("127.0.0.1", "localhost"),
    workers: Workers | None = None,
    *,
    jobs: JobQueue | None = None,
    folder: Path | None = None,
) -> Guard:
    """Return the calculator as an ASGI application.

    Parameters
    ----------
    hosts : sequence of str
        Names under which it may be asked, without the port.
    workers : Workers, optional
        Who computes; two threads by default.
    jobs : JobQueue, optional
        Where images wait; none are made without.
    folder : Path, optional
        Folder whose plans and what-ifs are shown.
    """
    workers = workers or Workers()
    routes = [*Site(workers).routes(), *RunPages(folder).routes(), *Commands(workers).routes()]
    routes += [Route("/openapi.json", openapi)]
    routes += JobPages(jobs, workers).routes() if jobs is not None else []
    site = Starlette(routes=routes, exception_handlers=HANDLERS)
    return Guard(site, frozenset(hosts))


def serve(
    host: str,
    port: int,
    hosts: Sequence[str] = (),
    *,
    jobs: Path | None = None,
    folder: Path | None = None,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Serve the calculator until it is interrupted.

    Parameters
    ----------
    host : str
        Address that it is bound to.
    port : int
    hosts : sequence of str
        Further names under which it may be asked.
    jobs : Path, optional
        Folder of jobs and their results, one of the cache by default.
    folder : Path, optional
        Folder whose plans and what-ifs are shown.
    ready : callable
        Called before the first request is taken.

    Raises
    ------
    InputError
        If a folder cannot be used.
    """
    import uvicorn

    from cpic_planner.web.punctual import Punctual

    usual = (("target", "tau Cet"),)
    pages.etc_blocks(usual)  # what the first asker would wait for
    names = (host, "127.0.0.1", "::1", "localhost", *hosts)
    with JobQueue(jobs or cache_dir() / "web-jobs") as queue:
        queue.start()
        app = application(names, jobs=queue, folder=folder)
        ready()
        # The first figure would wait for the import of matplotlib and its fonts. The thread is no daemon: the end of
        # the interpreter would cut it inside compiled code, and the process would be killed by a signal.
        threading.Thread(target=etc_figure, args=(usual, "svg")).start()
        uvicorn.run(app, host=host, port=port, http=Punctual, **UVICORN)
