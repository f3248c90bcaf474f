"""The calculator and the ranking as pages and data, all pages as one application, and how it is run."""

from __future__ import annotations

import functools
import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlencode

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from cpic_core import InputError, cache_dir, dump_json, only_sent_files, parse_json
from cpic_planner import report
from cpic_planner.results import Result
from cpic_planner.schemas import openapi_text
from cpic_planner.version import __version__
from cpic_planner.web import answers, forms, pages, star
from cpic_planner.web.answers import etc_figure
from cpic_planner.web.asking import ETC, RANK, Asking, Pairs
from cpic_planner.web.columns import COLUMNS
from cpic_planner.web.commands import Commands
from cpic_planner.web.compare import COMPARE
from cpic_planner.web.guard import FAILED, HEADERS, Guard, line
from cpic_planner.web.job_pages import JobPages
from cpic_planner.web.job_queue import JobQueue
from cpic_planner.web.runs import RunPages
from cpic_planner.web.sent import Sent, read_sent
from cpic_planner.web.star import STAR, View
from cpic_planner.web.work import Busy, Kept, Workers

MOST_PARAMETERS = 200
_FORM_OF: dict[str, Callable[..., forms.Form]] = {"etc": forms.etc_form, "rank": forms.rank_form}
VIEWS = (STAR, COMPARE, COLUMNS)
"""Pages that are no question of a command."""
_OWN = ("format", "limit")
"""Parameters of an address that are no fields of the question."""
_SVG_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_ABOUT = {
    "etc": "Wall time for an SNR or a detection, SNR in a time, or the contrast limit, of one star or known planet. "
    "The address of an answer is its question: share it.",
    "rank": "Which stars promise most planets per hour of telescope time, among 1077 nearby ones.",
}
_TITLE = {"etc": "CPI-C exposure-time calculator", "rank": "CPI-C priorities"}


class Site:
    """Pages and data of one server.

    Parameters
    ----------
    workers : Workers
        Who computes.
    """

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._kept: Kept[tuple[Any, ...]] = Kept()

    def routes(self) -> list[Route]:
        """Return the addresses that are answered."""
        found = [
            Route("/", lambda _: RedirectResponse(ETC.page, 307)),
            Route("/style.css", _style),
            Route("/page.js", _script),
        ]
        found.append(Route("/favicon.ico", _no_icon))
        for asking in (ETC, RANK):
            found.append(Route(asking.page, partial(self._asked, asking)))
            found += [
                Route(f"{asking.page}.{form}", partial(self._figure, asking, form)) for form in answers.FIGURE_MEDIA
            ]
            found.append(Route(asking.page, partial(self._posted, asking), methods=["POST"]))
            found.append(Route(f"{asking.page}/own", partial(_own_form, asking)))
        for view in VIEWS:
            found.append(Route(view.path, partial(self._viewed, view)))
            if view.takes_files:
                found.append(Route(view.path, partial(self._viewed_with_files, view), methods=["POST"]))
            if view.takes_files and not view.form((), None).sends:
                found.append(Route(f"{view.path}/own", partial(_own_view, view)))
        found += [Route(f"{star.PAGE}/{{which}}.{form}", partial(self._star, form)) for form in answers.FIGURE_MEDIA]
        return found

    async def _viewed(self, view: View, request: Request) -> Response:
        """Show what is no question of a command as a page or as data; without parameters its form."""
        form, given = "", _parameters(request)
        try:
            form, given = _form_of_view(given)
            pairs = view.pairs(given)
            if not form and any(not text for _, text in given):
                return RedirectResponse(f"{view.path}?{urlencode(pairs)}", 303)
            if not pairs and not form:
                return _page(pages.page(view.title, view.about, view.form((), None), own=_own_of(view)))
            return await self._workers.do(_view, view, pairs, form, key=(view.path, pairs, form))
        except InputError as error:
            return _refused_view(view, given, error, form)

    async def _viewed_with_files(self, view: View, request: Request) -> Response:
        """Show a page about files that are sent."""
        form, given = "", list[tuple[str, str]]()
        try:
            sent = read_sent(request.headers.get("content-type", ""), await request.body())
            form, given = _form_of_view([(name, text.strip()) for name, text in sent.given])
            return await self._workers.do(_view_sent, view, given, form, sent)
        except InputError as error:
            return _refused_view(view, given, error, form, sends=True)

    async def _star(self, form: answers.FigureForm, request: Request) -> Response:
        """Draw a figure of a star."""
        which = request.path_params["which"]
        if which not in star.FIGURES:
            raise HTTPException(404)
        try:
            pairs = star.star_pairs(_parameters(request))
            tag = answers.tag_of(f"{which}.{form}", pairs)
            drawing = partial(self._workers.do, star.star_figure, pairs, which, form, key=tag)
            return await _drawing(request, tag, form, drawing, STAR.title)
        except InputError as error:
            return line(str(error), 400)

    async def _asked(self, asking: Asking[Any], request: Request) -> Response:
        """Answer a question as a page or as data; without parameters the calculator's page is its form."""
        given = _parameters(request)
        form, rest = _own(given, "format"), [(name, text) for name, text in given if name not in _OWN]
        limit = _own(given, "limit") if asking is RANK else ""
        try:
            _check_own(given, asking)
            pairs, shown = asking.canonical(rest), {"limit": limit} if limit else {}
            rows = answers.rows_of(limit)
            if form not in ("", "html", *answers.MEDIA):
                raise InputError("format", form[:40], allowed=f"html, {', '.join(answers.MEDIA)}")
            if form in ("", "html") and any(not text for _, text in given):
                return RedirectResponse(asking.address(pairs, **shown), 303)
            if not given and asking is ETC:
                return _page(pages.page(_TITLE["etc"], _ABOUT["etc"], forms.etc_form(()), own=f"{asking.page}/own"))
            key = (asking.page, pairs, rows, form, bool(shown))
            kept = self._kept.get(key)
            if kept is None:
                made = await self._workers.do(_answer, asking, pairs, rows, form, shown, key=key)
                kept = bytes(made.body), str(made.media_type)
                self._kept.put(key, *kept)
            return Response(kept[0], media_type=kept[1])
        except InputError as error:
            return _refused(asking, given, error, form)

    async def _posted(self, asking: Asking[Any], request: Request) -> Response:
        """Answer a question that comes with files."""
        given: Sequence[tuple[str, str]] = ()
        form = "" if "text/html" in request.headers.get("accept", "") else "line"
        try:
            sent = read_sent(request.headers.get("content-type", ""), await request.body())
            given = [(name, text.strip()) for name, text in sent.given]
            form = _own(given, "format")
            _check_own(given, asking)
            rest = [(name, text) for name, text in given if name not in _OWN]
            pairs, rows = asking.canonical(rest), answers.rows_of(_own(given, "limit") if asking is RANK else "")
            if form not in ("", "html", *answers.MEDIA):
                raise InputError("format", form[:40], allowed=f"html, {', '.join(answers.MEDIA)}")
            return await self._workers.do(_answer_sent, asking, pairs, rows, form, sent)
        except InputError as error:
            return _refused(asking, given, error, form, sends=True)

    async def _figure(self, asking: Asking[Any], form: answers.FigureForm, request: Request) -> Response:
        """Draw an answer, unless the asker has its figure already."""
        given = _parameters(request)
        try:
            _check_own(given, asking)
            if _own(given, "format"):
                raise InputError("format", _own(given, "format")[:40], allowed="without it: this is a figure")
            pairs = asking.canonical((name, text) for name, text in given if name not in _OWN)
            limit = min(answers.rows_of(_own(given, "limit")), report.MOST_STARS)
            tag = answers.tag_of(f"{asking.page}.{form} {limit}", pairs)
            draw: Callable[..., bytes] = answers.etc_figure
            more: tuple[Any, ...] = (form,)
            if asking is RANK:
                draw, more = answers.rank_figure, (limit, form)
            drawing = partial(self._workers.do, draw, pairs, *more, key=tag)
            return await _drawing(request, tag, form, drawing, _TITLE[asking.command])
        except InputError as error:
            return line(str(error), 400)


async def _drawing(
    request: Request, tag: str, form: answers.FigureForm, draw: Callable[[], Awaitable[bytes]], title: str
) -> Response:
    """Send a figure or its values, unless the asker has them already."""
    headers = {"ETag": tag, "Cache-Control": "private, max-age=86400"}
    if form != "values":
        headers["Content-Security-Policy"] = _SVG_POLICY
    if tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    body = await draw()
    if form == "values":
        path, query = request.url.path.removesuffix(".values"), request.url.query
        addresses = f"{path}.svg?{query}", f"/{path.split('/')[1]}?{query}"
        body = (await run_in_threadpool(pages.values_page, title, *addresses, body)).encode()
    return Response(body, media_type=answers.FIGURE_MEDIA[form], headers=headers)


def _form_of_view(given: Sequence[tuple[str, str]]) -> tuple[str, list[tuple[str, str]]]:
    """Return the form of an answer, empty for a page, and the other parameters."""
    asked = [text for name, text in given if name == "format" and text not in ("", "html")]
    if asked not in ([], ["json"]):
        raise InputError("format", asked[0][:40], allowed="html or json, once")
    return "".join(asked), [(name, text) for name, text in given if name != "format"]


def _view(view: View, pairs: Pairs, form: str) -> Response:
    """Make a page, or data; this runs in a thread of its own."""
    with only_sent_files({}):
        if form:
            return _data(view.result(pairs))
        asked = urlencode(pairs)
        told = (view.heading(pairs), view.about, view.form(pairs, None), view.blocks(pairs))
        return _page(pages.page(*told, [("JSON", f"{view.path}?{asked}&format=json")], _own_of(view, asked)))


def _view_sent(view: View, given: Sequence[tuple[str, str]], form: str, sent: Sent) -> Response:
    """Make a page about files that were sent, or data; this runs in a thread of its own."""
    with only_sent_files(sent.files):
        pairs = view.pairs(given)
        if form:
            return _data(view.result(pairs, sent), _of_sent(sent))
        blocks, fields = [*view.blocks(pairs, sent), *_told_of(sent)], forms.own_form(view.form(pairs, None))
        return _page(pages.page(view.heading(pairs), view.about, fields, blocks), headers=_of_sent(sent))


def _data(result: Result, headers: Mapping[str, str] | None = None) -> Response:
    return Response(dump_json(result.model_dump(mode="json")), media_type=answers.MEDIA["json"], headers=headers)


def _refused_view(
    view: View, given: Sequence[tuple[str, str]], error: InputError, form: str, *, sends: bool = False
) -> Response:
    """Answer bad input: the form with one line at the field, or JSON with its parts."""
    if form:
        return JSONResponse(answers.Problem.of(error).model_dump(mode="json"), 400)
    made = view.form([pair for pair in given if pair[0] != "format"], error)
    return _page(pages.page(view.title, view.about, forms.own_form(made) if sends else made), 400)


def _own_of(view: View, asked: str = "") -> str:
    has_own = view.takes_files and not view.form((), None).sends
    return f"{view.path}/own{'?' * bool(asked)}{asked}" if has_own else ""


async def _own_view(view: View, request: Request) -> Response:
    """Show the form of a page that takes files."""
    form = forms.own_form(view.form(_parameters(request), None))
    return _page(pages.page(view.title, view.about, form))


def _of_sent(sent: Sent) -> dict[str, str]:
    """Return the headers of an answer with files."""
    told = ", ".join(f"{name}: sha256 {own}" for name, own in sent.hashes)
    return {"Cache-Control": "no-store", "Cpic-Files": told}


def _told_of(sent: Sent) -> list[report.Block]:
    told = [report.lines(name, report.code(f"sha256 {own}")) for name, own in sent.hashes]
    return [report.Heading("Files that were sent, and not kept"), report.Items(told)]


def _parameters(request: Request) -> list[tuple[str, str]]:
    return [(name, text.strip()) for name, text in request.query_params.multi_items()]


def _own(given: Sequence[tuple[str, str]], name: str) -> str:
    return next((text for key, text in given if key == name), "")


def _check_own(given: Sequence[tuple[str, str]], asking: Asking[Any]) -> None:
    """Refuse too many parameters, and those that are given twice or to no end."""
    if len(given) > MOST_PARAMETERS:
        raise InputError("parameters", len(given), allowed=f"at most {MOST_PARAMETERS}")
    for name in _OWN:
        times = sum(key == name for key, _ in given)
        if times > 1 or (times and name == "limit" and asking is ETC):
            raise InputError(name, "given", allowed="once" if asking is RANK else "with the ranking only")


@only_sent_files({})
def _answer(asking: Asking[Any], pairs: Pairs, rows: int, form: str, shown: dict[str, str]) -> Response:
    """Compute an answer and write it; this runs in a thread of its own."""
    result: Any
    if asking is ETC:
        answer = answers.etc_answer(pairs)
        result, tables = answer.result, answer.print
    else:
        result = answers.ranking(pairs)
        tables = cast(Any, partial(report.print_rank, result, limit=rows))
    if form not in ("", "html"):
        return Response(answers.form_text(form, result, tables), media_type=answers.MEDIA[form])
    sources = pages.sources_of(asking, pairs, **shown)
    if asking is ETC:
        title = f"{report.pretty_name(result.target)}: {_TITLE['etc']}"
        own = ETC.address(pairs, "/own")
        return _page(pages.page(title, _ABOUT["etc"], forms.etc_form(pairs), pages.etc_blocks(pairs), sources, own))
    form_of = forms.rank_form([*pairs, *shown.items()])
    own = RANK.address(pairs, "/own", **shown)
    return _page(pages.page(_TITLE["rank"], _ABOUT["rank"], form_of, pages.rank_blocks(pairs, rows), sources, own))


def _answer_sent(asking: Asking[Any], pairs: Pairs, rows: int, form: str, sent: Sent) -> Response:
    """Return the answer with files that were sent; this runs in a thread of its own."""
    with only_sent_files(sent.files):
        headers = _of_sent(sent)
        if form in ("", "html"):
            blocks = pages.etc_blocks(pairs, sent) if asking is ETC else pages.rank_blocks(pairs, rows, sent)
            blocks = [*blocks, *_told_of(sent)]
            made = _FORM_OF[asking.command](pairs, None)
            page = pages.page(_TITLE[asking.command], _ABOUT[asking.command], forms.own_form(made), blocks)
            policy = HEADERS["Content-Security-Policy"].replace("img-src 'self'", "img-src 'self' data:")
            return _page(page, headers=headers | {"Content-Security-Policy": policy})
        result: Any
        if asking is ETC:
            answer = answers.fresh_etc(pairs, sent)
            result, tables = answer.result, answer.print
        else:
            result = answers.fresh_ranking(pairs, sent)
            tables = cast(Any, partial(report.print_rank, result, limit=rows))
        return Response(answers.form_text(form, result, tables), media_type=answers.MEDIA[form], headers=headers)


async def _own_form(asking: Asking[Any], request: Request) -> Response:
    """Show the form that takes files; an address fills in the rest."""
    made = _FORM_OF[asking.command](_parameters(request), None)
    return _page(pages.page(_TITLE[asking.command], _ABOUT[asking.command], forms.own_form(made)))


def _page(text: str, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    return Response(text, status, media_type="text/html; charset=utf-8", headers=headers)


def _refused(
    asking: Asking[Any], given: Sequence[tuple[str, str]], error: InputError, form: str, *, sends: bool = False
) -> Response:
    """Answer bad input: the form with one line at the field, JSON with its parts, or one line."""
    if form == "json":
        return JSONResponse(answers.Problem.of(error).model_dump(mode="json"), 400)
    if form not in ("", "html"):
        return line(str(error), 400)
    made = _FORM_OF[asking.command](given, error)
    made = forms.own_form(made) if sends else made
    return _page(pages.page(_TITLE[asking.command], _ABOUT[asking.command], made), 400)


async def _style(request: Request) -> Response:
    return Response(pages.style_sheet(), media_type="text/css", headers={"Cache-Control": "private, max-age=3600"})


async def _script(request: Request) -> Response:
    return Response(pages.script(), media_type="text/javascript", headers={"Cache-Control": "private, max-age=3600"})


async def _no_icon(request: Request) -> Response:
    return Response(status_code=204)


async def _missing(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 404
    return line("There is no such page; /etc, /priorities, /star, /compare and /columns are the pages.", status)


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
