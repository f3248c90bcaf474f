"""The calculator as a server: its pages and data, all pages as one application, and how it is run."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Sequence
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from cpic_core import InputError, cache_dir, only_sent_files, parse_json
from cpic_planner.schemas import openapi_text
from cpic_planner.version import __version__
from cpic_planner.web import pages
from cpic_planner.web.addresses import MOST_PARAMETERS, Pairs, Submission, address, read_submission
from cpic_planner.web.answers import ETC_PAGE, PAGES, etc_answer
from cpic_planner.web.guard import FAILED, HEADERS, AnswerCache, Busy, Guard, TimedProtocol, Workers, line
from cpic_planner.web.job_pages import JobPages
from cpic_planner.web.job_queue import JobQueue
from cpic_planner.web.pages import FIGURE_MEDIA, MEDIA, FigureForm, Page, drawn
from cpic_planner.web.runs import RunPages, commands

_SVG_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_DRAWN_INSIDE = HEADERS["Content-Security-Policy"].replace("img-src 'self'", "img-src 'self' data:")


class Site:
    """Pages and data of one server.

    Parameters
    ----------
    workers : Workers
        Who computes.
    """

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._kept: AnswerCache[tuple[Any, ...]] = AnswerCache()

    def routes(self) -> list[Route]:
        """Return the addresses that are answered."""
        found = [
            Route("/", lambda _: RedirectResponse(ETC_PAGE.path, 307)),
            Route("/style.css", _style),
            Route("/page.js", _script),
            Route("/favicon.ico", _no_icon),
        ]
        for page in PAGES:
            found.append(Route(page.path, partial(self._shown, page)))
            if page.takes_files:
                found.append(Route(page.path, partial(self._posted, page), methods=["POST"]))
            if page.has_own:
                found.append(Route(f"{page.path}/own", partial(_own_form, page)))
            for name in page.figures:
                found += [
                    Route(page.drawing(name, form), partial(self._figure, page, name, form)) for form in FIGURE_MEDIA
                ]
        return found

    async def _shown(self, page: Page, request: Request) -> Response:
        """Answer a question as a page or as data; most pages are their form without parameters."""
        given = _parameters(request)
        form, rest = _form_of(given)
        try:
            _check(page, given)
            pairs = page.pairs(rest)
            if not form and any(not text for _, text in given):
                return RedirectResponse(address(page.path, pairs), 303)
            if not given and not page.answers_all:
                return pages.html(page.asked(()))
            key = page.path, pairs, form
            kept = self._kept.get(key)
            if kept is None:
                made = await self._workers.do(_answer, page, pairs, form, None, key=key)
                kept = bytes(made.body), str(made.media_type)
                self._kept.put(key, *kept)
            return Response(kept[0], media_type=kept[1])
        except InputError as error:
            return pages.refused(error, form, partial(page.asked, rest, error))

    async def _posted(self, page: Page, request: Request) -> Response:
        """Answer a question that comes with files."""
        rest: Sequence[tuple[str, str]] = ()
        form = "" if "text/html" in request.headers.get("accept", "") else "line"
        try:
            submission = read_submission(request.headers.get("content-type", ""), await request.body())
            given = [(name, text.strip()) for name, text in submission.given]
            form, rest = _form_of(given)
            _check(page, given)
            return await self._workers.do(_answer, page, rest, form, submission)
        except InputError as error:
            return pages.refused(error, form, partial(page.asked, rest, error, sends=True))

    async def _figure(self, page: Page, name: str, form: FigureForm, request: Request) -> Response:
        """Send a figure or its values, unless the asker has them already."""
        given = _parameters(request)
        asked, rest = _form_of(given)
        try:
            if asked:
                raise InputError("format", asked[:40], allowed="without it: this is a figure")
            _check(page, given)
            pairs = page.pairs(rest)
            return await self._drawing(page, pairs, name, form, request)
        except InputError as error:
            return line(str(error), 400)

    async def _drawing(self, page: Page, pairs: Pairs, name: str, form: FigureForm, request: Request) -> Response:
        tag = pages.tag_of(page.drawing(name, form), pairs)
        headers = {"ETag": tag, "Cache-Control": "private, max-age=86400"}
        if form != "values":
            headers["Content-Security-Policy"] = _SVG_POLICY
        if tag in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
        kept = self._kept.get((tag,))
        if kept is None:
            kept = await self._workers.do(_drawn, page, pairs, name, form, key=tag), FIGURE_MEDIA[form]
            self._kept.put((tag,), *kept)
        body, media = kept
        if form == "values":
            query = request.url.query
            addresses = f"{page.drawing(name, 'svg')}?{query}", f"{page.path}?{query}"
            body = (await run_in_threadpool(pages.values_page, page.title, *addresses, body)).encode()
        return Response(body, media_type=media, headers=headers)


def _parameters(request: Request) -> list[tuple[str, str]]:
    return [(name, text.strip()) for name, text in request.query_params.multi_items()]


def _form_of(given: Sequence[tuple[str, str]]) -> tuple[str, list[tuple[str, str]]]:
    """Return the form of an answer, empty for a page, and the other parameters."""
    form = next((text for name, text in given if name == "format"), "")
    return "" if form == "html" else form, [pair for pair in given if pair[0] != "format"]


def _check(page: Page, given: Sequence[tuple[str, str]]) -> None:
    """Refuse too many parameters, and another form of the answer or several."""
    if len(given) > MOST_PARAMETERS:
        raise InputError("parameters", len(given), allowed=f"at most {MOST_PARAMETERS}")
    forms = [text for name, text in given if name == "format"]
    if len(forms) > 1 or not set(forms) <= {"", "html", *page.media}:
        raise InputError("format", forms[0][:40], allowed=f"html, {', '.join(page.media)}, once")


def _answer(page: Page, given: Sequence[tuple[str, str]], form: str, submission: Submission | None) -> Response:
    """Compute an answer and write it; this runs in a thread of its own."""
    with only_sent_files({} if submission is None else submission.files):
        pairs = page.pairs(given)
        answer = page.answer(pairs, submission)
        headers = {} if submission is None else _of_sent(submission)
        if form:
            return Response(answer.text(form), media_type=MEDIA[form], headers=headers)
        if submission is not None and page.figures:
            headers["Content-Security-Policy"] = _DRAWN_INSIDE
        return pages.html(page.answered(answer, pairs, submission), headers=headers)


@only_sent_files({})
def _drawn(page: Page, pairs: Pairs, name: str, form: FigureForm) -> bytes:
    """Draw a figure of an answer; this runs in a thread of its own."""
    assert page.figure is not None
    return drawn(page.figure(pairs, name), form)


def _of_sent(submission: Submission) -> dict[str, str]:
    """Return the headers of an answer with files."""
    told = ", ".join(f"{name}: sha256 {own}" for name, own in submission.hashes)
    return {"Cache-Control": "no-store", "Cpic-Files": told}


async def _own_form(page: Page, request: Request) -> Response:
    """Show the form that takes files; an address fills in the rest."""
    return pages.html(page.asked(_parameters(request), sends=True))


async def _style(request: Request) -> Response:
    return Response(pages.style_sheet(), media_type="text/css", headers={"Cache-Control": "private, max-age=3600"})


async def _script(request: Request) -> Response:
    return Response(pages.script(), media_type="text/javascript", headers={"Cache-Control": "private, max-age=3600"})


async def _no_icon(request: Request) -> Response:
    return Response(status_code=204)


_PATHS = [page.path for page in PAGES]
_NO_PAGE = f"There is no such page; {', '.join(_PATHS[:-1])} and {_PATHS[-1]} are the pages."


async def _missing(request: Request, error: HTTPException) -> Response:
    plain = error.detail == HTTPStatus(error.status_code).phrase
    return line(_NO_PAGE if plain else error.detail, error.status_code)


async def _busy(request: Request, error: Exception) -> Response:
    return line("Too many questions wait for an answer; ask again in a moment.", 503, **{"Retry-After": "5"})


async def _late(request: Request, error: Exception) -> Response:
    return line("The answer takes too long here; the command line has no limit of time.", 504)


async def _failed(request: Request, error: Exception) -> Response:
    return line(FAILED, 500)


HANDLERS: dict[Any, Any] = {HTTPException: _missing, Busy: _busy, TimeoutError: _late, Exception: _failed}
"""What answers instead where something is raised."""


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
    routes = [*Site(workers).routes(), *RunPages(folder).routes(), Route("/openapi.json", openapi)]
    routes.append(Route("/commands", partial(commands, workers)))
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

    usual = (("target", "tau Cet"),)
    _answer(ETC_PAGE, usual, "", None)  # what the first asker would wait for
    names = (host, "127.0.0.1", "::1", "localhost", *hosts)
    with JobQueue(jobs or cache_dir() / "web-jobs") as queue:
        queue.start()
        app = application(names, jobs=queue, folder=folder)
        ready()
        # The first figure would wait for the import of matplotlib and its fonts. The thread is no daemon: the end of
        # the interpreter would cut it inside compiled code, and the process would be killed by a signal.
        threading.Thread(target=drawn, args=(etc_answer(usual).figure, "svg")).start()
        uvicorn.run(app, host=host, port=port, http=TimedProtocol, **UVICORN)
